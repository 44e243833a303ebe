//! Mechanisms that move the beam, as functions of time.
//!
//! Directions are those of the platform: to the right, forward, up.

use libm::{cos, sin};
use std::f64::consts::TAU;
use vlscan_geom::DVec3;

/// What moves the beam.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mirror {
    /// A cone about the downward axis (Palmer scanner). Parameters: half angle, turns per second, phase; positive turns go
    /// from ahead to the right.
    Cone,
    /// Parallel lines in one direction (polygon mirror). Parameters: angle per line, lines per second, phase, yaw; positive
    /// angles per line go from left to right.
    Polygon,
    /// Lines to and fro with constant speed (oscillating mirror). Parameters: half angle, periods per second, phase, yaw.
    Oscillating,
}

/// Maximum number of parameters of a mirror.
pub const MIRROR_PARAMETERS: usize = 4;

impl Mirror {
    /// All kinds.
    pub const ALL: [Mirror; 3] = [Mirror::Cone, Mirror::Polygon, Mirror::Oscillating];

    /// Name of the optics in pipeline files.
    pub fn optics(self) -> &'static str {
        match self {
            Mirror::Cone => "conic",
            Mirror::Polygon => "rotating",
            Mirror::Oscillating => "oscillating",
        }
    }

    /// Number of parameters.
    pub fn count(self) -> usize {
        match self {
            Mirror::Cone => 3,
            Mirror::Polygon | Mirror::Oscillating => 4,
        }
    }

    /// Direction of the beam at `time` (s), unit vector. Angles are rad.
    pub fn direction(self, p: &[f64], time: f64) -> DVec3 {
        match self {
            Mirror::Cone => {
                let turn = TAU * p[1] * time + p[2];
                let radius = sin(p[0]);
                DVec3::new(radius * sin(turn), radius * cos(turn), -cos(p[0]))
            }
            Mirror::Polygon | Mirror::Oscillating => {
                let angle = self.angle(p, time);
                let (across, yaw) = (sin(angle), p[3]);
                DVec3::new(across * cos(yaw), -across * sin(yaw), -cos(angle))
            }
        }
    }

    /// Scan angle of the mirrors that draw lines, rad.
    pub fn angle(self, p: &[f64], time: f64) -> f64 {
        let phase = p[1] * time + p[2] / TAU;
        let part = phase - phase.floor();
        match self {
            Mirror::Oscillating => p[0] * if part < 0.5 { 4.0 * part - 1.0 } else { 3.0 - 4.0 * part },
            _ => p[0] * (part - 0.5),
        }
    }

    /// Place within the revolution, line or period at `time`, from 0 to 1.
    pub fn phase(self, p: &[f64], time: f64) -> f64 {
        let phase = p[1] * time + p[2] / TAU;
        phase - phase.floor()
    }
}
