//! Opens packed scenes.

use super::contents::{are_arrays_valid, is_of_epoch, read_epochs, read_scene};
use super::origin::Origin;
use crate::builder::LoadOptions;
use crate::conditions::Conditions;
use crate::model::Scene;
use std::path::Path;
use vlscan_base::error::Result;
use vlscan_base::quantity;
use vlscan_base::store::ArrayFile;

/// An open packed scene.
pub struct Pack {
    file: ArrayFile,
    origin: Origin,
    epochs: u32,
}

impl Pack {
    /// Opens a packed scene. Its arrays are read with the scene of an epoch.
    ///
    /// # Errors
    /// [`vlscan_base::Error::Input`] with the reason when the file is not a packed scene of this version and byte order, is
    /// damaged, or is older than the files that it was made from.
    pub fn open(path: &Path) -> Result<Pack> {
        let file = ArrayFile::open(path)?;
        let origin = Origin::read(&file)?;
        origin.check_files(path).map_err(|reason| file.refuse(&reason))?;
        let epochs = read_epochs(&file)?;
        Ok(Pack { file, origin, epochs })
    }

    /// Number of epochs.
    pub fn epochs(&self) -> u32 {
        self.epochs
    }

    /// The settings that the scene was packed with.
    pub fn conditions(&self) -> &Conditions {
        &self.origin.conditions
    }

    /// `usual`, with the settings that the scene was packed with where it depends on them.
    pub fn load_options(&self, usual: LoadOptions) -> LoadOptions {
        let c = self.conditions();
        LoadOptions {
            wavelength_nm: c.wavelength_nm,
            seed: c.seed,
            rules: c.rules,
            drop_polygons: c.drop_polygons,
            ..usual
        }
    }

    /// Reads the scene of an epoch, with its tree. All that it consists of is compared with its checksums.
    ///
    /// # Errors
    /// [`vlscan_base::Error::Input`] when the scene was packed under other conditions that affect it, is damaged, or needs more
    /// memory than the options permit; [`vlscan_base::Error::Io`] when it cannot be read.
    pub fn scene(&self, options: &LoadOptions, epoch: u32) -> Result<Scene> {
        let checked = self.origin.conditions.check(options);
        checked.map_err(|reason| self.file.refuse(&format!("{reason}; pack the scene again for that")))?;
        let epoch = epoch.min(self.epochs().saturating_sub(1));
        let needed = self.file.bytes_of(|name| is_of_epoch(name, epoch));
        if let Some(limit) = options.max_memory.filter(|limit| needed > *limit) {
            let (needed, limit) = (quantity::bytes(needed), quantity::bytes(limit));
            return Err(self.file.refuse(&format!("its scene needs {needed}; the limit is {limit}")));
        }
        read_scene(&self.file, epoch, self.origin.builder)
    }

    /// Checksum of the contents.
    pub fn fingerprint(&self) -> u64 {
        self.file.fingerprint()
    }

    /// Reads the complete file and checks all checksums and all numbers that name something.
    ///
    /// # Errors
    /// [`vlscan_base::Error::Input`] with a description of the damage.
    pub fn verify(&self) -> Result<()> {
        self.file.verify()?;
        for epoch in 0..self.epochs() {
            let scene = read_scene(&self.file, epoch, self.origin.builder)?;
            if !are_arrays_valid(&scene) {
                return Err(self
                    .file
                    .refuse("an index in its arrays refers to something that does not exist"));
            }
        }
        Ok(())
    }
}
