//! Memory-mapped files and the arrays within them. The only `unsafe` code of this module.
//!
//! A mapping is shared with the file, so a run can meet two faults in the middle of any read: the file is damaged, or it
//! was shortened after it was mapped. Both are resolved in the handler of the signal that the first access to a page
//! raises, which costs nothing on any later access:
//!
//! * A file with checksums is mapped without access. The first access to a unit of it raises `SIGSEGV`; the handler
//!   reads the unit from the file, compares its checksums and permits the access.
//! * An access beyond the end of a shortened file raises `SIGBUS`.
//! * A unit that is damaged or lost is replaced by memory whose bytes are all 0xFF, and the [`Loss`] is recorded before
//!   the access continues. No number in it is a valid index, and as a node it is a leaf, so that code
//!   that follows it ends with a panic and never in a loop. [`super::catch_loss`] replaces that panic, and every other
//!   result of the run, by the error.
//!
//! Files are mapped on Linux; other systems read them into memory. The types of arrays accept every bit pattern
//! ([`AnyBitPattern`]), so no content of a file is an invalid value.
#![allow(unsafe_code, reason = "mapping a file, arrays within the mapping, and the handlers of its faults")]

use bytemuck::AnyBitPattern;
#[cfg(target_os = "linux")]
use linux::Mapping;
#[cfg(target_os = "linux")]
pub(super) use linux::{has_loss, take_loss};
use std::fs::File;
use std::io::Read;
use std::ops::{Deref, Range};
use std::path::{Path, PathBuf};
use std::ptr::NonNull;
use std::sync::Arc;
use xxhash_rust::xxh3::Xxh3Default;

/// Number of bytes that a checksum protects.
pub(super) const CHECKED_BYTES: usize = 1 << 18;

/// Checksums of a part of a file.
#[derive(Debug)]
pub(super) struct Checksums {
    /// The bytes that are protected.
    pub bytes: Range<usize>,
    /// The checksums of the blocks of the file, each of [`CHECKED_BYTES`] from the start of the file on, as far as they
    /// are within `bytes`.
    pub sums: Vec<u64>,
}

impl Checksums {
    /// The protected bytes of block `i`.
    pub fn block(&self, i: usize) -> Range<usize> {
        let start = (i * CHECKED_BYTES).max(self.bytes.start);
        start..((i + 1) * CHECKED_BYTES).min(self.bytes.end).max(start)
    }
}

/// A part of a mapped file that could not be read.
#[derive(Debug)]
pub(super) struct Loss {
    pub path: PathBuf,
    pub bytes: Range<usize>,
    pub cause: Cause,
}

#[derive(Debug, PartialEq)]
pub(super) enum Cause {
    /// The bytes do not match their checksum.
    Damaged,
    /// The file was shortened.
    Truncated,
    /// The system reported this error.
    System(i32),
}

/// The bytes of a file: mapped if it is a regular file, otherwise read, for example from a pipe.
#[derive(Debug)]
pub struct FileBytes(Content);

#[derive(Debug)]
enum Content {
    #[cfg(target_os = "linux")]
    Mapped(Mapping),
    Read(Vec<u8>),
}

impl FileBytes {
    /// Maps a regular file; reads any other file to its end.
    pub fn open(path: &Path) -> std::io::Result<FileBytes> {
        let mut file = File::open(path)?;
        #[cfg(target_os = "linux")]
        {
            let metadata = file.metadata()?;
            if metadata.is_file() && metadata.len() > 0 {
                return Mapping::new(file, path, metadata.len()).map(|map| FileBytes(Content::Mapped(map)));
            }
        }
        let mut bytes = Vec::new();
        file.read_to_end(&mut bytes)?;
        Ok(FileBytes::from(bytes))
    }

    /// Gives the memory of bytes that are not needed at present back to the system; they are read from the file again
    /// when they are accessed.
    pub fn release(&self, bytes: Range<usize>) {
        match &self.0 {
            #[cfg(target_os = "linux")]
            Content::Mapped(map) => map.release(bytes),
            Content::Read(_) => {}
        }
    }

    /// Protects a file by checksums: from now on every part is compared with its checksum before it is accessed.
    pub(super) fn protect(&self, sums: Arc<Checksums>) -> std::io::Result<()> {
        match &self.0 {
            #[cfg(target_os = "linux")]
            Content::Mapped(map) => map.protect(sums),
            Content::Read(_) => Ok(()),
        }
    }

    /// Reads block `i` from the file and compares its checksum.
    pub(super) fn check(&self, sums: &Checksums, i: usize) -> Result<(), Cause> {
        let expected = sums.sums.get(i).ok_or(Cause::Damaged)?;
        let mut hasher = Xxh3Default::new();
        match &self.0 {
            #[cfg(target_os = "linux")]
            Content::Mapped(map) => map.hash(sums.block(i), &mut hasher)?,
            Content::Read(bytes) => hasher.update(bytes.get(sums.block(i)).ok_or(Cause::Truncated)?),
        }
        if hasher.digest() == *expected { Ok(()) } else { Err(Cause::Damaged) }
    }

    /// Whether accesses are checked; bytes that were read into memory must be checked beforehand.
    pub(super) fn is_mapped(&self) -> bool {
        !matches!(self.0, Content::Read(_))
    }
}

impl From<Vec<u8>> for FileBytes {
    fn from(bytes: Vec<u8>) -> FileBytes {
        FileBytes(Content::Read(bytes))
    }
}

impl AsRef<[u8]> for FileBytes {
    fn as_ref(&self) -> &[u8] {
        self
    }
}

impl Deref for FileBytes {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        match &self.0 {
            #[cfg(target_os = "linux")]
            Content::Mapped(map) => map,
            Content::Read(bytes) => bytes,
        }
    }
}

#[cfg(not(target_os = "linux"))]
pub(super) fn has_loss() -> bool {
    false
}

#[cfg(not(target_os = "linux"))]
pub(super) fn take_loss() -> Option<Loss> {
    None
}

#[cfg(target_os = "linux")]
mod linux;

/// `len` values starting at `first`, all within `file`.
pub(super) struct MappedArray<T> {
    first: NonNull<T>,
    len: usize,
    file: Arc<FileBytes>,
}

// SAFETY: the values are only read, through `&self`, and the counted reference to the file, which is `Send` and `Sync`
// itself, keeps them in place.
unsafe impl<T: Sync> Send for MappedArray<T> {}
// SAFETY: the values are only read, and `T` may be read by several threads.
unsafe impl<T: Sync> Sync for MappedArray<T> {}

impl<T: AnyBitPattern> MappedArray<T> {
    /// Interprets the bytes `at` of a file as values. `None` unless the range lies within the file, is aligned, and has
    /// a multiple of the size of `T`.
    pub fn new(file: &Arc<FileBytes>, at: Range<usize>) -> Option<MappedArray<T>> {
        let values: &[T] = bytemuck::try_cast_slice(file.get(at)?).ok()?;
        let first = NonNull::new(values.as_ptr().cast_mut())?;
        Some(MappedArray { first, len: values.len(), file: file.clone() })
    }
}

impl<T> Deref for MappedArray<T> {
    type Target = [T];

    #[inline(always)]
    fn deref(&self) -> &[T] {
        // SAFETY: `new` took pointer and length from a slice of such values in the file's bytes, which stay in place as
        // long as `file` exists; every bit pattern is a value of the type.
        unsafe { std::slice::from_raw_parts(self.first.as_ptr(), self.len) }
    }
}

impl<T> Clone for MappedArray<T> {
    fn clone(&self) -> MappedArray<T> {
        MappedArray { file: self.file.clone(), ..*self }
    }
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::Checksums;
    use super::linux::Mapping;
    use std::fs::{self, File};
    use std::sync::Arc;
    use std::sync::atomic::{AtomicBool, Ordering};
    use xxhash_rust::xxh3::xxh3_64;

    #[test]
    fn mappings_leave_nothing_behind_while_handlers_look_at_others() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        fs::write(&path, [7; 10_000]).unwrap();
        let mapping = || Mapping::new(File::open(&path).unwrap(), &path, 10_000).unwrap();
        let sums = Arc::new(Checksums { bytes: 0..10_000, sums: vec![xxh3_64(&[7; 10_000])] });
        let is_over = AtomicBool::new(false);
        std::thread::scope(|scope| {
            scope.spawn(|| {
                while !is_over.load(Ordering::SeqCst) {
                    let protected = mapping();
                    protected.protect(sums.clone()).unwrap();
                    // The handler permits the access.
                    assert_eq!(protected[9000], 7);
                }
            });
            let regions = (0..2000).map(|_| {
                let mapping = mapping();
                assert_eq!(mapping[9000], 7);
                mapping.region()
            });
            let freed = regions.filter(|region| region.upgrade().is_none()).count();
            is_over.store(true, Ordering::SeqCst);
            assert_eq!(freed, 2000);
        });
        assert_eq!(Arc::strong_count(&sums), 1);
    }
}
