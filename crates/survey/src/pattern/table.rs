//! Files of rows: text, Parquet, NumPy.

use super::columns::{COLUMNS, Column, Row};
use super::npy::{MAGIC, NpyArray};
use super::sink::{PatternProblem, RowResult, RowSink};
use crate::context::Context;
use crate::rows::MAX_LONG_FILE_BYTES;
use std::path::Path;
use vlscan_base::columns::comma_note;
use vlscan_base::diag::Place;
use vlscan_base::error::Error;
use vlscan_base::recognise::{Expected, foreign};
use vlscan_tables::{Line, TextTable};

/// First bytes of a Parquet file.
const PARQUET: &[u8] = b"PAR1";

/// A file of rows: its name, the folder from which it is searched, the place of its name, and what a row is.
pub(super) struct TableFile<'a> {
    pub context: &'a Context,
    pub name: &'a str,
    pub folder: &'a Path,
    pub place: &'a Place,
    pub help: &'static str,
}

/// A column that is read: position in a row of the file, quantity and factor to its unit.
type Used = (usize, Column, f64);

impl TableFile<'_> {
    /// Passes all rows to `sink`. Problems are recorded with file, line and column.
    pub fn read(&self, sink: &mut impl RowSink) -> Option<()> {
        let context = self.context;
        let path = context.file(self.name, self.folder, self.place.clone())?;
        if path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("parquet")) {
            return self.read_parquet(&path, sink);
        }
        let bytes = match context.read(&path, MAX_LONG_FILE_BYTES) {
            Ok(bytes) => bytes,
            Err(e) => {
                context.unread(self.place.clone(), &path, &e);
                return None;
            }
        };
        if bytes.starts_with(PARQUET) {
            return self.read_parquet(&path, sink);
        }
        if bytes.starts_with(MAGIC) {
            return self.read_npy(&path, &bytes, sink);
        }
        if let Some(found) = foreign(&path, &bytes, &Expected::NUMBERS) {
            found.report(&path, &mut context.problems.borrow_mut());
            return None;
        }
        self.read_text(&path, &context.text(&path, &bytes)?, sink)
    }

    /// Records a problem at a place.
    fn refuse<T>(&self, place: Place, problem: &PatternProblem) -> Option<T> {
        self.context.error_help(place, problem.to_string(), self.help);
        None
    }

    /// The columns of headings that are read, and the question of misspelt ones. Others are warned of.
    fn used(&self, place: &Place, headings: &[&str]) -> (Vec<Used>, Option<String>) {
        let mut unread = Vec::new();
        let mut used = Vec::new();
        for (i, heading) in headings.iter().enumerate() {
            match Column::of_heading(heading) {
                Some((column, factor)) => used.push((i, column, factor)),
                None if heading.trim().is_empty() => {}
                None => unread.push(heading.trim()),
            }
        }
        let question = Column::question(&unread, &quantities(&used));
        if !unread.is_empty() {
            let columns = if unread.len() == 1 { "column" } else { "columns" };
            let names: Vec<String> = unread.iter().map(|name| format!("`{name}`")).collect();
            let message = format!("{columns} {} not read", names.join(", "));
            self.context.warn_help(place.clone(), message, question.as_deref().unwrap_or(self.help));
        }
        (used, question)
    }

    /// The columns of a table of `count` columns without headings.
    fn unnamed<S: RowSink>(&self, place: &Place, count: usize) -> Option<Vec<Used>> {
        match S::unnamed(count) {
            Some(columns) => Some(columns.iter().enumerate().map(|(i, column)| (i, *column, 1.0)).collect()),
            None => self.refuse(place.clone(), &PatternProblem::Unnamed(count)),
        }
    }

    fn read_text<S: RowSink>(&self, path: &Path, text: &str, sink: &mut S) -> Option<()> {
        let mut table = TextTable::new(path, text);
        let Some(first) = table.find(|line| !skips::<S>(line)) else {
            return self.refuse(Place::of_file(path), &PatternProblem::Empty);
        };
        let fields: Vec<&str> = first.fields.iter().map(AsRef::as_ref).collect();
        let place = table.place(&first, None);
        let has_headings = fields.iter().any(|field| field.parse::<f64>().is_err());
        let (used, question) = match has_headings {
            true => self.used(&place, &fields),
            false => (self.unnamed::<S>(&place, fields.len())?, None),
        };
        self.begin(place, &used, question, sink)?;
        if !has_headings {
            self.add_line(&table, &first, &used, sink)?;
        }
        while let Some(mut line) = table.next() {
            if skips::<S>(&line) {
                continue;
            }
            if let Err(e) = line.fit(fields.len(), "the first line", table.separator()) {
                self.context.error_help(table.place(&line, None), e.message, e.help);
                return None;
            }
            self.add_line(&table, &line, &used, sink)?;
        }
        Some(())
    }

    /// Begins a table with these columns. A question of misspelt headings is the help of problems.
    fn begin(
        &self,
        place: Place,
        used: &[Used],
        question: Option<String>,
        sink: &mut impl RowSink,
    ) -> Option<()> {
        let is_angle = |column| matches!(column, Column::Azimuth | Column::Elevation | Column::Zenith);
        let has_units = used.iter().any(|(_, column, factor)| is_angle(*column) && *factor != 1.0);
        match sink.begin(&quantities(used), has_units) {
            Ok(()) => Some(()),
            Err(problem) => {
                let help = question.unwrap_or_else(|| self.help.to_owned());
                self.context.error_help(place, problem.to_string(), help);
                None
            }
        }
    }

    fn add_line(&self, table: &TextTable, line: &Line, used: &[Used], sink: &mut impl RowSink) -> Option<()> {
        let field = |at: usize| line.fields.get(at).and_then(|field| field.parse::<f64>().ok());
        let Err((column, problem)) = add(used, |at| field(at).unwrap_or(f64::NAN), sink) else {
            return Some(());
        };
        let at = used.iter().find(|(_, of, _)| *of == column).map(|(at, ..)| *at);
        let text: &str = at.and_then(|at| line.fields.get(at)).map_or("", AsRef::as_ref);
        let problem = match (problem, comma_note(text)) {
            (PatternProblem::Value(expected), note) if !note.is_empty() => {
                PatternProblem::Value(format!("{expected}, found {text}{note}"))
            }
            (problem, _) => problem,
        };
        self.refuse(table.place(line, at), &problem)
    }

    fn read_npy<S: RowSink>(&self, path: &Path, bytes: &[u8], sink: &mut S) -> Option<()> {
        let place = Place::of_file(path);
        let array = match NpyArray::parse(bytes) {
            Ok(array) => array,
            Err(e) => {
                self.context.error_help(place, format!("this NumPy array {e}"), self.help);
                return None;
            }
        };
        let (used, question) = match &array.names {
            Some(names) => self.used(&place, &names.iter().map(String::as_str).collect::<Vec<_>>()),
            None => (self.unnamed::<S>(&place, array.width())?, None),
        };
        self.begin(place, &used, question, sink)?;
        self.add_rows(path, &used, array.rows, |row, column| array.number(row, column), sink)
    }

    fn read_parquet(&self, path: &Path, sink: &mut impl RowSink) -> Option<()> {
        let place = Place::of_file(path);
        let Some(read) = self.context.number_columns else {
            let message = "Parquet files are not read here";
            self.context.error_help(place, message, "write the table as CSV or as an array of NumPy (.npy)");
            return None;
        };
        let table = match read(path, &|name| Column::of_heading(name).is_some()) {
            Ok(table) => table,
            Err(Error::Input(problems)) => {
                self.context.problems.borrow_mut().extend(*problems);
                return None;
            }
            Err(e) => {
                self.context.error(place, e.to_string());
                return None;
            }
        };
        if let Some(name) = table.unread.iter().find(|name| Column::of_heading(name).is_some()) {
            let message = format!("the column `{name}` has no numbers, or of a type that is not read");
            self.context.error_help(place, message, "write the column as DOUBLE or as integers");
            return None;
        }
        let unread_message = table.unread_message();
        let (names, columns): (Vec<String>, Vec<Vec<f64>>) = table.columns.into_iter().unzip();
        let (used, _) = self.used(&place, &names.iter().map(String::as_str).collect::<Vec<_>>());
        let question = Column::question(&table.unread, &quantities(&used));
        if let Some(message) = unread_message {
            self.context.warn_help(place.clone(), message, question.as_deref().unwrap_or(self.help));
        }
        self.begin(place, &used, question, sink)?;
        let rows = columns.first().map_or(0, Vec::len);
        let number = |row: usize, column: usize| columns[column].get(row).copied().unwrap_or(f64::NAN);
        self.add_rows(path, &used, rows, number, sink)
    }

    /// Adds the rows of a table without lines, which has begun.
    fn add_rows(
        &self,
        path: &Path,
        used: &[Used],
        rows: usize,
        number: impl Fn(usize, usize) -> f64,
        sink: &mut impl RowSink,
    ) -> Option<()> {
        for row in 0..rows {
            if let Err(problem) = add_row(row, used, |at| number(row, at), sink) {
                return self.refuse(Place::of_file(path), &problem);
            }
        }
        Some(())
    }
}

fn quantities(used: &[Used]) -> Vec<Column> {
    used.iter().map(|(_, column, _)| *column).collect()
}

/// True if a line has a mark of correction files in place of numbers, or empty fields alone, as spreadsheets
/// write blank lines.
fn skips<S: RowSink>(line: &Line) -> bool {
    line.fields.iter().all(|field| field.trim().is_empty())
        || line.fields.first().is_some_and(|first| S::skips(first))
}

/// Adds a row of numbers by their places in the file. All of them must be finite.
fn add(used: &[Used], number: impl Fn(usize) -> f64, sink: &mut impl RowSink) -> RowResult {
    let mut row: Row = [f64::NAN; COLUMNS];
    for (at, column, factor) in used {
        let value = number(*at);
        if !value.is_finite() {
            return Err((*column, PatternProblem::Value("a finite number".to_owned())));
        }
        row[*column as usize] = if *factor == 1.0 { value } else { value * factor };
    }
    sink.add(&row)
}

/// Adds rows that a pipeline file lists.
///
/// # Errors
/// The first problem.
pub(super) fn add_listed<S: RowSink>(rows: &[Vec<f64>], sink: &mut S) -> Result<(), PatternProblem> {
    let expected = rows.first().map_or(0, Vec::len);
    if expected == 0 {
        return Err(PatternProblem::Empty);
    }
    let columns = S::unnamed(expected).ok_or(PatternProblem::Unnamed(expected))?;
    sink.begin(columns, false)?;
    let used: Vec<Used> = columns.iter().enumerate().map(|(i, column)| (i, *column, 1.0)).collect();
    for (row, numbers) in rows.iter().enumerate() {
        if numbers.len() != expected {
            return Err(PatternProblem::Ragged { row, found: numbers.len(), expected });
        }
        add_row(row, &used, |at| numbers[at], sink)?;
    }
    Ok(())
}

/// Adds a row of a table without lines.
fn add_row(
    row: usize,
    used: &[Used],
    number: impl Fn(usize) -> f64,
    sink: &mut impl RowSink,
) -> Result<(), PatternProblem> {
    add(used, number, sink).map_err(|(column, problem)| PatternProblem::InRow {
        row,
        column: column.name(),
        problem: Box::new(problem),
    })
}
