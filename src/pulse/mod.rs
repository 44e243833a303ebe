//! The physics of a pulse: subrays, received energy, waveform, detection.
//!
//! Ray generation and traversal handle many pulses at a time, what follows one pulse after the other:
//!
//! ```text
//! simulator: generate rays (subray, footprint) ─► traverse (ray_batch) ─► detection, pulse by pulse:
//!
//!   traced        ranges and gains of the subrays (energy)
//!   reflect       what each subray hits: triangles (triangle_cache), voxels (foliage, medium, continuum)
//!   profile       light by range (return_profile), planes as the whole beam meets them (slope)
//!   returns       without a waveform (single_bin, cluster), or by way of it (waveform, receiver, detect, peaks, fit)
//!   echoes        the surface that each return is attributed to (sources), range noise (range_noise)
//! ```

mod batch;
mod cluster;
mod continuum;
mod detect;
mod detection;
mod detector;
mod echo;
mod energy;
mod fit;
mod foliage;
mod footprint;
mod instrument;
mod lanes;
mod medium;
mod noise;
mod options;
mod peaks;
mod physics;
mod pulse_starts;
mod range_noise;
mod ranging;
mod ray_batch;
mod receiver;
mod recorded;
mod reflect;
mod reflections;
mod return_profile;
mod sampled;
mod shape;
mod simulator;
mod single_bin;
mod slope;
mod sources;
mod subray;
#[cfg(test)]
mod testkit;
#[cfg(test)]
mod tests;
mod traced;
mod triangle_cache;
mod view;
mod waveform;

pub use batch::Batch;
pub use echo::{Echo, EchoTruth, PulseRecord, WaveformRecord};
pub use instrument::InstrumentTable;
pub use options::{Corrections, PhysicsOptions};
pub use physics::Physics;
pub use recorded::{RecordedEcho, recorded_echoes};
pub use simulator::{Phase, PulseSimulator};
