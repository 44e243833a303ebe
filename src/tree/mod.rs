//! Which primitive does a ray hit first? Primitives, rays, the trees over them; nothing of lidar.
//!
//! | file | what it does |
//! |---|---|
//! | `geometry`, `rays` | primitives; rays by pulse; hits |
//! | `intersect` | the verdict: one ray, one primitive, double precision |
//! | `options`, `build` | what a tree is built with; the builders |
//! | `frame`, `node`, `block` | the tree's parts, in single precision around the scene's centre |
//! | `beam` | the filter: a bundle of rays against planes, boxes and blocks of triangles |
//! | `trace` | single rays |
//! | `instances`, `placed` | models in many places; their trees and rays |
//! | `pack` | all of it as arrays of a file |
//! | `kernel`, `simd` | groups of pulses; the instruction sets that they are traced with |
//!
//! Trees and beams only choose which verdicts are asked for, and err on the side of asking; so every tree, every way to
//! trace and every instruction set gives the same hits, bit for bit, as asking for all of them.

mod beam;
mod block;
mod build;
mod frame;
mod geometry;
mod index;
mod instances;
mod intersect;
mod kernel;
mod node;
mod options;
mod pack;
mod placed;
mod rays;
mod simd;
mod trace;

pub use geometry::{Cube, Geometry, Hit};
pub use index::Tree;
pub use instances::{Instances, Model, Placement};
pub use options::{BuildOptions, Builder};
pub use rays::{Hits, RayBundle, RayGroup};
pub(crate) use simd::{Level, prefetch};

#[cfg(test)]
mod golden_tests;
#[cfg(test)]
mod property_tests;
