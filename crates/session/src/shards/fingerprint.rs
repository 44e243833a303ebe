//! Fingerprints: everything that the contents of a shard depend on.

use serde::{Deserialize, Serialize};

/// Named facts on which the contents of shards depend: versions, survey, scene, seed, options. Shards of one
/// run have equal fingerprints.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Fingerprint(Vec<Fact>);

#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
struct Fact {
    name: String,
    value: String,
    /// True if the value affects the flight, not only the measurement.
    is_of_flight: bool,
}

impl Fingerprint {
    /// Adds a fact on which the flight depends.
    pub fn flight(&mut self, name: &str, value: impl ToString) {
        self.0.push(Fact { name: name.to_owned(), value: value.to_string(), is_of_flight: true });
    }

    /// Adds a fact on which only the measurements depend.
    pub fn measurement(&mut self, name: &str, value: impl ToString) {
        self.0.push(Fact { name: name.to_owned(), value: value.to_string(), is_of_flight: false });
    }

    /// The facts on which the flight depends.
    pub fn of_flight(&self) -> Fingerprint {
        Fingerprint(self.0.iter().filter(|fact| fact.is_of_flight).cloned().collect())
    }

    /// Names each fact that differs with both values, those of `self` first; `None` if both are equal.
    pub fn difference(&self, other: &Fingerprint) -> Option<String> {
        if self == other {
            return None;
        }
        let value = |of: &Fingerprint, name: &str| {
            of.0.iter().find(|fact| fact.name == name).map_or_else(String::new, |fact| fact.value.clone())
        };
        let mut names: Vec<&str> = self.0.iter().chain(&other.0).map(|fact| &fact.name[..]).collect();
        names.dedup();
        let mut found: Vec<String> = Vec::new();
        for name in names {
            let (mine, theirs) = (value(self, name), value(other, name));
            let text = || {
                let (mine, theirs) = first_difference(&mine, &theirs);
                format!("{name} ({mine}, {theirs})")
            };
            if mine != theirs && !found.iter().any(|known| known.starts_with(&format!("{name} ("))) {
                found.push(text());
            }
        }
        Some(found.join("; "))
    }
}

/// The first elements of two lists with commas that differ.
fn first_difference<'a>(mine: &'a str, theirs: &'a str) -> (&'a str, &'a str) {
    let mut pairs = mine.split(", ").zip(theirs.split(", "));
    let trim = |text: &'a str| text.trim_end_matches([' ', '}']);
    pairs.find(|(a, b)| a != b).map_or((mine, theirs), |(a, b)| (trim(a), trim(b)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_difference_is_named_with_both_values() {
        let of = |seed: u64, physics: &str| {
            let mut all = Fingerprint::default();
            all.flight("seed", seed);
            all.measurement("physics", physics);
            all
        };
        let one = of(11, "Physics { a: true, b: false }");
        assert_eq!(one.difference(&one.clone()), None);
        let other = of(12, "Physics { a: true, b: true }");
        assert_eq!(one.difference(&other).unwrap(), "seed (11, 12); physics (b: false, b: true)");
        assert_eq!(one.of_flight().difference(&of(11, "").of_flight()), None);
    }
}
