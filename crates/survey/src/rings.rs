//! The rows of the channels of a scanner, by elevation.

use crate::{Deflector, Device, Scanner};
use std::f64::consts::PI;
use vlscan_geom::{DVec3, Rotation};

/// Minimum difference between distinct elevations, rad.
const STEP: f64 = 1e-9;

impl Scanner {
    /// The row of each device, which drivers of spinning scanners publish as `ring`: 0 is the lowest channel,
    /// as in the driver of Velodyne for ROS. Channels of one elevation are in the order of devices; the only
    /// device of a scanner has row 0.
    ///
    /// The elevation is that of a beam with its deflector at rest above the plane in which the scanner turns:
    /// the head around the upright axis, or a mirror that sees all around.
    pub fn rings(&self) -> Vec<u16> {
        let steps = |device: &Device| (elevation(device) / STEP).round() as i64;
        let mut order: Vec<usize> = (0..self.devices.len()).collect();
        // Stable.
        order.sort_by_key(|number| steps(&self.devices[*number]));
        let mut rings = vec![0; self.devices.len()];
        for (row, number) in order.into_iter().enumerate() {
            rings[number] = u16::try_from(row).unwrap_or(u16::MAX);
        }
        rings
    }
}

/// Angle of the beam of a device above the plane in which its scanner turns, rad.
fn elevation(device: &Device) -> f64 {
    let (rest, axis) = match &device.deflector {
        Deflector::Polygon { effective_max, facet_tilts } => {
            let count = facet_tilts.len().max(1) as f64;
            let tilt = facet_tilts.iter().sum::<f64>() / count;
            // A tilt turns the beam towards +x, along the axis of the mirror.
            let axis = if *effective_max >= PI * (1.0 - 1e-9) { DVec3::X } else { DVec3::Z };
            (Rotation::about_z(-tilt).forward(), axis)
        }
        Deflector::Risley { incident, .. } => (*incident, DVec3::Z),
        Deflector::Pattern(table) => (table.mean_beam(), DVec3::Z),
        _ => (DVec3::Y, DVec3::Z),
    };
    libm::asin(device.beam_origin.rotation.apply(rest).dot(axis).clamp(-1.0, 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Mount, catalogue, testkit};

    fn rings_of(id: &str) -> Vec<u16> {
        let (known, _) = catalogue().unwrap();
        known.scanners.iter().find(|(name, _)| name.ends_with(id)).unwrap().1.rings()
    }

    #[test]
    fn rows_are_counted_from_the_lowest_channel_up() {
        let vlp16: Vec<u16> = (0..8).flat_map(|i| [i, i + 8]).collect();
        assert_eq!(rings_of("#vlp16"), vlp16);
        // The same lasers around a mirror's axis.
        assert_eq!(rings_of("#hovermap"), vlp16);
        assert_eq!(rings_of("#hesai_xt32"), (0..32).rev().collect::<Vec<u16>>());
        assert_eq!(rings_of("#velodyne_hdl-64e"), (0..64).collect::<Vec<u16>>());
        assert_eq!(rings_of("#riegl_vz400"), [0]);
        // Their planes are turned about the line of sight: one elevation, in the order of channels.
        assert_eq!(rings_of("#riegl_vq-1560ii"), [0, 1]);
    }

    #[test]
    fn every_scanner_has_each_row_once() {
        let (known, _) = catalogue().unwrap();
        for (name, scanner) in &known.scanners {
            let mut rings = scanner.rings();
            rings.sort_unstable();
            assert_eq!(rings, (0..scanner.devices.len() as u16).collect::<Vec<u16>>(), "{name}");
        }
    }

    #[test]
    fn channels_of_one_elevation_keep_their_order() {
        let device = |degrees: f64| {
            let rotation = Rotation::about_x(degrees.to_radians());
            Device { beam_origin: Mount { rotation, ..Mount::IDENTITY }, ..testkit::device() }
        };
        let survey = testkit::survey([5.0, -5.0, 5.0, 0.0, -5.0].map(device).to_vec());
        assert_eq!(survey.scanner.rings(), [3, 0, 4, 2, 1]);
    }
}
