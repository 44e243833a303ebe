//! In place of `bucket` in programs that are built without the feature `s3`.

use crate::records::Kind;
use axum::body::Body;
use std::collections::BTreeSet;
use std::io;
use std::ops::Range;
use std::path::Path;
use tokio::runtime::Handle;

/// There is none.
#[derive(Debug)]
pub enum Bucket {}

impl Bucket {
    /// # Errors
    /// Always.
    pub fn new(address: &str, _: Handle) -> io::Result<Bucket> {
        let message = format!(
            "--store {address}: this program has no buckets; install it with `cargo install \
             --locked --path apps/serve --features s3`"
        );
        Err(io::Error::new(io::ErrorKind::Unsupported, message))
    }

    pub(crate) fn put(&self, _: Kind, _: &str, _: &Path, _: &[String]) -> io::Result<()> {
        match *self {}
    }

    pub(crate) fn get(&self, _: Kind, _: &str, _: &Path, _: &[String]) -> io::Result<()> {
        match *self {}
    }

    pub(crate) fn read(&self, _: Kind, _: &str, _: &str) -> io::Result<Vec<u8>> {
        match *self {}
    }

    pub(crate) async fn body(&self, _: Kind, _: &str, _: &str, _: Range<u64>) -> io::Result<Body> {
        match *self {}
    }

    pub(crate) fn service(&self) -> io::Result<Option<String>> {
        match *self {}
    }

    pub(crate) fn set_service(&self, _: &str) -> io::Result<()> {
        match *self {}
    }

    pub(crate) fn set_aside(&self, _: Kind, _: &str) -> io::Result<()> {
        match *self {}
    }

    pub(crate) fn remove(&self, _: Kind, _: &str) -> io::Result<()> {
        match *self {}
    }

    pub(crate) fn ids(&self, _: Kind) -> io::Result<BTreeSet<String>> {
        match *self {}
    }
}
