//! An array in memory or in a mapped file.

use super::mapped::{FileBytes, MappedArray};
use bytemuck::AnyBitPattern;
use std::ops::{Deref, DerefMut, Range};
use std::sync::Arc;

/// An array in memory or in a mapped file, read as a slice. Changing a mapped array first copies it into memory.
#[derive(Clone)]
pub struct Store<T>(Data<T>);

#[derive(Clone)]
enum Data<T> {
    Owned(Vec<T>),
    Mapped(MappedArray<T>),
}

impl<T> Store<T> {
    pub const fn new() -> Store<T> {
        Store(Data::Owned(Vec::new()))
    }

    /// Bytes of memory held; 0 for a mapped array, whose pages the system can evict at any time.
    pub fn memory(&self) -> usize {
        match &self.0 {
            Data::Owned(values) => values.capacity() * size_of::<T>(),
            Data::Mapped(_) => 0,
        }
    }
}

impl<T: AnyBitPattern> Store<T> {
    /// Interprets the bytes `at` of a file as values. `None` unless the range lies within the file, is aligned, and has
    /// a multiple of the size of `T`.
    pub(super) fn mapped(file: &Arc<FileBytes>, at: Range<usize>) -> Option<Store<T>> {
        MappedArray::new(file, at).map(|values| Store(Data::Mapped(values)))
    }
}

impl<T> Deref for Store<T> {
    type Target = [T];

    #[inline(always)]
    fn deref(&self) -> &[T] {
        match &self.0 {
            Data::Owned(values) => values,
            Data::Mapped(values) => values,
        }
    }
}

impl<T: Clone> DerefMut for Store<T> {
    fn deref_mut(&mut self) -> &mut [T] {
        self.to_mut()
    }
}

impl<T: Clone> Store<T> {
    /// The array as a mutable vector; a mapped array is copied into memory first.
    pub fn to_mut(&mut self) -> &mut Vec<T> {
        if let Data::Mapped(_) = self.0 {
            self.0 = Data::Owned(self.to_vec());
        }
        match &mut self.0 {
            Data::Owned(values) => values,
            Data::Mapped(_) => unreachable!("it has just been copied"),
        }
    }

    pub fn push(&mut self, value: T) {
        self.to_mut().push(value);
    }

    pub fn extend(&mut self, values: impl IntoIterator<Item = T>) {
        self.to_mut().extend(values);
    }

    pub fn append(&mut self, values: &mut Vec<T>) {
        self.to_mut().append(values);
    }

    pub fn truncate(&mut self, len: usize) {
        self.to_mut().truncate(len);
    }

    pub fn split_off(&mut self, at: usize) -> Vec<T> {
        self.to_mut().split_off(at)
    }
}

impl<T> Default for Store<T> {
    fn default() -> Store<T> {
        Store::new()
    }
}

impl<T> From<Vec<T>> for Store<T> {
    fn from(values: Vec<T>) -> Store<T> {
        Store(Data::Owned(values))
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
