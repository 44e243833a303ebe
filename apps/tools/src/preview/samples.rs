//! The samples of a view: the nearest point of each, and shading that emphasises structure.
//!
//! Shading takes most of the time of a picture. It works through whole rows of neighbours, which compilers
//! turn into vector instructions. The sums of a sample have the same terms in the same order as if it were
//! computed alone.

use rayon::prelude::*;
use std::ops::Range;

/// Each dot of the picture is the mean of `FINE` × `FINE` samples.
pub(super) const FINE: usize = 2;

/// The nearest point of each sample.
pub(super) struct Samples {
    pub width: usize,
    height: usize,
    /// Towards the viewer, in samples; −∞ where there is no point.
    pub depth: Vec<f32>,
    /// Index of the point; [`u32::MAX`] where there is none.
    pub point: Vec<u32>,
}

/// Distances of neighbours, in samples, and their weights in the eye-dome term.
const RINGS: [(isize, f32); 3] = [(1, 0.12), (FINE as isize + 1, 0.3), (4 * FINE as isize, 0.6)];
/// Directions of neighbours.
const WAYS: [(isize, isize); 8] = [(1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1)];

impl Samples {
    /// Samples without points.
    pub fn new(width: usize, height: usize) -> Samples {
        let count = width * height;
        Samples { width, height, depth: vec![f32::NEG_INFINITY; count], point: vec![u32::MAX; count] }
    }

    /// Shows a point in the sample at (u, v) if it is the nearest one there.
    pub fn offer(&mut self, u: f64, v: f64, depth: f32, point: u32) {
        if u < 0.0 || v < 0.0 || u >= self.width as f64 || v >= self.height as f64 {
            return;
        }
        let at = v as usize * self.width + u as usize;
        if depth > self.depth[at] {
            self.depth[at] = depth;
            self.point[at] = point;
        }
    }

    /// The smallest and the largest depth of a point.
    pub fn depth_range(&self) -> (f32, f32) {
        self.depth
            .iter()
            .filter(|d| d.is_finite())
            .fold((f32::INFINITY, f32::NEG_INFINITY), |(f, n), &d| (f.min(d), n.max(d)))
    }

    /// Brightness of every sample: dark where neighbours are nearer to the viewer (eye-dome lighting,
    /// Boucheny 2009), and, if `has_sun` is set, lit from the north-west like a map.
    pub fn shade(&self, has_sun: bool) -> Vec<f32> {
        let mut shade = self.dome();
        if has_sun {
            let sun = self.sun();
            shade.iter_mut().zip(sun).for_each(|(s, light)| *s *= light);
        }
        // The exposure makes the mean brightness independent of the structure of the cloud.
        let covered = self.point.iter().filter(|p| **p != u32::MAX).count().max(1);
        let mean = shade.iter().map(|s| f64::from(*s)).sum::<f64>() / covered as f64;
        let exposure = (0.8 / mean).clamp(0.8, 2.2) as f32;
        shade.iter_mut().for_each(|s| *s = (*s * exposure).min(1.2));
        shade
    }

    /// Evaluates `value` for every sample that shows a point; 0 elsewhere.
    fn per_sample(&self, value: impl Fn(usize, usize) -> f32 + Sync) -> Vec<f32> {
        let mut values = vec![0.0; self.depth.len()];
        values.par_chunks_mut(self.width).enumerate().for_each(|(y, row)| {
            for (x, v) in row.iter_mut().enumerate() {
                if self.point[y * self.width + x] != u32::MAX {
                    *v = value(x, y);
                }
            }
        });
        values
    }

    /// The columns of row `y` whose neighbours (i, j) samples away are in the picture, and the index of the
    /// first one's neighbour. The other neighbours follow it.
    fn neighbours(&self, y: usize, (i, j): (isize, isize)) -> Option<(Range<usize>, usize)> {
        let other = y.checked_add_signed(j).filter(|other| *other < self.height)?;
        let (left, right) = (i.min(0).unsigned_abs(), i.max(0).unsigned_abs());
        let end = self.width.checked_sub(right).filter(|end| left < *end)?;
        Some((left..end, other * self.width + right))
    }

    /// Eye-dome term of every sample that shows a point, 0–1; 0 elsewhere.
    fn dome(&self) -> Vec<f32> {
        let mut hidden = vec![0.0_f32; self.depth.len()];
        hidden.par_chunks_mut(self.width).enumerate().for_each(|(y, row)| {
            let own = &self.depth[y * self.width..][..self.width];
            let shown = &self.point[y * self.width..][..self.width];
            for (reach, weight) in RINGS {
                for (i, j) in WAYS {
                    let Some((columns, at)) = self.neighbours(y, (i * reach, j * reach)) else { continue };
                    let others = &self.depth[at..at + columns.len()];
                    let own = &own[columns.clone()];
                    for ((hidden, own), other) in row[columns].iter_mut().zip(own).zip(others) {
                        let steepness = (other - own) / reach as f32;
                        let term = weight * (steepness - 0.15).clamp(0.0, 2.5);
                        *hidden += if other.is_finite() { term } else { 0.0 };
                    }
                }
            }
            for (hidden, point) in row.iter_mut().zip(shown) {
                *hidden = if *point == u32::MAX { 0.0 } else { libm::expf(-0.1 * *hidden) };
            }
        });
        hidden
    }

    /// Light from the upper left on the smoothed surface; about 1. Slopes are scaled to the relief of the
    /// cloud, so that plains show their folds and canopies do not become black and white.
    fn sun(&self) -> Vec<f32> {
        let fine = self.smoothed(FINE);
        let coarse = self.smoothed(5 * FINE);
        let slopes = |axis: (isize, isize)| {
            self.per_sample(|x, y| {
                let along = |depth: &[f32], reach: isize| {
                    let at = |k: isize| {
                        self.depth_at(depth, x as isize + axis.0 * k * reach, y as isize + axis.1 * k * reach)
                    };
                    at(-1).zip(at(1)).map_or(0.0, |(a, b)| (b - a) / (2 * reach) as f32)
                };
                0.4 * along(&fine, FINE as isize) + 0.6 * along(&coarse, 2 * FINE as isize)
            })
        };
        let (east, south) = (slopes((1, 0)), slopes((0, 1)));
        let square: f64 = east.iter().zip(&south).map(|(e, s)| f64::from(e * e + s * s)).sum();
        let covered = self.point.iter().filter(|p| **p != u32::MAX).count().max(1);
        let typical = (square / covered as f64).sqrt();
        let scale = (0.6 / typical.max(1e-9)).clamp(0.25, 6.0) as f32;
        self.per_sample(|x, y| {
            let at = y * self.width + x;
            let (east, south) = (east[at] * scale, south[at] * scale);
            // The normal is (−east, −south, 1); the light comes from (−1, −1, 1.6) in picture coordinates.
            let length = (east * east + south * south + 1.0).sqrt() * 2.135;
            let light = (east + south + 1.6) / length;
            0.45 + 0.75 * light.max(0.0)
        })
    }

    /// Mean depth over the samples that show a point in the square within `reach`.
    fn smoothed(&self, reach: usize) -> Vec<f32> {
        let rows = self.blurred(&self.depth, reach as isize, (1, 0));
        self.blurred(&rows, reach as isize, (0, 1))
    }

    /// Mean of a value over the samples that have one within `reach` along an axis; −∞ where there is no
    /// point.
    fn blurred(&self, source: &[f32], reach: isize, axis: (isize, isize)) -> Vec<f32> {
        let mut blurred = vec![0.0_f32; source.len()];
        let rows = blurred.par_chunks_mut(self.width).enumerate();
        rows.for_each_init(Vec::new, |counts: &mut Vec<f32>, (y, row)| {
            counts.clear();
            counts.resize(row.len(), 0.0);
            for k in -reach..=reach {
                let Some((columns, at)) = self.neighbours(y, (axis.0 * k, axis.1 * k)) else { continue };
                let others = &source[at..at + columns.len()];
                let sums = row[columns.clone()].iter_mut().zip(&mut counts[columns]);
                for ((sum, count), other) in sums.zip(others) {
                    let (value, one) = if other.is_finite() { (*other, 1.0) } else { (0.0, 0.0) };
                    *sum += value;
                    *count += one;
                }
            }
            let shown = &self.point[y * self.width..][..row.len()];
            for ((value, count), point) in row.iter_mut().zip(counts.iter()).zip(shown) {
                *value = if *point == u32::MAX { f32::NEG_INFINITY } else { *value / count };
            }
        });
        blurred
    }

    fn depth_at(&self, depth: &[f32], x: isize, y: isize) -> Option<f32> {
        let inside = x >= 0 && y >= 0 && (x as usize) < self.width && (y as usize) < self.height;
        let d = if inside { depth[y as usize * self.width + x as usize] } else { f32::NEG_INFINITY };
        d.is_finite().then_some(d)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Samples of which two thirds show a point, at depths without an order.
    fn scattered(width: usize, height: usize) -> Samples {
        let mut samples = Samples::new(width, height);
        let mut state = 7_u32;
        for at in 0..width * height {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            if !state.is_multiple_of(3) {
                let (u, v) = (at % width, at / width);
                samples.offer(u as f64, v as f64, (state >> 8) as f32 * 1e-5 - 60.0, at as u32);
            }
        }
        samples
    }

    /// Compares values bit by bit.
    fn assert_same(found: &[f32], expected: &[f32]) {
        let bits = |values: &[f32]| values.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(found), bits(expected));
    }

    #[test]
    fn rows_of_neighbours_give_the_bits_of_single_samples() {
        // The second is narrower than the farthest neighbours.
        for (width, height) in [(37, 23), (5, 9)] {
            let samples = scattered(width, height);
            let at = |source: &[f32], x: usize, y: usize, (i, j): (isize, isize)| {
                samples.depth_at(source, x as isize + i, y as isize + j)
            };
            let dome = samples.per_sample(|x, y| {
                let mut hidden = 0.0;
                for (reach, weight) in RINGS {
                    for (i, j) in WAYS {
                        if let Some(depth) = at(&samples.depth, x, y, (i * reach, j * reach)) {
                            let steepness = (depth - samples.depth[y * width + x]) / reach as f32;
                            hidden += weight * (steepness - 0.15).clamp(0.0, 2.5);
                        }
                    }
                }
                libm::expf(-0.1 * hidden)
            });
            assert_same(&samples.dome(), &dome);
            for (reach, axis) in [(2, (1, 0)), (10, (0, 1)), (10, (1, 0))] {
                let mut mean = samples.per_sample(|x, y| {
                    let values =
                        (-reach..=reach).filter_map(|k| at(&samples.depth, x, y, (axis.0 * k, axis.1 * k)));
                    let (sum, count) = values.fold((0.0, 0.0), |(sum, count), d| (sum + d, count + 1.0));
                    sum / count
                });
                let hidden = mean.iter_mut().zip(&samples.point).filter(|(_, point)| **point == u32::MAX);
                hidden.for_each(|(value, _)| *value = f32::NEG_INFINITY);
                assert_same(&samples.blurred(&samples.depth, reach, axis), &mean);
            }
        }
    }

    #[test]
    fn the_nearest_point_of_a_sample_is_shown() {
        let mut samples = Samples::new(2, 1);
        samples.offer(1.5, 0.0, 3.0, 7);
        samples.offer(1.0, 0.0, 2.0, 8);
        samples.offer(2.0, 0.0, 9.0, 9);
        assert_eq!((samples.point.as_slice(), samples.depth_range()), (&[u32::MAX, 7][..], (3.0, 3.0)));
        let shade = samples.shade(true);
        assert!(shade[0] == 0.0 && shade[1] > 0.0, "{shade:?}");
    }
}
