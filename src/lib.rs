//! Virtual laser scanning for Unix pipes.
//!
//! A survey, or a stream of poses, becomes the point cloud that the instrument would have measured. Data flows one way:
//!
//! ```text
//! survey.xml / pipeline.toml            scene files
//!        │ survey                            │ scene: load → place → shift → freeze
//!        ▼                                   ▼
//!   flight: clock, legs, steps          primitives ─► tree
//!   (platform poses, scanner optics)         │
//!        │ chunk descriptors                 │
//!        ▼                                   ▼
//!   schedule: warehouse ═════► workers: replay chunk → pulses → tree → pulse physics → encode
//!                                            │ encoded batches, in chunk order
//!                                            ▼
//!                                       output: xyz, csv, las, laz, ply, arrow, parquet, trajectory, waveforms, pulses
//! ```
//!
//! | room | what it does | imports |
//! |---|---|---|
//! | [`geom`], [`rng`], [`diag`], [`error`], `quantity`, [`input`], `columns`, `damage`, `files` | rotations, boxes; counter-based random numbers; places and reports; quantities as text; byte streams and Arrow tables read while they arrive; separators and headings of columns; panics of decoders; files named when complete | nothing |
//! | [`store`] | arrays in memory or in a mapped file, and that file | geom |
//! | `points` | reads point clouds: LAS and LAZ, PLY, columns of text | geom, damage |
//! | [`survey`] | reads surveys, scenes, scanners and platforms from XML and TOML into plain values | geom, diag, input |
//! | [`tree`] | primitives and rays: builders, traversal, watertight tests; nothing of lidar | geom, store |
//! | [`scene`] | loads scenes; moving parts, instances, epochs with swapped parts, packed scenes | survey, tree |
//! | [`generate`] | procedural scenes with the surveys that scan them | geom, rng |
//! | [`platform`] | the movers: position and attitude per step; recorded trajectories in every layout | survey, geom |
//! | [`scanner`] | heads and deflectors per step | survey, geom |
//! | [`flight`] | the clock: legs, steps, pulses; cheap to replay from a snapshot | platform, scanner |
//! | [`pulse`] | subrays, energy, waveform, detection: a pulse becomes echoes | flight, scene, tree |
//! | [`schedule`] | four ways to hand out chunks, workers, order; records and replays | nothing of lidar |
//! | [`output`] | sinks, one file per format | pulse, flight, scene, survey |
//! | [`streams`] | pulses and poses between commands, as rows of text or of Arrow streams | flight, platform, schedule |
//! | [`preview`] | draws point clouds as PNG and as pages for a browser, and waveforms | pulse, geom, diag |
//! | [`pipeline`] | the wiring of all of them | all above |
//! | [`cli`] | the command line | all above |
//!
//! The lower rooms never import the higher ones.
//!
//! What holds everywhere:
//! * the same inputs and seed give the same bytes for any number of threads, any schedule, chunk size and tree: every
//!   random draw is a function of what it is for ([`rng`]), and what a ray hits is decided by that ray and that primitive
//!   alone ([`tree`]);
//! * a scene is never changed: a chunk holds the state of its moving parts as it holds that of the platform, workers replay
//!   both, and every epoch of a scene with swapped parts has a scene of its own;
//! * coordinates are `f64` in the scene frame, which is the world's minus the scene's centre;
//! * points go to stdout and nothing else does.

pub mod cli;
mod columns;
mod damage;
pub mod diag;
pub mod error;
mod files;
pub mod flight;
pub mod generate;
pub mod geom;
pub mod input;
pub mod output;
pub mod pipeline;
pub mod platform;
mod points;
pub mod preview;
pub mod pulse;
mod quantity;
pub mod rng;
pub mod scanner;
pub mod scene;
pub mod schedule;
pub mod store;
pub mod streams;
pub mod survey;
pub mod tree;

pub use error::{Error, Result};
