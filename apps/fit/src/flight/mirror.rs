//! Mechanisms that move the beam, as functions of time.
//!
//! Directions are those of the platform: to the right, forward, up.

use libm::{cos, sin, tan};
use std::f64::consts::TAU;
use vlscan_geom::DVec3;

/// Largest share of a sweep in which a mirror reverses: two parabolas.
const MAX_TURNING: f64 = 1.0;

/// Kind of mirror that deflects the beam.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mirror {
    /// Cone about the downward axis (Palmer scanner).
    Cone,
    /// Elliptic cone about the downward axis.
    EllipticCone,
    /// Parallel lines in one direction (polygon mirror). Facets may differ by their tilt.
    Polygon,
    /// Lines to and fro with constant speed (oscillating mirror).
    Oscillating,
    /// Lines to and fro with constant speed between reversals that take a share of each sweep.
    Turning,
    /// Lines to and fro as a sine.
    Sine,
}

/// Parameters of a mirror.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MirrorParameters {
    /// Half angle of a cone, or of lines to and fro, rad; of an elliptic cone that across the flight. Of a
    /// polygon mirror the angle per line, positive from left to right.
    pub angle: f64,
    /// Revolutions, lines or periods per second. Positive revolutions of a cone go from ahead to the right.
    pub rate: f64,
    /// Yaw of the scanner, rad; 0 for a cone, whose phase has the same effect.
    pub yaw: f64,
    /// Half angle of an elliptic cone along the flight, rad; unused for other mirrors.
    pub angle_along: f64,
    /// Share of each sweep in which a mirror of the kind [`Mirror::Turning`] reverses, 0 to 1; unused for
    /// other mirrors.
    pub turning: f64,
}

impl MirrorParameters {
    /// Number of the revolution, line or period at `time`, s, of a mirror with the phase `phase` at time 0,
    /// rad.
    pub fn number(&self, phase: f64, time: f64) -> i64 {
        (self.rate * time + phase / TAU).floor() as i64
    }

    /// Fraction of the revolution, line or period that has passed at `time`, from 0 to 1.
    pub fn fraction(&self, phase: f64, time: f64) -> f64 {
        let turns = self.rate * time + phase / TAU;
        turns - turns.floor()
    }
}

impl Mirror {
    /// All kinds.
    pub const ALL: [Mirror; 6] = [
        Mirror::Cone,
        Mirror::EllipticCone,
        Mirror::Polygon,
        Mirror::Oscillating,
        Mirror::Turning,
        Mirror::Sine,
    ];

    /// Name of the optics in pipeline files.
    pub fn optics(self) -> &'static str {
        match self {
            Mirror::Cone | Mirror::EllipticCone => "conic",
            Mirror::Polygon => "rotating",
            Mirror::Oscillating | Mirror::Turning | Mirror::Sine => "oscillating",
        }
    }

    /// Name in messages.
    pub fn name(self) -> &'static str {
        match self {
            Mirror::Cone => "a cone",
            Mirror::EllipticCone => "an elliptic cone",
            Mirror::Polygon => "a polygon mirror",
            Mirror::Oscillating => "an oscillating mirror",
            Mirror::Turning => "an oscillating mirror with long reversals",
            Mirror::Sine => "a mirror that swings as a sine",
        }
    }

    /// True if a yaw of the scanner differs from a phase of the mirror.
    pub fn has_yaw(self) -> bool {
        self != Mirror::Cone
    }

    /// Direction of the beam at `time` (s), unit vector, of a mirror with the phase `phase` at time 0, rad.
    pub fn direction(self, p: &MirrorParameters, phase: f64, time: f64) -> DVec3 {
        let turn = TAU * p.rate * time + phase;
        match self {
            Mirror::Cone => {
                let radius = sin(p.angle);
                DVec3::new(radius * sin(turn), radius * cos(turn), -cos(p.angle))
            }
            Mirror::EllipticCone => {
                DVec3::new(tan(p.angle) * sin(turn), tan(p.angle_along) * cos(turn), -1.0).normalize()
            }
            Mirror::Polygon => across(p.angle * (p.fraction(phase, time) - 0.5)),
            Mirror::Oscillating => across(p.angle * swing(p.fraction(phase, time), 0.0)),
            Mirror::Turning => across(p.angle * swing(p.fraction(phase, time), p.turning)),
            Mirror::Sine => across(-p.angle * cos(turn)),
        }
    }

    /// True if the beam goes to and fro.
    pub fn is_swinging(self) -> bool {
        matches!(self, Mirror::Oscillating | Mirror::Turning | Mirror::Sine)
    }
}

/// Place of a mirror that swings, from −1 to 1, after this fraction of a period: constant speed between
/// reversals of constant acceleration, which take the share `turning` of each sweep.
fn swing(fraction: f64, turning: f64) -> f64 {
    let (x, sign) = if fraction < 0.5 { (2.0 * fraction, 1.0) } else { (2.0 * fraction - 1.0, -1.0) };
    // Half of a reversal is at either end of a sweep.
    let half = 0.5 * turning.clamp(0.0, MAX_TURNING);
    let speed = 1.0 / (1.0 - half);
    let way = if x < half {
        speed * x * x / (2.0 * half)
    } else if x <= 1.0 - half {
        speed * (x - 0.5 * half)
    } else {
        1.0 - speed * (1.0 - x) * (1.0 - x) / (2.0 * half)
    };
    sign * (2.0 * way - 1.0)
}

/// Direction at an angle across the flight, positive to the right.
fn across(angle: f64) -> DVec3 {
    DVec3::new(sin(angle), 0.0, -cos(angle))
}

#[cfg(test)]
mod tests {
    use super::*;

    const PARAMETERS: MirrorParameters =
        MirrorParameters { angle: 0.4, rate: 2.0, yaw: 0.0, angle_along: 0.2, turning: 0.5 };

    fn is_near(found: DVec3, expected: [f64; 3]) -> bool {
        (found - DVec3::from(expected)).length() < 1e-12
    }

    #[test]
    fn cones_turn_from_ahead_to_the_right() {
        for (mirror, along) in [(Mirror::Cone, 0.4), (Mirror::EllipticCone, 0.2)] {
            let ahead = mirror.direction(&PARAMETERS, 0.0, 0.0);
            assert!(is_near(ahead, [0.0, sin(along), -cos(along)]), "{mirror:?}: {ahead}");
            // A quarter of a revolution later.
            let right = mirror.direction(&PARAMETERS, 0.0, 0.125);
            assert!(is_near(right, [sin(0.4), 0.0, -cos(0.4)]), "{mirror:?}: {right}");
        }
    }

    #[test]
    fn a_polygon_mirror_draws_each_line_from_left_to_right() {
        let at = |time: f64| Mirror::Polygon.direction(&PARAMETERS, 0.0, time);
        assert!(is_near(at(0.0), [-sin(0.2), 0.0, -cos(0.2)]));
        assert!(is_near(at(0.25), [0.0, 0.0, -1.0]));
        assert!(at(0.49).x > 0.19 && at(0.51).x < -0.18);
    }

    #[test]
    fn an_oscillating_mirror_goes_to_and_fro_within_its_half_angle() {
        let at = |time: f64| Mirror::Oscillating.direction(&PARAMETERS, 0.0, time);
        for (time, angle) in [(0.0, -0.4), (0.125, 0.0), (0.25, 0.4), (0.375, 0.0), (0.5, -0.4)] {
            assert!(is_near(at(time), [sin(angle), 0.0, -cos(angle)]), "{time}: {}", at(time));
        }
    }

    #[test]
    fn reversals_take_their_share_of_a_sweep() {
        let angle = |mirror: Mirror, turning: f64, time: f64| {
            let at = mirror.direction(&MirrorParameters { turning, ..PARAMETERS }, 0.0, time);
            libm::atan2(at.x, -at.z) / 0.4
        };
        for mirror in [Mirror::Turning, Mirror::Sine] {
            for (time, place) in [(0.0, -1.0), (0.125, 0.0), (0.25, 1.0), (0.375, 0.0), (0.5, -1.0)] {
                assert!((angle(mirror, 0.5, time) - place).abs() < 1e-12, "{mirror:?} {time}");
            }
        }
        // Half a sweep of reversals: even at 4/3 of the mean speed in the half between.
        let step = angle(Mirror::Turning, 0.5, 0.14) - angle(Mirror::Turning, 0.5, 0.11);
        assert!((step - 0.03 * 8.0 * 4.0 / 3.0).abs() < 1e-12, "{step}");
        // An eighth of a sweep from its end, within the reversal.
        let end = angle(Mirror::Turning, 0.5, 0.125 / 4.0);
        assert!((end - (2.0 * (4.0 / 3.0) * 0.125 * 0.125 / 0.5 - 1.0)).abs() < 1e-12, "{end}");
        let even = angle(Mirror::Oscillating, 0.5, 0.03);
        assert!((angle(Mirror::Turning, 0.0, 0.03) - even).abs() < 1e-12);
    }

    #[test]
    fn numbers_and_fractions_add_up_to_the_turns() {
        for (phase, time) in [(0.0, 0.3), (1.0, -0.7), (-3.0, 12.1)] {
            let turns = PARAMETERS.number(phase, time) as f64 + PARAMETERS.fraction(phase, time);
            assert!((turns - (2.0 * time + phase / TAU)).abs() < 1e-12, "{phase} {time}");
            assert!((0.0..1.0).contains(&PARAMETERS.fraction(phase, time)));
        }
    }
}
