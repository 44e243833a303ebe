//! Distances in plan.

/// The distance of a place from the polyline of a line's first echoes, m; `None` where the line does not pass
/// it.
pub fn distance_to_line(place: [f64; 2], line: &[[f64; 2]]) -> Option<f64> {
    // Squares do for the nearest one: this is where most of the time goes.
    let (mut least, mut nearest) = (f64::INFINITY, 0);
    for (i, [x, y]) in line.iter().enumerate() {
        let (dx, dy) = (x - place[0], y - place[1]);
        let square = dx * dx + dy * dy;
        if square < least {
            (least, nearest) = (square, i);
        }
    }
    if nearest == 0 || nearest + 1 == line.len() {
        return None;
    }
    let to = |i: usize| distance_to_segment(place, [line[i], line[i + 1]]);
    Some(to(nearest - 1).min(to(nearest)))
}

/// The distance of two places, m.
pub fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    libm::hypot(a[0] - b[0], a[1] - b[1])
}

/// The distance of a place from a segment, m.
fn distance_to_segment(p: [f64; 2], [a, b]: [[f64; 2]; 2]) -> f64 {
    let along = [b[0] - a[0], b[1] - a[1]];
    let squared = along[0] * along[0] + along[1] * along[1];
    let share = match squared > 0.0 {
        true => (((p[0] - a[0]) * along[0] + (p[1] - a[1]) * along[1]) / squared).clamp(0.0, 1.0),
        false => 0.0,
    };
    distance(p, [a[0] + share * along[0], a[1] + share * along[1]])
}
