//! Makes a stand: reads inventory, models and terrain, and writes the scene.

use super::epochs::Development;
use super::headings::PROJECT;
use super::inventory::Inventory;
use super::models::read_models;
use super::write::{StandMade, StandSite, Substitute, Terrain, TerrainSurface, write_stand};
use crate::args;
use std::path::{Path, PathBuf};
use vlscan_base::diag::{Diagnostics, Place};
use vlscan_base::error::{Error, Result};
use vlscan_base::quantity::Bounds;
use vlscan_base::recognise::{Expected, foreign_file};
use vlscan_base::{Observer, machine};
use vlscan_lidar::pulse::Corrections;
use vlscan_scene::{GroundModel, LoadOptions, read_materials};
use vlscan_survey::{ReadOptions, names_raster, read_scene};

/// Numbers of epochs.
const EPOCHS: Bounds = Bounds::new(1.0, 1000.0, "1 to 1000");
/// Width of flat ground around the trees, m.
const FLAT_MARGIN: f64 = 20.0;

/// Inputs and choices of a stand.
#[derive(Clone, Debug, PartialEq, clap::Args)]
pub struct StandOptions {
    /// The inventory: a table of text with a heading.
    pub inventory: PathBuf,
    /// Folder of tree models, OBJ files whose names begin with their species: beech_1.obj. [default: models
    /// of spruces, beeches and birches in the folder `models` of the output, which stand for other conifers
    /// and broad-leaved trees, too]
    #[arg(long, value_name = "DIR")]
    pub trees: Option<PathBuf>,
    /// Terrain: a mesh (.obj, .ply, .stl, .off) or a raster (.tif, .asc, .vrt, a folder of tiles); may be
    /// given more than once. Rasters, and meshes without a ground material, become soil: class 2, reflectance
    /// 0.3, ground. [default: none; trees use z of the inventory]
    #[arg(long, value_name = "FILE")]
    pub terrain: Vec<PathBuf>,
    /// Flat ground under the trees and 20 m around them, of soil, at the height 0 or that which all trees
    /// have in the inventory.
    #[arg(long, conflicts_with = "terrain")]
    pub flat: bool,
    /// Material of terrain from rasters and OBJ files: a material file and the name of a ground material in
    /// it. [default: the mesh's own if it is ground, else soil]
    #[arg(long, value_name = "FILE.mtl#NAME", requires = "terrain")]
    pub terrain_mtl: Option<String>,
    /// Seed of the choice of models, yaw, thinning and storm.
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = args::seed)]
    pub seed: u64,
    /// Number of epochs; the first one is the inventory.
    #[arg(
        long,
        value_name = "N",
        default_value_t = 1,
        value_parser = clap::value_parser!(u32).range(1..=1000),
    )]
    pub epochs: u32,
    /// Growth, thinning and storm damage from one epoch to the next.
    #[command(flatten)]
    pub development: Development,
    /// Copy tree models and terrain into the output folder, which can then be moved, instead of naming where
    /// they are.
    #[arg(long)]
    pub copy: bool,
    /// Replace existing files.
    #[arg(id = "force", long = "force")]
    pub overwrite: bool,
}

impl StandOptions {
    /// One epoch of the trees of an inventory, without terrain.
    pub fn new(inventory: PathBuf, trees: PathBuf) -> StandOptions {
        StandOptions {
            inventory,
            trees: Some(trees),
            terrain: Vec::new(),
            flat: false,
            terrain_mtl: None,
            seed: 0,
            epochs: 1,
            development: Development::default(),
            copy: false,
            overwrite: false,
        }
    }
}

/// Makes a stand in `folder` of the trees at places (x, y in m) that `stands` accepts.
///
/// # Errors
/// [`Error::Input`] for inventories, models and terrain that cannot be read or do not fit each other, and for
/// files that exist; [`Error::Io`].
pub fn make_stand(
    options: &StandOptions,
    folder: &Path,
    stands: &dyn Fn([f64; 2]) -> bool,
    observer: &Observer,
) -> Result<StandMade> {
    let Development { growth, thinning, storm } = options.development;
    args::check([
        ("growth", Some(growth), args::GROWTH),
        ("thinning", Some(thinning), args::SHARE),
        ("storm", Some(storm), args::SHARE),
        ("epochs", Some(f64::from(options.epochs)), EPOCHS),
    ])?;
    let (inventory, warnings) = Inventory::read(&options.inventory)?;
    observer.warnings(warnings)?;
    let models = options.trees.as_deref().map(read_models).transpose()?;
    let named = options.terrain_mtl.as_deref().map(|name| named_material(name, observer)).transpose()?;
    let (mut grounds, mut terrain) = (Vec::new(), Vec::new());
    for path in &options.terrain {
        let (ground, file) = read_terrain(path, named.as_ref(), observer)?;
        grounds.push(ground);
        terrain.push(file);
    }
    refuse_all_beside(&inventory, &grounds, stands)?;
    let flat = options.flat.then(|| flat_ground(&inventory, &options.inventory)).transpose()?;
    terrain.extend(flat.as_ref().map(|(ground, _)| ground.clone()));
    let ground = |x: f64, y: f64| match flat {
        Some((_, height)) => Some(height),
        None => grounds.iter().filter_map(|part| part.height(x, y)).reduce(f64::max),
    };
    let told = |trees: usize, made: &StandMade| observer.warnings(doubts(&options.inventory, trees, made));
    let site = StandSite { folder, terrain: &terrain, ground: &ground, stands, told: &told };
    write_stand(&inventory, models, options, &site)
}

/// Flat ground under all trees, and its height.
fn flat_ground(inventory: &Inventory, path: &Path) -> Result<(Terrain, f64)> {
    let range = |axis: usize| {
        let values = inventory.trees.iter().map(|tree| tree.position[axis]);
        values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)))
    };
    let [x, y, z] = [0, 1, 2].map(range);
    if z.0 != z.1 {
        let message =
            format!("{}: the trees stand at heights from {:.2} to {:.2} m", path.display(), z.0, z.1);
        return Err(Error::input_with_help(message, "leave out --flat, or give a --terrain"));
    }
    let low = [x.0 - FLAT_MARGIN, y.0 - FLAT_MARGIN];
    let high = [x.1 + FLAT_MARGIN, y.1 + FLAT_MARGIN];
    let surface = TerrainSurface::Flat { low, high, height: z.0 };
    Ok((Terrain { path: PathBuf::new(), surface }, z.0))
}

/// Warns of trees of the first epoch that other species represent, or that stand outside of the terrain.
fn doubts(inventory: &Path, trees: usize, made: &StandMade) -> Diagnostics {
    let mut warnings = Diagnostics::default();
    let place = || Some(Place::of_file(inventory));
    for Substitute { species, trees, models, is_meant } in &made.substitutes {
        let models: Vec<&str> = models.iter().map(String::as_str).collect();
        let have = if *trees == 1 { "tree of species" } else { "trees of species" };
        let (has, of) = match (trees, &models[..]) {
            (1, _) => ("has a model of", models.join(", ")),
            (_, [first @ .., last]) if !first.is_empty() => {
                ("have models of", format!("{} and {last}", first.join(", ")))
            }
            _ => ("have models of", models.join(", ")),
        };
        let message = format!("{trees} {have} `{species}` {has} {of}");
        if *is_meant {
            warnings.note(place(), message);
        } else {
            warnings.warn(place(), message + ": no model's name begins with that species");
        }
    }
    if made.off_terrain > 0 {
        let message = format!(
            "{} of {trees} trees are outside the terrain and keep the inventory's z, or 0",
            made.off_terrain
        );
        warnings.warn(place(), message);
    }
    warnings
}

/// Rejects an inventory none of whose trees is on the terrain: the two are not in one coordinate system.
fn refuse_all_beside(
    inventory: &Inventory,
    terrain: &[GroundModel],
    stands: &dyn Fn([f64; 2]) -> bool,
) -> Result<()> {
    let trees = inventory.trees.iter().map(|tree| [tree.position[0], tree.position[1]]);
    let trees: Vec<[f64; 2]> = trees.filter(|place| stands(*place)).collect();
    let is_on = |[x, y]: &[f64; 2]| terrain.iter().any(|part| part.height(*x, *y).is_some());
    if terrain.is_empty() || trees.is_empty() || trees.iter().any(is_on) {
        return Ok(());
    }
    let corners: Vec<[f64; 2]> = terrain.iter().flat_map(GroundModel::extent).collect();
    let shown = |places: &[[f64; 2]]| {
        let axis = |i: usize| {
            let values = places.iter().map(|place| place[i]);
            let low = values.clone().fold(f64::INFINITY, f64::min);
            format!("{low:.3} to {:.3}", values.fold(f64::NEG_INFINITY, f64::max))
        };
        format!("x {}, y {}", axis(0), axis(1))
    };
    let message = format!(
        "no tree is on the terrain: the trees are at {}; the terrain at {}",
        shown(&trees),
        shown(&corners)
    );
    let is_degrees = trees.iter().all(|[x, y]| x.abs() <= 180.0 && y.abs() <= 90.0);
    let help = match is_degrees {
        true => format!("x and y look like longitude and latitude; {PROJECT}"),
        false => "give inventory and terrain in one coordinate system, in metres".to_owned(),
    };
    Err(Error::input_with_help(message, help))
}

/// Reads the heights of a terrain, and chooses its material: the requested one, else its own if that is
/// ground, else soil, as the option documents.
fn read_terrain(
    path: &Path,
    named: Option<&TerrainSurface>,
    observer: &Observer,
) -> Result<(GroundModel, Terrain)> {
    let is_one_of = |endings: &[&str]| {
        path.extension().is_some_and(|e| endings.iter().any(|known| e.eq_ignore_ascii_case(known)))
    };
    if let Some(found) = foreign_file(path, &Expected::SURFACE) {
        return Err(found.error(path));
    }
    let (is_raster, is_obj) = (names_raster(path), is_one_of(&["obj"]));
    let is_known = is_raster || is_obj || is_one_of(&["ply", "stl", "off"]);
    let name = path.to_str().filter(|_| is_known).ok_or_else(|| {
        Error::input(format!(
            "{}: expected a mesh (.obj, .ply, .stl, .off) or a raster (.tif, .asc, .vrt, a folder of tiles) \
             of the terrain",
            path.display()
        ))
    })?;
    let (recipe, warnings) = read_scene(name, &ReadOptions::default())?;
    observer.warnings(warnings)?;
    let options =
        LoadOptions { max_memory: machine::memory(), rules: Corrections::REFINED, ..LoadOptions::default() };
    let (ground, mut warnings) = GroundModel::load(&recipe, &options)?;
    // A raster is written into the stand without the soil that it is of as a scene by itself.
    let is_own = named.is_none() && !is_raster && ground.has_ground();
    if !is_own && !is_raster && !is_obj {
        return Err(Error::input_with_help(
            format!("{}: none of its materials is ground", path.display()),
            "put a materials.csv beside it with the line NAME,0.3,2,true below the heading \
             name,reflectance,class,ground; --terrain-mtl is for rasters (.tif) and OBJ files",
        ));
    }
    if is_raster {
        // A raster has no material; the message about that does not apply to a stand.
        warnings = Diagnostics::default();
    } else if !is_own && named.is_none() {
        let message = "none of its materials is ground, so the whole terrain becomes soil in the stand \
                       (class 2, reflectance 0.3, ground)";
        warnings.warn(Some(Place::of_file(path)), message).help(
            "--terrain-mtl FILE.mtl#NAME chooses another material; `helios_isGround true` in its own MTL \
             file keeps those",
        );
    }
    observer.warnings(warnings)?;
    let surface = match is_own {
        true => TerrainSurface::Own,
        false => named.cloned().unwrap_or(TerrainSurface::Soil),
    };
    Ok((ground, Terrain { path: path.to_path_buf(), surface }))
}

/// The material `file.mtl#name`, or the only one of `file.mtl`.
fn named_material(reference: &str, observer: &Observer) -> Result<TerrainSurface> {
    let (file, name) = match reference.rsplit_once('#') {
        Some((file, name)) => (Path::new(file), Some(name)),
        None => (Path::new(reference), None),
    };
    let (definitions, warnings) = read_materials(file)?;
    observer.warnings(warnings)?;
    let found = match name {
        Some(name) => definitions.iter().find(|d| d.name == name),
        None => definitions.first().filter(|_| definitions.len() == 1),
    };
    let Some(material) = found else {
        let names: Vec<&str> = definitions.iter().map(|d| d.name.as_str()).collect();
        let which = name.map_or("which material?".to_owned(), |name| format!("no material `{name}`"));
        return Err(Error::input(format!(
            "--terrain-mtl {reference}: {which} Name one as FILE#NAME; {} has {}",
            file.display(),
            if names.is_empty() { "none".to_owned() } else { names.join(", ") }
        )));
    };
    if !material.is_ground {
        return Err(Error::input_with_help(
            format!("--terrain-mtl {reference}: the material `{}` is not ground", material.name),
            format!(
                "write `helios_isGround true` and `helios_classification 2` below its newmtl in {}",
                file.display()
            ),
        ));
    }
    Ok(TerrainSurface::Material { file: file.to_path_buf(), name: material.name.clone() })
}
