//! File format of named arrays, for mapping.
//!
//! ```text
//! 0    magic "VLSCENE\n" │ version u32 │ byte order u32 │ table: offset, length, checksum │ file length │ checksum │ 0 u64
//! 64   arrays, each at a multiple of 64, padded with zeros
//!      table: for each array its name, first and last offset, bytes of an element; the checksums of blocks
//! ```
//!
//! The file from byte 64 to the table is divided at multiples of 256 KiB into blocks, each with a checksum. Opening
//! checks the header and the table, which takes microseconds: it detects other formats, versions and byte orders,
//! truncated and extended files, and damage outside the blocks. A block is compared with its checksum before the first
//! access to it, see [`super::catch_loss`]; [`ArrayFile::verify`] compares all of them.

use super::array::Store;
use super::bytes::{ByteReader, ByteWriter, UnexpectedEnd};
use super::mapped::{CHECKED_BYTES, Cause, Checksums, FileBytes};
use super::sum::Checksum;
use crate::error::{Error, Result};
use crate::files::{FileWriter, Patched, fault};
use bytemuck::{AnyBitPattern, NoUninit};
use rayon::prelude::*;
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use xxhash_rust::xxh3::{Xxh3Default, xxh3_64};

const MAGIC: &[u8; 8] = b"VLSCENE\n";

/// Version of the contents; incremented whenever the meaning of any content changes, such as the elements of an array.
const VERSION: u32 = 5;

/// Written in native byte order; a machine of the opposite order reads a different number.
const BYTE_ORDER: u32 = 0x0102_0304;

const HEADER_BYTES: usize = 64;

/// Maximum number of arrays that a message names.
const MAX_SHOWN_NAMES: usize = 5;

/// Offsets of arrays are multiples of this number of bytes, which satisfies the alignment of every element type.
const ALIGNMENT: u64 = 64;

/// Writes a file of arrays.
pub struct ArrayFileWriter {
    out: BufWriter<FileWriter>,
    at: u64,
    table: Vec<Entry>,
    /// Checksums of the complete blocks, and of the last block so far.
    sums: Vec<u64>,
    last: Xxh3Default,
}

/// Table entry of an array.
struct Entry {
    name: String,
    bytes: Range<u64>,
    element: u64,
}

impl ArrayFileWriter {
    /// Begins a file, which gets its name at the end and replaces an existing one then.
    pub fn create(path: &Path) -> Result<ArrayFileWriter> {
        let file = FileWriter::create(path, true, Patched::Always)?;
        let out = BufWriter::with_capacity(1 << 20, file);
        let (table, sums, last) = (Vec::new(), Vec::new(), Xxh3Default::new());
        let mut writer = ArrayFileWriter { out, at: 0, table, sums, last };
        writer.put(&[0; HEADER_BYTES])?;
        Ok(writer)
    }

    pub fn array<T: NoUninit>(&mut self, name: impl Into<String>, values: &[T]) -> Result<()> {
        let bytes: &[u8] = bytemuck::cast_slice(values);
        let gap = self.at.next_multiple_of(ALIGNMENT) - self.at;
        self.put_checked(&[0; ALIGNMENT as usize][..gap as usize])?;
        let start = self.at;
        self.put_checked(bytes)?;
        let element = size_of::<T>() as u64;
        self.table.push(Entry { name: name.into(), bytes: start..self.at, element });
        Ok(())
    }

    /// Completes the file and returns its length, bytes.
    pub fn finish(mut self) -> Result<u64> {
        let mut table = ByteWriter::default();
        table.list(&self.table, |w, e| {
            w.text(&e.name);
            [e.bytes.start, e.bytes.end, e.element].into_iter().for_each(|n| w.u64(n));
        });
        self.sums.push(self.last.digest());
        table.list(&self.sums, |w, sum| w.u64(*sum));
        let start = self.at;
        self.put(table.bytes())?;
        let mut header = MAGIC.to_vec();
        header.extend(VERSION.to_ne_bytes());
        header.extend(BYTE_ORDER.to_ne_bytes());
        for number in [start, table.bytes().len() as u64, xxh3_64(table.bytes()), self.at] {
            header.extend(number.to_ne_bytes());
        }
        header.extend(xxh3_64(&header).to_ne_bytes());
        let ArrayFileWriter { mut out, at, .. } = self;
        let write = |out: &mut BufWriter<FileWriter>| {
            out.seek(SeekFrom::Start(0))?;
            out.write_all(&header)?;
            out.flush()
        };
        write(&mut out).map_err(|e| out.get_ref().failed("write", e))?;
        let (file, _) = out.into_parts();
        file.finish().map(|_| at)
    }

    /// Writes bytes and adds them to the checksums of their blocks.
    fn put_checked(&mut self, mut bytes: &[u8]) -> Result<()> {
        while !bytes.is_empty() {
            let room = CHECKED_BYTES - self.at as usize % CHECKED_BYTES;
            let (now, later) = bytes.split_at(room.min(bytes.len()));
            self.last.update(now);
            self.put(now)?;
            if now.len() == room {
                self.sums.push(self.last.digest());
                self.last.reset();
            }
            bytes = later;
        }
        Ok(())
    }

    fn put(&mut self, bytes: &[u8]) -> Result<()> {
        self.out.write_all(bytes).map_err(|e| self.out.get_ref().failed("write", e))?;
        self.at += bytes.len() as u64;
        Ok(())
    }
}

/// A mapped file of arrays.
#[derive(Debug)]
pub struct ArrayFile {
    path: PathBuf,
    bytes: Arc<FileBytes>,
    table: Vec<Entry>,
    sums: Arc<Checksums>,
}

impl std::fmt::Debug for Entry {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        write!(f, "{} at {:?}", self.name, self.bytes)
    }
}

impl ArrayFile {
    /// Maps a file and checks its header and its table.
    ///
    /// # Errors
    /// [`Error::Input`] with the reason why the file cannot be used; [`Error::Io`] when it cannot be read.
    pub fn open(path: &Path) -> Result<ArrayFile> {
        let bytes = fault::point().and_then(|()| FileBytes::open(path));
        let bytes = bytes.map_err(|e| Error::io("read", path, e))?;
        if bytes.len() < HEADER_BYTES {
            return Err(refuse(path, "it is too short to be a packed scene"));
        }
        let (table, sums) = read_table(&bytes).map_err(|reason| refuse(path, &reason))?;
        let sums = Arc::new(sums);
        bytes.protect(sums.clone()).map_err(|e| Error::io("read", path, e))?;
        let file = ArrayFile { path: path.to_path_buf(), bytes: Arc::new(bytes), table, sums };
        if !file.bytes.is_mapped() {
            file.verify()?;
        }
        Ok(file)
    }

    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Length of the file, bytes.
    pub fn length(&self) -> u64 {
        self.bytes.len() as u64
    }

    /// An array by its name. The error is the reason why it cannot be used.
    pub fn array<T: AnyBitPattern>(&self, name: &str) -> std::result::Result<Store<T>, String> {
        let entry = self.table.iter().find(|e| e.name == name);
        let entry = entry.ok_or_else(|| format!("it lacks the array {name}"))?;
        let range = entry.bytes.start as usize..entry.bytes.end as usize;
        let values =
            (entry.element == size_of::<T>() as u64).then(|| Store::mapped(&self.bytes, range)).flatten();
        values.ok_or_else(|| format!("the array {name} has another layout"))
    }

    /// A small array of bytes, after comparing its checksums.
    pub fn checked(&self, name: &str) -> Result<Store<u8>> {
        let values = self.array::<u8>(name).map_err(|reason| self.refuse(&reason))?;
        let bytes = self.table.iter().find(|e| e.name == name).map_or(0..0, |e| e.bytes.clone());
        let blocks = bytes.start as usize / CHECKED_BYTES..(bytes.end as usize).div_ceil(CHECKED_BYTES);
        self.verify_blocks(blocks).map(|()| values)
    }

    /// Checksum of the contents, from the checksums within the file.
    pub fn fingerprint(&self) -> u64 {
        let mut sum = Checksum::default();
        self.table.iter().for_each(|e| sum.debug(&(&e.name, e.element, &e.bytes)));
        sum.array(&self.sums.sums);
        sum.finish()
    }

    /// Reads the complete file and compares all checksums.
    ///
    /// # Errors
    /// [`Error::Input`] with the names of the damaged arrays; [`Error::Io`] when the file cannot be read.
    pub fn verify(&self) -> Result<()> {
        self.verify_blocks(0..self.sums.sums.len())
    }

    fn verify_blocks(&self, blocks: Range<usize>) -> Result<()> {
        let check = |i| self.bytes.check(&self.sums, i).err().map(|cause| (self.sums.block(i), cause));
        let faults: Vec<(Range<usize>, Cause)> = blocks.into_par_iter().filter_map(check).collect();
        let Some((first, cause)) = faults.first() else { return Ok(()) };
        if *cause != Cause::Damaged {
            return Err(cause.error(&self.path, first));
        }
        let is_within = |e: &&Entry| {
            faults.iter().any(|(b, _)| (e.bytes.start as usize) < b.end && b.start < e.bytes.end as usize)
        };
        let mut names: Vec<&str> = self.table.iter().filter(is_within).map(|e| &e.name[..]).collect();
        if names.len() > MAX_SHOWN_NAMES {
            names.truncate(MAX_SHOWN_NAMES);
            names.push("…");
        }
        let names = names.join(", ");
        Err(self.refuse(&format!(
            "it is damaged: a checksum of the blocks with {names} differs; pack the scene again"
        )))
    }

    /// The error for a file that cannot be used.
    pub fn refuse(&self, reason: &str) -> Error {
        refuse(&self.path, reason)
    }
}

impl Cause {
    /// The error of a file that lacks these bytes.
    pub(super) fn error(&self, path: &Path, bytes: &Range<usize>) -> Error {
        let cause = match self {
            Cause::Damaged => {
                let (start, end) = (bytes.start, bytes.end);
                return refuse(
                    path,
                    &format!(
                        "it is damaged: the checksum of its bytes {start} to {end} differs; pack the scene again"
                    ),
                );
            }
            Cause::Truncated => io::Error::new(
                io::ErrorKind::UnexpectedEof,
                "the end of the file is missing; it was truncated during the run",
            ),
            Cause::System(code) => io::Error::from_raw_os_error(*code),
        };
        Error::io("read", path, cause)
    }
}

fn refuse(path: &Path, reason: &str) -> Error {
    Error::input(format!("cannot use the packed scene {}: {reason}", path.display()))
}

fn read_table(file: &[u8]) -> std::result::Result<(Vec<Entry>, Checksums), String> {
    let u64_at = |at: usize| file[at..at + 8].try_into().map_or(0, u64::from_ne_bytes);
    let u32_at = |at: usize| file[at..at + 4].try_into().map_or(0, u32::from_ne_bytes);
    if !file.starts_with(MAGIC) {
        return Err("it is a file of another kind".to_owned());
    }
    match u32_at(12) {
        BYTE_ORDER => {}
        n if n == BYTE_ORDER.swap_bytes() => {
            return Err("it was made on a machine of the other byte order; pack the scene again".to_owned());
        }
        _ => return Err("its header is damaged".to_owned()),
    }
    if u64_at(48) != xxh3_64(&file[..48]) || u64_at(56) != 0 {
        return Err("its header is damaged".to_owned());
    }
    if u32_at(8) != VERSION {
        let found = u32_at(8);
        return Err(format!("it has version {found}, this program reads {VERSION}; pack the scene again"));
    }
    let (start, length, sum, whole) = (u64_at(16), u64_at(24), u64_at(32), u64_at(40));
    if whole != file.len() as u64 {
        return Err(format!("it has {} bytes instead of {whole}; is it cut short?", file.len()));
    }
    let range = start as usize..start.saturating_add(length) as usize;
    let bytes = file.get(range).filter(|b| xxh3_64(b) == sum).ok_or("its table is damaged")?;
    let entry = |r: &mut ByteReader| {
        let name = r.text()?;
        let bytes = r.u64()?..r.u64()?;
        let element = r.u64()?;
        if bytes.start > bytes.end || bytes.end > start {
            return Err(UnexpectedEnd);
        }
        Ok(Entry { name, bytes, element })
    };
    let mut reader = ByteReader(bytes);
    let mut all = || Ok((reader.list(entry)?, reader.list(ByteReader::u64)?));
    let (table, sums) = all().map_err(|UnexpectedEnd| "its table is damaged".to_owned())?;
    Ok((table, Checksums { bytes: HEADER_BYTES..start as usize, sums }))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn write(path: &Path) {
        let mut w = ArrayFileWriter::create(path).unwrap();
        w.array("letters", b"abc").unwrap();
        w.array("numbers", &[1.5f64, -2.5]).unwrap();
        w.array::<u32>("none", &[]).unwrap();
        w.finish().unwrap();
    }

    fn reason(path: &Path) -> String {
        ArrayFile::open(path).unwrap_err().to_string()
    }

    #[test]
    fn arrays_come_back_and_foreign_files_do_not() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.vlscene");
        write(&path);
        let archive = ArrayFile::open(&path).unwrap();
        assert_eq!(archive.array::<f64>("numbers").unwrap(), [1.5, -2.5]);
        assert_eq!(archive.checked("letters").unwrap(), *b"abc");
        assert!(archive.array::<u32>("none").unwrap().is_empty());
        assert!(archive.array::<f32>("numbers").unwrap_err().contains("layout"));
        assert!(archive.array::<f32>("others").unwrap_err().contains("lacks"));
        archive.verify().unwrap();

        let whole = std::fs::read(&path).unwrap();
        let with = |change: &dyn Fn(&mut Vec<u8>)| {
            let mut bytes = whole.clone();
            change(&mut bytes);
            std::fs::write(&path, bytes).unwrap();
        };
        let seal = |b: &mut Vec<u8>| {
            let sum = xxh3_64(&b[..48]);
            b[48..56].copy_from_slice(&sum.to_ne_bytes());
        };
        for (change, expected) in [
            (&(|b: &mut Vec<u8>| b[0] = b'X') as &dyn Fn(&mut Vec<u8>), "another kind"),
            (&|b: &mut Vec<u8>| b.truncate(20), "too short"),
            (&|b: &mut Vec<u8>| b.truncate(b.len() - 1), "cut short"),
            (&|b: &mut Vec<u8>| b.push(0), "cut short"),
            (&|b: &mut Vec<u8>| b[12..16].reverse(), "byte order"),
            (&|b: &mut Vec<u8>| (b[8] = 99, seal(b)).1, "version 99"),
            (&|b: &mut Vec<u8>| b[20] ^= 1, "header is damaged"),
            (&|b: &mut Vec<u8>| *b.last_mut().unwrap() ^= 1, "table is damaged"),
        ] {
            with(change);
            let found = reason(&path);
            assert!(found.contains(expected), "{found} does not tell {expected}");
        }
        for at in 0..whole.len() {
            with(&|b| b[at] ^= 16);
            let found = ArrayFile::open(&path).and_then(|a| a.verify());
            assert!(found.is_err(), "a change of byte {at} is not found");
        }
    }

    #[test]
    fn every_block_has_a_checksum() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.vlscene");
        let mut w = ArrayFileWriter::create(&path).unwrap();
        let numbers: Vec<u64> = (0..100_000).collect();
        w.array("first", &numbers).unwrap();
        // Ends with a block.
        w.array("second", &vec![7u8; 4 * CHECKED_BYTES - HEADER_BYTES - 800_000]).unwrap();
        w.finish().unwrap();
        let whole = std::fs::read(&path).unwrap();
        let file = ArrayFile::open(&path).unwrap();
        assert_eq!(file.array::<u64>("first").unwrap(), numbers);
        file.verify().unwrap();
        drop(file);
        for (at, name) in
            [(HEADER_BYTES, "first"), (CHECKED_BYTES, "first"), (4 * CHECKED_BYTES - 1, "second")]
        {
            let mut bytes = whole.clone();
            bytes[at] ^= 1;
            std::fs::write(&path, bytes).unwrap();
            let file = ArrayFile::open(&path).unwrap();
            let found = file.verify().unwrap_err().to_string();
            assert!(found.contains("damaged") && found.contains(name), "{at}: {found}");
        }
    }
}
