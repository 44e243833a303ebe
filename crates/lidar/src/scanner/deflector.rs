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
    /// User-defined pattern.
    Custom {
        /// Steps since the first one of the leg; a fraction between two steps.
        steps: f64,
        /// Time per step, s.
        step: f64,
        /// Direction of the beam, unit vector; NaN where the pattern has none.
        beam: DVec3,
        is_firing: bool,
    },
    /// Table of beams.
    Pattern {
        /// The next step of the table.
        next: u32,
        /// Row of the current beam; `None`: the current step has none.
        row: Option<u32>,
    },
}

impl DeflectorState {
    pub(super) fn at_rest(plan: &DevicePlan) -> DeflectorState {
        match &plan.deflector {
            Deflector::Polygon { .. } => DeflectorState::Polygon(Polygon::default()),
            Deflector::Oscillating { .. } => DeflectorState::Oscillating(Oscillating::default()),
            Deflector::Conic | Deflector::EllipticConic { .. } => {
                DeflectorState::Conic { turn: plan.motion.phase, step: 0.0, half_angle: 0.0, along: None }
            }
            Deflector::Fibres { count } => {
                let next = first_fibre(plan, (*count).max(1));
                DeflectorState::Fibres { angle: 0.0, next, count: 1, half_angle: 0.0 }
            }
            Deflector::Risley { .. } => {
                DeflectorState::Risley { time: start_time(plan), step: 0.0, last: None }
            }
            Deflector::Custom(_) => {
                DeflectorState::Custom { steps: -1.0, step: 0.0, beam: DVec3::Y, is_firing: true }
            }
            Deflector::Pattern(_) => DeflectorState::Pattern { next: 0, row: None },
        }
    }

    /// Applies a leg's settings. Angles are reset only where the spec says so; the others continue, with the
    /// correction `optics_on_time` from one step of the leg before to the first pulse of this one.
    pub(super) fn start_leg(&mut self, plan: &DevicePlan, settings: &ScannerSettings, frequency: f64) {
        let scan_angle = plan.scan_angle(settings.scan_angle);
        match (self, &plan.deflector) {
            (DeflectorState::Polygon(mirror), Deflector::Polygon { effective_max, .. }) => {
                *mirror = Polygon::new(plan, *effective_max, scan_angle, settings, frequency);
            }
            (DeflectorState::Oscillating(mirror), Deflector::Oscillating { scan_product }) => {
                mirror.start_leg(plan, scan_angle, settings.scan_freq, *scan_product, frequency);
            }
            (DeflectorState::Conic { turn, step, half_angle, along }, deflector) => {
                // The reference has no elliptic cones.
                let is_elliptic = matches!(deflector, Deflector::EllipticConic { .. });
                let at_leg_frequency = plan.kinematics.conic_at_leg_frequency || is_elliptic;
                let turns = if at_leg_frequency { settings.scan_freq } else { plan.scan_freq_max };
                let before = std::mem::replace(step, plan.sense() * (TAU * turns / frequency));
                if plan.kinematics.optics_on_time {
                    *turn += before - *step;
                }
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
            // Prisms are at their phase a step before the first pulse, with any correction.
            (DeflectorState::Risley { step, .. }, _) => *step = plan.sense() * (1.0 / frequency),
            (DeflectorState::Custom { steps, step, .. }, _) => (*steps, *step) = (-1.0, 1.0 / frequency),
            (DeflectorState::Pattern { next, row }, _) => (*next, *row) = (0, None),
            _ => {}
        }
    }

    /// Resets the angle to that of the phase, at an active leg after an inactive one (spec kinematics §4.1).
    /// In the reference fibres and prisms continue.
    pub(super) fn restart(&mut self, plan: &DevicePlan) {
        let is_on_time = plan.kinematics.optics_on_time;
        match self {
            DeflectorState::Polygon(mirror) => mirror.restart(plan),
            DeflectorState::Oscillating(mirror) => mirror.restart(plan),
            DeflectorState::Conic { turn, step, .. } => {
                *turn = plan.motion.phase - if is_on_time { *step } else { 0.0 };
            }
            DeflectorState::Fibres { angle, next, count, .. } => {
                *angle = 0.0;
                *next = if is_on_time { first_fibre(plan, *count) } else { *next };
            }
            DeflectorState::Risley { time, .. } if is_on_time => *time = start_time(plan),
            // Tables of beams begin in each leg.
            DeflectorState::Risley { .. }
            | DeflectorState::Custom { .. }
            | DeflectorState::Pattern { .. } => {}
        }
    }

    /// Turns of the deflector's phase per step, signed, and those that have passed at the next step since
    /// phase 0. `None` for fibres and tables of beams, which are a matter of pulses, not of time.
    pub(super) fn turns(&self, plan: &DevicePlan) -> Option<(f64, f64)> {
        match self {
            DeflectorState::Polygon(mirror) => Some(mirror.turns(plan)),
            DeflectorState::Oscillating(mirror) => Some(mirror.turns(plan)),
            DeflectorState::Conic { turn, step, .. } => Some((*step / TAU, (*turn + *step) / TAU)),
            DeflectorState::Risley { time, step, .. } => {
                let freq = plan.prism_freq();
                Some((*step * freq, (*time + *step) * freq))
            }
            DeflectorState::Custom { .. } => Some((0.0, 0.0)),
            DeflectorState::Fibres { .. } | DeflectorState::Pattern { .. } => None,
        }
    }

    /// Moves the deflector to where it is `turns` after phase 0, `seconds` after the start of the leg.
    pub(super) fn place(&mut self, plan: &DevicePlan, turns: f64, seconds: f64) {
        match self {
            DeflectorState::Polygon(mirror) => mirror.place_with_error(plan, turns),
            DeflectorState::Oscillating(mirror) => mirror.place(turns),
            DeflectorState::Conic { turn, .. } => *turn = TAU * (turns - turns.floor()),
            DeflectorState::Risley { time, last, .. } => {
                let freq = plan.prism_freq();
                *time = if freq == 0.0 { 0.0 } else { turns / freq };
                remember_beam(plan, *time, last);
            }
            DeflectorState::Custom { steps, step, .. } => {
                *steps = seconds / *step;
                self.advance_pattern(plan, 0.0);
            }
            DeflectorState::Fibres { .. } | DeflectorState::Pattern { .. } => {}
        }
    }

    /// True if the state depends on each of the steps that led to it, and not only on their number.
    pub(super) fn depends_on_steps(&self, plan: &DevicePlan) -> bool {
        match self {
            DeflectorState::Polygon(_) | DeflectorState::Custom { .. } => true,
            DeflectorState::Risley { .. } => plan.prisms.as_ref().is_some_and(|p| p.may_reflect_totally),
            _ => false,
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
                } else if *turn < 0.0 {
                    *turn = turn.rem_euclid(TAU);
                }
            }
            DeflectorState::Fibres { angle, next, count, half_angle } => {
                let from_edge = if plan.kinematics.centred_fibres { 0.5 } else { 0.0 };
                *angle =
                    -*half_angle + (f64::from(*next) + from_edge) * (2.0 * *half_angle / f64::from(*count));
                *next = match plan.motion.is_reversed {
                    false if *next + 1 < *count => *next + 1,
                    false => 0,
                    true => next.checked_sub(1).unwrap_or(*count - 1),
                };
            }
            DeflectorState::Risley { time, step, last } => {
                *time += *step;
                remember_beam(plan, *time, last);
            }
            DeflectorState::Custom { .. } => self.advance_pattern(plan, 1.0),
            DeflectorState::Pattern { next, row } => {
                if let Deflector::Pattern(table) = &plan.deflector {
                    (*row, *next) = (table.row(*next), table.step_after(*next, 1));
                }
            }
        }
    }

    /// Advances a user-defined pattern by `count` steps, which may be a fraction.
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

    /// The deflector `part` of a step later. The light stays in its fibre, and a beam of a table in its
    /// direction, for a whole step.
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
            DeflectorState::Fibres { .. } | DeflectorState::Pattern { .. } => {}
            DeflectorState::Custom { .. } => later.advance_pattern(plan, part),
        }
        later
    }

    /// Takes `steps` steps of a deflector without an error, and returns in how many of them it fires. The
    /// state is that after as many calls of [`step`](Self::step), bit for bit.
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
            DeflectorState::Pattern { next, row } => {
                let Deflector::Pattern(table) = &plan.deflector else { return 0 };
                let Some(last) = steps.checked_sub(1) else { return 0 };
                let fired = table.beams_within(*next, steps);
                let current = table.step_after(*next, last);
                (*row, *next) = (table.row(current), table.step_after(current, 1));
                return fired;
            }
            DeflectorState::Oscillating(mirror) => mirror.advance(steps),
            DeflectorState::Fibres { next, count, .. } if steps > 0 => {
                // The angle is that of the last fibre.
                let fibres = u64::from(*count);
                // A step back is one of all the others forward.
                let step = if plan.motion.is_reversed { fibres - 1 } else { 1 };
                *next = ((u64::from(*next) + u64::from(steps - 1) * step) % fibres) as u32;
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

    /// True if the device emits a pulse at the current angle.
    #[inline]
    pub fn is_firing(&self) -> bool {
        match self {
            DeflectorState::Polygon(mirror) => mirror.is_firing(),
            DeflectorState::Custom { is_firing, .. } => *is_firing,
            DeflectorState::Pattern { row, .. } => row.is_some(),
            _ => true,
        }
    }

    /// The angle without errors, of which error formulas are functions; 0 for Risley prisms and patterns.
    #[inline]
    pub fn exact_angle(&self) -> f64 {
        match self {
            DeflectorState::Polygon(mirror) => mirror.exact,
            DeflectorState::Oscillating(mirror) => mirror.angle,
            DeflectorState::Conic { turn, .. } => *turn,
            DeflectorState::Fibres { angle, .. } => *angle,
            DeflectorState::Risley { .. }
            | DeflectorState::Custom { .. }
            | DeflectorState::Pattern { .. } => 0.0,
        }
    }

    /// The scan angle of a pulse, rad: the angle in the scan plane; for two-dimensional patterns the
    /// component about x of `deflection`, the exact rotation.
    pub fn scan_angle(&self, deflection: &Rotation) -> f64 {
        match self {
            DeflectorState::Conic { .. }
            | DeflectorState::Risley { .. }
            | DeflectorState::Custom { .. }
            | DeflectorState::Pattern { .. } => {
                let beam = deflection.forward();
                libm::atan2(beam.z, beam.y)
            }
            _ => self.exact_angle(),
        }
    }

    /// Origin of the current beam in the frame of the emitter, m; `None` unless beams have origins.
    #[inline]
    pub fn beam_origin(&self, plan: &DevicePlan) -> Option<DVec3> {
        match (self, &plan.deflector) {
            (DeflectorState::Pattern { row, .. }, Deflector::Pattern(table)) if table.has_origins() => {
                row.map(|row| table.origin(row))
            }
            _ => None,
        }
    }

    /// True if the beam has an error of its angle.
    pub fn has_error(&self) -> bool {
        matches!(self, DeflectorState::Polygon(mirror) if mirror.angle != mirror.exact)
    }

    /// The deflection with its error.
    pub fn rotation(&self, plan: &DevicePlan) -> Rotation {
        match self {
            DeflectorState::Polygon(mirror) => tilted(plan, reflected(mirror.angle, mirror.tilt(plan))),
            _ => self.exact_rotation(plan),
        }
    }

    /// The deflection without errors.
    #[inline]
    pub fn exact_rotation(&self, plan: &DevicePlan) -> Rotation {
        tilted(plan, self.deflection(plan))
    }

    /// The deflection without errors about an axis that is not tilted.
    fn deflection(&self, plan: &DevicePlan) -> Rotation {
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
            DeflectorState::Pattern { row: Some(row), .. } => match &plan.deflector {
                Deflector::Pattern(table) => table.attitude(*row),
                _ => Rotation::IDENTITY,
            },
            _ => Rotation::about_x(self.exact_angle()),
        }
    }
}

/// The deflection about the tilted axis of the device.
#[inline]
fn tilted(plan: &DevicePlan, deflection: Rotation) -> Rotation {
    plan.axis_tilt.map_or(deflection, |tilt| tilt.after(deflection))
}

/// The fibre, of `count`, that the light takes first.
fn first_fibre(plan: &DevicePlan, count: u32) -> u32 {
    // Rounding up to the whole sequence is its first fibre.
    (plan.start_turns() * f64::from(count)).round() as u32 % count
}

/// The time at which the first prism that turns has its phase, s.
fn start_time(plan: &DevicePlan) -> f64 {
    let freq = plan.prism_freq();
    if freq == 0.0 { 0.0 } else { plan.start_turns() / freq }
}

/// Keeps the direction behind prisms that may reflect it totally; without total reflection it is computed
/// only for pulses.
#[inline]
fn remember_beam(plan: &DevicePlan, time: f64, last: &mut Option<DVec3>) {
    if let Some(prisms) = plan.prisms.as_ref().filter(|p| p.may_reflect_totally) {
        *last = prisms.refract(time).or(*last);
    }
}

/// The deflection of a polygon mirror at this angle, whose facet turns the beam by `tilt` towards +x, along
/// the axis.
#[inline]
fn reflected(angle: f64, tilt: f64) -> Rotation {
    let across = Rotation::about_x(angle);
    if tilt == 0.0 { across } else { across.after(Rotation::about_z(-tilt)) }
}

#[cfg(test)]
mod tests;
