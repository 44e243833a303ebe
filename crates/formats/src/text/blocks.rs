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

/// Counts the problems of the lines of a file.
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
    /// Records why a line is not a point.
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
                    if !text.ends_with(b"\n") {
                        text.truncate(end_of_lines(&text));
                    }
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{AttributeSet, PointFile, PointSink, Selection};
    use vlscan_base::diag::Diagnostics;

    /// The first points of a file, with the names of their objects.
    struct First {
        rows: Vec<(PointRow, String)>,
        most: usize,
    }

    impl PointSink for First {
        fn start(&mut self, _: AttributeSet) {}

        fn point(&mut self, row: &PointRow, object: Option<&str>) -> Result<ControlFlow<()>> {
            self.rows.push((*row, object.unwrap_or_default().to_owned()));
            let is_full = self.rows.len() == self.most;
            Ok(if is_full { ControlFlow::Break(()) } else { ControlFlow::Continue(()) })
        }
    }

    fn read_on(text: &str, threads: usize, most: usize) -> (Vec<(PointRow, String)>, String) {
        let (mut sink, mut found) = (First { rows: Vec::new(), most }, Diagnostics::default());
        let file = PointFile::new(Path::new("a.csv"), text.as_bytes(), &mut found).unwrap();
        file.on_threads(threads).read(Selection::All, &mut sink, &mut found).unwrap();
        let described = |item: &vlscan_base::diag::Diagnostic| {
            format!("{} {:?} {:?}\n", item.line(), item.lines().collect::<Vec<_>>(), item.repeated())
        };
        (sink.rows, found.items().iter().map(described).collect())
    }

    /// Checks that the points and messages of a file do not depend on the number of threads; returns both.
    fn same_on_threads(text: &str, most: usize) -> (usize, String) {
        let (rows, said) = read_on(text, 1, most);
        for threads in [2, 5] {
            let (others, found) = read_on(text, threads, most);
            assert!(rows == others, "{threads} threads: {} and {} points", rows.len(), others.len());
            assert_eq!(found, said, "{threads} threads, {most} points");
        }
        (rows.len(), said)
    }

    #[test]
    fn points_and_messages_do_not_depend_on_the_number_of_threads() {
        let line = |i: usize| match i {
            333 | 777 => format!("{i},2,3,900,oak\n"),
            500 => format!("{i},2,3,4,ash,6\n"),
            600 => format!("{i},2,3,4\n"),
            _ if i % 50 == 9 => "\r\n# a comment\n".to_owned(),
            _ => format!("{i},2.5,-3e2,{},tree {}\r\n", i % 9, i % 7),
        };
        let text: String =
            std::iter::once("x,y,z,class,object\n".to_owned()).chain((0..1000).map(line)).collect();
        let (count, said) = same_on_threads(&text, usize::MAX);
        assert_eq!(count, 980);
        assert!(said.contains("2 points have a class") && said.contains("1 line has more values"), "{said}");
        for most in [1, 2, 470, 490, 491, 492, 979] {
            assert_eq!(same_on_threads(&text, most).0, most);
        }
        let numbered = |said: &str, i: usize| {
            let line = text.lines().position(|line| line.starts_with(&format!("{i},"))).unwrap() + 1;
            assert!(said.contains(&format!("a.csv:{line}:")), "{line}: {said}");
        };
        numbered(&said, 333);
        numbered(&said, 500);
        let wrong = text.replace("450,2.5", "450,two").replace("890,2.5", "890,two");
        let (count, said) = same_on_threads(&wrong, usize::MAX);
        assert!(count == 978 && said.contains("expected y"), "{said}");
        let many = text.replace("8,2.5", "8,two");
        // The tenth wrong line, of point 98, ends reading; there are two comments before.
        let (count, said) = same_on_threads(&many, usize::MAX);
        assert_eq!(count, 99 - 2 - MAX_PROBLEMS, "{said}");
        // Blocks without an end of a line.
        let long = format!("1 2 3\n{}\n4 5 6\n", "7".repeat(200_000));
        same_on_threads(&long, usize::MAX);
    }
}
