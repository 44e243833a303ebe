//! LAS and LAZ files (ASPRS LAS 1.0 to 1.5, point formats 0 to 10). Bounds in headers are ignored, since they
//! are often wrong.
//!
//! | file | what it does |
//! |---|---|
//! | `error` | errors |
//! | `header` | header and variable length records |
//! | `extra` | extra dimensions |
//! | `details` | fields that only copies need |
//! | `compressed` | compressed records |
//! | `chunks` | chunks of compressed records, each decompressed by itself |
//! | `excerpt` | the layers of a chunk that are decompressed |
//! | `rows` | records as points |
//! | `blocks` | blocks of records decoded on several threads |
//! | `units` | units of positions |

mod blocks;
mod chunks;
mod compressed;
mod details;
mod error;
mod excerpt;
mod extra;
mod header;
mod rows;
#[cfg(test)]
mod tests;
mod units;

pub use compressed::Selection;
pub use error::{LasError, PointsError};
pub use extra::ExtraDimension;
pub use header::{Header, LasFacts};

use crate::{CloudFormat, FileFacts, Reading};
use blocks::Passed;
use compressed::{Compressed, without_panic};
use details::DetailFields;
use header::Fields;
use rows::RowFormat;
use std::collections::BTreeMap;
use std::io::ErrorKind;
use std::ops::ControlFlow;
use units::Unprojected;
use vlscan_geom::DVec3;

/// Maximum number of records that one call of [`LasReader::read_records`] passes.
const BATCH_RECORDS: u64 = 1 << 16;

/// Reads the points of a file from first to last.
pub struct LasReader<'a> {
    file: Fields<'a>,
    records: Records<'a>,
    /// The header: format, number of records, scales and offsets.
    pub header: Header,
    record: Vec<u8>,
    at: u64,
}

enum Records<'a> {
    Plain(&'a [u8]),
    Compressed(Box<Compressed<'a>>),
}

impl<'a> LasReader<'a> {
    /// Reads the header of a file.
    pub fn open(bytes: &'a [u8], selection: Selection) -> Result<LasReader<'a>, LasError> {
        let file = Fields(bytes);
        let mut header = Header::read(file)?;
        let compressed = match header.is_compressed {
            false => None,
            true => without_panic(|| Compressed::open(file, &header, selection))?,
        };
        header.is_compressed = compressed.is_some();
        let records = match compressed {
            None => Records::Plain(&bytes[header.data_at..]),
            Some(compressed) => Records::Compressed(Box::new(compressed)),
        };
        let record = vec![0; usize::from(header.record_length)];
        Ok(LasReader { file, records, header, record, at: 0 })
    }

    /// The data of a variable length record.
    pub fn variable_record(&self, user: &str, id: u16) -> Result<Option<&'a [u8]>, LasError> {
        self.header.variable_record(self.file, user, id)
    }

    /// The extra dimensions of the points with their names.
    pub fn extra_dimensions(&self) -> Result<Vec<(String, ExtraDimension)>, LasError> {
        let descriptors = self.variable_record("LASF_Spec", 4)?.unwrap_or_default();
        Ok(extra::dimensions(descriptors, self.header.extra_bytes_at()))
    }

    /// Calls `take` with the bytes and the position of each record of the next batch; returns `false` after
    /// the last one, and when `take` breaks.
    pub fn read_records(
        &mut self,
        mut take: impl FnMut(&[u8], DVec3) -> ControlFlow<()>,
    ) -> Result<bool, LasError> {
        let end = self.header.count.min(self.at + BATCH_RECORDS);
        let broken = without_panic(|| {
            while self.at < end {
                self.read_record()?;
                if take(&self.record, self.header.position(&self.record)).is_break() {
                    return Ok(true);
                }
                self.at += 1;
            }
            Ok(false)
        })?;
        Ok(!broken && self.at < self.header.count)
    }

    /// Reads the points in blocks, as far as they can be. No record may have been read.
    fn read_blocks(&self, rows: &RowFormat, reading: &mut Reading) -> Passed {
        match &self.records {
            Records::Plain(_) if reading.threads <= 1 => Passed::default(),
            Records::Plain(records) => blocks::read_plain(records, &self.header, rows, reading),
            Records::Compressed(laz) => blocks::read_compressed(laz, &self.header, rows, reading),
        }
    }

    fn read_record(&mut self) -> Result<(), LasError> {
        let (at, count) = (self.at, self.header.count);
        let ended = |source| LasError::Points { at, count, source };
        match &mut self.records {
            Records::Plain(rest) => {
                let Some((record, more)) = rest.split_at_checked(self.record.len()) else {
                    return Err(ended(PointsError::Ends));
                };
                self.record.copy_from_slice(record);
                *rest = more;
            }
            Records::Compressed(laz) => {
                laz.check_chunk(at, self.record.len()).map_err(ended)?;
                let read = laz.decompressor.decompress_one(&mut self.record);
                read.map_err(|e| match e.kind() {
                    ErrorKind::UnexpectedEof => ended(PointsError::Ends),
                    _ => ended(PointsError::Decompression(e)),
                })?;
            }
        }
        Ok(())
    }

    /// Compares the number of points with the size of the file. A header without a number, as a writer leaves
    /// it that was interrupted, is completed.
    fn check_count(&mut self, reading: &mut Reading) {
        if self.header.is_compressed {
            return;
        }
        let (count, room) = (self.header.count, self.header.room(self.file));
        if count == 0 && room > 0 {
            reading.warn(format!("its header states 0 points, {room} records follow; all are read"));
            self.header.count = room;
        } else if room > count {
            reading.warn(format!(
                "its header states {count} points, there is room for {room}; {count} are read"
            ));
        }
    }
}

/// Reads a file.
pub(crate) fn read(bytes: &[u8], reading: &mut Reading) -> Result<(), LasError> {
    let mut reader = LasReader::open(bytes, reading.selection)?;
    let extra = reader.extra_dimensions()?;
    let (mut rows, warnings) = RowFormat::new(&reader.header, &extra, reading.selection);
    warnings.iter().for_each(|warning| reading.warn(warning.as_str()));
    let units = units::position_units(reader.file, &reader.header)?;
    units.note.iter().for_each(|note| reading.note(note.as_str()));
    units.warnings.iter().for_each(|warning| reading.warn(warning.as_str()));
    reader.check_count(reading);
    let is_copc = reader.variable_record("copc", 1)?.is_some();
    let metres = units.metres.unwrap_or(DVec3::ONE);
    let las = Some(reader.header.facts(is_copc, metres));
    reading.sink.file(&FileFacts { format: CloudFormat::Las, las });
    reading.sink.start(rows.attributes());
    // Positions that are converted to metres are not in the file's system any more.
    if let Some(wkt) = units.crs.as_ref().filter(|_| units.metres.is_none()) {
        reading.sink.crs(wkt);
    }
    if reading.sink.takes_details() {
        rows.read_details(&extra);
        reading.sink.unread(DetailFields::unread(&reader.header, &extra));
    }
    let names = extra.iter().map(|(name, dimension)| if dimension.is_number() { name.as_str() } else { "" });
    let chosen = reading.choose(&names.collect::<Vec<&str>>());
    rows.chosen = chosen.into_iter().map(|at| extra[at].1).collect();
    if reading.sink.takes_columns() {
        reading.pass_object_names(object_names(&reader)?);
    }
    rows.metres = metres;
    // The first position decides whether such coordinates can be read, before any point is passed on.
    let passed = match units.unprojected {
        Some(_) => Passed::default(),
        None => reader.read_blocks(&rows, reading),
    };
    if passed.is_ended || passed.points == reader.header.count {
        return Ok(());
    }
    read_in_order(&mut reader, &rows, (passed.points, units.unprojected), reading)
}

/// The names of objects by their numbers, as files of this program have them: lines of number, tab, name.
fn object_names(reader: &LasReader) -> Result<BTreeMap<i32, String>, LasError> {
    let lists = reader.header.variable_records(reader.file, "vlscan", 1)?;
    let name = |line: &str| {
        let (number, name) = line.split_once('\t')?;
        Some((number.parse::<i32>().ok()?, name.to_owned()))
    };
    let names = |list: &[u8]| -> Vec<(i32, String)> {
        String::from_utf8_lossy(list).lines().filter_map(name).collect()
    };
    Ok(lists.into_iter().flat_map(names).collect())
}

/// Reads all records in order, and passes on the points after the first `passed` ones. `unprojected` is the
/// form of coordinates that the coordinate reference system states, if it cannot be read.
fn read_in_order(
    reader: &mut LasReader,
    rows: &RowFormat,
    (mut passed, mut unprojected): (u64, Option<Unprojected>),
    reading: &mut Reading,
) -> Result<(), LasError> {
    let (mut more, mut values) = (true, Vec::new());
    while more {
        let mut refused = None;
        more = reader.read_records(|record, position| {
            if passed > 0 {
                passed -= 1;
                return ControlFlow::Continue(());
            }
            if let Some(stated) = unprojected.take() {
                if stated.fits(position) {
                    refused = Some(stated);
                    return ControlFlow::Break(());
                }
                reading.warn(format!(
                    "its coordinate reference system is {}, its coordinates are not; they are taken as \
                     metres",
                    stated.name()
                ));
            }
            if let Some(details) = rows.details(record) {
                reading.sink.details(&details);
            }
            values.clear();
            rows.push_values(record, &mut values);
            reading.pass_values(&values);
            reading.take(&rows.row(record))
        })?;
        if let Some(stated) = refused {
            return Err(stated.error());
        }
    }
    Ok(())
}
