//! Blocks of lines parsed on several threads.

use super::lines::{end_of_lines, next_line};
use super::rows::{BadRow, RowReader, Widths};
use crate::blocks::{Emit, in_order};
use crate::{Attribute, NewPart, PointPart, PointRow, Reading};
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
    reading.take_from(row, object.as_deref(), |attribute| place_of(attribute, rows, path, (number, text)))
}

/// The place of an attribute in a line of a file.
fn place_of(attribute: Attribute, rows: &RowReader, path: &Path, (number, text): (usize, &[u8])) -> Place {
    let mut words = Vec::new();
    rows.split(text, &mut words);
    let at = rows.word(attribute, &words);
    line_place(path, number, text, at.unwrap_or(text.len()..text.len()))
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
    /// The values of the chosen columns, point by point.
    values: Vec<f64>,
    /// The part of the sink, if it uses parts.
    part: Option<Box<dyn PointPart>>,
    /// True if the points are in the part: all lines are points.
    is_in_part: bool,
    /// Number of points of the part with a value that does not fit, by attribute, and the first line.
    misfits: [u64; Attribute::COUNT],
    first_misfits: [Option<Line>; Attribute::COUNT],
    /// Lines without a point, with the number of points before them.
    bad: Vec<(usize, Line, BadRow)>,
    /// Number of lines.
    lines: usize,
    widths: Widths<(Line, Range<usize>)>,
}

/// Calls `take` with the lines of a text that are not skipped, and their words, until it breaks. Returns the
/// number of lines.
fn each_line(
    text: &[u8],
    format: &RowReader,
    mut take: impl FnMut(Line, &[u8], &[Range<usize>]) -> ControlFlow<()>,
) -> usize {
    let mut words = Vec::new();
    let (mut at, mut number) = (0, 0);
    while let Some(range) = next_line(text, &mut at) {
        number += 1;
        let content = text[range.clone()].trim_ascii_end();
        // Lines before the first point are not in blocks.
        if format.is_skipped(usize::MAX, content) {
            continue;
        }
        let line = Line { number, start: range.start as u32, end: (range.start + content.len()) as u32 };
        format.split(content, &mut words);
        if take(line, content, &words).is_break() {
            break;
        }
    }
    number as usize
}

impl Block {
    /// Parses the lines of a text, for a part if there are any.
    fn parse(&mut self, text: Vec<u8>, format: &RowReader, parts: Option<&NewPart>) {
        let (rows, mut part) = (std::mem::take(&mut self.rows), self.part.take());
        match (part.as_mut(), parts) {
            (Some(part), _) => part.clear(),
            (None, Some(new)) => part = Some(new()),
            (None, None) => {}
        }
        *self = Block { text, rows, part, ..Block::default() };
        self.is_in_part = self.add_to_part(format);
        if !self.is_in_part {
            self.parse_rows(format);
        }
    }

    /// Adds the points to the part. Returns `false` if there is none, and after a line that is not a point.
    fn add_to_part(&mut self, format: &RowReader) -> bool {
        let Block { text, part: Some(part), misfits, first_misfits, lines, widths, .. } = self else {
            return false;
        };
        let mut are_points = true;
        *lines = each_line(text, format, |line, text, words| {
            let Ok(row) = format.parse(text, words) else {
                are_points = false;
                return ControlFlow::Break(());
            };
            widths.see(format, text, words, |at| (line, at));
            for attribute in row.misfits.attributes() {
                misfits[attribute as usize] += 1;
                first_misfits[attribute as usize].get_or_insert(line);
            }
            let object = format.word(Attribute::Object, words);
            let object = object.map(|at| String::from_utf8_lossy(text[at].trim_ascii()));
            part.add_named(&row, object.as_deref());
            ControlFlow::Continue(())
        });
        are_points
    }

    fn parse_rows(&mut self, format: &RowReader) {
        let Block { text, rows, values, bad, lines, widths, .. } = self;
        rows.clear();
        values.clear();
        *widths = Widths::default();
        *lines = each_line(text, format, |line, text, words| {
            match format.parse(text, words) {
                Ok(row) => {
                    widths.see(format, text, words, |at| (line, at));
                    let object = format.word(Attribute::Object, words);
                    let object = object.map(|at| [at.start as u32, at.end as u32]);
                    rows.push(Parsed { line, row, object });
                    format.push_values(text, words, values);
                }
                Err(problem) => {
                    bad.push((rows.len(), line, problem));
                    if bad.len() == MAX_PROBLEMS {
                        return ControlFlow::Break(());
                    }
                }
            }
            ControlFlow::Continue(())
        });
    }

    /// Passes the part to the sink; `before` is the number of lines of the file before these.
    fn take_part(
        &mut self,
        before: usize,
        format: &RowReader,
        taker: &mut LineTaker,
        reading: &mut Reading,
    ) -> ControlFlow<()> {
        let path = reading.path;
        let numbered = |line: &Line| (before + line.number as usize, line.of(&self.text));
        for attribute in Attribute::ALL {
            if let Some(line) = &self.first_misfits[attribute as usize] {
                let (_, first) = &mut reading.misfits[attribute as usize];
                first.get_or_insert_with(|| place_of(attribute, format, path, numbered(line)));
            }
        }
        taker.widths.append(std::mem::take(&mut self.widths), |(line, at)| place(path, numbered(&line), at));
        match self.part.as_mut() {
            Some(part) => reading.take_part(part.as_mut(), &self.misfits),
            None => ControlFlow::Continue(()),
        }
    }

    /// Passes the points to the sink; `before` is the number of lines of the file before these.
    fn take(
        &mut self,
        before: usize,
        format: &RowReader,
        taker: &mut LineTaker,
        reading: &mut Reading,
    ) -> ControlFlow<()> {
        if self.is_in_part {
            return self.take_part(before, format, taker, reading);
        }
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
                let width = format.chosen_count();
                reading.pass_values(self.values.get(taken * width..(taken + 1) * width).unwrap_or_default());
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
    let has_names = format.columns().has(Attribute::Object);
    let parts = reading.sink.parts().filter(|new| !has_names || new().takes_names());
    let make = |text: Vec<u8>, block: &mut Block, emit: &mut Emit<'_, Block>| {
        block.parse(text, format, parts.as_ref());
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
    use std::any::Any;
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

    /// The points of a block, and of a file in blocks.
    #[derive(Default)]
    struct Points(Vec<(PointRow, String)>);

    impl PointPart for Points {
        fn add(&mut self, row: &PointRow) {
            self.add_named(row, None);
        }

        fn add_named(&mut self, row: &PointRow, object: Option<&str>) {
            self.0.push((*row, object.unwrap_or_default().to_owned()));
        }

        fn takes_names(&self) -> bool {
            true
        }

        fn clear(&mut self) {
            self.0.clear();
        }
    }

    impl PointSink for Points {
        fn start(&mut self, _: AttributeSet) {}

        fn parts(&self) -> Option<NewPart> {
            Some(Box::new(|| -> Box<dyn PointPart> { Box::new(Points::default()) }))
        }

        fn add_part(&mut self, part: &mut (dyn PointPart + 'static)) -> Result<ControlFlow<()>> {
            let part: &mut dyn Any = part;
            self.0.append(&mut part.downcast_mut::<Points>().unwrap().0);
            Ok(ControlFlow::Continue(()))
        }

        fn point(&mut self, row: &PointRow, object: Option<&str>) -> Result<ControlFlow<()>> {
            self.add_named(row, object);
            Ok(ControlFlow::Continue(()))
        }
    }

    fn read_on(text: &str, threads: usize, most: usize) -> (Vec<(PointRow, String)>, String) {
        let mut sink = First { rows: Vec::new(), most };
        let said = read_to(&mut sink, text, threads);
        (sink.rows, said)
    }

    /// Reads a file on some threads; returns the messages.
    fn read_to(sink: &mut dyn PointSink, text: &str, threads: usize) -> String {
        let mut found = Diagnostics::default();
        let file = PointFile::new(Path::new("a.csv"), text.as_bytes(), &mut found).unwrap();
        file.on_threads(threads).read(Selection::All, sink, &mut found).unwrap();
        let described = |item: &vlscan_base::diag::Diagnostic| {
            format!("{} {:?} {:?}\n", item.line(), item.lines().collect::<Vec<_>>(), item.repeated())
        };
        found.items().iter().map(described).collect()
    }

    /// Checks that the points and messages of a file do not depend on the number of threads; returns both.
    fn same_on_threads(text: &str, most: usize) -> (usize, String) {
        let (rows, said) = read_on(text, 1, most);
        for threads in [2, 5] {
            let (others, found) = read_on(text, threads, most);
            assert!(rows == others, "{threads} threads: {} and {} points", rows.len(), others.len());
            assert_eq!(found, said, "{threads} threads, {most} points");
            if most == usize::MAX {
                let mut parts = Points::default();
                assert_eq!(read_to(&mut parts, text, threads), said, "{threads} threads, parts");
                assert!(rows == parts.0, "{threads} threads: {} and {} points", rows.len(), parts.0.len());
            }
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
