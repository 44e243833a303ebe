//! Departures from the reference in the reading of materials and leaf angle tables.

macro_rules! material_rules {
    ($($(#[$doc:meta])* $rule:ident,)*) => {
        /// Departures from the reference, each of which is the correction of the same name in the refined physics. By
        /// default all are off.
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
        pub struct MaterialRules {
            $($(#[$doc])* pub $rule: bool,)*
        }

        impl MaterialRules {
            pub(super) const COUNT: usize = [$(stringify!($rule)),*].len();

            /// The rules in the order of the fields.
            pub(super) fn to_array(self) -> [bool; MaterialRules::COUNT] {
                [$(self.$rule),*]
            }

            /// The inverse of [`MaterialRules::to_array`].
            pub(super) const fn from_array([$($rule),*]: [bool; MaterialRules::COUNT]) -> MaterialRules {
                MaterialRules { $($rule),* }
            }

            /// The rules that are set in `self`, in `other`, or in both.
            pub(super) fn or(self, other: MaterialRules) -> MaterialRules {
                MaterialRules { $($rule: self.$rule | other.$rule),* }
            }

            /// The rules that are set in both.
            pub(super) fn and(self, other: MaterialRules) -> MaterialRules {
                MaterialRules { $($rule: self.$rule & other.$rule),* }
            }
        }
    };
}

material_rules! {
    /// Every material with a specular colour has its specular share.
    specular_shares,
    /// Reflectances are fractions: spectra are divided by 100, and a missing one is 0.5.
    reflectance_fraction,
    /// Specular shares follow a normalised lobe.
    specular_lobe,
    /// Materials without colours are Lambertian.
    lambert_default,
    /// Leaf angle tables may hold G itself.
    leaf_table_scale,
    /// Leaf angle tables hold for opposite directions alike.
    leaf_table_mirror,
}
