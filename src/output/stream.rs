//! Where the bytes of one file go. A named file is written as `NAME.part` and gets its name when it is complete; streams
//! are written as they come, or spooled to an unnamed file when the format has a header that is known only at the end.

use crate::error::{Error, Result};
use std::fs::{self, File, OpenOptions};
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

/// What bytes can be appended to and patched in.
pub(super) trait Storage: Write + Seek + Send {}
impl<T: Write + Seek + Send> Storage for T {}

/// Where one file goes.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Destination {
    /// Standard output.
    Stdout,
    /// A name.
    Path(PathBuf),
}

/// One output being written.
pub(super) struct OutputStream {
    /// For messages: the final name.
    name: PathBuf,
    kind: Kind,
    /// `None` while parked.
    storage: Option<Box<dyn Storage>>,
    buffer: Vec<u8>,
    /// Bytes appended so far, those in the buffer included.
    len: u64,
    /// Whether bytes at the beginning can be replaced.
    seekable: bool,
}

/// Whether bytes at the beginning will be replaced at the end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Patched {
    Never,
    /// Where the place allows it.
    IfPossible,
    Always,
}

enum Kind {
    /// Bytes go straight to where they belong.
    Direct,
    /// Bytes go to an unnamed file whose contents are wanted elsewhere later.
    Unnamed(File),
    /// Bytes are collected in an unnamed file and copied at the end.
    Spool { spool: File, stream: File },
    /// `part` gets the file's name at the end; `committed` when it has, or when it must stay under its own.
    Part { part: PathBuf, force: bool, committed: bool },
}

/// Appends are collected up to this size.
const BUFFER: usize = 64 * 1024;

/// The name of a file until it is complete.
pub(super) fn part_name(path: &Path) -> PathBuf {
    let mut name = path.as_os_str().to_os_string();
    name.push(".part");
    PathBuf::from(name)
}

/// The name beside a complete file under which a run that ended early leaves what it measured: `a.partial.laz` beside
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

/// Whether the name stands for a pipe, a terminal or a device, which is written as it is.
pub(super) fn is_special(path: &Path) -> bool {
    fs::metadata(path).is_ok_and(|m| !m.is_file() && !m.is_dir())
}

impl OutputStream {
    /// Opens a place for writing.
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
            Destination::Path(path) => OutputStream::part(path, force),
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

    fn part(path: &Path, force: bool) -> Result<OutputStream> {
        // A link is followed, so that it stays and what it points to is replaced.
        let path = match fs::canonicalize(path) {
            Ok(real) if path.is_symlink() => real,
            _ => path.to_path_buf(),
        };
        let part = part_name(&path);
        if force {
            match fs::remove_file(&part) {
                Err(e) if e.kind() != io::ErrorKind::NotFound => return Err(Error::io("replace", &part, e)),
                _ => {}
            }
        }
        let options = OpenOptions::new().read(true).write(true).create_new(true).open(&part);
        let file = options.map_err(|e| Error::io("create", &part, e))?;
        let kind = Kind::Part { part, force, committed: false };
        Ok(OutputStream::new(path, kind, Box::new(file)))
    }

    /// A file that has no name and goes away when it is closed, see [`OutputStream::append_to`].
    pub fn unnamed() -> Result<OutputStream> {
        let name = std::env::temp_dir();
        let no_file = |e| Error::io("create a file in", std::env::temp_dir(), e);
        let file = tempfile::tempfile().map_err(no_file)?;
        let storage = Box::new(file.try_clone().map_err(no_file)?);
        Ok(OutputStream::new(name, Kind::Unnamed(file), storage))
    }

    /// Appends all bytes of an unnamed file to another out.
    pub fn append_to(mut self, other: &mut OutputStream) -> Result<()> {
        self.flush()?;
        let Kind::Unnamed(file) = &mut self.kind else {
            return Err(Error::Internal(format!("{} has a name", self.name.display())));
        };
        let failed = |e| Error::io("read a file in", &self.name, e);
        file.seek(SeekFrom::Start(0)).map_err(failed)?;
        let mut block = vec![0; BUFFER];
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

    /// A named file whose bytes go through `storage`.
    #[cfg(test)]
    pub fn part_through(path: &Path, storage: impl FnOnce(File) -> Box<dyn Storage>) -> OutputStream {
        let mut out = OutputStream::part(path, false).unwrap();
        out.storage = Some(storage(File::options().write(true).open(part_name(path)).unwrap()));
        out
    }

    /// Whether [`OutputStream::patch`] works.
    pub fn is_seekable(&self) -> bool {
        self.seekable
    }

    /// Whether bytes leave as they come, to a pipe or the like.
    pub fn is_stream(&self) -> bool {
        matches!(self.kind, Kind::Direct)
    }

    /// Bytes appended so far.
    pub fn len(&self) -> u64 {
        self.len
    }

    /// Appends bytes.
    pub fn append(&mut self, bytes: &[u8]) -> Result<()> {
        self.len += bytes.len() as u64;
        if matches!(self.kind, Kind::Direct) || self.buffer.len() + bytes.len() > BUFFER {
            self.flush()?;
        }
        if matches!(self.kind, Kind::Direct) || bytes.len() >= BUFFER {
            return self.write(bytes);
        }
        self.buffer.extend_from_slice(bytes);
        Ok(())
    }

    /// Hands everything to the operating system.
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

    /// Replaces bytes that were appended at `offset`.
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

    /// Gives the file handle back until the next append, so that thousands of legs need no thousands of handles.
    pub fn close_handle(&mut self) -> Result<()> {
        if matches!(self.kind, Kind::Part { .. }) {
            self.flush()?;
            self.storage = None;
            self.buffer = Vec::new();
        }
        Ok(())
    }

    fn storage(&mut self) -> Result<&mut Box<dyn Storage>> {
        if self.storage.is_none() {
            let Kind::Part { part, .. } = &self.kind else {
                return Err(Error::Internal(format!("{} was parked", self.name.display())));
            };
            let file = OpenOptions::new().read(true).write(true).open(part);
            let mut file = file.map_err(|e| Error::io("open", part, e))?;
            file.seek(SeekFrom::End(0)).map_err(|e| Error::io("write", part, e))?;
            self.storage = Some(Box::new(file));
        }
        self.storage.as_mut().ok_or_else(|| Error::Internal("a file without a handle".to_owned()))
    }

    /// Where a partial file goes when a file of an earlier run stands under its name, which only a complete one may replace.
    pub fn partial_path(&self) -> Option<PathBuf> {
        let replaces = matches!(&self.kind, Kind::Part { force: true, .. }) && self.name.is_file();
        replaces.then(|| partial_name(&self.name))
    }

    /// Completes the file: it gets its name, or that of `beside`, or a spooled stream is copied.
    pub fn finish(mut self, beside: Option<&Path>) -> Result<()> {
        self.flush()?;
        if let Some(mut storage) = self.storage.take() {
            storage.flush().map_err(|e| Error::io("write", &self.name, e))?;
        }
        match &mut self.kind {
            Kind::Direct | Kind::Unnamed(_) => Ok(()),
            Kind::Spool { spool, stream } => spool
                .seek(SeekFrom::Start(0))
                .and_then(|_| io::copy(spool, stream))
                .map(drop)
                .map_err(|e| Error::io("write", &self.name, e)),
            Kind::Part { part, force, committed } => {
                let named = commit(part, beside.unwrap_or(&self.name), *force);
                // What came in between is not overwritten, and what was computed is not thrown away.
                *committed = !matches!(&named, Err(e) if e.kind() != io::ErrorKind::AlreadyExists);
                named.map_err(|e| Error::io("give its name to", &*part, e))
            }
        }
    }
}

impl Drop for OutputStream {
    fn drop(&mut self) {
        if let Kind::Part { part, committed: false, .. } = &self.kind {
            // The run has failed already; there is nothing better to report than its error.
            let _ = fs::remove_file(part);
        }
    }
}

/// Renames `part`; without `force` never over another file.
fn commit(part: &Path, name: &Path, force: bool) -> io::Result<()> {
    if force {
        return fs::rename(part, name);
    }
    match fs::hard_link(part, name) {
        Ok(()) => fs::remove_file(part),
        Err(e) if e.kind() == io::ErrorKind::AlreadyExists => Err(e),
        // Some file systems have no hard links.
        Err(_) if name.exists() => Err(io::ErrorKind::AlreadyExists.into()),
        Err(_) => fs::rename(part, name),
    }
}

/// Whether bytes at the beginning can be replaced later. The name does not tell (`/dev/stdout`, `<(…)`), and a file
/// that the shell opened for appending, or that holds something already, moves but does not keep its place.
fn is_seekable(file: &mut File) -> bool {
    matches!(file.stream_position(), Ok(0)) && !appends(file)
}

/// Whether every write goes to the end of the file (`>>`).
#[cfg(unix)]
fn appends(file: &File) -> bool {
    rustix::fs::fcntl_getfl(file).is_ok_and(|flags| flags.contains(rustix::fs::OFlags::APPEND))
}

/// Whether every write goes to the end of the file; shells here seek instead.
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

/// Standard output without the line buffer of the standard library.
#[cfg(windows)]
fn stdout_file() -> io::Result<File> {
    use std::os::windows::io::AsHandle;
    io::stdout().as_handle().try_clone_to_owned().map(File::from)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seeking_is_tried_and_not_guessed_from_names() {
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
    fn parked_files_go_on_where_they_were() {
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
    fn what_is_partial_stands_beside_what_is_complete() {
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
        // Without an old file the name itself is free, whatever is written under it.
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

    #[cfg(unix)]
    #[test]
    fn a_link_stays_a_link() {
        let dir = tempfile::tempdir().unwrap();
        let [link, target] = ["link", "target"].map(|name| dir.path().join(name));
        fs::write(&target, "old").unwrap();
        std::os::unix::fs::symlink(&target, &link).unwrap();
        let mut out = OutputStream::open(&Destination::Path(link.clone()), true, Patched::Never).unwrap();
        out.append(b"new").unwrap();
        out.finish(None).unwrap();
        assert!(link.is_symlink());
        assert_eq!(fs::read_to_string(target).unwrap(), "new");
    }
}
