//! Files of rasters, of which only the bytes that are needed are read.

use super::ascii_grid;
use std::borrow::Cow;
use std::fs::{self, File};
use std::io::{self, BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use tiff::decoder::Decoder;
use vlscan_base::files::{fault, read_exact_at, reads};
use vlscan_base::recognise::{FIRST_BYTES, is_ascii_grid};
use vlscan_base::store::FileBytes;

/// The decoder of a file's directories.
pub(super) type Directory<'a> = Decoder<BufReader<Reader<'a>>>;

/// A file by its name, in the version that was read first.
#[derive(Debug)]
pub(super) struct RasterFile {
    path: PathBuf,
    version: Version,
}

#[derive(Debug)]
enum Version {
    /// Size and times of a regular file.
    Stamp(Option<reads::Stamp>),
    /// The bytes of a pipe, or the raster of a grid.
    Held(FileBytes),
}

/// An open file.
pub(super) enum OpenFile {
    Regular(File, u64),
    Held(FileBytes),
}

impl RasterFile {
    /// Opens a file for the first time. A grid of text is held as the GeoTIFF that it is read as.
    ///
    /// # Errors
    /// [`io::ErrorKind::InvalidData`] with a [`GridError`](super::GridError) for a grid that cannot be read.
    pub fn find(path: &Path) -> io::Result<(RasterFile, OpenFile)> {
        fault::point()?;
        let is_regular = fs::metadata(path).is_ok_and(|about| about.is_file());
        let open = if is_regular {
            let file = reads::open(path)?;
            let length = file.metadata()?.len();
            OpenFile::Regular(file, length)
        } else {
            OpenFile::Held(FileBytes::open(path)?)
        };
        let open = match is_ascii_grid(&open.start(FIRST_BYTES)?) {
            false => open,
            true => OpenFile::Held(FileBytes::from(read_grid(path, &open)?)),
        };
        let version = match &open {
            OpenFile::Regular(file, _) => Version::Stamp(reads::Stamp::of(&file.metadata()?)),
            OpenFile::Held(bytes) => Version::Held(bytes.clone()),
        };
        Ok((RasterFile { path: path.to_path_buf(), version }, open))
    }

    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Opens the same version of the file again.
    ///
    /// # Errors
    /// [`io::ErrorKind::InvalidData`] if the file has changed.
    pub fn open(&self) -> io::Result<OpenFile> {
        match &self.version {
            Version::Held(bytes) => Ok(OpenFile::Held(bytes.clone())),
            Version::Stamp(_) => {
                let file = reads::open(&self.path)?;
                let length = file.metadata()?.len();
                self.check_unchanged(&file)?;
                Ok(OpenFile::Regular(file, length))
            }
        }
    }

    fn check_unchanged(&self, file: &File) -> io::Result<()> {
        let Version::Stamp(then) = &self.version else { return Ok(()) };
        let now = reads::Stamp::of(&file.metadata()?);
        match (now, then) {
            (Some(now), Some(then)) if !now.is_same_content(then) => Err(io::Error::new(
                io::ErrorKind::InvalidData,
                "another program changed it while it was being read",
            )),
            _ => Ok(()),
        }
    }
}

/// The GeoTIFF of a grid of text.
fn read_grid(path: &Path, open: &OpenFile) -> io::Result<Vec<u8>> {
    let text = match open {
        OpenFile::Regular(..) => FileBytes::open(path)?,
        OpenFile::Held(bytes) => bytes.clone(),
    };
    let raster =
        ascii_grid::geotiff(&text, path).map_err(|e| io::Error::new(io::ErrorKind::InvalidData, e))?;
    text.check_unchanged()?;
    Ok(raster)
}

impl OpenFile {
    /// Number of bytes.
    pub fn length(&self) -> u64 {
        match self {
            OpenFile::Regular(_, length) => *length,
            OpenFile::Held(bytes) => bytes.len() as u64,
        }
    }

    /// The first bytes, fewer if the file is shorter.
    pub fn start(&self, count: usize) -> io::Result<Cow<'_, [u8]>> {
        self.bytes(0, self.length().min(count as u64) as usize)
    }

    /// `count` bytes from an offset on, which must be within the file.
    pub fn bytes(&self, offset: u64, count: usize) -> io::Result<Cow<'_, [u8]>> {
        match self {
            OpenFile::Regular(file, _) => {
                let mut bytes = vec![0; count];
                read_exact_at(file, &mut bytes, offset)?;
                Ok(Cow::Owned(bytes))
            }
            OpenFile::Held(bytes) => {
                let start = usize::try_from(offset).unwrap_or(usize::MAX);
                let range = start..start.saturating_add(count);
                bytes.get(range).map(Cow::Borrowed).ok_or_else(|| io::ErrorKind::UnexpectedEof.into())
            }
        }
    }

    /// Reads from the beginning on.
    pub fn reader(&self) -> BufReader<Reader<'_>> {
        BufReader::new(Reader { file: self, at: 0 })
    }
}

/// Reads an open file from its own position on.
pub(super) struct Reader<'a> {
    file: &'a OpenFile,
    at: u64,
}

impl Read for Reader<'_> {
    fn read(&mut self, to: &mut [u8]) -> io::Result<usize> {
        let count = self.file.length().saturating_sub(self.at).min(to.len() as u64) as usize;
        to[..count].copy_from_slice(&self.file.bytes(self.at, count)?);
        self.at += count as u64;
        Ok(count)
    }
}

impl Seek for Reader<'_> {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        let at = match to {
            SeekFrom::Start(at) => Some(at),
            SeekFrom::Current(by) => self.at.checked_add_signed(by),
            SeekFrom::End(by) => self.file.length().checked_add_signed(by),
        };
        self.at = at.ok_or(io::ErrorKind::InvalidInput)?;
        Ok(self.at)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_are_read_and_changes_are_found() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        fs::write(&path, "0123456789").unwrap();
        let (file, open) = RasterFile::find(&path).unwrap();
        assert_eq!(
            (&*open.bytes(3, 4).unwrap(), &*open.start(99).unwrap()),
            (&b"3456"[..], &b"0123456789"[..])
        );
        assert!(open.bytes(8, 4).is_err());
        let mut text = String::new();
        let mut reader = open.reader();
        reader.seek(SeekFrom::End(-3)).unwrap();
        reader.read_to_string(&mut text).unwrap();
        assert_eq!(text, "789");
        file.open().unwrap();
        fs::write(&path, "012").unwrap();
        assert!(file.open().is_err_and(|e| e.to_string().contains("another program changed it")));
    }
}
