//! From the ray of a pulse to its echoes: subrays, energy, waveform, detection.
//!
//! A pulse takes this way; each stage is a function from plain values to plain values:
//!
//! ```text
//! expand (subray) ─► trace (tree) ─► reflect ─► receive (waveform) ─► detect (peaks, fit) ─► emit (physics)
//!                                  foliage, energy    shape
//! ```

mod detect;
mod echo;
mod energy;
mod fit;
mod foliage;
mod instrument;
mod options;
mod peaks;
mod physics;
mod reflect;
mod shape;
mod subray;
#[cfg(test)]
mod testkit;
#[cfg(test)]
mod tests;
mod waveform;

pub use echo::{Echo, PulseRecord, WaveformRecord};
pub use options::{Corrections, PhysicsOptions};
pub use physics::{Physics, Shooter};
