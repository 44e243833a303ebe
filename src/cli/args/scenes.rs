//! The command line of `vlscan scene`.

use clap::{Args, Subcommand};
use std::path::PathBuf;
use vlscan_fit::scene::ReconstructOptions;
use vlscan_lidar::pulse::PhysicsProfile;
use vlscan_options::{Bytes, Positive, Seed, choice};
use vlscan_scene::Sharing;
use vlscan_tools::generate::{SceneOptions, StandOptions};
use vlscan_trace::Builder;

/// `vlscan scene`.
#[derive(Debug, Args)]
pub struct SceneArgs {
    /// Command for scenes.
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
    /// The inventory is a table with a heading: x, y and height are required; crown (diameter), dbh, species,
    /// id and z are optional. Each tree gets one of the three models of its species that are closest in
    /// height and in the ratio of crown to height, drawn at random, scaled to the tree's height, rotated, and
    /// placed on the terrain, which is ground. The output folder contains stand.xml, the table of instances,
    /// and labels.csv: number of the part in the points, id, species, model, position, height, crown, dbh.
    ///
    /// With --epochs stand.xml contains a scene for each epoch: stand_0, stand_1 and so on.
    Stand(StandArgs),
    /// Reconstruct a scene from a classified point cloud: terrain, roofs, foliage as voxels.
    ///
    /// Points of class 2 (ground), 9 (water), 8, 10 and 11 become the terrain, 6 and 17 roofs with walls; 7
    /// and 18 are noise; all others become voxels of leaf area density, of the class of their points. The
    /// position of the instrument is estimated from pulses with several returns, or from scan angles. The
    /// output folder contains scene.xml with its files, scene.toml with scene and instrument, the trajectory,
    /// and report.json with all estimates.
    Reconstruct(ReconstructArgs),
    /// Describe a scene: parts, primitives, bounds, materials, memory, faults.
    Info(InfoArgs),
    /// Draw a scene from above, with a world file that tells the coordinates of its pixels.
    Map(MapArgs),
    /// Compile a scene and its tree to one file that opens without loading meshes or building the tree.
    Pack(PackArgs),
}

/// `vlscan scene stand`.
#[derive(Debug, Args)]
pub struct StandArgs {
    /// Output folder.
    #[arg(short = 'o', long, value_name = "DIR", value_parser = super::files())]
    pub out: PathBuf,
    /// Inputs and choices of the stand.
    #[command(flatten)]
    pub options: StandOptions,
}

/// `vlscan scene reconstruct`.
#[derive(Debug, Args)]
pub struct ReconstructArgs {
    /// Output folder.
    #[arg(short = 'o', long, value_name = "DIR", value_parser = super::files())]
    pub out: PathBuf,
    /// Source and settings of the reconstruction.
    #[command(flatten)]
    pub options: ReconstructOptions,
}

/// `vlscan scene pack`.
#[derive(Debug, Args)]
pub struct PackArgs {
    /// A scene (file.xml#id), a geometry file, or a survey (.xml) or pipeline (.toml), whose scanner's
    /// wavelength is used.
    pub scene: String,
    /// The packed scene. [default: the scene's file with the extension .vlscene]
    #[arg(short = 'o', long, value_name = "PATH", value_parser = super::on_disk())]
    pub out: Option<PathBuf>,
    /// Folder to look for files in; may be given more than once.
    #[arg(long, value_name = "DIR")]
    pub assets: Vec<PathBuf>,
    /// Wavelength at which spectra are evaluated. [default: that of the survey's scanner, else 1064]
    #[arg(long, value_name = "NM")]
    pub wavelength: Option<Positive>,
    /// Seed of random materials and voxel places. [default: the survey's, else 0]
    #[arg(long, value_name = "SEED")]
    pub seed: Option<Seed>,
    /// The physics it will be scanned with; determines how materials are read. [default: that of the survey
    /// or pipeline, refined for a scene by itself]
    #[arg(long, value_name = "PROFILE", value_parser = choice::<PhysicsProfile>())]
    pub physics: Option<PhysicsProfile>,
    /// The tree to pack. [default: bvh]
    #[arg(long, value_name = "TREE", value_parser = choice::<Builder>())]
    pub tree: Option<Builder>,
    /// Share triangles among parts of the same mesh file; does not change the points. [default: auto]
    #[arg(long, value_name = "WHEN", value_parser = choice::<Sharing>())]
    pub instances: Option<Sharing>,
    /// Divide the scene into tiles, which runs with this option load when rays come near, and pack it with no
    /// more memory than this for them, e.g. 2G. [default: the scene is packed whole]
    #[arg(long, value_name = "SIZE")]
    pub scene_memory: Option<Bytes>,
    /// Pack the colours of surfaces, with their textures, too, for runs with the columns Red, Green and Blue.
    #[arg(long)]
    pub colours: bool,
    /// Replace an existing file.
    #[arg(long)]
    pub force: bool,
}

/// `vlscan scene info`.
#[derive(Debug, Args)]
pub struct InfoArgs {
    /// A scene (file.xml#id), a survey (.xml), a pipeline (.toml), a mesh (.obj), raster (.tif, .vrt, a
    /// folder of tiles), voxels (.vox), a table of instances (.csv), or a packed scene (.vlscene).
    pub scene: String,
    /// Packed scenes: check all epochs and all indices. Checksums are always compared.
    #[arg(long)]
    pub verify: bool,
    /// Folder to look for files in; may be given more than once.
    #[arg(long, value_name = "DIR")]
    pub assets: Vec<PathBuf>,
    /// As JSON.
    #[arg(long)]
    pub json: bool,
}

/// `vlscan scene map`.
#[derive(Debug, Args)]
pub struct MapArgs {
    /// A scene (file.xml#id), a survey (.xml), a pipeline (.toml), a mesh (.obj), raster (.tif, .vrt, a
    /// folder of tiles), voxels (.vox), a table of instances (.csv), or a packed scene (.vlscene).
    pub scene: String,
    /// The picture (.png), coloured by height, north at the top; its world file, which GIS read, is beside it
    /// (.pgw).
    #[arg(short = 'o', long, value_name = "PATH", value_parser = super::files())]
    pub out: PathBuf,
    /// Pixels along the longer side, 64 to 16384.
    #[arg(
        long,
        value_name = "PIXELS",
        default_value_t = 1200,
        value_parser = clap::value_parser!(u32).range(64..=16_384),
    )]
    pub side: u32,
    /// Folder to look for files in; may be given more than once.
    #[arg(long, value_name = "DIR")]
    pub assets: Vec<PathBuf>,
    /// Replace existing files.
    #[arg(long)]
    pub force: bool,
}

/// `vlscan scene make`.
#[derive(Debug, Args)]
pub struct MakeArgs {
    /// Output folder.
    #[arg(short = 'o', long, value_name = "DIR", value_parser = super::files())]
    pub out: PathBuf,
    /// Scene to make.
    #[command(flatten)]
    pub options: SceneOptions,
}
