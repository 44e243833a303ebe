//! The number of points of a recording that a memory limit allows.

use std::path::Path;
use vlscan_base::error::Error;
use vlscan_base::quantity::{amount_of, bytes};

/// Memory that estimates take for a point, bytes, about: its values and those of its pulse.
const POINT_BYTES: u64 = 160;

/// A limit of the memory for the points of a recording.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct PointLimit {
    max_memory: Option<u64>,
}

impl PointLimit {
    /// The limit of this memory, bytes; `None` for no limit.
    pub fn new(max_memory: Option<u64>) -> PointLimit {
        PointLimit { max_memory }
    }

    /// The limit, as text.
    pub fn memory(self) -> String {
        bytes(self.max_memory.unwrap_or(u64::MAX))
    }

    /// True if this number of points needs more memory.
    pub fn is_exceeded(self, points: usize) -> bool {
        self.max_memory.is_some_and(|bytes| points as u64 > bytes / POINT_BYTES)
    }

    /// The error about a cloud with too many points.
    pub fn error(self, cloud: &Path) -> Error {
        let limit = self.max_memory.unwrap_or(u64::MAX);
        Error::input_with_help(
            format!(
                "{}: more than {} need more memory than --max-memory {}",
                cloud.display(),
                amount_of((limit / POINT_BYTES) as f64, "point"),
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
        let limit = PointLimit::new(Some(1 << 20));
        assert!(!limit.is_exceeded(6553) && limit.is_exceeded(6554));
        assert!(!PointLimit::default().is_exceeded(usize::MAX));
        let Error::Input(report) = limit.error(Path::new("a.laz")) else { panic!("no problem of the input") };
        let text = report.text();
        assert!(text.contains("a.laz") && text.contains("--max-memory"), "{text}");
    }
}
