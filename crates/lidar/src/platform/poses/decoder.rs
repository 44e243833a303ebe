//! Detects the format of a trajectory and decodes its bytes to fixes.

use super::binary::{RecordDecoder, looks_like_sbet};
use super::fix::{Decoded, Pose, RecordError, RecordPlace};
use super::georeference::Georeference;
use super::text::TextDecoder;
use std::path::Path;
use vlscan_base::diag::Diagnostics;
use vlscan_survey::{PoseFormat, PoseStream};

/// Decodes one of the formats.
#[derive(Debug)]
pub enum PoseDecoder {
    /// Too few bytes have arrived to detect the format.
    Unknown(Box<PoseStream>),
    Text(Box<TextDecoder>),
    Binary(RecordDecoder),
}

/// Bytes that begin every TerraScan trajectory.
const TERRASCAN: &[u8] = b"TSCANTRJ";
/// Fewer bytes hold no pose in any format.
const MIN_POSE_BYTES: usize = 14;
/// Bytes that decide any detection: an SBET record.
const DETECTION_BYTES: usize = 136;

impl PoseDecoder {
    pub fn new(settings: &PoseStream) -> PoseDecoder {
        match settings.format {
            None => PoseDecoder::Unknown(Box::new(settings.clone())),
            Some(PoseFormat::Text | PoseFormat::Helios) => {
                PoseDecoder::Text(Box::new(TextDecoder::new(settings.clone())))
            }
            Some(PoseFormat::Sbet) => PoseDecoder::Binary(RecordDecoder::sbet()),
            Some(PoseFormat::TerraScan) => PoseDecoder::Binary(RecordDecoder::terrascan()),
        }
    }

    /// Decodes the beginning of `bytes`; with `ended` no others will follow.
    pub fn next<'t>(&mut self, bytes: &'t [u8], ended: bool) -> Decoded<'t> {
        if let PoseDecoder::Unknown(settings) = self {
            match detect(bytes, ended) {
                Detection::NeedMoreBytes => return Decoded::Incomplete,
                Detection::Text => {
                    *self = PoseDecoder::Text(Box::new(TextDecoder::new((**settings).clone())))
                }
                Detection::Sbet => *self = PoseDecoder::Binary(RecordDecoder::sbet()),
                Detection::TerraScan => *self = PoseDecoder::Binary(RecordDecoder::terrascan()),
                Detection::Unsupported(help) => {
                    let message = "this is neither text nor SBET nor a TerraScan trajectory";
                    let place = RecordPlace::Record { number: 1, byte: 0 };
                    return Decoded::Invalid(place, RecordError::new(message).help(help));
                }
            }
        }
        match self {
            PoseDecoder::Unknown(_) => Decoded::Incomplete,
            PoseDecoder::Text(lines) => lines.next(bytes, ended),
            PoseDecoder::Binary(records) => records.next(bytes, ended),
        }
    }

    pub fn name(&self) -> &'static str {
        match self {
            PoseDecoder::Unknown(_) => "nothing",
            PoseDecoder::Text(lines) => lines.name(),
            PoseDecoder::Binary(records) => records.name(),
        }
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

/// Detects by content: text has no control characters, TerraScan begins with its name, and the first record of an SBET
/// is plausible.
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
    if looks_like_sbet(start) {
        return Detection::Sbet;
    }
    Detection::Unsupported(if start.starts_with(&[0xff, 0xfe]) || start.starts_with(&[0xfe, 0xff]) {
        "convert UTF-16 first: iconv -f UTF-16 -t UTF-8"
    } else {
        "say what it is with --trajectory-format"
    })
}

/// All poses of a file in a binary format; `None` for text.
pub(in crate::platform) fn read_binary(
    path: &Path,
    bytes: &[u8],
    frame: &mut Georeference,
) -> Option<std::result::Result<Vec<Pose>, Diagnostics>> {
    let mut decoder = PoseDecoder::new(&PoseStream::at(path));
    let (mut poses, mut start) = (Vec::new(), 0);
    loop {
        let next = decoder.next(&bytes[start..], true);
        if !matches!(decoder, PoseDecoder::Binary(_)) {
            return None;
        }
        match next {
            Decoded::Incomplete => return Some(Ok(poses)),
            Decoded::Skipped(count) => start += count,
            Decoded::Fix(count, fix, place) => {
                start += count;
                match frame.pose(&fix) {
                    Ok(pose) => poses.push(pose),
                    Err(error) => return Some(Err(place.error(path, error))),
                }
            }
            Decoded::Invalid(place, error) => return Some(Err(place.error(path, error))),
        }
    }
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
