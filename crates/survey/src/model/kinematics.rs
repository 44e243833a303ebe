//! Optional corrections of the reference's motion of platform and optics.

macro_rules! kinematics {
    ($($name:ident,)*) => {
        /// Corrections of the reference's kinematics, each of which can be enabled separately. The field of the same
        /// name in `Corrections` of the physics of pulses describes the effect, docs/physics.md the formula.
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
        #[allow(missing_docs, reason = "described at the fields of the same names in `Corrections`")]
        pub struct Kinematics {
            $(pub $name: bool,)*
        }

        impl Kinematics {
            /// The reference's kinematics.
            pub const HELIOS: Kinematics = Kinematics { $($name: false),* };

            /// All corrections.
            pub const CORRECTED: Kinematics = Kinematics { $($name: true),* };

            /// Names of all corrections.
            pub const NAMES: &[&str] = &[$(stringify!($name)),*];

            /// The corrections for whose names `is_on` returns true.
            pub fn chosen(is_on: impl Fn(&str) -> bool) -> Kinematics {
                Kinematics { $($name: is_on(stringify!($name))),* }
            }
        }
    };
}

kinematics! {
    heading_along_leg,
    sharp_corners,
    vehicle_heights,
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
    firing_offsets,
}
