//! Detects the format of a trajectory and decodes its bytes to fixes.

use super::binary::{Decoded, RecordDecoder};
use super::fix::{Fix, Pose, RecordError, RecordPlace};
use super::georeference::Georeference;
use super::text::PoseRows;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use vlscan_base::diag::{Diagnostics, Place};
use vlscan_base::error::Result;
use vlscan_base::recognise::{Expected, Family, foreign, is_sbet};
use vlscan_survey::{PoseFormat, PoseStream};
use vlscan_tables::input::arrow::{ArrowDetection, detect_arrow};
use vlscan_tables::input::rows::RowError;

/// Takes the fixes that are decoded, with the name of their format; breaks after an error.
pub type TakeFix<'t> = dyn FnMut(&str, Fix, RecordPlace) -> ControlFlow<()> + 't;

/// Decodes one of the formats.
#[derive(Debug)]
pub struct PoseDecoder {
    /// Name of the stream in messages.
    path: PathBuf,
    settings: PoseStream,
    /// Bytes that have not been decoded, unless rows are.
    pending: Vec<u8>,
    format: Format,
}

#[derive(Debug)]
enum Format {
    /// Too few bytes have arrived to detect the format.
    Unknown,
    Rows(Box<PoseRows>),
    Binary(RecordDecoder),
}

/// Bytes that begin every TerraScan trajectory.
const TERRASCAN: &[u8] = b"TSCANTRJ";
/// Fewer bytes hold no pose in any format.
const MIN_POSE_BYTES: usize = 14;
/// Number of bytes of a file that are decoded together.
const PIECE_BYTES: usize = 1 << 20;
/// Bytes that decide any detection: an SBET record.
const DETECTION_BYTES: usize = 136;

impl PoseDecoder {
    /// A decoder without bytes; `path` is the name in messages.
    pub fn new(path: &Path, settings: &PoseStream) -> PoseDecoder {
        let format = match settings.format {
            None | Some(PoseFormat::Text | PoseFormat::Helios) => Format::Unknown,
            Some(PoseFormat::Sbet) => Format::Binary(RecordDecoder::sbet()),
            Some(PoseFormat::TerraScan) => Format::Binary(RecordDecoder::terrascan()),
        };
        PoseDecoder { path: path.to_path_buf(), settings: settings.clone(), pending: Vec::new(), format }
    }

    /// True if the bytes fed so far are records, or can still be such.
    fn may_be_binary(&self) -> bool {
        !matches!(self.format, Format::Rows(_))
    }

    /// Problems of headings found since the last call that do not end the run.
    pub fn take_remarks(&mut self) -> Diagnostics {
        match &mut self.format {
            Format::Rows(rows) => rows.take_remarks(),
            _ => Diagnostics::default(),
        }
    }

    /// Adds bytes that have arrived.
    pub fn feed(&mut self, bytes: &[u8]) {
        match &mut self.format {
            Format::Rows(rows) => rows.feed(bytes),
            _ => self.pending.extend_from_slice(bytes),
        }
    }

    /// Passes the fixes that have arrived to `take` until it breaks; with `ended` no others will follow.
    ///
    /// # Errors
    /// The first record without a fix, with its place.
    pub fn decode(&mut self, ended: bool, take: &mut TakeFix) -> Result<()> {
        if matches!(self.format, Format::Unknown) {
            self.find_format(ended)?;
        }
        let records = match &mut self.format {
            Format::Unknown => return Ok(()),
            Format::Rows(rows) => return rows.decode(ended, take),
            Format::Binary(records) => records,
        };
        let (mut start, mut outcome) = (0, Ok(()));
        loop {
            match records.next(&self.pending[start..], ended) {
                Decoded::Incomplete => break,
                Decoded::Skipped(count) => start += count,
                Decoded::Fix(count, fix, place) => {
                    start += count;
                    if take(records.name(), fix, place).is_break() {
                        break;
                    }
                }
                Decoded::Invalid(place, error) => {
                    outcome = Err(place.error(&self.path, error));
                    break;
                }
            }
        }
        self.pending.drain(..start);
        outcome
    }

    fn find_format(&mut self, ended: bool) -> Result<()> {
        let bytes = &self.pending;
        let is_named = self.settings.format.is_some();
        let has_line = ended || bytes.len() >= DETECTION_BYTES || bytes.contains(&b'\n');
        let found = if has_line { foreign(&self.path, bytes, &Expected::POSES) } else { None };
        if let Some(found) =
            found.filter(|found| !matches!(found.kind.family, Family::Binary | Family::Utf16))
        {
            return Err(found.error(&self.path));
        }
        let detected = match detect_arrow(bytes) {
            ArrowDetection::NeedMoreBytes if !ended => return Ok(()),
            ArrowDetection::Arrow => Detection::Text,
            _ if is_named && bytes[..bytes.len().min(DETECTION_BYTES)].contains(&0) => {
                let place = Place::in_line(&self.path, 1, "", 0..0);
                let message = "expected a pose as text, found binary data".to_owned();
                let help = "binary trajectories (SBET, TerraScan) are recognised without --trajectory-format";
                return Err(RowError { place, message }.with_help(help));
            }
            _ if is_named => Detection::Text,
            _ => detect(bytes, ended),
        };
        self.format = match detected {
            Detection::NeedMoreBytes => return Ok(()),
            Detection::Text => {
                let mut rows = PoseRows::new(&self.path, self.settings.clone());
                rows.feed(&std::mem::take(&mut self.pending));
                Format::Rows(Box::new(rows))
            }
            Detection::Sbet => Format::Binary(RecordDecoder::sbet()),
            Detection::TerraScan => Format::Binary(RecordDecoder::terrascan()),
            Detection::Unsupported(help) => {
                let message = "this is neither text nor SBET nor a TerraScan trajectory";
                let place = RecordPlace::Record { number: 1, byte: 0 };
                return Err(place.error(&self.path, RecordError::new(message).help(help)));
            }
        };
        Ok(())
    }
}

#[derive(Debug, PartialEq)]
enum Detection {
    NeedMoreBytes,
    Text,
    Sbet,
    TerraScan,
    /// An unknown format, with a hint for the message.
    Unsupported(&'static str),
}

/// Detects by content: text has no control characters, TerraScan begins with its name, and the first record
/// of an SBET is plausible.
fn detect(bytes: &[u8], ended: bool) -> Detection {
    if bytes.is_empty() || bytes.len() < MIN_POSE_BYTES && !ended {
        return Detection::NeedMoreBytes;
    }
    if bytes.starts_with(TERRASCAN) {
        return Detection::TerraScan;
    }
    let start = &bytes[..bytes.len().min(DETECTION_BYTES)];
    let is_text = !start.iter().any(|b| b.is_ascii_control() && !b.is_ascii_whitespace());
    // A few bytes could be text by chance, unless they are ASCII.
    if is_text && (ended || start.len() == DETECTION_BYTES || start.iter().all(u8::is_ascii)) {
        return Detection::Text;
    }
    if start.len() < DETECTION_BYTES && !ended {
        return Detection::NeedMoreBytes;
    }
    if is_sbet(start) {
        return Detection::Sbet;
    }
    Detection::Unsupported(if start.starts_with(&[0xff, 0xfe]) || start.starts_with(&[0xfe, 0xff]) {
        "convert UTF-16 first: iconv -f UTF-16 -t UTF-8"
    } else {
        "name the format with --trajectory-format"
    })
}

/// All poses of a file in a binary format; `None` for text.
pub(in crate::platform) fn read_binary(
    path: &Path,
    bytes: &[u8],
    frame: &mut Georeference,
) -> Option<Result<Vec<Pose>>> {
    let mut decoder = PoseDecoder::new(path, &PoseStream::at(path));
    decoder.feed(&bytes[..bytes.len().min(DETECTION_BYTES)]);
    if decoder.find_format(true).is_ok() && !decoder.may_be_binary() {
        return None;
    }
    let (mut poses, mut outcome) = (Vec::new(), Ok(()));
    let mut take = |_: &str, fix: Fix, place: RecordPlace| {
        let pose = frame.pose(&fix).map(|pose| poses.push(pose));
        outcome = pose.map_err(|error| place.error(path, error));
        if outcome.is_ok() { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
    };
    let pieces = bytes[bytes.len().min(DETECTION_BYTES)..].chunks(PIECE_BYTES);
    let decoded = pieces.into_iter().try_for_each(|piece| {
        decoder.feed(piece);
        decoder.decode(false, &mut take)
    });
    let decoded = decoded.and_then(|()| decoder.decode(true, &mut take));
    Some(outcome.and(decoded).map(|()| poses))
}

#[cfg(test)]
mod tests {
    use super::super::binary::testing;
    use super::*;

    #[test]
    fn formats_are_detected_by_their_first_bytes() {
        let sbet = testing::sbet(&[[1000.0, 0.8, 0.1, 300.0, 0.0, 0.0, 0.0]]);
        let trj = testing::terrascan(&[[1.0; 7]]);
        assert_eq!(detect(&sbet, false), Detection::Sbet);
        assert_eq!(detect(&sbet[..100], false), Detection::NeedMoreBytes);
        assert_eq!(detect(&trj, false), Detection::TerraScan);
        for text in [
            "1 2 3 4 5 6 7\n",
            "\u{feff}time,x,y,z,roll,pitch,yaw\n",
            "# Höhe über Grund in Metern, sonst nichts\n",
        ] {
            assert_eq!(detect(text.as_bytes(), true), Detection::Text, "{text}");
        }
        assert_eq!(detect(b"1 2 3 4 5 6 7\n", false), Detection::Text);
        assert_eq!(detect(b"1 2 3", false), Detection::NeedMoreBytes);
        assert_eq!(detect(b"", true), Detection::NeedMoreBytes);
        assert!(matches!(detect(&[0; 136], false), Detection::Unsupported(_)));
        assert!(
            matches!(detect(b"\xff\xfet\0i\0m\0e\0,\0x\0", true), Detection::Unsupported(h) if h.contains("iconv"))
        );
    }
}
