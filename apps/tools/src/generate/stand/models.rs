//! Tree models: the meshes of a folder, or those that are made where none are given.

use super::stems::StemProfile;
use crate::generate::forest;
use crate::generate::obj::{ObjFile, SceneFolder};
use crate::generate::tree::{Species, Tree};
use std::path::{Path, PathBuf};
use vlscan_base::error::{Error, Result};
use vlscan_base::files::reads;
use vlscan_geom::DVec3;
use vlscan_scene::{LoadOptions, Sharing};
use vlscan_survey::{ReadOptions, read_scene};

/// Models of each species that are made.
const MADE_PER_SPECIES: u64 = 3;
/// Triangles of a model that is made: leaves of about 2 dm².
const MADE_TRIANGLES: u64 = 6000;
/// Folder of the models that are made or copied.
pub const MODEL_FOLDER: &str = "models";

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
    pub stem: StemProfile,
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

/// Makes models of all species of the generator in a folder of a stand. Returns them with their names in the
/// stand.
///
/// # Errors
/// [`Error::Io`].
pub fn make_models(files: &SceneFolder, seed: u64) -> Result<(Vec<Model>, Vec<String>)> {
    files.add_folder(MODEL_FOLDER)?;
    files.write(&format!("{MODEL_FOLDER}/{}", forest::MATERIAL_FILE), forest::MATERIALS.text().as_bytes())?;
    let (mut models, mut names) = (Vec::new(), Vec::new());
    for (number, species) in (0..).zip(Species::ALL.into_iter().cycle()).take(3 * MADE_PER_SPECIES as usize) {
        let name = format!("{MODEL_FOLDER}/{}_{}.obj", species.name(), number / 3 + 1);
        let mut out = ObjFile::create(files, &name, forest::MATERIAL_FILE)?.keeping_wood();
        Tree::new(seed, number, species, DVec3::ZERO).write(&mut out, seed, MADE_TRIANGLES)?;
        let mesh = out.finish()?;
        let size = mesh.bounds.size();
        models.push(Model {
            path: mesh.path,
            species: species.name().to_owned(),
            height: mesh.bounds.max.z,
            crown: 0.5 * (size.x + size.y),
            foot: [0.0; 3],
            stem: StemProfile::of(&mesh.wood, DVec3::ZERO, mesh.bounds.max.z),
        });
        names.push(name);
    }
    Ok((models, names))
}

/// The species of the generated model that represents a species, by a word of its English, German or Latin
/// name.
pub fn stands_for(word: &str) -> Option<&'static str> {
    const SPRUCES: [&str; 16] = [
        "spruce",
        "fichte",
        "picea",
        "pine",
        "kiefer",
        "pinus",
        "fir",
        "tanne",
        "abies",
        "larch",
        "lärche",
        "larix",
        "douglas",
        "douglasie",
        "pseudotsuga",
        "conifer",
    ];
    const BIRCHES: [&str; 9] =
        ["birch", "birke", "betula", "aspen", "espe", "populus", "poplar", "pappel", "alder"];
    const BEECHES: [&str; 22] = [
        "beech",
        "rotbuche",
        "buche",
        "fagus",
        "oak",
        "eiche",
        "quercus",
        "maple",
        "ahorn",
        "acer",
        "ash",
        "esche",
        "fraxinus",
        "lime",
        "linde",
        "tilia",
        "hornbeam",
        "hainbuche",
        "carpinus",
        "elm",
        "ulme",
        "ulmus",
    ];
    let made =
        [(&SPRUCES[..], Species::Spruce), (&BIRCHES[..], Species::Birch), (&BEECHES[..], Species::Beech)];
    made.into_iter().find(|(words, _)| words.contains(&word)).map(|(_, species)| species.name())
}

/// True if a word names a species of the generated models, not one that they only represent.
pub fn is_own_name(word: &str) -> bool {
    ["spruce", "fichte", "picea", "birch", "birke", "betula", "beech", "rotbuche", "buche", "fagus"]
        .contains(&word)
}

fn measure(path: PathBuf) -> Result<Model> {
    let name = path.to_str().ok_or_else(|| {
        Error::input(format!("{}: its name is not UTF-8, which a table of instances needs", path.display()))
    })?;
    let (recipe, _) = read_scene(name, &ReadOptions::default())?;
    let (scene, _) = vlscan_scene::load(
        &recipe,
        &LoadOptions {
            max_memory: vlscan_base::machine::memory(),
            sharing: Sharing::Never,
            ..LoadOptions::default()
        },
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
    let name = path.file_stem().unwrap_or_default().to_string_lossy().to_lowercase();
    let species =
        name.split(|c: char| !c.is_alphabetic()).find(|part| !part.is_empty()).unwrap_or(&name).to_owned();
    let is_wood = |i: &usize| scene.material_of(*i as u32).is_leaf() != Some(true);
    let triangles = (0..scene.geometry.triangles.len()).filter(is_wood);
    let wood: Vec<[DVec3; 3]> =
        triangles.map(|i| scene.geometry.triangle(i).map(|p| scene.to_world(p))).collect();
    let height = high.z - foot[2];
    let stem = StemProfile::of(&wood, DVec3::from(foot), height);
    Ok(Model { path, species, height, crown: 0.5 * (size.x + size.y), foot, stem })
}
