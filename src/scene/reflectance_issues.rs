//! Collects materials whose reflectance is missing or not a fraction, to report them file by file.

use super::MaterialRules;
use super::library::DEFAULT;
use crate::diag::{Diagnostics, Place};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
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
pub(super) struct ReflectanceIssues(Vec<(ReflectanceIssue, String, Place)>);

/// Maximum number of names in one message.
const MAX_LISTED: usize = 8;

impl ReflectanceIssues {
    /// Records an issue of the material `name`, defined or used at `place`.
    pub fn add(&mut self, issue: ReflectanceIssue, name: &str, place: Place) {
        if !self.0.iter().any(|(i, n, p)| *i == issue && n == name && *p == place) {
            self.0.push((issue, name.to_owned(), place));
        }
    }

    /// Reports one message per file and issue, with the number of materials and their names. Under the reference's rules
    /// only reflectances that are missing count, which are 50 then.
    pub fn report(&self, rules: MaterialRules, diagnostics: &mut Diagnostics) {
        let is_fraction = rules.reflectance_fraction;
        let assumed = if is_fraction { "0.5" } else { "50 per cent, the default of HELIOS++" };
        for (i, (issue, name, place)) in self.0.iter().enumerate() {
            let is_alike =
                |(other, _, p): &&(ReflectanceIssue, String, Place)| other == issue && p.path == place.path;
            // Parts without any material are meant to have the default.
            if !is_fraction && (*issue != ReflectanceIssue::Missing || name == DEFAULT) {
                continue;
            }
            if self.0[..i].iter().any(|earlier| is_alike(&earlier)) {
                continue;
            }
            let names: Vec<String> =
                self.0.iter().filter(is_alike).map(|(_, name, _)| format!("\"{name}\"")).collect();
            let mut listed = names[..names.len().min(MAX_LISTED)].join(", ");
            if names.len() > MAX_LISTED {
                listed += &format!(" and {} more", names.len() - MAX_LISTED);
            }
            let place = Some(place.clone());
            let (message, help) = match (issue, names.len()) {
                (ReflectanceIssue::PerCent, n) => {
                    let (noun, are) = if n == 1 { ("reflectance", "is") } else { ("reflectances", "are") };
                    diagnostics
                        .note(place, format!("the {noun} of {listed} {are} above 2 and taken as per cent"));
                    continue;
                }
                (ReflectanceIssue::Missing, 1) => (
                    format!("material {listed} has no reflectance; it reflects {assumed}"),
                    "give it a helios_reflectance from 0 to 1, or helios_spectra",
                ),
                (ReflectanceIssue::Missing, n) => (
                    format!("{n} materials have no reflectance: {listed}; they reflect {assumed}"),
                    "give each a helios_reflectance from 0 to 1, or helios_spectra",
                ),
                (ReflectanceIssue::NoFraction, 1) => (
                    format!("the reflectance of material {listed} is not between 0 and 1, and used as it is"),
                    "helios_reflectance 0.3 reflects 30 per cent",
                ),
                (ReflectanceIssue::NoFraction, n) => (
                    format!(
                        "the reflectances of {n} materials are not between 0 and 1, and used as they are: {listed}"
                    ),
                    "helios_reflectance 0.3 reflects 30 per cent",
                ),
            };
            diagnostics.warn(place, message).help(help);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    #[test]
    fn a_file_has_one_message_with_all_its_materials() {
        let place = |file: &str, line| Place::in_line(Path::new(file), line, "newmtl m", 0..8);
        let mut issues = ReflectanceIssues::default();
        for i in 0..20 {
            issues.add(ReflectanceIssue::Missing, &format!("m{}", i % 10), place("a.mtl", i % 10));
        }
        issues.add(ReflectanceIssue::Missing, "m1", place("b.mtl", 3));
        issues.add(ReflectanceIssue::NoFraction, "glare", place("a.mtl", 20));
        let mut d = Diagnostics::default();
        issues.report(MaterialRules { reflectance_fraction: true, ..MaterialRules::default() }, &mut d);
        let [of_a, of_b, glare] = d.items() else { panic!("{}", d.render(false)) };
        assert!(of_a.message.contains("10 materials") && of_a.message.contains("\"m7\" and 2 more"));
        assert_eq!(of_b.message, "material \"m1\" has no reflectance; it reflects 0.5");
        assert!(glare.message.contains("\"glare\""));
    }
}
