//! Byte destinations. A named file is written as `NAME.part` and renamed when it is complete. Streams are written
//! directly, or spooled to an unnamed file when the format has a header that is known only at the end.

use crate::error::{Error, Result};
use crate::files::TemporaryFile;
use std::fs::{self, File, OpenOptions};
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

pub(super) trait Storage: Write + Seek + Send {}
impl<T: Write + Seek + Send> Storage for T {}

#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Destination {
    /// Standard output.
    Stdout,
    /// A file, pipe or device.
    Path(PathBuf),
}

/// One output that is being written.
pub(super) struct OutputStream {
    /// The final name, for messages.
    name: PathBuf,
    kind: Kind,
    /// `None` while the handle is closed.
    storage: Option<Box<dyn Storage>>,
    buffer: Vec<u8>,
    /// Bytes appended so far, including buffered ones.
    len: u64,
    /// Whether bytes at the beginning can be replaced.
    seekable: bool,
}

/// Whether bytes at the beginning will be replaced at the end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Patched {
    Never,
    /// If the destination allows it.
    IfPossible,
    Always,
}

enum Kind {
    /// Bytes go directly to the destination.
    Direct,
    /// Bytes go to an unnamed file, see [`OutputStream::append_to`].
    Unnamed(File),
    /// Bytes are collected in an unnamed file and copied at the end.
    Spool { spool: File, stream: File },
    /// Bytes go to a temporary file that is renamed at the end.
    Named { temporary: TemporaryFile, force: bool },
}

/// Size of the write buffer.
const BUFFER_BYTES: usize = 64 * 1024;

/// Returns the name under which an interrupted run leaves its records beside a complete file: `a.partial.laz` beside
/// `a.laz`, `a.partial.copc.laz` beside `a.copc.laz`.
pub(super) fn partial_name(path: &Path) -> PathBuf {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let octree = name
        .len()
        .checked_sub(".copc.laz".len())
        .filter(|&at| name.get(at..).is_some_and(|end| at > 0 && end.eq_ignore_ascii_case(".copc.laz")));
    match octree.or(name.rfind('.').filter(|&at| at > 0)) {
        Some(at) => path.with_file_name(format!("{}.partial{}", &name[..at], &name[at..])),
        None => path.with_file_name(format!("{name}.partial")),
    }
}

/// Whether the path is a pipe, a terminal or a device, which is written directly.
pub(super) fn is_special(path: &Path) -> bool {
    fs::metadata(path).is_ok_and(|m| !m.is_file() && !m.is_dir())
}

impl OutputStream {
    pub fn open(place: &Destination, force: bool, patched: Patched) -> Result<OutputStream> {
        match place {
            Destination::Stdout => {
                let name = PathBuf::from("standard output");
                let file = stdout_file().map_err(|e| Error::io("open", &name, e))?;
                OutputStream::stream(name, file, patched)
            }
            Destination::Path(path) if is_special(path) => {
                let file =
                    OpenOptions::new().write(true).open(path).map_err(|e| Error::io("open", path, e))?;
                OutputStream::stream(path.clone(), file, patched)
            }
            Destination::Path(path) => OutputStream::named(path, force),
        }
    }

    fn stream(name: PathBuf, mut file: File, patched: Patched) -> Result<OutputStream> {
        let seekable = is_seekable(&mut file);
        if patched != Patched::Always || seekable {
            let mut out = OutputStream::new(name, Kind::Direct, Box::new(file));
            out.seekable = seekable;
            return Ok(out);
        }
        let no_spool = |e| Error::io("create a file in", std::env::temp_dir(), e);
        let spool = tempfile::tempfile().map_err(no_spool)?;
        let storage = Box::new(spool.try_clone().map_err(no_spool)?);
        Ok(OutputStream::new(name, Kind::Spool { spool, stream: file }, storage))
    }

    fn named(path: &Path, force: bool) -> Result<OutputStream> {
        let (temporary, file) = TemporaryFile::create(path, force)?;
        let name = temporary.target().to_path_buf();
        Ok(OutputStream::new(name, Kind::Named { temporary, force }, Box::new(file)))
    }

    /// Creates an unnamed file that is removed when it is closed, see [`OutputStream::append_to`].
    pub fn unnamed() -> Result<OutputStream> {
        let name = std::env::temp_dir();
        let no_file = |e| Error::io("create a file in", std::env::temp_dir(), e);
        let file = tempfile::tempfile().map_err(no_file)?;
        let storage = Box::new(file.try_clone().map_err(no_file)?);
        Ok(OutputStream::new(name, Kind::Unnamed(file), storage))
    }

    /// Appends all bytes of an unnamed file to another stream.
    pub fn append_to(mut self, other: &mut OutputStream) -> Result<()> {
        self.flush()?;
        let Kind::Unnamed(file) = &mut self.kind else {
            return Err(Error::Internal(format!("{} has a name", self.name.display())));
        };
        let failed = |e| Error::io("read a file in", &self.name, e);
        file.seek(SeekFrom::Start(0)).map_err(failed)?;
        let mut block = vec![0; BUFFER_BYTES];
        loop {
            match file.read(&mut block).map_err(failed)? {
                0 => return Ok(()),
                n => other.append(&block[..n])?,
            }
        }
    }

    fn new(name: PathBuf, kind: Kind, storage: Box<dyn Storage>) -> OutputStream {
        OutputStream { name, kind, storage: Some(storage), buffer: Vec::new(), len: 0, seekable: true }
    }

    /// Creates a named file whose bytes go through `storage`.
    #[cfg(test)]
    pub fn named_through(path: &Path, storage: impl FnOnce(File) -> Box<dyn Storage>) -> OutputStream {
        let (temporary, file) = TemporaryFile::create(path, false).unwrap();
        OutputStream::new(path.to_path_buf(), Kind::Named { temporary, force: false }, storage(file))
    }

    /// Whether [`OutputStream::patch`] is possible.
    pub fn is_seekable(&self) -> bool {
        self.seekable
    }

    /// Whether bytes are written directly to a pipe, terminal or device.
    pub fn is_stream(&self) -> bool {
        matches!(self.kind, Kind::Direct)
    }

    /// Bytes appended so far, including buffered ones.
    pub fn len(&self) -> u64 {
        self.len
    }

    pub fn append(&mut self, bytes: &[u8]) -> Result<()> {
        self.len += bytes.len() as u64;
        if matches!(self.kind, Kind::Direct) || self.buffer.len() + bytes.len() > BUFFER_BYTES {
            self.flush()?;
        }
        if matches!(self.kind, Kind::Direct) || bytes.len() >= BUFFER_BYTES {
            return self.write(bytes);
        }
        self.buffer.extend_from_slice(bytes);
        Ok(())
    }

    /// Passes all bytes to the operating system.
    pub fn flush(&mut self) -> Result<()> {
        if self.buffer.is_empty() {
            return Ok(());
        }
        let buffer = std::mem::take(&mut self.buffer);
        let written = self.write(&buffer);
        self.buffer = buffer;
        self.buffer.clear();
        written
    }

    fn write(&mut self, bytes: &[u8]) -> Result<()> {
        let written = self.storage()?.write_all(bytes);
        written.map_err(|e| Error::io("write", &self.name, e))
    }

    /// Replaces appended bytes from `offset` on.
    pub fn patch(&mut self, offset: u64, bytes: &[u8]) -> Result<()> {
        self.flush()?;
        let end = self.len;
        let storage = self.storage()?;
        let patched = storage
            .seek(SeekFrom::Start(offset))
            .and_then(|_| storage.write_all(bytes))
            .and_then(|_| storage.seek(SeekFrom::Start(end)));
        patched.map(drop).map_err(|e| Error::io("write", &self.name, e))
    }

    /// Closes the file handle until the next append, so that thousands of legs do not need thousands of handles.
    pub fn close_handle(&mut self) -> Result<()> {
        if matches!(self.kind, Kind::Named { .. }) {
            self.flush()?;
            self.storage = None;
            self.buffer = Vec::new();
        }
        Ok(())
    }

    fn storage(&mut self) -> Result<&mut Box<dyn Storage>> {
        let storage = match (self.storage.take(), &self.kind) {
            (Some(storage), _) => storage,
            (None, Kind::Named { temporary, .. }) => {
                let path = temporary.path();
                let file = OpenOptions::new().read(true).write(true).open(path);
                let mut file = file.map_err(|e| Error::io("open", path, e))?;
                file.seek(SeekFrom::End(0)).map_err(|e| Error::io("write", path, e))?;
                Box::new(file)
            }
            (None, _) => return Err(Error::Internal(format!("{} has no handle", self.name.display()))),
        };
        Ok(self.storage.insert(storage))
    }

    /// Returns the name for a partial file if a file of an earlier run has the stream's name, which only a complete
    /// file replaces.
    pub fn partial_path(&self) -> Option<PathBuf> {
        let replaces = matches!(&self.kind, Kind::Named { force: true, .. }) && self.name.is_file();
        replaces.then(|| partial_name(&self.name))
    }

    /// Completes the output: renames the file to its name, or to `beside`, or copies a spooled stream to its
    /// destination.
    pub fn finish(mut self, beside: Option<&Path>) -> Result<()> {
        self.flush()?;
        if let Some(mut storage) = self.storage.take() {
            storage.flush().map_err(|e| Error::io("write", &self.name, e))?;
        }
        match self.kind {
            Kind::Direct | Kind::Unnamed(_) => Ok(()),
            Kind::Spool { mut spool, mut stream } => spool
                .seek(SeekFrom::Start(0))
                .and_then(|_| io::copy(&mut spool, &mut stream))
                .map(drop)
                .map_err(|e| Error::io("write", &self.name, e)),
            Kind::Named { temporary, .. } => temporary.commit_as(beside.unwrap_or(&self.name)),
        }
    }
}

/// Whether bytes at the beginning can be replaced later. The name alone does not decide (`/dev/stdout`, `<(…)`), and
/// in a file that the shell opened for appending, or that is not empty, offsets do not count from the first byte of
/// the stream.
fn is_seekable(file: &mut File) -> bool {
    matches!(file.stream_position(), Ok(0)) && !appends(file)
}

/// Whether every write goes to the end of the file (`>>`).
#[cfg(unix)]
fn appends(file: &File) -> bool {
    rustix::fs::fcntl_getfl(file).is_ok_and(|flags| flags.contains(rustix::fs::OFlags::APPEND))
}

/// Always false: shells on this platform seek to the end instead of opening the file for appending.
#[cfg(not(unix))]
fn appends(_: &File) -> bool {
    false
}

/// Standard output without the line buffer of the standard library.
#[cfg(unix)]
fn stdout_file() -> io::Result<File> {
    use std::os::fd::AsFd;
    io::stdout().as_fd().try_clone_to_owned().map(File::from)
}

#[cfg(windows)]
fn stdout_file() -> io::Result<File> {
    use std::os::windows::io::AsHandle;
    io::stdout().as_handle().try_clone_to_owned().map(File::from)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_empty_files_that_do_not_append_are_seekable() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a");
        assert!(is_seekable(&mut File::create(&path).unwrap()), "standard output as `> a`");
        fs::write(&path, "before").unwrap();
        assert!(!is_seekable(&mut File::options().append(true).open(&path).unwrap()), "`>> a`");
        let mut later = File::options().write(true).open(&path).unwrap();
        later.seek(SeekFrom::End(0)).unwrap();
        assert!(!is_seekable(&mut later), "`(echo; vlscan) > a`");
    }

    #[test]
    fn files_continue_after_their_handles_were_closed() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a");
        let mut out = OutputStream::open(&Destination::Path(path.clone()), false, Patched::Always).unwrap();
        for text in ["head ", "one ", "two"] {
            out.append(text.as_bytes()).unwrap();
            out.close_handle().unwrap();
        }
        out.patch(0, b"HEAD").unwrap();
        out.append(b" three").unwrap();
        assert_eq!(out.len(), 18);
        out.finish(None).unwrap();
        assert_eq!(fs::read_to_string(path).unwrap(), "HEAD one two three");
    }

    #[test]
    fn partial_files_are_written_beside_complete_ones() {
        for (name, beside) in [
            ("d.x/a.laz", "d.x/a.partial.laz"),
            ("a.copc.laz", "a.partial.copc.laz"),
            (".laz", ".laz.partial"),
            ("d.x/a", "d.x/a.partial"),
        ] {
            assert_eq!(partial_name(Path::new(name)), Path::new(beside));
        }
        let dir = tempfile::tempdir().unwrap();
        let [path, beside] = ["a.xyz", "a.partial.xyz"].map(|name| dir.path().join(name));
        // Without an older file the name itself is free, even for a partial file.
        for (old, expected) in [(None, None), (Some("old"), Some(beside.clone()))] {
            let _ = old.map(|text| fs::write(&path, text).unwrap());
            let mut out = OutputStream::open(&Destination::Path(path.clone()), true, Patched::Never).unwrap();
            out.append(b"new").unwrap();
            let beside = out.partial_path();
            assert_eq!(beside, expected);
            out.finish(beside.as_deref()).unwrap();
            assert_eq!(fs::read_to_string(&path).unwrap(), old.unwrap_or("new"));
        }
        assert_eq!(fs::read_to_string(&beside).unwrap(), "new");
    }
}
