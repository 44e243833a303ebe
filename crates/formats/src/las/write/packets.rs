//! Waveforms as packets of LAS 1.4: point data record format 9, whose points refer to the packet of their
//! pulse.
//!
//! A packet is one waveform of 16-bit samples, with the number of samples given by its descriptor. There are
//! at most 255 descriptors, and the header that lists them precedes the first point, while lengths and
//! amplitudes are known only after simulation. The descriptors therefore form a grid over all lengths and
//! amplitudes that can occur: for each bin width, lengths that grow by a constant factor (a packet is padded
//! with samples of amplitude 0) and gains that grow by a factor of sixteen.

use super::format::LasFormat;
use super::vlr::{fixed_text, record};
use crate::las::PacketPlace;
use crate::record::{EncodedPoints, Packet, PointBatch, PointRecord, Wave};
use vlscan_base::diag::Diagnostics;

/// Number of gains: 2^(−44), 2^(−40), … 2^12.
const GAINS: usize = 15;
/// Binary logarithm of the smallest gain, and of the factor between gains.
const GAIN_LOG: (i32, i32) = (-44, 4);
/// Sample value of amplitude 0; lower values represent noise below 0.
const ZERO: f64 = 16_384.0;
/// Maximum number of descriptors that the format allows.
const MAX_DESCRIPTORS: usize = 255;
/// Samples of the shortest and of the longest packet.
const LENGTHS: (f64, f64) = (16.0, 16_777_216.0);
/// Bytes of a point's reference to its packet.
const FIELD_BYTES: usize = 29;
/// Bytes of the header before the first packet.
pub const PACKETS_HEADER_BYTES: u64 = 60;

/// Mapping of waveforms to packets.
#[derive(Debug)]
pub(in crate::las) struct WavePackets {
    pub place: PacketPlace,
    /// Bin widths, ns.
    bins: Vec<f64>,
    /// Index of the bin width by device.
    by_device: Vec<usize>,
    /// Numbers of samples of the packets of one bin width, ascending.
    lengths: Vec<u32>,
    /// Metres of range per nanosecond of the times of waveforms.
    metres_per_ns: f64,
}

impl WavePackets {
    /// Computes the grid of descriptors. Returns `None`, with an error in `problems`, when the scanner has
    /// too many bin widths.
    pub fn new(
        place: PacketPlace,
        bins_ns: &[f64],
        metres_per_ns: f64,
        problems: &mut Diagnostics,
    ) -> Option<WavePackets> {
        let mut bins: Vec<f64> = Vec::new();
        let mut by_device = Vec::new();
        for &bin in bins_ns {
            by_device.push(bins.iter().position(|b| *b == bin).unwrap_or(bins.len()));
            if !bins.contains(&bin) {
                bins.push(bin);
            }
        }
        let steps = MAX_DESCRIPTORS / GAINS / bins.len().max(1);
        if steps < 2 {
            let max_bins = MAX_DESCRIPTORS / GAINS / 2;
            problems.error(
                None,
                format!("waveform packets: expected at most {max_bins} widths of bins, found {}", bins.len()),
            );
            return None;
        }
        let growth = libm::pow(LENGTHS.1 / LENGTHS.0, 1.0 / (steps - 1) as f64);
        let length = |step: usize| (LENGTHS.0 * libm::pow(growth, step as f64)).round() as u32;
        let lengths = (0..steps).map(length).collect();
        Some(WavePackets { place, bins, by_device, lengths, metres_per_ns })
    }

    /// Returns the variable length records of the descriptors.
    pub fn descriptors(&self) -> impl Iterator<Item = Vec<u8>> {
        let all = self.bins.iter().flat_map(|&bin| {
            let lengths = self.lengths.iter();
            lengths.flat_map(move |&length| (0..GAINS).map(move |step| (bin, length, gain(step))))
        });
        all.zip(100u16..).map(|((bin, length, gain), id)| {
            let mut data = Vec::with_capacity(26);
            // Bits per sample, compression
            data.extend([16, 0]);
            // Number of samples
            data.extend(length.to_le_bytes());
            // Temporal sample spacing, ps
            data.extend(spacing(bin).to_le_bytes());
            // Digitizer gain and offset
            data.extend(gain.to_le_bytes());
            data.extend((-ZERO * gain).to_le_bytes());
            record("LASF_Spec", id, "waveform packets", &data)
        })
    }

    /// Appends the samples of a waveform. Returns its packet.
    pub(super) fn push(&self, out: &mut Vec<u8>, wave: &Wave) -> Option<Packet> {
        let samples = wave.samples;
        let bin = *self.by_device.get(wave.device as usize)?;
        let step = self.lengths.iter().position(|&length| samples.len() <= length as usize)?;
        let length = *self.lengths.get(step)? as usize;
        let fits = |gain: f64| {
            let (min, max) = (-(ZERO + 0.5) * gain, (f64::from(u16::MAX) - ZERO + 0.5) * gain);
            samples.iter().all(|&s| min < s && s < max)
        };
        let exponent = (0..GAINS).find(|&exponent| fits(gain(exponent))).unwrap_or(GAINS - 1);
        let scale = 1.0 / gain(exponent);
        let (offset, bytes) = (out.len() as u64, 2 * length);
        out.reserve(bytes);
        // The conversion to integers saturates.
        let digital = samples.iter().map(|s| (s * scale + ZERO).round_ties_even() as u16);
        digital.for_each(|sample| out.extend(sample.to_le_bytes()));
        (samples.len()..length).for_each(|_| out.extend((ZERO as u16).to_le_bytes()));
        let descriptor = 1 + (bin * self.lengths.len() + step) * GAINS + exponent;
        Some(Packet { descriptor: u8::try_from(descriptor).ok()?, offset, bytes: u32::try_from(bytes).ok()? })
    }

    /// Returns the point's reference to its packet.
    pub(super) fn field(&self, packet: Packet, wave: &Wave, point: &PointRecord) -> [u8; FIELD_BYTES] {
        let bin =
            self.by_device.get(wave.device as usize).and_then(|&b| self.bins.get(b)).copied().unwrap_or(1.0);
        let spacing = f64::from(spacing(bin));
        // Sample at which the echo was detected.
        let sample = (point.range / self.metres_per_ns - wave.start_ns) / bin;
        // Towards the scanner, metres per picosecond.
        let step = point.direction * (-self.metres_per_ns * bin / spacing);
        let mut field = [0; FIELD_BYTES];
        field[0] = packet.descriptor;
        field[1..9].copy_from_slice(&packet.offset.to_le_bytes());
        field[9..13].copy_from_slice(&packet.bytes.to_le_bytes());
        let parameters = [sample * spacing, step.x, step.y, step.z];
        for (four, value) in field[13..].chunks_exact_mut(4).zip(parameters) {
            four.copy_from_slice(&(value as f32).to_le_bytes());
        }
        field
    }
}

impl LasFormat {
    /// Encodes points with references to the packets of their pulses. All points of a pulse refer to the same
    /// packet.
    pub fn encode_with_packets(&self, packets: &WavePackets, batch: &PointBatch, out: &mut EncodedPoints) {
        let EncodedPoints { bytes, packets: data, tally, last_packet } = out;
        for point in batch.points {
            let mut field = [0; FIELD_BYTES];
            // Without a packet the descriptor is 0.
            if let Some(wave) = batch.waves.get(point.wave as usize) {
                if last_packet.is_none_or(|(last, _)| last != point.wave) {
                    *last_packet = packets.push(data, wave).map(|packet| (point.wave, packet));
                }
                if let Some((_, packet)) = last_packet {
                    field = packets.field(*packet, wave, point);
                }
            }
            let before = bytes.len();
            match self.push(bytes, point) {
                Some(stored) => {
                    let at = before + self.packet_offset();
                    bytes.splice(at..at, field);
                    tally.count_point(stored, point);
                }
                None => tally.left_out += 1,
            }
        }
    }
}

/// Adds `before`, the position of the first packet in its file, to the packet offsets of encoded points.
pub(super) fn place_packets(points: &mut [u8], (record_length, at): (u16, usize), before: u64) {
    for point in points.chunks_exact_mut(usize::from(record_length)) {
        let Some((descriptor, offset)) = point.get_mut(at..at + 9).and_then(<[u8]>::split_first_mut) else {
            return;
        };
        if *descriptor != 0 {
            let mut within = [0; 8];
            within.copy_from_slice(offset);
            offset.copy_from_slice(&(u64::from_le_bytes(within) + before).to_le_bytes());
        }
    }
}

fn gain(step: usize) -> f64 {
    libm::exp2(f64::from(GAIN_LOG.0 + GAIN_LOG.1 * step as i32))
}

/// Bin width in picoseconds as stored in descriptors. The direction parameters of the points compensate its
/// rounding error.
fn spacing(bin: f64) -> u32 {
    (bin * 1000.0).round().max(1.0) as u32
}

/// Returns the header before packets of `length` bytes: an extended variable length record, which separate
/// files have too.
pub fn packets_header(length: u64) -> Vec<u8> {
    let mut out = Vec::with_capacity(PACKETS_HEADER_BYTES as usize);
    // Reserved
    out.extend(0u16.to_le_bytes());
    // User ID
    out.extend(fixed_text::<16>("LASF_Spec"));
    // Record ID: waveform packet data
    out.extend(65_535u16.to_le_bytes());
    // Record length after header
    out.extend(length.to_le_bytes());
    // Description
    out.extend(fixed_text::<32>("waveform packets"));
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use vlscan_geom::{DVec3, LIGHT_SPEED};

    fn packets() -> WavePackets {
        let problems = &mut Diagnostics::default();
        WavePackets::new(PacketPlace::Inside, &[0.25, 0.25], LIGHT_SPEED, problems).unwrap()
    }

    fn wave(samples: &[f64]) -> Wave<'_> {
        Wave { device: 0, start_ns: 300.0, samples }
    }

    /// Returns the amplitudes of a packet as a reader computes them.
    fn decode(packets: &WavePackets, packet: Packet, bytes: &[u8]) -> Vec<f64> {
        let all: Vec<Vec<u8>> = packets.descriptors().collect();
        let vlr = &all[usize::from(packet.descriptor) - 1][54..];
        let f64_at = |at: usize| f64::from_le_bytes(vlr[at..at + 8].try_into().unwrap());
        let samples = u32::from_le_bytes(vlr[2..6].try_into().unwrap());
        assert_eq!(packet.bytes, 2 * samples);
        let bytes = &bytes[packet.offset as usize..][..packet.bytes as usize];
        let raw = bytes.chunks_exact(2).map(|b| f64::from(u16::from_le_bytes([b[0], b[1]])));
        raw.map(|raw| f64_at(18) + f64_at(10) * raw).collect()
    }

    #[test]
    fn every_length_and_amplitude_has_a_descriptor() {
        let packets = packets();
        assert!(packets.descriptors().count() <= MAX_DESCRIPTORS);
        let mut bytes = vec![1, 2, 3];
        for length in [1, 16, 17, 100, 5000] {
            for amplitude in [1e-9, 3e-5, 0.9, 1234.5, 2e8] {
                let samples: Vec<f64> =
                    (0..length).map(|i| amplitude * (libm::sin(i as f64).abs() - 0.03)).collect();
                let packet = packets.push(&mut bytes, &wave(&samples)).unwrap();
                let decoded = decode(&packets, packet, &bytes);
                assert!(decoded.len() >= length && decoded[length..].iter().all(|&s| s == 0.0));
                for (got, put) in decoded.iter().zip(&samples) {
                    assert!((got - put).abs() <= amplitude / 6000.0, "{got} for {put} of {amplitude}");
                }
            }
        }
    }

    #[test]
    fn a_point_refers_to_the_sample_of_its_range_in_times_of_one_way_and_of_both() {
        let point = PointRecord { range: 100.0, direction: DVec3::NEG_Z, ..PointRecord::default() };
        for metres in [LIGHT_SPEED, LIGHT_SPEED * 0.5] {
            let problems = &mut Diagnostics::default();
            let packets = WavePackets::new(PacketPlace::Inside, &[0.25], metres, problems).unwrap();
            let wave = Wave { start_ns: point.range / metres - 2.0, ..wave(&[1.0; 16]) };
            let packet = packets.push(&mut Vec::new(), &wave).unwrap();
            let field = packets.field(packet, &wave, &point);
            let f32_at = |at: usize| f32::from_le_bytes(field[at..at + 4].try_into().unwrap());
            // 2 ns behind the first sample, and from there towards the scanner.
            assert!((f32_at(13) - 2000.0).abs() < 0.1, "{}", f32_at(13));
            let per_ps = DVec3::new(f32_at(17).into(), f32_at(21).into(), f32_at(25).into());
            assert!((per_ps + point.direction * (metres * 1e-3)).length() < 1e-9, "{per_ps}");
        }
    }

    #[test]
    fn what_no_gain_holds_saturates() {
        let (packets, mut bytes) = (packets(), Vec::new());
        let packet = packets.push(&mut bytes, &wave(&[1e30, -1e30, 0.0])).unwrap();
        let decoded = decode(&packets, packet, &bytes);
        assert!(decoded[0] > 2e8 && decoded[1] < -6e7 && decoded[2] == 0.0, "{decoded:?}");
    }

    #[test]
    fn a_scanner_with_too_many_widths_of_bins_is_refused() {
        let bins: Vec<f64> = (1..=9).map(|i| f64::from(i) * 0.1).collect();
        let mut problems = Diagnostics::default();
        let mut new = |bins| WavePackets::new(PacketPlace::Inside, bins, LIGHT_SPEED, &mut problems);
        assert!(new(&bins).is_none() && new(&bins[..8]).is_some());
        assert_eq!(problems.items().len(), 1);
    }
}
