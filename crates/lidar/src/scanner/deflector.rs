//! Beam deflectors (spec kinematics §4).

use super::oscillating::Oscillating;
use super::plan::DevicePlan;
use super::polygon::Polygon;
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;
use vlscan_geom::{DVec3, Rotation, add_repeatedly};
use vlscan_survey::{Deflector, ScannerSettings};

/// Angle of a deflector and its motion per step of the current leg. Angles are rad.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub enum DeflectorState {
    /// Polygon mirror.
    Polygon(Polygon),
    /// Oscillating mirror.
    Oscillating(Oscillating),
    /// Palmer scanner.
    Conic {
        /// Angle around the cone.
        turn: f64,
        /// Angle per step.
        step: f64,
        /// Half opening angle.
        half_angle: f64,
        /// Tangent of the half angle at right angles to it, for an elliptic cone.
        along: Option<f64>,
    },
    /// Fibre array.
    Fibres {
        /// Current deflection.
        angle: f64,
        next: u32,
        count: u32,
        /// Half opening angle.
        half_angle: f64,
    },
    /// Risley prisms.
    Risley {
        /// Time since all prisms were at angle 0, s.
        time: f64,
        /// Time per step, s.
        step: f64,
        /// The last direction that left the prisms, where total reflection is possible.
        last: Option<DVec3>,
    },
    /// A pattern of a program's own.
    Custom {
        /// Steps since the first one of the leg; a fraction between two steps.
        steps: f64,
        /// Time per step, s.
        step: f64,
        /// Direction of the beam, unit vector; NaN where the pattern has none.
        beam: DVec3,
        is_firing: bool,
    },
}

impl DeflectorState {
    pub(super) fn at_rest(deflector: &Deflector) -> DeflectorState {
        match deflector {
            Deflector::Polygon { .. } => DeflectorState::Polygon(Polygon::default()),
            Deflector::Oscillating { .. } => DeflectorState::Oscillating(Oscillating::default()),
            Deflector::Conic | Deflector::EllipticConic { .. } => {
                DeflectorState::Conic { turn: 0.0, step: 0.0, half_angle: 0.0, along: None }
            }
            Deflector::Fibres { .. } => {
                DeflectorState::Fibres { angle: 0.0, next: 0, count: 1, half_angle: 0.0 }
            }
            Deflector::Risley { .. } => DeflectorState::Risley { time: 0.0, step: 0.0, last: None },
            Deflector::Custom(_) => {
                DeflectorState::Custom { steps: -1.0, step: 0.0, beam: DVec3::Y, is_firing: true }
            }
        }
    }

    /// Applies a leg's settings. Angles are reset only where the spec says so.
    pub(super) fn start_leg(&mut self, plan: &DevicePlan, settings: &ScannerSettings, frequency: f64) {
        let scan_angle = plan.scan_angle(settings.scan_angle);
        match (self, &plan.deflector) {
            (DeflectorState::Polygon(mirror), Deflector::Polygon { effective_max, .. }) => {
                *mirror = Polygon::new(*effective_max, plan.scan_angle_max, scan_angle, settings, frequency);
            }
            (DeflectorState::Oscillating(mirror), Deflector::Oscillating { scan_product }) => {
                let corrected = plan.kinematics.oscillation_at_leg_frequency;
                mirror.start_leg(scan_angle, settings.scan_freq, *scan_product, frequency, corrected);
            }
            (DeflectorState::Conic { step, half_angle, along, .. }, deflector) => {
                // The reference has no elliptic cones.
                let is_elliptic = matches!(deflector, Deflector::EllipticConic { .. });
                let at_leg_frequency = plan.kinematics.conic_at_leg_frequency || is_elliptic;
                let turns = if at_leg_frequency { settings.scan_freq } else { plan.scan_freq_max };
                *step = TAU * turns / frequency;
                *half_angle = scan_angle;
                if let Deflector::EllipticConic { along_max } = deflector {
                    // A smaller scan angle shrinks the ellipse as a whole.
                    *along =
                        Some(libm::tan(scan_angle) * libm::tan(*along_max) / libm::tan(plan.scan_angle_max));
                }
            }
            (DeflectorState::Fibres { count, half_angle, next, .. }, Deflector::Fibres { count: fibres }) => {
                *count = (*fibres).max(1);
                *next %= *count;
                *half_angle = scan_angle;
            }
            (DeflectorState::Risley { step, .. }, _) => *step = 1.0 / frequency,
            (DeflectorState::Custom { steps, step, .. }, _) => (*steps, *step) = (-1.0, 1.0 / frequency),
            _ => {}
        }
    }

    /// Resets the angle to 0, at an active leg after an inactive one (spec kinematics §4.1).
    pub fn restart(&mut self) {
        match self {
            DeflectorState::Polygon(mirror) => (mirror.angle, mirror.exact) = (0.0, 0.0),
            DeflectorState::Oscillating(mirror) => (mirror.angle, mirror.count) = (0.0, 0),
            DeflectorState::Conic { turn, .. } => *turn = 0.0,
            DeflectorState::Fibres { angle, .. } => *angle = 0.0,
            DeflectorState::Risley { .. } | DeflectorState::Custom { .. } => {}
        }
    }

    #[inline]
    pub fn step(&mut self, plan: &DevicePlan) {
        match self {
            DeflectorState::Polygon(mirror) => mirror.step(plan),
            DeflectorState::Oscillating(mirror) => mirror.step(),
            DeflectorState::Conic { turn, step, .. } => {
                *turn += *step;
                if *turn >= TAU {
                    *turn %= TAU;
                }
            }
            DeflectorState::Fibres { angle, next, count, half_angle } => {
                let from_edge = if plan.kinematics.centred_fibres { 0.5 } else { 0.0 };
                *angle =
                    -*half_angle + (f64::from(*next) + from_edge) * (2.0 * *half_angle / f64::from(*count));
                *next = if *next + 1 < *count { *next + 1 } else { 0 };
            }
            DeflectorState::Risley { time, step, last } => {
                *time += *step;
                // Without total reflection the direction is computed only for pulses.
                if let Some(prisms) = plan.prisms.as_ref().filter(|p| p.may_reflect_totally) {
                    *last = prisms.refract(*time).or(*last);
                }
            }
            DeflectorState::Custom { .. } => self.advance_pattern(plan, 1.0),
        }
    }

    /// Moves a pattern of a program's own on by `count` steps or a fraction of one.
    fn advance_pattern(&mut self, plan: &DevicePlan, count: f64) {
        if let (DeflectorState::Custom { steps, step, beam, is_firing }, Deflector::Custom(pattern)) =
            (self, &plan.deflector)
        {
            *steps += count;
            let time = *steps * *step;
            *is_firing = pattern.is_firing(time);
            *beam = pattern.direction(time).try_normalize().unwrap_or(DVec3::NAN);
        }
    }

    /// The deflector `part` of a step later. The light stays in its fibre for a whole step.
    pub fn within_step(&self, plan: &DevicePlan, part: f64) -> DeflectorState {
        let mut later = self.clone();
        match &mut later {
            DeflectorState::Polygon(mirror) => {
                mirror.slow_down(part);
                mirror.step(plan);
            }
            DeflectorState::Oscillating(mirror) => {
                let now = mirror.angle;
                mirror.step();
                mirror.angle = now + (mirror.angle - now) * part;
            }
            DeflectorState::Conic { step, .. } | DeflectorState::Risley { step, .. } => {
                *step *= part;
                later.step(plan);
            }
            DeflectorState::Fibres { .. } => {}
            DeflectorState::Custom { .. } => later.advance_pattern(plan, part),
        }
        later
    }

    /// Takes `steps` steps of a deflector without an error, and returns in how many of them it fires. The state is that
    /// after as many calls of [`step`](Self::step), bit for bit.
    pub fn advance(&mut self, plan: &DevicePlan, steps: u32) -> u32 {
        match self {
            DeflectorState::Polygon(mirror) => return mirror.advance(plan, steps),
            DeflectorState::Custom { .. } => {
                let is_firing = |state: &mut DeflectorState| {
                    state.step(plan);
                    u32::from(state.is_firing())
                };
                return (0..steps).map(|_| is_firing(self)).sum();
            }
            DeflectorState::Oscillating(mirror) => mirror.advance(steps),
            DeflectorState::Fibres { next, count, .. } if steps > 0 => {
                // The angle is that of the last fibre.
                *next = ((u64::from(*next) + u64::from(steps - 1)) % u64::from(*count)) as u32;
                self.step(plan);
            }
            DeflectorState::Risley { time, step, .. }
                if plan.prisms.as_ref().is_none_or(|prisms| !prisms.may_reflect_totally) =>
            {
                *time = add_repeatedly(*time, *step, steps);
            }
            _ => (0..steps).for_each(|_| self.step(plan)),
        }
        steps
    }

    /// Whether the device emits a pulse at the current angle.
    #[inline]
    pub fn is_firing(&self) -> bool {
        match self {
            DeflectorState::Polygon(mirror) => mirror.is_firing(),
            DeflectorState::Custom { is_firing, .. } => *is_firing,
            _ => true,
        }
    }

    /// The angle without errors, of which error formulas are functions; 0 for Risley prisms and patterns of a program's own.
    #[inline]
    pub fn exact_angle(&self) -> f64 {
        match self {
            DeflectorState::Polygon(mirror) => mirror.exact,
            DeflectorState::Oscillating(mirror) => mirror.angle,
            DeflectorState::Conic { turn, .. } => *turn,
            DeflectorState::Fibres { angle, .. } => *angle,
            DeflectorState::Risley { .. } | DeflectorState::Custom { .. } => 0.0,
        }
    }

    /// The scan angle of a pulse, rad: the angle in the scan plane; for two-dimensional patterns the component about x
    /// of `deflection`, the exact rotation.
    pub fn scan_angle(&self, deflection: &Rotation) -> f64 {
        match self {
            DeflectorState::Conic { .. } | DeflectorState::Risley { .. } | DeflectorState::Custom { .. } => {
                let beam = deflection.forward();
                libm::atan2(beam.z, beam.y)
            }
            _ => self.exact_angle(),
        }
    }

    pub fn has_error(&self) -> bool {
        matches!(self, DeflectorState::Polygon(mirror) if mirror.angle != mirror.exact)
    }

    pub fn rotation(&self, plan: &DevicePlan) -> Rotation {
        match self {
            DeflectorState::Polygon(mirror) => reflected(mirror.angle, mirror.tilt(plan)),
            _ => self.exact_rotation(plan),
        }
    }

    pub fn exact_rotation(&self, plan: &DevicePlan) -> Rotation {
        match self {
            DeflectorState::Conic { turn, half_angle, along: Some(along), .. } => {
                let (sin, cos) = libm::sincos(*turn);
                let beam = DVec3::new(along * sin, 1.0, libm::tan(*half_angle) * cos);
                Rotation::between(DVec3::Y, beam)
            }
            DeflectorState::Conic { turn, half_angle, .. } => {
                Rotation::about_y(*turn).after(Rotation::about_x(*half_angle))
            }
            DeflectorState::Risley { time, last, .. } => {
                let beam = match &plan.prisms {
                    Some(prisms) if !prisms.may_reflect_totally => prisms.refract(*time),
                    _ => *last,
                };
                beam.map_or(Rotation::IDENTITY, |b| Rotation::between(DVec3::Y, b))
            }
            DeflectorState::Polygon(mirror) => reflected(mirror.exact, mirror.tilt(plan)),
            DeflectorState::Custom { beam, .. } => Rotation::between(DVec3::Y, *beam),
            _ => Rotation::about_x(self.exact_angle()),
        }
    }
}

/// The deflection of a polygon mirror at this angle, whose facet turns the beam by `tilt` towards +x, along the axis.
#[inline]
fn reflected(angle: f64, tilt: f64) -> Rotation {
    let across = Rotation::about_x(angle);
    if tilt == 0.0 { across } else { across.after(Rotation::about_z(-tilt)) }
}

#[cfg(test)]
mod tests;
