//! Columns: one value of every record, little-endian and bit for bit. A column whose values are all equal is stored as one
//! value, one of whole numbers as their distances from the least, in as few bytes as these need.

use vlscan_geom::{DVec3, Rotation};

/// A column's values follow.
const VALUES: u8 = 0;
/// One value follows, that of every record.
const CONSTANT: u8 = 1;
/// The least value follows, and the distances of all values from it in 1, 2 or 4 bytes.
const DISTANCES_OF_1: u8 = 2;
const DISTANCES_OF_2: u8 = 3;
const DISTANCES_OF_4: u8 = 4;

/// A value of a fixed number of bytes.
pub(super) trait Value: Copy {
    const BYTES: usize;
    fn put(self, out: &mut Vec<u8>);
    /// Reads the value from exactly [`Value::BYTES`] bytes.
    fn get(bytes: &[u8]) -> Self;
    fn has_bits_of(self, other: Self) -> bool;
    /// The least of some values and the distance to the greatest, if they are whole numbers.
    fn span(_values: impl Iterator<Item = Self>) -> Option<(Self, u64)> {
        None
    }
    /// The distance from a lesser whole number.
    fn distance_from(self, _least: Self) -> u64 {
        0
    }
    /// The whole number at a distance above.
    fn plus(self, _distance: u64) -> Self {
        self
    }
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

            fn span(values: impl Iterator<Item = $type>) -> Option<($type, u64)> {
                let (least, greatest) = values.fold((<$type>::MAX, <$type>::MIN), |(a, b), v| (a.min(v), b.max(v)));
                Some((least, greatest.distance_from(least)))
            }

            fn distance_from(self, least: $type) -> u64 {
                // The difference modulo 2⁶⁴, which is the distance also where that overflows an `i32`.
                (self as u64).wrapping_sub(least as u64)
            }

            fn plus(self, distance: u64) -> $type {
                self.wrapping_add(distance as $type)
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
    if let Some((least, span)) = V::span(records.iter().map(&value)) {
        let distances = records.iter().map(|record| value(record).distance_from(least));
        let mut begin = |kind: u8| {
            out.push(kind);
            least.put(out);
        };
        if span <= u64::from(u8::MAX) {
            begin(DISTANCES_OF_1);
            return out.extend(distances.map(|distance| distance as u8));
        }
        if span <= u64::from(u16::MAX) && V::BYTES > 2 {
            begin(DISTANCES_OF_2);
            return out.extend(distances.flat_map(|distance| (distance as u16).to_le_bytes()));
        }
        if span <= u64::from(u32::MAX) && V::BYTES > 4 {
            begin(DISTANCES_OF_4);
            return out.extend(distances.flat_map(|distance| (distance as u32).to_le_bytes()));
        }
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
    let width = match kind {
        VALUES => {
            let (values, rest) = bytes.split_at_checked(records.len().checked_mul(V::BYTES)?)?;
            let values = values.chunks_exact(V::BYTES);
            records.iter_mut().zip(values).for_each(|(record, value)| set(record, V::get(value)));
            return Some(rest);
        }
        CONSTANT => 0,
        DISTANCES_OF_1 => 1,
        DISTANCES_OF_2 => 2,
        DISTANCES_OF_4 => 4,
        _ => return None,
    };
    let (least, bytes) = bytes.split_at_checked(V::BYTES)?;
    let least = V::get(least);
    let (distances, rest) = bytes.split_at_checked(records.len().checked_mul(width)?)?;
    match width {
        0 => records.iter_mut().for_each(|record| set(record, least)),
        1 => fill(records, least, distances.iter().map(|byte| u64::from(*byte)), set),
        2 => fill(
            records,
            least,
            distances.chunks_exact(2).map(|b| u16::from_le_bytes([b[0], b[1]]).into()),
            set,
        ),
        _ => fill(records, least, distances.chunks_exact(4).map(|b| u32::get(b).into()), set),
    }
    Some(rest)
}

/// Sets the values at these distances from the least.
fn fill<R, V: Value>(
    records: &mut [R],
    least: V,
    distances: impl Iterator<Item = u64>,
    set: impl Fn(&mut R, V),
) {
    records.iter_mut().zip(distances).for_each(|(record, distance)| set(record, least.plus(distance)));
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
