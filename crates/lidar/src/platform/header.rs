//! Names of columns in a file of poses: a heading among the lines before the first pose, the columns of an
//! Arrow stream, and the directives of HELIOS++.

use super::layout::{PoseLayout, SCHEMA};
use super::layout_error::{MAX_COLUMNS, PoseLayoutError};
use vlscan_base::columns::{Separator, has_decimal_comma};
use vlscan_base::diag::Place;
use vlscan_tables::input::rows::{LeadingLine, Row, RowDecoder, RowError};
use vlscan_tables::{Dimension, Headings, Quantity, join_units, split_unit};

/// Maximum number of lines before the first pose among which a heading is looked for.
const MAX_LOOKED_AT: usize = 100;
/// Minimum number of known names in a heading whose columns are not as many as those of the first pose.
const MIN_KNOWN: usize = 3;

/// Directives about columns in the comments of a HELIOS++ trajectory file.
#[derive(Debug, Default)]
pub(super) struct Directives {
    /// `#HEADER:`
    pub layout: Option<PoseLayout>,
    /// `#TIME_COLUMN:`
    pub time_column: Option<usize>,
}

impl Directives {
    /// Parses a comment line; returns whether it was a directive.
    fn parse(&mut self, comment: &str) -> Result<bool, PoseLayoutError> {
        if let Some(names) = comment.strip_prefix("#HEADER:") {
            let names = Separator::guess(names).split(names).map(|at| &names[at]);
            self.layout = Some(PoseLayout::from_headings(names)?);
        } else if let Some(column) = comment.strip_prefix("#TIME_COLUMN:") {
            let column = column.trim();
            let number = column.parse().ok().filter(|number| *number < MAX_COLUMNS);
            let found = || PoseLayoutError::TimeColumn { found: column.to_owned() };
            self.time_column = Some(number.ok_or_else(found)?);
        } else {
            return Ok(false);
        }
        Ok(true)
    }
}

/// Columns of a table of poses as its heading and comments state them.
#[derive(Debug)]
pub(super) struct StatedColumns {
    pub directives: Directives,
    pub has_directives: bool,
    /// The texts of the first row; none in Arrow streams.
    pub first: Vec<String>,
    /// The numbers of the first row of text; none if it has other values.
    pub numbers: Vec<f64>,
    /// True if the first row is a heading, in a file without poses.
    pub has_header_row: bool,
    /// The last line before the first pose that is neither a comment nor a heading, if there is no heading.
    pub words: Option<Place>,
    /// The heading or the columns of an Arrow stream, and the place of the heading.
    header: Option<(Result<PoseLayout, PoseLayoutError>, Option<Place>)>,
}

impl StatedColumns {
    /// Reads the columns that the lines before the first row, or the schema of an Arrow stream, state.
    /// `first` is the first row.
    ///
    /// # Errors
    /// A directive that cannot be parsed.
    pub fn of(rows: &RowDecoder, first: Option<&Row>) -> Result<StatedColumns, RowError> {
        let (mut directives, mut has_directives) = (Directives::default(), false);
        for line in rows.leading().iter().filter(|line| line.is_comment) {
            let parsed = directives.parse(&line.text);
            has_directives |=
                parsed.map_err(|e| RowError { place: line.place.clone(), message: e.to_string() })?;
        }
        let texts: Vec<String> = first.into_iter().flat_map(Row::texts).collect();
        let line = first.filter(|_| !texts.is_empty());
        let numbers: Option<Vec<f64>> =
            line.and_then(|row| (0..row.width()).map(|column| row.number(column, "").ok()).collect());
        let separator = first.map_or(Separator::Blanks, Row::separator);
        let has_header_row = is_header(&texts);
        let header = match (rows.fields(), first) {
            (Some(fields), _) => Some((PoseLayout::from_fields(fields), None)),
            (None, Some(row)) if has_header_row => {
                Some((PoseLayout::from_headings(&texts), Some(row.error(None, "").place)))
            }
            _ => match find_heading(rows.leading(), texts.len(), separator) {
                Some((layout, heading)) => {
                    let lines = rows.leading();
                    check_below(&lines[heading + 1..], texts.len(), separator)?;
                    Some((layout, Some(lines[heading].place.clone())))
                }
                None => None,
            },
        };
        let words = rows.leading().iter().rfind(|line| !line.is_comment && header.is_none());
        let words = words.map(|line| line.place.clone());
        let numbers = numbers.unwrap_or_default();
        Ok(StatedColumns { directives, has_directives, first: texts, numbers, has_header_row, words, header })
    }

    /// True if there is a heading, or there are the columns of an Arrow stream.
    pub fn has_header(&self) -> bool {
        self.header.is_some()
    }

    /// The layout of the heading.
    pub fn header(&self) -> Option<Result<PoseLayout, PoseLayoutError>> {
        self.header.as_ref().map(|(layout, _)| layout.clone())
    }

    /// The place of the heading.
    pub fn header_place(&self) -> Option<Place> {
        self.header.as_ref().and_then(|(_, place)| place.clone())
    }
}

/// Checks the lines between the heading and the first pose: words, units, rules.
///
/// # Errors
/// A line with a number, which is a damaged pose.
fn check_below(lines: &[LeadingLine], width: usize, separator: Separator) -> Result<(), RowError> {
    let is_pose = |line: &&LeadingLine| {
        let has_number = || names_of(&line.text, width, separator).iter().any(|name| is_finite_number(name));
        !line.is_comment && !line.text.starts_with(['(', '[']) && has_number()
    };
    match lines.iter().find(is_pose) {
        Some(line) => {
            let message = format!("expected a pose below the heading, found `{}`", line.text);
            Err(RowError { place: line.place.clone(), message })
        }
        None => Ok(()),
    }
}

/// The last heading among the lines before the first pose, which has `width` columns, and its index.
fn find_heading(
    lines: &[LeadingLine],
    width: usize,
    separator: Separator,
) -> Option<(Result<PoseLayout, PoseLayoutError>, usize)> {
    for (i, line) in lines.iter().enumerate().rev().take(MAX_LOOKED_AT) {
        let names = names_of(&line.text, width, separator);
        if names.iter().any(|name| is_finite_number(name)) {
            continue;
        }
        let headings = Headings::of(&names, &SCHEMA);
        let is_complete = headings.has(Quantity::Time)
            && [[Quantity::X, Quantity::Y], [Quantity::Latitude, Quantity::Longitude]]
                .iter()
                .any(|place| place.iter().all(|quantity| headings.has(*quantity)));
        let is_heading = match line.is_comment {
            true => names.len() == width && is_complete,
            false => headings.columns.len() >= if names.len() == width { 1 } else { MIN_KNOWN },
        };
        if is_heading {
            let units = lines.get(i + 1).map_or(Ok(None), |line| units_of(&line.text, names.len()));
            let layout = units.and_then(|units| PoseLayout::from_headings(with_units(names, units)));
            return Some((layout, i));
        }
    }
    None
}

/// The names of a line, split as the first pose is, or in another way that gives as many columns.
fn names_of(text: &str, width: usize, separator: Separator) -> Vec<String> {
    let text = text.trim_start_matches(['#', '%', '/', ';', ' ', '\t']);
    let split = |separator: Separator| join_units(separator.split(text).map(|at| &text[at]));
    let same = split(separator);
    if same.len() == width {
        return same;
    }
    let guessed = split(Separator::guess(text));
    let wide = || join_units(text.split("  ").map(str::trim).filter(|name| !name.is_empty()));
    let others = [guessed.clone(), wide()];
    others.into_iter().find(|names| names.len() == width).unwrap_or(if guessed.len() > 1 {
        guessed
    } else {
        same
    })
}

/// The units below a heading of `count` columns: one in brackets, or one word, for each column.
///
/// # Errors
/// A sentence in brackets about radians or feet.
fn units_of(text: &str, count: usize) -> Result<Option<Vec<String>>, PoseLayoutError> {
    let text = text.trim_start_matches(['#', '%', ' ', '\t']);
    if text.starts_with(['(', '[']) {
        let units: Vec<String> = text
            .split_inclusive([')', ']'])
            .map(|part| split_unit(part).1.unwrap_or_default().to_owned())
            .filter(|unit| !unit.is_empty())
            .collect();
        if units.len() == count {
            return Ok(Some(units));
        }
        let lower = text.to_lowercase();
        if ["radian", "feet", "foot"].iter().any(|unit| lower.contains(unit)) {
            return Err(PoseLayoutError::Units { text: text.to_owned() });
        }
        return Ok(None);
    }
    let words: Vec<String> = Separator::guess(text).split(text).map(|at| text[at].to_lowercase()).collect();
    let dimensions = [Dimension::Time, Dimension::Length, Dimension::Angle, Dimension::Ratio];
    let is_unit = |word: &String| dimensions.iter().any(|dimension| dimension.factor(word).is_some());
    Ok(Some(words).filter(|words| words.len() == count && words.iter().all(is_unit)))
}

fn with_units(names: Vec<String>, units: Option<Vec<String>>) -> Vec<String> {
    let Some(units) = units else { return names };
    let with_unit = |(name, unit): (String, String)| {
        let has_unit = split_unit(&name).1.is_some() || matches!(unit.as_str(), "-" | "1");
        if has_unit { name } else { format!("{name}[{unit}]") }
    };
    names.into_iter().zip(units).map(with_unit).collect()
}

fn is_finite_number(text: &str) -> bool {
    text.parse::<f64>().map_or_else(|_| has_decimal_comma(text), f64::is_finite)
}

/// True if the columns of a line are headings: no column is a number, and at least one names a component of a
/// pose.
fn is_header(names: &[String]) -> bool {
    !names.iter().any(|name| is_finite_number(name)) && {
        let headings = Headings::of(join_units(names), &SCHEMA);
        !headings.columns.is_empty() || !headings.wrong_units.is_empty()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::platform::layout::{AttitudeColumns, POSE_COLUMNS};
    use std::path::Path;

    fn stated(text: &str) -> StatedColumns {
        let mut rows = RowDecoder::new(Path::new("a.txt"), "a pose", None).with_preamble();
        rows.feed(text.as_bytes());
        let block = rows.next_block(1, true).unwrap();
        let mut fields = Vec::new();
        let first = block.as_ref().map(|block| block.row(0, &mut fields));
        StatedColumns::of(&rows, first.as_ref()).unwrap()
    }

    fn layout(text: &str) -> PoseLayout {
        stated(text).header().unwrap().unwrap().complete(&POSE_COLUMNS).unwrap()
    }

    #[test]
    fn headers_are_lines_of_headings() {
        let names =
            |line: &str| Separator::guess(line).split(line).map(|at| line[at].to_owned()).collect::<Vec<_>>();
        let lines = ["time,x,y", "1,x,y", "foo,bar", ""];
        assert_eq!(lines.map(|line| is_header(&names(line))), [true, false, false, false]);
    }

    #[test]
    fn headings_stand_in_comments_and_below_other_lines() {
        let tum =
            "# ground truth trajectory\n# file: 'a.bag'\n# timestamp tx ty tz qx qy qz qw\n1 2 3 4 0 0 0 1\n";
        assert_eq!(layout(tum).attitude, AttitudeColumns::Quaternion([7, 4, 5, 6]));
        let rostopic = "%time,field.header.seq,field.header.frame_id,field.pose.position.x,field.pose.position.y,\
            field.pose.position.z,field.pose.orientation.x,field.pose.orientation.y,field.pose.orientation.z,\
            field.pose.orientation.w\n1403636580838555648,1,map,1,2,3,0,0,0,1\n";
        assert_eq!(layout(rostopic).attitude, AttitudeColumns::Quaternion([9, 6, 7, 8]));
        let explorer = "Project:     test\nProgram:     Inertial Explorer Version 8.60\nDatum: WGS84, (processing)\n\n\
            Week   GPSTime  Latitude  Longitude  H-Ell  Azimuth  Pitch  Roll\n\
            (weeks) (sec) (deg) (deg) (ft) (rad) (deg) (deg)\n\
            2000 345600.0 49.0 8.5 300 0.1 2 3\n";
        let l = layout(explorer);
        assert_eq!((l.columns, l.geographic), ([1, 7, 6, 5, 3, 2, 4].map(Some), true));
        assert_eq!((l.factors[6], l.factors[3]), (Some(0.3048), Some(1.0)));
        let pospac = "Mapping frame datum: WGS84 ; projection : TM;\n\
            TIME, DISTANCE, EASTING, NORTHING, ELLIPSOID HEIGHT, ROLL, PITCH, HEADING, EAST SD\n\n  \
            (time in Sec, distance in Meters, orientation angles and SD in Degrees)  \n\
            345600.0 0.0 4.5 5.5 300.1 1 2 3 0.01\n";
        assert_eq!(layout(pospac).columns, [0, 5, 6, 7, 2, 3, 4].map(Some));
        let radians = pospac.replace("Degrees", "Radians");
        assert!(matches!(stated(&radians).header().unwrap(), Err(PoseLayoutError::Units { .. })));
        let terrapos = "#----\n# Week  ToW (s)  Lat (deg)  Lon (deg)  Hght (m)  Roll(d)  Pitch(d)  Head(d)  #S\n#----\n\
            1972 518430.0 70.08 29.7 56.8 1 2 3 6\n";
        assert_eq!(layout(terrapos).columns, [1, 5, 6, 7, 3, 2, 4].map(Some));
        let below = "time x y z roll pitch yaw\ns ft m m rad deg deg\n1 2 3 4 5 6 7\n";
        assert_eq!(layout(below).factors[4], Some(0.3048));
    }

    #[test]
    fn lines_that_name_nothing_are_remembered() {
        let unknown = stated("a b c d p f g\n1 2 3 4 5 6 7\n");
        assert!(!unknown.has_header() && unknown.words.unwrap().line == 1);
        let sentence = stated("# time of the flight and its height\n1 2 3 4 5 6 7\n");
        assert!(!sentence.has_header() && sentence.words.is_none());
    }
}
