//! Opens packed scenes.

use super::contents::{Contents, are_arrays_valid};
use super::origin::Origin;
use crate::error::Result;
use crate::scene::builder::{LoadOptions, format_bytes};
use crate::scene::conditions::Conditions;
use crate::scene::model::Scene;
use crate::store::ArrayFile;
use std::path::Path;

pub struct Pack {
    file: ArrayFile,
    origin: Origin,
    contents: Contents,
}

impl Pack {
    /// Opens a packed scene.
    ///
    /// # Errors
    /// [`crate::Error::Input`] with the reason when the file is not a packed scene of this version and byte order, is
    /// damaged, or is older than the files that it was made from.
    pub fn open(path: &Path) -> Result<Pack> {
        let file = ArrayFile::open(path)?;
        let origin = Origin::read(&file.checked("origin")?).map_err(|reason| file.refuse(&reason))?;
        origin.check_files(path).map_err(|reason| file.refuse(&reason))?;
        let contents = Contents::read(&file.checked("scene")?).map_err(|reason| file.refuse(&reason))?;
        Ok(Pack { file, origin, contents })
    }

    pub fn epochs(&self) -> u32 {
        self.contents.epochs()
    }

    pub fn conditions(&self) -> &Conditions {
        &self.origin.conditions
    }

    /// The scene of an epoch, with its tree.
    ///
    /// # Errors
    /// [`crate::Error::Input`] when the scene was packed under other conditions that affect it.
    pub fn scene(&self, options: &LoadOptions, epoch: u32) -> Result<Scene> {
        let checked = self.origin.conditions.check(options);
        checked.map_err(|reason| self.file.refuse(&format!("{reason}; pack the scene again for that")))?;
        if let Some(limit) = options.max_memory.filter(|limit| self.file.length() > *limit) {
            let (has, limit) = (format_bytes(self.file.length()), format_bytes(limit));
            return Err(self.file.refuse(&format!("it has {has}; the limit is {limit}")));
        }
        let epoch = epoch.min(self.epochs().saturating_sub(1));
        self.contents
            .scene(&self.file, epoch, self.origin.builder)
            .map_err(|reason| self.file.refuse(&reason))
    }

    /// Checksum of the contents.
    pub fn fingerprint(&self) -> u64 {
        self.file.fingerprint()
    }

    /// Reads the complete file and checks all checksums and all numbers that name something.
    ///
    /// # Errors
    /// [`crate::Error::Input`] with a description of the damage.
    pub fn verify(&self) -> Result<()> {
        self.file.verify()?;
        for epoch in 0..self.epochs() {
            let scene = self.contents.scene(&self.file, epoch, self.origin.builder);
            let scene = scene.map_err(|reason| self.file.refuse(&reason))?;
            if !are_arrays_valid(&scene) {
                return Err(self.file.refuse("a number in its arrays names something that is not there"));
            }
        }
        Ok(())
    }
}
