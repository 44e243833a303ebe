//! Joins LAS and LAZ files of consecutive points to one. Points are copied, compressed or not: the chunks of
//! LAZ are those of the joined file if every file but the last holds whole chunks.

use super::summary::{FileKind, FileSummary};
use ::laz::LazVlr;
use ::laz::laszip::ChunkTable;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom, Write};
use std::ops::Range;
use std::path::{Path, PathBuf};
use vlscan_base::damage::catch_decoder_panic;
use vlscan_base::error::{Error, Result};
use vlscan_base::files::{FileWriter, Patched, reads};
use vlscan_base::store::Checksum;
use vlscan_formats::CHUNK_POINTS;
use vlscan_geom::{Aabb, DVec3};

/// Number of points of a chunk of LAZ, to whose multiples all files but the last are cut.
pub const JOINED_POINTS: u64 = CHUNK_POINTS as u64;

/// Bytes per read.
const COPY_BYTES: usize = 4 << 20;
/// The largest header with records that is read, bytes.
const MAX_HEAD_BYTES: u64 = 64 << 20;

/// Places in the header of LAS 1.4.
const DATA_AT: usize = 96;
const FORMAT_AT: usize = 104;
const LENGTH_AT: usize = 105;
const BOUNDS_AT: usize = 179;
const COUNT_AT: usize = 247;
const RETURNS_AT: usize = 255;
const HEADER_BYTES: usize = 375;

/// A file to be joined.
pub struct Segment {
    /// The file.
    pub path: PathBuf,
    /// Number of its points.
    pub records: u64,
    /// Checksum of the file, as of [`Checksum::file`].
    pub sum: u64,
}

/// An open file to be joined.
struct OpenSegment<'a> {
    path: &'a Path,
    file: File,
    /// Header and variable length records.
    head: Vec<u8>,
    /// Compression and sizes of chunks.
    compression: Option<(LazVlr, ChunkTable)>,
    /// Bytes of the points.
    points: Range<u64>,
}

fn number<const N: usize>(bytes: &[u8], at: usize) -> [u8; N] {
    std::array::from_fn(|i| bytes.get(at + i).copied().unwrap_or_default())
}

fn long(bytes: &[u8], at: usize) -> u64 {
    u64::from_le_bytes(number(bytes, at))
}

fn double(bytes: &[u8], at: usize) -> f64 {
    f64::from_le_bytes(number(bytes, at))
}

fn word(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes(number(bytes, at))
}

/// The record of the compression among the variable length records of a header.
fn laszip(head: &[u8]) -> Option<LazVlr> {
    let mut at = HEADER_BYTES;
    loop {
        let vlr = head.get(at..at + 54)?;
        let length = usize::from(u16::from_le_bytes(number(vlr, 20)));
        if vlr[2..].starts_with(b"laszip encoded") {
            return LazVlr::from_buffer(head.get(at + 54..at + 54 + length)?).ok();
        }
        at += 54 + length;
    }
}

impl OpenSegment<'_> {
    fn open(path: &Path) -> Result<OpenSegment<'_>> {
        let failed = |e| Error::io("read", path, e);
        let unusable = || Error::input(format!("{} is not a segment of a merge", path.display()));
        let mut file = reads::open(path).map_err(|e| Error::open(path, e))?;
        let length = file.metadata().map_err(failed)?.len();
        let mut head = vec![0; HEADER_BYTES];
        file.read_exact(&mut head).map_err(failed)?;
        let data = u64::from(word(&head, DATA_AT));
        if !head.starts_with(b"LASF") || head[24..26] != [1, 4] || data > MAX_HEAD_BYTES.min(length) {
            return Err(unusable());
        }
        head.resize((data as usize).max(HEADER_BYTES), 0);
        file.read_exact(&mut head[HEADER_BYTES..]).map_err(failed)?;
        let record = u64::from(u16::from_le_bytes(number(&head, LENGTH_AT)));
        let records = long(&head, COUNT_AT);
        if head[FORMAT_AT] & 0x80 == 0 {
            let points = data..data.saturating_add(records.saturating_mul(record));
            if points.end != length {
                return Err(unusable());
            }
            return Ok(OpenSegment { path, file, head, compression: None, points });
        }
        let vlr = laszip(&head).ok_or_else(unusable)?;
        let mut table_at = [0; 8];
        file.seek(SeekFrom::Start(data)).and_then(|_| file.read_exact(&mut table_at)).map_err(failed)?;
        let points = data + 8..u64::from_le_bytes(table_at);
        if points.end < points.start || points.end.saturating_add(8) > length {
            return Err(unusable());
        }
        let chunks = records.div_ceil(JOINED_POINTS);
        let mut counted = [0; 8];
        file.seek(SeekFrom::Start(points.end)).and_then(|_| file.read_exact(&mut counted)).map_err(failed)?;
        // A chunk holds its first point uncompressed.
        let possible = (points.end - points.start) / record.max(1);
        if u64::from(word(&counted, 4)) != chunks || chunks > possible {
            return Err(unusable());
        }
        file.seek(SeekFrom::Start(data)).map_err(failed)?;
        let table = catch_decoder_panic(|| ChunkTable::read_from(&mut file, &vlr));
        let table = table.and_then(|read| read.ok()).ok_or_else(unusable)?;
        let mut sizes = table.as_ref().iter().map(|chunk| chunk.byte_count);
        let bytes = sizes.try_fold(0u64, |sum, size| sum.checked_add(size));
        if bytes != Some(points.end - points.start) || table.as_ref().len() as u64 != chunks {
            return Err(unusable());
        }
        Ok(OpenSegment { path, file, head, compression: Some((vlr, table)), points })
    }

    fn records(&self) -> u64 {
        long(&self.head, COUNT_AT)
    }

    /// The header without the fields that depend on the points.
    fn common(&self) -> Vec<u8> {
        let mut head = self.head.clone();
        head[BOUNDS_AT..BOUNDS_AT + 48].fill(0);
        head[COUNT_AT..HEADER_BYTES].fill(0);
        head
    }

    /// Reads the complete file, passes the bytes of the points to `write` and returns the checksum of all
    /// bytes.
    fn copy(&mut self, block: &mut [u8], mut write: impl FnMut(&[u8]) -> Result<()>) -> Result<u64> {
        let failed = |e| Error::io("read", self.path, e);
        self.file.seek(SeekFrom::Start(0)).map_err(failed)?;
        let (mut sum, mut at) = (Checksum::default(), 0);
        loop {
            let count = self.file.read(block).map_err(failed)?;
            if count == 0 {
                return Ok(sum.finish());
            }
            sum.bytes(&block[..count]);
            let within = |place: u64| place.clamp(at, at + count as u64) - at;
            let points = within(self.points.start) as usize..within(self.points.end) as usize;
            write(&block[points])?;
            at += count as u64;
        }
    }
}

/// Adds counts and bounds of a header to another header.
fn add(head: &mut [u8], other: &[u8]) {
    if long(other, COUNT_AT) == 0 {
        return;
    }
    let is_first = long(head, COUNT_AT) == 0;
    for (i, at) in (BOUNDS_AT..BOUNDS_AT + 48).step_by(8).enumerate() {
        let (mine, theirs) = (double(head, at), double(other, at));
        // Maximum and minimum of x, y, z in turns.
        if is_first || (if i % 2 == 0 { theirs > mine } else { theirs < mine }) {
            head[at..at + 8].copy_from_slice(&other[at..at + 8]);
        }
    }
    for at in std::iter::once(COUNT_AT).chain((RETURNS_AT..HEADER_BYTES).step_by(8)) {
        let sum = long(head, at).saturating_add(long(other, at));
        head[at..at + 8].copy_from_slice(&sum.to_le_bytes());
    }
}

/// Joins files that were written by merges of the same shards to `out`. `progress` is called with the number
/// of points of each file that is copied, and returns true to continue.
///
/// # Errors
/// [`Error::Input`] for files of other contents and for those that do not match their checksums,
/// [`Error::Interrupted`] when `progress` returns false, [`Error::Io`].
pub fn join(
    segments: &[Segment],
    out: &Path,
    force: bool,
    mut progress: impl FnMut(u64) -> bool,
) -> Result<FileSummary> {
    let head = joined_head(segments)?;
    let mut file = FileWriter::create(out, force, Patched::Always)?;
    file.append(&head)?;
    let mut bytes = head.len() as u64;
    let (mut block, mut table, mut laszip) = (vec![0; COPY_BYTES], ChunkTable::default(), None);
    for Segment { path, records, sum } in segments {
        let mut segment = OpenSegment::open(path)?;
        if let Some((vlr, chunks)) = segment.compression.take() {
            if laszip.replace(vlr).is_none() {
                file.append(&[0; 8])?;
                bytes += 8;
            }
            chunks.as_ref().iter().for_each(|chunk| table.push(*chunk));
        }
        let copied = segment.copy(&mut block, |points| {
            bytes += points.len() as u64;
            file.append(points)
        })?;
        if copied != *sum {
            let message = format!("{} is damaged: it does not match its checksum", path.display());
            return Err(Error::input(message));
        }
        if !progress(*records) {
            return Err(Error::Interrupted);
        }
    }
    if let Some(laszip) = laszip {
        bytes += append_table(&mut file, &table, &laszip, (head.len() as u64, bytes))?;
    }
    let path = file.finish()?;
    let corner = |first: usize| DVec3::from([0, 1, 2].map(|axis| double(&head, first + 16 * axis)));
    Ok(FileSummary {
        path: Some(path),
        partial: false,
        earlier: None,
        kind: FileKind::Points,
        records: long(&head, COUNT_AT),
        bytes,
        bounds: Aabb { min: corner(BOUNDS_AT + 8), max: corner(BOUNDS_AT) },
        by_return: std::array::from_fn(|i| long(&head, RETURNS_AT + 8 * i)),
        left_out: 0,
    })
}

/// The header of the joined file, whose counts and bounds are those of all segments.
fn joined_head(segments: &[Segment]) -> Result<Vec<u8>> {
    let mut head: Option<(Vec<u8>, Vec<u8>)> = None;
    for Segment { path, records, .. } in segments {
        let segment = OpenSegment::open(path)?;
        if segment.records() != *records {
            return Err(Error::input(format!(
                "{} holds {} points instead of {records}: if points do not fit the format and are left out, \
                 merge without --segment",
                path.display(),
                segment.records()
            )));
        }
        match &mut head {
            None => head = Some((segment.head.clone(), segment.common())),
            Some((sum, common)) if *common == segment.common() => add(sum, &segment.head),
            Some(_) => {
                let message = format!(
                    "{} and {} belong to different merges",
                    segments[0].path.display(),
                    path.display()
                );
                return Err(Error::input(message));
            }
        }
    }
    head.map(|(head, _)| head).ok_or_else(|| Error::Internal("no segments".to_owned()))
}

/// Appends the sizes of all chunks at the end of the file, whose length is `at`, and stores `at` behind the
/// header. Returns the number of bytes.
fn append_table(
    file: &mut FileWriter,
    table: &ChunkTable,
    laszip: &LazVlr,
    (head, at): (u64, u64),
) -> Result<u64> {
    let mut encoded = Vec::new();
    table.write_to(&mut encoded, laszip).map_err(|e| Error::Internal(format!("LAZ: {e}")))?;
    file.append(&encoded)?;
    let patched = file
        .seek(SeekFrom::Start(head))
        .and_then(|_| file.write_all(&at.to_le_bytes()))
        .and_then(|()| file.seek(SeekFrom::End(0)));
    patched.map_err(|e| file.failed("write", e))?;
    Ok(encoded.len() as u64)
}

#[cfg(test)]
mod tests {
    use super::super::testing::{batch, survey, write};
    use super::super::{OutputRequest, PointFormat, Target};
    use super::*;

    #[test]
    fn damaged_tables_of_chunks_are_refused() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.laz");
        let sinks = vec![(Target::File(path.clone()), PointFormat::Laz)];
        let request = OutputRequest { sinks, ..OutputRequest::default() };
        write(request, &survey(1, &[None]), &[batch(0, 0, 60_000)]).unwrap();
        assert_eq!(OpenSegment::open(&path).unwrap().records(), 60_000);
        let bytes = std::fs::read(&path).unwrap();
        let data = word(&bytes, DATA_AT) as usize;
        let table = u64::from_le_bytes(number(&bytes, data)) as usize;
        let chunks = |change: &dyn Fn(&mut Vec<u8>)| -> Option<Vec<u64>> {
            let mut damaged = bytes.clone();
            change(&mut damaged);
            std::fs::write(&path, damaged).unwrap();
            let (_, table) = OpenSegment::open(&path).ok()?.compression?;
            Some(table.as_ref().iter().map(|chunk| chunk.byte_count).collect())
        };
        let whole = chunks(&|_| {}).unwrap();
        assert_eq!(whole.len(), 2);
        // The numbers of all points and of all chunks are as large as they can be.
        let many = |bytes: &mut Vec<u8>| {
            bytes[COUNT_AT..COUNT_AT + 8].fill(0xff);
            bytes[table + 4..table + 8].fill(0xff);
        };
        assert_eq!(chunks(&many), None);
        for at in table + 4..bytes.len() {
            for value in [0, 0x7f, 0xff].into_iter().filter(|&value| value != bytes[at]) {
                // The last bytes of the table are of no consequence.
                let found = chunks(&|bytes| bytes[at] = value);
                assert!(
                    found.is_none() || at > table + 8 && found.as_ref() == Some(&whole),
                    "{at} {value} {found:?}"
                );
            }
        }
    }

    #[test]
    fn every_changed_bit_of_a_segment_is_found() {
        let dir = tempfile::tempdir().unwrap();
        for (name, format) in [("a.las", PointFormat::Las), ("a.laz", PointFormat::Laz)] {
            let (path, out) = (dir.path().join(name), dir.path().join("out"));
            let sinks = vec![(Target::File(path.clone()), format)];
            let request = OutputRequest { sinks, ..OutputRequest::default() };
            write(request, &survey(1, &[None]), &[batch(0, 0, 7)]).unwrap();
            let mut whole = std::fs::read(&path).unwrap();
            let mut sum = Checksum::default();
            sum.bytes(&whole);
            let segments = [Segment { path: path.clone(), records: 7, sum: sum.finish() }];
            assert_eq!(join(&segments, &out, true, |_| true).unwrap().records, 7);
            assert!(std::fs::read(&out).unwrap() == whole, "{name}");
            let mut block = vec![0; 1 << 10];
            for bit in 0..8 * whole.len() {
                whole[bit / 8] ^= 1 << (bit % 8);
                std::fs::write(&path, &whole).unwrap();
                let copied = OpenSegment::open(&path).and_then(|mut open| open.copy(&mut block, |_| Ok(())));
                assert!(
                    copied.is_err() || copied.is_ok_and(|sum| sum != segments[0].sum),
                    "{name}: bit {bit}"
                );
                if bit % 61 == 0 {
                    assert!(join(&segments, &out, true, |_| true).is_err(), "{name}: bit {bit}");
                }
                whole[bit / 8] ^= 1 << (bit % 8);
            }
        }
    }
}
