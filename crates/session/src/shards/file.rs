//! The file of a shard: complete or absent, with everything that a merge needs.
//!
//! ```text
//! 0    magic │ version u64
//! 16   blocks
//!      index: head of the shard, heads of all blocks
//!      length of the index u64 │ checksum of the index u64 │ magic
//! ```

use super::block::{self, BlockHead};
use super::fingerprint::Fingerprint;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use vlscan_base::error::{Error, Result};
use vlscan_base::files::{read_exact_at, reads};
use vlscan_lidar::pulse::{Batch, PhysicsOptions};
use xxhash_rust::xxh3::xxh3_64;

/// The first bytes of every shard.
pub(super) const MAGIC: &[u8; 8] = b"VLSHARD\n";
/// Version of the contents; incremented whenever the meaning of any content changes.
const VERSION: u64 = 8;
const START_BYTES: usize = 16;
const END_BYTES: usize = 24;

/// The run that a shard belongs to, and the shard's share of it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ShardHead {
    /// Everything on which the contents depend.
    pub fingerprint: Fingerprint,
    /// Number of the shard, from 0.
    pub number: u32,
    /// Number of shards.
    pub of: u32,
    /// Pulses of all shards.
    pub total: u64,
    /// Epochs of the whole run.
    pub epochs: u32,
    /// Year and day of the year for the headers of files.
    pub creation: (u16, u16),
    /// Records in addition to echoes and poses.
    pub records: Records,
    /// The encoded facts that outputs depend on.
    pub context: Vec<u8>,
}

/// Records of a shard in addition to echoes and poses.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Records {
    /// Digitised waveforms.
    pub waveforms: bool,
    /// Emitted pulses.
    pub pulses: bool,
    /// True causes of echoes.
    pub truth: bool,
    /// Colours of surfaces, with the true causes.
    pub colours: bool,
    /// Positions of echoes in the axes of the scanner.
    pub scanner_axes: bool,
    /// True if the echoes are the reflections of subrays.
    pub subrays: bool,
    /// Radial velocities of echoes, with the true causes.
    pub velocities: bool,
}

impl Records {
    /// Records of a simulation.
    pub fn of(physics: &PhysicsOptions) -> Records {
        Records {
            waveforms: physics.record_waveforms,
            pulses: physics.record_pulses,
            truth: physics.record_truth,
            colours: physics.record_colours,
            scanner_axes: physics.record_scanner_axes,
            subrays: physics.record_subrays,
            velocities: physics.record_velocities,
        }
    }

    /// The options of a simulation that records this.
    pub fn recorded_by(self, physics: PhysicsOptions) -> PhysicsOptions {
        PhysicsOptions {
            record_waveforms: self.waveforms,
            record_pulses: self.pulses,
            record_truth: self.truth,
            record_colours: self.colours,
            record_scanner_axes: self.scanner_axes,
            record_subrays: self.subrays,
            record_velocities: self.velocities,
            ..physics
        }
    }

    /// Records in either of both.
    pub fn union(self, other: Records) -> Records {
        Records {
            waveforms: self.waveforms | other.waveforms,
            pulses: self.pulses | other.pulses,
            truth: self.truth | other.truth,
            colours: self.colours | other.colours,
            scanner_axes: self.scanner_axes | other.scanner_axes,
            subrays: self.subrays | other.subrays,
            velocities: self.velocities | other.velocities,
        }
    }
}

impl ShardHead {
    /// Describes how the run of another shard differs.
    pub fn difference(&self, other: &ShardHead) -> String {
        let found = self.fingerprint.difference(&other.fingerprint);
        found.unwrap_or_else(|| "the run that they belong to".to_owned())
    }

    /// The bytes that [`BlockTable::new`] takes.
    pub fn bytes(&self) -> Result<Vec<u8>> {
        postcard::to_stdvec(self).map_err(|e| Error::Internal(format!("head of a shard: {e}")))
    }
}

/// Facts about a shard when all of its blocks are written.
#[derive(Debug, Serialize, Deserialize)]
struct Index {
    head: Vec<u8>,
    blocks: Vec<BlockHead>,
}

/// The index of a shard that is being written.
#[derive(Debug)]
pub struct BlockTable(Index);

impl BlockTable {
    /// The bytes before the first block.
    pub fn start() -> Vec<u8> {
        [*MAGIC, VERSION.to_le_bytes()].concat()
    }

    /// The index of a shard with this head.
    pub fn new(head: Vec<u8>) -> BlockTable {
        BlockTable(Index { head, blocks: Vec::new() })
    }

    /// Adds the blocks in `bytes`, the next of the file.
    pub fn add(&mut self, mut bytes: &[u8]) {
        while let Some(head) = BlockHead::read(bytes) {
            self.0.blocks.push(head);
            bytes = bytes.get(head.bytes_of_block()..).unwrap_or_default();
        }
    }

    /// The bytes after the last block.
    pub fn finish(self) -> Result<Vec<u8>> {
        let mut bytes =
            postcard::to_stdvec(&self.0).map_err(|e| Error::Internal(format!("index of a shard: {e}")))?;
        let (length, sum) = (bytes.len() as u64, xxh3_64(&bytes));
        bytes.extend([length, sum].iter().flat_map(|number| number.to_le_bytes()));
        bytes.extend(MAGIC);
        Ok(bytes)
    }
}

/// Reason why the file of a shard cannot be used; the text follows the path of the file.
#[non_exhaustive]
#[derive(Debug, thiserror::Error)]
pub enum ShardFileError {
    /// An operation of the system that failed.
    #[error("cannot be read: {0}")]
    Unreadable(io::Error),
    /// Fewer bytes than an empty shard has.
    #[error("is too short to be a shard")]
    Short,
    /// A beginning that differs from shards.
    #[error("has another file format")]
    Format,
    /// The version of another program.
    #[error("has version {0} of the format, this program reads {version}", version = VERSION)]
    Version(u64),
    /// A file without its end.
    #[error("is truncated")]
    Truncated,
    /// An index whose bytes have changed.
    #[error("is damaged: the checksum of its index differs")]
    IndexChecksum,
    /// An index that does not follow the format.
    #[error("is damaged: its index cannot be read")]
    Index,
    /// Blocks of another length than the index states.
    #[error("is damaged: its blocks and its index differ")]
    Length,
    /// A block, by its number, whose bytes have changed.
    #[error("is damaged: the checksum of block {0} differs")]
    Block(usize),
    /// A block, by its number, beyond the last one.
    #[error("has no block {0}")]
    NoBlock(usize),
    /// Another share than the name of the file states.
    #[error("is shard {number} of {of}")]
    Other {
        /// Number of the shard.
        number: u32,
        /// Number of shards.
        of: u32,
    },
}

/// An open shard, whose index is valid.
#[derive(Debug)]
pub struct ShardFile {
    path: PathBuf,
    file: File,
    /// The run, and the share of it that the shard holds.
    pub head: ShardHead,
    /// Pulses emitted in this shard.
    pub pulses: u64,
    /// Echoes of this shard.
    pub echoes: u64,
    /// Offset of each block with its head.
    blocks: Vec<(u64, BlockHead)>,
}

impl ShardFile {
    /// Opens a shard and checks its index.
    pub fn open(path: &Path) -> Result<ShardFile, ShardFileError> {
        let read = ShardFileError::Unreadable;
        let file = reads::open(path).map_err(read)?;
        let length = file.metadata().map_err(read)?.len();
        if length < (START_BYTES + END_BYTES) as u64 {
            return Err(ShardFileError::Short);
        }
        let start = take(&file, 0, START_BYTES).map_err(read)?;
        if !start.starts_with(MAGIC) {
            return Err(ShardFileError::Format);
        }
        let version = long(&start, 8);
        if version != VERSION {
            return Err(ShardFileError::Version(version));
        }
        let end_at = length - END_BYTES as u64;
        let end = take(&file, end_at, END_BYTES).map_err(read)?;
        let index_at = end_at.checked_sub(long(&end, 0)).filter(|at| *at >= START_BYTES as u64);
        let Some(index_at) = index_at.filter(|_| end.ends_with(MAGIC)) else {
            return Err(ShardFileError::Truncated);
        };
        let index = take(&file, index_at, (end_at - index_at) as usize).map_err(read)?;
        if xxh3_64(&index) != long(&end, 8) {
            return Err(ShardFileError::IndexChecksum);
        }
        let unreadable = |_| ShardFileError::Index;
        let index: Index = postcard::from_bytes(&index).map_err(unreadable)?;
        let head: ShardHead = postcard::from_bytes(&index.head).map_err(unreadable)?;
        let mut at = START_BYTES as u64;
        let (mut pulses, mut echoes) = (0, 0);
        let mut blocks = Vec::with_capacity(index.blocks.len());
        for block in index.blocks {
            blocks.push((at, block));
            at = at.saturating_add(block.bytes_of_block() as u64);
            pulses += u64::from(block.pulses);
            echoes += u64::from(block.echoes);
        }
        if at != index_at {
            return Err(ShardFileError::Length);
        }
        Ok(ShardFile { path: path.to_path_buf(), file, head, pulses, echoes, blocks })
    }

    /// The path of the file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Number of blocks.
    pub fn blocks(&self) -> usize {
        self.blocks.len()
    }

    /// The head of a block, if there are this many.
    pub fn block(&self, number: usize) -> Option<BlockHead> {
        self.blocks.get(number).map(|(_, head)| *head)
    }

    /// Reads the complete shard and compares its checksums, with all threads.
    pub fn verify(&self) -> Result<(), ShardFileError> {
        let check = |buffer: &mut Vec<u8>, (number, (at, head)): (usize, &(u64, BlockHead))| {
            buffer.resize(head.bytes_of_block(), 0);
            read_exact_at(&self.file, buffer, *at).map_err(ShardFileError::Unreadable)?;
            head.is_of(buffer).then_some(()).ok_or(ShardFileError::Block(number))
        };
        self.blocks.par_iter().enumerate().try_for_each_init(Vec::new, check)
    }

    /// Reads a block into a batch, by way of `buffer`.
    pub fn read(&self, block: usize, batch: &mut Batch, buffer: &mut Vec<u8>) -> Result<(), ShardFileError> {
        let (at, head) = self.blocks.get(block).ok_or(ShardFileError::NoBlock(block))?;
        buffer.resize(head.bytes_of_block(), 0);
        read_exact_at(&self.file, buffer, *at).map_err(ShardFileError::Unreadable)?;
        block::decode(head, buffer, batch).ok_or(ShardFileError::Block(block))
    }
}

fn long(bytes: &[u8], at: usize) -> u64 {
    u64::from_le_bytes([0, 1, 2, 3, 4, 5, 6, 7].map(|i| bytes[at + i]))
}

/// Reads `count` bytes at an offset to new memory.
fn take(file: &File, at: u64, count: usize) -> io::Result<Vec<u8>> {
    let mut bytes = vec![0; count];
    read_exact_at(file, &mut bytes, at).map(|()| bytes)
}

#[cfg(test)]
pub(super) mod tests {
    use super::super::block::tests::batch;
    use super::*;

    pub fn head(number: u32, of: u32) -> ShardHead {
        let mut fingerprint = Fingerprint::default();
        fingerprint.flight("seed", 11);
        ShardHead {
            fingerprint,
            number,
            of,
            total: 520 * u64::from(of),
            epochs: 2,
            creation: (2024, 1),
            records: Records::default(),
            context: vec![1, 2, 3],
        }
    }

    /// The bytes of a shard with two blocks, 520 pulses.
    pub fn shard(head: &ShardHead) -> Vec<u8> {
        let (mut bytes, mut table) = (BlockTable::start(), BlockTable::new(head.bytes().unwrap()));
        for batch in [batch(0, 0, 500), batch(1, 1, 20)] {
            let mut block = Vec::new();
            block::encode(&batch, &mut block);
            table.add(&block);
            bytes.extend(block);
        }
        bytes.extend(table.finish().unwrap());
        bytes
    }

    #[test]
    fn a_part_comes_back_and_damage_is_found() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        let whole = shard(&head(3, 7));
        std::fs::write(&path, &whole).unwrap();
        let file = ShardFile::open(&path).unwrap();
        assert_eq!((file.head.clone(), file.pulses, file.echoes), (head(3, 7), 520, 520));
        let (mut read, mut buffer) = (Batch::default(), Vec::new());
        for (i, expected) in [batch(0, 0, 500), batch(1, 1, 20)].iter().enumerate() {
            file.read(i, &mut read, &mut buffer).unwrap();
            assert_eq!(format!("{read:?}"), format!("{expected:?}"));
        }
        for length in [0, 10, 63, 100, whole.len() / 2, whole.len() - 1] {
            std::fs::write(&path, &whole[..length]).unwrap();
            assert!(ShardFile::open(&path).is_err(), "{length} bytes");
        }
    }

    #[test]
    fn every_changed_bit_is_found() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        let (mut whole, mut table) = (BlockTable::start(), BlockTable::new(head(0, 1).bytes().unwrap()));
        for batch in [batch(0, 0, 3), batch(1, 1, 1)] {
            let mut block = Vec::new();
            block::encode(&batch, &mut block);
            table.add(&block);
            whole.extend(block);
        }
        whole.extend(table.finish().unwrap());
        let (mut batch, mut buffer) = (Batch::default(), Vec::new());
        let mut read = |bytes: &[u8]| {
            std::fs::write(&path, bytes).unwrap();
            let file = ShardFile::open(&path)?;
            let mut read_all = || (0..file.blocks()).try_for_each(|i| file.read(i, &mut batch, &mut buffer));
            // A merge reads exactly the verified bytes.
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
