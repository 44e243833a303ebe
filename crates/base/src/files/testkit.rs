//! Helpers for tests of files, also in other crates.

use std::fs;
use std::path::Path;

/// Sorted names in a folder.
///
/// # Panics
/// If the folder cannot be read or has names that are not Unicode.
pub fn names(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).unwrap();
    let mut names: Vec<String> =
        entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}
