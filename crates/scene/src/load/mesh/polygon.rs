//! Polygons as triangles: one rule for the faces of all mesh formats. A polygon is stored as a fan of
//! triangles around its first corner while its file is read, when its corners may not be known yet;
//! [`divide`] replaces the fans that do not fill their polygons, which are concave, by ear clipping in the
//! plane of the polygon.

use earcut::Earcut;
use rayon::prelude::*;
use vlscan_geom::DVec3;

/// A triangle that is left out without a word: ear clipping yields fewer triangles than the fan for polygons
/// with corners on a straight line. No scene has that many vertices.
pub(crate) const UNUSED: [u32; 3] = [u32::MAX - 1; 3];

/// Part of the polygon's area by which a triangle of a fan may be turned over, as rounding does with corners
/// on a line.
const MAX_REVERSED: f64 = 1e-9;
/// Part of the polygon's area by which triangles may deviate from it before it counts as crossing itself.
const MAX_DEVIATION: f64 = 1e-6;
/// Maximum number of corners of a polygon that is divided by ear clipping.
const MAX_CORNERS: u32 = 1 << 20;

/// A polygon of more than three corners as triangles around its first corner.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Fan {
    /// Its first triangle.
    pub first: u32,
    /// Number of its triangles: two less than corners.
    pub triangles: u32,
}

/// Polygons that cross themselves, of which triangles are an approximation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Crossings {
    pub count: usize,
    /// The first triangle of the first of them.
    pub first: usize,
}

impl Crossings {
    /// The warning.
    pub fn message(&self) -> String {
        match self.count {
            1 => "a face crosses itself; its interior is a guess".to_owned(),
            count => {
                format!("{count} faces cross themselves; their interior is a guess; this is the first")
            }
        }
    }
}

/// Replaces the fans that do not fill their polygons. Triangles that become superfluous are [`UNUSED`];
/// polygons with unknown corners are kept.
pub(crate) fn divide(fans: &[Fan], triangles: &mut [[u32; 3]], vertices: &[DVec3]) -> Option<Crossings> {
    let divided: Vec<Divided> = fans
        .par_iter()
        .map_init(Divider::default, |divider, fan| divider.divide(*fan, triangles, vertices))
        .flatten()
        .collect();
    let mut crossings: Option<Crossings> = None;
    for Divided { first, replaced, crosses } in divided {
        triangles[first..first + replaced.len()].copy_from_slice(&replaced);
        if crosses {
            crossings.get_or_insert(Crossings { count: 0, first }).count += 1;
        }
    }
    crossings
}

/// The triangles of a polygon in place of its fan.
struct Divided {
    first: usize,
    replaced: Vec<[u32; 3]>,
    crosses: bool,
}

/// Buffers of ear clipping.
#[derive(Default)]
struct Divider {
    ears: Earcut<f64>,
    /// Corners relative to the first one.
    near: Vec<[f64; 3]>,
    /// The corners in the plane of the polygon.
    flat: Vec<[f64; 2]>,
    found: Vec<u32>,
}

impl Divider {
    /// The triangles of a polygon; `None` if its fan fills it, or if it has no plane.
    fn divide(&mut self, fan: Fan, triangles: &[[u32; 3]], vertices: &[DVec3]) -> Option<Divided> {
        let first = fan.first as usize;
        let own = &triangles[first..first + fan.triangles as usize];
        let corners = own.first()?[..2].iter().copied().chain(own.iter().map(|t| t[2]));
        let point = |corner: u32| vertices.get(corner as usize).copied().filter(|p| p.is_finite());
        let origin = point(own[0][0])?;
        self.near.clear();
        for corner in corners.clone() {
            self.near.push((point(corner)? - origin).to_array());
        }
        let near = |i: usize| DVec3::from(self.near[i]);
        let cross = |i: usize| near(i).cross(near(i + 1));
        let normal: DVec3 = (1..self.near.len() - 1).map(cross).sum();
        let area = normal.length_squared();
        let fills = (1..self.near.len() - 1).all(|i| cross(i).dot(normal) >= -MAX_REVERSED * area);
        if fills || fan.triangles > MAX_CORNERS {
            return None;
        }
        if !earcut::utils3d::project3d_to_2d(&self.near, self.near.len(), &mut self.flat) {
            return None;
        }
        self.ears.earcut_slice(&self.flat, &[], &mut self.found);
        if self.found.is_empty() || self.found.len() > 3 * own.len() {
            return None;
        }
        let deviation = earcut::deviation(self.flat.iter().copied(), &[], &self.found);
        let corners: Vec<u32> = corners.collect();
        let mut replaced = vec![UNUSED; own.len()];
        for (triangle, ear) in replaced.iter_mut().zip(self.found.chunks_exact(3)) {
            let [a, b, c] = [ear[0], ear[1], ear[2]].map(|i| i as usize);
            let turned = (near(b) - near(a)).cross(near(c) - near(a)).dot(normal) < 0.0;
            let order = if turned { [a, c, b] } else { [a, b, c] };
            *triangle = order.map(|i| corners[i]);
        }
        Some(Divided { first, replaced, crosses: deviation > MAX_DEVIATION })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use vlscan_geom::Rotation;

    /// The triangles of a polygon, and whether it crosses itself.
    fn divided(corners: &[DVec3]) -> (Vec<[u32; 3]>, bool) {
        let count = corners.len() as u32;
        let mut triangles: Vec<[u32; 3]> = (2..count).map(|i| [0, i - 1, i]).collect();
        let crossings = divide(&[Fan { first: 0, triangles: count - 2 }], &mut triangles, corners);
        triangles.retain(|t| *t != UNUSED);
        (triangles, crossings.is_some())
    }

    fn area(corners: &[DVec3], triangle: &[u32; 3]) -> DVec3 {
        let [a, b, c] = triangle.map(|i| corners[i as usize]);
        0.5 * (b - a).cross(c - a)
    }

    /// True if a point of the plane z = 0 is in one of the triangles.
    fn covers(corners: &[DVec3], triangles: &[[u32; 3]], x: f64, y: f64) -> bool {
        let p = DVec3::new(x, y, 0.0);
        triangles.iter().any(|t| {
            let [a, b, c] = t.map(|i| corners[i as usize]);
            let side = |a: DVec3, b: DVec3| (b - a).cross(p - a).z;
            let sides = [side(a, b), side(b, c), side(c, a)];
            sides.iter().all(|s| *s >= 0.0) || sides.iter().all(|s| *s <= 0.0)
        })
    }

    const ARROW: [[f64; 2]; 5] = [[0.0, 0.0], [4.0, 3.0], [8.0, 0.0], [8.0, 8.0], [0.0, 8.0]];

    fn flat(outline: &[[f64; 2]]) -> Vec<DVec3> {
        outline.iter().map(|&[x, y]| DVec3::new(x, y, 0.0)).collect()
    }

    #[test]
    fn a_dent_stays_empty_whatever_corner_comes_first() {
        for turn in 0..5 {
            for is_reversed in [false, true] {
                let mut corners = flat(&ARROW);
                corners.rotate_left(turn);
                if is_reversed {
                    corners.reverse();
                }
                let (triangles, crosses) = divided(&corners);
                let inside = |x, y| covers(&corners, &triangles, x, y);
                assert!(!inside(4.0, 1.0) && inside(4.0, 5.0) && inside(1.0, 2.0), "{turn}: {triangles:?}");
                let sum: DVec3 = triangles.iter().map(|t| area(&corners, t)).sum();
                assert_eq!((sum.z.abs(), crosses), (52.0, false));
                assert!(triangles.iter().all(|t| area(&corners, t).dot(sum) > 0.0), "sides are kept");
            }
        }
    }

    #[test]
    fn convex_polygons_are_fans_and_so_are_those_without_a_plane() {
        let hexagon: Vec<DVec3> = (0..6)
            .map(|i| DVec3::new(libm::cos(f64::from(i)), libm::sin(f64::from(i)), 0.1 * f64::from(i % 2)))
            .collect();
        let fan: Vec<[u32; 3]> = (2..6).map(|i| [0, i - 1, i]).collect();
        assert_eq!(divided(&hexagon), (fan, false));
        let line = flat(&[[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [3.0, 0.0]]);
        assert_eq!(divided(&line).0, [[0, 1, 2], [0, 2, 3]]);
        let unknown = [DVec3::ZERO, DVec3::NAN, DVec3::X, DVec3::Y];
        assert_eq!(divided(&unknown).0.len(), 2);
    }

    #[test]
    fn a_hole_is_an_outline_that_goes_in_and_back_along_one_edge() {
        let corners = flat(&[
            [0.0, 0.0],
            [9.0, 0.0],
            [9.0, 9.0],
            [0.0, 9.0],
            [0.0, 0.0],
            [3.0, 3.0],
            [3.0, 6.0],
            [6.0, 6.0],
            [6.0, 3.0],
            [3.0, 3.0],
        ]);
        let (triangles, _) = divided(&corners);
        let sum: f64 = triangles.iter().map(|t| area(&corners, t).length()).sum();
        assert!((sum - 72.0).abs() < 1e-12 && !covers(&corners, &triangles, 4.5, 4.6), "{sum}");
    }

    #[test]
    fn polygons_that_cross_themselves_are_counted() {
        assert!(divided(&flat(&[[0.0, 0.0], [4.0, 4.0], [4.0, 0.0], [0.0, 3.0], [-1.0, 1.0]])).1);
    }

    proptest! {
        #[test]
        fn star_shaped_polygons_keep_their_area_in_every_place(
            radii in proptest::collection::vec(0.2f64..5.0, 4..30),
            start in 0usize..30,
            turn in -3.0f64..3.0,
            place in prop::array::uniform3(-1e6f64..1e6)
        ) {
            let count = radii.len();
            let outline: Vec<DVec3> = (0..count)
                .map(|i| {
                    let angle = std::f64::consts::TAU * ((i + start) % count) as f64 / count as f64;
                    let r = radii[(i + start) % count];
                    DVec3::new(r * libm::cos(angle), r * libm::sin(angle), 0.0)
                })
                .collect();
            let exact: f64 = (0..count).map(|i| 0.5 * outline[i].cross(outline[(i + 1) % count]).z).sum();
            let rotation = Rotation::about(DVec3::new(1.0, 2.0, 3.0), turn);
            let placed: Vec<DVec3> = outline.iter().map(|p| rotation.apply(*p) + DVec3::from(place)).collect();
            let (triangles, crosses) = divided(&placed);
            let sum: f64 = triangles.iter().map(|t| area(&placed, t).length()).sum();
            prop_assert!((sum - exact).abs() < 1e-6 * exact && !crosses, "{} is not {}", sum, exact);
        }
    }
}
