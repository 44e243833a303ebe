//! The few points of a cloud that lie far from all others, caused by bad GNSS fixes, damaged files or birds.
//! They are found in one pass and in constant memory.
//!
//! A stray lies behind a gap without points along x, y or z that is wider than three times the extent of most
//! points, and wider than the way from these to the gap: the points of a tripod thin out with their distance.
//! Strays are few and isolated: an islet or the returns through a window are a separate place.

use std::path::Path;
use vlscan_base::diag::{Diagnostics, Place};
use vlscan_base::quantity::{metres, number};
use vlscan_geom::{Aabb, DVec3};

/// Maximum number of strays at one end of an axis; more of them are a separate place.
const MAX_STRAYS: usize = 63;
/// Minimum number of distinct points near each other that are a separate place.
const MIN_PLACE: usize = 8;
/// Maximum distance between the points of a place, as a share of the distance from most points.
const PLACE_REACH: f64 = 0.5;
/// Maximum share of the points that are strays at one end of an axis, and the share that the extent of most
/// points excludes there.
const MAX_SHARE: f64 = 0.05;
/// Fewest points of which some can lie far from the others.
const MIN_POINTS: u64 = 10;
/// Width of the gap before a stray, in extents of most points.
const GAP_EXTENTS: f64 = 3.0;
/// Minimum extents for this: horizontally and vertically, m.
const MIN_EXTENTS: [f64; 2] = [10.0, 50.0];
/// Minimum width of the gap before points that lie apart, as a share of the extent.
const MIN_APART: f64 = 0.5;
/// Maximum number of points, evenly sampled, from which the extent of most points is estimated.
const MAX_SAMPLE: usize = 1 << 14;

/// Takes the points of a cloud to find its strays.
#[derive(Clone, Debug)]
pub struct StrayFinder {
    count: u64,
    /// Every n-th point is in the sample, n a power of two.
    stride: u64,
    sample: Vec<DVec3>,
    /// The lower and the upper end of each axis.
    ends: [End; 6],
}

/// The points at one end of an axis.
#[derive(Clone, Debug)]
struct End {
    axis: usize,
    sign: f64,
    /// Points of this value or less are not among the outermost.
    threshold: f64,
    /// Value towards the end, number and position of points.
    points: Vec<(f64, u64, DVec3)>,
}

impl End {
    fn add(&mut self, number: u64, p: DVec3) {
        let value = self.sign * p[self.axis];
        if value > self.threshold {
            self.points.push((value, number, p));
            if self.points.len() >= 4 * MAX_STRAYS {
                self.shorten();
            }
        }
    }

    /// Keeps the outermost points: one more than may be strays.
    fn shorten(&mut self) {
        self.points.sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        self.points.truncate(MAX_STRAYS + 1);
        self.threshold = self.points.last().map_or(f64::NEG_INFINITY, |last| last.0);
    }

    /// The value behind which points are strays, in the middle of the innermost gap that is wide enough and
    /// has no place behind it; `None` without strays. `core` is the box of most points.
    fn limit(mut self, count: u64, gap: f64, core: &Aabb) -> Option<f64> {
        self.shorten();
        let edge = if self.sign < 0.0 { core.min } else { core.max };
        let edge = self.sign * edge[self.axis];
        let most = ((count as f64 * MAX_SHARE) as usize).clamp(1, MAX_STRAYS);
        let is_limit = |last: &usize| {
            let [outer, inner] = [self.points[*last].0, self.points[last + 1].0];
            outer - inner > gap.max(inner - edge) && !has_place(&self.points[..=*last], core)
        };
        let last = (0..self.points.len().saturating_sub(1).min(most)).rfind(is_limit)?;
        Some(self.sign * (0.5 * self.points[last].0 + 0.5 * self.points[last + 1].0))
    }
}

/// True if some points far from the core of a cloud are a separate place: many distinct ones are near each
/// other, and not above or below the core, where clouds, birds and multiple reflections give points.
fn has_place(points: &[(f64, u64, DVec3)], core: &Aabb) -> bool {
    let margin = core.size();
    let is_neighbour = |p: &DVec3| {
        (0..2).any(|axis| p[axis] < core.min[axis] - margin[axis] || p[axis] > core.max[axis] + margin[axis])
    };
    let neighbours: Vec<DVec3> = points.iter().map(|(_, _, p)| *p).filter(is_neighbour).collect();
    neighbours.iter().any(|p| {
        let reach = PLACE_REACH * distance(core, *p);
        let mut near: Vec<DVec3> = Vec::new();
        for q in &neighbours {
            // Damaged files have many points at one position.
            if (*q - *p).length() <= reach && !near.contains(q) {
                near.push(*q);
            }
        }
        near.len() >= MIN_PLACE
    })
}

/// The distance of a point from a box, m.
fn distance(from: &Aabb, p: DVec3) -> f64 {
    (p - p.max(from.min).min(from.max)).length()
}

impl Default for StrayFinder {
    fn default() -> StrayFinder {
        let end = |i: usize| End {
            axis: i / 2,
            sign: if i.is_multiple_of(2) { -1.0 } else { 1.0 },
            threshold: f64::NEG_INFINITY,
            points: Vec::new(),
        };
        StrayFinder { count: 0, stride: 1, sample: Vec::new(), ends: std::array::from_fn(end) }
    }
}

impl StrayFinder {
    /// The strays of some points.
    pub fn of(points: impl IntoIterator<Item = DVec3>) -> Strays {
        let mut finder = StrayFinder::default();
        points.into_iter().for_each(|p| finder.add(p));
        finder.strays()
    }

    /// Adds a point, whose coordinates are finite.
    pub fn add(&mut self, p: DVec3) {
        let count = self.count;
        self.add_to_sample(count, p);
        self.ends.iter_mut().for_each(|end| end.add(count, p));
        self.count += 1;
    }

    /// Adds points in their order, as [`StrayFinder::add`] does, faster.
    pub fn add_all(&mut self, points: &[DVec3]) {
        let bounds = Aabb::around(points.iter().copied());
        for end in &mut self.ends {
            let corner = if end.sign < 0.0 { bounds.min } else { bounds.max };
            if end.sign * corner[end.axis] > end.threshold {
                (self.count..).zip(points).for_each(|(number, p)| end.add(number, *p));
            }
        }
        let mut from = self.count;
        while let Some(number) = from.checked_next_multiple_of(self.stride)
            && let Some(p) = points.get((number - self.count) as usize)
        {
            self.add_to_sample(number, *p);
            from = number + 1;
        }
        self.count += points.len() as u64;
    }

    /// Adds the point of a number to the sample, if that is one of its numbers.
    fn add_to_sample(&mut self, number: u64, p: DVec3) {
        if number & (self.stride - 1) != 0 {
            return;
        }
        if self.sample.len() == MAX_SAMPLE {
            let mut place = 0;
            self.sample.retain(|_| {
                place += 1;
                place % 2 == 1
            });
            self.stride *= 2;
        }
        if number & (self.stride - 1) == 0 {
            self.sample.push(p);
        }
    }

    /// The strays among the points so far.
    pub fn strays(&self) -> Strays {
        let everywhere = Aabb { min: DVec3::NEG_INFINITY, max: DVec3::INFINITY };
        let mut strays = Strays { within: everywhere, count: 0, farthest: None };
        if self.count < MIN_POINTS {
            return strays;
        }
        let core = self.core();
        let size = core.size();
        let [across, up] = [(size.x.max(size.y), MIN_EXTENTS[0]), (size.z, MIN_EXTENTS[1])]
            .map(|(extent, least)| GAP_EXTENTS * extent.max(least));
        for end in &self.ends {
            let gap = if end.axis == 2 { up } else { across };
            let Some(limit) = end.clone().limit(self.count, gap, &core) else { continue };
            let side = if end.sign < 0.0 { &mut strays.within.min } else { &mut strays.within.max };
            side[end.axis] = limit;
        }
        let mut found: Vec<(u64, DVec3)> = Vec::new();
        for (_, number, p) in self.ends.iter().flat_map(|end| &end.points) {
            if strays.contains(*p) && found.iter().all(|(other, _)| other != number) {
                found.push((*number, *p));
            }
        }
        let farthest = found.iter().map(|(_, p)| (*p, distance(&core, *p)));
        strays.farthest = farthest.max_by(|a, b| a.1.total_cmp(&b.1));
        strays.count = found.len() as u64;
        strays
    }

    /// The smaller part of the points, if it lies behind a gap along x or y that is wider than half their
    /// extent.
    pub fn apart(&self) -> Option<Apart> {
        let widest = |axis: usize| {
            let mut values: Vec<f64> = self.kept().map(|p| p[axis]).collect();
            values.sort_unstable_by(f64::total_cmp);
            let extent = values.last()? - values.first()?;
            let gaps = values.windows(2).map(|pair| (pair[1] - pair[0], 0.5 * pair[0] + 0.5 * pair[1]));
            let (gap, middle) = gaps.max_by(|a, b| a.0.total_cmp(&b.0))?;
            (gap > MIN_APART * extent).then_some((gap, axis, middle))
        };
        let (gap_m, axis, middle) = (0..2).filter_map(widest).max_by(|a, b| a.0.total_cmp(&b.0))?;
        let above = self.sample.iter().filter(|p| p[axis] > middle).count();
        let is_upper = 2 * above <= self.sample.len();
        let is_apart = |p: &DVec3| (p[axis] > middle) == is_upper;
        let mut end = self.ends[2 * axis + usize::from(is_upper)].clone();
        end.shorten();
        let at_end = end.points.iter().filter(|(_, _, p)| is_apart(p)).count() as u64;
        let in_sample = self.sample.iter().filter(|p| is_apart(p)).count() as u64;
        // The ends hold all points apart, or one more than may be strays.
        let are_at_end = at_end <= MAX_STRAYS as u64;
        Some(Apart {
            count: if are_at_end { at_end } else { at_end.max(in_sample * self.stride) },
            is_estimated: !are_at_end && self.stride > 1,
            gap_m,
            bounds: Aabb::around(self.kept().filter(|p| is_apart(p))),
            others: Aabb::around(self.kept().filter(|p| !is_apart(p))),
        })
    }

    /// The horizontal extent of the points, and the number and place of those that lie apart, in words; there
    /// must be points.
    pub fn described_extent(&self) -> String {
        let Aabb { min, max } = Aabb::around(self.kept());
        let mut text = format!(
            "the points lie from x {:.0} to {:.0} and from y {:.0} to {:.0} m",
            min.x, max.x, min.y, max.y
        );
        if let Some(apart) = self.apart() {
            let lie = if apart.count == 1 { "lies" } else { "lie" };
            let centre = apart.bounds.centre();
            text += &format!(
                "; {}{} of {} {lie} {} from the others, around x {:.0} and y {:.0}",
                if apart.is_estimated { "about " } else { "" },
                apart.count,
                self.count,
                metres(apart.gap_m),
                centre.x,
                centre.y
            );
        }
        text
    }

    /// The sample and the outermost points.
    fn kept(&self) -> impl Iterator<Item = DVec3> {
        let at_ends = self.ends.iter().flat_map(|end| end.points.iter().map(|(_, _, p)| *p));
        self.sample.iter().copied().chain(at_ends)
    }

    /// The box around most points.
    fn core(&self) -> Aabb {
        let skipped = ((self.sample.len() as f64 * MAX_SHARE) as usize).max(1);
        let ends = |axis: usize| {
            let mut values: Vec<f64> = self.sample.iter().map(|p| p[axis]).collect();
            values.sort_unstable_by(f64::total_cmp);
            let last = values.len() - 1;
            [values[skipped.min(last)], values[last.saturating_sub(skipped)]]
        };
        let [x, y, z] = [0, 1, 2].map(ends);
        Aabb { min: DVec3::new(x[0], y[0], z[0]), max: DVec3::new(x[1], y[1], z[1]) }
    }
}

/// A part of a cloud, few points or many, that lies apart from the others.
#[derive(Clone, Copy, Debug)]
pub struct Apart {
    /// Number of points.
    pub count: u64,
    /// True if the number is estimated from a sample.
    pub is_estimated: bool,
    /// Width of the gap between them and the others, m.
    pub gap_m: f64,
    /// Box around them, m.
    pub bounds: Aabb,
    /// Box around the others, m.
    pub others: Aabb,
}

/// The points of a cloud that lie far from all others.
#[derive(Clone, Copy, Debug)]
pub struct Strays {
    /// Box of all other points, m; infinite without strays.
    within: Aabb,
    /// Number of strays.
    pub count: u64,
    /// The farthest one, and its distance from most points, m.
    pub farthest: Option<(DVec3, f64)>,
}

impl Strays {
    /// True if a point of the cloud is one of them.
    pub fn contains(&self, p: DVec3) -> bool {
        let is_within =
            (0..3).all(|axis| self.within.min[axis] <= p[axis] && p[axis] <= self.within.max[axis]);
        !is_within
    }

    /// The box of all other points, m; infinite without strays.
    pub fn others(&self) -> Aabb {
        self.within
    }

    /// Their number and the place of the farthest one in words; `None` without strays.
    pub fn described(&self) -> Option<String> {
        let (p, distance) = self.farthest?;
        let [x, y, z] = p.to_array().map(|c| format!("{c:.2}"));
        let far = if distance >= 1e4 {
            format!("{} km", number((distance / 10.0).round() / 100.0))
        } else {
            format!("{} m", distance.round())
        };
        Some(match self.count {
            1 => format!("1 point lies far from all others, {far} away at {x} {y} {z}"),
            count => {
                format!("{count} points lie far from all others, the farthest {far} away at {x} {y} {z}")
            }
        })
    }

    /// Warns of strays; `what` names their treatment: "left out".
    pub fn warn(&self, path: &Path, what: &str, found: &mut Diagnostics) {
        if let Some(described) = self.described() {
            let them = if self.count == 1 { "it is" } else { "they are" };
            found.warn(Some(Place::of_file(path)), format!("{described}; {them} {what}"));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use vlscan_base::rng::{Purpose, Stream};

    /// Points within `size`, and others.
    fn cloud(count: u64, size: DVec3, more: &[DVec3]) -> Vec<DVec3> {
        let draws = Stream::new(3, Purpose::SceneMaking);
        let place = |i: u64| DVec3::from([0, 1, 2].map(|axis| draws.uniform(0, i, axis as u32))) * size;
        more.iter().copied().chain((0..count).map(place)).collect()
    }

    #[test]
    fn single_points_far_away_are_strays_wherever_they_are_in_the_file() {
        let size = DVec3::new(60.0, 60.0, 10.0);
        for place in [
            DVec3::new(30.0, 30.0, 3000.0),
            DVec3::new(3000.0, 0.0, 0.0),
            DVec3::new(20.0, -30_000.0, 0.0),
            DVec3::new(1e6, 1e6, 0.0),
            DVec3::new(5.0, 5.0, -200.0),
        ] {
            for count in [10, 400, 100_000] {
                let mut points = cloud(count, size, &[place]);
                let found = StrayFinder::of(points.iter().copied());
                assert_eq!((found.count, found.farthest.unwrap().0), (1, place), "{count}");
                assert_eq!(points.iter().filter(|p| found.contains(**p)).count(), 1);
                let half = points.len() / 2;
                points.rotate_left(half);
                assert_eq!(StrayFinder::of(points).count, 1);
            }
        }
        let both = StrayFinder::of(cloud(400, size, &[DVec3::new(1e6, 1e6, 0.0); 5]));
        let text = both.described().unwrap();
        assert_eq!(both.count, 5);
        assert!(
            text.contains("5 points lie far") && text.contains("at 1000000.00 1000000.00 0.00"),
            "{text}"
        );
        assert!(text.contains("1414.13 km") || text.contains("1414.14 km"), "{text}");
    }

    #[test]
    fn points_that_lie_apart_are_described_however_many_they_are() {
        let size = DVec3::new(60.0, 60.0, 10.0);
        for count in [1, 40, 64, 100, 2000] {
            let far = cloud(count, size, &[]).into_iter().map(|p| p + DVec3::new(0.0, -20_000.0, 0.0));
            let finder = &mut StrayFinder::default();
            cloud(3000, size, &far.collect::<Vec<DVec3>>()).into_iter().for_each(|p| finder.add(p));
            let apart = finder.apart().unwrap();
            assert_eq!((apart.count, apart.is_estimated), (count, false));
            assert!((apart.gap_m - 19_970.0).abs() < 40.0 && apart.others.min.y >= 0.0, "{apart:?}");
            let text = finder.described_extent();
            assert!(text.contains(&format!("; {count} of {} lie", 3000 + count)), "{text}");
            assert!(text.contains(" 20 km from the others, around x "), "{text}");
        }
        // Points beyond the sample are estimated.
        let far = cloud(5000, size, &[]).into_iter().map(|p| p + DVec3::X * 20_000.0);
        let mut finder = StrayFinder::default();
        cloud(100_000, size, &far.collect::<Vec<DVec3>>()).into_iter().for_each(|p| finder.add(p));
        let apart = finder.apart().unwrap();
        assert!(apart.is_estimated && (4900..5100).contains(&apart.count), "{apart:?}");
        let mut even = StrayFinder::default();
        cloud(1000, size, &[]).into_iter().for_each(|p| even.add(p));
        assert!(even.apart().is_none() && even.described_extent().ends_with(" m"));
    }

    #[test]
    fn points_that_are_added_together_are_those_added_one_by_one() {
        let size = DVec3::new(60.0, 60.0, 10.0);
        let points = cloud(50_000, size, &[DVec3::X * 1e5, DVec3::Z * -3e4]);
        let mut single = StrayFinder::default();
        points.iter().for_each(|p| single.add(*p));
        for block in [1, 7, 1000, 16_384, 60_000] {
            let mut together = StrayFinder::default();
            points.chunks(block).for_each(|block| together.add_all(block));
            together.add_all(&[]);
            assert!(format!("{together:?}") == format!("{single:?}"), "{block}");
        }
    }

    #[test]
    fn few_points_equal_points_and_points_in_the_air_are_strays_together() {
        let size = DVec3::new(60.0, 60.0, 10.0);
        let few = cloud(7, size * 0.5, &[]).into_iter().map(|p| p + DVec3::X * 860.0);
        let air = cloud(30, DVec3::new(60.0, 60.0, 200.0), &[]).into_iter().map(|p| p + DVec3::Z * 400.0);
        for far in [few.collect::<Vec<DVec3>>(), air.collect(), vec![DVec3::splat(-5e5); 40]] {
            assert_eq!(StrayFinder::of(cloud(3000, size, &far)).count, far.len() as u64);
        }
    }

    #[test]
    fn places_of_their_own_and_points_that_thin_out_are_no_strays() {
        let size = DVec3::new(60.0, 60.0, 10.0);
        let far: Vec<DVec3> = cloud(100, size, &[]).into_iter().map(|p| p + DVec3::X * 1e5).collect();
        assert_eq!(StrayFinder::of(cloud(5000, size, &far)).count, 0);
        assert_eq!(StrayFinder::of(cloud(1, size, &[DVec3::ZERO, DVec3::X * 1e6])).count, 0);
        assert_eq!(StrayFinder::of(cloud(6, size, &[DVec3::X * 1e6; 6])).count, 0);
        // An islet, and an outlier beyond it.
        let mut lake = cloud(3000, size, &[]);
        lake.extend(cloud(60, size * 0.5, &[]).into_iter().map(|p| p + DVec3::X * 860.0));
        assert_eq!(StrayFinder::of(lake.iter().copied()).count, 0);
        lake.push(DVec3::new(20_000.0, 0.0, 0.0));
        assert_eq!(StrayFinder::of(lake).count, 1);
        // Returns through a window.
        let outside = (0..12u32).map(|i| DVec3::new(60.0 + 8.0 * f64::from(i), f64::from(i % 5), 1.0));
        let room = cloud(20_000, DVec3::new(8.0, 6.0, 3.0), &outside.collect::<Vec<DVec3>>());
        assert_eq!(StrayFinder::of(room).count, 0);
        // A tripod's: their number falls with the square of the distance, out to 2 km.
        let around = (0..20_000u32).map(|i| {
            let turn = 2.399_963 * f64::from(i);
            let range = 2.0 / (1.0 - f64::from(i) / 20_020.0);
            DVec3::new(range * libm::cos(turn), range * libm::sin(turn), 0.0)
        });
        assert_eq!(StrayFinder::of(around).count, 0);
        assert_eq!(StrayFinder::of([]).count, 0);
        assert_eq!(StrayFinder::of(vec![DVec3::ZERO; 1000]).count, 0);
    }
}
