//! Memory of vectors.

/// Memory that a vector holds, bytes.
pub(crate) fn vec_bytes<T>(values: &Vec<T>) -> usize {
    values.capacity() * size_of::<T>()
}
