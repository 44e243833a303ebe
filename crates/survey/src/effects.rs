//! Settings of legs that the scanner or the platform limits, replaces or does not have. Each is a warning
//! that names what is used instead.

use super::checks::LegCheck;
use super::keys::{Key, LegKeys, SettingsKeys};
use super::{Deflector, Device, PlatformKind};
use vlscan_base::quantity::{NUMBER, number};
use vlscan_geom::degrees;

const K: SettingsKeys = SettingsKeys::KEYS;
const STOP_AND_TURN: Key = Key::attribute("stopAndTurn", &NUMBER);
const SMOOTH_TURN: Key = Key::attribute("smoothTurn", &NUMBER);
const SLOWDOWN: Key = Key::attribute("slowdownEnabled", &NUMBER);
const YAW_AT_DEPARTURE: Key = Key::attribute("yawAtDeparture_deg", &NUMBER);

/// Speed of legs that name none, m/s.
const DEFAULT_SPEED: f64 = 70.0;
/// Maximum angle that is checked for being in radians by mistake: one turn.
const MAX_RADIANS: f64 = 6.3;
/// Ratio from which a scan angle is far below the scanner's.
const FAR_BELOW: f64 = 20.0;

impl LegCheck<'_> {
    /// Warns of settings without effect.
    pub fn effects(&self) {
        if !matches!(self.survey.platform.kind, PlatformKind::Stream(_)) {
            self.platform();
        }
        if self.leg.scanner.active {
            self.head();
            self.radians();
            self.deflection();
            self.divergence();
        }
    }

    fn devices(&self) -> &[Device] {
        &self.survey.scanner.devices
    }

    /// Warns of a setting; `message` follows its name.
    fn warn(&self, setting: Key, message: impl std::fmt::Display) {
        let place = self.place(setting);
        let name = self.name(setting);
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
            self.warn(LegKeys::KEYS.speed_m_per_s, &no_effect);
        }
        if has_waypoints {
            self.speed();
        }
        if matches!(kind, PlatformKind::Interpolated(_)) {
            if p.position.length_squared() > 0.0 {
                self.warn(
                    LegKeys::KEYS.position_m,
                    format!("{no_effect}: positions come from its trajectory"),
                );
            }
            if p.on_ground {
                self.warn(LegKeys::KEYS.on_ground, format!("{no_effect}: heights come from its trajectory"));
            }
        }
        if matches!(kind, PlatformKind::Multicopter(_)) {
            if p.yaw_at_departure.is_some() && !p.stop_and_turn {
                self.warn(YAW_AT_DEPARTURE, "has no effect: the platform does not stop there");
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

    /// Warns of a speed that does not reach the next waypoint, and of a default speed.
    fn speed(&self) {
        let (p, speed) = (&self.leg.platform, LegKeys::KEYS.speed_m_per_s);
        let next = self.survey.legs.iter().find(|leg| leg.number > self.leg.number);
        if !next.is_some_and(|next| next.platform.position != p.position) {
            return;
        }
        if p.speed <= 0.0 {
            let found = number(p.speed);
            let consequence = match self.survey.platform.kind {
                PlatformKind::LinearPath => "the platform does not move towards the next leg",
                _ => "it limits nothing: the platform is as fast as its engine lets it",
            };
            self.warn(speed, format!("is {found} m/s, which is no speed; {consequence}"));
        } else if !p.has_speed {
            self.warn(speed, format!("is missing; {} m/s are used", number(DEFAULT_SPEED)));
        }
    }

    fn head(&self) {
        let requested = self.leg.scanner.head_rate;
        let limit = self.devices().iter().map(|d| d.head.max_rate).fold(f64::INFINITY, f64::min);
        if requested.abs() <= limit {
            return;
        }
        if limit == 0.0 {
            return self.warn(K.head_rate_deg_per_s, "has no effect: the scanner's head does not turn");
        }
        let (requested, limit) = (number(degrees(requested)), number(degrees(limit)));
        self.warn(
            K.head_rate_deg_per_s,
            format!("of {requested} °/s is beyond the scanner's limit; its head turns by {limit} °/s"),
        );
    }

    /// Warns of angles that are round numbers of degrees when read as radians.
    fn radians(&self) {
        let s = &self.leg.scanner;
        let max = self.devices().iter().map(|d| d.scan_angle_max).fold(0.0, f64::max);
        let doubt = |setting, angle: f64| {
            let written = degrees(angle);
            let (written, meant) = (number(written), number(degrees(written)));
            self.warn(setting, format!("is {written} degrees; {written} rad would be {meant} degrees"));
        };
        let is_small = s.scan_angle > 0.0 && s.scan_angle * FAR_BELOW < max;
        if is_small && looks_like_radians(s.scan_angle) && degrees(s.scan_angle) <= max * 1.05 {
            doubt(K.scan_angle_deg, s.scan_angle);
        }
        let head = [(K.head_start_deg, s.head_start), (K.head_stop_deg, s.head_stop)];
        let angles = head.into_iter().chain(self.vertical_angles());
        angles.filter(|(_, angle)| looks_like_radians(*angle)).for_each(|(key, angle)| doubt(key, angle));
    }

    /// The vertical angles that the leg has, rad.
    fn vertical_angles(&self) -> impl Iterator<Item = (Key, f64)> + use<> {
        let s = &self.leg.scanner;
        let angles = [(K.vertical_angle_min_deg, s.vertical_min), (K.vertical_angle_max_deg, s.vertical_max)];
        angles.into_iter().filter_map(|(key, angle)| Some((key, angle?)))
    }

    fn deflection(&self) {
        let s = &self.leg.scanner;
        if s.scan_angle < 0.0 {
            self.warn(K.scan_angle_deg, "is below 0 and ignored: that of the scanner is used");
        }
        let only = |optics: &str| self.devices().iter().all(|d| d.deflector.optics() == optics);
        // Rounding of the conversion to radians.
        if s.scan_angle > std::f64::consts::PI * (1.0 + 1e-9) && only("oscillating") {
            let angle = number(degrees(s.scan_angle));
            let message = format!("of {angle} degrees is more than 180, half a turn to each side");
            self.warn(K.scan_angle_deg, message);
        }
        if s.scan_freq > 0.0 && (only("line") || only("risley") || only("pattern")) {
            let reason = if only("risley") { "its prisms turn by themselves" } else { "it has no mirror" };
            self.warn(K.scan_freq_hz, format!("has no effect with this scanner: {reason}"));
        }
        // The channels of a spinning sensor need no mirror.
        let spins = self.survey.scanner.multi_channel && s.head_rate != 0.0;
        let has_polygon = self.devices().iter().any(|d| matches!(d.deflector, Deflector::Polygon { .. }));
        if s.scan_freq == 0.0 && has_polygon && !spins {
            self.warn(
                K.scan_freq_hz,
                "is 0: the mirror stands still, and all pulses have one deflection angle",
            );
        }
        if s.scan_angle > 0.0 && only("risley") {
            self.warn(K.scan_angle_deg, "has no effect with this scanner: its prisms deflect the beam");
        }
        if s.scan_angle > 0.0 && only("pattern") {
            self.warn(K.scan_angle_deg, "has no effect with this scanner: its pattern states all directions");
        }
        if !self.devices().iter().any(|d| d.deflector.optics() == "rotating") {
            for (setting, _) in self.vertical_angles() {
                self.warn(setting, "has no effect: only rotating optics have vertical angles");
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
                    K.scan_freq_hz,
                    format!("of {freq} Hz is too much for {angle} degrees: the mirror swings with {used} Hz"),
                );
            }
            Deflector::Risley { .. } | Deflector::Oscillating { .. } | Deflector::Pattern(_) => {}
            Deflector::Conic | Deflector::EllipticConic { .. } | Deflector::Fibres { .. }
                if max == 0.0 && angle > 0.0 =>
            {
                let message =
                    "has no effect: the largest angle of the scanner is 0, so that its beam is not deflected";
                self.warn(K.scan_angle_deg, message);
            }
            _ if max > 0.0 && angle > max => {
                let (angle, max) = (in_degrees(angle), in_degrees(max));
                self.warn(
                    K.scan_angle_deg,
                    format!("of {angle} degrees is beyond the scanner's {max}, which is used"),
                );
            }
            Deflector::Polygon { effective_max, .. } => {
                let window = s.vertical_min.zip(s.vertical_max);
                if angle > effective_max && effective_max > 0.0 && window.is_none() {
                    let (angle, usable) = (in_degrees(angle), in_degrees(effective_max));
                    let message =
                        format!("of {angle} degrees is beyond the {usable} within which the scanner fires");
                    self.warn(K.scan_angle_deg, message);
                }
            }
            _ => {}
        }
        let Deflector::Polygon { .. } = device.deflector else { return };
        for (setting, vertical) in self.vertical_angles() {
            // Rounding of the conversion to radians.
            let beyond = |limit: f64| limit > 0.0 && vertical.abs() > limit * (1.0 + 1e-9);
            if beyond(max) {
                self.warn(
                    setting,
                    format!("is beyond the mirror, which turns within ±{} degrees", in_degrees(max)),
                );
            } else if beyond(angle) {
                let angle = in_degrees(angle);
                self.warn(
                    setting,
                    format!("is beyond the scan angle of {angle} degrees, which does not count for it"),
                );
            }
        }
    }

    fn divergence(&self) {
        let devices = self.devices();
        if devices.len() > 1 && self.leg.scanner.beam_divergence != devices[0].beam.divergence {
            let message = format!("reaches the first of the {} channels only, as in HELIOS++", devices.len());
            self.warn(K.beam_divergence_rad, message);
        }
    }
}

/// True if the written number of an angle (rad) is not a round number of degrees, but would be one if it were
/// in radians.
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
