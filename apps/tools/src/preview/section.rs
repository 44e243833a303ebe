//! The extent of a cloud, and the part of it that each view shows.

use crate::cloud::Points;

/// The cloud's box relative to its origin.
pub(super) struct Extent {
    low: [f64; 3],
    high: [f64; 3],
}

impl Extent {
    pub(super) fn of(points: &Points) -> Extent {
        let (bounds, origin) = (points.bounds(), points.origin());
        Extent { low: (bounds.min - origin).to_array(), high: (bounds.max - origin).to_array() }
    }

    pub(super) fn size(&self, axis: usize) -> f64 {
        (self.high[axis] - self.low[axis]).max(1e-3)
    }

    /// Lowest and highest coordinate along an axis; never equal.
    pub(super) fn range(&self, axis: usize) -> [f64; 2] {
        [self.low[axis], self.low[axis] + self.size(axis)]
    }

    pub(super) fn centre(&self) -> [f64; 3] {
        [0, 1, 2].map(|a| 0.5 * (self.low[a] + self.high[a]))
    }

    /// The box with further horizontal positions, relative to the same origin.
    pub(super) fn including(&self, places: impl Iterator<Item = [f64; 2]>) -> Extent {
        let (mut low, mut high) = (self.low, self.high);
        for place in places {
            for (axis, value) in place.into_iter().enumerate() {
                (low[axis], high[axis]) = (low[axis].min(value), high[axis].max(value));
            }
        }
        Extent { low, high }
    }

    /// Limits that include all points, slightly enlarged for rounding.
    pub(super) fn keep(&self) -> [[f32; 3]; 2] {
        [[0, 1, 2].map(|a| (self.low[a] - 1.0) as f32), [0, 1, 2].map(|a| (self.high[a] + 1.0) as f32)]
    }
}

/// Height above which the view from above omits points, in world coordinates; `None` if no ceiling hides the
/// rest.
pub(super) fn ceiling(points: &Points) -> Option<f64> {
    if points.is_empty() { None } else { Section::choose(points, &Extent::of(points)).cut_above }
}

/// The points that the views show.
pub(super) struct Section {
    /// Limits of the view from the south, relative to the points' origin, m.
    pub(super) south: f64,
    pub(super) north: f64,
    /// Loss of colour of the farthest points in the view from the south, 0–1.
    pub(super) haze: f32,
    /// Height above which the view from above omits points, world coordinates.
    pub(super) cut_above: Option<f64>,
}

impl Section {
    pub(super) fn choose(points: &Points, extent: &Extent) -> Section {
        let room = is_room(points, extent);
        let middle = 0.5 * (extent.low[1] + extent.high[1]);
        let cut_above = room.then(|| 0.5 * (extent.low[2] + extent.high[2]) + points.origin().z);
        if room {
            return Section { south: middle, north: extent.high[1], haze: 0.35, cut_above };
        }
        let thickness = slice(points, extent, middle);
        let middle = fullest(points, extent, thickness);
        Section { south: middle - 0.5 * thickness, north: middle + 0.5 * thickness, haze: 0.5, cut_above }
    }
}

/// Thickness of the thinnest slice about `middle` that contains enough points for a readable view, m.
fn slice(points: &Points, extent: &Extent, middle: f64) -> f64 {
    const MIN_POINTS: usize = 60_000;
    let depth = extent.size(1);
    // A third of the height shows crowns rather than single twigs.
    let mut thickness = (extent.size(2) / 3.0).clamp(0.04 * depth, 0.25 * depth);
    while thickness < depth {
        let half = (0.5 * thickness) as f32;
        let inside = points.offsets().filter(|p| (p[1] - middle as f32).abs() <= half).count();
        if inside >= MIN_POINTS.min(points.len() / 2) {
            return thickness;
        }
        thickness *= 1.5;
    }
    depth
}

/// The middle of the slice of a thickness that shows most: whose points fill most cells of the view from the
/// south.
fn fullest(points: &Points, extent: &Extent, thickness: f64) -> f64 {
    const SLICES: usize = 96;
    const COLUMNS: usize = 64;
    const ROWS: usize = 32;
    let cell = |p: &[f32; 3], axis: usize, count: usize| {
        let share = (f64::from(p[axis]) - extent.low[axis]) / extent.size(axis);
        ((share * count as f64) as usize).min(count - 1)
    };
    // A bit for each cell of the view.
    let mut filled = vec![[0u64; ROWS]; SLICES];
    for p in points.offsets() {
        filled[cell(&p, 1, SLICES)][cell(&p, 2, ROWS)] |= 1 << cell(&p, 0, COLUMNS);
    }
    let depth = extent.size(1);
    let width = ((thickness / depth * SLICES as f64).round() as usize).clamp(1, SLICES);
    let seen = |first: usize| {
        let slices = &filled[first..first + width];
        (0..ROWS).map(|row| slices.iter().fold(0, |all, slice| all | slice[row]).count_ones()).sum::<u32>()
    };
    // Of equals the one nearest to the middle.
    let off_middle = |first: usize| (2 * first + width).abs_diff(SLICES);
    let best = (0..=SLICES - width).max_by_key(|&first| (seen(first), std::cmp::Reverse(off_middle(first))));
    let middle = (best.unwrap_or(0) as f64 + 0.5 * width as f64) / SLICES as f64 * depth + extent.low[1];
    let half = 0.5 * thickness.min(depth);
    // No clamp: rounding may leave the upper limit below the lower one.
    middle.max(extent.low[1] + half).min(extent.high[1] - half)
}

/// True if a ceiling covers most of the floor.
fn is_room(points: &Points, extent: &Extent) -> bool {
    const CELLS: usize = 48;
    let height = extent.size(2);
    if height < 0.12 * extent.size(0).max(extent.size(1)) {
        return false;
    }
    let (roof, floor) = (extent.low[2] + 0.85 * height, extent.low[2] + 0.3 * height);
    let mut cells = vec![(false, false); CELLS * CELLS];
    for p in points.offsets() {
        let cell = |axis: usize| {
            let share = (f64::from(p[axis]) - extent.low[axis]) / extent.size(axis);
            ((share * CELLS as f64) as usize).min(CELLS - 1)
        };
        let (has_roof, has_floor) = &mut cells[cell(1) * CELLS + cell(0)];
        *has_roof |= f64::from(p[2]) > roof;
        *has_floor |= f64::from(p[2]) < floor;
    }
    let with_floor = cells.iter().filter(|c| c.1).count();
    let with_both = cells.iter().filter(|c| c.0 && c.1).count();
    with_floor > 0 && 2 * with_both > with_floor
}

#[cfg(test)]
mod tests {
    use super::*;
    use vlscan_formats::PointRow;
    use vlscan_geom::DVec3;

    #[test]
    fn a_room_is_cut_open_and_a_forest_is_not() {
        let mut room = Points::default();
        let mut forest = Points::default();
        for i in 0..40_000u32 {
            let (x, y) = (f64::from(i % 200) * 0.04, f64::from(i / 200) * 0.03);
            for z in [0.0, 2.8] {
                room.push(&PointRow { position: DVec3::new(x, y, z), ..PointRow::default() }, None);
            }
            let tree = 12.0 + 9.0 * libm::sin(0.9 * x * 25.0) * libm::cos(1.1 * y * 25.0);
            for z in [0.0, tree] {
                forest.push(
                    &PointRow { position: DVec3::new(x * 25.0, y * 25.0, z), ..PointRow::default() },
                    None,
                );
            }
        }
        assert!(is_room(&room, &Extent::of(&room)));
        assert!(!is_room(&forest, &Extent::of(&forest)));
        let section = Section::choose(&room, &Extent::of(&room));
        assert!(section.cut_above.is_some_and(|c| (1.0..2.0).contains(&c)));
    }
}
