//! Points as records of LAS in parts of a run, so that merges copy them.
//!
//! ```text
//! records
//! numbers of points, of points left out, and of points by return, u64 each
//! least and greatest stored x, y, z, f64 each
//! ```

use super::codec::{LegFacts, Piece};
use super::encode::{Encoded, Source};
use super::las::{LasCodec, MIN_RECORD_BYTES, read_stored};
use super::layout::Content;
use super::plan::OutputPlan;
use super::summary::Tally;
use crate::parts;
use std::mem;
use std::ops::Range;
use vlscan_geom::{Aabb, DVec3};
use vlscan_lidar::pulse::{Batch, Echo};

/// Bytes after the records.
const TALLY_BYTES: usize = 8 * (2 + 15 + 6);

fn put_tally(tally: &Tally, out: &mut Vec<u8>) {
    let counts = [tally.records, tally.left_out].into_iter().chain(tally.by_return);
    counts.for_each(|count| out.extend_from_slice(&count.to_le_bytes()));
    let bounds = [tally.bounds.min, tally.bounds.max].map(|corner| corner.to_array());
    bounds.as_flattened().iter().for_each(|c| out.extend_from_slice(&c.to_le_bytes()));
}

/// Points of a batch as a part holds them.
#[derive(Debug)]
pub struct StoredPoints {
    pub(super) tally: Tally,
    records: Vec<u8>,
}

impl StoredPoints {
    /// Reads what a part holds; `None` if it is cut short.
    pub fn read(mut bytes: Vec<u8>) -> Option<StoredPoints> {
        let (records, tally) = bytes.split_at_checked(bytes.len().checked_sub(TALLY_BYTES)?)?;
        let word = |n: usize| std::array::from_fn(|i| tally[8 * n + i]);
        let count = |n: usize| u64::from_le_bytes(word(n));
        let corner = |n: usize| DVec3::from([0, 1, 2].map(|axis| f64::from_le_bytes(word(n + axis))));
        let tally = Tally {
            records: count(0),
            left_out: count(1),
            by_return: std::array::from_fn(|nth| count(2 + nth)),
            bounds: Aabb { min: corner(17), max: corner(20) },
        };
        bytes.truncate(records.len());
        Some(StoredPoints { tally, records: bytes })
    }

    /// Keeps the points of LAS 1.4 whose echoes are `wanted`, of `all` in the batch. Returns `false`, with all points kept, when
    /// there are echoes without a point, so that it is not known which points are wanted.
    #[must_use]
    pub fn keep(&mut self, wanted: Range<u32>, all: u32) -> bool {
        if wanted == (0..all) {
            return true;
        }
        let length = self.records.len() / (all as usize).max(1);
        if self.tally.records != u64::from(all) || length < MIN_RECORD_BYTES {
            return false;
        }
        self.records.truncate(wanted.end as usize * length);
        self.records.drain(..wanted.start as usize * length);
        self.tally = Tally::EMPTY;
        for record in self.records.chunks_exact(length) {
            let (stored, return_number) = read_stored(record);
            self.tally.count_point(stored, return_number);
        }
        true
    }
}

impl OutputPlan {
    /// [`encode`](Self::encode) of a batch whose points are records of LAS.
    pub fn encode_stored(&self, batch: &Batch, stored: StoredPoints) -> Encoded {
        let mut encoded = self.encode_source(Source { batch, ground: None, stored: Some(&stored.tally) });
        let is_points = |slot: u32| matches!(self.layout.files[slot as usize].content, Content::Points(_));
        let mut pieces = encoded.pieces.iter_mut().filter(|piece| is_points(piece.slot)).peekable();
        while let Some(piece) = pieces.next() {
            if pieces.peek().is_none() {
                piece.bytes = stored.records;
                break;
            }
            piece.bytes.clone_from(&stored.records);
        }
        encoded
    }

    /// Returns the batch as a block of a part that holds records of LAS instead of echoes.
    pub(super) fn part_of_records(&self, slot: u32, leg: &LegFacts, batch: &Batch, echoes: &[Echo]) -> Piece {
        let codec =
            LasCodec { format: &self.las, objects: &self.objects, truths: &batch.truths, ground: None };
        let mut block = Piece::new(slot, echoes.len() * usize::from(self.las.record_length()) + 1024);
        let put_records = |out: &mut Vec<u8>| {
            let mut points = Piece { bytes: mem::take(out), ..Piece::new(slot, 0) };
            echoes.iter().for_each(|echo| points.push_point(&codec, leg, echo));
            *out = points.bytes;
            put_tally(&points.tally, out);
        };
        parts::encode_records(batch, put_records, &mut block.bytes);
        block.tally.records = batch.echoes.len() as u64;
        block
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::{batch, scene, survey};
    use super::super::{OutputContext, OutputRequest, PointFormat, Target};
    use super::*;

    #[test]
    fn counts_and_bounds_come_back() {
        let mut tally = Tally { left_out: 3, ..Tally::EMPTY };
        for i in 0..40u32 {
            tally.count_point(DVec3::new(f64::from(i), -f64::from(i), 7.0), i);
        }
        for tally in [tally, Tally::EMPTY] {
            let mut bytes = vec![1, 2, 3];
            put_tally(&tally, &mut bytes);
            assert_eq!(bytes.len(), 3 + TALLY_BYTES);
            let read = StoredPoints::read(bytes).unwrap();
            assert_eq!((&read.tally, &read.records[..]), (&tally, &[1, 2, 3][..]));
            assert!(StoredPoints::read(vec![0; TALLY_BYTES - 1]).is_none());
        }
    }

    #[test]
    fn points_are_cut_and_counted_anew() {
        let sinks = vec![(Target::File("a.las".into()), PointFormat::Las)];
        let request = OutputRequest { sinks, ..OutputRequest::default() };
        let (survey, scene) = (survey(2, &[None]), scene());
        let plan = OutputPlan::new(request, &OutputContext::new(&survey, &scene)).unwrap();
        let whole = batch(0, 0, 300);
        let stored = |echoes: Range<usize>| {
            let part = Batch { echoes: whole.echoes[echoes].to_vec(), ..Batch::default() };
            let piece = plan.encode(&part, None).pieces.remove(0);
            StoredPoints { tally: piece.tally, records: piece.bytes }
        };
        for (first, end) in [(0, 300), (0, 1), (17, 140), (299, 300), (150, 150)] {
            let (mut cut, expected) = (stored(0..300), stored(first..end));
            assert!(cut.keep(first as u32..end as u32, 300));
            assert_eq!((cut.tally, cut.records), (expected.tally, expected.records));
        }
        // One of the echoes has no point.
        let mut some = stored(0..299);
        assert!(some.keep(0..300, 300) && !some.keep(0..10, 300));
        assert_eq!(some.tally.records, 299);
    }
}
