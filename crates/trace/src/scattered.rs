//! Tracing of rays that come one by one, each with its own origin.

use super::{Geometry, Hit, Hits, RayGroup, TraceScratch, Tree};
use vlscan_geom::DVec3;

/// Maximum difference of two rays that are traced together: in each component of the direction, and of the
/// origin in metres.
const MAX_DISTANCE: (f64, f64) = (0.02, 1.0);
/// Minimum number of consecutive rays that are traced together; fewer are faster one by one.
const MIN_RUN: usize = 4;
/// Number of rays whose hits are taken over at once.
const MAX_WAITING: usize = 4096;

impl Tree {
    /// First hits of rays `origins[i] + t·directions[i]`, as [`Tree::nearest_where`] finds them, bit for bit;
    /// if there are more origins than directions, or fewer, the rest is left out. Rays may come in any order,
    /// and are traced fastest where consecutive ones are neighbours.
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
        let (mut group, mut numbers, mut hits) = (RayGroup::new(1), Vec::new(), Hits::default());
        let mut take = |group: &mut RayGroup, numbers: &mut Vec<usize>, found: &mut [Option<Hit>]| {
            self.trace_group(geometry, group, &mut hits, scratch);
            for (pulse, number) in numbers.drain(..).enumerate() {
                let at = pulse * group.stride();
                let (t, primitive) = (hits.t[at], hits.primitive[at]);
                found[number] = (primitive != Hits::MISS).then_some(Hit { t, primitive });
            }
            group.clear(1);
        };
        let mut first = 0;
        while first < count {
            let is_near = |i: &usize| {
                let turn = (directions[*i] - directions[first]).abs();
                let away = (origins[*i] - origins[first]).abs();
                turn.cmple(DVec3::splat(MAX_DISTANCE.0)).all()
                    && away.cmple(DVec3::splat(MAX_DISTANCE.1)).all()
            };
            let end = first + 1 + (first + 1..count).take(MAX_WAITING).take_while(is_near).count();
            let run = origins[first..end].iter().zip(&directions[first..end]);
            if end - first < MIN_RUN {
                for (hit, (origin, direction)) in found[first..end].iter_mut().zip(run) {
                    *hit = self.nearest_where(geometry, *origin, *direction, |_| true);
                }
            } else {
                for (origin, d) in run {
                    group.push(*origin, |x, y, z| (x[0], y[0], z[0]) = (d.x, d.y, d.z));
                }
                numbers.extend(first..end);
                if numbers.len() >= MAX_WAITING {
                    take(&mut group, &mut numbers, &mut found);
                }
            }
            first = end;
        }
        if !numbers.is_empty() {
            take(&mut group, &mut numbers, &mut found);
        }
        found
    }
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
    fn hits_of_scattered_and_of_swept_rays_are_those_of_single_rays() {
        let mesh = waves();
        let tree = Tree::try_build(&mesh, &BuildOptions::default()).unwrap();
        let (mut origins, mut directions) = (Vec::new(), Vec::new());
        for i in 0..9_000 {
            let at = f64::from(i);
            // A thousand rays of a sweep, then a thousand in all directions, and so on.
            let turn = if i / 1000 % 2 == 0 { at * 1e-3 } else { at * 2.4 };
            origins.push(DVec3::new(30.0 + libm::sin(turn), 30.0 - libm::cos(turn), 5.0 + at * 1e-4));
            directions.push(DVec3::new(libm::sin(turn), libm::cos(turn), -0.3).normalize());
        }
        directions[70] = DVec3::NAN;
        let found = tree.trace_rays(&mesh, &origins, &directions, &mut TraceScratch::default());
        assert_eq!(found.len(), 9_000);
        for (i, hit) in found.iter().enumerate() {
            let single = tree.nearest_where(&mesh, origins[i], directions[i], |_| true);
            let bits = |hit: &Hit| (hit.t.to_bits(), hit.primitive);
            assert_eq!(hit.as_ref().map(bits), single.as_ref().map(bits), "ray {i}");
        }
        assert!(found.iter().filter(|hit| hit.is_some()).count() > 4_000);
        assert!(tree.trace_rays(&mesh, &[], &directions, &mut TraceScratch::default()).is_empty());
    }
}
