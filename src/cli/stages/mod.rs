//! The stages of a run as commands: `vlscan trajectory` and `vlscan pulses` fly, `vlscan trace` traces.

mod fly;
mod trace;

pub use fly::{pulses, trajectory};
pub use trace::run as trace;
