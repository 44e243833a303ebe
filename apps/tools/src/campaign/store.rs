//! The folder of a data set, which any number of processes fill.
//!
//! ```text
//! OUT/cells/NAME/          a complete cell: points, objects.csv, record.json
//! OUT/manifest.jsonl       a line per cell, when all are complete or have failed
//! OUT/times.jsonl          what each cell took, and where
//! OUT/.campaign/vlscan-campaign.json   the mark of the folders of campaigns
//! OUT/.campaign/NAME.lock  held by the process that computes the cell
//! OUT/.campaign/NAME.work/ unfinished files of the cell
//! OUT/.campaign/NAME.made  what was written to OUT/cells/NAME, with sizes and times
//! OUT/.campaign/NAME.failed
//! ```
//!
//! A cell gets its name when everything in it is on the disk, in one step, so that it is complete or absent.
//! Nothing is removed but files that a campaign has written (`made`), what lies in the folders that it has
//! marked, and a manifest with lines of cells: a folder of the data set that holds other files is left as it
//! is, and its cell is not computed. Where a file system has no locks two processes would remove each other's
//! unfinished files; then only processes with cells of their own (`--task K/N`) compute.

use super::cells::Cell;
use super::inputs::Inputs;
use super::made::{self, Made, moved};
use super::record::Record;
use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{self, BufRead as _, BufReader, Write as _};
use std::path::{Path, PathBuf};
use vlscan_base::error::{Error, Result};
use vlscan_base::files::{FileWriter, is_temporary_name, publish, reads};

/// The record of a cell, within its folder.
pub(super) const RECORD: &str = "record.json";
/// The mark of a campaign's hidden folder, and what it contains.
const MARK: &str = "vlscan-campaign.json";
const MARK_TEXT: &str =
    "{\"program\":\"vlscan campaign\",\"folder\":\"unfinished files and state of the data set around it\"}\n";
/// The mark of a folder with unfinished files.
const WORK_MARK: &str = "vlscan-unfinished-cell";

/// The folder of a data set.
#[derive(Clone, Debug)]
pub struct Store {
    /// Path of the data set's folder.
    pub folder: PathBuf,
    /// True if no other process computes the cells that this one locks, so that it needs no locks.
    needs_no_locks: bool,
    /// True if the checksums of all files are compared.
    verifies: bool,
}

/// A file of a complete cell that is not as recorded.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{path} of the cell {cell} {damage}")]
struct DamagedFile {
    /// Its path in the folder of the data set.
    path: String,
    cell: String,
    damage: Damage,
}

/// Difference of a file from its record.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
enum Damage {
    #[error("is missing")]
    Missing,
    #[error("is not a regular file")]
    NotRegular,
    #[error("has {found} bytes, expected {expected}")]
    Size { found: u64, expected: u64 },
    #[error("has changed since it was written: its checksum differs")]
    Changed,
}

/// Outcome of a cell.
#[derive(Debug)]
pub enum Outcome {
    /// Computed for the current state of the campaign; its files are as recorded.
    Complete(Box<Record>),
    /// The computation ended with the error that the record holds.
    Failed(Box<Record>),
    /// Not complete, and other files are in its place.
    Obstructed(String),
    /// Not begun, of an earlier state of the campaign, or damaged, which the text describes then.
    Absent(Option<String>),
}

/// A cell that no other process computes until this value is dropped, which removes its unfinished files.
#[derive(Debug)]
pub struct CellLock {
    _lock: File,
    /// The folder for its unfinished files, which holds an empty folder `out`.
    pub work: PathBuf,
}

impl Drop for CellLock {
    fn drop(&mut self) {
        // What stays is removed by the next process that computes the cell.
        let _ = remove_work(&self.work);
    }
}

impl Store {
    /// Creates the folder if it is missing. `needs_no_locks` is true if this process has cells of its own;
    /// with `verifies` the checksums of all files are compared.
    ///
    /// # Errors
    /// [`Error::Input`] if the folder holds files of these names that no campaign has written; [`Error::Io`].
    pub fn create(folder: &Path, needs_no_locks: bool, verifies: bool) -> Result<Store> {
        let store = Store { folder: folder.to_path_buf(), needs_no_locks, verifies };
        store.check_names()?;
        for path in [folder.join("cells"), folder.join(".campaign")] {
            fs::create_dir_all(&path).map_err(|e| Error::io("create", path, e))?;
        }
        if !store.is_marked() {
            write(&store.hidden(MARK), MARK_TEXT.as_bytes())?;
        }
        Ok(store)
    }

    fn is_marked(&self) -> bool {
        reads::read_own(&self.hidden(MARK)).is_ok_and(|text| text == MARK_TEXT.as_bytes())
    }

    /// Rejects a folder in which files of others have the names that a data set needs.
    fn check_names(&self) -> Result<()> {
        let foreign = |path: &Path, what: &str| {
            Error::input(format!(
                "{} {what}, which no campaign has written: move it, or choose another folder as `out`",
                path.display()
            ))
        };
        for folder in [self.folder.join("cells"), self.folder.join(".campaign")] {
            if folder.symlink_metadata().is_ok() && !folder.is_dir() {
                return Err(foreign(&folder, "is not a folder"));
            }
        }
        let hidden = self.folder.join(".campaign");
        let mut names = fs::read_dir(&hidden).into_iter().flatten().flatten().map(|entry| entry.file_name());
        let is_empty = names.all(|name| is_temporary_name(&name));
        // A damaged mark is replaced where the state of a cell proves the same. Another process that begins
        // at the same time may be writing the mark, which is therefore looked for last.
        let is_known =
            hidden.symlink_metadata().is_err() || is_empty || made::is_in(&hidden) || self.is_marked();
        let is_marked = self.is_marked();
        if !is_known {
            return Err(foreign(&hidden, "exists"));
        }
        // Lines are added to the times, but the manifest is replaced.
        for (name, is_replaced) in [("manifest.jsonl", true), ("times.jsonl", false)] {
            let path = self.folder.join(name);
            match path.symlink_metadata() {
                Err(_) => {}
                Ok(about) if !about.is_file() => return Err(foreign(&path, "is not a regular file")),
                Ok(_) if !is_replaced && (is_marked || made::is_in(&hidden)) => {}
                Ok(_) if is_of_cells(&path) => {}
                Ok(_) => return Err(foreign(&path, "exists")),
            }
        }
        Ok(())
    }

    /// The files and folders that processes write.
    pub fn outputs(&self) -> Vec<PathBuf> {
        let names = ["cells", ".campaign", "manifest.jsonl", "times.jsonl"];
        names.map(|name| self.folder.join(name)).into_iter().chain([self.folder.clone()]).collect()
    }

    fn hidden(&self, name: &str) -> PathBuf {
        self.folder.join(".campaign").join(name)
    }

    /// The folder of a cell that is complete.
    pub fn cell(&self, cell: &Cell) -> PathBuf {
        self.folder.join("cells").join(&cell.name)
    }

    fn made_path(&self, cell: &Cell) -> PathBuf {
        self.hidden(&format!("{}.made", cell.name))
    }

    fn failed_path(&self, cell: &Cell) -> PathBuf {
        self.hidden(&format!("{}.failed", cell.name))
    }

    fn record_in(&self, path: &Path, cell: &Cell) -> Option<Record> {
        Record::parse(&reads::read_own(path).ok()?).filter(|record| record.cell == cell.name)
    }

    /// Outcome of a cell; `wanted` is its record as far as it is known before it is computed.
    pub fn outcome(&self, cell: &Cell, wanted: &Record, inputs: &mut Inputs) -> Outcome {
        let place = self.cell(cell);
        let mut damage = None;
        if place.symlink_metadata().is_ok() {
            match self.record_in(&place.join(RECORD), cell) {
                Some(record) if record.is_current(wanted, inputs) => {
                    match self.check_files(cell, &record, inputs) {
                        Ok(()) => return Outcome::Complete(Box::new(record)),
                        Err(found) => damage = Some(found.to_string()),
                    }
                }
                Some(_) => {}
                None => damage = Some(format!("{} is damaged or missing", place.join(RECORD).display())),
            }
        }
        match self.record_in(&self.failed_path(cell), cell) {
            Some(record) if record.is_current(wanted, inputs) => Outcome::Failed(Box::new(record)),
            _ => match self.obstruction(cell) {
                Some(reason) => Outcome::Obstructed(reason),
                None => Outcome::Absent(damage),
            },
        }
    }

    /// Compares the files of a complete cell with its record: their sizes and times, and their checksums if
    /// the times are others than those when the checksums were compared last.
    fn check_files(&self, cell: &Cell, record: &Record, inputs: &mut Inputs) -> Result<(), DamagedFile> {
        let made = Made::read(&self.made_path(cell));
        let stamps = made.as_ref().map(|made| &made.stamps);
        let mut is_known = true;
        for file in &record.files {
            let path = self.folder.join(&file.path);
            let damaged =
                |damage| Err(DamagedFile { path: file.path.clone(), cell: record.cell.clone(), damage });
            match path.symlink_metadata() {
                Err(_) => return damaged(Damage::Missing),
                Ok(about) if !about.is_file() => return damaged(Damage::NotRegular),
                Ok(about) if about.len() != file.bytes => {
                    return damaged(Damage::Size { found: about.len(), expected: file.bytes });
                }
                Ok(_) => {}
            }
            let is_seen = made::stamp(&path)
                .is_some_and(|stamp| stamps.is_some_and(|known| known.get(&file.path) == Some(&stamp)));
            if (self.verifies || !is_seen) && inputs.sum(&path).as_ref() != Some(&file.sum) {
                return damaged(Damage::Changed);
            }
            is_known &= is_seen;
        }
        if !is_known {
            // Without this note the checksums are compared once more, which is no error.
            let _ = self.note_made(cell, record);
        }
        Ok(())
    }

    fn note_made(&self, cell: &Cell, record: &Record) -> Result<()> {
        let made = Made::of(record, |path| self.folder.join(path));
        write(&self.made_path(cell), made.text()?.as_bytes())
    }

    /// The files that campaigns have written for a cell.
    fn owned(&self, cell: &Cell) -> made::Owned {
        let recorded = self.record_in(&self.cell(cell).join(RECORD), cell);
        let made = Made::read(&self.made_path(cell)).map(|made| made.record);
        let records = recorded.into_iter().chain(made.filter(|record| record.cell == cell.name));
        made::Owned::new(&self.folder, &self.cell(cell), records)
    }

    /// Reason why a cell cannot be computed: there is something in the place of one of its files or folders
    /// that no campaign has written.
    fn obstruction(&self, cell: &Cell) -> Option<String> {
        for path in
            [self.failed_path(cell), self.made_path(cell), self.hidden(&format!("{}.lock", cell.name))]
        {
            if path.symlink_metadata().is_ok_and(|about| !about.is_file()) {
                return Some(format!("{} is not a regular file: {}", path.display(), moved(&path)));
            }
        }
        let work = self.work(cell);
        if work.symlink_metadata().is_ok() && !is_work(&work) {
            return Some(format!("{} was not written by a campaign: {}", work.display(), moved(&work)));
        }
        self.owned(cell).foreign()
    }

    fn work(&self, cell: &Cell) -> PathBuf {
        self.hidden(&format!("{}.work", cell.name))
    }

    /// Locks a cell; `None` if another process computes it.
    ///
    /// # Errors
    /// [`Error::Input`] on a file system without locks, [`Error::Io`].
    pub fn lock(&self, cell: &Cell) -> Result<Option<CellLock>> {
        let path = self.hidden(&format!("{}.lock", cell.name));
        if path.symlink_metadata().is_ok_and(|about| !about.is_file()) {
            return Err(Error::input(format!("{} is not a regular file: {}", path.display(), moved(&path))));
        }
        let lock = OpenOptions::new().write(true).create(true).truncate(false).open(&path);
        let lock = lock.map_err(|e| Error::io("create", &path, e))?;
        if !self.is_locked(lock.try_lock())? {
            return Ok(None);
        }
        let work = self.work(cell);
        remove_work(&work).map_err(|e| Error::io("remove", &work, e))?;
        let created = fs::create_dir(&work)
            .and_then(|()| File::create_new(work.join(WORK_MARK)))
            .and_then(|_| fs::create_dir(work.join("out")));
        created.map_err(|e| Error::io("create", &work, e))?;
        Ok(Some(CellLock { _lock: lock, work }))
    }

    /// True if this process holds a cell after the attempt to lock it.
    fn is_locked(&self, attempt: std::result::Result<(), TryLockError>) -> Result<bool> {
        match attempt {
            Ok(()) => Ok(true),
            Err(TryLockError::WouldBlock) => Ok(false),
            Err(TryLockError::Error(_)) if self.needs_no_locks => Ok(true),
            Err(TryLockError::Error(error)) => Err(Error::input(format!(
                "{}: this file system has no locks ({error}); use --task K/N, which divides the cells among \
                 the processes",
                self.folder.display()
            ))),
        }
    }

    /// Publishes files from the work folder into `out`.
    ///
    /// # Errors
    /// [`Error::Input`] if files of others are there, [`Error::Io`].
    pub fn complete(&self, cell: &Cell, lock: CellLock, record: &Record) -> Result<()> {
        let out = lock.work.join("out");
        write(&out.join(RECORD), record.line()?.as_bytes())?;
        // Of an earlier state of the campaign, or computed twice.
        self.owned(cell).remove()?;
        let prefix = format!("cells/{}/", cell.name);
        let made = Made::of(record, |path| out.join(path.strip_prefix(&prefix).unwrap_or(path)));
        write(&self.made_path(cell), made.text()?.as_bytes())?;
        publish(&out, &self.cell(cell))?;
        remove_file(&self.failed_path(cell))
    }

    /// Records the failure of a cell, and removes its unfinished files and those of an earlier state of the
    /// campaign.
    ///
    /// # Errors
    /// [`Error::Input`] if files of others are in the place of the cell, in which case nothing is kept;
    /// [`Error::Io`].
    pub fn fail(&self, cell: &Cell, lock: CellLock, record: &Record) -> Result<()> {
        self.owned(cell).remove()?;
        write(&self.failed_path(cell), record.line()?.as_bytes())?;
        drop(lock);
        Ok(())
    }

    /// Removes everything of a failed cell, so that the next start computes it.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn forget(&self, cell: &Cell, lock: CellLock) -> Result<()> {
        remove_file(&self.failed_path(cell))?;
        drop(lock);
        Ok(())
    }

    /// Writes the manifest, the same bytes from any process. Returns whether another one was there.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn write_manifest(&self, records: &[Record]) -> Result<(PathBuf, bool)> {
        let path = self.folder.join("manifest.jsonl");
        let mut text = String::new();
        for record in records {
            text.push_str(&record.line()?);
        }
        let earlier = reads::read_own(&path).ok();
        if earlier.as_deref() != Some(text.as_bytes()) {
            write(&path, text.as_bytes())?;
        }
        Ok((path, earlier.is_some_and(|earlier| earlier != text.as_bytes())))
    }

    /// Removes the manifest before a cell is computed again, since it does not describe what is then in the
    /// folder.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn remove_manifest(&self) -> Result<()> {
        remove_file(&self.folder.join("manifest.jsonl"))
    }

    /// Records the duration of a cell; a line that cannot be written is left out.
    pub fn note_time(&self, cell: &Cell, seconds: f64, threads: usize) {
        let line = serde_json::json!({ "cell": cell.name, "seconds": seconds, "threads": threads });
        let path = self.folder.join("times.jsonl");
        if path.symlink_metadata().is_ok_and(|about| !about.is_file()) {
            return;
        }
        if let Ok(mut file) = OpenOptions::new().append(true).create(true).open(path) {
            let _ = file.write_all(format!("{line}\n").as_bytes());
        }
    }
}

/// True if a file holds a line of a cell, as in the manifest or among the times. Other lines may be damaged.
fn is_of_cells(path: &Path) -> bool {
    let is_of_cell = |line: &[u8]| {
        let Ok(line) = serde_json::from_slice::<serde_json::Value>(line) else { return false };
        let has = |keys: [&str; 3]| keys.iter().all(|key| line.get(key).is_some());
        has(["cell", "inputs", "sum"]) || has(["cell", "seconds", "threads"])
    };
    let Ok(file) = reads::open_own(path) else { return false };
    let mut lines = BufReader::new(file).split(b'\n').map_while(|line| line.ok());
    lines.any(|line| is_of_cell(&line))
}

/// True if a folder is one with unfinished files, or empty.
fn is_work(work: &Path) -> bool {
    let is_folder = work.symlink_metadata().is_ok_and(|about| about.is_dir());
    let is_marked = || work.join(WORK_MARK).symlink_metadata().is_ok_and(|about| about.is_file());
    let is_empty = || fs::read_dir(work).is_ok_and(|mut entries| entries.next().is_none());
    is_folder && (is_marked() || is_empty())
}

/// Removes a folder with unfinished files, if it exists. Its mark is removed last, so that the remains of a
/// killed process are recognised by it.
fn remove_work(work: &Path) -> io::Result<()> {
    if work.symlink_metadata().is_err() {
        return Ok(());
    }
    if !is_work(work) {
        return Err(io::Error::new(io::ErrorKind::AlreadyExists, "no campaign has written it"));
    }
    let mark = work.join(WORK_MARK);
    for entry in fs::read_dir(work)? {
        let path = entry?.path();
        match path.symlink_metadata()?.is_dir() {
            true => fs::remove_dir_all(&path)?,
            false if path == mark => {}
            false => fs::remove_file(&path)?,
        }
    }
    if mark.symlink_metadata().is_ok() {
        fs::remove_file(&mark)?;
    }
    fs::remove_dir(work)
}

/// Removes a regular file of the campaign's own, if it exists.
fn remove_file(path: &Path) -> Result<()> {
    match path.symlink_metadata() {
        Ok(about) if about.is_file() => fs::remove_file(path).map_err(|e| Error::io("remove", path, e)),
        _ => Ok(()),
    }
}

fn write(path: &Path, bytes: &[u8]) -> Result<()> {
    let mut file = FileWriter::create_own(path)?;
    file.append(bytes)?;
    file.finish().map(drop)
}

#[cfg(test)]
mod tests;
