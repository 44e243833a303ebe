//! The scene as its file describes it: the input of the module `scene`.

use super::{MaterialChanges, Mesh, RasterFiles};
use std::path::PathBuf;
use std::sync::Arc;
use vlscan_base::diag::Place;
use vlscan_crs::LengthUnit;
use vlscan_geom::{DVec3, Rotation};

/// A scene as its file describes it; geometry is not loaded yet.
#[derive(Clone, Debug)]
pub struct SceneRecipe {
    /// Id in its file.
    pub id: String,
    /// The file that describes it.
    pub path: PathBuf,
    /// Parts in document order.
    pub parts: Vec<PartRecipe>,
    /// Moving scenes: update every n-th pulse period.
    pub dyn_step: u32,
    /// Moving scenes: update interval in seconds; overrides all steps.
    pub dyn_time_step: Option<f64>,
    /// Path of a packed scene, which has no parts; `None` for other scenes.
    pub packed: Option<PathBuf>,
    /// Folders that may hold a `spectra` folder, in search order.
    pub asset_folders: Vec<PathBuf>,
}

impl SceneRecipe {
    /// A scene of these parts, which no file describes. `path` is its name in messages.
    pub fn of_parts(path: impl Into<PathBuf>, parts: Vec<PartRecipe>) -> SceneRecipe {
        let parts = (0..).zip(parts).map(|(number, part)| PartRecipe { number, ..part }).collect();
        SceneRecipe {
            id: "scene".to_owned(),
            path: path.into(),
            parts,
            dyn_step: 1,
            dyn_time_step: None,
            packed: None,
            asset_folders: Vec::new(),
        }
    }
}

impl From<Mesh> for SceneRecipe {
    /// A scene of one part.
    fn from(mesh: Mesh) -> SceneRecipe {
        SceneRecipe::of_parts("<mesh>", vec![PartRecipe::new(Loader::Mesh(Arc::new(mesh)))])
    }
}

/// A part of a scene.
#[derive(Clone, Debug)]
pub struct PartRecipe {
    /// Explicit id, if any; otherwise parts are numbered.
    pub id: Option<String>,
    /// Name of the object, if the file names it; otherwise the name of the geometry.
    pub name: Option<String>,
    /// Running number of the part element in its scene, from 0 (a skipped part keeps its number).
    pub number: u32,
    /// Source of its geometry.
    pub loader: Loader,
    /// Materials that replace those of its files, in this order.
    pub changes: MaterialChanges,
    /// Placement in the scene.
    pub transform: Transform,
    /// Rigid motions; empty for a part at rest.
    pub motions: Vec<MotionSequence>,
    /// How often it moves.
    pub timing: MotionTiming,
    /// Geometry swaps between epochs; empty for most parts.
    pub swaps: Vec<Swap>,
    /// Place of the part in its file, for messages.
    pub place: Option<Place>,
}

impl PartRecipe {
    /// A part at rest, with the materials and the position of its geometry.
    pub fn new(loader: Loader) -> PartRecipe {
        PartRecipe {
            id: None,
            name: None,
            number: 0,
            loader,
            changes: MaterialChanges::default(),
            transform: Transform::IDENTITY,
            motions: Vec::new(),
            timing: MotionTiming::default(),
            swaps: Vec::new(),
            place: None,
        }
    }
}

/// `p′ = scale · R · W · p + offset`, then grounding. W multiplies x and y by `widening`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Transform {
    /// Accumulated rotation.
    pub rotation: Rotation,
    /// Factor of x and y beyond that of z, above 0. Only instances of tables have one other than 1.
    pub widening: f64,
    /// Last non-zero scale.
    pub scale: f64,
    /// Last offset, m.
    pub offset: DVec3,
    /// `onGround` mode of the translate filter (spec input-formats §3.4).
    pub on_ground: i64,
}

impl Transform {
    /// No change.
    pub const IDENTITY: Transform = Transform {
        rotation: Rotation::IDENTITY,
        widening: 1.0,
        scale: 1.0,
        offset: DVec3::ZERO,
        on_ground: 0,
    };

    /// The image of a point.
    pub fn apply(&self, p: DVec3) -> DVec3 {
        let widened = DVec3::new(p.x * self.widening, p.y * self.widening, p.z);
        self.rotation.apply(widened) * self.scale + self.offset
    }

    /// True if z stays vertical.
    pub fn is_upright(&self) -> bool {
        self.rotation.apply(DVec3::Z).z > 1.0 - 1e-12
    }

    /// The point whose image is `p`.
    pub fn undo(&self, p: DVec3) -> DVec3 {
        let p = self.rotation.inverse().apply((p - self.offset) / self.scale);
        DVec3::new(p.x / self.widening, p.y / self.widening, p.z)
    }
}

impl Default for Transform {
    fn default() -> Transform {
        Transform::IDENTITY
    }
}

/// How mesh files are read.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MeshReading {
    /// Axis that points up in the files; `None`: that of the format, y for glTF and z for the others.
    pub up: Option<UpAxis>,
    /// Length of a unit of their coordinates, m; `None`: 1 m, which is doubted if it is improbable.
    pub unit_m: Option<f64>,
    /// Table of materials, resolved; `None`: `materials.csv` next to the file, if it exists and the file is
    /// not OBJ file.
    pub materials: Option<PathBuf>,
}

impl MeshReading {
    /// Units that [`MeshReading::unit`] reads.
    pub const UNITS: &str = "m, dm, cm, mm, km, in, ft, us-ft, yd, or a number of metres above 0";

    /// The length of a unit of the files, m.
    pub fn metres_per_unit(&self) -> f64 {
        self.unit_m.unwrap_or(1.0)
    }

    /// The length of a unit of this name, m.
    pub fn unit(name: &str) -> Option<f64> {
        let number = || name.trim().parse().ok().filter(|n: &f64| *n > 0.0 && n.is_finite());
        LengthUnit::of_name(name).map(|unit| unit.metres).or_else(number)
    }
}

/// Up axis of a mesh file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum UpAxis {
    /// z: coordinates are unchanged.
    Z,
    /// y: (x, y, z) is read as (x, −z, y).
    Y,
}

impl UpAxis {
    /// The axes by name.
    pub const NAMES: [(&str, UpAxis); 2] = [("y", UpAxis::Y), ("z", UpAxis::Z)];
}

/// Material settings of loaders whose files have no materials (spec input-formats §3.5).
#[derive(Clone, Debug, Default)]
pub struct MaterialChoice {
    /// MTL file, resolved.
    pub file: Option<PathBuf>,
    /// Material name; `None` = the alphabetically first.
    pub name: Option<String>,
    /// Number of randomised copies of the material, which primitives use in turn.
    pub random_variants: u32,
    /// Largest change of the colours of a randomised copy.
    pub random_range: f64,
}

/// Loaders (spec input-formats §4); no others exist. File paths are resolved; several files come from
/// `efilepath`.
#[derive(Clone, Debug)]
pub enum Loader {
    /// Meshes: OBJ, PLY, STL, OFF, glTF.
    MeshFiles {
        /// The files.
        files: Vec<PathBuf>,
        /// How they are read.
        reading: MeshReading,
    },
    /// Terrain raster.
    GeoTiff {
        /// The raster, or the tiles that make it up.
        files: RasterFiles,
        /// Its material.
        material: MaterialChoice,
    },
    /// Point cloud to voxels.
    Xyz(Box<XyzLoader>),
    /// AMAPVox voxels.
    DetailedVoxels(Box<VoxelLoader>),
    /// Triangles in memory.
    Mesh(Arc<Mesh>),
}

impl Loader {
    /// The files that it reads.
    pub fn files(&self) -> &[PathBuf] {
        match self {
            Loader::MeshFiles { files, .. } => files,
            Loader::GeoTiff { files, .. } => files.all(),
            Loader::Xyz(xyz) => &xyz.files,
            Loader::DetailedVoxels(voxels) => &voxels.files,
            Loader::Mesh(_) => &[],
        }
    }
}

/// Settings of the point cloud loader (spec input-formats §4.4).
#[derive(Clone, Debug)]
pub struct XyzLoader {
    /// Files, each of which becomes voxels separately.
    pub files: Vec<PathBuf>,
    /// Characters each of which separates columns; empty means blanks.
    pub separator: String,
    /// Edge length of a voxel, m.
    pub voxel_size: f64,
    /// Value that colours are divided by.
    pub max_color_value: f64,
    /// Normal of points that have none.
    pub default_normal: Option<DVec3>,
    /// Columns of red, green and blue, from 0.
    pub rgb_columns: Option<[usize; 3]>,
    /// Columns of the normal, from 0.
    pub normal_columns: Option<[usize; 3]>,
    /// True if a voxel has the normal of the point nearest to its centre.
    pub snap_neighbor_normal: bool,
    /// 0: none, 1: a plane per voxel, 2 and more: a plane per voxel, in batches.
    pub estimate_normals: u32,
    /// Material of the voxels.
    pub material: MaterialChoice,
}

/// How rays intersect detailed voxels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum VoxelMode {
    /// Exponential free path.
    Transmittive,
    /// Opaque cubes.
    Fixed,
    /// Opaque cubes scaled by the density to this power.
    Scaled(f64),
}

/// Settings of the AMAPVox loader (spec input-formats §4.5).
#[derive(Clone, Debug)]
pub struct VoxelLoader {
    /// The files.
    pub files: Vec<PathBuf>,
    /// How rays intersect them.
    pub mode: VoxelMode,
    /// True if voxels without density are dropped; true where the scene states no mode.
    pub drop_empty: bool,
    /// `scaled` mode: random displacement within the original cell.
    pub random_shift: bool,
    /// Table of leaf angles.
    pub lad_table: Option<PathBuf>,
    /// Material of the voxels.
    pub material: MaterialChoice,
}

/// A sequence of rigid motions (spec input-formats §3.7).
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct MotionSequence {
    /// Id within the part.
    pub id: String,
    /// Repetitions; 0 = unlimited.
    pub loops: u32,
    /// Index of the sequence that follows.
    pub next: Option<usize>,
    /// Motions applied in this order at each step.
    pub motions: Vec<Motion>,
}

/// One rigid motion per update step.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Motion {
    /// The rigid motion that each step applies.
    pub kind: MotionKind,
    /// True if the centre is the part's own centroid instead of the scene origin.
    pub about_self: bool,
    /// Fraction of the scene shift that is applied to centres and vectors.
    pub auto_crs: f64,
}

/// Rigid motions; no others exist. Axes and normals are unit vectors, angles radians.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[allow(missing_docs, reason = "variants and fields have the mathematical names of the motions")]
pub enum MotionKind {
    Identity,
    Translation { by: DVec3 },
    Rotation { axis: DVec3, angle: f64, centre: Option<DVec3> },
    Reflection { normal: DVec3 },
    GlidePlane { normal: DVec3, shift: DVec3 },
    Helical { axis: DVec3, angle: f64, glide: f64 },
    RotaryReflection { axis: DVec3, angle: f64, centre: Option<DVec3> },
}

/// Update intervals of a moving part.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct MotionTiming {
    /// The part moves at every n-th scene update.
    pub dyn_step: u32,
    /// The tree is rebuilt at every n-th move.
    pub tree_step: u32,
    /// `dyn_step` in seconds.
    pub dyn_time_step: Option<f64>,
    /// `tree_step` in seconds.
    pub tree_time_step: Option<f64>,
}

impl Default for MotionTiming {
    fn default() -> MotionTiming {
        MotionTiming { dyn_step: 1, tree_step: 1, dyn_time_step: None, tree_time_step: None }
    }
}

/// One state of a part between epochs (spec input-formats §3.8).
#[derive(Clone, Debug)]
pub struct Swap {
    /// Number of epochs for which the state lasts, at least 1; the last state of a part stays.
    pub epochs: u32,
    /// True if the scene shift of the first epoch is kept.
    pub keep_crs: bool,
    /// True if the part is absent in this state; afterwards only a new loader brings it back.
    pub vanish: bool,
    /// New geometry; `None` unless the first filter is a loader.
    pub loader: Option<Loader>,
    /// New scale; `None` = unchanged.
    pub scale: Option<f64>,
    /// New offset (m) and grounding mode; `None` = unchanged.
    pub offset: Option<(DVec3, i64)>,
}
