//! Files that campaigns have written for a cell, the only ones that they remove.

use super::record::Record;
use super::store::RECORD;
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Component, Path, PathBuf};
use vlscan_base::error::{Error, Result};
use vlscan_base::files::{Stamp, reads};

/// The note of the files that were written for a cell, in addition to the record in its folder. The note
/// identifies the files if the record is damaged, and contains the sizes and times that they had when their
/// checksums were verified.
#[derive(Debug)]
pub(super) struct Made {
    pub record: Record,
    /// By the paths in the record.
    pub stamps: BTreeMap<String, Stamp>,
}

impl Made {
    /// The note of a record whose files `place` finds.
    pub fn of(record: &Record, place: impl Fn(&str) -> PathBuf) -> Made {
        let stamps =
            record.files.iter().filter_map(|file| Some((file.path.clone(), stamp(&place(&file.path))?)));
        Made { record: record.clone(), stamps: stamps.collect() }
    }

    /// Reads a note; `None` unless there is one whose record is unmodified.
    pub fn read(path: &Path) -> Option<Made> {
        let text = reads::read_own(path).ok()?;
        let mut lines = text.split_inclusive(|byte| *byte == b'\n');
        let record = Record::parse(lines.next()?)?;
        let stamps = lines.next().and_then(|line| serde_json::from_slice(line).ok()).unwrap_or_default();
        Some(Made { record, stamps })
    }

    /// The note as text.
    ///
    /// # Errors
    /// [`Error::Internal`] for numbers that JSON has not.
    pub fn text(&self) -> Result<String> {
        let stamps = serde_json::to_string(&self.stamps);
        let stamps = stamps.map_err(|e| Error::Internal(format!("sizes and times of files: {e}")))?;
        Ok(self.record.line()? + &stamps + "\n")
    }
}

/// Advice about something in the place of one of a campaign's files.
pub(super) fn moved(path: &Path) -> String {
    format!("move it to another folder (mv '{}' FOLDER), then start the campaign again", path.display())
}

/// True if a folder holds a note.
pub(super) fn is_in(folder: &Path) -> bool {
    let paths = fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
    let mut notes = paths.filter(|path| path.extension().is_some_and(|e| e == "made"));
    notes.any(|path| Made::read(&path).is_some())
}

/// The stamp of a regular file that is no link.
pub(super) fn stamp(path: &Path) -> Option<Stamp> {
    Stamp::of(&path.symlink_metadata().ok()?)
}

/// The folder of a cell, and the files in it that campaigns have written.
pub(super) struct Owned {
    place: PathBuf,
    files: BTreeSet<PathBuf>,
}

impl Owned {
    /// The files that `records` name in `place`, the folder of a cell of the data set in `folder`, and the
    /// record there.
    pub fn new(folder: &Path, place: &Path, records: impl Iterator<Item = Record>) -> Owned {
        let mut files = BTreeSet::new();
        for record in records {
            files.insert(place.join(RECORD));
            let is_plain = |path: &Path| path.components().all(|part| matches!(part, Component::Normal(_)));
            let paths = record.files.iter().map(|file| Path::new(&file.path));
            let own = paths.filter(|path| is_plain(path)).map(|path| folder.join(path));
            files.extend(own.filter(|path| path.starts_with(place)));
        }
        Owned { place: place.to_path_buf(), files }
    }

    /// Describes foreign content in the place, which no campaign has written; `None` if there is none.
    pub fn foreign(&self) -> Option<String> {
        match self.place.symlink_metadata() {
            Err(_) => None,
            Ok(about) if !about.is_dir() => {
                Some(format!("{} is not a folder: {}", self.place.display(), moved(&self.place)))
            }
            Ok(_) => self.foreign_in(&self.place),
        }
    }

    fn foreign_in(&self, folder: &Path) -> Option<String> {
        let entries = match fs::read_dir(folder) {
            Ok(entries) => entries,
            Err(e) => return Some(format!("{} cannot be read: {e}", folder.display())),
        };
        let mut paths: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).collect();
        paths.sort();
        paths.into_iter().find_map(|path| {
            let kind = path.symlink_metadata().map(|about| about.file_type());
            match kind {
                Ok(kind) if kind.is_dir() => self.foreign_in(&path),
                Ok(kind) if kind.is_file() && self.files.contains(&path) => None,
                Ok(kind) if self.files.contains(&path) => {
                    let what = if kind.is_symlink() { "a link" } else { "not a regular file" };
                    Some(format!(
                        "{} is {what}, which no campaign has written: {}",
                        path.display(),
                        moved(&path)
                    ))
                }
                _ => Some(format!("{} was not written by a campaign: {}", path.display(), moved(&path))),
            }
        })
    }

    /// Removes the files and the folders around them, the record first, so that the cell is not complete from
    /// then on.
    ///
    /// # Errors
    /// [`Error::Input`] if there are other files, in which case nothing is removed; [`Error::Io`].
    pub fn remove(&self) -> Result<()> {
        if let Some(foreign) = self.foreign() {
            return Err(Error::input(foreign));
        }
        let record = self.place.join(RECORD);
        for path in [&record].into_iter().chain(self.files.iter().filter(|path| **path != record)) {
            match fs::remove_file(path) {
                Err(e) if e.kind() != std::io::ErrorKind::NotFound => {
                    return Err(Error::io("remove", path, e));
                }
                _ => {}
            }
        }
        remove_folders(&self.place)
    }
}

/// Removes a folder in which there are only folders.
fn remove_folders(folder: &Path) -> Result<()> {
    let Ok(entries) = fs::read_dir(folder) else { return Ok(()) };
    for entry in entries.flatten() {
        remove_folders(&entry.path())?;
    }
    fs::remove_dir(folder).map_err(|e| Error::io("remove", folder, e))
}
