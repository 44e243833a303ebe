//! Light on its way over mirrors, through panes and into water: its state, and the surfaces that it meets.

use super::echo::EchoPath;
use super::foliage::{self, FreePaths, MediumEvent};
use super::instrument::Instrument;
use super::pane::Crossing;
use super::reflect::ShadedSurface;
use super::reflections::PathEnd;
use super::specular::Image;
use super::traced::NextHits;
use super::view::{Interaction, STEP_BEHIND, SceneView};
use vlscan_geom::{DVec3, unit};
use vlscan_scene::Optics;
use vlscan_trace::{Hit, Hits};

/// Minimum radius of a beam that a rough mirror widens, m.
const MIN_RADIUS: f64 = 1e-3;

/// Light that arrives at a mirror or pane.
#[derive(Clone, Copy, Debug)]
pub(super) struct Arrival {
    pub optics: Optics,
    /// The mirror or pane.
    pub primitive: u32,
    pub at: DVec3,
    pub direction: DVec3,
    pub light: Light,
    /// The next hits of the light, if they are traced ahead.
    pub next: NextHits,
}

/// State of the light on a path.
#[derive(Clone, Copy, Debug)]
pub(super) struct Light {
    pub subray: u32,
    /// Optical length so far, m.
    pub length: f64,
    /// Share of the light of the subray, one way.
    pub share: f64,
    pub path: EchoPath,
    /// Image of the transmitter, as long as it is sharp enough to send light straight back.
    pub image: Option<Image>,
}

/// Light that leaves a mirror or pane.
#[derive(Clone, Copy, Debug)]
pub(super) struct Departure {
    /// The mirror or pane.
    pub primitive: u32,
    pub from: DVec3,
    pub direction: DVec3,
    /// Way through the pane, which ends at `from`.
    pub crossing: Option<Crossing>,
    /// Standard deviation of the slopes of the facets that spread the light, rad.
    pub roughness: f64,
    /// Factor by which light is slower than in vacuum.
    pub slowness: f64,
    pub light: Light,
    /// The first hit, if it is traced ahead.
    pub next: Option<Hit>,
}

/// Reflection at the end of a path.
#[derive(Clone, Copy, Debug)]
pub(super) struct Found {
    pub end: PathEnd,
    pub subray: u32,
    pub primitive: u32,
    pub cosine: f64,
    /// Optical length, m.
    pub range: f64,
}

/// The mirror or pane that a primitive is. Voxels are opaque.
pub(super) fn optics_of(view: &SceneView, primitive: u32) -> Option<Optics> {
    if primitive == Hits::MISS || !view.is_triangle(primitive) {
        return None;
    }
    view.scene.materials[view.surface(primitive).material as usize].optics
}

/// Unit normal of a mirror, pane or surface of water on the side that light of this direction meets.
pub(super) fn normal_towards(view: &SceneView, primitive: u32, direction: DVec3) -> Option<DVec3> {
    let mut surface = ShadedSurface::none(view);
    surface.load(view, primitive);
    normal_on_side(surface.normal, direction)
}

/// The unit normal of a surface, if it has one, on the side that light of this direction meets.
pub(super) fn normal_on_side(normal: Option<DVec3>, direction: DVec3) -> Option<DVec3> {
    let normal = normal.filter(|normal| normal.is_finite())?;
    Some(if normal.dot(direction) > 0.0 { -normal } else { normal })
}

/// Direction of light that a facet with this unit normal mirrors.
pub(super) fn mirrored(direction: DVec3, facet: DVec3) -> DVec3 {
    unit(direction - facet * (2.0 * facet.dot(direction)))
}

/// Way of light that leaves a surface at which it is traced on, m; negative for light that has crossed a
/// pane: it is traced from the plane of the pane, as surfaces may be nearer to that than the pane is thick.
pub(super) fn first_way(crossing: Option<Crossing>) -> f64 {
    STEP_BEHIND - crossing.map_or(0.0, |crossing| crossing.unbent)
}

/// The next surface on the way of light, or the foliage that intercepts it, and its distance, m; the distance
/// is negative if the surface lies within the thickness of the pane that the light crosses.
pub(super) fn next_surface(
    view: &SceneView,
    instrument: &Instrument,
    departure: &Departure,
    paths: &mut FreePaths,
) -> Option<(Interaction, f64)> {
    let Departure { primitive, from, direction, slowness, light, mut next, .. } = *departure;
    let detector = &instrument.detector;
    let mut crossing = departure.crossing;
    let mut way = first_way(crossing);
    loop {
        let start = from + direction * way;
        let at = match next.take().filter(|hit| hit.primitive != primitive) {
            Some(hit) => Interaction::at_hit((start, direction), start, hit),
            None => view.nearest_astray((start, direction), |i| i != primitive),
        };
        if way + at.t < 0.0
            && let Some(crossing) = crossing.take()
            && !is_obstructed(view, primitive, &crossing, from)
        {
            way = STEP_BEHIND;
            continue;
        }
        // False for a ray that misses, and for one that is not finite.
        let length = light.length + slowness * way + slowness * at.t;
        let is_in_reach = at.primitive != Hits::MISS && length <= detector.range_max;
        if !is_in_reach {
            return None;
        }
        let (scene, local) = view.locate(at.primitive);
        let ray = (start, direction);
        match foliage::medium_event(scene, &detector.corrections, local, ray, at.t, paths) {
            MediumEvent::Scatter(depth) => return Some((at, way + at.t + depth)),
            MediumEvent::Lost => return None,
            MediumEvent::Exit(exit) => way += exit + STEP_BEHIND,
        }
    }
}

/// True if a surface lies on the way of light through a pane to `from`. The line of the light in air,
/// extended back to the plane of the pane, may also meet surfaces beside that way, such as a reveal.
fn is_obstructed(view: &SceneView, primitive: u32, crossing: &Crossing, from: DVec3) -> bool {
    let (length, inner) = (crossing.way.length(), unit(crossing.way));
    let start = from - crossing.way + inner * STEP_BEHIND;
    // Surfaces at the exit count, on either side of it.
    view.nearest_astray((start, inner), |i| i != primitive).t <= length
}

/// Square root of the share of light that returns from a surface `way` m behind a rough mirror: facets of
/// slope σ turn rays by 2σ, so that both the spot on the surface, of radius w over a polished mirror, and the
/// view of the receiver widen by 4σ·way. They overlap by w²/(w² + (4σ·way)²).
pub(super) fn spread_share(instrument: &Instrument, roughness: f64, way: f64, length: f64) -> f64 {
    if roughness == 0.0 {
        return 1.0;
    }
    let radius = (instrument.footprint_angle * length).max(MIN_RADIUS);
    radius / libm::hypot(radius, 4.0 * roughness * way)
}
