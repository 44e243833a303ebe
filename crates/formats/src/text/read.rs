//! Reads points from lines of text, from files and from streams.

use super::layout::{Layout, LayoutFinder};
use super::lines::{BadColumn, is_skipped, read_line};
use crate::{Attribute, Reading};
use std::io::BufRead;
use std::ops::ControlFlow;
use vlscan_base::columns::comma_note;
use vlscan_base::diag::Place;
use vlscan_base::error::{Error, Result};
use vlscan_base::input::rows::line_place;

/// Number of problems after which reading stops.
const MAX_PROBLEMS: usize = 10;

/// Reads one point per line.
pub(crate) fn read(mut source: impl BufRead, reading: &mut Reading) -> Result<()> {
    let mut finder = LayoutFinder::default();
    let mut layout: Option<Layout> = None;
    let (mut line, mut words) = (Vec::new(), Vec::new());
    let mut problems = 0;
    // The number of values of the first point and its line; the lines with more values, and the place of the first one.
    let (mut width, mut longer): ((usize, usize), (u64, Option<Place>)) = Default::default();
    for number in 1.. {
        if !read_line(&mut source, &mut line).map_err(|e| Error::io("read", reading.path, e))? {
            break;
        }
        let text = line.trim_ascii_end();
        let layout = match &layout {
            Some(_) if is_skipped(text) => continue,
            Some(layout) => layout,
            None => {
                let Some(found) = finder.next(reading.path, number, &line, reading.found) else { continue };
                found.split(text, &mut words);
                found.warn_of_unread(reading.path, text, &words, reading.found);
                reading.sink.start(found.columns.attributes());
                width = (words.len(), number);
                layout.insert(found)
            }
        };
        layout.split(text, &mut words);
        if words.len() > width.0 {
            longer.0 += 1;
            longer.1.get_or_insert_with(|| {
                line_place(reading.path, number, text, words[width.0].start..text.len())
            });
        }
        let missing = layout.missing_values(&words).map(Wrong::Missing);
        let parsed = layout.columns.parse(text, &words).map_err(Wrong::Column);
        let parsed = parsed.and_then(|row| missing.map_or(Ok(row), Err));
        match parsed {
            Ok(row) => {
                let object = layout.columns.get(Attribute::Object).and_then(|column| words.get(column));
                let object = object.map(|at| String::from_utf8_lossy(text[at.clone()].trim_ascii()));
                let path = reading.path;
                let place = |attribute| {
                    let at = layout.columns.get(attribute).and_then(|column| words.get(column)).cloned();
                    line_place(path, number, text, at.unwrap_or(text.len()..text.len()))
                };
                if let ControlFlow::Break(()) = reading.take_from(&row, object.as_deref(), place) {
                    break;
                }
            }
            Err(wrong) => {
                wrong.report(number, text, reading);
                problems += 1;
                if problems == MAX_PROBLEMS {
                    break;
                }
            }
        }
    }
    if let (count, Some(place)) = longer {
        let lines = if count == 1 { "line has" } else { "lines have" };
        let (values, first) = width;
        reading.found.warn(
            Some(place),
            format!(
                "{count} {lines} more values than line {first}, which has {values}; the others are not read"
            ),
        );
    }
    Ok(())
}

/// Why a line is no point.
enum Wrong {
    /// It has less values than there are names.
    Missing(String),
    Column(BadColumn),
}

impl Wrong {
    fn report(self, number: usize, line: &[u8], reading: &mut Reading) {
        match self {
            Wrong::Missing(message) => {
                let place = line_place(reading.path, number, line, line.len()..line.len());
                let problem = reading.found.error(Some(place), message);
                problem.help("separate the columns by commas if values may be empty");
            }
            Wrong::Column(bad) => {
                let word = String::from_utf8_lossy(line[bad.at.clone()].trim_ascii());
                let found = match word.is_empty() {
                    true if bad.at.start >= line.len() => "the end of the line".to_owned(),
                    true => "nothing".to_owned(),
                    false => format!("{word:?}"),
                };
                let hint = comma_note(&word);
                let message = format!("expected {}, found {found}{hint}", bad.attribute.described());
                let problem =
                    reading.found.error(Some(line_place(reading.path, number, line, bad.at)), message);
                if !hint.is_empty() {
                    problem
                        .help("`tr , .` replaces the commas if the columns are separated by something else");
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{AttributeSet, PointRow, PointSink, Selection};
    use std::path::Path;
    use vlscan_base::diag::Diagnostics;

    struct Count(u32);

    impl PointSink for Count {
        fn start(&mut self, _: AttributeSet) {}

        fn point(&mut self, _: &PointRow, _: Option<&str>) -> ControlFlow<()> {
            self.0 += 1;
            ControlFlow::Continue(())
        }
    }

    #[test]
    fn values_beyond_those_of_the_first_line_are_told() {
        let text = "x,y,z\n1,2,3\n4,5,6,7\n8,9,10,11,12\n1,1,1,\n";
        let (mut sink, mut found) = (Count(0), Diagnostics::default());
        let mut reading = Reading::new(Path::new("a.csv"), Selection::All, &mut sink, &mut found);
        read(text.as_bytes(), &mut reading).unwrap();
        let said = found.render(false);
        assert!(said.contains("2 lines have more values than line 2, which has 3"), "{said}");
        assert!(said.contains("a.csv:3:7"), "{said}");
        assert_eq!(sink.0, 4);
    }
}
