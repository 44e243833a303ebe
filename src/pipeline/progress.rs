//! Progress counters: atomics written by the collector and read by a progress display.

use super::aim::{Aim, AimLog};
use std::sync::Mutex;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering::Relaxed};

/// Counters of a running flight.
#[derive(Debug, Default)]
pub struct Progress {
    pulses: AtomicU64,
    echoes: AtomicU64,
    leg: AtomicU32,
    done: AtomicU64,
    aim: Mutex<AimLog>,
}

/// The counters at one moment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Snapshot {
    /// Pulses emitted and written.
    pub pulses: u64,
    /// Echoes written.
    pub echoes: u64,
    /// Number of the leg in the survey.
    pub leg: u32,
    /// Fraction of the survey done, 0–1; NaN when the end is unknown.
    pub done: f64,
}

impl Progress {
    /// Adds a finished chunk: its pulses, echoes and leg, and the fraction of the survey done.
    pub(super) fn add(&self, pulses: u64, echoes: u64, leg: u32, done: f64) {
        self.pulses.fetch_add(pulses, Relaxed);
        self.echoes.fetch_add(echoes, Relaxed);
        self.leg.store(leg, Relaxed);
        self.done.store(done.to_bits(), Relaxed);
    }

    /// Adds the beam directions of a piece.
    pub(super) fn add_aim(&self, piece: &Aim) {
        if let Ok(mut log) = self.aim.lock() {
            log.add(piece);
        }
    }

    /// Statistics of where the beams have pointed so far.
    pub(super) fn aim(&self) -> AimLog {
        self.aim.lock().map(|log| log.clone()).unwrap_or_default()
    }

    /// Reads the counters.
    pub fn snapshot(&self) -> Snapshot {
        Snapshot {
            pulses: self.pulses.load(Relaxed),
            echoes: self.echoes.load(Relaxed),
            leg: self.leg.load(Relaxed),
            done: f64::from_bits(self.done.load(Relaxed)),
        }
    }
}
