//! Platforms, which carry the scanner: position and attitude per step (spec kinematics §2).
//!
//! [`PlatformPlan`] is immutable during a run, [`PlatformState`] moves. A step along a straight path costs a
//! square root and no trigonometry; attitudes are composed only for steps with a pulse.
//!
//! | file | what it does |
//! |---|---|
//! | `plan`, `state` | all kinds of platforms behind one type each |
//! | `course` | waypoints and headings |
//! | `linear`, `ground_vehicle`, `multicopter` | motion from waypoint to waypoint |
//! | `physics` | acceleration against drag |
//! | `interpolated`, `table`, `trajectory_file` | motion along a table of recorded poses, the table, its files |
//! | `stream` | motion along poses as they arrive |
//! | `poses` | reads poses in any format while they arrive |
//! | `layout`, `layout_error`, `header` | columns of poses in text, their errors and their names |
//! | `attitude` | quaternions and matrices in the axes of other programs |

mod attitude;
mod course;
mod ground_vehicle;
mod header;
mod interpolated;
mod layout;
mod layout_error;
mod linear;
mod multicopter;
mod physics;
mod plan;
mod poses;
mod state;
mod stream;
mod table;
#[cfg(test)]
pub(crate) mod testing;
mod trajectory_file;

pub use course::{LegCourse, LegEntry, Span};
pub use layout_error::PoseLayoutError;
pub use plan::{Motion, PlatformPlan};
pub use poses::{MAX_FLOWN_GAP, PollResult, Pose, PoseEvent, PoseReader};
pub use state::PlatformState;
pub use stream::{Readiness, StreamPlan, adjusted_time_origin};
pub use table::TrajectoryTable;
pub use trajectory_file::read_trajectories;
