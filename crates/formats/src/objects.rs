//! Integer ids of scene parts.

use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Key of the names of objects in the metadata of tables, see [`ObjectIds::names_as_json`].
pub const OBJECT_NAMES: &str = "object_names";

/// The integer id of every part, and the names of parts whose id is not that integer (spec outputs trap 2).
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ObjectIds {
    /// Integers by index of the part.
    ids: Vec<i32>,
    /// Integers and the ids that they replace, ascending; without ids that equal their integer.
    pub(crate) names: Vec<(i32, String)>,
}

impl ObjectIds {
    /// Assigns the integers to the ids of the parts. A numeric id is its own integer. Any other id, and one
    /// that equals an earlier one in value only (`07` after `7`), gets the next integer above all numeric
    /// ones, in document order. Equal ids denote the same object.
    pub fn new(parts: &[String]) -> ObjectIds {
        let mut taken: BTreeMap<i32, &str> = BTreeMap::new();
        let mut known: BTreeMap<&str, i32> = BTreeMap::new();
        for part in parts {
            if let Ok(number) = part.trim().parse::<i32>()
                && *taken.entry(number).or_insert(part) == part
            {
                known.insert(part, number);
            }
        }
        let mut free = taken.last_key_value().map_or(0, |(&highest, _)| highest);
        for part in parts.iter().filter(|part| !part.is_empty()) {
            if !known.contains_key(part.as_str()) {
                // Wraps around when a part has the largest integer.
                free = free.wrapping_add(1);
                while taken.contains_key(&free) {
                    free = free.wrapping_add(1);
                }
                taken.insert(free, part);
                known.insert(part, free);
            }
        }
        let ids = parts.iter().map(|part| known.get(part.as_str()).copied().unwrap_or(0)).collect();
        let named = taken.into_iter().filter(|(number, id)| number.to_string() != *id);
        ObjectIds { ids, names: named.map(|(number, id)| (number, id.to_owned())).collect() }
    }

    /// The names of objects by their integers, of a cloud whose parts are not known.
    pub fn of_names(names: BTreeMap<i32, String>) -> ObjectIds {
        ObjectIds { ids: Vec::new(), names: names.into_iter().collect() }
    }

    /// Integers and the ids that they replace, ascending; without ids that equal their integer.
    pub fn names(&self) -> &[(i32, String)] {
        &self.names
    }

    /// The names as a JSON object by their integers, which is the metadata [`OBJECT_NAMES`] of tables; `None`
    /// without names.
    pub fn names_as_json(&self) -> Option<String> {
        let names: BTreeMap<i32, &str> =
            self.names.iter().map(|(number, name)| (*number, name.as_str())).collect();
        // JSON serialisation of a map from integers to strings cannot fail.
        (!names.is_empty()).then(|| serde_json::to_string(&names).unwrap_or_default())
    }

    /// Number of parts.
    pub fn count(&self) -> usize {
        self.ids.len()
    }

    /// Returns the integer of a part; 0 if the part does not exist.
    pub fn of_part(&self, part: u32) -> i32 {
        self.ids.get(part as usize).copied().unwrap_or(0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_become_integers_that_no_part_has() {
        let parts = |ids: &[&str]| ids.iter().map(|id| (*id).to_owned()).collect::<Vec<_>>();
        let objects = ObjectIds::new(&parts(&["3", "north", "0", "", "north", "03", "-5", "7 "]));
        assert_eq!(objects.ids, [3, 8, 0, 0, 8, 9, -5, 7]);
        let names = [(7, "7 "), (8, "north"), (9, "03")].map(|(n, id)| (n, id.to_owned()));
        assert_eq!(objects.names, names);
        let objects = ObjectIds::new(&parts(&["2147483647", "north"]));
        assert_eq!(objects.ids, [i32::MAX, i32::MIN]);
        assert!(ObjectIds::new(&[]).ids.is_empty());
    }
}
