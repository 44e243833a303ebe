//! The columns of one stream and their positions. Headers of text and schemas of Arrow streams are checked
//! alike.

use super::columns::{COLUMNS, PulseColumn, parse_pulse_heading};
use super::row::{ANGLES, ATTITUDE, ColumnSet, DIRECTION, EXACT, LOW, ORIGIN, PulseRow, RowFault, Values};
use std::path::Path;
use vlscan_base::columns::is_number;
use vlscan_base::diag::{Diagnostics, Place};
use vlscan_base::error::Result;
use vlscan_geom::DVec3;
use vlscan_tables::input::arrow::TableField;
use vlscan_tables::input::rows::{Row, RowError};

#[derive(Debug)]
pub(super) struct StreamSchema {
    /// Column, factor to ns, m or rad, and position in a row.
    columns: Vec<(PulseColumn, f64, usize)>,
    present: ColumnSet,
    /// Number of columns of every line.
    width: Option<usize>,
    /// Number of rows that are headers.
    pub header_rows: u64,
}

impl StreamSchema {
    fn new(width: Option<usize>) -> StreamSchema {
        StreamSchema { columns: Vec::new(), present: ColumnSet::default(), width, header_rows: 0 }
    }

    /// The schema of text with this first row, which may be a header. Without a header seven numbers are
    /// time, origin and direction, and six are origin and direction.
    ///
    /// # Errors
    /// As [`StreamSchema::of_fields`], and for another number of columns without a header.
    pub fn of_text(first: &Row) -> Result<StreamSchema> {
        let names: Vec<String> = first.texts().collect();
        if !names.iter().any(|name| is_number(name)) {
            let place = |column| first.error(column, "").place;
            let headings = names.iter().enumerate().map(|(i, name)| (&**name, place(Some(i)), None));
            let schema = StreamSchema::new(Some(names.len())).with_headings(headings, place(None))?;
            return Ok(StreamSchema { header_rows: 1, ..schema });
        }
        if !matches!(names.len(), 6 | 7) {
            let message = format!("{} numbers and no header that names them", names.len());
            let help = "without a header the columns are time, x, y, z, dx, dy, dz";
            return Err(first.error(None, message).with_help(help));
        }
        let seconds = std::iter::once((PulseColumn::Time, 1e9)).filter(|_| names.len() == 7);
        let metres = ORIGIN.iter().chain(&DIRECTION).map(|c| (*c, 1.0));
        let mut schema = StreamSchema::new(Some(names.len()));
        for (position, (column, factor)) in seconds.chain(metres).enumerate() {
            schema.push(column, factor, position);
        }
        Ok(schema)
    }

    /// The schema of an Arrow stream; `path` is its name in messages.
    ///
    /// # Errors
    /// [`Error::Input`](vlscan_base::error::Error::Input) with every heading that is unknown, repeated or
    /// without numbers, and with the missing columns that a pulse requires.
    pub fn of_fields(path: &Path, fields: &[TableField]) -> Result<StreamSchema> {
        let place = Place::of_file(path);
        let headings = fields
            .iter()
            .map(|field| (&*field.heading, place.clone(), Some(field.holds).filter(|_| !field.is_number())));
        StreamSchema::new(None).with_headings(headings, place.clone())
    }

    /// Resolves headings to columns. Each heading has its place and, where its values are not numbers, a
    /// description of them; `whole` is the place of the header.
    fn with_headings<'h>(
        mut self,
        headings: impl Iterator<Item = (&'h str, Place, Option<&'h str>)>,
        whole: Place,
    ) -> Result<StreamSchema> {
        let mut problems = Diagnostics::default();
        for (position, (heading, place, no_numbers)) in headings.enumerate() {
            match (parse_pulse_heading(heading), no_numbers) {
                (Ok((column, _)), _) if self.present.has(column) => {
                    let message = format!("a second column for {}", column.entry().name());
                    let problem = problems.error(Some(place), message);
                    if heading.trim().eq_ignore_ascii_case("elevation") {
                        problem.help("elevation is a height; the angle is elevation_deg or elevation[rad]");
                    }
                }
                (Ok(_), Some(holds)) => {
                    problems
                        .error(Some(place), format!("column `{heading}` holds {holds}, expected numbers"));
                }
                (Ok((column, factor)), None) => self.push(column, factor, position),
                (Err((message, help)), _) => {
                    problems.error(Some(place), message).help(help);
                }
            }
        }
        if problems.is_empty() {
            check_complete(self.present, whole, &mut problems);
        }
        problems.finish(false)?;
        Ok(self)
    }

    fn push(&mut self, column: PulseColumn, factor: f64, position: usize) {
        self.columns.push((column, factor, position));
        self.present = self.present.with(column);
    }

    /// Position of a column in a row.
    pub fn position(&self, column: PulseColumn) -> Option<usize> {
        self.columns.iter().find(|c| c.0 == column).map(|c| c.2)
    }

    /// The pulse of a row, if `check` accepts it, in the frame whose origin is at `shift` in the world.
    /// `order` is the index of the row in the stream, from 0.
    pub fn pulse(
        &self,
        row: &Row,
        shift: DVec3,
        order: u64,
        check: &impl Fn(&PulseRow) -> Result<(), RowFault>,
    ) -> Result<PulseRow, RowError> {
        if let Some(width) = self.width {
            row.check_width(width, if self.header_rows > 0 { "the heading" } else { "the first line" })?;
        }
        let mut values: Values = [0.0; COLUMNS];
        for (column, factor, position) in &self.columns {
            values[*column as usize] = row.number(*position, column.entry().name())? * factor;
        }
        let pulse = PulseRow::of(&values, self.present, shift, order);
        let pulse = pulse.and_then(|pulse| check(&pulse).map(|()| pulse));
        pulse.map_err(|(column, message)| row.error(self.position(column), message))
    }
}

/// Reports missing columns that a pulse requires, and incomplete groups of columns.
fn check_complete(present: ColumnSet, place: Place, problems: &mut Diagnostics) {
    let mut missing: Vec<&str> = Vec::new();
    let mut need = |columns: &[PulseColumn]| {
        missing.extend(columns.iter().filter(|c| !present.has(**c)).map(|c| c.entry().name()));
    };
    need(&ORIGIN);
    for group in [&ATTITUDE[..], &ANGLES[..], &EXACT[..], &LOW[..]] {
        if present.has_any(group) {
            need(group);
        }
    }
    let has_other = present.has_any(&ATTITUDE) || present.has_any(&ANGLES);
    if !has_other || present.has_any(&DIRECTION) {
        need(&DIRECTION);
    }
    if present.has_any(&ANGLES) && (present.has_any(&ATTITUDE) || present.has_any(&DIRECTION)) {
        problems
            .error(Some(place.clone()), "angles of the beam beside its direction or quaternion")
            .help("leave out the columns azimuth and elevation, or dx, dy, dz and qw, qx, qy, qz");
    }
    if !missing.is_empty() {
        problems
            .error(Some(place), format!("no column for {}", missing.join(", ")))
            .help("a pulse needs x, y, z and dx, dy, dz (or qw, qx, qy, qz, or azimuth_deg, elevation_deg)");
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use vlscan_tables::input::rows::RowDecoder;

    #[test]
    fn spreadsheets_quote_fields_and_write_decimal_commas() {
        for (text, header_rows) in [
            ("\"x\",\"y\",\"z\",\"dx\",\"dy\",\"dz\"\n\"1.5\",\"0\",\"0\",\"0\",\"0\",\"-1\"\n", 1),
            ("x;y;z;dx;dy;dz\n1,5;0;0;0;0;-1\n", 1),
            ("1,5;0,0;0,0;0,0;0,0;-1,0\n", 0),
        ] {
            let mut rows = RowDecoder::new(Path::new("a.csv"), "a pulse", None);
            rows.feed(text.as_bytes());
            let (block, mut fields) = (rows.next_block(2, true).unwrap().unwrap(), Vec::new());
            let schema = StreamSchema::of_text(&block.row(0, &mut fields)).unwrap();
            assert_eq!(schema.header_rows, header_rows, "{text}");
            let row = block.row(header_rows as usize, &mut fields);
            let pulse = schema.pulse(&row, DVec3::ZERO, 0, &|_| Ok(())).unwrap().pulse;
            assert_eq!(pulse.origin, DVec3::new(1.5, 0.0, 0.0), "{text}");
        }
    }
}
