//! Checks of the complete survey: limits of the scanner, legs that never end.

use super::context::Context;
use super::effects::{
    HEAD_RATE, MAX_DURATION, PULSE_FREQ, Places, SCAN_ANGLE, SCAN_FREQ, Setting, VERTICAL_MAX, check_effects,
};
use super::xml::Element;
use super::{Deflector, Device, Leg, PlatformKind, Survey};
use vlscan_base::diag::Place;
use vlscan_base::quantity::number;
use vlscan_geom::degrees;

/// Checks every leg against the scanner and the platform. `places` tells where a setting is written.
pub(super) fn check_legs(context: &Context, survey: &Survey, places: Places) {
    check_effects(context, survey, places);
    for (index, leg) in survey.legs.iter().enumerate() {
        let leg = Checked { leg, index, places };
        check_end(context, survey, &leg);
        if leg.leg.scanner.pulse_freq == 0 {
            let message = format!("leg {}: the pulse frequency must be above 0", leg.leg.number);
            context.error_help(leg.place(PULSE_FREQ), message, "it is the clock of inactive legs, too");
            continue;
        }
        if !leg.leg.scanner.active {
            continue;
        }
        check_scan_freq(context, &survey.scanner.devices[0], &leg);
        check_pulse_freq(context, survey, &leg);
        for device in &survey.scanner.devices {
            check_deflection(context, device, &leg);
        }
    }
}

/// Where the settings of legs with these elements are written: in an element of the leg, or in the element that lacks them.
pub(super) fn places_in(elements: &[Element]) -> impl Fn(usize, Setting) -> Option<Place> + '_ {
    |index, setting| {
        let leg = elements.get(index)?;
        Some(leg.child(setting.tag)?.value_place(setting.xml))
    }
}

/// A leg and where its settings are written.
struct Checked<'a> {
    leg: &'a Leg,
    index: usize,
    places: Places<'a>,
}

impl Checked<'_> {
    fn place(&self, setting: Setting) -> Option<Place> {
        (self.places)(self.index, setting).or_else(|| self.leg.place.clone())
    }

    /// The name of a setting in the file of the leg.
    fn name(&self, setting: Setting) -> &'static str {
        setting.name_at(self.place(setting).as_ref())
    }
}

/// The scan frequency must lie within the scanner's limits (spec input-formats §2.7; active legs only).
fn check_scan_freq(context: &Context, device: &Device, leg: &Checked) {
    let (low, high) = device.scan_freq;
    let freq = leg.leg.scanner.scan_freq;
    if freq < low || high != 0.0 && freq > high {
        let message = format!(
            "leg {}: the scan frequency of {} Hz is outside the scanner's limits",
            leg.leg.number,
            number(freq)
        );
        let (low, high_text) = (number(low), number(high));
        let help = match high != 0.0 {
            true => format!("the scanner allows {low} to {high_text} Hz"),
            false => format!("the scanner allows {low} Hz and more"),
        };
        context.limit(leg.place(SCAN_FREQ), message, help);
    }
}

fn check_pulse_freq(context: &Context, survey: &Survey, leg: &Checked) {
    let freq = leg.leg.scanner.pulse_freq;
    if let Some(place) = leg.place(PULSE_FREQ)
        && !survey.scanner.pulse_freqs.contains(&freq)
    {
        let message = format!("the pulse frequency of {freq} Hz is not among those of the scanner");
        let known: Vec<String> = survey.scanner.pulse_freqs.iter().map(u32::to_string).collect();
        context.warn_help(place, message, format!("the scanner lists {} Hz", known.join(", ")));
    }
}

fn check_deflection(context: &Context, device: &Device, leg: &Checked) {
    let settings = &leg.leg.scanner;
    match device.deflector {
        Deflector::Polygon { effective_max, .. } => {
            let half = if settings.scan_angle > 0.0 { settings.scan_angle } else { device.scan_angle_max };
            let half = half.min(device.scan_angle_max).min(effective_max);
            let window = (settings.vertical_min.unwrap_or(-half), settings.vertical_max.unwrap_or(half));
            if window.1 - window.0 > 2.0 * effective_max {
                let message = format!(
                    "leg {}: the vertical angles {} to {} degrees are wider than the scanner's field of view",
                    leg.leg.number,
                    number(degrees(window.0)),
                    number(degrees(window.1))
                );
                let help = format!("the field of view is {} degrees", number(2.0 * degrees(effective_max)));
                context.error_help(leg.place(VERTICAL_MAX), message, help);
            }
        }
        Deflector::Oscillating { .. } => {
            let missing = match (settings.scan_angle > 0.0, settings.scan_freq > 0.0) {
                (false, _) => SCAN_ANGLE,
                (_, false) => SCAN_FREQ,
                _ => return,
            };
            let (number, name) = (leg.leg.number, leg.name(missing));
            let message = format!("leg {number}: oscillating optics need `{name}` above 0");
            context.error_help(leg.place(missing), message, "");
        }
        _ => {}
    }
}

/// A leg must end (spec kinematics §1.3, §1.5).
fn check_end(context: &Context, survey: &Survey, leg: &Checked) {
    let settings = &leg.leg.scanner;
    if settings.max_duration.is_some() || matches!(survey.platform.kind, PlatformKind::Stream(_)) {
        return;
    }
    let max_rate = survey.scanner.devices[0].head.max_rate;
    let rate = settings.head_rate.clamp(-max_rate, max_rate);
    if rate != 0.0 {
        return;
    }
    let (rate_name, duration) = (leg.name(HEAD_RATE), leg.name(MAX_DURATION));
    let help = match settings.head_rate != 0.0 {
        true => format!("the scanner's head cannot turn; give the leg `{duration}`"),
        false => format!("give the leg `{duration}`, or `{rate_name}` with start and stop angles"),
    };
    let reason = if matches!(survey.platform.kind, PlatformKind::Static) {
        "neither the platform nor the scanner's head moves"
    } else if settings.head_stop > settings.head_start {
        "the scanner's head does not reach its stop angle"
    } else {
        return;
    };
    let message = format!("leg {} would never end: {reason}", leg.leg.number);
    context.error_help(leg.place(HEAD_RATE), message, help);
}
