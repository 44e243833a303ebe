//! A point cloud in memory: 20 bytes per point.

use crate::geom::{Aabb, DVec3};
use std::collections::HashMap;

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
}

/// The attributes that the points have.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Attributes {
    pub intensity: bool,
    pub class: bool,
    pub return_number: bool,
    pub object: bool,
}

/// A point cloud. Positions are `f32` offsets from an origin near the points.
#[derive(Clone, Debug, Default)]
pub struct Points {
    pub(super) attributes: Attributes,
    pub(super) offsets: Vec<[f32; 3]>,
    pub(super) intensity: Vec<f32>,
    pub(super) class: Vec<u8>,
    pub(super) return_number: Vec<u8>,
    pub(super) object: Vec<u16>,
    pub(super) objects: Vec<String>,
    origin: Option<DVec3>,
    bounds: Aabb,
    object_numbers: HashMap<String, u16>,
    latest_object: u16,
    skipped: u64,
}

impl Points {
    /// An empty cloud whose points have `attributes`; the others take no memory.
    pub fn new(attributes: Attributes) -> Points {
        Points { attributes, ..Points::default() }
    }

    /// Adds a point. A point whose position is not finite is counted and skipped. Classes above 255 become 255; object
    /// names beyond the first 65 535 share one number.
    pub fn push(&mut self, point: &Point) {
        if !point.position.is_finite() {
            self.skipped += 1;
            return;
        }
        let origin = *self.origin.get_or_insert(point.position);
        self.bounds = self.bounds.with(point.position);
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

    /// World position of the origin of the offsets, m.
    pub(super) fn origin(&self) -> DVec3 {
        self.origin.unwrap_or(DVec3::ZERO)
    }

    pub fn len(&self) -> usize {
        self.offsets.len()
    }

    pub fn is_empty(&self) -> bool {
        self.offsets.is_empty()
    }

    /// Box around the points, world frame, m; empty without points.
    pub fn bounds(&self) -> Aabb {
        if self.is_empty() { Aabb::EMPTY } else { self.bounds }
    }

    /// Number of points skipped because their position is not finite.
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
