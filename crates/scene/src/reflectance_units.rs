//! Finds scenes whose reflectances are in two units: fractions, and per cent or the default of 50.

use std::collections::HashSet;
use vlscan_base::diag::{Diagnostics, Place};

/// Reflectances above this are interpreted as per cent; those between 1 and this can be of retroreflectors.
pub(super) const MAX_FRACTION: f64 = 2.0;

/// A reflectance from a file, or an assumed one.
#[derive(Clone, Debug, PartialEq)]
struct Given {
    material: u32,
    name: String,
    value: f64,
    place: Option<Place>,
}

/// The reflectances of a scene, in the order of first use.
#[derive(Clone, Debug, Default)]
pub(super) struct ReflectanceUnits {
    fractions: Vec<Given>,
    per_cent: Vec<Given>,
    /// Materials whose reflectance is known.
    known: HashSet<u32>,
}

/// Maximum number of materials of either unit in a message.
const MAX_LISTED: usize = 4;

impl ReflectanceUnits {
    /// Records the reflectance of a material, by its index and its name. Values that either unit can have, 0
    /// and those above 1 that are no per cent, do not count.
    pub fn add(&mut self, material: u32, name: &str, value: f64, place: impl FnOnce() -> Option<Place>) {
        let unit = match value {
            v if v > MAX_FRACTION => &mut self.per_cent,
            v if v > 0.0 && v <= 1.0 => &mut self.fractions,
            _ => return,
        };
        if self.known.insert(material) {
            unit.push(Given { material, name: name.to_owned(), value, place: place() });
        }
    }

    /// Warns of a scene that has both. `used` marks the materials of primitives: others were replaced.
    pub fn report(&self, is_fraction: bool, used: impl FnOnce() -> Vec<bool>, diagnostics: &mut Diagnostics) {
        if self.per_cent.is_empty() || self.fractions.is_empty() {
            return;
        }
        let used = used();
        let in_use = |all: &'_ [Given]| {
            let mut known = HashSet::new();
            let is_used = |given: &&Given| used.get(given.material as usize).copied().unwrap_or(false);
            let all = all.iter().filter(is_used).cloned();
            all.filter(|given| known.insert((given.name.clone(), given.value.to_bits()))).collect::<Vec<_>>()
        };
        let (per_cent, fractions) = (in_use(&self.per_cent), in_use(&self.fractions));
        let (Some(first), false) = (per_cent.first(), fractions.is_empty()) else { return };
        let message = format!(
            "the reflectances of this scene are in two units, per cent: {}; and fractions: {}",
            listed(&per_cent),
            listed(&fractions)
        );
        let help = if is_fraction {
            "those above 2 are read as per cent, the others as fractions; give all from 0 to 1 \
             (helios_reflectance 0.3)"
        } else {
            "--physics helios uses all as they are, so the former echo 100 times as strongly and the latter \
             can be too weak to detect; give all from 0 to 1 (helios_reflectance 0.3), or use --physics \
             refined"
        };
        let place = first.place.clone().or_else(|| fractions.iter().find_map(|given| given.place.clone()));
        diagnostics.warn(place, message).help(help);
    }
}

fn listed(all: &[Given]) -> String {
    let one = |given: &Given| {
        let place = given.place.as_ref().map(|place| match place.line {
            0 => format!(" ({})", place.path.display()),
            line => format!(" ({}:{line})", place.path.display()),
        });
        format!("\"{}\" {}{}", given.name, given.value, place.unwrap_or_default())
    };
    let mut text = all.iter().take(MAX_LISTED).map(one).collect::<Vec<_>>().join(", ");
    if all.len() > MAX_LISTED {
        text += &format!(" and {} more", all.len() - MAX_LISTED);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    fn said(all: &[(&str, f64)], is_fraction: bool) -> String {
        let mut units = ReflectanceUnits::default();
        for (line, (name, value)) in (1..).zip(all) {
            let place = || Some(Place::in_line(Path::new("a.mtl"), line, "newmtl m", 0..0));
            units.add(line as u32, name, *value, place);
        }
        let mut d = Diagnostics::default();
        units.report(is_fraction, || vec![true; all.len() + 1], &mut d);
        d.text()
    }

    #[test]
    fn both_units_in_one_scene_are_named_with_their_materials_and_lines() {
        for is_fraction in [false, true] {
            let said = said(&[("bark", 0.4), ("default", 50.0), ("leaves", 0.5)], is_fraction);
            for part in ["\"default\" 50 (a.mtl:2)", "\"bark\" 0.4 (a.mtl:1), \"leaves\" 0.5 (a.mtl:3)"] {
                assert!(said.contains(part), "{said}");
            }
        }
        let many: Vec<(String, f64)> = (0..9).map(|i| (format!("m{i}"), 0.1)).collect();
        let many: Vec<(&str, f64)> = many.iter().map(|(name, value)| (name.as_str(), *value)).collect();
        let said_of_many = said(&[&many[..], &many, &[("dust", 30.0)]].concat(), true);
        assert!(said_of_many.contains("\"m3\" 0.1 (a.mtl:4) and 5 more"), "{said_of_many}");
        for alike in
            [&[("a", 0.4), ("b", 1.0), ("glare", 1.7), ("black", 0.0)][..], &[("a", 40.0), ("black", 0.0)]]
        {
            assert_eq!(said(alike, false), "", "{alike:?}");
        }
    }
}
