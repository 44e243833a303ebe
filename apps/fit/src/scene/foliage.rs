//! Foliage as voxels: leaf area density by the law of Beer and Lambert from the losses of beams.
//!
//! A return k of a pulse with n returns has intercepted 1/n of the beam, and (n − k)/n continues. In every
//! voxel the intercepted shares are added up, and so are the lengths of the beams within it, each weighted by
//! the share that is left there. Their ratio is the estimate of the extinction σ with the greatest likelihood
//! where paths are exponentially distributed (Pimont et al. 2018, *Estimators and confidence intervals for
//! plant area density at voxel scale with T-LiDAR*, Remote Sensing of Environment 215), and the leaf area
//! density is σ/G with G = 1/2 for leaves that face all directions alike. Both sums are smoothed over
//! neighbouring columns, along the ground or the canopy and never up or down, since tops of crowns are sharp.
//! The result of one level of smoothing is the prior of the next finer one (a gamma distribution, conjugate
//! to exponential paths). Surface and weight of the prior are chosen by the likelihood of a quarter of the
//! pulses, given the other three quarters.

use super::recording::{Recording, Return, Target};
use super::sensor::SensorPath;
use super::smoothing::smoothed;
use rayon::prelude::*;
use vlscan_geom::DVec3;
use vlscan_tools::neighbours::Neighbours;

/// Mean projection of leaves that face all directions alike.
pub(super) const PROJECTION: f64 = 0.5;
/// Maximum number of voxels of the grid, filled or not: a minimum for few points, and more for each point.
/// Work and memory grow with the points, not with the area over which they are spread.
const MAX_VOXELS: f64 = 40e6;
const MIN_VOXELS: f64 = 4e6;
const VOXELS_PER_POINT: f64 = 256.0;
/// Extinction below which a voxel is empty, 1/m.
const MIN_EXTINCTION: f32 = 4e-3;
/// Extinction above which a voxel is as good as opaque, 1/m.
const MAX_EXTINCTION: f32 = 20.0;

/// A voxel that holds foliage.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LeafVoxel {
    /// Indices along x, y and z.
    pub index: [u32; 3],
    /// One-sided leaf area density, m²/m³.
    pub density: f64,
    /// Class of the points.
    pub class: u8,
}

/// Foliage of a place.
#[derive(Clone, Debug, Default)]
pub struct Foliage {
    /// Minimum corner of the grid, m.
    pub min: DVec3,
    /// Edge of a voxel, m.
    pub size: f64,
    /// Voxels along each axis.
    pub cells: [usize; 3],
    /// Voxels with foliage, in the order of x, y, z.
    pub voxels: Vec<LeafVoxel>,
}

impl Foliage {
    /// Leaf area of all voxels, m².
    pub fn leaf_area(&self) -> f64 {
        self.voxels.iter().map(|v| v.density).sum::<f64>() * self.size.powi(3)
    }
}

/// Edge of voxels, at least `size`, at which a box has at most `most` voxels, m.
fn size_within(extent: DVec3, size: f64, most: f64) -> f64 {
    let voxels = |size: f64| {
        let cells = extent / size + 3.0;
        cells.x * cells.y * cells.z
    };
    let around = extent + 3.0 * size;
    let mut size = size.max((around.x * around.y * around.z / most).cbrt());
    // In a flat box most voxels are in the layers around it. The loop ends: 27 voxels are the minimum.
    while voxels(size) > (2.0 * most).max(64.0) {
        size *= 1.25;
    }
    size
}

/// A grid of voxels with a number for each.
#[derive(Clone)]
pub(super) struct Grid {
    pub min: DVec3,
    pub size: f64,
    pub cells: [usize; 3],
}

impl Grid {
    /// The grid around `positions`, of voxels of that size, or larger ones if they were too many, about
    /// `max_voxels` at most; `None` without positions.
    fn around(positions: impl Iterator<Item = DVec3>, size: f64, max_voxels: f64) -> Option<Grid> {
        let none = (DVec3::INFINITY, DVec3::NEG_INFINITY, 0.0);
        let (min, max, count) = positions.fold(none, |(a, b, n), p| (a.min(p), b.max(p), n + 1.0));
        if !min.is_finite() {
            return None;
        }
        let most = (MIN_VOXELS + VOXELS_PER_POINT * count).min(MAX_VOXELS).min(max_voxels);
        let size = size_within(max - min, size, most);
        let min = ((min / size).floor() - 1.0) * size;
        let cells = ((max - min) / size).floor() + 2.0;
        Some(Grid { min, size, cells: [cells.x as usize, cells.y as usize, cells.z as usize] })
    }

    pub fn len(&self) -> usize {
        self.cells[0] * self.cells[1] * self.cells[2]
    }

    pub fn number(&self, [i, j, k]: [usize; 3]) -> usize {
        (i * self.cells[1] + j) * self.cells[2] + k
    }

    fn index(&self, number: usize) -> [usize; 3] {
        [
            number / self.cells[2] / self.cells[1],
            number / self.cells[2] % self.cells[1],
            number % self.cells[2],
        ]
    }

    /// Number of the voxel at the surface of each column, of columns in the order of x, y.
    fn levels_of(&self, surface: impl Fn(f64, f64) -> f64 + Sync) -> Vec<i32> {
        let column = |c: usize| {
            let (i, j) = (c / self.cells[1], c % self.cells[1]);
            let [x, y] =
                [(i, self.min.x), (j, self.min.y)].map(|(n, min)| min + (n as f64 + 0.5) * self.size);
            ((surface(x, y) - self.min.z) / self.size).round() as i32
        };
        (0..self.cells[0] * self.cells[1]).into_par_iter().map(column).collect()
    }

    fn containing(&self, p: DVec3) -> Option<usize> {
        let q = (p - self.min) / self.size;
        let index = [q.x, q.y, q.z].map(|v| v.floor() as i64);
        let is_within = index.iter().zip(self.cells).all(|(v, n)| *v >= 0 && (*v as usize) < n);
        is_within.then(|| self.number(index.map(|v| v as usize)))
    }

    /// Visits the voxels along `origin` + t·`direction` up to `end` m with the t at which the beam enters and
    /// leaves them (Amanatides and Woo 1987, *A fast voxel traversal algorithm for ray tracing*).
    pub fn along(&self, origin: DVec3, direction: DVec3, end: f64, mut visit: impl FnMut(usize, f64, f64)) {
        let max = self.min
            + DVec3::new(self.cells[0] as f64, self.cells[1] as f64, self.cells[2] as f64) * self.size;
        let (mut from, mut to) = (0.0f64, end);
        for axis in 0..3 {
            let (o, d) = (origin[axis], direction[axis]);
            if d == 0.0 {
                if o < self.min[axis] || o >= max[axis] {
                    return;
                }
                continue;
            }
            let (a, b) = ((self.min[axis] - o) / d, (max[axis] - o) / d);
            (from, to) = (from.max(a.min(b)), to.min(a.max(b)));
        }
        if from >= to {
            return;
        }
        let start = origin + direction * (from + 1e-9);
        let mut index = [0i64; 3];
        let (mut next, mut step) = ([f64::INFINITY; 3], [f64::INFINITY; 3]);
        for axis in 0..3 {
            let q = ((start[axis] - self.min[axis]) / self.size).floor() as i64;
            index[axis] = q.clamp(0, self.cells[axis] as i64 - 1);
            let d = direction[axis];
            if d != 0.0 {
                let border = self.min[axis] + (index[axis] + i64::from(d > 0.0)) as f64 * self.size;
                (next[axis], step[axis]) = ((border - origin[axis]) / d, self.size / d.abs());
            }
        }
        let mut t = from;
        while t < to {
            let axis = (0..3).min_by(|a, b| next[*a].total_cmp(&next[*b])).unwrap_or(0);
            let leave = next[axis].min(to);
            if leave > t {
                visit(self.number(index.map(|v| v as usize)), t, leave);
            }
            t = t.max(leave);
            index[axis] += if direction[axis] > 0.0 { 1 } else { -1 };
            next[axis] += step[axis];
            if index[axis] < 0 || index[axis] >= self.cells[axis] as i64 {
                return;
            }
        }
    }
}

/// The beam of a recorded pulse.
#[derive(Clone, Copy, Debug)]
pub(super) struct Beam {
    pub origin: DVec3,
    pub direction: DVec3,
    /// Distance to its last known return, m.
    pub length: f64,
}

/// The beam through the last known return of a pulse.
pub(super) fn beam(recording: &Recording, pulse: usize, path: &SensorPath) -> Beam {
    let last = recording.of_pulse(pulse)[recording.of_pulse(pulse).len() - 1];
    let origin = path.at(last.time);
    let length = (last.position - origin).length();
    Beam { origin, direction: (last.position - origin) / length.max(1e-9), length }
}

/// Losses of beams in each voxel, and their path lengths through it.
struct Sums {
    hits: Vec<f32>,
    lengths: Vec<f32>,
}

/// Extinctions of the voxels of a place, 1/m.
pub(super) struct Extinctions {
    pub grid: Grid,
    pub sigma: Vec<f32>,
    /// Class that intercepts most light in each voxel with returns, [`NO_CLASS`] for others.
    classes: Vec<u8>,
    /// Length of beams, m, for which the next coarser level of smoothing counts.
    pub prior: f64,
    /// True if smoothing follows the canopy rather than the ground.
    pub along_canopy: bool,
}

const NO_CLASS: u8 = u8::MAX;

/// Voxels whose likelihoods are computed before they are summed.
const SUMMED_VOXELS: usize = 1 << 16;

/// Passes of smoothing of the levels, finest first; that one has none.
const PASSES: [usize; 4] = [0, 2, 6, 18];
/// Lengths of beam that the coarser level may weigh, m; the likelihood of the pulses that are held out
/// decides.
const PRIOR_LENGTHS: [f64; 6] = [0.1, 0.3, 1.0, 3.0, 10.0, 30.0];

/// The extinctions by all pulses of a recording, and those by all but the ones that are held out; `None`
/// without foliage. `is_leaf` is true for returns from foliage, `terrain` is the terrain height. Voxels have
/// this size, m, or a larger one if there were more than the maximum number.
pub(super) fn extinctions(
    recording: &Recording,
    paths: &[SensorPath],
    is_leaf: &[bool],
    (size, max_voxels): (f64, f64),
    terrain: impl Fn(f64, f64) -> f64 + Sync,
) -> Option<[Extinctions; 2]> {
    let leaves = recording.returns.iter().zip(is_leaf).filter(|(_, leaf)| **leaf);
    let grid = Grid::around(leaves.map(|(r, _)| r.position), size, max_voxels)?;
    let ground = grid.levels_of(&terrain);
    let classes = classes(recording, is_leaf, &grid);
    let left_out = sums(recording, paths, is_leaf, &grid, |pulse| recording.is_held_out[pulse]);
    let mut all = sums(recording, paths, is_leaf, &grid, |pulse| !recording.is_held_out[pulse]);
    let crowns = |counts: &dyn Fn(usize) -> bool| grid.levels_of(canopy(recording, counts));
    // Alignment and prior for which the pulses that are held out are most likely.
    let passed = left_out.passed();
    let mut best = (f64::NEG_INFINITY, false, 0.0, Vec::new());
    for along_canopy in [false, true] {
        let surface =
            if along_canopy { crowns(&|pulse| !recording.is_held_out[pulse]) } else { ground.clone() };
        let levels = Levels::of(&all, &grid, &surface);
        let mut better: Option<(f64, f64)> = None;
        for prior in PRIOR_LENGTHS {
            let likelihood = left_out.log_likelihood(&passed, |voxel| levels.extinction(voxel, prior));
            if likelihood > better.map_or(best.0, |(likelihood, _)| likelihood) {
                better = Some((likelihood, prior));
            }
        }
        if let Some((likelihood, prior)) = better {
            best = (likelihood, along_canopy, prior, levels.extinctions(prior));
        }
    }
    let (_, along_canopy, prior, of_rest) = best;
    all.hits.iter_mut().zip(&left_out.hits).for_each(|(a, b)| *a += b);
    all.lengths.iter_mut().zip(&left_out.lengths).for_each(|(a, b)| *a += b);
    drop((left_out, passed));
    let surface = if along_canopy { crowns(&|_| true) } else { ground };
    let sigma = Levels::of(&all, &grid, &surface).extinctions(prior);
    let by_rest =
        Extinctions { grid: grid.clone(), sigma: of_rest, classes: Vec::new(), prior, along_canopy };
    Some([Extinctions { sigma, classes, prior, along_canopy, grid }, by_rest])
}

/// The class that intercepts most light in each voxel.
fn classes(recording: &Recording, is_leaf: &[bool], grid: &Grid) -> Vec<u8> {
    let leaves = recording.returns.iter().zip(is_leaf).filter(|(_, leaf)| **leaf);
    // Voxel, class and returns of the pulse.
    let leaf = |(r, _): (&Return, &bool)| Some((grid.containing(r.position)? as u32, r.class, r.of));
    let mut leaves: Vec<(u32, u8, u8)> = leaves.filter_map(leaf).collect();
    leaves.sort_by_key(|(voxel, class, _)| (*voxel, *class));
    let mut classes = vec![NO_CLASS; grid.len()];
    for of_voxel in leaves.chunk_by(|a, b| a.0 == b.0) {
        let shares = of_voxel.chunk_by(|a, b| a.1 == b.1).map(|of_class| {
            let share = of_class.iter().fold(0.0_f32, |sum, (_, _, of)| sum + 1.0 / f32::from(*of));
            (of_class[0].1, share)
        });
        let most = shares.max_by(|a, b| a.1.total_cmp(&b.1));
        classes[of_voxel[0].0 as usize] = most.map_or(NO_CLASS, |(class, _)| class);
    }
    classes
}

/// Height of the canopy: the mean of the first returns that are nearest, of the pulses that `counts` selects.
fn canopy(recording: &Recording, counts: &dyn Fn(usize) -> bool) -> impl Fn(f64, f64) -> f64 + Sync + use<> {
    const NEAREST: usize = 4;
    let pulses = (0..recording.pulses()).filter(|pulse| counts(*pulse));
    let firsts: Vec<DVec3> = pulses.map(|pulse| recording.of_pulse(pulse)[0].position).collect();
    let neighbours = Neighbours::of(firsts);
    move |x, y| {
        let near = neighbours.nearest(x, y, NEAREST, None);
        let weights = near.iter().map(|(square, _)| 1.0 / (square + 0.01));
        let add =
            |[s, n]: [f64; 2], ((_, i), w): (&(f64, usize), f64)| [s + w * neighbours.points()[*i].z, n + w];
        let sums = near.iter().zip(weights).fold([0.0; 2], add);
        sums[0] / sums[1]
    }
}

/// Intercepted shares and lengths of the pulses that `counts` selects.
fn sums(
    recording: &Recording,
    paths: &[SensorPath],
    is_leaf: &[bool],
    grid: &Grid,
    counts: impl Fn(usize) -> bool,
) -> Sums {
    let mut sums = Sums { hits: vec![0.0; grid.len()], lengths: vec![0.0; grid.len()] };
    for (line, path) in recording.lines.iter().zip(paths) {
        for pulse in line.pulses.clone().filter(|pulse| counts(*pulse)) {
            let beam = beam(recording, pulse, path);
            let mut from = 0.0;
            for i in recording.range(pulse) {
                let r = &recording.returns[i];
                let (share, left) = (1.0 / f32::from(r.of), f32::from(r.of - r.number + 1) / f32::from(r.of));
                let t = (r.position - beam.origin).dot(beam.direction);
                grid.along(beam.origin, beam.direction, t, |voxel, enter, leave| {
                    let length = leave - enter.max(from);
                    if length > 0.0 {
                        sums.lengths[voxel] += left * length as f32;
                    }
                });
                from = t;
                if is_leaf[i]
                    && let Some(voxel) = grid.containing(r.position)
                {
                    sums.hits[voxel] += share;
                }
            }
        }
    }
    sums
}

impl Sums {
    /// Replaces both sums by means over 3 by 3 columns with the weights 1, 2, 1 along x and y, at the same
    /// height over the ground: `ground` is the number of the voxel at the ground of each column. `spare` has
    /// as many values, of any content.
    fn smooth(&mut self, grid: &Grid, ground: &[i32], spare: &mut Vec<f32>) {
        for values in [&mut self.hits, &mut self.lengths] {
            smoothed(grid.cells, ground, values, spare);
            std::mem::swap(values, spare);
        }
    }

    /// The voxels that beams have passed, in their order.
    fn passed(&self) -> Vec<u32> {
        (0..).zip(&self.lengths).filter(|(_, length)| **length > 0.0).map(|(voxel, _)| voxel).collect()
    }

    /// Log-likelihood of the sums of the voxels that beams have `passed`, given extinctions from other
    /// pulses.
    fn log_likelihood(&self, passed: &[u32], sigma: impl Fn(usize) -> f32 + Sync) -> f64 {
        let of = |voxel: &u32| {
            let voxel = *voxel as usize;
            let s = f64::from(sigma(voxel).max(MIN_EXTINCTION));
            f64::from(self.hits[voxel]) * libm::log(s) - f64::from(self.lengths[voxel]) * s
        };
        // The order of the sum does not depend on the threads.
        let mut terms: Vec<f64> = Vec::new();
        passed.chunks(SUMMED_VOXELS).fold(0.0, |sum, voxels| {
            voxels.par_iter().map(of).collect_into_vec(&mut terms);
            terms.iter().fold(sum, |sum, term| sum + term)
        })
    }
}

/// Sums at several levels of smoothing.
struct Levels<'s> {
    /// The finest level, which is not smoothed.
    finest: &'s Sums,
    /// The others, finest first, with the number of voxels that count at each.
    smooth: Vec<(Sums, f64)>,
}

impl<'s> Levels<'s> {
    fn of(finest: &'s Sums, grid: &Grid, ground: &[i32]) -> Levels<'s> {
        let mut smooth: Vec<(Sums, f64)> = Vec::new();
        let mut spare = vec![0.0; grid.len()];
        for passes in PASSES.windows(2) {
            let before = smooth.last().map_or(finest, |(sums, _)| sums);
            let mut sums = Sums { hits: before.hits.clone(), lengths: before.lengths.clone() };
            (passes[0]..passes[1]).for_each(|_| sums.smooth(grid, ground, &mut spare));
            // A kernel of the variance n/2 along both axes counts as many voxels as lie in 4π times it.
            let count = (2.0 * std::f64::consts::PI * passes[1] as f64).max(1.0);
            smooth.push((sums, count));
        }
        Levels { finest, smooth }
    }

    /// Extinctions of the finest level, where each has the next coarser one for a prior that counts like
    /// `prior` metres of beams: the mean of a gamma distribution, which is conjugate to exponential paths.
    fn extinctions(&self, prior: f64) -> Vec<f32> {
        (0..self.finest.hits.len()).into_par_iter().map(|voxel| self.extinction(voxel, prior)).collect()
    }

    /// The extinction of a voxel.
    fn extinction(&self, voxel: usize, prior: f64) -> f32 {
        let mut sigma: Option<f32> = None;
        let mut refine = |sums: &Sums, count: f64| {
            let (hit, length) = (sums.hits[voxel], sums.lengths[voxel]);
            // The coarsest level has no prior.
            let (weight, before) = sigma.map_or((0.0, 0.0), |sigma| ((prior / count) as f32, sigma));
            let has_beams = length + weight > 0.0;
            sigma = Some(if has_beams { (hit + weight * before) / (length + weight) } else { 0.0 });
        };
        self.smooth.iter().rev().for_each(|(sums, count)| refine(sums, *count));
        refine(self.finest, 1.0);
        sigma.filter(|sigma| *sigma >= MIN_EXTINCTION).map_or(0.0, |sigma| sigma.min(MAX_EXTINCTION))
    }
}

impl Extinctions {
    /// The voxels with foliage; `factor` scales the extinction of the voxel around a point.
    pub fn foliage(&self, factor: impl Fn(DVec3) -> f64 + Sync) -> Foliage {
        let grid = &self.grid;
        let filled = self.sigma.par_iter().enumerate().filter(|(_, sigma)| **sigma > 0.0);
        let voxel = |(number, sigma): (usize, &f32)| {
            let index = grid.index(number);
            let [i, j, k] = index.map(|i| i as f64 + 0.5);
            let density = f64::from(*sigma) * factor(grid.min + DVec3::new(i, j, k) * grid.size) / PROJECTION;
            LeafVoxel { index: index.map(|i| i as u32), density, class: self.class(number, index) }
        };
        Foliage { min: grid.min, size: grid.size, cells: grid.cells, voxels: filled.map(voxel).collect() }
    }

    /// The class of most of the light from a voxel and, where it has none of its own, that of the nearest one
    /// that has.
    fn class(&self, number: usize, index: [usize; 3]) -> u8 {
        if self.classes[number] != NO_CLASS {
            return self.classes[number];
        }
        for radius in 1..=PASSES[PASSES.len() - 1] as i64 {
            let mut best = (i64::MAX, NO_CLASS);
            let range = -radius..=radius;
            for (di, dj) in range.clone().flat_map(|di| range.clone().map(move |dj| (di, dj))) {
                // Only what lies on the surface of the cube.
                let is_side = di.abs() == radius || dj.abs() == radius;
                let step = if is_side { 1 } else { 2 * radius as usize };
                for dk in range.clone().step_by(step) {
                    let at = [index[0] as i64 + di, index[1] as i64 + dj, index[2] as i64 + dk];
                    let square = di * di + dj * dj + dk * dk;
                    if square >= best.0 || (0..3).any(|a| at[a] < 0 || at[a] >= self.grid.cells[a] as i64) {
                        continue;
                    }
                    let class = self.classes[self.grid.number(at.map(|v| v as usize))];
                    if class != NO_CLASS {
                        best = (square, class);
                    }
                }
            }
            if best.1 != NO_CLASS {
                return best.1;
            }
        }
        1
    }
}

/// Marks the returns from foliage: those of no surface, except unclassified ones as near to the terrain as
/// ground points.
pub(super) fn leaf_returns(recording: &Recording, near_terrain: impl Fn(DVec3) -> bool + Sync) -> Vec<bool> {
    let is_leaf = |r: &Return| r.target() == Target::Foliage && !(r.class <= 1 && near_terrain(r.position));
    recording.returns.iter().map(is_leaf).collect()
}

#[cfg(test)]
mod tests;
