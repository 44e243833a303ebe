//! One pulse on its way between commands: from the flight to a row of numbers and back, bit for bit.

use super::columns::{COLUMNS, Column, ENTRIES};
use crate::columns::Dimension;
use crate::flight::Pulse;
use crate::geom::{DVec3, Rotation, unit};

/// A pulse as a stream carries it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PulseRow {
    /// The pulse, in the frame of the scene.
    pub pulse: Pulse,
    /// Number of the leg.
    pub leg: u32,
    /// Simulation steps since the play began.
    pub step: u64,
    /// Number of the play, from 0.
    pub play: u32,
    /// Divergence of device 0 when the survey began and in this leg, rad, where the stream tells it.
    pub divergence: Option<[f64; 2]>,
}

/// The numbers of a row by column, in the units inside.
pub type Values = [f64; COLUMNS];

/// Which columns a stream has.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Present(u64);

impl Present {
    /// With another column.
    pub fn with(self, column: Column) -> Present {
        Present(self.0 | 1 << column as u64)
    }

    /// Whether a column is there.
    pub fn has(self, column: Column) -> bool {
        self.0 & 1 << column as u64 != 0
    }

    /// Whether all of them are there.
    pub fn has_all(self, columns: &[Column]) -> bool {
        columns.iter().all(|c| self.has(*c))
    }

    /// Whether any of them is there.
    pub fn has_any(self, columns: &[Column]) -> bool {
        columns.iter().any(|c| self.has(*c))
    }
}

/// The columns of an origin.
pub const ORIGIN: [Column; 3] = [Column::X, Column::Y, Column::Z];
/// The columns of a direction.
pub const DIRECTION: [Column; 3] = [Column::DirectionX, Column::DirectionY, Column::DirectionZ];
/// The columns of an attitude.
pub const ATTITUDE: [Column; 4] =
    [Column::AttitudeW, Column::AttitudeX, Column::AttitudeY, Column::AttitudeZ];
/// The columns of the attitude without mechanical errors.
pub const EXACT: [Column; 4] = [Column::ExactW, Column::ExactX, Column::ExactY, Column::ExactZ];
/// The columns of the reported pose.
pub const REPORTED: [Column; 4] =
    [Column::ReportedW, Column::ReportedX, Column::ReportedY, Column::ReportedZ];
/// The columns of the error of the reported origin.
pub const ORIGIN_ERROR: [Column; 3] = [Column::OriginErrorX, Column::OriginErrorY, Column::OriginErrorZ];
const LOW: [Column; 3] = [Column::LowX, Column::LowY, Column::LowZ];

/// Whole numbers beyond these are not exact in double precision.
const LARGEST_COUNT: f64 = 9_007_199_254_740_992.0;
/// How far a direction may lie beside its quaternion's, and a quaternion's length from 1.
const DISAGREEMENT: f64 = 1e-6;

/// A row that cannot be: the column to blame and why.
#[derive(Clone, Debug, PartialEq)]
pub struct RowFault {
    /// The column.
    pub column: Column,
    /// What was found and what was expected.
    pub message: String,
}

fn fault(column: Column, message: impl Into<String>) -> RowFault {
    RowFault { column, message: message.into() }
}

impl PulseRow {
    /// The numbers of the row; `shift` is the world position of the scene frame's origin.
    pub fn values(&self, shift: DVec3) -> Values {
        let p = &self.pulse;
        let mut values = [0.0; COLUMNS];
        let mut put = |columns: &[Column], numbers: &[f64]| {
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
                Column::Time,
                Column::ScanAngle,
                Column::RangeError,
                Column::StartDivergence,
                Column::Divergence,
            ],
            &[p.time_ns, p.scan_angle, p.range_error, start, leg],
        );
        put(
            &[Column::Leg, Column::Device, Column::Pulse, Column::Step, Column::Play],
            &[
                f64::from(self.leg),
                f64::from(p.device),
                p.number as f64,
                self.step as f64,
                f64::from(self.play),
            ],
        );
        values
    }

    /// The pulse of a row of a stream with these columns. `order` is its place in the stream, from 0: its number where the
    /// stream has none.
    ///
    /// # Errors
    /// Numbers that no pulse can have.
    pub fn of(values: &Values, present: Present, shift: DVec3, order: u64) -> Result<PulseRow, RowFault> {
        check_numbers(values, present)?;
        let value = |c: Column| if present.has(c) { values[c as usize] } else { 0.0 };
        let vector = |c: [Column; 3]| DVec3::from(c.map(value));
        let rotation = |c: [Column; 4]| Rotation {
            w: value(c[0]),
            u: DVec3::new(value(c[1]), value(c[2]), value(c[3])),
        };
        let (world, low) = (vector(ORIGIN), vector(LOW));
        let origin = DVec3::from([0, 1, 2].map(|i| without(world[i], low[i], shift[i])));
        let attitude = if present.has_all(&ATTITUDE) {
            let attitude = rotation(ATTITUDE);
            check_attitude(&attitude, ATTITUDE[0])?;
            if present.has_all(&DIRECTION) {
                check_agreement(vector(DIRECTION), &attitude)?;
            }
            attitude
        } else {
            aimed(vector(DIRECTION))?
        };
        let exact_attitude = if present.has_all(&EXACT) {
            let exact = rotation(EXACT);
            check_attitude(&exact, EXACT[0])?;
            exact
        } else {
            attitude
        };
        let reported_attitude = if present.has_all(&REPORTED) {
            let reported = rotation(REPORTED);
            check_attitude(&reported, REPORTED[0])?;
            reported
        } else {
            exact_attitude
        };
        let divergence = present.has(Column::Divergence).then(|| {
            let leg = value(Column::Divergence);
            [if present.has(Column::StartDivergence) { value(Column::StartDivergence) } else { leg }, leg]
        });
        let number = if present.has(Column::Pulse) { value(Column::Pulse) as u64 } else { order + 1 };
        Ok(PulseRow {
            pulse: Pulse {
                origin,
                attitude,
                exact_attitude,
                reported_attitude,
                origin_error: vector(ORIGIN_ERROR),
                time_ns: value(Column::Time),
                number,
                device: count(Column::Device, value(Column::Device))?,
                scan_angle: value(Column::ScanAngle),
                range_error: value(Column::RangeError),
            },
            leg: count(Column::Leg, value(Column::Leg))?,
            step: value(Column::Step) as u64,
            play: count(Column::Play, value(Column::Play))?,
            divergence,
        })
    }
}

fn quaternion(r: &Rotation) -> [f64; 4] {
    [r.w, r.u.x, r.u.y, r.u.z]
}

fn count(column: Column, value: f64) -> Result<u32, RowFault> {
    if value <= f64::from(u32::MAX) {
        return Ok(value as u32);
    }
    Err(fault(column, format!("{} is {value}, expected at most {}", column.entry().name, u32::MAX)))
}

fn check_numbers(values: &Values, present: Present) -> Result<(), RowFault> {
    for entry in ENTRIES.iter().filter(|e| present.has(e.column)) {
        let value = values[entry.column as usize];
        let whole = (0.0..=LARGEST_COUNT).contains(&value) && value.fract() == 0.0;
        if !value.is_finite() {
            return Err(fault(entry.column, format!("{} is {value}, expected a number", entry.name)));
        }
        if entry.dimension == Dimension::Count && !whole {
            let message = format!("{} is {value}, expected a whole number of at least 0", entry.name);
            return Err(fault(entry.column, message));
        }
        if matches!(entry.column, Column::Divergence | Column::StartDivergence) && value < 0.0 {
            return Err(fault(entry.column, format!("{} is {value}, expected at least 0", entry.name)));
        }
    }
    Ok(())
}

fn check_attitude(attitude: &Rotation, first: Column) -> Result<(), RowFault> {
    let length = (attitude.w * attitude.w + attitude.u.dot(attitude.u)).sqrt();
    if (length - 1.0).abs() <= DISAGREEMENT {
        return Ok(());
    }
    Err(fault(first, format!("the quaternion's length is {length}, expected 1")))
}

fn check_agreement(direction: DVec3, attitude: &Rotation) -> Result<(), RowFault> {
    let beside = (unit(direction) - attitude.forward()).length();
    if beside <= DISAGREEMENT {
        return Ok(());
    }
    Err(fault(
        DIRECTION[0],
        "direction and quaternion disagree; leave the columns qw, qx, qy, qz out to aim by the direction",
    ))
}

/// The attitude of a beam of which only the direction is known: turned from +y by the shortest way.
fn aimed(direction: DVec3) -> Result<Rotation, RowFault> {
    let attitude = Rotation::between(DVec3::Y, direction);
    if attitude.w.is_finite() && attitude.u.is_finite() {
        return Ok(attitude);
    }
    let [x, y, z] = direction.to_array();
    Err(fault(DIRECTION[0], format!("{x} {y} {z} is no direction")))
}

/// `a + b` rounded, and what the rounding lost (Knuth, The Art of Computer Programming 2, §4.2.2).
fn two_sum(a: f64, b: f64) -> (f64, f64) {
    let sum = a + b;
    let virtual_b = sum - a;
    (sum, (a - (sum - virtual_b)) + (b - virtual_b))
}

/// `high + low − shift`, exact where `high` and `low` are what [`two_sum`] made of the result and `shift`: the remainders of
/// sum and difference are multiples of one and the same small unit, so that adding them loses nothing.
fn without(high: f64, low: f64, shift: f64) -> f64 {
    let (difference, lost) = two_sum(high, -shift);
    difference + (lost + low)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn all() -> Present {
        ENTRIES.iter().fold(Present::default(), |p, e| p.with(e.column))
    }

    fn row(origin: DVec3) -> PulseRow {
        PulseRow {
            pulse: Pulse {
                origin,
                attitude: Rotation::about(DVec3::new(1.0, 2.0, 0.5), 0.7),
                exact_attitude: Rotation::about_x(0.3),
                reported_attitude: Rotation::about_x(0.2),
                origin_error: DVec3::new(0.01, -0.02, 0.03),
                time_ns: 86_391e9 + 1.0 / 3.0,
                number: 12_345_678_901,
                device: 3,
                scan_angle: -0.1,
                range_error: 1e-3,
            },
            leg: 7,
            step: 99,
            play: 2,
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

    fn some(columns: &[(Column, f64)]) -> Result<PulseRow, RowFault> {
        let (mut values, mut present) = ([f64::NAN; COLUMNS], Present::default());
        for (c, v) in columns {
            values[*c as usize] = *v;
            present = present.with(*c);
        }
        PulseRow::of(&values, present, DVec3::ZERO, 41)
    }

    #[test]
    fn a_direction_of_any_length_is_enough() {
        use Column::{DirectionX, DirectionY, DirectionZ, X, Y, Z};
        let base = [(X, 1.0), (Y, 2.0), (Z, 3.0), (DirectionX, 0.0), (DirectionY, 0.0)];
        let r = some(&[&base[..], &[(DirectionZ, -5.0)]].concat()).unwrap();
        assert!((r.pulse.attitude.forward() + DVec3::Z).length() < 1e-12);
        assert_eq!((r.pulse.number, r.leg, r.pulse.device, r.divergence), (42, 0, 0, None));
        let e = some(&[&base[..], &[(DirectionZ, 0.0)]].concat()).unwrap_err();
        assert!(e.message.contains("0 0 0 is no direction"), "{}", e.message);
    }

    #[test]
    fn impossible_rows_name_their_column() {
        let mut values = row(DVec3::ZERO).values(DVec3::ZERO);
        let mut refuse = |c: Column, v: f64, part: &str| {
            let kept = std::mem::replace(&mut values[c as usize], v);
            let e = PulseRow::of(&values, all(), DVec3::ZERO, 0).unwrap_err();
            assert!(e.message.contains(part), "{part:?} is missing from {:?}", e.message);
            values[c as usize] = kept;
        };
        refuse(Column::Leg, -1.0, "leg is -1, expected a whole number");
        refuse(Column::Device, 0.5, "device is 0.5");
        refuse(Column::Device, 1e10, "expected at most");
        refuse(Column::Time, f64::NAN, "time is NaN");
        refuse(Column::DirectionX, 7.0, "disagree");
        refuse(Column::AttitudeW, 2.0, "length is");
        refuse(Column::Divergence, -1.0, "expected at least 0");
    }
}
