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
//!                                       output: points (las, ply, arrow …), trajectory, waveforms, pulses
//! ```
//!
//! | module | what it does | imports |
//! |---|---|---|
//! | `error`, `diag` | errors; diagnostics with file, line and caret | |
//! | `geom`, `rng` | rotations, boxes, map projection; counter-based random numbers | |
//! | `quantity`, `markup` | bounds of numbers, counts and sizes as text; text in XML and HTML | |
//! | `crs` | coordinate reference systems: WKT by EPSG code, codes in WKT, areas of use; units of length | geom |
//! | `columns` | headings and separators of columns | crs |
//! | `files`, `damage`, `machine`, `input` | files named when complete, files that are read; panics of decoders caught; threads and memory of the machine; byte streams and Arrow tables read while they arrive | |
//! | `store` | files of arrays with checksums, the bytes of files | geom, files |
//! | `points` | reads point clouds: LAS and LAZ, PLY, PCD, E57, PTS, text, Arrow, Parquet | geom, crs, input |
//! | `survey` | reads surveys, scenes, scanners and platforms from XML and TOML into plain values | geom, input |
//! | `tree` | primitives and rays: builders, traversal, watertight tests; nothing of LiDAR | geom, store |
//! | `scene` | loads scenes; moving parts, instances, epochs with swapped parts, packed scenes | survey, tree, points |
//! | `generate` | procedural scenes with the surveys that scan them; stands from inventories | geom, rng, scene |
//! | `platform` | position and attitude per step; recorded trajectories in every layout | survey, geom |
//! | `scanner` | heads and deflectors per step | survey, geom |
//! | `flight` | the clock: legs, steps, pulses; replayed from a snapshot | platform, scanner |
//! | `plan` | survey planning: legs from an area, a plot or a line, by what the instrument's optics see | crs, flight, scanner, survey |
//! | `pulse` | subrays, energy, waveform, detection: a pulse becomes returns | flight, scene, tree |
//! | `schedule` | four ways to distribute chunks to workers; records and replays | nothing of LiDAR |
//! | `parts` | shares of a run that other processes compute: their files, their borders in the flight | pulse, flight |
//! | `output` | writers, one file per format | parts, pulse, scene, survey |
//! | `streams` | pulses and poses between commands, as rows of text or of Arrow streams | flight, platform, schedule |
//! | `preview` | draws point clouds as PNG and as pages for a browser, and waveforms | points, geom |
//! | `compare` | two point clouds of one place: density, heights, distances, voxels | preview, geom |
//! | `options` | the options of a run, for the command line and pipeline files alike | output, pulse, schedule, survey, tree |
//! | `pipeline` | the session that joins all of them | all above |
//! | `campaign` | many runs: scenes × variants × seeds, shared by processes without a server | plan, store |
//! | `cli` | the command line | all above |
//!
//! No module imports one from a row below its own; `tests/whole/structure.rs` holds it.
//!
//! What holds everywhere:
//! * the same inputs and seed give the same bytes for any number of threads, any schedule, chunk size and tree: every
//!   random draw is a function of what it is for (`rng`), and what a ray hits is decided by that ray and that primitive
//!   alone (`tree`);
//! * a scene is never changed: a chunk holds the state of its moving parts as it holds that of the platform, workers replay
//!   both, and every epoch of a scene with swapped parts has a scene of its own;
//! * coordinates are `f64` in the scene frame, which is the world frame minus the scene's centre;
//! * only data goes to stdout.

#![deny(unsafe_code)]

mod campaign;
mod cli;
mod columns;
mod compare;
mod crs;
mod damage;
mod diag;
mod error;
mod files;
mod flight;
mod generate;
mod geom;
mod input;
mod machine;
mod markup;
mod options;
mod output;
mod parts;
mod pipeline;
mod plan;
mod platform;
mod points;
mod preview;
mod pulse;
mod quantity;
mod rng;
mod scanner;
mod scene;
mod schedule;
mod store;
mod streams;
mod survey;

mod tree;

pub use cli::main;
pub use diag::{Diagnostics, Notice};
pub use error::{Error, Result};
pub use options::{OptionName, Options};
pub use output::{Column, OutputRequest, PointFormat, TableContent, TableRequest, TableSink, Target};
pub use pipeline::{
    Control, Job, LegRule, LoadedScene, Progress, Report, Resumption, SceneFacts, Session, Settings,
};
pub use schedule::{Policy, Recorder, Schedule, Stop};
pub use streams::PulseReader;
pub use survey::{Formula, MaterialDefinition, Mesh, ReadOptions, parse_seed, read_scene, read_survey};

/// What the benchmarks, the tests and the Python module of this repository use, besides the library.
#[doc(hidden)]
pub mod internals {
    pub use crate::cli::command_line;
    pub use crate::diag::{Diagnostic, Place, Severity};
    pub use crate::flight::{
        FlightOptions, FlightPlan, FlightSink, FlightState, PoseSample, Pulse, Skipped, Step,
    };
    pub use crate::generate::{Kind, SceneOptions, write_scene};
    pub use crate::geom::{Aabb, DVec3, Rotation, UtmZone};
    pub use crate::input::arrow::encode_stream;
    pub use crate::options::{Options, read_survey as read_run};
    pub use crate::output::{NoOffload, OutputContext, OutputPlan, unzip};
    pub use crate::platform::{PollResult, Pose, PoseReader};
    pub use crate::preview::{
        ColourBy, PageOptions, Points, PreviewOptions, draw, points_of_table, read_packet, read_points,
        read_wave, write_page,
    };
    pub use crate::pulse::{Batch, Phase, Physics, PulseSimulator};
    pub use crate::rng::{Purpose, Stream};
    pub use crate::scene::{LoadOptions, Pack, Scene, load, pack};
    pub use crate::survey::{
        Loader, MaterialChange, MaterialChoice, MeshReading, MotionTiming, PartRecipe, PlatformKind,
        Replaced, Scanner, SceneRecipe, Survey, Transform, UpAxis, VoxelLoader, VoxelMode, XyzLoader,
        catalogue,
    };
    pub use crate::tree::{BuildOptions, Builder, Geometry, Hits, RayGroup, TraceScratch, Tree};
}
