//! Headers of voxel files.

use super::layout::Layout;
use crate::builder::MAX_COORDINATE;
use crate::number::float;
use crate::text::{Line, Lines, Problems, Source, shown};
use std::ops::Range;
use vlscan_geom::DVec3;

/// The header of a file.
#[derive(Debug, PartialEq)]
pub(super) struct Header {
    pub min_corner: DVec3,
    pub resolution: f64,
    /// Number of cells along x, y, z.
    pub split: [f64; 3],
    pub max_density: Option<f64>,
    pub layout: Layout,
    /// Start of the voxels: bytes and lines before them.
    pub body: (usize, usize),
}

/// Reads everything before the voxels: fields, and the two lines that are neither fields nor blank.
pub(super) fn read_header(source: &Source, problems: &mut Problems) -> Option<Header> {
    let mut fields = Fields::default();
    let mut titles = Vec::new();
    let mut lines = Lines::new(source.bytes(), false);
    let mut end = None;
    for line in lines.by_ref() {
        let text = line.text.trim_ascii_start();
        if text.is_empty() {
            continue;
        }
        if text[0] == b'#' {
            fields.read(&line, problems);
        } else if titles.len() == 2 {
            end = Some((line.start, line.number - 1));
            break;
        } else {
            titles.push(line);
        }
    }
    let body = end.unwrap_or((source.bytes().len(), lines.passed));
    if !fields.is_sound {
        return None;
    }
    let mut required = |name: &str| {
        let value = fields.get(name);
        if value.is_none() {
            let count = if name == "res" { 1 } else { 3 };
            problems.error(1, 0..0, || format!("the header has no line \"#{name}:\" with {count} numbers"));
        }
        value
    };
    let corners = [required("min_corner"), required("max_corner")];
    let [split, size] = [required("split"), required("res")];
    let ([Some(low), Some(high)], Some(split), Some(size)) = (corners, split, size) else { return None };
    let resolution = size.values[0];
    if resolution <= 0.0 || size.values.iter().any(|s| *s != resolution) {
        problems.error(size.line, size.at.clone(), || {
            format!("expected cubes of a size above 0 as #res, found {}", numbers_of(&size.values))
        });
        return None;
    }
    if split.values.iter().any(|count| count.fract() != 0.0 || !(1.0..=f64::from(u32::MAX)).contains(count)) {
        problems.error(split.line, split.at.clone(), || {
            format!(
                "expected whole numbers of cells, at least 1, as #split, found {}",
                numbers_of(&split.values)
            )
        });
        return None;
    }
    let vector = |field: &Field| DVec3::new(field.values[0], field.values[1], field.values[2]);
    let (min_corner, expected) = (vector(low), vector(low) + vector(split) * resolution);
    // Files round their numbers, but not to half a cell.
    if (vector(high) - expected).abs().max_element() > 0.5 * resolution {
        problems.warn(high.line, high.at.clone(), || {
            format!(
                "#max_corner is not where #min_corner, #split and #res end, at {} {} {}; it is ignored",
                expected.x, expected.y, expected.z
            )
        });
    }
    let max_density = fields.get("max_pad").map(|field| field.values[0]);
    let split = [split.values[0], split.values[1], split.values[2]];
    let layout = titles.get(1).map_or(Some(Layout::UNNAMED), |line| Layout::read(line, problems))?;
    Some(Header { min_corner, resolution, split, max_density, layout, body })
}

/// A field `#name: values`.
struct Field {
    name: &'static str,
    values: Vec<f64>,
    line: usize,
    at: Range<usize>,
}

/// Names of the fields that are read, and the numbers of values that they may have.
const NAMES: [(&str, &[usize]); 5] =
    [("min_corner", &[3]), ("max_corner", &[3]), ("split", &[3]), ("res", &[1, 3]), ("max_pad", &[1])];

struct Fields {
    all: Vec<Field>,
    /// False after a field that cannot be read.
    is_sound: bool,
}

impl Default for Fields {
    fn default() -> Fields {
        Fields { all: Vec::new(), is_sound: true }
    }
}

impl Fields {
    /// The last field of a name.
    fn get(&self, name: &str) -> Option<&Field> {
        self.all.iter().rfind(|field| field.name == name)
    }

    /// Parses a header line with one or more fields.
    fn read(&mut self, line: &Line, problems: &mut Problems) {
        for field in line.text.split(|&b| b == b'#') {
            let Some(colon) = field.iter().position(|&b| b == b':') else { continue };
            let name = field[..colon].trim_ascii().to_ascii_lowercase();
            let Some((name, counts)) = NAMES.iter().find(|(known, _)| known.as_bytes() == name) else {
                continue;
            };
            let at = line.start..line.start + line.text.len();
            let words = field[colon + 1..].split(|b| b" \t\r,()".contains(b)).filter(|w| !w.is_empty());
            let values: Option<Vec<f64>> =
                words.map(|w| float(w).filter(|v| v.abs() <= MAX_COORDINATE)).collect();
            // The maximum is optional, and may be empty.
            if *name == "max_pad" && values.as_ref().is_some_and(Vec::is_empty) {
                continue;
            }
            let Some(values) = values.filter(|values| counts.contains(&values.len())) else {
                self.is_sound = false;
                problems.error(line.number, at, || wrong(name, counts, &field[colon + 1..]));
                continue;
            };
            if self.get(name).is_some_and(|first| first.values != values) {
                problems
                    .warn(line.number, at.clone(), || format!("#{name} is given twice; this line counts"));
            }
            self.all.push(Field { name, values, line: line.number, at });
        }
    }
}

/// The message about values that are not numbers, or not as many as there should be.
fn wrong(name: &str, counts: &[usize], values: &[u8]) -> String {
    let expected: Vec<String> = counts.iter().map(usize::to_string).collect();
    let noun = if counts == [1] { "number" } else { "numbers" };
    let found = shown(values.trim_ascii());
    let is_decimal =
        |pair: &[u8]| matches!(pair, [digit, b',', next] if digit.is_ascii_digit() && next.is_ascii_digit());
    let hint = match values.windows(3).any(is_decimal) {
        true => "; a comma separates numbers, write decimal points",
        false => "",
    };
    format!("expected {} {noun} after \"#{name}:\", found \"{found}\"{hint}", expected.join(" or "))
}

/// Numbers as a file lists them.
pub(super) fn numbers_of<T: ToString>(numbers: &[T]) -> String {
    numbers.iter().map(T::to_string).collect::<Vec<_>>().join(" ")
}
