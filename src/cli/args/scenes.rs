//! The command line of `vlscan scene`.

use crate::options::{Count, Seed};
use crate::pulse::PhysicsProfile;
use crate::scene::Sharing;
use crate::tree::Builder;
use clap::{Args, Subcommand, ValueEnum};
use std::path::PathBuf;

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
    /// Tell what a scene holds and costs: parts, primitives, bounds, materials, memory, faults.
    Info(InfoArgs),
    /// Compile a scene and its tree to one file that is open in milliseconds, whatever its size.
    Pack(PackArgs),
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
    /// The physics that it will be scanned with; decides about specular shares. [default: helios]
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
    /// Of a packed scene: read all of it and compare the checksums.
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
