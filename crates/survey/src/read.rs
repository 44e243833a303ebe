//! The entry points: a survey, a scene, a scanner.

use super::assets::Found;
use super::context::{Context, ReadOptions, SceneChoice};
use super::documents::find_asset;
use super::instances::{Base, Row, read_table};
use super::instrument::scanner_named;
use super::platform_xml::read_platform;
use super::rasters::is_raster;
use super::scene_xml::read_scene_element;
use super::survey_xml::read_survey_document;
use super::{
    Loader, MaterialChange, MaterialChoice, MaterialDefinition, MeshReading, PartRecipe, Platform,
    RasterFiles, Replaced, Scanner, SceneRecipe, Survey, Transform,
};
use super::{VoxelLoader, VoxelMode};
use std::path::{Path, PathBuf};
use vlscan_base::diag::{Diagnostics, Place};
use vlscan_base::error::Result;
use vlscan_base::files::reads;
use vlscan_base::recognise::{Expected, Family, foreign_file, recognise_file};

/// Reads the survey of an XML file and everything that it refers to, except the geometry. The second value
/// contains the warnings to be shown.
///
/// # Errors
/// All problems of all files at once as [`vlscan_base::Error::Input`]; scan frequencies outside the scanner's
/// limits and contradictory trajectory settings as [`vlscan_base::Error::Limits`].
pub fn read_survey(path: &Path, options: &ReadOptions) -> Result<(Survey, Diagnostics)> {
    if let Some(found) = foreign_file(path, &Expected::SURVEY) {
        return Err(found.error(path));
    }
    let context = Context::new(options);
    let root = match reads::is_file(path) {
        true => context.open(&Found::File(path.to_path_buf())),
        false => context.referred_document(&path.to_string_lossy(), Path::new(""), None),
    };
    let survey = root.and_then(|root| read_survey_document(&context, &root, options.trajectory.clone()));
    context.finish(survey)
}

/// Reads the survey of a document in memory as [`read_survey`] does that of a file; `name` is its name in
/// messages, and its folder the one in which files are searched last.
///
/// # Errors
/// The errors of [`read_survey`].
pub fn read_survey_text(name: &Path, text: &str, options: &ReadOptions) -> Result<(Survey, Diagnostics)> {
    let context = Context::new(options);
    let root = context.open_text(name, text);
    let survey = root.and_then(|root| read_survey_document(&context, &root, options.trajectory.clone()));
    context.finish(survey)
}

/// Reads a scene: `file.xml#id`, `file.xml` for its first scene, a geometry file (.obj, .off, .tif, .asc,
/// .vrt, .vox) or a folder of tiles of a raster as a scene of one part, a table of instances (.csv), or a
/// packed scene (.vlscene). A raster is terrain, of [soil](MaterialDefinition::soil).
///
/// # Errors
/// The errors of [`read_survey`].
pub fn read_scene(reference: &str, options: &ReadOptions) -> Result<(SceneRecipe, Diagnostics)> {
    let context = Context::new(options);
    let scene = find_scene_on_soil(&context, reference, Path::new(""), None);
    context.finish(scene)
}

/// Reads a scanner: `file.xml#id`, `file.xml` for its first scanner, the calibration file of an Ouster sensor
/// (.json), or the id of a built-in scanner. An id of two built-in scanners is an error that lists their full
/// references. `catalogue:` before an id or reference skips all files but the built-in ones.
///
/// # Errors
/// The errors of [`read_survey`].
pub fn find_scanner(reference: &str, options: &ReadOptions) -> Result<(Scanner, Diagnostics)> {
    let context = Context::new(options);
    let scanner = scanner_named(&context, reference, Path::new(""), None);
    context.finish(scanner)
}

/// Reads a platform; references have the forms of [`find_scanner`].
///
/// # Errors
/// The errors of [`read_survey`].
pub fn find_platform(reference: &str, options: &ReadOptions) -> Result<(Platform, Diagnostics)> {
    let context = Context::new(options);
    let element = find_asset(&context, "platform", reference, Path::new(""), None);
    let platform = element.and_then(|element| read_platform(&context, &element));
    context.finish(platform)
}

/// The scene that replaces the survey's; `find` is [`find_scene`] or [`find_scene_on_soil`].
pub(super) fn chosen_scene(
    context: &Context,
    choice: &SceneChoice,
    find: fn(&Context, &str, &Path, Option<Place>) -> Option<SceneRecipe>,
) -> Option<SceneRecipe> {
    match choice {
        SceneChoice::Named(reference) => find(context, reference, Path::new(""), None),
        SceneChoice::Given(recipe) => Some((**recipe).clone()),
    }
}

/// Like [`find_scene`], but a raster is terrain, of soil. Scenes of XML surveys follow HELIOS++: rasters
/// without a material are not ground.
pub(super) fn find_scene_on_soil(
    context: &Context,
    reference: &str,
    folder: &Path,
    place: Option<Place>,
) -> Option<SceneRecipe> {
    let mut scene = find_scene(context, reference, folder, place)?;
    if context.is_terrain(reference, folder) {
        let soil = MaterialChange { replaced: Replaced::All, material: MaterialDefinition::soil() };
        for part in &mut scene.parts {
            part.changes = vec![soil.clone()].into();
        }
    }
    Some(scene)
}

/// The scene of a reference in a file in `folder`; `place` is the place of the reference.
pub(super) fn find_scene(
    context: &Context,
    reference: &str,
    folder: &Path,
    place: Option<Place>,
) -> Option<SceneRecipe> {
    if is_geometry(reference)
        || context.is_folder(reference, folder)
        || holds_no_xml(context, reference, folder)
    {
        return scene_of_file(context, reference, folder, place);
    }
    let (file, id) = match reference.split_once('#') {
        Some((file, id)) => (file, Some(id)),
        None => (reference, None),
    };
    let root = context.referred_document(file, folder, place.clone())?;
    let element = context.pick(&root, "scene", id, place)?;
    read_scene_element(context, &element)
}

fn extension(name: &str) -> String {
    Path::new(name).extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default()
}

fn is_packed(name: &str) -> bool {
    extension(name) == "vlscene"
}

/// Endings of the mesh files that the scene reads.
pub(super) const MESH_ENDINGS: [&str; 6] = ["obj", "ply", "stl", "off", "gltf", "glb"];

/// True if a reference names an existing file of a known kind that is not XML. The loader of meshes reports
/// the remedy for files that are not scenes.
fn holds_no_xml(context: &Context, reference: &str, folder: &Path) -> bool {
    let kind = context.assets.file(reference, folder).and_then(|file| recognise_file(&file.found));
    kind.is_some_and(|kind| !matches!(kind.family, Family::Document | Family::Markup))
}

/// True if a reference names a file that is a scene without XML, by its ending.
pub(super) fn is_geometry(reference: &str) -> bool {
    let ending = extension(reference);
    is_packed(reference)
        || is_raster(reference)
        || matches!(ending.as_str(), "vox" | "csv")
        || MESH_ENDINGS.contains(&ending.as_str())
}

fn scene_of_file(context: &Context, name: &str, folder: &Path, place: Option<Place>) -> Option<SceneRecipe> {
    let rasters = match context.is_terrain(name, folder) {
        true => Some(context.raster(name, folder, place.clone())?),
        false => None,
    };
    let path = match &rasters {
        Some(files) => files.all()[0].clone(),
        None => context.file(name, folder, place)?,
    };
    let asset_folders = context.assets.folders(path.parent().unwrap_or(Path::new("")));
    let parts = if let Some(files) = rasters {
        vec![PartRecipe { place: Some(Place::of_file(&path)), ..PartRecipe::new(raster_loader(files)) }]
    } else if is_packed(name) {
        Vec::new()
    } else if extension(name) == "csv" {
        let base = Base { file: None, reading: MeshReading::default(), transform: Transform::IDENTITY };
        let rows = read_table(context, &path, &base)?;
        let part = |(number, row): (u32, Row)| PartRecipe {
            place: Some(row.place),
            number,
            transform: row.transform,
            ..PartRecipe::new(row.loader)
        };
        (0..).zip(rows).map(part).collect()
    } else {
        let place = Some(Place::of_file(&path));
        vec![PartRecipe { place, ..PartRecipe::new(loader_of_file(path.clone())) }]
    };
    let id = Path::new(name).file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default();
    let packed = is_packed(name).then(|| path.clone());
    Some(SceneRecipe { id, path, parts, dyn_step: 1, dyn_time_step: None, packed, asset_folders })
}

/// The loader of a raster without a material.
pub(super) fn raster_loader(files: RasterFiles) -> Loader {
    Loader::GeoTiff { files, material: MaterialChoice { random_range: 1.0, ..Default::default() } }
}

/// The loader of a mesh or voxels, by the extension of the file.
pub(super) fn loader_of_file(path: PathBuf) -> Loader {
    match extension(&path.to_string_lossy()).as_str() {
        "vox" => Loader::DetailedVoxels(Box::new(VoxelLoader {
            files: vec![path],
            mode: VoxelMode::Transmittive,
            drop_empty: true,
            random_shift: false,
            lad_table: None,
            material: MaterialChoice { random_range: 1.0, ..MaterialChoice::default() },
        })),
        _ => Loader::MeshFiles { files: vec![path], reading: MeshReading::default() },
    }
}
