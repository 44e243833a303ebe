//! A file, stream or scratch file that is written.

use super::fault;
use super::group::{FileGroup, Member};
use super::paths::{is_special, is_stdout, resolve};
use super::positioned::PositionedFile;
use super::reads::{refuse_input, refuse_input_at};
use super::stream::{Stream, stderr_file, stdout_file};
use super::temporary::{TemporaryFile, synchronise};
use crate::error::{Error, Result};
use std::fs::{File, OpenOptions};
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

/// True if bytes at the beginning will be replaced at the end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Patched {
    /// Bytes are only appended, so any stream is a possible destination.
    Never,
    /// If the destination allows it.
    IfPossible,
    /// In any case: bytes for a stream that cannot seek are collected in a scratch file first.
    Always,
}

/// A destination of bytes. Errors refer to the path as the user wrote it.
#[derive(Debug)]
pub struct FileWriter {
    name: PathBuf,
    kind: Kind,
    /// The file, unless bytes go directly to a stream; `None` while the handle is closed.
    file: Option<File>,
    /// True if bytes at the beginning can be replaced.
    seekable: bool,
}

#[derive(Debug)]
enum Kind {
    /// Bytes go directly to the stream.
    Stream(Stream),
    /// Bytes are collected in a scratch file and copied to the stream at the end.
    Spooled(Stream),
    /// Bytes go to an unnamed file, which is removed when it is closed.
    Scratch,
    /// Bytes go to a temporary file that is renamed at the end.
    Named { temporary: TemporaryFile, target: PathBuf, replace: bool, is_own: bool, keeps_equal: bool },
}

/// Bytes per read when a file is copied.
const COPY_BYTES: usize = 64 * 1024;

impl FileWriter {
    /// Opens `path` for writing. A pipe, terminal or device is written directly, or at the end if bytes at
    /// the beginning are `patched`; a file gets its name when it is [finished](FileWriter::finish), and
    /// replaces an existing one only with `replace`, and never one that this command has read.
    pub fn create(path: &Path, replace: bool, patched: Patched) -> Result<FileWriter> {
        if is_stdout(path) {
            return FileWriter::stdout(patched);
        }
        refuse_input(path)?;
        if is_special(path) {
            // A file that the shell has opened (`3>>log`) keeps its contents.
            let is_filled = std::fs::metadata(path).is_ok_and(|about| about.is_file() && about.len() > 0);
            let mut options = OpenOptions::new();
            let options = if is_filled { options.append(true) } else { options.write(true) };
            let file =
                fault::point().and_then(|()| options.open(path)).map_err(|e| Error::io("open", path, e))?;
            return FileWriter::stream(path.to_path_buf(), file, patched);
        }
        let failed = |e| Error::io("create", path, e);
        let target = resolve(path).map_err(failed)?;
        let (temporary, file) = TemporaryFile::create(&target).map_err(failed)?;
        let kind = Kind::Named { temporary, target, replace, is_own: false, keeps_equal: false };
        Ok(FileWriter { name: path.to_path_buf(), kind, file: Some(file), seekable: true })
    }

    /// Opens a file of the program's own state, which replaces an existing one. A pipe or link in its place
    /// is an error and is not waited for.
    pub fn create_own(path: &Path) -> Result<FileWriter> {
        let failed = |e| Error::io("create", path, e);
        if path.symlink_metadata().is_ok_and(|about| !about.is_file()) {
            return Err(Error::input(format!("{} is not a regular file: remove it", path.display())));
        }
        let (temporary, file) = TemporaryFile::create(path).map_err(failed)?;
        let target = path.to_path_buf();
        let kind = Kind::Named { temporary, target, replace: true, is_own: true, keeps_equal: false };
        Ok(FileWriter { name: path.to_path_buf(), kind, file: Some(file), seekable: true })
    }

    /// With `keeps`, a file of the same name that is not to be replaced is no error if it holds the same
    /// bytes: it stays, and this one is removed.
    pub fn keeping_equal(mut self, keeps: bool) -> FileWriter {
        if let Kind::Named { keeps_equal, .. } = &mut self.kind {
            *keeps_equal = keeps;
        }
        self
    }

    /// Opens standard output.
    pub fn stdout(patched: Patched) -> Result<FileWriter> {
        let name = PathBuf::from("standard output");
        let file = stdout_file().map_err(|e| Error::io("open", &name, e))?;
        refuse_input_at(&name, &file)?;
        FileWriter::stream(name, file, patched)
    }

    /// Creates an unnamed file in the folder for temporary files, which is removed when it is closed.
    pub fn scratch() -> Result<FileWriter> {
        Ok(FileWriter { name: PathBuf::new(), kind: Kind::Scratch, file: Some(scratch()?), seekable: true })
    }

    fn stream(name: PathBuf, file: File, patched: Patched) -> Result<FileWriter> {
        let mut stream = Stream::new(file);
        let seekable = stream.is_seekable();
        if patched != Patched::Always || seekable {
            return Ok(FileWriter { name, kind: Kind::Stream(stream), file: None, seekable });
        }
        Ok(FileWriter { name, kind: Kind::Spooled(stream), file: Some(scratch()?), seekable: true })
    }

    /// True if bytes that were written can be replaced.
    pub fn is_seekable(&self) -> bool {
        self.seekable
    }

    /// True if bytes are written directly to a pipe, terminal or device.
    pub fn is_stream(&self) -> bool {
        matches!(self.kind, Kind::Stream(_))
    }

    /// The error for an operation that failed.
    pub fn failed(&self, action: &'static str, e: io::Error) -> Error {
        match self.kind {
            Kind::Spooled(_) | Kind::Scratch => scratch_failed(e),
            _ => Error::io(action, &self.name, e),
        }
    }

    /// Path of the temporary file until the file gets its name; `None` for streams.
    pub fn temporary_path(&self) -> Option<&Path> {
        match &self.kind {
            Kind::Named { temporary, .. } => Some(temporary.path()),
            _ => None,
        }
    }

    /// Writes all bytes.
    pub fn append(&mut self, bytes: &[u8]) -> Result<()> {
        self.write_all(bytes).map_err(|e| self.failed("write", e))
    }

    /// Closes the handle of a named file until the next write, so that thousands of files do not need
    /// thousands of handles.
    pub fn close_handle(&mut self) {
        if matches!(self.kind, Kind::Named { .. }) {
            self.file = None;
        }
    }

    /// Another handle of a named file, for writes at given offsets.
    pub fn positioned(&mut self) -> Result<PositionedFile> {
        let file = self.handle().and_then(|file| file.try_clone());
        file.map(PositionedFile::of).map_err(|e| self.failed("write", e))
    }

    /// Copies the bytes of a scratch file to another writer.
    pub fn copy_to(mut self, mut copy: impl FnMut(&[u8]) -> Result<()>) -> Result<()> {
        self.rewind().map_err(|e| self.failed("read", e))?;
        let mut block = vec![0; COPY_BYTES];
        loop {
            match self.read(&mut block).map_err(|e| self.failed("read", e))? {
                0 => return Ok(()),
                n => copy(&block[..n])?,
            }
        }
    }

    /// The file whose name this one gets when it is finished; `None` for streams.
    pub fn target(&self) -> Option<&Path> {
        match &self.kind {
            Kind::Named { target, .. } => Some(target),
            _ => None,
        }
    }

    /// Completes the file under its name and returns that, or copies the collected bytes to a stream.
    ///
    /// # Errors
    /// [`Error::Io`]. The file is removed, unless only its folder could not be synchronised, or another file
    /// of its name has appeared, next to which it is left as `NAME.new.EXT`.
    pub fn finish(self) -> Result<PathBuf> {
        let (name, target) = (self.name.clone(), self.target().map(Path::to_path_buf));
        self.finish_as(target.as_deref().unwrap_or(&name)).map(|()| name)
    }

    /// [`FileWriter::finish`] under another name than that of [`FileWriter::target`].
    pub fn finish_as(mut self, path: &Path) -> Result<()> {
        let (stream, file) = match self.kind {
            Kind::Scratch | Kind::Stream(_) => return Ok(()),
            Kind::Spooled(ref mut stream) => (stream, &mut self.file),
            Kind::Named { .. } => return FileGroup::of(self.complete(Some(path))?).commit(),
        };
        let Some(file) = file else { return Err(Error::Internal("a scratch file has no handle".to_owned())) };
        file.rewind().map_err(scratch_failed)?;
        let mut block = vec![0; COPY_BYTES];
        loop {
            match file.read(&mut block).map_err(scratch_failed)? {
                0 => return Ok(()),
                n => fault::point()
                    .and_then(|()| stream.write_all(&block[..n]))
                    .map_err(|e| Error::io("write", &self.name, e))?,
            }
        }
    }

    /// Writes the content to the disk, or copies it to its stream. The file that then waits for its name,
    /// `path` or that of [`FileWriter::target`]; `None` for streams.
    pub(super) fn complete(mut self, path: Option<&Path>) -> Result<Option<Member>> {
        if !matches!(self.kind, Kind::Named { .. }) {
            return self.finish().map(|_| None);
        }
        self.handle().and_then(|file| synchronise(file)).map_err(|e| self.failed("write", e))?;
        self.file = None;
        let Kind::Named { temporary, target, replace, is_own, keeps_equal } = self.kind else {
            return Ok(None);
        };
        let target = path.map_or(target, Path::to_path_buf);
        Ok(Some(Member { temporary, target, replace, is_own, keeps_equal }))
    }

    fn handle(&mut self) -> io::Result<&mut File> {
        let file = match (self.file.take(), &self.kind) {
            (Some(file), _) => file,
            (None, Kind::Named { temporary, .. }) => {
                let mut file = temporary.reopen()?;
                file.seek(SeekFrom::End(0))?;
                file
            }
            (None, _) => return Err(io::ErrorKind::Unsupported.into()),
        };
        Ok(self.file.insert(file))
    }
}

fn scratch() -> Result<File> {
    fault::point().and_then(|()| tempfile::tempfile()).map_err(scratch_failed)
}

/// The error of a failed access to a scratch file, with the folder for temporary files as its path.
pub fn scratch_failed(e: io::Error) -> Error {
    Error::io("write a temporary file in the folder that TMPDIR names,", std::env::temp_dir(), e)
}

impl Write for FileWriter {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        fault::point()?;
        match &mut self.kind {
            Kind::Stream(stream) => stream.write(bytes),
            _ => self.handle()?.write(bytes),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Seek for FileWriter {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        match &mut self.kind {
            Kind::Stream(stream) => stream.seek(to),
            _ => self.handle()?.seek(to),
        }
    }
}

impl Read for FileWriter {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        fault::point()?;
        self.handle()?.read(bytes)
    }
}

/// Writes a file, or stdout if that is what `path` names; an existing file is replaced only with `replace`.
///
/// # Errors
/// As for [`FileWriter`].
pub fn write_file(path: &Path, replace: bool, bytes: &[u8]) -> Result<()> {
    let mut file = FileWriter::create(path, replace, Patched::Never)?;
    file.append(bytes)?;
    file.finish().map(drop)
}

/// Writes a text to standard output.
///
/// # Errors
/// [`Error::ClosedPipe`] if the reader has closed it; [`Error::Io`].
pub fn write_stdout(text: &str) -> Result<()> {
    FileWriter::stdout(Patched::Never)?.append(text.as_bytes())
}

/// Writes a message to standard error. A message is lost if standard error is closed.
pub fn write_stderr(text: &str) {
    // Messages of several threads follow each other.
    let _lock = io::stderr().lock();
    if let Ok(file) = stderr_file() {
        let _ = Stream::new(file).write_all(text.as_bytes());
    }
}
