//! Where the motion of platform and optics departs from the reference's.

macro_rules! kinematics {
    ($($name:ident,)*) => {
        /// Departures from the reference's kinematics, each of which can be chosen by itself. The field of the same name in
        /// [`crate::pulse::Corrections`] says what it does, docs/physics.md by which formula.
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
        #[allow(missing_docs)]
        pub struct Kinematics {
            $(pub $name: bool,)*
        }

        impl Kinematics {
            /// The reference's kinematics.
            pub const HELIOS: Kinematics = Kinematics { $($name: false),* };

            /// All corrections.
            pub const CORRECTED: Kinematics = Kinematics { $($name: true),* };

            /// Names of all of them.
            pub const NAMES: &[&str] = &[$(stringify!($name)),*];

            /// Those whose name `is_on` says to be on.
            pub fn chosen(is_on: impl Fn(&str) -> bool) -> Kinematics {
                Kinematics { $($name: is_on(stringify!($name))),* }
            }
        }
    };
}

kinematics! {
    heading_along_leg,
    sharp_corners,
    multicopter_tilt,
    mount_offsets_turn,
    attitude_noise_of_platform,
    shortest_turns,
    legs_on_time,
    leg_pulse_rate,
    exact_clock,
    leap_seconds,
    conic_at_leg_frequency,
    oscillation_at_leg_frequency,
    polygon_keeps_excess,
    centred_fibres,
    channels_restart,
    warmup_of_optics,
}
