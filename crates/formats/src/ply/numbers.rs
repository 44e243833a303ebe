//! The numbers of text PLY files, between blanks and line ends of any kind: a line need not be an element.

use super::PlyError;
use crate::text::float;

/// Maximum length of a word, bytes.
const MAX_WORD_BYTES: usize = 1 << 10;

/// Reads the numbers behind the header one after the other.
pub struct PlyNumbers<'b>(&'b [u8]);

impl<'b> PlyNumbers<'b> {
    /// Begins at the first byte behind the header.
    pub fn new(body: &'b [u8]) -> PlyNumbers<'b> {
        PlyNumbers(body)
    }

    /// True if nothing but blanks is left.
    pub fn is_at_end(&self) -> bool {
        self.0.trim_ascii_start().is_empty()
    }

    /// Number of bytes that are not read yet.
    pub(crate) fn unread(&self) -> usize {
        self.0.len()
    }

    /// Reads the next number.
    ///
    /// # Errors
    /// A word that is not a number, or the end of the file.
    pub fn number(&mut self) -> Result<f64, PlyError> {
        self.0 = self.0.trim_ascii_start();
        let end = self.0.iter().position(u8::is_ascii_whitespace).unwrap_or(self.0.len());
        let (word, rest) = self.0.split_at(end.min(MAX_WORD_BYTES));
        self.0 = rest;
        if word.is_empty() {
            return Err(PlyError::EndOfFile);
        }
        float(word).ok_or_else(|| PlyError::NotANumber(String::from_utf8_lossy(word).into_owned()))
    }

    /// Reads the number of values of a list, which follow it.
    ///
    /// # Errors
    /// As [`PlyNumbers::number`], and a number that cannot be a length.
    pub fn length(&mut self) -> Result<usize, PlyError> {
        let count = self.number()?;
        // A list has at most as many numbers as the file has bytes.
        if !(0.0..=self.0.len() as f64).contains(&count) || count.fract() != 0.0 {
            return Err(PlyError::Length(count));
        }
        Ok(count as usize)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn line_ends_are_blanks() {
        for text in ["1 2.5\n\n3\n", "1\r\n2.5 3", "1\r2.5\r3\r"] {
            let mut numbers = PlyNumbers::new(text.as_bytes());
            let read: Vec<f64> = (0..3).map(|_| numbers.number().unwrap()).collect();
            assert_eq!(read, [1.0, 2.5, 3.0], "{text:?}");
            assert!((numbers.number() == Err(PlyError::EndOfFile)), "{text:?}");
        }
        let wrong = |text: &'static str| PlyNumbers::new(text.as_bytes()).number().unwrap_err().to_string();
        assert!(wrong("1,5 2").contains("decimal comma") && wrong("a\x1b").contains("a\\u{1b}"));
        assert_eq!(PlyNumbers::new(b"2 1 2").length(), Ok(2));
        for wrong in ["2.5 1 2", "9 1", "-1 1"] {
            assert!(PlyNumbers::new(wrong.as_bytes()).length().is_err(), "{wrong}");
        }
    }
}
