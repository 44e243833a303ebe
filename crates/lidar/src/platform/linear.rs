//! Straight flight from waypoint to waypoint (spec kinematics §2.3).

use super::course::{Course, LegCourse, LegEntry, align, facing};
use serde::{Deserialize, Serialize};
use vlscan_base::corrections::Corrections;
use vlscan_geom::{DVec3, Rotation, spacing, steps_in_binade, unit};

#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct LinearPath {
    pub(super) course: Course,
    pub(super) attitude: Rotation,
}

impl Default for LinearPath {
    fn default() -> LinearPath {
        LinearPath { course: Course::default(), attitude: Rotation::IDENTITY }
    }
}

impl LinearPath {
    /// Aligns with the leg's target; the reference aligns twice in the first leg of a run.
    pub(super) fn start_leg(
        &mut self,
        legs: &[LegCourse],
        leg: usize,
        entry: LegEntry,
        kinematics: &Corrections,
    ) {
        let corner = self.course.target;
        let left = self.course.time_left_at_target().filter(|_| entry == LegEntry::Continuing);
        let assigned = self.course.start_leg(legs, leg, entry);
        let mut way = self.course.to_target();
        if kinematics.sharp_corners && legs[leg].speed <= 0.0 {
            // The reference flies on with the velocity of the leg before.
            if left.is_some() {
                self.course.position = corner;
            }
            self.course.velocity = DVec3::ZERO;
        } else if kinematics.sharp_corners
            && assigned
            && let (Some(left), Some(before)) = (left, leg.checked_sub(1))
        {
            // Flies the rest of the step along the new leg, at most to its end.
            way = self.course.target - corner;
            let beyond = (left * legs[leg].speed / legs[before].frequency).min(way.length());
            let ahead = if beyond > 0.0 { unit(way) * beyond } else { DVec3::ZERO };
            self.course.velocity = corner - self.course.position + ahead;
        }
        if kinematics.heading_along_leg {
            if assigned {
                self.attitude = facing(way).unwrap_or(self.attitude);
            }
            return;
        }
        if assigned {
            self.attitude = align(self.attitude, self.course.to_target());
        }
        if entry == LegEntry::Initial {
            self.attitude = align(self.attitude, self.course.to_target());
        }
    }

    #[inline]
    pub(super) fn step(&mut self, leg: &LegCourse) {
        let c = &mut self.course;
        c.position += c.velocity;
        let q = c.to_target();
        if q.dot(q) > 0.0 && leg.speed > 0.0 {
            c.velocity = unit(q) * leg.step_length;
        }
    }

    /// Takes the first or a later step of a leg, which is `steps` steps of the leg's mean rate after the
    /// start of the leg or the step before it.
    pub(super) fn step_by(&mut self, leg: &LegCourse, steps: f64, is_first: bool) {
        if is_first {
            self.step(leg);
        }
        let c = &mut self.course;
        let way = c.to_target();
        // Beyond the target it would turn round.
        let far = (c.velocity * steps).length();
        c.position = if far < way.length() { c.position + c.velocity * steps } else { c.target };
        let left = c.to_target();
        if left.dot(left) > 0.0 && leg.speed > 0.0 {
            c.velocity = unit(left) * leg.step_length;
        }
    }

    /// Number of steps, rounded down, after which the target is still farther than a step; 0 or less near it,
    /// and 0 unless the velocity is that of this leg.
    pub(super) fn steps_to_target(&self, leg: &LegCourse) -> f64 {
        let q = self.course.to_target();
        let is_cruising = leg.speed > 0.0 && self.course.velocity == unit(q) * leg.step_length;
        if is_cruising { (q.length() / leg.step_length * (1.0 - 1e-6)).floor() - 4.0 } else { 0.0 }
    }

    /// Takes `steps` steps, at most [`steps_to_target`](Self::steps_to_target). Position and velocity are
    /// those of as many calls of [`step`](Self::step), bit for bit.
    pub(super) fn advance(&mut self, leg: &LegCourse, mut steps: u32) {
        let mut single = MIN_SINGLE_STEPS;
        while steps > 0 {
            let equal = self.equal_steps(leg, steps);
            if equal >= MIN_EQUAL_STEPS {
                let c = &mut self.course;
                // Exact: see `equal_steps`.
                c.position += ((c.position + c.velocity) - c.position) * f64::from(equal);
                c.velocity = unit(c.to_target()) * leg.step_length;
                steps -= equal;
            } else {
                // Increments that alternate do so for long.
                single = (2 * single).min(steps);
                self.advance_by_prediction(leg, single);
                steps -= single;
            }
        }
    }

    /// As many calls of [`step`](Self::step), of which [`LANES`] are computed side by side.
    ///
    /// A step waits for the square root and the division of the step before. The velocity, though, hardly
    /// changes, and where it does its last bits alternate. So the next positions are predicted from the last
    /// two velocities, the velocities at all predicted positions computed at once, and the positions compared
    /// with what these velocities give: up to the first difference the prediction was right, bit for bit.
    fn advance_by_prediction(&mut self, leg: &LegCourse, mut steps: u32) {
        let c = &mut self.course;
        let (target, mut before) = (c.target, c.velocity);
        while steps >= LANES as u32 {
            let mut position = [[0.0; LANES]; 3];
            for (axis, lanes) in position.iter_mut().enumerate() {
                // The first one is not a prediction.
                let mut at = c.position[axis] + c.velocity[axis];
                for (lane, place) in lanes.iter_mut().enumerate() {
                    *place = at;
                    at += if lane % 2 == 0 { before[axis] } else { c.velocity[axis] };
                }
            }
            let velocity = velocities(&position, target, leg.step_length);
            let right = correct_lanes(&position, &velocity);
            let at = |[x, y, z]: &[[f64; LANES]; 3], lane: usize| DVec3::new(x[lane], y[lane], z[lane]);
            before = if right >= 2 { at(&velocity, right - 2) } else { c.velocity };
            (c.position, c.velocity) = (at(&position, right - 1), at(&velocity, right - 1));
            steps -= right as u32;
        }
        (0..steps).for_each(|_| self.step(leg));
    }

    /// Number of steps, up to `requested`, that certainly change the position by the same increment each.
    ///
    /// The velocity v = s·q/|q|, with q the way to the target and s the length of a step, hardly changes
    /// along a straight path. Adding it to a coordinate rounds to a multiple of the spacing d of the
    /// coordinate's binade. So the increment stays the same multiple, r, as long as v stays within d/2 of it.
    ///
    /// After n steps of r, which leave the line to the target by less than n·|r − v| sideways, the direction
    /// has turned by less than n·|r − v|/|q − n·r|. Rounding errors of computed velocities are below 2⁻⁴⁸·s:
    /// ten operations with relative errors of up to 2⁻⁵³ each, at both ends. The margins cover the rounding
    /// errors of this estimate.
    fn equal_steps(&self, leg: &LegCourse, requested: u32) -> u32 {
        let Course { position, velocity, .. } = self.course;
        let increment = (position + velocity) - position;
        // Distance of the velocity from where it would round to another increment, as far as the leg needs
        // it.
        let mut room = f64::INFINITY;
        let mut steps = f64::from(requested);
        for axis in 0..3 {
            if velocity[axis] == 0.0 {
                // Along an axis without motion the increment is 0 only as long as the target has the same
                // coordinate.
                if self.course.to_target()[axis] != 0.0 {
                    return 0;
                }
                continue;
            }
            let Some(spacing) = spacing(position[axis]) else { return 0 };
            room = room.min(0.5 * spacing - (velocity[axis] - increment[axis]).abs());
            steps = steps.min(steps_in_binade(position[axis], increment[axis]));
        }
        let length = leg.step_length;
        let drift = (increment - velocity).length() + length * ROUNDING;
        let (way, speed) = (self.course.to_target().length(), length.max(increment.length()));
        let stays = |steps: f64| {
            let turn = 1.01 * steps * drift / (way - 1.01 * steps * speed);
            (0.0..0.1).contains(&turn) && length * (1.01 * turn + ROUNDING) < room
        };
        while steps >= f64::from(MIN_EQUAL_STEPS) {
            if stays(steps) {
                return steps as u32;
            }
            steps = (steps * 0.25).floor();
        }
        0
    }
}

/// `unit(target - position) * step` for every lane, in the same order of operations.
#[inline]
fn velocities(position: &[[f64; LANES]; 3], target: DVec3, step: f64) -> [[f64; LANES]; 3] {
    let mut way = [[0.0; LANES]; 3];
    for axis in 0..3 {
        for lane in 0..LANES {
            way[axis][lane] = target[axis] - position[axis][lane];
        }
    }
    let mut scale = [0.0; LANES];
    for lane in 0..LANES {
        let (x, y, z) = (way[0][lane], way[1][lane], way[2][lane]);
        scale[lane] = 1.0 / (x * x + y * y + z * z).sqrt();
    }
    for lanes in &mut way {
        for lane in 0..LANES {
            lanes[lane] = lanes[lane] * scale[lane] * step;
        }
    }
    way
}

/// Number of lanes, from the first on, whose position follows from the lane before, bit for bit.
#[inline]
fn correct_lanes(position: &[[f64; LANES]; 3], velocity: &[[f64; LANES]; 3]) -> usize {
    let mut differs = [0; LANES];
    for (at, step) in position.iter().zip(velocity) {
        for lane in 1..LANES {
            differs[lane] |= (at[lane - 1] + step[lane - 1]).to_bits() ^ at[lane].to_bits();
        }
    }
    // One branch where all are correct.
    let any = differs.iter().fold(0, |any, bits| any | bits);
    if any == 0 { LANES } else { differs.iter().position(|bits| *bits != 0).unwrap_or(LANES) }
}

/// Number of steps that are predicted at once.
const LANES: usize = 8;
/// Fewer equal steps are taken one by one.
const MIN_EQUAL_STEPS: u32 = 8;
/// Half of the steps that are taken one by one before equal steps are looked for again; doubled each time in
/// vain.
const MIN_SINGLE_STEPS: u32 = 16;
/// Bound of the relative rounding error of a velocity, with a margin.
const ROUNDING: f64 = 1.0 / (1u64 << 48) as f64;
