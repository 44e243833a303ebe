//! Draws one view of the cloud: projection, nearest point per dot, and shading that emphasises structure.

use super::colour::Colouring;
use crate::chart::{Frame, Picture, Rgb};
use crate::cloud::Points;
use rayon::prelude::*;

/// Each dot of the picture is the mean of `FINE` × `FINE` samples.
const FINE: usize = 2;

/// The position of the viewer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum View {
    /// From above, north at the top.
    Above,
    /// From the south, looking north.
    South,
}

/// A view and its frame on the picture.
pub(super) struct Panel {
    pub(super) view: View,
    pub(super) frame: Frame,
    /// Dots per metre.
    pub(super) scale: f64,
    /// Vertical exaggeration in the view from the south.
    pub(super) exaggeration: f64,
    /// Point at the centre of the panel, relative to the points' origin, m.
    pub(super) centre: [f64; 3],
    /// Lower and upper limits of the points shown, relative to the points' origin, m.
    pub(super) keep: [[f32; 3]; 2],
    /// Loss of colour of the farthest points, 0–1.
    pub(super) haze: f32,
}

/// The nearest point of each sample.
struct Samples {
    width: usize,
    height: usize,
    /// Towards the viewer, in samples; −∞ where there is no point.
    depth: Vec<f32>,
    point: Vec<u32>,
}

/// Projects points to sample coordinates and depth, all in samples.
struct Projection<'a> {
    panel: &'a Panel,
    fine: f64,
}

impl Projection<'_> {
    fn of(&self, p: &[f32; 3]) -> Option<(f64, f64, f32)> {
        let [low, high] = &self.panel.keep;
        if (0..3).any(|a| p[a] < low[a] || p[a] > high[a]) {
            return None;
        }
        let [x, y, z] = [0, 1, 2].map(|a| f64::from(p[a]) - self.panel.centre[a]);
        let (right, up, near) = match self.panel.view {
            View::Above => (x, y, z),
            View::South => (x, z * self.panel.exaggeration, -y),
        };
        let frame = self.panel.frame;
        let fine = FINE as f64;
        let u = 0.5 * f64::from(frame.width) * fine + right * self.fine;
        let v = 0.5 * f64::from(frame.height) * fine - up * self.fine;
        Some((u, v, (near * self.fine) as f32))
    }
}

impl Panel {
    /// Lowest and highest coordinate that the frame shows along an axis of the world, 0 to 2. `origin` is
    /// that of the points, world coordinates.
    pub(super) fn range(&self, axis: usize, origin: [f64; 3]) -> [f64; 2] {
        let (dots, scale) = match axis {
            0 => (self.frame.width, self.scale),
            _ => (self.frame.height, self.scale * self.exaggeration),
        };
        let (middle, half) = (origin[axis] + self.centre[axis], 0.5 * f64::from(dots) / scale);
        [middle - half, middle + half]
    }

    /// Place on the picture of a horizontal position of the world in the view from above, dots.
    pub(super) fn place(&self, origin: [f64; 3], [x, y]: [f64; 2]) -> [f64; 2] {
        let middle = [0, 1].map(|axis| origin[axis] + self.centre[axis]);
        let Frame { x: left, y: top, width, height } = self.frame;
        [
            f64::from(left) + 0.5 * f64::from(width) + (x - middle[0]) * self.scale,
            f64::from(top) + 0.5 * f64::from(height) - (y - middle[1]) * self.scale,
        ]
    }

    /// Draws the panel on `picture`, on a background of colour `ground`.
    pub(super) fn draw(&self, picture: &mut Picture, points: &Points, colouring: &Colouring, ground: Rgb) {
        let samples = self.nearest(points);
        let shade = samples.shade(self.view);
        let (far, near) = samples.depth_range();
        for y in 0..self.frame.height {
            for x in 0..self.frame.width {
                let mut sum = [0u32; 3];
                for (i, j) in (0..FINE * FINE).map(|k| (k % FINE, k / FINE)) {
                    let at = (y as usize * FINE + j) * samples.width + x as usize * FINE + i;
                    let colour = if samples.point[at] == u32::MAX {
                        ground
                    } else {
                        let share = if near > far { (near - samples.depth[at]) / (near - far) } else { 0.0 };
                        let plain = colouring.of(points, samples.point[at] as usize);
                        let lit = plain.map(|c| f32::from(c) * shade[at]);
                        let haze = self.haze * share;
                        std::array::from_fn(|c| {
                            (lit[c] + (f32::from(ground[c]) - lit[c]) * haze).clamp(0.0, 255.0) as u8
                        })
                    };
                    (0..3).for_each(|c| sum[c] += u32::from(colour[c]));
                }
                let mean = sum.map(|s| (s / (FINE * FINE) as u32) as u8);
                picture.set(self.frame.x + x, self.frame.y + y, mean);
            }
        }
    }

    fn nearest(&self, points: &Points) -> Samples {
        let (width, height) = (self.frame.width as usize * FINE, self.frame.height as usize * FINE);
        let projection = Projection { panel: self, fine: self.scale * FINE as f64 };
        let mut samples = Samples {
            width,
            height,
            depth: vec![f32::NEG_INFINITY; width * height],
            point: vec![u32::MAX; width * height],
        };
        let splat = splat(splat_radius(points, &projection, width, height));
        for (i, p) in points.offsets().enumerate() {
            let Some((u, v, depth)) = projection.of(&p) else { continue };
            for &(du, dv, back) in &splat {
                samples.offer((u + du).floor(), (v + dv).floor(), depth - back, i as u32);
            }
        }
        samples
    }
}

/// Radius, in samples, at which points on a surface just touch, derived from the number of points per
/// occupied sample.
fn splat_radius(points: &Points, projection: &Projection, width: usize, height: usize) -> f64 {
    const CELL: usize = 8;
    let (columns, rows) = (width.div_ceil(CELL), height.div_ceil(CELL));
    let mut counts = vec![0u32; columns * rows];
    for (u, v, _) in points.offsets().filter_map(|p| projection.of(&p)) {
        if u >= 0.0 && v >= 0.0 && (u as usize) < width && (v as usize) < height {
            counts[v as usize / CELL * columns + u as usize / CELL] += 1;
        }
    }
    counts.retain(|&n| n > 0);
    counts.sort_unstable();
    // The sparser half of the covered area determines the radius.
    let typical = counts.get(counts.len() * 2 / 5).copied().unwrap_or(1);
    let per_sample = f64::from(typical) / (CELL * CELL) as f64;
    (2.4 / (std::f64::consts::PI * per_sample)).sqrt().clamp(0.5, 5.0 * FINE as f64)
}

/// Offsets of the samples that a disc of `radius` covers, and how far each lies behind the centre of the
/// disc.
fn splat(radius: f64) -> Vec<(f64, f64, f32)> {
    let reach = radius.floor() as i32;
    let mut covered = Vec::new();
    for j in -reach..=reach {
        for i in -reach..=reach {
            let square = f64::from(i * i + j * j);
            if square <= radius * radius {
                covered.push((f64::from(i), f64::from(j), (0.35 * square / radius) as f32));
            }
        }
    }
    covered
}

impl Samples {
    fn offer(&mut self, u: f64, v: f64, depth: f32, point: u32) {
        if u < 0.0 || v < 0.0 || u >= self.width as f64 || v >= self.height as f64 {
            return;
        }
        let at = v as usize * self.width + u as usize;
        if depth > self.depth[at] {
            self.depth[at] = depth;
            self.point[at] = point;
        }
    }

    fn depth_range(&self) -> (f32, f32) {
        self.depth
            .iter()
            .filter(|d| d.is_finite())
            .fold((f32::INFINITY, f32::NEG_INFINITY), |(f, n), &d| (f.min(d), n.max(d)))
    }

    /// Brightness of every sample: dark where neighbours are nearer to the viewer (eye-dome lighting,
    /// Boucheny 2009), and in the view from above lit from the north-west like a map.
    fn shade(&self, view: View) -> Vec<f32> {
        let mut shade: Vec<f32> = self.per_sample(|x, y| self.dome(x, y));
        if view == View::Above {
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

    /// Eye-dome term of a sample, 0–1.
    fn dome(&self, x: usize, y: usize) -> f32 {
        const RINGS: [(isize, f32); 3] = [(1, 0.12), (FINE as isize + 1, 0.3), (4 * FINE as isize, 0.6)];
        const WAYS: [(isize, isize); 8] =
            [(1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1)];
        let own = self.depth[y * self.width + x];
        let mut hidden = 0.0;
        for (reach, weight) in RINGS {
            for (i, j) in WAYS {
                if let Some(depth) =
                    self.depth_at(&self.depth, x as isize + i * reach, y as isize + j * reach)
                {
                    let steepness = (depth - own) / reach as f32;
                    hidden += weight * (steepness - 0.15).clamp(0.0, 2.5);
                }
            }
        }
        libm::expf(-0.1 * hidden)
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

    fn blurred(&self, source: &[f32], reach: isize, axis: (isize, isize)) -> Vec<f32> {
        let mut blurred = self.per_sample(|x, y| {
            let near = |k: isize| self.depth_at(source, x as isize + axis.0 * k, y as isize + axis.1 * k);
            let (sum, count) =
                (-reach..=reach).filter_map(near).fold((0.0, 0.0), |(sum, count), d| (sum + d, count + 1.0));
            sum / count
        });
        for (depth, point) in blurred.iter_mut().zip(&self.point) {
            if *point == u32::MAX {
                *depth = f32::NEG_INFINITY;
            }
        }
        blurred
    }

    fn depth_at(&self, depth: &[f32], x: isize, y: isize) -> Option<f32> {
        let inside = x >= 0 && y >= 0 && (x as usize) < self.width && (y as usize) < self.height;
        let d = if inside { depth[y as usize * self.width + x as usize] } else { f32::NEG_INFINITY };
        d.is_finite().then_some(d)
    }
}
