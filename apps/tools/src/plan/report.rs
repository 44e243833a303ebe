//! Report of a planned flight as comments, with hints for the user.

use super::area::Area;
use super::choice::Choice;
use super::document::{PlannedSurvey, Turned};
use super::height::GroundLevel;
use super::requirements::AirborneOptions;
use super::swath::SwathModel;
use vlscan_base::quantity::{amount, duration, number};
use vlscan_geom::degrees;

/// Relative departure from the requested density above which a plan warns.
pub(super) const MAX_DENSITY_ERROR: f64 = 0.03;
/// Part of a strip's width that counts as the middle of it, and as its edge on each side.
const EDGE: f64 = 0.05;
/// Ratio of the spacings along and across the flight above which their difference is explained.
const MAX_UNEVEN: f64 = 1.2;
/// Number of pulses above which a plan warns.
const MAX_PULSES: f64 = 1e11;

/// Begin or end of a line, `margin` m outside of the area, or within it if that is negative.
fn beside(margin: f64, outside: &str, area: &str) -> String {
    match margin {
        m if m.abs() < 0.05 => format!("at the edge of {area}"),
        m if m < 0.0 => format!("{:.1} m within {area}", -m),
        m => format!("{m:.1} m {outside} {area}"),
    }
}

/// Contents of the comments of a plan.
pub(super) struct PlanReport<'f> {
    pub area: &'f Area,
    pub instrument: &'f SwathModel,
    pub choice: &'f Choice,
    /// Height above the ground, m.
    pub height: f64,
    /// Direction of the lines, rad clockwise from +y; `None` if they follow a line.
    pub heading: Option<f64>,
    /// How far before the area lines begin and behind it they end, m.
    pub margins: [f64; 2],
    /// Number of parallel lines.
    pub parallel: usize,
    /// Length of the lines, m.
    pub active: f64,
    pub level: GroundLevel,
}

impl PlanReport<'_> {
    pub fn describe(&self, document: &mut PlannedSurvey, options: &AirborneOptions) {
        let flown = document.length();
        document.comments.extend(self.flight(options, flown));
        document.comments.extend(self.strip());
        document.warnings.extend(self.warnings(options));
    }

    fn flight(&self, options: &AirborneOptions, flown: f64) -> Vec<String> {
        let Choice { speed, spacing, fired_rate, .. } = self.choice;
        let apart = match self.parallel {
            1 => String::new(),
            _ => format!(", {spacing:.2} m apart"),
        };
        let direction = match self.heading {
            Some(heading) => format!("at heading {:.1}°", degrees(heading)),
            None => "along the line".to_owned(),
        };
        let seconds = flown / speed;
        let exact = if seconds < 60.0 { String::new() } else { format!(" ({seconds:.1} s)") };
        let hectares = self.area.square_metres() / 1e4;
        let mut lines = vec![
            format!(
                "{} over {hectares:.2} ha, {} m above the ground at {speed:.2} m/s",
                self.instrument.name(),
                number(self.height)
            ),
            format!(
                "lines      {} {direction}{apart}, {} across; {:.2} km of {:.2} km flown measure",
                self.parallel,
                options.cross_lines,
                self.active / 1e3,
                flown / 1e3
            ),
            format!("duration   {}{exact}", duration(seconds)),
            format!(
                "pulses     {} leave the instrument, {} per second",
                amount(self.active / speed * fired_rate),
                amount(*fired_rate)
            ),
        ];
        lines.extend(self.rate(options));
        if let Some(Turned { turns, .. }) = &self.choice.turned {
            lines.push(format!(
                "mount      {}, because the platform's mount does not point the scanner at the \
                 ground",
                turns.text()
            ));
        }
        lines
    }

    /// True if the pulse rate follows from the options.
    fn derives_rate(options: &AirborneOptions) -> bool {
        options.density.is_some() && options.speed.is_some() && options.overlap.is_some()
    }

    /// The pulse rate of an instrument with several, where the plan chose it.
    fn rate(&self, options: &AirborneOptions) -> Option<String> {
        let rates = self.instrument.pulse_rates();
        if self.instrument.wanted_rate.is_some() || rates.len() < 2 {
            return None;
        }
        let kilohertz = |rate: u32| number(f64::from(rate) / 1e3);
        let all: Vec<String> = rates.iter().map(|rate| kilohertz(*rate)).collect();
        if PlanReport::derives_rate(options) {
            let rate = kilohertz(self.choice.scan.pulse_rate);
            return Some(format!(
                "rate       {rate} kHz, the lowest of {} kHz that gives the density at this speed and \
                 overlap",
                all.join(", ")
            ));
        }
        Some(format!(
            "rate       {} kHz by default, the first of {} kHz; a higher --pulse-rate flies faster for the \
             same density",
            kilohertz(rates[0]),
            all.join(", ")
        ))
    }

    fn strip(&self) -> Vec<String> {
        let Choice { scan, field, fired_rate, speed, spacing, density, .. } = self.choice;
        let width = field.width();
        let ground_rate = self.choice.ground_rate();
        let [before, behind] = self.margins;
        let (overlap, begin, end) = match self.parallel {
            1 => (String::new(), "the line begins", "ends"),
            _ => (
                format!(", overlap 1 − S/W = {:.1} %", 100.0 * (1.0 - spacing / width)),
                "lines begin",
                "end",
            ),
        };
        let mut lines = vec![format!(
            "swath      W = {width:.2} m{overlap}; {begin} {} and {end} {}",
            beside(before, "before", "the area"),
            beside(behind, "behind", "it")
        )];
        if field.measured < 0.999 {
            lines.push(format!(
                "ground     N = {} of {} pulses per second reach it where the instrument measures it",
                amount(ground_rate),
                amount(*fired_rate)
            ));
        }
        // Shares of the fired pulses per metre to densities.
        let per_area = |share: f64| share * fired_rate / speed;
        let edge = EDGE * width;
        let [left, right] = field.across;
        let at_edge =
            0.5 * (field.mean_profile([left, left + edge]) + field.mean_profile([right - edge, right]));
        lines.push(format!(
            "density    {density:.3} pulses/m² over the area, N/(v·S) = {:.3} far from its edges; one strip \
             {:.3} below, {:.3} at its edge",
            ground_rate / (speed * spacing),
            per_area(field.mean_profile([-edge, edge])),
            per_area(at_edge)
        ));
        if scan.line_rate > 0.0 && self.instrument.spins() {
            lines.push(format!(
                "spacing    v/f = {:.3} m from turn to turn of the head",
                speed / scan.line_rate
            ));
        } else if scan.line_rate > 0.0 {
            let (along, across) = (speed / scan.line_rate, width * scan.line_rate / ground_rate);
            let is_uneven = (along / across).max(across / along) > MAX_UNEVEN;
            let reason = match self.instrument.limit_of(scan).filter(|_| is_uneven) {
                Some(limit) => {
                    format!("; unequal: {} Hz is the {limit} scan frequency", number(scan.scan_freq))
                }
                None => String::new(),
            };
            lines.push(format!("spacing    v/f = {along:.3} m along, W·f/N = {across:.3} m across{reason}"));
        }
        let range = self.height.hypot(field.reach());
        lines.push(format!(
            "footprint  {} below the platform; range at the edge {range:.0} m",
            self.instrument.footprint(self.height)
        ));
        lines
    }

    fn warnings(&self, options: &AirborneOptions) -> Vec<String> {
        let Choice { field, fired_rate, speed, density, .. } = self.choice;
        let mut warnings = Vec::new();
        let mut warn = |text: String| warnings.push(text);
        if let Some(asked) = options.density.filter(|_| !PlanReport::derives_rate(options))
            && (density / asked - 1.0).abs() > MAX_DENSITY_ERROR
        {
            warn(format!(
                "the density over the area is {density:.3} pulses/m² instead of {asked}, because the number \
                 of lines is whole; at {:.3} m/s it would be {asked}",
                speed * density / asked,
                asked = number(asked)
            ));
        }
        let [_, far] = self.instrument.ranges();
        let depth = self.level.mean - self.level.low;
        let lowest = (self.height + depth).hypot(field.reach() * (1.0 + depth / self.height));
        if !options.follow_terrain && lowest > far && field.lost.too_far <= 0.0 {
            warn(format!(
                "where the ground is lowest the edge of the swath is {lowest:.0} m away, farther than the \
                 instrument's {} m",
                number(far)
            ));
        }
        let relief = self.level.high - self.level.low;
        if !options.follow_terrain && relief > 0.1 * self.height {
            warn(format!(
                "the ground height varies by {relief:.0} m within the area, so swath and density vary along \
                 level lines; --follow-terrain keeps the height above ground"
            ));
        }
        if self.level.known == 0.0 {
            warn(format!(
                "the scene has no ground in the area; a height of {:.1} m is assumed, --ground sets another",
                self.level.mean
            ));
        } else if self.level.known < 0.99 {
            let help = if self.level.known < 0.5 { "; draw the area within the scene" } else { "" };
            warn(format!(
                "the scene has no ground in {:.0} % of the area{help}",
                100.0 * (1.0 - self.level.known)
            ));
        }
        let pulses = self.active / speed * fired_rate;
        if pulses > MAX_PULSES {
            warn(format!("{} pulses will take very long to compute", amount(pulses)));
        }
        warnings
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ends_of_lines_are_outside_of_the_area_or_within_it() {
        assert_eq!(beside(12.34, "before", "the area"), "12.3 m before the area");
        assert_eq!(beside(-6.6, "before", "the area"), "6.6 m within the area");
        assert_eq!(beside(-0.04, "behind", "it"), "at the edge of it");
    }
}
