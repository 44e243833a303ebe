//! The scene as its file describes it: what the module `scene` loads, and how it places it.

use crate::diag::Place;
use crate::geom::{DVec3, Rotation};
use std::path::PathBuf;

/// A scene as its file describes it; geometry is not loaded yet.
#[derive(Clone, Debug)]
pub struct SceneRecipe {
    /// Asset id.
    pub id: String,
    /// The file that holds it.
    pub path: PathBuf,
    /// Parts in document order.
    pub parts: Vec<PartRecipe>,
    /// Moving scenes: update every n-th pulse period.
    pub dyn_step: u32,
    /// The same in seconds, overrides all steps.
    pub dyn_time_step: Option<f64>,
    /// The packed scene that this is; it has no parts then.
    pub packed: Option<PathBuf>,
    /// Folders that may hold a `spectra` folder, in search order.
    pub asset_folders: Vec<PathBuf>,
}

/// One part of a scene.
#[derive(Clone, Debug)]
pub struct PartRecipe {
    /// Explicit id, if any; otherwise parts are numbered.
    pub id: Option<String>,
    /// Running number of the part element in its scene, from 0 (a skipped part keeps its number).
    pub number: u32,
    /// What is loaded.
    pub loader: Loader,
    /// How it is placed.
    pub transform: Transform,
    /// Rigid motions; empty for a still part.
    pub motions: Vec<MotionSequence>,
    /// Motion timing.
    pub timing: MotionTiming,
    /// Geometry swaps between epochs; empty for most parts.
    pub swaps: Vec<Swap>,
    /// Where the part stands in its file.
    pub place: Option<Place>,
}

/// `p′ = scale · R · p + offset`, then grounding.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Transform {
    /// Accumulated rotation.
    pub rotation: Rotation,
    /// Last non-zero scale.
    pub scale: f64,
    /// Last offset, m.
    pub offset: DVec3,
    /// `onGround` mode of the translate filter (spec input-formats §3.4).
    pub on_ground: i64,
}

impl Transform {
    /// Leaves everything where it is.
    pub const IDENTITY: Transform =
        Transform { rotation: Rotation::IDENTITY, scale: 1.0, offset: DVec3::ZERO, on_ground: 0 };

    /// The image of `p`.
    pub fn apply(&self, p: DVec3) -> DVec3 {
        self.rotation.apply(p) * self.scale + self.offset
    }
}

/// Which axis of an OBJ file points up.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum UpAxis {
    /// z, nothing changes.
    Z,
    /// y: (x, y, z) is read as (x, −z, y).
    Y,
}

/// Materials of loaders that have none in their files (spec input-formats §3.5).
#[derive(Clone, Debug, Default)]
pub struct MaterialChoice {
    /// MTL file, already found.
    pub file: Option<PathBuf>,
    /// Material name; the alphabetically first one otherwise.
    pub name: Option<String>,
    /// Number of randomised variants.
    pub random_variants: u32,
    /// Range of the variation.
    pub random_range: f64,
}

/// The closed list of loaders (spec input-formats §4). Files are already found; several files come from `efilepath`.
#[derive(Clone, Debug)]
pub enum Loader {
    /// Wavefront OBJ.
    Obj {
        /// Files.
        files: Vec<PathBuf>,
        /// Up axis.
        up: UpAxis,
    },
    /// Terrain raster.
    GeoTiff {
        /// File.
        file: PathBuf,
        /// Material.
        material: MaterialChoice,
    },
    /// Point cloud to voxels.
    Xyz(Box<XyzLoader>),
    /// AMAPVox voxels.
    DetailedVoxels(Box<VoxelLoader>),
}

/// Settings of the point cloud loader (spec input-formats §4.4).
#[derive(Clone, Debug)]
pub struct XyzLoader {
    /// Files, each voxelised separately.
    pub files: Vec<PathBuf>,
    /// Every character separates columns; empty means blanks.
    pub separator: String,
    /// Edge length of a voxel, m.
    pub voxel_size: f64,
    /// Divisor of colours.
    pub max_color_value: f64,
    /// Normal of points without one.
    pub default_normal: Option<DVec3>,
    /// Colour columns.
    pub rgb_columns: Option<[usize; 3]>,
    /// Normal columns.
    pub normal_columns: Option<[usize; 3]>,
    /// Voxel normal is that of the point nearest to the centre.
    pub snap_neighbor_normal: bool,
    /// 0: none, 1: plane per voxel, 2 and more: the same in batches.
    pub estimate_normals: u32,
    /// Material.
    pub material: MaterialChoice,
}

/// How rays meet detailed voxels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum VoxelMode {
    /// Exponential free path.
    Transmittive,
    /// Opaque cubes.
    Fixed,
    /// Opaque cubes scaled by density to this exponent.
    Scaled(f64),
}

/// Settings of the AMAPVox loader (spec input-formats §4.5).
#[derive(Clone, Debug)]
pub struct VoxelLoader {
    /// Files.
    pub files: Vec<PathBuf>,
    /// Interaction.
    pub mode: VoxelMode,
    /// Whether voxels without density are dropped (the mode was not spelled out).
    pub drop_empty: bool,
    /// `scaled`: random displacement within the original cell.
    pub random_shift: bool,
    /// Leaf angle table.
    pub lad_table: Option<PathBuf>,
    /// Material.
    pub material: MaterialChoice,
}

/// A sequence of rigid motions (spec input-formats §3.7).
#[derive(Clone, Debug, PartialEq)]
pub struct MotionSequence {
    /// Id within the part.
    pub id: String,
    /// Repetitions; 0 = for ever.
    pub loops: u32,
    /// Index of the sequence that follows.
    pub next: Option<usize>,
    /// Motions applied in this order at each step.
    pub motions: Vec<Motion>,
}

/// One rigid motion per update step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// What it does.
    pub kind: MotionKind,
    /// About the part's own centroid instead of the scene origin.
    pub about_self: bool,
    /// Share of the scene shift to apply to centres and vectors.
    pub auto_crs: f64,
}

/// The closed list of motions; axes and normals are unit vectors, angles radians.
#[derive(Clone, Copy, Debug, PartialEq)]
#[allow(missing_docs)] // the fields are the motions' own mathematical names
pub enum MotionKind {
    Identity,
    Translation { by: DVec3 },
    Rotation { axis: DVec3, angle: f64, centre: Option<DVec3> },
    Reflection { normal: DVec3 },
    GlidePlane { normal: DVec3, shift: DVec3 },
    Helical { axis: DVec3, angle: f64, glide: f64 },
    RotaryReflection { axis: DVec3, angle: f64, centre: Option<DVec3> },
}

/// When a moving part moves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionTiming {
    /// Move every n-th scene update.
    pub dyn_step: u32,
    /// Rebuild the tree every n-th move.
    pub tree_step: u32,
    /// `dyn_step` in seconds.
    pub dyn_time_step: Option<f64>,
    /// `tree_step` in seconds.
    pub tree_time_step: Option<f64>,
}

/// One state of a part between epochs (spec input-formats §3.8).
#[derive(Clone, Debug)]
pub struct Swap {
    /// Number of epochs it lasts.
    pub epochs: u32,
    /// Keep the scene shift of the first epoch.
    pub keep_crs: bool,
    /// The part disappears.
    pub vanish: bool,
    /// New geometry, if the first filter is a loader.
    pub loader: Option<Loader>,
    /// New scale, if given.
    pub scale: Option<f64>,
    /// New offset and grounding mode, if given.
    pub offset: Option<(DVec3, i64)>,
}
