//! What is scanned: parts with geometry and materials in one frozen frame.
//!
//! ```text
//! SceneRecipe ─ load ─► loaders: obj │ geotiff │ xyz │ vox ─► assembly ─ place ─ ground ─ shift ─► Scene
//!                          └ mtl, spectra ─► library (materials at the scanner's wavelength)
//! ```

mod assembly;
#[cfg(test)]
mod fixture;
mod geotiff;
mod ground;
mod lad;
mod library;
mod load;
pub mod make;
mod material;
mod model;
mod mtl;
mod number;
mod obj;
mod place;
mod plane;
mod spectra;
#[cfg(test)]
mod tests;
mod text;
mod vox;
mod voxel;
mod xyz;

pub use lad::LadTable;
pub use load::{LoadOptions, load};
pub use material::{Material, Reflection};
pub use model::{Part, Scene, Surface};
pub use voxel::{Voxel, VoxelKind};
