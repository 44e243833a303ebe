//! Tracing instances: through the tree over their boxes and then the trees of the models that are met. Groups go the way of
//! `kernel`; what is here for that are single rays and pulses that have no part in one.

use super::beam::Beam;
use super::block::{Block, LANES};
use super::build::Prim;
use super::build::build_wide;
use super::frame::Frame;
use super::index::Nodes;
use super::instances::{Instance, Instances, Inward};
use super::intersect::{SHORTEST, triangle};
use super::trace::depth_limit;
use super::{BuildOptions, Geometry, Hit, Hits, Level, RayGroup, Tree};
use crate::geom::{Aabb, DVec3};
use std::cell::RefCell;
use std::sync::Arc;

thread_local! {
    /// What a group hits of the geometry itself.
    static OWN: RefCell<Hits> = RefCell::default();
}

/// The trees over instances and over their models.
#[derive(Clone, Debug)]
pub(super) struct Placed {
    pub instances: Arc<Instances>,
    pub models: Vec<Tree>,
    /// Over the boxes of the instances, which stand in its blocks as cubes.
    pub top: Tree,
}

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
                d.is_finite() && d.abs().max_element() >= SHORTEST
            })
    }

    /// The depth beyond which nothing is of interest, when a ray gains at most `steepness` of it per unit of t.
    fn limit(&self, steepness: f64) -> f32 {
        depth_limit(self.t.iter().fold(0.0, |m: f64, t| m.max(*t)) * steepness)
    }
}

/// How fast the depth of a beam may grow with t.
fn steepness(beam: &Beam, frame: &Frame, directions: impl Iterator<Item = DVec3>) -> f64 {
    directions.fold(0.0, |m: f64, d| m.max(d[beam.axes[0]].abs())) * frame.scale
}

impl Placed {
    /// Builds all trees.
    pub fn build(instances: &Arc<Instances>, options: &BuildOptions) -> Placed {
        let models = instances.models.iter().map(|m| Tree::build(&m.geometry, options)).collect();
        Placed { instances: instances.clone(), models, top: over_boxes(&instances.boxes(), options) }
    }

    /// Bytes of all trees; the models themselves are not counted.
    pub fn memory(&self) -> usize {
        self.models.iter().map(Tree::memory).sum::<usize>() + self.top.memory()
    }

    /// Brings the instances into the hits of a group that was traced without them.
    pub fn trace_group_on(&self, level: Level, geometry: &Geometry, group: &RayGroup, hits: &mut Hits) {
        OWN.with_borrow_mut(|own| {
            // Instances win all equal distances at first, the one with the lowest number that of all instances. If that
            // one does not come before the geometry's primitive, no other does.
            own.t.clone_from(&hits.t);
            own.primitive.clone_from(&hits.primitive);
            hits.primitive.fill(Hits::MISS);
            self.trace_nearer_on(level, geometry, group, hits);
            let own = own.t.iter().zip(&own.primitive);
            for ((t, id), (own_t, own)) in hits.t.iter().zip(&mut hits.primitive).zip(own) {
                let equal = *own != Hits::MISS && t == own_t;
                if *id == Hits::MISS || (equal && !self.comes_before(*id, *own)) {
                    *id = *own;
                }
            }
        });
    }

    /// Whether triangle `new` of an instance comes before primitive `own` of the geometry.
    fn comes_before(&self, new: u32, own: u32) -> bool {
        let place = self.instances.locate(new).map(|(instance, _)| self.instances.all[instance].before);
        place.is_some_and(|before| self.instances.comes_first(new, before, own))
    }

    /// Traces one pulse alone, likewise.
    pub(super) fn trace_pulse(&self, group: &RayGroup, pulse: usize, hits: &mut Hits) {
        let row = pulse * group.stride()..pulse * group.stride() + group.rays();
        let (t, id) = (&mut hits.t[row.clone()], &mut hits.primitive[row]);
        let rays = Rays { origin: group.origin(pulse), directions: group.directions(pulse), t, id };
        self.trace(rays, &|_| true, &mut Vec::new());
    }

    /// Asks an instance about the rays of one pulse, whose nearest hits so far are in `t` and `id`.
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

    /// The nearer of `best` and the first hit among the instances' triangles that `accept` approves.
    pub fn nearest(
        &self,
        origin: DVec3,
        direction: DVec3,
        best: Option<Hit>,
        accept: &impl Fn(u32) -> bool,
    ) -> Option<Hit> {
        let mut t = [best.map_or(f64::INFINITY, |b| b.t)];
        let mut id = [best.map_or(Hits::MISS, |b| b.primitive)];
        let axes = direction.to_array();
        let rays = Rays { origin, directions: [&axes[..1], &axes[1..2], &axes[2..]], t: &mut t, id: &mut id };
        self.trace(rays, accept, &mut Vec::new());
        (id[0] != Hits::MISS).then_some(Hit { t: t[0], primitive: id[0] })
    }

    fn trace(&self, mut rays: Rays, accept: &impl Fn(u32) -> bool, inward: &mut Vec<DVec3>) {
        let frame = &self.top.frame;
        let directions = (0..rays.len()).map(|r| rays.direction(r));
        match Beam::of(frame, rays.origin, directions.clone()) {
            Some(beam) => {
                let steepness = steepness(&beam, frame, directions);
                self.top.walk(&beam, rays.limit(steepness), |block, mut mask, limit| {
                    while mask != 0 {
                        let instance = &self.instances.all[block.id[mask.trailing_zeros() as usize] as usize];
                        self.visit(instance, &mut rays, accept, inward);
                        *limit = rays.limit(steepness);
                        mask &= mask - 1;
                    }
                });
            }
            None if rays.len() > 1 => {
                (0..rays.len()).for_each(|r| self.trace(rays.one(r), accept, inward));
            }
            None if rays.is_sound() => {
                self.instances.all.iter().for_each(|i| self.visit(i, &mut rays, accept, inward));
            }
            None => {}
        }
    }

    /// Asks an instance.
    fn visit(
        &self,
        instance: &Instance,
        rays: &mut Rays,
        accept: &impl Fn(u32) -> bool,
        inward: &mut Vec<DVec3>,
    ) {
        match self.instances.inward(instance) {
            Some(way) => self.enter(instance, &way, rays, accept, inward),
            None => self.ask_all(instance, rays, accept),
        }
    }

    /// Walks the model's tree.
    fn enter(
        &self,
        instance: &Instance,
        way: &Inward,
        rays: &mut Rays,
        accept: &impl Fn(u32) -> bool,
        inward: &mut Vec<DVec3>,
    ) {
        let tree = &self.models[instance.model as usize];
        let (origin, off) = way.point(rays.origin);
        inward.clear();
        inward.extend((0..rays.len()).map(|r| way.direction(rays.direction(r))));
        let directions = inward.iter().copied();
        match Beam::of(&tree.frame, origin, directions.clone()) {
            Some(beam) => {
                let beam = beam.widened(off * tree.frame.scale);
                let steepness = steepness(&beam, &tree.frame, directions);
                tree.walk(&beam, rays.limit(steepness), |block, mut mask, limit| {
                    while mask != 0 {
                        let triangle = block.id[mask.trailing_zeros() as usize];
                        self.ask(instance, triangle, rays, accept);
                        mask &= mask - 1;
                    }
                    *limit = rays.limit(steepness);
                });
            }
            None if rays.len() > 1 => {
                (0..rays.len()).for_each(|r| self.enter(instance, way, &mut rays.one(r), accept, inward));
            }
            // Out of reach of single precision.
            None => self.ask_all(instance, rays, accept),
        }
    }

    fn ask_all(&self, instance: &Instance, rays: &mut Rays, accept: &impl Fn(u32) -> bool) {
        let count = self.instances.model(instance).geometry.triangles.len() as u32;
        (0..count).for_each(|triangle| self.ask(instance, triangle, rays, accept));
    }

    /// The verdicts of all rays on a triangle.
    #[inline]
    fn ask(&self, instance: &Instance, number: u32, rays: &mut Rays, accept: &impl Fn(u32) -> bool) {
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

/// A tree over boxes, whatever is in them.
fn over_boxes(boxes: &[Aabb], options: &BuildOptions) -> Tree {
    let sound = |b: &Aabb| b.min.is_finite() && b.max.is_finite() && !b.is_empty();
    let all = boxes.iter().filter(|b| sound(b)).fold(Aabb::EMPTY, |all, b| all.union(*b));
    let frame = Frame::around(&all);
    let prims: Vec<Prim> = (0..)
        .zip(boxes)
        .filter(|(_, b)| sound(b))
        .map(|(id, b)| {
            let (lo, hi) = frame.local_box(b);
            Prim { lo, id, hi }
        })
        .collect();
    let (arena, statistics) = build_wide(0, &frame, prims, options);
    let blocks: Vec<Block> = arena.slots.chunks(LANES).map(|ids| block_of(boxes, &frame, ids)).collect();
    let (lo, hi) = frame.local_box(&all);
    Tree::of(frame, [lo, hi], Nodes::Wide(arena.nodes.into()), blocks.into(), statistics)
}

fn block_of(boxes: &[Aabb], frame: &Frame, ids: &[u32]) -> Block {
    let mut block =
        Block { corner: [[[f32::NAN; LANES]; 3]; 3], id: [Hits::MISS; LANES], vertex: [[0; LANES]; 3] };
    block.corner[0] = [[f32::INFINITY; LANES]; 3];
    block.corner[1] = [[f32::NEG_INFINITY; LANES]; 3];
    for (lane, &id) in ids.iter().enumerate().filter(|(_, id)| **id != Hits::MISS) {
        let (lo, hi) = frame.local_box(&boxes[id as usize]);
        block.id[lane] = id;
        for axis in 0..3 {
            block.corner[0][axis][lane] = lo[axis];
            block.corner[1][axis][lane] = hi[axis];
        }
    }
    block
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::{Rotation, unit};
    use crate::tree::{Builder, Cube, Geometry, Model, Placement};
    use proptest::prelude::*;

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
        let turned = (point(1.0), -4.0..4.0, -2.0..2.0f64, point(12.0), prop_oneof![Just(-0.0), -1.0..1.0]);
        let turned = turned.prop_filter_map("a scale of none", |(axis, angle, scale, offset, raise)| {
            let rotation = Rotation::about(axis + DVec3::splat(1e-3), angle);
            (scale.abs() > 0.05).then_some(Placement { rotation, scale, offset, raise })
        });
        let moved = [-4..=4i32, -4..=4, -4..=4]
            .prop_map(|o| Placement { offset: DVec3::from(o.map(f64::from)), ..Placement::IDENTITY });
        prop_oneof![turned, moved, Just(Placement::IDENTITY)]
    }

    /// Own triangles and cubes, models, and instances with the number of own triangles before them.
    type Parts = (Geometry, Vec<Geometry>, Vec<(u32, u32, Placement)>, DVec3);

    fn parts() -> impl Strategy<Value = Parts> {
        let cube = (point(10.0), 0.1..1.0).prop_map(|(centre, half)| Cube { centre, half });
        let own = (model(), prop::collection::vec(cube, 0..4))
            .prop_map(|(g, cubes)| Geometry { cubes: cubes.into(), ..g });
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

    /// The same scene with every model copied to its places.
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

    /// More than fit two registers of sixteen.
    const RAYS: usize = 37;

    fn pulses() -> impl Strategy<Value = Vec<(DVec3, Vec<DVec3>)>> {
        let on_grid = [-6..=6i32, -6..=6, -6..=6].prop_map(|c| DVec3::from(c.map(|x| f64::from(x) * 0.5)));
        let origin = prop_oneof![point(20.0), on_grid.clone(), point(2000.0)];
        let target = prop_oneof![point(8.0), on_grid];
        let aside = prop::collection::vec(point(0.02), RAYS);
        // Pulses alone, and some that run side by side.
        let volley = (origin, target, aside, prop_oneof![Just(1), 2..20usize], point(0.004), point(0.1));
        let volley = volley.prop_map(|(origin, target, aside, count, turn, step)| {
            let axis = unit(target - origin + DVec3::splat(f64::MIN_POSITIVE));
            let aimed = if axis.is_finite() { axis } else { DVec3::X };
            let pulse = |n: usize| {
                let aimed = aimed + turn * n as f64;
                let aside = aside[1..].iter().map(|a| unit(aimed + *a));
                (origin + step * n as f64, std::iter::once(unit(aimed)).chain(aside).collect())
            };
            (0..count).map(pulse).collect::<Vec<_>>()
        });
        prop::collection::vec(volley, 1..8).prop_map(|volleys| volleys.into_iter().flatten().collect())
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
            flat_tree.trace_group(&flat, &group, &mut expected);
            let number = |id: u32| match id {
                Hits::MISS => Hits::MISS,
                id => all.number_when_stored(id, own.triangles.len()),
            };
            for level in Level::available() {
                tree.trace_group_on(level, own, &group, &mut hits);
                tree.placed.as_ref().unwrap().trace_group_on(level, own, &group, &mut hits);
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
            let own = Geometry { cubes: Vec::new().into(), ..parts.0.clone() }.bounds();
            let expected = Geometry { cubes: Vec::new().into(), ..flat }.bounds();
            prop_assert_eq!(all.exact_bounds(own), expected);
        }

        #[test]
        fn every_triangle_is_found_again(parts in parts()) {
            let (all, flat) = (instances(&parts), stored(&parts));
            let own = &parts.0;
            let mut seen = vec![false; flat.len()];
            for i in 0..(own.len() as u32 + all.triangles()) {
                let number = all.number_when_stored(i, own.triangles.len()) as usize;
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
