//! Reads points from lines of text, from files and from streams.

use super::layout::LayoutFinder;
use super::lines::read_line;
use super::rows::{BadRow, RowReader, Widths};
use crate::{Attribute, Reading};
use std::io::BufRead;
use std::ops::ControlFlow;
use vlscan_base::error::{Error, Result};
use vlscan_tables::input::rows::line_place;

/// Number of problems after which reading stops.
const MAX_PROBLEMS: usize = 10;

/// Reads one point per line.
pub(crate) fn read(mut source: impl BufRead, reading: &mut Reading) -> Result<()> {
    let mut finder = LayoutFinder::default();
    let mut rows: Option<RowReader> = None;
    let (mut line, mut words) = (Vec::new(), Vec::new());
    let mut problems = 0;
    let mut widths = Widths::default();
    for number in 1.. {
        if !read_line(&mut source, &mut line).map_err(|e| Error::io("read", reading.path, e))? {
            break;
        }
        let text = line.trim_ascii_end();
        let rows = match &rows {
            Some(rows) if rows.is_skipped(number, text) => continue,
            Some(rows) => rows,
            None => {
                let Some(found) = finder.next(reading.path, number, &line, reading.found) else { continue };
                found.split(text, &mut words);
                found.warn_of_unread(reading.path, text, &words, reading.found);
                reading.sink.start(found.columns.attributes());
                let columns = found.columns;
                rows.insert(RowReader::new(found, columns, text))
            }
        };
        rows.split(text, &mut words);
        let path = reading.path;
        match rows.parse(text, &words) {
            Ok(row) => {
                widths.see(rows, text, &words, |at| line_place(path, number, text, at));
                let object = rows.word(Attribute::Object, &words);
                let object = object.map(|at| String::from_utf8_lossy(text[at].trim_ascii()));
                let place = |attribute| {
                    let at = rows.word(attribute, &words);
                    line_place(path, number, text, at.unwrap_or(text.len()..text.len()))
                };
                if let ControlFlow::Break(()) = reading.take_from(&row, object.as_deref(), place) {
                    break;
                }
            }
            Err(BadRow { at, message, help }) => {
                let problem = reading.found.error(Some(line_place(path, number, text, at)), message);
                if let Some(help) = help {
                    problem.help(help);
                }
                problems += 1;
                if problems == MAX_PROBLEMS {
                    break;
                }
            }
        }
    }
    for (place, message) in rows.map_or_else(Vec::new, |rows| widths.warnings(&rows)) {
        reading.found.warn(Some(place), message);
    }
    Ok(())
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

        fn point(&mut self, _: &PointRow, _: Option<&str>) -> Result<ControlFlow<()>> {
            self.0 += 1;
            Ok(ControlFlow::Continue(()))
        }
    }

    #[test]
    fn lines_of_other_lengths_than_the_first_are_reported() {
        let text = "x,y,z,time\n1,2,3,4\n4,5,6,7,8\n8,9,10,11,12,13\n1,1,1,\n1,1,1,1,\n2,2,2\n";
        let (mut sink, mut found) = (Count(0), Diagnostics::default());
        let mut reading = Reading::new(Path::new("a.csv"), Selection::All, &mut sink, &mut found);
        read(text.as_bytes(), &mut reading).unwrap();
        let said = found.text();
        assert!(said.contains("2 lines have more values than line 2, which has 4"), "{said}");
        assert!(said.contains("a.csv:3:9") && said.contains("a decimal comma divides"), "{said}");
        // An empty time is a value, a missing one is not.
        assert!(said.contains("1 line has fewer values than line 2") && said.contains("a.csv:7:6"), "{said}");
        assert_eq!(sink.0, 6);
    }

    #[test]
    fn a_quoted_last_value_is_not_missing() {
        let said = |text: &str| {
            let (mut sink, mut found) = (Count(0), Diagnostics::default());
            let mut reading = Reading::new(Path::new("a.csv"), Selection::All, &mut sink, &mut found);
            read(text.as_bytes(), &mut reading).unwrap();
            found.text()
        };
        assert_eq!(said("x,y,z\n\"1\",\"2\",\"3\"\n\"4\",\"5\",\"6\"\n"), "");
        let short = said("x,y,z,time\n1,2,3,4\n\"1\",\"2\",\"3\"\n");
        assert!(short.contains("1 line has fewer values"), "{short}");
    }
}
