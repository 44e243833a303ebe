//! Which primitive does a ray hit first? Primitives, rays, the trees over them; nothing of lidar.
//!
//! | file | what it does |
//! |---|---|
//! | `geometry`, `rays` | primitives; rays by pulse; hits |
//! | `intersect` | the exact test: one ray, one primitive, double precision |
//! | `options`, `build` | what a tree is built with; the builders |
//! | `index`, `frame`, `node`, `block` | the tree; its parts, in single precision around the scene's centre |
//! | `frustum` | the filter: rays with one origin against planes, boxes and blocks of triangles |
//! | `trace`, `trace_instances` | single rays |
//! | `instances` | models in many places |
//! | `pack` | all of it as arrays of a file |
//! | `kernel`, `simd` | packets of pulses; the instruction sets that they are traced with |
//!
//! Trees and frustums only choose which exact tests are made, and err on the side of making them; so every tree, every way to
//! trace and every instruction set gives the same hits, bit for bit, as making all of them.

mod block;
mod build;
mod frame;
mod frustum;
mod geometry;
mod index;
mod instances;
mod intersect;
mod kernel;
mod node;
mod options;
mod pack;
mod rays;
pub(crate) mod simd;
mod trace;
mod trace_instances;

pub use geometry::{Cube, Geometry, Hit};
pub use index::Tree;
pub use instances::{Instances, Model, Placement};
pub use kernel::TraceScratch;
pub use options::{BuildOptions, Builder};
pub use rays::{Hits, RayGroup};
pub(crate) use simd::prefetch;

#[cfg(test)]
mod golden_tests;
#[cfg(test)]
mod property_tests;
