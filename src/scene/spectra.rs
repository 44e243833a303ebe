//! Reflectance at the scanner's wavelength from spectral libraries (spec input-formats §5).

use super::number::float;
use super::text::{Lines, Problems, Source, Words};
use crate::diag::Diagnostics;
use std::collections::HashMap;
use std::path::{Path, PathBuf};

/// Number of lines before the table.
const HEADER_LINES: usize = 26;

/// Maximum wavelength and reflectance of a table.
const MAX_VALUE: f64 = 1e6;

/// The spectra of all asset folders, read on first use by a material.
pub(super) struct Spectra {
    folders: Vec<PathBuf>,
    wavelength_um: f32,
    known: HashMap<String, Option<f64>>,
    files: Vec<PathBuf>,
}

impl Spectra {
    /// The spectra in the `spectra` folders of `asset_folders`, evaluated at `wavelength_nm`.
    pub fn new(asset_folders: &[PathBuf], wavelength_nm: f64) -> Spectra {
        Spectra {
            folders: asset_folders.iter().map(|f| f.join("spectra")).filter(|f| f.is_dir()).collect(),
            wavelength_um: (wavelength_nm / 1000.0) as f32,
            known: HashMap::new(),
            files: Vec::new(),
        }
    }

    /// Reflectance of the spectrum `name` in per cent; `None` if there is no such spectrum.
    pub fn reflectance(&mut self, name: &str, diagnostics: &mut Diagnostics) -> Option<f64> {
        if let Some(&value) = self.known.get(name) {
            return value;
        }
        let file = self.find(name);
        self.files.extend(file.clone());
        let value = file.and_then(|path| reflectance_in(&path, self.wavelength_um, diagnostics));
        self.known.insert(name.to_owned(), value);
        value
    }

    pub fn files(&self) -> impl Iterator<Item = &PathBuf> {
        self.files.iter()
    }

    /// The folders that are searched, for messages.
    pub fn described(&self) -> String {
        match self.folders.as_slice() {
            [] => "no asset folder holds a folder \"spectra\"".to_owned(),
            all => {
                let names: Vec<String> = all.iter().map(|f| f.display().to_string()).collect();
                format!("looked in {}", names.join(", "))
            }
        }
    }

    fn find(&self, name: &str) -> Option<PathBuf> {
        self.folders.iter().find_map(|folder| {
            let mut files: Vec<PathBuf> =
                std::fs::read_dir(folder).ok()?.flatten().map(|e| e.path()).collect();
            files.sort();
            files.into_iter().find(|f| f.file_stem().is_some_and(|s| s == name) && f.is_file())
        })
    }
}

fn reflectance_in(path: &Path, wavelength: f32, diagnostics: &mut Diagnostics) -> Option<f64> {
    let source = match Source::open(path) {
        Ok(source) => source,
        Err(e) => {
            diagnostics.error(None, format!("cannot read the spectrum {}: {e}", path.display()));
            return None;
        }
    };
    if !source.is_text("a spectrum", diagnostics) {
        return None;
    }
    let mut problems = Problems::default();
    let table = table(&source, &mut problems);
    if !problems.report(&source, diagnostics) {
        return None;
    }
    if table.is_empty() {
        let end = source.bytes().len();
        let lines = Lines::new(source.bytes(), false).count();
        let message = format!("the spectrum holds no values after the {HEADER_LINES} lines of its header");
        diagnostics.error(Some(source.place(lines, end.saturating_sub(1)..end)), message);
        return None;
    }
    Some(f64::from(interpolate(&table, wavelength)))
}

fn table(source: &Source, problems: &mut Problems) -> Vec<(f32, f32)> {
    let mut rows = Vec::new();
    for line in Lines::new(source.bytes(), false).skip(HEADER_LINES) {
        let mut words = Words::new(&line.text, 0);
        let Some((first, at)) = words.next() else { continue };
        let number = |word: &[u8]| float(word).filter(|v| v.abs() <= MAX_VALUE).map(|v| v as f32);
        match (number(first), words.next().and_then(|(w, _)| number(w))) {
            (Some(wavelength), Some(percent)) => rows.push((wavelength, percent)),
            _ => problems.error(line.number, line.start + at.start..line.start + line.text.len(), || {
                "expected a wavelength in micrometres and a reflectance in per cent".to_owned()
            }),
        }
    }
    rows
}

/// The value at `wavelength` in single precision: linear between rows, from (0, 0) below the first, constant beyond the
/// last.
fn interpolate(table: &[(f32, f32)], wavelength: f32) -> f32 {
    let mut before = (0.0f32, 0.0f32);
    for &(at, value) in table {
        if at == wavelength {
            return value;
        }
        if at > wavelength {
            return before.1 + (value - before.1) * (wavelength - before.0) / (at - before.0);
        }
        before = (at, value);
    }
    before.1
}

#[cfg(test)]
mod tests {
    use super::*;

    fn spectrum(rows: &str) -> String {
        format!("{}{rows}", "a header line\n".repeat(HEADER_LINES))
    }

    #[test]
    fn interpolation_within_below_and_beyond() {
        let table = [(0.4f32, 10.0f32), (1.0, 40.0), (1.064, 52.4)];
        assert_eq!(interpolate(&table, 1.064), 52.4);
        assert!((interpolate(&table, 0.7) - 25.0).abs() < 1e-5);
        assert!((interpolate(&table, 0.2) - 5.0).abs() < 1e-6, "below the first row from (0, 0)");
        assert_eq!(interpolate(&table, 2.5), 52.4);
    }

    #[test]
    fn the_first_folder_wins_and_the_extension_does_not_count() {
        let (a, b) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
        for (root, percent) in [(&a, 20.0), (&b, 80.0)] {
            std::fs::create_dir(root.path().join("spectra")).unwrap();
            let rows = spectrum(&format!("0.5\t{percent}  \r\n1.5\t{percent}\textra\n"));
            std::fs::write(root.path().join("spectra/moss.green.txt"), rows).unwrap();
        }
        let mut d = Diagnostics::default();
        let empty = tempfile::tempdir().unwrap();
        let folders = [empty.path().to_path_buf(), a.path().to_path_buf(), b.path().to_path_buf()];
        let mut spectra = Spectra::new(&folders, 1064.0);
        assert_eq!(spectra.reflectance("moss.green", &mut d), Some(20.0));
        assert_eq!(spectra.reflectance("moss", &mut d), None);
        assert!(d.items().is_empty());
    }

    #[test]
    fn a_damaged_spectrum_is_named() {
        let root = tempfile::tempdir().unwrap();
        std::fs::create_dir(root.path().join("spectra")).unwrap();
        std::fs::write(root.path().join("spectra/a.txt"), spectrum("0.5\t10\nrubbish\n1.5\n2\t20\n"))
            .unwrap();
        std::fs::write(root.path().join("spectra/b.txt"), "0.5\t10\n").unwrap();
        let mut d = Diagnostics::default();
        let mut spectra = Spectra::new(&[root.path().to_path_buf()], 500.0);
        assert_eq!(spectra.reflectance("a", &mut d), None);
        assert_eq!(d.items().iter().flat_map(|i| i.lines()).collect::<Vec<_>>(), [28, 29]);
        assert_eq!(spectra.reflectance("b", &mut d), None);
        assert_eq!(d.items().len(), 2);
    }
}
