//! Tracing of single rays among instances, and of pulses that are in no packet: through the tree over the
//! boxes of the instances, then through the trees of the models hit.

use super::frustum::Frustum;
use super::index::InstanceTree;
use super::instances::{Instance, WorldToInstance};
use super::intersect::{MIN_DIRECTION, triangle};
use super::trace::Accept;
use super::{Hit, Hits, RayGroup};
use vlscan_geom::DVec3;

/// Rays from one origin with the nearest hits so far.
struct Rays<'a> {
    origin: DVec3,
    directions: [&'a [f64]; 3],
    t: &'a mut [f64],
    id: &'a mut [u32],
}

impl Rays<'_> {
    fn direction(&self, ray: usize) -> DVec3 {
        let [x, y, z] = self.directions;
        DVec3::new(x[ray], y[ray], z[ray])
    }

    fn one(&mut self, ray: usize) -> Rays<'_> {
        Rays {
            origin: self.origin,
            directions: self.directions.map(|d| &d[ray..=ray]),
            t: &mut self.t[ray..=ray],
            id: &mut self.id[ray..=ray],
        }
    }

    fn len(&self) -> usize {
        self.t.len()
    }

    fn is_sound(&self) -> bool {
        self.origin.is_finite()
            && (0..self.len()).all(|r| {
                let d = self.direction(r);
                d.is_finite() && d.abs().max_element() >= MIN_DIRECTION
            })
    }

    /// The distance beyond which no first hit can be.
    fn max_t(&self) -> f64 {
        self.t.iter().fold(0.0, |m: f64, t| m.max(*t))
    }
}

impl InstanceTree {
    /// Merges the hits of the instances into the hits of one pulse.
    pub(super) fn trace_pulse(&self, group: &RayGroup, pulse: usize, hits: &mut Hits) {
        let row = pulse * group.stride()..pulse * group.stride() + group.rays();
        let (t, id) = (&mut hits.t[row.clone()], &mut hits.primitive[row]);
        let rays = Rays { origin: group.origin(pulse), directions: group.directions(pulse), t, id };
        self.trace(rays, &|_| true, &mut Vec::new());
    }

    /// Merges the hits of one instance into the hits `t` and `id` of one pulse.
    #[cold]
    pub(super) fn visit_pulse(
        &self,
        instance: &Instance,
        group: &RayGroup,
        pulse: usize,
        t: &mut [f64],
        id: &mut [u32],
    ) {
        let (t, id) = (&mut t[..group.rays()], &mut id[..group.rays()]);
        let mut rays = Rays { origin: group.origin(pulse), directions: group.directions(pulse), t, id };
        self.visit(instance, &mut rays, &|_| true, &mut Vec::new());
    }

    /// Returns the nearer of `best` and the first hit among the instances' triangles that `accept` accepts.
    pub fn nearest(&self, origin: DVec3, direction: DVec3, best: Option<Hit>, accept: Accept) -> Option<Hit> {
        let mut t = [best.map_or(f64::INFINITY, |b| b.t)];
        let mut id = [best.map_or(Hits::MISS, |b| b.primitive)];
        let axes = direction.to_array();
        let rays = Rays { origin, directions: [&axes[..1], &axes[1..2], &axes[2..]], t: &mut t, id: &mut id };
        self.trace(rays, accept, &mut Vec::new());
        (id[0] != Hits::MISS).then_some(Hit { t: t[0], primitive: id[0] })
    }

    /// Merges the hits of the instances into the hits of some rays. `local` is memory for directions in the
    /// frame of a model.
    fn trace(&self, mut rays: Rays, accept: Accept, local: &mut Vec<DVec3>) {
        let directions = (0..rays.len()).map(|r| rays.direction(r));
        match Frustum::around(&self.top.frame, rays.origin, directions) {
            Some(frustum) => {
                self.top.walk(&frustum, frustum.limit(rays.max_t()), |block, mut mask, limit| {
                    while mask != 0 {
                        let instance = &self.instances.all[block.id[mask.trailing_zeros() as usize] as usize];
                        self.visit(instance, &mut rays, accept, local);
                        *limit = frustum.limit(rays.max_t());
                        mask &= mask - 1;
                    }
                });
            }
            None if rays.len() > 1 => {
                (0..rays.len()).for_each(|r| self.trace(rays.one(r), accept, local));
            }
            None if rays.is_sound() => {
                self.instances.all.iter().for_each(|i| self.visit(i, &mut rays, accept, local));
            }
            None => {}
        }
    }

    /// Merges the hits of one instance into the hits of some rays.
    fn visit(&self, instance: &Instance, rays: &mut Rays, accept: Accept, local: &mut Vec<DVec3>) {
        match self.instances.world_to_instance(instance) {
            Some(way) => self.walk_model(instance, &way, rays, accept, local),
            None => self.test_all(instance, rays, accept),
        }
    }

    /// Traverses the model's tree with some rays.
    fn walk_model(
        &self,
        instance: &Instance,
        way: &WorldToInstance,
        rays: &mut Rays,
        accept: Accept,
        local: &mut Vec<DVec3>,
    ) {
        let tree = &self.models[instance.model as usize];
        let (origin, error) = way.point(rays.origin);
        local.clear();
        local.extend((0..rays.len()).map(|r| way.matrix() * rays.direction(r)));
        match Frustum::around(&tree.frame, origin, local.iter().copied()) {
            Some(frustum) => {
                let frustum = frustum.widened(error * tree.frame.scale);
                tree.walk(&frustum, frustum.limit(rays.max_t()), |block, mut mask, limit| {
                    while mask != 0 {
                        let triangle = block.id[mask.trailing_zeros() as usize];
                        self.test(instance, triangle, rays, accept);
                        mask &= mask - 1;
                    }
                    *limit = frustum.limit(rays.max_t());
                });
            }
            None if rays.len() > 1 => {
                (0..rays.len()).for_each(|r| self.walk_model(instance, way, &mut rays.one(r), accept, local));
            }
            // Out of range of single precision.
            None => self.test_all(instance, rays, accept),
        }
    }

    /// Applies the exact test to all rays and all triangles of an instance.
    fn test_all(&self, instance: &Instance, rays: &mut Rays, accept: Accept) {
        let count = self.instances.model(instance).geometry.triangles.len() as u32;
        (0..count).for_each(|triangle| self.test(instance, triangle, rays, accept));
    }

    /// Applies the exact test to all rays and one triangle of an instance.
    #[inline]
    fn test(&self, instance: &Instance, number: u32, rays: &mut Rays, accept: Accept) {
        let id = instance.first + number;
        if !accept(id) {
            return;
        }
        let corners = self.instances.corners(instance, number as usize);
        for r in 0..rays.len() {
            let Some(t) = triangle(rays.origin, rays.direction(r), corners) else { continue };
            let best = rays.t[r];
            if t < best || (t == best && self.instances.comes_first(id, instance.before, rays.id[r])) {
                (rays.t[r], rays.id[r]) = (t, id);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::Level;
    use crate::{BuildOptions, Builder, Cube, Geometry, Instances, Model, Placement, TraceScratch, Tree};
    use proptest::prelude::*;
    use std::sync::Arc;
    use vlscan_geom::{Rotation, unit};

    fn point(size: f64) -> impl Strategy<Value = DVec3> {
        [-size..size, -size..size, -size..size].prop_map(DVec3::from)
    }

    /// Corners on a coarse grid, so that edges are shared and distances are equal.
    fn model() -> impl Strategy<Value = Geometry> {
        let corner = [-3..=3i32, -3..=3, -3..=3].prop_map(|c| DVec3::from(c.map(|x| f64::from(x) * 0.5)));
        prop::collection::vec([corner.clone(), corner.clone(), corner], 1..60).prop_map(of_triangles)
    }

    fn of_triangles(triangles: Vec<[DVec3; 3]>) -> Geometry {
        let count = triangles.len() as u32;
        Geometry {
            vertices: triangles.into_iter().flatten().collect(),
            triangles: (0..count).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect(),
            ..Geometry::default()
        }
    }

    fn placement() -> impl Strategy<Value = Placement> {
        let widening = prop_oneof![Just(1.0), 0.2..4.0f64];
        let raise = prop_oneof![Just(-0.0), -1.0..1.0];
        let turned = (point(1.0), -4.0..4.0, widening, -2.0..2.0f64, point(12.0), raise);
        let turned =
            turned.prop_filter_map("a scale of none", |(axis, angle, widening, scale, offset, raise)| {
                let rotation = Rotation::about(axis + DVec3::splat(1e-3), angle);
                (scale.abs() > 0.05).then_some(Placement { rotation, widening, scale, offset, raise })
            });
        let moved = [-4..=4i32, -4..=4, -4..=4]
            .prop_map(|o| Placement { offset: DVec3::from(o.map(f64::from)), ..Placement::IDENTITY });
        prop_oneof![turned, moved, Just(Placement::IDENTITY)]
    }

    /// Own triangles and cubes, models, and instances with the number of own triangles before them.
    type Parts = (Geometry, Vec<Geometry>, Vec<(u32, u32, Placement)>, DVec3);

    fn parts() -> impl Strategy<Value = Parts> {
        let cube = (point(10.0), 0.1..1.0).prop_map(|(centre, half)| Cube { centre, half });
        let own = (model(), prop::collection::vec(cube, 0..4)).prop_map(|(g, cubes)| Geometry { cubes, ..g });
        let shift = prop_oneof![Just(DVec3::ZERO), point(5e6), point(30.0)];
        let places = prop::collection::vec((0..3u32, any::<u32>(), placement()), 0..12);
        (own, [model(), model(), model()], places, shift).prop_map(|(own, models, mut places, shift)| {
            let count = own.triangles.len() as u32;
            places.iter_mut().for_each(|p| {
                p.1 %= count + 1;
                p.2.offset += shift;
            });
            places.sort_by_key(|p| p.1);
            (own, models.to_vec(), places, shift)
        })
    }

    /// The scene with every model copied to its placements.
    fn stored((own, models, places, shift): &Parts) -> Geometry {
        let mut triangles = Vec::new();
        for i in 0..=own.triangles.len() {
            for (model, _, placement) in places.iter().filter(|p| p.1 as usize == i) {
                let model = &models[*model as usize];
                triangles.extend(
                    (0..model.triangles.len()).map(|k| model.triangle(k).map(|p| placement.place(p, *shift))),
                );
            }
            if i < own.triangles.len() {
                triangles.push(own.triangle(i));
            }
        }
        Geometry { cubes: own.cubes.clone(), ..of_triangles(triangles) }
    }

    fn instances((own, models, places, shift): &Parts) -> Arc<Instances> {
        let models = models.iter().map(|m| Arc::new(Model::new(m.clone()))).collect();
        let mut all = Instances::new(models, places.iter().copied(), own.len()).unwrap();
        all.shift = *shift;
        Arc::new(all)
    }

    fn group(pulses: &[(DVec3, Vec<DVec3>)]) -> RayGroup {
        let mut group = RayGroup::new(pulses[0].1.len());
        for (origin, directions) in pulses {
            group.push(*origin, |x, y, z| {
                for (r, d) in directions.iter().enumerate() {
                    (x[r], y[r], z[r]) = (d.x, d.y, d.z);
                }
            });
        }
        group
    }

    /// More than fit into two registers of sixteen.
    const RAYS: usize = 37;

    fn pulses() -> impl Strategy<Value = Vec<(DVec3, Vec<DVec3>)>> {
        let on_grid = [-6..=6i32, -6..=6, -6..=6].prop_map(|c| DVec3::from(c.map(|x| f64::from(x) * 0.5)));
        let origin = prop_oneof![point(20.0), on_grid.clone(), point(2000.0)];
        let target = prop_oneof![point(8.0), on_grid];
        let aside = prop::collection::vec(point(0.02), RAYS);
        // Pulses alone, and some that run side by side.
        let run = (origin, target, aside, prop_oneof![Just(1), 2..20usize], point(0.004), point(0.1));
        let run = run.prop_map(|(origin, target, aside, count, turn, step)| {
            let axis = unit(target - origin + DVec3::splat(f64::MIN_POSITIVE));
            let aimed = if axis.is_finite() { axis } else { DVec3::X };
            let pulse = |n: usize| {
                let aimed = aimed + turn * n as f64;
                let aside = aside[1..].iter().map(|a| unit(aimed + *a));
                (origin + step * n as f64, std::iter::once(unit(aimed)).chain(aside).collect())
            };
            (0..count).map(pulse).collect::<Vec<_>>()
        });
        prop::collection::vec(run, 1..8).prop_map(|runs| runs.into_iter().flatten().collect())
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(400))]

        #[test]
        fn instances_are_hit_as_if_they_were_stored(
            parts in parts(),
            pulses in pulses(),
            builder in prop_oneof![Just(Builder::Bvh), Just(Builder::Fsah)],
        ) {
            let options = BuildOptions { jobs: 1, ..BuildOptions::of(builder) };
            let (own, all, flat) = (&parts.0, instances(&parts), stored(&parts));
            let tree = Tree::build(own, &options).with_instances(&all, &options);
            let flat_tree = Tree::build(&flat, &options);
            let group = group(&pulses);
            let (mut hits, mut expected) = (Hits::default(), Hits::default());
            let mut scratch = TraceScratch::default();
            flat_tree.trace_group(&flat, &group, &mut expected, &mut scratch);
            let number = |id: u32| match id {
                Hits::MISS => Hits::MISS,
                id => all.number_when_stored(id, own.triangles.len()).0,
            };
            for level in Level::available() {
                tree.trace_group_on(level, own, &group, &mut hits, &mut scratch);
                for at in (0..group.len() * group.stride()).filter(|at| at % group.stride() < RAYS) {
                    prop_assert_eq!(hits.t[at].to_bits(), expected.t[at].to_bits());
                    prop_assert_eq!(number(hits.primitive[at]), expected.primitive[at]);
                }
            }
            for p in (0..group.len()).step_by(5) {
                let (o, d) = (group.origin(p), group.direction(p, p % RAYS));
                let one = tree.nearest_where(own, o, d, |_| true);
                let one = one.map_or((f64::INFINITY, Hits::MISS), |h| (h.t, number(h.primitive)));
                let at = p * group.stride() + p % RAYS;
                prop_assert_eq!(one, (expected.t[at], expected.primitive[at]));
            }
        }

        #[test]
        fn boxes_hold_their_instances(parts in parts()) {
            let all = instances(&parts);
            let flat = stored(&parts);
            for (instance, wide) in all.all.iter().zip(all.boxes()) {
                let exact = all.exact_bounds_of(instance);
                prop_assert!(exact.min.cmpge(wide.min).all() && exact.max.cmple(wide.max).all());
            }
            let own = Geometry { cubes: Vec::new(), ..parts.0.clone() }.bounds();
            let expected = Geometry { cubes: Vec::new(), ..flat }.bounds();
            prop_assert_eq!(all.exact_bounds(own), expected);
        }

        #[test]
        fn every_triangle_is_found_again(parts in parts()) {
            let (all, flat) = (instances(&parts), stored(&parts));
            let own = &parts.0;
            let mut seen = vec![false; flat.len()];
            for i in 0..(own.len() as u32 + all.triangles()) {
                let number = all.number_when_stored(i, own.triangles.len()).0 as usize;
                prop_assert!(!std::mem::replace(&mut seen[number], true));
                match all.triangle(i) {
                    Some(corners) => prop_assert_eq!(corners, flat.triangle(number)),
                    None => prop_assert_eq!(own.bounds_of(i as usize), flat.bounds_of(number)),
                }
            }
            prop_assert!(all.triangle(own.len() as u32 + all.triangles()).is_none());
        }
    }

    #[test]
    fn more_triangles_than_numbers_are_refused() {
        let model = Arc::new(Model::new(of_triangles(vec![[DVec3::ZERO, DVec3::X, DVec3::Y]; 1 << 16])));
        let places = |n: usize| std::iter::repeat_n((0, 0, Placement::IDENTITY), n);
        assert!(Instances::new(vec![model.clone()], places((1 << 16) - 1), 0).is_some());
        assert!(Instances::new(vec![model], places(1 << 16), 0).is_none());
    }
}
