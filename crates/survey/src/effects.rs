//! Settings of legs that the scanner or the platform limits, replaces or does not have. Each is a warning that names
//! what is used instead.

use super::context::Context;
use super::{Deflector, Device, Leg, PlatformKind, Survey};
use vlscan_base::diag::Place;
use vlscan_base::quantity::number;
use vlscan_geom::degrees;

/// A setting of a leg by its names in surveys and in pipeline files.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Setting {
    pub xml: &'static str,
    pub toml: &'static str,
    /// The element of a leg that has it.
    pub tag: &'static str,
}

const fn setting(xml: &'static str, toml: &'static str) -> Setting {
    Setting { xml, toml, tag: "scannerSettings" }
}

const fn of_platform(xml: &'static str, toml: &'static str) -> Setting {
    Setting { xml, toml, tag: "platformSettings" }
}

pub(super) const SCAN_FREQ: Setting = setting("scanFreq_hz", "scan_freq_hz");
pub(super) const SCAN_ANGLE: Setting = setting("scanAngle_deg", "scan_angle_deg");
pub(super) const VERTICAL_MIN: Setting = setting("verticalAngleMin_deg", "vertical_angle_min_deg");
pub(super) const VERTICAL_MAX: Setting = setting("verticalAngleMax_deg", "vertical_angle_max_deg");
pub(super) const HEAD_RATE: Setting = setting("headRotatePerSec_deg", "head_rate_deg_per_s");
pub(super) const HEAD_START: Setting = setting("headRotateStart_deg", "head_start_deg");
pub(super) const HEAD_STOP: Setting = setting("headRotateStop_deg", "head_stop_deg");
pub(super) const PULSE_FREQ: Setting = setting("pulseFreq_hz", "pulse_freq_hz");
pub(super) const MAX_DURATION: Setting = setting("maxDuration_s", "max_duration_s");
const BEAM_DIVERGENCE: Setting = setting("beamDivergence_rad", "beam_divergence_rad");
const POSITION: Setting = of_platform("x", "position_m");
const ON_GROUND: Setting = of_platform("onGround", "on_ground");
const SPEED: Setting = of_platform("movePerSec_m", "speed_m_per_s");
const STOP_AND_TURN: Setting = of_platform("stopAndTurn", "");
const SMOOTH_TURN: Setting = of_platform("smoothTurn", "");
const SLOWDOWN: Setting = of_platform("slowdownEnabled", "");
const YAW_AT_DEPARTURE: Setting = of_platform("yawAtDeparture_deg", "");

impl Setting {
    /// Its name in the file of a place.
    pub fn name_at(self, place: Option<&Place>) -> &'static str {
        let is_pipeline =
            place.is_some_and(|p| p.path.extension().is_some_and(|e| e.eq_ignore_ascii_case("toml")));
        if is_pipeline && !self.toml.is_empty() { self.toml } else { self.xml }
    }
}

/// Where a setting of a leg, by its index, is written.
pub(super) type Places<'a> = &'a dyn Fn(usize, Setting) -> Option<Place>;

/// Speed of legs that name none, m/s.
const DEFAULT_SPEED: f64 = 70.0;
/// Largest angle that is looked at as one in radians: a turn.
const MAX_RADIANS: f64 = 6.3;
/// Ratio from which a scan angle is far below that of the scanner.
const FAR_BELOW: f64 = 20.0;

/// Warns of settings without effect in all legs.
pub(super) fn check_effects(context: &Context, survey: &Survey, places: Places) {
    let is_flown = matches!(survey.platform.kind, PlatformKind::Stream(_));
    for (index, leg) in survey.legs.iter().enumerate() {
        let check = LegCheck { context, survey, leg, index, places };
        if !is_flown {
            check.platform();
        }
        if leg.scanner.active {
            check.head();
            check.radians();
            check.deflection();
            check.divergence();
        }
    }
}

struct LegCheck<'a> {
    context: &'a Context,
    survey: &'a Survey,
    leg: &'a Leg,
    index: usize,
    places: Places<'a>,
}

impl LegCheck<'_> {
    fn devices(&self) -> &[Device] {
        &self.survey.scanner.devices
    }

    /// Warns of a setting; `message` follows its name.
    fn warn(&self, setting: Setting, message: &str) {
        let place = (self.places)(self.index, setting).or_else(|| self.leg.place.clone());
        let name = setting.name_at(place.as_ref());
        let message = match &place {
            Some(_) => format!("`{name}` {message}"),
            None => format!("leg {}: `{name}` {message}", self.leg.number),
        };
        self.context.warn_help(place, message, "");
    }

    fn platform(&self) {
        let (kind, p) = (&self.survey.platform.kind, &self.leg.platform);
        let because = format!("on a platform of type {}", kind.name());
        let no_effect = format!("has no effect {because}");
        let has_waypoints = matches!(
            kind,
            PlatformKind::LinearPath | PlatformKind::GroundVehicle { .. } | PlatformKind::Multicopter(_)
        );
        if p.speed != DEFAULT_SPEED && p.speed != 0.0 && !has_waypoints {
            self.warn(SPEED, &no_effect);
        }
        if matches!(kind, PlatformKind::Interpolated(_)) {
            if p.position.length_squared() > 0.0 {
                self.warn(POSITION, &format!("{no_effect}: positions come from its trajectory"));
            }
            if p.on_ground {
                self.warn(ON_GROUND, &format!("{no_effect}: heights come from its trajectory"));
            }
        }
        if matches!(kind, PlatformKind::Multicopter(_)) {
            if p.yaw_at_departure.is_some() && !p.stop_and_turn {
                self.warn(YAW_AT_DEPARTURE, "has no effect where the platform does not stop");
            }
            return;
        }
        let turns = [
            (!p.stop_and_turn && !p.smooth_turn, STOP_AND_TURN),
            (p.smooth_turn, SMOOTH_TURN),
            (!p.slowdown, SLOWDOWN),
            (p.yaw_at_departure.is_some(), YAW_AT_DEPARTURE),
        ];
        turns.into_iter().filter(|turn| turn.0).for_each(|turn| self.warn(turn.1, &no_effect));
    }

    fn head(&self) {
        let wanted = self.leg.scanner.head_rate;
        let limit = self.devices().iter().map(|d| d.head.max_rate).fold(f64::INFINITY, f64::min);
        if wanted.abs() <= limit {
            return;
        }
        if limit == 0.0 {
            return self.warn(HEAD_RATE, "has no effect: the scanner's head does not turn");
        }
        let (wanted, limit) = (number(degrees(wanted)), number(degrees(limit)));
        self.warn(
            HEAD_RATE,
            &format!("of {wanted} °/s is beyond the scanner's limit; its head turns by {limit} °/s"),
        );
    }

    /// Angles that are round numbers of degrees if they are read as radians.
    fn radians(&self) {
        let s = &self.leg.scanner;
        let max = self.devices().iter().map(|d| d.scan_angle_max).fold(0.0, f64::max);
        let doubt = |setting, angle: f64| {
            let written = degrees(angle);
            let (written, meant) = (number(written), number(degrees(written)));
            self.warn(setting, &format!("is {written} degrees; {written} rad would be {meant} degrees"));
        };
        let is_small = s.scan_angle > 0.0 && s.scan_angle * FAR_BELOW < max;
        if is_small && looks_like_radians(s.scan_angle) && degrees(s.scan_angle) <= max * 1.05 {
            doubt(SCAN_ANGLE, s.scan_angle);
        }
        for (setting, angle) in [
            (HEAD_START, s.head_start),
            (HEAD_STOP, s.head_stop),
            (VERTICAL_MIN, s.vertical_min.unwrap_or(0.0)),
            (VERTICAL_MAX, s.vertical_max.unwrap_or(0.0)),
        ] {
            if looks_like_radians(angle) {
                doubt(setting, angle);
            }
        }
    }

    fn deflection(&self) {
        let s = &self.leg.scanner;
        if s.scan_angle < 0.0 {
            self.warn(SCAN_ANGLE, "is below 0 and counts as not given: that of the scanner is used");
        }
        let has = |is: fn(&Deflector) -> bool| self.devices().iter().any(|d| is(&d.deflector));
        let (fibres, risley) = (|d: &Deflector| matches!(d, Deflector::Fibres { .. }), is_risley);
        let only = |what: fn(&Deflector) -> bool| self.devices().iter().all(|d| what(&d.deflector));
        if s.scan_freq > 0.0 && (only(fibres) || only(risley)) {
            let reason = if has(is_risley) { "its prisms turn by themselves" } else { "it has no mirror" };
            self.warn(SCAN_FREQ, &format!("has no effect with this scanner: {reason}"));
        }
        if s.scan_angle > 0.0 && only(risley) {
            self.warn(SCAN_ANGLE, "has no effect with this scanner: its prisms deflect the beam");
        }
        if !has(|d| matches!(d, Deflector::Polygon { .. })) {
            for (setting, angle) in [(VERTICAL_MIN, s.vertical_min), (VERTICAL_MAX, s.vertical_max)] {
                if angle.is_some() {
                    self.warn(setting, "has no effect: only rotating optics have vertical angles");
                }
            }
        }
        self.devices().iter().for_each(|device| self.limits(device));
    }

    /// The limits of one device.
    fn limits(&self, device: &Device) {
        let (s, max) = (&self.leg.scanner, device.scan_angle_max);
        let in_degrees = |angle: f64| number(degrees(angle));
        let angle = s.scan_angle;
        match device.deflector {
            Deflector::Oscillating { scan_product } if degrees(angle) * s.scan_freq > scan_product => {
                let used = number(scan_product / degrees(angle));
                let (freq, angle) = (number(s.scan_freq), in_degrees(angle));
                self.warn(
                    SCAN_FREQ,
                    &format!(
                        "of {freq} Hz is too much for {angle} degrees: the mirror swings with {used} Hz"
                    ),
                );
            }
            Deflector::Risley { .. } | Deflector::Oscillating { .. } => {}
            _ if max > 0.0 && angle > max => {
                let (angle, max) = (in_degrees(angle), in_degrees(max));
                self.warn(
                    SCAN_ANGLE,
                    &format!("of {angle} degrees is beyond the scanner's {max}, which is used"),
                );
            }
            Deflector::Polygon { effective_max, .. } => {
                let window = s.vertical_min.zip(s.vertical_max);
                if angle > effective_max && effective_max > 0.0 && window.is_none() {
                    let (angle, usable) = (in_degrees(angle), in_degrees(effective_max));
                    let message =
                        format!("of {angle} degrees is beyond the {usable} within which the scanner fires");
                    self.warn(SCAN_ANGLE, &message);
                }
            }
            _ => {}
        }
        let Deflector::Polygon { .. } = device.deflector else { return };
        for (setting, vertical) in [(VERTICAL_MIN, s.vertical_min), (VERTICAL_MAX, s.vertical_max)] {
            let Some(vertical) = vertical.map(f64::abs) else { continue };
            // Rounding of the conversion to radians.
            let beyond = |limit: f64| limit > 0.0 && vertical > limit * (1.0 + 1e-9);
            if beyond(max) {
                self.warn(
                    setting,
                    &format!("is beyond the mirror, which turns within ±{} degrees", in_degrees(max)),
                );
            } else if beyond(angle) {
                let angle = in_degrees(angle);
                self.warn(
                    setting,
                    &format!("is beyond the scan angle of {angle} degrees, which does not count for it"),
                );
            }
        }
    }

    fn divergence(&self) {
        let devices = self.devices();
        if devices.len() > 1 && self.leg.scanner.beam_divergence != devices[0].beam.divergence {
            let message = format!("reaches the first of the {} channels only, as in HELIOS++", devices.len());
            self.warn(BEAM_DIVERGENCE, &message);
        }
    }
}

fn is_risley(deflector: &Deflector) -> bool {
    matches!(deflector, Deflector::Risley { .. })
}

/// Whether an angle (rad) was written as a number that is no round number of degrees, and a round one if it stands for
/// radians.
fn looks_like_radians(angle: f64) -> bool {
    let written = degrees(angle).abs();
    let is_multiple =
        |value: f64, of: f64, tolerance: f64| (value - (value / of).round() * of).abs() < tolerance;
    written > 0.0
        && written < MAX_RADIANS
        && !is_multiple(written, 0.05, 1e-9)
        && is_multiple(degrees(written), 5.0, 0.06)
        && degrees(written) > 1.0
}
