//! Writers of points, trajectories, waveforms and pulses: one file per format, all of which take batches in
//! chunk order.
//!
//! ```text
//! OutputRequest ─► OutputPlan   which files, checked before the run, shared by the workers
//!                    │   │
//!       workers: encode  open: every output, before the first pulse
//!                    │   │
//!                Encoded ─► Writer::append, in chunk order ─► finish ─► OutputSummary
//! ```
//!
//! | file | contents |
//! |---|---|
//! | `request`, `context` | the request; the facts about survey and scene that outputs depend on |
//! | `layout`, `plan`, `division` | the files that follow from both, and their checks; points divided by tile or object |
//! | `formats` | the formats of points |
//! | `encode` | encoding of batches as bytes for every file, in the worker threads |
//! | `text` | trajectories, waveforms and pulses as text |
//! | `memory` | tables in memory for the caller |
//! | `system` | checks of the coordinate reference system of points |
//! | `points`, `point_table` | files of the points of a table in memory; its rows as records |
//! | `join` | LAS and LAZ files of consecutive points as one |
//! | `piece` | what a batch contributes to an output, and what takes it |
//! | `writer`, `file` | all outputs, and one of them, in the writer thread |
//! | `summary` | summary of the outputs |
//! | `unused` | warnings of choices without effect |
//!
//! Formats of points are those of [`vlscan_formats`], to which echoes go as
//! [`PointRecord`](vlscan_formats::PointRecord)s. Files are written through
//! [`FileWriter`](vlscan_base::files::FileWriter). Formats with counts in their header are spooled to an
//! unnamed file when the stream is not seekable.

mod context;
mod division;
mod encode;
mod file;
#[cfg(test)]
mod format_tests;
mod formats;
mod join;
mod layout;
mod memory;
mod piece;
mod plan;
mod point_table;
mod points;
mod request;
mod summary;
mod system;
#[cfg(test)]
mod testing;
#[cfg(test)]
mod tests;
mod text;
mod unused;
mod writer;

pub use context::OutputContext;
pub use division::Division;
#[doc(hidden)]
pub use division::Ring;
pub use encode::Encoded;
#[doc(hidden)]
pub use join::JOINED_POINTS;
pub use join::{Segment, join};
pub use plan::CheckedOutputs;
#[doc(hidden)]
pub use plan::OutputPlan;
pub use points::{CloudFacts, write_points};
pub use request::{
    OutputRequest, ShardOutput, TableContent, TableRequest, TableSink, Target, TrajectoryFormat,
    leave_options_to_others,
};
pub use summary::{FileKind, FileSummary, OutputSummary};
pub(crate) use system::check_system;
pub use vlscan_formats::text::expand;
#[doc(hidden)]
pub use vlscan_formats::text::unzip;
pub use vlscan_formats::{
    CloudSettings, Column, ExtraDimensions, FrameNames, LasSettings, LasVersion, NoOffload, ObjectIds,
    Offload, PacketPlace, PointFormat,
};
#[doc(hidden)]
pub use writer::Writer;
