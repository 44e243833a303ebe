//! Checks of the complete survey: limits of the scanner, legs that never end.

use super::context::Context;
use super::xml::Element;
use super::{Deflector, Device, Leg, PlatformKind, Survey};
use crate::diag::Place;
use crate::geom::degrees;

/// Checks every leg against the scanner and the platform. `elements` are the legs' XML elements, if they have any.
pub(super) fn check_legs(context: &Context, survey: &Survey, elements: &[Element]) {
    for (i, leg) in survey.legs.iter().enumerate() {
        let leg = Checked { leg, element: elements.get(i) };
        check_end(context, survey, &leg);
        if leg.leg.scanner.pulse_freq == 0 {
            let message = format!("leg {}: the pulse frequency must be above 0", leg.leg.number);
            context.error_help(leg.place("pulseFreq_hz"), message, "it is the clock of inactive legs, too");
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

/// A leg and its XML element.
struct Checked<'a> {
    leg: &'a Leg,
    element: Option<&'a Element>,
}

impl Checked<'_> {
    /// The place of an attribute of the scanner settings, or of the element that lacks it.
    fn place(&self, attribute: &str) -> Option<Place> {
        let settings = self.element.and_then(|e| e.child("scannerSettings"));
        settings.map(|s| s.value_place(attribute)).or_else(|| self.leg.place.clone())
    }
}

/// The scan frequency must lie within the scanner's limits (spec input-formats §2.7; active legs only).
fn check_scan_freq(context: &Context, device: &Device, leg: &Checked) {
    let (low, high) = device.scan_freq;
    let freq = leg.leg.scanner.scan_freq;
    if freq < low || high != 0.0 && freq > high {
        let message = format!(
            "leg {}: the scan frequency of {freq} Hz is outside the scanner's limits",
            leg.leg.number
        );
        let help = match high != 0.0 {
            true => format!("the scanner allows {low} to {high} Hz"),
            false => format!("the scanner allows {low} Hz and more"),
        };
        context.limit(leg.place("scanFreq_hz"), message, help);
    }
}

fn check_pulse_freq(context: &Context, survey: &Survey, leg: &Checked) {
    let freq = leg.leg.scanner.pulse_freq;
    if let Some(place) = leg.place("pulseFreq_hz")
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
                    "leg {}: the vertical angles {:.4} to {:.4} degrees are wider than the scanner's field of view",
                    leg.leg.number,
                    degrees(window.0),
                    degrees(window.1)
                );
                let help = format!("the field of view is {:.4} degrees", 2.0 * degrees(effective_max));
                context.error_help(leg.place("verticalAngleMax_deg"), message, help);
            }
        }
        Deflector::Oscillating { .. } => {
            let missing = match (settings.scan_angle > 0.0, settings.scan_freq > 0.0) {
                (false, _) => "scanAngle_deg",
                (_, false) => "scanFreq_hz",
                _ => return,
            };
            let message = format!("leg {}: oscillating optics need `{missing}` above 0", leg.leg.number);
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
    let cannot_turn = settings.head_rate != 0.0;
    let help = match cannot_turn {
        true => {
            "the scanner's head cannot turn (`headRotatePerSecMax_deg` is 0); give the leg `maxDuration_s`"
        }
        false => "give the leg `maxDuration_s`, or `headRotatePerSec_deg` with start and stop angles",
    };
    if matches!(survey.platform.kind, PlatformKind::Static) {
        let message = format!(
            "leg {} would never end: neither the platform nor the scanner's head moves",
            leg.leg.number
        );
        context.error_help(leg.place("headRotatePerSec_deg"), message, help);
    } else if settings.head_stop > settings.head_start {
        let message = format!(
            "leg {} would never end: the scanner's head does not reach its stop angle",
            leg.leg.number
        );
        context.error_help(leg.place("headRotatePerSec_deg"), message, help);
    }
}
