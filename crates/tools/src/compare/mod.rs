//! Compares two point clouds of one place: a measured and a simulated one, or two runs.
//!
//! | file | what it does |
//! |---|---|
//! | `measures` | density, heights, canopy, intensity, returns, voxels |
//! | `neighbours` | distances from the points of one cloud to the other |
//! | `report` | the result as a table of text |
//! | `page` | the result as a page with pictures |

mod measures;
mod neighbours;
mod page;
mod report;

pub use measures::{Canopy, Change, Cloud, CompareOptions, Comparison, Histogram, Voxels, compare};
pub use neighbours::Distances;
pub use page::page;
pub use report::{json, table};
