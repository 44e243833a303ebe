//! Arrays of NumPy (`.npy`): one of two dimensions, or one of records whose fields have names.
//!
//! A file is `\x93NUMPY`, the version in two bytes, the length of the header in two bytes (version 1) or four
//! (2 and 3), little-endian; the header, a dictionary of Python with `descr`, `fortran_order` and `shape`;
//! then the numbers (NumPy, "NEP 1 — A simple file format for NumPy arrays").

use regex_lite::Regex;

/// First bytes of a file.
pub(super) const MAGIC: &[u8] = b"\x93NUMPY";

/// Reasons why an array is not read; the text of each error completes "this NumPy array ".
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub(super) enum NpyError {
    /// Fewer bytes than the header states.
    #[error("ends before its last number")]
    Truncated,
    /// More bytes than the header states, such as those of a second array.
    #[error("has {0} bytes behind its last number")]
    Longer(usize),
    /// A damaged header.
    #[error("has a damaged header")]
    Header,
    /// Numbers of other types.
    #[error("has values of the type {0}; expected real numbers, such as float64")]
    Type(String),
    /// An array of other dimensions.
    #[error("has the shape ({0}); expected rows of numbers, or records with names")]
    Shape(String),
}

/// A type of numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Scalar {
    /// `f`, `i` or `u`.
    kind: u8,
    bytes: usize,
    is_big_endian: bool,
}

/// An array in memory.
#[derive(Debug)]
pub(super) struct NpyArray<'b> {
    /// Names of the columns, if the rows are records.
    pub names: Option<Vec<String>>,
    columns: Vec<Scalar>,
    pub rows: usize,
    is_by_column: bool,
    data: &'b [u8],
}

impl Scalar {
    fn parse(text: &str) -> Result<Scalar, NpyError> {
        let other = || NpyError::Type(text.chars().take(40).collect());
        let (order, rest) = match text.as_bytes() {
            [order @ (b'<' | b'>' | b'=' | b'|'), rest @ ..] => (*order, rest),
            _ => return Err(other()),
        };
        let (kind, bytes) = match rest {
            [kind @ (b'i' | b'u'), size @ (b'1' | b'2' | b'4' | b'8')] => (*kind, usize::from(size - b'0')),
            [kind @ b'f', size @ (b'4' | b'8')] => (*kind, usize::from(size - b'0')),
            _ => return Err(other()),
        };
        Ok(Scalar { kind, bytes, is_big_endian: order == b'>' })
    }

    /// The number of the first bytes of `data`.
    fn number(self, data: &[u8]) -> f64 {
        let mut bytes = [0; 8];
        let Some(stored) = data.get(..self.bytes) else { return f64::NAN };
        bytes[..self.bytes].copy_from_slice(stored);
        if self.is_big_endian {
            bytes[..self.bytes].reverse();
        }
        let bits = u64::from_le_bytes(bytes);
        let unused = 64 - 8 * self.bytes as u32;
        match (self.kind, self.bytes) {
            (b'f', 4) => f64::from(f32::from_bits(bits as u32)),
            (b'f', _) => f64::from_bits(bits),
            (b'i', _) => (((bits << unused) as i64) >> unused) as f64,
            _ => bits as f64,
        }
    }
}

impl NpyArray<'_> {
    /// The array in the bytes of a file.
    ///
    /// # Errors
    /// Damaged files, and arrays that are no rows of numbers.
    pub fn parse(bytes: &[u8]) -> Result<NpyArray<'_>, NpyError> {
        let rest = bytes.strip_prefix(MAGIC).ok_or(NpyError::Header)?;
        let (length, rest) = match rest {
            [1, _, low, high, rest @ ..] => (usize::from(u16::from_le_bytes([*low, *high])), rest),
            [2 | 3, _, a, b, c, d, rest @ ..] => (u32::from_le_bytes([*a, *b, *c, *d]) as usize, rest),
            _ => return Err(NpyError::Header),
        };
        let header = rest.get(..length).ok_or(NpyError::Truncated)?;
        let header = std::str::from_utf8(header).map_err(|_| NpyError::Header)?;
        let part = |pattern: &str| -> Result<String, NpyError> {
            let found = Regex::new(pattern).ok().and_then(|regex| regex.captures(header));
            found.and_then(|found| Some(found.get(1)?.as_str().to_owned())).ok_or(NpyError::Header)
        };
        let is_by_column = part(r"'fortran_order'\s*:\s*(True|False)")? == "True";
        let shape_text = part(r"'shape'\s*:\s*\(([^)]*)\)")?;
        let sizes = shape_text.split(',').map(str::trim).filter(|size| !size.is_empty());
        let shape: Option<Vec<usize>> = sizes.map(|size| size.parse().ok()).collect();
        let shape = shape.ok_or(NpyError::Header)?;
        let (names, columns) = match (part(r"'descr'\s*:\s*'([^']*)'"), &shape[..]) {
            // No table has more columns.
            (Ok(kind), [_, width @ 1..=64]) => (None, vec![Scalar::parse(&kind)?; *width]),
            (Err(_), [_]) => {
                let fields = part(r"'descr'\s*:\s*\[(.*)\]")?;
                let (names, kinds) = fields_of(&fields)?;
                (Some(names), kinds)
            }
            _ => return Err(NpyError::Shape(shape_text)),
        };
        let data = &rest[length..];
        let width: usize = columns.iter().map(|column| column.bytes).sum();
        let needed = shape[0].checked_mul(width).ok_or(NpyError::Truncated)?;
        match data.len().checked_sub(needed) {
            None => Err(NpyError::Truncated),
            Some(0) => Ok(NpyArray { names, columns, rows: shape[0], is_by_column, data }),
            Some(more) => Err(NpyError::Longer(more)),
        }
    }

    /// Number of columns.
    pub fn width(&self) -> usize {
        self.columns.len()
    }

    /// The number in a row and a column.
    pub fn number(&self, row: usize, column: usize) -> f64 {
        let kind = self.columns[column];
        let before: usize = self.columns[..column].iter().map(|column| column.bytes).sum();
        let at = match self.is_by_column && self.names.is_none() {
            true => (column * self.rows + row) * kind.bytes,
            false => row * self.columns.iter().map(|column| column.bytes).sum::<usize>() + before,
        };
        kind.number(self.data.get(at..).unwrap_or_default())
    }
}

/// Names and types of the fields of records, `('azimuth_deg', '<f8'), …`.
fn fields_of(text: &str) -> Result<(Vec<String>, Vec<Scalar>), NpyError> {
    let field = Regex::new(r"\(\s*'([^']*)'\s*,\s*'([^']*)'\s*\)").map_err(|_| NpyError::Header)?;
    let (mut names, mut kinds) = (Vec::new(), Vec::new());
    for found in field.captures_iter(text) {
        names.push(found[1].to_owned());
        kinds.push(Scalar::parse(&found[2])?);
    }
    // Fields of other forms, such as arrays, do not match.
    match !names.is_empty() && text.matches('(').count() == names.len() {
        true => Ok((names, kinds)),
        false => Err(NpyError::Type(text.chars().take(40).collect())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file(header: &str, data: &[u8]) -> Vec<u8> {
        let length = (header.len() as u16).to_le_bytes();
        [MAGIC, &[1, 0], &length, header.as_bytes(), data].concat()
    }

    fn rows(bytes: &[u8]) -> Vec<Vec<f64>> {
        let array = NpyArray::parse(bytes).unwrap();
        let row = |row: usize| (0..array.width()).map(|column| array.number(row, column)).collect();
        (0..array.rows).map(row).collect()
    }

    #[test]
    fn arrays_have_rows_in_either_order() {
        let data: Vec<u8> = [1.5, -2.0, 3.0, 4.0, 5.0, 6.0f64].iter().flat_map(|x| x.to_le_bytes()).collect();
        let header = "{'descr': '<f8', 'fortran_order': False, 'shape': (3, 2), }\n";
        assert_eq!(rows(&file(header, &data)), [[1.5, -2.0], [3.0, 4.0], [5.0, 6.0]]);
        let header = header.replace("False", "True");
        assert_eq!(rows(&file(&header, &data)), [[1.5, 4.0], [-2.0, 5.0], [3.0, 6.0]]);
    }

    #[test]
    fn records_have_names_and_types_of_their_own() {
        let header = "{'descr': [('t', '>i2'), ('az', '<f4'), ('ch', '|u1')], 'fortran_order': False, 'shape': (2,), }";
        let mut data = vec![0xff, 0xfe];
        data.extend(0.25f32.to_le_bytes());
        data.push(200);
        data.extend([0x01, 0x00, 0, 0, 0, 0, 7]);
        let bytes = file(header, &data);
        let array = NpyArray::parse(&bytes).unwrap();
        assert_eq!(array.names.as_deref(), Some(&["t".to_owned(), "az".to_owned(), "ch".to_owned()][..]));
        assert_eq!(rows(&bytes), [[-2.0, 0.25, 200.0], [256.0, 0.0, 7.0]]);
    }

    #[test]
    fn other_arrays_are_refused() {
        let of = |descr: &str, shape: &str, data: &[u8]| {
            let header = format!("{{'descr': {descr}, 'fortran_order': False, 'shape': ({shape}), }}");
            NpyArray::parse(&file(&header, data)).map(|_| ()).unwrap_err()
        };
        assert_eq!(of("'<f8'", "2, 2", &[0; 31]), NpyError::Truncated);
        assert_eq!(of("'<f8'", "2, 2", &[0; 40]), NpyError::Longer(8));
        assert_eq!(of("'<f8'", "18446744073709551615, 2", &[]), NpyError::Truncated);
        assert_eq!(of("'<c16'", "2, 2", &[]), NpyError::Type("<c16".to_owned()));
        assert_eq!(of("'|O'", "2, 2", &[]), NpyError::Type("|O".to_owned()));
        assert_eq!(of("'<f8'", "4,", &[]), NpyError::Shape("4,".to_owned()));
        assert_eq!(of("'<f8'", "1, 2, 2", &[]), NpyError::Shape("1, 2, 2".to_owned()));
        assert!(matches!(of("[('a', '<f8', (3,))]", "4,", &[]), NpyError::Type(_)));
        assert_eq!(of("'<f8'", "a", &[]), NpyError::Header);
        for bytes in [&b"\x93NUMPY"[..], b"\x93NUMPY\x01\x00\xff\xff{", b"\x93NUMPY\x09\x00\x00\x00", b""] {
            assert!(NpyArray::parse(bytes).is_err());
        }
    }
}
