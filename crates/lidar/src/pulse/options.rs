//! Options of the pulse physics.

use std::fmt;
use vlscan_base::corrections::Corrections;

vlscan_choice::choices! {
    /// Set of corrections to the reference's physics.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum PhysicsProfile {
        /// Reproduce HELIOS++.
        Helios = "helios",
        /// Correct its known weaknesses.
        Refined = "refined",
    }
}

impl PhysicsProfile {
    /// The default of XML surveys, which are written for HELIOS++.
    pub const OF_SURVEYS: PhysicsProfile = PhysicsProfile::Helios;
    /// The default wherever no XML survey is run: pipeline files, scenes by themselves, instruments by
    /// themselves.
    pub const OF_PIPELINES: PhysicsProfile = PhysicsProfile::Refined;

    /// The corrections that belong to the profile.
    pub fn corrections(self) -> Corrections {
        match self {
            PhysicsProfile::Helios => Corrections::NONE,
            PhysicsProfile::Refined => Corrections::REFINED,
        }
    }
}

/// Options of the pulse physics. [`PhysicsOptions::helios`] reproduces the reference's numbers.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct PhysicsOptions {
    /// Seed of every random draw.
    pub seed: u64,
    /// Use the older energy model (spec pulse-physics §3.3); ignored by scanners with channels (spec
    /// pulse-physics §0.4).
    pub legacy_energy: bool,
    /// Treat every surface as if it faced the beam (spec pulse-physics §2.4).
    pub fixed_incidence: bool,
    /// Fit a Gaussian to every echo (spec pulse-physics §4.5); echoes narrower than 0.1 ns are dropped then.
    pub echo_width: bool,
    /// Add noise to the recorded waveforms; without effect on points (spec pulse-physics §4.11).
    pub waveform_noise: bool,
    /// Append a record to the batch for the waveform of every pulse with an echo.
    pub record_waveforms: bool,
    /// Append a record to the batch for every pulse, with or without echoes.
    pub record_pulses: bool,
    /// Append a record to the batch of the true cause of every echo ([`super::EchoTruth`]).
    pub record_truth: bool,
    /// Record the colours of surfaces with their true causes ([`super::EchoTruth::colour`]), if the scene has
    /// colours.
    pub record_colours: bool,
    /// Record the radial velocities of echoes with their true causes ([`super::Batch::velocities`]), if
    /// pulses have the velocity of their origin.
    pub record_velocities: bool,
    /// Give every echo the attitude of the scanner ([`super::Echo::scanner`]).
    pub record_scanner_axes: bool,
    /// Append the reflections of all subrays to the batch instead of echoes.
    pub record_subrays: bool,
    /// Let fog, rain, snow and dust dim the light of surfaces only, without light of their own.
    pub dark_air: bool,
    /// Maximum number of mirrors and panes on the way of light from the instrument to a surface; 0 = they do
    /// not pass light on.
    pub max_order: u8,
    /// Corrections to the reference's physics.
    pub corrections: Corrections,
}

impl PhysicsOptions {
    /// Default of [`PhysicsOptions::max_order`].
    pub const MAX_ORDER: u8 = 4;
    /// Greatest [`PhysicsOptions::max_order`] that options of a run accept.
    pub const GREATEST_ORDER: u8 = 64;

    /// The reference's physics: no corrections, improved energy model, seed 0, only points are recorded.
    pub fn helios() -> PhysicsOptions {
        PhysicsOptions {
            seed: 0,
            legacy_energy: false,
            fixed_incidence: false,
            echo_width: false,
            waveform_noise: false,
            record_waveforms: false,
            record_pulses: false,
            record_truth: false,
            record_colours: false,
            record_velocities: false,
            record_scanner_axes: false,
            record_subrays: false,
            dark_air: false,
            max_order: PhysicsOptions::MAX_ORDER,
            corrections: Corrections::NONE,
        }
    }

    /// The corrected physics: [`Corrections::REFINED`], otherwise as [`PhysicsOptions::helios`].
    pub fn refined() -> PhysicsOptions {
        PhysicsOptions { corrections: Corrections::REFINED, ..PhysicsOptions::helios() }
    }
}

impl fmt::Debug for PhysicsOptions {
    /// Checksums of shards include this text, so fields that came later are in it only if they are set.
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        // Checksums would miss a field that is not named.
        let PhysicsOptions {
            seed,
            legacy_energy,
            fixed_incidence,
            echo_width,
            waveform_noise,
            record_waveforms,
            record_pulses,
            record_truth,
            record_colours,
            record_velocities,
            record_scanner_axes,
            record_subrays,
            dark_air,
            max_order,
            corrections,
        } = self;
        let mut fields = f.debug_struct("PhysicsOptions");
        fields
            .field("seed", seed)
            .field("legacy_energy", legacy_energy)
            .field("fixed_incidence", fixed_incidence)
            .field("echo_width", echo_width)
            .field("waveform_noise", waveform_noise)
            .field("record_waveforms", record_waveforms)
            .field("record_pulses", record_pulses)
            .field("record_truth", record_truth)
            .field("record_colours", record_colours)
            .field("record_scanner_axes", record_scanner_axes)
            .field("record_subrays", record_subrays)
            .field("max_order", max_order)
            .field("corrections", corrections);
        if *record_velocities {
            fields.field("record_velocities", record_velocities);
        }
        if *dark_air {
            fields.field("dark_air", dark_air);
        }
        fields.finish()
    }
}

impl Default for PhysicsOptions {
    fn default() -> PhysicsOptions {
        PhysicsOptions::helios()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use vlscan_survey::KeyUse;

    #[test]
    fn the_list_of_keys_names_corrections_that_there_are() {
        for key in vlscan_survey::INSTRUMENT_KEYS {
            let name = match key.used {
                KeyUse::Always => continue,
                KeyUse::With(name) | KeyUse::Without(name) | KeyUse::InLaterChannelsWith(name) => name,
                KeyUse::UnlessBeside { key, correction } => {
                    assert!(vlscan_survey::key_named(key).is_some(), "{key}");
                    correction
                }
            };
            assert!(Corrections::NAMES.contains(&name), "{name}");
        }
    }
}
