//! Reads a stream of pulses as blocks of complete rows, which the workers parse. The first bytes decide whether the
//! stream is text or an Arrow stream.

use super::row::{PulseRow, RowFault};
use super::table_rows::{BatchReader, TableRows};
use super::text_rows::{LineReader, TextRows};
use std::path::{Path, PathBuf};
use std::time::Duration;
use vlscan_base::diag::{Diagnostics, Place};
use vlscan_base::error::{Error, Result};
use vlscan_base::input::arrow::{ArrowDetection, detect_arrow};
use vlscan_base::input::{InputStream, ReadEvent, is_stdin};
use vlscan_geom::DVec3;
use vlscan_warehouse::Stop;

/// Interval at which the stop flag is polled while no bytes arrive.
const STOP_POLL_INTERVAL: Duration = Duration::from_millis(100);

/// Rows of pulses that have not been parsed.
#[derive(Clone, Debug)]
pub struct RowBlock {
    rows: Rows,
    /// Number of rows in the stream before this block.
    before: u64,
}

#[derive(Clone, Debug)]
enum Rows {
    Text(TextRows),
    Table(TableRows),
}

/// Reader of a stream of pulses.
#[derive(Debug)]
pub struct PulseReader {
    input: InputStream,
    path: PathBuf,
    format: Format,
    ended: bool,
    before: u64,
    max_rows: usize,
}

#[derive(Debug)]
enum Format {
    /// Too few bytes have arrived to decide.
    Unknown(Vec<u8>),
    Text(LineReader),
    Table(BatchReader),
}

impl PulseReader {
    /// Opens a file, a named pipe, or (`-`) standard input. Blocks have at most `max_rows` rows.
    ///
    /// # Errors
    /// [`Error::Io`] when it cannot be opened.
    pub fn open(path: &Path, max_rows: usize) -> Result<PulseReader> {
        let input = InputStream::open(path).map_err(|e| Error::open(path, e))?;
        Ok(PulseReader::of(input, path, max_rows))
    }

    /// Reads a stream in memory; `name` is its name in messages.
    pub fn of_bytes(bytes: impl AsRef<[u8]> + Send + 'static, name: &Path, max_rows: usize) -> PulseReader {
        PulseReader::of(InputStream::from_reader(std::io::Cursor::new(bytes)), name, max_rows)
    }

    /// Reads `input`; `path` is the name in messages.
    pub fn of(input: InputStream, path: &Path, max_rows: usize) -> PulseReader {
        PulseReader {
            input,
            path: if is_stdin(path) { PathBuf::from("<stdin>") } else { path.to_path_buf() },
            format: Format::Unknown(Vec::new()),
            ended: false,
            before: 0,
            max_rows: max_rows.max(1),
        }
    }

    /// Waits for at least one row and returns the rows that have arrived; `None` at the end of the stream, or when
    /// `stop` is requested.
    ///
    /// # Errors
    /// [`Error::Input`] for an invalid header or schema and for a stream that is empty or truncated; [`Error::Io`]
    /// when it cannot be read.
    pub fn next_block(&mut self, stop: &Stop) -> Result<Option<RowBlock>> {
        loop {
            let rows = match &mut self.format {
                Format::Unknown(_) => None,
                Format::Text(lines) => lines.next_rows(self.max_rows, self.ended)?.map(Rows::Text),
                Format::Table(tables) => tables.next_rows(self.max_rows)?.map(Rows::Table),
            };
            if let Some(rows) = rows {
                let block = RowBlock { rows, before: self.before };
                self.before += block.rows.count();
                return Ok(Some(block));
            }
            if self.ended || !self.receive(stop)? {
                return self.finish(stop);
            }
        }
    }

    /// Waits for the next bytes; `false` when `stop` is requested.
    fn receive(&mut self, stop: &Stop) -> Result<bool> {
        loop {
            match self.input.next(Some(STOP_POLL_INTERVAL)) {
                ReadEvent::Bytes(bytes) => {
                    self.feed(&bytes);
                    self.receive_available();
                    return Ok(true);
                }
                ReadEvent::Timeout if stop.is_requested() => return Ok(false),
                ReadEvent::Timeout => {}
                ReadEvent::End => {
                    self.ended = true;
                    // A beginning of an Arrow stream that is too short to be recognised is read as text.
                    if let Format::Unknown(bytes) = &mut self.format {
                        let bytes = std::mem::take(bytes);
                        self.begin_text(&bytes);
                    }
                    return Ok(true);
                }
                ReadEvent::Error(e) => return Err(Error::io("read", &self.path, e)),
            }
        }
    }

    fn feed(&mut self, bytes: &[u8]) {
        match &mut self.format {
            Format::Text(lines) => lines.feed(bytes),
            Format::Table(tables) => tables.feed(bytes),
            Format::Unknown(first) => {
                first.extend_from_slice(bytes);
                let first = std::mem::take(first);
                match detect_arrow(&first) {
                    ArrowDetection::NeedMoreBytes => self.format = Format::Unknown(first),
                    ArrowDetection::Other => self.begin_text(&first),
                    ArrowDetection::Arrow => {
                        let mut tables = BatchReader::new(&self.path);
                        tables.feed(&first);
                        self.format = Format::Table(tables);
                    }
                }
            }
        }
    }

    fn begin_text(&mut self, bytes: &[u8]) {
        let mut lines = LineReader::new(&self.path);
        lines.feed(bytes);
        self.format = Format::Text(lines);
    }

    /// Adds all bytes that have already arrived, so that blocks of a fast stream are large.
    fn receive_available(&mut self) {
        while let Format::Text(lines) = &mut self.format
            && !lines.has_rows(self.max_rows)
        {
            match self.input.next(Some(Duration::ZERO)) {
                ReadEvent::Bytes(bytes) => lines.feed(&bytes),
                // The next call reports the end and errors again.
                _ => break,
            }
        }
    }

    fn finish(&self, stop: &Stop) -> Result<Option<RowBlock>> {
        match &self.format {
            _ if stop.is_requested() => Ok(None),
            Format::Table(tables) => tables.end().map(|()| None),
            Format::Text(lines) if lines.has_begun() => Ok(None),
            _ => {
                let mut problems = Diagnostics::default();
                let message = "the stream is empty, expected a header such as time,x,y,z,dx,dy,dz and pulses";
                problems.error(Some(Place::in_line(&self.path, 0, "", 0..0)), message);
                Err(Error::Input(Box::new(problems)))
            }
        }
    }
}

impl Rows {
    fn count(&self) -> u64 {
        match self {
            Rows::Text(rows) => rows.count(),
            Rows::Table(rows) => rows.count(),
        }
    }
}

impl RowBlock {
    pub fn rows(&self) -> u32 {
        u32::try_from(self.rows.count()).unwrap_or(u32::MAX)
    }

    /// Epoch of the first pulse; the other rows are not parsed.
    pub fn first_epoch(&self) -> u32 {
        match &self.rows {
            Rows::Text(rows) => rows.first_epoch(),
            Rows::Table(rows) => rows.first_epoch(),
        }
    }

    /// Splits the block before the first pulse of another epoch; the second value is the rest.
    pub fn split_at_epoch(self) -> (RowBlock, Option<RowBlock>) {
        let (first, rest) = match self.rows {
            Rows::Text(rows) => {
                let (first, rest) = rows.split_at_epoch();
                (Rows::Text(first), rest.map(Rows::Text))
            }
            Rows::Table(rows) => {
                let (first, rest) = rows.split_at_epoch();
                (Rows::Table(first), rest.map(Rows::Table))
            }
        };
        let rest = rest.map(|rows| RowBlock { rows, before: self.before + first.count() });
        (RowBlock { rows: first, before: self.before }, rest)
    }

    /// Appends the rows as pulses in the frame whose origin is at `shift` in the world. `check` accepts or refuses
    /// each pulse.
    ///
    /// # Errors
    /// [`Error::Input`] for the first row that is not a valid pulse, with its place.
    pub fn pulses(
        &self,
        shift: DVec3,
        into: &mut Vec<PulseRow>,
        check: impl Fn(&PulseRow) -> Result<(), RowFault>,
    ) -> Result<()> {
        match &self.rows {
            Rows::Text(rows) => rows.pulses(shift, self.before, into, check),
            Rows::Table(rows) => rows.pulses(shift, self.before, into, check),
        }
    }
}
