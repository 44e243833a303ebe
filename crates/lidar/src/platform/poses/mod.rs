//! Reads poses in any format while they arrive.
//!
//! | file | what it does |
//! |---|---|
//! | `reader` | bytes to poses, in blocks |
//! | `decoder` | detects the format; bytes to fixes |
//! | `text`, `binary` | decoders of rows of text and Arrow, and of SBET and TerraScan records |
//! | `recognise` | quaternions, matrices and cameras by their numbers |
//! | `fix` | fixes, poses, and errors in records |
//! | `georeference` | a fix to a pose: projection, lever arm, boresight |
//! | `sequence` | checks of consecutive fixes: times, gaps, headings |

mod binary;
pub(super) mod decoder;
pub(super) mod fix;
pub(super) mod georeference;
mod reader;
mod recognise;
mod sequence;
#[cfg(test)]
mod tests;
pub(super) mod text;

pub use fix::Pose;
pub use reader::{PollResult, PoseEvent, PoseReader};
pub use sequence::MAX_FLOWN_GAP;
