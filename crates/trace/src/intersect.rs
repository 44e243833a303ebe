//! The exact test: whether one ray hits one primitive, and where. Everything else in this module is a filter
//! in front of it.
//!
//! The result is a function of the ray and the primitive alone, in double precision without fused operations,
//! so every tree, packet and instruction set reports the same bits.
//!
//! * **Inside** is decided in the plane across the ray's dominant axis `k` (Woop, Benthin and Wald 2013):
//!   each vertex, taken relative to the ray's origin, becomes the point
//!   `(p_i·d_k − p_k·d_i, p_j·d_k − p_k·d_j)`, and the ray is inside when the origin of that plane is on the
//!   same side of all three edges, on an edge included. The point of a vertex depends on the ray and the
//!   vertex only, and sides are decided exactly; so neighbours that share an edge or a vertex leave no gap,
//!   whatever their winding.
//! * **Distance** is `e2·q / det` in the operation order of spec pulse-physics §2.3, because equal distances
//!   of symmetric rays are physically meaningful. For a triangle seen edge-on that quotient is rounding
//!   noise; then the depth is interpolated from the corners, and where that is noise too it is the farthest
//!   corner's, which no filter contradicts.

use super::Cube;
use vlscan_geom::{Aabb, DVec3};

/// Directions shorter than this are none: their products would be lost to underflow.
pub(crate) const MIN_DIRECTION: f64 = 1e-100;

/// How far a distance may leave the depth range of the triangle's corners, relative to that depth.
pub(crate) const DEPTH_SLACK: f64 = 1e-9;

/// Smallest `det`, relative to the edges and the direction, of a triangle that is not seen edge-on.
pub(crate) const EDGE_ON: f64 = 1e-6;

/// The axis along which a direction is longest (the first of equals), then the other two in cyclic order.
pub(crate) fn axes_by_dominance(d: DVec3) -> [usize; 3] {
    let m = d.abs();
    if m.x >= m.y && m.x >= m.z {
        [0, 1, 2]
    } else if m.y >= m.z {
        [1, 2, 0]
    } else {
        [2, 0, 1]
    }
}

/// Distance at which the ray `origin + t·direction` hits the triangle, from either side, in units of
/// `direction`; `None` when it does not, when `t ≤ 0`, or when the ray runs within the triangle's plane.
/// Directions are meant to be of about unit length; one shorter than 1e-100 hits nothing.
pub fn triangle(origin: DVec3, direction: DVec3, [a, b, c]: [DVec3; 3]) -> Option<f64> {
    let (pa, pb, pc) = (a - origin, b - origin, c - origin);
    let [k, i, j] = axes_by_dominance(direction);
    let d = direction;
    if d[k].abs() < MIN_DIRECTION {
        return None;
    }
    let across = |p: DVec3| (p[i] * d[k] - p[k] * d[i], p[j] * d[k] - p[k] * d[j]);
    let (xa, ya) = across(pa);
    let (xb, yb) = across(pb);
    let (xc, yc) = across(pc);
    let edges = [[xb, yc, yb, xc], [xc, ya, yc, xa], [xa, yb, ya, xb]];
    let sides = edges.map(side);
    let left = sides.iter().all(|s| *s >= 0);
    let right = sides.iter().all(|s| *s <= 0);
    // Both hold only for a triangle seen exactly edge-on: its neighbours have the hit.
    if left == right || sides.contains(&UNDEFINED) {
        return None;
    }
    let (e1, e2) = (b - a, c - a);
    let forward = |p: DVec3| if d[k] < 0.0 { -p[k] } else { p[k] };
    let depths = [forward(pa), forward(pb), forward(pc)];
    let nearest = depths[0].min(depths[1]).min(depths[2]);
    let farthest = depths[0].max(depths[1]).max(depths[2]);
    let h = cross(d, e2);
    let q = cross(-pa, e1);
    let det = dot(h, e1);
    let t = dot(e2, q) / det;
    let s = t * d[k].abs();
    let faces = det.abs() >= EDGE_ON * e1.abs().max_element() * e2.abs().max_element() * d[k].abs();
    if faces && s >= nearest * (1.0 - DEPTH_SLACK) && s <= farthest * (1.0 + DEPTH_SLACK) {
        return (t > 0.0).then_some(t);
    }
    let depth = interpolated_depth(edges, depths).unwrap_or(farthest).max(nearest).min(farthest);
    let t = depth / d[k].abs();
    (t > 0.0 && t.is_finite() && nearest.is_finite()).then_some(t)
}

/// The side of a NaN.
const UNDEFINED: i8 = i8::MAX;

/// The sign of `a·b − c·d`, exactly (but for underflow).
fn side([a, b, c, d]: [f64; 4]) -> i8 {
    let (l, r) = (a * b, c * d);
    let order = if l == r {
        // What rounding took from either product is a number itself.
        a.mul_add(b, -l).partial_cmp(&c.mul_add(d, -r))
    } else {
        l.partial_cmp(&r)
    };
    order.map_or(UNDEFINED, |o| o as i8)
}

/// Depth by the edge functions as weights of the opposite corners; `None` when they are noise.
fn interpolated_depth(edges: [[f64; 4]; 3], depths: [f64; 3]) -> Option<f64> {
    let products = edges.map(|[a, b, c, d]| (a * b, c * d));
    let weight = products.map(|(l, r)| l - r);
    let sum = weight[0] + weight[1] + weight[2];
    let noise = products.iter().fold(0.0, |n, (l, r)| n + l.abs() + r.abs());
    let depth = (weight[0] * depths[0] + weight[1] * depths[1] + weight[2] * depths[2]) / sum;
    (sum.abs() >= EDGE_ON * noise && depth.is_finite()).then_some(depth)
}

fn cross(a: DVec3, b: DVec3) -> DVec3 {
    DVec3::new(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x)
}

fn dot(a: DVec3, b: DVec3) -> f64 {
    a.x * b.x + a.y * b.y + a.z * b.z
}

/// Distance at which the ray enters the cube; `None` for a miss and for an origin on or within it (spec
/// pulse-physics §2.3: the entry must lie ahead).
pub fn cube(origin: DVec3, direction: DVec3, cube: Cube) -> Option<f64> {
    if direction.abs().max_element() < MIN_DIRECTION {
        return None;
    }
    let half = DVec3::splat(cube.half);
    let entry = Aabb { min: cube.centre - half, max: cube.centre + half }.slabs(origin, direction)?.0;
    (entry > 0.0 && entry.is_finite()).then_some(entry)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use vlscan_geom::unit;

    fn v(x: f64, y: f64, z: f64) -> DVec3 {
        DVec3::new(x, y, z)
    }

    #[test]
    fn worked_example() {
        // spec pulse-physics §2.8 (b)
        let t = [v(-1.0, 5.0, -1.0), v(1.0, 5.0, -1.0), v(0.0, 6.0, 1.0)];
        assert_eq!(triangle(v(0.2, 0.0, 0.3), DVec3::Y, t), Some(5.65));
        assert_eq!(triangle(v(0.2, 0.0, 0.3), DVec3::Y, [t[0], t[2], t[1]]), Some(5.65), "both sides");
        assert_eq!(triangle(v(0.2, 0.0, 0.3), -DVec3::Y, t), None, "behind");
        assert_eq!(triangle(v(1.2, 0.0, 0.3), DVec3::Y, t), None, "beside");
    }

    #[test]
    fn an_origin_on_the_triangle_does_not_hit_it() {
        let t = [v(-1.0, 0.0, -1.0), v(1.0, 0.0, -1.0), v(0.0, 0.0, 1.0)];
        assert_eq!(triangle(DVec3::ZERO, DVec3::Y, t), None);
        assert_eq!(triangle(t[0], DVec3::Y, t), None);
    }

    #[test]
    fn rays_in_the_plane_and_degenerate_triangles_miss() {
        let t = [v(-1.0, 0.0, -1.0), v(1.0, 0.0, -1.0), v(0.0, 0.0, 1.0)];
        assert_eq!(triangle(v(-9.0, 0.0, 0.0), DVec3::X, t), None);
        assert_eq!(triangle(v(0.0, -9.0, -1.0), DVec3::Y, [t[0], t[1], t[1]]), None);
        for bad in [DVec3::ZERO, DVec3::NAN, DVec3::INFINITY] {
            assert_eq!(triangle(v(0.2, -5.0, 0.0), bad, t), None);
        }
        assert_eq!(triangle(v(f64::NAN, -5.0, 0.0), DVec3::Y, t), None);
    }

    #[test]
    fn edge_on_triangles_are_hit_within_their_depth() {
        // A sliver almost parallel to the ray: the quotient of the plane equation is noise.
        let (a, b, c) = (v(1e-17, 100.0, 0.0), v(-1e-17, 200.0, 0.3), v(3e-17, 150.0, -0.2));
        for i in 0..200 {
            let d = unit(v(1e-19 * f64::from(i - 100), 1.0, 1e-4 * f64::from(i % 7 - 3)));
            if let Some(t) = triangle(DVec3::ZERO, d, [a, b, c]) {
                assert!((99.9..200.1).contains(&t), "{t}");
            }
        }
    }

    #[test]
    fn cubes_are_hit_at_their_entry_only() {
        let c = Cube { centre: v(0.0, 5.0, 0.0), half: 1.0 };
        assert_eq!(cube(DVec3::ZERO, DVec3::Y, c), Some(4.0));
        assert_eq!(cube(v(0.0, 5.5, 0.0), DVec3::Y, c), None, "inside");
        assert_eq!(cube(v(0.0, 4.0, 0.0), DVec3::Y, c), None, "on the entry");
        assert_eq!(cube(v(0.0, 9.0, 0.0), DVec3::Y, c), None, "behind");
        assert_eq!(cube(v(2.0, 0.0, 0.0), DVec3::Y, c), None, "beside");
    }

    proptest! {
        /// A fan around a vertex leaves no gap for rays aimed at the vertex, its spokes or anywhere near.
        #[test]
        fn fans_do_not_leak(
            spokes in 3usize..9, offset in -1e4..1e4f64, size in 1e-3..1e3f64, tilt in -0.5..0.5f64,
            from in prop::array::uniform3(-1.0..1.0f64), along in 0.0..0.9f64, nudge in -1i32..=1, spoke in 0usize..9,
        ) {
            let centre = v(offset, -offset * 0.3, offset * 0.7);
            let ring: Vec<DVec3> = (0..spokes).map(|s| {
                let angle = s as f64 * std::f64::consts::TAU / spokes as f64;
                centre + v(libm::cos(angle), libm::sin(angle), tilt * libm::sin(3.0 * angle)) * size
            }).collect();
            let target = centre + (ring[spoke % spokes] - centre) * along;
            let origin = centre + v(from[0], from[1], 2.0) * size * 3.0;
            let mut d = unit(target - origin);
            d.x = f64::from_bits((d.x.to_bits() as i64 + i64::from(nudge)) as u64);
            let hit = (0..spokes).any(|s| triangle(origin, d, [centre, ring[s], ring[(s + 1) % spokes]]).is_some());
            prop_assert!(hit);
        }

        /// Corner order changes neither whether a ray hits nor, beyond rounding, the distance.
        #[test]
        fn corner_order_does_not_matter(p in prop::array::uniform9(-10.0..10.0f64), d in prop::array::uniform3(-1.0..1.0f64)) {
            let [a, b, c] = [v(p[0], p[1], p[2]), v(p[3], p[4], p[5]), v(p[6], p[7], p[8])];
            let d = v(d[0], d[1], d[2]);
            let first = triangle(DVec3::ZERO, d, [a, b, c]);
            for other in [[b, c, a], [c, a, b], [a, c, b], [c, b, a], [b, a, c]] {
                let t = triangle(DVec3::ZERO, d, other);
                prop_assert_eq!(first.is_some(), t.is_some());
                if let (Some(x), Some(y)) = (first, t) {
                    prop_assert!((x - y).abs() <= 1e-3 * x.max(1.0));
                }
            }
        }
    }
}
