//! Collects materials whose reflectance is missing or not a fraction, to report them file by file.

use super::material::DEFAULT;
use super::material::has_leaf_word;
use std::collections::{HashMap, HashSet};
use std::path::PathBuf;
use vlscan_base::corrections::Corrections;
use vlscan_base::diag::{Diagnostics, Place, listed};

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum ReflectanceIssue {
    /// There is no reflectance.
    Missing,
    /// It is above 1, or a spectrum contains a negative one.
    NoFraction,
    /// It is so large that it is interpreted as per cent.
    PerCent,
}

/// Issues with the materials' names and places, in the order of first use.
#[derive(Clone, Debug, Default)]
pub(super) struct ReflectanceIssues {
    groups: Vec<Group>,
    /// Index in `groups` by issue and file.
    index: HashMap<(ReflectanceIssue, PathBuf), usize>,
    /// Names and lines that are in a group.
    known: HashSet<(usize, String, usize)>,
}

/// An issue in a file.
#[derive(Clone, Debug)]
struct Group {
    issue: ReflectanceIssue,
    /// Materials that have it, with their places.
    materials: Vec<(String, Place)>,
}

/// The message about materials, whose names are in quotes, without a reflectance.
pub(super) fn missing(names: &[String], rules: Corrections) -> String {
    let (assumed, listed) = (assumed(rules), listed(names, MAX_LISTED));
    match names.len() {
        1 => format!("material {listed} has no reflectance; it reflects {assumed}"),
        n => format!("{n} materials have no reflectance: {listed}; they reflect {assumed}"),
    }
}

/// The reflectance of materials without one.
pub(super) fn assumed(rules: Corrections) -> &'static str {
    if rules.reflectance_fraction { "0.5" } else { "50 per cent, the default of HELIOS++" }
}

/// Advice for leaves with the default reflectance.
const HELP_OF_LEAVES: &str = "leaves reflect less than that at most wavelengths: give them the built-in \
                              spectrum broadleaf or needle (helios_spectra in MTL files), or a reflectance \
                              from 0 to 1";

/// Maximum number of names in one message.
const MAX_LISTED: usize = 8;

impl ReflectanceIssues {
    /// Records an issue of the material `name`, defined or used at `place`.
    pub fn add(&mut self, issue: ReflectanceIssue, name: &str, place: Place) {
        let next = self.groups.len();
        let group = *self.index.entry((issue, place.path.clone())).or_insert(next);
        if group == next {
            self.groups.push(Group { issue, materials: Vec::new() });
        }
        if self.known.insert((group, name.to_owned(), place.line)) {
            self.groups[group].materials.push((name.to_owned(), place));
        }
    }

    /// Reports one message per file and issue, with the number of materials and their names. Under the
    /// reference's rules only reflectances that are missing count, which are 50 then.
    pub fn report(&self, rules: Corrections, diagnostics: &mut Diagnostics) {
        let is_fraction = rules.reflectance_fraction;
        for Group { issue, materials } in &self.groups {
            // Parts without any material are meant to have the default.
            let counts = |name: &str| is_fraction || *issue == ReflectanceIssue::Missing && name != DEFAULT;
            let mut materials = materials.iter().filter(|(name, _)| counts(name)).peekable();
            let Some((_, place)) = materials.peek() else { continue };
            let place = Some(place.clone());
            let names: Vec<String> = materials.map(|(name, _)| format!("\"{name}\"")).collect();
            let listed = listed(&names, MAX_LISTED);
            let (message, help) = match (issue, names.len()) {
                (ReflectanceIssue::PerCent, 1) => (
                    format!("the reflectance of material {listed} is above 2 and read as per cent"),
                    "write a number from 0 to 1: 0.5 reflects 50 per cent",
                ),
                (ReflectanceIssue::PerCent, n) => (
                    format!("the reflectances of {n} materials are above 2 and read as per cent: {listed}"),
                    "write a number from 0 to 1: 0.5 reflects 50 per cent",
                ),
                (ReflectanceIssue::Missing, 1) => (
                    missing(&names, rules),
                    "give it a reflectance from 0 to 1 (helios_reflectance in MTL files), or a spectrum \
                     (helios_spectra)",
                ),
                (ReflectanceIssue::Missing, _) => (
                    missing(&names, rules),
                    "give each a reflectance from 0 to 1 (helios_reflectance in MTL files), or a spectrum \
                     (helios_spectra)",
                ),
                (ReflectanceIssue::NoFraction, 1) => (
                    format!("the reflectance of material {listed} is not between 0 and 1, and used as it is"),
                    "helios_reflectance 0.3 reflects 30 per cent",
                ),
                (ReflectanceIssue::NoFraction, n) => (
                    format!(
                        "the reflectances of {n} materials are not between 0 and 1, and used as they are: \
                         {listed}"
                    ),
                    "helios_reflectance 0.3 reflects 30 per cent",
                ),
            };
            let has_leaves = names.iter().any(|name| has_leaf_word(name));
            let help = if *issue == ReflectanceIssue::Missing && has_leaves { HELP_OF_LEAVES } else { help };
            diagnostics.warn(place, message).help(help);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;
    use vlscan_base::diag::Severity;

    #[test]
    fn a_file_has_one_message_with_all_its_materials() {
        let place = |file: &str, line| Place::in_line(Path::new(file), line, "newmtl m", 0..8);
        let mut issues = ReflectanceIssues::default();
        for i in 0..20 {
            issues.add(ReflectanceIssue::Missing, &format!("m{}", i % 10), place("a.mtl", i % 10));
        }
        issues.add(ReflectanceIssue::Missing, "m1", place("b.mtl", 3));
        issues.add(ReflectanceIssue::NoFraction, "glare", place("a.mtl", 20));
        issues.add(ReflectanceIssue::PerCent, "wall", place("a.mtl", 30));
        let mut d = Diagnostics::default();
        issues.report(Corrections { reflectance_fraction: true, ..Corrections::NONE }, &mut d);
        let [of_a, of_b, glare, wall] = d.items() else { panic!("{}", d.text()) };
        assert!(of_a.message.contains("10 materials") && of_a.message.contains("\"m7\" and 2 more"));
        assert_eq!(of_b.message, "material \"m1\" has no reflectance; it reflects 0.5");
        assert!(glare.message.contains("\"glare\""));
        assert!(wall.severity == Severity::Warning && wall.message.contains("\"wall\" is above 2"));
    }

    #[test]
    fn the_default_hides_no_other_material_under_the_rules_of_the_reference() {
        let mut issues = ReflectanceIssues::default();
        for (line, name) in [(1, DEFAULT), (2, "wall"), (2, "wall")] {
            issues.add(ReflectanceIssue::Missing, name, Place::in_line(Path::new("a.obj"), line, "", 0..0));
        }
        let mut d = Diagnostics::default();
        issues.report(Corrections::NONE, &mut d);
        let [reported] = d.items() else { panic!("{}", d.text()) };
        assert!(reported.message.contains("material \"wall\" has no"), "{}", reported.message);
        assert_eq!(reported.place.as_ref().map(|place| place.line), Some(2));
    }
}
