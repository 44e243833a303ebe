//! Noise of ranges, by the heights of points about the ground around them.

use super::recording::{Pulse, Recording};
use super::solution::Solution;
use libm::cos;
use std::collections::HashMap;
use vlscan_geom::{DVec3, LeastSquares, median};

/// Width of the cells in which the ground counts as a plane, in mean distances between points.
const CELL_SPACINGS: f64 = 4.0;
/// Minimum number of pulses in a cell for a plane.
const MIN_PULSES: usize = 8;
/// Minimum number of cells.
const MIN_CELLS: usize = 20;
/// ASPRS class of ground.
const GROUND: u8 = 2;

/// Standard deviation of ranges to smooth ground, m, including its roughness; `None` without enough
/// points.
///
/// Planes are fitted to the single returns of small cells, of class ground where there are any; the median of
/// their residuals counts, corrected for the degrees of freedom, so that cells with bushes have no effect.
pub fn range_noise(recording: &Recording, solution: &Solution) -> Option<f64> {
    let has_ground =
        recording.pulses.iter().filter(|pulse| pulse.class == GROUND).count() > recording.pulses.len() / 10;
    let is_used = |i: &usize| {
        let pulse = &recording.pulses[*i];
        pulse.returns == 1 && (!has_ground || pulse.class == GROUND)
    };
    let used: Vec<usize> = recording.lines.iter().flat_map(|line| line.clone()).filter(is_used).collect();
    let spacing = spacing(recording, &used);
    let width = CELL_SPACINGS * spacing;
    let mut cells: HashMap<(i64, i64), Vec<usize>> = HashMap::new();
    for i in &used {
        let place = recording.pulses[*i].position;
        let cell = ((place.x / width).floor() as i64, (place.y / width).floor() as i64);
        cells.entry(cell).or_default().push(*i);
    }
    let mut spreads = Vec::new();
    for cell in cells.values().filter(|cell| cell.len() >= MIN_PULSES) {
        if let Some(spread) = plane_spread(recording, cell) {
            spreads.push(spread * slant(&recording.pulses[cell[0]], solution));
        }
    }
    (spreads.len() >= MIN_CELLS).then(|| median(spreads)).flatten()
}

/// Range that changes with a height, per m: the reciprocal of the cosine of the beam's angle from the
/// vertical.
fn slant(pulse: &Pulse, solution: &Solution) -> f64 {
    let attitude = solution.attitude(pulse.time);
    let beam = solution.model.direction(&attitude, usize::from(pulse.channel), pulse.time);
    1.0 / (-beam.z).max(cos(1.5))
}

/// Mean distance between points, m, by the cells of a coarse grid that hold any.
fn spacing(recording: &Recording, used: &[usize]) -> f64 {
    const COARSE: f64 = 5.0;
    let mut cells: HashMap<(i64, i64), u32> = HashMap::new();
    for i in used {
        let place = recording.pulses[*i].position;
        *cells.entry(((place.x / COARSE).floor() as i64, (place.y / COARSE).floor() as i64)).or_default() +=
            1;
    }
    let counts: Vec<f64> = cells.values().map(|count| f64::from(*count)).collect();
    COARSE / median(counts).unwrap_or(1.0).max(1.0).sqrt()
}

/// Standard deviation of heights from their plane, m.
fn plane_spread(recording: &Recording, cell: &[usize]) -> Option<f64> {
    let origin = recording.pulses[cell[0]].position;
    let offset = |i: &usize| recording.pulses[*i].position - origin;
    let mut sums = LeastSquares::new(3);
    for d in cell.iter().map(offset) {
        sums.add(&[d.x, d.y, 1.0], d.z, 1.0);
    }
    let plane = DVec3::from_slice(&sums.solution()?);
    let residual = |d: DVec3| d.z - plane.dot(DVec3::new(d.x, d.y, 1.0));
    let squares: f64 = cell.iter().map(|i| residual(offset(i)).powi(2)).sum();
    Some((squares / (cell.len() - 3) as f64).sqrt())
}
