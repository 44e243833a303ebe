//! Points, and those of a text file.

use crate::geom::DVec3;
use crate::scene::assembly::FARTHEST;
use crate::scene::number::{float, is_blank};
use crate::scene::text::{Line, Lines, Problems, is_empty_line, shown};
use crate::survey::XyzLoader;
use std::ops::Range;

/// Points that are read at a time.
pub(super) const BATCH: usize = 1 << 16;

/// A file whose points come one after the other.
pub(super) trait Batches {
    /// Appends up to [`BATCH`] points; says whether there are more. An error says what is wrong with the file.
    fn next(&mut self, room: &mut Vec<Point>) -> Result<bool, String>;
}

/// A point with the normal that its line or record holds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Point {
    /// m, as the file has it.
    pub position: DVec3,
    /// As the file has it, of any length, also useless.
    pub normal: Option<DVec3>,
    /// Point class; 0 where the file has none.
    pub class: u8,
}

/// Where the columns are.
pub(super) struct Columns {
    separators: Vec<u8>,
    normal: Option<[usize; 3]>,
}

/// Columns of normals when the scene names none.
const USUAL_NORMAL: [usize; 3] = [3, 4, 5];

impl Columns {
    /// The columns of a loader's files. Colours named for the usual place of normals leave no room for them.
    pub fn new(loader: &XyzLoader, has_normals: bool) -> Columns {
        let separators =
            if loader.separator.is_empty() { vec![b' '] } else { loader.separator.clone().into_bytes() };
        let colours = loader.rgb_columns.unwrap_or([6, 7, 8]);
        let usual = (!USUAL_NORMAL.iter().any(|c| colours.contains(c))).then_some(USUAL_NORMAL);
        Columns { separators, normal: loader.normal_columns.or(usual).filter(|_| has_normals) }
    }

    /// The words of a line. Blanks that separate may be repeated; other separators make empty words.
    fn split<'a>(&'a self, line: &'a [u8]) -> impl Iterator<Item = Range<usize>> + 'a {
        let is_separator = |b: u8| {
            self.separators.contains(&b) || (is_blank(b) && self.separators.iter().all(|&s| is_blank(s)))
        };
        let mut at = Some(0);
        std::iter::from_fn(move || {
            let mut start = at?;
            while line.get(start).is_some_and(|&b| is_blank(b)) {
                start += 1;
            }
            if start >= line.len() {
                at = None;
                return None;
            }
            let end = line[start..].iter().position(|&b| is_separator(b)).map_or(line.len(), |n| start + n);
            at = (end < line.len()).then_some(end + 1);
            Some(start..end)
        })
    }
}

/// `//` marks comments, and what other programs put before their headings.
fn is_comment(text: &[u8]) -> bool {
    matches!(text, [b'/', b'/', ..] | [b'#', ..])
}

/// Whether the first line names columns: it has words, and each begins with a letter and is no number.
fn is_heading(line: &Line, words: &[Range<usize>]) -> bool {
    let is_name = |at: &Range<usize>| {
        let word = line.text[at.clone()].trim_ascii();
        let word = word.strip_prefix(b"\"").unwrap_or(word);
        word.first().is_some_and(u8::is_ascii_alphabetic) && float(word).is_none()
    };
    words.len() >= 3 && words.iter().all(is_name)
}

/// The columns of the first point and of the last line, which nothing ends, if the latter is shorter.
pub(super) fn cut(bytes: &[u8], last: &[u8], columns: &Columns) -> Option<(usize, usize)> {
    let is_row = |text: &[u8]| !is_empty_line(text) && !is_comment(text.trim_ascii_start());
    let is_point = |l: &Line| {
        is_row(&l.text) && !(l.number == 1 && is_heading(l, &columns.split(&l.text).collect::<Vec<_>>()))
    };
    let first = columns.split(&Lines::new(bytes, false).find(is_point)?.text).count();
    let found = columns.split(last).count();
    (is_row(last) && found >= 3 && found < first).then_some((first, found))
}

/// Calls `take` with every point of a piece of the file; returns the number of lines.
pub(super) fn each(
    bytes: &[u8],
    is_first: bool,
    columns: &Columns,
    problems: &mut Problems,
    mut take: impl FnMut(Point),
) -> usize {
    let mut lines = Lines::new(bytes, false);
    let mut words = Vec::new();
    for line in lines.by_ref() {
        if is_empty_line(&line.text) || is_comment(line.text.trim_ascii_start()) {
            continue;
        }
        words.clear();
        words.extend(columns.split(&line.text));
        if is_first && line.number == 1 && is_heading(&line, &words) {
            continue;
        }
        if let Some(point) = point(&line, &words, columns, problems) {
            take(point);
        }
    }
    lines.passed
}

fn point(line: &Line, words: &[Range<usize>], columns: &Columns, problems: &mut Problems) -> Option<Point> {
    let mut position = [0.0; 3];
    for (axis, value) in position.iter_mut().enumerate() {
        let at = words.get(axis).cloned().unwrap_or(line.text.len()..line.text.len());
        let number = float(line.text[at.clone()].trim_ascii()).filter(|v| v.abs() <= FARTHEST);
        let Some(number) = number else {
            problems.error(line.number, line.start + at.start..line.start + at.end, || {
                let (found, axis) = (shown(&line.text[at]), ["x", "y", "z"][axis]);
                format!("expected the {axis} of a point within ±{FARTHEST:e} m, found \"{found}\"")
            });
            return None;
        };
        *value = number;
    }
    let component =
        |column: usize| words.get(column).and_then(|at| float(line.text[at.clone()].trim_ascii()));
    let normal = columns.normal.filter(|c| c.iter().all(|&i| i < words.len())).map(|[x, y, z]| {
        let value = |column| component(column).unwrap_or(f64::NAN);
        DVec3::new(value(x), value(y), value(z))
    });
    Some(Point { position: DVec3::from(position), normal, class: 0 })
}
