//! Whole documents as users write them.

use super::*;
use crate::diag::Diagnostics;
use crate::error::Error;
use std::path::{Path, PathBuf};

mod conformance;

/// A folder of files that is removed afterwards.
struct Folder(tempfile::TempDir);

impl Folder {
    fn new(files: &[(&str, &str)]) -> Folder {
        let folder = Folder(tempfile::tempdir().unwrap());
        files.iter().for_each(|(name, text)| folder.write(name, text));
        folder
    }

    fn write(&self, name: &str, text: &str) {
        let path = self.path(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, text).unwrap();
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn survey(&self) -> crate::Result<(Survey, Diagnostics)> {
        read_survey(&self.path("survey.xml"), &ReadOptions::default())
    }
}
