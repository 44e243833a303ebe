//! Virtual laser scanning: a scene and an instrument become the point cloud that the instrument would have
//! measured.
//!
//! Terrestrial, mobile and airborne scanners, with beams that have a width, surfaces that have a reflectance,
//! waveforms, foliage, moving parts. The same inputs and seed give the same bytes, for any number of threads.
//!
//! ```
//! use vlscan::arrow_array::{cast::AsArray, types::Float64Type};
//! use vlscan::survey::{Mesh, ReadOptions, find_scanner};
//! use vlscan::{DVec3, Scan};
//!
//! # fn main() -> vlscan::Result<()> {
//! // A floor of 20 m × 20 m in memory; `read_scene("scene.xml#site")` reads files.
//! let corners = [[-10.0, -10.0], [10.0, -10.0], [10.0, 10.0], [-10.0, 10.0]];
//! let corners = corners.map(|[x, y]| DVec3::new(x, y, 0.0));
//! let floor = Mesh::new(corners.into(), vec![[0, 1, 2], [0, 2, 3]], Vec::new(), Vec::new())?;
//!
//! // One turn of a VLP-16 from 1.5 m above it, at 10 turns per second.
//! let (scanner, _) = find_scanner("vlp16", &ReadOptions::default())?;
//! let turn = std::f64::consts::TAU;
//! let scan = Scan::new(floor, scanner)
//!     .station(DVec3::new(0.0, 0.0, 1.5))
//!     .configure(|settings| (settings.head_rate, settings.head_stop) = (10.0 * turn, turn))
//!     .seed(1);
//!
//! // Arrow record batches arrive while the scan runs.
//! for batch in scan.batches(10_000)? {
//!     let batch = batch?;
//!     let heights = batch["Z"].as_primitive::<Float64Type>().values();
//!     assert!(heights.iter().all(|z| z.abs() < 0.2));
//! }
//! # Ok(())
//! # }
//! ```
//!
//! # Where to begin
//!
//! | you have | begin with |
//! |---|---|
//! | a scene and an instrument | [`Scan`], whose [`run`](Scan::run) writes files and whose [`batches`](Scan::batches) stay in memory |
//! | a survey file of HELIOS++ | [`read_survey`], [`Settings::new`], [`Session::open`] |
//! | a pipeline file, or options as the command line takes them | [`ResolvedRun::resolve`] |
//! | one scene for many runs | [`LoadedScene`], over which sessions are opened |
//! | a scan pattern of your own | [`survey::ScanPattern`] |
//! | pulses of your own | [`PulseReader`] and [`Session::trace`] |
//! | a scene to send rays through | [`LoadedScene::cast`], [`RayCaster`]; [`scene::load`], [`trace::Tree`] |
//!
//! An [`OutputRequest`] describes the outputs: [files](Target) in any [`PointFormat`], [tables](TableRequest)
//! in memory, [columns](Column), waveforms, tiles. Problems of the input are [`Error::Input`] with
//! [`Diagnostics`]: each has its file, line and remedy; warnings reach the observer of a session as
//! [`Notice`]s. The programs in `examples/` show each of these at work.
//!
//! # Crates
//!
//! Most stages are crates, each of which can be used alone; here they are modules:
//!
//! * [`geom`]: vectors, rotations, boxes, map projection
//! * [`base`]: errors with the place of each problem, files that are named when complete, random numbers
//! * [`crs`]: coordinate reference systems as well-known text
//! * [`tables`]: tables read while they arrive, as text and as Arrow streams
//! * [`render`]: reports of problems for people
//! * [`trace`]: a watertight ray tracer in double precision for packets of rays; independent of LiDAR
//! * [`warehouse`]: producer, bounded queue, workers, ordered collector; independent of LiDAR
//! * [`survey`]: surveys, scenes and instruments as their files describe them, the catalogue
//! * [`formats`]: point clouds, read and written
//! * [`scene`]: scenes that can be traced
//! * [`lidar`]: the instrument: platform, scanner, flight, pulse
//! * `vlscan-session`: sessions, outputs, shards and streams, all of which are re-exported here
//! * [`options`]: the options of a run, for the command line and pipeline files alike
//! * [`tools`]: generated scenes, plans, comparison, pictures
//! * [`fit`]: flights, instruments and scenes estimated from recorded point clouds
//! * `vlscan-campaign`: surveys that are planned and checked, sketches of flights, data sets of many runs,
//!   all of which are re-exported here
//!
//! ```text
//! base ◄─ render, warehouse
//! geom, base ◄─ crs ◄─ tables ◄─ survey, formats
//! geom ◄─ trace
//! survey, formats, trace ◄─ scene ◄─ lidar ◄─ session
//! session ◄─ options
//! lidar ◄─ tools ◄─ fit
//! options, tools ◄─ campaign
//! campaign, fit ◄─ vlscan
//! ```
//!
//! # How a run works
//!
//! Data flows one way:
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
//! The only module of this crate is the command line. What each crate is for is in ARCHITECTURE.md.
//!
//! These rules hold everywhere:
//! * the same inputs and seed give the same bytes for any number of threads, any schedule, chunk size and
//!   tree: every random draw is a function of what it is for (`rng`), and what a ray hits is decided by that
//!   ray and that primitive alone (`tree`);
//! * a scene is never changed: a chunk holds the state of its moving parts as it holds that of the platform,
//!   workers replay both, and every epoch of a scene with swapped parts has a scene of its own;
//! * coordinates are `f64` in the scene frame, which is the world frame minus the scene's centre;
//! * only data goes to stdout.

#![deny(unsafe_code)]

mod cli;

/// The arrays of the record batches in which points arrive.
pub use arrow_array;
pub use vlscan_base as base;
pub use vlscan_crs as crs;
pub use vlscan_fit as fit;
pub use vlscan_formats as formats;
pub use vlscan_geom as geom;
pub use vlscan_lidar as lidar;
pub use vlscan_options as options;
pub use vlscan_render as render;
pub use vlscan_scene as scene;
pub use vlscan_survey as survey;
pub use vlscan_tables as tables;
pub use vlscan_tools as tools;
pub use vlscan_trace as trace;
pub use vlscan_warehouse as warehouse;

#[doc(hidden)]
pub use cli::{command_line, main, scene_json};
pub use vlscan_base::Observer;
pub use vlscan_base::diag::{Diagnostics, Notice};
pub use vlscan_base::error::{Error, Result};
pub use vlscan_campaign::{
    Campaign, CampaignEvent, CampaignOptions, CampaignReport, FailedCell, SurveySketch, plan_survey,
    session_points, survey_points,
};
pub use vlscan_geom::DVec3;
pub use vlscan_options::{OneOf, OptionName, OptionValues, Options, ResolvedRun, schedule_of};
pub use vlscan_session::output;
pub use vlscan_session::output::{
    CloudFacts, Column, OutputRequest, PointFormat, TableContent, TableRequest, TableSink, Target,
    write_points,
};
pub use vlscan_session::shards::{Records, ShardSet, shard_path};
pub use vlscan_session::streams::{PulseReader, RowBlock};
pub use vlscan_session::{
    Batches, CoverageBand, CoverageMap, DryRunReport, Emission, Emitted, Estimate, FileEstimate,
    FlightCoverage, FlightRows, LegEstimate, LegRule, LoadedScene, Missed, Progress, RayCaster, RayHit,
    Report, ResumeOptions, RunContext, Scan, SceneFacts, SceneGeometry, Session, Settings, Snapshot,
    TimeEstimate, emit, flight_table, merge, merge_warnings,
};
pub use vlscan_survey::{
    Formula, MaterialDefinition, Mesh, ReadOptions, parse_seed, read_scene, read_survey,
};
pub use vlscan_warehouse::{Policy, Recorder, Schedule, Stop};
