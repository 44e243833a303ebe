//! E57 (ASTM E2807), all scans of a file with their poses. Points with an invalid state are left out;
//! spherical coordinates are read where a scan has no Cartesian ones. Positions are metres by the standard.

use super::{E57Error, NAMESPACE, SCAN_NAME, ScanError};
use crate::{Attribute, AttributeSet, Misfits, PointRow, Reading};
use ::e57::{E57Reader, PointCloud, RawValues, RecordDataType, RecordName, Transform};
use std::io::Cursor;
use std::ops::ControlFlow;
use vlscan_base::damage::catch_decoder_panic;
use vlscan_geom::DVec3;

/// Reads a file.
pub(crate) fn read(bytes: &[u8], reading: &mut Reading) -> Result<(), E57Error> {
    let done = catch_decoder_panic(|| read_scans(bytes, reading));
    done.unwrap_or(Err(E57Error::Damaged))
}

fn read_scans(bytes: &[u8], reading: &mut Reading) -> Result<(), E57Error> {
    let mut file = E57Reader::new(Cursor::new(bytes))?;
    let clouds = file.pointclouds();
    let scans: Vec<Scan> = clouds.iter().map(Scan::new).collect();
    let mut attributes = AttributeSet::of(|attribute| scans.iter().any(|scan| scan.has(attribute)));
    if scans.len() > 1 {
        attributes = AttributeSet::of(|attribute| attribute == Attribute::Leg || attributes.has(attribute));
    }
    reading.sink.start(attributes.with_colours(scans.iter().any(|scan| scan.colour.is_some())));
    for (number, (cloud, scan)) in clouds.iter().zip(&scans).enumerate() {
        let named = |source| E57Error::Scan { number: number + 1, name: cloud.name.clone(), source };
        if scan.position == Position::None {
            return Err(named(ScanError::NoCoordinates));
        }
        // Values that are all equal take no bits, so the library cannot determine their number.
        if cloud.records > 0 && cloud.prototype.iter().all(|record| is_constant(&record.data_type)) {
            return Err(named(ScanError::Constant));
        }
        for values in file.pointcloud_raw(cloud).map_err(|e| named(e.into()))? {
            let values = values.map_err(|e| named(e.into()))?;
            let row = scan.row(&values, cloud, number);
            if let Some(row) = row
                && let ControlFlow::Break(()) = reading.take(&row)
            {
                return Ok(());
            }
        }
    }
    Ok(())
}

fn is_constant(kind: &RecordDataType) -> bool {
    match kind {
        RecordDataType::Integer { min, max } | RecordDataType::ScaledInteger { min, max, .. } => min == max,
        _ => false,
    }
}

/// Indices of the coordinates among the values of a scan.
#[derive(Clone, Copy, PartialEq)]
enum Position {
    Cartesian([usize; 3]),
    /// Range, azimuth, elevation.
    Spherical([usize; 3]),
    None,
}

/// Location of the values of a scan, and its pose.
struct Scan {
    position: Position,
    /// 0 where a position is valid.
    position_state: Option<usize>,
    intensity: Option<usize>,
    intensity_state: Option<usize>,
    return_index: Option<usize>,
    return_count: Option<usize>,
    time: Option<usize>,
    class: Option<usize>,
    /// Way of the light.
    path: Option<usize>,
    /// Red, green and blue.
    colour: Option<[usize; 3]>,
    pose: Transform,
    /// True if this program has written the scan; its pulses without a return have no returns.
    is_own: bool,
}

impl Scan {
    fn new(cloud: &PointCloud) -> Scan {
        let column = |name: RecordName| cloud.prototype.iter().position(|record| record.name == name);
        let all = |names: [RecordName; 3]| {
            let [a, b, c] = names.map(column);
            Some([a?, b?, c?])
        };
        let cartesian = all([RecordName::CartesianX, RecordName::CartesianY, RecordName::CartesianZ]);
        let spherical =
            all([RecordName::SphericalRange, RecordName::SphericalAzimuth, RecordName::SphericalElevation]);
        let (position, state) = match (cartesian, spherical) {
            (Some(columns), _) => (Position::Cartesian(columns), RecordName::CartesianInvalidState),
            (None, Some(columns)) => (Position::Spherical(columns), RecordName::SphericalInvalidState),
            (None, None) => (Position::None, RecordName::CartesianInvalidState),
        };
        let class = cloud.prototype.iter().position(|record| match &record.name {
            RecordName::Unknown { name, .. } => name.to_ascii_lowercase().contains("classification"),
            _ => false,
        });
        let path = cloud.prototype.iter().position(|record| match &record.name {
            RecordName::Unknown { namespace, name } => namespace == NAMESPACE && name == "path",
            _ => false,
        });
        Scan {
            position,
            position_state: column(state),
            intensity: column(RecordName::Intensity),
            intensity_state: column(RecordName::IsIntensityInvalid),
            return_index: column(RecordName::ReturnIndex),
            return_count: column(RecordName::ReturnCount),
            time: column(RecordName::TimeStamp),
            class,
            path,
            colour: all([RecordName::ColorRed, RecordName::ColorGreen, RecordName::ColorBlue]),
            pose: cloud.transform.clone().unwrap_or_default(),
            is_own: cloud.name.as_ref().is_some_and(|name| name.starts_with(SCAN_NAME)),
        }
    }

    fn has(&self, attribute: Attribute) -> bool {
        match attribute {
            Attribute::X | Attribute::Y | Attribute::Z => true,
            Attribute::Intensity => self.intensity.is_some(),
            Attribute::ReturnNumber => self.return_index.is_some(),
            Attribute::NumberOfReturns => self.return_count.is_some(),
            Attribute::Time => self.time.is_some(),
            Attribute::Class => self.class.is_some(),
            Attribute::Path => self.path.is_some(),
            _ => false,
        }
    }

    /// The point of some values; `None` if they are marked as invalid.
    fn row(&self, values: &RawValues, cloud: &PointCloud, number: usize) -> Option<PointRow> {
        let value =
            |column: usize| values[column].to_f64(&cloud.prototype[column].data_type).unwrap_or(f64::NAN);
        let is_invalid = |state: Option<usize>| state.is_some_and(|column| value(column) != 0.0);
        if is_invalid(self.position_state) {
            return None;
        }
        let local = match self.position {
            Position::Cartesian(columns) => DVec3::from(columns.map(value)),
            Position::Spherical(columns) => {
                let [range, azimuth, elevation] = columns.map(value);
                let (sin_e, cos_e) = libm::sincos(elevation);
                let (sin_a, cos_a) = libm::sincos(azimuth);
                DVec3::new(cos_e * cos_a, cos_e * sin_a, sin_e) * range
            }
            Position::None => return None,
        };
        let intensity = match is_invalid(self.intensity_state) {
            true => f64::NAN,
            false => self.intensity.map_or(f64::NAN, value),
        };
        let is_zero = |column: Option<usize>| column.is_some_and(|column| value(column) == 0.0);
        let is_miss = self.is_own && is_zero(self.return_count) && is_zero(self.intensity);
        let mut misfits = Misfits::default();
        let mut fitted = |attribute: Attribute, column: Option<usize>, first: f64| {
            column.map_or(0.0, |column| misfits.fitted(attribute, value(column) + first))
        };
        Some(PointRow {
            position: posed(&self.pose, local),
            intensity: intensity as f32,
            // Counted from 0 in files.
            return_number: fitted(Attribute::ReturnNumber, self.return_index, 1.0) as u8,
            number_of_returns: fitted(Attribute::NumberOfReturns, self.return_count, 0.0) as u8,
            is_miss,
            class: fitted(Attribute::Class, self.class, 0.0) as u8,
            time: fitted(Attribute::Time, self.time, 0.0),
            path: fitted(Attribute::Path, self.path, 0.0) as u8,
            leg: u16::try_from(number).unwrap_or(u16::MAX),
            colour: self.colour.map(|columns| columns.map(|column| value(column).round() as u16)),
            misfits,
            ..PointRow::default()
        })
    }
}

/// A position of a scan in the frame of the file.
fn posed(pose: &Transform, local: DVec3) -> DVec3 {
    let (q, t) = (&pose.rotation, &pose.translation);
    let axis = DVec3::new(q.x, q.y, q.z);
    let across = axis.cross(local) * 2.0;
    local + across * q.w + axis.cross(across) + DVec3::new(t.x, t.y, t.z)
}
