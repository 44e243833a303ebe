//! Coverage of a flight in square cells: [`Session::coverage`].

use super::super::collector::{Ended, PassEnd};
use super::super::fly::run_stages;
use super::super::pass::{Pass, RunContext};
use super::super::progress::Progress;
use super::super::run::Epochs;
use super::super::session::Session;
use super::super::worker::{FlightWorker, Pieces};
use super::beams::{Beam, ITSELF, KeptPulse, Surroundings, is_of_surface, thin};
use super::blocks::{BlockChunk, Blocks, Stride};
use super::cells::{CellSum, CoverageCells, Repeats};
use super::timeline::Timeline;
use crate::output::{OutputPlan, OutputRequest};
use std::collections::{BTreeMap, HashMap, HashSet};
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex, PoisonError};
use vlscan_base::error::{Error, Result};
use vlscan_geom::{Aabb, DVec3};
use vlscan_lidar::flight::{FlightPlan, FlightState, Pulse};
use vlscan_lidar::pulse::Echo;
use vlscan_scene::{Fallback, MotionState, Scene};
use vlscan_survey::{PlatformKind, Survey};

/// Rays that are traced in any case, if there are as many.
const MIN_RAYS: f64 = 3_000_000.0;
/// Part of the rays of the run that are traced, if these are more.
const SHARE_OF_RAYS: f64 = 0.012;
/// Maximum number of pulses of a scan line of which one is measured: neighbouring lines add more information
/// than all pulses of one line.
const MAX_THINNING: u32 = 8;
/// Limits of the side of a cell, m.
const SIDES: [f64; 2] = [0.01, 100_000.0];
/// Maximum number of cells with returns, and of cells of the map.
const MAX_CELLS: usize = 4_000_000;
const MAX_MAP: f64 = 2e7;
/// Greatest width of crowns and roofs that reach beyond the ground of a scene, m.
const MAX_OVERHANG: f64 = 15.0;

/// A quantity of each cell of a [`CoverageMap`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CoverageBand {
    /// Pulses with a return per m²: first returns. Returns of the air and of noise do not count.
    PulseDensity,
    /// Returns of surfaces per m².
    PointDensity,
    /// Number of strips with returns in the cell.
    Strips,
    /// Share of the cell without first returns, in sixteenths.
    Gaps,
    /// Mean angle of incidence of first returns, degrees; NaN without returns.
    Incidence,
    /// Share of the pulses aimed at the cell's ground that have no echo from the ground, because something
    /// stands above it; NaN without ground or pulses.
    Occlusion,
}

impl CoverageBand {
    /// All bands, in the order of files.
    pub const ALL: [CoverageBand; 6] = [
        CoverageBand::PulseDensity,
        CoverageBand::PointDensity,
        CoverageBand::Strips,
        CoverageBand::Gaps,
        CoverageBand::Incidence,
        CoverageBand::Occlusion,
    ];

    /// Name in files.
    pub fn name(self) -> &'static str {
        match self {
            CoverageBand::PulseDensity => "pulse_density",
            CoverageBand::PointDensity => "point_density",
            CoverageBand::Strips => "strips",
            CoverageBand::Gaps => "gaps",
            CoverageBand::Incidence => "incidence_deg",
            CoverageBand::Occlusion => "occlusion",
        }
    }

    fn of(self, cell: &CellSum, area: f64) -> f64 {
        match self {
            CoverageBand::PulseDensity => cell.pulses() / area,
            CoverageBand::PointDensity => cell.points() / area,
            CoverageBand::Strips => cell.strips() as f64,
            CoverageBand::Gaps => cell.gaps(),
            CoverageBand::Incidence => cell.incidence_deg(),
            CoverageBand::Occlusion => cell.occlusion(),
        }
    }
}

/// Coverage of a flight in square cells, whose corners are at multiples of their side.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CoverageMap {
    /// Number of cells from west to east.
    pub columns: usize,
    /// Number of cells from south to north.
    pub rows: usize,
    /// Side of a cell, m.
    pub side_m: f64,
    /// World coordinates of the south-western corner, m.
    pub corner: [f64; 2],
    /// System of the coordinates as WKT.
    pub crs: Option<String>,
    /// Number of pulses that were measured.
    pub sampled_pulses: u64,
    /// Values of the bands in the order of [`CoverageBand::ALL`], row by row from the south west.
    bands: [Vec<f64>; 6],
    /// Sums of the cells with returns, by column and row in the world, in this order.
    sums: Vec<([i64; 2], CellSum)>,
}

impl CoverageMap {
    /// Values of a band, row by row from the south west.
    pub fn values(&self, band: CoverageBand) -> &[f64] {
        &self.bands[band as usize]
    }

    /// World coordinates of the centre of a cell, by its index in the values, m.
    pub fn centre(&self, cell: usize) -> [f64; 2] {
        let columns = self.columns.max(1);
        let place = [cell % columns, cell / columns];
        [0, 1].map(|axis| self.corner[axis] + (place[axis] as f64 + 0.5) * self.side_m)
    }

    /// The coverage by several scanners together, of which each has a map of the same scene in cells of the
    /// same side: returns add up, and legs of the same number are one strip. An empty map without maps.
    ///
    /// # Errors
    /// [`Error::Input`] for cells of different sides, and for too many cells.
    pub fn together(maps: &[CoverageMap]) -> Result<CoverageMap> {
        let Some(CoverageMap { side_m, crs, .. }) = maps.first() else { return Ok(CoverageMap::default()) };
        if let Some(other) = maps.iter().find(|map| map.side_m != *side_m) {
            let message = format!("maps of coverage have cells of {side_m} m and of {} m", other.side_m);
            return Err(Error::input(message));
        }
        let mut sums: BTreeMap<[i64; 2], CellSum> = BTreeMap::new();
        for (place, sum) in maps.iter().flat_map(|map| &map.sums) {
            sums.entry(*place).or_default().join(sum);
        }
        let pulses = maps.iter().map(|map| map.sampled_pulses).sum();
        CoverageMap::of(sums.into_iter().collect(), *side_m, crs.clone(), pulses)
    }

    /// The map of the sums of cells; an empty one without returns.
    fn of(
        sums: Vec<([i64; 2], CellSum)>,
        side_m: f64,
        crs: Option<String>,
        sampled_pulses: u64,
    ) -> Result<CoverageMap> {
        let (mut low, mut high) = ([i64::MAX; 2], [i64::MIN; 2]);
        for (place, _) in &sums {
            low = [low[0].min(place[0]), low[1].min(place[1])];
            high = [high[0].max(place[0]), high[1].max(place[1])];
        }
        if sums.is_empty() {
            return Ok(CoverageMap { side_m, crs, sampled_pulses, ..CoverageMap::default() });
        }
        let size = [0, 1].map(|axis| high[axis].abs_diff(low[axis]) as f64 + 1.0);
        if size[0] * size[1] > MAX_MAP {
            return Err(too_many_cells(side_m));
        }
        let [columns, rows] = size.map(|cells| cells as usize);
        let (area, empty) = (side_m * side_m, CellSum::default());
        let mut bands = CoverageBand::ALL.map(|band| vec![band.of(&empty, area); columns * rows]);
        for (place, sum) in &sums {
            let [column, row] = [0, 1].map(|axis| place[axis].abs_diff(low[axis]) as usize);
            for (values, band) in bands.iter_mut().zip(CoverageBand::ALL) {
                values[row * columns + column] = band.of(sum, area);
            }
        }
        let corner = low.map(|cell| cell as f64 * side_m);
        Ok(CoverageMap { columns, rows, side_m, corner, crs, sampled_pulses, bands, sums })
    }
}

impl Session {
    /// Measures a sample of the survey over the scene of the first epoch and estimates its coverage in square
    /// cells of `side` m.
    ///
    /// Of short flights all pulses are measured, otherwise about one per cent: of each leg periods of the
    /// scan pattern at equal distances, and of these one in a few pulses. Their returns count at the places
    /// of the pulses beside them and of the other periods, too.
    ///
    /// # Errors
    /// As for [`Session::run`]; [`Error::Input`] for cells that are too small or too large, and for a live
    /// trajectory.
    pub fn coverage(&mut self, side: f64, control: RunContext<'_>) -> Result<CoverageMap> {
        self.check_cells(side)?;
        self.enter_epoch(0, control.stop)?;
        let flight = self.plan_flight()?;
        let timeline = self.timeline(&flight, control)?;
        self.measure_coverage(&flight, &timeline, side, control)
    }

    /// Checks that coverage can be measured in cells of `side` m.
    pub(super) fn check_cells(&self, side: f64) -> Result<()> {
        // Also false for NaN.
        if !(SIDES[0]..=SIDES[1]).contains(&side) {
            return Err(Error::input(format!(
                "cells of {side} m for the coverage: expected {} to {} m",
                SIDES[0], SIDES[1]
            )));
        }
        match self.survey().platform.kind {
            PlatformKind::Stream(_) => Err(Error::input_with_help(
                "coverage is measured along the whole flight, but its poses are read as a stream",
                "name the recorded trajectory as a file",
            )),
            _ => Ok(()),
        }
    }

    /// Measures the coverage of a flight whose timeline is known.
    pub(super) fn measure_coverage(
        &mut self,
        flight: &FlightPlan,
        timeline: &Timeline,
        side: f64,
        control: RunContext<'_>,
    ) -> Result<CoverageMap> {
        let context = self.output_context();
        let nothing = OutputRequest::default();
        let options = self.settings().physics_for(&nothing);
        let crs = context.crs.clone();
        let output = Arc::new(OutputPlan::new(nothing, &context)?);
        let epochs = Epochs { range: 0..=0, options, is_checked: false, has_legs: true };
        // The pulses of the sample are not part of a run.
        let progress = Progress::default();
        let control = RunContext { progress: &progress, ..control };
        let shift = self.scene().shift;
        let cells = Mutex::new(CoverageCells::new(side, shift));
        let report =
            self.run_epochs(output, epochs, control, &AtomicBool::new(true), |session, pass, _, _| {
                let sampler = Sampler { side, shift, cells: &cells, strips: strips_of(session.survey()) };
                sampler.measure(session, pass, flight, timeline)
            })?;
        if report.interrupted {
            return Err(Error::Interrupted);
        }
        let cells = cells.into_inner().unwrap_or_else(PoisonError::into_inner);
        CoverageMap::of(cells.into_sums(), side, crs, report.pulses)
    }
}

/// Measurement of a sample of a flight in cells.
struct Sampler<'a> {
    /// Side of a cell, m.
    side: f64,
    /// Origin of the scene frame in the world, m.
    shift: DVec3,
    cells: &'a Mutex<CoverageCells>,
    /// Strip of each leg of the survey.
    strips: Vec<u32>,
}

impl Sampler<'_> {
    /// Measures blocks of a flight.
    fn measure(
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
        let make_worker = || {
            let mut worker = FlightWorker::new(pass, flight);
            move |work: BlockChunk| -> Result<Pieces> {
                let leg = work.chunk.leg;
                let (every, phase) = (work.pulses, work.phase);
                let mut beams = Vec::new();
                let pieces = worker.measure_some(work.chunk, |pulses| beams = thin(pulses, every, phase))?;
                let strip = self.strips.get(leg as usize).copied().unwrap_or(leg);
                let found = self.count(worker.measured(), &beams, (strip, &work.repeats), &scene);
                self.add(&found)?;
                Ok(pieces)
            }
        };
        let end =
            PassEnd { check: None, is_last: true, keeps_partial: false, open_outputs: pass.open_outputs };
        let stride = stride(pass, timeline);
        run_stages(pass.schedule, pass.control, &pass.output, None, end, make_worker, |feed| {
            let run = feed.state();
            let motion = pass.motion.map(|motion| (motion, MotionState::after_steps(motion, 0)));
            let state = FlightState::start(flight);
            let mut blocks = Blocks { survey: session.survey(), flight, state, motion };
            blocks.divide(stride, &|| run.is_stopped(), &mut |block| feed.put(block))?;
            feed.end_leg()
        })
    }

    /// The returns of measured pulses of a strip. `beams` are those of the pulses, if they stand for others.
    fn count(
        &self,
        (pulses, echoes): (&[Pulse], &[Echo]),
        beams: &[KeptPulse],
        (strip, repeats): (u32, &Repeats),
        scene: &Surroundings<'_>,
    ) -> CoverageCells {
        let mut found = CoverageCells::new(self.side, self.shift);
        let surfaces = echoes.iter().filter(|echo| is_of_surface(echo));
        let returned: HashSet<(u32, u64)> = surfaces.map(|echo| (echo.device, echo.pulse_number)).collect();
        for (i, pulse) in pulses.iter().enumerate() {
            if !returned.contains(&(pulse.device, pulse.number)) {
                let beam = Beam { origin: pulse.origin, direction: pulse.attitude.forward() };
                let swings = beams.get(i).map_or(ITSELF, |beam| &beam.swings[..]);
                found.add_around(&beam, strip, repeats, swings, scene);
            }
        }
        let mut left = beams.iter();
        let mut swings = |echo: &Echo| {
            let is_it = |beam: &&KeptPulse| (beam.device, beam.number) == (echo.device, echo.pulse_number);
            left.find(is_it).map_or(ITSELF, |beam| &beam.swings[..])
        };
        found.add(echoes, strip, repeats, &mut swings, scene);
        found
    }

    /// Adds the returns of a chunk.
    fn add(&self, found: &CoverageCells) -> Result<()> {
        let mut all = self.cells.lock().map_err(|_| Error::Internal("a worker has panicked".to_owned()))?;
        all.join(found);
        if all.count() > MAX_CELLS { Err(too_many_cells(self.side)) } else { Ok(()) }
    }
}

/// The box of a scene's ground if at most crowns and roofs reach beyond it, otherwise that of the scene.
fn edges(scene: &Scene) -> Aabb {
    let whole = scene.bounds;
    // Tiles that are not loaded have ground, too.
    let Some(ground) = scene.ground_bounds().filter(|_| scene.tiles.is_none()) else { return whole };
    let is_near = |a: DVec3, b: DVec3| (a.x - b.x).abs().max((a.y - b.y).abs()) <= MAX_OVERHANG;
    if is_near(whole.min, ground.min) && is_near(whole.max, ground.max) { ground } else { whole }
}

fn too_many_cells(side: f64) -> Error {
    Error::input_with_help(
        format!("the coverage of this survey has too many cells of {side} m"),
        "give larger ones with --coverage-cell",
    )
}

/// The pulses that are measured with the rays of a sample.
fn stride(pass: &Pass<'_>, timeline: &Timeline) -> Stride {
    let rays = timeline.pulses() * pass.physics.max_rays() as f64;
    let ratio = (rays / MIN_RAYS.max(SHARE_OF_RAYS * rays)).max(1.0);
    // Moving parts refer to pulses by their place in a chunk.
    let pulses = if pass.motion.is_some() { 1.0 } else { ratio.ceil().min(f64::from(MAX_THINNING)) };
    Stride { periods: (ratio / pulses).ceil() as u64, pulses: pulses as u32 }
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
    fn maps_begin_at_the_south_western_cell() {
        let shift = DVec3::new(500_000.0, 0.0, 0.0);
        assert_eq!(CoverageMap::of(Vec::new(), 10.0, None, 0).unwrap().columns, 0);
        let far = CoverageMap::of(two_cells(shift, 25.0), 10.0, None, 2).unwrap();
        assert_eq!((far.columns, far.rows, far.corner), (3, 1, [500_000.0, 0.0]));
        assert_eq!(far.values(CoverageBand::PulseDensity), [0.01, 0.0, 0.01]);
        assert_eq!(far.values(CoverageBand::Strips), [1.0, 0.0, 1.0]);
        assert!(far.values(CoverageBand::Incidence)[1].is_nan());
        assert_eq!(far.centre(2), [500_025.0, 5.0]);
        let refused = CoverageMap::of(two_cells(DVec3::ZERO, 1e9), 10.0, None, 2).unwrap_err().to_string();
        assert!(refused.contains("too many cells of 10 m"), "{refused}");
    }

    #[test]
    fn maps_of_several_scanners_are_added() {
        let map = |x: f64| CoverageMap::of(two_cells(DVec3::ZERO, x), 10.0, None, 2).unwrap();
        let both = CoverageMap::together(&[map(25.0), map(-5.0)]).unwrap();
        assert_eq!((both.columns, both.rows, both.corner, both.sampled_pulses), (4, 1, [-10.0, 0.0], 4));
        // Both have a pulse in the first cell, on the same leg.
        assert_eq!(both.values(CoverageBand::PulseDensity), [0.01, 0.02, 0.0, 0.01]);
        assert_eq!(both.values(CoverageBand::Strips), [1.0, 1.0, 0.0, 1.0]);
        assert_eq!(
            CoverageMap::together(&[map(25.0)]).unwrap().values(CoverageBand::Gaps),
            map(25.0).values(CoverageBand::Gaps)
        );
        assert_eq!(CoverageMap::together(&[]).unwrap(), CoverageMap::default());
        let other = CoverageMap { side_m: 5.0, ..map(25.0) };
        let refused = CoverageMap::together(&[map(25.0), other]).unwrap_err().to_string();
        assert!(refused.contains("cells of 10 m and of 5 m"), "{refused}");
    }

    /// Sums of cells with returns in the first cell and `x` m from its side.
    fn two_cells(shift: DVec3, x: f64) -> Vec<([i64; 2], CellSum)> {
        let miss = vlscan_lidar::pulse::PulseRecord {
            origin: DVec3::ZERO,
            direction: DVec3::NEG_Z,
            time_ns: 0.0,
            number: 1,
            device: 0,
            scan_angle: 0.0,
        };
        let repeats = Repeats { around: [0.0; 2], drift: [0.0; 2] };
        let heights = |_: f64, _: f64| None::<f64>;
        let scene = Surroundings { heights: &heights, has_ground: false, bounds: Aabb::EMPTY };
        let mut cells = CoverageCells::new(10.0, shift);
        for x in [5.0, x] {
            let position = DVec3::new(x, 5.0, 0.0);
            let echo =
                Echo { position, return_number: 1, number_of_returns: 1, part: 0, ..Echo::miss(&miss) };
            cells.add(&[echo], 0, &repeats, &mut |_: &Echo| ITSELF, &scene);
        }
        cells.into_sums()
    }
}
