//! Opens files and streams of points and calls the reader of their format.

#[cfg(feature = "e57")]
use super::e57;
use super::format::{CloudFormat, DETECTED_BYTES};
use super::{PointSink, Reading, Selection, las, leica, pcd, ply, table, text};
#[cfg(feature = "parquet")]
use bytes::Bytes;
use std::io::{BufRead, BufReader, Cursor, Read};
use std::path::{Path, PathBuf};
use vlscan_base::diag::{Diagnostics, Place};
use vlscan_base::error::{Error, Result};
use vlscan_base::files::reads;
use vlscan_base::machine;
use vlscan_base::store::FileBytes;

/// Maximum length of a file that is read into memory before its points are decoded, bytes. Longer files are
/// mapped, and the parts whose points have been passed on are released.
const MAX_WHOLE_BYTES: u64 = 128 << 20;

/// Reads all points of a file, or of stdin for `-`. Returns warnings, and notes on how the file was
/// interpreted.
///
/// # Errors
/// [`Error::Input`] with all problems when the file does not exist, has no supported format, or is damaged:
/// the points before the damage may have been passed to the sink. [`Error::Io`] when it cannot be read. The
/// errors of the sink.
pub fn read_points(path: &Path, sink: &mut dyn PointSink) -> Result<Diagnostics> {
    read_points_on(path, 0, sink)
}

/// Reads all points as [`read_points`] does, decoded on `threads` threads; 0 means as many as the machine
/// runs at once. Points, their order and warnings do not depend on it. Streams are decoded on the calling
/// thread.
///
/// # Errors
/// The errors of [`read_points`].
pub fn read_points_on(path: &Path, threads: usize, sink: &mut dyn PointSink) -> Result<Diagnostics> {
    let mut found = Diagnostics::default();
    read_into(path, threads, sink, &mut found)?;
    found.finish(false)
}

/// The number of threads for a file; 0 stands for that of the machine.
fn or_all(threads: usize) -> usize {
    if threads == 0 { machine::threads() } else { threads }
}

/// Reads all points of a file; problems of the content are recorded in `found`.
fn read_into(path: &Path, threads: usize, sink: &mut dyn PointSink, found: &mut Diagnostics) -> Result<()> {
    let is_stdin = path.as_os_str() == "-";
    let is_file = !is_stdin && path.is_file();
    let name = if is_stdin { PathBuf::from("<stdin>") } else { path.to_path_buf() };
    let mut source: Box<dyn Read> = match is_stdin {
        true => Box::new(std::io::stdin().lock()),
        false => Box::new(reads::open(path).map_err(|e| Error::open(path, e))?),
    };
    // A pipe may deliver the first bytes one by one.
    let mut first = Vec::new();
    let read = source.by_ref().take(DETECTED_BYTES as u64).read_to_end(&mut first);
    read.map_err(|e| Error::io("read", &name, e))?;
    // The points of a stream are passed on as they arrive.
    let threads = if is_file { or_all(threads) } else { 1 };
    let mut reading = Reading::new(&name, sink.selection(), sink, found).on(threads);
    let Some(format) = recognise(&first, &mut reading) else { return Ok(()) };
    reading.tell(format);
    if format.is_stream() {
        let source = BufReader::with_capacity(1 << 20, Cursor::new(first).chain(source));
        read_stream(source, format, &mut reading)?;
        return reading.end();
    }
    let file = match is_file {
        true => FileBytes::open_in_parts(path, MAX_WHOLE_BYTES).map_err(|e| Error::open(path, e))?,
        false => {
            source.read_to_end(&mut first).map_err(|e| Error::io("read", &name, e))?;
            FileBytes::from(first)
        }
    };
    reading.release_from(&file);
    match format {
        #[cfg(feature = "parquet")]
        CloudFormat::Parquet => table::read_parquet(Bytes::from_owner(file.clone()), &mut reading)?,
        _ => read_binary(&file, format, &mut reading),
    }
    reading.end()?;
    file.check_unchanged().map_err(|e| Error::io("read", &name, e))
}

/// The format of a file with this beginning; `None` if it is not read, which is recorded.
fn recognise(first: &[u8], reading: &mut Reading) -> Option<CloudFormat> {
    let format = CloudFormat::recognise(first, reading.path);
    format.map_err(|problem| reading.fail(format!("{} {problem}", reading.path.display()), problem)).ok()
}

/// Reads a format from its beginning to its end.
fn read_stream(source: impl BufRead, format: CloudFormat, reading: &mut Reading) -> Result<()> {
    match format {
        CloudFormat::Arrow => table::read_arrow(source, reading),
        CloudFormat::Pts | CloudFormat::Ptx => leica::read(source, format == CloudFormat::Ptx, reading),
        #[cfg(feature = "mcap")]
        CloudFormat::Mcap => {
            let mut source = source;
            super::mcap::read_points(&mut source, reading)
        }
        _ => text::read(source, reading),
    }
}

/// Reads a binary format from all bytes of a file.
fn read_binary(bytes: &[u8], format: CloudFormat, reading: &mut Reading) {
    match format {
        CloudFormat::Ply => {
            let read = ply::read(bytes, reading);
            reading.fail_unless_ok(read);
        }
        CloudFormat::Pcd => {
            let read = pcd::read(bytes, reading);
            reading.fail_unless_ok(read);
        }
        #[cfg(feature = "e57")]
        CloudFormat::E57 => {
            let read = e57::read(bytes, reading);
            reading.fail_unless_ok(read);
        }
        _ => {
            let read = las::read(bytes, reading);
            reading.fail_unless_ok(read);
        }
    }
}

/// A file of points whose bytes are available, and may be read several times.
pub struct PointFile<'a> {
    path: &'a Path,
    bytes: &'a [u8],
    format: CloudFormat,
    threads: usize,
}

impl<'a> PointFile<'a> {
    /// Recognises the format; `None` if the format is not supported, which is recorded in `found`.
    pub fn new(path: &'a Path, bytes: &'a [u8], found: &mut Diagnostics) -> Option<PointFile<'a>> {
        match CloudFormat::recognise(&bytes[..bytes.len().min(DETECTED_BYTES)], path) {
            Ok(format) => Some(PointFile { path, bytes, format, threads: 0 }),
            Err(problem) => {
                let message = format!("{} {problem}", path.display());
                found.error(Some(Place::in_line(path, 1, "", 0..0)), message).because_of(problem);
                None
            }
        }
    }

    /// The format, as recognised by the beginning of the file.
    pub fn format(&self) -> CloudFormat {
        self.format
    }

    /// Decodes on this number of threads; 0, the default, is the number of threads that the machine runs at
    /// once. Points, their order and warnings do not depend on it.
    #[must_use]
    pub fn on_threads(self, threads: usize) -> PointFile<'a> {
        PointFile { threads, ..self }
    }

    /// Reads all points. Problems of the content are recorded in `found`.
    ///
    /// # Errors
    /// [`Error::Io`] when the file cannot be read, and the errors of the sink.
    pub fn read(
        &self,
        selection: Selection,
        sink: &mut dyn PointSink,
        found: &mut Diagnostics,
    ) -> Result<()> {
        let mut reading = Reading::new(self.path, selection, sink, found).on(or_all(self.threads));
        reading.tell(self.format);
        match self.format {
            #[cfg(feature = "parquet")]
            CloudFormat::Parquet => {
                let file = FileBytes::open(self.path).map_err(|e| Error::open(self.path, e))?;
                table::read_parquet(Bytes::from_owner(file.clone()), &mut reading)?;
                file.check_unchanged().map_err(|e| Error::io("read", self.path, e))?;
            }
            format if format.is_stream() => read_stream(Cursor::new(self.bytes), format, &mut reading)?,
            format => read_binary(self.bytes, format, &mut reading),
        }
        reading.end()
    }
}
