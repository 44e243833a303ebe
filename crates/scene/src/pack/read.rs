//! Opens packed scenes.

use super::colours::has_colours;
use super::contents::{are_arrays_valid, is_of_epoch, prefix, read_epochs, read_scene};
use super::origin::Origin;
use super::tiles::{PackedTiles, has_tiles};
use crate::builder::LoadOptions;
use crate::conditions::Conditions;
use crate::model::Scene;
use std::path::Path;
use std::sync::Arc;
use vlscan_base::error::Result;
use vlscan_base::quantity;
use vlscan_base::recognise::{Expected, Family, Foreign, foreign_file};
use vlscan_base::store::ArrayFile;

/// An open packed scene.
pub struct Pack {
    file: Arc<ArrayFile>,
    origin: Origin,
    epochs: u32,
}

impl Pack {
    /// Opens a packed scene. Its arrays are read with the scene of an epoch.
    ///
    /// # Errors
    /// [`vlscan_base::Error::Input`] with the reason when the file is not a packed scene of this version and
    /// byte order, is damaged, or is older than the files that it was made from.
    pub fn open(path: &Path) -> Result<Pack> {
        let is_known =
            |found: &Foreign| !matches!(found.kind.family, Family::Binary | Family::Text | Family::Empty);
        if let Some(found) = foreign_file(path, &Expected::PACKED).filter(is_known) {
            return Err(found.error(path));
        }
        let file = ArrayFile::open(path)?;
        let origin = Origin::read(&file)?;
        origin.check_files(path).map_err(|changed| file.refuse_because(changed))?;
        let epochs = read_epochs(&file)?;
        Ok(Pack { file: Arc::new(file), origin, epochs })
    }

    /// Number of epochs.
    pub fn epochs(&self) -> u32 {
        self.epochs
    }

    /// The settings that the scene was packed with.
    pub fn conditions(&self) -> &Conditions {
        &self.origin.conditions
    }

    /// `defaults`, with the settings that the scene was packed with where it depends on them.
    pub fn load_options(&self, defaults: LoadOptions) -> LoadOptions {
        let c = self.conditions();
        LoadOptions {
            wavelength_nm: c.wavelength_nm,
            further_wavelengths_nm: c.further_wavelengths_nm.clone(),
            seed: c.seed,
            rules: c.rules,
            drop_polygons: c.drop_polygons,
            ..defaults
        }
    }

    /// True if parts of the scene of an epoch are tiles, which are read when rays need them.
    pub fn has_tiles(&self, epoch: u32) -> bool {
        has_tiles(&self.file, &prefix(epoch))
    }

    /// True if the scene of an epoch was packed with the colours of its surfaces.
    pub fn has_colours(&self, epoch: u32) -> bool {
        has_colours(&self.file, &prefix(epoch))
    }

    /// Reads the scene of an epoch, with its tree. All that it consists of is compared with its checksums;
    /// tiles are when rays need them. Without [`LoadOptions::tiles`] they stay in memory.
    ///
    /// # Errors
    /// [`vlscan_base::Error::Input`] when the scene was packed under other conditions that affect it, is
    /// damaged, or needs more memory than the options permit; [`vlscan_base::Error::Io`] when it cannot be
    /// read.
    pub fn scene(&self, options: &LoadOptions, epoch: u32) -> Result<Scene> {
        let checked = self.origin.conditions.check(options);
        checked.map_err(|reason| self.file.refuse(&format!("{reason}; pack the scene again for that")))?;
        let epoch = epoch.min(self.epochs().saturating_sub(1));
        let needed = self.file.bytes_of(|name| is_of_epoch(name, epoch, options.colours));
        if let Some(limit) = options.max_memory.filter(|limit| needed > *limit) {
            let (needed, limit) = (quantity::bytes(needed), quantity::bytes(limit));
            return Err(self.file.refuse(&format!("its scene needs {needed}; the limit is {limit}")));
        }
        let mut scene = read_scene(&self.file, &prefix(epoch), self.origin.builder, options.colours)?;
        if self.has_tiles(epoch) {
            let tiles = self.tiles(&scene, epoch)?;
            let needed = needed.saturating_add(tiles.bytes());
            let limit = options.max_memory.filter(|limit| options.tiles.is_none() && needed > *limit);
            if let Some(limit) = limit {
                let [needed, limit] = [needed, limit].map(quantity::bytes);
                let reason = format!("its scene needs {needed} with all tiles; the limit is {limit}");
                return Err(self.file.refuse(&format!("{reason}; give --scene-memory less than that")));
            }
            scene.tiles = Some(Arc::new(tiles.finish(options, scene.numbers())?));
        }
        Ok(scene)
    }

    fn tiles(&self, scene: &Scene, epoch: u32) -> Result<PackedTiles> {
        PackedTiles::read(&self.file, &prefix(epoch), scene, self.origin.builder)
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
            let scene = read_scene(&self.file, &prefix(epoch), self.origin.builder, true)?;
            let mut is_valid = are_arrays_valid(&scene);
            if self.has_tiles(epoch) {
                let tiles = self.tiles(&scene, epoch)?;
                for tile in 0..tiles.len() {
                    is_valid &= are_arrays_valid(&tiles.read_tile(tile, true)?);
                }
            }
            if !is_valid {
                return Err(self
                    .file
                    .refuse("an index in its arrays refers to something that does not exist"));
            }
        }
        Ok(())
    }
}
