//! A bucket of an S3-compatible store. Credentials and the address of the store are taken from the variables
//! `AWS_…` of the environment.

use crate::beneath::Beneath;
use crate::records::Kind;
use axum::body::Body;
use futures_util::{StreamExt as _, TryStreamExt as _};
use object_store::aws::AmazonS3Builder;
use object_store::buffered::BufWriter;
use object_store::path::Path as Key;
use object_store::{GetOptions, GetRange, ObjectStore, ObjectStoreExt as _};
use std::collections::BTreeSet;
use std::io;
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;
use tokio::io::{AsyncWriteExt as _, BufReader, copy_buf};
use tokio::runtime::Handle;

/// Bytes that are read or written at a time.
const BUFFER: usize = 1 << 20;
/// Parts of a file that are sent at the same time.
const MAX_PARTS: usize = 2;
/// The object with the id of the service, and the prefix of what its database does not list.
const SERVICE: &str = "service-id";
const LOST: &str = "lost";

/// A bucket and the prefix of the service's objects in it.
#[derive(Debug)]
pub struct Bucket {
    store: Arc<dyn ObjectStore>,
    prefix: Key,
    runtime: Handle,
}

impl Bucket {
    /// The bucket of an address `s3://BUCKET/PREFIX`.
    ///
    /// # Errors
    /// For an address of another form, and when the environment lacks credentials.
    pub fn new(address: &str, runtime: Handle) -> io::Result<Bucket> {
        let wrong = || {
            let message = format!("--store {address}: expected s3://BUCKET or s3://BUCKET/PREFIX");
            io::Error::new(io::ErrorKind::InvalidInput, message)
        };
        let rest = address.strip_prefix("s3://").ok_or_else(wrong)?;
        let (name, prefix) = rest.split_once('/').unwrap_or((rest, ""));
        if name.is_empty() {
            return Err(wrong());
        }
        // Another provider may have been installed by a program that uses this library.
        let _ = rustls::crypto::ring::default_provider().install_default();
        let store = AmazonS3Builder::from_env().with_bucket_name(name).build().map_err(io::Error::other)?;
        Ok(Bucket { store: Arc::new(store), prefix: Key::from(prefix), runtime })
    }

    fn key(&self, kind: Kind, id: &str, path: &str) -> Key {
        let parts = [kind.name(), id].into_iter().chain(path.split('/'));
        parts.filter(|part| !part.is_empty()).fold(self.prefix.clone(), |key, part| key.join(part))
    }

    /// Stores files of a folder.
    ///
    /// # Errors
    /// Errors of files and of the store.
    pub(crate) fn put(&self, kind: Kind, id: &str, folder: &Path, paths: &[String]) -> io::Result<()> {
        let folder = Beneath::of(folder)?;
        self.runtime.block_on(async {
            for path in paths {
                let file = tokio::fs::File::from_std(folder.file(path)?);
                let mut file = BufReader::with_capacity(BUFFER, file);
                let object = BufWriter::new(Arc::clone(&self.store), self.key(kind, id, path));
                let mut object = object.with_max_concurrency(MAX_PARTS);
                let copied = match copy_buf(&mut file, &mut object).await {
                    Ok(_) => object.shutdown().await,
                    Err(error) => Err(error),
                };
                if let Err(error) = copied {
                    // What was sent so far is no object.
                    let _ = object.abort().await;
                    return Err(error);
                }
            }
            Ok(())
        })
    }

    /// Fetches files into a folder.
    ///
    /// # Errors
    /// Errors of files and of the store.
    pub(crate) fn get(&self, kind: Kind, id: &str, folder: &Path, paths: &[String]) -> io::Result<()> {
        self.runtime.block_on(async {
            for path in paths {
                let target = folder.join(path);
                if let Some(parent) = target.parent() {
                    tokio::fs::create_dir_all(parent).await?;
                }
                let mut file = tokio::fs::File::create_new(&target).await?;
                let mut bytes = self.store.get(&self.key(kind, id, path)).await?.into_stream();
                while let Some(chunk) = bytes.try_next().await? {
                    file.write_all(&chunk).await?;
                }
                file.flush().await?;
            }
            Ok(())
        })
    }

    /// A file.
    ///
    /// # Errors
    /// Errors of the store.
    pub(crate) fn read(&self, kind: Kind, id: &str, path: &str) -> io::Result<Vec<u8>> {
        let key = self.key(kind, id, path);
        let bytes = self.runtime.block_on(async { self.store.get(&key).await?.bytes().await })?;
        Ok(bytes.into())
    }

    /// A part of a file as the body of an answer.
    ///
    /// # Errors
    /// Errors of the store.
    pub(crate) async fn body(&self, kind: Kind, id: &str, path: &str, range: Range<u64>) -> io::Result<Body> {
        // Ranges without bytes are none to the store.
        if range.is_empty() {
            return Ok(Body::empty());
        }
        let wanted = GetOptions { range: Some(GetRange::Bounded(range)), ..GetOptions::default() };
        let found = self.store.get_opts(&self.key(kind, id, path), wanted).await?;
        Ok(Body::from_stream(found.into_stream()))
    }

    /// The id of the service that the prefix belongs to, if it has one.
    ///
    /// # Errors
    /// Errors of the store.
    pub(crate) fn service(&self) -> io::Result<Option<String>> {
        let key = self.prefix.clone().join(SERVICE);
        let found = self.runtime.block_on(async {
            match self.store.get(&key).await {
                Ok(found) => Ok(Some(found.bytes().await?)),
                Err(object_store::Error::NotFound { .. }) => Ok(None),
                Err(error) => Err(io::Error::from(error)),
            }
        })?;
        Ok(found.map(|bytes| String::from_utf8_lossy(&bytes).trim().to_owned()))
    }

    /// Gives the prefix to a service.
    ///
    /// # Errors
    /// Errors of the store.
    pub(crate) fn set_service(&self, id: &str) -> io::Result<()> {
        let key = self.prefix.clone().join(SERVICE);
        self.runtime.block_on(self.store.put(&key, id.to_owned().into()))?;
        Ok(())
    }

    /// Moves all files of an upload or of results below `lost/`.
    ///
    /// # Errors
    /// Errors of the store.
    pub(crate) fn set_aside(&self, kind: Kind, id: &str) -> io::Result<()> {
        self.runtime.block_on(async {
            let found = self.store.list(Some(&self.key(kind, id, "")));
            for object in found.try_collect::<Vec<_>>().await? {
                let inner = object.location.prefix_match(&self.prefix).into_iter().flatten();
                let lost = self.prefix.clone().join(LOST);
                let lost = inner.fold(lost, |key, part| key.join(part));
                self.store.rename(&object.location, &lost).await?;
            }
            Ok(())
        })
    }

    /// Removes all files of an upload or of results.
    ///
    /// # Errors
    /// Errors of the store.
    pub(crate) fn remove(&self, kind: Kind, id: &str) -> io::Result<()> {
        self.runtime.block_on(async {
            let found = self.store.list(Some(&self.key(kind, id, "")));
            let keys = found.map_ok(|object| object.location).boxed();
            self.store.delete_stream(keys).try_collect::<Vec<Key>>().await?;
            Ok(())
        })
    }

    /// The uploads or results that have files.
    ///
    /// # Errors
    /// Errors of the store.
    pub(crate) fn ids(&self, kind: Kind) -> io::Result<BTreeSet<String>> {
        let prefix = self.key(kind, "", "");
        let found = self.runtime.block_on(self.store.list_with_delimiter(Some(&prefix)))?;
        let last = |key: &Key| key.filename().map(str::to_owned);
        Ok(found.common_prefixes.iter().filter_map(last).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_name_a_bucket() {
        let runtime = tokio::runtime::Builder::new_current_thread().build().unwrap();
        for address in ["bucket", "s3://", "s3:///a", "https://example.org/bucket"] {
            let refused = Bucket::new(address, runtime.handle().clone()).unwrap_err().to_string();
            assert!(refused.contains("expected s3://BUCKET"), "{refused}");
        }
    }
}
