//! Constants of a platform during a run.

use super::course::LegCourse;
use super::ground_vehicle;
use super::multicopter::MulticopterPlan;
use super::stream::StreamPlan;
use super::table::TrajectoryTable;
use vlscan_base::corrections::Corrections;
use vlscan_survey::{Multicopter, RotationSpec};

/// A platform as the flight simulation uses it: its motion model, legs and corrections.
#[derive(Clone, Debug)]
pub struct PlatformPlan {
    /// The motion model.
    pub motion: Motion,
    /// The legs that it visits, including those that interpolated platforms add.
    pub legs: Vec<LegCourse>,
    /// How the roll, pitch and yaw angles of a trajectory compose to an attitude.
    pub rotation_spec: RotationSpec,
    /// Corrections of the reference's kinematics that are enabled.
    pub kinematics: Corrections,
}

/// How a platform moves.
#[derive(Clone, Debug)]
pub enum Motion {
    /// Stands still at each leg.
    Static,
    /// Flies straight from leg to leg.
    Linear,
    /// Drives from leg to leg.
    GroundVehicle {
        /// Coefficient of drag per step.
        drag: f64,
    },
    /// Flies from leg to leg, tilting; one plan per leg, see [`Motion::multicopter`].
    Multicopter(Vec<MulticopterPlan>),
    /// Follows a table of recorded poses.
    Interpolated(TrajectoryTable),
    /// Follows poses as they arrive.
    Stream(StreamPlan),
}

impl Motion {
    /// A multicopter whose steps in angle follow from the first leg's pulse frequency, or, with
    /// [`Corrections::leg_pulse_rate`], from the frequency of each leg.
    pub fn multicopter(parameters: &Multicopter, legs: &[LegCourse], kinematics: &Corrections) -> Motion {
        let first = legs.first().map_or(1.0, |l| l.frequency);
        let frequency = |leg: &LegCourse| if kinematics.leg_pulse_rate { leg.frequency } else { first };
        let plans = legs.iter().map(|leg| MulticopterPlan::new(parameters.clone(), frequency(leg)));
        Motion::Multicopter(plans.collect())
    }
}

impl PlatformPlan {
    pub(crate) fn table(&self) -> Option<&TrajectoryTable> {
        match &self.motion {
            Motion::Interpolated(table) => Some(table),
            _ => None,
        }
    }

    pub(crate) fn has_waypoints(&self) -> bool {
        matches!(self.motion, Motion::Linear) || self.is_physical()
    }

    pub(crate) fn is_stream(&self) -> bool {
        matches!(self.motion, Motion::Stream(_))
    }

    /// True if the platform accelerates and steers, so that its time of arrival is known only by simulation.
    pub fn is_physical(&self) -> bool {
        matches!(self.motion, Motion::GroundVehicle { .. } | Motion::Multicopter(_))
    }

    /// The highest speed in m/s that the engine reaches against drag; infinite without drag or engine.
    pub fn terminal_speed(&self) -> f64 {
        match &self.motion {
            Motion::GroundVehicle { drag } => ground_vehicle::CRUISE_FORCE / drag,
            Motion::Multicopter(legs) => legs.first().map_or(f64::INFINITY, MulticopterPlan::terminal_speed),
            _ => f64::INFINITY,
        }
    }
}
