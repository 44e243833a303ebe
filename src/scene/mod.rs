//! What is scanned: parts with geometry and materials in one frozen frame.
//!
//! ```text
//! SceneRecipe ─ load ─► loaders: obj │ geotiff │ xyz │ vox ─► assembly ─ place ─ ground ─ shift ─► Scene
//!                          └ mtl, spectra ─► library (materials at the scanner's wavelength)
//! ```
//!
//! A scene never changes. What moves is told by a plan and a state beside it (`motion`), and swapped parts give every play
//! a scene of its own (`play`):
//!
//! ```text
//! SceneRecipe, Scene ─► Movers, MoverState ─► Stage: moving parts where rays see them
//! SceneRecipe ─ load_play(0, 1, …) ─► a Scene per play
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
pub mod make;
mod material;
mod model;
mod motion;
mod mtl;
mod number;
mod obj;
mod pack;
mod place;
mod plane;
mod play;
mod rules;
mod spectra;
mod surface_of;
#[cfg(test)]
mod tests;
mod text;
mod vox;
mod voxel;
mod xyz;

pub use geotiff::{RasterNeed, raster_needs};
pub use instances::{Placed, Sharing};
pub use inventory::Inventory;
pub use lad::LadTable;
pub use load::{LoadOptions, load, load_play};
pub use material::{Material, Reflection, SPHERICAL_MEAN_COSINE};
pub use model::{Mover, Part, ReadyTree, Scene, Surface};
pub use motion::{Actor, Change, MoverState, Movers, Stage};
pub use pack::{Conditions, Pack, Packed, pack};
pub use play::{Stand, plays};
pub use rules::MaterialRules;
pub use surface_of::SurfaceOf;
pub use voxel::{Voxel, VoxelKind};
