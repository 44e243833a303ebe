//! Packed scenes: everything that tracing needs in one file, mapped instead of read.
//!
//! A pack holds, for every epoch, the frozen scene and the tree over it, as arrays that are used where they stand in the
//! file; so it is open in milliseconds whatever its size, and programs that share one share its memory. Beside them stand
//! the parts, materials and motions, what the scene depended on (wavelength, seed, switches), and the files that it was
//! made from. What opening checks and what it leaves to [`Pack::verify`] is told in [`crate::store`].

mod contents;
mod origin;
#[cfg(test)]
mod tests;

pub use origin::Conditions;

use super::{LoadOptions, Scene, SceneFrame, count_epochs, load_epoch};
use crate::diag::Diagnostics;
use crate::error::Result;
use crate::store::{ArrayFile, ArrayFileWriter, ByteWriter};
use crate::survey::SceneRecipe;
use crate::tree::BuildOptions;
use contents::Contents;
use origin::Origin;
use std::path::Path;

/// Most epochs of a packed scene, each of which is stored whole.
const MAX_EPOCHS: u32 = 64;

/// An open packed scene.
pub struct Pack {
    file: ArrayFile,
    origin: Origin,
    contents: Contents,
}

/// What [`pack`] wrote.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Packed {
    /// Length of the file.
    pub bytes: u64,
    /// Primitives of the first epoch.
    pub primitives: usize,
    /// States of swapped parts.
    pub epochs: u32,
}

/// Loads a scene from its sources and packs it with its tree as `path`.
///
/// # Errors
/// As [`load_epoch`]; a scene of more than 64 epochs, and one that is packed already, are refused.
pub fn pack(
    recipe: &SceneRecipe,
    options: &LoadOptions,
    tree: &BuildOptions,
    path: &Path,
) -> Result<(Packed, Diagnostics)> {
    let epochs = count_epochs(recipe)?;
    if recipe.packed.is_some() {
        return Err(crate::Error::input(format!("{} is packed already", recipe.path.display())));
    }
    if epochs > MAX_EPOCHS {
        let message = format!("the scene has {epochs} epochs; at most {MAX_EPOCHS} can be packed");
        return Err(crate::Error::input(message));
    }
    let (mut out, mut words) = (ArrayFileWriter::create(path)?, ByteWriter::default());
    let mut origin = Origin::of(recipe, options, tree.builder);
    let (mut warnings, mut first, mut primitives) = (Diagnostics::default(), None, 0);
    words.u64(u64::from(epochs));
    for epoch in 0..epochs {
        let (scene, found) = load_epoch(recipe, options, epoch, first)?;
        warnings.extend(found);
        first = first.or(Some(SceneFrame::of(&scene)));
        primitives = primitives.max(scene.primitives());
        origin.add(&scene);
        contents::write(&scene, &scene.tree(tree), epoch, &mut out, &mut words)?;
    }
    out.array("scene", words.bytes())?;
    out.array("origin", origin.finish(path)?.bytes())?;
    Ok((Packed { bytes: out.finish()?, primitives, epochs }, warnings))
}

impl Pack {
    /// Opens a packed scene.
    ///
    /// # Errors
    /// [`crate::Error::Input`] with the reason when the file is no packed scene of this version and machine, damaged, or
    /// older than the files that it was made from.
    pub fn open(path: &Path) -> Result<Pack> {
        let file = ArrayFile::open(path)?;
        let section = |name: &str| file.checked(name).map_err(|reason| file.refuse(&reason));
        let origin = Origin::read(&section("origin")?).map_err(|reason| file.refuse(&reason))?;
        origin.check_files(path).map_err(|reason| file.refuse(&reason))?;
        let contents = Contents::read(&section("scene")?).map_err(|reason| file.refuse(&reason))?;
        Ok(Pack { file, origin, contents })
    }

    /// How often a survey over the scene is flown.
    pub fn epochs(&self) -> u32 {
        self.contents.epochs()
    }

    /// What it was packed for.
    pub fn conditions(&self) -> &Conditions {
        &self.origin.conditions
    }

    /// The scene in the state of an epoch, with its tree.
    ///
    /// # Errors
    /// [`crate::Error::Input`] when the scene was packed under other conditions that matter to it.
    pub fn scene(&self, options: &LoadOptions, epoch: u32) -> Result<Scene> {
        self.origin.conditions.check(options).map_err(|reason| self.file.refuse(&reason))?;
        if let Some(limit) = options.max_memory.filter(|limit| self.file.length() > *limit) {
            let (has, limit) =
                (super::assembly::as_size(self.file.length()), super::assembly::as_size(limit));
            return Err(self.file.refuse(&format!("it has {has}; the limit is {limit}")));
        }
        let epoch = epoch.min(self.epochs().saturating_sub(1));
        self.contents
            .scene(&self.file, epoch, self.origin.builder)
            .map_err(|reason| self.file.refuse(&reason))
    }

    /// Reads the whole file and compares all checksums and all numbers of vertices.
    ///
    /// # Errors
    /// [`crate::Error::Input`] that tells what is damaged.
    pub fn verify(&self) -> Result<()> {
        self.file.verify()?;
        for epoch in 0..self.epochs() {
            let scene = self.contents.scene(&self.file, epoch, self.origin.builder);
            let scene = scene.map_err(|reason| self.file.refuse(&reason))?;
            let models = scene.instances.iter().flat_map(|p| &p.instances.models);
            let sound = scene.geometry.is_sound() && models.into_iter().all(|m| m.geometry.is_sound());
            if !sound {
                return Err(self.file.refuse("a triangle names a vertex that is not there"));
            }
        }
        Ok(())
    }
}
