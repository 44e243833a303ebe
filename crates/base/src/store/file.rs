//! File format of named arrays and values. Values are encoded by postcard, without names of their fields.
//!
//! ```text
//! 0    magic "VLSCENE\n" │ version u32 │ byte order u32 │ table: offset, length, checksum │ file length
//!      │ checksum │ 0 u64
//! 64   arrays, one after the other
//!      table, a value: for each array its name, bytes, bytes of an element, checksums of its blocks
//! ```
//!
//! An array is divided into blocks of 256 KiB, each with a checksum. Opening a file checks header and table;
//! reading an array reads its blocks into memory, by all threads in parallel, and compares each with its
//! checksum before the array is returned. So the numbers that a program computes with are those that were
//! compared, even if the file changes afterwards.

use super::ArrayFileError;
use crate::diag::Problem;
use crate::error::{Error, Result};
use crate::files::{FileWriter, Patched, fault, read_exact_at, reads};
use bytemuck::{AnyBitPattern, NoUninit};
use rayon::prelude::*;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use std::collections::HashMap;
use std::fs::File;
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::ops::Range;
use std::path::{Path, PathBuf};
use xxhash_rust::xxh3::xxh3_64;

const MAGIC: &[u8; 8] = b"VLSCENE\n";

/// Version of the contents; incremented whenever the meaning of any content changes, such as the elements of
/// an array.
const VERSION: u32 = 14;

/// Written in native byte order; a machine of the opposite order reads a different number.
const BYTE_ORDER: u32 = 0x0102_0304;

const HEADER_BYTES: usize = 64;

/// Number of bytes of an array that a checksum protects; the last block of an array can be shorter.
const BLOCK_BYTES: usize = 1 << 18;

/// Writes a file of arrays.
pub struct ArrayFileWriter {
    out: BufWriter<FileWriter>,
    at: u64,
    table: Vec<Entry>,
}

/// Table entry of an array.
#[derive(Serialize, Deserialize)]
struct Entry {
    name: String,
    bytes: Range<u64>,
    element: u64,
    /// Checksums of the blocks.
    sums: Vec<u64>,
}

impl Entry {
    /// Number of the entry's bytes.
    fn length(&self) -> u64 {
        self.bytes.end - self.bytes.start
    }
}

impl ArrayFileWriter {
    /// Begins a file, which gets its name at the end and replaces an existing one then.
    pub fn create(path: &Path) -> Result<ArrayFileWriter> {
        let file = FileWriter::create(path, true, Patched::Always)?;
        let out = BufWriter::with_capacity(1 << 20, file);
        let mut writer = ArrayFileWriter { out, at: 0, table: Vec::new() };
        writer.put(&[0; HEADER_BYTES])?;
        Ok(writer)
    }

    /// Appends an array under a name, with a checksum for each block of its bytes.
    pub fn array<T: NoUninit>(&mut self, name: impl Into<String>, values: &[T]) -> Result<()> {
        let bytes: &[u8] = bytemuck::cast_slice(values);
        let sums = bytes.par_chunks(BLOCK_BYTES).map(xxh3_64).collect();
        let start = self.at;
        self.put(bytes)?;
        let element = size_of::<T>() as u64;
        self.table.push(Entry { name: name.into(), bytes: start..self.at, element, sums });
        Ok(())
    }

    /// Appends a value under a name.
    pub fn value(&mut self, name: impl Into<String>, value: &impl Serialize) -> Result<()> {
        self.array(name, &encode(value)?)
    }

    /// Completes the file and returns its length, bytes.
    pub fn finish(self) -> Result<u64> {
        self.finish_checked(|_| Ok(()))
    }

    /// As [`ArrayFileWriter::finish`], but a file gets its name only if `check` accepts it, whose path is a
    /// temporary one then. Streams are not checked.
    pub fn finish_checked(mut self, check: impl FnOnce(&Path) -> Result<()>) -> Result<u64> {
        let (table, start) = (encode(&self.table)?, self.at);
        self.put(&table)?;
        let mut header = MAGIC.to_vec();
        header.extend(VERSION.to_ne_bytes());
        header.extend(BYTE_ORDER.to_ne_bytes());
        for number in [start, table.len() as u64, xxh3_64(&table), self.at] {
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
        file.temporary_path().map_or(Ok(()), check)?;
        file.finish().map(|_| at)
    }

    fn put(&mut self, bytes: &[u8]) -> Result<()> {
        self.out.write_all(bytes).map_err(|e| self.out.get_ref().failed("write", e))?;
        self.at += bytes.len() as u64;
        Ok(())
    }
}

/// An open file of arrays, whose header and table are valid.
#[derive(Debug)]
pub struct ArrayFile {
    path: PathBuf,
    file: File,
    length: u64,
    table: Vec<Entry>,
    /// The entry of each name.
    entry_of: HashMap<String, usize>,
    /// Checksum of the table, which has those of all blocks.
    table_sum: u64,
}

impl std::fmt::Debug for Entry {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        write!(f, "{} at {:?}", self.name, self.bytes)
    }
}

impl ArrayFile {
    /// Opens a file and checks its header and its table.
    ///
    /// # Errors
    /// [`Error::Input`] with the reason why the file cannot be used; [`Error::Io`] when it cannot be read.
    pub fn open(path: &Path) -> Result<ArrayFile> {
        let failed = |e| Error::io("read", path, e);
        if !std::fs::metadata(path).map_err(failed)?.is_file() {
            return Err(refused(path, ArrayFileError::NotRegular));
        }
        let file = fault::point().and_then(|()| reads::open(path)).map_err(failed)?;
        let length = file.metadata().map_err(failed)?.len();
        if length < HEADER_BYTES as u64 {
            return Err(refused(path, ArrayFileError::TooShort));
        }
        let mut header = [0; HEADER_BYTES];
        read_exact_at(&file, &mut header, 0).map_err(failed)?;
        let place = read_header(&header, length).map_err(|reason| refused(path, reason))?;
        let mut bytes = vec![0; (place.end - place.start) as usize];
        read_exact_at(&file, &mut bytes, place.start).map_err(failed)?;
        let table_sum = xxh3_64(&bytes);
        let table = (table_sum == u64_at(&header, 32)).then(|| read_table(&bytes, place.start)).flatten();
        let table = table.ok_or_else(|| refused(path, damaged("its table")))?;
        let entry_of = table.iter().zip(0..).map(|(entry, i)| (entry.name.clone(), i)).collect();
        Ok(ArrayFile { path: path.to_path_buf(), file, length, table, entry_of, table_sum })
    }

    /// Length of the file, bytes.
    pub fn length(&self) -> u64 {
        self.length
    }

    /// Bytes of all arrays whose names pass `is_counted`.
    pub fn bytes_of(&self, is_counted: impl Fn(&str) -> bool) -> u64 {
        self.table.iter().filter(|entry| is_counted(&entry.name)).map(Entry::length).sum()
    }

    /// Bytes of an element of an array; `None` without an array of this name.
    pub fn element(&self, name: &str) -> Option<u64> {
        self.entry(name).map(|entry| entry.element)
    }

    fn entry(&self, name: &str) -> Option<&Entry> {
        self.entry_of.get(name).map(|i| &self.table[*i])
    }

    /// Reads an array and compares its checksums.
    ///
    /// # Errors
    /// [`Error::Input`] for an array that is missing, damaged, of other elements or larger than the memory;
    /// [`Error::Io`] when it cannot be read.
    pub fn array<T: AnyBitPattern + NoUninit>(&self, name: &str) -> Result<Vec<T>> {
        let missing = || self.refuse_because(ArrayFileError::Missing { name: name.to_owned() });
        let entry = self.entry(name).ok_or_else(missing)?;
        let (length, element) = (entry.length() as usize, size_of::<T>());
        if entry.element != element as u64 || !length.is_multiple_of(element) {
            return Err(self.layout("array", name));
        }
        let values = bytemuck::allocation::try_zeroed_vec::<T>(length / element);
        let mut values = values.map_err(|()| self.refuse_because(ArrayFileError::TooLarge))?;
        let blocks = bytemuck::cast_slice_mut::<T, u8>(&mut values).par_chunks_mut(BLOCK_BYTES);
        let blocks = blocks.zip(&entry.sums).enumerate();
        blocks.try_for_each(|(i, (block, sum))| self.read_block(entry, i, block, *sum))?;
        Ok(values)
    }

    /// Reads a value.
    ///
    /// # Errors
    /// As for [`ArrayFile::array`], and [`Error::Input`] for a value of another type.
    pub fn value<T: DeserializeOwned>(&self, name: &str) -> Result<T> {
        let bytes = self.array::<u8>(name)?;
        postcard::from_bytes(&bytes).map_err(|_| self.layout("value", name))
    }

    /// Checksum of the contents, from the checksums within the file.
    pub fn fingerprint(&self) -> u64 {
        self.table_sum
    }

    /// Reads all arrays and compares all checksums.
    ///
    /// # Errors
    /// [`Error::Input`] with the name of a damaged array; [`Error::Io`] when the file cannot be read.
    pub fn verify(&self) -> Result<()> {
        let check = |entry: &Entry| {
            (0..entry.sums.len()).into_par_iter().try_for_each_init(
                || vec![0; BLOCK_BYTES],
                |buffer, i| {
                    let length = (entry.length() - (i * BLOCK_BYTES) as u64).min(BLOCK_BYTES as u64);
                    self.read_block(entry, i, &mut buffer[..length as usize], entry.sums[i])
                },
            )
        };
        self.table.iter().try_for_each(check)
    }

    /// Reads block `i` of an array and compares its checksum.
    fn read_block(&self, entry: &Entry, i: usize, block: &mut [u8], sum: u64) -> Result<()> {
        let at = entry.bytes.start + (i * BLOCK_BYTES) as u64;
        read_exact_at(&self.file, block, at).map_err(|e| match e.kind() {
            io::ErrorKind::UnexpectedEof => {
                let message = "it was truncated while it was being read";
                Error::io("read", &self.path, io::Error::new(io::ErrorKind::UnexpectedEof, message))
            }
            _ => Error::io("read", &self.path, e),
        })?;
        if xxh3_64(block) == sum {
            return Ok(());
        }
        let end = at + block.len() as u64;
        let what = format!("its bytes {at} to {end}, of the array {},", entry.name);
        Err(self.refuse_because(ArrayFileError::Damaged { what }))
    }

    /// The error for a file that cannot be used.
    pub fn refuse(&self, reason: &str) -> Error {
        Error::input(refusal(&self.path, reason))
    }

    /// [`ArrayFile::refuse`] with the error that is the reason.
    pub fn refuse_because(&self, reason: impl Problem) -> Error {
        refused(&self.path, reason)
    }

    /// The error for an array or a value of another type.
    fn layout(&self, kind: &'static str, name: &str) -> Error {
        self.refuse_because(ArrayFileError::Layout { kind, name: name.to_owned() })
    }
}

/// The bytes of a value.
fn encode(value: &impl Serialize) -> Result<Vec<u8>> {
    postcard::to_stdvec(value).map_err(|e| Error::Internal(format!("a value of a file: {e}")))
}

fn refused(path: &Path, reason: impl Problem) -> Error {
    Error::caused_by(refusal(path, &reason.to_string()), reason)
}

fn refusal(path: &Path, reason: &str) -> String {
    format!("cannot use the packed scene {}: {reason}", path.display())
}

/// The reason to refuse a file of which `what` is damaged.
fn damaged(what: &str) -> ArrayFileError {
    ArrayFileError::Damaged { what: what.to_owned() }
}

fn u64_at(header: &[u8; HEADER_BYTES], at: usize) -> u64 {
    header[at..at + 8].try_into().map_or(0, u64::from_ne_bytes)
}

/// Checks a header and returns the bytes of the table.
fn read_header(header: &[u8; HEADER_BYTES], length: u64) -> Result<Range<u64>, ArrayFileError> {
    let u32_at = |at: usize| header[at..at + 4].try_into().map_or(0, u32::from_ne_bytes);
    if !header.starts_with(MAGIC) {
        return Err(ArrayFileError::Foreign);
    }
    match u32_at(12) {
        BYTE_ORDER => {}
        n if n == BYTE_ORDER.swap_bytes() => {
            return Err(ArrayFileError::ByteOrder);
        }
        _ => return Err(damaged("the bytes of its header")),
    }
    if u64_at(header, 48) != xxh3_64(&header[..48]) || u64_at(header, 56) != 0 {
        return Err(damaged("the bytes of its header"));
    }
    if u32_at(8) != VERSION {
        return Err(ArrayFileError::Version { found: u32_at(8), expected: VERSION });
    }
    let (start, table, stated) = (u64_at(header, 16), u64_at(header, 24), u64_at(header, 40));
    if stated != length {
        return Err(ArrayFileError::Length { length, stated });
    }
    let end = start.checked_add(table).filter(|end| *end <= length);
    end.map(|end| start..end).ok_or_else(|| damaged("the bytes of its header"))
}

/// Reads a table of arrays that end before `limit`; `None` for one that is not valid.
fn read_table(bytes: &[u8], limit: u64) -> Option<Vec<Entry>> {
    let table: Vec<Entry> = postcard::from_bytes(bytes).ok()?;
    let is_valid = |Entry { bytes, sums, .. }: &Entry| {
        bytes.start <= bytes.end
            && bytes.end <= limit
            && (bytes.end - bytes.start).div_ceil(BLOCK_BYTES as u64) == sums.len() as u64
    };
    table.iter().all(is_valid).then_some(table)
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

    /// Opens a file and reads everything in it.
    fn read_all(path: &Path) -> Result<(Vec<u8>, Vec<f64>, Vec<u32>)> {
        let file = ArrayFile::open(path)?;
        Ok((file.array("letters")?, file.array("numbers")?, file.array("none")?))
    }

    #[test]
    fn arrays_come_back_and_foreign_files_do_not() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.vlscene");
        write(&path);
        let expected = (b"abc".to_vec(), vec![1.5, -2.5], vec![]);
        assert_eq!(read_all(&path).unwrap(), expected);
        let archive = ArrayFile::open(&path).unwrap();
        assert!(archive.array::<f32>("numbers").unwrap_err().to_string().contains("layout"));
        assert!(archive.array::<f32>("others").unwrap_err().to_string().contains("is missing"));
        assert_eq!((archive.element("numbers"), archive.element("others")), (Some(8), None));
        assert_eq!(archive.bytes_of(|name| name != "letters"), 16);
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
            (&(|b: &mut Vec<u8>| b[0] = b'X') as &dyn Fn(&mut Vec<u8>), "not a packed scene"),
            (&|b: &mut Vec<u8>| b.truncate(20), "too short"),
            (&|b: &mut Vec<u8>| b.truncate(b.len() - 1), "truncated"),
            (&|b: &mut Vec<u8>| b.push(0), "truncated"),
            (&|b: &mut Vec<u8>| b[12..16].reverse(), "byte order"),
            (&|b: &mut Vec<u8>| (b[8] = 99, seal(b)).1, "version 99"),
            (&|b: &mut Vec<u8>| b[20] ^= 1, "the bytes of its header"),
            (&|b: &mut Vec<u8>| *b.last_mut().unwrap() ^= 1, "its table"),
        ] {
            with(change);
            let found = ArrayFile::open(&path).unwrap_err().to_string();
            assert!(found.contains(expected), "{found} does not tell {expected}");
        }
        for bit in 0..8 * whole.len() {
            with(&|b| b[bit / 8] ^= 1 << (bit % 8));
            assert!(read_all(&path).is_err(), "a change of bit {bit} is not found");
            assert!(ArrayFile::open(&path).and_then(|a| a.verify()).is_err(), "bit {bit}");
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
        w.array("second", &vec![7u8; 2 * BLOCK_BYTES]).unwrap();
        w.finish().unwrap();
        let whole = std::fs::read(&path).unwrap();
        let file = ArrayFile::open(&path).unwrap();
        assert_eq!(file.array::<u64>("first").unwrap(), numbers);
        file.verify().unwrap();
        // Bytes already read are kept; bytes read later are compared.
        let second = HEADER_BYTES + 800_000;
        for (at, name) in [
            (HEADER_BYTES, "first"),
            (HEADER_BYTES + BLOCK_BYTES, "first"),
            (second - 1, "first"),
            (second, "second"),
            (second + 2 * BLOCK_BYTES - 1, "second"),
        ] {
            let mut bytes = whole.clone();
            bytes[at] ^= 1;
            std::fs::write(&path, bytes).unwrap();
            let array = if name == "first" {
                file.array::<u64>("first").map(drop)
            } else {
                file.array::<u8>("second").map(drop)
            };
            for found in [array.unwrap_err(), file.verify().unwrap_err()] {
                let found = found.to_string();
                assert!(found.contains("damaged") && found.contains(name), "{at}: {found}");
            }
        }
        std::fs::write(&path, &whole[..second]).unwrap();
        let found = file.array::<u8>("second").unwrap_err();
        assert!(matches!(found, Error::Io { .. }) && found.to_string().contains("truncated"), "{found}");
    }
}
