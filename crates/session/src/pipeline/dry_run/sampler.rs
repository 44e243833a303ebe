//! Measurement of the sample of a flight from which its coverage is estimated.

use super::super::collector::{Ended, PassEnd};
use super::super::fly::run_stages;
use super::super::pass::Pass;
use super::super::session::Session;
use super::super::worker::{FlightWorker, Pieces};
use super::beams::{Beam, ITSELF, Surroundings, is_of_surface, offsets, thin};
use super::blocks::{BlockChunk, Blocks, MIN_SPIN, Stride, period_s};
use super::cells::{CoverageCells, too_many_cells};
use super::sweeps::{Sweep, assign, fill, gaps, split_echoes, take};
use super::timeline::Timeline;
use std::collections::HashMap;
use std::sync::Mutex;
use vlscan_base::error::{Error, Result};
use vlscan_geom::{Aabb, DVec3};
use vlscan_lidar::flight::{FlightPlan, FlightState};
use vlscan_scene::{Fallback, MotionState, Scene};
use vlscan_survey::{Deflector, Survey};

/// Cost of a pulse besides its rays, in rays.
const COST_OF_PULSE: f64 = 8.0;
/// Cost of the sample in any case, in rays, if the flight costs as much.
const MIN_COST: f64 = 3_000_000.0;
/// Part of the cost of the flight that the sample costs, if that is more.
const SHARE_OF_COST: f64 = 0.006;
/// Beams measured where surfaces end between two others, as a share of these.
const REFINED: f64 = 0.5;
/// Maximum number of pulses of a scan line of which one is measured where beams turn steadily. Neighbouring
/// lines add more information than all pulses of one line.
const MAX_STEADY: f64 = 16.0;
/// [`MAX_STEADY`] of mirrors whose lines take longer than [`LONG_S`], s. The turns of spinning heads may be
/// farther apart, because their channels lie side by side, but objects between measured beams are missed.
const MAX_STEADY_LONG: f64 = 32.0;
const LONG_S: f64 = 0.04;
/// Minimum number of measured pulses of a scan line where beams turn steadily.
const MIN_PER_LINE: f64 = 48.0;
/// Maximum number of pulses of which one is measured elsewhere.
const MAX_UNSTEADY: f64 = 8.0;
/// Maximum number of cells with returns.
const MAX_CELLS: usize = 4_000_000;
/// Greatest width of crowns and roofs that reach beyond the ground of a scene, m.
const MAX_OVERHANG: f64 = 15.0;

/// Measurement of a sample of a flight in cells.
pub struct Sampler<'a> {
    cells: &'a Mutex<CoverageCells>,
    /// Side of a cell, m.
    side: f64,
    /// Origin of the scene frame in the world, m.
    shift: DVec3,
    /// Strip of each leg of the survey.
    strips: Vec<u32>,
    /// True if beams turn steadily from pulse to pulse.
    is_steady: bool,
}

impl<'a> Sampler<'a> {
    /// A measurement of a survey in cells whose side is `side` m, in a scene frame with the origin `shift`.
    pub fn new(cells: &'a Mutex<CoverageCells>, survey: &Survey, side: f64, shift: DVec3) -> Sampler<'a> {
        Sampler { cells, side, shift, strips: strips_of(survey), is_steady: turns_steadily(survey) }
    }

    /// Measures blocks of a flight.
    pub fn measure(
        &self,
        session: &Session,
        pass: &Pass<'_>,
        flight: &FlightPlan,
        timeline: &Timeline,
    ) -> Result<Ended> {
        let ground = session.ground(Fallback::Lowest)?;
        let has_ground = ground.has_ground();
        let heights = move |x: f64, y: f64| ground.local_height(x, y);
        let scene = Surroundings { heights: &heights, has_ground, bounds: edges(session.scene()) };
        let has_velocities = pass.physics.records_velocities();
        let make_worker = || {
            let mut worker = FlightWorker::new(pass, flight);
            let scene = &scene;
            move |work: BlockChunk| -> Result<Pieces> {
                let sweeps = match self.is_steady && work.pulses > 1 {
                    true => take(flight, &work.chunk, (work.pulses, work.phase as u32), has_velocities)?,
                    false => None,
                };
                let (pieces, found) = match sweeps {
                    Some(sweeps) => self.measure_sweeps(&mut worker, &work, sweeps, scene)?,
                    None => self.measure_thinned(&mut worker, work, scene)?,
                };
                self.add(&found)?;
                Ok(pieces)
            }
        };
        let end =
            PassEnd { check: None, is_last: true, keeps_partial: false, open_outputs: pass.open_outputs };
        let stride = self.stride(pass, timeline, session.survey());
        run_stages(pass.schedule, pass.control, &pass.output, None, end, make_worker, |feed| {
            let run = feed.state();
            let motion = pass.motion.map(|motion| (motion, MotionState::after_steps(motion, 0)));
            let state = FlightState::start(flight);
            let mut blocks = Blocks { survey: session.survey(), flight, state, motion };
            blocks.divide(stride, &|| run.is_stopped(), &mut |block| feed.put(block))?;
            feed.end_leg()
        })
    }

    /// Measures the beams of sweeps of a chunk, and others between those whose surfaces do not continue each
    /// other. The number of these depends on the chunk alone, not on other threads.
    fn measure_sweeps(
        &self,
        worker: &mut FlightWorker<'_>,
        work: &BlockChunk,
        mut sweeps: Vec<Sweep>,
        scene: &Surroundings<'_>,
    ) -> Result<(Pieces, CoverageCells)> {
        let chunk = (work.chunk.leg, work.chunk.done);
        let pulses = sweeps.iter().flat_map(|sweep| sweep.nodes.iter().map(|node| node.pulse));
        let mut pieces = vec![Ok(worker.measure_pulses(chunk, pulses)?)];
        assign(sweeps.iter_mut().flat_map(|sweep| sweep.nodes.iter_mut()), worker.measured().1);
        let measured: usize = sweeps.iter().map(|sweep| sweep.nodes.len()).sum();
        let mut left = (measured as f64 * REFINED) as usize;
        while left > 0 {
            let wide = gaps(&sweeps, left);
            if wide.is_empty() {
                break;
            }
            left -= wide.len();
            pieces.push(Ok(worker.measure_pulses(chunk, wide.iter().map(|gap| gap.pulse))?));
            fill(&mut sweeps, wide, worker.measured().1);
        }
        let (strip, repeats) = (self.strip(work.chunk.leg), &work.repeats);
        let mut found = CoverageCells::new(self.side, self.shift);
        for sweep in &sweeps {
            for (i, node) in sweep.nodes.iter().enumerate() {
                match node.echoes.is_empty() {
                    true => found.add_around(&node.beam(), strip, repeats, &sweep.swings(i), scene),
                    false => found.add(&node.echoes, strip, (repeats, &sweep.offsets(i)), scene),
                }
            }
        }
        Ok((Pieces(pieces), found))
    }

    /// Measures the pulses of a chunk, or one in a few of them.
    fn measure_thinned(
        &self,
        worker: &mut FlightWorker<'_>,
        work: BlockChunk,
        scene: &Surroundings<'_>,
    ) -> Result<(Pieces, CoverageCells)> {
        let BlockChunk { chunk, repeats, pulses: every, phase } = work;
        let strip = self.strip(chunk.leg);
        let mut beams = Vec::new();
        let pieces = worker.measure_some(chunk, |pulses| beams = thin(pulses, every, phase))?;
        let mut found = CoverageCells::new(self.side, self.shift);
        let (pulses, mut rest) = worker.measured();
        for (i, pulse) in pulses.iter().enumerate() {
            let (own, later) = split_echoes(pulse, rest);
            rest = later;
            let swings = beams.get(i).map_or(ITSELF, |swings| &swings[..]);
            let surfaces = own.iter().filter(|echo| is_of_surface(echo));
            match surfaces.max_by_key(|echo| echo.return_number) {
                Some(last) => {
                    let offsets = offsets(&Beam::of(last), last.position, swings);
                    found.add(own, strip, (&repeats, &offsets), scene);
                }
                None => {
                    let beam = Beam { origin: pulse.origin, direction: pulse.attitude.forward() };
                    found.add_around(&beam, strip, &repeats, swings, scene);
                }
            }
        }
        Ok((pieces, found))
    }

    fn strip(&self, leg: u32) -> u32 {
        self.strips.get(leg as usize).copied().unwrap_or(leg)
    }

    /// Adds the returns of a chunk.
    fn add(&self, found: &CoverageCells) -> Result<()> {
        let mut all = self.cells.lock().map_err(|_| Error::Internal("a worker has panicked".to_owned()))?;
        all.join(found);
        if all.count() > MAX_CELLS { Err(too_many_cells(self.side)) } else { Ok(()) }
    }

    /// The pulses that are measured for the cost of the sample.
    fn stride(&self, pass: &Pass<'_>, timeline: &Timeline, survey: &Survey) -> Stride {
        let cost = timeline.pulses() * (pass.physics.max_rays() as f64 + COST_OF_PULSE);
        let ratio = (cost / MIN_COST.max(SHARE_OF_COST * cost)).max(1.0);
        let most = match (pass.motion, self.is_steady) {
            // Moving parts refer to pulses by their place in a chunk.
            (Some(_), _) => 1.0,
            (None, true) => max_steady(survey),
            (None, false) => MAX_UNSTEADY,
        };
        stride_for(ratio, most)
    }
}

/// The shares that measure one pulse in `ratio`, at least 1, with at most one in `most` of a period. Periods
/// are rounded: with one more than needed, scan lines would be farther apart and the sample smaller.
fn stride_for(ratio: f64, most: f64) -> Stride {
    let periods = (ratio / most).round().max(1.0);
    let pulses = (ratio / periods).ceil().min(most).max(1.0);
    Stride { periods: periods as u64, pulses: pulses as u32 }
}

/// The box of a scene's ground if at most crowns and roofs reach beyond it, otherwise that of the scene.
fn edges(scene: &Scene) -> Aabb {
    let whole = scene.bounds;
    // Tiles that are not loaded have ground, too.
    let Some(ground) = scene.ground_bounds().filter(|_| scene.tiles.is_none()) else { return whole };
    let is_near = |a: DVec3, b: DVec3| (a.x - b.x).abs().max((a.y - b.y).abs()) <= MAX_OVERHANG;
    if is_near(whole.min, ground.min) && is_near(whole.max, ground.max) { ground } else { whole }
}

/// True if the beams of a survey turn steadily: not from fibre to fibre, or by a table, or at pulse times.
fn turns_steadily(survey: &Survey) -> bool {
    let is_mirror = |deflector: &Deflector| match deflector {
        Deflector::Polygon { .. }
        | Deflector::Oscillating { .. }
        | Deflector::Conic
        | Deflector::EllipticConic { .. }
        | Deflector::Risley { .. } => true,
        Deflector::Fibres { .. } | Deflector::Custom(_) | Deflector::Pattern(_) => false,
    };
    survey.scanner.devices.iter().all(|device| is_mirror(&device.deflector))
        && survey.legs.iter().all(|leg| leg.scanner.pulse_times.is_none())
}

/// Maximum number of pulses of which one is measured where beams turn steadily.
fn max_steady(survey: &Survey) -> f64 {
    let active = survey.legs.iter().filter(|leg| leg.scanner.active);
    let limit = active.map(|leg| {
        let period = period_s(survey, leg.number);
        let max_rate = survey.scanner.devices.first().map_or(0.0, |device| device.head.max_rate);
        let spins = leg.scanner.head_rate.abs().min(max_rate) >= MIN_SPIN;
        let most = if period > LONG_S && !spins { MAX_STEADY_LONG } else { MAX_STEADY };
        let per_line = period * leg.scanner.pulse_rate() / MIN_PER_LINE;
        if per_line > 0.0 { most.min(per_line) } else { most }
    });
    limit.fold(MAX_STEADY_LONG, f64::min).floor().max(1.0)
}

/// Number of the strip of each leg: legs of one strip have that of the first.
fn strips_of(survey: &Survey) -> Vec<u32> {
    let mut named: HashMap<&str, u32> = HashMap::new();
    let legs = survey.legs.iter();
    legs.map(|leg| match leg.strip.as_deref() {
        Some(name) => *named.entry(name).or_insert(leg.number),
        None => leg.number,
    })
    .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sample_has_about_the_size_of_its_budget() {
        for (ratio, most, periods, pulses) in [
            (1.0, 16.0, 1, 1),
            (7.2, 16.0, 1, 8),
            (20.0, 16.0, 1, 16),
            (129.7, 32.0, 4, 32),
            (144.5, 16.0, 9, 16),
            (80.0, 32.0, 3, 27),
            (12.4, 1.0, 12, 1),
        ] {
            assert_eq!(stride_for(ratio, most), Stride { periods, pulses }, "one in {ratio}");
        }
    }
}
