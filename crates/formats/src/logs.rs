//! Logs of messages of several scanners as one.

use std::path::{Path, PathBuf};
use vlscan_base::error::Result;

/// Numbers of a file made by [`merge_logs`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MergedLog {
    /// Messages.
    pub messages: u64,
    /// Bytes.
    pub bytes: u64,
}

/// Merges MCAP files that [`PointFormat::Mcap`](crate::PointFormat::Mcap) has written, each with the name of
/// its scanner, to one file with the topics `/NAME/points` and `/NAME/odom` of each scanner and `/tf` of all.
/// Messages are ordered by time; those of a file keep their order. `replace` replaces an existing file,
/// and `is_partial` marks one of runs that have not ended.
///
/// # Errors
/// [`Error::Io`](vlscan_base::Error::Io); [`Error::Input`](vlscan_base::Error::Input) for other files, and in
/// a build without the feature `mcap`.
pub fn merge_logs(
    parts: &[(String, PathBuf)],
    path: &Path,
    replace: bool,
    is_partial: bool,
) -> Result<MergedLog> {
    #[cfg(feature = "mcap")]
    {
        let (messages, bytes) = crate::mcap::merge(parts, path, replace, is_partial)?;
        Ok(MergedLog { messages, bytes })
    }
    #[cfg(not(feature = "mcap"))]
    {
        let _ = (parts, replace, is_partial);
        let message = format!("{}: this build does not write mcap", path.display());
        Err(vlscan_base::Error::unsupported(message, crate::point_format::build_with("mcap")))
    }
}
