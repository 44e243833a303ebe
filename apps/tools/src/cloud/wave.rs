//! Reads the waveform of one pulse from a file of waveforms (spec outputs §6).

use flate2::bufread::MultiGzDecoder;
use std::io::{self, BufRead, BufReader, Read};
use std::path::Path;
use vlscan_base::diag::{Diagnostics, Place};
use vlscan_base::error::{Error, Result};
use vlscan_base::recognise::{Expected, foreign};
use vlscan_geom::DVec3;

/// The recorded waveform of a pulse.
#[derive(Clone, Debug, PartialEq)]
pub struct Wave {
    /// Pulse number of its device.
    pub pulse: u64,
    /// Origin of the pulse, m.
    pub origin: DVec3,
    /// Direction of the pulse, a unit vector.
    pub direction: DVec3,
    /// One-way travel time of the first sample, ns.
    pub start: f64,
    /// One-way travel time of the last sample, ns.
    pub end: f64,
    /// Emission time, s.
    pub gps_time: f64,
    /// Amplitudes at equal intervals of time.
    pub samples: Vec<f64>,
    /// Number of further waveforms of this pulse, from other channels.
    pub duplicates: u64,
}

impl Wave {
    /// Time between samples, ns.
    pub fn interval(&self) -> f64 {
        (self.end - self.start) / (self.samples.len().max(2) - 1) as f64
    }
}

/// Columns before the samples.
const FIXED_COLUMNS: usize = 10;
/// Maximum length of a line, bytes.
const MAX_LINE_BYTES: u64 = 1 << 28;

/// Finds the waveform of pulse `number`, from the first channel that has one.
///
/// # Errors
/// [`Error::Input`] when a line is not a waveform, with its place, or when the pulse is missing, with the
/// nearest pulses.
pub fn read_wave(source: impl Read, path: &Path, number: u64) -> Result<Wave> {
    let mut source = BufReader::with_capacity(1 << 20, source);
    // gzip (RFC 1952) is recognised by its first two bytes.
    let first = source.fill_buf().map_err(|e| Error::io("read", path, e))?;
    let packed = first.starts_with(&[0x1f, 0x8b]);
    if let Some(found) = foreign(path, first, &Expected::WAVEFORMS).filter(|_| !packed) {
        return Err(found.error(path));
    }
    if packed {
        find(BufReader::new(MultiGzDecoder::new(source)), path, number)
    } else {
        find(source, path, number)
    }
}

fn find(mut source: impl BufRead, path: &Path, number: u64) -> Result<Wave> {
    let mut found: Option<Wave> = None;
    let mut near = NearestPulses::default();
    let mut line = Vec::new();
    for count in 1.. {
        line.clear();
        let read = source.by_ref().take(MAX_LINE_BYTES).read_until(b'\n', &mut line);
        if read.map_err(|e| damaged(path, e))? == 0 {
            break;
        }
        let text = String::from_utf8_lossy(&line);
        let Some(first) = text.split_ascii_whitespace().next() else { continue };
        let pulse =
            first.parse::<u64>().map_err(|_| wrong(path, count, &text, first, "the number of a pulse"))?;
        near.see(pulse, number);
        if pulse == number {
            match &mut found {
                Some(wave) => wave.duplicates += 1,
                None => found = Some(wave(path, count, &text, pulse)?),
            }
        }
    }
    found.ok_or_else(|| Error::input(near.advice(path, number)))
}

fn damaged(path: &Path, error: io::Error) -> Error {
    match error.kind() {
        io::ErrorKind::InvalidInput | io::ErrorKind::InvalidData | io::ErrorKind::UnexpectedEof => {
            Error::input(format!("{}: the compressed text is damaged: {error}", path.display()))
        }
        _ => Error::io("read", path, error),
    }
}

fn wave(path: &Path, count: usize, text: &str, pulse: u64) -> Result<Wave> {
    let mut numbers = Vec::new();
    for field in text.split_ascii_whitespace() {
        let number = field.parse::<f64>().ok().filter(|v| v.is_finite());
        numbers.push(number.ok_or_else(|| wrong(path, count, text, field, "a number"))?);
    }
    if numbers.len() <= FIXED_COLUMNS {
        let message =
            "ten numbers (pulse, origin, direction, first and last time, GPS time) and then samples";
        return Err(wrong(path, count, text, "", message));
    }
    let vector = |at: usize| DVec3::new(numbers[at], numbers[at + 1], numbers[at + 2]);
    Ok(Wave {
        pulse,
        origin: vector(1),
        direction: vector(4),
        start: numbers[7],
        end: numbers[8],
        gps_time: numbers[9],
        samples: numbers.split_off(FIXED_COLUMNS),
        duplicates: 0,
    })
}

/// The error about a line that is not a waveform.
fn wrong(path: &Path, count: usize, text: &str, found: &str, expected: &str) -> Error {
    let excerpt: String = text.trim_end().chars().take(120).collect();
    let start = if found.is_empty() {
        excerpt.len()
    } else {
        (found.as_ptr() as usize).saturating_sub(text.as_ptr() as usize)
    };
    let marked = if start + found.len() <= excerpt.len() { start..start + found.len() } else { 0..0 };
    let mut problems = Diagnostics::default();
    let what = if found.is_empty() {
        "the end of the line".to_owned()
    } else {
        format!("{:?}", found.chars().take(40).collect::<String>())
    };
    problems.error(
        Some(Place::in_line(path, count, &excerpt, marked)),
        format!("expected {expected}, found {what}"),
    );
    Error::Input(Box::new(problems))
}

/// The numbers of the pulses nearest to a missing one, for the message.
#[derive(Default)]
pub(super) struct NearestPulses {
    lines: u64,
    below: Option<u64>,
    above: Option<u64>,
}

impl NearestPulses {
    pub(super) fn see(&mut self, pulse: u64, wanted: u64) {
        self.lines += 1;
        if pulse < wanted {
            self.below = self.below.max(Some(pulse));
        } else if pulse > wanted {
            self.above = Some(self.above.map_or(pulse, |a| a.min(pulse)));
        }
    }

    pub(super) fn advice(&self, path: &Path, wanted: u64) -> String {
        let near: Vec<String> =
            [self.below, self.above].into_iter().flatten().map(|n| n.to_string()).collect();
        if near.is_empty() {
            return format!("{} holds no waveforms", path.display());
        }
        format!(
            "{} has no waveform of pulse {wanted} (only pulses with an echo have one); nearest: {}",
            path.display(),
            near.join(", ")
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;

    const TEXT: &str = "1 0 0 300 0 0 -1 955.0 955.75 86391.5 0.0 1.0 0.5 0.1\n\
                        7 1 2 300 0 0.6 -0.8 900 901 86391.6 0 1 0\n7 1 2 300 0 0.6 -0.8 900 901 86391.6 0 2 0\n";

    fn read(text: &[u8], number: u64) -> Result<Wave> {
        read_wave(text, Path::new("w.txt"), number)
    }

    #[test]
    fn a_pulse_is_found_in_text_and_in_gzip() {
        let mut gzip = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
        gzip.write_all(TEXT.as_bytes()).unwrap();
        for bytes in [TEXT.as_bytes().to_vec(), gzip.finish().unwrap()] {
            let wave = read(&bytes, 1).unwrap();
            assert_eq!((wave.samples.len(), wave.interval(), wave.duplicates), (4, 0.25, 0));
            let wave = read(&bytes, 7).unwrap();
            assert_eq!((wave.direction.y, wave.samples[1], wave.duplicates), (0.6, 1.0, 1));
        }
    }

    #[test]
    fn what_is_wrong_is_said() {
        for (text, number, expected) in [
            (TEXT, 5, "nearest: 1, 7"),
            ("", 5, "no waveforms"),
            ("5 0 0 300 0 0 -1 955.0 955.75\n", 5, "and then samples"),
            ("x 1 2\n", 5, "the number of a pulse, found \"x\""),
            ("5 0 0 300 0 0 -1 955.0 955.75 1 0 nan\n", 5, "a number, found \"nan\""),
        ] {
            let Err(Error::Input(report)) = read(text.as_bytes(), number) else {
                panic!("{text:?} is accepted")
            };
            assert!(report.text().contains(expected), "{}", report.text());
        }
        assert!(matches!(read(&[0x1f, 0x8b, 8, 0, 1, 2], 1), Err(Error::Input(_))));
        assert!(matches!(read(&[0xff; 1000], 1), Err(Error::Input(_))));
    }
}
