//! Position of the instrument when it emitted a pulse.
//!
//! All returns of a pulse lie on its beam, so that the beams of pulses with several returns meet in the
//! instrument (Gatziolis and McGaughey 2019, *Reconstructing aircraft trajectories from multi-return airborne
//! laser-scanning data*, Remote Sensing 11(19)). A pass over a place is short: the instrument moves along a
//! straight line, x(t) = a + b·(t − t₀), whose six numbers minimise the squared distances from the beams. If
//! there are too few beams, or they meet too badly, the position across the track follows from the scan
//! angle: its tangent grows by 1/height per metre, in the direction to the right of the flight.

use super::recording::{Line, Recording};
use vlscan_geom::DVec3;

/// Minimum number of pulses with several returns for a path.
const MIN_BEAMS: usize = 50;
/// Minimum distance between the first and the last return of such a pulse, m.
const MIN_BEAM_LENGTH: f64 = 2.0;
/// Largest standard deviation of the instrument's direction, as seen from the place, rad.
const MAX_DIRECTION_ERROR: f64 = 0.01;
/// Height above the place of an instrument of which only the direction is known, m.
const UNKNOWN_HEIGHT: f64 = 1000.0;

/// Source of the path of a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PathSource {
    /// Beams of pulses with several returns.
    Beams,
    /// Scan angles.
    ScanAngles,
    /// None: the instrument is assumed to be above the place.
    Nadir,
}

impl PathSource {
    /// A phrase for messages.
    pub fn phrase(self) -> &'static str {
        match self {
            PathSource::Beams => "pulses of several returns",
            PathSource::ScanAngles => "scan angles",
            PathSource::Nadir => "nothing; it is taken to be straight above",
        }
    }
}

/// The straight path of the instrument along a line.
#[derive(Clone, Debug)]
pub struct SensorPath {
    /// Point source id of LAS; of other formats the number of the leg, counted from 1.
    pub source: u16,
    /// First and last time, s.
    pub times: [f64; 2],
    /// World position at the time in the middle, m.
    pub position: DVec3,
    /// Velocity, m/s.
    pub velocity: DVec3,
    /// Source of the path.
    pub found_by: PathSource,
    /// Standard deviation of the direction in which the instrument is seen, rad, where it was estimated.
    pub direction_sigma: Option<f64>,
}

impl SensorPath {
    /// World position at a time, m.
    pub fn at(&self, time: f64) -> DVec3 {
        self.position + self.velocity * (time - 0.5 * (self.times[0] + self.times[1]))
    }
}

/// The paths of all lines.
pub(super) fn paths(recording: &Recording) -> Vec<SensorPath> {
    recording.lines.iter().map(|line| path(recording, line)).collect()
}

fn path(recording: &Recording, line: &Line) -> SensorPath {
    let time = |pulse: usize| recording.of_pulse(pulse)[0].time;
    let times = [time(line.pulses.start), time(line.pulses.end - 1)];
    let points = || line.pulses.clone().map(|pulse| recording.of_pulse(pulse)[0].position);
    let place = points().sum::<DVec3>() / line.pulses.len() as f64;
    let base = SensorPath {
        source: line.source,
        times,
        position: place + DVec3::Z * UNKNOWN_HEIGHT,
        velocity: DVec3::ZERO,
        found_by: PathSource::Nadir,
        direction_sigma: None,
    };
    by_beams(recording, line, place, &base)
        .or_else(|| by_scan_angles(recording, line, place, &base))
        .unwrap_or(base)
}

/// A beam: time after the middle of the line, a point on it, its unit vector upwards, weight.
struct Beam {
    time: f64,
    point: DVec3,
    axis: DVec3,
    /// Distance between its first and last return, m.
    length: f64,
    weight: f64,
}

/// Beams of the pulses of a line with several returns; `middle` is the time of its middle, s.
fn beams_of(recording: &Recording, line: &Line, place: DVec3, middle: f64) -> Vec<Beam> {
    let mut beams: Vec<Beam> = Vec::new();
    for pulse in line.pulses.clone() {
        let returns = recording.of_pulse(pulse);
        let (first, last) = (returns[0].position, returns[returns.len() - 1].position);
        let (along, length) = (first - last, (first - last).length());
        if length >= MIN_BEAM_LENGTH && along.z > 0.0 {
            let (point, axis, time) = (first - place, along / length, returns[0].time - middle);
            beams.push(Beam { time, point, axis, length, weight: length * length });
        }
    }
    beams
}

/// Normal equations of position and motion within `duration`: matrix and right side.
fn equations(beams: &[Beam], duration: f64) -> ([[f64; 6]; 6], [f64; 6]) {
    let mut normal = [[0.0; 6]; 6];
    let mut right = [0.0; 6];
    for beam in beams {
        // The distance from the beam is (1 − a·aᵀ)(x + v·t − p).
        let t = beam.time / duration;
        for (i, ei) in DVec3::AXES.into_iter().enumerate() {
            let across = (ei - beam.axis * beam.axis.dot(ei)) * beam.weight;
            let r = across.dot(beam.point);
            right[i] += r;
            right[i + 3] += r * t;
            for (j, ej) in DVec3::AXES.into_iter().enumerate() {
                let n = across.dot(ej);
                normal[i][j] += n;
                normal[i][j + 3] += n * t;
                normal[i + 3][j] += n * t;
                normal[i + 3][j + 3] += n * t * t;
            }
        }
    }
    // Aircraft fly almost level, and the rate of climb is the least certain.
    normal[5][5] += 1e6 * normal[0][0];
    (normal, right)
}

fn by_beams(recording: &Recording, line: &Line, place: DVec3, base: &SensorPath) -> Option<SensorPath> {
    let middle = 0.5 * (base.times[0] + base.times[1]);
    let mut beams = beams_of(recording, line, place, middle);
    if beams.len() < MIN_BEAMS {
        return None;
    }
    let duration = (base.times[1] - base.times[0]).max(1e-3);
    let mut solution = [0.0; 6];
    let mut errors = [[0.0; 6]; 6];
    for _ in 0..6 {
        let (normal, right) = equations(&beams, duration);
        let inverse = inverse(&normal)?;
        solution = std::array::from_fn(|i| (0..6).map(|j| inverse[i][j] * right[j]).sum());
        // Residual angle of each beam; beams far off have a lower weight (Cauchy). All beams count for the
        // variance.
        let angle = |beam: &Beam| {
            let x = DVec3::new(solution[0], solution[1], solution[2])
                + DVec3::new(solution[3], solution[4], solution[5]) * (beam.time / duration);
            let d = x - beam.point;
            (d - beam.axis * beam.axis.dot(d)).length() / d.length().max(1.0)
        };
        let mut angles: Vec<f64> = beams.iter().map(angle).collect();
        angles.sort_by(f64::total_cmp);
        let scale = angles[angles.len() / 2].max(1e-6);
        let distance = DVec3::new(solution[0], solution[1], solution[2]).length().max(1.0);
        let mut unit_variance = 0.0;
        for beam in &mut beams {
            let relative = angle(beam) / (2.0 * scale);
            unit_variance += beam.weight * (angle(beam) * distance).powi(2) / (2.0 * angles.len() as f64);
            beam.weight = beam.length.powi(2) / (1.0 + relative * relative);
        }
        errors = inverse.map(|row| row.map(|e| e * unit_variance));
    }
    let position = DVec3::new(solution[0], solution[1], solution[2]);
    let velocity = DVec3::new(solution[3], solution[4], solution[5]) / duration;
    let distance = position.length();
    // Across the line of sight at the middle of the line.
    let sight = position / distance.max(1.0);
    let across = |axis: DVec3| {
        let e: f64 = (0..3).map(|i| (0..3).map(|j| axis[i] * errors[i][j] * axis[j]).sum::<f64>()).sum();
        e.max(0.0).sqrt() / distance.max(1.0)
    };
    let aside = sight.cross(DVec3::Y).normalize_or(DVec3::X);
    let sigma = across(aside).max(across(aside.cross(sight)));
    let is_sound = position.z > 5.0 && sigma < MAX_DIRECTION_ERROR && position.is_finite();
    let direction_sigma = Some(sigma);
    is_sound.then(|| SensorPath {
        position: place + position,
        velocity,
        found_by: PathSource::Beams,
        direction_sigma,
        ..base.clone()
    })
}

/// The path by tan(scan angle) = c + g·(x, y): the gradient g points to the right of the flight and is
/// 1/height.
fn by_scan_angles(recording: &Recording, line: &Line, place: DVec3, base: &SensorPath) -> Option<SensorPath> {
    if !recording.has_scan_angles {
        return None;
    }
    let mut sums = [[0.0; 3]; 3];
    let mut right = [0.0; 3];
    for pulse in line.pulses.clone() {
        let first = recording.of_pulse(pulse)[0];
        let p = first.position - place;
        let row = [1.0, p.x, p.y];
        let tangent = libm::tan(first.scan_angle.to_radians());
        for i in 0..3 {
            right[i] += row[i] * tangent;
            (0..3).for_each(|j| sums[i][j] += row[i] * row[j]);
        }
    }
    let inverse = inverse(&sums)?;
    let [centre, gx, gy] = std::array::from_fn(|i| (0..3).map(|j| inverse[i][j] * right[j]).sum::<f64>());
    let slope = libm::hypot(gx, gy);
    // No airborne scanner flies lower than 20 m or higher than 20 km: such heights come from angles in whole
    // degrees over a small place.
    let height = Some(1.0 / slope).filter(|h| (20.0..20_000.0).contains(h))?;
    let to_right = DVec3::new(gx, gy, 0.0) / slope;
    let position = place - to_right * (centre * height) + DVec3::Z * height;
    // The beam lies in the plane across the flight: the instrument is as far along the track as its points.
    let forward = DVec3::new(-to_right.y, to_right.x, 0.0);
    let velocity = forward * speed_along(recording, line, place, forward);
    Some(SensorPath { position, velocity, found_by: PathSource::ScanAngles, ..base.clone() })
}

/// Speed of the points along `forward`, m/s, by least squares.
fn speed_along(recording: &Recording, line: &Line, place: DVec3, forward: DVec3) -> f64 {
    let first = |pulse: usize| recording.of_pulse(pulse)[0];
    let n = line.pulses.len() as f64;
    let mean = line.pulses.clone().map(|pulse| first(pulse).time).sum::<f64>() / n;
    let (mut square, mut product) = (0.0, 0.0);
    for pulse in line.pulses.clone() {
        let t = first(pulse).time - mean;
        square += t * t;
        product += t * (first(pulse).position - place).dot(forward);
    }
    if square > 0.0 { product / square } else { 0.0 }
}

/// Inverse of a matrix by Gauss-Jordan elimination with pivoting, for matrices that are nearly singular;
/// `None` for singular ones.
fn inverse<const N: usize>(matrix: &[[f64; N]; N]) -> Option<[[f64; N]; N]> {
    let mut a = *matrix;
    let mut b = std::array::from_fn(|i| std::array::from_fn(|j| f64::from(u8::from(i == j))));
    for column in 0..N {
        let pivot = (column..N).max_by(|i, j| a[*i][column].abs().total_cmp(&a[*j][column].abs()))?;
        a.swap(column, pivot);
        b.swap(column, pivot);
        let scale = a[column][column];
        if scale.abs() < 1e-300 || !scale.is_finite() {
            return None;
        }
        for j in 0..N {
            a[column][j] /= scale;
            b[column][j] /= scale;
        }
        for i in (0..N).filter(|i| *i != column) {
            let factor = a[i][column];
            for j in 0..N {
                a[i][j] -= factor * a[column][j];
                b[i][j] -= factor * b[column][j];
            }
        }
    }
    Some(b)
}
