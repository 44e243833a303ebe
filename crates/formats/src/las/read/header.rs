//! The header of LAS files and their variable length records.

use super::error::LasError;
use crate::PositionSteps;
use las::point::Format;
use las::raw;
use std::io::Cursor;
use vlscan_geom::DVec3;

/// Bit of the format byte that marks compressed records; the bits of the format itself.
const COMPRESSED: u8 = 0x80;
const FORMAT: u8 = 0x3f;
/// Length of a header of LAS 1.4 and later, bytes. Shorter ones have no fields of that version.
const HEADER_BYTES_1_4: u16 = 375;

/// The properties of the records, from the header of a file.
#[derive(Clone, Debug)]
pub struct Header {
    /// Point format, 0 to 10.
    pub format: u8,
    /// Number of records.
    pub count: u64,
    pub(super) record_length: u16,
    pub(super) is_compressed: bool,
    /// Offset of the points in the file.
    pub(super) data_at: usize,
    /// The fields of records of the format, without extra bytes.
    fields: Format,
    raw: raw::Header,
}

/// Statements of a header about all points of the file.
#[derive(Clone, Debug, PartialEq)]
pub struct LasFacts {
    /// Major and minor version of LAS.
    pub version: (u8, u8),
    /// Point format, 0 to 10.
    pub point_format: u8,
    /// True if points are compressed (LAZ).
    pub is_compressed: bool,
    /// True if chunks are the nodes of an octree (COPC).
    pub is_copc: bool,
    /// True if times are adjusted standard GPS time (seconds since 6 January 1980, less 10⁹); otherwise they
    /// are seconds of the GPS week.
    pub has_adjusted_times: bool,
    /// Steps of the coordinates, in the unit of the file.
    pub scale: DVec3,
    /// Coordinates of step 0, in the unit of the file.
    pub offset: DVec3,
    /// Metres in a unit of x, y and z.
    pub metres: DVec3,
    /// The system that made the points, as the file names it.
    pub system: String,
    /// The program that wrote the file, as the file names it.
    pub software: String,
}

impl LasFacts {
    /// Steps of the positions.
    pub fn steps(&self) -> PositionSteps {
        PositionSteps { scale: self.scale, offset: self.offset, metres: self.metres }
    }
}

/// Little-endian numbers in the bytes of a file.
#[derive(Clone, Copy)]
pub(super) struct Fields<'a>(pub &'a [u8]);

impl<'a> Fields<'a> {
    pub fn bytes<const N: usize>(self, at: usize) -> Result<[u8; N], LasError> {
        let end = at.checked_add(N).filter(|end| *end <= self.0.len());
        let bytes = end.and_then(|end| self.0[at..end].try_into().ok());
        bytes.ok_or(LasError::HeaderEnds)
    }

    pub fn u16(self, at: usize) -> Result<u16, LasError> {
        self.bytes(at).map(u16::from_le_bytes)
    }

    pub fn u32(self, at: usize) -> Result<u32, LasError> {
        self.bytes(at).map(u32::from_le_bytes)
    }

    pub fn u64(self, at: usize) -> Result<u64, LasError> {
        self.bytes(at).map(u64::from_le_bytes)
    }
}

impl Header {
    pub(super) fn read(file: Fields) -> Result<Header, LasError> {
        let raw = raw::Header::read_from(Cursor::new(file.0)).map_err(|_| LasError::HeaderEnds)?;
        let format = raw.point_data_record_format & FORMAT;
        let (major, minor) = (raw.version.major, raw.version.minor);
        let fields = Format::new(format).ok().filter(|_| major == 1 && minor <= 5);
        let Some(fields) = fields else {
            return Err(LasError::Version { major, minor, format });
        };
        // Some writers of LAS 1.4 only fill in the field of earlier versions.
        let large = raw.large_file.filter(|_| raw.header_size >= HEADER_BYTES_1_4);
        let count = large.map(|large| large.number_of_point_records).filter(|count| *count > 0);
        let header = Header {
            format,
            record_length: raw.point_data_record_length,
            count: count.unwrap_or(raw.number_of_point_records.into()),
            is_compressed: raw.point_data_record_format & COMPRESSED != 0,
            data_at: raw.offset_to_point_data as usize,
            fields,
            raw,
        };
        if header.record_length < fields.len() {
            let (shortest, found) = (fields.len(), header.record_length);
            return Err(LasError::RecordTooShort { format, shortest, found });
        }
        if header.data_at > file.0.len() {
            let (at, end) = (header.data_at, file.0.len());
            return Err(LasError::PointsBehindEnd { at, end });
        }
        let (scale, offset) = (header.scale(), header.offset());
        if !(scale.is_finite() && offset.is_finite() && scale.cmpne(DVec3::ZERO).all()) {
            return Err(LasError::Scales { scale, offset });
        }
        Ok(header)
    }

    /// The data of the first variable length record, or extended one (LAS 1.4), of a user and a number. All
    /// records are read: each must end within the file. They are not copied: waveform packets take gigabytes.
    pub(super) fn variable_record<'a>(
        &self,
        file: Fields<'a>,
        user: &str,
        id: u16,
    ) -> Result<Option<&'a [u8]>, LasError> {
        Ok(self.variable_records(file, user, id)?.into_iter().next())
    }

    /// The data of all variable length records of a user and a number, see
    /// [`variable_record`](Header::variable_record).
    pub(super) fn variable_records<'a>(
        &self,
        file: Fields<'a>,
        user: &str,
        id: u16,
    ) -> Result<Vec<&'a [u8]>, LasError> {
        let mut found = Vec::new();
        let count = u64::from(self.raw.number_of_variable_length_records);
        let normal = (usize::from(self.raw.header_size), count, 54);
        let extended = self.raw.evlr.filter(|_| self.raw.header_size >= HEADER_BYTES_1_4).map(|extended| {
            let start = usize::try_from(extended.start_of_first_evlr).unwrap_or(usize::MAX);
            (start, u64::from(extended.number_of_evlrs), 60)
        });
        for (mut at, count, header) in [Some(normal), extended].into_iter().flatten() {
            for _ in 0..count {
                let start = at
                    .checked_add(header)
                    .filter(|start| *start <= file.0.len())
                    .ok_or(LasError::HeaderEnds)?;
                let length = match header {
                    54 => u64::from(file.u16(at + 20)?),
                    _ => file.u64(at + 20)?,
                };
                let end = usize::try_from(length).ok().and_then(|length| start.checked_add(length));
                let end = end.filter(|end| *end <= file.0.len()).ok_or(LasError::HeaderEnds)?;
                let user_id = file.bytes::<16>(at + 2)?;
                let name = user_id.split(|b| *b == 0).next().unwrap_or_default();
                if name == user.as_bytes() && file.u16(at + 18)? == id {
                    found.extend(file.0.get(start..end));
                }
                at = end;
            }
        }
        Ok(found)
    }

    /// Statements about all points, whose units are this many metres.
    pub(super) fn facts(&self, is_copc: bool, metres: DVec3) -> LasFacts {
        let text = |bytes: &[u8]| {
            let bytes = bytes.split(|b| *b == 0).next().unwrap_or_default();
            String::from_utf8_lossy(bytes).trim().to_owned()
        };
        LasFacts {
            version: (self.raw.version.major, self.raw.version.minor),
            point_format: self.format,
            is_compressed: self.is_compressed,
            is_copc,
            has_adjusted_times: self.raw.global_encoding & 1 != 0,
            scale: self.scale(),
            offset: self.offset(),
            metres,
            system: text(&self.raw.system_identifier),
            software: text(&self.raw.generating_software),
        }
    }

    /// True if the coordinate reference system is stated as WKT, by a bit of the global encoding.
    pub(super) fn states_wkt(&self) -> bool {
        self.raw.global_encoding & 0x10 != 0
    }

    fn scale(&self) -> DVec3 {
        DVec3::new(self.raw.x_scale_factor, self.raw.y_scale_factor, self.raw.z_scale_factor)
    }

    fn offset(&self) -> DVec3 {
        DVec3::new(self.raw.x_offset, self.raw.y_offset, self.raw.z_offset)
    }
}

impl Header {
    pub(super) fn position(&self, record: &[u8]) -> DVec3 {
        let int = |at: usize| {
            f64::from(i32::from_le_bytes([record[at], record[at + 1], record[at + 2], record[at + 3]]))
        };
        DVec3::new(int(0), int(4), int(8)) * self.scale() + self.offset()
    }

    pub(super) fn class(&self, record: &[u8]) -> u8 {
        if self.fields.is_extended { record[16] } else { record[15] & 0x1f }
    }

    pub(super) fn point_source(&self, record: &[u8]) -> u16 {
        let at = if self.fields.is_extended { 20 } else { 18 };
        u16::from_le_bytes([record[at], record[at + 1]])
    }

    /// The number of the leg: by convention of this program the point source id less one.
    pub(super) fn source_id(&self, record: &[u8]) -> u16 {
        self.point_source(record).saturating_sub(1)
    }

    pub(super) fn channel(&self, record: &[u8]) -> u16 {
        if self.fields.is_extended { u16::from(record[15] >> 4 & 0x03) } else { 0 }
    }

    pub(super) fn time(&self, record: &[u8]) -> f64 {
        if !self.fields.has_gps_time {
            return 0.0;
        }
        let at = if self.fields.is_extended { 22 } else { 20 };
        record.get(at..at + 8).map_or(0.0, |b| f64::from_le_bytes(b.try_into().unwrap_or_default()))
    }

    pub(super) fn return_number(&self, record: &[u8]) -> u8 {
        record[14] & if self.fields.is_extended { 0x0f } else { 0x07 }
    }

    /// True if this program wrote the file.
    pub(super) fn is_own(&self) -> bool {
        self.raw.generating_software.starts_with(b"vlscan ")
    }

    /// True if a record of a file of this program is that of a pulse without a return: return 0 of 0,
    /// withheld. The intensity is 0, too.
    pub(super) fn is_miss(&self, record: &[u8]) -> bool {
        let is_withheld =
            if self.fields.is_extended { record[15] & 1 << 2 != 0 } else { record[15] & 1 << 7 != 0 };
        is_withheld && self.return_number(record) == 0 && self.number_of_returns(record) == 0
    }

    pub(super) fn number_of_returns(&self, record: &[u8]) -> u8 {
        if self.fields.is_extended { record[14] >> 4 } else { record[14] >> 3 & 0x07 }
    }

    /// Scan angle, degrees: steps of 0.006° in formats from 6 on, whole degrees in others.
    pub(super) fn scan_angle(&self, record: &[u8]) -> f64 {
        match self.fields.is_extended {
            true => 0.006 * f64::from(i16::from_le_bytes([record[18], record[19]])),
            false => f64::from(record[16] as i8),
        }
    }

    /// Offset of the first extra byte in a record.
    pub(super) fn extra_bytes_at(&self) -> usize {
        usize::from(self.fields.len())
    }

    /// True if records have a time.
    pub(super) fn has_time(&self) -> bool {
        self.fields.has_gps_time
    }

    /// Number of records that fit between the start of the points and what follows them, for records that are
    /// not compressed.
    pub(super) fn room(&self, file: Fields) -> u64 {
        let extended = self.raw.evlr.filter(|_| self.raw.header_size >= HEADER_BYTES_1_4);
        let packets = self.raw.start_of_waveform_data_packet_record.filter(|_| self.raw.header_size >= 235);
        let starts = [extended.map(|extended| extended.start_of_first_evlr), packets].into_iter().flatten();
        let start = starts.filter(|start| *start >= self.data_at as u64).min();
        let end = start.unwrap_or(u64::MAX).min(file.0.len() as u64);
        end.saturating_sub(self.data_at as u64) / u64::from(self.record_length.max(1))
    }
}
