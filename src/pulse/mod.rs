//! From the ray of a pulse to its echoes: subrays, energy, waveform, detection.

mod echo;

pub use echo::{Echo, PulseRecord, WaveformRecord};
