//! Note on the pulses that a mirror does not fire.

use vlscan_base::quantity::amount;
use vlscan_survey::{Deflector, Survey};

/// Share of a mirror's turn without pulses above which a note is given.
const MIN_IDLE_SHARE: f64 = 0.25;

/// Reports how many pulses a pipeline fires if its mirror turns farther than the scan angle: the pulse
/// frequency counts over the complete turn.
pub fn describe_idle_mirror(survey: &Survey) -> Option<String> {
    let leg = survey.legs.iter().find(|leg| leg.scanner.active)?;
    let device = survey.scanner.devices.first()?;
    let Deflector::Polygon { effective_max, .. } = device.deflector else { return None };
    let (all, requested) = (device.scan_angle_max, leg.scanner.scan_angle);
    let usable = if requested > 0.0 { effective_max.min(requested) } else { effective_max };
    let share = usable / all;
    let is_pipeline = survey.path.extension().is_some_and(|e| e.eq_ignore_ascii_case("toml"));
    if !(is_pipeline && share > 0.0 && share <= 1.0 - MIN_IDLE_SHARE) {
        return None;
    }
    let frequency = f64::from(leg.scanner.pulse_freq);
    Some(format!(
        "{} of {} pulses per second are fired: pulse_freq_hz counts over ±{:.0}° of the mirror, which fires \
         within ±{:.0}°",
        amount(share * frequency),
        amount(frequency),
        all.to_degrees(),
        usable.to_degrees()
    ))
}
