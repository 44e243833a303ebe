//! What is known of a cell that is complete: its line of the manifest.

use crate::error::{Error, Result};
use crate::store::Checksum;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// The line of a cell in the manifest. Nothing in it depends on where and when the cell was computed.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Record {
    pub cell: String,
    pub scene: String,
    pub variant: String,
    pub seed: u64,
    pub group: String,
    /// train, validation or test; empty without a split.
    pub split: String,
    /// Version of vlscan.
    pub version: String,
    /// Scene, variant and options as the campaign's file says them.
    pub options: serde_json::Value,
    /// The files that were read, with checksums of their contents (XXH3, 64 bits).
    pub inputs: BTreeMap<String, String>,
    /// Why there is nothing else, if the cell failed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub error: Option<String>,
    #[serde(default)]
    pub pulses: u64,
    #[serde(default)]
    pub points: u64,
    /// Area of the polygon, or of the box of the points, m².
    #[serde(default)]
    pub area_m2: f64,
    #[serde(default)]
    pub points_per_m2: f64,
    /// Corners of the box around the points, m.
    #[serde(default)]
    pub bounds: Option<[[f64; 3]; 2]>,
    #[serde(default)]
    pub files: Vec<FileRecord>,
}

/// A file of a cell.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct FileRecord {
    /// Path below the folder of the data set.
    pub path: String,
    /// Points; rows of tables.
    pub records: u64,
    pub bytes: u64,
    /// Checksum of its contents.
    pub sum: String,
}

impl Record {
    /// The record as a line of JSON.
    ///
    /// # Errors
    /// [`Error::Internal`] for numbers that JSON has not.
    pub fn line(&self) -> Result<String> {
        let line = serde_json::to_string(self).map_err(|e| Error::Internal(format!("a record: {e}")))?;
        Ok(line + "\n")
    }

    /// Whether the same cell, described by `wanted`, would have this record again: version, options, group and the contents
    /// of all files that were read.
    pub fn is_current(&self, wanted: &Record, inputs: &mut Inputs) -> bool {
        let head = |record: &Record| {
            let Record { cell, scene, variant, seed, group, split, version, .. } = record.clone();
            (cell, scene, variant, seed, group, split, version)
        };
        head(self) == head(wanted)
            && self.options == wanted.options
            && wanted.inputs.iter().all(|(path, sum)| self.inputs.get(path) == Some(sum))
            && self.inputs.iter().all(|(path, sum)| inputs.sum(Path::new(path)).as_ref() == Some(sum))
    }
}

/// Checksums of the files that cells read, each computed once per process.
#[derive(Debug, Default)]
pub struct Inputs {
    /// What is not an input although it lies within a folder that is one: the data set.
    excluded: Vec<PathBuf>,
    known: BTreeMap<PathBuf, Option<String>>,
}

impl Inputs {
    /// Inputs among which files and folders of these names are none, unless an option names them.
    pub fn without(excluded: impl IntoIterator<Item = PathBuf>) -> Inputs {
        // Some of them do not exist yet.
        let resolved = |path: PathBuf| {
            let within = |folder: &Path| Some(folder.canonicalize().ok()?.join(path.file_name()?));
            path.canonicalize().ok().or_else(|| within(path.parent()?))
        };
        let excluded = excluded.into_iter().filter_map(resolved).collect();
        Inputs { excluded, known: BTreeMap::new() }
    }

    /// The checksum of a file; `None` if it cannot be read.
    pub fn sum(&mut self, path: &Path) -> Option<String> {
        if let Some(known) = self.known.get(path) {
            return known.clone();
        }
        let sum = checksum(path).ok();
        self.known.insert(path.to_path_buf(), sum.clone());
        sum
    }

    /// The files that words name, and those below the folders that they name; `--option=value` names its value.
    pub fn named<'w>(&mut self, words: impl Iterator<Item = &'w str>) -> BTreeMap<String, String> {
        let mut found = BTreeMap::new();
        for word in words {
            let value =
                word.strip_prefix('-').and_then(|option| option.split_once('=')).map(|(_, value)| value);
            for name in [Some(word), value].into_iter().flatten() {
                let path = Path::new(name.split_once('#').map_or(name, |(path, _)| path));
                self.add(path, &mut found, 0);
            }
        }
        found
    }

    /// Adds a file, or the files below a folder.
    fn add(&mut self, path: &Path, found: &mut BTreeMap<String, String>, depth: u32) {
        if path.is_file() {
            if let (Some(sum), Some(name)) = (self.sum(path), path.to_str()) {
                found.insert(name.to_owned(), sum);
            }
        } else if path.is_dir() && depth < 4 && !path.as_os_str().is_empty() {
            let entries = std::fs::read_dir(path).into_iter().flatten().flatten();
            for path in entries.map(|entry| entry.path()) {
                let is_excluded = !self.excluded.is_empty()
                    && path.canonicalize().is_ok_and(|path| self.excluded.contains(&path));
                if !is_excluded {
                    self.add(&path, found, depth + 1);
                }
            }
        }
    }
}

/// The checksum of a file's contents.
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

    #[test]
    fn a_record_is_current_as_long_as_nothing_it_depends_on_changes() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("trees.csv");
        std::fs::write(&path, "x,y").unwrap();
        let name = path.to_str().unwrap();
        let wanted = |version: &str| Record {
            cell: "a".to_owned(),
            version: version.to_owned(),
            inputs: Inputs::default().named([name].into_iter()),
            ..Record::default()
        };
        let record = Record { points: 7, ..wanted("1") };
        assert!(record.is_current(&wanted("1"), &mut Inputs::default()));
        assert!(!record.is_current(&wanted("2"), &mut Inputs::default()));
        std::fs::write(&path, "x,z").unwrap();
        assert!(!record.is_current(&wanted("1"), &mut Inputs::default()));
        std::fs::remove_file(&path).unwrap();
        assert!(!record.is_current(&wanted("1"), &mut Inputs::default()));
        let again: Record = serde_json::from_str(&record.line().unwrap()).unwrap();
        assert_eq!(again, record);
    }

    #[test]
    fn folders_are_named_with_all_their_files() {
        let dir = tempfile::tempdir().unwrap();
        std::fs::create_dir(dir.path().join("models")).unwrap();
        for file in ["models/a.obj", "models/b.obj", "ground.obj"] {
            std::fs::write(dir.path().join(file), file).unwrap();
        }
        let models = dir.path().join("models");
        let ground = format!("--terrain={}", dir.path().join("ground.obj").display());
        let words = [models.to_str().unwrap(), &ground, "--seed", "7"];
        let found = Inputs::default().named(words.into_iter());
        assert_eq!(found.len(), 3, "{found:?}");
        // But for the data set itself.
        let all = [dir.path().to_str().unwrap()];
        assert_eq!(Inputs::default().named(all.into_iter()).len(), 3);
        assert_eq!(Inputs::without([models.clone()]).named(all.into_iter()).len(), 1);
        assert_eq!(Inputs::without([models.clone()]).named([models.to_str().unwrap()].into_iter()).len(), 2);
    }
}
