//! A `Vec` or a part of a mapped file.

use bytemuck::AnyBitPattern;
use memmap2::Mmap;
use std::ops::{Deref, DerefMut, Range};
use std::ptr::NonNull;
use std::sync::Arc;

/// An array that is held in memory or stands in a mapped file. It is read as a slice; whoever changes it gets a copy in
/// memory first, which for a held one is the array itself.
pub struct Store<T>(Place<T>);

enum Place<T> {
    Held(Vec<T>),
    Mapped(Mapped<T>),
}

/// `len` values at `first`, which lie within `file`.
struct Mapped<T> {
    first: NonNull<T>,
    len: usize,
    file: Arc<Mmap>,
}

// SAFETY: a mapped array is only read, through `&self`, and the map that it points into is kept alive by the counted
// reference beside it, which may itself be sent and shared.
unsafe impl<T: Sync> Send for Mapped<T> {}
// SAFETY: as above.
unsafe impl<T: Sync> Sync for Mapped<T> {}

impl<T> Store<T> {
    /// Nothing.
    pub const fn new() -> Store<T> {
        Store(Place::Held(Vec::new()))
    }
}

impl<T: AnyBitPattern> Store<T> {
    /// The bytes `at` of a file as values. `None` unless they lie within it, aligned, and are a whole number of values.
    pub(super) fn mapped(file: &Arc<Mmap>, at: Range<usize>) -> Option<Store<T>> {
        let values: &[T] = bytemuck::try_cast_slice(file.get(at)?).ok()?;
        if values.is_empty() {
            return Some(Store::new());
        }
        let first = NonNull::from(&values[0]);
        Some(Store(Place::Mapped(Mapped { first, len: values.len(), file: file.clone() })))
    }
}

impl<T> Deref for Store<T> {
    type Target = [T];

    #[inline(always)]
    fn deref(&self) -> &[T] {
        match &self.0 {
            Place::Held(values) => values,
            // SAFETY: `mapped` took place and length from a slice of such values in the file, every bit pattern of which
            // is one, and the file stays mapped as long as `self` lives. The map is read-only and private to this
            // process; another program that shortens or rewrites the file meanwhile is outside of what any reader of
            // mapped files can guard against.
            Place::Mapped(m) => unsafe { std::slice::from_raw_parts(m.first.as_ptr(), m.len) },
        }
    }
}

impl<T: Clone> DerefMut for Store<T> {
    fn deref_mut(&mut self) -> &mut [T] {
        self.to_mut()
    }
}

impl<T: Clone> Store<T> {
    /// The array in memory.
    pub fn to_mut(&mut self) -> &mut Vec<T> {
        if let Place::Mapped(_) = self.0 {
            self.0 = Place::Held(self.to_vec());
        }
        match &mut self.0 {
            Place::Held(values) => values,
            Place::Mapped(_) => unreachable!("it was copied just now"),
        }
    }

    /// As of a `Vec`.
    pub fn push(&mut self, value: T) {
        self.to_mut().push(value);
    }

    /// As of a `Vec`.
    pub fn extend(&mut self, values: impl IntoIterator<Item = T>) {
        self.to_mut().extend(values);
    }

    /// As of a `Vec`.
    pub fn append(&mut self, values: &mut Vec<T>) {
        self.to_mut().append(values);
    }

    /// As of a `Vec`.
    pub fn truncate(&mut self, len: usize) {
        self.to_mut().truncate(len);
    }

    /// As of a `Vec`.
    pub fn split_off(&mut self, at: usize) -> Vec<T> {
        self.to_mut().split_off(at)
    }
}

impl<T> Store<T> {
    /// Bytes of memory that are held; none for a mapped array, whose pages the system takes back when it needs them.
    pub fn memory(&self) -> usize {
        match &self.0 {
            Place::Held(values) => values.capacity() * size_of::<T>(),
            Place::Mapped(_) => 0,
        }
    }
}

impl<T: Clone> Clone for Store<T> {
    fn clone(&self) -> Store<T> {
        Store(match &self.0 {
            Place::Held(values) => Place::Held(values.clone()),
            Place::Mapped(m) => Place::Mapped(Mapped { file: m.file.clone(), ..*m }),
        })
    }
}

impl<T> Default for Store<T> {
    fn default() -> Store<T> {
        Store::new()
    }
}

impl<T> From<Vec<T>> for Store<T> {
    fn from(values: Vec<T>) -> Store<T> {
        Store(Place::Held(values))
    }
}

impl<T> FromIterator<T> for Store<T> {
    fn from_iter<I: IntoIterator<Item = T>>(values: I) -> Store<T> {
        Store::from(Vec::from_iter(values))
    }
}

impl<T: std::fmt::Debug> std::fmt::Debug for Store<T> {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        self.deref().fmt(f)
    }
}

impl<T: PartialEq> PartialEq for Store<T> {
    fn eq(&self, other: &Store<T>) -> bool {
        **self == **other
    }
}

impl<T: PartialEq> PartialEq<Vec<T>> for Store<T> {
    fn eq(&self, other: &Vec<T>) -> bool {
        **self == **other
    }
}

impl<T: PartialEq, const N: usize> PartialEq<[T; N]> for Store<T> {
    fn eq(&self, other: &[T; N]) -> bool {
        **self == *other
    }
}

impl<'a, T> IntoIterator for &'a Store<T> {
    type Item = &'a T;
    type IntoIter = std::slice::Iter<'a, T>;

    fn into_iter(self) -> std::slice::Iter<'a, T> {
        self.iter()
    }
}

impl<'a, T: Clone> IntoIterator for &'a mut Store<T> {
    type Item = &'a mut T;
    type IntoIter = std::slice::IterMut<'a, T>;

    fn into_iter(self) -> std::slice::IterMut<'a, T> {
        self.to_mut().iter_mut()
    }
}
