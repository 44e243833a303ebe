//! Densities that a share of the cells of an area has: a plan is made denser until a sample of its flight has
//! them.

use std::ops::RangeInclusive;
use vlscan_base::error::{Error, Result};
use vlscan_base::quantity::number;
use vlscan_session::{CoverageBand, CoverageMap};
use vlscan_tools::plan::{AirborneOptions, Area, PlannedSurvey};

/// Share of the cells if none is requested, percent.
const DEFAULT_SHARE: f64 = 95.0;
/// Side of a cell if none is requested, m.
const DEFAULT_SIDE: f64 = 10.0;
/// Plans that are tried.
const MAX_ROUNDS: u32 = 6;
/// By how much more than needed a plan is made denser, as a share.
const MARGIN: f64 = 1.01;
/// Largest factor by which a plan is made denser.
const MAX_FACTOR: f64 = 3.0;
/// Most cells that are compared.
const MAX_CELLS: f64 = 4e6;
/// Distance, in sides of a cell, by which its corners may lie outside of the area.
const TOLERANCE: f64 = 1e-6;

/// A density that cells of the area are to have.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Guarantee {
    /// Pulses with a return per m².
    least: f64,
    /// Share of the cells, percent.
    share: f64,
    /// Side of a cell, m.
    pub side: f64,
}

impl Guarantee {
    /// The guarantee that options request, if they do.
    pub fn of(options: &AirborneOptions) -> Option<Guarantee> {
        let least = options.min_density?;
        let share = options.min_share.unwrap_or(DEFAULT_SHARE);
        Some(Guarantee { least, share, side: options.min_cell.unwrap_or(DEFAULT_SIDE) })
    }

    /// Tries plans of growing density until the cells of the area have theirs. `plan` makes a plan of a mean
    /// density, pulses/m²; `measure` estimates the coverage of its flight.
    ///
    /// # Errors
    /// [`Error::Input`] for areas without whole cells and densities that are not reached; the errors of
    /// `plan` and `measure`.
    pub fn reach(
        &self,
        area: &Area,
        plan: &dyn Fn(f64) -> Result<PlannedSurvey>,
        measure: &dyn Fn(&PlannedSurvey) -> Result<CoverageMap>,
    ) -> Result<PlannedSurvey> {
        let cells = self.cells(area)?;
        let mut density = self.least;
        let mut best = 0.0;
        for _ in 0..MAX_ROUNDS {
            let mut survey = plan(density)?;
            let densities = self.densities(&cells, &measure(&survey)?);
            let found = self.found(&densities);
            if found >= self.share {
                let Guarantee { least, side, .. } = *self;
                survey.comments.push(format!(
                    "guarantee  {found:.1} % of the cells of {} m have at least {} pulses/m² with a return",
                    number(side),
                    number(least)
                ));
                return Ok(survey);
            }
            best = f64::max(best, found);
            let reached = self.reached(&densities);
            if reached <= 0.0 {
                // Cells without pulses get none from a denser flight.
                break;
            }
            density *= (MARGIN * self.least / reached).clamp(MARGIN, MAX_FACTOR);
        }
        Err(self.missed(best))
    }

    fn missed(&self, best: f64) -> Error {
        let Guarantee { least, share, side } = *self;
        Error::input_with_help(
            format!(
                "{best:.1} % of the cells of {} m within the area have {} pulses/m² with a return, instead \
                 of {} %",
                number(side),
                number(least),
                number(share)
            ),
            "lower --min-density or --min-share, raise --overlap, or keep the area within the scene; `vlscan \
             run plan.toml --dry-run --coverage c.tif` shows the cells of a plan without --min-density",
        )
    }

    /// Columns and rows of the cells that lie within the area.
    fn cells(&self, area: &Area) -> Result<Vec<[i64; 2]>> {
        let side = self.side;
        let (low, high) = area.bounds();
        let range = |axis: usize| -> RangeInclusive<i64> {
            (low[axis] / side).floor() as i64..=(high[axis] / side).floor() as i64
        };
        let size = [0, 1].map(|axis| (high[axis] - low[axis]) / side + 1.0);
        if size[0] * size[1] > MAX_CELLS {
            return Err(Error::input(format!(
                "the area has too many cells of {} m; give larger ones with --min-cell",
                number(side)
            )));
        }
        let is_within = |place: &[i64; 2]| {
            let corner = |i: f64, k: f64| [(place[0] as f64 + i) * side, (place[1] as f64 + k) * side];
            let (near, far) = (TOLERANCE, 1.0 - TOLERANCE);
            [(near, near), (far, near), (far, far), (near, far)]
                .iter()
                .all(|(i, k)| area.contains(corner(*i, *k)))
        };
        let places = range(1).flat_map(|row| range(0).map(move |column| [column, row]));
        let cells: Vec<[i64; 2]> = places.filter(is_within).collect();
        if cells.is_empty() {
            return Err(Error::input(format!(
                "no cell of {} m lies within the area; give smaller ones with --min-cell",
                number(side)
            )));
        }
        Ok(cells)
    }

    /// Densities of cells in ascending order, pulses/m².
    fn densities(&self, cells: &[[i64; 2]], map: &CoverageMap) -> Vec<f64> {
        let values = map.values(CoverageBand::PulseDensity);
        let first = map.corner.map(|c| (c / self.side).round() as i64);
        let density = |place: &[i64; 2]| {
            let [column, row] = [0, 1].map(|axis| usize::try_from(place[axis] - first[axis]).ok());
            let (column, row) = (column.filter(|c| *c < map.columns)?, row.filter(|r| *r < map.rows)?);
            values.get(row * map.columns + column).copied()
        };
        let mut densities: Vec<f64> = cells.iter().map(|place| density(place).unwrap_or(0.0)).collect();
        densities.sort_unstable_by(f64::total_cmp);
        densities
    }

    /// Percent of the cells that have the density.
    fn found(&self, ascending: &[f64]) -> f64 {
        let below = ascending.partition_point(|density| *density < self.least);
        100.0 * (ascending.len() - below) as f64 / ascending.len().max(1) as f64
    }

    /// The density that the requested share of the cells has, pulses/m².
    fn reached(&self, ascending: &[f64]) -> f64 {
        let below = ((1.0 - self.share / 100.0) * ascending.len() as f64) as usize;
        ascending.get(below.min(ascending.len().saturating_sub(1))).copied().unwrap_or(0.0)
    }
}

/// The options with a mean density (pulses/m²) in place of the minimum.
pub fn mean(options: &AirborneOptions, density: f64) -> AirborneOptions {
    AirborneOptions {
        density: Some(density),
        min_density: None,
        min_share: None,
        min_cell: None,
        ..options.clone()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn guarantee(least: f64, share: f64) -> Guarantee {
        Guarantee { least, share, side: 10.0 }
    }

    #[test]
    fn plans_that_are_tried_have_a_mean_density_only() {
        let (min_density, min_share) = (Some(4.0), Some(98.0));
        let options = AirborneOptions { height: 60.0, min_density, min_share, ..AirborneOptions::default() };
        let tried = mean(&options, 5.0);
        assert!(options.check().is_ok() && tried.check().is_ok());
        assert_eq!((tried.height, tried.density, tried.min_density), (60.0, Some(5.0), None));
    }

    #[test]
    fn cells_lie_within_the_area() {
        let cells = |low, high| {
            guarantee(1.0, 95.0).cells(&Area::rectangle(low, high).unwrap()).map(|cells| cells.len())
        };
        assert_eq!(cells([0.0, 0.0], [100.0, 50.0]).unwrap(), 50);
        assert_eq!(cells([-5.0, 0.0], [105.0, 50.0]).unwrap(), 50);
        assert_eq!(cells([-25.0, -10.0], [-9.0, 0.0]).unwrap(), 1);
        for (low, high, expected) in
            [([1.0, 1.0], [9.0, 9.0], "smaller ones"), ([0.0, 0.0], [1e7, 1e7], "larger ones")]
        {
            let refused = cells(low, high).unwrap_err().to_string();
            assert!(refused.contains(expected), "{refused}");
        }
    }

    #[test]
    fn shares_count_the_cells_that_have_the_density() {
        let densities: Vec<f64> = (1..=100).map(f64::from).collect();
        let wanted = guarantee(21.0, 95.0);
        assert_eq!((wanted.found(&densities), wanted.reached(&densities)), (80.0, 6.0));
        assert_eq!(guarantee(6.0, 95.0).found(&densities), 95.0);
        assert_eq!(guarantee(1.0, 100.0).reached(&densities), 1.0);
        assert_eq!(guarantee(1.0, 0.0).reached(&densities), 100.0);
    }

    #[test]
    fn plans_without_pulses_in_cells_are_refused_after_one_round() {
        let area = Area::rectangle([0.0, 0.0], [100.0, 50.0]).unwrap();
        let rounds = std::cell::Cell::new(0);
        let plan = |_: f64| -> Result<PlannedSurvey> {
            rounds.set(rounds.get() + 1);
            Ok(PlannedSurvey::default())
        };
        let refused = guarantee(4.0, 95.0).reach(&area, &plan, &|_| Ok(CoverageMap::default())).unwrap_err();
        assert!(refused.to_string().contains("0.0 % of the cells of 10 m"), "{refused}");
        assert_eq!(rounds.get(), 1);
    }
}
