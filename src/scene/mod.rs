//! What is scanned: parts with geometry and materials in one frozen frame.
//!
//! ```text
//! SceneRecipe ─ load ─► loaders: obj │ geotiff │ xyz │ vox ─► assembly ─ place ─ ground ─ shift ─► Scene
//!                          └ mtl, spectra ─► library (materials at the scanner's wavelength)
//! ```
//!
//! A scene never changes. What moves is told by a plan and a state beside it (`motion`), and swapped parts give every epoch
//! a scene of its own (`epoch`):
//!
//! ```text
//! SceneRecipe, Scene ─► MotionPlan, MotionState ─► DynamicScene: moving parts where rays see them
//! SceneRecipe ─ load_epoch(0, 1, …) ─► a Scene per epoch
//! ```

mod assembly;
mod doubts;
#[cfg(test)]
mod fixture;
mod geotiff;
mod ground;
mod instances;
mod inventory;
mod lad;
mod library;
mod load;

mod epoch;
mod material;
mod model;
mod motion;
mod mtl;
mod number;
mod obj;
mod pack;
mod place;
mod plane;
mod rules;
mod spectra;
mod surface_ids;
#[cfg(test)]
mod tests;
mod text;
mod vox;
mod voxel;
mod xyz;

pub use epoch::{SceneFrame, count_epochs};
pub use geotiff::raster_needs;
pub use instances::{InstanceSet, Sharing};
pub use inventory::Inventory;
pub use lad::LadTable;
pub use load::{LoadOptions, load, load_epoch};
pub use material::{Material, Reflection, SPHERICAL_MEAN_COSINE};
pub use model::{MovingPart, Part, ReadyTree, Scene, Surface};
pub use motion::{DynamicObject, DynamicScene, MotionPlan, MotionState, ObjectUpdate};
pub use pack::{Pack, pack};
pub use rules::MaterialRules;
pub use surface_ids::SurfaceIds;
pub use voxel::{Voxel, VoxelKind};
