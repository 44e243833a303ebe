//! Least-squares planes through points.

use vlscan_geom::{Aabb, DVec3};

/// A plane through `centre` with unit `normal`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Plane {
    /// A point of the plane.
    pub centre: DVec3,
    /// Direction of the smallest spread of the points; its sign is arbitrary.
    pub normal: DVec3,
}

/// Second moments of points about some centre: xx, xy, xz, yy, yz, zz.
pub(super) type Moments = [f64; 6];

/// The second moments of points given relative to the centre.
pub(super) fn moments(centred: impl Iterator<Item = DVec3>) -> Moments {
    centred.fold([0.0; 6], |m, d| {
        [
            m[0] + d.x * d.x,
            m[1] + d.x * d.y,
            m[2] + d.x * d.z,
            m[3] + d.y * d.y,
            m[4] + d.y * d.z,
            m[5] + d.z * d.z,
        ]
    })
}

/// The plane through the centre of the box around `points` that minimises the sum of their squared distances;
/// `None` without points. The centroid would fit better, but the reference uses this plane for `onGround`.
/// `points` are listed twice.
pub(super) fn fit<I: Iterator<Item = DVec3>>(points: impl Fn() -> I) -> Option<Plane> {
    points().next()?;
    let centre = Aabb::around(points()).centre();
    let normal = least_direction(moments(points().map(|p| p - centre)));
    Some(Plane { centre, normal })
}

/// Unit eigenvector of the smallest eigenvalue (Jacobi rotations; only +, −, ×, ÷ and square roots, so the
/// result is the same on every machine). Among equal eigenvalues the later axis wins.
pub(super) fn least_direction(m: Moments) -> DVec3 {
    let mut a = [[m[0], m[1], m[2]], [m[1], m[3], m[4]], [m[2], m[4], m[5]]];
    let mut v = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    for _ in 0..50 {
        let off = a[0][1].abs() + a[0][2].abs() + a[1][2].abs();
        if off <= f64::MIN_POSITIVE || off <= 1e-17 * (a[0][0].abs() + a[1][1].abs() + a[2][2].abs()) {
            break;
        }
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            rotate(&mut a, &mut v, p, q);
        }
    }
    let least = (0..3).fold(2, |best, i| if a[i][i] < a[best][best] { i } else { best });
    vlscan_geom::unit(DVec3::new(v[0][least], v[1][least], v[2][least]))
}

fn rotate(a: &mut [[f64; 3]; 3], v: &mut [[f64; 3]; 3], p: usize, q: usize) {
    if a[p][q] == 0.0 {
        return;
    }
    let theta = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
    let t = theta.signum() / (theta.abs() + (theta * theta + 1.0).sqrt());
    let c = 1.0 / (t * t + 1.0).sqrt();
    let s = t * c;
    let turn = |x: f64, y: f64| (c * x - s * y, s * x + c * y);
    for row in a.iter_mut().chain(v) {
        (row[p], row[q]) = turn(row[p], row[q]);
    }
    let (top, bottom) = (a[p], a[q]);
    for column in 0..3 {
        (a[p][column], a[q][column]) = turn(top[column], bottom[column]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use vlscan_geom::{Rotation, unit};

    #[test]
    fn points_of_a_plane_at_large_coordinates() {
        let normal = unit(DVec3::new(0.3, -0.2, 1.0));
        let (u, w) = (unit(normal.cross(DVec3::X)), unit(normal.cross(DVec3::X)).cross(normal));
        let origin = DVec3::new(477_000.0, 5_474_500.0, 300.0);
        let points: Vec<DVec3> =
            (0..100).map(|i| origin + u * f64::from(i % 10) + w * f64::from(i / 10) * 2.0).collect();
        let plane = fit(|| points.iter().copied()).unwrap();
        assert!((plane.normal.dot(normal).abs() - 1.0).abs() < 1e-12);
        assert!((plane.centre - points[0]).dot(normal).abs() < 1e-9);
        assert!(fit(std::iter::empty).is_none());
    }

    #[test]
    fn the_plane_passes_through_the_centre_of_the_box_and_not_the_centroid() {
        let mut points: Vec<DVec3> =
            (0..100).map(|i| DVec3::new(f64::from(i % 10), f64::from(i / 10), 0.0)).collect();
        points[44].z = 2.0;
        let plane = fit(|| points.iter().copied()).unwrap();
        assert_eq!(plane.centre, DVec3::new(4.5, 4.5, 1.0));
        assert!(plane.normal.z.abs() > 0.999);
    }

    #[test]
    fn degenerate_clouds_have_some_unit_normal() {
        for points in
            [vec![DVec3::ONE], vec![DVec3::ONE; 5], vec![DVec3::ZERO, DVec3::X * 1e-200, DVec3::X * 1e9]]
        {
            assert!((fit(|| points.iter().copied()).unwrap().normal.length() - 1.0).abs() < 1e-12);
        }
    }

    proptest! {
        #[test]
        fn the_axis_of_least_spread_is_found(angles in prop::array::uniform3(0.0..6.0f64), s in prop::array::uniform3(0.1..10.0f64)) {
            let r = Rotation::about_x(angles[0]).after(Rotation::about_y(angles[1])).after(Rotation::about_z(angles[2]));
            let axes = [DVec3::X * s[0], DVec3::Y * s[1], DVec3::Z * s[2]];
            let points: Vec<DVec3> = axes.iter().flat_map(|&a| [r.apply(a), r.apply(-a)]).collect();
            let least = (0..3).fold(0, |b, i| if s[i] < s[b] { i } else { b });
            let others = (0..3).filter(|&i| i != least).all(|i| s[i] > 1.01 * s[least]);
            prop_assume!(others);
            let expected = r.apply(unit(axes[least]));
            prop_assert!(fit(|| points.iter().copied()).unwrap().normal.dot(expected).abs() > 1.0 - 1e-9);
        }
    }
}
