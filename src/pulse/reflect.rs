//! From what the subrays hit to reflections (spec pulse-physics §2).

use super::instrument::Instrument;
use crate::geom::{Aabb, DVec3, unit};
use crate::scene::{Material, Scene};
use crate::tree::{Hits, RayBundle, Tree};

/// How far behind a surface a ray goes on, m.
const STEP_BEHIND: f64 = 1e-5;
/// Tolerance of the scene's box, m.
const BOX_SLACK: f64 = 1e-4;

/// The reflections of a pulse in the order of its subrays, field by field.
#[derive(Clone, Debug, Default)]
pub(super) struct Reflections {
    /// Range of what sends light back, m.
    pub range: Vec<f64>,
    /// Range at which the ray entered the primitive, m: what attribution goes by.
    pub entry: Vec<f64>,
    /// Received intensity.
    pub intensity: Vec<f64>,
    /// Cosine of the incidence angle.
    pub cosine: Vec<f64>,
    /// Number of the primitive.
    pub primitive: Vec<u32>,
    /// Ring of the subray.
    ring: Vec<u32>,
}

impl Reflections {
    /// Forgets all of them.
    pub fn clear(&mut self) {
        self.range.clear();
        self.entry.clear();
        self.intensity.clear();
        self.cosine.clear();
        self.primitive.clear();
        self.ring.clear();
    }

    /// Adds one; `strength` becomes an intensity later.
    pub fn push(&mut self, ring: u32, range: f64, primitive: u32, cosine: f64, strength: f64) {
        self.range.push(range);
        self.entry.push(range);
        self.intensity.push(strength);
        self.cosine.push(cosine);
        self.primitive.push(primitive);
        self.ring.push(ring);
    }

    /// Whether nothing was reflected.
    pub fn is_empty(&self) -> bool {
        self.range.is_empty()
    }
}

/// The scene as rays see it.
#[derive(Clone, Copy, Debug)]
pub(super) struct View<'a> {
    /// What there is.
    pub scene: &'a Scene,
    /// Finds what is hit.
    pub tree: &'a Tree,
    /// The scene's box, outside of which nothing is visible; `None` when nothing lies outside, or may be seen there.
    pub limits: Option<Aabb>,
    /// All surfaces face the beam.
    pub fixed_incidence: bool,
}

/// Memory for the way of single rays.
#[derive(Clone, Debug, Default)]
pub(super) struct Probe {
    ranges: Vec<f64>,
    rays: RayBundle,
    hits: Hits,
}

impl<'a> View<'a> {
    /// Replaces `out` by the reflections of a pulse's subrays, in their order.
    pub fn reflect(
        &self,
        instrument: &Instrument,
        rays: &RayBundle,
        hits: &Hits,
        probe: &mut Probe,
        out: &mut Reflections,
    ) {
        out.clear();
        measure(rays, hits, &mut probe.ranges);
        let mut face = Face::none();
        for (i, ring) in instrument.subrays.ring.iter().enumerate() {
            let mut at = Encounter {
                from: rays.origin,
                t: hits.t[i],
                primitive: hits.primitive[i],
                range: probe.ranges[i],
            };
            if !self.stops_at(instrument, &at) {
                match self.follow(instrument, rays.origin, rays.direction(i), at, probe) {
                    Some(behind) => at = behind,
                    None => continue,
                }
            }
            if face.primitive != at.primitive {
                face = Face::of(self.scene, at.primitive);
            }
            let cosine =
                if self.fixed_incidence { 1.0 } else { face.cosine(self.scene, &at, rays.direction(i)) };
            out.push(*ring, at.range, at.primitive, cosine, face.material_factor(cosine));
        }
        instrument.energy.apply(&out.ring, &out.entry, &mut out.intensity);
    }

    /// Whether a ray that met this is reflected here, without further questions.
    fn stops_at(&self, instrument: &Instrument, at: &Encounter) -> bool {
        at.primitive != Hits::MISS
            && self.limits.is_none()
            && at.range >= instrument.range_min
            && at.range <= instrument.range_max
    }

    /// Follows a subray from what it met first to what reflects it (§2.7), or `None`.
    fn follow(
        &self,
        instrument: &Instrument,
        origin: DVec3,
        direction: DVec3,
        mut at: Encounter,
        probe: &mut Probe,
    ) -> Option<Encounter> {
        loop {
            if at.primitive == Hits::MISS || !at.range.is_finite() {
                return None;
            }
            let next = match self.standing(&at, direction) {
                Standing::Beyond => return None,
                Standing::Before(entry) => entry,
                Standing::Inside if at.range > instrument.range_max => return None,
                Standing::Inside if at.range >= instrument.range_min => return Some(at),
                Standing::Inside if !instrument.corrections.see_through_near => return None,
                Standing::Inside => at.point(direction) + direction * STEP_BEHIND,
            };
            if next == at.from {
                return None;
            }
            at = self.first_behind(next, direction, origin, probe);
        }
    }

    /// Where an encounter lies relative to the scene's box. Only moving parts ever leave it (§6).
    fn standing(&self, at: &Encounter, direction: DVec3) -> Standing {
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

    /// What a ray meets first from a point on its way on; `origin` is the pulse's.
    fn first_behind(&self, from: DVec3, direction: DVec3, origin: DVec3, probe: &mut Probe) -> Encounter {
        let Probe { rays, hits, .. } = probe;
        rays.origin = from;
        for (lane, component) in
            [(&mut rays.x, direction.x), (&mut rays.y, direction.y), (&mut rays.z, direction.z)]
        {
            lane.clear();
            lane.push(component);
        }
        self.tree.trace(&self.scene.geometry, rays, hits);
        let mut at = Encounter { from, t: hits.t[0], primitive: hits.primitive[0], range: f64::INFINITY };
        if at.primitive != Hits::MISS {
            at.range = distance(at.point(direction) - origin);
        }
        at
    }
}

/// A ray meets a primitive.
#[derive(Clone, Copy, Debug)]
struct Encounter {
    /// Where this stretch of the ray began.
    from: DVec3,
    /// Way from there, m.
    t: f64,
    /// What it met, or [`Hits::MISS`].
    primitive: u32,
    /// Distance from the pulse's origin, m.
    range: f64,
}

impl Encounter {
    fn point(&self, direction: DVec3) -> DVec3 {
        self.from + direction * self.t
    }
}

/// See [`View::standing`].
enum Standing {
    Inside,
    /// The box begins here, behind the encounter.
    Before(DVec3),
    Beyond,
}

/// Distance of every hit from the origin, of the point that it has in the scene's frame: that rounding decides which
/// ranges are equal (§4.2).
fn measure(rays: &RayBundle, hits: &Hits, ranges: &mut Vec<f64>) {
    let n = rays.len().min(hits.t.len());
    ranges.resize(n, 0.0);
    let o = rays.origin;
    let (x, y, z, t) = (&rays.x[..n], &rays.y[..n], &rays.z[..n], &hits.t[..n]);
    for (i, range) in ranges[..n].iter_mut().enumerate() {
        let (dx, dy, dz) = ((o.x + x[i] * t[i]) - o.x, (o.y + y[i] * t[i]) - o.y, (o.z + z[i] * t[i]) - o.z);
        *range = (dx * dx + dy * dy + dz * dz).sqrt();
    }
}

/// √(x² + y² + z²), added in this order.
fn distance(d: DVec3) -> f64 {
    (d.x * d.x + d.y * d.y + d.z * d.z).sqrt()
}

/// The primitive that was met last: neighbouring subrays mostly meet the same.
struct Face<'a> {
    primitive: u32,
    material: Option<&'a Material>,
    /// Unit normal of a triangle; a cube has none of its own.
    normal: Option<DVec3>,
}

impl<'a> Face<'a> {
    fn none() -> Face<'a> {
        Face { primitive: Hits::MISS, material: None, normal: None }
    }

    fn of(scene: &'a Scene, primitive: u32) -> Face<'a> {
        let i = primitive as usize;
        let normal = (i < scene.geometry.triangles.len()).then(|| {
            let [a, b, c] = scene.geometry.triangle(i);
            unit((b - a).cross(c - a))
        });
        Face { primitive, material: Some(scene.material_of(primitive)), normal }
    }

    /// Cosine of the incidence angle (§2.4).
    fn cosine(&self, scene: &Scene, at: &Encounter, direction: DVec3) -> f64 {
        let normal = self.normal.unwrap_or_else(|| {
            let cube = &scene.geometry.cubes[at.primitive as usize - scene.geometry.triangles.len()];
            face_of_cube(at.point(direction) - cube.centre, cube.half)
        });
        normal.dot(direction).abs().min(1.0)
    }

    fn material_factor(&self, cosine: f64) -> f64 {
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
    use crate::pulse::testkit::{half_white, tls_instrument, tree};
    use crate::scene::{Part, Surface};
    use crate::tree::Cube;

    #[test]
    fn the_nearest_face_of_a_cube_gives_its_normal() {
        for n in [DVec3::X, DVec3::NEG_X, DVec3::Y, DVec3::NEG_Y, DVec3::Z, DVec3::NEG_Z] {
            assert_eq!(face_of_cube(n * 0.5 + DVec3::splat(0.1), 0.5), n);
        }
        assert_eq!(face_of_cube(DVec3::new(0.5, 0.5, 0.5), 0.5), DVec3::X, "the first of equals");
    }

    #[test]
    fn opaque_cubes_reflect_like_their_nearest_face() {
        let mut scene = Scene {
            surface_of: vec![0],
            surfaces: vec![Surface { part: 0, material: 0 }],
            parts: vec![Part { id: "1".to_owned() }],
            materials: vec![half_white()],
            ..Scene::default()
        };
        scene.geometry.cubes.push(Cube { centre: DVec3::new(0.0, 10.5, 0.0), half: 0.5 });
        scene.bounds = scene.geometry.bounds();
        let tree = tree(&scene);
        let view = View { scene: &scene, tree: &tree, limits: Some(scene.bounds), fixed_incidence: false };
        let mut instrument = tls_instrument(5.0);
        instrument.subrays = crate::pulse::subray::Subrays::new(0.0, 1);
        let direction = unit(DVec3::new(0.0, 10.0, 0.1));
        let rays = RayBundle {
            origin: DVec3::ZERO,
            x: vec![direction.x],
            y: vec![direction.y],
            z: vec![direction.z],
        };
        let hits = Hits { t: vec![10.0 / direction.y], primitive: vec![0] };
        let mut out = Reflections::default();
        view.reflect(&instrument, &rays, &hits, &mut Probe::default(), &mut out);
        assert_eq!(out.primitive, [0]);
        assert!((out.range[0] - 10.0 / direction.y).abs() < 1e-12);
        assert!((out.cosine[0] - direction.y).abs() < 1e-15);
    }
}
