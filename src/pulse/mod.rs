//! From the ray of a pulse to its echoes: subrays, energy, waveform, detection.
//!
//! Pulses take this way, many at a time up to the tracing and one by one behind it:
//!
//! ```text
//! aim (subray) ─► trace (tree) ─► reflect ─► receive (waveform) ─► detect (peaks, fit) ─► emit (physics)
//!                               foliage, medium, energy  shape
//! ```

mod batch;
mod cluster;
mod continuum;
mod detect;
mod echo;
mod energy;
mod facet;
mod fit;
mod foliage;
mod footprint;
mod instrument;
mod light;
mod lone;
mod medium;
mod noise;
mod options;
mod peaks;
mod physics;
mod radiometry;
mod range_noise;
mod ranging;
mod receiver;
mod recorded;
mod reflect;
mod reflections;
mod sampled;
mod shape;
mod sight;
mod slope;
mod starts;
mod subray;
#[cfg(test)]
mod testkit;
#[cfg(test)]
mod tests;
mod truth;
mod waveform;

pub use batch::Batch;
pub use echo::{Echo, EchoTruth, PulseRecord, WaveformRecord};
pub use options::{Corrections, PhysicsOptions};
pub use physics::{Equipment, Lap, Physics, Shooter};
pub use recorded::{RecordedEcho, recorded_echoes};
