//! Packed scenes: everything that tracing needs in one file, mapped instead of read.
//!
//! A pack holds, for every play, the frozen scene and the tree over it, as arrays that are used where they stand in the
//! file; so it is open in milliseconds whatever its size, and programs that share one share its memory. Beside them stand
//! the parts, materials and motions, what the scene depended on (wavelength, seed, switches), and the files that it was
//! made from. What opening checks and what it leaves to [`Pack::verify`] is told in [`crate::store`].

mod contents;
mod origin;
#[cfg(test)]
mod tests;

pub use origin::Conditions;

use super::{LoadOptions, Scene, Stand, load_play, plays};
use crate::diag::Diagnostics;
use crate::error::Result;
use crate::store::{Archive, Words, Writer};
use crate::survey::SceneRecipe;
use crate::tree::BuildOptions;
use contents::Contents;
use origin::Origin;
use std::path::Path;

/// Most plays of a packed scene, each of which is stored whole.
const MOST_PLAYS: u32 = 64;

/// An open packed scene.
pub struct Pack {
    file: Archive,
    origin: Origin,
    contents: Contents,
}

/// What [`pack`] wrote.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Packed {
    /// Length of the file.
    pub bytes: u64,
    /// Primitives of the first play.
    pub primitives: usize,
    /// States of swapped parts.
    pub plays: u32,
}

/// Loads a scene from its sources and packs it with its tree as `path`.
///
/// # Errors
/// As [`load_play`]; a scene of more than 64 plays, and one that is packed already, are refused.
pub fn pack(
    recipe: &SceneRecipe,
    options: &LoadOptions,
    tree: &BuildOptions,
    path: &Path,
) -> Result<(Packed, Diagnostics)> {
    let plays = plays(recipe)?;
    if recipe.packed.is_some() {
        return Err(crate::Error::input(format!("{} is packed already", recipe.path.display())));
    }
    if plays > MOST_PLAYS {
        let message = format!("the scene has {plays} plays; at most {MOST_PLAYS} can be packed");
        return Err(crate::Error::input(message));
    }
    let (mut out, mut words) = (Writer::create(path)?, Words::default());
    let mut origin = Origin::of(recipe, options, tree.builder);
    let (mut warnings, mut first, mut primitives) = (Diagnostics::default(), None, 0);
    words.u64(u64::from(plays));
    for play in 0..plays {
        let (scene, found) = load_play(recipe, options, play, first)?;
        warnings.extend(found);
        first = first.or(Some(Stand::of(&scene)));
        primitives = primitives.max(scene.primitives());
        origin.add(&scene);
        contents::write(&scene, &scene.tree(tree), play, &mut out, &mut words)?;
    }
    out.array("scene", words.bytes())?;
    out.array("origin", origin.finish(path)?.bytes())?;
    Ok((Packed { bytes: out.finish()?, primitives, plays }, warnings))
}

impl Pack {
    /// Opens a packed scene.
    ///
    /// # Errors
    /// [`crate::Error::Input`] with the reason when the file is no packed scene of this version and machine, damaged, or
    /// older than the files that it was made from.
    pub fn open(path: &Path) -> Result<Pack> {
        let file = Archive::open(path)?;
        let section = |name: &str| file.checked(name).map_err(|reason| file.refuse(&reason));
        let origin = Origin::read(&section("origin")?).map_err(|reason| file.refuse(&reason))?;
        origin.check_files(path).map_err(|reason| file.refuse(&reason))?;
        let contents = Contents::read(&section("scene")?).map_err(|reason| file.refuse(&reason))?;
        Ok(Pack { file, origin, contents })
    }

    /// How often a survey over the scene is flown.
    pub fn plays(&self) -> u32 {
        self.contents.plays()
    }

    /// What it was packed for.
    pub fn conditions(&self) -> &Conditions {
        &self.origin.conditions
    }

    /// The scene in the state of a play, with its tree.
    ///
    /// # Errors
    /// [`crate::Error::Input`] when the scene was packed under other conditions that matter to it.
    pub fn scene(&self, options: &LoadOptions, play: u32) -> Result<Scene> {
        self.origin.conditions.check(options).map_err(|reason| self.file.refuse(&reason))?;
        if let Some(limit) = options.max_memory.filter(|limit| self.file.length() > *limit) {
            let (has, limit) =
                (super::assembly::as_size(self.file.length()), super::assembly::as_size(limit));
            return Err(self.file.refuse(&format!("it has {has}; the limit is {limit}")));
        }
        let play = play.min(self.plays().saturating_sub(1));
        self.contents.scene(&self.file, play, self.origin.builder).map_err(|reason| self.file.refuse(&reason))
    }

    /// Reads the whole file and compares all checksums and all numbers of vertices.
    ///
    /// # Errors
    /// [`crate::Error::Input`] that tells what is damaged.
    pub fn verify(&self) -> Result<()> {
        self.file.verify()?;
        for play in 0..self.plays() {
            let scene = self.contents.scene(&self.file, play, self.origin.builder);
            let scene = scene.map_err(|reason| self.file.refuse(&reason))?;
            let models = scene.placed.iter().flat_map(|p| &p.instances.models);
            let sound = scene.geometry.is_sound() && models.into_iter().all(|m| m.geometry.is_sound());
            if !sound {
                return Err(self.file.refuse("a triangle names a vertex that is not there"));
            }
        }
        Ok(())
    }
}
