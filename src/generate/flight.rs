//! A recorded flight: the trajectory of an aircraft that winds its way over a made scene.

use super::obj::NewFile;
use crate::error::{Error, Result};
use crate::geom::{UtmZone, degrees, radians};
use libm::{atan2, cos, sin};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// What [`write_flight`] flies: an S-shaped course northwards through the origin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FlightOptions {
    /// Poses per second.
    pub rate_hz: f64,
    /// Duration, s.
    pub duration_s: f64,
    /// Height of the track, m.
    pub height_m: f64,
    /// Distance from start to end in a straight line, m.
    pub length_m: f64,
    /// How far the course swings to either side, m.
    pub swing_m: f64,
    /// Time of the first pose, s.
    pub start_s: f64,
}

impl Default for FlightOptions {
    fn default() -> FlightOptions {
        FlightOptions {
            rate_hz: 200.0,
            duration_s: 20.0,
            height_m: 200.0,
            length_m: 260.0,
            swing_m: 30.0,
            start_s: 1000.0,
        }
    }
}

const NAMES: &str = "time[s],x[m],y[m],z[m],roll[deg],pitch[deg],yaw[deg]";

/// Writes a flight as comma-separated text: a line of names with their units, then one pose per line. Angles are those of
/// aeronautics: yaw clockwise from north (+y), pitch with the nose up, roll (innermost) with the right wing down.
pub fn write_flight(options: &FlightOptions, path: &Path) -> Result<PathBuf> {
    let poses = options.poses()?;
    let mut file = NewFile::create(path)?;
    let mut text = format!("{NAMES}\n");
    for i in 0..=poses {
        let t = i as f64 / options.rate_hz;
        let [x, y, z, roll, pitch, yaw] = options.pose(t);
        let _ =
            writeln!(text, "{:.4},{x:.4},{y:.4},{z:.4},{roll:.5},{pitch:.5},{yaw:.5}", options.start_s + t);
        if text.len() > 1 << 20 {
            file.write(text.as_bytes())?;
            text.clear();
        }
    }
    file.write(text.as_bytes())?;
    file.finish()
}

/// Where on the Earth a flight is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GridPlace {
    /// The grid.
    pub zone: UtmZone,
    /// Easting and northing of the flight's origin, m.
    pub origin_m: [f64; 2],
    /// Height of the flight's zero above the ellipsoid, m.
    pub height_m: f64,
}

/// Writes the same flight as SBET: records of 17 little-endian doubles, whose headings count from the north of a frame that
/// wanders. Accelerations and angular rates are 0.
pub fn write_sbet(options: &FlightOptions, place: &GridPlace, path: &Path) -> Result<PathBuf> {
    let poses = options.poses()?;
    let mut file = NewFile::create(path)?;
    for i in 0..=poses {
        let t = i as f64 / options.rate_hz;
        let [x, y, z, roll, pitch, heading] = options.pose(t);
        let [a, b] = [t - 5e-4, t + 5e-4].map(|t| options.pose(t));
        let velocity: [f64; 3] = std::array::from_fn(|axis| (b[axis] - a[axis]) * 1e3);
        let (latitude, longitude) = place.zone.unproject(place.origin_m[0] + x, place.origin_m[1] + y);
        let point = place.zone.project(latitude, longitude);
        let convergence = point.ok_or_else(|| Error::input("a flight must lie in its UTM zone"))?.convergence;
        let wander = 0.1 + 1e-3 * t;
        // Velocities along the axes of the wandering frame, the third one downwards.
        let turn = convergence + wander;
        let (s, c) = (sin(turn), cos(turn));
        let [east, north, up] = velocity;
        let record = [
            options.start_s + t,
            latitude,
            longitude,
            place.height_m + z,
            north * c - east * s,
            east * c + north * s,
            -up,
            radians(roll),
            radians(pitch),
            radians(heading) + turn,
            wander,
            0.0,
            0.0,
            0.0,
            0.0,
            0.0,
            0.0,
        ];
        let bytes: Vec<u8> = record.into_iter().flat_map(f64::to_le_bytes).collect();
        file.write(&bytes)?;
    }
    file.finish()
}

impl FlightOptions {
    /// Number of poses after the first.
    fn poses(&self) -> Result<u64> {
        let poses = self.rate_hz * self.duration_s;
        if poses.is_finite() && (1.0..=1e9).contains(&poses) && self.length_m > 0.0 {
            return Ok(poses.round() as u64);
        }
        Err(Error::input("a flight needs a positive rate, duration and length, and at most 1000000000 poses"))
    }

    /// Position in metres and attitude in degrees at `t` seconds after the start.
    fn pose(&self, t: f64) -> [f64; 6] {
        let speed = self.length_m / self.duration_s;
        let wave = std::f64::consts::TAU / self.duration_s;
        let x = self.swing_m * sin(wave * t);
        let y = speed * t - 0.5 * self.length_m;
        // Air is never quite still.
        let z = self.height_m + 1.5 * sin(0.9 * t) + 0.2 * sin(4.1 * t + 1.0);
        let (vx, vz) = (self.swing_m * wave * cos(wave * t), 1.35 * cos(0.9 * t) + 0.82 * cos(4.1 * t + 1.0));
        let ax = -self.swing_m * wave * wave * sin(wave * t);
        let course = degrees(atan2(vx, speed));
        // Continuous, so that readers may interpolate between poses.
        let yaw = course + 0.6 * sin(1.7 * t);
        let pitch = degrees(atan2(vz, speed)) + 1.5 + 0.3 * sin(5.3 * t);
        let roll =
            degrees(atan2(ax * cos(radians(course)), 9.81)) + 0.8 * sin(2.3 * t) + 0.15 * sin(11.0 * t);
        [x, y, z, roll, pitch, yaw]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flight_has_its_poses_in_order_and_no_jumps() {
        let folder = tempfile::tempdir().unwrap();
        let path = write_flight(&FlightOptions::default(), &folder.path().join("flight.csv")).unwrap();
        let text = std::fs::read_to_string(path).unwrap();
        let mut lines = text.lines();
        assert_eq!(lines.next().unwrap(), NAMES);
        let rows: Vec<Vec<f64>> = lines.map(|l| l.split(',').map(|f| f.parse().unwrap()).collect()).collect();
        assert_eq!(rows.len(), 4001);
        for pair in rows.windows(2) {
            let step = |i: usize| pair[1][i] - pair[0][i];
            assert!((step(0) - 0.005).abs() < 1e-9);
            assert!((1..4).all(|i| step(i).abs() < 0.2), "{pair:?}");
            assert!((4..7).all(|i| step(i).abs() < 1.0), "{pair:?}");
        }
    }

    #[test]
    fn nonsense_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        for rate_hz in [0.0, f64::NAN, f64::INFINITY, -1.0, 1e12] {
            let options = FlightOptions { rate_hz, ..FlightOptions::default() };
            assert!(matches!(write_flight(&options, &folder.path().join("f.csv")), Err(Error::Input(_))));
        }
    }
}
