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

/// Classes of points that are noise.
pub(crate) const NOISE: [u8; 2] = [7, 18];

/// The name of a point class; `None` for reserved and user-defined ones.
pub fn class_name(class: u8) -> Option<&'static str> {
    NAMES.get(usize::from(class)).copied()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn classes_have_the_names_of_the_specification() {
        let named = [2, 6, 9, 17, 22].map(class_name);
        let expected = ["ground", "building", "water", "bridge", "temporal exclusion"].map(Some);
        assert_eq!(named, expected);
        assert!([23, 64, 255].map(class_name).iter().all(Option::is_none));
        assert!(NOISE.iter().all(|class| class_name(*class).is_some_and(|name| name.contains("noise"))));
    }
}
