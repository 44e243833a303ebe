//! Dependencies of the contents of cells: files that were read, looked for or listed.

use super::record::Record;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use vlscan_base::error::{Error, Result};
use vlscan_base::files::{Reads, Stamp, identity};
use vlscan_base::store::Checksum;

/// Checksums of files, each computed once per process as long as size and times of the file stay the same.
#[derive(Debug, Default)]
pub struct Inputs {
    /// Files that are not inputs although they lie in a listed folder: the data set.
    excluded: BTreeSet<PathBuf>,
    known: BTreeMap<PathBuf, (Stamp, String)>,
}

impl Inputs {
    /// Inputs that exclude files and folders of these names, even in listed folders.
    pub fn without(excluded: impl IntoIterator<Item = PathBuf>) -> Inputs {
        let excluded = excluded.into_iter().map(|path| identity(&path)).collect();
        Inputs { excluded, known: BTreeMap::new() }
    }

    /// The checksum of a regular file; `None` if there is none that can be read.
    pub fn sum(&mut self, path: &Path) -> Option<String> {
        let stamp = stamp(path)?;
        match self.known.get(path) {
            Some((known, sum)) if *known == stamp => Some(sum.clone()),
            _ => {
                let sum = checksum(path).ok()?;
                self.known.insert(path.to_path_buf(), (stamp, sum.clone()));
                Some(sum)
            }
        }
    }

    /// The checksum of the names in a folder; that of no names if it cannot be listed.
    fn sum_of_names(&self, folder: &Path) -> String {
        let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
        let is_listed = |path: &PathBuf| self.excluded.is_empty() || !self.excluded.contains(&identity(path));
        let mut names: Vec<_> =
            entries.filter(|entry| is_listed(&entry.path())).map(|entry| entry.file_name()).collect();
        names.sort();
        let mut sum = Checksum::default();
        for name in names {
            // Writing to a checksum does not fail.
            let _ = writeln!(sum, "{name:?}");
        }
        format!("{:016x}", sum.finish())
    }

    /// True if everything that a record depends on is as it was.
    pub(super) fn are_as_in(&mut self, record: &Record) -> bool {
        record.inputs.iter().all(|(path, sum)| self.sum(Path::new(path)).as_ref() == Some(sum))
            && !record.absent.iter().any(|path| Path::new(path).is_file())
            && record.folders.iter().all(|(path, sum)| self.sum_of_names(Path::new(path)) == *sum)
    }

    /// Adds the inputs that were read for a cell to its record, except those in the folder `work`. Paths
    /// below `folder`, the working directory, become relative. Returns the files that were written, touched
    /// or removed since they were read, which are not recorded: without the original inputs neither the
    /// result of the cell nor its failure may be kept.
    pub fn note(&mut self, reads: &Reads, record: &mut Record, work: &Path, folder: &Path) -> Vec<String> {
        let name = |path: &Path| -> Option<String> {
            let is_own = path.starts_with(work);
            let near = path.strip_prefix(folder).unwrap_or(path);
            (!is_own).then(|| near.to_str().map(str::to_owned)).flatten().filter(|name| !name.is_empty())
        };
        let mut changed = Vec::new();
        for (path, read) in &reads.files {
            // Streams pass only once.
            let (Some(name), Some(read)) = (name(path), read) else { continue };
            let sum = self.sum(Path::new(&name));
            let now = stamp(Path::new(&name));
            match (sum, now) {
                (Some(sum), Some(now)) if now.is_same_content(read) => drop(record.inputs.insert(name, sum)),
                _ => changed.push(name),
            }
        }
        record.absent.extend(reads.absent.iter().filter_map(|path| name(path)));
        for name in reads.folders.iter().filter_map(|path| name(path)) {
            let sum = self.sum_of_names(Path::new(&name));
            record.folders.insert(name, sum);
        }
        changed
    }
}

/// The present stamp of a regular file.
pub(super) fn stamp(path: &Path) -> Option<Stamp> {
    Stamp::of(&std::fs::metadata(path).ok()?)
}

/// The checksum of a regular file's contents.
///
/// # Errors
/// [`Error::Io`].
pub fn checksum(path: &Path) -> Result<String> {
    let mut sum = Checksum::default();
    sum.file(path).map_err(|e| Error::io("read", path, e))?;
    Ok(format!("{:016x}", sum.finish()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;
    use vlscan_base::files::{FileLog, reads};

    #[test]
    fn a_record_is_current_as_long_as_nothing_it_depends_on_changes() {
        let dir = tempfile::tempdir().unwrap();
        let at = |name: &str| dir.path().join(name);
        fs::create_dir(at("models")).unwrap();
        fs::write(at("trees.csv"), "x,y").unwrap();
        fs::write(at("models/a.obj"), "").unwrap();
        let log = FileLog::default();
        log.record(|| {
            reads::read(at("trees.csv")).unwrap();
            assert!(!reads::is_file(at("materials.csv")));
            reads::list(at("models")).unwrap();
        });
        let read = log.reads();
        let wanted =
            |version: &str| Record { cell: "a".to_owned(), version: version.to_owned(), ..Record::default() };
        let mut record = Record { points: 7, ..wanted("1") };
        let excluded = || Inputs::without([at("models/set")]);
        let note =
            |record: &mut Record| excluded().note(&read, record, Path::new("/none"), Path::new("/none"));
        assert!(note(&mut record).is_empty());
        assert_eq!((record.inputs.len(), record.absent.len(), record.folders.len()), (1, 1, 1));
        let is_current = || record.is_current(&wanted("1"), &mut excluded());
        assert!(is_current() && !record.is_current(&wanted("2"), &mut Inputs::default()));
        for (name, is_relevant) in
            [("materials.csv", true), ("models/b.obj", true), ("models/set", false), ("other", false)]
        {
            fs::write(at(name), "").unwrap();
            assert_eq!(is_current(), !is_relevant, "{name}");
            fs::remove_file(at(name)).unwrap();
            assert!(is_current(), "{name}");
        }
        fs::write(at("trees.csv"), "x,z").unwrap();
        assert!(!is_current());
        let mut late = wanted("1");
        assert_eq!(note(&mut late), [at("trees.csv").to_str().unwrap()]);
        assert_eq!((late.inputs.len(), late.absent.len(), late.folders.len()), (0, 1, 1));
        fs::remove_file(at("trees.csv")).unwrap();
        assert!(!is_current());
    }
}
