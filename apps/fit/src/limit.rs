//! The number of points of a recording that a memory limit allows.

use std::path::Path;
use vlscan_base::error::Error;
use vlscan_base::quantity::{amount_of, bytes};

/// Memory that the points of a recording may take by default, bytes.
pub(crate) const DEFAULT_MEMORY: u64 = 1 << 30;

/// A limit of the memory for the points of a recording.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PointLimit {
    max_memory: Option<u64>,
    /// Memory that an estimate takes for a point, bytes, about.
    point_bytes: u64,
}

impl Default for PointLimit {
    /// No limit.
    fn default() -> PointLimit {
        PointLimit::new(None, 1)
    }
}

impl PointLimit {
    /// The limit of this memory, bytes, for points that take `point_bytes` each; `None` for no limit.
    pub fn new(max_memory: Option<u64>, point_bytes: u64) -> PointLimit {
        PointLimit { max_memory, point_bytes: point_bytes.max(1) }
    }

    /// The limit, as text.
    pub fn memory(self) -> String {
        bytes(self.max_memory.unwrap_or(u64::MAX))
    }

    /// Maximum number of points; their indices have 32 bits.
    pub fn points(self) -> u64 {
        let points = self.max_memory.map_or(u64::MAX, |bytes| bytes / self.point_bytes);
        points.min(u64::from(u32::MAX) - 1)
    }

    /// True if this number of points needs more memory.
    pub fn is_exceeded(self, points: usize) -> bool {
        points as u64 > self.points()
    }

    /// The error about a cloud with too many points.
    pub fn error(self, cloud: &Path) -> Error {
        Error::input_with_help(
            format!(
                "{}: more than {} need more memory than --max-memory {}",
                cloud.display(),
                amount_of(self.points() as f64, "point"),
                self.memory()
            ),
            "allow more memory, or divide the cloud into parts",
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_beyond_the_limit_are_an_error() {
        let limit = PointLimit::new(Some(1 << 20), 160);
        assert!(!limit.is_exceeded(6553) && limit.is_exceeded(6554));
        assert!(!PointLimit::new(None, 160).is_exceeded(u32::MAX as usize - 1));
        let Error::Input(report) = limit.error(Path::new("a.laz")) else { panic!("no problem of the input") };
        let text = report.text();
        assert!(text.contains("a.laz") && text.contains("--max-memory"), "{text}");
    }
}
