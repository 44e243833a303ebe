//! The layers of a chunk that are decompressed.
//!
//! Each extra byte of a record is a layer, but the decompressor takes all of them or none, and keeps models
//! of 2 kB for every byte and channel. So a chunk is copied as if its records had only the extra bytes and
//! the items that are read.

use laz::las::selective::DecompressionSelection;
use laz::{LazItemType, LazVlr};
use std::iter::repeat_n;
use std::ops::Range;

/// Numbers of the kinds of items in the record of the compression.
const POINT_14: u16 = 10;
const BYTES_14: u16 = 14;
/// Offset of the number of items in the record of the compression.
const ITEMS_AT: usize = 32;
/// Bytes of the number of points of a chunk, and of the size of a layer.
const SIZE_BYTES: usize = 4;

/// A layer of the chunks of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Layer {
    Copied,
    /// Copied as a layer without bytes: the values are those of the first record.
    Emptied,
    LeftOut,
}

/// The bytes of records, and the layers of chunks, that are decompressed.
#[derive(Debug)]
pub(super) struct Excerpt {
    /// The record of the compression for the records of the excerpt.
    pub vlr: LazVlr,
    /// Length of a record in the file, bytes.
    record_length: usize,
    /// Bytes of a record in the file that are in one of the excerpt, in ascending order.
    bytes: Vec<Range<usize>>,
    /// The layers in the file.
    layers: Vec<Layer>,
}

impl Excerpt {
    /// The excerpt with the selected layers, and the extra bytes at the offsets in records for which
    /// `is_read` is true. `None` if no layer can be left out.
    pub fn of(
        vlr: &LazVlr,
        selection: DecompressionSelection,
        is_read: impl Fn(usize) -> bool,
    ) -> Option<Excerpt> {
        let (mut items, mut bytes, mut layers) = (Vec::new(), Vec::new(), Vec::new());
        let mut end = 0;
        for item in vlr.items() {
            let (start, size, kind) = (end, item.size(), item.item_type());
            end = start + usize::from(size);
            let (is_selected, count) = match kind {
                LazItemType::Point14 => {
                    items.push([POINT_14, size, item.version()]);
                    bytes.push(start..end);
                    layers.extend(point_layers(selection));
                    continue;
                }
                LazItemType::Byte14(_) => {
                    let is_kept = |at: &usize| selection.should_decompress_extra_bytes() && is_read(*at);
                    let kept: Vec<usize> = (start..end).filter(is_kept).collect();
                    if !kept.is_empty() {
                        items.push([BYTES_14, kept.len() as u16, item.version()]);
                    }
                    layers.extend((start..end).map(|at| match is_kept(&at) {
                        true => Layer::Copied,
                        false => Layer::LeftOut,
                    }));
                    bytes.extend(kept.chunk_by(|a, b| a + 1 == *b).map(|run| run[0]..run[0] + run.len()));
                    continue;
                }
                LazItemType::RGB14 => (selection.should_decompress_rgb(), 1),
                LazItemType::RGBNIR14 => {
                    (selection.should_decompress_rgb() || selection.should_decompress_nir(), 2)
                }
                LazItemType::WavePacket14 => (selection.should_decompress_wavepacket(), 1),
                _ => return None,
            };
            if is_selected {
                items.push([u16::from(kind), size, item.version()]);
                bytes.push(start..end);
            }
            layers.extend(repeat_n(if is_selected { Layer::Copied } else { Layer::LeftOut }, count));
        }
        let vlr = layers.contains(&Layer::LeftOut).then(|| with_items(vlr, &items)).flatten()?;
        Some(Excerpt { vlr, record_length: end, bytes, layers })
    }

    /// Copies the excerpt of the chunk at an offset of the file. Returns the offset behind the chunk; `None`
    /// if the chunk does not lie within the file.
    pub fn copy(&self, file: &[u8], start: usize, out: &mut Vec<u8>) -> Option<usize> {
        // The first record, the number of points, and the sizes of the layers precede the layers.
        let sizes_at = start.checked_add(self.record_length + SIZE_BYTES)?;
        let layers_at = sizes_at.checked_add(SIZE_BYTES * self.layers.len())?;
        let head = file.get(start..sizes_at)?;
        let sizes = file.get(sizes_at..layers_at)?.chunks_exact(SIZE_BYTES);
        let layers = || self.layers.iter().copied().zip(sizes.clone());
        let (mut end, mut copied) = (layers_at, 0);
        for (layer, size) in layers() {
            let size = size_in(size);
            end = end.checked_add(size)?;
            copied += if layer == Layer::Copied { size } else { 0 };
        }
        let mut rest = file.get(layers_at..end)?;
        out.clear();
        out.reserve(layers_at - start + copied);
        self.bytes.iter().for_each(|bytes| out.extend_from_slice(&head[bytes.clone()]));
        out.extend_from_slice(&head[self.record_length..]);
        for (layer, size) in layers() {
            match layer {
                Layer::Copied => out.extend_from_slice(size),
                Layer::Emptied => out.extend_from_slice(&[0; SIZE_BYTES]),
                Layer::LeftOut => {}
            }
        }
        for (layer, size) in layers() {
            let (bytes, more) = rest.split_at_checked(size_in(size))?;
            if layer == Layer::Copied {
                out.extend_from_slice(bytes);
            }
            rest = more;
        }
        Some(end)
    }

    /// Copies a record of the excerpt to its places in a record of the file.
    pub fn spread(&self, mut from: &[u8], record: &mut [u8]) {
        for bytes in &self.bytes {
            let (part, rest) = from.split_at(bytes.len());
            record[bytes.clone()].copy_from_slice(part);
            from = rest;
        }
    }
}

fn size_in(bytes: &[u8]) -> usize {
    bytes.iter().rev().fold(0, |size, byte| size << 8 | usize::from(*byte))
}

/// The layers of the fields that all records have, in the order of the file.
fn point_layers(selection: DecompressionSelection) -> [Layer; 9] {
    [
        true,
        selection.should_decompress_z(),
        selection.should_decompress_classification(),
        selection.should_decompress_flags(),
        selection.should_decompress_intensity(),
        selection.should_decompress_scan_angle(),
        selection.should_decompress_user_data(),
        selection.should_decompress_point_source_id(),
        selection.should_decompress_gps_time(),
    ]
    .map(|is_selected| if is_selected { Layer::Copied } else { Layer::Emptied })
}

/// The record of a compression of other items: kind, size and version of each.
fn with_items(vlr: &LazVlr, items: &[[u16; 3]]) -> Option<LazVlr> {
    let mut record = Vec::new();
    vlr.write_to(&mut record).ok()?;
    record.truncate(ITEMS_AT);
    record.extend((items.len() as u16).to_le_bytes());
    record.extend(items.iter().flatten().flat_map(|value| value.to_le_bytes()));
    LazVlr::from_buffer(record).ok()
}

#[cfg(test)]
mod tests {
    use super::*;
    use laz::LazItemRecordBuilder;

    #[test]
    fn an_excerpt_has_the_selected_layers_and_extra_bytes() {
        let mut builder = LazItemRecordBuilder::new();
        builder.add_item(LazItemType::Point14).add_item(LazItemType::RGB14).add_item(LazItemType::Byte14(5));
        let vlr = LazVlr::from_laz_items(builder.build());
        let all = DecompressionSelection::all();
        assert!(Excerpt::of(&vlr, all, |_| true).is_none());
        let excerpt = Excerpt::of(&vlr, all.skip_rgb().skip_z(), |at| matches!(at, 37 | 38 | 40)).unwrap();
        assert_eq!(excerpt.bytes, [0..30, 37..39, 40..41]);
        let kinds: Vec<LazItemType> = excerpt.vlr.items().iter().map(|item| item.item_type()).collect();
        assert_eq!(kinds, [LazItemType::Point14, LazItemType::Byte14(3)]);
        // A chunk whose layers have 1, 2, 3 … bytes of their number.
        let record: Vec<u8> = (100..141).collect();
        let sizes: Vec<u8> = (1..=15_u32).flat_map(u32::to_le_bytes).collect();
        let layers: Vec<u8> = (1..=15_u8).flat_map(|layer| repeat_n(layer, layer.into())).collect();
        let file = [&[7, 7, 7][..], &record, &500_u32.to_le_bytes(), &sizes, &layers, &[7]].concat();
        let mut out = vec![1, 2];
        assert_eq!(excerpt.copy(&file, 3, &mut out), Some(file.len() - 1));
        assert_eq!(out[..30], record[..30]);
        assert_eq!(out[30..37], [137, 138, 140, 244, 1, 0, 0]);
        let copied = [1, 0, 3, 4, 5, 6, 7, 8, 9, 12, 13, 15_u32];
        assert_eq!(out[37..85], copied.into_iter().flat_map(u32::to_le_bytes).collect::<Vec<u8>>());
        let expected = copied.into_iter().flat_map(|layer| repeat_n(layer as u8, layer as usize));
        assert_eq!(out[85..], expected.collect::<Vec<u8>>());
        let mut spread = [0; 41];
        excerpt.spread(&out[..33], &mut spread);
        assert_eq!((spread[29], &spread[30..]), (129, &[0, 0, 0, 0, 0, 0, 0, 137, 138, 0, 140][..]));
        // A chunk that does not lie within the file.
        for length in [10, 40, 100, file.len() - 2] {
            assert_eq!(excerpt.copy(&file[..length], 3, &mut out), None, "{length}");
        }
        assert_eq!(excerpt.copy(&file, usize::MAX - 2, &mut out), None);
    }
}
