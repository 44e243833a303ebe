//! Where the points go: one file per format, all of them taking batches in chunk order.
//!
//! ```text
//! OutputRequest ─► OutputPlan   what goes where; checked before the run, shared by the workers
//!                    │   │
//!       workers: encode  open: every output, before the first pulse
//!                    │   │
//!                Encoded ─► Writer::append, in chunk order ─► finish ─► Summary
//! ```
//!
//! | file | what it does |
//! |---|---|
//! | [`request`](OutputRequest), `layout`, `plan` | what is asked for, which files that makes, what is wrong with it |
//! | `encode` with `text`, `number`, `las`, `ply` | batches as bytes |
//! | `columns` with `arrow`, `table` | chosen columns as Arrow, Parquet and text with a header |
//! | `laz`, `archive` with `blocks` | compression of LAS and of text; text expanded |
//! | `copc` | compressed LAS as an octree |
//! | `writer`, `file`, `stream` | bytes into files and streams |
//! | `offload`, `summary`, `crs` | work given away, what was written, EPSG codes |
//!
//! A named file is `NAME.part` until it is complete. Formats with counts in their header are spooled to an unnamed file
//! when the stream cannot seek.

mod archive;
mod arrow;
mod blocks;
mod codec;
mod column_codec;
mod columns;
mod copc;
mod crs;
mod encode;
mod file;
#[cfg(test)]
mod format_tests;
mod las;
mod layout;
mod laz;
mod number;
mod objects;
mod offload;
mod plan;
mod ply;
mod request;
mod stream;
mod summary;
mod table;
#[cfg(test)]
mod testing;
#[cfg(test)]
mod tests;
mod text;
mod writer;

pub use archive::unzip;
pub use columns::Column;
pub use encode::Encoded;
pub use offload::{NoOffload, Offload};
pub use plan::{OutputContext, OutputPlan};
pub use request::{
    LasSettings, LasVersion, OutputRequest, PacketPlace, PointFormat, Target, TrajectoryFormat,
};
pub use summary::{FileKind, FileSummary, Summary};
pub use writer::Writer;
