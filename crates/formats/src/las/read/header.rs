//! The header of LAS files and their variable length records.

use vlscan_geom::DVec3;

/// Lengths of a record of point formats 0 to 10 without extra bytes, bytes.
const MIN_RECORD_BYTES: [u16; 11] = [20, 28, 26, 34, 57, 63, 30, 36, 38, 59, 67];

/// Bit of the format byte that marks compressed records; the bits of the format itself.
const COMPRESSED: u8 = 0x80;
const FORMAT: u8 = 0x3f;

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
    scale: DVec3,
    offset: DVec3,
}

/// Little-endian numbers in the bytes of a file.
#[derive(Clone, Copy)]
pub(super) struct Fields<'a>(pub &'a [u8]);

impl<'a> Fields<'a> {
    pub fn bytes<const N: usize>(self, at: usize) -> Result<[u8; N], String> {
        let end = at.checked_add(N).filter(|end| *end <= self.0.len());
        let bytes = end.and_then(|end| self.0[at..end].try_into().ok());
        bytes.ok_or_else(|| "the file ends within its header".to_owned())
    }

    pub fn u16(self, at: usize) -> Result<u16, String> {
        self.bytes(at).map(u16::from_le_bytes)
    }

    pub fn u32(self, at: usize) -> Result<u32, String> {
        self.bytes(at).map(u32::from_le_bytes)
    }

    pub fn u64(self, at: usize) -> Result<u64, String> {
        self.bytes(at).map(u64::from_le_bytes)
    }

    pub fn f64(self, at: usize) -> Result<f64, String> {
        self.bytes(at).map(f64::from_le_bytes)
    }

    pub fn vector(self, at: usize) -> Result<DVec3, String> {
        Ok(DVec3::new(self.f64(at)?, self.f64(at + 8)?, self.f64(at + 16)?))
    }

    /// The data of the first variable length record, or extended one (LAS 1.4), of a user and a number. All records are
    /// read: each must end within the file.
    pub fn variable_record(self, user: &str, id: u16) -> Result<Option<&'a [u8]>, String> {
        let mut found = None;
        let (header_size, count) = (self.u16(94)?, self.u32(100)?);
        let normal = (usize::from(header_size), u64::from(count), 54);
        let has_extended = self.bytes::<1>(25)? >= [4] && header_size >= 375;
        let extended = match has_extended {
            true => (usize::try_from(self.u64(235)?).unwrap_or(usize::MAX), u64::from(self.u32(243)?), 60),
            false => (0, 0, 60),
        };
        for (mut at, count, header) in [normal, extended] {
            for _ in 0..count {
                let end = at.checked_add(header).filter(|end| *end <= self.0.len());
                let start = end.ok_or("the file ends within its header")?;
                let length = match header {
                    54 => u64::from(self.u16(at + 20)?),
                    _ => self.u64(at + 20)?,
                };
                let end = usize::try_from(length).ok().and_then(|length| start.checked_add(length));
                let end = end.filter(|end| *end <= self.0.len()).ok_or("the file ends within its header")?;
                let user_id = self.bytes::<16>(at + 2)?;
                let name = user_id.split(|b| *b == 0).next().unwrap_or_default();
                if found.is_none() && name == user.as_bytes() && self.u16(at + 18)? == id {
                    found = self.0.get(start..end);
                }
                at = end;
            }
        }
        Ok(found)
    }
}

impl Header {
    pub(super) fn read(file: Fields) -> Result<Header, String> {
        let [major, minor] = file.bytes(24)?;
        let (header_size, format) = (file.u16(94)?, file.bytes::<1>(104)?[0] & FORMAT);
        let counts =
            (u64::from(file.u32(107)?), if minor >= 4 && header_size >= 375 { file.u64(247)? } else { 0 });
        let header = Header {
            format,
            record_length: file.u16(105)?,
            // Some writers of LAS 1.4 fill in the field of earlier versions alone.
            count: if counts.1 > 0 { counts.1 } else { counts.0 },
            is_compressed: file.bytes::<1>(104)?[0] & COMPRESSED != 0,
            data_at: file.u32(96)? as usize,
            scale: file.vector(131)?,
            offset: file.vector(155)?,
        };
        let shortest = MIN_RECORD_BYTES.get(usize::from(format)).filter(|_| major == 1 && minor <= 5);
        let Some(shortest) = shortest else {
            return Err(format!(
                "is LAS {major}.{minor} with points of format {format}; LAS 1.0 to 1.5 with formats 0 to 10 are read, convert it for example with PDAL"
            ));
        };
        if header.record_length < *shortest {
            let found = header.record_length;
            return Err(format!(
                "expected at least {shortest} bytes per point of format {format}, found {found}"
            ));
        }
        if header.data_at > file.0.len() {
            return Err(format!(
                "the points begin at byte {}, the file ends at {}",
                header.data_at,
                file.0.len()
            ));
        }
        if !(header.scale.is_finite() && header.offset.is_finite() && header.scale.cmpne(DVec3::ZERO).all()) {
            let (scale, offset) = (header.scale, header.offset);
            return Err(format!("expected finite scales and offsets, found {scale} and {offset}"));
        }
        Ok(header)
    }
}

impl Header {
    pub(super) fn position(&self, record: &[u8]) -> DVec3 {
        let int = |at: usize| {
            f64::from(i32::from_le_bytes([record[at], record[at + 1], record[at + 2], record[at + 3]]))
        };
        DVec3::new(int(0), int(4), int(8)) * self.scale + self.offset
    }

    pub(super) fn class(&self, record: &[u8]) -> u8 {
        if self.format < 6 { record[15] & 0x1f } else { record[16] }
    }

    /// Point source id: by convention of this program the number of the leg plus one.
    pub(super) fn source_id(&self, record: &[u8]) -> u16 {
        let at = if self.format < 6 { 18 } else { 20 };
        u16::from_le_bytes([record[at], record[at + 1]]).saturating_sub(1)
    }

    pub(super) fn channel(&self, record: &[u8]) -> u16 {
        if self.format < 6 { 0 } else { u16::from(record[15] >> 4 & 0x03) }
    }

    pub(super) fn time(&self, record: &[u8]) -> f64 {
        let at = match self.format {
            6.. => 22,
            1 | 3..=5 => 20,
            _ => return 0.0,
        };
        record.get(at..at + 8).map_or(0.0, |b| f64::from_le_bytes(b.try_into().unwrap_or_default()))
    }

    pub(super) fn return_number(&self, record: &[u8]) -> u8 {
        record[14] & if self.format < 6 { 0x07 } else { 0x0f }
    }

    /// Offset of the first extra byte in a record.
    pub(super) fn extra_bytes_at(&self) -> usize {
        MIN_RECORD_BYTES.get(usize::from(self.format)).copied().map_or(0, usize::from)
    }

    /// Number of records that fit between the start of the points and what follows them, for records that are not compressed.
    pub(super) fn room(&self, file: Fields) -> u64 {
        let minor = file.bytes::<2>(24).map_or(0, |version| version[1]);
        let header_size = file.u16(94).unwrap_or(0);
        let mut end = file.0.len() as u64;
        // Extended variable records, and waveform packets.
        for (at, is_there) in
            [(235, minor >= 4 && header_size >= 375), (227, minor >= 3 && header_size >= 235)]
        {
            let start = file.u64(at).unwrap_or(0);
            if is_there && start >= self.data_at as u64 {
                end = end.min(start);
            }
        }
        end.saturating_sub(self.data_at as u64) / u64::from(self.record_length.max(1))
    }
}
