//! Draws one view of the cloud: projection, and colours of the nearest points.

use super::colour::Colouring;
use super::samples::{FINE, Samples};
use crate::chart::{Frame, Picture, Rgb};
use crate::cloud::Points;

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
        let shade = samples.shade(self.view == View::Above);
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
        let mut samples = Samples::new(width, height);
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
