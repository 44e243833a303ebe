//! Facts about a block of points, counted on the thread that decodes it.

use super::occupancy::{Occupancy, SmallestCell};
use super::points_part::is_placed;
use std::collections::{BTreeMap, HashSet};
use std::hash::{DefaultHasher, Hash, Hasher};
use vlscan_formats::{Attribute, AttributeSet, PointPart, PointRow};
use vlscan_geom::DVec3;

/// Seconds of a week.
pub(super) const WEEK_S: f64 = 604_800.0;

/// Smallest and largest of some values.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Span {
    /// The smallest.
    pub min: f64,
    /// The largest.
    pub max: f64,
}

impl Span {
    fn with(span: Option<Span>, value: f64) -> Option<Span> {
        let Some(Span { min, max }) = span else { return Some(Span { min: value, max: value }) };
        Some(Span { min: min.min(value), max: max.max(value) })
    }

    pub(super) fn union(self, other: Span) -> Span {
        Span { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    /// The span of two, either of which may have no values.
    pub(super) fn of_both(a: Option<Span>, b: Option<Span>) -> Option<Span> {
        [a, b].into_iter().flatten().reduce(Span::union)
    }

    /// True if times, s, cannot be seconds of the GPS week. Some recordings continue past the end of the
    /// week.
    pub(super) fn is_beyond_week(self) -> bool {
        self.min < 0.0 || self.max > 2.0 * WEEK_S
    }
}

/// The points of a flight line.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LineFacts {
    /// Number of points.
    pub points: u64,
    /// Their times, s.
    pub time: Option<Span>,
}

impl LineFacts {
    /// Adds points of the same line.
    pub(super) fn append(&mut self, more: &LineFacts) {
        self.points += more.points;
        self.time = Span::of_both(self.time, more.time);
    }
}

/// The number and the exact sum of values, so that their order does not matter.
#[derive(Clone, Debug)]
pub(super) struct ExactSum {
    count: u64,
    /// Sums of the digits of values, by their exponent.
    digits: Box<[i64; 256]>,
}

impl Default for ExactSum {
    fn default() -> ExactSum {
        ExactSum { count: 0, digits: Box::new([0; 256]) }
    }
}

impl ExactSum {
    /// Adds a value that is a number.
    fn add(&mut self, value: f32) {
        let bits = value.to_bits();
        let exponent = ((bits >> 23) & 0xff) as usize;
        let implicit = if exponent > 0 { 1 << 23 } else { 0 };
        let digits = i64::from((bits & 0x7f_ffff) | implicit);
        self.count += 1;
        self.digits[exponent] += if value.is_sign_negative() { -digits } else { digits };
    }

    pub fn append(&mut self, more: &ExactSum) {
        self.count += more.count;
        self.digits.iter_mut().zip(more.digits.iter()).for_each(|(sum, more)| *sum += more);
    }

    fn clear(&mut self) {
        (self.count, *self.digits) = (0, [0; 256]);
    }

    /// The mean; `None` without values.
    pub fn mean(&self) -> Option<f64> {
        let of_exponent = |(exponent, sum): (i32, &i64)| match exponent {
            255 if *sum != 0 => f64::INFINITY.copysign(*sum as f64),
            _ => *sum as f64 * libm::ldexp(1.0, exponent.max(1) - 150),
        };
        let sum: f64 = (0..).zip(self.digits.iter()).map(of_exponent).sum();
        (self.count > 0).then(|| sum / self.count as f64)
    }
}

/// Facts about some successive points of a file. Those about several blocks are the same wherever blocks end.
#[derive(Debug)]
pub(super) struct FactsPart {
    attributes: AttributeSet,
    is_las: bool,
    /// Positions of the points that count, in their order.
    pub positions: Vec<DVec3>,
    /// Cells of these positions, of equal successive ones the first.
    pub cells: Vec<SmallestCell>,
    pub skipped: u64,
    pub misses: u64,
    pub without_number: u64,
    pub beyond_number: u64,
    pub by_class: Box<[u64; 256]>,
    pub by_return: Box<[u64; 256]>,
    pub pulses_by_returns: Box<[u64; 256]>,
    pub by_path: Box<[u64; 256]>,
    /// Numbers of points of the channels below 256, and of the others.
    pub by_channel: Box<[u64; 256]>,
    pub by_high_channel: BTreeMap<u16, u64>,
    pub intensity: Option<Span>,
    pub intensities: ExactSum,
    pub scan_angle: Option<Span>,
    pub time: Option<Span>,
    /// Successive points of a flight line.
    pub lines: Vec<(u16, LineFacts)>,
    pub objects: HashSet<u64>,
    /// The object of the last point, and its name.
    object: Option<u64>,
    name: Option<String>,
}

impl FactsPart {
    /// No points yet, which have these attributes.
    pub fn new(attributes: AttributeSet, is_las: bool) -> FactsPart {
        let none = || Box::new([0; 256]);
        FactsPart {
            attributes,
            is_las,
            positions: Vec::new(),
            cells: Vec::new(),
            skipped: 0,
            misses: 0,
            without_number: 0,
            beyond_number: 0,
            by_class: none(),
            by_return: none(),
            pulses_by_returns: none(),
            by_path: none(),
            by_channel: none(),
            by_high_channel: BTreeMap::new(),
            intensity: None,
            intensities: ExactSum::default(),
            scan_angle: None,
            time: None,
            lines: Vec::new(),
            objects: HashSet::new(),
            object: None,
            name: None,
        }
    }

    fn count(&mut self, row: &PointRow, object: Option<&str>) {
        let p = row.position;
        let attributes = self.attributes;
        let has = |attribute| attributes.has(attribute);
        self.positions.push(p);
        let cell = Occupancy::smallest_cell(p.x, p.y);
        if self.cells.last() != Some(&cell) {
            self.cells.push(cell);
        }
        if has(Attribute::Class) {
            self.by_class[usize::from(row.class)] += 1;
        }
        if has(Attribute::ReturnNumber) {
            self.by_return[usize::from(row.return_number)] += 1;
            let has_number = has(Attribute::NumberOfReturns);
            self.beyond_number += u64::from(has_number && row.return_number > row.number_of_returns.max(1));
            if row.return_number <= 1 && has_number {
                self.pulses_by_returns[usize::from(row.number_of_returns)] += 1;
                self.without_number += u64::from(row.return_number == 0 && row.number_of_returns == 0);
            }
        }
        if has(Attribute::Path) {
            self.by_path[usize::from(row.path)] += 1;
        }
        if has(Attribute::Intensity) && !row.intensity.is_nan() {
            self.intensity = Span::with(self.intensity, f64::from(row.intensity));
            self.intensities.add(row.intensity);
        }
        if has(Attribute::ScanAngle) {
            self.scan_angle = Span::with(self.scan_angle, row.scan_angle);
        }
        let time = has(Attribute::Time).then_some(row.time);
        if let Some(time) = time {
            self.time = Span::with(self.time, time);
        }
        if has(Attribute::Channel) {
            match self.by_channel.get_mut(usize::from(row.channel)) {
                Some(count) => *count += 1,
                None => *self.by_high_channel.entry(row.channel).or_default() += 1,
            }
        }
        if has(Attribute::Leg) {
            self.count_of_line(if self.is_las { row.point_source } else { row.leg }, time);
        }
        if has(Attribute::Object) {
            self.note_object(row, object);
        }
    }

    fn count_of_line(&mut self, number: u16, time: Option<f64>) {
        if self.lines.last().is_none_or(|(last, _)| *last != number) {
            self.lines.push((number, LineFacts::default()));
        }
        if let Some((_, line)) = self.lines.last_mut() {
            line.points += 1;
            line.time = time.map_or(line.time, |time| Span::with(line.time, time));
        }
    }

    fn note_object(&mut self, row: &PointRow, object: Option<&str>) {
        if object.is_some() && self.name.as_deref() == object {
            return;
        }
        self.name = object.map(str::to_owned);
        let object = match object {
            Some(name) => {
                let mut hasher = DefaultHasher::new();
                name.hash(&mut hasher);
                hasher.finish()
            }
            None => row.object as u64,
        };
        if self.object != Some(object) {
            self.objects.insert(object);
            self.object = Some(object);
        }
    }
}

impl PointPart for FactsPart {
    fn add(&mut self, row: &PointRow) {
        self.add_named(row, None);
    }

    fn add_named(&mut self, row: &PointRow, object: Option<&str>) {
        if !is_placed(row.position) {
            self.skipped += 1;
            return;
        }
        if row.is_miss {
            self.misses += 1;
            return;
        }
        self.count(row, object);
    }

    fn takes_names(&self) -> bool {
        true
    }

    fn clear(&mut self) {
        self.positions.clear();
        self.cells.clear();
        (self.skipped, self.misses) = (0, 0);
        (self.without_number, self.beyond_number) = (0, 0);
        for counts in [
            &mut self.by_class,
            &mut self.by_return,
            &mut self.pulses_by_returns,
            &mut self.by_path,
            &mut self.by_channel,
        ] {
            counts.fill(0);
        }
        self.by_high_channel.clear();
        self.intensities.clear();
        (self.intensity, self.scan_angle, self.time) = (None, None, None);
        self.lines.clear();
        self.objects.clear();
        (self.object, self.name) = (None, None);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_and_numbers_of_objects_count_once() {
        let mut part = FactsPart::new(AttributeSet::of(|_| true), false);
        let row = |object| PointRow { object, ..PointRow::default() };
        for name in ["oak", "oak", "ash", "oak"] {
            part.add_named(&row(0), Some(name));
        }
        [7, 7, 0, 7].into_iter().for_each(|object| part.add(&row(object)));
        part.add_named(&row(7), Some("oak"));
        assert_eq!((part.objects.len(), part.positions.len()), (4, 9));
        part.clear();
        part.add_named(&row(0), Some("oak"));
        assert_eq!(part.objects.len(), 1);
    }

    #[test]
    fn sums_of_values_do_not_depend_on_their_order() {
        let values: Vec<f32> =
            (0..10_000).map(|i| (i as f32 * 0.37).sin() * 10f32.powi(i % 60 - 30)).collect();
        let mut sums = [ExactSum::default(), ExactSum::default(), ExactSum::default()];
        values.iter().for_each(|value| sums[0].add(*value));
        values.iter().rev().for_each(|value| sums[1].add(*value));
        for part in values.chunks(7) {
            let mut sum = ExactSum::default();
            part.iter().for_each(|value| sum.add(*value));
            sums[2].append(&sum);
        }
        let mean = sums[0].mean().unwrap();
        assert!(sums.iter().all(|sum| sum.mean() == Some(mean)), "{mean}");
        let plain = values.iter().map(|value| f64::from(*value)).sum::<f64>() / 1e4;
        assert!((mean - plain).abs() <= 1e-9 * plain.abs(), "{mean} {plain}");
        let mut small = ExactSum::default();
        [1.5, -0.25, 1e-45, 0.0].into_iter().for_each(|value| small.add(value));
        assert_eq!(small.mean(), Some((1.25 + f64::from(1e-45_f32)) / 4.0));
        small.clear();
        assert_eq!(small.mean(), None);
        small.add(f32::NEG_INFINITY);
        assert_eq!(small.mean(), Some(f64::NEG_INFINITY));
    }
}
