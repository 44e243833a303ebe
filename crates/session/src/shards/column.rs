//! Records as columns: one word of every record, bit for bit, as the distance from the least word of the
//! column, in as few bytes as the greatest distance needs. A column whose words are all equal takes none.
//!
//! ```text
//! bytes per distance u8 │ least word u64 │ distances
//! ```

use vlscan_geom::{DVec3, Rotation};

/// A value that is a fixed number of words.
pub(super) trait Words: Copy {
    /// Hands the words to `put`, in order.
    fn put(self, put: &mut impl FnMut(u64));
    /// Makes the value of words that `next` returns in the same order.
    fn take(next: &mut impl FnMut() -> u64) -> Self;
}

/// Implements [`Words`] for numbers.
macro_rules! numbers {
    ($($type:ty: $value:ident => $word:expr, $given:ident => $back:expr;)*) => {$(
        impl Words for $type {
            fn put(self, put: &mut impl FnMut(u64)) {
                let $value = self;
                put($word);
            }

            fn take(next: &mut impl FnMut() -> u64) -> $type {
                let $given = next();
                $back
            }
        }
    )*};
}

numbers! {
    u64: value => value, word => word;
    u32: value => value.into(), word => word as u32;
    usize: value => value as u64, word => word as usize;
    // Words are in the order of the numbers.
    i32: value => (value as u32 ^ 1 << 31).into(), word => (word as u32 ^ 1 << 31) as i32;
    f64: value => value.to_bits(), word => f64::from_bits(word);
}

impl<T: Words> Words for [T; 2] {
    fn put(self, put: &mut impl FnMut(u64)) {
        self.into_iter().for_each(|value| value.put(put));
    }

    fn take(next: &mut impl FnMut() -> u64) -> [T; 2] {
        [T::take(next), T::take(next)]
    }
}

impl<A: Words, B: Words> Words for (A, B) {
    fn put(self, put: &mut impl FnMut(u64)) {
        self.0.put(put);
        self.1.put(put);
    }

    fn take(next: &mut impl FnMut() -> u64) -> (A, B) {
        (A::take(next), B::take(next))
    }
}

/// Implements [`Words`] for structs, field by field; all fields have to be named. `by` names a function that
/// converts a value to the one that is stored and back.
macro_rules! words {
    ($($type:ident $(by $convert:path)? { $($field:ident),+ $(,)? })+) => {$(
        impl $crate::shards::column::Words for $type {
            fn put(self, put: &mut impl FnMut(u64)) {
                let value = self;
                $(let value = $convert(value);)?
                let $type { $($field),+ } = value;
                $($crate::shards::column::Words::put($field, put);)+
            }

            fn take(next: &mut impl FnMut() -> u64) -> $type {
                $(let $field = $crate::shards::column::Words::take(next);)+
                let value = $type { $($field),+ };
                $(let value = $convert(value);)?
                value
            }
        }
    )+};
}
pub(super) use words;

words! {
    DVec3 { x, y, z }
    Rotation { w, u }
}

/// Number of words of a type of records.
fn count<R: Words>() -> usize {
    let mut count = 0;
    R::take(&mut || {
        count += 1;
        0
    });
    count
}

/// Appends the columns of some records; nothing for no records.
pub(super) fn put_records<R: Words>(out: &mut Vec<u8>, records: &[R]) {
    if records.is_empty() {
        return;
    }
    // Columns that are a power of two apart would share few lines of the cache.
    let stride = records.len() | 15;
    let mut words = vec![0; stride * count::<R>()];
    for (row, record) in records.iter().enumerate() {
        let mut at = row;
        record.put(&mut |word| {
            words[at] = word;
            at += stride;
        });
    }
    for column in words.chunks_exact(stride) {
        put_column(out, &column[..records.len()]);
    }
}

/// Reads columns of this many `rows` into `records` and returns the bytes after them; `None` if the bytes are
/// not such columns.
pub(super) fn get_records<'b, R: Words>(
    mut bytes: &'b [u8],
    records: &mut Vec<R>,
    rows: usize,
) -> Option<&'b [u8]> {
    records.clear();
    if rows == 0 {
        return Some(bytes);
    }
    let stride = rows | 15;
    let mut words = vec![0; stride.checked_mul(count::<R>())?];
    for column in words.chunks_exact_mut(stride) {
        bytes = get_column(bytes, &mut column[..rows])?;
    }
    records.extend((0..rows).map(|row| {
        let mut at = row;
        R::take(&mut || {
            let word = words[at];
            at += stride;
            word
        })
    }));
    Some(bytes)
}

/// Calls a function that is generic in a number of bytes from 1 to 8.
macro_rules! of_width {
    ($width:expr, $call:ident($($argument:expr),*)) => {
        match $width {
            1 => $call::<1>($($argument),*),
            2 => $call::<2>($($argument),*),
            3 => $call::<3>($($argument),*),
            4 => $call::<4>($($argument),*),
            5 => $call::<5>($($argument),*),
            6 => $call::<6>($($argument),*),
            7 => $call::<7>($($argument),*),
            _ => $call::<8>($($argument),*),
        }
    };
}

fn put_column(out: &mut Vec<u8>, words: &[u64]) {
    let (least, greatest) =
        words.iter().fold((u64::MAX, 0), |(least, greatest), &word| (word.min(least), word.max(greatest)));
    let width = (u64::BITS - (greatest - least).leading_zeros()).div_ceil(8) as usize;
    out.push(width as u8);
    out.extend(least.to_le_bytes());
    let start = out.len();
    out.resize(start + width * words.len(), 0);
    if width > 0 {
        of_width!(width, put_distances(&mut out[start..], words, least));
    }
}

fn put_distances<const WIDTH: usize>(out: &mut [u8], words: &[u64], least: u64) {
    for (bytes, word) in out.chunks_exact_mut(WIDTH).zip(words) {
        bytes.copy_from_slice(&(word - least).to_le_bytes()[..WIDTH]);
    }
}

fn get_column<'b>(bytes: &'b [u8], words: &mut [u64]) -> Option<&'b [u8]> {
    let (&width, bytes) = bytes.split_first()?;
    let (least, bytes) = bytes.split_first_chunk()?;
    let (width, least) = (usize::from(width), u64::from_le_bytes(*least));
    let (distances, rest) = bytes.split_at_checked(words.len().checked_mul(width)?)?;
    match width {
        0 => words.fill(least),
        1..=8 => of_width!(width, get_distances(distances, words, least)),
        _ => return None,
    }
    Some(rest)
}

fn get_distances<const WIDTH: usize>(bytes: &[u8], words: &mut [u64], least: u64) {
    for (bytes, word) in bytes.chunks_exact(WIDTH).zip(words) {
        let mut distance = [0; 8];
        distance[..WIDTH].copy_from_slice(bytes);
        *word = least.wrapping_add(u64::from_le_bytes(distance));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_take_as_few_bytes_as_their_span_needs() {
        for (values, width) in [
            (vec![7u64, 7, 7], 0),
            (vec![u64::MAX, u64::MAX - 255], 1),
            (vec![1 << 40, (1 << 40) + 256], 2),
            (vec![0, 1 << 23], 3),
            (vec![5, 5 + (1 << 55)], 7),
            (vec![0, u64::MAX], 8),
        ] {
            let mut bytes = vec![1];
            put_records(&mut bytes, &values);
            assert_eq!(bytes.len(), 1 + 9 + width * values.len(), "{values:?}");
            let mut read = vec![3];
            assert_eq!(get_records(&bytes[1..], &mut read, values.len()), Some(&[][..]));
            assert_eq!(read, values);
            assert_eq!(get_records(&bytes[1..bytes.len() - 1], &mut read, values.len()), None);
        }
        let mut bytes = Vec::new();
        let signed = [-3, 0, i32::MAX, i32::MIN];
        put_records(&mut bytes, &signed);
        let mut read: Vec<i32> = Vec::new();
        get_records(&bytes, &mut read, 4).unwrap();
        assert_eq!(read, signed);
        assert_eq!(get_records::<u64>(&[9; 30], &mut Vec::new(), 1), None);
    }
}
