//! Adding points to a cloud: one by one, and the points of a block column by column.

use super::super::points_part::{KeptValues, PointsPart};
use super::Points;
use vlscan_formats::Attribute;
use vlscan_geom::{Aabb, DVec3};

impl Points {
    /// Adds the points of a block.
    pub(super) fn append(&mut self, part: &PointsPart) {
        self.misses += part.misses;
        self.skipped += part.skipped;
        self.bounds = self.bounds.union(Aabb::around(part.positions.iter().copied()));
        self.strays.add_all(&part.positions);
        // Names of objects are numbered one by one, and points that are thinned are counted.
        let is_thinned = self.stride > 1 || self.positions.len() + part.positions.len() > self.max_points;
        if is_thinned || self.has(Attribute::Object) {
            part.positions.iter().zip(&part.values).for_each(|(p, values)| self.keep(*p, values, None));
        } else {
            self.keep_all(part);
        }
    }

    /// Keeps all points of a block that have no objects, as [`Points::keep`] keeps each: column by column,
    /// which is faster.
    fn keep_all(&mut self, part: &PointsPart) {
        let values = || part.values.iter();
        self.added += part.positions.len() as u64;
        if self.kept.is_none() && values().any(|value| value.colour.is_some()) {
            let before = self.positions.len();
            for (number, colour) in (before..).zip(values().map(|value| value.colour)) {
                let Some(colour) = colour else { continue };
                self.max_colour = colour.into_iter().fold(self.max_colour, u16::max);
                self.colour.fill(number, [0; 3]);
                self.colour.push(colour);
            }
        }
        self.positions.extend(&part.positions);
        if self.has(Attribute::Intensity) {
            self.intensity.extend(values().map(|value| value.intensity));
        }
        if self.has(Attribute::Class) {
            self.class.extend(values().map(|value| value.class));
        }
        if self.has(Attribute::ReturnNumber) {
            self.return_number.extend(values().map(|value| value.return_number));
        }
        if self.has(Attribute::NumberOfReturns) {
            self.number_of_returns.extend(values().map(|value| value.number_of_returns));
        }
        if self.has(Attribute::ScanAngle) {
            self.scan_angle.extend(values().map(|value| value.scan_angle));
        }
        if self.has(Attribute::Leg) {
            self.high_legs += values().filter(|value| value.leg > 255).count() as u64;
            self.leg.extend(values().map(|value| value.leg));
        }
        if self.has(Attribute::Channel) {
            self.high_channels += values().filter(|value| value.channel > 255).count() as u64;
            self.channel.extend(values().map(|value| value.channel.min(255) as u8));
        }
        if let (true, Some(first)) = (self.has(Attribute::Time), part.values.first()) {
            let first = *self.first_time.get_or_insert(first.time);
            self.time.extend(values().map(|value| value.time - first));
        }
    }

    /// Keeps a point, unless only some of the points are kept.
    pub(super) fn keep(&mut self, position: DVec3, point: &KeptValues, object: Option<&str>) {
        if self.positions.len() >= self.max_points {
            self.drop_every_second();
        }
        self.added += 1;
        let colour = point.colour.filter(|_| self.kept.is_none());
        // Every point counts: most of a cloud may be dark.
        self.max_colour = colour.into_iter().flatten().fold(self.max_colour, u16::max);
        if !(self.added - 1).is_multiple_of(self.stride) {
            return;
        }
        self.positions.push(position);
        if self.has(Attribute::Intensity) {
            self.intensity.push(point.intensity);
        }
        if self.has(Attribute::Class) {
            self.class.push(point.class);
        }
        if self.has(Attribute::ReturnNumber) {
            self.return_number.push(point.return_number);
        }
        if self.has(Attribute::NumberOfReturns) {
            self.number_of_returns.push(point.number_of_returns);
        }
        if self.has(Attribute::ScanAngle) {
            self.scan_angle.push(point.scan_angle);
        }
        if self.has(Attribute::Object) {
            let mut number = itoa::Buffer::new();
            let number = self.object_number(object.unwrap_or_else(|| number.format(point.object)));
            self.object.push(number);
        }
        if self.has(Attribute::Leg) {
            self.high_legs += u64::from(point.leg > 255);
            self.leg.push(point.leg);
        }
        if self.has(Attribute::Channel) {
            self.high_channels += u64::from(point.channel > 255);
            self.channel.push(point.channel.min(255) as u8);
        }
        if let Some(colour) = colour {
            // Points of other scans may have none.
            self.colour.fill(self.positions.len() - 1, [0; 3]);
            self.colour.push(colour);
        }
        if self.has(Attribute::Time) {
            let first = *self.first_time.get_or_insert(point.time);
            self.time.push(point.time - first);
        }
    }

    fn drop_every_second(&mut self) {
        self.positions.halve();
        self.intensity.halve();
        self.class.halve();
        self.return_number.halve();
        self.number_of_returns.halve();
        self.scan_angle.halve();
        self.object.halve();
        self.leg.halve();
        self.channel.halve();
        self.colour.halve();
        self.time.halve();
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
}
