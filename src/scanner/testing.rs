//! Devices for tests.

use crate::geom::{DVec3, radians};
use crate::survey::testkit;
pub use crate::survey::testkit::scanner_settings as settings;
use crate::survey::{Deflector, Device, Head};

/// A device with that deflector, a mechanical half angle of 120° and a head of up to 3600°/s.
pub fn device(deflector: Deflector) -> Device {
    Device {
        deflector,
        scan_angle_max: radians(120.0),
        head: Head { axis: DVec3::Z, max_rate: radians(3600.0) },
        ..testkit::device()
    }
}
