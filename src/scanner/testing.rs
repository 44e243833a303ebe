//! Devices for tests.

use crate::geom::{DVec3, radians};
use crate::survey::testkit;
pub use crate::survey::testkit::scanner_settings as settings;
use crate::survey::{Deflector, Device, Head};

/// A device with the given deflector, 120° mechanical half angle and a free head.
pub fn device(deflector: Deflector) -> Device {
    Device {
        deflector,
        scan_angle_max: radians(120.0),
        head: Head { axis: DVec3::Z, max_rate: radians(3600.0) },
        ..testkit::device()
    }
}
