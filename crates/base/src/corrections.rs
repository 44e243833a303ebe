//! The departures from the reference's physics, materials and kinematics, each of which is optional: one row
//! of one table.

/// Subject of a correction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Area {
    /// Beam, interaction and detection.
    Pulse,
    /// Materials and leaf angle tables as they are read with a scene.
    Material,
    /// The motion of platform and optics.
    Motion,
    /// Records of a pulse besides its points.
    Record,
}

macro_rules! corrections {
    ($($(#[doc = $doc:literal])* $area:ident $name:ident: $refined:literal,)*) => {
        /// Departures from the reference's physics, each of which is optional. Spec pulse-physics §9 and §10
        /// and spec kinematics state the rule behind each.
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
        pub struct Corrections {
            $($(#[doc = $doc])* pub $name: bool,)*
        }

        impl Corrections {
            /// Names of all corrections, in the order of the fields.
            pub const NAMES: &[&str] = &[$(stringify!($name)),*];

            /// Help text of every correction, in the order of the fields.
            pub const HELP: &[&str] = &[$(concat!($($doc),*)),*];

            /// No corrections: the reference's physics.
            pub const NONE: Corrections = Corrections { $($name: false),* };

            /// The corrections of the refined physics.
            pub const REFINED: Corrections = Corrections { $($name: $refined),* };

            /// All corrections of the motion of platform and optics, which are the default in pipeline files.
            pub const MOTION: Corrections = Corrections { $($name: matches!(Area::$area, Area::Motion)),* };

            /// All corrections of what is recorded of a pulse.
            pub const RECORD: Corrections = Corrections { $($name: matches!(Area::$area, Area::Record)),* };

            /// All corrections of materials and leaf angle tables.
            pub const MATERIAL: Corrections =
                Corrections { $($name: matches!(Area::$area, Area::Material)),* };

            /// The corrections that are on in either.
            pub fn or(self, other: Corrections) -> Corrections {
                Corrections { $($name: self.$name || other.$name),* }
            }

            /// The corrections that are on in both.
            pub fn and(self, other: Corrections) -> Corrections {
                Corrections { $($name: self.$name && other.$name),* }
            }

            /// Name, area and switch of every correction, in the order of the fields.
            pub fn switches(&mut self) -> impl Iterator<Item = (&'static str, Area, &mut bool)> {
                [$((stringify!($name), Area::$area, &mut self.$name)),*].into_iter()
            }
        }
    };
}

corrections! {
    /// Reflections at exactly the same range add up; the reference keeps the first one, so that most subrays
    /// vanish on surfaces that are hit symmetrically.
    Pulse sum_equal_ranges: true,
    /// Rays meet every voxel on their way and those around their origin; in the reference they miss the one
    /// next to a voxel that they passed, and those around the origin.
    Pulse adjacent_voxels: true,
    /// The beam is narrowest where it leaves the instrument; the reference's improved model focuses it at the
    /// minimum range.
    Pulse waist_at_exit: true,
    /// The improved model compares radii and beam width both in metres, so that extended targets fade with
    /// R⁻²; the reference compares radians with metres, hence R⁻⁴.
    Pulse ring_radii_in_metres: true,
    /// The divergence is the full angle, as in data sheets, of the traced cone and of the waist; the
    /// reference takes it as the half angle.
    Pulse full_angle_divergence: true,
    /// The legacy model divides by the number of subrays that exist; the reference's divisor is wrong from 5
    /// rings on.
    Pulse true_subray_count: true,
    /// The divergence of a leg holds for the whole physics of that leg; in the reference only for a part of
    /// the legacy model.
    Pulse divergence_per_leg: true,
    /// Extinction by haze per kilometre and wavelength in micrometres, as the formula is meant: about 8 times
    /// the reference's at 1064 nm. A visibility of 50 km belongs to the clear branch.
    Pulse atmosphere_units: true,
    /// Recorded waveforms begin at the minimum range at the earliest; in the reference one reflection shortly
    /// behind the minimum range discards the whole pulse.
    Pulse clip_dead_zone: true,
    /// The longest waveform counts from the first reflection; in the reference from the instrument.
    Pulse limit_from_first: true,
    /// At least one neighbour on each side is compared with a peak, and quotients like 0.3/0.1 count as 3;
    /// otherwise a window of less than two bins makes every bin an echo.
    Pulse peak_neighbours: true,
    /// Neighbours of a peak may lie below the threshold.
    Pulse weak_neighbours: true,
    /// A bin is worth cΔ/2 of range, as in instruments, which time the way there and back, and recorded times
    /// are two-way; the reference counts one way and resolves half as well.
    Pulse two_way_time: true,
    /// A reflection may start between two bins and ranges are read between bins; the reference rounds them
    /// down to whole bins behind the first reflection.
    Pulse fractional_bins: true,
    /// The width of an echo is fitted near its peak; the reference fits the whole waveform and gets absurd
    /// widths for second echoes.
    Pulse local_fit: true,
    /// Echoes whose fitted width is below 0.1 ns are kept.
    Pulse keep_narrow_echoes: true,
    /// Each device has range noise of its own accuracy; in the reference all have that of device 0.
    Pulse own_accuracy: true,
    /// Returns are numbered and counted after the near-range filter.
    Pulse count_kept_returns: true,
    /// Returns whose measured range, errors and noise included, lies outside the range limits of the
    /// instrument are not reported; in the reference range noise puts points behind the scanner.
    Pulse range_gate: true,
    /// Subrays may hit though the axis of the beam misses the scene's box.
    Pulse no_axis_gate: true,
    /// The scene has no box: moving parts stay visible wherever they go, and the axis need not hit it.
    Pulse unbounded_scene: true,
    /// Rays continue through what is nearer than the minimum range, for instruments inside a modelled hull.
    /// Not part of the refined physics, since a near object really occludes.
    Pulse see_through_near: false,
    /// Voxels without a leaf angle table have spherically distributed leaves: half the reference's
    /// extinction.
    Pulse spherical_leaves: true,
    /// Intensity, attribution and range limits of a voxel's echo follow from where the ray is scattered; in
    /// the reference from where it entered.
    Pulse voxel_stop_point: true,
    /// Foliage is met at the mean angle of leaves that face all directions alike; in the reference like the
    /// nearest face of its voxel, so that an echo from an edge may vanish.
    Pulse foliage_incidence: true,
    /// Subrays share the energy of the whole beam evenly, in a pattern with its radius, edge and second
    /// moments that is turned from pulse to pulse; the reference's rings hold 86 % of the energy and are 0.7
    /// times as wide.
    Pulse equal_energy: true,
    /// Amplitudes are received power in nanowatts by the lidar equation, at any range and divergence; pulse
    /// energy falls with the pulse rate, regardless of pulse length and beam quality.
    Pulse radiometry: true,
    /// Haze dims each channel at its own wavelength; in the reference at that of the scanner.
    Pulse channel_haze: true,
    /// The detection threshold is in watts of received power; the reference compares watts with nanowatts.
    /// The default of 0.0001, which would hide everything, counts as not given.
    Pulse threshold_in_watts: true,
    /// A pulse fades out; in the reference it ends with 8 % of its peak power, which makes steps in
    /// waveforms.
    Pulse whole_pulse: true,
    /// A pulse is a raised cosine of its width at half maximum, so that the peak of an echo lies at the mean
    /// range of what it hit; the reference's lopsided pulse puts sloping ground too low, by centimetres where
    /// the footprint is deep.
    Pulse symmetric_pulse: true,
    /// Pulse lengths of the scanners of the catalogue are full widths at half maximum, as data sheets state
    /// them; in the reference the same numbers make pulses half as wide. Always on where a pipeline file
    /// names such a scanner.
    Pulse stated_pulse_widths: true,
    /// Subrays on one slope return one broad echo, as the whole beam does; otherwise each becomes an echo of
    /// its own once they are farther apart in range than the pulse is long.
    Pulse smooth_slopes: true,
    /// Receivers have the noise, false alarms, saturation, range walk, digitiser clock, pulse shape, detector
    /// and maximum range that the instrument states; the reference has none of them.
    Pulse receiver: true,
    /// Every material with a specular colour has its specular share; in the reference only the last one of an
    /// MTL file and those with a spectrum do.
    Material specular_shares: true,
    /// Reflectances are fractions from 0 to 1: spectra are divided by 100, and a missing reflectance is 0.5,
    /// with a warning; in the reference both count as per cent, 100 times too much.
    Material reflectance_fraction: true,
    /// Specular shares follow a normalised lobe that ends at 45° from the normal, where the mirror direction
    /// is 90° from the instrument; in the reference |cos 2θ|^N glares at grazing incidence.
    Material specular_lobe: true,
    /// Materials without colours are Lambertian; in the reference they reflect alike at all angles, more than
    /// they receive at grazing ones.
    Material lambert_default: true,
    /// Spectra are evaluated at the wavelength of each channel; in the reference at that of the first one.
    Material channel_spectra: true,
    /// Leaf angle tables of G itself (mean 0.5 over all directions) are told from those of 2πG (mean π); in
    /// the reference the former are 2π times too transparent.
    Material leaf_table_scale: true,
    /// Leaf angle tables of one hemisphere hold for the opposite directions, too; the reference repeats the
    /// value at the table's edge there.
    Material leaf_table_mirror: true,
    /// Foliage with a leaf angle table reflects by its material at the mean incidence of its leaf angles; in
    /// the reference it is up to 10⁵ times brighter and fades with R⁻⁴. Needs foliage_incidence.
    Pulse leaf_table_law: true,
    /// The light of a subray that foliage intercepts returns from all along its path, as exp(−σs); otherwise
    /// every subray is an echo of its own. Interception stays random, and so does the range for beams of one
    /// ray. Needs adjacent_voxels and leaf_table_law.
    Pulse foliage_continuum: true,
    /// Kinematics: platforms face along the leg, and recorded positions without angles along their path; in
    /// the reference small clockwise errors of up to 1.4 degrees double or quadruple, positions without
    /// angles face north, and a multicopter's beam lags behind its yaw.
    Motion heading_along_leg: true,
    /// Kinematics: straight flights turn at the waypoint and fly the rest of that step along the new leg; in
    /// the reference they overshoot by up to a step. Where the next leg has no speed they stand; in the
    /// reference they fly on.
    Motion sharp_corners: true,
    /// Kinematics: ground vehicles drive up and down in a straight line between the heights of their
    /// waypoints; in the reference they keep the height of the first one and never arrive at others.
    Motion vehicle_heights: true,
    /// Kinematics: pitch and roll of a multicopter turn about its own axes and reach the beam; in the
    /// reference they turn about the axes of the world and only trajectories show them.
    Motion multicopter_tilt: true,
    /// Kinematics: offsets of the scanner's mount turn with the platform, those of the emitter also with the
    /// head; in the reference they are added along the axes of the world. Always on along a --trajectory.
    Motion mount_offsets_turn: true,
    /// Kinematics: noise of the attitude turns the platform and what it carries; in the reference it turns
    /// the beam about the beam's axes, one of which is the beam itself.
    Motion attitude_noise_of_platform: true,
    /// Kinematics: recorded headings turn the shorter way, through north; in the reference 350 to 10 degrees
    /// leads back through 180.
    Motion shortest_turns: true,
    /// Kinematics: legs along recorded trajectories begin and end at their times, with synchronised stamps,
    /// and fire as many pulses as their duration holds; in the reference later legs come 3 or 4 steps late
    /// and get one pulse more or less.
    Motion legs_on_time: true,
    /// Kinematics: clocks follow the pulse rate of each leg; in the reference that of the first.
    Motion leg_pulse_rate: true,
    /// Kinematics: GPS time is start + k times the period; in the reference a sum whose rounding drifts by
    /// microseconds a second.
    Motion exact_clock: true,
    /// Kinematics: the GPS clock counts from 1980-01-06 and with leap seconds; in the reference its origin is
    /// 9 s late, and leap seconds are missing.
    Motion leap_seconds: true,
    /// Kinematics: conic deflectors turn at the leg's scan frequency; in the reference at the highest of the
    /// device.
    Motion conic_at_leg_frequency: true,
    /// Kinematics: a pulse leaves where head and deflector are at its time, the first one of a leg at the
    /// start angle and the phase; in the reference the head and conic and rotating deflectors have turned by
    /// a step by then, so that every point is a pulse ahead of its time.
    Motion optics_on_time: true,
    /// Kinematics: oscillating mirrors keep the leg's mean scan frequency, their greatest angle and their
    /// phase; in the reference periods are whole pulses, fast mirrors leave their range, and a leg may begin
    /// within a period of another length.
    Motion oscillation_at_leg_frequency: true,
    /// Kinematics: polygon mirrors begin a line with the excess angle of the previous one; in the reference
    /// it is lost, and lines are fewer than asked for.
    Motion polygon_keeps_excess: true,
    /// Kinematics: the fibres of an array lie symmetrically; in the reference the swath is half a spacing off
    /// centre.
    Motion centred_fibres: true,
    /// Kinematics: after an inactive leg the deflectors of all channels restart; in the reference only that
    /// of the first, which then is out of step.
    Motion channels_restart: true,
    /// Kinematics: the warm-up of the optics does not turn the head, too.
    Motion warmup_of_optics: true,
    /// Kinematics: the channels of an instrument fire one after the other where it states when; in the
    /// reference all at once.
    Motion firing_offsets: true,
    /// Scan angles of points are those of the beam from the vertical across the track, roll included,
    /// negative to the left, as the LAS specification has them; otherwise deflections on the scanner. The
    /// reference's are 0.
    Record las_scan_angles: true,
    /// Times of trajectories in adjusted standard GPS time (GPS seconds less 10⁹) stay what they are, in
    /// points, too; in the reference whole weeks are taken off.
    Record adjusted_times: true,
}

/// A name that is not that of a correction.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "no correction is called {0:?}; there are {known}",
    known = Corrections::NAMES.join(", ").replace('_', "-")
)]
pub struct UnknownCorrection(pub String);

impl Corrections {
    /// Switches one correction on by its name with hyphens or underscores, or off if `no-` precedes the name.
    /// A correction whose own name begins with `no-` is switched on by that name.
    ///
    /// # Errors
    /// An unknown name.
    pub fn switch(&mut self, name: &str) -> Result<(), UnknownCorrection> {
        let exact = Corrections::NAMES.contains(&name.replace('-', "_").as_str());
        let bare = name.strip_prefix("no-").filter(|_| !exact).unwrap_or(name);
        match self.by_name(&bare.replace('-', "_")) {
            Some(correction) => {
                *correction = bare == name;
                Ok(())
            }
            None => Err(UnknownCorrection(bare.to_owned())),
        }
    }

    /// The correction of that name, to be read or changed; `None` for an unknown name.
    pub fn by_name(&mut self, name: &str) -> Option<&mut bool> {
        self.switches().find(|(known, ..)| *known == name).map(|(.., is_on)| is_on)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_reference_has_no_corrections_and_each_is_found_by_name() {
        let mut c = Corrections::default();
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
    fn the_help_of_corrections_of_motion_says_so() {
        for ((name, area, _), help) in Corrections::default().switches().zip(Corrections::HELP) {
            assert_eq!(help.trim_start().starts_with("Kinematics:"), area == Area::Motion, "{name}");
        }
    }
}
