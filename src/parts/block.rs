//! Blocks: batches as bytes.
//!
//! ```text
//! 0    magic │ leg │ epoch │ number of the leg in records │ pulses emitted
//! 20   numbers of echoes, truths, waveforms, pulse records, poses, zero │ number of samples │ length of the columns
//! 56   checksum of the bytes before it and of the columns
//! 64   columns of echoes, truths, waveforms, samples, pulse records, poses
//! ```
//!
//! Where the part holds the records of a format instead of echoes and truths, these come first, after their length u64.

use super::column::{Value, columns};
use vlscan_geom::{DVec3, Rotation};
use vlscan_lidar::flight::PoseSample;
use vlscan_lidar::pulse::{Batch, Echo, EchoTruth, PulseRecord, WaveformRecord};
use xxhash_rust::xxh3::Xxh3;

/// Bytes of a block's head.
pub(super) const HEAD_BYTES: usize = 64;
/// Where records begin in a block that holds them.
pub(super) const RECORDS_AT: usize = HEAD_BYTES + 8;

const MAGIC: [u8; 4] = *b"BLK\n";
/// Number of the leg of batches whose records have that of the survey's leg.
const NO_LEG_NUMBER: u32 = u32::MAX;

columns!(put_echoes, get_echoes, Echo, [
    { .origin.x } { .origin.y } { .origin.z } { .direction.x } { .direction.y } { .direction.z } { .in_scanner } { .range } { .true_range } { .intensity } { .echo_width }
    { .return_number } { .number_of_returns } { .pulse_number } { .device } { .part } { .primitive }
    { .classification } { .incidence_cosine } { .scan_angle } { .time_ns } { .truth_index }
]);
columns!(put_stored_positions, get_stored_positions, Echo, [{ .position.x } { .position.y } { .position.z }]);
columns!(put_truths, get_truths, EchoTruth, [
    { .beam[0] } { .beam[1] } { .surface } { .normal } { .fraction } { .subray }
]);
columns!(put_waveforms, get_waveforms, WaveformRecord, [
    { .pulse_number } { .device } { .origin } { .direction } { .start_ns } { .end_ns } { .time_ns }
    { .first_sample } { .samples }
]);
columns!(put_pulses, get_pulses, PulseRecord, [
    { .origin } { .direction } { .time_ns } { .number } { .device } { .scan_angle }
]);
columns!(put_poses, get_poses, PoseSample, [
    { .time_ns } { .position } { .roll } { .pitch } { .yaw } { .attitude } { .flown.0 } { .flown.1 }
]);

/// Positions follow from origins, directions and ranges.
const DERIVED_POSITIONS: u8 = 0;
/// Columns of positions follow: another origin or direction was reported than that of the pulse.
const STORED_POSITIONS: u8 = 1;

/// The position as the measurement computes it.
fn derived_position(echo: &Echo) -> DVec3 {
    echo.origin + echo.direction * echo.range
}

fn put_positions(out: &mut Vec<u8>, echoes: &[Echo]) {
    if echoes.iter().all(|echo| echo.position.has_bits_of(derived_position(echo))) {
        return out.push(DERIVED_POSITIONS);
    }
    out.push(STORED_POSITIONS);
    put_stored_positions(out, echoes);
}

fn get_positions<'b>(bytes: &'b [u8], echoes: &mut [Echo]) -> Option<&'b [u8]> {
    let (kind, bytes) = bytes.split_first()?;
    match *kind {
        DERIVED_POSITIONS => {
            echoes.iter_mut().for_each(|echo| echo.position = derived_position(echo));
            Some(bytes)
        }
        STORED_POSITIONS => get_stored_positions(bytes, echoes),
        _ => None,
    }
}

/// The sizes of a block's records.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BlockHead {
    pub leg: u32,
    pub epoch: u32,
    leg_number: u32,
    /// Pulses emitted.
    pub pulses: u32,
    pub echoes: u32,
    truths: u32,
    waveforms: u32,
    pulse_records: u32,
    poses: u32,
    samples: u64,
    /// Bytes of the columns.
    pub length: u64,
    sum: u64,
}

impl BlockHead {
    fn bytes(&self) -> [u8; HEAD_BYTES] {
        let mut bytes = [0; HEAD_BYTES];
        bytes[..4].copy_from_slice(&MAGIC);
        let words = [
            self.leg,
            self.epoch,
            self.leg_number,
            self.pulses,
            self.echoes,
            self.truths,
            self.waveforms,
            self.pulse_records,
            self.poses,
        ];
        for (slot, word) in bytes[4..40].chunks_exact_mut(4).zip(words) {
            slot.copy_from_slice(&word.to_le_bytes());
        }
        for (slot, word) in bytes[40..64].chunks_exact_mut(8).zip([self.samples, self.length, self.sum]) {
            slot.copy_from_slice(&word.to_le_bytes());
        }
        bytes
    }

    /// Reads a head; `None` if the bytes are no head of a block.
    pub fn read(bytes: &[u8]) -> Option<BlockHead> {
        let bytes = bytes.get(..HEAD_BYTES).filter(|bytes| bytes.starts_with(&MAGIC))?;
        let word = |n: usize| u32::from_le_bytes([0, 1, 2, 3].map(|i| bytes[4 + 4 * n + i]));
        let long = |n: usize| u64::from_le_bytes([0, 1, 2, 3, 4, 5, 6, 7].map(|i| bytes[40 + 8 * n + i]));
        Some(BlockHead {
            leg: word(0),
            epoch: word(1),
            leg_number: word(2),
            pulses: word(3),
            echoes: word(4),
            truths: word(5),
            waveforms: word(6),
            pulse_records: word(7),
            poses: word(8),
            samples: long(0),
            length: long(1),
            sum: long(2),
        })
    }

    /// Whether `bytes` are a block with this head that is not damaged.
    pub(super) fn is_of(&self, bytes: &[u8]) -> bool {
        BlockHead::read(bytes).is_some_and(|head| head == *self)
            && bytes.len() as u64 == HEAD_BYTES as u64 + self.length
            && self.sum(&[&bytes[HEAD_BYTES..]]) == self.sum
    }

    fn sum(&self, columns: &[&[u8]]) -> u64 {
        let mut sum = Xxh3::new();
        sum.update(&self.bytes()[..HEAD_BYTES - 8]);
        columns.iter().for_each(|columns| sum.update(columns));
        sum.digest()
    }
}

/// Appends a batch as a block.
pub fn encode(batch: &Batch, out: &mut Vec<u8>) {
    let start = out.len();
    out.extend_from_slice(&[0; HEAD_BYTES]);
    put_echoes(out, &batch.echoes);
    put_positions(out, &batch.echoes);
    put_truths(out, &batch.truths);
    end_block(batch, batch.truths.len() as u32, start, out);
}

/// Appends a batch as a block, with the records of a format, which `put_records` appends, instead of echoes and truths.
pub fn encode_records(batch: &Batch, put_records: impl FnOnce(&mut Vec<u8>), out: &mut Vec<u8>) {
    let start = out.len();
    out.extend_from_slice(&[0; RECORDS_AT]);
    put_records(out);
    let length = (out.len() - start - RECORDS_AT) as u64;
    out[start + HEAD_BYTES..start + RECORDS_AT].copy_from_slice(&length.to_le_bytes());
    end_block(batch, 0, start, out);
}

/// Appends the records that every block holds, and completes the head of the block that begins at `start`.
fn end_block(batch: &Batch, truths: u32, start: usize, out: &mut Vec<u8>) {
    put_waveforms(out, &batch.waveforms);
    out.extend(batch.samples.iter().flat_map(|sample| sample.to_bits().to_le_bytes()));
    put_pulses(out, &batch.pulses);
    put_poses(out, &batch.poses);
    let columns = start + HEAD_BYTES;
    let mut head = BlockHead {
        leg: batch.leg,
        epoch: batch.epoch,
        leg_number: batch.leg_number.unwrap_or(NO_LEG_NUMBER),
        pulses: batch.emitted,
        echoes: batch.echoes.len() as u32,
        truths,
        waveforms: batch.waveforms.len() as u32,
        pulse_records: batch.pulses.len() as u32,
        poses: batch.poses.len() as u32,
        samples: batch.samples.len() as u64,
        length: (out.len() - columns) as u64,
        sum: 0,
    };
    head.sum = head.sum(&[&out[columns..]]);
    out[start..columns].copy_from_slice(&head.bytes());
}

/// A block as it is in a file.
pub(super) struct RawBlock<'a> {
    pub head: &'a [u8],
    /// The records that it holds instead of echoes and truths, after their length.
    pub records: Option<[&'a [u8]; 2]>,
    pub columns: &'a [u8],
}

/// Reads a block, whose head must be `head`, into a batch; `None` if it is damaged.
pub(super) fn decode(head: &BlockHead, block: &RawBlock, batch: &mut Batch) -> Option<()> {
    let [length, records] = block.records.unwrap_or_default();
    let bytes = length.len() + records.len() + block.columns.len();
    let is_sound = BlockHead::read(block.head)? == *head
        && bytes as u64 == head.length
        && head.sum(&[length, records, block.columns]) == head.sum;
    if !is_sound {
        return None;
    }
    batch.clear(head.leg);
    batch.epoch = head.epoch;
    batch.emitted = head.pulses;
    batch.leg_number = (head.leg_number != NO_LEG_NUMBER).then_some(head.leg_number);
    batch.waveforms.resize(head.waveforms as usize, BLANK_WAVEFORM);
    batch.pulses.resize(head.pulse_records as usize, BLANK_PULSE);
    batch.poses.resize(head.poses as usize, BLANK_POSE);
    let mut columns = block.columns;
    if block.records.is_none() {
        batch.echoes.resize(head.echoes as usize, BLANK_ECHO);
        batch.truths.resize(head.truths as usize, EchoTruth::unknown([DVec3::ZERO; 2]));
        columns = get_echoes(columns, &mut batch.echoes)?;
        columns = get_positions(columns, &mut batch.echoes)?;
        columns = get_truths(columns, &mut batch.truths)?;
    }
    let columns = get_waveforms(columns, &mut batch.waveforms)?;
    let (samples, columns) = columns.split_at_checked(usize::try_from(head.samples.checked_mul(8)?).ok()?)?;
    let sample =
        |bytes: &[u8]| f64::from_bits(u64::from_le_bytes([0, 1, 2, 3, 4, 5, 6, 7].map(|i| bytes[i])));
    batch.samples.extend(samples.chunks_exact(8).map(sample));
    let columns = get_pulses(columns, &mut batch.pulses)?;
    let columns = get_poses(columns, &mut batch.poses)?;
    columns.is_empty().then_some(())
}

const BLANK_PULSE: PulseRecord = PulseRecord {
    origin: DVec3::ZERO,
    direction: DVec3::ZERO,
    time_ns: 0.0,
    number: 0,
    device: 0,
    scan_angle: 0.0,
};

const BLANK_WAVEFORM: WaveformRecord = WaveformRecord {
    pulse_number: 0,
    device: 0,
    origin: DVec3::ZERO,
    direction: DVec3::ZERO,
    start_ns: 0.0,
    end_ns: 0.0,
    time_ns: 0.0,
    first_sample: 0,
    samples: 0,
};

const BLANK_POSE: PoseSample = PoseSample {
    time_ns: 0.0,
    position: DVec3::ZERO,
    roll: 0.0,
    pitch: 0.0,
    yaw: 0.0,
    attitude: Rotation::IDENTITY,
    flown: (DVec3::ZERO, Rotation::IDENTITY),
};

const BLANK_ECHO: Echo = Echo {
    position: DVec3::ZERO,
    origin: DVec3::ZERO,
    direction: DVec3::ZERO,
    in_scanner: DVec3::ZERO,
    range: 0.0,
    true_range: 0.0,
    intensity: 0.0,
    echo_width: 0.0,
    return_number: 0,
    number_of_returns: 0,
    pulse_number: 0,
    device: 0,
    part: 0,
    primitive: 0,
    classification: 0,
    incidence_cosine: 0.0,
    scan_angle: 0.0,
    time_ns: 0.0,
    truth_index: 0,
};

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// A batch with records of every kind, some of whose values are equal and some not numbers.
    pub fn batch(epoch: u32, leg: u32, count: u32) -> Batch {
        let mut batch =
            Batch { epoch, leg, emitted: count, leg_number: (leg == 3).then_some(7), ..Batch::default() };
        for i in 0..count {
            let x = f64::from(i);
            batch.echoes.push(Echo {
                position: DVec3::new(x, -0.0, f64::NAN),
                range: f64::from_bits(0x7ff8_0000_0000_0001 + u64::from(i)),
                pulse_number: u64::MAX - u64::from(i),
                classification: -(i as i32),
                // Distances of one, two and four bytes, and none that is shorter than the numbers.
                part: 7 + i % 200,
                primitive: i * 100,
                return_number: i << 23,
                ..BLANK_ECHO
            });
            batch.truths.push(EchoTruth {
                beam: [DVec3::X * x, DVec3::Z],
                subray: i,
                ..EchoTruth::unknown([DVec3::ZERO; 2])
            });
            batch.waveforms.push(WaveformRecord {
                first_sample: batch.samples.len(),
                samples: 2,
                start_ns: x,
                ..BLANK_WAVEFORM
            });
            batch.samples.extend([x, f64::INFINITY]);
            batch.pulses.push(PulseRecord { number: u64::from(i), ..BLANK_PULSE });
            let turned = Rotation::about_z(x);
            batch.poses.push(PoseSample { attitude: turned, flown: (DVec3::Y * x, turned), ..BLANK_POSE });
        }
        batch
    }

    /// A block of `bytes`.
    fn raw(bytes: &[u8], has_records: bool) -> RawBlock<'_> {
        let (head, columns) = bytes.split_at(HEAD_BYTES);
        if !has_records {
            return RawBlock { head, records: None, columns };
        }
        let (length, columns) = columns.split_at(8);
        let (records, columns) = columns.split_at(u64::from_le_bytes(length.try_into().unwrap()) as usize);
        RawBlock { head, records: Some([length, records]), columns }
    }

    #[test]
    fn batches_come_back_bit_for_bit() {
        for batch in [batch(0, 0, 0), batch(1, 3, 1), batch(2, 1, 500)] {
            let mut bytes = vec![1, 2, 3];
            encode(&batch, &mut bytes);
            let head = BlockHead::read(&bytes[3..]).unwrap();
            let mut read = self::batch(9, 9, 3);
            decode(&head, &raw(&bytes[3..], false), &mut read).unwrap();
            // The debug representation of -0 and of infinity differs from that of other numbers; NaNs are compared below.
            assert_eq!(format!("{read:?}"), format!("{batch:?}"));
            let bits = |b: &Batch| b.echoes.iter().map(|e| e.range.to_bits()).collect::<Vec<_>>();
            assert_eq!(bits(&read), bits(&batch));
        }
    }

    #[test]
    fn positions_are_stored_where_they_do_not_follow() {
        let mut batch = Batch { emitted: 3, ..Batch::default() };
        for i in 0..3 {
            let (origin, direction, range) =
                (DVec3::new(0.1, 0.2, 0.3), DVec3::new(0.6, -0.8, 0.0), 10.0 / f64::from(3 + i));
            let position = origin + direction * range;
            batch.echoes.push(Echo { origin, direction, range, position, ..BLANK_ECHO });
        }
        let bytes = |batch: &Batch| {
            let mut bytes = Vec::new();
            encode(batch, &mut bytes);
            let mut read = Batch::default();
            decode(&BlockHead::read(&bytes).unwrap(), &raw(&bytes, false), &mut read).unwrap();
            assert_eq!(format!("{read:?}"), format!("{batch:?}"));
            bytes.len()
        };
        let derived = bytes(&batch);
        batch.echoes[1].position.y += 1e-9;
        assert_eq!(bytes(&batch), derived + 2 * (1 + 24) + 1 + 8);
    }

    #[test]
    fn any_changed_byte_is_found() {
        for has_records in [false, true] {
            let (batch, mut bytes) = (batch(1, 2, 20), Vec::new());
            match has_records {
                false => encode(&batch, &mut bytes),
                true => encode_records(&batch, |out| out.extend([7; 100]), &mut bytes),
            }
            let head = BlockHead::read(&bytes).unwrap();
            let mut read = Batch::default();
            let mut decode = |bytes: &[u8]| decode(&head, &raw(bytes, has_records), &mut read);
            for at in 0..bytes.len() {
                // The length of the records tells where they end.
                if !has_records || !(HEAD_BYTES..RECORDS_AT).contains(&at) {
                    bytes[at] ^= 8;
                    assert!(decode(&bytes).is_none(), "byte {at}");
                    bytes[at] ^= 8;
                }
            }
            assert!(decode(&bytes[..bytes.len() - 1]).is_none());
            assert!(decode(&bytes).is_some());
        }
    }

    #[test]
    fn records_come_back_with_everything_but_echoes() {
        let batch = batch(1, 2, 20);
        let mut bytes = Vec::new();
        encode_records(&batch, |out| out.extend([1, 2, 3]), &mut bytes);
        let (head, mut read) = (BlockHead::read(&bytes).unwrap(), Batch::default());
        let block = raw(&bytes, true);
        decode(&head, &block, &mut read).unwrap();
        assert_eq!(block.records.unwrap()[1], [1, 2, 3]);
        let expected = Batch { echoes: Vec::new(), truths: Vec::new(), ..batch };
        assert_eq!((format!("{read:?}"), head.echoes), (format!("{expected:?}"), 20));
    }
}
