//! Writers of points, trajectories, waveforms and pulses: one file per format, all of which take batches in chunk order.
//!
//! ```text
//! OutputRequest ─► OutputPlan   which files, checked before the run, shared by the workers
//!                    │   │
//!       workers: encode  open: every output, before the first pulse
//!                    │   │
//!                Encoded ─► Writer::append, in chunk order ─► finish ─► Summary
//! ```
//!
//! | file | contents |
//! |---|---|
//! | `request`, `context` | the request; the facts about survey and scene that outputs depend on |
//! | `layout`, `plan`, `division` | the files that follow from both, checks and formats; points divided by tile or object |
//! | `ground` | heights above the ground |
//! | `codec`, `objects` | definitions shared by the formats of point records; ids of scene parts as integers |
//! | `text`, `number`, `las`, `ply`, `ray_cloud`, `pcd` | records of text, LAS, PLY and PCD |
//! | `columns`, `column_codec`, `table` | columns: definition and values, as text |
//! | `rows`, `arrow`, `parquet` | columns in groups of rows, as Arrow and as Parquet |
//! | `memory` | tables in memory for the caller |
//! | `encode` | encoding of batches as bytes for every file, in the worker threads |
//! | `laz`, `archive`, `blocks` | compression of LAS and of text in blocks; expansion of text |
//! | `copc` | compressed LAS as an octree |
//! | `e57` | E57: scans with their poses |
//! | `mcap` | MCAP: frames as messages of ROS 2 |
//! | `join` | LAS and LAZ files of consecutive points as one |
//! | `writer`, `open`, `file`, `stream` | writing of bytes to files and streams, in the writer thread |
//! | `offload`, `writes`, `summary` | jobs for idle workers, among them writes of large pieces; summary of the outputs |
//!
//! Files are written through [`FileWriter`](vlscan_base::files::FileWriter). Formats with counts in their header are spooled to
//! an unnamed file when the stream is not seekable.

mod archive;
mod arrow;
mod blocks;
mod codec;
mod column_codec;
mod columns;
mod context;
mod copc;
mod division;
mod e57;
mod encode;
mod file;
#[cfg(test)]
mod format_tests;
mod ground;
mod join;
mod las;
mod layout;
mod laz;
mod mcap;
mod memory;
mod number;
mod objects;
mod offload;
mod open;
mod parquet;
mod pcd;
mod plan;
mod ply;
mod ray_cloud;
mod request;
mod rows;
mod stream;
mod summary;
mod table;
#[cfg(test)]
mod testing;
#[cfg(test)]
mod tests;
mod text;
mod writer;
mod writes;

pub use archive::{expand, unzip};
pub use columns::Column;
pub use context::OutputContext;
pub use division::{Division, Ring};
pub use encode::Encoded;
pub use ground::Ground;
pub use join::{JOINED_POINTS, Segment, join};
pub use memory::{TableContent, TableRequest, TableSink};
pub use objects::ObjectIds;
pub use offload::{NoOffload, Offload};
pub use plan::OutputPlan;
pub use request::{
    ExtraDimensions, LasSettings, LasVersion, OutputRequest, PacketPlace, PointFormat, ShardOutput, Target,
    TrajectoryFormat,
};
pub use summary::{FileKind, FileSummary, Summary};
pub use writer::Writer;
