//! Columns of poses: which column of a row holds which component, and its unit.

use vlscan_base::columns::{Dimension, Heading, HeadingError, Separator, parse_heading};
use vlscan_base::input::arrow::TableField;
use vlscan_base::input::rows::{Row, RowDecoder, RowError};
use vlscan_geom::radians;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum PoseColumn {
    Time,
    Roll,
    Pitch,
    Yaw,
    X,
    Y,
    Z,
    Longitude,
    Latitude,
}

/// The columns of a pose on a grid, in the order of trajectory files without names.
pub(super) const POSE_COLUMNS: [PoseColumn; 7] = [
    PoseColumn::Time,
    PoseColumn::Roll,
    PoseColumn::Pitch,
    PoseColumn::Yaw,
    PoseColumn::X,
    PoseColumn::Y,
    PoseColumn::Z,
];

pub(super) const ANGLES: [PoseColumn; 3] = [PoseColumn::Roll, PoseColumn::Pitch, PoseColumn::Yaw];

impl PoseColumn {
    fn name(self) -> &'static str {
        match self {
            PoseColumn::Time => "time",
            PoseColumn::Roll => "roll",
            PoseColumn::Pitch => "pitch",
            PoseColumn::Yaw => "yaw",
            PoseColumn::X => "x",
            PoseColumn::Y => "y",
            PoseColumn::Z => "z",
            PoseColumn::Longitude => "longitude",
            PoseColumn::Latitude => "latitude",
        }
    }

    fn dimension(self) -> Dimension {
        match self {
            PoseColumn::Time => Dimension::Time,
            PoseColumn::X | PoseColumn::Y | PoseColumn::Z => Dimension::Length,
            _ => Dimension::Angle,
        }
    }

    fn named(name: &str) -> Option<PoseColumn> {
        Some(match name {
            "lat" | "latitude" => PoseColumn::Latitude,
            "lon" | "long" | "lng" | "longitude" => PoseColumn::Longitude,
            "t" | "time" | "gpstime" | "gps_time" | "timestamp" | "sow" => PoseColumn::Time,
            "x" | "easting" | "east" | "e" => PoseColumn::X,
            "y" | "northing" | "north" | "n" => PoseColumn::Y,
            "z" | "h" | "height" | "altitude" | "alt" | "elevation" | "up" => PoseColumn::Z,
            "roll" => PoseColumn::Roll,
            "pitch" => PoseColumn::Pitch,
            "yaw" | "heading" | "hdg" => PoseColumn::Yaw,
            _ => return None,
        })
    }

    /// Parses a heading; `Ok(None)` for other quantities, an error for an unsuitable unit.
    pub fn parse(heading: &str) -> Result<Option<Heading<PoseColumn>>, String> {
        let known = |name: &str| PoseColumn::named(name).map(|column| (column, column.dimension()));
        match parse_heading(heading, known) {
            Ok(heading) => Ok(Some(heading)),
            Err(HeadingError::UnknownName(_)) => Ok(None),
            Err(HeadingError::WrongUnit(found, expected)) => Err(format!("{found}, {expected}")),
        }
    }
}

/// The columns of a table of poses, each array in the order of [`POSE_COLUMNS`].
#[derive(Clone, Debug, PartialEq)]
pub(super) struct PoseLayout {
    pub columns: [Option<usize>; 7],
    /// Factors to seconds, metres and radians where the headings state units.
    pub factors: [Option<f64>; 7],
    /// X is the longitude, Y the latitude.
    pub geographic: bool,
}

/// Columns as their headings are read one by one, in the order of [`PoseColumn`].
#[derive(Default)]
struct Headings([Option<(usize, Option<f64>)>; 9]);

impl Headings {
    fn add(&mut self, column: usize, heading: Heading<PoseColumn>) -> Result<(), String> {
        match self.0[heading.column as usize].replace((column, heading.factor)) {
            Some(_) => Err(format!("a second column for {}", heading.column.name())),
            None => Ok(()),
        }
    }

    /// Returns the layout. Projected coordinates take precedence over latitude and longitude.
    fn finish(self) -> PoseLayout {
        let [time, roll, pitch, yaw, x, y, z, longitude, latitude] = self.0;
        let geographic = longitude.is_some() && latitude.is_some() && (x.is_none() || y.is_none());
        let (x, y) = if geographic { (longitude, latitude) } else { (x, y) };
        let found = [time, roll, pitch, yaw, x, y, z];
        PoseLayout {
            columns: found.map(|f| f.map(|(column, _)| column)),
            factors: found.map(|f| f.and_then(|(_, factor)| factor)),
            geographic,
        }
    }
}

impl PoseLayout {
    /// Columns by number, in the order of [`POSE_COLUMNS`].
    pub fn numbered(columns: [usize; 7]) -> PoseLayout {
        PoseLayout { columns: columns.map(Some), factors: [None; 7], geographic: false }
    }

    /// Columns in the order of `order`. If `time` is given, it is the index of the time column, and the others skip it.
    pub fn in_order(order: &[PoseColumn], time: Option<usize>) -> PoseLayout {
        let mut layout = PoseLayout { columns: [None; 7], factors: [None; 7], geographic: false };
        let places = (0..).filter(|place| Some(*place) != time);
        let others = order.iter().filter(|c| time.is_none() || **c != PoseColumn::Time);
        for (column, place) in others.zip(places) {
            layout.columns[*column as usize] = Some(place);
        }
        layout.set_time(time);
        layout
    }

    pub fn set_time(&mut self, time: Option<usize>) {
        if time.is_some() {
            self.columns[PoseColumn::Time as usize] = time;
        }
    }

    /// The layout that headings describe; unknown names are ignored.
    pub fn from_headings(names: impl IntoIterator<Item = impl AsRef<str>>) -> Result<PoseLayout, String> {
        let mut columns: Vec<String> = Vec::new();
        for name in names {
            let name = name.as_ref();
            match columns.last_mut() {
                // `roll (deg)` in a line separated by blanks is one heading.
                Some(last) if name.starts_with(['(', '[']) && name.ends_with([')', ']']) => {
                    last.push_str(name)
                }
                _ => columns.push(name.to_owned()),
            }
        }
        let mut headings = Headings::default();
        for (column, name) in columns.iter().enumerate() {
            PoseColumn::parse(name)?.map_or(Ok(()), |heading| headings.add(column, heading))?;
        }
        Ok(headings.finish())
    }

    /// The layout of an Arrow stream; other columns than those of poses need not be numbers.
    fn from_fields(fields: &[TableField]) -> Result<PoseLayout, String> {
        let mut headings = Headings::default();
        for (column, field) in fields.iter().enumerate() {
            match PoseColumn::parse(&field.heading)? {
                Some(_) if !field.is_number() => {
                    return Err(format!(
                        "column `{}` holds {}, expected numbers",
                        field.heading, field.holds
                    ));
                }
                Some(heading) => headings.add(column, heading)?,
                None => {}
            }
        }
        Ok(headings.finish())
    }

    /// The layout that a user chooses: headings in their order, where unknown names skip a column, or `heading=number`
    /// with numbers from 1.
    pub fn chosen(columns: &[String]) -> Result<PoseLayout, String> {
        let mut headings = Headings::default();
        let numbered = columns.iter().any(|column| column.contains('='));
        for (i, column) in columns.iter().enumerate() {
            let (name, number) = match column.rsplit_once('=') {
                Some((name, number)) => (name, number.trim().parse().unwrap_or(0)),
                None if numbered => return Err(format!("`{column}` has no number as the others have")),
                None => (column.as_str(), i + 1),
            };
            if !(1..=MAX_COLUMNS).contains(&number) {
                let expected =
                    format!("expected a name and a number from 1 to {MAX_COLUMNS}, such as time=1");
                return Err(format!("`{column}`: {expected}"));
            }
            match PoseColumn::parse(name)? {
                Some(heading) => headings.add(number - 1, heading)?,
                None if numbered => {
                    return Err(format!("`{name}` is none of time, x, y, z, roll, pitch, yaw, lat, lon"));
                }
                None => {}
            }
        }
        let layout = headings.finish();
        match layout.shared_column() {
            Some((one, other, column)) => Err(format!("{one} and {other} are both column {}", column + 1)),
            None => Ok(layout),
        }
    }

    /// Two quantities that are read from one column, if there are any, and that column.
    fn shared_column(&self) -> Option<(&'static str, &'static str, usize)> {
        let column = |c: PoseColumn| self.columns[c as usize];
        POSE_COLUMNS.iter().enumerate().find_map(|(i, &later)| {
            let earlier =
                POSE_COLUMNS[..i].iter().find(|&&c| column(c).is_some() && column(c) == column(later))?;
            Some((self.name_of(*earlier), self.name_of(later), column(later)?))
        })
    }

    /// The first quantity that `named` has in another column: its name, its column here and there.
    pub fn difference(&self, named: &PoseLayout) -> Option<(&'static str, usize, usize)> {
        let pairs = POSE_COLUMNS.iter().filter_map(|&c| {
            let (here, there) = (self.columns[c as usize]?, named.columns[c as usize]?);
            (here != there).then(|| (named.name_of(c), here, there))
        });
        pairs.into_iter().next()
    }

    fn name_of(&self, column: PoseColumn) -> &'static str {
        match column {
            PoseColumn::X if self.geographic => PoseColumn::Longitude.name(),
            PoseColumn::Y if self.geographic => PoseColumn::Latitude.name(),
            column => column.name(),
        }
    }

    pub fn complete(self, wanted: &[PoseColumn]) -> Result<PoseLayout, String> {
        let is_missing = |c: &&PoseColumn| self.columns[**c as usize].is_none();
        let missing: Vec<&str> = wanted.iter().filter(is_missing).map(|c| c.name()).collect();
        if missing.is_empty() { Ok(self) } else { Err(format!("no column for {}", missing.join(", "))) }
    }

    /// The numbers of a row, not converted, in the order of [`POSE_COLUMNS`]. Components without a column are 0.
    pub fn read(&self, row: &Row) -> Result<[f64; 7], RowError> {
        let mut values = [0.0; 7];
        for column in POSE_COLUMNS {
            let Some(index) = self.columns[column as usize] else { continue };
            let name = self.name_of(column);
            let number = row.number(index, name)?;
            if !number.is_finite() {
                return Err(row.expected_number(index, name));
            }
            values[column as usize] = number;
        }
        Ok(values)
    }

    /// Converts `values` to seconds, metres and radians. Angles without a unit are degrees if `degrees` is set.
    pub fn in_si(&self, mut values: [f64; 7], degrees: bool) -> [f64; 7] {
        for column in POSE_COLUMNS {
            let is_angle = column.dimension() == Dimension::Angle
                || self.geographic && matches!(column, PoseColumn::X | PoseColumn::Y);
            let value = &mut values[column as usize];
            match self.factors[column as usize] {
                Some(factor) => *value *= factor,
                None if degrees && is_angle => *value = radians(*value),
                None => {}
            }
        }
        values
    }
}

/// Maximum number of columns.
const MAX_COLUMNS: usize = 1000;

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
    fn parse(&mut self, comment: &str) -> Result<bool, String> {
        if let Some(names) = comment.strip_prefix("#HEADER:") {
            let names = Separator::guess(names).split(names).map(|at| &names[at]);
            self.layout = Some(PoseLayout::from_headings(names)?);
        } else if let Some(column) = comment.strip_prefix("#TIME_COLUMN:") {
            let column = column.trim();
            let number = column.parse().ok().filter(|number| *number < MAX_COLUMNS);
            self.time_column = Some(number.ok_or_else(|| {
                format!("expected the number of a column below {MAX_COLUMNS}, found `{column}`")
            })?);
        } else {
            return Ok(false);
        }
        Ok(true)
    }
}

/// What a table of poses itself says of its columns.
#[derive(Debug)]
pub(super) struct StatedColumns {
    pub directives: Directives,
    pub has_directives: bool,
    /// The texts of the first row; none in Arrow streams.
    pub first: Vec<String>,
    /// Whether the first row of text consists of headings: no column is a number, and at least one names a component of a
    /// pose. Or whether there are the columns of an Arrow stream.
    pub has_header: bool,
    header: Result<PoseLayout, String>,
}

impl StatedColumns {
    /// What the comments and the first row, or the columns of an Arrow stream, say.
    ///
    /// # Errors
    /// A directive that cannot be parsed.
    pub fn of(rows: &RowDecoder, first: Option<&Row>) -> Result<StatedColumns, RowError> {
        let (mut directives, mut has_directives) = (Directives::default(), false);
        for (place, comment) in rows.comments() {
            let parsed = directives.parse(comment);
            has_directives |= parsed.map_err(|message| RowError { place: place.clone(), message })?;
        }
        let first: Vec<String> = first.into_iter().flat_map(Row::texts).collect();
        let (has_header, header) = match rows.fields() {
            Some(fields) => (true, PoseLayout::from_fields(fields)),
            None => (is_header(&first), PoseLayout::from_headings(&first)),
        };
        Ok(StatedColumns { directives, has_directives, first, has_header, header })
    }

    /// Whether the first row is text and names the columns.
    pub fn has_header_row(&self) -> bool {
        self.has_header && !self.first.is_empty()
    }

    /// The layout of the header.
    pub fn header(&self) -> Result<PoseLayout, String> {
        self.header.clone()
    }
}

/// Whether the columns of a line are headings.
fn is_header(names: &[String]) -> bool {
    names.iter().all(|name| name.parse::<f64>().map_or(true, |v| !v.is_finite()))
        && names.iter().any(|name| PoseColumn::parse(name) != Ok(None))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(line: &str) -> Vec<String> {
        Separator::guess(line).split(line).map(|at| line[at].to_owned()).collect()
    }

    fn layout(line: &str) -> Result<PoseLayout, String> {
        PoseLayout::from_headings(names(line))
    }

    /// The message about a row, if there is one, and the text that it marks.
    fn refused(layout: &PoseLayout, line: &str) -> (String, String) {
        let mut rows = RowDecoder::new(std::path::Path::new("a.txt"), "a pose", None);
        rows.feed(line.as_bytes());
        let block = rows.next_block(1, true).unwrap().unwrap();
        let e = layout.read(&block.row(0, &mut Vec::new())).unwrap_err();
        (e.place.excerpt[e.place.marked.clone()].to_owned(), e.message)
    }

    #[test]
    fn headings_are_found_in_any_order() {
        let l = layout("x,y,z,gps_time,quality,Roll[deg],pitch,heading").unwrap();
        assert_eq!(l.columns, [Some(3), Some(5), Some(6), Some(7), Some(0), Some(1), Some(2)]);
        assert!(l.factors[1].is_some() && l.factors[2].is_none());
        assert!(l.complete(&POSE_COLUMNS).is_ok());
    }

    #[test]
    fn units_separated_from_their_names_are_no_columns() {
        let l = layout("time x y z roll (deg) pitch (deg) yaw (deg)").unwrap();
        assert_eq!(l.columns, [Some(0), Some(4), Some(5), Some(6), Some(1), Some(2), Some(3)]);
        assert!(l.factors[3].is_some());
    }

    #[test]
    fn geographic_columns_count_where_there_are_no_projected_ones() {
        let l = layout("t,lat[rad],longitude,h").unwrap();
        assert!(l.geographic && l.columns[4] == Some(2) && l.columns[5] == Some(1));
        assert_eq!(
            l.in_si([1.0, 2.0, 0.0, 0.0, 180.0, 0.5, 9.0], true)[4..],
            [std::f64::consts::PI, 0.5, 9.0]
        );
        let l = layout("t,lat,lon,x,northing,z").unwrap();
        assert!(!l.geographic && l.columns[4] == Some(3) && l.columns[5] == Some(4));
        assert!(layout("lat[m]").unwrap_err().contains("expected rad, mrad or deg"));
    }

    #[test]
    fn two_quantities_in_one_column_are_refused() {
        let chosen =
            |list: &[&str]| PoseLayout::chosen(&list.iter().map(|c| (*c).to_owned()).collect::<Vec<_>>());
        let e = chosen(&["time=1", "x=1", "y=2", "z=3", "roll=4", "pitch=5", "yaw=6"]).unwrap_err();
        assert_eq!(e, "time and x are both column 1");
        assert!(chosen(&["time", "x", "y", "z", "roll", "pitch", "yaw"]).is_ok());
        let named = layout("time,x,y,z,roll,pitch,yaw").unwrap();
        let numbered = PoseLayout::numbered([0, 1, 2, 3, 4, 5, 6]);
        assert_eq!(numbered.difference(&named), Some(("roll", 1, 4)));
        assert_eq!(named.difference(&named), None);
    }

    #[test]
    fn errors_in_rows_are_located() {
        let l = PoseLayout::in_order(&POSE_COLUMNS, None);
        let (marked, message) = refused(&l, "1,2,3,abc,5,6,7");
        assert_eq!((&*marked, &*message), ("abc", "expected a number for yaw, found `abc`"));
        assert!(refused(&l, "1,2,3").1.contains("column 4 for yaw is missing: 3 columns"));
        assert!(refused(&l, "1,2,3,nan,5,6,7").1.contains("found `nan`"));
        assert!(refused(&l, "1;2;3,5;4;5;6;7").1.contains("decimal comma"));
        assert!(layout("time,x,x").unwrap_err().contains("second column for x"));
    }

    #[test]
    fn headers_are_lines_of_headings() {
        let lines = ["time,x,y", "1,x,y", "foo,bar", ""];
        assert_eq!(lines.map(|line| is_header(&names(line))), [true, false, false, false]);
    }
}
