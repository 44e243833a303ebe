//! Reflectance at the scanner's wavelength from spectral libraries (spec input-formats §5). Rows are taken as
//! the reference takes them; rows that are probably meant differently cause a warning.

use super::number::float;
use super::surface_library::SurfaceSpectrum;
use super::text::{Lines, Problems, Source, Words, shown};
use std::collections::{HashMap, HashSet};
use std::ops::Range;
use std::path::{Path, PathBuf};
use vlscan_base::columns::comma_note;
use vlscan_base::diag::{Diagnostics, Place};
use vlscan_base::files::reads;
use vlscan_base::quantity::number;
use vlscan_base::recognise::Expected;

/// Number of lines before the table.
const HEADER_LINES: usize = 26;

/// Maximum wavelength and reflectance of a table.
const MAX_VALUE: f64 = 1e6;

/// Wavelength, µm, from which a whole table is taken to be in nanometres: scanners have up to 20 µm.
const MIN_NANOMETRES: f32 = 100.0;

/// A row of a table.
struct Row {
    /// µm.
    wavelength: f32,
    /// Reflectance, per cent.
    per_cent: f32,
    /// Number of its line, from 1, and its place in the file.
    line: usize,
    at: Range<usize>,
}

impl Row {
    fn warn(&self, problems: &mut Problems, message: impl FnOnce() -> String) {
        problems.warn(self.line, self.at.clone(), message);
    }
}

/// The spectra of all asset folders, read on first use by a material.
#[derive(Clone)]
pub(super) struct Spectra {
    folders: Vec<PathBuf>,
    /// Folders of an installation of HELIOS++ around the scene, which are searched last.
    installed: Vec<PathBuf>,
    /// The first is that of the first device.
    wavelengths_um: Vec<f32>,
    known: HashMap<String, Option<Vec<f64>>>,
    files: Vec<PathBuf>,
}

impl Spectra {
    /// The spectra in the `spectra` folders of `asset_folders`, evaluated at wavelengths in nm.
    pub fn new(asset_folders: &[PathBuf], wavelengths_nm: impl IntoIterator<Item = f64>) -> Spectra {
        Spectra {
            folders: asset_folders.iter().map(|f| f.join("spectra")).filter(|f| f.is_dir()).collect(),
            installed: asset_folders.last().map_or_else(Vec::new, |folder| installed(folder)),
            wavelengths_um: wavelengths_nm.into_iter().map(|nm| (nm / 1000.0) as f32).collect(),
            known: HashMap::new(),
            files: Vec::new(),
        }
    }

    /// Reflectances of the spectrum `name`, used by the material at `place`, at the wavelengths in per cent;
    /// `None` if there is no such spectrum.
    pub fn reflectances(
        &mut self,
        name: &str,
        place: Option<&Place>,
        diagnostics: &mut Diagnostics,
    ) -> Option<Vec<f64>> {
        if let Some(values) = self.known.get(name) {
            return values.clone();
        }
        let file = self.find(name, place, diagnostics);
        self.files.extend(file.clone());
        let values = match file {
            Some(path) => reflectances_in(&path, &self.wavelengths_um, diagnostics),
            None => self.built_in(name, place, diagnostics),
        };
        self.known.insert(name.to_owned(), values.clone());
        values
    }

    /// Reflectances of a surface of the library at the wavelengths in per cent; `None` for another name.
    fn built_in(&self, name: &str, place: Option<&Place>, diagnostics: &mut Diagnostics) -> Option<Vec<f64>> {
        let surface = SurfaceSpectrum::find(name)?;
        let (first, last) = surface.range();
        let wavelengths = self.wavelengths_um.iter().map(|um| f64::from(*um) * 1000.0);
        // A wavelength in µm has the digits of a number of 32 bits.
        let is_beyond = |nm: &f64| *nm < first - 0.01 || *nm > last + 0.01;
        if let Some(beyond) = wavelengths.clone().find(is_beyond) {
            let message = format!(
                "the built-in spectrum \"{name}\" has values from {first} to {last} nm; the nearest one is \
                 used for {} nm",
                number(beyond.round())
            );
            diagnostics.warn(place.cloned(), message);
        }
        Some(wavelengths.map(|nm| 100.0 * surface.reflectance(nm)).collect())
    }

    pub fn files(&self) -> impl Iterator<Item = &PathBuf> {
        self.files.iter()
    }

    /// The folders that are searched, for messages.
    pub fn described(&self) -> String {
        let names = SurfaceSpectrum::names();
        format!("{}; built in are {names}", self.described_folders())
    }

    fn described_folders(&self) -> String {
        match self.folders.as_slice() {
            [] => "no asset folder holds a folder \"spectra\"".to_owned(),
            all => {
                let names: Vec<String> = all.iter().map(|f| f.display().to_string()).collect();
                format!("looked in {}", names.join(", "))
            }
        }
    }

    /// The first file of this name; further ones cause a warning. The assets around the file of the material
    /// are searched last.
    fn find(&self, name: &str, place: Option<&Place>, diagnostics: &mut Diagnostics) -> Option<PathBuf> {
        let found = Spectra::find_in(&self.folders, name, diagnostics);
        let found = found.or_else(|| Spectra::find_in(&self.installed, name, diagnostics));
        let around = || place.and_then(|place| place.path.parent()).map_or_else(Vec::new, installed);
        found.or_else(|| Spectra::find_in(&around(), name, diagnostics))
    }

    fn find_in(folders: &[PathBuf], name: &str, diagnostics: &mut Diagnostics) -> Option<PathBuf> {
        let files = folders.iter().flat_map(|folder| reads::list(folder).unwrap_or_default());
        let named = files.filter(|f| f.file_stem().is_some_and(|s| s == name) && f.is_file());
        // Several paths can lead to the same folder.
        let mut seen = HashSet::new();
        let mut different = named.filter(|f| seen.insert(f.canonicalize().unwrap_or_else(|_| f.clone())));
        let first = different.next()?;
        let others: Vec<String> = different.map(|f| f.display().to_string()).collect();
        if !others.is_empty() {
            let message = format!(
                "several files have the name of the spectrum \"{name}\"; this one is used, not {}",
                others.join(", ")
            );
            diagnostics.warn(Some(Place::of_file(&first)), message).help("rename or remove the others");
        }
        Some(first)
    }
}

/// Number of folders above that of a scene or a material in which the assets of HELIOS++ are searched: scenes
/// are in `data/scenes/NAME`, materials in `data/sceneparts/NAME`, spectra in `assets/spectra`.
const MAX_ABOVE: usize = 4;

/// The folders of spectra in `assets` beside a folder and those above it.
fn installed(folder: &Path) -> Vec<PathBuf> {
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let whole = std::path::absolute(folder).unwrap_or_else(|_| folder.to_path_buf());
    let above = whole.ancestors().take(MAX_ABOVE + 1);
    above.map(|folder| folder.join("assets").join("spectra")).filter(|folder| folder.is_dir()).collect()
}

fn reflectances_in(path: &Path, wavelengths: &[f32], diagnostics: &mut Diagnostics) -> Option<Vec<f64>> {
    let source = match Source::open(path) {
        Ok(source) => source,
        Err(e) => {
            let message = format!("cannot read the spectrum {}: {e}", path.display());
            diagnostics.error(None, message).of_kind((&e).into());
            return None;
        }
    };
    if !source.is_text(&Expected::SPECTRUM, diagnostics) {
        return None;
    }
    let mut problems = Problems::default();
    let rows = table(&source, &mut problems);
    if problems.is_valid() {
        warn_of_doubts(&rows, wavelengths, &mut problems);
    }
    if !problems.report(&source, diagnostics) {
        return None;
    }
    if rows.is_empty() {
        let end = source.bytes().len();
        let lines = Lines::new(source.bytes(), false).count();
        let message = format!("the spectrum holds no values after the {HEADER_LINES} lines of its header");
        diagnostics.error(Some(source.place(lines, end.saturating_sub(1)..end)), message);
        return None;
    }
    Some(wavelengths.iter().map(|wavelength| f64::from(interpolate(&rows, *wavelength))).collect())
}

fn table(source: &Source, problems: &mut Problems) -> Vec<Row> {
    let mut rows = Vec::new();
    let (mut has_reported_header, mut has_reported_columns) = (false, false);
    for line in Lines::new(source.bytes(), false) {
        let mut words = Words::new(&line.text, 0);
        let Some((first, at)) = words.next() else { continue };
        let parsed = |word: &[u8]| float(word).filter(|v| v.abs() <= MAX_VALUE).map(|v| v as f32);
        let values = parsed(first).zip(words.next().and_then(|(word, _)| parsed(word)));
        let at = line.start + at.start..line.start + line.text.len();
        if line.number <= HEADER_LINES {
            if values.is_some() && !has_reported_header {
                has_reported_header = true;
                problems.warn(line.number, at, || {
                    format!(
                        "a row among the first {HEADER_LINES} lines, which are the header and are not read; \
                         put as many lines before the table"
                    )
                });
            }
            continue;
        }
        let Some((wavelength, per_cent)) = values else {
            problems.error(line.number, at.clone(), || {
                let found = shown(&source.bytes()[at]);
                let found = found.trim();
                let hint = comma_note(found.split_whitespace().next().unwrap_or_default());
                format!(
                    "expected a wavelength in micrometres and a reflectance in per cent with a blank between \
                     them, found \"{found}\"{hint}"
                )
            });
            continue;
        };
        if words.next().is_some() && !has_reported_columns {
            has_reported_columns = true;
            problems.warn(line.number, at.clone(), || {
                "what follows the wavelength and the reflectance in a row is not read".to_owned()
            });
        }
        rows.push(Row { wavelength, per_cent, line: line.number, at });
    }
    rows
}

/// Warns of rows that are probably meant differently, and of a wavelength outside of the table.
fn warn_of_doubts(rows: &[Row], wavelengths: &[f32], problems: &mut Problems) {
    let used_at = |wavelength: &f32| {
        let per_cent = number(f64::from(interpolate(rows, *wavelength)).max(0.0));
        format!("at {wavelength} µm it reflects {per_cent} per cent")
    };
    let used: Vec<String> = wavelengths.iter().map(used_at).collect();
    let used = used.join(", ");
    warn_of_numbers(rows, &used, problems);
    let Some(range) = rows.first().zip(rows.last()) else { return };
    if rows.iter().all(|row| row.wavelength >= MIN_NANOMETRES) {
        range.0.warn(problems, || {
            format!(
                "wavelengths in nanometres? the file is read in micrometres, from {} to {} µm: {used}; \
                 divide them by 1000",
                range.0.wavelength, range.1.wavelength
            )
        });
    } else if !warn_of_order(rows, &used, problems) {
        for wavelength in wavelengths {
            warn_of_range(range, *wavelength, &used_at(wavelength), problems);
        }
    }
}

/// Warns of the first of several rows with the same problem.
fn warn_of_first(wrong: &[&Row], problems: &mut Problems, message: impl FnOnce(&Row, &str) -> String) {
    let Some(row) = wrong.first() else { return };
    let others = match wrong.len() {
        1 => String::new(),
        n => format!(", and so in {} more rows", n - 1),
    };
    row.warn(problems, || message(row, &others));
}

/// Warns of numbers that are not wavelengths or not reflectances in per cent. `used` is what follows from the
/// table.
fn warn_of_numbers(rows: &[Row], used: &str, problems: &mut Problems) {
    let no_wavelengths: Vec<&Row> = rows.iter().filter(|row| row.wavelength <= 0.0).collect();
    warn_of_first(&no_wavelengths, problems, |row, others| {
        let found = row.wavelength;
        format!("expected a wavelength above 0 µm, found {found}{others}; the row is used: {used}")
    });
    let negative: Vec<&Row> = rows.iter().filter(|row| row.per_cent < 0.0).collect();
    warn_of_first(&negative, problems, |row, others| {
        format!(
            "expected a reflectance of 0 per cent or more, found {}{others}; the row is used, and a result \
             below 0 is set to 0: {used}",
            row.per_cent
        )
    });
    let highest = rows.iter().fold(0.0f32, |highest, row| highest.max(row.per_cent));
    if let (Some(first), true) = (rows.first(), negative.is_empty() && highest > 0.0 && highest <= 1.0) {
        first.warn(problems, || {
            format!(
                "reflectances as fractions? none is above {highest}, and the file is read in per cent: \
                 {used}; multiply them by 100"
            )
        });
    }
}

/// Warns of rows that do not ascend; `false` if all do.
fn warn_of_order(rows: &[Row], used: &str, problems: &mut Problems) -> bool {
    // A row may be duplicated, as where the data of two instruments meet.
    let is_misplaced = |row: &Row, before: &Row| {
        row.wavelength < before.wavelength
            || row.wavelength == before.wavelength && row.per_cent != before.per_cent
    };
    let misplaced: Vec<&Row> =
        rows.windows(2).filter(|pair| is_misplaced(&pair[1], &pair[0])).map(|pair| &pair[1]).collect();
    warn_of_first(&misplaced, problems, |row, others| {
        format!(
            "expected a wavelength above that of the row before, found {}{others}; the first row at or above \
             the wavelength is used: {used}; sort the rows by wavelength",
            row.wavelength
        )
    });
    !misplaced.is_empty()
}

/// Warns of a wavelength outside of a table with this first and this last row.
fn warn_of_range((first, last): (&Row, &Row), wavelength: f32, used: &str, problems: &mut Problems) {
    let is = format!("the wavelength {wavelength} µm (the scanner's, or 1.064 µm where none is named) is");
    if wavelength < first.wavelength {
        first.warn(problems, || {
            let begin = first.wavelength;
            format!(
                "{is} below the table, which begins at {begin} µm; the value lies between 0 per cent at 0 µm \
                 and its first row: {used}"
            )
        });
    } else if wavelength > last.wavelength {
        last.warn(problems, || {
            let end = last.wavelength;
            format!("{is} beyond the table, which ends at {end} µm; its last row is used: {used}")
        });
    }
}

/// The value at `wavelength` in single precision: linear between rows, from (0, 0) below the first, constant
/// beyond the last.
fn interpolate(rows: &[Row], wavelength: f32) -> f32 {
    let mut before = (0.0f32, 0.0f32);
    for &Row { wavelength: at, per_cent: value, .. } in rows {
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

    fn rows(values: &[(f32, f32)]) -> Vec<Row> {
        values
            .iter()
            .map(|&(wavelength, per_cent)| Row { wavelength, per_cent, line: 27, at: 0..0 })
            .collect()
    }

    /// The reflectance at 1.064 µm of a spectrum of these rows, and what is said about them.
    fn read(rows: &str) -> (Option<f64>, Diagnostics) {
        let root = tempfile::tempdir().unwrap();
        std::fs::create_dir(root.path().join("spectra")).unwrap();
        std::fs::write(root.path().join("spectra/a.txt"), spectrum(rows)).unwrap();
        let mut d = Diagnostics::default();
        let values = Spectra::new(&[root.path().to_path_buf()], [1064.0]).reflectances("a", None, &mut d);
        (values.map(|values| values[0]), d)
    }

    #[test]
    fn interpolation_within_below_and_beyond() {
        let table = rows(&[(0.4, 10.0), (1.0, 40.0), (1.064, 52.4)]);
        assert_eq!(interpolate(&table, 1.064), 52.4);
        assert!((interpolate(&table, 0.7) - 25.0).abs() < 1e-5);
        assert!((interpolate(&table, 0.2) - 5.0).abs() < 1e-6, "below the first row from (0, 0)");
        assert_eq!(interpolate(&table, 2.5), 52.4);
    }

    #[test]
    fn rows_that_hardly_mean_what_is_read_are_warned_of_at_their_lines() {
        for (rows, expected, line, message) in [
            ("400 20\n1600 40\n", 0.0532, 27, "wavelengths in nanometres? the file is read in micrometres"),
            ("1600 40\n400 20\n", 0.0266, 27, "wavelengths in nanometres?"),
            ("1.2 20\n1.6 40\n", 17.733, 27, "is below the table, which begins at 1.2 µm"),
            ("0.4 20\n0.6 40\n", 40.0, 28, "is beyond the table, which ends at 0.6 µm; its last row is used"),
            ("0.5 10\n", 10.0, 27, "is beyond the table"),
            ("1.6 40\n1.0 30\n0.4 20\n", 26.6, 28, "found 1, and so in 1 more rows; the first row at"),
            ("1 10\n1 20\n2 20\n", 20.0, 28, "expected a wavelength above that of the row before, found 1;"),
            ("-0.4 20\n1.6 40\n", 34.64, 27, "expected a wavelength above 0 µm, found -0.4;"),
            ("0 20\n1.6 40\n", 33.3, 27, "expected a wavelength above 0 µm, found 0;"),
            ("0.4 -20\n1.064 -4\n2 -1\n", -4.0, 27, "found -20, and so in 2 more rows"),
            ("0.4 0.2\n1.064 0.4\n2 1\n", 0.4, 27, "reflectances as fractions? none is above 1,"),
            ("1 20\n2 20 0.01\n", 20.0, 28, "what follows the wavelength and the reflectance"),
        ] {
            let (value, found) = read(rows);
            assert!((value.unwrap() - expected).abs() < 1e-3, "{rows}: {value:?}");
            let reported: Vec<_> =
                found.items().iter().filter(|item| item.message.contains(message)).collect();
            assert_eq!(reported.len(), 1, "{rows}:\n{}", found.text());
            assert_eq!(reported[0].place.as_ref().unwrap().line, line, "{rows}");
            assert!(found.is_fatal(true) && !found.is_fatal(false), "{rows}");
            let used = format!("it reflects {} per cent", number(value.unwrap().max(0.0)));
            assert!(
                message.contains("what follows") || reported[0].message.contains(&used),
                "{}",
                reported[0].message
            );
        }
        let fine =
            ["0.4 20\t\n1 40\n1 40\n1.6 30 # dry\n", "0.4 0\n2 0\n", "0.3 0.5\n\n1.064 98\n", "1.064 20\n"];
        for rows in fine {
            let found = read(rows).1;
            assert!(found.is_empty(), "{rows}:\n{}", found.text());
        }
        let (_, found) = read("0,4 20\n");
        assert!(found.items()[0].message.contains("found \"0,4 20\", which has a decimal comma"));
    }

    #[test]
    fn rows_within_the_header_are_warned_of() {
        let root = tempfile::tempdir().unwrap();
        std::fs::create_dir(root.path().join("spectra")).unwrap();
        let header = "Name: a\n".repeat(HEADER_LINES - 2);
        std::fs::write(
            root.path().join("spectra/a.txt"),
            format!("{header}0.4 10\n0.6 20\n0.8 30\n1.2 40\n"),
        )
        .unwrap();
        let mut d = Diagnostics::default();
        Spectra::new(&[root.path().to_path_buf()], [1064.0]).reflectances("a", None, &mut d);
        let [reported] = d.items() else { panic!("{}", d.text()) };
        assert!(reported.message.contains("the first 26 lines"), "{}", reported.message);
        assert_eq!(reported.place.as_ref().unwrap().line, 25);
    }

    #[test]
    fn the_first_folder_wins_with_a_warning_and_the_extension_does_not_count() {
        let (a, b) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
        for (root, percent) in [(&a, 20.0), (&b, 80.0)] {
            std::fs::create_dir(root.path().join("spectra")).unwrap();
            let rows = spectrum(&format!("0.5\t{percent}  \r\n1.5\t{percent}\t\n"));
            std::fs::write(root.path().join("spectra/moss.green.txt"), rows).unwrap();
        }
        let empty = tempfile::tempdir().unwrap();
        let [empty, a, b] = [&empty, &a, &b].map(|folder| folder.path().to_path_buf());
        for (folders, warnings) in [(vec![empty.clone(), a.clone(), a.clone()], 0), (vec![empty, a, b], 1)] {
            let mut d = Diagnostics::default();
            let mut spectra = Spectra::new(&folders, [1064.0]);
            assert_eq!(spectra.reflectances("moss.green", None, &mut d), Some(vec![20.0]));
            assert_eq!(spectra.reflectances("moss", None, &mut d), None);
            assert_eq!(d.items().len(), warnings, "{}", d.text());
            assert!(d.items().iter().all(|item| item.place.is_some()));
        }
    }

    #[test]
    fn assets_around_the_file_of_a_material_are_searched_last() {
        let root = tempfile::tempdir().unwrap();
        for (folder, percent) in [("assets/spectra", 10), ("own/spectra", 20)] {
            std::fs::create_dir_all(root.path().join(folder)).unwrap();
            let rows = spectrum(&format!("0.5\t{percent}\n1.5\t{percent}\n"));
            std::fs::write(root.path().join(folder).join("wood.txt"), rows).unwrap();
        }
        let place = Place::of_file(&root.path().join("data/sceneparts/tree/tree.mtl"));
        let cases = [(0, None, None), (0, Some(&place), Some(10.0)), (1, Some(&place), Some(20.0))];
        for (folders, place, expected) in cases {
            let mut spectra = Spectra::new(&[], [1064.0]);
            spectra.folders = vec![root.path().join("own/spectra"); folders];
            let values = spectra.reflectances("wood", place, &mut Diagnostics::default());
            assert_eq!(values.map(|values| values[0]), expected);
        }
    }

    #[test]
    fn a_damaged_spectrum_is_named() {
        let root = tempfile::tempdir().unwrap();
        std::fs::create_dir(root.path().join("spectra")).unwrap();
        std::fs::write(root.path().join("spectra/a.txt"), spectrum("0.5\t10\nrubbish\n1.5\n2\t20\n"))
            .unwrap();
        std::fs::write(root.path().join("spectra/b.txt"), "0.5\t10\n").unwrap();
        let mut d = Diagnostics::default();
        let mut spectra = Spectra::new(&[root.path().to_path_buf()], [500.0]);
        assert_eq!(spectra.reflectances("a", None, &mut d), None);
        assert_eq!(d.items().iter().flat_map(|i| i.lines()).collect::<Vec<_>>(), [28, 29]);
        assert_eq!(spectra.reflectances("b", None, &mut d), None);
        assert!(d.text().contains("holds no values"), "{}", d.text());
    }
}
