//! A value of each point: in memory as far as the limit allows, the others in temporary files.
//!
//! Parts of equal length go to an unnamed file in the folder for temporary files, and are mapped. The system
//! keeps their bytes in free memory, and drops them where memory is short. If there is no room for a file,
//! the values stay in memory.

use std::io::Write;
use vlscan_base::store::{FileBytes, ScratchFile};

/// Number of values that are encoded at a time.
const ENCODED_VALUES: usize = 1 << 13;

/// A value with a fixed number of bytes.
pub(crate) trait Stored: Copy {
    /// Number of bytes.
    const BYTES: usize;

    /// Appends the bytes.
    fn append_to(self, bytes: &mut Vec<u8>);

    /// The value of the first bytes.
    fn from_bytes(bytes: &[u8]) -> Self;
}

macro_rules! stored {
    ($($number:ty),*) => {$(
        impl Stored for $number {
            const BYTES: usize = size_of::<$number>();

            fn append_to(self, bytes: &mut Vec<u8>) {
                bytes.extend_from_slice(&self.to_le_bytes());
            }

            fn from_bytes(bytes: &[u8]) -> $number {
                let mut value = [0; size_of::<$number>()];
                value.copy_from_slice(&bytes[..Self::BYTES]);
                <$number>::from_le_bytes(value)
            }
        }
    )*};
}

stored!(u8, u16, i32, f32, f64);

impl<T: Stored, const N: usize> Stored for [T; N] {
    const BYTES: usize = N * T::BYTES;

    fn append_to(self, bytes: &mut Vec<u8>) {
        self.into_iter().for_each(|value| value.append_to(bytes));
    }

    fn from_bytes(bytes: &[u8]) -> [T; N] {
        std::array::from_fn(|i| T::from_bytes(&bytes[i * T::BYTES..]))
    }
}

/// Maximum number of values of a column in memory: a power of two.
#[derive(Clone, Copy, Debug)]
pub(crate) struct HeldValues {
    shift: u32,
}

impl HeldValues {
    /// All values.
    pub const ALL: HeldValues = HeldValues { shift: usize::BITS - 1 };

    /// At most this number.
    pub fn at_most(count: usize) -> HeldValues {
        HeldValues { shift: count.max(1).ilog2() }
    }

    fn count(self) -> usize {
        1 << self.shift
    }
}

/// A value of each point, in their order.
#[derive(Debug)]
pub(crate) struct Column<T> {
    /// The first values, each part with as many as may be in memory.
    parts: Vec<FileBytes>,
    /// The file of the next part; `None` if it does not exist yet.
    file: Option<ScratchFile>,
    /// The other values.
    held: Vec<T>,
    max_held: HeldValues,
    /// True if there is no room for temporary files.
    is_kept: bool,
}

impl<T: Clone> Clone for Column<T> {
    /// A copy, whose further parts go to a separate file.
    fn clone(&self) -> Column<T> {
        Column {
            parts: self.parts.clone(),
            file: None,
            held: self.held.clone(),
            max_held: self.max_held,
            is_kept: self.is_kept,
        }
    }
}

impl<T: Stored> Column<T> {
    /// No values yet.
    pub fn new(max_held: HeldValues) -> Column<T> {
        Column { parts: Vec::new(), file: None, held: Vec::new(), max_held, is_kept: false }
    }

    /// Maximum number of values in memory.
    pub fn max_held(&self) -> HeldValues {
        self.max_held
    }

    /// Number of values.
    pub fn len(&self) -> usize {
        self.parts.len() * self.max_held.count() + self.held.len()
    }

    /// True without values.
    pub fn is_empty(&self) -> bool {
        self.parts.is_empty() && self.held.is_empty()
    }

    /// The value of an index; `None` beyond the last.
    pub fn get(&self, index: usize) -> Option<T> {
        (index < self.len()).then(|| self.at(index))
    }

    /// The value of an index below their number.
    pub fn at(&self, index: usize) -> T {
        let within = index & (self.max_held.count() - 1);
        match self.parts.get(index >> self.max_held.shift) {
            Some(part) => T::from_bytes(&part[within * T::BYTES..]),
            None => self.held[index - self.parts.len() * self.max_held.count()],
        }
    }

    /// All values.
    pub fn iter(&self) -> impl Iterator<Item = T> + Clone + '_ {
        // Part by part, since finding the part of each value takes longer than reading it.
        let in_files = self.parts.iter().flat_map(|part| part.chunks_exact(T::BYTES).map(T::from_bytes));
        in_files.chain(self.held.iter().copied())
    }

    /// Adds a value.
    pub fn push(&mut self, value: T) {
        if self.held.len() >= self.max_held.count() && !self.is_kept {
            match self.written() {
                Some(part) => {
                    self.parts.push(part);
                    self.held.clear();
                }
                None => self.is_kept = true,
            }
        }
        self.held.push(value);
    }

    /// Adds values.
    pub fn extend(&mut self, values: impl Iterator<Item = T>) {
        let mut values = values.peekable();
        while values.peek().is_some() {
            // This one starts a part if the last is full; then as many follow as have room in it.
            values.next().into_iter().for_each(|value| self.push(value));
            let room = match self.is_kept {
                true => usize::MAX,
                false => self.max_held.count().saturating_sub(self.held.len()),
            };
            self.held.extend(values.by_ref().take(room));
        }
    }

    /// Adds a value until there are `len`.
    pub fn fill(&mut self, len: usize, value: T) {
        (self.len()..len).for_each(|_| self.push(value));
    }

    /// The values in memory, as many as may be there, in a temporary file; `None` if there is no room.
    fn written(&mut self) -> Option<FileBytes> {
        let held = &self.held;
        let write = |out: &mut dyn Write| {
            let mut bytes = Vec::with_capacity(ENCODED_VALUES * T::BYTES);
            held.chunks(ENCODED_VALUES).try_for_each(|values| {
                bytes.clear();
                values.iter().for_each(|value| value.append_to(&mut bytes));
                out.write_all(&bytes)
            })
        };
        if self.file.is_none() {
            self.file = ScratchFile::create().ok();
        }
        let part = self.file.as_mut()?.append(write).ok()?;
        (part.len() == held.len() * T::BYTES).then_some(part)
    }

    /// Keeps the values whose index is chosen.
    pub fn retain(&mut self, mut is_kept: impl FnMut(usize) -> bool) {
        if self.parts.is_empty() {
            let mut index = 0;
            self.held.retain(|_| {
                index += 1;
                is_kept(index - 1)
            });
            return;
        }
        let mut kept = Column { is_kept: self.is_kept, ..Column::new(self.max_held) };
        (0..self.len()).filter(|index| is_kept(*index)).for_each(|index| kept.push(self.at(index)));
        *self = kept;
    }

    /// Keeps every second value.
    pub fn halve(&mut self) {
        self.retain(|index| index.is_multiple_of(2));
    }

    /// Releases the memory of the values in files, which is taken again when they are used.
    pub fn release(&self) {
        self.parts.iter().for_each(|part| part.release(0..part.len()));
    }
}

#[cfg(test)]
impl<T: Stored> Column<T> {
    pub fn to_vec(&self) -> Vec<T> {
        self.iter().collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn column<T: Stored>(values: &[T], most: usize) -> Column<T> {
        let mut column = Column::new(HeldValues::at_most(most));
        values.iter().for_each(|value| column.push(*value));
        column
    }

    #[test]
    fn values_are_the_same_in_memory_and_in_files() {
        let values: Vec<[f64; 3]> =
            (0..1000).map(|i| [f64::from(i), -0.0, f64::NAN].map(|v| v / 3.0)).collect();
        let bits =
            |values: Vec<[f64; 3]>| values.into_iter().map(|v| v.map(f64::to_bits)).collect::<Vec<_>>();
        for most in [1, 7, 64, 1000, usize::MAX] {
            let column = column(&values, most);
            assert_eq!((column.len(), column.is_empty()), (1000, false), "{most}");
            assert_eq!(column.parts.is_empty(), most > 1000, "{most}");
            column.release();
            assert_eq!(bits(column.to_vec()), bits(values.clone()), "{most}");
            assert!(column.get(1000).is_none() && column.get(999).is_some());
        }
        assert!(column::<u8>(&[], 4).is_empty());
    }

    #[test]
    fn values_are_left_out_wherever_they_are() {
        let values: Vec<u16> = (0..300).collect();
        for most in [4, 100, 400] {
            let mut column = column(&values, most);
            column.halve();
            assert_eq!(column.to_vec(), values.iter().copied().step_by(2).collect::<Vec<_>>(), "{most}");
            column.retain(|index| index % 50 == 49);
            assert_eq!(column.to_vec(), [98, 198, 298], "{most}");
            column.fill(5, 7);
            column.push(8);
            assert_eq!(column.to_vec(), [98, 198, 298, 7, 7, 8], "{most}");
        }
    }
}
