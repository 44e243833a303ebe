//! Sessions: a survey, a scene and settings become the point clouds, waveforms and tables that the
//! instrument would have measured, in files, in memory or on streams.
//!
//! | module | what it does | uses |
//! |---|---|---|
//! | `shards` | shares of a run that other processes compute: their files, their borders in the flight | lidar |
//! | `output` | the files of a run: layout, records in the workers, bytes in order | shards, formats, lidar, scene, survey |
//! | `streams` | pulses and poses between commands, as rows of text or of Arrow streams | lidar, warehouse |
//! | `pipeline` | the session that joins all of them | all above |
//!
//! Users of the library begin with the crate `vlscan`, which has all of this and the options of the command
//! line and of pipeline files.

#![deny(unsafe_code)]

pub mod output;
mod pipeline;
pub mod shards;
pub mod streams;

pub use pipeline::{
    Batches, CoverageBand, CoverageMap, DEFAULT_CHUNK_SIZE, DEFAULT_WAREHOUSE_FACTOR, DryRunReport, Emission,
    Emitted, Estimate, FileEstimate, Flight, FlightCoverage, FlightRows, LegEstimate, LegRule, LoadedScene,
    MAX_LATENCY_S, Missed, PartTable, Progress, RayCaster, RayHit, Report, ResumeOptions, RunContext, Scan,
    SceneFacts, SceneGeometry, Session, Settings, Snapshot, TimeEstimate, check_raster_memory, emit,
    flight_table, join_segments, merge, merge_segment, merge_warnings, output_context,
};
