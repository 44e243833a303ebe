//! Reads points from lines of text, from files and from streams.

use super::blocks::{self, LineTaker};
use super::layout::LayoutFinder;
use super::lines::read_line;
use super::rows::RowReader;
use crate::{Attribute, Reading};
use std::io::BufRead;
use vlscan_base::error::{Error, Result};
use vlscan_tables::input::rows::line_place;

/// Reads one point per line.
pub(crate) fn read(mut source: impl BufRead, reading: &mut Reading) -> Result<()> {
    let mut finder = LayoutFinder::default();
    let mut rows: Option<RowReader> = None;
    let (mut line, mut words, mut values) = (Vec::new(), Vec::new(), Vec::new());
    let mut taker = LineTaker::default();
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
                let (columns, chosen) = (found.columns, reading.choose(&found.names()));
                rows.insert(RowReader::new(found, columns, text).with_chosen(chosen))
            }
        };
        rows.split(text, &mut words);
        let path = reading.path;
        let flow = match rows.parse(text, &words) {
            Ok(row) => {
                taker.widths.see(rows, text, &words, |at| line_place(path, number, text, at));
                let object = rows.word(Attribute::Object, &words);
                values.clear();
                rows.push_values(text, &words, &mut values);
                reading.pass_values(&values);
                blocks::take_row(rows, (number, text), (&row, object), reading)
            }
            Err(bad) => taker.take_problem((number, text), bad, reading),
        };
        if flow.is_break() {
            break;
        }
        if reading.threads > 1 {
            blocks::read(source, number, rows, &mut taker, reading)?;
            break;
        }
    }
    for (place, message) in rows.map_or_else(Vec::new, |rows| taker.widths.warnings(&rows)) {
        reading.found.warn(Some(place), message);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{AttributeSet, PointRow, PointSink, Selection};
    use std::ops::ControlFlow;
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
