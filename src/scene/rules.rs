//! Where materials and leaf angle tables depart from the reference's reading of them.

/// Departures from the reference, each of which is the correction of the refined physics of the same name. The default
/// has none of them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct MaterialRules {
    /// Every material with a specular colour has its specular share.
    pub specular_shares: bool,
    /// Reflectances are fractions: spectra are divided by 100, and a missing one is 0.5.
    pub reflectance_fraction: bool,
    /// Specular shares follow a normalised lobe.
    pub specular_lobe: bool,
    /// Materials without colours are Lambertian.
    pub lambert_default: bool,
    /// Leaf angle tables may hold G itself.
    pub leaf_table_scale: bool,
    /// Leaf angle tables hold for opposite directions alike.
    pub leaf_table_mirror: bool,
}

impl MaterialRules {
    /// Number of rules.
    pub(super) const COUNT: usize = 6;

    /// The rules in the order of the fields.
    pub(super) fn to_array(self) -> [bool; MaterialRules::COUNT] {
        let MaterialRules {
            specular_shares,
            reflectance_fraction,
            specular_lobe,
            lambert_default,
            leaf_table_scale,
            leaf_table_mirror,
        } = self;
        [
            specular_shares,
            reflectance_fraction,
            specular_lobe,
            lambert_default,
            leaf_table_scale,
            leaf_table_mirror,
        ]
    }

    /// The inverse of [`MaterialRules::to_array`].
    pub(super) fn of_array(rules: [bool; MaterialRules::COUNT]) -> MaterialRules {
        let [
            specular_shares,
            reflectance_fraction,
            specular_lobe,
            lambert_default,
            leaf_table_scale,
            leaf_table_mirror,
        ] = rules;
        MaterialRules {
            specular_shares,
            reflectance_fraction,
            specular_lobe,
            lambert_default,
            leaf_table_scale,
            leaf_table_mirror,
        }
    }

    /// Those that hold in `self`, in `other`, or in both.
    pub(super) fn or(self, other: MaterialRules) -> MaterialRules {
        let (a, b) = (self.to_array(), other.to_array());
        MaterialRules::of_array(std::array::from_fn(|i| a[i] | b[i]))
    }

    /// Those that hold in both.
    pub(super) fn and(self, other: MaterialRules) -> MaterialRules {
        let (a, b) = (self.to_array(), other.to_array());
        MaterialRules::of_array(std::array::from_fn(|i| a[i] & b[i]))
    }
}
