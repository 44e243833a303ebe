//! Mechanisms that move the beam, as functions of time.
//!
//! Directions are those of the platform: to the right, forward, up.

use libm::{cos, sin, tan};
use std::f64::consts::TAU;
use vlscan_geom::DVec3;

/// Kind of mirror that deflects the beam.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mirror {
    /// A cone about the downward axis (Palmer scanner). Parameters: half angle, turns per second, phase;
    /// positive turns go from ahead to the right.
    Cone,
    /// An elliptic cone about the downward axis. Parameters: half angle across the flight, turns per second,
    /// phase, yaw of the scanner, half angle along the flight; positive turns go from ahead to the right.
    EllipticCone,
    /// Parallel lines in one direction (polygon mirror). Parameters: angle per line, lines per second, phase,
    /// yaw of the scanner; positive angles per line go from left to right. Facets may differ by their tilt.
    Polygon,
    /// Lines to and fro with constant speed (oscillating mirror). Parameters: half angle, periods per second,
    /// phase, yaw of the scanner.
    Oscillating,
}

/// Maximum number of parameters of a mirror.
pub const MIRROR_PARAMETERS: usize = 5;

impl Mirror {
    /// All kinds.
    pub const ALL: [Mirror; 4] = [Mirror::Cone, Mirror::EllipticCone, Mirror::Polygon, Mirror::Oscillating];

    /// Name of the optics in pipeline files.
    pub fn optics(self) -> &'static str {
        match self {
            Mirror::Cone | Mirror::EllipticCone => "conic",
            Mirror::Polygon => "rotating",
            Mirror::Oscillating => "oscillating",
        }
    }

    /// Name in messages.
    pub fn name(self) -> &'static str {
        match self {
            Mirror::Cone => "a cone",
            Mirror::EllipticCone => "an elliptic cone",
            Mirror::Polygon => "a polygon mirror",
            Mirror::Oscillating => "an oscillating mirror",
        }
    }

    /// Number of parameters.
    pub fn count(self) -> usize {
        match self {
            Mirror::Cone => 3,
            Mirror::EllipticCone => 5,
            Mirror::Polygon | Mirror::Oscillating => 4,
        }
    }

    /// Direction of the beam at `time` (s), unit vector, of a mirror with the phase `phase` at time 0. Angles
    /// are rad.
    pub fn direction(self, p: &[f64], phase: f64, time: f64) -> DVec3 {
        match self {
            Mirror::Cone => {
                let turn = TAU * p[1] * time + phase;
                let radius = sin(p[0]);
                DVec3::new(radius * sin(turn), radius * cos(turn), -cos(p[0]))
            }
            Mirror::EllipticCone => {
                let turn = TAU * p[1] * time + phase;
                DVec3::new(tan(p[0]) * sin(turn), tan(p[4]) * cos(turn), -1.0).normalize()
            }
            Mirror::Polygon | Mirror::Oscillating => {
                let part = self.part(p, phase, time);
                let angle = match self {
                    Mirror::Oscillating if part < 0.5 => p[0] * (4.0 * part - 1.0),
                    Mirror::Oscillating => p[0] * (3.0 - 4.0 * part),
                    _ => p[0] * (part - 0.5),
                };
                DVec3::new(sin(angle), 0.0, -cos(angle))
            }
        }
    }

    /// Number of the revolution, line or period at `time`.
    pub fn number(self, p: &[f64], phase: f64, time: f64) -> i64 {
        (p[1] * time + phase / TAU).floor() as i64
    }

    /// Place within the revolution, line or period at `time`, from 0 to 1.
    pub fn part(self, p: &[f64], phase: f64, time: f64) -> f64 {
        let phase = p[1] * time + phase / TAU;
        phase - phase.floor()
    }
}
