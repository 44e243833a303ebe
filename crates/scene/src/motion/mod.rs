//! Moving parts (spec input-formats §3.7, pulse-physics §6).
//!
//! ```text
//! SceneRecipe, Scene ─► MotionPlan (how and when parts move; shared by all threads)
//!                          │ start, step: called once per simulation step
//!                          ▼
//!                      MotionState (small; every chunk holds its initial one)
//!                          ▼
//!                      DynamicScene (a worker's transformed copy of the parts with their trees)
//! ```
//!
//! The motions of a part are multiplied, step by step, into one transform of its initial pose. A state is
//! therefore small, and replaying a copy of it results in the same bits on every thread.
//!
//! | file | contents |
//! |---|---|
//! | `plan` | how and when parts move |
//! | `state` | their poses at a step |
//! | `body` | boxes around them |
//! | `object` | their geometry in these poses |
//! | `twist` | velocities |

mod body;
mod object;
mod plan;
mod state;
#[cfg(test)]
mod tests;
mod twist;

pub use body::{BodyBox, BodyPose};
pub use object::{DynamicObject, DynamicScene, ObjectUpdate};
pub use plan::{MotionPlan, check_time_step};
pub use state::MotionState;
pub use twist::Twist;
