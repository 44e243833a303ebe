//! The folder of a data set, which any number of processes fill.
//!
//! ```text
//! OUT/cells/NAME/          a complete cell: points, objects.csv, record.json
//! OUT/manifest.jsonl       a line per cell, when all are complete or have failed
//! OUT/times.jsonl          what each cell took, and where
//! OUT/.campaign/NAME.lock  held by the process that computes the cell
//! OUT/.campaign/NAME/      unfinished files of the cell
//! OUT/.campaign/NAME.failed
//! ```
//!
//! A cell gets its name when everything in it is on the disk, in one step, so that it is complete or absent. A process removes
//! what it finds in the work folder of a cell that it has locked. Where a file system has no locks two processes would remove each
//! other's files there; then only processes with cells of their own (`--task K/N`) compute.

use super::cells::Cell;
use super::record::{Inputs, Record};
use crate::error::{Error, Result};
use crate::files::{FileWriter, Patched, publish};
use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::Write as _;
use std::path::{Path, PathBuf};

/// The record of a cell, within its folder.
const RECORD: &str = "record.json";

/// The folder of a data set.
#[derive(Clone, Debug)]
pub struct Store {
    pub folder: PathBuf,
    /// Whether no other process computes the cells that this one locks, so that it needs no locks.
    needs_no_locks: bool,
}

/// What became of a cell.
#[derive(Debug)]
pub enum Outcome {
    Complete(Box<Record>),
    Failed(Box<Record>),
    /// Not begun, or of an earlier state of the campaign.
    Absent,
}

/// A cell that no other process computes until this value is dropped.
#[derive(Debug)]
pub struct CellLock {
    _lock: File,
    /// The folder for its unfinished files, which is empty.
    pub work: PathBuf,
}

impl CellLock {
    /// Releases a cell that needs no computing.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn release(self) -> Result<()> {
        fs::remove_dir_all(&self.work).map_err(|e| Error::io("remove", &self.work, e))
    }
}

impl Store {
    /// Creates the folder if it is missing. `needs_no_locks` tells that this process has cells of its own.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn create(folder: &Path, needs_no_locks: bool) -> Result<Store> {
        for path in [folder.join("cells"), folder.join(".campaign")] {
            fs::create_dir_all(&path).map_err(|e| Error::io("create", path, e))?;
        }
        Ok(Store { folder: folder.to_path_buf(), needs_no_locks })
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

    /// What became of a cell; `wanted` is its record as far as it is known before it is computed.
    pub fn outcome(&self, cell: &Cell, wanted: &Record, inputs: &mut Inputs) -> Outcome {
        let mut read = |path: PathBuf| -> Option<Box<Record>> {
            let record: Record = serde_json::from_slice(&fs::read(path).ok()?).ok()?;
            record.is_current(wanted, inputs).then(|| Box::new(record))
        };
        match read(self.cell(cell).join(RECORD)) {
            Some(record) => Outcome::Complete(record),
            None => match read(self.hidden(&format!("{}.failed", cell.name))) {
                Some(record) => Outcome::Failed(record),
                None => Outcome::Absent,
            },
        }
    }

    /// Locks a cell; `None` if another process computes it.
    ///
    /// # Errors
    /// [`Error::Input`] on a file system without locks, [`Error::Io`].
    pub fn lock(&self, cell: &Cell) -> Result<Option<CellLock>> {
        let path = self.hidden(&format!("{}.lock", cell.name));
        let lock = File::create(&path).map_err(|e| Error::io("create", &path, e))?;
        if !self.is_locked(lock.try_lock())? {
            return Ok(None);
        }
        let work = self.hidden(&cell.name);
        if work.exists() {
            fs::remove_dir_all(&work).map_err(|e| Error::io("remove", &work, e))?;
        }
        fs::create_dir_all(work.join("out")).map_err(|e| Error::io("create", &work, e))?;
        Ok(Some(CellLock { _lock: lock, work }))
    }

    /// Whether a cell is this process's own after the attempt to lock it.
    fn is_locked(&self, attempt: std::result::Result<(), TryLockError>) -> Result<bool> {
        match attempt {
            Ok(()) => Ok(true),
            Err(TryLockError::WouldBlock) => Ok(false),
            Err(TryLockError::Error(_)) if self.needs_no_locks => Ok(true),
            Err(TryLockError::Error(error)) => Err(Error::input(format!(
                "{}: this file system has no locks ({error}); use --task K/N, which gives each process cells of its own",
                self.folder.display()
            ))),
        }
    }

    /// Gives the unfinished files in `out` below the work folder their place.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn complete(&self, cell: &Cell, lock: CellLock, record: &Record) -> Result<()> {
        let out = lock.work.join("out");
        write(&out.join(RECORD), record.line()?.as_bytes())?;
        let place = self.cell(cell);
        if place.exists() {
            // Of an earlier state of the campaign, or computed twice.
            fs::remove_dir_all(&place).map_err(|e| Error::io("remove", &place, e))?;
        }
        publish(&out, &place)?;
        let failed = self.hidden(&format!("{}.failed", cell.name));
        if failed.exists() {
            fs::remove_file(&failed).map_err(|e| Error::io("remove", failed, e))?;
        }
        fs::remove_dir_all(&lock.work).map_err(|e| Error::io("remove", &lock.work, e))
    }

    /// Keeps why a cell has failed, and removes its unfinished files.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn fail(&self, cell: &Cell, lock: CellLock, record: &Record) -> Result<()> {
        write(&self.hidden(&format!("{}.failed", cell.name)), record.line()?.as_bytes())?;
        let place = self.cell(cell);
        if place.exists() {
            fs::remove_dir_all(&place).map_err(|e| Error::io("remove", &place, e))?;
        }
        fs::remove_dir_all(&lock.work).map_err(|e| Error::io("remove", &lock.work, e))
    }

    /// Writes the manifest, the same bytes from any process.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn write_manifest(&self, records: &[Record]) -> Result<PathBuf> {
        let path = self.folder.join("manifest.jsonl");
        let mut text = String::new();
        for record in records {
            text.push_str(&record.line()?);
        }
        write(&path, text.as_bytes())?;
        Ok(path)
    }

    /// Notes what a cell took; a line that cannot be written is left out.
    pub fn note_time(&self, cell: &Cell, seconds: f64, threads: usize) {
        let line = serde_json::json!({ "cell": cell.name, "seconds": seconds, "threads": threads });
        let path = self.folder.join("times.jsonl");
        if let Ok(mut file) = OpenOptions::new().append(true).create(true).open(path) {
            let _ = file.write_all(format!("{line}\n").as_bytes());
        }
    }
}

fn write(path: &Path, bytes: &[u8]) -> Result<()> {
    let mut file = FileWriter::create(path, true, Patched::Never)?;
    file.append(bytes)?;
    file.finish().map(drop)
}

#[cfg(test)]
mod tests {
    use super::super::{Cells, File as CampaignFile};
    use super::*;

    #[test]
    fn cells_are_complete_or_absent_and_one_process_has_them() {
        let dir = tempfile::tempdir().unwrap();
        let text =
            "out = \"o\"\n[[scene]]\nname = \"s\"\nfile = \"x\"\n[[variant]]\nname = \"v\"\nplan = \"p\"\n";
        let file: CampaignFile = toml::from_str(text).unwrap();
        let cell = Cells::of(&file).unwrap().0.remove(0);
        let store = Store::create(dir.path(), false).unwrap();
        let record = Record { cell: cell.name.clone(), ..Record::default() };
        let outcome = || store.outcome(&cell, &record, &mut Inputs::default());
        assert!(matches!(outcome(), Outcome::Absent));
        let lock = store.lock(&cell).unwrap().unwrap();
        assert!(store.lock(&cell).unwrap().is_none());
        fs::write(lock.work.join("out/points.laz"), "unfinished").unwrap();
        drop(lock);
        // What a process that was killed has left is gone.
        let lock = store.lock(&cell).unwrap().unwrap();
        assert!(!lock.work.join("out/points.laz").exists());
        let failed = Record { error: Some("no".to_owned()), ..record.clone() };
        store.fail(&cell, lock, &failed).unwrap();
        assert!(matches!(outcome(), Outcome::Failed(found) if found.error.as_deref() == Some("no")));
        let lock = store.lock(&cell).unwrap().unwrap();
        fs::write(lock.work.join("out/points.laz"), "all").unwrap();
        store.complete(&cell, lock, &record).unwrap();
        assert!(matches!(outcome(), Outcome::Complete(_)));
        assert_eq!(fs::read(store.cell(&cell).join("points.laz")).unwrap(), b"all");
    }

    #[test]
    fn without_locks_only_processes_with_cells_of_their_own_compute() {
        let dir = tempfile::tempdir().unwrap();
        let attempt = || Err(TryLockError::Error(std::io::Error::from_raw_os_error(95)));
        let shared = Store::create(dir.path(), false).unwrap();
        match shared.is_locked(attempt()) {
            Err(Error::Input(problems)) => assert!(problems.render(false).contains("use --task K/N")),
            other => panic!("{other:?}"),
        }
        assert!(!shared.is_locked(Err(TryLockError::WouldBlock)).unwrap());
        assert!(Store::create(dir.path(), true).unwrap().is_locked(attempt()).unwrap());
    }
}
