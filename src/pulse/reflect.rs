//! From what the subrays hit to reflections (spec pulse-physics §2).

use super::continuum::{Continuum, Leaves, Stretch, depth};
use super::energy::LANES;
use super::facet::Facets;
use super::foliage::{self, FreePaths, Passage};
use super::instrument::Instrument;
use super::options::Corrections;
use super::reflections::{Lanes, Reflections};
use super::sight::{Shot, Sight};
use crate::geom::{Aabb, DVec3, unit};
use crate::scene::{DynamicObject, Material, Scene, Voxel};
use crate::tree::{Hit, Hits, Tree};

/// How far behind a surface a ray goes on, m.
pub(super) const STEP_BEHIND: f64 = 1e-5;
/// Tolerance of the scene's box, m.
const BOX_SLACK: f64 = 1e-4;

/// The scene as rays see it.
#[derive(Clone, Copy, Debug)]
pub(super) struct View<'a> {
    /// What there is.
    pub scene: &'a Scene,
    /// Finds what is hit of it, other than the moving parts.
    pub tree: &'a Tree,
    /// The moving parts where they are seen now.
    pub moving: &'a [DynamicObject],
    /// The scene's box, outside of which nothing is visible; `None` when nothing lies outside, or may be seen there.
    pub limits: Option<Aabb>,
    /// All surfaces face the beam.
    pub fixed_incidence: bool,
    /// Edge of the largest cube, m.
    pub largest_cube: f64,
}

/// Memory for the way of single rays.
#[derive(Clone, Debug, Default)]
pub(super) struct Probe {
    foliage: Vec<(usize, f64)>,
    continuum: Continuum,
    /// Triangles that were met.
    pub facets: Facets,
}

impl<'a> View<'a> {
    /// Replaces `out` by the reflections of a pulse's subrays, in their order.
    #[inline(always)]
    pub fn reflect(
        &self,
        instrument: &Instrument,
        (shot, sight): (Shot, Sight),
        paths: &mut FreePaths,
        probe: &mut Probe,
        out: &mut Reflections,
    ) {
        out.clear(instrument.subrays.len());
        let around = self.voxels_around(instrument, shot.origin);
        let is_plain = around.is_empty()
            && self.limits.is_none()
            && self.reflect_plainly(instrument, (shot, sight), &mut probe.facets, out);
        if !is_plain {
            // What was found until then is found again.
            out.clear(instrument.subrays.len());
            self.reflect_each(instrument, (shot, sight), &around, paths, probe, out);
        }
    }

    /// [`View::reflect`] of a pulse that meets triangles only, none of which lets rays through; `false` for any other.
    #[inline(always)]
    fn reflect_plainly(
        &self,
        instrument: &Instrument,
        (shot, sight): (Shot, Sight),
        facets: &mut Facets,
        out: &mut Reflections,
    ) -> bool {
        let mut left = shot.primitive.len();
        let [x, y, z] = shot.directions;
        let gains = sight.gains.as_chunks::<LANES>().0;
        let blocks = shot.met.iter().zip(sight.ranges.as_chunks::<LANES>().0).zip(gains);
        for (((met, range), gain), ((x, y), z)) in blocks.zip(x.iter().zip(y).zip(z)) {
            let (mut hits, mut seen) = ([0; LANES], [0; LANES]);
            for i in 0..LANES {
                hits[i] = u8::from((met[i] != Hits::MISS) & (i < left));
                let in_range = (range[i] >= instrument.range_min) & (range[i] <= instrument.range_max);
                seen[i] = hits[i] & u8::from(in_range);
            }
            left = left.saturating_sub(LANES);
            if instrument.corrections.see_through_near && hits != seen {
                return false;
            }
            let (mut cosine, mut intensity) = ([1.0; LANES], [0.0; LANES]);
            let mut others = Lanes::of(seen);
            // Neighbours mostly meet the same triangle: there are few rounds.
            while let Some(first) = others.first() {
                let Some(facet) = facets.look_up(self, met[first]) else { return false };
                let mut same = [0; LANES];
                for i in 0..LANES {
                    same[i] = u8::from(met[i] == met[first]);
                }
                if !self.fixed_incidence {
                    facet.cosines([x, y, z], &same, &mut cosine);
                }
                facet.intensities(self, &cosine, gain, &same, &mut intensity);
                others = others.without(Lanes::of(same));
            }
            out.add_plain(Lanes::of(seen), range, &intensity, &cosine, met);
        }
        out.are_plain();
        true
    }

    /// [`View::reflect`] of any pulse; `around` are the voxels of foliage in which it begins.
    #[inline(never)]
    fn reflect_each(
        &self,
        instrument: &Instrument,
        (shot, sight): (Shot, Sight),
        around: &[u32],
        paths: &mut FreePaths,
        probe: &mut Probe,
        out: &mut Reflections,
    ) {
        let (rings, c) = (&instrument.subrays.ring, &instrument.corrections);
        probe.foliage.clear();
        let spreads = c.foliage_continuum && c.adjacent_voxels && c.leaf_table_law && rings.len() > 1;
        if spreads {
            probe.continuum.clear(instrument);
        }
        let asks = !around.is_empty() || self.limits.is_some();
        let (triangles, own) = (self.scene.geometry.triangles.len(), self.scene.geometry.len());
        let is_triangle = |i: u32| (i as usize) < triangles || (i as usize >= own && i != Hits::MISS);
        let mut face = Face::none(self.scene);
        let t = shot.t.as_flattened();
        for (i, (ring, range)) in rings.iter().zip(sight.ranges).enumerate() {
            let (primitive, direction) = (shot.primitive[i], shot.direction(i));
            let in_range = *range >= instrument.range_min && *range <= instrument.range_max;
            if !asks && is_triangle(primitive) && in_range {
                face.turn_to(self, primitive);
                let cosine = if self.fixed_incidence { 1.0 } else { face.plane_cosine(direction) };
                out.add((i as u32, *ring), (*range, *range), primitive, cosine, face.factor(cosine));
            } else if primitive != Hits::MISS || !around.is_empty() {
                let first = Encounter { from: shot.origin, t: t[i], primitive, range: *range, stop: *range };
                let end = if spreads {
                    self.spread((instrument, *ring), (shot.origin, direction), first, around, (paths, probe))
                } else if c.adjacent_voxels {
                    self.cross(instrument, shot.origin, direction, first, around, paths)
                } else {
                    self.follow(instrument, shot.origin, direction, first, paths)
                };
                let Some(at) = end else { continue };
                face.turn_to(self, at.primitive);
                let Leaves { cosine, factor } = face.response(&at, direction, self.fixed_incidence, c);
                if let Some(sigma) = foliage::cross_section(face.scene, c, face.local, direction) {
                    probe.foliage.push((out.count(), sigma));
                }
                let entry = if c.voxel_stop_point { at.stop } else { at.range };
                out.add((i as u32, *ring), (at.stop, entry), at.primitive, cosine, factor);
            }
        }
        out.illuminate(instrument, &probe.foliage);
        if spreads {
            probe.continuum.emit(out);
        }
    }

    /// Follows a subray of `ring` through foliage to what reflects it behind, or `None`: where foliage intercepts it, the
    /// light from there joins that of the pulse.
    fn spread(
        &self,
        (instrument, ring): (&Instrument, u32),
        (origin, direction): (DVec3, DVec3),
        first: Encounter,
        around: &[u32],
        (paths, probe): (&mut FreePaths, &mut Probe),
    ) -> Option<Encounter> {
        let continuum = &mut probe.continuum;
        let behind = self.collect(instrument, (origin, direction), first, around, &mut continuum.stretches);
        if continuum.stretches.is_empty() {
            return behind;
        }
        let end = behind.map_or(f64::INFINITY, |b| b.range);
        // The optical depth at which the light is intercepted.
        if paths.next(1.0) > depth(&continuum.stretches, end) {
            return behind;
        }
        let leaves = |stretch: &Stretch| {
            let mut face = Face::none(self.scene);
            face.turn_to(self, stretch.entry.primitive);
            face.response(&stretch.entry, direction, self.fixed_incidence, &instrument.corrections)
        };
        continuum.scatter(instrument, ring, end, leaves);
        None
    }

    /// The voxels of foliage around a pulse's origin, if they are to be seen at all.
    fn voxels_around(&self, instrument: &Instrument, origin: DVec3) -> Vec<u32> {
        let b = self.scene.bounds;
        let may = instrument.corrections.adjacent_voxels
            && self.largest_cube > 0.0
            && origin.cmpge(b.min).all()
            && origin.cmple(b.max).all();
        let around = |scene, tree| foliage::around(scene, tree, origin, self.largest_cube);
        if !may {
            return Vec::new();
        }
        let moving = self.moving.iter().flat_map(|a| {
            around(&a.scene, &a.tree).into_iter().map(|voxel| a.to_scene_index(voxel)).collect::<Vec<_>>()
        });
        around(self.scene, self.tree).into_iter().chain(moving).collect()
    }

    /// The scene that shows primitive `i` where it is now, and its number there.
    #[inline]
    pub fn shown(&self, i: u32) -> (&'a Scene, u32) {
        let moving = self.moving.iter().find_map(|a| Some((&a.scene, a.to_object_index(i)?)));
        moving.unwrap_or((self.scene, i))
    }

    /// Whether primitive `i` belongs to a moving part.
    pub fn moves(&self, i: u32) -> bool {
        self.moving.iter().any(|a| a.to_object_index(i).is_some())
    }

    /// Follows a subray from what it met first to what reflects it (§2.7), or `None`.
    #[inline(never)]
    fn follow(
        &self,
        instrument: &Instrument,
        origin: DVec3,
        direction: DVec3,
        mut at: Encounter,
        paths: &mut FreePaths,
    ) -> Option<Encounter> {
        let corrections = &instrument.corrections;
        loop {
            if at.primitive == Hits::MISS || !at.range.is_finite() {
                return None;
            }
            let (scene, local) = self.shown(at.primitive);
            let by_stop = corrections.voxel_stop_point && foliage::scatters(scene, local);
            let next = match self.standing(&at, direction) {
                Standing::Beyond => return None,
                Standing::Before(entry) => entry,
                Standing::Inside if at.range > instrument.range_max => return None,
                Standing::Inside if at.range < instrument.range_min && !by_stop => {
                    if !corrections.see_through_near {
                        return None;
                    }
                    at.point(direction) + direction * STEP_BEHIND
                }
                Standing::Inside => {
                    match foliage::pass(scene, corrections, local, (at.from, direction), at.t, paths) {
                        Passage::Stops(0.0) => return Some(at),
                        Passage::Stops(path) => {
                            at.stop = distance((at.point(direction) + direction * path) - origin);
                            let within = at.stop >= instrument.range_min && at.stop <= instrument.range_max;
                            return (within || !by_stop).then_some(at);
                        }
                        Passage::Lost => return None,
                        Passage::Leaves(exit) => at.from + direction * exit + direction * STEP_BEHIND,
                    }
                }
            };
            if next == at.from {
                return None;
            }
            at = self.first_behind(next, direction, origin, |_| true);
        }
    }

    /// Where an encounter lies relative to the scene's box. Only moving parts ever leave it (§6).
    pub(super) fn standing(&self, at: &Encounter, direction: DVec3) -> Standing {
        let Some(b) = self.limits else { return Standing::Inside };
        let point = at.point(direction);
        if point.cmpge(b.min - BOX_SLACK).all() && point.cmple(b.max + BOX_SLACK).all() {
            return Standing::Inside;
        }
        match b.slabs(at.from, direction) {
            Some((enter, exit)) if at.t <= exit + BOX_SLACK => {
                if at.t < enter - BOX_SLACK {
                    Standing::Before(at.from + direction * (enter - BOX_SLACK))
                } else {
                    Standing::Inside
                }
            }
            _ => Standing::Beyond,
        }
    }

    /// What a ray meets first from a point on its way on, of what `accept` approves; `origin` is the pulse's.
    pub(super) fn first_behind(
        &self,
        from: DVec3,
        direction: DVec3,
        origin: DVec3,
        accept: impl Fn(u32) -> bool,
    ) -> Encounter {
        let hit = self.tree.nearest_where(&self.scene.geometry, from, direction, &accept);
        let nearest = self.moving.iter().fold(hit, |best, actor| {
            let accept = |i| accept(actor.to_scene_index(i));
            let hit = actor.tree.nearest_where(&actor.scene.geometry, from, direction, accept);
            nearer(best, hit.map(|h| Hit { primitive: actor.to_scene_index(h.primitive), ..h }))
        });
        let Some(hit) = nearest else {
            return Encounter {
                from,
                t: f64::INFINITY,
                primitive: Hits::MISS,
                range: f64::INFINITY,
                stop: f64::INFINITY,
            };
        };
        let range = distance((from + direction * hit.t) - origin);
        Encounter { from, t: hit.t, primitive: hit.primitive, range, stop: range }
    }
}

/// A ray meets a primitive.
#[derive(Clone, Copy, Debug)]
pub(super) struct Encounter {
    /// Where this stretch of the ray began.
    pub from: DVec3,
    /// Way from there, m; 0 where the ray began within foliage.
    pub t: f64,
    /// What it met, or [`Hits::MISS`].
    pub primitive: u32,
    /// Distance of the entry from the pulse's origin, m.
    pub range: f64,
    /// Distance of what reflects the ray from there, m: behind the entry in foliage.
    pub stop: f64,
}

impl Encounter {
    pub fn point(&self, direction: DVec3) -> DVec3 {
        self.from + direction * self.t
    }
}

/// See [`View::standing`].
pub(super) enum Standing {
    Inside,
    /// The box begins here, behind the encounter.
    Before(DVec3),
    Beyond,
}

/// The nearer of two hits; of equally near ones that of the smaller number.
fn nearer(a: Option<Hit>, b: Option<Hit>) -> Option<Hit> {
    match (a, b) {
        (Some(a), Some(b)) if (b.t, b.primitive) < (a.t, a.primitive) => Some(b),
        (a, b) => a.or(b),
    }
}

/// √(x² + y² + z²), added in this order.
pub(super) fn distance(d: DVec3) -> f64 {
    (d.x * d.x + d.y * d.y + d.z * d.z).sqrt()
}

/// The primitive that was met last: neighbouring subrays mostly meet the same.
struct Face<'a> {
    primitive: u32,
    /// The scene that shows it, and its number there.
    scene: &'a Scene,
    local: u32,
    material: Option<&'a Material>,
    /// Unit normal of a triangle or of a cube that has one.
    normal: Option<DVec3>,
}

impl<'a> Face<'a> {
    fn none(scene: &'a Scene) -> Face<'a> {
        Face { primitive: Hits::MISS, scene, local: Hits::MISS, material: None, normal: None }
    }

    fn turn_to(&mut self, view: &View<'a>, primitive: u32) {
        if self.primitive == primitive {
            return;
        }
        let (scene, local) = view.shown(primitive);
        let normal = match scene.triangle(local) {
            Some([a, b, c]) => Some(unit((b - a).cross(c - a))),
            None => scene.voxel(local).and_then(Voxel::normal),
        };
        *self = Face { primitive, scene, local, material: Some(scene.material_of(local)), normal };
    }

    /// Cosine of the incidence angle (§2.4).
    fn cosine(&self, at: &Encounter, direction: DVec3) -> f64 {
        if self.normal.is_some() {
            return self.plane_cosine(direction);
        }
        let geometry = &self.scene.geometry;
        let cube = &geometry.cubes[self.local as usize - geometry.triangles.len()];
        face_of_cube(at.point(direction) - cube.centre, cube.half).dot(direction).abs().min(1.0)
    }

    /// The same of a primitive that has a normal.
    fn plane_cosine(&self, direction: DVec3) -> f64 {
        self.normal.map_or(1.0, |n| n.dot(direction).abs().min(1.0))
    }

    /// How a surface or foliage reflects what came in at `at`.
    fn response(&self, at: &Encounter, direction: DVec3, fixed_incidence: bool, c: &Corrections) -> Leaves {
        if !fixed_incidence && c.foliage_incidence && foliage::scatters(self.scene, self.local) {
            let cosine = foliage::mean_cosine(self.scene, c, self.local, direction);
            return Leaves { cosine, factor: self.material.map_or(0.0, |m| m.leaf_factor(cosine)) };
        }
        let cosine = if fixed_incidence { 1.0 } else { self.cosine(at, direction) };
        Leaves { cosine, factor: self.factor(cosine) }
    }

    /// Reflectance factor.
    fn factor(&self, cosine: f64) -> f64 {
        self.material.map_or(0.0, |m| m.factor(cosine))
    }
}

/// Normal of the cube's face whose centre is nearest to `p` (relative to the cube's centre): of equally near ones the
/// first of +x, −x, +y, −y, +z, −z.
fn face_of_cube(p: DVec3, half: f64) -> DVec3 {
    let faces = [DVec3::X, DVec3::NEG_X, DVec3::Y, DVec3::NEG_Y, DVec3::Z, DVec3::NEG_Z];
    let mut best = (f64::INFINITY, DVec3::X);
    for normal in faces {
        let d = (p - normal * half).length_squared();
        if d < best.0 {
            best = (d, normal);
        }
    }
    best.1
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::Rotation;
    use crate::pulse::sight::Sights;
    use crate::pulse::subray::Subrays;
    use crate::pulse::testkit::{foliage, half_white, rectangles, tls_instrument, tree, wall};
    use crate::rng::{Purpose, Stream};
    use crate::scene::{Reflection, VoxelKind};
    use crate::tree::RayGroup;

    #[test]
    fn the_nearest_face_of_a_cube_gives_its_normal() {
        for n in [DVec3::X, DVec3::NEG_X, DVec3::Y, DVec3::NEG_Y, DVec3::Z, DVec3::NEG_Z] {
            assert_eq!(face_of_cube(n * 0.5 + DVec3::splat(0.1), 0.5), n);
        }
        assert_eq!(face_of_cube(DVec3::new(0.5, 0.5, 0.5), 0.5), DVec3::X, "the first of equals");
    }

    /// What becomes of a pulse from the world's origin whose axis is turned off +y, as `ask` has it.
    fn shoot<R>(
        scene: &Scene,
        instrument: &Instrument,
        turn: &Rotation,
        ask: impl FnOnce(&View, (Shot, Sight), &mut FreePaths) -> R,
    ) -> R {
        let tree = tree(scene);
        let view =
            View { scene, tree: &tree, moving: &[], limits: None, fixed_incidence: false, largest_cube: 1.0 };
        let mut rays = RayGroup::new(instrument.subrays.len());
        instrument.subrays.expand(0, turn, rays.add(-scene.shift));
        let mut hits = Hits::default();
        tree.trace_group(&scene.geometry, &rays, &mut hits);
        let (shot, mut sights) = (Shot::of(&rays, &hits, 0), Sights::default());
        sights.push(instrument, &shot);
        let mut paths =
            FreePaths { stream: Stream::new(0, Purpose::FreePath), device: 0, pulse: 1, drawn: 0 };
        ask(&view, (shot, sights.of(0, &shot)), &mut paths)
    }

    /// Room for the reflections of a pulse.
    fn room(instrument: &Instrument) -> Reflections {
        let mut out = Reflections::default();
        out.clear(instrument.subrays.len());
        out
    }

    fn assert_same(one: &Reflections, other: &Reflections) {
        assert_eq!(one.primitives(), other.primitives());
        assert_eq!(one.ranges(), other.ranges());
        assert_eq!(one.entries(), other.entries());
        assert_eq!(one.cosines(), other.cosines());
        assert_eq!(one.intensities(), other.intensities());
    }

    #[test]
    fn triangles_reflect_together_as_one_by_one() {
        // Boards with gaps between them, the farthest of them out of range.
        let boards: Vec<_> =
            (0..12).map(|i| wall(f64::from(i) - 6.3, f64::from(i) - 5.7, f64::from(9 + i))).collect();
        let shiny = |i: u32| match i % 5 {
            0 => Reflection::Uniform,
            1 => Reflection::Lambert,
            2 => Reflection::Phong { specularity: 0.3, exponent: 7.0 },
            3 => Reflection::Lobes { specularity: 0.0, exponent: 7.0, roughness: 0.0 },
            _ => Reflection::Lobes { specularity: 0.4, exponent: 7.0, roughness: 0.3 },
        };
        let (mut some, mut none) = (0, 0);
        for round in 0..60u32 {
            let scene = rectangles(Material { reflection: shiny(round), ..half_white() }, &boards);
            let mut instrument = tls_instrument(5.0);
            (instrument.range_min, instrument.range_max) = (9.5, 18.5);
            instrument.subrays = Subrays::new(0.02 * f64::from(round % 9), 3);
            let turn = Rotation::about_z(f64::from(round) * 0.02 - 0.6);
            shoot(&scene, &instrument, &turn, |view, seen, paths| {
                let view = View { fixed_incidence: round % 7 == 0, ..*view };
                let (mut plain, mut each) = (room(&instrument), room(&instrument));
                let mut probe = Probe::default();
                assert!(view.reflect_plainly(&instrument, seen, &mut probe.facets, &mut plain));
                view.reflect_each(&instrument, seen, &[], paths, &mut probe, &mut each);
                assert_same(&plain, &each);
                some += plain.primitives().len();
                none += instrument.subrays.len() - plain.primitives().len();
            });
        }
        assert!(some > 200 && none > 200, "{some} {none}");
    }

    /// The first eight subrays pass beside the cubes to the wall behind them, some of the others do not.
    #[test]
    fn what_the_plain_way_found_before_a_voxel_counts_once() {
        let cubes: Vec<_> = (0..5).map(|i| (f64::from(100 + i), 0.0, VoxelKind::Opaque)).collect();
        let scene = foliage(&cubes, None);
        let mut instrument = tls_instrument(5.0);
        instrument.subrays = Subrays::new(0.01, 3);
        shoot(&scene, &instrument, &Rotation::about_z(-0.01), |view, seen, paths| {
            let (mut plain, mut each, mut out) = (room(&instrument), room(&instrument), room(&instrument));
            let mut probe = Probe::default();
            assert!(!view.reflect_plainly(&instrument, seen, &mut probe.facets, &mut plain));
            assert_eq!(plain.count(), 8);
            view.reflect_each(&instrument, seen, &[], paths, &mut probe, &mut each);
            view.reflect(&instrument, seen, paths, &mut probe, &mut out);
            assert_eq!(out.count(), instrument.subrays.len());
            assert_same(&out, &each);
        });
    }

    #[test]
    fn opaque_cubes_reflect_like_their_nearest_face() {
        let scene = foliage(&[(10.0, 0.0, VoxelKind::Opaque)], None);
        let mut instrument = tls_instrument(5.0);
        instrument.subrays = Subrays::new(0.0, 1);
        let turn = Rotation::about_x(0.01);
        let mut out = Reflections::default();
        shoot(&scene, &instrument, &turn, |view, seen, paths| {
            view.reflect(&instrument, seen, paths, &mut Probe::default(), &mut out);
        });
        let d = turn.forward();
        assert_eq!(out.primitives(), [0]);
        assert!((out.ranges()[0] - 10.0 / d.y).abs() < 1e-12);
        assert!((out.cosines()[0] - d.y).abs() < 1e-15);
    }
}
