//! Checks of the complete survey: limits of the scanner, legs that never end.

use super::context::Context;
use super::keys::{Key, SettingsKeys};
use super::xml::Element;
use super::{Deflector, Device, Leg, PlatformKind, Survey};
use vlscan_base::diag::Place;
use vlscan_base::quantity::number;
use vlscan_geom::degrees;

const K: SettingsKeys = SettingsKeys::KEYS;

/// Place of a setting of a leg, by the index of the leg.
pub(super) type Places<'a> = &'a dyn Fn(usize, Key) -> Option<Place>;

/// Checks every leg against the scanner and the platform. `places` returns the place of a setting: in a
/// pipeline file, whose legs may come from an XML survey, or in that survey.
pub(super) fn check_legs(context: &Context, survey: &Survey, places: Places, in_pipeline: bool) {
    for (index, leg) in survey.legs.iter().enumerate() {
        let check = LegCheck { context, survey, leg, index, places, in_pipeline };
        check.effects();
        check.end();
        if leg.scanner.pulse_freq == 0 {
            let message = format!("leg {}: the pulse frequency must be above 0", leg.number);
            context.error_help(
                check.place(K.pulse_freq_hz),
                message,
                "it is the clock of inactive legs as well",
            );
        } else if leg.scanner.active {
            check.scan_freq(&survey.scanner.devices[0]);
            check.pulse_freq();
            survey.scanner.devices.iter().for_each(|device| check.deflection_range(device));
        }
    }
}

/// Places of the settings of legs with these elements: in an element of the leg, or in the element that lacks
/// them.
pub(super) fn places_in(elements: &[Element]) -> impl Fn(usize, Key) -> Option<Place> + '_ {
    |index, setting| {
        let is_of_scanner = SettingsKeys::ALL.contains(&setting);
        let tag = if is_of_scanner { "scannerSettings" } else { "platformSettings" };
        Some(elements.get(index)?.child(tag)?.value_place(setting.attribute))
    }
}

/// The checks of one leg.
pub(super) struct LegCheck<'a> {
    pub context: &'a Context,
    pub survey: &'a Survey,
    pub leg: &'a Leg,
    index: usize,
    places: Places<'a>,
    in_pipeline: bool,
}

impl LegCheck<'_> {
    pub fn place(&self, setting: Key) -> Option<Place> {
        (self.places)(self.index, setting).or_else(|| self.leg.place.clone())
    }

    /// The name of a setting in the file where it would be written.
    pub fn name(&self, setting: Key) -> &'static str {
        let place = self.place(setting);
        let ending = place.as_ref().and_then(|place| place.path.extension());
        let is_xml = !self.in_pipeline || ending.is_some_and(|ending| ending.eq_ignore_ascii_case("xml"));
        if is_xml || setting.key.is_empty() { setting.attribute } else { setting.key }
    }

    /// The scan frequency must lie within the scanner's limits (spec input-formats §2.7; active legs only).
    fn scan_freq(&self, device: &Device) {
        let (low, high) = device.scan_freq;
        let freq = self.leg.scanner.scan_freq;
        if freq < low || high != 0.0 && freq > high {
            let message = format!(
                "leg {}: the scan frequency of {} Hz is outside the scanner's limits",
                self.leg.number,
                number(freq)
            );
            let (low, high_text) = (number(low), number(high));
            let help = match high != 0.0 {
                true => format!("the scanner allows {low} to {high_text} Hz"),
                false => format!("the scanner allows {low} Hz and more"),
            };
            self.context.limit(self.place(K.scan_freq_hz), message, help);
        }
    }

    fn pulse_freq(&self) {
        let freq = self.leg.scanner.pulse_freq;
        if let Some(place) = self.place(K.pulse_freq_hz)
            && self.leg.scanner.pulse_times.is_none()
            // The rate of a pattern with times is only their mean, which a leg may replace.
            && self.survey.scanner.pulse_times.is_none()
            && !self.survey.scanner.pulse_freqs.contains(&freq)
        {
            let message = format!("the pulse frequency of {freq} Hz is not among those of the scanner");
            let known: Vec<String> = self.survey.scanner.pulse_freqs.iter().map(u32::to_string).collect();
            self.context.warn_help(place, message, format!("the scanner lists {} Hz", known.join(", ")));
        }
    }

    fn deflection_range(&self, device: &Device) {
        let settings = &self.leg.scanner;
        match device.deflector {
            Deflector::Polygon { effective_max, .. } => {
                let half =
                    if settings.scan_angle > 0.0 { settings.scan_angle } else { device.scan_angle_max };
                let half = half.min(device.scan_angle_max).min(effective_max);
                let window = (settings.vertical_min.unwrap_or(-half), settings.vertical_max.unwrap_or(half));
                if window.1 - window.0 > 2.0 * effective_max {
                    let message = format!(
                        "leg {}: the vertical angles {} to {} degrees are wider than the scanner's field of \
                         view",
                        self.leg.number,
                        number(degrees(window.0)),
                        number(degrees(window.1))
                    );
                    let help =
                        format!("the field of view is {} degrees", number(2.0 * degrees(effective_max)));
                    self.context.error_help(self.place(K.vertical_angle_max_deg), message, help);
                }
            }
            Deflector::Oscillating { .. } => {
                let missing = match (settings.scan_angle > 0.0, settings.scan_freq > 0.0) {
                    (false, _) => K.scan_angle_deg,
                    (_, false) => K.scan_freq_hz,
                    _ => return,
                };
                let (number, name) = (self.leg.number, self.name(missing));
                let message = format!("leg {number}: oscillating optics need `{name}` above 0");
                self.context.error_help(self.place(missing), message, "");
            }
            _ => {}
        }
    }

    /// A leg must end (spec kinematics §1.3, §1.5).
    fn end(&self) {
        let settings = &self.leg.scanner;
        if settings.max_duration.is_some() || matches!(self.survey.platform.kind, PlatformKind::Stream(_)) {
            return;
        }
        let max_rate = self.survey.scanner.devices[0].head.max_rate;
        let rate = settings.head_rate.clamp(-max_rate, max_rate);
        if rate != 0.0 {
            return;
        }
        let (rate_name, duration) = (self.name(K.head_rate_deg_per_s), self.name(K.max_duration_s));
        let help = match settings.head_rate != 0.0 {
            true => format!("the scanner's head cannot turn; give the leg `{duration}`"),
            false => format!("give the leg `{duration}`, or `{rate_name}` with start and stop angles"),
        };
        let reason = if matches!(self.survey.platform.kind, PlatformKind::Static) {
            "neither the platform nor the scanner's head moves"
        } else if settings.head_stop > settings.head_start {
            "the scanner's head does not reach its stop angle"
        } else {
            return;
        };
        let message = format!("leg {} would never end: {reason}", self.leg.number);
        self.context.error_help(self.place(K.head_rate_deg_per_s), message, help);
    }
}
