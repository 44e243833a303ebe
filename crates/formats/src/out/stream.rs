//! Byte destinations: a [`FileWriter`] with a buffer.

use super::offload::{NoOffload, Offload};
use super::writes::ParallelWrites;
use std::io::{Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use vlscan_base::error::Result;
use vlscan_base::files::{FileGroup, FileWriter, Patched, free_name};

/// Destination of bytes.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Destination {
    /// Standard output.
    Stdout,
    /// A file, pipe or device.
    Path(PathBuf),
}

/// One output that is being written.
pub struct OutputStream {
    out: FileWriter,
    buffer: Vec<u8>,
    /// Bytes appended so far, including buffered ones.
    len: u64,
    is_parallel: bool,
    /// Writes at offsets, after the first of which the position of the file is not its end.
    writes: Option<ParallelWrites>,
}

/// Size of the write buffer.
const BUFFER_BYTES: usize = 64 * 1024;
/// Pieces of this size are written without being copied to the buffer.
const DIRECT_BYTES: usize = 16 * 1024;

impl OutputStream {
    /// Opens an output, as [`FileWriter::create`] or [`FileWriter::stdout`].
    ///
    /// # Errors
    /// The errors of [`FileWriter`].
    pub fn open(place: &Destination, force: bool, patched: Patched) -> Result<OutputStream> {
        Ok(OutputStream::new(match place {
            Destination::Stdout => FileWriter::stdout(patched)?,
            Destination::Path(path) => FileWriter::create(path, force, patched)?,
        }))
    }

    /// As [`FileWriter::keeping_equal`].
    pub fn keeping_equal(mut self, keeps: bool) -> OutputStream {
        self.out = self.out.keeping_equal(keeps);
        self
    }

    /// Lets idle workers write pieces at their places in a file, see [`OutputStream::append_piece`].
    #[must_use]
    pub fn writing_in_parallel(mut self, is_parallel: bool) -> OutputStream {
        self.is_parallel = is_parallel;
        self
    }

    /// Creates an unnamed file that is removed when it is closed, see [`OutputStream::append_to`].
    pub fn unnamed() -> Result<OutputStream> {
        FileWriter::scratch().map(OutputStream::new)
    }

    fn new(out: FileWriter) -> OutputStream {
        OutputStream { out, buffer: Vec::new(), len: 0, is_parallel: false, writes: None }
    }

    /// Creates a file that is removed when it is dropped: next to this file, where its handle can be closed,
    /// or in the folder for temporary files if this stream is not a file.
    pub fn sibling_scratch(&self) -> Result<FileWriter> {
        match self.out.target() {
            Some(target) => FileWriter::create(target, true, Patched::Always),
            None => FileWriter::scratch(),
        }
    }

    /// Appends all bytes of an unnamed file to another stream.
    pub fn append_to(mut self, other: &mut OutputStream) -> Result<()> {
        self.flush()?;
        self.out.copy_to(|bytes| other.append(bytes))
    }

    /// True if [`OutputStream::patch`] is possible.
    pub fn is_seekable(&self) -> bool {
        self.out.is_seekable()
    }

    /// True if bytes are written directly to a pipe, terminal or device.
    pub fn is_stream(&self) -> bool {
        self.out.is_stream()
    }

    /// True if the output is a file that gets its name at the end.
    pub fn is_file(&self) -> bool {
        self.out.target().is_some()
    }

    /// Bytes appended so far, including buffered ones.
    #[expect(clippy::len_without_is_empty, reason = "a stream is not a collection")]
    pub fn len(&self) -> u64 {
        self.len
    }

    /// Appends bytes.
    ///
    /// # Errors
    /// The errors of [`FileWriter::append`].
    pub fn append(&mut self, bytes: &[u8]) -> Result<()> {
        if self.out.is_stream() || self.buffer.len() + bytes.len() > BUFFER_BYTES {
            self.flush()?;
        }
        if self.out.is_stream() || bytes.len() >= DIRECT_BYTES {
            self.flush()?;
            self.join_writes()?;
            self.len += bytes.len() as u64;
            return self.out.append(bytes);
        }
        self.len += bytes.len() as u64;
        self.buffer.extend_from_slice(bytes);
        Ok(())
    }

    /// [`OutputStream::append`] of a piece that a worker may write, at its place in the file, if
    /// [that is allowed](OutputStream::writing_in_parallel).
    pub fn append_piece(&mut self, bytes: Vec<u8>, offload: &dyn Offload) -> Result<()> {
        if bytes.len() < DIRECT_BYTES || !self.is_parallel || !self.is_file() {
            return self.append(&bytes);
        }
        self.flush()?;
        let offset = self.len;
        self.len += bytes.len() as u64;
        self.submit(offset, bytes, offload)
    }

    fn submit(&mut self, offset: u64, bytes: Vec<u8>, offload: &dyn Offload) -> Result<()> {
        let writes = match &mut self.writes {
            Some(writes) => writes,
            None => self.writes.insert(ParallelWrites::new(self.out.positioned()?, offload.threads())),
        };
        writes.submit(offset, bytes, offload).map_err(|e| self.out.failed("write", e))
    }

    /// Waits for the pieces that workers write, and goes to the end of the file.
    fn join_writes(&mut self) -> Result<()> {
        let Some(mut writes) = self.writes.take() else { return Ok(()) };
        let end = SeekFrom::Start(self.len - self.buffer.len() as u64);
        let ended = writes.finish().and_then(|()| self.out.seek(end));
        ended.map(drop).map_err(|e| self.out.failed("write", e))
    }

    /// Passes all buffered bytes to the operating system.
    pub fn flush(&mut self) -> Result<()> {
        if self.buffer.is_empty() {
            return Ok(());
        }
        if self.writes.is_some() {
            let bytes = std::mem::take(&mut self.buffer);
            return self.submit(self.len - bytes.len() as u64, bytes, &NoOffload);
        }
        let written = self.out.append(&self.buffer);
        self.buffer.clear();
        written
    }

    /// Replaces appended bytes from `offset` on.
    pub fn patch(&mut self, offset: u64, bytes: &[u8]) -> Result<()> {
        self.flush()?;
        self.join_writes()?;
        let OutputStream { out, len, .. } = self;
        let patched = out
            .seek(SeekFrom::Start(offset))
            .and_then(|_| out.write_all(bytes))
            .and_then(|()| out.seek(SeekFrom::Start(*len)));
        patched.map(drop).map_err(|e| out.failed("write", e))
    }

    /// Closes the file handle until the next append, so that thousands of legs do not need thousands of
    /// handles.
    pub fn close_handle(&mut self) -> Result<()> {
        if self.is_file() {
            self.flush()?;
            self.join_writes()?;
            self.buffer = Vec::new();
            self.out.close_handle();
        }
        Ok(())
    }

    /// Returns the name of the file if it is partial: `a.partial.laz` for `a.laz`. With `force` a partial
    /// file of an earlier run is replaced, otherwise the next name is chosen that is not `taken`. `None` for
    /// streams.
    pub fn partial_path(&self, force: bool, taken: impl Fn(&Path) -> bool) -> Option<PathBuf> {
        self.out.target().map(|target| free_name(target, "partial", |path| !force && taken(path)))
    }

    /// The complete file of an earlier run that has the output's name.
    pub fn existing(&self) -> Option<PathBuf> {
        self.out.target().filter(|target| target.is_file()).map(Path::to_path_buf)
    }

    /// Completes the output: renames the file to its name, or copies a spooled stream to its destination.
    pub fn finish(self) -> Result<()> {
        let mut group = FileGroup::default();
        self.finish_in(&mut group, None)?;
        group.commit()
    }

    /// [`OutputStream::finish`] of a file that gets its name, or that of `partial`, with the others of a
    /// group. A stream is complete afterwards.
    pub fn finish_in(mut self, group: &mut FileGroup, partial: Option<&Path>) -> Result<()> {
        self.flush()?;
        self.join_writes()?;
        match (self.out.target(), partial) {
            (None, _) => return self.out.finish().map(drop),
            (_, Some(path)) => group.add_as(self.out, path),
            (_, None) => group.add(self.out),
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn partial_files_are_written_beside_complete_ones() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.xyz");
        fs::write(&path, "old").unwrap();
        for (force, expected) in
            [(false, "a.partial.xyz"), (false, "a.partial-2.xyz"), (true, "a.partial.xyz")]
        {
            let mut out =
                OutputStream::open(&Destination::Path(path.clone()), force, Patched::Never).unwrap();
            out.append(b"new").unwrap();
            assert_eq!(out.existing(), Some(path.clone()));
            let partial = out.partial_path(force, |path| path.exists()).unwrap();
            assert_eq!(partial, dir.path().join(expected));
            let mut group = FileGroup::default();
            out.finish_in(&mut group, Some(&partial)).unwrap();
            group.commit().unwrap();
            assert_eq!(fs::read_to_string(&path).unwrap(), "old");
            assert_eq!(fs::read_to_string(&partial).unwrap(), "new");
        }
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 3);
    }
}
