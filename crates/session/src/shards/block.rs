//! Blocks: batches as bytes.
//!
//! ```text
//! 0    magic
//! 8    words of the head, u64 each: leg, epoch, number of the leg in records, pulses emitted, numbers of
//!      echoes, truths, waveforms, samples, pulse records and poses, length of the columns, checksum of the
//!      bytes before it and of the columns
//! 104  columns of echoes, truths, waveforms, samples, pulse records, poses; if they are recorded, of the
//!      velocities of all truths
//! ```

use super::column::{Words, get_records, put_records, words};
use serde::{Deserialize, Serialize};
use vlscan_geom::DVec3;
use vlscan_lidar::flight::PoseSample;
use vlscan_lidar::pulse::{Batch, Echo, EchoPath, EchoTruth, EchoVelocity, PulseRecord, WaveformRecord};
use xxhash_rust::xxh3::Xxh3;

/// Bytes of a block's head.
const HEAD_BYTES: usize = 104;

const MAGIC: &[u8; 8] = b"VLBLOCK\n";
/// Number of the leg of batches whose records have that of the survey's leg.
const NO_LEG_NUMBER: u32 = u32::MAX;

words! {
    Echo by convert_position {
        position, origin, direction, scanner, range, true_range, intensity, echo_width, return_number,
        number_of_returns, pulse_number, device, part, primitive, classification, incidence_cosine,
        scan_angle, time_ns, truth_index,
    }
    WaveformRecord {
        pulse_number, device, origin, direction, start_ns, end_ns, time_ns, first_sample, samples,
    }
    EchoVelocity { radial, spread }
    PulseRecord { origin, direction, time_ns, number, device, scan_angle }
    PoseSample { time_ns, position, roll, pitch, yaw, attitude, flown }
    BlockHead {
        leg, epoch, leg_number, pulses, echoes, truths, waveforms, samples, pulse_records, poses, length, sum,
    }
}

impl Words for EchoTruth {
    fn put(self, put: &mut impl FnMut(u64)) {
        let EchoTruth { beam, surface, normal, fraction, subray, path, colour } = self;
        beam.put(put);
        surface.put(put);
        normal.put(put);
        fraction.put(put);
        // A number of 32 bits leaves the other bits of its word to the path, which mostly is 0.
        put(u64::from(path.code()) << 32 | u64::from(subray));
        let [red, green, blue] = colour;
        put(u32::from_le_bytes([red, green, blue, 0]).into());
    }

    fn take(next: &mut impl FnMut() -> u64) -> EchoTruth {
        let (beam, surface) = (Words::take(next), Words::take(next));
        let (normal, fraction, word) = (Words::take(next), Words::take(next), next());
        let path = EchoPath::of_code((word >> 32) as u16);
        let [red, green, blue, _] = (next() as u32).to_le_bytes();
        let colour = [red, green, blue];
        EchoTruth { beam, surface, normal, fraction, subray: word as u32, path, colour }
    }
}

/// Replaces the position by the bits in which it differs from that which the measurement computes, and these
/// bits by the position. They are all 0 unless another origin or direction was reported than that of the
/// pulse.
fn convert_position(echo: Echo) -> Echo {
    let computed = echo.origin + echo.direction * echo.range;
    let differing = |axis: usize| f64::from_bits(echo.position[axis].to_bits() ^ computed[axis].to_bits());
    Echo { position: DVec3::from([0, 1, 2].map(differing)), ..echo }
}

/// The sizes of a block's records.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct BlockHead {
    /// Index of the leg, from 0.
    pub leg: u32,
    /// Index of the epoch, from 0.
    pub epoch: u32,
    leg_number: u32,
    /// Pulses emitted.
    pub pulses: u32,
    /// Echoes recorded.
    pub echoes: u32,
    truths: u32,
    waveforms: u32,
    samples: usize,
    pulse_records: u32,
    poses: u32,
    /// Bytes of the columns.
    pub length: u64,
    sum: u64,
}

impl BlockHead {
    fn bytes(&self) -> Vec<u8> {
        let mut bytes = MAGIC.to_vec();
        self.put(&mut |word| bytes.extend(word.to_le_bytes()));
        bytes
    }

    /// Reads a head; `None` if the bytes are not the head of a block.
    pub fn read(bytes: &[u8]) -> Option<BlockHead> {
        let words = bytes.get(..HEAD_BYTES)?.strip_prefix(MAGIC)?;
        let mut words = words.as_chunks().0.iter().map(|word| u64::from_le_bytes(*word));
        let head = BlockHead::take(&mut || words.next().unwrap_or_default());
        // Numbers of fewer bits are stored in words, too.
        (head.bytes() == bytes[..HEAD_BYTES]).then_some(head)
    }

    /// Bytes of the block with this head.
    pub(super) fn bytes_of_block(&self) -> usize {
        HEAD_BYTES.saturating_add(self.length as usize)
    }

    /// True if `bytes` are a block with this head that is not damaged.
    pub(super) fn is_of(&self, bytes: &[u8]) -> bool {
        bytes.split_at_checked(HEAD_BYTES).is_some_and(|(head, columns)| {
            head == self.bytes() && columns.len() as u64 == self.length && self.checksum(columns) == self.sum
        })
    }

    fn checksum(&self, columns: &[u8]) -> u64 {
        let mut sum = Xxh3::new();
        sum.update(&self.bytes()[..HEAD_BYTES - 8]);
        sum.update(columns);
        sum.digest()
    }
}

/// Appends a batch as a block.
pub fn encode(batch: &Batch, out: &mut Vec<u8>) {
    let start = out.len();
    out.extend_from_slice(&[0; HEAD_BYTES]);
    put_records(out, &batch.echoes);
    put_records(out, &batch.truths);
    put_records(out, &batch.waveforms);
    put_records(out, &batch.samples);
    put_records(out, &batch.pulses);
    put_records(out, &batch.poses);
    if !batch.velocities.is_empty() {
        let mut all = batch.velocities.clone();
        all.resize(batch.truths.len(), EchoVelocity::UNKNOWN);
        put_records(out, &all);
    }
    let columns = start + HEAD_BYTES;
    let mut head = BlockHead {
        leg: batch.leg,
        epoch: batch.epoch,
        leg_number: batch.leg_number.unwrap_or(NO_LEG_NUMBER),
        pulses: batch.emitted,
        echoes: batch.echoes.len() as u32,
        truths: batch.truths.len() as u32,
        waveforms: batch.waveforms.len() as u32,
        samples: batch.samples.len(),
        pulse_records: batch.pulses.len() as u32,
        poses: batch.poses.len() as u32,
        length: (out.len() - columns) as u64,
        sum: 0,
    };
    head.sum = head.checksum(&out[columns..]);
    out[start..columns].copy_from_slice(&head.bytes());
}

/// Reads a block, whose head must be `head`, into a batch; `None` if it is damaged.
pub(super) fn decode(head: &BlockHead, block: &[u8], batch: &mut Batch) -> Option<()> {
    if !head.is_of(block) {
        return None;
    }
    batch.clear(head.leg);
    batch.epoch = head.epoch;
    batch.emitted = head.pulses;
    batch.leg_number = (head.leg_number != NO_LEG_NUMBER).then_some(head.leg_number);
    let columns = &block[HEAD_BYTES..];
    let columns = get_records(columns, &mut batch.echoes, head.echoes as usize)?;
    let columns = get_records(columns, &mut batch.truths, head.truths as usize)?;
    let columns = get_records(columns, &mut batch.waveforms, head.waveforms as usize)?;
    let columns = get_records(columns, &mut batch.samples, head.samples)?;
    let columns = get_records(columns, &mut batch.pulses, head.pulse_records as usize)?;
    let columns = get_records(columns, &mut batch.poses, head.poses as usize)?;
    let velocities = if columns.is_empty() { 0 } else { head.truths as usize };
    let columns = get_records(columns, &mut batch.velocities, velocities)?;
    columns.is_empty().then_some(())
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use vlscan_geom::Rotation;

    /// A batch with records of every kind, some of whose values are equal and some not numbers.
    pub fn batch(epoch: u32, leg: u32, count: u32) -> Batch {
        let mut batch =
            Batch { epoch, leg, emitted: count, leg_number: (leg == 3).then_some(7), ..Batch::default() };
        for i in 0..count {
            let x = f64::from(i);
            let pulse = PulseRecord {
                origin: DVec3::ZERO,
                direction: DVec3::ZERO,
                time_ns: 0.0,
                number: u64::from(i),
                device: 0,
                scan_angle: 0.0,
            };
            batch.echoes.push(Echo {
                position: DVec3::new(x, -0.0, f64::NAN),
                range: f64::from_bits(0x7ff8_0000_0000_0001 + u64::from(i)),
                pulse_number: u64::MAX - u64::from(i),
                classification: -(i as i32),
                part: 7 + i % 200,
                primitive: i * 100,
                return_number: i << 23,
                ..Echo::miss(&pulse)
            });
            batch.truths.push(EchoTruth {
                beam: [DVec3::X * x, DVec3::Z],
                subray: i,
                path: EchoPath::of_code([0, 0x0201, 0x0102][i as usize % 3]),
                colour: [i as u8, 255, 7],
                ..EchoTruth::unknown([DVec3::ZERO; 2])
            });
            if leg == 3 {
                batch.velocities.push(EchoVelocity { radial: x - 7.5, spread: f64::NAN });
            }
            batch.waveforms.push(WaveformRecord {
                pulse_number: 0,
                device: 0,
                origin: DVec3::ZERO,
                direction: DVec3::ZERO,
                start_ns: x,
                end_ns: 0.0,
                time_ns: 0.0,
                first_sample: batch.samples.len(),
                samples: 2,
            });
            batch.samples.extend([x, f64::INFINITY]);
            batch.pulses.push(pulse);
            let turned = Rotation::about_z(x);
            batch.poses.push(PoseSample {
                time_ns: 0.0,
                position: DVec3::ZERO,
                roll: 0.0,
                pitch: 0.0,
                yaw: 0.0,
                attitude: turned,
                flown: (DVec3::Y * x, turned),
            });
        }
        batch
    }

    #[test]
    fn batches_come_back_bit_for_bit() {
        for batch in [batch(0, 0, 0), batch(1, 3, 1), batch(2, 1, 500)] {
            let mut bytes = vec![1, 2, 3];
            encode(&batch, &mut bytes);
            let head = BlockHead::read(&bytes[3..]).unwrap();
            let mut read = self::batch(9, 9, 3);
            decode(&head, &bytes[3..], &mut read).unwrap();
            // -0 and infinity have a different debug representation; NaNs are compared below.
            assert_eq!(format!("{read:?}"), format!("{batch:?}"));
            let bits = |b: &Batch| b.echoes.iter().map(|e| e.range.to_bits()).collect::<Vec<_>>();
            assert_eq!(bits(&read), bits(&batch));
        }
    }

    #[test]
    fn positions_take_no_bytes_where_they_follow() {
        let mut batch = Batch { emitted: 3, ..Batch::default() };
        for i in 0..3 {
            let (origin, direction, range) =
                (DVec3::new(0.1, 0.2, 0.3), DVec3::new(0.6, -0.8, 0.0), 10.0 / f64::from(3 + i));
            let position = origin + direction * range;
            let other = self::batch(0, 0, 1).echoes[0];
            batch.echoes.push(Echo { origin, direction, range, position, ..other });
        }
        let bytes = |batch: &Batch| {
            let mut bytes = Vec::new();
            encode(batch, &mut bytes);
            let mut read = Batch::default();
            decode(&BlockHead::read(&bytes).unwrap(), &bytes, &mut read).unwrap();
            assert_eq!(format!("{read:?}"), format!("{batch:?}"));
            bytes.len()
        };
        let derived = bytes(&batch);
        batch.echoes[1].position.y = -batch.echoes[1].position.y;
        assert_eq!(bytes(&batch), derived + 3 * 8);
    }

    #[test]
    fn any_changed_byte_is_found() {
        let (batch, mut bytes) = (batch(1, 2, 20), Vec::new());
        encode(&batch, &mut bytes);
        let (head, mut read) = (BlockHead::read(&bytes).unwrap(), Batch::default());
        let mut decode = |bytes: &[u8]| decode(&head, bytes, &mut read);
        for at in 0..bytes.len() {
            bytes[at] ^= 8;
            assert!(decode(&bytes).is_none(), "byte {at}");
            bytes[at] ^= 8;
        }
        assert!(decode(&bytes[..bytes.len() - 1]).is_none());
        assert!(decode(&bytes).is_some());
    }
}
