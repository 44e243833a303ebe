//! Chunks of compressed records, found without decompressing those before them.

use super::error::LasError;
use super::excerpt::Excerpt;
use super::header::Fields;
use laz::LazVlr;
use laz::las::selective::DecompressionSelection;
use laz::laszip::ChunkTableEntry;
use laz::record::{LayeredPointRecordDecompressor, RecordDecompressor, SequentialPointRecordDecompressor};
use std::io::Cursor;
use std::ops::ControlFlow;

/// A chunk of compressed records.
#[derive(Clone, Copy, Debug)]
pub(super) struct Chunk {
    /// Offset in the file.
    pub start: u64,
    /// Number of points, of the last chunk as far as the file has them.
    pub points: u64,
}

/// The chunks of a file, each of which is decompressed by itself.
pub(super) struct Chunks<'a> {
    pub file: Fields<'a>,
    pub vlr: LazVlr,
    pub selection: DecompressionSelection,
    pub record_length: usize,
    /// Number of layers of a chunk, if chunks are layered.
    pub layers: Option<usize>,
    /// The layers that are decompressed, if others are left out.
    pub excerpt: Option<Excerpt>,
    /// The table of chunks, if chunks cannot be found without it.
    pub table: Vec<ChunkTableEntry>,
    /// Offset of the first chunk.
    pub start: u64,
}

impl<'a> Chunks<'a> {
    /// The chunks of the first `count` points in the order of the file, up to the first one whose place or
    /// size is not known or not within the file.
    pub fn of_points(&self, count: u64) -> impl Iterator<Item = Chunk> + '_ {
        let (mut start, mut left, mut index) = (self.start, count, 0);
        std::iter::from_fn(move || {
            let points = self.points(index)?.min(left);
            let end = start.checked_add(self.length(start, index)?)?;
            if points == 0 || end > self.file.0.len() as u64 {
                return None;
            }
            let chunk = Chunk { start, points };
            (start, left, index) = (end, left - points, index + 1);
            Some(chunk)
        })
    }

    /// Number of points of a chunk, as the decompressor of all chunks takes it.
    fn points(&self, index: usize) -> Option<u64> {
        match self.vlr.uses_variable_size_chunks() {
            true => self.table.get(index).map(|entry| entry.point_count),
            false => Some(self.vlr.chunk_size().into()),
        }
    }

    /// Length of the chunk at an offset of the file, bytes: by its layers if it has any, since the table may
    /// be missing or damaged. `None` if the number of points there is not that of the table.
    fn length(&self, start: u64, index: usize) -> Option<u64> {
        let Some(layers) = self.layers else { return self.table.get(index).map(|entry| entry.byte_count) };
        // The first record, the number of points, and the sizes of the layers precede the layers.
        let count_at = usize::try_from(start).ok()?.checked_add(self.record_length)?;
        let is_counted = || self.file.u32(count_at).is_ok_and(|n| Some(u64::from(n)) == self.points(index));
        if self.vlr.uses_variable_size_chunks() && !is_counted() {
            return None;
        }
        let sizes_at = count_at.checked_add(4)?;
        let mut length = (self.record_length + 4 + 4 * layers) as u64;
        for layer in 0..layers {
            length += u64::from(self.file.u32(sizes_at.checked_add(4 * layer)?).ok()?);
        }
        Some(length)
    }

    /// Calls `take` with the records of a chunk until it breaks. Returns the offset behind the chunk; `None`
    /// if `take` broke. `copied` is memory for the excerpt of a chunk. Bytes of records that are not
    /// decompressed are 0 or those of the first record of the chunk.
    pub fn read(
        &self,
        chunk: Chunk,
        copied: &mut Vec<u8>,
        mut take: impl FnMut(&[u8]) -> ControlFlow<()>,
    ) -> Result<Option<u64>, LasError> {
        if let Some(excerpt) = &self.excerpt {
            let start = usize::try_from(chunk.start).map_err(|_| LasError::Damaged)?;
            let end = excerpt.copy(self.file.0, start, copied).ok_or(LasError::Damaged)?;
            let decompressor = LayeredPointRecordDecompressor::new(Cursor::new(&copied[..]));
            let mut record = vec![0; self.record_length];
            let read = self.read_with(decompressor, &excerpt.vlr, chunk.points, |part| {
                excerpt.spread(part, &mut record);
                take(&record)
            })?;
            return Ok(read.map(|_| end as u64));
        }
        let mut source = Cursor::new(self.file.0);
        source.set_position(chunk.start);
        match self.layers {
            Some(_) => {
                self.read_with(LayeredPointRecordDecompressor::new(source), &self.vlr, chunk.points, take)
            }
            None => {
                self.read_with(SequentialPointRecordDecompressor::new(source), &self.vlr, chunk.points, take)
            }
        }
    }

    /// Calls `take` with the records of a chunk of these items until it breaks. Returns the offset in the
    /// source behind the chunk.
    fn read_with<'s, D: RecordDecompressor<Cursor<&'s [u8]>>>(
        &self,
        mut decompressor: D,
        vlr: &LazVlr,
        points: u64,
        mut take: impl FnMut(&[u8]) -> ControlFlow<()>,
    ) -> Result<Option<u64>, LasError> {
        decompressor.set_fields_from(vlr.items()).map_err(LasError::of_library)?;
        decompressor.set_selection(self.selection);
        let mut record = vec![0; vlr.items_size() as usize];
        for _ in 0..points {
            decompressor.decompress_next(&mut record).map_err(|_| LasError::Damaged)?;
            if take(&record).is_break() {
                return Ok(None);
            }
        }
        Ok(Some(decompressor.get().position()))
    }
}

#[cfg(test)]
mod tests {
    use crate::las::read::tests::{chunked_with, irregular, read_selected, same_on_threads};
    use crate::{Attribute, AttributeSet, PointDetails, PointFile, PointRow, PointSink, Selection};
    use std::ops::ControlFlow;
    use std::path::Path;
    use vlscan_base::diag::Diagnostics;

    /// A file of 1000 points of four channels with extra bytes, of which some are read.
    fn with_extra_bytes(is_variable: bool) -> Vec<u8> {
        let descriptor = |(kind, name): (u8, &str)| {
            let mut descriptor = vec![0; 192];
            descriptor[2] = kind;
            descriptor[4..4 + name.len()].copy_from_slice(name.as_bytes());
            descriptor
        };
        let dimensions = [(10, "echo_width"), (6, "hitObjectId"), (10, "heliosAmplitude"), (9, "range")];
        let descriptors = dimensions.into_iter().flat_map(descriptor).collect();
        let mut records = irregular(1000, 54);
        for (i, record) in (0_u32..).zip(&mut records) {
            record[15] = ((i / 40 % 4) << 4) as u8;
            record[30..38].copy_from_slice(&(0.7 * f64::from(i)).to_le_bytes());
            record[38..42].copy_from_slice(&(i % 7).to_le_bytes());
            record[42..50].copy_from_slice(&(0.3 * f64::from(i)).to_le_bytes());
            record[50..54].copy_from_slice(&(0.5 * i as f32).to_le_bytes());
        }
        chunked_with(6, &records, is_variable, Some(descriptors))
    }

    #[test]
    fn values_are_the_same_whatever_extra_bytes_are_left_out() {
        struct Details(Vec<[Option<f64>; 3]>);
        impl PointSink for Details {
            fn start(&mut self, _: AttributeSet) {}
            fn takes_details(&self) -> bool {
                true
            }
            fn details(&mut self, details: &PointDetails) {
                self.0.push([details.echo_width, details.amplitude, details.range]);
            }
            fn point(&mut self, _: &PointRow, _: Option<&str>) -> vlscan_base::Result<ControlFlow<()>> {
                Ok(ControlFlow::Continue(()))
            }
        }
        for is_variable in [false, true] {
            let bytes = with_extra_bytes(is_variable);
            let (rows, said) = same_on_threads(&bytes, "extra bytes");
            assert_eq!((rows.len(), said.as_str()), (1000, ""));
            for (i, row) in (0_u32..).zip(&rows) {
                let values = (row.position.x, row.channel, row.object, row.intensity);
                let intensity = (0.3 * f64::from(i)) as f32;
                let channel = (i / 40 % 4) as u16;
                assert_eq!(values, (f64::from(i) * 0.01, channel, i64::from(i % 7), intensity), "{i}");
            }
            for selected in [Attribute::Object, Attribute::Intensity, Attribute::Leg] {
                let selection = Selection::Attributes(AttributeSet::of(|attribute| attribute == selected));
                let has = |attribute| attribute == selected;
                let expected = rows.iter().map(|row| PointRow {
                    intensity: if has(Attribute::Intensity) { row.intensity } else { 0.0 },
                    object: if has(Attribute::Object) { row.object } else { 0 },
                    leg: if has(Attribute::Leg) { row.leg } else { 0 },
                    point_source: if has(Attribute::Leg) { row.point_source } else { 0 },
                    ..*row
                });
                let expected: Vec<PointRow> = expected.collect();
                for threads in [1, 3] {
                    let rows = read_selected(&bytes, threads, selection).0;
                    assert!(rows == expected, "{selected:?}, {threads} threads");
                }
            }
            let (mut all, mut found) = (Details(Vec::new()), Diagnostics::default());
            let file = PointFile::new(Path::new("a.las"), &bytes, &mut found).unwrap().on_threads(3);
            file.read(Selection::All, &mut all, &mut found).unwrap();
            assert_eq!((all.0.len(), found.text().as_str()), (1000, ""));
            for (i, values) in (0_u32..).zip(all.0) {
                let i = f64::from(i);
                assert_eq!(values, [0.7 * i, 0.3 * i, 0.5 * i].map(Some), "{i}");
            }
        }
    }

    #[test]
    fn damage_of_files_with_extra_bytes_has_the_same_place_on_any_number_of_threads() {
        let whole = with_extra_bytes(true);
        let start = whole.len() / 10;
        for at in (start..whole.len()).step_by(whole.len() / 25) {
            let mut damaged = whole.clone();
            damaged[at] ^= 0x55;
            same_on_threads(&damaged, &format!("byte {at}"));
            same_on_threads(&whole[..at], &format!("byte {at}, cut"));
        }
    }
}
