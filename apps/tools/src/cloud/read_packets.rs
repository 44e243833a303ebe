//! Reads the waveform of one pulse from the wave packets of LAS and LAZ files (LAS 1.4 R15, point formats 4,
//! 5, 9 and 10).

use super::wave::{NearestPulses, Wave};
use std::io::{Read, Seek, SeekFrom};
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use vlscan_base::diag::ProblemKind;
use vlscan_base::error::{Error, Result};
use vlscan_base::files::reads;
use vlscan_base::store::FileBytes;
use vlscan_formats::{LasError, LasReader, Selection};
use vlscan_geom::DVec3;

/// Speed of light, m/ns.
const C: f64 = 0.299792458;
/// Maximum size of a packet, bytes.
const MAX_PACKET_BYTES: u32 = 1 << 28;

/// Finds the packet of pulse `number`; the extra dimension `fullwaveIndex` of the points holds the numbers of
/// pulses.
///
/// # Errors
/// [`Error::Input`] when the file has no packets or none of that pulse; the message lists the nearest pulses.
pub fn read_packet(path: &Path, number_wanted: u64) -> Result<Wave> {
    let file = FileBytes::open(path).map_err(|e| Error::open(path, e))?;
    let unusable = |problem: String| Error::input(format!("{}: {problem}", path.display()));
    let failed = |problem: LasError| Error::caused_by(format!("{}: {problem}", path.display()), problem);
    let mut reader = LasReader::open(&file, Selection::All).map_err(failed)?;
    let format = reader.header.format;
    let Some((packet_at, time_at)) = place(format) else {
        return Err(unusable(format!(
            "its points have no waveform packets (format {format}); write them with --wave-packets inside"
        )));
    };
    let dimensions = reader.extra_dimensions().map_err(failed)?;
    let dimension = |wanted: &str| dimensions.iter().find(|(name, _)| name == wanted).map(|(_, d)| *d);
    let Some(index) = dimension("fullwaveIndex") else {
        return Err(unusable(
            "its pulses cannot be distinguished: it has no dimension fullwaveIndex".to_owned(),
        ));
    };
    let range = dimension("range");
    let (mut near, mut found): (NearestPulses, Option<(Packet, Echo)>) = (NearestPulses::default(), None);
    let mut duplicates = 0;
    let mut more = true;
    while more {
        more = reader
            .read_records(|record, position| {
                // Files store the low 32 bits of the number.
                let Some(pulse) = index.value(record).map(|pulse| pulse as i64 as u32) else {
                    return ControlFlow::Continue(());
                };
                near.see(u64::from(pulse), number_wanted);
                if u64::from(pulse) != number_wanted & u64::from(u32::MAX) {
                    return ControlFlow::Continue(());
                }
                let Some(packet) = Packet::of(record, packet_at) else { return ControlFlow::Continue(()) };
                match &found {
                    Some((first, _)) => duplicates += u64::from(*first != packet),
                    None => {
                        let range = range.and_then(|dimension| dimension.value(record));
                        let gps_time = f64_at(record, time_at).unwrap_or(0.0);
                        found = Some((packet, Echo { position, range, gps_time }));
                    }
                }
                ControlFlow::Continue(())
            })
            .map_err(failed)?;
    }
    file.check_unchanged().map_err(|e| Error::io("read", path, e))?;
    let (packet, echo) = found.ok_or_else(|| Error::input(near.advice(path, number_wanted)))?;
    let wave = packet.wave(number_wanted, &echo, &reader, path)?;
    Ok(Wave { duplicates, ..wave })
}

/// The first point of the pulse.
struct Echo {
    position: DVec3,
    range: Option<f64>,
    gps_time: f64,
}

/// Offsets of the packet reference and of the GPS time in a record.
fn place(format: u8) -> Option<(usize, usize)> {
    match format {
        4 => Some((28, 20)),
        5 => Some((34, 20)),
        9 => Some((30, 22)),
        10 => Some((38, 22)),
        _ => None,
    }
}

/// The packet reference of a point.
#[derive(Clone, Copy, Debug)]
struct Packet {
    descriptor: u8,
    offset: u64,
    bytes: u32,
    /// Time from the first sample to the return, ps.
    location: f64,
    /// Direction towards the scanner, m/ps.
    step: DVec3,
}

impl PartialEq for Packet {
    fn eq(&self, other: &Packet) -> bool {
        (self.descriptor, self.offset) == (other.descriptor, other.offset)
    }
}

impl Packet {
    /// The reference in a record, if the point has a packet.
    fn of(record: &[u8], at: usize) -> Option<Packet> {
        let field = record.get(at..at + 29)?;
        let float = |at: usize| Some(f64::from(f32::from_le_bytes(field.get(at..at + 4)?.try_into().ok()?)));
        let packet = Packet {
            descriptor: field[0],
            offset: u64::from_le_bytes(field.get(1..9)?.try_into().ok()?),
            bytes: u32::from_le_bytes(field.get(9..13)?.try_into().ok()?),
            location: float(13)?,
            step: DVec3::new(float(17)?, float(21)?, float(25)?),
        };
        (packet.descriptor != 0).then_some(packet)
    }

    fn wave(&self, pulse: u64, echo: &Echo, file: &LasReader, path: &Path) -> Result<Wave> {
        let wrong = |what: &str| Error::input(format!("{}: {what}", path.display()));
        let id = 99 + u16::from(self.descriptor);
        let data = file.variable_record("LASF_Spec", id).map_err(|problem| wrong(&problem.to_string()))?;
        let data = data.filter(|data| data.len() >= 26);
        let data = data.ok_or_else(|| wrong("the points refer to a missing packet descriptor"))?;
        let bits = usize::from(data[0]);
        if data[1] != 0 || !matches!(bits, 8 | 16 | 32) {
            return Err(wrong(
                "these waveform packets are not supported (compressed, or an odd number of bits)",
            ));
        }
        let spacing = f64::from(u32::from_le_bytes([data[6], data[7], data[8], data[9]]));
        let (gain, zero) = (f64_at(data, 10).unwrap_or(1.0), f64_at(data, 18).unwrap_or(0.0));
        let bytes = self.bytes(path)?;
        let raw = bytes.chunks_exact(bits / 8).map(|sample| {
            let mut sample_bytes = [0; 4];
            sample_bytes[..sample.len()].copy_from_slice(sample);
            f64::from(u32::from_le_bytes(sample_bytes))
        });
        let mut samples: Vec<f64> = raw.map(|sample| zero + gain * sample).collect();
        // Packets are padded with zeros to the length given in their descriptor.
        while samples.len() > 2 && samples.last() == Some(&0.0) {
            samples.pop();
        }
        let metres = self.step.length() * spacing;
        if samples.is_empty() || spacing <= 0.0 || !(metres > 0.0 && metres.is_finite()) {
            return Err(wrong("a waveform packet without samples or without a direction"));
        }
        let direction = -self.step / self.step.length();
        let bin = metres / C;
        // Without a range, the first sample is the origin of time.
        let before = self.location / spacing * bin;
        let range = echo.range.unwrap_or(before * C);
        let start = range / C - before;
        let end = start + (samples.len() - 1) as f64 * bin;
        let origin = echo.position - direction * range;
        Ok(Wave { pulse, origin, direction, start, end, gps_time: echo.gps_time, samples, duplicates: 0 })
    }

    /// Reads the packet from this file or from the `.wdp` file beside it.
    fn bytes(&self, path: &Path) -> Result<Vec<u8>> {
        let failed = |path: &Path| {
            let path = path.to_path_buf();
            move |e: std::io::Error| match e.kind() {
                std::io::ErrorKind::UnexpectedEof => {
                    Error::input(format!("{} ends before the waveform packet", path.display()))
                }
                std::io::ErrorKind::NotFound => {
                    let message = format!("{} with the waveform packets is missing", path.display());
                    Error::input_of(ProblemKind::NotFound, message)
                }
                _ => Error::io("read", path.clone(), e),
            }
        };
        if self.bytes > MAX_PACKET_BYTES {
            return Err(Error::input(format!("{}: a packet of {} bytes", path.display(), self.bytes)));
        }
        let mut file = reads::open(path).map_err(failed(path))?;
        let mut head = [0; 235];
        file.read_exact(&mut head).map_err(failed(path))?;
        let encoding = u16::from_le_bytes([head[6], head[7]]);
        let mut start = [0; 8];
        start.copy_from_slice(&head[227..235]);
        let mut start = u64::from_le_bytes(start);
        let mut home = path.to_path_buf();
        // Global encoding: bit 1 means within the file, bit 2 in a file beside it.
        if encoding & 4 != 0 || start == 0 {
            (home, start) = (beside(path), 0);
            file = reads::open(&home).map_err(failed(&home))?;
        }
        let mut bytes = Vec::new();
        file.seek(SeekFrom::Start(start.saturating_add(self.offset)))
            .and_then(|_| file.take(u64::from(self.bytes)).read_to_end(&mut bytes))
            .map_err(failed(&home))?;
        if bytes.len() < self.bytes as usize {
            return Err(failed(&home)(std::io::ErrorKind::UnexpectedEof.into()));
        }
        Ok(bytes)
    }
}

fn beside(path: &Path) -> PathBuf {
    path.with_extension("wdp")
}

fn f64_at(bytes: &[u8], at: usize) -> Option<f64> {
    Some(f64::from_le_bytes(bytes.get(at..at + 8)?.try_into().ok()?))
}
