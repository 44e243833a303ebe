//! Coverage of a flight in square cells: [`Session::coverage`].

use super::super::collector::{Ended, PassEnd};
use super::super::fly::run_stages;
use super::super::pass::{Pass, RunContext};
use super::super::progress::Progress;
use super::super::run::Epochs;
use super::super::session::Session;
use super::super::worker::{FlightWorker, Pieces};
use super::blocks::{BlockChunk, Course, Stride};
use super::cells::{CellSum, Cells};
use super::timeline::Timeline;
use crate::output::{OutputPlan, OutputRequest};
use std::collections::HashMap;
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex, PoisonError};
use vlscan_base::error::{Error, Result};
use vlscan_geom::{DVec3, HeightModel};
use vlscan_lidar::flight::{FlightPlan, FlightState};
use vlscan_scene::{Fallback, MotionState};
use vlscan_survey::{PlatformKind, Survey};

/// Rays that are traced in any case, if there are as many.
const MIN_RAYS: f64 = 3_000_000.0;
/// Part of the rays of the run that are traced, if these are more.
const SHARE_OF_RAYS: f64 = 0.02;
/// Way of the platform from one measured period to the next, if enough rays are left, in sides of a cell.
const SIDES_PER_STRIDE: f64 = 0.25;
/// Limits of the side of a cell, m.
const SIDES: [f64; 2] = [0.01, 100_000.0];
/// Most cells with returns, and most cells of the map.
const MAX_CELLS: usize = 4_000_000;
const MAX_MAP: f64 = 2e7;

/// A quantity of each cell of a [`CoverageMap`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CoverageBand {
    /// Pulses with a return per m²: first returns.
    PulseDensity,
    /// Returns per m².
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

    /// The map of sums; an empty one without returns.
    fn of(cells: &Cells, side_m: f64, crs: Option<String>, sampled_pulses: u64) -> Result<CoverageMap> {
        let (mut low, mut high) = ([i64::MAX; 2], [i64::MIN; 2]);
        for (place, _) in cells.iter() {
            low = [low[0].min(place[0]), low[1].min(place[1])];
            high = [high[0].max(place[0]), high[1].max(place[1])];
        }
        if cells.count() == 0 {
            return Ok(CoverageMap { side_m, crs, sampled_pulses, ..CoverageMap::default() });
        }
        let size = [0, 1].map(|axis| high[axis].abs_diff(low[axis]) as f64 + 1.0);
        if size[0] * size[1] > MAX_MAP {
            return Err(too_many_cells(side_m));
        }
        let [columns, rows] = size.map(|cells| cells as usize);
        let (area, empty) = (side_m * side_m, CellSum::default());
        let mut bands = CoverageBand::ALL.map(|band| vec![band.of(&empty, area); columns * rows]);
        for (place, sum) in cells.iter() {
            let [column, row] = [0, 1].map(|axis| place[axis].abs_diff(low[axis]) as usize);
            for (values, band) in bands.iter_mut().zip(CoverageBand::ALL) {
                values[row * columns + column] = band.of(sum, area);
            }
        }
        let corner = low.map(|cell| cell as f64 * side_m);
        Ok(CoverageMap { columns, rows, side_m, corner, crs, sampled_pulses, bands })
    }
}

impl Session {
    /// Measures a sample of the survey over the scene of the first epoch and estimates its coverage in square
    /// cells of `side` m.
    ///
    /// Of each leg, periods of the scan pattern are measured at equal distances: all of them if they have few
    /// rays, otherwise about two per cent. The returns of a period are spread over the way of the platform
    /// half way to the periods before and behind it.
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
        let epochs = Epochs { range: 0..=0, options, is_checked: false };
        // The pulses of the sample are no part of a run.
        let progress = Progress::default();
        let control = RunContext { progress: &progress, ..control };
        let shift = self.scene().shift;
        let cells = Mutex::new(Cells::new(side, shift));
        let report =
            self.run_epochs(output, epochs, control, &AtomicBool::new(true), |session, pass, _, _| {
                let area = Area { side, shift, cells: &cells, strips: strips_of(session.survey()) };
                area.measure(session, pass, flight, timeline)
            })?;
        if report.interrupted {
            return Err(Error::Interrupted);
        }
        let cells = cells.into_inner().unwrap_or_else(PoisonError::into_inner);
        CoverageMap::of(&cells, side, crs, report.pulses)
    }
}

/// Cells that are measured.
struct Area<'a> {
    /// Side of a cell, m.
    side: f64,
    /// Origin of the scene frame in the world, m.
    shift: DVec3,
    cells: &'a Mutex<Cells>,
    /// Strip of each leg of the survey.
    strips: Vec<u32>,
}

impl Area<'_> {
    /// Measures blocks of a flight.
    fn measure(
        &self,
        session: &Session,
        pass: &Pass<'_>,
        flight: &FlightPlan,
        timeline: &Timeline,
    ) -> Result<Ended> {
        let ground = session.ground(Fallback::Lowest)?;
        let ground = ground.has_ground().then_some(move |x: f64, y: f64| ground.local_height(x, y));
        let ground = ground.as_ref().map(|ground| ground as &dyn HeightModel);
        let make_worker = || {
            let mut worker = FlightWorker::new(pass, flight);
            move |work: BlockChunk| -> Result<Pieces> {
                let leg = work.chunk.leg;
                let pieces = worker.measure_in_any_order(work.chunk)?;
                let strip = self.strips.get(leg as usize).copied().unwrap_or(leg);
                let mut found = Cells::new(self.side, self.shift);
                found.add(worker.measured().1, strip, &work.repeats, ground);
                self.add(&found)?;
                Ok(pieces)
            }
        };
        let end =
            PassEnd { check: None, is_last: true, keeps_partial: false, open_outputs: pass.open_outputs };
        let stride = stride(pass, timeline, self.side);
        run_stages(pass.schedule, pass.control, &pass.output, None, end, make_worker, |feed| {
            let run = feed.state();
            let motion = pass.motion.map(|motion| (motion, MotionState::after_steps(motion, 0)));
            let state = FlightState::start(flight);
            let mut course = Course { survey: session.survey(), flight, state, motion };
            course.divide(stride, &|| run.is_stopped(), &mut |block| feed.put(block))?;
            feed.end_leg()
        })
    }

    /// Adds the returns of a chunk.
    fn add(&self, found: &Cells) -> Result<()> {
        let mut all = self.cells.lock().map_err(|_| Error::Internal("a worker has panicked".to_owned()))?;
        all.join(found);
        if all.count() > MAX_CELLS { Err(too_many_cells(self.side)) } else { Ok(()) }
    }
}

fn too_many_cells(side: f64) -> Error {
    Error::input_with_help(
        format!("the coverage of this survey has too many cells of {side} m"),
        "give larger ones with --coverage-cell",
    )
}

/// The distances of blocks that are measured with the rays of a sample.
fn stride(pass: &Pass<'_>, timeline: &Timeline, side: f64) -> Stride {
    let rays = timeline.pulses() * pass.physics.max_rays() as f64;
    let available = MIN_RAYS.max(SHARE_OF_RAYS * rays);
    Stride { min_periods: (rays / available).ceil().max(1.0) as u64, way: SIDES_PER_STRIDE * side }
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
