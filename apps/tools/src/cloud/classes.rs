//! Names of point classes (ASPRS LAS 1.4 R15, table 17).

/// Names by class; those of 8 and 12 are from LAS 1.1 to 1.3.
const NAMES: [&str; 23] = [
    "no class",
    "unclassified",
    "ground",
    "low vegetation",
    "mid vegetation",
    "high vegetation",
    "building",
    "low noise",
    "key point",
    "water",
    "rail",
    "road",
    "overlap",
    "wire guard",
    "conductor",
    "tower",
    "connector",
    "bridge",
    "high noise",
    "overhead structure",
    "ignored ground",
    "snow",
    "temporal exclusion",
];

/// First class of [`BATHYMETRIC_NAMES`].
const FIRST_BATHYMETRIC: u8 = 40;
/// Names of the classes of water and what is below.
const BATHYMETRIC_NAMES: [&str; 6] = [
    "bathymetric point (bottom)",
    "water surface",
    "derived water surface",
    "submerged object",
    "IHO S-57 object",
    "no bottom found",
];

/// Classes of points that are noise.
pub(crate) const NOISE: [u8; 2] = [7, 18];

/// Classes that point formats 0 to 5 of LAS name (ASPRS LAS 1.4 R15, table 9): 10, 11 and those from 13 on
/// are reserved there.
const NAMED_IN_OLD_FORMATS: [u8; 11] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 12];

/// The name of a point class in files of LAS of the point formats 0 to 5; `None` for reserved and
/// user-defined ones.
pub(super) fn class_name_in_old_formats(class: u8) -> Option<&'static str> {
    class_name(class).filter(|_| NAMED_IN_OLD_FORMATS.contains(&class))
}

/// The name of a point class; `None` for reserved and user-defined ones.
pub fn class_name(class: u8) -> Option<&'static str> {
    let bathymetric = || BATHYMETRIC_NAMES.get(usize::from(class.checked_sub(FIRST_BATHYMETRIC)?)).copied();
    NAMES.get(usize::from(class)).copied().or_else(bathymetric)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn classes_have_the_names_of_the_specification() {
        let named = [2, 6, 9, 17, 22].map(class_name);
        let expected = ["ground", "building", "water", "bridge", "temporal exclusion"].map(Some);
        assert_eq!(named, expected);
        let named = [40, 41, 42, 43, 44, 45].map(class_name);
        assert_eq!(named, BATHYMETRIC_NAMES.map(Some));
        assert_eq!(class_name(41), Some("water surface"));
        assert!([23, 39, 46, 64, 255].map(class_name).iter().all(Option::is_none));
        // Tower, rail and wires came with point format 6; 31 classes are all that the older ones hold.
        let old = [2, 12, 15, 10, 13, 18].map(class_name_in_old_formats);
        assert_eq!(old, [Some("ground"), Some("overlap"), None, None, None, None]);
        assert!(NOISE.iter().all(|class| class_name(*class).is_some_and(|name| name.contains("noise"))));
    }
}
