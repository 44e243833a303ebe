//! Storage of the files of uploads and results: the folder of the service, or a bucket. From a bucket they
//! are fetched into the folder when a job or a picture needs them, and removed there afterwards.

use crate::beneath::Beneath;
use crate::bucket::Bucket;
use crate::names::relative_path;
use crate::records::Kind;
use crate::store::{Result, ResultFile, Store, StoreError, remove_folder};
use std::collections::{BTreeSet, HashMap};
use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Place of files.
#[derive(Debug, Default)]
pub enum Files {
    /// In the folder of the service.
    #[default]
    Folder,
    /// In a bucket.
    Bucket(Bucket),
}

impl Files {
    /// Folder from the command line.
    ///
    /// # Errors
    /// For an address that is none of a bucket.
    pub fn of(store: Option<&str>, runtime: &tokio::runtime::Handle) -> std::io::Result<Files> {
        match store {
            None => Ok(Files::Folder),
            Some(address) => Ok(Files::Bucket(Bucket::new(address, runtime.clone())?)),
        }
    }

    /// The id of the service that a bucket belongs to, if it has one.
    ///
    /// # Errors
    /// Errors of the bucket.
    pub(crate) fn id(&self) -> Result<Option<String>> {
        match self {
            Files::Folder => Ok(None),
            Files::Bucket(bucket) => bucket.service().map_err(StoreError::Bucket),
        }
    }

    /// Gives a bucket to a service.
    ///
    /// # Errors
    /// Errors of the bucket.
    pub(crate) fn set_id(&self, id: &str) -> Result<()> {
        match self {
            Files::Folder => Ok(()),
            Files::Bucket(bucket) => bucket.set_service(id).map_err(StoreError::Bucket),
        }
    }

    /// True if a bucket has uploads or results.
    ///
    /// # Errors
    /// Errors of the bucket.
    pub(crate) fn has_objects(&self) -> Result<bool> {
        match self {
            Files::Folder => Ok(false),
            Files::Bucket(bucket) => {
                let found = [Kind::Upload, Kind::Results].map(|kind| bucket.ids(kind));
                let found = found.into_iter().collect::<std::io::Result<Vec<_>>>();
                Ok(found.map_err(StoreError::Bucket)?.iter().any(|ids| !ids.is_empty()))
            }
        }
    }
}

/// Number of users of the local copy of an upload or of results.
pub(crate) type Fetches = Mutex<HashMap<(Kind, String), Arc<Mutex<usize>>>>;

/// Files that are in the folder of the service at least until this is dropped.
#[derive(Debug)]
pub struct Fetched<'s> {
    store: &'s Store,
    key: (Kind, String),
}

impl Drop for Fetched<'_> {
    fn drop(&mut self) {
        let mut all = held(&self.store.fetches);
        let Some(count) = all.get(&self.key).map(Arc::clone) else { return };
        let mut left = held(&count);
        *left -= 1;
        if *left > 0 {
            return;
        }
        self.store.remove_copy(self.key.0, &self.key.1);
        // Who waits for the count has a reference to it.
        if Arc::strong_count(&count) == 2 {
            all.remove(&self.key);
        }
    }
}

fn held<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Store {
    /// The folder in which the files are while they are used, and always if there is no bucket.
    pub fn local(&self, kind: Kind, id: &str) -> PathBuf {
        match kind {
            Kind::Upload => self.upload_folder(id),
            Kind::Results => self.job_folder(id).join("out"),
        }
    }

    /// Keeps files that are in their folder. To be called before they are listed in the database.
    ///
    /// # Errors
    /// Errors of the bucket.
    pub fn keep(&self, kind: Kind, id: &str, paths: &[String]) -> Result<()> {
        match &self.kept {
            Files::Folder => {}
            Files::Bucket(bucket) => {
                let folder = self.local(kind, id);
                bucket.put(kind, id, &folder, paths).map_err(StoreError::Bucket)?;
                // The folder is there as a whole or not at all, whenever the service is ended.
                let gone = self.new_incoming();
                std::fs::rename(&folder, &gone)?;
                std::fs::remove_dir_all(gone)?;
            }
        }
        Ok(())
    }

    /// Makes sure that files are in their folder.
    ///
    /// # Errors
    /// Errors of files and of the bucket.
    pub fn fetch(&self, kind: Kind, id: &str) -> Result<Option<Fetched<'_>>> {
        match &self.kept {
            Files::Folder => Ok(None),
            Files::Bucket(bucket) => {
                let key = (kind, id.to_owned());
                let count = Arc::clone(held(&self.fetches).entry(key.clone()).or_default());
                let mut count = held(&count);
                let folder = self.local(kind, id);
                if *count == 0 && !folder.is_dir() {
                    let part = self.new_incoming();
                    std::fs::create_dir_all(&part)?;
                    let paths: Vec<String> =
                        self.listed(kind, id)?.into_iter().map(|file| file.path).collect();
                    if let Err(error) = bucket.get(kind, id, &part, &paths) {
                        // It is tried again, with a new folder.
                        remove_folder(&part)?;
                        return Err(StoreError::Bucket(error));
                    }
                    folder.parent().map_or(Ok(()), std::fs::create_dir_all)?;
                    std::fs::rename(&part, &folder)?;
                }
                *count += 1;
                Ok(Some(Fetched { store: self, key }))
            }
        }
    }

    /// Removes the copy of files in a bucket, unless it is used, or an unfinished job reads it, perhaps by
    /// tasks of an engine.
    pub fn release_copy(&self, kind: Kind, id: &str) {
        let all = held(&self.fetches);
        if self.has_bucket() && !all.contains_key(&(kind, id.to_owned())) {
            self.remove_copy(kind, id);
        }
    }

    fn remove_copy(&self, kind: Kind, id: &str) {
        if !self.is_used(id).unwrap_or(true) {
            let _ = std::fs::remove_dir_all(self.local(kind, id));
        }
    }

    /// A small file; `None` if there is none of that name, or it has more bytes.
    ///
    /// # Errors
    /// Errors of files and of the bucket.
    pub fn read(&self, kind: Kind, id: &str, path: &str, max_bytes: u64) -> Result<Option<Vec<u8>>> {
        match &self.kept {
            Files::Folder => {
                let Some(path) = relative_path(path) else { return Ok(None) };
                // What is no file of a job's or an upload's own has no content.
                let found =
                    Beneath::of(&self.local(kind, id)).and_then(|folder| folder.read(path, max_bytes));
                Ok(found.ok())
            }
            Files::Bucket(bucket) => {
                let files = self.listed(kind, id)?;
                match files.iter().find(|file| file.path == path && file.bytes <= max_bytes) {
                    Some(file) => Ok(Some(bucket.read(kind, id, &file.path).map_err(StoreError::Bucket)?)),
                    None => Ok(None),
                }
            }
        }
    }

    /// Removes files that the database does not list any more, and the note of their removal.
    ///
    /// # Errors
    /// Errors of files and of the database. Objects that stay in a bucket are reported; the next start
    /// removes them.
    pub(crate) fn discard(&self, kind: Kind, id: &str) -> Result<()> {
        let folder = match kind {
            Kind::Upload => self.upload_folder(id),
            Kind::Results => self.job_folder(id),
        };
        if let Files::Bucket(bucket) = &self.kept
            && let Err(error) = bucket.remove(kind, id)
        {
            eprintln!("vlscan serve: {}/{id} stays in the bucket until the next start: {error}", kind.name());
            return Ok(remove_folder(&folder)?);
        }
        remove_folder(&folder)?;
        self.database().execute("DELETE FROM removed WHERE kind = ? AND id = ?", [kind.name(), id])?;
        Ok(())
    }

    /// The uploads or results that have files in the bucket.
    ///
    /// # Errors
    /// Errors of the bucket.
    pub(crate) fn in_bucket(&self, kind: Kind) -> Result<BTreeSet<String>> {
        match &self.kept {
            Files::Folder => Ok(BTreeSet::new()),
            Files::Bucket(bucket) => bucket.ids(kind).map_err(StoreError::Bucket),
        }
    }

    /// True if files are in their folder only while they are used.
    pub(crate) fn has_bucket(&self) -> bool {
        !matches!(self.kept, Files::Folder)
    }

    /// The files that the database lists.
    ///
    /// # Errors
    /// Errors of the database.
    pub(crate) fn listed(&self, kind: Kind, id: &str) -> Result<Vec<ResultFile>> {
        match kind {
            Kind::Upload => {
                let files = self.files(id)?;
                Ok(files.into_iter().map(|file| ResultFile { path: file.path, bytes: file.bytes }).collect())
            }
            Kind::Results => self.results_in(id),
        }
    }
}
