//! The instrument's moving optics: heads and deflectors per step (spec kinematics §4, §5).
//!
//! States hold angles and counters only; rotations are composed only for steps with a pulse.
//!
//! | file | what it does |
//! |---|---|
//! | `plan` | constants of a device |
//! | `device` | head and deflector of a device |
//! | `head` | the rotating head |
//! | `deflector` | all kinds of deflectors behind one type |
//! | `timed` | the motion of a deflector as a function of time |
//! | `polygon`, `oscillating`, `risley` | polygon mirrors, oscillating mirrors, Risley prisms |

mod deflector;
mod device;
mod head;
mod oscillating;
mod plan;
mod polygon;
mod risley;
#[cfg(test)]
pub mod testing;
mod timed;

pub use device::DeviceState;
pub use plan::DevicePlan;
pub(crate) use polygon::firing_window;
