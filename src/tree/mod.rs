//! Which primitive does a ray hit first? Primitives, rays, the trees over them; nothing of lidar.

mod geometry;
mod rays;

pub use geometry::{Cube, Geometry, Hit};
pub use rays::{Hits, RayBundle, Tree};
