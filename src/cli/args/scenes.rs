//! The command line of `vlscan scene`.

use crate::options::{Count, Seed};
use clap::{Args, Subcommand, ValueEnum};
use std::path::PathBuf;
use vlscan_lidar::pulse::PhysicsProfile;
use vlscan_scene::Sharing;
use vlscan_trace::Builder;

/// `vlscan scene`.
#[derive(Debug, Args)]
pub struct SceneArgs {
    /// What to do with scenes.
    #[command(subcommand)]
    pub command: SceneCommand,
}

/// Subcommands of `vlscan scene`.
#[derive(Debug, Subcommand)]
pub enum SceneCommand {
    /// Make a procedural scene with a survey that scans it: OBJ, MTL, scene.xml, survey.xml.
    Make(MakeArgs),
    /// Place tree models on terrain by an inventory.
    ///
    /// The inventory is a table with a heading: x, y and height are needed; crown (diameter), dbh, species, id and z may be
    /// there. For each tree one of the three models of its species that are most alike in crown over height and in height is
    /// drawn, scaled to the tree's height, turned, and set on the terrain, which is ground. The folder gets stand.xml, the table
    /// of instances and labels.csv: number of the part in the points, id, species, model, place, height, crown, dbh.
    ///
    /// With --epochs each epoch is a scene of its own in stand.xml, stand_0, stand_1 and so on.
    Stand(StandArgs),
    /// Tell what a scene holds and costs: parts, primitives, bounds, materials, memory, faults.
    Info(InfoArgs),
    /// Compile a scene and its tree to one file that opens without loading meshes and building the tree.
    Pack(PackArgs),
}

/// `vlscan scene stand`.
#[derive(Debug, Args)]
pub struct StandArgs {
    /// The inventory: a table of text with a heading.
    pub inventory: PathBuf,
    /// Folder of tree models, OBJ files whose names begin with their species: beech_1.obj.
    #[arg(long, value_name = "DIR")]
    pub trees: PathBuf,
    /// Terrain: a mesh (.obj, .ply, .stl) or a raster (.tif); may be given more than once. Rasters, and meshes without a ground
    /// material, become soil: class 2, reflectance 0.3, ground. [default: none, z of the inventory]
    #[arg(long, value_name = "FILE")]
    pub terrain: Vec<PathBuf>,
    /// Material of the terrain, rasters and OBJ files: a material file and a name in it that is ground. [default: that of a mesh
    /// with ground, else soil]
    #[arg(long, value_name = "FILE.mtl#NAME", requires = "terrain")]
    pub terrain_mtl: Option<String>,
    /// Folder to write to.
    #[arg(short = 'o', long, value_name = "DIR")]
    pub out: PathBuf,
    /// Seed of choice, yaw, thinning and storm.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub seed: u64,
    /// Epochs, the first of which is the inventory.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=1000))]
    pub epochs: u32,
    /// Growth of the trees from epoch to epoch, percent.
    #[arg(long, value_name = "PERCENT", default_value = "0", value_parser = growth, allow_negative_numbers = true)]
    pub growth: f64,
    /// Trees felled from epoch to epoch, percent, evenly over the stand.
    #[arg(long, value_name = "PERCENT", default_value = "0", value_parser = share)]
    pub thinning: f64,
    /// Trees that a storm throws from epoch to epoch, percent, in one gap.
    #[arg(long, value_name = "PERCENT", default_value = "0", value_parser = share)]
    pub storm: f64,
    /// Overwrite files that exist.
    #[arg(long)]
    pub force: bool,
}

fn growth(text: &str) -> Result<f64, String> {
    percent(text, -90.0, 900.0)
}

fn share(text: &str) -> Result<f64, String> {
    percent(text, 0.0, 100.0)
}

/// A fraction, given as percent.
fn percent(text: &str, low: f64, high: f64) -> Result<f64, String> {
    match text.trim_end_matches('%').trim().parse::<f64>() {
        Ok(value) if (low..=high).contains(&value) => Ok(value / 100.0),
        _ => Err(format!("expected percent from {low} to {high}, found {text}")),
    }
}

/// `vlscan scene pack`.
#[derive(Debug, Args)]
pub struct PackArgs {
    /// A scene (file.xml#id), a survey (.xml) or pipeline (.toml), whose scanner's wavelength counts, or a file of geometry.
    pub scene: String,
    /// The packed scene. [default: beside the scene's file, .vlscene]
    #[arg(short = 'o', long, value_name = "PATH")]
    pub out: Option<PathBuf>,
    /// Folder to look for files in; may be given more than once.
    #[arg(long, value_name = "DIR")]
    pub assets: Vec<PathBuf>,
    /// Wavelength at which spectra are evaluated. [default: that of the survey's scanner, else 1064]
    #[arg(long, value_name = "NM")]
    pub wavelength: Option<f64>,
    /// Seed of random materials and voxel places. [default: the survey's, else 0]
    #[arg(long, value_name = "SEED")]
    pub seed: Option<Seed>,
    /// The physics that it will be scanned with; decides how materials are read. [default: that of the survey or pipeline,
    /// refined for a scene by itself]
    #[arg(long, value_name = "PROFILE")]
    pub physics: Option<PhysicsProfile>,
    /// The tree to pack. [default: bvh]
    #[arg(long, value_name = "TREE")]
    pub tree: Option<Builder>,
    /// Whether parts of one mesh file share it; the points are the same. [default: auto]
    #[arg(long, value_name = "WHEN")]
    pub instances: Option<Sharing>,
    /// Overwrite a file that exists.
    #[arg(long)]
    pub force: bool,
}

/// `vlscan scene info`.
#[derive(Debug, Args)]
pub struct InfoArgs {
    /// A scene (file.xml#id), a survey (.xml), a pipeline (.toml), a mesh (.obj), raster (.tif), voxels (.vox), a table of
    /// instances (.csv), or a packed scene (.vlscene).
    pub scene: String,
    /// Of a packed scene: check all epochs, and that all numbers name something that is there. Checksums are compared in any case.
    #[arg(long)]
    pub verify: bool,
    /// Folder to look for files in; may be given more than once.
    #[arg(long, value_name = "DIR")]
    pub assets: Vec<PathBuf>,
    /// As JSON.
    #[arg(long)]
    pub json: bool,
}

/// Kinds of procedural scenes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum SceneKind {
    /// Trees on rolling ground, scanned from an aeroplane.
    Forest,
    /// Hills, scanned from an aeroplane.
    Terrain,
    /// A furnished room, scanned from two tripod positions.
    Room,
}

/// `vlscan scene make`.
#[derive(Debug, Args)]
pub struct MakeArgs {
    /// What to make.
    pub kind: SceneKind,
    /// The folder that gets the files.
    #[arg(short = 'o', long, value_name = "DIR")]
    pub out: PathBuf,
    /// Number of triangles, met within about one per cent; 250k and 10M are understood.
    #[arg(short = 'n', long, value_name = "N", default_value = "100k")]
    pub triangles: Count,
    /// Another seed makes another scene.
    #[arg(long, value_name = "SEED", default_value_t = 1)]
    pub seed: u64,
    /// Edge length of the scene in metres.
    #[arg(long, value_name = "METRES")]
    pub extent: Option<f64>,
    /// Roughly how many pulses the survey emits.
    #[arg(long, value_name = "N")]
    pub pulses: Option<Count>,
    /// Forest: every tree is a part of its own, so that echoes carry the tree's number.
    #[arg(long)]
    pub separate_trees: bool,
    /// Forest: make so many trees and let each stand in --copies places; a forest of a billion triangles is
    /// -n 1G --models 50 --copies 1000.
    #[arg(long, value_name = "N", conflicts_with = "separate_trees")]
    pub models: Option<u64>,
    /// Forest: so many opaque voxels of 0.25 m in the crowns, besides the triangles.
    #[arg(long, value_name = "N", conflicts_with = "models")]
    pub voxels: Option<Count>,
    /// Forest with --models: places of each tree. [default: 100]
    #[arg(long, value_name = "N", requires = "models")]
    pub copies: Option<u64>,
    /// Overwrite files that exist.
    #[arg(long)]
    pub force: bool,
}
