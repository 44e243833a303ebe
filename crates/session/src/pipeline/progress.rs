//! Progress counters: atomics written by the collector and read by a progress display.

use super::beam_counts::{BeamCounts, BeamLog};
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use vlscan_scene::Tiles;
use vlscan_trace::ResidencyStatistics;

/// Counters of a running flight.
#[derive(Debug, Default)]
pub struct Progress {
    pulses: AtomicU64,
    echoes: AtomicU64,
    leg: AtomicU32,
    done: AtomicU64,
    beam_counts: Mutex<BeamLog>,
    /// The tiles of the scene, if it has any.
    tiles: Mutex<Option<Arc<Tiles>>>,
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
    /// Statistics of the tiles that were loaded and dropped.
    pub tiles: Option<ResidencyStatistics>,
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
    pub(super) fn add_beam_counts(&self, piece: &BeamCounts) {
        self.beam_counts.lock().unwrap_or_else(PoisonError::into_inner).add(piece);
    }

    /// Statistics of where the beams have pointed so far.
    pub(super) fn beam_counts(&self) -> BeamLog {
        self.beam_counts.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Sets the tiles of the scene that is measured.
    pub(super) fn set_tiles(&self, tiles: Option<&Arc<Tiles>>) {
        *self.tiles() = tiles.cloned();
    }

    fn tiles(&self) -> MutexGuard<'_, Option<Arc<Tiles>>> {
        self.tiles.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Reads the counters.
    pub fn snapshot(&self) -> Snapshot {
        Snapshot {
            pulses: self.pulses.load(Relaxed),
            echoes: self.echoes.load(Relaxed),
            leg: self.leg.load(Relaxed),
            done: f64::from_bits(self.done.load(Relaxed)),
            tiles: self.tiles().as_ref().map(|tiles| tiles.statistics()),
        }
    }
}
