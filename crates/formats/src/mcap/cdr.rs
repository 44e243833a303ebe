//! Messages of ROS 2 as CDR: little-endian, each value aligned to its size, after the four bytes of the
//! encapsulation.

use vlscan_geom::{DVec3, Rotation};

/// Bytes before the values, which alignment does not count.
const ENCAPSULATION: [u8; 4] = [0, 1, 0, 0];

/// A message that is being written.
pub struct CdrWriter(pub Vec<u8>);

impl CdrWriter {
    pub fn new() -> CdrWriter {
        CdrWriter(ENCAPSULATION.to_vec())
    }

    fn align(&mut self, size: usize) {
        let values = self.0.len() - ENCAPSULATION.len();
        self.0.resize(values.next_multiple_of(size) + ENCAPSULATION.len(), 0);
    }

    pub fn byte(&mut self, value: u8) {
        self.0.push(value);
    }

    pub fn word(&mut self, value: u32) {
        self.align(4);
        self.0.extend(value.to_le_bytes());
    }

    pub fn double(&mut self, value: f64) {
        self.align(8);
        self.0.extend(value.to_le_bytes());
    }

    pub fn string(&mut self, text: &str) {
        self.word(text.len() as u32 + 1);
        self.0.extend(text.as_bytes());
        self.0.push(0);
    }

    /// `std_msgs/Header`.
    pub fn header(&mut self, stamp_ns: u64, frame: &str) {
        self.word((stamp_ns / 1_000_000_000) as u32);
        self.word((stamp_ns % 1_000_000_000) as u32);
        self.string(frame);
    }

    /// `geometry_msgs/Vector3` and `Point`.
    pub fn vector(&mut self, v: DVec3) {
        v.to_array().into_iter().for_each(|c| self.double(c));
    }

    /// `geometry_msgs/Quaternion`.
    pub fn rotation(&mut self, r: Rotation) {
        self.vector(r.u);
        self.double(r.w);
    }
}

/// A message that is being read; `None` where it ends too early.
pub struct CdrReader<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl<'a> CdrReader<'a> {
    /// `None` for bytes of another encapsulation.
    pub fn new(bytes: &'a [u8]) -> Option<CdrReader<'a>> {
        Some(CdrReader { bytes: bytes.strip_prefix(&ENCAPSULATION)?, at: 0 })
    }

    pub fn take(&mut self, count: usize) -> Option<&'a [u8]> {
        let end = self.at.checked_add(count)?;
        let found = self.bytes.get(self.at..end)?;
        self.at = end;
        Some(found)
    }

    fn aligned<const N: usize>(&mut self) -> Option<[u8; N]> {
        self.at = self.at.next_multiple_of(N);
        self.take(N)?.try_into().ok()
    }

    pub fn byte(&mut self) -> Option<u8> {
        self.aligned::<1>().map(|[byte]| byte)
    }

    pub fn word(&mut self) -> Option<u32> {
        self.aligned().map(u32::from_le_bytes)
    }

    fn double(&mut self) -> Option<f64> {
        self.aligned().map(f64::from_le_bytes)
    }

    pub fn string(&mut self) -> Option<&'a str> {
        let length = self.word()? as usize;
        std::str::from_utf8(self.take(length)?.strip_suffix(&[0])?).ok()
    }

    /// Time and frame of a header.
    pub fn header(&mut self) -> Option<(u64, &'a str)> {
        let (seconds, nanoseconds) = (self.word()?, self.word()?);
        Some((u64::from(seconds) * 1_000_000_000 + u64::from(nanoseconds), self.string()?))
    }

    pub fn vector(&mut self) -> Option<DVec3> {
        Some(DVec3::new(self.double()?, self.double()?, self.double()?))
    }

    pub fn rotation(&mut self) -> Option<Rotation> {
        let u = self.vector()?;
        Some(Rotation { u, w: self.double()? })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_aligned_and_read_back() {
        let mut out = CdrWriter::new();
        out.header(3_000_000_007, "lidar");
        out.vector(DVec3::new(1.0, 2.0, 3.0));
        out.byte(7);
        out.rotation(Rotation::IDENTITY);
        // Two words, a length, six letters, and the padding of the first double.
        assert_eq!((&out.0[16..22], out.0[4 + 24..][..8] == 1f64.to_le_bytes()), (&b"lidar\0"[..], true));
        let mut back = CdrReader::new(&out.0).unwrap();
        assert_eq!(back.header(), Some((3_000_000_007, "lidar")));
        assert_eq!(back.vector(), Some(DVec3::new(1.0, 2.0, 3.0)));
        assert_eq!((back.byte(), back.rotation(), back.word()), (Some(7), Some(Rotation::IDENTITY), None));
    }
}
