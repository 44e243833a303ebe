//! Tracing of rays that come one by one, each with its own origin.

use super::{Geometry, Hit, Hits, RayGroup, TraceScratch, Tree};
use vlscan_geom::DVec3;

/// Maximum difference of two rays that are traced together: in each component of the direction, and of the
/// origin in metres.
const MAX_DISTANCE: (f64, f64) = (0.02, 1.0);
/// Minimum number of consecutive rays that are traced together; fewer are faster one by one.
const MIN_RUN: usize = 8;
/// Number of rays whose hits are taken over at once.
const MAX_WAITING: usize = 4096;
/// Mean length of runs from which on rays are traced in their own order; sorting costs as much as tracing
/// them.
const LONG_RUN: usize = 16;
/// Number of rays that are sorted together.
const BLOCK: usize = 1 << INDEX_BITS;
/// Bits of the number of a ray in its block.
const INDEX_BITS: u32 = 14;
/// Bits of each component of a direction in the key of a ray.
const WAY_BITS: u32 = 10;
/// Bits of each component of an origin, in steps of [`MAX_DISTANCE`]; farther ones begin again at zero.
const PLACE_BITS: u32 = 6;

impl Tree {
    /// First hits of rays `origins[i] + t·directions[i]`, as [`Tree::nearest_where`] finds them, bit for bit;
    /// if there are more origins than directions, or fewer, the rest is left out. Rays may come in any order:
    /// those of a block that are neighbours are traced together. They are traced fastest where consecutive
    /// ones are neighbours.
    ///
    /// ```
    /// use vlscan_trace::{BuildOptions, DVec3, Geometry, TraceScratch, Tree};
    ///
    /// let mesh = Geometry {
    ///     vertices: vec![DVec3::ZERO, DVec3::X, DVec3::Y],
    ///     triangles: vec![[0, 1, 2]],
    ///     ..Geometry::default()
    /// };
    /// let tree = Tree::try_build(&mesh, &BuildOptions::default())?;
    /// let origins = [DVec3::new(0.2, 0.2, 5.0), DVec3::new(2.0, 2.0, 5.0)];
    /// let hits = tree.trace_rays(&mesh, &origins, &[-DVec3::Z; 2], &mut TraceScratch::default());
    /// assert_eq!(hits.iter().map(|hit| hit.map(|hit| hit.t)).collect::<Vec<_>>(), [Some(5.0), None]);
    /// # Ok::<(), vlscan_trace::GeometryError>(())
    /// ```
    pub fn trace_rays(
        &self,
        geometry: &Geometry,
        origins: &[DVec3],
        directions: &[DVec3],
        scratch: &mut TraceScratch,
    ) -> Vec<Option<Hit>> {
        let count = origins.len().min(directions.len());
        let mut found = vec![None; count];
        let blocks = found.chunks_mut(BLOCK).zip(origins.chunks(BLOCK)).zip(directions.chunks(BLOCK));
        for ((found, origins), directions) in blocks {
            let rays = (&origins[..found.len()], &directions[..found.len()]);
            if has_long_runs(rays) {
                self.trace_in_order(geometry, rays, scratch, |ray, hit| found[ray] = hit);
                continue;
            }
            let order = order_by_neighbours(rays);
            let sorted = |all: &[DVec3]| order.iter().map(|ray| all[*ray]).collect::<Vec<_>>();
            let (origins, directions) = (sorted(rays.0), sorted(rays.1));
            let put = |ray: usize, hit| found[order[ray]] = hit;
            self.trace_in_order(geometry, (&origins, &directions), scratch, put);
        }
        found
    }

    /// Gives `put` the first hit of each ray: consecutive rays that are neighbours are traced together.
    fn trace_in_order(
        &self,
        geometry: &Geometry,
        rays: Rays<'_>,
        scratch: &mut TraceScratch,
        mut put: impl FnMut(usize, Option<Hit>),
    ) {
        let (mut group, mut numbers, mut hits) = (RayGroup::new(1), Vec::new(), Hits::default());
        let mut first = 0;
        while first < rays.0.len() {
            let end = end_of_run(rays, first);
            let run = (first..end).zip(rays.0[first..end].iter().zip(&rays.1[first..end]));
            if end - first < MIN_RUN {
                for (number, (origin, direction)) in run {
                    put(number, self.nearest_where(geometry, *origin, *direction, |_| true));
                }
            } else {
                for (_, (origin, d)) in run {
                    group.push(*origin, |x, y, z| (x[0], y[0], z[0]) = (d.x, d.y, d.z));
                }
                numbers.extend(first..end);
            }
            first = end;
            if numbers.len() >= MAX_WAITING || (first == rays.0.len() && !numbers.is_empty()) {
                self.trace_group(geometry, &group, &mut hits, scratch);
                for (pulse, number) in numbers.drain(..).enumerate() {
                    let at = pulse * group.stride();
                    let (t, primitive) = (hits.t[at], hits.primitive[at]);
                    put(number, (primitive != Hits::MISS).then_some(Hit { t, primitive }));
                }
                group.clear(1);
            }
        }
    }
}

/// As many origins as directions.
type Rays<'r> = (&'r [DVec3], &'r [DVec3]);

/// End of the run of rays from `first` on that are near to it.
fn end_of_run((origins, directions): Rays<'_>, first: usize) -> usize {
    let is_near = |i: &usize| {
        let turn = (directions[*i] - directions[first]).abs();
        let away = (origins[*i] - origins[first]).abs();
        turn.cmple(DVec3::splat(MAX_DISTANCE.0)).all() && away.cmple(DVec3::splat(MAX_DISTANCE.1)).all()
    };
    first + 1 + (first + 1..origins.len()).take(MAX_WAITING).take_while(is_near).count()
}

/// True if rays have runs of at least [`LONG_RUN`] on average.
fn has_long_runs(rays: Rays<'_>) -> bool {
    let most = rays.0.len() / LONG_RUN;
    let (mut first, mut runs) = (0, 0);
    while first < rays.0.len() && runs <= most {
        first = end_of_run(rays, first);
        runs += 1;
    }
    runs <= most
}

/// The numbers of at most [`BLOCK`] rays along Morton curves: of their origins, and among near origins of
/// their directions.
fn order_by_neighbours((origins, directions): Rays<'_>) -> Vec<usize> {
    const WAYS: f64 = (1 << WAY_BITS) as f64;
    let corner = origins.iter().fold(DVec3::INFINITY, |corner, origin| corner.min(*origin));
    let key = |(ray, (origin, direction)): (usize, (&DVec3, &DVec3))| {
        let place = along_curve((origin - corner) / MAX_DISTANCE.1, PLACE_BITS);
        let way = along_curve((direction + 1.0) * (0.5 * WAYS - 1.0), WAY_BITS);
        (place << (3 * WAY_BITS) | way) << INDEX_BITS | ray as u64
    };
    // Whole numbers sort several times as fast as pairs, and a ray is in its key.
    let mut keys: Vec<u64> = origins.iter().zip(directions).enumerate().map(key).collect();
    keys.sort_unstable();
    keys.into_iter().map(|key| key as usize % BLOCK).collect()
}

/// Place along a Morton curve of the cell at whole coordinates, of which the lower bits count; that of NaN
/// is 0.
fn along_curve(cell: DVec3, bits: u32) -> u64 {
    let coordinates = cell.to_array().map(|v| v as u64);
    let bit = |at: u32, axis: usize| (coordinates[axis] >> at & 1) << (3 * at + axis as u32);
    (0..bits).flat_map(|at| [bit(at, 0), bit(at, 1), bit(at, 2)]).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::BuildOptions;

    /// A surface of waves, 2 triangles per cell of 1 m.
    fn waves() -> Geometry {
        const SIDE: u32 = 60;
        let height = |x: u32, y: u32| libm::sin(f64::from(x) * 0.7) * libm::cos(f64::from(y) * 0.5);
        let vertex = |i: u32| {
            let (x, y) = (i % SIDE, i / SIDE);
            DVec3::new(f64::from(x), f64::from(y), height(x, y))
        };
        let cell = |i: u32| {
            let first = i / (SIDE - 1) * SIDE + i % (SIDE - 1);
            [[first, first + 1, first + SIDE], [first + 1, first + SIDE + 1, first + SIDE]]
        };
        Geometry {
            vertices: (0..SIDE * SIDE).map(vertex).collect(),
            triangles: (0..(SIDE - 1) * (SIDE - 1)).flat_map(cell).collect(),
            ..Geometry::default()
        }
    }

    #[test]
    fn rays_of_a_block_are_ordered_by_place_and_way() {
        let origins = [0.2, 9.0, 0.4, 9.9, 0.1].map(|x| DVec3::new(x, 3.0, 0.0));
        let ways = [0.9, 0.1, -0.9, -0.4, 0.3].map(|x| DVec3::new(x, 0.0, -0.1));
        assert_eq!(order_by_neighbours((&origins, &ways)), [2, 4, 0, 1, 3]);
        assert_eq!(along_curve(DVec3::new(3.0, 1.0, 0.5), 10), 0b1011);
        assert_eq!(along_curve(DVec3::new(f64::NAN, 64.0, 2.0), 6), 0b10_0000);
        let close = [DVec3::ZERO; 40];
        assert!(has_long_runs((&close, &close)) && !has_long_runs((&origins, &ways)));
    }

    #[test]
    fn hits_of_scattered_and_of_swept_rays_are_those_of_single_rays() {
        let mesh = waves();
        let tree = Tree::try_build(&mesh, &BuildOptions::default()).unwrap();
        let (mut origins, mut directions) = (Vec::new(), Vec::new());
        for i in 0..20_000 {
            let at = f64::from(i);
            // A thousand rays of a sweep, then a thousand in all directions, and so on.
            let turn = if i / 1000 % 2 == 0 { at * 1e-3 } else { at * 2.4 };
            origins.push(DVec3::new(30.0 + libm::sin(turn), 30.0 - libm::cos(turn), 5.0 + at * 1e-4));
            directions.push(DVec3::new(libm::sin(turn), libm::cos(turn), -0.3).normalize());
        }
        (directions[70], origins[1070]) = (DVec3::NAN, DVec3::INFINITY);
        let found = tree.trace_rays(&mesh, &origins, &directions, &mut TraceScratch::default());
        assert_eq!(found.len(), 20_000);
        for (i, hit) in found.iter().enumerate() {
            let single = tree.nearest_where(&mesh, origins[i], directions[i], |_| true);
            let bits = |hit: &Hit| (hit.t.to_bits(), hit.primitive);
            assert_eq!(hit.as_ref().map(bits), single.as_ref().map(bits), "ray {i}");
        }
        assert!(found.iter().filter(|hit| hit.is_some()).count() > 9_000);
        assert!(tree.trace_rays(&mesh, &[], &directions, &mut TraceScratch::default()).is_empty());
    }
}
