//! Material libraries (spec input-formats §4.2).

use super::mtl_optics::{ExpectedValue, OPTICAL_KEYS, Optics, set_optics};
use super::mtl_texture;
use super::number::{float, skip_blanks};
use super::text::{Line, Lines, Problems, Source, Words, operand, printable, shown};
use std::ops::Range;
use std::path::Path;
use vlscan_base::columns::{comma_note, decoded};
use vlscan_base::diag::{Diagnostics, nearest};
use vlscan_base::quantity::CLASSES;
use vlscan_base::recognise::Expected;
use vlscan_survey::MaterialDefinition;

/// Reads the materials of a single file.
///
/// # Errors
/// [`vlscan_base::Error::Io`]; [`vlscan_base::Error::Input`] with all problems of the file.
pub fn read_materials(path: &Path) -> vlscan_base::Result<(Vec<MaterialDefinition>, Diagnostics)> {
    let source = Source::open(path).map_err(|e| vlscan_base::Error::open(path, e))?;
    let mut problems = Diagnostics::default();
    let definitions = read(&source, &mut problems);
    Ok((definitions, problems.finish(false)?))
}

/// Reads all definitions in the order of the file. An unreadable value is an error.
pub(super) fn read(source: &Source, diagnostics: &mut Diagnostics) -> Vec<MaterialDefinition> {
    let other = source.with_other_line_ends();
    let source = other.as_ref().unwrap_or(source);
    if !source.is_text(&Expected::MATERIALS, diagnostics) {
        return Vec::new();
    }
    let mut problems = Problems::default();
    let mut definitions: Vec<MaterialDefinition> = Vec::new();
    let mut optics = Optics::default();
    for line in Lines::new(source.bytes(), true) {
        statement(source, &line, &mut definitions, &mut optics, &mut problems);
    }
    optics.finish(definitions.last_mut(), &mut problems);
    problems.report(source, diagnostics);
    definitions
}

fn statement(
    source: &Source,
    line: &Line,
    definitions: &mut Vec<MaterialDefinition>,
    optics: &mut Optics,
    problems: &mut Problems,
) {
    let mut words = Words::new(&line.text, skip_blanks(&line.text, 0));
    let Some((keyword, at)) = words.next() else { return };
    let in_file = |at: Range<usize>| line.start + at.start..line.start + at.end;
    let values: Vec<(&[u8], Range<usize>)> = words.collect();
    if keyword == b"newmtl" {
        std::mem::take(optics).finish(definitions.last_mut(), problems);
        return begin(source, line, at, definitions, problems);
    }
    let whole_line = || source.place(line.number, in_file(at.start..line.text.len()));
    let operand_of_line = &line.text[operand(&line.text, at.end)];
    let whole = (line.number, in_file(at.start..line.text.len()));
    if optics.read((keyword, operand_of_line), whole, whole_line, problems) {
        return;
    }
    if keyword == b"map_Kd" {
        if let Some(material) = definitions.last_mut() {
            let folder = source.path().parent().unwrap_or(Path::new(""));
            mtl_texture::set(material, folder, &line.text, (at.end, &values));
        }
        return;
    }
    if !is_known(keyword) {
        if let Some(text) = unknown_keyword(&shown(keyword)) {
            problems.warn(line.number, in_file(at), || format!("unknown keyword {text}"));
        }
        return;
    }
    let Some(material) = definitions.last_mut() else {
        return problems.warn(line.number, in_file(at), || {
            format!("{} before the first newmtl is ignored", shown(keyword))
        });
    };
    if keyword.starts_with(OPTICAL_PREFIX.as_bytes()) && optics.is_repeated(keyword) {
        problems.warn(line.number, in_file(at.clone()), || {
            format!("this material has {} already; the last one counts", shown(keyword))
        });
    }
    if keyword == b"helios_spectra" {
        // What begins with `#` is a comment here.
        let last = values.last().map_or(at.end, |(_, at)| at.end);
        let name = &line.text[skip_blanks(&line.text, at.end).min(last)..last];
        if !name.is_empty() {
            material.spectrum = Some(name_of(name));
            return;
        }
    }
    let is_set = set(material, keyword, &values);
    if is_set.is_ok() && keyword == b"Kd" {
        // Colours beyond white are those of pictures with other units.
        mtl_texture::colour_of(material).factor = material.kd.map(|c| c.min(1.0));
    }
    if is_set.is_ok() {
        warn_of_rest(line, keyword, &values, problems);
    }
    if is_set.is_ok() && keyword == b"helios_classification" && !CLASSES.contains(&material.classification) {
        let message = format!(
            "class {} is written as 0 in LAS and LAZ, which have classes 0 to 255",
            material.classification
        );
        return problems.warn(line.number, in_file(at), || message);
    }
    if let Err(expected) = is_set {
        report_value(line, (keyword, at), &values, expected, problems);
    }
}

/// Begins the material that a line `newmtl` names; `at` is the keyword.
fn begin(
    source: &Source,
    line: &Line,
    at: Range<usize>,
    definitions: &mut Vec<MaterialDefinition>,
    problems: &mut Problems,
) {
    let in_file = |at: Range<usize>| line.start + at.start..line.start + at.end;
    let name_at = operand(&line.text, at.end);
    if name_at.is_empty() {
        problems.warn(line.number, in_file(at), || {
            "newmtl without a name: no face can use this material".to_owned()
        });
    }
    let name = name_of(&line.text[name_at.clone()]);
    if let Some(first) = definitions.iter().find(|d| d.name == name) {
        let first = first.place.as_ref().map_or(0, |place| place.line);
        let message = format!("material \"{name}\" is already defined in line {first}, which is used");
        problems.warn(line.number, in_file(name_at), || message);
    }
    let place = Some(source.place(line.number, in_file(0..line.text.len())));
    definitions.push(MaterialDefinition { place, ..MaterialDefinition::new(name) });
}

/// Reports values that a keyword cannot have.
fn report_value(
    line: &Line,
    (keyword, at): (&[u8], Range<usize>),
    values: &[(&[u8], Range<usize>)],
    expected: ExpectedValue,
    problems: &mut Problems,
) {
    // Any component of a colour may be the wrong one.
    let used = if matches!(keyword, b"Kd" | b"Ks") { 3 } else { 1 };
    let used = &values[..used.min(values.len())];
    let (found, marked) = match (used.first(), used.last()) {
        (Some((_, first)), Some((_, last))) => {
            (format!("\"{}\"", shown(&line.text[first.start..last.end])), first.start..last.end)
        }
        _ => ("nothing".to_owned(), at),
    };
    let marked = line.start + marked.start..line.start + marked.end;
    if matches!(values.first(), Some((b"spectral" | b"xyz", _))) {
        let message = "colours by spectral curves or CIE XYZ are not read; the line is ignored";
        return problems.warn(line.number, marked, || message.to_owned());
    }
    let hint = values.iter().find_map(|(word, _)| Some(comma_note(&shown(word))).filter(|h| !h.is_empty()));
    problems.error(line.number, marked, || {
        format!("{expected} after {}, found {found}{}", shown(keyword), hint.unwrap_or_default())
    });
}

/// Keywords of other programs that are used.
const COLOURS: [&str; 3] = ["Kd", "Ks", "Ns"];
/// Keywords that only laser scanners have, in addition to [`OPTICAL_KEYS`].
const OWN: [&str; 7] = [
    "vlscan_roughness_deg",
    "vlscan_element_size_m",
    "vlscan_leaf",
    "helios_reflectance",
    "helios_spectra",
    "helios_classification",
    "helios_isGround",
];
/// Prefix of [`OPTICAL_KEYS`] in material files.
const OPTICAL_PREFIX: &str = "vlscan_";
/// Prefixes of keywords that only laser scanners have.
const OWN_PREFIXES: [&str; 2] = ["helios_", "vlscan_"];
/// Keywords of programs of HELIOS++ without effect there.
const WITHOUT_EFFECT: [&str; 1] = ["helios_useVertexColors"];

fn is_known(keyword: &[u8]) -> bool {
    let is_one_of = |known: &[&str], word: &[u8]| known.iter().any(|known| known.as_bytes() == word);
    is_one_of(&COLOURS, keyword)
        || is_one_of(&OWN, keyword)
        || optical_key(keyword).is_some_and(|key| is_one_of(&OPTICAL_KEYS, key))
}

/// The key of an optical property, if the keyword may have one.
fn optical_key(keyword: &[u8]) -> Option<&[u8]> {
    keyword.strip_prefix(OPTICAL_PREFIX.as_bytes())
}

/// True if a keyword has a prefix of laser scanners.
pub(super) fn is_own(keyword: &str) -> bool {
    let lower = keyword.to_ascii_lowercase();
    OWN_PREFIXES.iter().any(|prefix| lower.starts_with(prefix))
}

/// The warning of a keyword with a prefix of laser scanners that is unknown in material files and extras of
/// glTF, from the keyword on. `None` for known keywords, and for others, such as those for rendering.
pub(super) fn unknown_keyword(keyword: &str) -> Option<String> {
    if !is_own(keyword) || is_known(keyword.as_bytes()) || WITHOUT_EFFECT.contains(&keyword) {
        return None;
    }
    let optical = OPTICAL_KEYS.map(|key| format!("{OPTICAL_PREFIX}{key}"));
    let all = OWN.into_iter().chain(optical.iter().map(String::as_str));
    let near = nearest(keyword, all).map_or(String::new(), |near| format!("; did you mean {near}?"));
    Some(format!("{} is ignored{near}", printable(keyword)))
}

/// Warns of words beyond those that are the value of a keyword.
fn warn_of_rest(line: &Line, keyword: &[u8], values: &[(&[u8], Range<usize>)], problems: &mut Problems) {
    let used = match keyword {
        b"Kd" | b"Ks" if values.len() >= 3 => 3,
        _ => 1,
    };
    let rest = values.get(used..).unwrap_or_default();
    let (Some((_, first)), Some((_, last))) = (rest.first(), rest.last()) else { return };
    let rest = first.start..last.end;
    problems.warn(line.number, line.start + rest.start..line.start + rest.end, || {
        let (value, rest) = (shown(values[used - 1].0), shown(&line.text[rest]));
        let hint = match rest.strip_prefix('.') {
            Some(decimals) if float(values[used - 1].0).is_some_and(|v| v.fract() == 0.0) => {
                format!("; did you mean {value}.{decimals}?")
            }
            _ if rest.starts_with('%') => "; write a fraction: 0.3 is 30 %".to_owned(),
            _ => "; a comment begins with #".to_owned(),
        };
        format!("\"{rest}\" after {} {value} is ignored{hint}", shown(keyword))
    });
}

fn set(
    material: &mut MaterialDefinition,
    keyword: &[u8],
    values: &[(&[u8], Range<usize>)],
) -> Result<(), ExpectedValue> {
    let first = values.first().map(|(word, _)| *word);
    let number = || first.and_then(float).filter(|v| v.is_finite());
    let is_true = || first.and_then(boolean).ok_or(ExpectedValue("true or false"));
    let components = || colour(values).ok_or(ExpectedValue("one or three numbers, 0 or greater,"));
    match keyword {
        b"Kd" => material.kd = components()?,
        b"Ks" => material.ks = components()?,
        b"Ns" => {
            let exponent = number().filter(|n| *n >= 0.0);
            material.ns = exponent.ok_or(ExpectedValue("an exponent, 0 or greater,"))?;
        }
        b"vlscan_roughness_deg" => {
            let degrees = number().filter(|d| (0.0..=90.0).contains(d));
            let degrees = degrees.ok_or(ExpectedValue("a roughness of 0 to 90 degrees"))?;
            material.roughness = degrees.to_radians();
        }
        b"vlscan_element_size_m" => {
            let size = number().filter(|size| (0.0..=100.0).contains(size));
            material.element_size = size.ok_or(ExpectedValue("a size of foliage elements of 0 to 100 m"))?;
        }
        b"helios_reflectance" if first.and_then(float).is_some_and(f64::is_nan) => {
            material.reflectance = None
        }
        b"helios_reflectance" => {
            let reflectance = number().filter(|r| *r >= 0.0);
            material.reflectance = Some(reflectance.ok_or(ExpectedValue("a reflectance, 0 or greater,"))?);
        }
        b"helios_spectra" => return Err(ExpectedValue("the name of a spectrum")),
        b"helios_classification" => {
            material.classification = first.and_then(integer).ok_or(ExpectedValue("a whole number"))?;
        }
        b"vlscan_leaf" => material.leaf = Some(is_true()?),
        _ => match optical_key(keyword) {
            Some(key) => return set_optics(&mut material.optics, key, number()),
            None => material.is_ground = is_true()?,
        },
    }
    Ok(())
}

/// Parses three components; a single one is used for all three, as the format specifies.
fn colour(values: &[(&[u8], Range<usize>)]) -> Option<[f64; 3]> {
    let component = |i: usize| float(values.get(i)?.0).filter(|c| (0.0..=1e9).contains(c));
    let red = component(0)?;
    if values.len() == 1 { Some([red; 3]) } else { Some([red, component(1)?, component(2)?]) }
}

fn integer(word: &[u8]) -> Option<i32> {
    let value = float(word).filter(|v| v.fract() == 0.0)?;
    (value >= f64::from(i32::MIN) && value <= f64::from(i32::MAX)).then_some(value as i32)
}

fn boolean(word: &[u8]) -> Option<bool> {
    match word.to_ascii_lowercase().as_slice() {
        b"true" | b"1" => Some(true),
        b"false" | b"0" => Some(false),
        _ => None,
    }
}

/// Decodes a name, see [`decoded`], without control characters.
pub(super) fn name_of(bytes: &[u8]) -> String {
    printable(&decoded(bytes))
}

#[cfg(test)]
mod tests {
    use super::*;
    use vlscan_base::diag::Severity;
    use vlscan_survey::OpticsDefinition;

    fn read_text(text: &[u8]) -> (Vec<MaterialDefinition>, Diagnostics) {
        let mut d = Diagnostics::default();
        (read(&Source::of("m.mtl", text), &mut d), d)
    }

    #[test]
    fn the_example_of_the_dialect() {
        let (m, d) = read_text(
            b"# fields\r\nnewmtl meadow wide\r\n\tKd 0.2 0.6 0.2\r\nhelios_spectra tall grass # dry\r\nhelios_classification 2\r\n\
              helios_isGround TRUE\r\nillum 2\r\nnewmtl b\xe4r\nKs .5 # grey\nNs 20\nvlscan_roughness_deg 18\nvlscan_element_size_m 0.25\nhelios_reflectance 0.4\nvlscan_leaf true\n",
        );
        assert!(d.items().is_empty(), "{}", d.text());
        assert_eq!(
            (m[0].name.as_str(), m[0].kd, m[0].spectrum.as_deref()),
            ("meadow wide", [0.2, 0.6, 0.2], Some("tall grass"))
        );
        assert_eq!((m[0].classification, m[0].is_ground, m[0].reflectance), (2, true, None));
        assert_eq!((m[1].name.as_str(), m[1].ks, m[1].ns), ("bär", [0.5; 3], 20.0));
        assert_eq!((m[1].reflectance, m[1].is_ground), (Some(0.4), false));
        assert_eq!((m[0].element_size, m[1].element_size), (0.0, 0.25));
        assert_eq!((m[0].leaf, m[1].leaf), (None, Some(true)));
        assert_eq!((m[0].roughness, m[1].roughness), (0.0, std::f64::consts::PI / 10.0));
    }

    #[test]
    fn bad_values_are_named_all_at_once() {
        let (m, d) = read_text(
            b"Kd 1 1 1\nnewmtl a\nKd spectral f.rfl\nhelios_useVertexColors true\nhelios_reflectance much\n\
              helios_classification 2.5\nhelios_isGround perhaps\nNs -1\nvlscan_roughness_deg 91\nKs 1 nan 1\nnewmtl\nnewmtl a\nnewmtl b\nKd 1 1 1\n",
        );
        assert_eq!(d.items().len(), 10, "{}", d.text());
        assert_eq!(m.iter().map(|m| m.name.as_str()).collect::<Vec<_>>(), ["a", "", "a", "b"]);
        assert_eq!((m[0].kd, m[0].ns, m[3].kd), ([0.0; 3], 10.0, [1.0; 3]));
        let place = d.items()[2].place.as_ref().unwrap();
        assert_eq!((place.line, &place.excerpt[place.marked.clone()]), (5, "much"));
    }

    #[test]
    fn all_components_of_a_wrong_colour_are_quoted() {
        let (_, d) = read_text(b"newmtl a\nKd 0.2 -1 0 # note\n");
        let [reported] = d.items() else { panic!("{}", d.text()) };
        assert!(reported.message.contains("found \"0.2 -1 0\""), "{}", reported.message);
        let place = reported.place.as_ref().unwrap();
        assert_eq!(&place.excerpt[place.marked.clone()], "0.2 -1 0");
    }

    #[test]
    fn the_rest_of_a_line_is_reported() {
        for (line, expected) in [
            ("helios_reflectance 0 .4", "\".4\" after helios_reflectance 0 is ignored; did you mean 0.4?"),
            ("helios_reflectance 0.4 %", "a fraction"),
            ("helios_reflectance 0.4 0.5", "\"0.5\" after helios_reflectance 0.4"),
            ("helios_classification 6 building", "a comment begins with #"),
            ("helios_isGround true false", "\"false\" after"),
            ("vlscan_roughness_deg 5 rad", "\"rad\""),
            ("vlscan_element_size_m 0.3 m", "\"m\""),
            ("vlscan_leaf true yes", "\"yes\""),
            ("Ns 10 20", "\"20\""),
            ("Kd 0.1 0.2 0.3 1", "\"1\" after Kd 0.3"),
        ] {
            let (_, d) = read_text(format!("newmtl a\n{line} # note\n").as_bytes());
            let [reported] = d.items() else { panic!("{line}: {}", d.text()) };
            assert!(reported.message.contains(expected), "{line}: {}", reported.message);
            assert!(reported.severity == Severity::Warning && reported.place.as_ref().unwrap().line == 2);
        }
    }

    #[test]
    fn transparency_and_mirrors_are_remembered_for_a_message() {
        let optics = |lines: &str| {
            let (m, d) = read_text(format!("newmtl a\n{lines}\nnewmtl b\n").as_bytes());
            assert!(d.is_empty() && m[1].unused_optics.is_none(), "{lines}: {}", d.text());
            m[0].unused_optics.clone().map(|found| (found.properties, found.place.unwrap().line))
        };
        for (lines, expected) in [
            ("d 0.05\nTr 0.95\nillum 4", ("d 0.05, Tr 0.95, illum 4", 2)),
            ("Kd 1 1 1\nTr 0.5", ("Tr 0.5", 3)),
            ("d -halo 0.3", ("d -halo 0.3", 2)),
            ("d 0,05", ("d 0,05", 2)),
            ("illum 7", ("illum 7", 2)),
            ("map_d leaf 1.png", ("map_d leaf 1.png", 2)),
            ("Kd 1 1 1\nTf 0.2 0.2 0.2", ("Tf 0.2 0.2 0.2", 3)),
            ("d 0.4\nTf 0.2 0.2 0.2", ("d 0.4, Tf 0.2 0.2 0.2", 2)),
        ] {
            assert_eq!(optics(lines), Some((expected.0.to_owned(), expected.1)), "{lines}");
        }
        // Some programs write the opposite value of Tr.
        for opaque in [
            "d 1.0\nTr 0\nillum 2",
            "d 1\nTr 1",
            "Tr 1\nd 1",
            "illum 3",
            "d 0.5\nd 1",
            "d",
            "Ni 1.5",
            "Tf 1 1 1",
            "Tf 0 0 0",
            "Tf xyz",
            "d 1\nTf 0.2 0.2 0.2",
        ] {
            assert_eq!(optics(opaque), None, "{opaque}");
        }
    }

    #[test]
    fn impossible_contradictory_and_repeated_values_are_warnings() {
        let found = |lines: &str| read_text(format!("newmtl a\n{lines}\nnewmtl b\n").as_bytes()).1;
        for (lines, expected) in [
            ("d -1", "d -1 is no share from 0 to 1; it is read as 0"),
            ("Tr 7", "Tr 7 is no share from 0 to 1; it is read as 1"),
            ("d 1\nTr 0.4", "d 1 and Tr 0.4 contradict each other: Tr is 1 - d; Tr counts"),
            ("Tr 0.9\nd 0.5", "d 0.5 and Tr 0.9 contradict each other: Tr is 1 - d; d counts"),
            ("illum 4\nNi 0", "Ni 0 is no refractive index from 1 to 5; the pane has 1.5"),
            ("Ni nan\nd 0.25", "Ni nan is no refractive index from 1 to 5; the pane has 1.5"),
            ("vlscan_mirror 0.5\nvlscan_mirror 0.7", "has vlscan_mirror already; the last one counts"),
        ] {
            let d = found(lines);
            let [reported] = d.items() else { panic!("{lines}: {}", d.text()) };
            assert!(reported.severity == Severity::Warning, "{lines}");
            assert!(reported.message.contains(expected), "{lines}: {}", reported.message);
        }
        for usual in ["illum 2\nNi 0", "d 0.5\nTr 0.5", "d 0.3\nTr 0.7", "vlscan_mirror 0.5"] {
            assert!(found(usual).is_empty(), "{usual}");
        }
    }

    #[test]
    fn mirrors_and_panes_are_read_and_bad_ones_are_errors() {
        let (m, d) = read_text(
            b"newmtl pane\nvlscan_pane_index 1.52\nvlscan_pane_thickness_m 0.006\nvlscan_pane_absorption 4\n\
              vlscan_pane_sheets 2\nnewmtl mirror\nvlscan_mirror 0.9\nnewmtl sign\nvlscan_retro 180\n",
        );
        assert!(d.items().is_empty(), "{}", d.text());
        let none = OpticsDefinition::default();
        let pane = OpticsDefinition {
            index: Some(1.52),
            thickness: Some(0.006),
            absorption: Some(4.0),
            sheets: Some(2),
            ..none
        };
        assert_eq!((m[0].optics, m[1].optics.mirror, m[2].optics.retro), (pane, Some(0.9), Some(180.0)));
        for bad in [
            "vlscan_pane_index 0",
            "vlscan_pane_index -1.5",
            "vlscan_pane_index nan",
            "vlscan_pane_sheets 1.5",
            "vlscan_pane_sheets 3",
            "vlscan_pane_thickness_m -1",
            "vlscan_mirror 1.1",
            "vlscan_retro",
        ] {
            let (m, d) = read_text(format!("newmtl a\n{bad}\n").as_bytes());
            assert!(d.is_fatal(false) && m[0].optics == none, "{bad}: {}", d.text());
        }
    }

    #[test]
    fn water_is_read_and_impossible_water_is_an_error() {
        let values = [1.34, 1.365, 0.2, 5.0, 0.9, 0.001, 7.0, -30.0];
        let keys = OPTICAL_KEYS.iter().filter(|key| key.starts_with("water_"));
        let lines: String = keys.zip(values).map(|(key, value)| format!("vlscan_{key} {value}\n")).collect();
        let (m, d) = read_text(format!("newmtl a\n{lines}").as_bytes());
        assert!(d.items().is_empty(), "{}", d.text());
        let w = m[0].optics.water;
        let of_light = [w.index, w.group_index, w.attenuation, w.secchi, w.beam_attenuation, w.backscatter];
        assert_eq!([&of_light[..], &[w.wind, w.wind_direction]].concat(), values.map(Some));
        for bad in [
            "vlscan_water_index nan",
            "vlscan_water_attenuation -1",
            "vlscan_water_secchi_m 0",
            "vlscan_water_backscatter nan",
            "vlscan_water_wind_m_s -1",
        ] {
            let (m, d) = read_text(format!("newmtl a\n{bad}\n").as_bytes());
            assert!(d.is_fatal(false) && m[0].optics == OpticsDefinition::default(), "{bad}: {}", d.text());
        }
    }

    #[test]
    fn glass_and_mirrors_of_pictures_have_a_meaning() {
        let meaning = |lines: &str| {
            let (m, _) = read_text(format!("newmtl a\n{lines}\n").as_bytes());
            m[0].unused_optics.as_ref().and_then(|optics| optics.meaning)
        };
        let none = OpticsDefinition::default();
        let glass = |index, opacity| OpticsDefinition { index: Some(index), opacity, ..none };
        assert_eq!(meaning("illum 4\nNi 1.45"), Some(glass(1.45, None)));
        assert_eq!(meaning("Ni 0\nd 0.25"), Some(glass(1.5, Some(0.25))));
        assert_eq!(meaning("Tr 0.75"), Some(glass(1.5, Some(0.25))));
        let mirror = OpticsDefinition { mirror: Some(0.5), ..none };
        assert_eq!(meaning("Ks 0.5 0.5 0.5\nillum 5"), Some(mirror));
        assert_eq!(meaning("Ks 0.5 0.5 0.5\nillum 5\nd 1"), Some(mirror));
        for other in
            ["d 0.5\nmap_d leaf.png", "Tf 0.2 0.2 0.2", "illum 2\nNi 1.45", "illum 11", "illum 4\nd 1"]
        {
            assert_eq!(meaning(other), None, "{other}");
        }
    }

    #[test]
    fn names_have_no_control_characters() {
        let (m, _) = read_text(b"newmtl \x1b[31mred\nhelios_spectra a\x07b\n");
        assert_eq!((m[0].name.as_str(), m[0].spectrum.as_deref()), ("_[31mred", Some("a_b")));
    }

    #[test]
    fn noise_is_survived() {
        let noise: Vec<u8> = (0..20_000u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 13) as u8).collect();
        let (definitions, d) = read_text(&noise);
        assert!(definitions.is_empty() && d.is_fatal(false));
    }
}
