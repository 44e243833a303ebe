//! Polygons in the plane.

/// True if a point is inside of a polygon, by the number of sides that a ray to the right crosses (even-odd
/// rule). The last corner is joined to the first one.
pub fn is_inside(corners: &[[f64; 2]], [x, y]: [f64; 2]) -> bool {
    let next = corners.iter().cycle().skip(1);
    let crosses = |(a, b): &(&[f64; 2], &[f64; 2])| {
        (a[1] > y) != (b[1] > y) && x < a[0] + (y - a[1]) / (b[1] - a[1]) * (b[0] - a[0])
    };
    corners.iter().zip(next).filter(crosses).count() % 2 == 1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn notches_are_outside() {
        let corners = [[0.0, 0.0], [10.0, 0.0], [10.0, 10.0], [5.0, 2.0], [0.0, 10.0]];
        let inside = [[5.0, 1.0], [1.0, 7.0], [9.0, 7.0]];
        let outside = [[5.0, 3.0], [-1.0, 5.0], [11.0, 5.0], [5.0, f64::NAN]];
        assert!(inside.iter().all(|p| is_inside(&corners, *p)));
        assert!(!outside.iter().any(|p| is_inside(&corners, *p)));
        assert!(!is_inside(&[], [0.0; 2]));
    }
}
