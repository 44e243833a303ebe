//! Reads a stream of pulses as blocks of complete rows, which the workers parse. The first bytes decide
//! whether the stream is text or an Arrow stream.

use super::columns::PulseColumn;
use super::row::{PulseRow, RowFault};
use super::schema::StreamSchema;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;
use vlscan_base::diag::{Diagnostics, Place};
use vlscan_base::error::{Error, Result};
use vlscan_geom::DVec3;
use vlscan_tables::input::rows::{self, RowDecoder};
use vlscan_tables::input::{InputStream, ReadEvent, is_stdin};

/// Interval at which the stop flag is polled while no bytes arrive.
const STOP_POLL_INTERVAL: Duration = Duration::from_millis(100);
/// Approximate length of a line with all columns, bytes.
const TYPICAL_LINE_BYTES: usize = 320;

/// Rows of pulses that have not been parsed.
#[derive(Clone, Debug)]
pub struct RowBlock {
    rows: rows::RowBlock,
    schema: Arc<StreamSchema>,
}

/// Reader of a stream of pulses.
#[derive(Debug)]
pub struct PulseReader {
    input: InputStream,
    path: PathBuf,
    decoder: RowDecoder,
    schema: Option<Arc<StreamSchema>>,
    ended: bool,
    max_rows: usize,
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
        let path = if is_stdin(path) { PathBuf::from("<stdin>") } else { path.to_path_buf() };
        let decoder = RowDecoder::new(&path, "a pulse", None);
        PulseReader { input, path, decoder, schema: None, ended: false, max_rows: max_rows.max(1) }
    }

    /// Waits for at least one row and returns the rows that have arrived; `None` at the end of the stream, or
    /// when `is_stopped` returns true.
    ///
    /// # Errors
    /// [`Error::Input`] for an invalid header or schema and for a stream that is empty or truncated;
    /// [`Error::Io`] when it cannot be read.
    pub fn next_block(&mut self, is_stopped: &dyn Fn() -> bool) -> Result<Option<RowBlock>> {
        loop {
            let block = self.decoder.next_block(self.max_rows, self.ended)?;
            let has_rows = block.is_some();
            if let Some(rows) = self.without_header(block)?
                && let Some(schema) = self.schema.clone()
            {
                return Ok(Some(RowBlock { rows, schema }));
            }
            if !has_rows && (self.ended || !self.receive(is_stopped)?) {
                return self.finish(is_stopped);
            }
        }
    }

    /// Resolves the columns as soon as they are known, even before the first row; returns the rows without a
    /// header.
    fn without_header(&mut self, block: Option<rows::RowBlock>) -> Result<Option<rows::RowBlock>> {
        if self.schema.is_some() {
            return Ok(block);
        }
        if let Some(fields) = self.decoder.fields() {
            self.schema = Some(Arc::new(StreamSchema::of_fields(&self.path, fields)?));
            return Ok(block);
        }
        let Some(block) = block else { return Ok(None) };
        let schema = StreamSchema::of_text(&block.row(0, &mut Vec::new()))?;
        let has_header = schema.header_rows > 0;
        self.schema = Some(Arc::new(schema));
        Ok(if has_header { block.split_at(1).1 } else { Some(block) })
    }

    /// Waits for the next bytes; `false` when `is_stopped` returns true.
    fn receive(&mut self, is_stopped: &dyn Fn() -> bool) -> Result<bool> {
        loop {
            match self.input.next(Some(STOP_POLL_INTERVAL)) {
                ReadEvent::Bytes(bytes) => {
                    self.decoder.feed(&bytes);
                    self.receive_available();
                    return Ok(true);
                }
                ReadEvent::Timeout if is_stopped() => return Ok(false),
                ReadEvent::Timeout => {}
                ReadEvent::End => {
                    self.ended = true;
                    return Ok(true);
                }
                ReadEvent::Error(e) => return Err(Error::io("read", &self.path, e)),
            }
        }
    }

    /// Adds all bytes of text that have already arrived, so that blocks of a fast stream are large.
    fn receive_available(&mut self) {
        while !self.decoder.has_pending(self.max_rows.saturating_mul(TYPICAL_LINE_BYTES)) {
            match self.input.next(Some(Duration::ZERO)) {
                ReadEvent::Bytes(bytes) => self.decoder.feed(&bytes),
                // The next call reports the end and errors again.
                _ => break,
            }
        }
    }

    fn finish(&self, is_stopped: &dyn Fn() -> bool) -> Result<Option<RowBlock>> {
        if is_stopped() || self.decoder.has_begun() {
            return Ok(None);
        }
        let mut problems = Diagnostics::default();
        let message = "the stream is empty, expected a header such as time,x,y,z,dx,dy,dz and pulses";
        problems.error(Some(Place::of_file(&self.path)), message);
        Err(Error::Input(Box::new(problems)))
    }
}

impl RowBlock {
    /// Number of its rows.
    pub fn rows(&self) -> u32 {
        u32::try_from(self.rows.len()).unwrap_or(u32::MAX)
    }

    /// Epoch of the first pulse; the other rows are not parsed.
    pub fn first_epoch(&self) -> u32 {
        self.epochs().next().unwrap_or(0)
    }

    /// Epochs of the pulses; an invalid number is reported when the row is parsed.
    fn epochs(&self) -> impl Iterator<Item = u32> {
        let (column, mut fields) = (self.schema.position(PulseColumn::Epoch), Vec::new());
        (0..self.rows.len()).map(move |row| {
            let epoch = column.map(|at| self.rows.row(row, &mut fields).number(at, ""));
            epoch.and_then(|epoch| epoch.ok()).unwrap_or(0.0) as u32
        })
    }

    /// Splits the block before the first pulse of another epoch; the second value is the rest.
    pub fn split_at_epoch(self) -> (RowBlock, Option<RowBlock>) {
        let has_epochs = self.schema.position(PulseColumn::Epoch).is_some();
        let first = self.first_epoch();
        let Some(count) = self.epochs().position(|epoch| has_epochs && epoch != first) else {
            return (self, None);
        };
        let (rows, rest) = self.rows.split_at(count);
        let schema = self.schema;
        (RowBlock { rows, schema: schema.clone() }, rest.map(|rows| RowBlock { rows, schema }))
    }

    /// Appends the rows as pulses in the frame whose origin is at `shift` in the world. `check` accepts or
    /// rejects each pulse.
    ///
    /// # Errors
    /// [`Error::Input`] for the first row that is not a valid pulse, with its place.
    pub fn pulses(
        &self,
        shift: DVec3,
        into: &mut Vec<PulseRow>,
        check: impl Fn(&PulseRow) -> Result<(), RowFault>,
    ) -> Result<()> {
        let (mut fields, before) = (Vec::new(), self.rows.before() - self.schema.header_rows);
        for (index, order) in (0..self.rows.len()).zip(before..) {
            let row = self.rows.row(index, &mut fields);
            into.push(self.schema.pulse(&row, shift, order, &check).map_err(|e| e.with_help(""))?);
        }
        Ok(())
    }
}
