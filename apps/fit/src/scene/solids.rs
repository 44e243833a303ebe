//! Solid things that no class tells: vehicles, walls, containers, sheds.
//!
//! In foliage neighbouring first returns lie at different heights, and beams are divided. Where single
//! returns of no class lie on planes with their neighbours, they show a surface.

use super::recording::{Recording, Target};
use rayon::prelude::*;
use vlscan_geom::DVec3;
use vlscan_tools::neighbours::{Neighbours, plane_at};

/// Neighbours through which the plane at a point goes, and that decide with it.
const NEIGHBOURS: usize = 8;
/// Distance of neighbours over the mean distance between pulses from which on they do not count.
const REACH: f64 = 3.0;
/// Distance from the plane of the neighbours within which a point lies on a surface, m.
const MAX_ROUGHNESS: f64 = 0.25;

/// True for each return that a solid thing of no class reflects. Pulses are `spacing` m apart; `is_terrain`
/// is true for what belongs to the terrain.
pub(super) fn solids(
    recording: &Recording,
    spacing: f64,
    is_terrain: impl Fn(DVec3) -> bool + Sync,
) -> Vec<bool> {
    let returns = &recording.returns;
    let may_be_solid = |i: &usize| {
        let r = &returns[*i];
        r.target() == Target::Foliage && !is_plant_or_wire(r.class) && !is_terrain(r.position)
    };
    let candidates: Vec<usize> = (0..returns.len()).into_par_iter().filter(may_be_solid).collect();
    let neighbours = Neighbours::of(candidates.iter().map(|i| returns[*i].position).collect());
    let points = neighbours.points();
    let near = |k: usize| {
        let p = points[k];
        let all = neighbours.nearest(p.x, p.y, NEIGHBOURS, Some(k)).into_iter();
        all.filter(|n| n.0 <= (REACH * spacing).powi(2)).collect::<Vec<_>>()
    };
    let is_on_surface = |k: usize| {
        let (p, near) = (points[k], near(k));
        let is_flat = || (p.z - plane_at(points, &near, [p.x, p.y])).abs() < MAX_ROUGHNESS;
        returns[candidates[k]].of == 1 && 2 * near.len() > NEIGHBOURS && is_flat()
    };
    let on_surface: Vec<bool> = (0..points.len()).into_par_iter().map(is_on_surface).collect();
    // At its edges a solid thing divides beams, too; and some neighbours in a crown lie on a plane by chance.
    let mut solid = on_surface;
    for _ in 0..2 {
        let is_one_of_most = |k: usize| {
            let near = near(k);
            let count = near.iter().filter(|n| solid[n.1]).count() + usize::from(solid[k]);
            2 * near.len() > NEIGHBOURS && 3 * count >= 2 * (near.len() + 1)
        };
        solid = (0..points.len()).into_par_iter().map(is_one_of_most).collect();
    }
    // What lies beside a solid thing, no higher, is its side.
    let is_side = |k: usize| {
        let p = points[k];
        let beside = neighbours.nearest_within(p.x, p.y, NEIGHBOURS, spacing).into_iter();
        beside.map(|n| n.1).any(|n| solid[n] && p.z < points[n].z + MAX_ROUGHNESS)
    };
    let solid: Vec<bool> = (0..points.len()).into_par_iter().map(|k| solid[k] || is_side(k)).collect();
    let mut out = vec![false; returns.len()];
    candidates.iter().zip(solid).for_each(|(i, is_solid)| out[*i] = is_solid);
    out
}

/// Plants, guard wires, conductors, towers and insulators.
fn is_plant_or_wire(class: u8) -> bool {
    matches!(class, 3..=5 | 13..=16)
}

#[cfg(test)]
mod tests {
    use super::super::recording::Return;
    use super::*;
    use vlscan_base::rng::{Purpose, Stream};

    /// The share of the returns of a thing of 5 m by 2 m that are solid; the ground around has none.
    fn share(class: u8, of: u8, height: impl Fn(f64, f64) -> f64) -> f64 {
        let draws = Stream::new(4, Purpose::Material);
        let thing = |i: u64| {
            let [x, y] = [(0, 5.0), (1, 2.0)].map(|(axis, size)| size * draws.uniform(0, i, axis));
            Return::last_of(of, class, DVec3::new(x, y, height(x, draws.uniform(1, i, 0))))
        };
        let returns: Vec<Return> = (0..90).map(thing).collect();
        let found = solids(&Recording { returns, ..Recording::default() }, 0.33, |p| p.z < 0.1);
        found.iter().filter(|is_solid| **is_solid).count() as f64 / found.len() as f64
    }

    #[test]
    fn a_parked_car_is_solid_and_a_bush_is_not() {
        // A bonnet, a windscreen, a roof; noise of 2 cm.
        let car = |x: f64, u: f64| 0.9 + (x - 1.0).clamp(0.0, 0.7) + 0.02 * u;
        assert!(share(1, 1, car) > 0.9);
        assert!(share(1, 1, |_, u| 0.3 + 2.5 * u) < 0.05, "heights of a bush");
        assert!(share(1, 2, car) < 0.05, "beams that go on");
        assert!(share(5, 1, car) < 0.05, "a clipped hedge that is classified");
        assert!(share(1, 1, |_, _| 0.0) < 0.05, "the ground");
    }
}
