//! A pulse as a row of numbers and back, bit for bit.

use super::columns::{COLUMNS, ColumnEntry, ENTRIES, PulseColumn};
use vlscan_base::quantity::{self, Bounds};
use vlscan_geom::{DVec3, Rotation, rescaled};
use vlscan_lidar::flight::Pulse;
use vlscan_tables::Dimension;

/// A pulse with its metadata in a stream.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PulseRow {
    /// The pulse, in the scene frame.
    pub pulse: Pulse,
    /// Index of the leg, from 0.
    pub leg: u32,
    /// Number of simulation steps since the beginning of the epoch.
    pub step: u64,
    /// Index of the epoch, from 0.
    pub epoch: u32,
    /// Divergence of device 0 at the beginning of the survey and in this leg, rad, if the stream has these
    /// columns.
    pub divergence: Option<[f64; 2]>,
}

/// The numbers of a row by column, in ns, m and rad.
pub type Values = [f64; COLUMNS];

/// A set of columns.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ColumnSet(u64);

impl ColumnSet {
    /// The set with `column` added.
    pub fn with(self, column: PulseColumn) -> ColumnSet {
        ColumnSet(self.0 | 1 << column as u64)
    }

    /// True if the set holds `column`.
    pub fn has(self, column: PulseColumn) -> bool {
        self.0 & 1 << column as u64 != 0
    }

    /// True if the set holds all of `columns`.
    pub fn has_all(self, columns: &[PulseColumn]) -> bool {
        columns.iter().all(|c| self.has(*c))
    }

    /// True if the set holds one of `columns`.
    pub fn has_any(self, columns: &[PulseColumn]) -> bool {
        columns.iter().any(|c| self.has(*c))
    }
}

pub const ORIGIN: [PulseColumn; 3] = [PulseColumn::X, PulseColumn::Y, PulseColumn::Z];
pub const DIRECTION: [PulseColumn; 3] =
    [PulseColumn::DirectionX, PulseColumn::DirectionY, PulseColumn::DirectionZ];
/// The columns of the direction as angles.
pub const ANGLES: [PulseColumn; 2] = [PulseColumn::Azimuth, PulseColumn::Elevation];
pub const ATTITUDE: [PulseColumn; 4] =
    [PulseColumn::AttitudeW, PulseColumn::AttitudeX, PulseColumn::AttitudeY, PulseColumn::AttitudeZ];
/// The columns of the attitude without mechanical errors.
pub const EXACT: [PulseColumn; 4] =
    [PulseColumn::ExactW, PulseColumn::ExactX, PulseColumn::ExactY, PulseColumn::ExactZ];
/// The columns of the reported pose.
pub const REPORTED: [PulseColumn; 4] =
    [PulseColumn::ReportedW, PulseColumn::ReportedX, PulseColumn::ReportedY, PulseColumn::ReportedZ];
/// The columns of the error of the reported origin.
pub const ORIGIN_ERROR: [PulseColumn; 3] =
    [PulseColumn::OriginErrorX, PulseColumn::OriginErrorY, PulseColumn::OriginErrorZ];
/// The columns of the rounding errors of the origin.
pub const LOW: [PulseColumn; 3] = [PulseColumn::LowX, PulseColumn::LowY, PulseColumn::LowZ];

/// Maximum integer up to which all integers are exact in double precision.
const MAX_EXACT_COUNT: f64 = 9_007_199_254_740_992.0;
/// Maximum distance between a direction and that of its quaternion, and between a quaternion's length and 1.
const MAX_DISAGREEMENT: f64 = 1e-6;

/// Why a row is not a valid pulse: the column of the invalid value, and a message.
pub type RowFault = (PulseColumn, String);

impl PulseRow {
    /// Converts the pulse to the numbers of a row; `shift` is the world position of the scene frame's origin,
    /// m.
    pub fn values(&self, shift: DVec3) -> Values {
        let p = &self.pulse;
        let mut values = [0.0; COLUMNS];
        let mut put = |columns: &[PulseColumn], numbers: &[f64]| {
            columns.iter().zip(numbers).for_each(|(c, v)| values[*c as usize] = *v);
        };
        let world = [0, 1, 2].map(|i| two_sum(p.origin[i], shift[i]));
        put(&ORIGIN, &world.map(|w| w.0));
        put(&LOW, &world.map(|w| w.1));
        put(&DIRECTION, &p.attitude.forward().to_array());
        put(&ATTITUDE, &quaternion(&p.attitude));
        put(&EXACT, &quaternion(&p.exact_attitude));
        put(&REPORTED, &quaternion(&p.reported_attitude));
        put(&ORIGIN_ERROR, &p.origin_error.to_array());
        let [start, leg] = self.divergence.unwrap_or_default();
        put(
            &[
                PulseColumn::Time,
                PulseColumn::ScanAngle,
                PulseColumn::RangeError,
                PulseColumn::StartDivergence,
                PulseColumn::Divergence,
            ],
            &[p.time_ns, p.scan_angle, p.range_error, start, leg],
        );
        put(
            &[
                PulseColumn::Leg,
                PulseColumn::Device,
                PulseColumn::Pulse,
                PulseColumn::Step,
                PulseColumn::Epoch,
            ],
            &[
                f64::from(self.leg),
                f64::from(p.device),
                p.number as f64,
                self.step as f64,
                f64::from(self.epoch),
            ],
        );
        values
    }

    /// Converts a row of a stream with the columns `present` to a pulse. `order` is the index of the row in
    /// the stream, from 0: the number of the pulse where the stream has no numbers.
    ///
    /// # Errors
    /// The first value that no pulse can have.
    pub fn of(values: &Values, present: ColumnSet, shift: DVec3, order: u64) -> Result<PulseRow, RowFault> {
        check_numbers(values, present)?;
        let value = |c: PulseColumn| if present.has(c) { values[c as usize] } else { 0.0 };
        let vector = |c: [PulseColumn; 3]| DVec3::from(c.map(value));
        // The rotation of four columns, if the stream has them.
        let rotation = |columns: [PulseColumn; 4]| {
            if !present.has_all(&columns) {
                return Ok(None);
            }
            let [w, x, y, z] = columns.map(value);
            check_unit_length(Rotation { w, u: DVec3::new(x, y, z) }, columns[0]).map(Some)
        };
        let (world, low) = (vector(ORIGIN), vector(LOW));
        let origin = DVec3::from([0, 1, 2].map(|i| subtract_exactly(world[i], low[i], shift[i])));
        let attitude = match rotation(ATTITUDE)? {
            Some(attitude) if present.has_all(&DIRECTION) => check_agreement(vector(DIRECTION), attitude)?,
            Some(attitude) => attitude,
            None if present.has_all(&ANGLES) => {
                let [azimuth, elevation] = ANGLES.map(value);
                Rotation::about_z(-azimuth).after(Rotation::about_x(elevation))
            }
            None => attitude_of_direction(vector(DIRECTION))?,
        };
        let exact_attitude = rotation(EXACT)?.unwrap_or(attitude);
        let reported_attitude = rotation(REPORTED)?.unwrap_or(exact_attitude);
        let divergence = present.has(PulseColumn::Divergence).then(|| {
            let leg = value(PulseColumn::Divergence);
            let start = PulseColumn::StartDivergence;
            [if present.has(start) { value(start) } else { leg }, leg]
        });
        let has_number = present.has(PulseColumn::Pulse);
        let number = if has_number { value(PulseColumn::Pulse) as u64 } else { order + 1 };
        Ok(PulseRow {
            pulse: Pulse {
                origin,
                attitude,
                exact_attitude,
                reported_attitude,
                scanner_attitude: Rotation::IDENTITY,
                origin_error: vector(ORIGIN_ERROR),
                time_ns: value(PulseColumn::Time),
                number,
                device: count(PulseColumn::Device, value(PulseColumn::Device))?,
                scan_angle: value(PulseColumn::ScanAngle),
                range_error: value(PulseColumn::RangeError),
                velocity: None,
            },
            leg: count(PulseColumn::Leg, value(PulseColumn::Leg))?,
            step: value(PulseColumn::Step) as u64,
            epoch: count(PulseColumn::Epoch, value(PulseColumn::Epoch))?,
            divergence,
        })
    }
}

fn quaternion(r: &Rotation) -> [f64; 4] {
    [r.w, r.u.x, r.u.y, r.u.z]
}

fn count(column: PulseColumn, value: f64) -> Result<u32, RowFault> {
    if value <= f64::from(u32::MAX) {
        return Ok(value as u32);
    }
    Err((column, format!("{} is {value}, expected at most {}", column.entry().name(), u32::MAX)))
}

fn check_numbers(values: &Values, present: ColumnSet) -> Result<(), RowFault> {
    for entry in ENTRIES.iter().filter(|e| present.has(e.column)) {
        let value = values[entry.column as usize];
        let whole = (0.0..=MAX_EXACT_COUNT).contains(&value) && value.fract() == 0.0;
        if !value.is_finite() {
            return Err((entry.column, format!("{} is {value}, expected a number", entry.name())));
        }
        if entry.dimension() == Dimension::Count && !whole {
            let message = format!("{} is {value}, expected a whole number of at least 0", entry.name());
            return Err((entry.column, message));
        }
        let bounds = bounds(entry);
        if !bounds.contains(value) {
            // Bounds of times are stated in seconds.
            let shown = if entry.dimension() == Dimension::Time { value / 1e9 } else { value };
            return Err((
                entry.column,
                format!("{} is {}, expected {}", entry.name(), quantity::number(shown), bounds.expected),
            ));
        }
    }
    Ok(())
}

/// Bounds of the numbers of a column, in ns, m and rad.
fn bounds(entry: &ColumnEntry) -> Bounds {
    match (entry.column, entry.dimension()) {
        (PulseColumn::Divergence | PulseColumn::StartDivergence, _) => quantity::STREAMED_DIVERGENCE,
        (_, Dimension::Time) => quantity::TIME_NS,
        (_, Dimension::Length) => quantity::COORDINATE,
        (_, Dimension::Angle) => quantity::NUMBER,
        (_, Dimension::Ratio | Dimension::Count | Dimension::Text) => quantity::ANY,
    }
}

fn check_unit_length(rotation: Rotation, first: PulseColumn) -> Result<Rotation, RowFault> {
    let length = (rotation.w * rotation.w + rotation.u.dot(rotation.u)).sqrt();
    if (length - 1.0).abs() <= MAX_DISAGREEMENT {
        return Ok(rotation);
    }
    Err((first, format!("the quaternion's length is {length}, expected 1")))
}

fn check_agreement(direction: DVec3, attitude: Rotation) -> Result<Rotation, RowFault> {
    let unit = vlscan_geom::direction(direction);
    if unit.is_some_and(|unit| (unit - attitude.forward()).length() <= MAX_DISAGREEMENT) {
        return Ok(attitude);
    }
    let message =
        "direction and quaternion disagree; leave out the columns qw, qx, qy, qz to use the direction";
    Err((DIRECTION[0], message.to_owned()))
}

/// The attitude of a beam of which only the direction is known: the smallest rotation from +y.
fn attitude_of_direction(direction: DVec3) -> Result<Rotation, RowFault> {
    let attitude = Rotation::between(DVec3::Y, rescaled(direction));
    if attitude.w.is_finite() && attitude.u.is_finite() {
        return Ok(attitude);
    }
    let [x, y, z] = direction.to_array();
    Err((DIRECTION[0], format!("{x} {y} {z} is not a direction")))
}

/// `a + b` rounded, and the rounding error (Knuth, The Art of Computer Programming 2, §4.2.2).
fn two_sum(a: f64, b: f64) -> (f64, f64) {
    let sum = a + b;
    let virtual_b = sum - a;
    (sum, (a - (sum - virtual_b)) + (b - virtual_b))
}

/// Computes `high + low − shift`, exactly where `high` and `low` are the [`two_sum`] of the result and
/// `shift`: both rounding errors are multiples of one small unit, so their sum is exact.
fn subtract_exactly(high: f64, low: f64, shift: f64) -> f64 {
    let (difference, lost) = two_sum(high, -shift);
    difference + (lost + low)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn all() -> ColumnSet {
        ENTRIES.iter().fold(ColumnSet::default(), |p, e| p.with(e.column))
    }

    fn row(origin: DVec3) -> PulseRow {
        PulseRow {
            pulse: Pulse {
                origin,
                attitude: Rotation::about(DVec3::new(1.0, 2.0, 0.5), 0.7),
                exact_attitude: Rotation::about_x(0.3),
                reported_attitude: Rotation::about_x(0.2),
                scanner_attitude: Rotation::IDENTITY,
                origin_error: DVec3::new(0.01, -0.02, 0.03),
                time_ns: 86_391e9 + 1.0 / 3.0,
                number: 12_345_678_901,
                device: 3,
                scan_angle: -0.1,
                range_error: 1e-3,
                velocity: None,
            },
            leg: 7,
            step: 99,
            epoch: 2,
            divergence: Some([1e-3, 2e-3]),
        }
    }

    proptest! {
        #[test]
        fn rows_come_back_bit_for_bit(
            x in -1e7..1e7f64, y in -1e-3..1e-3f64, z in prop::num::f64::NORMAL, sx in -1e7..1e7f64, sz in -1e4..1e4f64,
        ) {
            let z = z % 1e9;
            let there = row(DVec3::new(x, y, z));
            let shift = DVec3::new(sx, 5_412_345.25, sz);
            let back = PulseRow::of(&there.values(shift), all(), shift, 0).unwrap();
            prop_assert_eq!(back, there);
        }
    }

    fn some(columns: &[(PulseColumn, f64)]) -> Result<PulseRow, RowFault> {
        let (mut values, mut present) = ([f64::NAN; COLUMNS], ColumnSet::default());
        for (c, v) in columns {
            values[*c as usize] = *v;
            present = present.with(*c);
        }
        PulseRow::of(&values, present, DVec3::ZERO, 41)
    }

    #[test]
    fn a_direction_of_any_length_is_enough() {
        use PulseColumn::{DirectionX, DirectionY, DirectionZ, X, Y, Z};
        let base = [(X, 1.0), (Y, 2.0), (Z, 3.0), (DirectionX, 0.0), (DirectionY, 0.0)];
        let r = some(&[&base[..], &[(DirectionZ, -5.0)]].concat()).unwrap();
        assert!((r.pulse.attitude.forward() + DVec3::Z).length() < 1e-12);
        for length in [5e-324, 1e-200, 1e154, 1e155, f64::MAX] {
            let r = some(&[&base[..], &[(DirectionZ, -length)]].concat()).unwrap();
            assert!((r.pulse.attitude.forward() + DVec3::Z).length() < 1e-12, "{length}");
        }
        assert_eq!((r.pulse.number, r.leg, r.pulse.device, r.divergence), (42, 0, 0, None));
        let e = some(&[&base[..], &[(DirectionZ, 0.0)]].concat()).unwrap_err();
        assert!(e.1.contains("0 0 0 is not a direction"), "{}", e.1);
    }

    #[test]
    fn azimuth_and_elevation_are_enough() {
        use PulseColumn::{Azimuth, Elevation, X, Y, Z};
        let r = some(&[(X, 1.0), (Y, 2.0), (Z, 3.0), (Azimuth, 0.4), (Elevation, -0.3)]).unwrap();
        let (level, up) = (0.3f64.cos(), -(0.3f64.sin()));
        let expected = DVec3::new(level * 0.4f64.sin(), level * 0.4f64.cos(), up);
        assert!((r.pulse.attitude.forward() - expected).length() < 1e-15);
    }

    #[test]
    fn impossible_rows_name_their_column() {
        let mut values = row(DVec3::ZERO).values(DVec3::ZERO);
        let mut refuse = |c: PulseColumn, v: f64, part: &str| {
            let kept = std::mem::replace(&mut values[c as usize], v);
            let e = PulseRow::of(&values, all(), DVec3::ZERO, 0).unwrap_err();
            assert!(e.1.contains(part), "{part:?} is missing from {:?}", e.1);
            values[c as usize] = kept;
        };
        refuse(PulseColumn::Leg, -1.0, "leg is -1, expected a whole number");
        refuse(PulseColumn::Device, 0.5, "device is 0.5");
        refuse(PulseColumn::Device, 1e10, "expected at most");
        refuse(PulseColumn::Time, f64::NAN, "time is NaN");
        refuse(PulseColumn::DirectionX, 7.0, "disagree");
        refuse(PulseColumn::AttitudeW, 2.0, "length is");
        refuse(PulseColumn::Divergence, -1.0, "expected a number of at least 0");
        refuse(PulseColumn::StartDivergence, 1e300, "at most 1.5 rad");
        refuse(PulseColumn::X, 1e11, "x is 100000000000, expected metres");
        refuse(PulseColumn::RangeError, -1e300, "is -1e300, expected metres");
        refuse(PulseColumn::ScanAngle, 1e300, "to 1e12");
        refuse(PulseColumn::Time, 1e21, "time is 1000000000000, expected seconds");
    }
}
