//! Legs with their resolved settings of platform and scanner.

use super::platform::Mount;
use super::pulse_times::PulseTimes;
use super::weather::Weather;
use vlscan_base::diag::Place;
use vlscan_geom::{DVec3, radians};

/// A leg of a survey: a waypoint or standpoint, with the settings from there on.
#[derive(Clone, Debug)]
pub struct Leg {
    /// Index among the survey's legs, from 0.
    pub number: u32,
    /// Legs with the same strip share their output files.
    pub strip: Option<String>,
    /// Settings of the platform.
    pub platform: PlatformSettings,
    /// Settings of the scanner.
    pub scanner: ScannerSettings,
    /// Place of the leg in its file, for messages.
    pub place: Option<Place>,
}

/// Resolved platform settings of a leg (spec input-formats §2.4).
#[derive(Clone, Debug)]
pub struct PlatformSettings {
    /// World position of the leg's start, m.
    pub position: DVec3,
    /// True if z is replaced by the ground height.
    pub on_ground: bool,
    /// Speed, m/s.
    pub speed: f64,
    /// True if the speed is written, and not the default.
    pub has_speed: bool,
    /// Multicopter: stop and turn at the waypoint.
    pub stop_and_turn: bool,
    /// Multicopter: curve through the waypoint.
    pub smooth_turn: bool,
    /// Multicopter: brake before the waypoint.
    pub slowdown: bool,
    /// Multicopter with stop-and-turn: yaw to adopt, rad.
    pub yaw_at_departure: Option<f64>,
    /// Interpolated platforms: the flown part of a trajectory file.
    pub trajectory: Option<LegTrajectory>,
    /// Mount of the scanner in this leg; `None`: the platform's.
    pub mount: Option<Mount>,
}

/// The part of a trajectory that a leg flies.
#[derive(Clone, Debug)]
pub struct LegTrajectory {
    /// Index into [`crate::Interpolated::files`].
    pub file: usize,
    /// Start in the file's own time, s; `None` = first sample.
    pub start: Option<f64>,
    /// End in the file's own time, s; `None` = last sample.
    pub end: Option<f64>,
    /// True if the platform jumps to the start instead of travelling to it.
    pub teleport: bool,
}

/// Resolved scanner settings of a leg (spec input-formats §2.5–2.6): templates, the scanner's default values
/// and the resolution settings have been applied.
#[derive(Clone)]
pub struct ScannerSettings {
    /// True if the scanner fires; inactive legs emit no pulses.
    pub active: bool,
    /// Pulses per second; the rounded mean if `pulse_times` is given.
    pub pulse_freq: u32,
    /// Times at which pulses leave, in place of the constant rate.
    pub pulse_times: Option<PulseTimes>,
    /// Lines (rotating) or periods (oscillating) per second.
    pub scan_freq: f64,
    /// Half opening angle, rad; 0 = the device's maximum (rotating, conic, fibres).
    pub scan_angle: f64,
    /// Lower limit of the deflection angles that fire, rad.
    pub vertical_min: Option<f64>,
    /// Upper limit of the deflection angles that fire, rad.
    pub vertical_max: Option<f64>,
    /// Head speed, rad/s, signed, not yet limited by the device.
    pub head_rate: f64,
    /// Head start angle, rad.
    pub head_start: f64,
    /// Head stop angle, rad.
    pub head_stop: f64,
    /// Beam divergence of device 0, rad.
    pub beam_divergence: f64,
    /// Divergence that the leg specifies, rad, where the reference treats its value (0.003) as "not given".
    pub written_divergence: Option<f64>,
    /// Spacing of trajectory samples, s; 0 = none.
    pub trajectory_interval: f64,
    /// Simulated time after which the leg ends, s.
    pub max_duration: Option<f64>,
    /// Time for which head and deflector move before the first pulse, s.
    pub warmup: f64,
    /// Fog, rain, snow and dust along the beam.
    pub weather: Weather,
}

impl ScannerSettings {
    /// Sets the speed of the head, degrees per second, and the angles at which it starts and stops, degrees.
    pub fn set_head_turn_deg(&mut self, rate: f64, start: f64, stop: f64) {
        (self.head_rate, self.head_start, self.head_stop) = (radians(rate), radians(start), radians(stop));
    }

    /// Sets the half opening angle, degrees.
    pub fn set_scan_angle_deg(&mut self, angle: f64) {
        self.scan_angle = radians(angle);
    }

    /// Sets the deflection angles between which the scanner fires, degrees.
    pub fn set_vertical_limits_deg(&mut self, min: f64, max: f64) {
        (self.vertical_min, self.vertical_max) = (Some(radians(min)), Some(radians(max)));
    }

    /// Mean number of pulses per second.
    pub fn pulse_rate(&self) -> f64 {
        self.pulse_times.as_ref().map_or(f64::from(self.pulse_freq), PulseTimes::mean_rate)
    }
}
