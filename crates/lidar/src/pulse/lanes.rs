//! Blocks of subrays that are computed together.

use vlscan_trace::RayGroup;

/// Subrays per block.
pub(super) const LANES: usize = RayGroup::WIDTH;
/// A number for each subray of a block.
pub(super) type Block = [f64; LANES];
