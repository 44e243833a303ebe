//! E57 (ASTM E2807).

mod error;
mod read;
mod write;

pub use error::{E57Error, ScanError};
pub(crate) use read::read;
pub(crate) use write::e57;

/// Prefix of the leg number in the name of a scan.
const SCAN_NAME: &str = "leg ";
/// Namespace of the labels of the way of light.
const NAMESPACE: &str = "vlscan";
