//! Uploads: files of a form are received into a folder of their own, archives expanded by a confined process,
//! everything hashed, and only then listed under the name that their owner gives them.
//!
//! | file | what it does |
//! |---|---|
//! | `error` | why an upload is refused |
//! | `form` | files of a form as they arrive |
//! | `contents` | files of an upload, hashed |

mod contents;
mod error;
mod form;

pub use error::UploadError;
pub use form::{MAX_TIME, receive};

use crate::archives::{Unpacking, is_archive};
use crate::beneath::BLOCK;
use crate::config::ServeArgs;
use crate::names;
use crate::records::Kind;
use crate::reservations::Reservation;
use crate::store::{Store, Upload, now};
use crate::tokens::random_name;
use contents::{Contents, hash_files, sync_folder};
use error::too_much;
use std::collections::BTreeSet;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// Highest number that is added to a name that is taken.
const MAX_NUMBER: u32 = 1000;

/// Files that were received, in a folder that is removed unless they are listed.
#[derive(Debug)]
pub struct Received {
    folder: tempfile::TempDir,
    /// The name that the form gives, if any.
    name: Option<String>,
    /// True if a number is added to a name that is taken.
    is_numbered: bool,
    first: String,
    files: BTreeSet<PathBuf>,
    /// Disk space of the files.
    space: Reservation,
}

impl Received {
    fn new(folder: tempfile::TempDir, owner: &str, store: &Store) -> Received {
        Received {
            folder,
            name: None,
            is_numbered: false,
            first: String::new(),
            files: BTreeSet::new(),
            space: Reservation::new(&store.receiving, owner),
        }
    }

    /// Texts of the program itself as an upload under a name, or a name with a number if that is taken.
    ///
    /// # Errors
    /// [`UploadError`].
    pub fn of_texts(
        store: &Store,
        owner: &str,
        name: &str,
        texts: &[(&'static str, String)],
    ) -> Result<Received, UploadError> {
        let folder = tempfile::tempdir_in(store.incoming())?;
        let mut received = Received::new(folder, owner, store);
        for (file, text) in texts {
            fs::write(received.folder.path().join(file), text)?;
            received.files.insert(PathBuf::from(file));
        }
        received.name = Some(name.to_owned());
        received.is_numbered = true;
        Ok(received)
    }

    /// Expands archives, hashes the files and lists the upload.
    ///
    /// # Errors
    /// [`UploadError`].
    pub fn list(mut self, owner: &str, store: &Store, limits: &ServeArgs) -> Result<Upload, UploadError> {
        let name = match &self.name {
            Some(name) if names::is_upload_name(name) => name.clone(),
            Some(name) => {
                return Err(UploadError::Wrong(format!(
                    "`{name}` cannot be the name of an upload: expected letters, digits, - . _ and +, and another name than those of the \
                     service's own files (data, jobs, job.toml …)"
                )));
            }
            None => names::upload_name_from(
                self.first.split_once(['/', '\\']).map_or(self.first.as_str(), |(folder, _)| folder),
            ),
        };
        // The folder that a browser sends a folder's files with is the upload itself.
        let mut root = self.folder.path().to_owned();
        let work = tempfile::tempdir_in(store.incoming())?;
        let only = self.files.first().filter(|_| self.files.len() == 1).map(|path| root.join(path));
        if let Some(archive) = only
            && is_archive(&archive)?
        {
            root = self.expand(&archive, work.path(), owner, store, limits)?;
        }
        let root = inner_folder(&root)?;
        let Contents { files, folders, sha256 } = hash_files(&root, limits)?;
        let blocks = folders.saturating_add(files.len() as u64).saturating_mul(BLOCK);
        let taken = files.iter().map(|file| file.bytes).fold(blocks, u64::saturating_add);
        let others = store.stored_bytes(owner)?.saturating_sub(self.space.bytes());
        if others.saturating_add(taken) > limits.max_stored {
            return Err(too_much(limits.max_stored));
        }
        self.space.set(taken);
        let mut upload = Upload {
            id: random_name(16),
            name: name.clone(),
            files: files.len() as u64,
            folders,
            bytes: files.iter().map(|file| file.bytes).sum(),
            sha256,
            created: now(),
        };
        let target = store.upload_folder(&upload.id);
        fs::rename(&root, &target)?;
        sync_folder(&store.root().join("uploads"))?;
        let paths: Vec<String> = files.iter().map(|file| file.path.clone()).collect();
        if let Err(error) = store.keep(Kind::Upload, &upload.id, &paths) {
            store.discard(Kind::Upload, &upload.id)?;
            return Err(error.into());
        }
        let most = if self.is_numbered { MAX_NUMBER } else { 1 };
        for number in 1..=most {
            upload.name = if number == 1 { name.clone() } else { format!("{name}-{number}") };
            if store.add_upload(owner, &upload, &files)? {
                // The database counts it from now on.
                self.space.set(0);
                return Ok(upload);
            }
        }
        store.discard(Kind::Upload, &upload.id)?;
        Err(UploadError::Taken(name))
    }

    /// Expands an archive within the room that its owner has, of which it takes no more than the directory of
    /// the archive says. Returns the folder of its files.
    fn expand(
        &mut self,
        archive: &Path,
        work: &Path,
        owner: &str,
        store: &Store,
        limits: &ServeArgs,
    ) -> Result<PathBuf, UploadError> {
        let unpacking = Unpacking::new(archive, work, limits)?;
        let stated = unpacking.stated_size()?;
        self.space.add(stated.bytes.saturating_add(stated.files.saturating_mul(BLOCK)));
        if store.stored_bytes(owner)? > limits.max_stored {
            return Err(too_much(limits.max_stored));
        }
        unpacking.expand(stated.bytes)
    }
}

/// The folder itself, or the only thing in it if that is a folder. The folder `data` stays: files of HELIOS++
/// name others by it.
fn inner_folder(folder: &Path) -> io::Result<PathBuf> {
    let entries: Vec<_> = fs::read_dir(folder)?.collect::<io::Result<_>>()?;
    match entries.as_slice() {
        [only] if only.file_type()?.is_dir() && only.file_name() != names::DATA => Ok(only.path()),
        _ => Ok(folder.to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_only_folder_of_an_upload_is_the_upload_unless_files_are_named_by_it() {
        for (made, inner) in [("wood/a", "wood"), ("data/scenes/a", ""), ("wood/data/a", "wood"), ("a", "")] {
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join(made);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, "").unwrap();
            assert_eq!(inner_folder(folder.path()).unwrap(), folder.path().join(inner), "{made}");
        }
    }
}
