//! Packs scenes.

use super::contents;
use super::origin::Origin;
use super::read::Pack;
use crate::builder::LoadOptions;
use crate::epoch::{SceneFrame, count_epochs};
use crate::load::load_epoch;
use std::path::Path;
use std::time::{Duration, Instant};
use vlscan_base::diag::Diagnostics;
use vlscan_base::error::{Error, Result};
use vlscan_base::store::ArrayFileWriter;
use vlscan_survey::SceneRecipe;
use vlscan_trace::BuildOptions;

/// Maximum number of epochs of a packed scene, each of which is stored completely.
const MAX_EPOCHS: u32 = 64;

/// Summary of what [`pack`] wrote.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Packed {
    /// Length of the file, bytes.
    pub bytes: u64,
    /// Number of primitives of the first epoch.
    pub primitives: usize,
    pub epochs: u32,
    /// Time to open the file and its first epoch; `None` for a stream.
    pub opens: Option<Duration>,
}

/// Loads a scene from its sources and packs it with its tree as `path`. `warn` gets the warnings before the
/// file has its name, which it gets only if it can be opened.
///
/// # Errors
/// The errors of [`load_epoch`]; [`vlscan_base::Error::Input`] for more than 64 epochs, for a scene that is
/// already packed, and for a `path` that is one of the sources; those of `warn`.
pub fn pack(
    recipe: &SceneRecipe,
    options: &LoadOptions,
    tree: &BuildOptions,
    path: &Path,
    warn: &dyn Fn(&Diagnostics) -> Result<()>,
) -> Result<Packed> {
    let epochs = count_epochs(recipe)?;
    if recipe.packed.is_some() {
        return Err(Error::input(format!("{} is already a packed scene", recipe.path.display())));
    }
    if epochs > MAX_EPOCHS {
        let message = format!("the scene has {epochs} epochs; at most {MAX_EPOCHS} can be packed");
        return Err(Error::input(message));
    }
    let mut origin = Origin::of(recipe, options, tree.builder);
    origin.refuse_replacing(path)?;
    let mut out = ArrayFileWriter::create(path)?;
    let (mut warnings, mut first, mut primitives) = (Diagnostics::default(), None, 0);
    for epoch in 0..epochs {
        let (scene, found) = load_epoch(recipe, options, epoch, first)?;
        warnings.extend(found);
        first = first.or(Some(SceneFrame::of(&scene)));
        primitives = primitives.max(scene.primitives());
        origin.add(&scene);
        contents::write(&scene, &scene.tree(tree), epoch, &mut out)?;
    }
    warn(&warnings)?;
    origin.refuse_replacing(path)?;
    contents::write_epochs(epochs, &mut out)?;
    origin.write(path, &mut out)?;
    let mut opens = None;
    let bytes = out.finish_checked(|file| {
        let started = Instant::now();
        let pack = Pack::open(file)?;
        for epoch in 0..epochs {
            pack.scene(options, epoch)?;
            opens = opens.or(Some(started.elapsed()));
        }
        Ok(())
    })?;
    Ok(Packed { bytes, primitives, epochs, opens })
}
