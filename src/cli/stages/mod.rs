//! The stages of the river as commands: `vlscan trajectory` and `vlscan pulses` fly, `vlscan trace` looks.

mod fly;
mod trace;

pub use fly::{pulses, trajectory};
pub use trace::run as trace;
