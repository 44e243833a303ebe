#![doc = include_str!("../README.md")]
//!
//! ## Inside
//!
//! A [`Geometry`] holds triangles, cubes, height fields and grids of voxels, a [`Tree`] is built over it, and
//! [`Tree::nearest_where`] finds the first hit of a ray, [`Tree::trace_rays`] those of many, and
//! [`Tree::trace_group`] those of groups ([`RayGroup`], [`Hits`]). [`Instances`] place a model many times.
//! These functions run in the thread of the caller: threads share the tree, and each has its own
//! [`TraceScratch`].
//!
//! | file | contents |
//! |---|---|
//! | `geometry`, `primitive`, `cube`, `rays` | primitives and their numbers; rays by pulse; hits |
//! | `intersect` | the exact test: one ray, one primitive, double precision |
//! | `options`, `build` | build options; the builders |
//! | `index`, `frame`, `node`, `block` | the tree and its parts, in single precision around the scene's centre |
//! | `frustum` | the filter: rays with one origin against planes, boxes and blocks of triangles |
//! | `trace`, `trace_instances`, `scattered` | single rays; many of them |
//! | `checked` | geometries that are checked before |
//! | `instances` | models with several placements |
//! | `heights` | terrain as a grid of heights, whose triangles are computed when they are tested |
//! | `voxels` | cubes on a regular grid, which are computed when they are tested |
//! | `parts` | trees as plain arrays and numbers, for files |
//! | `residency` | items that are loaded when rays need them, within a budget of memory |
//! | `kernel`, `simd` | packets of pulses; the instruction sets |
//! | `stack` | nodes that wait to be visited |
//! | `memory` | memory of vectors |
//!
//! Trees and frustums only choose which exact tests are made, and err on the side of more tests. So every
//! tree, every traversal and every instruction set reports the same hits, bit for bit, as testing everything.

#![deny(unsafe_code)]

mod block;
mod build;
mod checked;
mod cube;
mod frame;
mod frustum;
mod geometry;
mod heights;
mod index;
mod instances;
mod intersect;
mod kernel;
mod memory;
mod node;
mod options;
mod parts;
mod primitive;
mod rays;
mod residency;
mod scattered;
#[doc(hidden)]
pub mod simd;
mod stack;
mod trace;
mod trace_instances;
mod voxels;

#[doc(hidden)]
pub use block::Block;
pub use checked::GeometryError;
pub use cube::Cube;
pub use frame::Frame;
pub use geometry::{Geometry, Hit};
pub use heights::{HeightField, HeightGrid, Heights, Similarity};
pub use index::Tree;
pub use instances::{Instance, Instances, Model, Placement};
pub use kernel::TraceScratch;
#[doc(hidden)]
pub use node::{KdNode, WideNode};
pub use options::{Accounting, Areas, Axes, BuildOptions, Builder, Statistics};
#[doc(hidden)]
pub use parts::{NodeArray, TreeParts};
pub use primitive::PrimitiveRef;
pub use rays::{Hits, RayGroup};
pub use residency::{LoadError, Paged, PinError, Pins, Residency, ResidencyStatistics};
pub use simd::prefetch;
pub use vlscan_geom::{Aabb, DVec3, Rotation};
pub use voxels::{CellLayout, GridPlace, VoxelCells, VoxelGrid};

#[cfg(test)]
mod golden_tests;
#[cfg(test)]
mod property_tests;
