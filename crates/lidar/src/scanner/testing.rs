//! Devices for tests.

use vlscan_geom::{DVec3, radians};
use vlscan_survey::testkit;
pub use vlscan_survey::testkit::scanner_settings as settings;
use vlscan_survey::{Deflector, Device, Head};

/// A device with that deflector, a mechanical half angle of 120° and a head of up to 3600°/s.
pub fn device(deflector: Deflector) -> Device {
    Device {
        deflector,
        scan_angle_max: radians(120.0),
        head: Head { axis: DVec3::Z, max_rate: radians(3600.0) },
        ..testkit::device()
    }
}
