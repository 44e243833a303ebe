//! The stages of the program and their connections. A [`Session`] takes resolved [`Settings`] and a
//! [`LoadedScene`]; it flies the survey over it or traces a stream of pulses, once per epoch of a scene with
//! swapped parts:
//!
//! ```text
//! Scan ────────┐
//! ResolvedRun ─┴► Settings ─► LoadedScene ─► Session ─► run ──────────────► fly ─┐ pass over  ┌─► next epoch
//!                                                     ├ trace(stream of pulses) ─┴─ an epoch ─┴─► Report
//!                                                     └ into_emission ─► emit: poses or pulses, not traced
//! ```
//!
//! | file | contents |
//! |---|---|
//! | `scene`, `geometry` | a loaded scene with its tree; facts about it, points on it; its primitives |
//! | `cast` | rays without an instrument |
//! | `settings` | everything that is chosen before the start |
//! | `session`, `run` | a scene and its survey; the loop over epochs, the report |
//! | `scan`, `batches` | scans of a scene with an instrument, without files; points as record batches during the run |
//! | `dry_run` | forecast of a run's time, points and coverage, from a measured sample |
//! | `fly`, `pass` | the stages of a pass over one epoch, and their inputs |
//! | `load` | scene and tree of an epoch, within the memory limit |
//! | `prefetch` | loading of tiles of the scene ahead of the flight |
//! | `chunk` | the producer of a flight: steps become chunks |
//! | `stream` | the producer and worker of a stream of pulses |
//! | `worker`, `moving` | the computing stage, which replays chunks to pulses; the moving parts of the scene |
//! | `shard`, `merge`, `resume` | shares of a run as files, their merging to outputs, resumed runs |
//! | `resume_folder` | the folder with the shards of a resumable run: its mark, its lock, its removal |
//! | `segment` | merges that many processes share |
//! | `collector` | the last stage: encoded results to the outputs, in order |
//! | `part_table` | the parts of the scene as a table beside labelled points |
//! | `object_track` | poses of the moving parts of the scene over the flight as a table |
//! | `emit`, `flight_rows` | the flight alone, written as poses or pulses; their rows |
//! | `plausibility`, `beam_counts` | detection of inputs that are valid but hardly intended |
//! | `crs` | the coordinate reference system of a run |
//! | `progress` | counters of the work done |

mod batches;
mod beam_counts;
mod cast;
mod chunk;
mod collector;
mod crs;
mod dry_run;
mod emit;
mod flight_rows;
mod fly;
mod geometry;
mod load;
mod merge;
mod moving;
mod object_track;
mod part_table;
mod pass;
mod plausibility;
mod prefetch;
mod progress;
mod resume;
mod resume_folder;
mod run;
mod scan;
mod scene;
mod segment;
mod session;
mod settings;
mod shard;
mod stream;
mod worker;

pub use batches::Batches;
pub use cast::{RayCaster, RayHit};
pub use dry_run::{
    CoverageBand, CoverageMap, DryRunReport, Estimate, FileEstimate, FlightCoverage, LegEstimate, Missed,
    TimeEstimate,
};
pub use emit::{Emission, Emitted, emit};
pub use flight_rows::Flight;
pub use flight_rows::{FlightRows, flight_table};
pub use geometry::SceneGeometry;
pub use load::check_raster_memory;
pub use merge::{merge, merge_warnings, output_context};
pub use part_table::PartTable;
pub use pass::RunContext;
pub use progress::{Progress, Snapshot};
pub use resume::ResumeOptions;
pub use run::Report;
pub use scan::Scan;
pub use scene::{LoadedScene, SceneFacts};
pub use segment::{join_segments, merge_segment};
pub use session::Session;
pub use settings::{DEFAULT_CHUNK_SIZE, DEFAULT_WAREHOUSE_FACTOR, MAX_LATENCY_S, Settings};
pub use stream::LegRule;
