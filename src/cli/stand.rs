//! `vlscan scene stand`: tree models placed by an inventory.

use super::Console;
use super::args::StandArgs;
use super::ground::GroundModel;
use std::path::Path;
use vlscan_base::diag::{Diagnostics, Place};
use vlscan_base::error::{Error, Result};
use vlscan_base::machine;
use vlscan_lidar::pulse::Corrections;
use vlscan_scene::{LoadOptions, read_materials};
use vlscan_survey::{ReadOptions, read_scene};
use vlscan_tools::generate::{
    Development, Inventory, Models, PROJECT, StandMade, StandOptions, Terrain, TerrainSurface, write_stand,
};

pub fn run(args: &StandArgs, console: &Console) -> Result<()> {
    make(args, &|_| true, console)
}

/// Makes a stand of the trees of the inventory at places that `stands` accepts.
pub fn make(args: &StandArgs, stands: &dyn Fn([f64; 2]) -> bool, console: &Console) -> Result<()> {
    let (inventory, warnings) = Inventory::read(&args.inventory)?;
    console.warnings(&warnings)?;
    let models = Models::read(&args.trees)?;
    let named = args.terrain_mtl.as_deref().map(|name| named_material(name, console)).transpose()?;
    let (mut terrain, mut files) = (Vec::new(), Vec::new());
    for path in &args.terrain {
        let (ground, file) = read_terrain(path, named.as_ref(), console)?;
        terrain.push(ground);
        files.push(file);
    }
    refuse_all_beside(&inventory, &terrain, stands)?;
    let ground = |x: f64, y: f64| terrain.iter().filter_map(|part| part.height(x, y)).reduce(f64::max);
    let options = StandOptions {
        seed: args.seed,
        terrain: &files,
        ground: &ground,
        stands,
        epochs: args.epochs,
        development: Development { growth: args.growth, thinning: args.thinning, storm: args.storm },
        overwrite: args.force,
        told: &|trees, made| console.warnings(&doubts(&args.inventory, trees, made)),
    };
    let made = write_stand(&inventory, &models, &options, &args.out)?;
    let counts: Vec<String> = made.trees.iter().map(usize::to_string).collect();
    console.say(format!(
        "{}: {} trees of {} models{}; scan them with: vlscan run SURVEY --scene {0}",
        made.scene.display(),
        counts.join(", "),
        models.models.len(),
        if counts.len() > 1 { " in the epochs stand_0, stand_1 …" } else { "" },
    ));
    Ok(())
}

/// Warns of trees of the first epoch that stand as others, or beside the terrain.
fn doubts(inventory: &Path, trees: usize, made: &StandMade) -> Diagnostics {
    let mut warnings = Diagnostics::default();
    let place = || Some(Place::of_file(inventory));
    for (species, count) in &made.unmatched_species {
        let of =
            if species.is_empty() { "without species".to_owned() } else { format!("of species `{species}`") };
        warnings.warn(place(), format!("{count} trees {of} stand as others: no model's name begins with it"));
    }
    if made.off_terrain > 0 {
        let message = format!(
            "{} of {trees} trees are beside the terrain and keep the inventory's z, or 0",
            made.off_terrain
        );
        warnings.warn(place(), message);
    }
    warnings
}

/// Refuses an inventory none of whose trees is on the terrain: the two are not in one coordinate system.
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
    let mut problems = Diagnostics::default();
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
    problems.error(None, message).help(help);
    Err(Error::Input(Box::new(problems)))
}

/// Reads the height of a terrain, and decides what it is made of: of the material that is asked for; of its own, if that
/// is ground; else of soil, since that is what the option says that it is.
fn read_terrain(
    path: &Path,
    named: Option<&TerrainSurface>,
    console: &Console,
) -> Result<(GroundModel, Terrain)> {
    let is_one_of = |endings: &[&str]| {
        path.extension().is_some_and(|e| endings.iter().any(|known| e.eq_ignore_ascii_case(known)))
    };
    let (is_raster, is_obj) = (is_one_of(&["tif", "tiff"]), is_one_of(&["obj"]));
    let is_known = is_raster || is_obj || is_one_of(&["ply", "stl"]);
    let name = path.to_str().filter(|_| is_known).ok_or_else(|| {
        Error::input(format!(
            "{}: expected a mesh (.obj, .ply, .stl) or a raster (.tif) of the terrain",
            path.display()
        ))
    })?;
    let (recipe, warnings) = read_scene(name, &ReadOptions::default())?;
    console.warnings(&warnings)?;
    let options =
        LoadOptions { max_memory: machine::memory(), rules: Corrections::REFINED, ..LoadOptions::default() };
    let (ground, mut warnings) = GroundModel::load(&recipe, &options)?;
    let is_own = named.is_none() && ground.has_ground();
    if !is_own && !is_raster && !is_obj {
        let mut problems = Diagnostics::default();
        problems.error(None, format!("{}: none of its materials is ground", path.display())).help(
            "put a materials.csv beside it with the line NAME,0.3,2,true below the heading name,reflectance,class,ground; \
             --terrain-mtl is for rasters (.tif) and OBJ files",
        );
        return Err(Error::Input(Box::new(problems)));
    }
    if is_raster {
        // A raster has no material, and what is said about that is not so in the stand.
        warnings = Diagnostics::default();
    } else if !is_own && named.is_none() {
        let message = "none of its materials is ground, so all of it becomes soil in the stand (class 2, reflectance 0.3, ground)";
        warnings.warn(Some(Place::of_file(path)), message).help(
            "--terrain-mtl FILE.mtl#NAME chooses another material; `helios_isGround true` in its own MTL file keeps those",
        );
    }
    console.warnings(&warnings)?;
    let surface = match is_own {
        true => TerrainSurface::Own,
        false => named.cloned().unwrap_or(TerrainSurface::Soil),
    };
    Ok((ground, Terrain { path: path.to_path_buf(), surface }))
}

/// The material `file.mtl#name`, or the only one of `file.mtl`.
fn named_material(reference: &str, console: &Console) -> Result<TerrainSurface> {
    let (file, name) = match reference.rsplit_once('#') {
        Some((file, name)) => (Path::new(file), Some(name)),
        None => (Path::new(reference), None),
    };
    let (definitions, warnings) = read_materials(file)?;
    console.warnings(&warnings)?;
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
        let mut problems = Diagnostics::default();
        let message = format!("--terrain-mtl {reference}: the material `{}` is not ground", material.name);
        problems.error(None, message).help(format!(
            "write `helios_isGround true` and `helios_classification 2` below its newmtl in {}",
            file.display()
        ));
        return Err(Error::Input(Box::new(problems)));
    }
    Ok(TerrainSurface::Material { file: file.to_path_buf(), name: material.name.clone() })
}
