//! The points of a block with the values that a cloud keeps, chosen on the thread that decodes them.

use super::column::HeldValues;
use vlscan_formats::{Attribute, AttributeSet, PointPart, PointRow};
use vlscan_geom::{DVec3, MAX_COORDINATE};

/// Values of a point that a cloud may keep in addition to its position.
#[derive(Clone, Copy, Debug)]
pub(super) struct KeptValues {
    pub time: f64,
    pub object: i64,
    pub intensity: f32,
    /// Degrees.
    pub scan_angle: f32,
    pub leg: u16,
    pub channel: u16,
    pub colour: Option<[u16; 3]>,
    pub class: u8,
    pub return_number: u8,
    pub number_of_returns: u8,
}

impl KeptValues {
    pub fn of(row: &PointRow) -> KeptValues {
        KeptValues {
            time: row.time,
            object: row.object,
            intensity: row.intensity,
            scan_angle: row.scan_angle as f32,
            leg: row.leg,
            channel: row.channel,
            colour: row.colour,
            class: row.class,
            return_number: row.return_number,
            number_of_returns: row.number_of_returns,
        }
    }
}

/// Fewest points in memory, so that temporary files are few.
const MIN_HELD_POINTS: u64 = if cfg!(test) { 64 } else { 1 << 16 };

/// The number of points with these attributes that take at most this memory.
pub(super) fn held_points(attributes: AttributeSet, max_bytes: u64) -> HeldValues {
    use Attribute::{Channel, Class, Intensity, Leg, NumberOfReturns, Object, ReturnNumber, ScanAngle, Time};
    let sizes = [
        (Time, 8_u64),
        (Intensity, 4),
        (ScanAngle, 4),
        (Object, 2),
        (Leg, 2),
        (Class, 1),
        (ReturnNumber, 1),
        (NumberOfReturns, 1),
        (Channel, 1),
    ];
    let of_attributes: u64 =
        sizes.into_iter().filter(|(attribute, _)| attributes.has(*attribute)).map(|(_, size)| size).sum();
    // Positions in metres, and colours.
    let bytes = 24 + 6 + of_attributes;
    let points = (max_bytes / bytes).max(MIN_HELD_POINTS);
    HeldValues::at_most(usize::try_from(points).unwrap_or(usize::MAX))
}

/// The points of a block in their order, and the number of those that are left out.
#[derive(Debug, Default)]
pub(super) struct PointsPart {
    pub positions: Vec<DVec3>,
    pub values: Vec<KeptValues>,
    pub skipped: u64,
    pub misses: u64,
    /// True if the names of objects are kept, which parts do not have.
    pub needs_names: bool,
}

/// True if a position can be that of a point: its coordinates are numbers within ±[`MAX_COORDINATE`].
pub(crate) fn is_placed(position: DVec3) -> bool {
    position.is_finite() && position.abs().max_element() <= MAX_COORDINATE
}

impl PointPart for PointsPart {
    fn add(&mut self, row: &PointRow) {
        if row.is_miss {
            self.misses += 1;
        } else if !is_placed(row.position) {
            self.skipped += 1;
        } else {
            self.positions.push(row.position);
            self.values.push(KeptValues::of(row));
        }
    }

    fn takes_names(&self) -> bool {
        !self.needs_names
    }

    fn clear(&mut self) {
        self.positions.clear();
        self.values.clear();
        (self.skipped, self.misses) = (0, 0);
    }
}
