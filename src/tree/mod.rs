//! The first primitive hit by a ray: primitives, rays, and the trees over them, independent of LiDAR.
//!
//! | file | contents |
//! |---|---|
//! | `geometry`, `rays` | primitives; rays by pulse; hits |
//! | `intersect` | the exact test: one ray, one primitive, double precision |
//! | `options`, `build` | build options; the builders |
//! | `index`, `frame`, `node`, `block` | the tree and its parts, in single precision around the scene's centre |
//! | `frustum` | the filter: rays with one origin against planes, boxes and blocks of triangles |
//! | `trace`, `trace_instances` | single rays |
//! | `instances` | models with several placements |
//! | `pack` | trees and geometry as arrays of a file |
//! | `kernel`, `simd` | packets of pulses; the instruction sets |
//!
//! Trees and frustums only choose which exact tests are made, and err on the side of more tests. So every tree, every
//! traversal and every instruction set reports the same hits, bit for bit, as testing everything.

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
