//! A point cloud in memory: 20 bytes per point, and a bounded number of points.

use crate::geom::{Aabb, DVec3, MAX_COORDINATE};
use std::collections::HashMap;

/// Maximum number of points that are kept.
const MAX_POINTS: usize = 40_000_000;

/// A point to be added to [`Points`].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Point<'a> {
    /// World position, m.
    pub position: DVec3,
    /// Strength of the return, any unit.
    pub intensity: f32,
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
    pub intensity: bool,
    pub class: bool,
    pub return_number: bool,
    pub object: bool,
    pub leg: bool,
    pub channel: bool,
    pub time: bool,
}

/// A point cloud. Positions are `f32` offsets from an origin near the points. When there are too many points, every
/// second one of those kept is dropped.
#[derive(Clone, Debug)]
pub struct Points {
    pub(super) attributes: Attributes,
    pub(super) offsets: Vec<[f32; 3]>,
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
    origin: Option<DVec3>,
    bounds: Aabb,
    object_numbers: HashMap<String, u16>,
    latest_object: u16,
    /// Number of points that were added, without those skipped.
    added: u64,
    /// Number of points of which the first is kept.
    stride: u64,
    max_points: usize,
    skipped: u64,
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
            offsets: Vec::new(),
            intensity: Vec::new(),
            class: Vec::new(),
            return_number: Vec::new(),
            object: Vec::new(),
            objects: Vec::new(),
            leg: Vec::new(),
            channel: Vec::new(),
            time: Vec::new(),
            first_time: None,
            origin: None,
            bounds: Aabb::default(),
            object_numbers: HashMap::new(),
            latest_object: 0,
            added: 0,
            stride: 1,
            max_points: MAX_POINTS,
            skipped: 0,
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
        let origin = *self.origin.get_or_insert(point.position);
        self.bounds = self.bounds.with(point.position);
        if self.offsets.len() >= self.max_points {
            self.drop_every_second();
        }
        self.added += 1;
        if !(self.added - 1).is_multiple_of(self.stride) {
            return;
        }
        let offset = point.position - origin;
        self.offsets.push([offset.x as f32, offset.y as f32, offset.z as f32]);
        if self.attributes.intensity {
            self.intensity.push(point.intensity);
        }
        if self.attributes.class {
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
            self.leg.push(point.leg.min(255) as u8);
        }
        if self.attributes.channel {
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
        halve(&mut self.offsets);
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

    /// Sets the origin of the offsets; by default it is the first point. It must be called before the first point is
    /// added.
    pub fn set_origin(&mut self, origin: DVec3) {
        if self.offsets.is_empty() && origin.is_finite() {
            self.origin = Some(origin);
        }
    }

    /// World position of a point that is kept, m, exact to half a millimetre within some kilometres of the origin.
    pub fn position(&self, i: usize) -> DVec3 {
        self.origin() + DVec3::from(self.offsets[i].map(f64::from))
    }

    /// Intensity of a point; `None` if the points have none.
    pub fn intensity_of(&self, i: usize) -> Option<f32> {
        self.intensity.get(i).copied()
    }

    /// Return number of a point; `None` if the points have none.
    pub fn return_number_of(&self, i: usize) -> Option<u8> {
        self.return_number.get(i).copied()
    }

    /// World position of the origin of the offsets, m.
    pub(super) fn origin(&self) -> DVec3 {
        self.origin.unwrap_or(DVec3::ZERO)
    }

    /// Number of points that are kept.
    pub fn len(&self) -> usize {
        self.offsets.len()
    }

    /// Number of points of the cloud, of which not all may be kept.
    pub fn total(&self) -> usize {
        self.added as usize
    }

    pub fn is_empty(&self) -> bool {
        self.offsets.is_empty()
    }

    /// Box around the points, world frame, m; empty without points.
    pub fn bounds(&self) -> Aabb {
        if self.is_empty() { Aabb::EMPTY } else { self.bounds }
    }

    /// Number of points skipped because of their position.
    pub fn skipped(&self) -> u64 {
        self.skipped
    }

    pub fn attributes(&self) -> Attributes {
        self.attributes
    }
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
        assert!((f64::from(points.offsets[1][0]) + points.origin().x - 478_001.456).abs() < 1e-6);
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
        assert_eq!((points.intensity[6], points.offsets[6][0], points.object.len()), (96.0, 96.0, 7));
        assert_eq!(points.bounds().max.x, 99.0);
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
