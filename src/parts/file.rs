//! The file of a part: complete or absent, and everything that a merge needs to know is in it.
//!
//! ```text
//! 0    magic │ version u32 │ length of the head u32 │ checksum of the head u64
//! 24   head
//!      blocks
//!      table: the heads of all blocks
//!      offset of the table u64 │ pulses u64 │ echoes u64 │ checksum of the table and of these numbers u64 │ magic
//! ```

use super::block::{self, BlockHead, HEAD_BYTES, RECORDS_AT, RawBlock};
use super::fingerprint::Fingerprint;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use vlscan_base::files::{read_exact_at, reads};
use vlscan_lidar::pulse::Batch;
use xxhash_rust::xxh3::{Xxh3, xxh3_64};

/// The first bytes of every part.
pub(super) const MAGIC: &[u8; 8] = b"VLSPART\n";
/// Version of the contents; incremented whenever the meaning of any content changes.
pub(super) const VERSION: u32 = 4;
const START_BYTES: usize = 24;
const END_BYTES: usize = 40;

/// What a part is a part of.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PartHead {
    /// What the contents depend on.
    pub fingerprint: Fingerprint,
    /// Number of the part, from 0.
    pub number: u32,
    /// Number of parts.
    pub of: u32,
    /// Pulses of all parts.
    pub total: u64,
    /// Epochs of the whole run.
    pub epochs: u32,
    /// Year and day of the year for the headers of files.
    pub creation: (u16, u16),
    /// What is recorded beside echoes and poses.
    pub records: Records,
    /// What the records of LAS depend on, if the part holds these instead of echoes.
    pub las: Option<Fingerprint>,
    /// The encoded facts that outputs depend on.
    pub context: Vec<u8>,
}

/// Records of a part beside echoes and poses.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Records {
    /// Digitised waveforms.
    pub waveforms: bool,
    /// Emitted pulses.
    pub pulses: bool,
    /// True causes of echoes.
    pub truth: bool,
    /// Positions of echoes in the axes of the scanner.
    pub scanner_axes: bool,
    /// Whether the echoes are the reflections of subrays.
    pub subrays: bool,
}

impl Records {
    /// What is in either of both.
    pub fn union(self, other: Records) -> Records {
        Records {
            waveforms: self.waveforms | other.waveforms,
            pulses: self.pulses | other.pulses,
            truth: self.truth | other.truth,
            scanner_axes: self.scanner_axes | other.scanner_axes,
            subrays: self.subrays | other.subrays,
        }
    }
}

impl PartHead {
    /// Says in what the run of another part differs.
    pub fn difference(&self, other: &PartHead) -> String {
        let points = || match (&self.las, &other.las) {
            (Some(mine), Some(theirs)) => mine.difference(theirs),
            (None, None) => None,
            _ => Some("what they hold of the points, echoes or records of LAS (--part-points)".to_owned()),
        };
        let found = points().or_else(|| self.fingerprint.difference(&other.fingerprint));
        found.unwrap_or_else(|| "what they are parts of".to_owned())
    }

    /// The bytes at the beginning of the file.
    pub fn bytes(&self) -> Result<Vec<u8>, postcard::Error> {
        let head = postcard::to_stdvec(self)?;
        let mut bytes = MAGIC.to_vec();
        bytes.extend(VERSION.to_le_bytes());
        bytes.extend((head.len() as u32).to_le_bytes());
        bytes.extend(xxh3_64(&head).to_le_bytes());
        bytes.extend(head);
        Ok(bytes)
    }
}

/// The table of a part that is being written.
#[derive(Debug)]
pub struct PartTable {
    at: u64,
    heads: Vec<u8>,
    pulses: u64,
    echoes: u64,
}

impl PartTable {
    /// The table of a file whose first block begins at `at`.
    pub fn new(at: u64) -> PartTable {
        PartTable { at, heads: Vec::new(), pulses: 0, echoes: 0 }
    }

    /// Adds the blocks in `bytes`, the next of the file.
    pub fn add(&mut self, mut bytes: &[u8]) {
        self.at += bytes.len() as u64;
        while let Some(head) = BlockHead::read(bytes) {
            self.heads.extend_from_slice(&bytes[..HEAD_BYTES]);
            self.pulses += u64::from(head.pulses);
            self.echoes += u64::from(head.echoes);
            bytes = bytes.get(HEAD_BYTES + head.length as usize..).unwrap_or_default();
        }
    }

    /// The bytes at the end of the file.
    pub fn finish(self) -> Vec<u8> {
        let mut bytes = self.heads;
        let table = bytes.len();
        bytes.extend([self.at, self.pulses, self.echoes].iter().flat_map(|number| number.to_le_bytes()));
        let sum = end_sum(&bytes[..table], &bytes[table..]);
        bytes.extend(sum.to_le_bytes());
        bytes.extend(MAGIC);
        bytes
    }
}

fn end_sum(table: &[u8], numbers: &[u8]) -> u64 {
    let mut sum = Xxh3::new();
    sum.update(table);
    sum.update(numbers);
    sum.digest()
}

/// An open part, whose head and table are sound.
#[derive(Debug)]
pub struct PartFile {
    path: PathBuf,
    file: File,
    pub head: PartHead,
    /// Pulses emitted in this part.
    pub pulses: u64,
    /// Echoes of this part.
    pub echoes: u64,
    /// Offset of each block with its head.
    blocks: Vec<(u64, BlockHead)>,
}

impl PartFile {
    /// Opens a part and checks its head and its table. The error is the reason why it cannot be used.
    pub fn open(path: &Path) -> Result<PartFile, String> {
        let read = |e: io::Error| format!("cannot be read: {e}");
        let file = reads::open(path).map_err(read)?;
        let length = file.metadata().map_err(read)?.len();
        if length < (START_BYTES + END_BYTES) as u64 {
            return Err("is too short to be a part".to_owned());
        }
        let start = take(&file, 0, START_BYTES).map_err(read)?;
        if !start.starts_with(MAGIC) {
            return Err("is a file of another kind".to_owned());
        }
        let version = u32::from_le_bytes([start[8], start[9], start[10], start[11]]);
        if version != VERSION {
            return Err(format!("has version {version} of the format, this program reads {VERSION}"));
        }
        let head_length = u64::from(u32::from_le_bytes([start[12], start[13], start[14], start[15]]));
        let blocks_at = START_BYTES as u64 + head_length;
        if blocks_at + END_BYTES as u64 > length {
            return Err("is cut short".to_owned());
        }
        let head = take(&file, START_BYTES as u64, head_length as usize).map_err(read)?;
        if xxh3_64(&head) != long(&start, 16) {
            return Err("is damaged: the checksum of its head differs".to_owned());
        }
        let head: PartHead =
            postcard::from_bytes(&head).map_err(|_| "is damaged: its head cannot be read".to_owned())?;
        let end = take(&file, length - END_BYTES as u64, END_BYTES).map_err(read)?;
        if !end.ends_with(MAGIC) {
            return Err("is cut short".to_owned());
        }
        let (table_at, pulses, echoes) = (long(&end, 0), long(&end, 8), long(&end, 16));
        let table_end = length - END_BYTES as u64;
        if !(blocks_at..=table_end).contains(&table_at) {
            return Err("is damaged: its table has no place".to_owned());
        }
        let table = take(&file, table_at, (table_end - table_at) as usize).map_err(read)?;
        if end_sum(&table, &end[..24]) != long(&end, 24) {
            return Err("is damaged: the checksum of its table differs".to_owned());
        }
        let mut at = blocks_at;
        let mut blocks = Vec::with_capacity(table.len() / HEAD_BYTES);
        for bytes in table.chunks(HEAD_BYTES) {
            let head = BlockHead::read(bytes).ok_or("is damaged: its table cannot be read")?;
            blocks.push((at, head));
            at = at.saturating_add(head.length).saturating_add(HEAD_BYTES as u64);
        }
        if at != table_at {
            return Err("is damaged: its blocks and its table differ".to_owned());
        }
        Ok(PartFile { path: path.to_path_buf(), file, head, pulses, echoes, blocks })
    }

    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Number of blocks.
    pub fn blocks(&self) -> usize {
        self.blocks.len()
    }

    /// The head of a block, if there are so many.
    pub fn block(&self, number: usize) -> Option<BlockHead> {
        self.blocks.get(number).map(|(_, head)| *head)
    }

    /// Reads the complete part and compares its checksums, with all threads. The error is the reason why it cannot be used.
    pub fn verify(&self) -> Result<(), String> {
        let check = |buffer: &mut Vec<u8>, (number, (at, head)): (usize, &(u64, BlockHead))| {
            buffer.resize(HEAD_BYTES + head.length as usize, 0);
            read_exact_at(&self.file, buffer, *at).map_err(|e| format!("cannot be read: {e}"))?;
            head.is_of(buffer).then_some(()).ok_or_else(|| damaged_block(number))
        };
        self.blocks.par_iter().enumerate().try_for_each_init(Vec::new, check)
    }

    /// Reads a block into a batch, by way of `buffer`. Returns the records of LAS, if the part holds these instead of echoes.
    /// The error is the reason why it cannot be used.
    pub fn read(
        &self,
        block: usize,
        batch: &mut Batch,
        buffer: &mut Vec<u8>,
    ) -> Result<Option<Vec<u8>>, String> {
        let (at, head) = self.blocks.get(block).ok_or_else(|| format!("has no block {block}"))?;
        let failed = |e| format!("cannot be read: {e}");
        let damaged = || damaged_block(block);
        if self.head.las.is_none() {
            buffer.resize(HEAD_BYTES + head.length as usize, 0);
            read_exact_at(&self.file, buffer, *at).map_err(failed)?;
            let (start, columns) = buffer.split_at(HEAD_BYTES);
            let block = RawBlock { head: start, records: None, columns };
            return block::decode(head, &block, batch).map(|()| None).ok_or_else(damaged);
        }
        // Records are read to the memory from which they are written.
        let mut start = [0; RECORDS_AT];
        read_exact_at(&self.file, &mut start, *at).map_err(failed)?;
        let (start, length) = start.split_at(HEAD_BYTES);
        let room = head.length.saturating_sub(8);
        let count = long(length, 0);
        if count > room {
            return Err(damaged());
        }
        let records = take(&self.file, at + RECORDS_AT as u64, count as usize).map_err(failed)?;
        buffer.resize((room - count) as usize, 0);
        read_exact_at(&self.file, buffer, at + RECORDS_AT as u64 + count).map_err(failed)?;
        let block = RawBlock { head: start, records: Some([length, &records]), columns: buffer };
        block::decode(head, &block, batch).map(|()| Some(records)).ok_or_else(damaged)
    }
}

fn damaged_block(number: usize) -> String {
    format!("is damaged: the checksum of block {number} differs")
}

fn long(bytes: &[u8], at: usize) -> u64 {
    u64::from_le_bytes([0, 1, 2, 3, 4, 5, 6, 7].map(|i| bytes[at + i]))
}

/// Reads `count` bytes at an offset to new memory.
#[cfg(unix)]
fn take(file: &File, at: u64, count: usize) -> io::Result<Vec<u8>> {
    // `read_at` needs memory that was zeroed, which takes a twentieth of a merge.
    let mut bytes = Vec::with_capacity(count);
    while bytes.len() < count {
        let end = at + bytes.len() as u64;
        match rustix::io::pread(file, rustix::buffer::spare_capacity(&mut bytes), end) {
            Ok(0) => return Err(io::ErrorKind::UnexpectedEof.into()),
            Ok(_) | Err(rustix::io::Errno::INTR) => {}
            Err(e) => return Err(e.into()),
        }
    }
    bytes.truncate(count);
    Ok(bytes)
}

/// Reads `count` bytes at an offset to new memory.
#[cfg(windows)]
fn take(file: &File, at: u64, count: usize) -> io::Result<Vec<u8>> {
    let mut bytes = vec![0; count];
    read_exact_at(file, &mut bytes, at).map(|()| bytes)
}

#[cfg(test)]
pub(super) mod tests {
    use super::super::block::tests::batch;
    use super::*;

    pub fn head(number: u32, of: u32) -> PartHead {
        let mut fingerprint = Fingerprint::default();
        fingerprint.flight("seed", 11);
        PartHead {
            fingerprint,
            number,
            of,
            total: 520 * u64::from(of),
            epochs: 2,
            creation: (2024, 1),
            records: Records::default(),
            las: None,
            context: vec![1, 2, 3],
        }
    }

    /// The bytes of a part with two blocks, 520 pulses.
    pub fn part(head: &PartHead) -> Vec<u8> {
        let mut bytes = head.bytes().unwrap();
        let mut table = PartTable::new(bytes.len() as u64);
        for batch in [batch(0, 0, 500), batch(1, 1, 20)] {
            let mut block = Vec::new();
            block::encode(&batch, &mut block);
            table.add(&block);
            bytes.extend(block);
        }
        bytes.extend(table.finish());
        bytes
    }

    #[test]
    fn a_part_comes_back_and_damage_is_found() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        let whole = part(&head(3, 7));
        std::fs::write(&path, &whole).unwrap();
        let file = PartFile::open(&path).unwrap();
        assert_eq!((file.head.clone(), file.pulses, file.echoes), (head(3, 7), 520, 520));
        let (mut read, mut buffer) = (Batch::default(), Vec::new());
        for (i, expected) in [batch(0, 0, 500), batch(1, 1, 20)].iter().enumerate() {
            file.read(i, &mut read, &mut buffer).unwrap();
            assert_eq!(format!("{read:?}"), format!("{expected:?}"));
        }
        for length in [0, 10, 63, 100, whole.len() / 2, whole.len() - 1] {
            std::fs::write(&path, &whole[..length]).unwrap();
            assert!(PartFile::open(&path).is_err(), "{length} bytes");
        }
    }

    #[test]
    fn every_changed_bit_is_found() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        for holds_records in [false, true] {
            let las = holds_records.then(Fingerprint::default);
            let mut whole = PartHead { las, ..head(0, 1) }.bytes().unwrap();
            let mut table = PartTable::new(whole.len() as u64);
            for batch in [batch(0, 0, 3), batch(1, 1, 1)] {
                let mut block = Vec::new();
                match holds_records {
                    false => block::encode(&batch, &mut block),
                    true => block::encode_records(&batch, |out| out.extend([7; 30]), &mut block),
                }
                table.add(&block);
                whole.extend(block);
            }
            whole.extend(table.finish());
            let (mut batch, mut buffer) = (Batch::default(), Vec::new());
            let mut read = |bytes: &[u8]| {
                std::fs::write(&path, bytes).unwrap();
                let file = PartFile::open(&path)?;
                let mut read_all =
                    || (0..file.blocks()).try_for_each(|i| file.read(i, &mut batch, &mut buffer).map(drop));
                // What a merge reads and what is verified agree.
                assert_eq!(read_all().is_err(), file.verify().is_err());
                read_all()
            };
            read(&whole).unwrap();
            for bit in 0..8 * whole.len() {
                whole[bit / 8] ^= 1 << (bit % 8);
                assert!(read(&whole).is_err(), "a change of bit {bit} is not found");
                whole[bit / 8] ^= 1 << (bit % 8);
            }
        }
    }
}
