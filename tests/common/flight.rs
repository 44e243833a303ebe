//! A recorded flight for the fixtures: the trajectory of an aircraft on an S-shaped course over a generated scene.

use libm::{atan2, cos, sin};
use std::fmt::Write as _;
use vlscan::internals::UtmZone;

fn radians(degrees: f64) -> f64 {
    degrees.to_radians()
}

fn degrees(radians: f64) -> f64 {
    radians.to_degrees()
}

/// What [`flight_text`] flies: an S-shaped course northwards through the origin.
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

/// The line of names.
pub const NAMES: &str = "time[s],x[m],y[m],z[m],roll[deg],pitch[deg],yaw[deg]";

/// A flight as comma-separated text: a line of names with their units, then one pose per line. Angles are those of
/// aeronautics: yaw clockwise from north (+y), pitch with the nose up, roll (innermost) with the right wing down.
pub fn flight_text(options: &FlightOptions) -> Vec<u8> {
    let mut text = format!("{NAMES}\n");
    for i in 0..=options.poses() {
        let t = i as f64 / options.rate_hz;
        let [x, y, z, roll, pitch, yaw] = options.pose(t);
        let _ =
            writeln!(text, "{:.4},{x:.4},{y:.4},{z:.4},{roll:.5},{pitch:.5},{yaw:.5}", options.start_s + t);
    }
    text.into_bytes()
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

/// The flight as SBET: records of 17 little-endian doubles, whose headings count from the north of a frame that
/// wanders. Accelerations and angular rates are 0.
pub fn flight_sbet(options: &FlightOptions, place: &GridPlace) -> Vec<u8> {
    let mut records = Vec::new();
    for i in 0..=options.poses() {
        let t = i as f64 / options.rate_hz;
        let [x, y, z, roll, pitch, heading] = options.pose(t);
        let [a, b] = [t - 5e-4, t + 5e-4].map(|t| options.pose(t));
        let velocity: [f64; 3] = std::array::from_fn(|axis| (b[axis] - a[axis]) * 1e3);
        let (latitude, longitude) = place.zone.unproject(place.origin_m[0] + x, place.origin_m[1] + y);
        let point = place.zone.project(latitude, longitude);
        let convergence = point.expect("a flight lies in its UTM zone").convergence;
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
        records.extend(record.into_iter().flat_map(f64::to_le_bytes));
    }
    records
}

impl FlightOptions {
    /// Number of poses after the first.
    fn poses(&self) -> u64 {
        (self.rate_hz * self.duration_s).round() as u64
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
