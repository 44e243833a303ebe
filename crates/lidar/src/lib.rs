//! The instrument: how it moves, where its beams point, and what it measures.
//!
//! | module | what it does |
//! |---|---|
//! | `platform` | position and attitude per step; recorded trajectories in every layout |
//! | `scanner` | heads and deflectors per step |
//! | `flight` | the clock: legs, steps, pulses; replayed from a snapshot |
//! | `pulse` | subrays, energy, waveform, detection: a pulse becomes returns |

#![deny(unsafe_code)]

pub mod flight;
pub mod platform;
pub mod pulse;
pub mod scanner;
