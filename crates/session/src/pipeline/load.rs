//! Loading of an epoch's scene and construction of its tree, both rejected if they would exceed the memory
//! limit.

use std::sync::Arc;
use std::time::Instant;
use vlscan_base::diag::{Notice, ProblemKind};
use vlscan_base::error::{Error, Result};
use vlscan_base::quantity::{amount, bytes};
use vlscan_scene::{LoadOptions, Scene, SceneFrame};
use vlscan_survey::SceneRecipe;
use vlscan_trace::{BuildOptions, Builder, ResidencyStatistics, Tree};

/// Minimum memory of rasters and their tree that is reported.
const MIN_REPORTED_BYTES: u64 = 500_000_000;

/// Loads the scene of an epoch, the first one without a `frame`, later ones in that of the first. Warnings
/// are errors if it `is_strict`.
pub(super) fn load_scene(
    recipe: &SceneRecipe,
    options: &LoadOptions,
    is_strict: bool,
    (epoch, frame): (u32, Option<SceneFrame>),
    notify: &dyn Fn(Notice),
) -> Result<Scene> {
    let started = Instant::now();
    notify(Notice::Step("loading the scene"));
    let (scene, found) = vlscan_scene::load_epoch(recipe, options, epoch, frame)?;
    notify(Notice::Warnings(found.finish(is_strict)?));
    notify(Notice::Timing(format!(
        "scene: {} parts, {} primitives, {:.1} MB, {:.2} s",
        scene.parts.len(),
        amount(scene.primitives() as f64),
        scene.memory() as f64 / 1e6,
        started.elapsed().as_secs_f64()
    )));
    if let Some(tiles) = &scene.tiles {
        notify(Notice::Timing(format!(
            "tiles: {} of the parts, {} primitives, are loaded when rays come near",
            tiles.facts().len(),
            amount(tiles.primitives() as f64)
        )));
    }
    Ok(scene)
}

/// Describes the tiles of a scene that were loaded and dropped.
pub(super) fn describe_tiles(statistics: &ResidencyStatistics) -> String {
    let ResidencyStatistics { loaded, prefetched, dropped, peak, load_time, .. } = statistics;
    format!(
        "tiles: {loaded} loaded ({prefetched} ahead), {dropped} dropped, {:.2} % found in memory, at most {} \
         at a time, {:.2} s",
        100.0 * statistics.hit_rate(),
        bytes(*peak),
        load_time.as_secs_f64()
    )
}

/// Builds the tree over a scene, unless both together exceed the memory limit.
pub(super) fn build_tree(
    options: &BuildOptions,
    max_memory: Option<u64>,
    scene: &Scene,
    notify: &dyn Fn(Notice),
) -> Result<Arc<Tree>> {
    let (held, needed) = (scene.memory() as u64, scene.tree_forecast(options.builder));
    if let Some(limit) = max_memory.filter(|limit| held.saturating_add(needed) > *limit) {
        return Err(too_large(format!(
            "the scene needs {} and the tree over it about {} more; the limit is {}",
            bytes(held),
            bytes(needed),
            bytes(limit)
        )));
    }
    let started = Instant::now();
    notify(Notice::Step("building the tree"));
    let tree = scene.tree(options);
    notify(Notice::Timing(format!(
        "tree: {:.1} MB, {:.2} s",
        tree.memory() as f64 / 1e6,
        started.elapsed().as_secs_f64()
    )));
    Ok(tree)
}

fn too_large(message: String) -> Error {
    Error::input_of(ProblemKind::TooLarge, message)
}

/// Reports the memory that large rasters and the trees over them will need, and rejects more than the limit,
/// before any of it is loaded.
///
/// # Errors
/// [`Error::Input`] for rasters that need more.
pub fn check_raster_memory(
    recipe: &SceneRecipe,
    options: &LoadOptions,
    builder: Builder,
    notify: &dyn Fn(Notice),
) -> Result<()> {
    let mut all = 0u64;
    for need in vlscan_scene::raster_needs(recipe, options) {
        let stored = if need.is_field { 0 } else { need.triangles };
        let tree = Tree::estimate_build_memory(stored, builder);
        all = all.saturating_add(need.bytes).saturating_add(tree);
        if need.bytes.saturating_add(tree) >= MIN_REPORTED_BYTES {
            let kept = match need.is_field {
                true => format!("a height field, which needs {}", bytes(need.bytes)),
                false => format!(
                    "{} triangles, which need {}, plus about {} for their tree",
                    amount(need.triangles as f64),
                    bytes(need.bytes),
                    bytes(tree)
                ),
            };
            let others = match need.files {
                1 => String::new(),
                files => format!(" and others ({files} files)"),
            };
            notify(Notice::Note(format!(
                "{}{others}: {} x {} pixels become {kept}",
                need.path.display(),
                need.columns,
                need.rows
            )));
        }
    }
    match options.max_memory {
        Some(limit) if all > limit => Err(too_large(format!(
            "the rasters of the scene need about {}; the limit is {}",
            bytes(all),
            bytes(limit)
        ))),
        _ => Ok(()),
    }
}
