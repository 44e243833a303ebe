//! A chunk of LAS 1.4 points with extra bytes, layer by layer: the bytes of LASzip in about half the time of
//! the `laz` crate. Bytes that never change within a chunk are only counted, and independent layers are coded
//! interleaved.

use super::extra;
use super::point::{POINT, Points, channel};

/// True if all points have the same scanner channel, which [`compress`] requires.
pub(super) fn has_one_channel(records: &[u8], length: usize) -> bool {
    let Some(first) = records.get(..length) else { return false };
    records.chunks_exact(length).all(|record| channel(record) == channel(first))
}

/// Appends the chunk of `records`, at least one, each of `length` bytes.
pub(super) fn compress(records: &[u8], length: usize, out: &mut Vec<u8>) {
    let count = records.len() / length;
    let Some((first, _)) = records.split_first_chunk::<POINT>() else { return };
    let mut points = Points::new(first, count);
    for record in records.chunks_exact(length).skip(1) {
        if let Some((record, _)) = record.split_first_chunk() {
            points.write(record);
        }
    }
    let of_points = points.finish();
    let of_extra = extra::layers(records, POINT, length);
    out.extend_from_slice(&records[..length]);
    out.extend((count as u32).to_le_bytes());
    let layers = || of_points.iter().chain(&of_extra);
    layers().for_each(|layer| out.extend((layer.len() as u32).to_le_bytes()));
    layers().for_each(|layer| out.extend_from_slice(layer));
}
