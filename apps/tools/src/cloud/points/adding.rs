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
            self.added += part.positions.len() as u64;
            self.keep_columns(&part.positions, &part.values);
        }
    }

    /// Keeps a point, unless only some of the points are kept.
    pub(super) fn keep(&mut self, position: DVec3, point: &KeptValues, object: Option<&str>) {
        if self.positions.len() >= self.max_points {
            self.drop_every_second();
        }
        self.added += 1;
        if !(self.added - 1).is_multiple_of(self.stride) {
            // Every point counts: most of a cloud may be dark.
            self.count_colour(point);
            return;
        }
        if self.has(Attribute::Object) {
            let mut number = itoa::Buffer::new();
            let number = self.object_number(object.unwrap_or_else(|| number.format(point.object)));
            self.object.push(number);
        }
        self.keep_columns(&[position], std::slice::from_ref(point));
    }

    /// Keeps points without their objects, column by column, which is faster than point by point.
    fn keep_columns(&mut self, positions: &[DVec3], points: &[KeptValues]) {
        let values = || points.iter();
        if self.kept.is_none() {
            for (number, point) in (self.positions.len()..).zip(values()) {
                let Some(colour) = self.count_colour(point) else { continue };
                // Points of other scans may have none.
                self.colour.fill(number, [0; 3]);
                self.colour.push(colour);
            }
        }
        self.positions.extend(positions);
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
        if let (true, Some(first)) = (self.has(Attribute::Time), points.first()) {
            let first = *self.first_time.get_or_insert(first.time);
            self.time.extend(values().map(|value| value.time - first));
        }
    }

    /// The colour of a point if colours are kept, whose greatest component counts.
    fn count_colour(&mut self, point: &KeptValues) -> Option<[u16; 3]> {
        let colour = point.colour.filter(|_| self.kept.is_none())?;
        self.max_colour = colour.into_iter().fold(self.max_colour, u16::max);
        Some(colour)
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
