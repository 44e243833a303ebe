//! Trajectories of records of fixed size.
//!
//! SBET (Applanix, smoothed best estimate of trajectory): records of 17 little-endian doubles: time,
//! latitude, longitude (rad), ellipsoidal height (m), three velocities, roll, pitch, platform heading, wander
//! angle (rad), three accelerations, three angular rates. The platform heading is that in the wander frame,
//! so the true heading is the platform heading minus the wander angle.
//!
//! TerraScan (.trj): a header that begins with `TSCANTRJ`, version, its own size, the number of records and
//! their size (32-bit, little-endian), then records of doubles: time, x, y, z (m), heading, roll, pitch
//! (degrees), and quality flags (TerraScan User Guide, Trajectory file formats). The heading counts clockwise
//! from the grid's north.

use super::fix::{Fix, FixPlace, RecordError, RecordPlace};
use vlscan_geom::{Rotation, radians};

const SBET_BYTES: usize = 136;
/// Bytes of a TerraScan header that are read.
const HEADER_BYTES: usize = 24;
/// Plausible sizes of TerraScan's header and records.
const HEADER_SIZES: std::ops::RangeInclusive<usize> = HEADER_BYTES..=1 << 16;
const RECORD_SIZES: std::ops::RangeInclusive<usize> = 56..=4096;

/// Result of decoding the next bytes. Counts are bytes.
#[derive(Debug)]
pub enum Decoded {
    /// The beginning of a record; more bytes are needed.
    Incomplete,
    /// Bytes without a fix.
    Skipped(usize),
    /// A fix.
    Fix(usize, Fix, RecordPlace<'static>),
    /// An invalid record.
    Invalid(RecordPlace<'static>, RecordError),
}

/// Decodes the records of one of the formats.
#[derive(Debug)]
pub struct RecordDecoder {
    format: RecordFormat,
    /// Records decoded so far.
    read: u64,
    /// Bytes decoded so far.
    byte: u64,
    header: Option<Header>,
    /// Bytes of the header that are still to be skipped.
    skip: usize,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum RecordFormat {
    Sbet,
    TerraScan,
}

#[derive(Clone, Copy, Debug)]
struct Header {
    record: usize,
    /// Number of records; 0 if it was unknown to the writer.
    count: u64,
}

impl RecordDecoder {
    pub fn sbet() -> RecordDecoder {
        RecordDecoder { format: RecordFormat::Sbet, read: 0, byte: 0, header: None, skip: 0 }
    }

    pub fn terrascan() -> RecordDecoder {
        RecordDecoder { format: RecordFormat::TerraScan, ..RecordDecoder::sbet() }
    }

    pub fn name(&self) -> &'static str {
        match self.format {
            RecordFormat::Sbet => "SBET",
            RecordFormat::TerraScan => "TerraScan",
        }
    }

    pub fn next(&mut self, bytes: &[u8], ended: bool) -> Decoded {
        if self.skip > 0 {
            return match bytes.len().min(self.skip) {
                0 if ended => self.invalid(RecordError::new("the header is truncated")),
                0 => Decoded::Incomplete,
                some => {
                    self.skip -= some;
                    self.skip(some)
                }
            };
        }
        let size = match (self.format, self.header) {
            (RecordFormat::Sbet, _) => SBET_BYTES,
            (RecordFormat::TerraScan, Some(header)) => header.record,
            (RecordFormat::TerraScan, None) => return self.read_header(bytes, ended),
        };
        if let Some(header) = self.header.filter(|h| h.count > 0) {
            if self.read == header.count {
                // Anything after the last record is ignored.
                return if bytes.is_empty() { Decoded::Incomplete } else { self.skip(bytes.len()) };
            }
            if bytes.is_empty() && ended {
                let message = format!("the header states {} records, but the file ends here", header.count);
                return self.invalid(RecordError::new(message));
            }
        }
        if bytes.len() < size {
            if !ended || bytes.is_empty() {
                return Decoded::Incomplete;
            }
            return self
                .invalid(RecordError::new(format!("truncated: {} bytes, expected {size}", bytes.len())));
        }
        let fix = match self.format {
            RecordFormat::Sbet => sbet_fix(bytes),
            RecordFormat::TerraScan => terrascan_fix(bytes),
        };
        match fix {
            Err(error) => self.invalid(error),
            Ok(fix) => {
                let place = self.place();
                self.read += 1;
                self.byte += size as u64;
                Decoded::Fix(size, fix, place)
            }
        }
    }

    fn read_header(&mut self, bytes: &[u8], ended: bool) -> Decoded {
        if bytes.len() < HEADER_BYTES {
            return match ended && !bytes.is_empty() {
                true => self.invalid(RecordError::new("the header is truncated")),
                false => Decoded::Incomplete,
            };
        }
        let word = |at: usize| u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]]);
        let (header, count, record) = (word(12) as usize, u64::from(word(16)), word(20) as usize);
        if !bytes.starts_with(b"TSCANTRJ") {
            return self
                .invalid(RecordError::new("a TerraScan trajectory begins with `TSCANTRJ`, this does not"));
        }
        if !(HEADER_SIZES.contains(&header) && RECORD_SIZES.contains(&record)) {
            let message = format!(
                "the header states {header} bytes of header and {record} bytes per record, expected about \
                 1376 and 64"
            );
            return self.invalid(RecordError::new(message));
        }
        self.header = Some(Header { record, count });
        self.skip = header - HEADER_BYTES;
        self.skip(HEADER_BYTES)
    }

    fn skip(&mut self, bytes: usize) -> Decoded {
        self.byte += bytes as u64;
        Decoded::Skipped(bytes)
    }

    fn place(&self) -> RecordPlace<'static> {
        RecordPlace::Record { number: self.read + 1, byte: self.byte }
    }

    fn invalid(&self, error: RecordError) -> Decoded {
        Decoded::Invalid(self.place(), error)
    }
}

fn doubles<const N: usize>(bytes: &[u8]) -> [f64; N] {
    std::array::from_fn(|i| {
        let mut eight = [0; 8];
        eight.copy_from_slice(&bytes[i * 8..i * 8 + 8]);
        f64::from_le_bytes(eight)
    })
}

fn check_finite(values: &[(&str, f64)]) -> Result<(), RecordError> {
    match values.iter().find(|(_, value)| !value.is_finite()) {
        Some((name, value)) => Err(RecordError::new(format!("{name} is {value}, expected a number"))),
        None => Ok(()),
    }
}

fn sbet_fix(bytes: &[u8]) -> Result<Fix, RecordError> {
    let [time, latitude, longitude, height, _, _, _, roll, pitch, heading, wander] = doubles(bytes);
    check_finite(&[
        ("time", time),
        ("latitude", latitude),
        ("longitude", longitude),
        ("height", height),
        ("roll", roll),
        ("pitch", pitch),
        ("heading", heading),
        ("wander angle", wander),
    ])?;
    let attitude = Rotation::of_heading(roll, pitch, heading - wander);
    Ok(Fix {
        time,
        place: FixPlace::Geographic([latitude, longitude, height]),
        attitude,
        unitless_angles: None,
    })
}

fn terrascan_fix(bytes: &[u8]) -> Result<Fix, RecordError> {
    let [time, x, y, z, heading, roll, pitch] = doubles(bytes);
    check_finite(&[
        ("time", time),
        ("x", x),
        ("y", y),
        ("z", z),
        ("heading", heading),
        ("roll", roll),
        ("pitch", pitch),
    ])?;
    let attitude = Rotation::of_heading(radians(roll), radians(pitch), radians(heading));
    Ok(Fix { time, place: FixPlace::Local([x, y, z]), attitude, unitless_angles: None })
}

/// Encodes records for tests.
#[cfg(test)]
pub mod testing {
    /// Rows of time, latitude, longitude (rad), height, roll, pitch, heading (rad).
    pub fn sbet(rows: &[[f64; 7]]) -> Vec<u8> {
        let record = |[t, lat, lon, h, roll, pitch, heading]: [f64; 7]| {
            let wander = 0.25;
            [t, lat, lon, h, 1.0, 2.0, 3.0, roll, pitch, heading + wander, wander, 0., 0., 0., 0., 0., 0.]
        };
        rows.iter().flat_map(|row| record(*row)).flat_map(f64::to_le_bytes).collect()
    }

    /// Rows of time, x, y, z, heading, roll, pitch (degrees).
    pub fn terrascan(rows: &[[f64; 7]]) -> Vec<u8> {
        let mut bytes = b"TSCANTRJ".to_vec();
        for word in [20_010_715u32, 1376, rows.len() as u32, 64] {
            bytes.extend(word.to_le_bytes());
        }
        bytes.resize(1376, 0);
        for row in rows {
            bytes.extend(row.iter().flat_map(|v| v.to_le_bytes()));
            bytes.extend([0; 8]);
        }
        bytes
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::FRAC_PI_2;

    fn read_all(mut records: RecordDecoder, bytes: &[u8]) -> (Vec<Fix>, Option<String>) {
        let (mut fixes, mut at) = (Vec::new(), 0);
        loop {
            match records.next(&bytes[at..], true) {
                Decoded::Incomplete => return (fixes, None),
                Decoded::Skipped(n) => at += n,
                Decoded::Fix(n, fix, _) => {
                    at += n;
                    fixes.push(fix);
                }
                Decoded::Invalid(place, error) => {
                    let found = place.error(std::path::Path::new("f"), error);
                    return (fixes, Some(found.to_string()));
                }
            }
        }
    }

    #[test]
    fn the_wander_angle_is_subtracted_from_the_platform_heading() {
        let rows = [[10.0, 0.8, 0.1, 300.0, 0.0, 0.0, FRAC_PI_2], [11.0, 0.9, 0.2, 301.0, 0.0, 0.0, 0.0]];
        let (fixes, error) = read_all(RecordDecoder::sbet(), &testing::sbet(&rows));
        assert_eq!((fixes.len(), error, fixes[0].time), (2, None, 10.0));
        assert_eq!(fixes[1].place, FixPlace::Geographic([0.9, 0.2, 301.0]));
        assert!((fixes[0].attitude.forward() - vlscan_geom::DVec3::X).length() < 1e-12, "not to the east");
    }

    #[test]
    fn terrascan_headers_state_sizes() {
        let bytes = testing::terrascan(&[[5.0, 1.0, 2.0, 3.0, 90.0, 0.0, 0.0]; 3]);
        let (fixes, error) = read_all(RecordDecoder::terrascan(), &bytes);
        assert_eq!((fixes.len(), error), (3, None));
        assert_eq!(fixes[2].place, FixPlace::Local([1.0, 2.0, 3.0]));
        assert!((fixes[2].attitude.forward() - vlscan_geom::DVec3::X).length() < 1e-12);
        // A writer that does not know the number of records leaves 0; anything after the last record is
        // ignored.
        let mut unknown = bytes.clone();
        unknown[16] = 0;
        assert_eq!(read_all(RecordDecoder::terrascan(), &unknown).0.len(), 3);
        let mut longer = bytes.clone();
        longer.extend([1; 30]);
        assert_eq!(read_all(RecordDecoder::terrascan(), &longer).0.len(), 3);
    }

    #[test]
    fn truncated_and_invalid_records_are_located() {
        let sbet = testing::sbet(&[[10.0, 0.8, 0.1, 300.0, 0.0, 0.0, 0.0]; 3]);
        let (fixes, error) = read_all(RecordDecoder::sbet(), &sbet[..SBET_BYTES * 2 + 7]);
        assert!(
            fixes.len() == 2
                && error.unwrap().contains("record 3 (byte 272): truncated: 7 bytes, expected 136")
        );
        let nan = testing::sbet(&[[10.0, f64::NAN, 0.1, 300.0, 0.0, 0.0, 0.0]]);
        assert!(
            read_all(RecordDecoder::sbet(), &nan).1.unwrap().contains("record 1 (byte 0): latitude is NaN")
        );
        let trj = testing::terrascan(&[[5.0, 1.0, 2.0, 3.0, 90.0, 0.0, 0.0]; 3]);
        let of = |bytes: &[u8]| read_all(RecordDecoder::terrascan(), bytes).1.unwrap();
        assert!(of(&trj[..1376 + 128]).contains("record 3 (byte 1504): the header states 3 records"));
        assert!(of(&trj[..1376 + 100]).contains("record 2 (byte 1440): truncated: 36 bytes, expected 64"));
        assert!(
            of(&trj[..1000]).contains("the header is truncated")
                && of(&trj[..20]).contains("the header is truncated")
        );
        let mut odd = trj.clone();
        odd[20] = 1;
        assert!(of(&odd).contains("1 bytes per record"));
        assert!(of(&sbet).contains("TSCANTRJ"));
    }

    proptest::proptest! {
        #[test]
        fn any_bytes_are_read_or_refused(bytes in proptest::collection::vec(0u8.., 0..600)) {
            let _ = read_all(RecordDecoder::sbet(), &bytes);
            let _ = read_all(RecordDecoder::terrascan(), &bytes);
            let headed = [&testing::terrascan(&[])[..], &bytes].concat();
            let _ = read_all(RecordDecoder::terrascan(), &headed);
        }
    }
}
