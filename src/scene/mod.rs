//! What is scanned: parts with geometry and materials in one frozen frame.

mod material;
mod model;

pub use material::{Material, Reflection};
pub use model::{Part, Scene, Surface};
