//! Source of a cloud: a file, or a table in memory.

use ::arrow_array::RecordBatch;
use std::path::{Path, PathBuf};
use vlscan_base::diag::Diagnostics;
use vlscan_base::error::Result;
use vlscan_formats::{PointSink, read_points, read_record_batch};

/// A cloud that is read.
#[derive(Clone, Debug)]
pub enum CloudSource {
    /// A file in any format of [`vlscan_formats`]; `-` is stdin.
    File(PathBuf),
    /// A table in memory with its name in messages. The key `crs` of the metadata of its schema is the system
    /// of its coordinates, WKT.
    Table(PathBuf, RecordBatch),
}

impl CloudSource {
    /// The files of some paths.
    pub fn files<P: AsRef<Path>>(paths: &[P]) -> Vec<CloudSource> {
        paths.iter().map(|path| CloudSource::File(path.as_ref().to_path_buf())).collect()
    }

    /// The path of the file, or the name of the table.
    pub fn name(&self) -> &Path {
        match self {
            CloudSource::File(path) => path,
            CloudSource::Table(name, _) => name,
        }
    }

    /// True if the points can be read more than once: not those of stdin and named pipes.
    pub(crate) fn can_be_read_again(&self) -> bool {
        match self {
            CloudSource::File(path) => path.is_file(),
            CloudSource::Table(..) => true,
        }
    }

    /// Passes the points to a sink.
    pub(crate) fn read(&self, sink: &mut dyn PointSink, found: &mut Diagnostics) -> Result<()> {
        match self {
            CloudSource::File(path) => read_points(path, sink).map(|warnings| found.extend(warnings)),
            CloudSource::Table(name, batch) => {
                if let Some(wkt) = batch.schema_ref().metadata().get("crs").filter(|wkt| !wkt.is_empty()) {
                    sink.crs(wkt);
                }
                read_record_batch(batch, &name.to_string_lossy(), sink, found)
            }
        }
    }
}
