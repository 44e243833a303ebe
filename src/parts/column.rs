//! Columns: one value of every record, little-endian and bit for bit. A column whose values are all equal is stored as one
//! value.

use crate::geom::{DVec3, Rotation};

/// A column's values follow.
const VALUES: u8 = 0;
/// One value follows, that of every record.
const CONSTANT: u8 = 1;

/// A value of a fixed number of bytes.
pub(super) trait Value: Copy {
    const BYTES: usize;
    fn put(self, out: &mut Vec<u8>);
    /// Reads the value from exactly [`Value::BYTES`] bytes.
    fn get(bytes: &[u8]) -> Self;
    fn has_bits_of(self, other: Self) -> bool;
}

macro_rules! integers {
    ($($type:ty),*) => {$(
        impl Value for $type {
            const BYTES: usize = size_of::<$type>();

            fn put(self, out: &mut Vec<u8>) {
                out.extend_from_slice(&self.to_le_bytes());
            }

            fn get(bytes: &[u8]) -> $type {
                let mut value = [0; size_of::<$type>()];
                value.copy_from_slice(bytes);
                <$type>::from_le_bytes(value)
            }

            fn has_bits_of(self, other: $type) -> bool {
                self == other
            }
        }
    )*};
}

integers!(u32, u64, i32);

impl Value for f64 {
    const BYTES: usize = 8;

    fn put(self, out: &mut Vec<u8>) {
        self.to_bits().put(out);
    }

    fn get(bytes: &[u8]) -> f64 {
        f64::from_bits(u64::get(bytes))
    }

    fn has_bits_of(self, other: f64) -> bool {
        self.to_bits() == other.to_bits()
    }
}

impl Value for usize {
    const BYTES: usize = 8;

    fn put(self, out: &mut Vec<u8>) {
        (self as u64).put(out);
    }

    fn get(bytes: &[u8]) -> usize {
        u64::get(bytes) as usize
    }

    fn has_bits_of(self, other: usize) -> bool {
        self == other
    }
}

impl Value for DVec3 {
    const BYTES: usize = 24;

    fn put(self, out: &mut Vec<u8>) {
        self.to_array().into_iter().for_each(|x| x.put(out));
    }

    fn get(bytes: &[u8]) -> DVec3 {
        DVec3::new(f64::get(&bytes[..8]), f64::get(&bytes[8..16]), f64::get(&bytes[16..24]))
    }

    fn has_bits_of(self, other: DVec3) -> bool {
        self.to_array().into_iter().zip(other.to_array()).all(|(a, b)| a.has_bits_of(b))
    }
}

impl Value for Rotation {
    const BYTES: usize = 32;

    fn put(self, out: &mut Vec<u8>) {
        self.w.put(out);
        self.u.put(out);
    }

    fn get(bytes: &[u8]) -> Rotation {
        Rotation { w: f64::get(&bytes[..8]), u: DVec3::get(&bytes[8..32]) }
    }

    fn has_bits_of(self, other: Rotation) -> bool {
        self.w.has_bits_of(other.w) && self.u.has_bits_of(other.u)
    }
}

/// Appends a column; nothing for no records.
pub(super) fn put_column<R, V: Value>(out: &mut Vec<u8>, records: &[R], value: impl Fn(&R) -> V) {
    let Some(first) = records.first().map(&value) else { return };
    if records.iter().all(|record| value(record).has_bits_of(first)) {
        out.push(CONSTANT);
        return first.put(out);
    }
    out.push(VALUES);
    out.reserve(records.len() * V::BYTES);
    records.iter().for_each(|record| value(record).put(out));
}

/// Reads a column into the records and returns the bytes after it; `None` if the bytes are no such column.
pub(super) fn get_column<'b, R, V: Value>(
    bytes: &'b [u8],
    records: &mut [R],
    set: impl Fn(&mut R, V),
) -> Option<&'b [u8]> {
    if records.is_empty() {
        return Some(bytes);
    }
    let (&kind, bytes) = bytes.split_first()?;
    let count = match kind {
        VALUES => records.len(),
        CONSTANT => 1,
        _ => return None,
    };
    let (values, rest) = bytes.split_at_checked(count.checked_mul(V::BYTES)?)?;
    if kind == CONSTANT {
        let value = V::get(values);
        records.iter_mut().for_each(|record| set(record, value));
    } else {
        let values = values.chunks_exact(V::BYTES);
        records.iter_mut().zip(values).for_each(|(record, value)| set(record, V::get(value)));
    }
    Some(rest)
}

/// Defines the columns of a type of records: a function that appends them and one that reads them.
macro_rules! columns {
    ($put:ident, $get:ident, $type:ty, [$({ $($path:tt)+ })+]) => {
        fn $put(out: &mut Vec<u8>, records: &[$type]) {
            $($crate::parts::column::put_column(out, records, |record| record $($path)+);)+
        }

        fn $get<'b>(bytes: &'b [u8], records: &mut [$type]) -> Option<&'b [u8]> {
            $(let bytes = $crate::parts::column::get_column(bytes, records, |record, value| record $($path)+ = value)?;)+
            Some(bytes)
        }
    };
}
pub(super) use columns;
