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
//! Most stages are crates, each of which can be used alone:
//!
//! ```text
//! geom ◄─ base ◄─ survey, formats, warehouse
//! geom ◄─ trace
//! survey, formats, trace ◄─ scene ◄─ lidar ◄─ tools ◄─ vlscan
//! ```
//!
//! | module | what it does | uses |
//! |---|---|---|
//! | `shards` | shares of a run that other processes compute: their files, their borders in the flight | lidar |
//! | `output` | writers, one file per format | shards, lidar, scene, survey |
//! | `streams` | pulses and poses between commands, as rows of text or of Arrow streams | lidar, warehouse |
//! | `options` | the options of a run, for the command line and pipeline files alike | output, lidar, warehouse, survey, trace |
//! | `pipeline` | the session that joins all of them | all above |
//! | `cli` | the command line | all above, tools |
//!
//! No module imports one from a row below its own; `tests/whole/structure.rs` holds it. What each crate is for is in
//! ARCHITECTURE.md.
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

mod cli;
mod options;
mod output;
mod pipeline;
mod shards;
mod streams;

pub use cli::main;
pub use options::{OptionName, Options};
pub use output::{Column, OutputRequest, PointFormat, TableContent, TableRequest, TableSink, Target};
pub use pipeline::{
    Control, Job, LegRule, LoadedScene, Progress, Report, Resumption, SceneFacts, Session, Settings,
};
pub use streams::PulseReader;
pub use vlscan_base::diag::{Diagnostics, Notice};
pub use vlscan_base::error::{Error, Result};
pub use vlscan_survey::{
    Formula, MaterialDefinition, Mesh, ReadOptions, parse_seed, read_scene, read_survey,
};
pub use vlscan_warehouse::{Policy, Recorder, Schedule, Stop};

/// What the benchmarks, the tests and the Python module of this repository use, besides the library.
#[doc(hidden)]
pub mod internals {
    pub use crate::cli::command_line;
    pub use crate::options::{Options, read_survey as read_run};
    pub use crate::output::{NoOffload, OutputContext, OutputPlan, unzip};
    pub use vlscan_base::diag::{Diagnostic, Place, Severity};
    pub use vlscan_base::input::arrow::encode_stream;
    pub use vlscan_base::rng::{Purpose, Stream};
    pub use vlscan_geom::{Aabb, DVec3, Rotation, UtmZone};
    pub use vlscan_lidar::flight::{
        FlightOptions, FlightPlan, FlightSink, FlightState, PoseSample, Pulse, Skipped, Step,
    };
    pub use vlscan_lidar::platform::{PollResult, Pose, PoseReader};
    pub use vlscan_lidar::pulse::{Batch, Phase, Physics, PulseSimulator};
    pub use vlscan_scene::{LoadOptions, Pack, Scene, load, pack};
    pub use vlscan_survey::{
        Loader, MaterialChange, MaterialChoice, MeshReading, MotionTiming, PartRecipe, PlatformKind,
        Replaced, Scanner, SceneRecipe, Survey, Transform, UpAxis, VoxelLoader, VoxelMode, XyzLoader,
        catalogue,
    };
    pub use vlscan_tools::generate::{Kind, SceneOptions, write_scene};
    pub use vlscan_tools::preview::{
        ColourBy, PageOptions, Points, PreviewOptions, draw, points_of_table, read_packet, read_points,
        read_wave, write_page,
    };
    pub use vlscan_trace::{BuildOptions, Builder, Geometry, Hits, RayGroup, TraceScratch, Tree};
}
