//! Extra dimensions of the points (LAS 1.4, extra bytes): their place in a record, type, scale, offset and
//! no-data value.

use std::ops::Range;

/// Bytes of a descriptor.
const DESCRIPTOR_BYTES: usize = 192;

/// Bits of the options of a descriptor: which of its fields count.
const HAS_NO_DATA: u8 = 1;
const HAS_SCALE: u8 = 8;
const HAS_OFFSET: u8 = 16;

/// An extra dimension.
#[derive(Clone, Copy, Debug)]
pub struct ExtraDimension {
    /// Offset in a record, bytes.
    offset: usize,
    kind: u8,
    scale: f64,
    shift: f64,
    /// Before scale and offset.
    no_data: Option<f64>,
    /// True if the file states a scale or an offset that cannot be used.
    is_rescaled: bool,
}

/// The dimensions in the data of the record of extra bytes, with their names; `offset` is that of the first
/// one in a record.
pub(super) fn dimensions(descriptors: &[u8], mut offset: usize) -> Vec<(String, ExtraDimension)> {
    let dimension = |descriptor: &[u8]| {
        let (kind, options) = (descriptor[2], descriptor[3]);
        let name = descriptor[4..36].split(|&b| b == 0).next().unwrap_or_default();
        let bytes = |at: usize| -> [u8; 8] { std::array::from_fn(|i| descriptor[at + i]) };
        let double =
            |at: usize, flag: u8| (options & flag != 0 && kind != 0).then(|| f64::from_le_bytes(bytes(at)));
        let no_data = (options & HAS_NO_DATA != 0).then(|| widened(kind, bytes(40))).flatten();
        let (scale, shift) = (double(112, HAS_SCALE), double(136, HAS_OFFSET));
        // A scale of 0 would leave nothing of the values.
        let usable_scale = scale.filter(|scale| *scale != 0.0 && scale.is_finite());
        let usable_shift = shift.filter(|shift| shift.is_finite());
        let dimension = ExtraDimension {
            offset,
            kind,
            scale: usable_scale.unwrap_or(1.0),
            shift: usable_shift.unwrap_or(0.0),
            no_data,
            is_rescaled: usable_scale.is_some() != scale.is_some()
                || usable_shift.is_some() != shift.is_some(),
        };
        // Type 0 is a sequence of bytes whose length is in the options.
        offset += if kind == 0 { usize::from(options) } else { size_of_kind(kind) };
        (String::from_utf8_lossy(name).into_owned(), dimension)
    };
    descriptors.chunks_exact(DESCRIPTOR_BYTES).map(dimension).collect()
}

impl ExtraDimension {
    /// True if the dimension is a single number.
    pub fn is_number(self) -> bool {
        (1..=10).contains(&self.kind)
    }

    /// Offsets of its bytes in a record.
    pub(super) fn bytes(self) -> Range<usize> {
        self.offset..self.offset + size_of_kind(self.kind)
    }

    /// True if the file states a scale or an offset that cannot be used: 1 and 0 are used instead.
    pub fn is_rescaled(self) -> bool {
        self.is_rescaled
    }

    /// Its value in a record, with scale and offset; `None` if it is the no-data value or not a single
    /// number.
    pub fn value(self, record: &[u8]) -> Option<f64> {
        let bytes = record.get(self.bytes())?;
        let raw = match self.kind {
            1 => f64::from(bytes[0]),
            2 => f64::from(bytes[0] as i8),
            3 => f64::from(u16::from_le_bytes(bytes.try_into().ok()?)),
            4 => f64::from(i16::from_le_bytes(bytes.try_into().ok()?)),
            5 => f64::from(u32::from_le_bytes(bytes.try_into().ok()?)),
            6 => f64::from(i32::from_le_bytes(bytes.try_into().ok()?)),
            7 => u64::from_le_bytes(bytes.try_into().ok()?) as f64,
            8 => i64::from_le_bytes(bytes.try_into().ok()?) as f64,
            9 => f64::from(f32::from_le_bytes(bytes.try_into().ok()?)),
            10 => f64::from_le_bytes(bytes.try_into().ok()?),
            _ => return None,
        };
        let is_none = self.no_data.is_some_and(|none| raw == none || (none.is_nan() && raw.is_nan()));
        (!is_none).then_some(raw * self.scale + self.shift)
    }
}

/// A value of a descriptor, which is stored as the widest type of its kind.
fn widened(kind: u8, bytes: [u8; 8]) -> Option<f64> {
    match kind {
        1 | 3 | 5 | 7 => Some(u64::from_le_bytes(bytes) as f64),
        2 | 4 | 6 | 8 => Some(i64::from_le_bytes(bytes) as f64),
        9 | 10 => Some(f64::from_le_bytes(bytes)),
        _ => None,
    }
}

/// Size of an extra-bytes data type, bytes (LAS 1.4 table 24); types 11 to 30 are the first ten as arrays of
/// two and three.
fn size_of_kind(kind: u8) -> usize {
    const SIZES: [usize; 10] = [1, 1, 2, 2, 4, 4, 8, 8, 4, 8];
    match kind {
        1..=30 => SIZES[usize::from((kind - 1) % 10)] * (1 + usize::from((kind - 1) / 10)),
        _ => 0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_type_has_its_place_scale_offset_and_value_for_none() {
        let mut descriptors = Vec::new();
        let mut record = Vec::new();
        let mut expected = Vec::new();
        for kind in 0..=30u8 {
            let mut descriptor = [0; DESCRIPTOR_BYTES];
            descriptor[2] = kind;
            descriptor[3] = if kind == 0 { 5 } else { HAS_SCALE | HAS_OFFSET | HAS_NO_DATA };
            descriptor[4] = b'a' + kind;
            descriptor[112..120].copy_from_slice(&0.5f64.to_le_bytes());
            descriptor[136..144].copy_from_slice(&10f64.to_le_bytes());
            // 7 stands for none.
            let none = if kind < 9 { 7u64.to_le_bytes() } else { 7f64.to_le_bytes() };
            descriptor[40..48].copy_from_slice(&none);
            descriptors.extend_from_slice(&descriptor);
            let size = if kind == 0 { 5 } else { size_of_kind(kind) };
            let value = match kind {
                9 => 4f32.to_le_bytes().to_vec(),
                10 => 4f64.to_le_bytes().to_vec(),
                _ => [vec![4], vec![0; size - 1]].concat(),
            };
            assert_eq!(value.len(), size);
            record.extend(value);
            expected.push((1..=10).contains(&kind).then_some(12.0));
        }
        let all = dimensions(&descriptors, 0);
        assert_eq!(all.iter().map(|(_, d)| d.value(&record)).collect::<Vec<_>>(), expected);
        assert_eq!((all[2].0.as_str(), all[10].1.is_number(), all[11].1.is_number()), ("c", true, false));
        let sizes: Vec<usize> = all.iter().map(|(_, d)| d.offset).collect();
        assert_eq!((sizes[11], sizes[21], sizes[30]), (5 + 42, 5 + 42 + 84, 5 + 42 + 84 + 126 - 24));
        let seven = [vec![0; 5], vec![7]].concat();
        assert_eq!(all[1].1.value(&seven), None, "the value for none");
    }
}
