//! Points as records of LAS in parts of a run, so that merges copy them.
//!
//! ```text
//! 0    numbers of points, of points left out, and of points by return, u64 each
//! 136  least and greatest stored x, y, z, f64 each
//! 184  records
//! ```

use super::codec::{LegFacts, Piece};
use super::las::LasCodec;
use super::plan::OutputPlan;
use super::summary::Tally;
use crate::geom::{Aabb, DVec3};
use crate::parts;
use crate::pulse::{Batch, Echo};

/// Bytes before the records.
const HEAD_BYTES: usize = 8 * (2 + 15 + 6);

fn put_tally(tally: &Tally, out: &mut Vec<u8>) {
    let counts = [tally.records, tally.left_out].into_iter().chain(tally.by_return);
    counts.for_each(|count| out.extend_from_slice(&count.to_le_bytes()));
    let bounds = [tally.bounds.min, tally.bounds.max].map(|corner| corner.to_array());
    bounds.as_flattened().iter().for_each(|c| out.extend_from_slice(&c.to_le_bytes()));
}

/// Points of a batch as a part holds them.
#[derive(Debug)]
pub struct StoredPoints<'a> {
    pub(super) tally: Tally,
    pub(super) records: &'a [u8],
}

impl StoredPoints<'_> {
    /// Reads what a part holds; `None` if it is cut short.
    pub fn read(bytes: &[u8]) -> Option<StoredPoints<'_>> {
        let (head, records) = bytes.split_at_checked(HEAD_BYTES)?;
        let word = |n: usize| std::array::from_fn(|i| head[8 * n + i]);
        let count = |n: usize| u64::from_le_bytes(word(n));
        let corner = |n: usize| DVec3::from([0, 1, 2].map(|axis| f64::from_le_bytes(word(n + axis))));
        let tally = Tally {
            records: count(0),
            left_out: count(1),
            by_return: std::array::from_fn(|nth| count(2 + nth)),
            bounds: Aabb { min: corner(17), max: corner(20) },
        };
        Some(StoredPoints { tally, records })
    }

    pub(super) fn piece(&self, slot: u32) -> Piece {
        Piece { bytes: self.records.to_vec(), tally: self.tally.clone(), ..Piece::new(slot, 0) }
    }
}

impl OutputPlan {
    /// Returns the batch as a block of a part that holds records of LAS instead of echoes.
    pub(super) fn part_of_records(&self, slot: u32, leg: &LegFacts, batch: &Batch, echoes: &[Echo]) -> Piece {
        let codec =
            LasCodec { format: &self.las, objects: &self.objects, truths: &batch.truths, ground: None };
        let mut points = Piece::new(slot, echoes.len() * usize::from(self.las.record_length()));
        echoes.iter().for_each(|echo| points.push_point(&codec, leg, echo));
        let mut records = Vec::with_capacity(HEAD_BYTES + points.bytes.len());
        put_tally(&points.tally, &mut records);
        records.extend_from_slice(&points.bytes);
        let mut block = Piece::new(slot, records.len() + 1024);
        parts::encode(batch, Some(&records), &mut block.bytes);
        block.tally.records = batch.echoes.len() as u64;
        block
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_and_bounds_come_back() {
        let mut tally = Tally { left_out: 3, ..Tally::EMPTY };
        for i in 0..40u32 {
            tally.count_point(DVec3::new(f64::from(i), -f64::from(i), 7.0), i);
        }
        for tally in [tally, Tally::EMPTY] {
            let mut bytes = Vec::new();
            put_tally(&tally, &mut bytes);
            assert_eq!(bytes.len(), HEAD_BYTES);
            bytes.extend([1, 2, 3]);
            let read = StoredPoints::read(&bytes).unwrap();
            assert_eq!((&read.tally, read.records), (&tally, &[1, 2, 3][..]));
            assert!(StoredPoints::read(&bytes[..HEAD_BYTES - 1]).is_none());
        }
    }
}
