//! The files and settings that a packed scene was made from, and whether it is still up to date.

use crate::conditions::Conditions;
use crate::{LoadOptions, Scene};
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::collections::BTreeSet;
use std::fs::Metadata;
use std::path::{Path, PathBuf};
use std::time::UNIX_EPOCH;
use vlscan_base::diag::Problem;
use vlscan_base::error::{Error, Result};
use vlscan_base::files::{FileSet, reads};
use vlscan_base::store::{ArrayFile, ArrayFileWriter, Checksum};
use vlscan_survey::SceneRecipe;
use vlscan_trace::Builder;

/// A file at the time the scene was packed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Source {
    /// Relative to the folder of the pack if the file is within it.
    path: String,
    length: u64,
    modified_ns: u64,
    sum: u64,
}

/// Settings and files that a pack was made from.
pub(super) struct Origin {
    pub conditions: Conditions,
    pub builder: Builder,
    files: BTreeSet<PathBuf>,
    sources: Vec<Source>,
}

/// The stored form of the origin. Values are stored in the order of the fields.
#[derive(Serialize, Deserialize)]
struct StoredOrigin<'a> {
    conditions: Cow<'a, Conditions>,
    builder: Builder,
    sources: Vec<Source>,
}

/// The name of the origin in a pack.
const NAME: &str = "origin";

impl Origin {
    pub fn of(recipe: &SceneRecipe, options: &LoadOptions, builder: Builder) -> Origin {
        let mut files = BTreeSet::from([recipe.path.clone()]);
        files.extend(recipe.parts.iter().filter_map(|p| p.place.as_ref()).map(|p| p.path.clone()));
        let conditions = Conditions::of(recipe, options);
        Origin { conditions, builder, files, sources: Vec::new() }
    }

    /// Adds the files that an epoch was loaded from, and the settings that its materials depend on.
    pub fn add(&mut self, scene: &Scene) {
        self.conditions.add(scene);
        self.files.extend(scene.sources.iter().cloned());
    }

    /// Fails if `pack` is one of the files.
    pub fn refuse_replacing(&self, pack: &Path) -> Result<()> {
        match FileSet::of(&self.files).contains(pack) {
            true => Err(Error::input(format!(
                "{} is a source of the scene, expected another name",
                pack.display()
            ))),
            false => Ok(()),
        }
    }

    /// Reads all files again for their checksums and appends the origin to the pack at `pack`.
    pub fn write(self, pack: &Path, out: &mut ArrayFileWriter) -> Result<()> {
        let folder = folder_of(pack);
        let folder = std::fs::canonicalize(folder).map_err(|e| Error::io("read", folder, e))?;
        let mut sources = Vec::new();
        for path in self.files.iter().filter(|p| p.is_file()) {
            let about = std::fs::metadata(path).map_err(|e| Error::io("read", path, e))?;
            let whole = std::fs::canonicalize(path).map_err(|e| Error::io("read", path, e))?;
            let path = whole.strip_prefix(&folder).unwrap_or(&whole).to_string_lossy().into_owned();
            sources.push(Source {
                path,
                length: about.len(),
                modified_ns: modified(&about),
                sum: sum(&whole).map_err(|e| Error::io("read", &whole, e))?,
            });
        }
        let conditions = Cow::Borrowed(&self.conditions);
        out.value(NAME, &StoredOrigin { conditions, builder: self.builder, sources })
    }

    /// Reads the origin of a pack.
    ///
    /// # Errors
    /// As for [`ArrayFile::value`].
    pub fn read(file: &ArrayFile) -> Result<Origin> {
        let StoredOrigin { conditions, builder, sources } = file.value::<StoredOrigin<'static>>(NAME)?;
        Ok(Origin { conditions: conditions.into_owned(), builder, files: BTreeSet::new(), sources })
    }

    /// Checks that the files have not changed. A missing file counts as unchanged: packs can be moved without
    /// their sources.
    ///
    /// # Errors
    /// The first file that has changed.
    pub fn check_files(&self, pack: &Path) -> Result<(), ChangedFile> {
        let changed = |s: &&Source| {
            let path = folder_of(pack).join(&s.path);
            let about = std::fs::metadata(&path);
            reads::note_opened(&path, &about);
            let Ok(about) = about else { return false };
            let same_time = modified(&about) == s.modified_ns;
            about.len() != s.length || (!same_time && sum(&path).ok() != Some(s.sum))
        };
        match self.sources.iter().find(changed) {
            Some(s) => Err(ChangedFile { path: s.path.clone() }),
            None => Ok(()),
        }
    }
}

/// A file of which a pack was made and that has changed.
#[derive(Debug, thiserror::Error)]
#[error("{path} has changed since; pack the scene again")]
pub struct ChangedFile {
    /// The file, relative to the folder of the pack or absolute.
    pub path: String,
}

impl Problem for ChangedFile {}

fn folder_of(pack: &Path) -> &Path {
    pack.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

fn modified(about: &Metadata) -> u64 {
    let since = about.modified().ok().and_then(|t| t.duration_since(UNIX_EPOCH).ok());
    since.map_or(0, |d| d.as_nanos() as u64)
}

fn sum(path: &Path) -> std::io::Result<u64> {
    let mut sum = Checksum::default();
    sum.file(path)?;
    Ok(sum.finish())
}
