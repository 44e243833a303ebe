//! What of the pulse physics a run can choose.

use crate::survey::Kinematics;

/// Choices of the pulse physics. [`PhysicsOptions::helios`] reproduces the reference's numbers; single fields may then be
/// changed at will.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PhysicsOptions {
    /// Seed of every random draw.
    pub seed: u64,
    /// Use the older energy model (spec pulse-physics §3.3). Scanners with channels ignore it (§0.4).
    pub legacy_energy: bool,
    /// Treat every surface as if it faced the beam (§2.4).
    pub fixed_incidence: bool,
    /// Fit a Gaussian to every echo (§4.5); echoes narrower than 0.1 ns are dropped then.
    pub echo_width: bool,
    /// Add noise to the recorded waveforms; points never see it (§4.11).
    pub waveform_noise: bool,
    /// Append a record to the batch for the waveform of every pulse with an echo.
    pub record_waveforms: bool,
    /// Append a record to the batch for every pulse, with or without echoes.
    pub record_pulses: bool,
    /// Find out what really sent every echo ([`super::EchoTruth`]).
    pub record_truth: bool,
    /// Append the reflections of all subrays to the batch instead of echoes.
    pub record_subrays: bool,
    /// Where the physics departs from the reference's.
    pub corrections: Corrections,
}

impl PhysicsOptions {
    /// The reference's physics: no corrections, improved energy model, seed 0, nothing recorded but points.
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
            record_subrays: false,
            corrections: Corrections::NONE,
        }
    }

    /// The corrected physics: [`Corrections::REFINED`], otherwise as [`PhysicsOptions::helios`].
    pub fn refined() -> PhysicsOptions {
        PhysicsOptions { corrections: Corrections::REFINED, ..PhysicsOptions::helios() }
    }
}

impl Default for PhysicsOptions {
    fn default() -> PhysicsOptions {
        PhysicsOptions::helios()
    }
}

macro_rules! corrections {
    ($($(#[doc = $doc:literal])* $name:ident: $refined:literal,)*) => {
        /// Departures from the reference's physics (spec pulse-physics §9, §10), each of which can be chosen by itself.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub struct Corrections {
            $($(#[doc = $doc])* pub $name: bool,)*
        }

        impl Corrections {
            /// Names of all corrections, in the order of the fields.
            pub const NAMES: &[&str] = &[$(stringify!($name)),*];

            /// What each of them does, in the order of the fields.
            pub const HELP: &[&str] = &[$(concat!($($doc),*)),*];

            /// None of them: the reference's physics.
            pub const NONE: Corrections = Corrections { $($name: false),* };

            /// Those that make up the refined physics.
            pub const REFINED: Corrections = Corrections { $($name: $refined),* };

            /// Those of either.
            pub fn or(self, other: Corrections) -> Corrections {
                Corrections { $($name: self.$name || other.$name),* }
            }

            /// The correction of that name, to be read or changed; `None` for an unknown name.
            pub fn by_name(&mut self, name: &str) -> Option<&mut bool> {
                match name {
                    $(stringify!($name) => Some(&mut self.$name),)*
                    _ => None,
                }
            }
        }
    };
}

corrections! {
    /// Reflections at exactly the same range add up; the reference keeps the first and drops the others, so that most
    /// subrays vanish on surfaces that are hit symmetrically (trap 2).
    sum_equal_ranges: true,
    /// A ray that passed one voxel meets the next even if it touches, and a voxel around the origin is met; in the
    /// reference both are invisible (trap 3).
    adjacent_voxels: true,
    /// The beam is narrowest where it leaves the instrument; the reference's improved model focuses it at the minimum
    /// range, and at a minimum range of 0 receives nothing at all (trap 4).
    waist_at_exit: true,
    /// The improved model compares radii and beam width both in metres, which makes extended targets fade with R⁻²; the
    /// reference compares radians with metres, hence R⁻⁴ (§10).
    ring_radii_in_metres: true,
    /// The divergence is the beam's full angle, as in data sheets, for the traced cone and the waist too, where the
    /// reference takes it as the half angle (§10).
    full_angle_divergence: true,
    /// The legacy model divides by the number of subrays that exist; the reference's divisor is wrong from 5 rings on
    /// (§1.3).
    true_subray_count: true,
    /// A beam without divergence keeps its energy on its axis instead of yielding NaN echoes (trap 21).
    collimated_energy: true,
    /// A later leg's divergence holds for the whole of that leg's physics; in the reference only for a part of the
    /// legacy model (trap 8).
    divergence_per_leg: true,
    /// Extinction by haze per kilometre and wavelength in micrometres, as the formula is meant: about 8 times the
    /// reference's at 1064 nm; a visibility of 50 km belongs to the clear branch (trap 15).
    atmosphere_units: true,
    /// The recorded waveform begins at the minimum range at the earliest, and nothing else happens; in the reference one
    /// reflection shortly behind the minimum range discards the whole pulse (trap 5).
    clip_dead_zone: true,
    /// The longest waveform counts from the first reflection, not from the instrument (trap 6).
    limit_from_first: true,
    /// At least one neighbour on each side is compared with a peak, and quotients like 0.3/0.1 count as 3; otherwise a
    /// window of less than two bins makes every bin an echo (trap 7).
    peak_neighbours: true,
    /// Neighbours of a peak may lie below the threshold (trap 17).
    weak_neighbours: true,
    /// A bin is worth cΔ/2 of range as in an instrument, which times the way there and back; the reference counts one
    /// way and resolves half as well. Recorded waveform times are two-way then (§10).
    two_way_time: true,
    /// A reflection may start between two bins and the range is read between bins; the reference rounds ranges down to
    /// whole bins behind the first reflection (§10).
    fractional_bins: true,
    /// Fit an echo's width near its peak, where the reference fits the whole waveform and gets absurd widths for second
    /// echoes (trap 18).
    local_fit: true,
    /// Echoes whose fitted width is below 0.1 ns stay (trap 18).
    keep_narrow_echoes: true,
    /// Range noise of each device has its own accuracy, not that of device 0 (trap 9).
    own_accuracy: true,
    /// Returns are numbered and counted after the near-range filter (trap 20).
    count_kept_returns: true,
    /// Subrays may hit though the axis misses the scene's box (trap 11).
    no_axis_gate: true,
    /// The scene has no box: moving parts stay visible wherever they go, and the axis need not meet it (trap 12).
    unbounded_scene: true,
    /// Rays go on through what lies nearer than the minimum range, for instruments inside a modelled hull (trap 10). Not
    /// part of the refined physics, since a near object really is in the way.
    see_through_near: false,
    /// Voxels without a leaf angle table have spherically distributed leaves, half the reference's extinction (trap 14).
    spherical_leaves: true,
    /// Intensity, attribution and range limits of a voxel's echo go by where the ray stopped, not by where it entered (trap
    /// 22).
    voxel_stop_point: true,
    /// Foliage is met at the mean angle of leaves that face all directions alike, wherever the ray entered its voxel; in the
    /// reference it is met like the voxel's nearest face, so that an echo from an edge may vanish (§10).
    foliage_incidence: true,
    /// Subrays share the energy of the whole Gaussian beam evenly, in a pattern that keeps its radius, its edge and its second
    /// moments, and that is turned from pulse to pulse; the reference's rings hold 86 % of the energy and are 0.7 times as wide.
    equal_energy: true,
    /// Amplitudes are received power in nanowatts by the lidar equation, at any range and divergence; the energy of a pulse
    /// falls with the pulse rate and does not depend on the pulse length; the beam quality does not change a given divergence.
    radiometry: true,
    /// Haze dims each channel as it does its own wavelength, not that of the scanner (trap 9).
    channel_haze: true,
    /// The detection threshold is in watts of received power; in the reference watts are compared with nanowatts. The default
    /// of 0.0001, with which no watt would be seen, counts as not given and stays in nanowatts.
    threshold_in_watts: true,
    /// A pulse fades out; in the reference it ends with 8 % of its peak power, which makes steps in waveforms.
    whole_pulse: true,
    /// Subrays that meet one slope return one broad echo, as the whole of the beam does; with few subrays each becomes an echo
    /// of its own once they are farther apart in range than the pulse is long.
    smooth_slopes: true,
    /// The receiver of an instrument does what the instrument says of it: noise and false alarms, saturation, range walk, the
    /// digitiser's clock, the shape of the pulse, the detector, and the maximum range that sets the threshold. The reference
    /// knows none of them.
    receiver: true,
    /// Every material with a specular colour has its specular share; in the reference only the last one of an MTL file and
    /// those with a spectrum do (spec input-formats §10, trap 56).
    specular_shares: true,
    /// Reflectances are fractions from 0 to 1: spectra are divided by 100, a missing reflectance is 0.5 and told, and so are
    /// fractions above 1; in the reference spectra and missing ones count as per cent, 100 times too much (trap 16).
    reflectance_fraction: true,
    /// Specular shares follow a lobe that is normalised and ends at 45° from the normal, where the mirror direction is 90°
    /// away from the instrument; in the reference |cos 2θ|^N glares at grazing incidence (spec §3.2).
    specular_lobe: true,
    /// A material without colours is Lambertian; in the reference it reflects alike at all angles, more than it receives at
    /// grazing ones (spec §3.2).
    lambert_default: true,
    /// Leaf angle tables that hold G itself (mean 0.5 over all directions) are told from those on the reference's scale, 2πG
    /// (mean π); in the reference the former are 2π times too transparent.
    leaf_table_scale: true,
    /// Leaf angle tables of one hemisphere hold for the opposite directions, too, in which leaves project the same; the
    /// reference repeats the value at the table's edge there.
    leaf_table_mirror: true,
    /// Foliage with a leaf angle table reflects by its material like foliage without one, at the mean incidence that its leaf
    /// angles have; in the reference it is up to 10⁵ times brighter and fades with R⁻⁴ (spec §3.5). Needs foliage_incidence.
    leaf_table_law: true,
    /// The light of a subray that foliage intercepts returns from all along its way through the foliage, as exp(−σs) has it,
    /// since a subray stands for a part of the footprint with many leaves; otherwise every subray is an echo of its own.
    /// Whether foliage intercepts a subray stays random, and so does where it stops the only ray of a beam. Needs
    /// adjacent_voxels and leaf_table_law.
    foliage_continuum: true,
    /// Kinematics: platforms face along the leg from waypoint to waypoint, and recorded places without angles along their way;
    /// in the reference small clockwise errors of up to 1.4 degrees grow to the double or fourfold, places without angles
    /// face north, and the beam of a multicopter lags behind its yaw (spec kinematics, traps 14, 17, 25).
    heading_along_leg: true,
    /// Kinematics: straight flights turn at the waypoint and fly the rest of that step along the new leg; in the reference they
    /// overshoot by up to a step (trap 8).
    sharp_corners: true,
    /// Kinematics: pitch and roll of a multicopter turn about its own axes and reach the beam; in the reference they turn
    /// about the axes of the world and only trajectories show them (traps 17 and 18).
    multicopter_tilt: true,
    /// Kinematics: offsets of the scanner's mount turn with the platform, those of the emitter with the head, too; in the
    /// reference they are added along the axes of the world (trap 13). Always on along a --trajectory.
    mount_offsets_turn: true,
    /// Kinematics: noise of the attitude turns the platform about its own axes, and what it carries; in the reference it turns
    /// the beam about the beam's axes, one of which is the beam itself (trap 41).
    attitude_noise_of_platform: true,
    /// Kinematics: recorded headings of a survey turn the shorter way, through north; in the reference 350 to 10 degrees leads
    /// back through 180 (trap 25).
    shortest_turns: true,
    /// Kinematics: legs along recorded trajectories begin and end at the times given, with synchronised stamps in all of them,
    /// and a limited leg fires as many pulses as its duration holds; in the reference later legs come 3 or 4 steps late, and
    /// get one pulse more or less (traps 3 and 4).
    legs_on_time: true,
    /// Kinematics: clocks go by the pulse rate of each leg; in the reference by that of the first (trap 1).
    leg_pulse_rate: true,
    /// Kinematics: GPS time is start + k times the period; in the reference a sum whose rounding drifts by microseconds a
    /// second (trap 2).
    exact_clock: true,
    /// Kinematics: the start of the GPS clock counts from 1980-01-06 and with leap seconds; in the reference its epoch is 9 s
    /// late, and leap seconds are missing (spec kinematics 1.2).
    leap_seconds: true,
    /// Kinematics: conic deflectors turn at the leg's scan frequency; in the reference at the highest of the device (trap 29).
    conic_at_leg_frequency: true,
    /// Kinematics: oscillating mirrors keep the leg's scan frequency on average, their greatest angle and their phase; in the
    /// reference periods are whole pulses, fast mirrors leave their range, and a leg may begin in the middle of a period of
    /// another length (trap 30).
    oscillation_at_leg_frequency: true,
    /// Kinematics: polygon mirrors begin a line with what the line before had in excess; in the reference that is lost, and
    /// lines are fewer than asked for (trap 27).
    polygon_keeps_excess: true,
    /// Kinematics: the fibres of an array lie symmetrically; in the reference the swath is half a spacing off centre (spec
    /// kinematics 4.5).
    centred_fibres: true,
    /// Kinematics: after an inactive leg the deflectors of all channels begin anew; in the reference only that of the first,
    /// which then is out of step (trap 31).
    channels_restart: true,
    /// Kinematics: the warm-up of the optics does not turn the head, too (trap 11).
    warmup_of_optics: true,
}

impl Corrections {
    /// Those of the motion of platform and optics, which hold in pipeline files without asking.
    pub fn kinematic() -> Corrections {
        let mut corrections = Corrections::NONE;
        for name in Kinematics::NAMES {
            if let Some(correction) = corrections.by_name(name) {
                *correction = true;
            }
        }
        corrections
    }

    /// What of them the flight has to know.
    pub fn kinematics(self) -> Kinematics {
        Kinematics::chosen(|name| Corrections::by_name(&mut { self }, name).is_some_and(|on| *on))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_reference_has_no_corrections_and_each_is_found_by_name() {
        let mut c = PhysicsOptions::helios().corrections;
        assert_eq!(c, Corrections::NONE);
        for name in Corrections::NAMES {
            let one = c.by_name(name).expect("a listed name");
            assert!(!*one, "{name} is on in the reference's physics");
            *one = true;
        }
        assert!(c.by_name("helios").is_none());
        c.see_through_near = false;
        assert_eq!(c, Corrections::REFINED);
    }
    #[test]
    fn every_kinematic_correction_reaches_the_flight() {
        assert_eq!(Corrections::NONE.kinematics(), Kinematics::HELIOS);
        assert_eq!(Corrections::REFINED.kinematics(), Kinematics::CORRECTED);
        assert_eq!(Corrections::kinematic().kinematics(), Kinematics::CORRECTED);
        for (name, help) in Corrections::NAMES.iter().zip(Corrections::HELP) {
            let moves = Kinematics::NAMES.contains(name);
            assert_eq!(help.trim_start().starts_with("Kinematics:"), moves, "{name}");
        }
    }
}
