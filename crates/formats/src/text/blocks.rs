//! Blocks of lines parsed on several threads.

use super::lines::{end_of_lines, next_line};
use super::rows::{BadRow, RowReader, Widths};
use crate::blocks::{Emit, in_order};
use crate::{Attribute, PointRow, Reading};
use std::io::{self, Read};
use std::ops::{ControlFlow, Range};
use std::path::Path;
use vlscan_base::diag::Place;
use vlscan_base::error::{Error, Result};
use vlscan_tables::input::rows::line_place;

/// Number of problems after which reading stops.
const MAX_PROBLEMS: usize = 10;
/// Bytes of a block.
const BLOCK_BYTES: usize = if cfg!(test) { 1 << 8 } else { 1 << 20 };

/// Counts what is wrong with the lines of a file.
#[derive(Default)]
pub(super) struct LineTaker {
    problems: usize,
    pub widths: Widths<Place>,
}

/// Passes the point of a line to the sink. The object's name is at `object` in the line.
pub(super) fn take_row(
    rows: &RowReader,
    (number, text): (usize, &[u8]),
    (row, object): (&PointRow, Option<Range<usize>>),
    reading: &mut Reading,
) -> ControlFlow<()> {
    let path = reading.path;
    let object = object.map(|at| String::from_utf8_lossy(text[at].trim_ascii()));
    let place = |attribute| {
        let mut words = Vec::new();
        rows.split(text, &mut words);
        let at = rows.word(attribute, &words);
        line_place(path, number, text, at.unwrap_or(text.len()..text.len()))
    };
    reading.take_from(row, object.as_deref(), place)
}

impl LineTaker {
    /// Records why a line is no point.
    pub fn take_problem(
        &mut self,
        (number, text): (usize, &[u8]),
        bad: BadRow,
        reading: &mut Reading,
    ) -> ControlFlow<()> {
        let BadRow { at, message, help } = bad;
        let problem = reading.found.error(Some(line_place(reading.path, number, text, at)), message);
        if let Some(help) = help {
            problem.help(help);
        }
        self.problems += 1;
        if self.problems == MAX_PROBLEMS { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }
}

/// A line in the text of a block.
#[derive(Clone, Copy, Debug)]
struct Line {
    /// Its number, from 1 in the block.
    number: u32,
    start: u32,
    end: u32,
}

impl Line {
    fn of<'t>(&self, text: &'t [u8]) -> &'t [u8] {
        &text[self.start as usize..self.end as usize]
    }
}

/// The point of a line.
struct Parsed {
    line: Line,
    row: PointRow,
    /// The place of the object's name in the line.
    object: Option<[u32; 2]>,
}

/// Lines of a file.
#[derive(Default)]
struct Block {
    text: Vec<u8>,
    rows: Vec<Parsed>,
    /// Lines without a point, with the number of points before them.
    bad: Vec<(usize, Line, BadRow)>,
    /// Number of lines.
    lines: usize,
    widths: Widths<(Line, Range<usize>)>,
}

impl Block {
    /// Parses the lines of a text.
    fn parse(&mut self, text: Vec<u8>, format: &RowReader, words: &mut Vec<Range<usize>>) {
        *self = Block { text, rows: std::mem::take(&mut self.rows), ..Block::default() };
        self.rows.clear();
        let (mut at, mut number) = (0, 0);
        while let Some(range) = next_line(&self.text, &mut at) {
            number += 1;
            let text = self.text[range.clone()].trim_ascii_end();
            // Lines before the first point are not in blocks.
            if format.is_skipped(usize::MAX, text) {
                continue;
            }
            let line = Line { number, start: range.start as u32, end: (range.start + text.len()) as u32 };
            format.split(text, words);
            match format.parse(text, words) {
                Ok(row) => {
                    self.widths.see(format, text, words, |at| (line, at));
                    let object = format.word(Attribute::Object, words);
                    let object = object.map(|at| [at.start as u32, at.end as u32]);
                    self.rows.push(Parsed { line, row, object });
                }
                Err(problem) => {
                    self.bad.push((self.rows.len(), line, problem));
                    if self.bad.len() == MAX_PROBLEMS {
                        break;
                    }
                }
            }
        }
        self.lines = number as usize;
    }

    /// Passes the points to the sink; `before` is the number of lines of the file before these.
    fn take(
        &mut self,
        before: usize,
        format: &RowReader,
        taker: &mut LineTaker,
        reading: &mut Reading,
    ) -> ControlFlow<()> {
        let mut bad = std::mem::take(&mut self.bad).into_iter().peekable();
        let numbered = |line: &Line| (before + line.number as usize, line.of(&self.text));
        let path = reading.path;
        let mut flow = ControlFlow::Continue(());
        let mut taken = 0;
        while flow.is_continue() {
            if let Some((_, line, problem)) = bad.next_if(|(rows, ..)| *rows <= taken) {
                flow = taker.take_problem(numbered(&line), problem, reading);
            } else if let Some(Parsed { line, row, object }) = self.rows.get(taken) {
                let object = object.map(|[start, end]| start as usize..end as usize);
                flow = take_row(format, numbered(line), (row, object), reading);
                taken += 1;
            } else {
                break;
            }
        }
        let mut widths = std::mem::take(&mut self.widths);
        if flow.is_break() {
            // Only the lines up to the last one that was taken count.
            widths = Widths::default();
            let mut words = Vec::new();
            for Parsed { line, .. } in &self.rows[..taken] {
                let text = line.of(&self.text);
                format.split(text, &mut words);
                widths.see(format, text, &words, |at| (*line, at));
            }
        }
        taker.widths.append(widths, |(line, at)| place(path, numbered(&line), at));
        flow
    }
}

fn place(path: &Path, (number, text): (usize, &[u8]), at: Range<usize>) -> Place {
    line_place(path, number, text, at)
}

/// Reads the rest of a file, after this number of lines.
pub(super) fn read(
    source: impl Read,
    lines: usize,
    format: &RowReader,
    taker: &mut LineTaker,
    reading: &mut Reading,
) -> Result<()> {
    let (path, threads) = (reading.path, reading.threads);
    let mut pieces = Pieces { source, rest: Vec::new(), is_ended: false, failure: None };
    let mut before = lines;
    let make = |text: Vec<u8>, block: &mut Block, emit: &mut Emit<'_, Block>| {
        block.parse(text, format, &mut Vec::new());
        let _ = emit(block);
    };
    let mut is_ended = false;
    in_order(threads, &mut pieces, make, |block: &mut Block| {
        let flow = block.take(before, format, taker, reading);
        before += block.lines;
        is_ended = flow.is_break();
        flow
    })?;
    match pieces.failure.filter(|_| !is_ended) {
        Some(failure) => Err(Error::io("read", path, failure)),
        None => Ok(()),
    }
}

/// Pieces of a text of whole lines.
struct Pieces<R> {
    source: R,
    /// The bytes behind the last piece.
    rest: Vec<u8>,
    is_ended: bool,
    failure: Option<io::Error>,
}

impl<R: Read> Iterator for Pieces<R> {
    type Item = Vec<u8>;

    fn next(&mut self) -> Option<Vec<u8>> {
        let mut text = std::mem::take(&mut self.rest);
        let mut length = BLOCK_BYTES;
        while !self.is_ended {
            let missing = length.saturating_sub(text.len()) as u64;
            match self.source.by_ref().take(missing).read_to_end(&mut text) {
                Ok(_) => self.is_ended = text.len() < length,
                Err(failure) => {
                    // The line that is cut is no line of the file.
                    (self.failure, self.is_ended) = (Some(failure), true);
                    text.truncate(end_of_lines(&text));
                }
            }
            if !self.is_ended {
                let end = end_of_lines(&text);
                if end > 0 {
                    self.rest = text.split_off(end);
                    break;
                }
                length += BLOCK_BYTES;
            }
        }
        (!text.is_empty()).then_some(text)
    }
}
