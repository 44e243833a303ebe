//! The bytes of files that are read as a whole.
//!
//! A file is read into memory, so that nothing that happens to it afterwards changes the bytes. One that
//! would take more than a share of the memory is mapped instead. A mapping is shared with the file: bytes
//! that another program writes meanwhile appear in it, and an access beyond the end of a file that was
//! truncated meanwhile raises `SIGBUS`, which ends the process. [`FileBytes::check_unchanged`] finds the
//! first of both; nothing but leaving the file alone prevents the second.

use crate::files::{fault, reads};
use crate::machine;
use memmap2::{Mmap, MmapOptions};
use std::fs::{File, Metadata};
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::ops::{Deref, Range};
use std::path::Path;
use std::sync::Arc;
use std::time::SystemTime;

/// Files up to this length are read into memory under any memory limit, bytes.
const MAX_SMALL_BYTES: u64 = 16 << 20;

/// Files that take up more than this fraction of the memory are mapped.
const MAX_READ_FRACTION: u64 = 8;

/// The bytes of a file. Clones share them.
#[derive(Clone, Debug)]
pub struct FileBytes(Arc<Content>);

#[derive(Debug)]
enum Content {
    Read(Vec<u8>),
    Mapped {
        map: Mmap,
        file: File,
        version: Version,
    },
    /// A part of a [`ScratchFile`], which stays open: the space of a file that is only mapped is not told.
    Scratch {
        map: Mmap,
        _file: Arc<File>,
    },
}

/// An unnamed temporary file that grows. No other program has it.
#[derive(Debug)]
pub struct ScratchFile {
    file: Arc<File>,
    /// Number of bytes that have been appended.
    length: u64,
}

/// Facts that distinguish versions of a file.
#[derive(Debug, PartialEq)]
struct Version {
    length: u64,
    modified: Option<SystemTime>,
}

impl Version {
    fn of(metadata: &Metadata) -> Version {
        Version { length: metadata.len(), modified: metadata.modified().ok() }
    }
}

impl FileBytes {
    /// Reads a file to its end, or maps a large one.
    ///
    /// # Errors
    /// When the file cannot be read, or changes while it is read.
    pub fn open(path: &Path) -> io::Result<FileBytes> {
        FileBytes::open_within(path, None)
    }

    /// As [`FileBytes::open`]; `max_memory` limits the memory instead of the machine's, bytes.
    ///
    /// # Errors
    /// As for [`FileBytes::open`].
    pub fn open_within(path: &Path, max_memory: Option<u64>) -> io::Result<FileBytes> {
        FileBytes::open_or_map(path, || {
            max_memory.or_else(machine::memory).unwrap_or(u64::MAX) / MAX_READ_FRACTION
        })
    }

    /// As [`FileBytes::open`], and maps also files of more than `max_read` bytes, for readers that
    /// [release](FileBytes::release) the parts that they have read.
    ///
    /// # Errors
    /// As for [`FileBytes::open`].
    pub fn open_in_parts(path: &Path, max_read: u64) -> io::Result<FileBytes> {
        FileBytes::open_or_map(path, || {
            max_read.min(machine::memory().unwrap_or(u64::MAX) / MAX_READ_FRACTION)
        })
    }

    /// Reads a file of at most this number of bytes, or at most [`MAX_SMALL_BYTES`], or maps it.
    fn open_or_map(path: &Path, max_read: impl FnOnce() -> u64) -> io::Result<FileBytes> {
        let mut file = reads::open(path)?;
        let metadata = file.metadata()?;
        let version = Version::of(&metadata);
        let is_file = metadata.is_file();
        if is_file && version.length > MAX_SMALL_BYTES && version.length > max_read() {
            return map(file, version);
        }
        let mut bytes = Vec::new();
        let room = if is_file { usize::try_from(version.length).unwrap_or(0) } else { 0 };
        bytes.try_reserve_exact(room).map_err(|_| io::Error::from(io::ErrorKind::OutOfMemory))?;
        file.read_to_end(&mut bytes)?;
        if is_file {
            // A file of the proc file system states no length.
            let is_read = version.length == 0 || bytes.len() as u64 == version.length;
            check(&file, &version, is_read)?;
        }
        Ok(FileBytes::from(bytes))
    }

    /// Releases the memory of a part of a mapped file; its bytes are read from the file again when they are
    /// used again.
    pub fn release(&self, part: Range<usize>) {
        if let Content::Mapped { map, .. } | Content::Scratch { map, .. } = &*self.0 {
            let part = part.start.min(map.len())..part.end.min(map.len());
            release(map, part);
        }
    }

    /// Fails if the file has changed since it was opened, so that the bytes read may be a mixture of two
    /// versions.
    ///
    /// # Errors
    /// [`io::ErrorKind::InvalidData`].
    pub fn check_unchanged(&self) -> io::Result<()> {
        match &*self.0 {
            Content::Read(_) | Content::Scratch { .. } => Ok(()),
            Content::Mapped { file, version, .. } => check(file, version, true),
        }
    }
}

impl ScratchFile {
    /// Creates an empty file in the folder for temporary files.
    ///
    /// # Errors
    /// When the file cannot be created.
    pub fn create() -> io::Result<ScratchFile> {
        let file = fault::point().and_then(|()| tempfile::tempfile())?;
        Ok(ScratchFile { file: Arc::new(file), length: 0 })
    }

    /// Appends the bytes that `write` writes, and maps them. After an error the file is as before.
    ///
    /// # Errors
    /// When the bytes cannot be written or mapped.
    pub fn append(&mut self, write: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> io::Result<FileBytes> {
        let mut out: &File = &self.file;
        out.seek(SeekFrom::Start(self.length))?;
        write(&mut out)?;
        let end = out.stream_position()?;
        let length = usize::try_from(end.saturating_sub(self.length))
            .map_err(|_| io::Error::from(io::ErrorKind::OutOfMemory))?;
        if length == 0 {
            return Ok(FileBytes::from(Vec::new()));
        }
        let map = mapped(&self.file, MmapOptions::new().offset(self.length).len(length))?;
        self.length = end;
        Ok(FileBytes(Arc::new(Content::Scratch { map, _file: self.file.clone() })))
    }
}

fn map(file: File, version: Version) -> io::Result<FileBytes> {
    let map = mapped(&file, &MmapOptions::new())?;
    Ok(FileBytes(Arc::new(Content::Mapped { map, file, version })))
}

#[allow(unsafe_code, reason = "mapping a file")]
fn mapped(file: &File, part: &MmapOptions) -> io::Result<Mmap> {
    // SAFETY: the mapping is only read, as bytes, for which every value is valid. Other programs can change
    // it, see above.
    unsafe { part.map(file) }
}

#[allow(unsafe_code, reason = "releasing the memory of a mapped file")]
fn release(map: &Mmap, part: Range<usize>) {
    // That it fails on some system means only that the memory is not released.
    #[cfg(unix)]
    // SAFETY: the mapping is shared with the file and only read, so that pages that are dropped come back
    // with the same bytes.
    let _ = unsafe { map.unchecked_advise_range(memmap2::UncheckedAdvice::DontNeed, part.start, part.len()) };
    #[cfg(not(unix))]
    let _ = (map, part);
}

fn check(file: &File, version: &Version, is_read: bool) -> io::Result<()> {
    match is_read && Version::of(&file.metadata()?) == *version {
        true => Ok(()),
        false => Err(io::Error::new(
            io::ErrorKind::InvalidData,
            "another program changed it while it was being read",
        )),
    }
}

impl From<Vec<u8>> for FileBytes {
    fn from(bytes: Vec<u8>) -> FileBytes {
        FileBytes(Arc::new(Content::Read(bytes)))
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
        match &*self.0 {
            Content::Read(bytes) => bytes,
            Content::Mapped { map, .. } | Content::Scratch { map, .. } => map,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn bytes_that_were_read_stay_and_mapped_ones_are_checked() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        let long = vec![7; MAX_SMALL_BYTES as usize + 1];
        fs::write(&path, &long).unwrap();
        let read = FileBytes::open_within(&path, Some(1 << 40)).unwrap();
        let mapped = FileBytes::open_within(&path, Some(0)).unwrap();
        assert!(matches!(*read.0, Content::Read(_)) && matches!(*mapped.0, Content::Mapped { .. }));
        assert!(*read == long && *mapped == long);
        mapped.check_unchanged().unwrap();
        // Released parts are read again.
        let in_parts = FileBytes::open_in_parts(&path, 0).unwrap();
        assert!(matches!(*in_parts.0, Content::Mapped { .. }));
        in_parts.release(1..long.len() - 1);
        in_parts.release(long.len()..usize::MAX);
        assert!(*in_parts == long);
        in_parts.check_unchanged().unwrap();
        fs::File::options().append(true).open(&path).unwrap().write_all(b"more").unwrap();
        assert!(mapped.check_unchanged().unwrap_err().to_string().contains("another program changed it"));
        fs::write(&path, "short").unwrap();
        assert!(*read == long);
        read.check_unchanged().unwrap();
        let short = FileBytes::open_within(&path, Some(0)).unwrap();
        assert!(matches!(*short.0, Content::Read(_)));
    }

    #[test]
    fn scratch_files_are_mapped_and_keep_their_bytes() {
        let bytes: Vec<u8> = (0..100_000_u32).map(|i| (i % 251) as u8).collect();
        let mut file = ScratchFile::create().unwrap();
        let parts = [&bytes[..70_000], &bytes[70_000..]].map(|part| {
            assert!(file.append(|_| Ok(())).unwrap().is_empty());
            let failed = file.append(|out| {
                out.write_all(b"half")?;
                Err(io::ErrorKind::StorageFull.into())
            });
            assert!(failed.is_err());
            file.append(|out| out.write_all(part)).unwrap()
        });
        drop(file);
        for (part, expected) in parts.iter().zip([&bytes[..70_000], &bytes[70_000..]]) {
            assert!(matches!(*part.0, Content::Scratch { .. }));
            part.release(0..part.len());
            assert!(**part == *expected);
            part.check_unchanged().unwrap();
        }
    }
}
