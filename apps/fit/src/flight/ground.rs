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
/// Plausible noise of ranges with the roughness of the ground, m.
const NOISES: std::ops::RangeInclusive<f64> = 0.0002..=0.3;
/// Maximum plausible standard deviation of the noise, over the noise.
const MAX_DEVIATION: f64 = 0.25;
/// A tenth of the cells scatters less than the median cell by this factor where cells lie on surfaces of
/// different roughness, such as bare ground and crowns.
const MIXED: f64 = 2.0;

/// Standard deviation of ranges to smooth ground, including its roughness.
#[derive(Clone, Copy, Debug)]
pub struct RangeScatter {
    /// m.
    pub value: f64,
    /// Its standard deviation, m.
    pub deviation: f64,
    /// True if the points have no classes, and lie on surfaces of different roughness.
    pub is_mixed: bool,
}

impl RangeScatter {
    /// The reason why this is not the noise of an instrument; `None` if it may be.
    pub(super) fn doubt(&self) -> Option<String> {
        let (low, high) = (NOISES.start(), NOISES.end());
        // Written so that NaN is doubtful.
        if !NOISES.contains(&self.value) {
            return Some(format!("points scatter by {:.4} m, expected {low} to {high} m", self.value));
        }
        if !(0.0..=MAX_DEVIATION * self.value).contains(&self.deviation) {
            return Some(format!(
                "the scatter of {:.4} m is uncertain by {:.4} m",
                self.value, self.deviation
            ));
        }
        self.is_mixed.then(|| {
            "points without class 2 (ground) lie on surfaces of different roughness, such as crowns"
                .to_owned()
        })
    }
}

/// Standard deviation of ranges to smooth ground, including its roughness; `None` without enough points.
///
/// Planes are fitted to the single returns of small cells, of class ground where there are any; the median of
/// their residuals counts, corrected for the degrees of freedom, so that cells with bushes have no effect.
pub fn range_noise(recording: &Recording, solution: &Solution) -> Option<RangeScatter> {
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
    scatter_of_cells(spreads, has_ground)
}

/// The scatter of the median cell; `None` for few cells.
fn scatter_of_cells(mut spreads: Vec<f64>, has_ground: bool) -> Option<RangeScatter> {
    /// Standard deviation of a normal distribution over its median absolute deviation, and that of the
    /// median over that of the mean.
    const OF_MEDIAN_DEVIATION: f64 = 1.4826;
    const OF_MEDIAN: f64 = 1.2533;
    if spreads.len() < MIN_CELLS {
        return None;
    }
    let count = spreads.len() as f64;
    spreads.sort_by(f64::total_cmp);
    let smooth = spreads[spreads.len() / 10];
    let value = median(spreads.iter().copied())?;
    let spread = median(spreads.iter().map(|spread| (spread - value).abs()))?;
    Some(RangeScatter {
        value,
        deviation: OF_MEDIAN * OF_MEDIAN_DEVIATION * spread / count.sqrt(),
        is_mixed: !has_ground && value > MIXED * smooth,
    })
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scatter_of_crowns_is_no_range_noise() {
        let cells =
            |share: usize| (0..200).map(|k| if k % 10 < share { 4.0 } else { 0.02 }).collect::<Vec<f64>>();
        let crowns = scatter_of_cells(cells(8), false).unwrap();
        assert!(crowns.doubt().unwrap().contains("4.0000 m"), "{crowns:?}");
        // Low plants: the value is one of instruments, but cells differ.
        let plants = (0..200).map(|k| if k % 5 < 3 { 0.1 } else { 0.02 }).collect::<Vec<f64>>();
        let plants_without_classes = scatter_of_cells(plants.clone(), false).unwrap();
        assert!(plants_without_classes.doubt().unwrap().contains("different roughness"));
        assert!(scatter_of_cells(plants, true).unwrap().doubt().is_none());
        let ground = scatter_of_cells((0..200).map(|k| 0.02 + 1e-4 * f64::from(k % 20)).collect(), false);
        assert!(ground.unwrap().doubt().is_none() && ground.unwrap().deviation > 0.0);
        assert!(scatter_of_cells(vec![0.02; 5], true).is_none());
    }
}
