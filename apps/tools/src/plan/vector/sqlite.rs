//! Rows of the tables of an SQLite database in memory (<https://sqlite.org/fileformat.html>). Only tables
//! with row ids are read, by their pages in order. Every page is visited at most once for each table, and the
//! bytes of all rows are bounded by the size of the file, so that a damaged or hostile file ends with an
//! error.

use std::collections::HashSet;

/// A value of a row.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Value {
    /// NULL; also the value of a column that is an alias of the row id.
    Null,
    /// A whole number.
    Integer(i64),
    /// A number.
    Real(f64),
    /// Text.
    Text(String),
    /// Bytes.
    Blob(Vec<u8>),
}

impl Value {
    /// The text of a value that has one.
    pub fn text(&self) -> Option<&str> {
        match self {
            Value::Text(text) => Some(text),
            _ => None,
        }
    }

    /// The number of a value that is whole.
    pub fn integer(&self) -> Option<i64> {
        match self {
            Value::Integer(number) => Some(*number),
            _ => None,
        }
    }
}

/// A row with its id.
pub(super) type Row = (i64, Vec<Value>);

/// An open database.
pub(super) struct Database<'b> {
    bytes: &'b [u8],
    page_bytes: usize,
    /// Bytes of a page that hold content.
    usable: usize,
}

/// Pages of tables, by the first byte of their header.
const LEAF: u8 = 0x0d;
const INTERIOR: u8 = 0x05;
/// Length of the header of the file, on its first page.
const FILE_HEADER: usize = 100;
/// Maximum number of levels of a tree; one of 2³² rows has fewer.
const MAX_DEPTH: usize = 32;
/// Code of UTF-8 in the header.
const UTF8: u32 = 1;

/// Problem of a database.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SqliteError {
    /// Content that does not follow the format.
    #[error("the database is damaged")]
    Damaged,
    /// A page beyond the end of the file.
    #[error("the database is truncated")]
    Truncated,
    /// Texts in an encoding that is not supported.
    #[error("the text of the database is in UTF-16")]
    Utf16,
    /// A view in place of a table, by its name.
    #[error("`{0}` is a view, whose rows are not stored")]
    View(String),
}

impl<'b> Database<'b> {
    /// Reads the header.
    ///
    /// # Errors
    /// Problem of the database, or a feature that is not supported.
    pub fn open(bytes: &'b [u8]) -> Result<Database<'b>, SqliteError> {
        if bytes.len() < FILE_HEADER || !bytes.starts_with(b"SQLite format 3\0") {
            return Err(SqliteError::Damaged);
        }
        let page_bytes = match u16::from_be_bytes([bytes[16], bytes[17]]) {
            1 => 65536,
            size => usize::from(size),
        };
        let usable = page_bytes.saturating_sub(usize::from(bytes[20]));
        if !page_bytes.is_power_of_two() || page_bytes < 512 || usable < 480 {
            return Err(SqliteError::Damaged);
        }
        let encoding = u32::from_be_bytes([bytes[56], bytes[57], bytes[58], bytes[59]]);
        // A database without tables has none yet.
        if encoding > UTF8 {
            return Err(SqliteError::Utf16);
        }
        Ok(Database { bytes, page_bytes, usable })
    }

    /// The first page of a table by its name; `None` if there is none.
    ///
    /// # Errors
    /// A damaged schema, or a view in place of the table.
    pub fn table(&self, name: &str) -> Result<Option<u32>, SqliteError> {
        let mut root = None;
        self.rows(1, |(_, row)| {
            let [kind, own, _, page, ..] = row.as_slice() else { return Err(SqliteError::Damaged) };
            if !own.text().is_some_and(|own| own.eq_ignore_ascii_case(name)) {
                return Ok(());
            }
            match kind.text() {
                Some("table") => root = page.integer().and_then(|page| u32::try_from(page).ok()),
                Some("view") => return Err(SqliteError::View(name.to_owned())),
                _ => {}
            }
            Ok(())
        })?;
        Ok(root)
    }

    /// Passes the rows of the table with this first page to `take`, in the order of their ids.
    ///
    /// # Errors
    /// Damage, and those of `take`.
    pub fn rows<E: From<SqliteError>>(
        &self,
        root: u32,
        mut take: impl FnMut(Row) -> Result<(), E>,
    ) -> Result<(), E> {
        let mut seen = HashSet::new();
        // Pages with their depth; the next one is the last.
        let mut todo = vec![(root, 0)];
        let mut budget = self.bytes.len();
        while let Some((number, depth)) = todo.pop() {
            if depth > MAX_DEPTH || !seen.insert(number) {
                return Err(SqliteError::Damaged.into());
            }
            let page = self.page(number)?;
            let start = if number == 1 { FILE_HEADER } else { 0 };
            let kind = byte(page, start)?;
            let cells = usize::from(u16_at(page, start + 3)?);
            let header = start + if kind == INTERIOR { 12 } else { 8 };
            let cell = |i: usize| u16_at(page, header + 2 * i).map(usize::from);
            match kind {
                INTERIOR => {
                    todo.push((u32_at(page, start + 8)?, depth + 1));
                    for i in (0..cells).rev() {
                        todo.push((u32_at(page, cell(i)?)?, depth + 1));
                    }
                }
                LEAF => {
                    for i in 0..cells {
                        let (id, payload) = self.payload(page, cell(i)?, &mut budget)?;
                        take((id, record(&payload)?))?;
                    }
                }
                _ => return Err(SqliteError::Damaged.into()),
            }
        }
        Ok(())
    }

    /// A page by its number, from 1.
    fn page(&self, number: u32) -> Result<&'b [u8], SqliteError> {
        let start = (number as usize).checked_sub(1).and_then(|n| n.checked_mul(self.page_bytes));
        let page = start.and_then(|start| self.bytes.get(start..start.checked_add(self.page_bytes)?));
        page.map(|page| &page[..self.usable]).ok_or(SqliteError::Truncated)
    }

    /// The id and the bytes of a row, with those on overflow pages. `budget` is the number of bytes that all
    /// rows may have.
    fn payload(&self, page: &[u8], at: usize, budget: &mut usize) -> Result<(i64, Vec<u8>), SqliteError> {
        let (length, at) = varint(page, at)?;
        let (id, at) = varint(page, at)?;
        let length = usize::try_from(length).map_err(|_| SqliteError::Damaged)?;
        *budget = budget.checked_sub(length).ok_or(SqliteError::Damaged)?;
        let (max_local, overflow_bytes) = (self.usable - 35, self.usable - 4);
        let min_local = (self.usable - 12) * 32 / 255 - 23;
        let local = match length {
            length if length <= max_local => length,
            length => {
                let local = min_local + (length - min_local) % overflow_bytes;
                if local <= max_local { local } else { min_local }
            }
        };
        let mut bytes = page.get(at..at + local).ok_or(SqliteError::Damaged)?.to_vec();
        let mut next = if local < length { u32_at(page, at + local)? } else { 0 };
        // Each page adds bytes, so that a chain that leads in a circle ends, too.
        while bytes.len() < length {
            let page = self.page(next)?;
            next = u32_at(page, 0)?;
            let count = (length - bytes.len()).min(overflow_bytes);
            bytes.extend_from_slice(&page[4..4 + count]);
        }
        if next != 0 {
            return Err(SqliteError::Damaged);
        }
        Ok((id, bytes))
    }
}

/// The values of a record.
fn record(bytes: &[u8]) -> Result<Vec<Value>, SqliteError> {
    let (header, mut at) = varint(bytes, 0)?;
    let header =
        usize::try_from(header).ok().filter(|header| *header <= bytes.len()).ok_or(SqliteError::Damaged)?;
    let (mut values, mut body) = (Vec::new(), header);
    while at < header {
        let kind;
        (kind, at) = varint(bytes, at)?;
        let length = match kind {
            0 | 8 | 9 => 0,
            1..=4 => kind as usize,
            5 => 6,
            6 | 7 => 8,
            kind if kind >= 12 => usize::try_from((kind - 12) / 2).map_err(|_| SqliteError::Damaged)?,
            _ => return Err(SqliteError::Damaged),
        };
        let end = body.checked_add(length).ok_or(SqliteError::Damaged)?;
        let content = bytes.get(body..end).ok_or(SqliteError::Damaged)?;
        body = end;
        values.push(match kind {
            0 => Value::Null,
            8 => Value::Integer(0),
            9 => Value::Integer(1),
            1..=6 => Value::Integer(integer(content)),
            7 => Value::Real(f64::from_bits(integer(content) as u64)),
            kind if kind % 2 == 0 => Value::Blob(content.to_vec()),
            _ => Value::Text(String::from_utf8_lossy(content).into_owned()),
        });
    }
    Ok(values)
}

/// A number in two's complement, the most significant byte first.
fn integer(bytes: &[u8]) -> i64 {
    let sign = if bytes.first().is_some_and(|first| first & 0x80 != 0) { -1 } else { 0 };
    bytes.iter().fold(sign, |number, byte| number << 8 | i64::from(*byte))
}

/// A number of one to nine bytes, and where the next begins.
fn varint(bytes: &[u8], at: usize) -> Result<(i64, usize), SqliteError> {
    let mut number = 0_u64;
    for i in 0..9 {
        let byte = byte(bytes, at + i)?;
        if i == 8 {
            return Ok(((number << 8 | u64::from(byte)) as i64, at + 9));
        }
        number = number << 7 | u64::from(byte & 0x7f);
        if byte & 0x80 == 0 {
            return Ok((number as i64, at + i + 1));
        }
    }
    Err(SqliteError::Damaged)
}

fn byte(bytes: &[u8], at: usize) -> Result<u8, SqliteError> {
    bytes.get(at).copied().ok_or(SqliteError::Damaged)
}

fn u16_at(bytes: &[u8], at: usize) -> Result<u16, SqliteError> {
    Ok(u16::from_be_bytes([byte(bytes, at)?, byte(bytes, at + 1)?]))
}

fn u32_at(bytes: &[u8], at: usize) -> Result<u32, SqliteError> {
    Ok(u32::from(u16_at(bytes, at)?) << 16 | u32::from(u16_at(bytes, at + 2)?))
}
