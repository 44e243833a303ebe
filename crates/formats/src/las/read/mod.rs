//! LAS and LAZ files (ASPRS LAS 1.0 to 1.5, point formats 0 to 10). Bounds in headers are not looked at: they
//! are often wrong.
//!
//! | file | what it does |
//! |---|---|
//! | `error` | errors |
//! | `header` | header and variable length records |
//! | `extra` | extra dimensions |
//! | `details` | fields that only copies need |
//! | `compressed` | compressed records |
//! | `units` | units of positions |

mod compressed;
mod details;
mod error;
mod extra;
mod header;
#[cfg(test)]
mod tests;
mod units;

pub use error::{LasError, PointsError};
pub use extra::ExtraDimension;
pub use header::{Header, LasFacts};

use crate::{Attribute, AttributeSet, CloudFormat, Columns, FileFacts, Misfits, PointRow, Reading};
use compressed::{Compressed, without_panic};
use details::DetailFields;
use header::Fields;
use std::io::ErrorKind;
use std::ops::ControlFlow;
use vlscan_geom::DVec3;

/// Maximum number of records that one call of [`LasReader::read_records`] passes.
const BATCH_RECORDS: u64 = 1 << 16;
/// The extra dimension of this program's files with pulses without a return.
const NAME_OF_MISSES: &str = "BeamDirectionX";

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

/// Selection of the fields of compressed records that are decompressed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Selection {
    /// Position and class only.
    PositionAndClass,
    /// All fields.
    All,
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

/// The extra dimensions that are read as attributes of points.
struct Shown {
    /// The unscaled amplitude of this program. Amplitudes of other programs are another quantity than the
    /// intensity.
    intensity: Option<ExtraDimension>,
    object: Option<ExtraDimension>,
    device: Option<ExtraDimension>,
    /// Warnings about scales and offsets that are replaced.
    warnings: Vec<String>,
}

impl Shown {
    fn of(reader: &LasReader, selection: Selection) -> Result<Shown, LasError> {
        if selection != Selection::All {
            return Ok(Shown { intensity: None, object: None, device: None, warnings: Vec::new() });
        }
        let all = reader.extra_dimensions()?;
        let numbers: Vec<&(String, ExtraDimension)> = all.iter().filter(|(_, d)| d.is_number()).collect();
        let columns = Columns::find(numbers.iter().map(|(name, _)| name.as_str()));
        let dimension = |attribute| columns.get(attribute).map(|column| numbers[column]);
        let intensity = numbers.iter().copied().find(|(name, _)| name == "heliosAmplitude");
        let (object, device) = (dimension(Attribute::Object), dimension(Attribute::Channel));
        let rescaled = [intensity, object, device].into_iter().flatten().filter(|(_, d)| d.is_rescaled());
        let warning = |(name, _): &(String, ExtraDimension)| {
            format!(
                "its dimension {name} has a scale of 0, or a scale or an offset that is not finite; 1 and 0 \
                 are used instead"
            )
        };
        Ok(Shown {
            intensity: intensity.map(|(_, d)| *d),
            object: object.map(|(_, d)| *d),
            device: device.map(|(_, d)| *d),
            warnings: rescaled.map(warning).collect(),
        })
    }
}

/// Reads a file.
pub(crate) fn read(bytes: &[u8], reading: &mut Reading) -> Result<(), LasError> {
    let mut reader = LasReader::open(bytes, reading.selection)?;
    let shown = Shown::of(&reader, reading.selection)?;
    shown.warnings.iter().for_each(|warning| reading.warn(warning.as_str()));
    let units = units::position_units(reader.file, &reader.header)?;
    units.note.iter().for_each(|note| reading.note(note.as_str()));
    units.warnings.iter().for_each(|warning| reading.warn(warning.as_str()));
    reader.check_count(reading);
    // A program that edits a file of this program names itself in the header and keeps the dimensions.
    let extra = reader.extra_dimensions()?;
    let may_have_misses = reader.header.is_own() || extra.iter().any(|(name, _)| name == NAME_OF_MISSES);
    let is_copc = reader.variable_record("copc", 1)?.is_some();
    let las = Some(reader.header.facts(is_copc));
    reading.sink.file(&FileFacts { format: CloudFormat::Las, las });
    let format = reader.header.format;
    reading.sink.start(AttributeSet::of(|attribute| match attribute {
        Attribute::NormalX | Attribute::NormalY | Attribute::NormalZ => false,
        Attribute::Object => shown.object.is_some(),
        Attribute::Channel => shown.device.is_some() || format >= 6,
        Attribute::Time => reader.header.has_time(),
        _ => true,
    }));
    // Positions that are converted to metres are not in the file's system any more.
    if let Some(wkt) = units.crs.as_ref().filter(|_| units.metres.is_none()) {
        reading.sink.crs(wkt);
    }
    let details = reading.sink.takes_details().then(|| DetailFields::of(&reader.header, &extra));
    if details.is_some() {
        reading.sink.unread(DetailFields::unread(&reader.header, &extra));
    }
    let (header, metres) = (reader.header.clone(), units.metres.unwrap_or(DVec3::ONE));
    let mut are_degrees = units.is_angle;
    let mut more = true;
    while more {
        let mut is_geographic = false;
        more = reader.read_records(|record, position| {
            if std::mem::take(&mut are_degrees) {
                if position.x.abs() <= 360.0 && position.y.abs() <= 90.0 {
                    is_geographic = true;
                    return ControlFlow::Break(());
                }
                reading.warn(
                    "its coordinate reference system is in degrees, its coordinates are not; they are taken \
                     as metres",
                );
            }
            if let Some(details) = &details {
                reading.sink.details(&details.read(&header, record));
            }
            let raw_intensity = u16::from_le_bytes([record[12], record[13]]);
            let mut misfits = Misfits::default();
            let time = misfits.fitted(Attribute::Time, header.time(record));
            let mut number = |attribute, dimension: Option<ExtraDimension>| {
                dimension
                    .and_then(|dimension| dimension.value(record))
                    .map(|value| misfits.fitted(attribute, value))
            };
            reading.take(&PointRow {
                position: position * metres,
                normal: None,
                intensity: match shown.intensity {
                    Some(amplitude) => amplitude.value(record).unwrap_or(f64::NAN) as f32,
                    None => f32::from(raw_intensity),
                },
                class: header.class(record),
                return_number: header.return_number(record),
                number_of_returns: header.number_of_returns(record),
                is_miss: may_have_misses && raw_intensity == 0 && header.is_miss(record),
                scan_angle: header.scan_angle(record),
                leg: header.source_id(record),
                point_source: header.point_source(record),
                channel: number(Attribute::Channel, shown.device)
                    .map_or(header.channel(record), |v| v as u16),
                time,
                object: number(Attribute::Object, shown.object).map_or(0, |v| v as i64),
                misfits,
            })
        })?;
        if is_geographic {
            return Err(LasError::Geographic);
        }
    }
    Ok(())
}
