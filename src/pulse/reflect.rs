//! From what the subrays hit to reflections (spec pulse-physics §2).

use super::energy::{Energy, Response};
use super::instrument::Instrument;
use crate::geom::{Aabb, DVec3, unit};
use crate::scene::Scene;
use crate::tree::{Hits, RayBundle, Tree};

/// How far behind a surface a ray goes on, m.
const STEP_BEHIND: f64 = 1e-5;
/// Tolerance of the scene's box, m.
const BOX_SLACK: f64 = 1e-4;

/// One subray's reflection.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Reflection {
    /// Range of what sends light back, m.
    pub range: f64,
    /// Range at which the ray entered the primitive, m: what attribution goes by.
    pub entry: f64,
    /// Received intensity.
    pub intensity: f64,
    /// Cosine of the incidence angle.
    pub cosine: f64,
    /// Number of the primitive.
    pub primitive: u32,
}

/// The scene as rays see it.
#[derive(Clone, Copy, Debug)]
pub(super) struct View<'a> {
    /// What there is.
    pub scene: &'a Scene,
    /// Finds what is hit.
    pub tree: &'a Tree,
    /// The scene's box, outside of which nothing is visible; `None` for no such limit.
    pub limits: Option<Aabb>,
    /// All surfaces face the beam.
    pub fixed_incidence: bool,
}

/// Memory for single rays that go on behind their first hit.
#[derive(Clone, Debug, Default)]
pub(super) struct Probe {
    rays: RayBundle,
    hits: Hits,
}

impl View<'_> {
    /// Appends the reflections of a pulse's subrays to `out`, in their order.
    pub fn reflections(
        &self,
        instrument: &Instrument,
        rays: &RayBundle,
        hits: &Hits,
        probe: &mut Probe,
        out: &mut Vec<Reflection>,
    ) {
        match &instrument.energy {
            Energy::Legacy(law) => self.follow_all(instrument, rays, hits, probe, out, |ring, range, r| {
                law.intensity(ring, range, r)
            }),
            Energy::Improved(law, legacy) => {
                self.follow_all(instrument, rays, hits, probe, out, |ring, range, r| match r {
                    Response::Factor(f) => law.intensity(ring, range, f),
                    Response::CrossSection(_) => legacy.intensity(ring, range, r),
                })
            }
        }
    }

    fn follow_all(
        &self,
        instrument: &Instrument,
        rays: &RayBundle,
        hits: &Hits,
        probe: &mut Probe,
        out: &mut Vec<Reflection>,
        intensity: impl Fn(u32, f64, Response) -> f64,
    ) {
        let mut face = Face::NONE;
        for (i, ring) in instrument.subrays.ring.iter().enumerate() {
            let direction = rays.direction(i);
            let first = Stretch { origin: rays.origin, t: hits.t[i], primitive: hits.primitive[i] };
            let Some((stretch, range)) = self.follow(instrument, rays.origin, direction, first, probe) else {
                continue;
            };
            let (cosine, factor) = face.meet(self, stretch.primitive, stretch.point(direction), direction);
            out.push(Reflection {
                range,
                entry: range,
                intensity: intensity(*ring, range, Response::Factor(factor)),
                cosine,
                primitive: stretch.primitive,
            });
        }
    }

    /// Follows one subray to where it is reflected, with that point's distance from the pulse's origin; `None` when it is
    /// not reflected.
    fn follow(
        &self,
        instrument: &Instrument,
        origin: DVec3,
        direction: DVec3,
        mut stretch: Stretch,
        probe: &mut Probe,
    ) -> Option<(Stretch, f64)> {
        loop {
            if stretch.primitive == Hits::MISS {
                return None;
            }
            let point = stretch.point(direction);
            let go_on_from = match self.standing(point, &stretch, direction) {
                Standing::Inside => {
                    let range = distance(point, origin);
                    if !range.is_finite() || range > instrument.range_max {
                        return None;
                    }
                    if range >= instrument.range_min {
                        return Some((stretch, range));
                    }
                    if !instrument.corrections.see_through_near {
                        return None;
                    }
                    point + direction * STEP_BEHIND
                }
                Standing::Before(entry) => entry,
                Standing::Beyond => return None,
            };
            if go_on_from == stretch.origin {
                return None;
            }
            stretch = self.next(go_on_from, direction, probe);
        }
    }

    /// Where a hit lies relative to the scene's box. Only moving parts ever leave it (spec pulse-physics §6).
    fn standing(&self, point: DVec3, stretch: &Stretch, direction: DVec3) -> Standing {
        let Some(b) = self.limits else { return Standing::Inside };
        if point.cmpge(b.min - BOX_SLACK).all() && point.cmple(b.max + BOX_SLACK).all() {
            return Standing::Inside;
        }
        match b.slabs(stretch.origin, direction) {
            Some((enter, exit)) if stretch.t <= exit + BOX_SLACK => {
                if stretch.t < enter - BOX_SLACK {
                    Standing::Before(stretch.origin + direction * (enter - BOX_SLACK))
                } else {
                    Standing::Inside
                }
            }
            _ => Standing::Beyond,
        }
    }

    fn next(&self, origin: DVec3, direction: DVec3, probe: &mut Probe) -> Stretch {
        let Probe { rays, hits } = probe;
        rays.origin = origin;
        (rays.x.clear(), rays.y.clear(), rays.z.clear());
        (rays.x.push(direction.x), rays.y.push(direction.y), rays.z.push(direction.z));
        self.tree.trace(&self.scene.geometry, rays, hits);
        Stretch { origin, t: hits.t[0], primitive: hits.primitive[0] }
    }
}

/// One stretch of a subray, from an origin to the first thing it hits.
#[derive(Clone, Copy, Debug)]
struct Stretch {
    origin: DVec3,
    t: f64,
    primitive: u32,
}

impl Stretch {
    fn point(&self, direction: DVec3) -> DVec3 {
        self.origin + direction * self.t
    }
}

/// See [`View::standing`].
enum Standing {
    Inside,
    /// The box begins here, behind the hit.
    Before(DVec3),
    Beyond,
}

/// √(Δx² + Δy² + Δz²), added in this order: equal ranges must come out equal (§4.2).
fn distance(a: DVec3, b: DVec3) -> f64 {
    let d = a - b;
    (d.x * d.x + d.y * d.y + d.z * d.z).sqrt()
}

/// The triangle that was met last: neighbouring subrays mostly meet the same.
struct Face {
    primitive: u32,
    normal: DVec3,
}

impl Face {
    const NONE: Face = Face { primitive: Hits::MISS, normal: DVec3::ZERO };

    /// Cosine of the incidence angle (§2.4) and reflectance factor where a ray meets `primitive` at `point`.
    fn meet(&mut self, view: &View, primitive: u32, point: DVec3, direction: DVec3) -> (f64, f64) {
        let material = view.scene.material_of(primitive);
        if view.fixed_incidence {
            return (1.0, material.factor(1.0));
        }
        let normal = if self.primitive == primitive {
            self.normal
        } else {
            let geometry = &view.scene.geometry;
            match (primitive as usize).checked_sub(geometry.triangles.len()) {
                None => {
                    let [a, b, c] = geometry.triangle(primitive as usize);
                    *self = Face { primitive, normal: unit((b - a).cross(c - a)) };
                    self.normal
                }
                Some(i) => face_of_cube(point - geometry.cubes[i].centre, geometry.cubes[i].half),
            }
        };
        let cosine = normal.dot(direction).abs().min(1.0);
        (cosine, material.factor(cosine))
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
