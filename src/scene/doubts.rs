//! Materials whose reflectance is missing or no fraction, collected to be told file by file.

use crate::diag::{Diagnostics, Place};

/// What is wrong with a reflectance.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Doubt {
    /// There is none.
    Missing,
    /// It is above 1, or a spectrum has a negative one.
    NoFraction,
    /// It is so large that it is taken as per cent.
    PerCent,
}

/// Materials with doubts, in the order of first use.
#[derive(Clone, Debug, Default)]
pub(super) struct Doubts(Vec<(Doubt, String, Place)>);

/// Most names in one message.
const MAX_LISTED: usize = 8;

impl Doubts {
    /// Takes note of the material `name` that is defined or used at `place`.
    pub fn add(&mut self, doubt: Doubt, name: &str, place: Place) {
        if !self.0.iter().any(|(d, n, p)| *d == doubt && n == name && *p == place) {
            self.0.push((doubt, name.to_owned(), place));
        }
    }

    /// One message per file and doubt, with the names of the materials and their number.
    pub fn report(&self, diagnostics: &mut Diagnostics) {
        for (i, (doubt, _, place)) in self.0.iter().enumerate() {
            let alike = |(d, _, p): &&(Doubt, String, Place)| d == doubt && p.path == place.path;
            if self.0[..i].iter().any(|other| alike(&other)) {
                continue;
            }
            let names: Vec<String> =
                self.0.iter().filter(alike).map(|(_, name, _)| format!("\"{name}\"")).collect();
            let mut listed = names[..names.len().min(MAX_LISTED)].join(", ");
            if names.len() > MAX_LISTED {
                listed += &format!(" and {} more", names.len() - MAX_LISTED);
            }
            let (message, help) = match (doubt, names.len()) {
                (Doubt::Missing, 1) => (
                    format!("material {listed} has no reflectance; it reflects 0.5"),
                    "give it a helios_reflectance from 0 to 1, or helios_spectra",
                ),
                (Doubt::Missing, n) => (
                    format!("{n} materials have no reflectance and reflect 0.5: {listed}"),
                    "give each a helios_reflectance from 0 to 1, or helios_spectra",
                ),
                (Doubt::NoFraction, 1) => (
                    format!(
                        "the reflectance of material {listed} is no fraction from 0 to 1, and used as it stands"
                    ),
                    "helios_reflectance 0.3 reflects 30 per cent",
                ),
                (Doubt::NoFraction, n) => (
                    format!(
                        "the reflectances of {n} materials are no fractions from 0 to 1, and used as they stand: {listed}"
                    ),
                    "helios_reflectance 0.3 reflects 30 per cent",
                ),
                (Doubt::PerCent, n) => {
                    let (whose, are) = if n == 1 { ("reflectance", "is") } else { ("reflectances", "are") };
                    diagnostics.note(
                        Some(place.clone()),
                        format!("the {whose} of {listed} {are} above 2 and taken as per cent"),
                    );
                    continue;
                }
            };
            diagnostics.warn(Some(place.clone()), message).help(help);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    #[test]
    fn a_file_is_told_once_with_all_its_materials() {
        let place = |file: &str, line| Place::in_line(Path::new(file), line, "newmtl m", 0..8);
        let mut doubts = Doubts::default();
        for i in 0..10 {
            doubts.add(Doubt::Missing, &format!("m{i}"), place("a.mtl", i));
            doubts.add(Doubt::Missing, &format!("m{i}"), place("a.mtl", i));
        }
        doubts.add(Doubt::Missing, "m1", place("b.mtl", 3));
        doubts.add(Doubt::NoFraction, "glare", place("a.mtl", 20));
        let mut d = Diagnostics::default();
        doubts.report(&mut d);
        let messages: Vec<&str> = d.items().iter().map(|i| i.message.as_str()).collect();
        assert_eq!(messages.len(), 3, "{messages:?}");
        assert!(messages[0].contains("10 materials") && messages[0].contains("\"m7\" and 2 more"));
        assert_eq!(messages[1], "material \"m1\" has no reflectance; it reflects 0.5");
        assert!(messages[2].contains("\"glare\""));
    }
}
