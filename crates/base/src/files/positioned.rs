//! Files that several threads write or read at the same time, each at its own offset.

use super::fault;
use std::fs::File;
use std::io;

/// Another handle of a file that is being written, for writes at given offsets. It does not move the position
/// of other handles, but on Windows.
#[derive(Debug)]
pub struct PositionedFile {
    file: File,
}

impl PositionedFile {
    /// Wraps a file handle for access at given offsets.
    pub fn of(file: File) -> PositionedFile {
        PositionedFile { file }
    }

    /// Writes all bytes from `offset` on.
    #[cfg(unix)]
    pub fn write_all_at(&self, bytes: &[u8], offset: u64) -> io::Result<()> {
        fault::point()?;
        std::os::unix::fs::FileExt::write_all_at(&self.file, bytes, offset)
    }

    /// Writes all bytes from `offset` on.
    #[cfg(windows)]
    pub fn write_all_at(&self, mut bytes: &[u8], mut offset: u64) -> io::Result<()> {
        fault::point()?;
        while !bytes.is_empty() {
            let count = std::os::windows::fs::FileExt::seek_write(&self.file, bytes, offset)?;
            if count == 0 {
                return Err(io::ErrorKind::WriteZero.into());
            }
            bytes = &bytes[count..];
            offset += count as u64;
        }
        Ok(())
    }
}

/// Reads at an offset, independently of other threads that read the same file.
#[cfg(unix)]
pub fn read_exact_at(file: &File, bytes: &mut [u8], offset: u64) -> io::Result<()> {
    std::os::unix::fs::FileExt::read_exact_at(file, bytes, offset)
}

/// Reads at an offset, independently of other threads that read the same file.
#[cfg(windows)]
pub fn read_exact_at(file: &File, mut bytes: &mut [u8], mut offset: u64) -> io::Result<()> {
    while !bytes.is_empty() {
        let count = std::os::windows::fs::FileExt::seek_read(file, bytes, offset)?;
        if count == 0 {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        bytes = &mut bytes[count..];
        offset += count as u64;
    }
    Ok(())
}
