//! Coverage of a flight in square cells: [`Session::coverage`].

use super::super::pass::RunContext;
use super::super::progress::Progress;
use super::super::run::Epochs;
use super::super::session::Session;
use super::cells::{CellSum, CoverageCells, too_many_cells};
use super::sampler::Sampler;
use super::timeline::Timeline;
use crate::output::{OutputPlan, OutputRequest};
use std::collections::BTreeMap;
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex, PoisonError};
use vlscan_base::error::{Error, Result};
use vlscan_lidar::flight::FlightPlan;
use vlscan_lidar::pulse::PhysicsOptions;
use vlscan_survey::PlatformKind;

/// Limits of the side of a cell, m.
const SIDES: [f64; 2] = [0.01, 100_000.0];
/// Maximum number of cells of the map.
const MAX_MAP: f64 = 2e7;

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
    /// scan pattern at equal distances, and of these one in a few pulses, and more where surfaces end between
    /// them. Their returns count at the places of the pulses beside them and of the other periods, too. Fog,
    /// rain, snow and dust only dim the surfaces.
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
        // Light of fog and drops costs most of a pulse, and does not count.
        let options = PhysicsOptions { dark_air: true, ..self.settings().physics_for(&nothing) };
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
                let sampler = Sampler::new(&cells, session.survey(), side, shift);
                sampler.measure(session, pass, flight, timeline)
            })?;
        if report.interrupted {
            return Err(Error::Interrupted);
        }
        let cells = cells.into_inner().unwrap_or_else(PoisonError::into_inner);
        CoverageMap::of(cells.into_sums(), side, crs, report.pulses)
    }
}

#[cfg(test)]
mod tests {
    use super::super::beams::Surroundings;
    use super::super::cells::Repeats;
    use super::*;
    use vlscan_geom::{Aabb, DVec3};
    use vlscan_lidar::pulse::Echo;

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
            cells.add(&[echo], 0, (&repeats, &[[0.0; 2]]), &scene);
        }
        cells.into_sums()
    }
}
