//! Memory-mapped files and the arrays within them. The only `unsafe` code of this module.
//!
//! A mapping is shared with the file: what another program writes to the file while it is mapped becomes visible here,
//! and reading a page beyond the end of a file that was shortened meanwhile ends the process (`SIGBUS`). This is
//! accepted, as in other programs that map their input: copying gigabytes of scene before each run would cost more than
//! the fault, and a file that changes during a run has no correct result either way. Arrays of a changed file may hold
//! other numbers, but never invalid values: their types accept every bit pattern ([`AnyBitPattern`]).
#![allow(unsafe_code, reason = "mapping a file, and arrays within the mapping")]

use bytemuck::AnyBitPattern;
use memmap2::Mmap;
use std::fs::File;
use std::io::Read;
use std::ops::{Deref, Range};
use std::path::Path;
use std::ptr::NonNull;
use std::sync::Arc;

/// The bytes of a file: mapped if it is a regular file, otherwise read, for example from a pipe.
#[derive(Debug)]
pub enum FileBytes {
    /// A mapped regular file.
    Mapped(Mmap),
    /// Bytes read into memory.
    Read(Vec<u8>),
}

impl FileBytes {
    /// Maps a regular file; reads any other file to its end.
    pub fn open(path: &Path) -> std::io::Result<FileBytes> {
        let mut file = File::open(path)?;
        let metadata = file.metadata()?;
        if metadata.is_file() && metadata.len() > 0 {
            // SAFETY: the mapping is read-only. That the file is not shortened or rewritten meanwhile cannot be
            // guaranteed; the documentation of this module describes the consequences and why they are accepted.
            return Ok(FileBytes::Mapped(unsafe { Mmap::map(&file)? }));
        }
        let mut bytes = Vec::new();
        file.read_to_end(&mut bytes)?;
        Ok(FileBytes::Read(bytes))
    }
}

impl Deref for FileBytes {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        match self {
            FileBytes::Mapped(map) => map,
            FileBytes::Read(bytes) => bytes,
        }
    }
}

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
