//! The next surfaces behind polished mirrors and panes, found for some pulses at once: rays that are traced
//! together cost a fraction of single ones. They follow from the first hits of the pulses alone. Those behind
//! foliage, rough mirrors and further mirrors are found when light gets there ([`super::light`]).

use super::light::{first_way, mirrored, normal_on_side, optics_of};
use super::pane::{Crossing, Pane};
use super::reflect::ShadedSurface;
use super::traced::{NextHits, SubrayGains, TracedPulse};
use super::view::SceneView;
use vlscan_geom::DVec3;
use vlscan_scene::{Optics, OpticsKind};
use vlscan_trace::{Hit, Hits, TraceScratch};

/// Rays of the same kind, and the places of their hits.
#[derive(Clone, Debug, Default)]
struct Rays {
    starts: Vec<DVec3>,
    directions: Vec<DVec3>,
    places: Vec<usize>,
}

/// The hits of light behind the mirrors and panes that some pulses meet first.
#[derive(Clone, Debug, Default)]
pub(super) struct Ahead {
    /// First place of each pulse in `hits`, and the number of its subrays.
    rows: Vec<(usize, usize)>,
    /// Rows of the pulses that meet a mirror or pane, by subray.
    hits: Vec<NextHits>,
    /// Of mirrored light, and of light that passes.
    rays: [Rays; 2],
}

impl Rays {
    /// Adds light that leaves a surface at `from`, after its way through a pane.
    fn push(&mut self, (from, direction): (DVec3, DVec3), crossing: Option<Crossing>, place: usize) {
        self.starts.push(from + direction * first_way(crossing));
        self.directions.push(direction);
        self.places.push(place);
    }
}

impl Ahead {
    /// Finds what light meets behind the mirrors and panes that these pulses meet first. Among tiles and
    /// moving objects, it finds nothing.
    pub fn find<'a>(
        &mut self,
        view: &SceneView,
        pulses: impl Iterator<Item = (TracedPulse<'a>, SubrayGains<'a>)>,
        scratch: &mut TraceScratch,
    ) {
        self.rows.clear();
        self.hits.clear();
        if view.tiles.is_some() || !view.moving.is_empty() {
            return;
        }
        for (traced, gains) in pulses {
            let first = self.hits.len();
            self.push(view, &traced, &gains);
            self.rows.push((first, self.hits.len() - first));
        }
        self.trace(view, scratch);
    }

    /// Adds the light of a pulse that goes on.
    fn push(&mut self, view: &SceneView, traced: &TracedPulse, gains: &SubrayGains) {
        let first = self.hits.len();
        let mut last = (Hits::MISS, None);
        let mut surface = ShadedSurface::none(view);
        for (subray, primitive) in traced.primitives.iter().enumerate() {
            if last.0 != *primitive {
                last = (*primitive, optics_of(view, *primitive));
            }
            let is_traced = |optics: &Optics| !matches!(optics.kind, OpticsKind::Water(_));
            let Some(optics) = last.1.filter(is_traced) else { continue };
            surface.load(view, *primitive);
            let direction = traced.direction(subray);
            let Some(normal) = normal_on_side(surface.normal, direction) else { continue };
            self.hits.resize(first + traced.primitives.len(), [None; 2]);
            let at = traced.start(subray) + direction * gains.ranges[subray];
            self.push_light(optics, (at, direction), normal, first + subray);
        }
    }

    /// Adds the light that goes on from a mirror or pane, whose unit normal is on the side of the arrival.
    fn push_light(&mut self, optics: Optics, (at, direction): (DVec3, DVec3), normal: DVec3, place: usize) {
        if optics.roughness == 0.0 {
            let mirrored = mirrored(direction, normal);
            if mirrored.dot(normal) > 0.0 {
                self.rays[0].push((at, mirrored), None, place);
            }
        }
        if let Some(pane) = Pane::of(optics.kind) {
            let crossing = pane.crossing(normal, direction);
            self.rays[1].push((at + crossing.way, direction), Some(crossing), place);
        }
    }

    /// Traces the light of all pulses.
    fn trace(&mut self, view: &SceneView, scratch: &mut TraceScratch) {
        for (side, rays) in self.rays.iter_mut().enumerate() {
            if rays.places.is_empty() {
                continue;
            }
            let found = view.tree.trace_rays(&view.scene.geometry, &rays.starts, &rays.directions, scratch);
            let miss = Hit { t: f64::INFINITY, primitive: Hits::MISS };
            for (place, hit) in rays.places.drain(..).zip(found) {
                self.hits[place][side] = Some(hit.unwrap_or(miss));
            }
            rays.starts.clear();
            rays.directions.clear();
        }
    }

    /// The hits of pulse `i`, by subray; empty if it meets no mirror or pane.
    pub fn of(&self, i: usize) -> &[NextHits] {
        self.rows.get(i).map_or(&[], |(first, count)| &self.hits[*first..first + count])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pulse::ray_batch::RayBatch;
    use crate::pulse::testkit::{half_white, rectangles, survey, tls_device, tree, wall};
    use crate::pulse::{Physics, PhysicsOptions};
    use vlscan_geom::unit;
    use vlscan_scene::Material;

    const RAYS: usize = 7;

    #[test]
    fn light_traced_ahead_meets_what_single_rays_meet() {
        // A mirror and a pane side by side, a wall behind them and one behind the scanner.
        let walls =
            [wall(-9.0, 0.0, 8.0), wall(0.0, 9.0, 8.0), wall(-40.0, 40.0, 12.0), wall(-40.0, 40.0, -5.0)];
        let mut scene = rectangles(half_white(), &walls);
        let pane = OpticsKind::Pane { index: 1.5, thickness: 0.004, absorption: 0.0, sheets: 2 };
        for (i, kind) in [(1, OpticsKind::Mirror { reflectance: 0.9 }), (2, pane)] {
            let optics = Some(Optics { kind, share: 1.0, roughness: 0.0 });
            scene.materials.push(Material { optics, ..half_white() });
            scene.surfaces[i - 1].material = i as u32;
        }
        let (tree, survey) = (tree(&scene), survey(vec![tls_device(4.0)]));
        let physics = Physics::new(&scene, &tree, &survey, PhysicsOptions::refined()).unwrap();
        let view = physics.view.with(&[], None);
        let (mut batch, mut scratch) = (RayBatch::default(), TraceScratch::default());
        batch.rays.clear(RAYS);
        for pulse in 0..60 {
            let azimuth = f64::from(pulse) * 0.03 - 0.9;
            batch.rays.push(-scene.shift, |x, y, z| {
                for ray in 0..RAYS {
                    let aside = ray as f64 * 1e-3;
                    let d = unit(DVec3::new(libm::sin(azimuth + aside), libm::cos(azimuth), aside));
                    (x[ray], y[ray], z[ray]) = (d.x, d.y, d.z);
                }
            });
        }
        batch.trace(&tree, &scene.geometry, &mut scratch);
        let gains = |i| SubrayGains { ranges: &batch.hits.t[i * batch.rays.stride()..], gains: &[] };
        let pulses = || (0..60).map(|i| (TracedPulse::of(&batch, i), gains(i)));
        let mut ahead = Ahead::default();
        ahead.find(&view, pulses(), &mut scratch);
        let mut known = [0; 2];
        for (i, (traced, gains)) in pulses().enumerate() {
            for (subray, hits) in ahead.of(i).iter().enumerate() {
                let at = traced.start(subray) + traced.direction(subray) * gains.ranges[subray];
                let normal = DVec3::NEG_Y;
                let crossing = Pane::of(pane).unwrap().crossing(normal, traced.direction(subray));
                let ways = [
                    (at, mirrored(traced.direction(subray), normal), None),
                    (at + crossing.way, traced.direction(subray), Some(crossing)),
                ];
                for (side, (hit, (from, direction, crossing))) in hits.iter().zip(ways).enumerate() {
                    let Some(hit) = hit else { continue };
                    let start = from + direction * first_way(crossing);
                    let single = view.nearest_astray((start, direction), |_| true);
                    assert_eq!((hit.t.to_bits(), hit.primitive), (single.t.to_bits(), single.primitive));
                    known[side] += 1;
                }
            }
        }
        // All rays of 60 pulses are mirrored, and about half of them pass.
        assert!(known[0] > 50 * RAYS && known[1] > 20 * RAYS && known[1] < known[0], "{known:?}");
    }
}
