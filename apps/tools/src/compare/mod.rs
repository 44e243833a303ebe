//! Compares two point clouds of one place: a measured and a simulated one, two runs, two epochs.
//!
//! | file | what it does |
//! |---|---|
//! | `options` | how clouds are compared |
//! | `comparison` | the comparison and its result |
//! | `cut` | the points within the box that both share; cells |
//! | `pulses` | pulses and scan lines by time and scan angle |
//! | `clock` | pulses of both clouds at the same time |
//! | `terrain` | the terrain that heights and residuals refer to |
//! | `setting` | both clouds, ready to be measured |
//! | `quantities`, `residuals` | heights, returns, classes, intensity, pulses, scan lines; residuals to the terrain |
//! | `quantity`, `statistic`, `histogram` | a quantity of both clouds with its figures and distributions |
//! | `chance` | halves of the first cloud, whose differences chance gives |
//! | `surfaces`, `neighbours` | canopy, voxels; distances from the points of one cloud to the other |
//! | `change`, `changed` | two epochs: differences of the ground, cut and fill; points that are new or gone |
//! | `cell_surface`, `registration` | the ground in cells; errors that neighbouring cells share |
//! | `gaps` | cells without a difference: filled from measured cells, or left out |
//! | `report` | the result as a table of text and as JSON |
//! | `page`, `map` | the result as a page with charts and pictures; the picture of the differences |

mod cell_surface;
mod chance;
mod change;
mod changed;
mod clock;
mod comparison;
mod cut;
mod gaps;
mod histogram;
mod map;
mod neighbours;
mod options;
mod page;
mod pulses;
mod quantities;
mod quantity;
mod registration;
mod report;
mod residuals;
mod setting;
mod statistic;
mod surfaces;
mod terrain;
#[cfg(test)]
mod tests;

pub use chance::{BlockKind, Chance};
pub use change::{Change, ChangeMap, Volume};
pub use changed::{ChangedPoints, changed_points, write_changed};
pub use comparison::{Agreement, Cloud, Comparison, compare, compared_attributes};
pub use histogram::Histogram;
pub use neighbours::Distances;
pub use options::CompareOptions;
pub use page::page;
pub use quantity::{DistributionDistance, Figure, Quantity};
pub use report::{json, table};
pub use surfaces::{Canopy, Voxels};
