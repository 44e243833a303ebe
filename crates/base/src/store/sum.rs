//! Checksums of values of any kind.

use crate::files::reads;
use bytemuck::NoUninit;
use std::fmt::{self, Debug, Write as _};
use std::io::{self, Read};
use std::path::Path;
use xxhash_rust::xxh3::Xxh3;

/// A checksum under construction.
#[derive(Default)]
pub struct Checksum(Xxh3);

impl Checksum {
    /// Adds an array, with its length.
    pub fn array<T: NoUninit>(&mut self, values: &[T]) {
        self.0.update(&(values.len() as u64).to_le_bytes());
        self.0.update(bytemuck::cast_slice(values));
    }

    /// Adds bytes, as those of a file.
    pub fn bytes(&mut self, bytes: &[u8]) {
        self.0.update(bytes);
    }

    /// Adds everything that the debug representation of a value shows: floats are written with all their
    /// digits.
    pub fn debug(&mut self, value: &impl Debug) {
        // Writing to a checksum cannot fail.
        let _ = write!(self, "{value:?};");
    }

    /// Adds the contents of a regular file.
    ///
    /// # Errors
    /// When the file cannot be read.
    pub fn file(&mut self, path: &Path) -> io::Result<()> {
        let mut file = reads::open_own(path)?;
        let mut block = vec![0; 1 << 18];
        loop {
            match file.read(&mut block)? {
                0 => return Ok(()),
                n => self.0.update(&block[..n]),
            }
        }
    }

    /// The 64-bit XXH3 checksum of everything added so far; more can be added afterwards.
    pub fn finish(&self) -> u64 {
        self.0.digest()
    }
}

impl fmt::Write for Checksum {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        self.0.update(text.as_bytes());
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_bit_and_every_length_counts() {
        let sum = |add: &dyn Fn(&mut Checksum)| {
            let mut sum = Checksum::default();
            add(&mut sum);
            sum.finish()
        };
        assert_ne!(sum(&|s| s.debug(&1.0f64)), sum(&|s| s.debug(&1.0f64.next_up())));
        assert_ne!(sum(&|s| s.array(&[1.0f64])), sum(&|s| s.array(&[1.0f64.next_up()])));
        let split = |first: &'static [u8], second: &'static [u8]| {
            sum(&move |s| {
                s.array(first);
                s.array(second);
            })
        };
        assert_ne!(split(b"ab", b"c"), split(b"a", b"bc"));
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a");
        std::fs::write(&path, "text").unwrap();
        assert_eq!(sum(&|s| s.file(&path).unwrap()), sum(&|s| s.write_str("text").unwrap()));
    }
}
