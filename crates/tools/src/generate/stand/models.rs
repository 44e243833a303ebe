//! Tree models: the meshes of a folder.

use std::path::{Path, PathBuf};
use vlscan_base::error::{Error, Result};
use vlscan_base::files::reads;
use vlscan_scene::LoadOptions;
use vlscan_survey::{ReadOptions, read_scene};

/// A tree model.
#[derive(Clone, Debug, PartialEq)]
pub struct Model {
    pub path: PathBuf,
    /// The beginning of the file's name, in lower case: `beech` of `Beech_old-2.obj`.
    pub species: String,
    /// m.
    pub height: f64,
    /// Mean of both horizontal extents, m.
    pub crown: f64,
    /// The foot of the stem in the coordinates of the mesh, m.
    pub foot: [f64; 3],
}

/// Measures the tree models of a folder, its OBJ files.
///
/// # Errors
/// No mesh in it; a mesh that cannot be read or has no height.
pub fn read_models(folder: &Path) -> Result<Vec<Model>> {
    let mut paths = reads::list(folder).map_err(|e| Error::open(folder, e))?;
    paths.retain(|path| path.extension().is_some_and(|e| e.eq_ignore_ascii_case("obj")));
    if paths.is_empty() {
        return Err(Error::input(format!("{}: no tree model (.obj) in that folder", folder.display())));
    }
    paths.into_iter().map(measure).collect()
}

fn measure(path: PathBuf) -> Result<Model> {
    let name = path.to_str().ok_or_else(|| {
        Error::input(format!("{}: its name is not UTF-8, which a table of instances needs", path.display()))
    })?;
    let (recipe, _) = read_scene(name, &ReadOptions::default())?;
    let (scene, _) = vlscan_scene::load(
        &recipe,
        &LoadOptions { max_memory: vlscan_base::machine::memory(), ..LoadOptions::default() },
    )?;
    let [low, high] = [scene.bounds.min, scene.bounds.max].map(|corner| scene.to_world(corner));
    let size = high - low;
    if size.z <= 0.0 {
        return Err(Error::input(format!("{}: a tree model without height", path.display())));
    }
    // Models usually stand at the origin of their coordinates; others on the middle of their lowest plane.
    let within = |v: f64, low: f64, high: f64| low <= v && v <= high;
    let at_origin = within(0.0, low.x, high.x)
        && within(0.0, low.y, high.y)
        && within(0.0, low.z - 0.1 * size.z, low.z + 0.1 * size.z);
    let foot = match at_origin {
        true => [0.0; 3],
        false => [0.5 * (low.x + high.x), 0.5 * (low.y + high.y), low.z],
    };
    let stem = path.file_stem().unwrap_or_default().to_string_lossy().to_lowercase();
    let species =
        stem.split(|c: char| !c.is_alphabetic()).find(|part| !part.is_empty()).unwrap_or(&stem).to_owned();
    Ok(Model { path, species, height: high.z - foot[2], crown: 0.5 * (size.x + size.y), foot })
}
