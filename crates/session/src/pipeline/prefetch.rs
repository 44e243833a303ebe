//! Loading of tiles of the scene before rays need them: those in the direction of the flight.

use std::sync::Arc;
use std::time::Instant;
use vlscan_base::damage::panic_text;
use vlscan_base::error::{Error, Result};
use vlscan_base::machine;
use vlscan_geom::{Aabb, DVec3};
use vlscan_scene::Tiles;

/// How far ahead tiles are loaded, in times that the loading of a tile takes.
const LOADS_AHEAD: f64 = 3.0;

/// Place at which a chunk of pulses was measured.
#[derive(Clone, Copy, Debug)]
pub struct Sighting {
    /// Position of the instrument, scene frame, m.
    pub position: DVec3,
    /// Box around everything that its beams could hit, scene frame, m.
    pub area: Aabb,
}

/// Takes sightings of the workers of a run; a thread loads the tiles ahead.
#[derive(Clone, Debug)]
pub struct Prefetcher {
    sightings: flume::Sender<Sighting>,
}

impl Prefetcher {
    /// Runs `work` with a thread that loads tiles in parallel.
    ///
    /// # Errors
    /// The errors of `work`, and [`Error::Io`] if the system has no more threads.
    pub fn run<R>(tiles: &Arc<Tiles>, work: impl FnOnce(&Prefetcher) -> Result<R>) -> Result<R> {
        // One that waits is enough: the next will be newer.
        let (sender, sightings) = flume::bounded(1);
        std::thread::scope(|scope| {
            let prefetcher = Prefetcher { sightings: sender };
            let thread = machine::spawn_scoped(scope, "vlscan-tiles", || load_ahead(tiles, &sightings))?;
            let result = work(&prefetcher);
            drop(prefetcher);
            thread.join().map_err(|panic| {
                let text = panic_text(&*panic);
                Error::Internal(format!("the thread that loads tiles panicked: {text}"))
            })?;
            result
        })
    }

    /// Tells where a chunk was measured.
    pub fn tell(&self, sighting: Sighting) {
        // While the thread is busy, sightings are too many.
        let _ = self.sightings.try_send(sighting);
    }
}

/// Loads the tiles that the beams will meet if the flight continues as it is.
fn load_ahead(tiles: &Tiles, sightings: &flume::Receiver<Sighting>) {
    let mut last: Option<(Instant, DVec3)> = None;
    while let Ok(Sighting { position, area }) = sightings.recv() {
        let now = Instant::now();
        if let Some((then, from)) = last {
            let statistics = tiles.statistics();
            let load_s = statistics.load_time.as_secs_f64() / statistics.loaded.max(1) as f64;
            // In time of the program, not of the flight.
            let velocity = (position - from) / (now - then).as_secs_f64().max(1e-6);
            let way = velocity * (LOADS_AHEAD * load_s);
            if way.is_finite() && !area.is_empty() {
                tiles.prefetch(&area, way);
            }
        }
        last = Some((now, position));
    }
}
