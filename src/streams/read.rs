//! Reads a stream of pulses: blocks of whole rows as they arrive, which the workers then turn into pulses. The first bytes
//! tell whether they are lines of text or an Arrow stream.

use super::columns::Column;
use super::row::{ATTITUDE, DIRECTION, EXACT, ORIGIN, Present, PulseRow};
use super::table_rows::{TableRows, Tables};
use super::text_rows::{Lines, TextRows};
use crate::diag::{Diagnostics, Place};
use crate::error::{Error, Result};
use crate::geom::DVec3;
use crate::input::arrow::{ArrowDetection, detect_arrow};
use crate::input::{InputStream, ReadEvent, is_stdin};
use crate::schedule::Stop;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// How often the wish to end is looked at while nothing arrives.
const LOOK: Duration = Duration::from_millis(100);

/// Rows of pulses as they arrived, not looked into yet.
#[derive(Clone, Debug)]
pub struct Block {
    rows: Rows,
    /// Pulses before it in the stream.
    before: u64,
}

#[derive(Clone, Debug)]
enum Rows {
    Text(TextRows),
    Table(TableRows),
}

/// A stream of pulses being read.
#[derive(Debug)]
pub struct PulseReader {
    input: InputStream,
    path: PathBuf,
    form: Form,
    ended: bool,
    before: u64,
    most: usize,
}

/// What the stream is made of.
#[derive(Debug)]
enum Form {
    /// The bytes that have arrived do not tell yet.
    Unknown(Vec<u8>),
    Text(Lines),
    Table(Tables),
}

impl PulseReader {
    /// Opens a file, a named pipe, or (`-`) standard input. Blocks have at most `most` rows.
    ///
    /// # Errors
    /// [`Error::Io`] when it cannot be opened.
    pub fn open(path: &Path, most: usize) -> Result<PulseReader> {
        let input = InputStream::open(path).map_err(|e| Error::open(path, e))?;
        Ok(PulseReader::of(input, path, most))
    }

    /// Reads what arrives; `path` is the name in messages.
    pub fn of(input: InputStream, path: &Path, most: usize) -> PulseReader {
        PulseReader {
            input,
            path: if is_stdin(path) { PathBuf::from("<stdin>") } else { path.to_path_buf() },
            form: Form::Unknown(Vec::new()),
            ended: false,
            before: 0,
            most: most.max(1),
        }
    }

    /// Waits for at least one row and returns those that have arrived; nothing at the end of the stream, or when `stop` is
    /// asked.
    ///
    /// # Errors
    /// [`Error::Input`] for a header or schema that is none, a stream without anything, or one that is cut off;
    /// [`Error::Io`] when it cannot be read.
    pub fn next_block(&mut self, stop: &Stop) -> Result<Option<Block>> {
        loop {
            let rows = match &mut self.form {
                Form::Unknown(_) => None,
                Form::Text(lines) => lines.next_rows(self.most, self.ended)?.map(Rows::Text),
                Form::Table(tables) => tables.next_rows(self.most)?.map(Rows::Table),
            };
            if let Some(rows) = rows {
                let block = Block { rows, before: self.before };
                self.before += block.rows.count();
                return Ok(Some(block));
            }
            if self.ended || !self.receive(stop)? {
                return self.finish(stop);
            }
        }
    }

    /// Takes in what arrives next; `false` when the user wants an end.
    fn receive(&mut self, stop: &Stop) -> Result<bool> {
        loop {
            match self.input.next(Some(LOOK)) {
                ReadEvent::Bytes(bytes) => {
                    self.feed(&bytes);
                    self.take_what_waits();
                    return Ok(true);
                }
                ReadEvent::Timeout if stop.is_requested() => return Ok(false),
                ReadEvent::Timeout => {}
                ReadEvent::End => {
                    self.ended = true;
                    // Too little to tell: a few bytes of text.
                    if let Form::Unknown(bytes) = &mut self.form {
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
        match &mut self.form {
            Form::Text(lines) => lines.feed(bytes),
            Form::Table(tables) => tables.feed(bytes),
            Form::Unknown(first) => {
                first.extend_from_slice(bytes);
                let first = std::mem::take(first);
                match detect_arrow(&first) {
                    ArrowDetection::NeedMoreBytes => self.form = Form::Unknown(first),
                    ArrowDetection::Other => self.begin_text(&first),
                    ArrowDetection::Arrow => {
                        let mut tables = Tables::new(&self.path);
                        tables.feed(&first);
                        self.form = Form::Table(tables);
                    }
                }
            }
        }
    }

    fn begin_text(&mut self, bytes: &[u8]) {
        let mut lines = Lines::new(&self.path);
        lines.feed(bytes);
        self.form = Form::Text(lines);
    }

    /// Takes in what has arrived already, so that blocks of a fast stream are large.
    fn take_what_waits(&mut self) {
        while let Form::Text(lines) = &mut self.form
            && !lines.are_many(self.most)
        {
            match self.input.next(Some(Duration::ZERO)) {
                ReadEvent::Bytes(bytes) => lines.feed(&bytes),
                // An end or a failure is met again by whoever waits next.
                _ => break,
            }
        }
    }

    fn finish(&self, stop: &Stop) -> Result<Option<Block>> {
        match &self.form {
            _ if stop.is_requested() => Ok(None),
            Form::Table(tables) => tables.end().map(|()| None),
            Form::Text(lines) if lines.have_begun() => Ok(None),
            _ => {
                let mut problems = Diagnostics::default();
                let message = "the stream is empty, expected a header such as time,x,y,z,dx,dy,dz and pulses";
                problems.error(Some(Place::in_line(&self.path, 0, "", 0..0)), message);
                Err(Error::Input(Box::new(problems)))
            }
        }
    }
}

/// Columns that stand for one thing are there together, and those that a pulse needs are there.
pub(super) fn check_complete(present: Present, place: Place, problems: &mut Diagnostics) {
    let low = [Column::LowX, Column::LowY, Column::LowZ];
    let mut missing: Vec<&str> = Vec::new();
    let mut need = |columns: &[Column]| {
        missing.extend(columns.iter().filter(|c| !present.has(**c)).map(|c| c.entry().name));
    };
    need(&ORIGIN);
    for together in [&ATTITUDE[..], &EXACT[..], &low[..]] {
        if present.has_any(together) {
            need(together);
        }
    }
    if !present.has_any(&ATTITUDE) || present.has_any(&DIRECTION) {
        need(&DIRECTION);
    }
    if !missing.is_empty() {
        problems
            .error(Some(place), format!("no column for {}", missing.join(", ")))
            .help("a pulse needs x, y, z and dx, dy, dz (or qw, qx, qy, qz)");
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

impl Block {
    /// Number of rows.
    pub fn rows(&self) -> u32 {
        u32::try_from(self.rows.count()).unwrap_or(u32::MAX)
    }

    /// Number of the play of the first pulse, without looking at the others.
    pub fn first_play(&self) -> u32 {
        match &self.rows {
            Rows::Text(rows) => rows.first_play(),
            Rows::Table(rows) => rows.first_play(),
        }
    }

    /// Cuts the block where another play begins than that of its first pulse; the second value is the rest.
    pub fn split_at_play(self) -> (Block, Option<Block>) {
        let (first, rest) = match self.rows {
            Rows::Text(rows) => {
                let (first, rest) = rows.split_at_play();
                (Rows::Text(first), rest.map(Rows::Text))
            }
            Rows::Table(rows) => {
                let (first, rest) = rows.split_at_play();
                (Rows::Table(first), rest.map(Rows::Table))
            }
        };
        let rest = rest.map(|rows| Block { rows, before: self.before + first.count() });
        (Block { rows: first, before: self.before }, rest)
    }

    /// Turns the rows into pulses in the frame whose origin lies at `shift` in the world. `check` looks at each.
    ///
    /// # Errors
    /// [`Error::Input`] for the first row that is no pulse, with its place.
    pub fn pulses(
        &self,
        shift: DVec3,
        into: &mut Vec<PulseRow>,
        check: impl Fn(&PulseRow) -> Result<(), (Column, String)>,
    ) -> Result<()> {
        match &self.rows {
            Rows::Text(rows) => rows.pulses(shift, self.before, into, check),
            Rows::Table(rows) => rows.pulses(shift, self.before, into, check),
        }
    }
}
