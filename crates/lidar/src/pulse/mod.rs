//! The physics of a pulse: subrays, received energy, waveform, detection.
//!
//! Ray generation and traversal handle many pulses at a time, detection one pulse after the other.
//!
//! | file | what it does |
//! |---|---|
//! | `options`, `instrument`, `emission`, `physics` | options and corrections; constants of each device, its pulse and beam; data of all workers |
//! | `simulator`, `ray_batch` | the three phases of many pulses; rays that are traced together |
//! | `subray`, `footprint` | directions of subrays: rings, and patterns of equal energy |
//! | `traced`, `energy`, `lanes` | ranges of the hits and the energy received from there, in blocks of subrays |
//! | `receive` | from the hits of a pulse to its records |
//! | `view`, `reflect`, `reflections`, `triangle_cache` | the scene at the time of a pulse, and its reflections |
//! | `tiles` | tracing through the tiles of a scene, which are loaded when rays need them |
//! | `foliage`, `medium`, `continuum` | rays through voxels |
//! | `paths`, `light`, `ahead` | light over mirrors and through panes; its state; surfaces behind them for pulses at once |
//! | `pane`, `specular` | panes; mirrors that face the beam |
//! | `water`, `water_column` | the surface of water; light that water scatters back |
//! | `weather`, `weather_drops`, `weather_light`, `beam_volume` | fog, rain, snow and dust; single drops; returned light; volume of the beam |
//! | `return_profile`, `slope` | reflected light by range; subrays on one slope |
//! | `single_bin`, `cluster`, `pulse_starts` | returns without a waveform |
//! | `shape`, `sampled`, `waveform` | the outgoing pulse and the received waveform |
//! | `reception`, `receiver`, `receiver_error`, `noise`, `ranging`, `selection` | detection of each device; receivers that are not ideal: noise, ranging, photon statistics, dead time |
//! | `fmcw` | ranges and velocities by chirps |
//! | `photon_counter` | receivers that count single photons |
//! | `maximum` | time and height of an echo between its samples |
//! | `detector_settings`, `peak_detection`, `peaks`, `fit`, `recorded` | detection settings; returns of simulated, recorded waveforms |
//! | `sources`, `velocity`, `range_noise` | true causes of echoes; their radial velocities; noise of ranges |
//! | `echo`, `batch` | the records |

mod ahead;
mod batch;
mod beam_volume;
mod cluster;
mod continuum;
mod detector_settings;
mod echo;
mod emission;
mod energy;
mod fit;
mod fmcw;
mod foliage;
mod footprint;
mod instrument;
mod lanes;
mod light;
mod maximum;
mod medium;
mod noise;
mod options;
mod pane;
mod paths;
mod peak_detection;
mod peaks;
mod photon_counter;
mod physics;
mod pulse_starts;
mod range_noise;
mod ranging;
mod ray_batch;
mod receive;
mod receiver;
mod receiver_error;
mod reception;
mod recorded;
mod reflect;
mod reflections;
mod return_profile;
mod sampled;
mod selection;
mod shape;
mod simulator;
mod single_bin;
mod slope;
mod sources;
mod specular;
mod subray;
#[cfg(test)]
mod testkit;
#[cfg(test)]
mod tests;
mod tiles;
mod traced;
mod triangle_cache;
mod velocity;
mod view;
mod water;
mod water_column;
mod waveform;
mod weather;
mod weather_drops;
mod weather_light;

pub use batch::{Batch, NearPulses, WeakPulses};
pub use echo::{Echo, EchoPath, EchoTruth, EchoVelocity, PathKind, PulseRecord, WaveformRecord};
pub use instrument::{InstrumentTable, count_echoes_of_one_pulse};
pub use options::{PhysicsOptions, PhysicsProfile};
pub use physics::Physics;
pub use receiver::FalseAlarms;
pub use receiver_error::ReceiverError;
pub use recorded::{RecordedEcho, recorded_echoes};
pub use simulator::{Phase, PulseSimulator};
pub use vlscan_base::corrections::Corrections;
