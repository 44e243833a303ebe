//! Encodes small values one after the other, little-endian and bit for bit. The encoding carries no types: a checksum
//! protects it, and the reader must request the types that the writer wrote, in the same order.

use vlscan_geom::DVec3;

/// Appends encoded values to a vector of bytes.
#[derive(Debug, Default)]
pub struct ByteWriter(Vec<u8>);

impl ByteWriter {
    /// All bytes that have been encoded.
    pub fn bytes(&self) -> &[u8] {
        &self.0
    }

    /// Appends an integer as eight bytes.
    pub fn u64(&mut self, value: u64) {
        self.0.extend(value.to_le_bytes());
    }

    /// Appends the bits of a float.
    pub fn f64(&mut self, value: f64) {
        self.u64(value.to_bits());
    }

    /// Appends the components x, y, z as floats.
    pub fn vector(&mut self, value: DVec3) {
        value.to_array().into_iter().for_each(|x| self.f64(x));
    }

    /// Appends a boolean as one byte.
    pub fn flag(&mut self, value: bool) {
        self.0.push(u8::from(value));
    }

    /// Appends a string with its length.
    pub fn text(&mut self, value: &str) {
        self.blob(value.as_bytes());
    }

    /// Appends the number of bytes, then the bytes.
    pub fn blob(&mut self, value: &[u8]) {
        self.u64(value.len() as u64);
        self.0.extend(value);
    }

    /// Appends a flag and, if there is a value, the value.
    pub fn option<T>(&mut self, value: Option<T>, write: impl FnOnce(&mut ByteWriter, T)) {
        self.flag(value.is_some());
        if let Some(value) = value {
            write(self, value);
        }
    }

    /// Appends the number of values, then the values.
    pub fn list<T>(&mut self, values: &[T], mut write: impl FnMut(&mut ByteWriter, &T)) {
        self.u64(values.len() as u64);
        values.iter().for_each(|value| write(self, value));
    }
}

/// The bytes end before a value is complete, or do not encode a value of the requested type.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct UnexpectedEnd;

/// Decodes values that a [`ByteWriter`] encoded.
#[derive(Clone, Debug)]
pub struct ByteReader<'a>(pub &'a [u8]);

impl<'a> ByteReader<'a> {
    fn take(&mut self, count: usize) -> Result<&'a [u8], UnexpectedEnd> {
        let (taken, rest) = self.0.split_at_checked(count).ok_or(UnexpectedEnd)?;
        self.0 = rest;
        Ok(taken)
    }

    /// Reads an integer of eight bytes.
    pub fn u64(&mut self) -> Result<u64, UnexpectedEnd> {
        self.take(8)?.try_into().map(u64::from_le_bytes).map_err(|_| UnexpectedEnd)
    }

    /// Reads an integer that fits into 32 bits.
    pub fn u32(&mut self) -> Result<u32, UnexpectedEnd> {
        u32::try_from(self.u64()?).map_err(|_| UnexpectedEnd)
    }

    /// Reads an integer that fits into `usize`.
    pub fn size(&mut self) -> Result<usize, UnexpectedEnd> {
        usize::try_from(self.u64()?).map_err(|_| UnexpectedEnd)
    }

    /// Reads a float, bit for bit.
    pub fn f64(&mut self) -> Result<f64, UnexpectedEnd> {
        self.u64().map(f64::from_bits)
    }

    /// Reads the components x, y, z of a vector.
    pub fn vector(&mut self) -> Result<DVec3, UnexpectedEnd> {
        Ok(DVec3::new(self.f64()?, self.f64()?, self.f64()?))
    }

    /// Reads a boolean of one byte; any byte but 0 is true.
    pub fn flag(&mut self) -> Result<bool, UnexpectedEnd> {
        Ok(self.take(1)? != [0])
    }

    /// Reads a UTF-8 string with its length.
    pub fn text(&mut self) -> Result<String, UnexpectedEnd> {
        String::from_utf8(self.blob()?.to_vec()).map_err(|_| UnexpectedEnd)
    }

    /// Reads the number of bytes, then returns the bytes without copying them.
    pub fn blob(&mut self) -> Result<&'a [u8], UnexpectedEnd> {
        let count = self.size()?;
        self.take(count)
    }

    /// Reads a flag and, if it is set, a value with `read`.
    pub fn option<T>(
        &mut self,
        read: impl FnOnce(&mut ByteReader<'a>) -> Result<T, UnexpectedEnd>,
    ) -> Result<Option<T>, UnexpectedEnd> {
        if self.flag()? { read(self).map(Some) } else { Ok(None) }
    }

    /// Reads the number of values, then each value with `read`.
    pub fn list<T>(
        &mut self,
        mut read: impl FnMut(&mut ByteReader<'a>) -> Result<T, UnexpectedEnd>,
    ) -> Result<Vec<T>, UnexpectedEnd> {
        let count = self.u64()?;
        // Every value takes at least one byte, so a corrupt count cannot cause a larger allocation than this.
        (0..count.min(self.0.len() as u64 + 1)).map(|_| read(self)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_read_is_what_was_written() {
        let mut w = ByteWriter::default();
        w.f64(f64::NAN);
        w.option(Some("ä"), ByteWriter::text);
        w.option(None, ByteWriter::f64);
        w.list(&[1.0, -0.0], |w, x| w.f64(*x));
        w.vector(DVec3::Y);
        let mut r = ByteReader(w.bytes());
        assert!(r.f64().unwrap().is_nan());
        assert_eq!(r.option(ByteReader::text), Ok(Some("ä".to_owned())));
        assert_eq!(r.option(ByteReader::f64), Ok(None));
        assert_eq!(r.list(ByteReader::f64).unwrap()[1].to_bits(), (-0.0f64).to_bits());
        assert_eq!((r.vector(), r.flag()), (Ok(DVec3::Y), Err(UnexpectedEnd)));
        assert_eq!(ByteReader(&[255; 8]).text(), Err(UnexpectedEnd));
        assert_eq!(ByteReader(&[255; 8]).list(ByteReader::flag), Err(UnexpectedEnd));
    }
}
