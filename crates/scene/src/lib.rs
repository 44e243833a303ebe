//! The scanned scene: parts with geometry and materials in one frame.
//!
//! ```text
//! SceneRecipe ─► loaders: mesh │ raster │ cloud │ voxel ─► builder ─ transform, ground, shift ─► Scene
//!                          └ mtl, spectra ─► library (materials at the scanner's wavelength)
//! ```
//!
//! A scene is immutable once it is loaded. Moving parts have a plan and a state outside it, and scenes with
//! swapped parts are reloaded for every epoch:
//!
//! ```text
//! SceneRecipe, Scene ─► MotionPlan, MotionState ─► DynamicScene: moving parts in the poses that rays hit
//! SceneRecipe ─ load_epoch(0, 1, …) ─► a Scene per epoch
//! ```
//!
//! | file | what it does |
//! |---|---|
//! | `load`, `builder` | load a scene from meshes, rasters, point clouds and vegetation voxels; the scene under construction |
//! | `text`, `number` | files of text: lines, problems with their places, numbers |
//! | `change` | materials that replace those of a part |
//! | `library`, `mtl`, `mtl_optics`, `mtl_texture`, `spectra`, `surface_library`, `reflectance_issues`, `reflectance_units` | material definitions, their resolution and problems |
//! | `ground`, `plane` | drop parts to the ground; planes fitted to points |
//! | `ground_model` | the ground of a loaded scene |
//! | `instances`, `instance_set` | parts that share a mesh |
//! | `tiles` | parts that are in memory only while rays need them |
//! | `coincident` | triangles that repeat an earlier one |
//! | `model`, `primitive`, `triangle`, `surfaces`, `material`, `optics`, `voxel`, `grid_voxels`, `lad` | the loaded scene and its components |
//! | `colours`, `colour_at`, `texture` | colours of surfaces for people; images |
//! | `colour_builder`, `colour_store` | colours of a scene under construction |
//! | `motion` | moving parts |
//! | `epoch` | swapped parts |
//! | `conditions` | the settings that a scene depends on |
//! | `pack` | packed scenes |
//! | `fingerprint`, `heights` | checksums of scenes, and of the heights of their rasters |
//! | `crs`, `frames` | coordinate reference systems of rasters and meshes; parts in local coordinates beside a grid |
//! | `water_levels` | water below everything else |
//! | `inventory`, `part_facts` | count the contents of a scene and of its parts |

#![deny(unsafe_code)]

mod builder;
mod change;
mod coincident;
mod colour_at;
mod colour_builder;
mod colour_store;
mod colours;
mod conditions;
mod crs;
mod epoch;
mod fingerprint;
#[cfg(test)]
mod fixture;
mod frames;
mod grid_voxels;
mod ground;
mod ground_model;
mod heights;
mod instance_set;
mod instances;
mod inventory;
mod lad;
mod library;
mod load;
mod material;
mod model;
mod motion;
mod mtl;
mod mtl_optics;
mod mtl_texture;
mod number;
mod optics;
mod pack;
mod part_facts;
mod plane;
mod primitive;
mod reflectance_issues;
mod reflectance_units;
mod spectra;
mod surface_library;
mod surfaces;
#[cfg(test)]
mod tests;
mod text;
mod texture;
mod tiles;
mod triangle;
mod voxel;
mod water_levels;

pub use builder::{LoadOptions, Sharing};
pub use colours::Colours;
pub use conditions::{ConditionMismatch, Conditions};
pub use epoch::{SceneFrame, count_epochs};
pub use fingerprint::fingerprint;
pub use grid_voxels::{GridSurfaces, GridVoxels};
pub use ground_model::{Fallback, GroundModel};
pub use instance_set::InstanceSet;
pub use inventory::Inventory;
pub use lad::LadTable;
pub use load::{
    GltfError, GridError, MeshError, OffError, PlyMeshError, RasterError, StlError, UnpackError, load,
    load_epoch, obj_materials, raster_needs,
};
pub use material::{Material, Reflection, SPHERICAL_MEAN_COSINE};
pub use model::{MovingPart, PackedTree, Part, Scene, Sizes};
pub use motion::{
    BodyBox, BodyPose, DynamicObject, DynamicScene, MotionPlan, MotionState, ObjectUpdate, Twist,
    check_time_step,
};
pub use mtl::read_materials;
pub use optics::{GLASS_INDEX, Optics, OpticsKind, SHEET_THICKNESS, Water};
pub use pack::{Pack, pack};
pub use part_facts::{MaterialArea, PartFacts, material_areas};
pub use primitive::{PrimitiveFacts, PrimitiveShape};
pub use surface_library::{SURFACE_SPECTRA, SurfaceSpectrum};
pub use surfaces::{Surface, SurfaceIds};
pub use tiles::{PlaceInRaster, Tile, TileFacts, TileOptions, TileReader, Tiles};
pub use triangle::SceneTriangle;
pub use voxel::{Voxel, VoxelKind};
