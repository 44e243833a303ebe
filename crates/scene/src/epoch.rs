//! Epochs: repeated surveys of a scene with parts swapped in between (spec input-formats §3.8).

use crate::model::Scene;
use crate::pack::Pack;
use std::borrow::Cow;
use vlscan_base::error::Result;
use vlscan_geom::{Aabb, DVec3};
use vlscan_survey::{Loader, PartRecipe, SceneRecipe, Swap};

/// Number of epochs of a scene: the largest number of states of any part, at least one.
///
/// # Errors
/// When the scene is packed and the pack cannot be used.
pub fn count_epochs(recipe: &SceneRecipe) -> Result<u32> {
    if let Some(path) = &recipe.packed {
        return Ok(Pack::open(path)?.epochs());
    }
    let of = |part: &PartRecipe| part.swaps.iter().fold(1u32, |n, swap| n.saturating_add(swap.epochs));
    Ok(recipe.parts.iter().map(of).max().unwrap_or(1))
}

/// Local frame and bounding box of the first epoch's scene, which determine the frame and box of later
/// epochs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SceneFrame {
    /// World position of the local origin, m.
    pub(super) shift: DVec3,
    bounds: Aabb,
}

impl SceneFrame {
    /// The local frame and bounding box of `scene`, normally the scene of the first epoch.
    pub fn of(scene: &Scene) -> SceneFrame {
        SceneFrame { shift: scene.shift, bounds: scene.bounds }
    }

    /// The bounding box of a later epoch whose primitives have the box `found`: the first epoch's, extended
    /// symmetrically to hold them, or `found` unless the first epoch's frame is kept.
    pub(super) fn bounds(&self, found: Aabb, keep: bool) -> Aabb {
        if found.is_empty() {
            return self.bounds;
        }
        if !keep {
            return found;
        }
        let reach = found.min.abs().max(found.max.abs());
        self.bounds.union(Aabb { min: -reach, max: reach })
    }
}

/// True if later epochs keep the frame of the first: this depends on the last swap of each part, and a single
/// part that does not keep it suffices.
pub(super) fn keeps_frame(recipe: &SceneRecipe) -> bool {
    recipe.parts.iter().filter_map(|p| p.swaps.last()).all(|swap| swap.keep_crs)
}

/// The part in an epoch, counted from 0; `None` if it is absent in that epoch.
pub(super) fn part_in_epoch(part: &PartRecipe, epoch: u32) -> Option<Cow<'_, PartRecipe>> {
    if epoch == 0 || part.swaps.is_empty() {
        return Some(Cow::Borrowed(part));
    }
    let mut swapped = part.clone();
    // The loader for swaps without one: the loader of the first epoch, until the part has been absent once.
    let (mut baseline, mut present, mut begins) = (Some(&part.loader), true, 1u64);
    for swap in &part.swaps {
        if begins > u64::from(epoch) {
            break;
        }
        begins += u64::from(swap.epochs);
        present = apply_swap(&mut swapped, swap, &mut baseline);
    }
    present.then_some(Cow::Owned(swapped))
}

/// Changes the part to its next state; `false` if it is absent in that state.
fn apply_swap<'a>(part: &mut PartRecipe, swap: &'a Swap, baseline: &mut Option<&'a Loader>) -> bool {
    if swap.vanish {
        *baseline = None;
        return false;
    }
    let Some(loader) = swap.loader.as_ref().or(*baseline) else { return false };
    part.loader = loader.clone();
    if let Some(scale) = swap.scale {
        part.transform.scale = scale;
    }
    if let Some((offset, on_ground)) = swap.offset {
        (part.transform.offset, part.transform.on_ground) = (offset, on_ground);
    }
    true
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture::Fixture;
    use std::path::PathBuf;
    use vlscan_survey::MeshReading;

    fn swap(epochs: u32) -> Swap {
        Swap { epochs, keep_crs: true, vanish: false, loader: None, scale: None, offset: None }
    }

    fn loader(file: &str) -> Loader {
        Loader::MeshFiles { files: vec![PathBuf::from(file)], reading: MeshReading::default() }
    }

    fn file_and_scale(part: &PartRecipe, epoch: u32) -> Option<(String, f64)> {
        part_in_epoch(part, epoch).map(|p| match &p.loader {
            Loader::MeshFiles { files, .. } => (files[0].display().to_string(), p.transform.scale),
            _ => unreachable!("only OBJ files here"),
        })
    }

    #[test]
    fn states_follow_one_another_and_the_last_one_stays() {
        // spec input-formats §3.8: small, big, big, absent
        let mut f = Fixture::new();
        let part = f.part(loader("ball"));
        part.swaps = vec![Swap { scale: Some(2.0), ..swap(2) }, Swap { vanish: true, ..swap(1) }];
        let found: Vec<_> = (0..6).map(|epoch| file_and_scale(part, epoch)).collect();
        let ball = |scale| Some(("ball".to_owned(), scale));
        assert_eq!(found, [ball(1.0), ball(2.0), ball(2.0), None, None, None]);
    }

    #[test]
    fn transforms_persist_and_the_baseline_is_lost_with_the_part() {
        let mut f = Fixture::new();
        let part = f.part(loader("ball"));
        let at = Some((DVec3::X, 1));
        part.swaps = vec![
            Swap { loader: Some(loader("rod")), scale: Some(3.0), offset: at, ..swap(1) },
            swap(1),
            Swap { vanish: true, ..swap(1) },
            Swap { scale: Some(5.0), ..swap(1) },
            Swap { loader: Some(loader("cone")), ..swap(1) },
            swap(1),
        ];
        let found: Vec<_> = (1..7).map(|epoch| file_and_scale(part, epoch)).collect();
        let shown = |file: &str, scale| Some((file.to_owned(), scale));
        assert_eq!(found, [shown("rod", 3.0), shown("ball", 3.0), None, None, shown("cone", 3.0), None]);
        let later = part_in_epoch(part, 5).unwrap().transform;
        assert_eq!((later.offset, later.on_ground), (DVec3::X, 1));
    }

    #[test]
    fn the_longest_chain_of_swaps_counts_wherever_it_stands() {
        let mut f = Fixture::new();
        f.part(loader("ground"));
        f.part(loader("ball")).swaps = vec![swap(4)];
        f.part(loader("rod")).swaps = vec![swap(1), swap(1)];
        let count = |f: &Fixture| count_epochs(&f.recipe()).unwrap();
        assert_eq!(count(&f), 5);
        f.parts[1].swaps[0].epochs = u32::MAX;
        assert_eq!(count(&f), u32::MAX);
        f.parts.truncate(1);
        assert_eq!(count(&f), 1);
    }
}
