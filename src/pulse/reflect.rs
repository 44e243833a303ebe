//! From what the subrays hit to reflections (spec pulse-physics §2).

use super::energy::{Block, LANES};
use super::facet::Facets;
use super::foliage::{self, FreePaths, Passage};
use super::instrument::Instrument;
use crate::geom::{Aabb, DVec3, unit};
use crate::scene::{Actor, Material, Scene, Voxel};
use crate::tree::{Hit, Hits, RayGroup, Tree, prefetch};

/// How far behind a surface a ray goes on, m.
pub(super) const STEP_BEHIND: f64 = 1e-5;
/// Tolerance of the scene's box, m.
const BOX_SLACK: f64 = 1e-4;

/// The reflections of a pulse in the order of its subrays, field by field.
#[derive(Clone, Debug, Default)]
pub(super) struct Reflections {
    /// How many there are; the fields are longer.
    count: usize,
    /// All of them where the rays entered, so that `entry` and `ring` are not filled in.
    is_plain: bool,
    range: Vec<f64>,
    entry: Vec<f64>,
    intensity: Vec<f64>,
    cosine: Vec<f64>,
    primitive: Vec<u32>,
    ring: Vec<u32>,
}

impl Reflections {
    /// Forgets all of them and makes room for `most` in whole blocks.
    pub fn clear(&mut self, most: usize) {
        let most = most.next_multiple_of(LANES);
        self.count = 0;
        self.is_plain = false;
        if self.range.len() < most {
            for field in [&mut self.range, &mut self.entry, &mut self.intensity, &mut self.cosine] {
                field.resize(most, 0.0);
            }
            self.primitive.resize(most, Hits::MISS);
            self.ring.resize(most, 0);
        }
    }

    /// Adds one; its reflectance factor becomes an intensity later.
    pub fn add(&mut self, ring: u32, (range, entry): (f64, f64), primitive: u32, cosine: f64, factor: f64) {
        let i = self.count;
        self.range[i] = range;
        self.entry[i] = entry;
        self.intensity[i] = factor;
        self.cosine[i] = cosine;
        self.primitive[i] = primitive;
        self.ring[i] = ring;
        self.count += 1;
    }

    /// Adds those of a block's subrays that `which` names; their entries and rings are not filled in.
    #[inline(always)]
    fn add_plain(&mut self, which: Lanes, range: &Block, intensity: &Block, cosine: &Block, primitive: &[u32; LANES]) {
        let first = self.count;
        self.count += which.count();
        if which.are_first() {
            // The others are overwritten by what follows, or lie behind the last.
            let row = first..first + LANES;
            self.range[row.clone()].copy_from_slice(range);
            self.intensity[row.clone()].copy_from_slice(intensity);
            self.cosine[row.clone()].copy_from_slice(cosine);
            self.primitive[row].copy_from_slice(primitive);
            return;
        }
        for (to, from) in (first..).zip(which) {
            self.range[to] = range[from];
            self.intensity[to] = intensity[from];
            self.cosine[to] = cosine[from];
            self.primitive[to] = primitive[from];
        }
    }

    /// Turns factors into intensities, and gives those in `foliage` (position, cross-section) theirs.
    fn illuminate(&mut self, instrument: &Instrument, foliage: &[(usize, f64)]) {
        let n = self.count;
        instrument.energy.apply(&self.ring[..n], &self.entry[..n], &mut self.intensity[..n]);
        for (i, sigma) in foliage {
            self.intensity[*i] = instrument.energy.of_cross_section(self.ring[*i], self.entry[*i], *sigma);
        }
    }

    /// Whether nothing was reflected.
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// Ranges of what sends light back, m.
    pub fn ranges(&self) -> &[f64] {
        &self.range[..self.count]
    }

    /// Ranges at which the rays entered the primitives, m: what attribution goes by.
    pub fn entries(&self) -> &[f64] {
        if self.is_plain { self.ranges() } else { &self.entry[..self.count] }
    }

    /// Received intensities.
    pub fn intensities(&self) -> &[f64] {
        &self.intensity[..self.count]
    }

    /// Cosines of the incidence angles.
    pub fn cosines(&self) -> &[f64] {
        &self.cosine[..self.count]
    }

    /// Numbers of the primitives.
    pub fn primitives(&self) -> &[u32] {
        &self.primitive[..self.count]
    }
}

/// Some subrays of a block: a byte of each is 1 or 0.
#[derive(Clone, Copy, Debug)]
struct Lanes(u64);

impl Lanes {
    #[inline(always)]
    fn of(which: [u8; LANES]) -> Lanes {
        Lanes(u64::from_le_bytes(which))
    }

    #[inline(always)]
    fn first(self) -> Option<usize> {
        (self.0 != 0).then(|| self.0.trailing_zeros() as usize / 8)
    }

    #[inline(always)]
    fn without(self, others: Lanes) -> Lanes {
        Lanes(self.0 & !others.0)
    }

    #[inline(always)]
    fn count(self) -> usize {
        self.0.count_ones() as usize
    }

    /// Whether none is missing before the last of them.
    #[inline(always)]
    fn are_first(self) -> bool {
        self.0 & ((self.0 << 8) | 1) == self.0
    }
}

impl Iterator for Lanes {
    type Item = usize;

    #[inline(always)]
    fn next(&mut self) -> Option<usize> {
        let first = self.first()?;
        self.0 &= self.0 - 1;
        Some(first)
    }
}

/// The scene as rays see it.
#[derive(Clone, Copy, Debug)]
pub(super) struct View<'a> {
    /// What there is.
    pub scene: &'a Scene,
    /// Finds what is hit of it, other than the moving parts.
    pub tree: &'a Tree,
    /// The moving parts where they are seen now.
    pub moving: &'a [Actor],
    /// The scene's box, outside of which nothing is visible; `None` when nothing lies outside, or may be seen there.
    pub limits: Option<Aabb>,
    /// All surfaces face the beam.
    pub fixed_incidence: bool,
    /// Edge of the largest cube, m.
    pub largest_cube: f64,
}

/// The traced subrays of a pulse.
#[derive(Clone, Copy, Debug)]
pub(super) struct Shot<'a> {
    /// Where all of them began, m.
    pub origin: DVec3,
    directions: [&'a [Block]; 3],
    t: &'a [Block],
    /// As many as there are subrays; the others are filled up to whole blocks.
    primitive: &'a [u32],
    /// The same in whole blocks.
    met: &'a [[u32; LANES]],
}

impl<'a> Shot<'a> {
    /// Pulse `pulse` of a group and what it hit.
    #[inline(always)]
    pub fn of(group: &'a RayGroup, hits: &'a Hits, pulse: usize) -> Shot<'a> {
        let row = pulse * group.stride();
        Shot {
            origin: group.origin(pulse),
            directions: group.blocks(pulse),
            t: hits.t[row..row + group.stride()].as_chunks().0,
            primitive: &hits.primitive[row..row + group.rays()],
            met: hits.primitive[row..row + group.stride()].as_chunks().0,
        }
    }

    /// Asks for what the hits will be looked up by, ahead of their turn: some of them stand for their neighbours.
    #[inline(always)]
    pub fn foresee(&self, scene: &Scene) {
        for primitive in self.primitive.iter().step_by(4) {
            let primitive = *primitive as usize;
            if let Some(triangle) = scene.geometry.triangles.get(primitive) {
                prefetch(triangle);
                scene.surface_of.prefetch(primitive);
            }
        }
    }

    /// Blocks that the subrays fill.
    #[inline(always)]
    pub fn blocks(&self) -> usize {
        self.t.len()
    }

    #[inline(always)]
    fn direction(&self, i: usize) -> DVec3 {
        let [x, y, z] = self.directions.map(|d| d.as_flattened());
        DVec3::new(x[i], y[i], z[i])
    }

    /// Distance of every hit from the origin, of the point that it has in the scene's frame: that rounding decides which
    /// ranges are equal (§4.2).
    #[inline(always)]
    fn measure(&self, ranges: &mut [Block]) {
        let (o, [x, y, z]) = (self.origin, self.directions);
        for ((((range, x), y), z), t) in ranges.iter_mut().zip(x).zip(y).zip(z).zip(self.t) {
            for i in 0..LANES {
                let (dx, dy, dz) =
                    ((o.x + x[i] * t[i]) - o.x, (o.y + y[i] * t[i]) - o.y, (o.z + z[i] * t[i]) - o.z);
                range[i] = (dx * dx + dy * dy + dz * dz).sqrt();
            }
        }
    }
}

/// Ranges and gains of the subrays of some pulses, one pulse after the other.
#[derive(Clone, Debug, Default)]
pub(super) struct Sights {
    ranges: Vec<Block>,
    gains: Vec<Block>,
}

impl Sights {
    /// Forgets all pulses.
    pub fn clear(&mut self) {
        self.ranges.clear();
        self.gains.clear();
    }

    /// Appends the ranges of a pulse, and what an instrument gains of a perfect reflector there (§3).
    #[inline(always)]
    pub fn push(&mut self, instrument: &Instrument, shot: &Shot) {
        let (first, end) = (self.ranges.len(), self.ranges.len() + shot.t.len());
        self.ranges.resize(end, [0.0; LANES]);
        self.gains.resize(end, [0.0; LANES]);
        shot.measure(&mut self.ranges[first..]);
        instrument.energy.gains(&self.ranges[first..], &mut self.gains[first..]);
    }

    /// The pulse whose first block is number `first`.
    #[inline(always)]
    pub fn of(&self, first: usize, shot: &Shot) -> Sight<'_> {
        let row = first..first + shot.t.len();
        Sight { ranges: self.ranges[row.clone()].as_flattened(), gains: self.gains[row].as_flattened() }
    }
}

/// The same of one pulse, by subray.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sight<'a> {
    ranges: &'a [f64],
    gains: &'a [f64],
}

/// Memory for the way of single rays.
#[derive(Clone, Debug, Default)]
pub(super) struct Probe {
    foliage: Vec<(usize, f64)>,
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
        out.is_plain = true;
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
        let rings = &instrument.subrays.ring;
        probe.foliage.clear();
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
                out.add(*ring, (*range, *range), primitive, cosine, face.factor(cosine));
            } else if primitive != Hits::MISS || !around.is_empty() {
                let first = Encounter { from: shot.origin, t: t[i], primitive, range: *range, stop: *range };
                let end = if instrument.corrections.adjacent_voxels {
                    self.cross(instrument, shot.origin, direction, first, around, paths)
                } else {
                    self.follow(instrument, shot.origin, direction, first, paths)
                };
                let Some(at) = end else { continue };
                face.turn_to(self, at.primitive);
                let cosine = match instrument.corrections.foliage_incidence {
                    _ if self.fixed_incidence => 1.0,
                    true if foliage::scatters(face.scene, face.local) => foliage::MEAN_COSINE,
                    _ => face.cosine(&at, direction),
                };
                if let Some(sigma) = foliage::cross_section(face.scene, face.local, direction) {
                    probe.foliage.push((out.count, sigma));
                }
                let entry = if instrument.corrections.voxel_stop_point { at.stop } else { at.range };
                out.add(*ring, (at.stop, entry), at.primitive, cosine, face.factor(cosine));
            }
        }
        out.illuminate(instrument, &probe.foliage);
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
            around(&a.scene, &a.tree).into_iter().map(|voxel| a.global(voxel)).collect::<Vec<_>>()
        });
        around(self.scene, self.tree).into_iter().chain(moving).collect()
    }

    /// The scene that shows primitive `i` where it is now, and its number there.
    #[inline]
    pub fn shown(&self, i: u32) -> (&'a Scene, u32) {
        let moving = self.moving.iter().find_map(|a| Some((&a.scene, a.local(i)?)));
        moving.unwrap_or((self.scene, i))
    }

    /// Whether primitive `i` belongs to a moving part.
    pub fn moves(&self, i: u32) -> bool {
        self.moving.iter().any(|a| a.local(i).is_some())
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
            let accept = |i| accept(actor.global(i));
            let hit = actor.tree.nearest_where(&actor.scene.geometry, from, direction, accept);
            nearer(best, hit.map(|h| Hit { primitive: actor.global(h.primitive), ..h }))
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
    use crate::pulse::testkit::{foliage, tls_instrument, tree};
    use crate::rng::{Purpose, Stream};
    use crate::scene::VoxelKind;

    #[test]
    fn the_nearest_face_of_a_cube_gives_its_normal() {
        for n in [DVec3::X, DVec3::NEG_X, DVec3::Y, DVec3::NEG_Y, DVec3::Z, DVec3::NEG_Z] {
            assert_eq!(face_of_cube(n * 0.5 + DVec3::splat(0.1), 0.5), n);
        }
        assert_eq!(face_of_cube(DVec3::new(0.5, 0.5, 0.5), 0.5), DVec3::X, "the first of equals");
    }

    #[test]
    fn opaque_cubes_reflect_like_their_nearest_face() {
        let scene = foliage(&[(10.0, 0.0, VoxelKind::Opaque)], None);
        let tree = tree(&scene);
        let view = View {
            scene: &scene,
            tree: &tree,
            moving: &[],
            limits: None,
            fixed_incidence: false,
            largest_cube: 1.0,
        };
        let mut instrument = tls_instrument(5.0);
        instrument.subrays = crate::pulse::subray::Subrays::new(0.0, 1);
        let d = unit(DVec3::new(0.0, 10.0, 0.1));
        let mut rays = RayGroup::new(1);
        rays.push(DVec3::ZERO, |x, y, z| (x[0], y[0], z[0]) = (d.x, d.y, d.z));
        let mut hits = Hits::default();
        tree.trace_group(&scene.geometry, &rays, &mut hits);
        let mut paths =
            FreePaths { stream: Stream::new(0, Purpose::FreePath), device: 0, pulse: 1, drawn: 0 };
        let mut out = Reflections::default();
        let (shot, mut sights) = (Shot::of(&rays, &hits, 0), Sights::default());
        sights.push(&instrument, &shot);
        let seen = (shot, sights.of(0, &shot));
        view.reflect(&instrument, seen, &mut paths, &mut Probe::default(), &mut out);
        assert_eq!(out.primitives(), [0]);
        assert!((out.ranges()[0] - 10.0 / d.y).abs() < 1e-12);
        assert!((out.cosines()[0] - d.y).abs() < 1e-15);
    }
}
