//! A point cloud in memory: 24 bytes for each position and up to 12 for its attributes, and a bounded number of points.

use std::collections::HashMap;
use std::path::Path;
use vlscan_base::diag::{Diagnostics, Place};
use vlscan_geom::{Aabb, DVec3, MAX_COORDINATE};

/// What the colours show.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ColourBy {
    /// Height above the datum.
    #[default]
    Height,
    /// Point class, in the customary colours of LAS classes.
    Class,
    /// Strength of the return.
    Intensity,
    /// Object that was hit.
    Object,
    /// Return number.
    Return,
    /// Leg that was flown.
    Leg,
    /// Device of the scanner.
    Channel,
    /// Time of the pulse.
    Time,
}

impl ColourBy {
    /// All of them.
    pub const ALL: [ColourBy; 8] = [
        ColourBy::Height,
        ColourBy::Class,
        ColourBy::Intensity,
        ColourBy::Object,
        ColourBy::Return,
        ColourBy::Leg,
        ColourBy::Channel,
        ColourBy::Time,
    ];

    /// Its name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            ColourBy::Height => "height",
            ColourBy::Class => "class",
            ColourBy::Intensity => "intensity",
            ColourBy::Object => "object",
            ColourBy::Return => "return",
            ColourBy::Leg => "leg",
            ColourBy::Channel => "channel",
            ColourBy::Time => "time",
        }
    }
}

/// Maximum number of points that are kept.
const MAX_POINTS: usize = 40_000_000;

/// A point to be added to [`Points`].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Point<'a> {
    /// World position, m.
    pub position: DVec3,
    /// Strength of the return, any unit.
    pub intensity: f32,
    /// Point class: the classification code of LAS.
    pub class: i32,
    /// Return number, from 1; 0 if unknown.
    pub return_number: u32,
    /// Name of the object that was hit; empty if unknown.
    pub object: &'a str,
    /// Number of the leg.
    pub leg: u16,
    /// Number of the scanner's device.
    pub channel: u16,
    /// Time of the pulse, s.
    pub time: f64,
}

/// The attributes that the points have.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Attributes {
    /// Strength of the return.
    pub intensity: bool,
    /// Point class.
    pub class: bool,
    /// Return number.
    pub return_number: bool,
    /// Name of the object that was hit.
    pub object: bool,
    /// Number of the leg.
    pub leg: bool,
    /// Number of the scanner's device.
    pub channel: bool,
    /// Time of the pulse.
    pub time: bool,
}

/// A point cloud. When there are too many points, every second one of those kept is dropped.
#[derive(Clone, Debug)]
pub struct Points {
    pub(super) attributes: Attributes,
    positions: Vec<DVec3>,
    pub(super) intensity: Vec<f32>,
    pub(super) class: Vec<u8>,
    pub(super) return_number: Vec<u8>,
    pub(super) object: Vec<u16>,
    pub(super) objects: Vec<String>,
    /// Numbers above 255 are 255.
    pub(super) leg: Vec<u8>,
    pub(super) channel: Vec<u8>,
    /// Seconds after the first point.
    pub(super) time: Vec<f32>,
    first_time: Option<f64>,
    bounds: Aabb,
    /// Whether 0 stands for no leg, and N + 1 for leg N.
    legs_from_one: bool,
    object_numbers: HashMap<String, u16>,
    latest_object: u16,
    /// Number of points that were added, without those skipped.
    added: u64,
    /// Number of points of which the first is kept.
    stride: u64,
    max_points: usize,
    skipped: u64,
    odd_classes: u64,
    /// Numbers of points with legs and channels above 255.
    high_legs: u64,
    high_channels: u64,
}

impl Default for Points {
    fn default() -> Points {
        Points::new(Attributes::default())
    }
}

impl Points {
    /// An empty cloud whose points have `attributes`; the others take no memory.
    pub fn new(attributes: Attributes) -> Points {
        Points {
            attributes,
            positions: Vec::new(),
            intensity: Vec::new(),
            class: Vec::new(),
            return_number: Vec::new(),
            object: Vec::new(),
            objects: Vec::new(),
            leg: Vec::new(),
            channel: Vec::new(),
            time: Vec::new(),
            first_time: None,
            bounds: Aabb::EMPTY,
            legs_from_one: false,
            object_numbers: HashMap::new(),
            latest_object: 0,
            added: 0,
            stride: 1,
            max_points: MAX_POINTS,
            skipped: 0,
            odd_classes: 0,
            high_legs: 0,
            high_channels: 0,
        }
    }

    /// Adds a point. A point with a coordinate that is NaN or beyond [`MAX_COORDINATE`] is counted and skipped. Classes above 255 become 255; object
    /// names beyond the first 65 535 share one number.
    pub fn push(&mut self, point: &Point) {
        // Also false for NaN.
        if !(point.position.is_finite() && point.position.abs().max_element() <= MAX_COORDINATE) {
            self.skipped += 1;
            return;
        }
        self.bounds = self.bounds.with(point.position);
        if self.positions.len() >= self.max_points {
            self.drop_every_second();
        }
        self.added += 1;
        if !(self.added - 1).is_multiple_of(self.stride) {
            return;
        }
        self.positions.push(point.position);
        if self.attributes.intensity {
            self.intensity.push(point.intensity);
        }
        if self.attributes.class {
            self.odd_classes += u64::from(!(0..=255).contains(&point.class));
            self.class.push(point.class.clamp(0, 255) as u8);
        }
        if self.attributes.return_number {
            self.return_number.push(point.return_number.min(255) as u8);
        }
        if self.attributes.object {
            let number = self.object_number(point.object);
            self.object.push(number);
        }
        if self.attributes.leg {
            self.high_legs += u64::from(point.leg > 255);
            self.leg.push(point.leg.min(255) as u8);
        }
        if self.attributes.channel {
            self.high_channels += u64::from(point.channel > 255);
            self.channel.push(point.channel.min(255) as u8);
        }
        if self.attributes.time {
            let first = *self.first_time.get_or_insert(point.time);
            self.time.push((point.time - first) as f32);
        }
    }

    fn drop_every_second(&mut self) {
        fn halve<T: Copy>(values: &mut Vec<T>) {
            let kept = values.len().div_ceil(2);
            (0..kept).for_each(|i| values[i] = values[2 * i]);
            values.truncate(kept);
        }
        halve(&mut self.positions);
        halve(&mut self.intensity);
        halve(&mut self.class);
        halve(&mut self.return_number);
        halve(&mut self.object);
        halve(&mut self.leg);
        halve(&mut self.channel);
        halve(&mut self.time);
        self.stride *= 2;
    }

    fn object_number(&mut self, name: &str) -> u16 {
        // Consecutive points are mostly on one object.
        if self.objects.get(usize::from(self.latest_object)).is_some_and(|latest| latest == name) {
            return self.latest_object;
        }
        self.latest_object = match self.object_numbers.get(name) {
            Some(&number) => number,
            None if self.objects.len() < usize::from(u16::MAX) => {
                let number = self.objects.len() as u16;
                self.objects.push(name.to_owned());
                self.object_numbers.insert(name.to_owned(), number);
                number
            }
            None => u16::MAX - 1,
        };
        self.latest_object
    }

    /// From now on leg 0 of the points stands for no leg, and N + 1 for leg N.
    pub fn count_legs_from_one(&mut self) {
        self.legs_from_one = true;
    }

    pub(super) fn legs_from_one(&self) -> bool {
        self.legs_from_one
    }

    /// World position of a point that is kept, m.
    pub fn position(&self, i: usize) -> DVec3 {
        self.positions[i]
    }

    /// World positions of the points that are kept, m.
    pub fn positions(&self) -> &[DVec3] {
        &self.positions
    }

    /// Position of a point relative to [`Points::origin`], m.
    pub(super) fn offset(&self, i: usize) -> [f32; 3] {
        rounded(self.positions[i] - self.origin())
    }

    /// The offsets of all points.
    pub(super) fn offsets(&self) -> impl Iterator<Item = [f32; 3]> + Clone {
        let origin = self.origin();
        self.positions.iter().map(move |position| rounded(*position - origin))
    }

    /// Intensity of a point; `None` if the points have none.
    pub fn intensity_of(&self, i: usize) -> Option<f32> {
        self.intensity.get(i).copied()
    }

    /// Return number of a point; `None` if the points have none.
    pub fn return_number_of(&self, i: usize) -> Option<u8> {
        self.return_number.get(i).copied()
    }

    /// World position of the origin of offsets, the centre of the cloud's box, m.
    pub(super) fn origin(&self) -> DVec3 {
        if self.is_empty() { DVec3::ZERO } else { self.bounds.centre() }
    }

    /// Number of points that are kept.
    pub fn len(&self) -> usize {
        self.positions.len()
    }

    /// Number of points of the cloud, of which not all may be kept.
    pub fn total(&self) -> usize {
        self.added as usize
    }

    /// Whether there are no points.
    pub fn is_empty(&self) -> bool {
        self.positions.is_empty()
    }

    /// Box around the points, world frame, m; empty without points.
    pub fn bounds(&self) -> Aabb {
        if self.is_empty() { Aabb::EMPTY } else { self.bounds }
    }

    /// Warnings of the points of the file `path` that are left out, and of classes that are not kept as they are.
    pub fn doubts(&self, path: &Path) -> Diagnostics {
        let mut found = Diagnostics::default();
        let place = || Some(Place::of_file(path));
        if self.skipped > 0 {
            let count = self.skipped;
            let message =
                format!("{count} points without coordinates within ±{MAX_COORDINATE:e} m are left out");
            found.warn(place(), message);
        }
        if self.odd_classes > 0 {
            let count = self.odd_classes;
            found.warn(
                place(),
                format!("{count} points have classes beyond 0 to 255, which count as 0 or 255"),
            );
        }
        found
    }

    /// A warning of the points of the file `path` whose colour is that of other numbers, if the colours are `colour`.
    pub fn doubts_of_colours(&self, path: &Path, colour: ColourBy) -> Diagnostics {
        let (count, what) = match colour {
            ColourBy::Leg => (self.high_legs, "legs"),
            ColourBy::Channel => (self.high_channels, "channels"),
            _ => (0, ""),
        };
        let mut found = Diagnostics::default();
        if count > 0 {
            let message = format!("{count} points have {what} above 255, which are shown as 255");
            found.warn(Some(Place::of_file(path)), message);
        }
        found
    }

    /// Number of points skipped because of their position.
    pub fn skipped(&self) -> u64 {
        self.skipped
    }

    /// The attributes that the points have.
    pub fn attributes(&self) -> Attributes {
        self.attributes
    }
}

fn rounded(offset: DVec3) -> [f32; 3] {
    [offset.x as f32, offset.y as f32, offset.z as f32]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn positions_keep_their_digits_at_utm_coordinates() {
        let mut points = Points::new(Attributes::default());
        for x in [478_000.123, 478_001.456] {
            points.push(&Point { position: DVec3::new(x, 5_474_500.5, 110.25), ..Point::default() });
        }
        points.push(&Point { position: DVec3::NAN, ..Point::default() });
        assert_eq!((points.len(), points.skipped()), (2, 1));
        let doubts = points.doubts(Path::new("a.xyz")).render(false);
        assert!(doubts.contains("1 points without coordinates") && doubts.contains("a.xyz"), "{doubts}");
        assert_eq!(points.position(1), DVec3::new(478_001.456, 5_474_500.5, 110.25));
        assert!((f64::from(points.offset(1)[0]) + points.origin().x - 478_001.456).abs() < 1e-6);
        assert_eq!(points.bounds().max.x, 478_001.456);
    }

    #[test]
    fn a_bounded_number_of_points_is_kept_evenly() {
        let all = Attributes {
            intensity: true,
            class: true,
            return_number: true,
            object: true,
            ..Attributes::default()
        };
        let mut points = Points { max_points: 8, ..Points::new(all) };
        for i in 0..100 {
            let position = DVec3::X * f64::from(i);
            points.push(&Point { position, intensity: i as f32, class: i, object: "a", ..Point::default() });
        }
        assert_eq!((points.total(), points.len()), (100, 7));
        assert_eq!(points.class, [0, 16, 32, 48, 64, 80, 96]);
        assert_eq!((points.intensity[6], points.position(6).x, points.object.len()), (96.0, 96.0, 7));
        assert_eq!(points.bounds().max.x, 99.0);
    }

    #[test]
    fn numbers_beyond_those_that_are_kept_are_told() {
        let all = Attributes { class: true, leg: true, channel: true, ..Attributes::default() };
        let mut points = Points::new(all);
        for (class, leg, channel) in [(5, 0, 3), (300, 255, 256), (-1, 300, 0), (255, 70, 1)] {
            points.push(&Point { class, leg, channel, ..Point::default() });
        }
        assert_eq!((&points.class[..], &points.leg[..]), (&[5, 255, 0, 255][..], &[0, 255, 255, 70][..]));
        let path = Path::new("a.las");
        assert!(points.doubts(path).render(false).contains("2 points have classes beyond 0 to 255"));
        let colours = |colour| points.doubts_of_colours(path, colour).render(false);
        assert!(colours(ColourBy::Leg).contains("1 points have legs above 255"));
        assert!(colours(ColourBy::Channel).contains("1 points have channels above 255"));
        assert_eq!(colours(ColourBy::Class), "");
    }

    #[test]
    fn objects_are_numbered_in_order_of_appearance() {
        let mut points = Points::new(Attributes { object: true, ..Attributes::default() });
        for object in ["7", "7", "tree", "7", "tree"] {
            points.push(&Point { object, ..Point::default() });
        }
        assert_eq!(points.object, [0, 0, 1, 0, 1]);
        assert_eq!(points.objects, ["7", "tree"]);
    }

    #[test]
    fn more_objects_than_numbers_share_the_last_one() {
        let mut points = Points::new(Attributes { object: true, ..Attributes::default() });
        for i in 0..70_000 {
            points.push(&Point { object: &i.to_string(), ..Point::default() });
        }
        assert_eq!(points.len(), 70_000);
        assert_eq!(points.objects.len(), 65_535);
    }
}
