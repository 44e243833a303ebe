//! Report of an estimated flight, with uncertainties.

use super::FlightFit;
use super::mirror::Mirror;
use super::model::{MAX_CHANNELS, MAX_FACETS};
use super::pulses::Pulse;
use libm::{atan2, hypot, tan};
use serde::Serialize;
use vlscan_base::error::{Error, Result};
use vlscan_base::quantity::fixed;
use vlscan_geom::degrees;

/// Names of the yaws and pitches of channels.
const OF_CHANNELS: [(&str, &str); MAX_CHANNELS] = [
    ("yaw of channel 1", "pitch of channel 1"),
    ("yaw of channel 2", "pitch of channel 2"),
    ("yaw of channel 3", "pitch of channel 3"),
    ("yaw of channel 4", "pitch of channel 4"),
];

/// Names of the tilts of facets.
const OF_FACETS: [&str; MAX_FACETS] = [
    "tilt of facet 1 forward",
    "tilt of facet 2 forward",
    "tilt of facet 3 forward",
    "tilt of facet 4 forward",
    "tilt of facet 5 forward",
    "tilt of facet 6 forward",
    "tilt of facet 7 forward",
    "tilt of facet 8 forward",
    "tilt of facet 9 forward",
];

/// An estimated quantity.
#[derive(Clone, Debug, Serialize)]
pub struct Figure {
    /// Name of the quantity.
    pub name: &'static str,
    /// Value in `unit`.
    pub value: f64,
    /// Standard deviation in `unit`, if known.
    pub deviation: Option<f64>,
    /// Unit of value and deviation; empty for numbers.
    pub unit: &'static str,
}

/// Figures in the order in which they are shown.
#[derive(Default)]
struct Figures(Vec<Figure>);

impl Figures {
    fn add(&mut self, name: &'static str, value: f64, deviation: Option<f64>, unit: &'static str) {
        let deviation = deviation.filter(|deviation| deviation.is_finite());
        self.0.push(Figure { name, value, deviation, unit });
    }

    /// Adds an angle of radians in degrees.
    fn add_angle(&mut self, name: &'static str, value: f64, deviation: Option<f64>) {
        self.add(name, degrees(value), deviation.map(degrees), "deg");
    }
}

impl FlightFit {
    /// The estimated quantities, in the order in which they are shown.
    pub fn figures(&self) -> Vec<Figure> {
        let mut figures = Figures::default();
        self.add_platform(&mut figures);
        self.add_mirror(&mut figures);
        self.add_rate(&mut figures);
        if let Some(noise) = self.noise {
            figures.add("range noise with roughness", noise.value, Some(noise.deviation), "m");
        }
        let solution = &self.solution;
        figures.add_angle("attitude changes, root mean square", solution.attitude_spread(), None);
        figures.add("residual on the ground", solution.residual, None, "m");
        figures.add_angle("residual of the scan angle", solution.angle_residual, None);
        figures.0
    }

    fn add_platform(&self, figures: &mut Figures) {
        let solution = &self.solution;
        let (p, d) = (&solution.model.parameters, &solution.deviations);
        let speed = solution.model.speed();
        let of_speed = hypot(d.velocity.x, d.velocity.y);
        figures.add("speed", speed, Some(hypot(of_speed, self.speed_by_pitch)), "m/s");
        let course = degrees(solution.model.course()).rem_euclid(360.0);
        figures.add("course", course, Some(degrees(of_speed / speed)), "deg");
        let above = self.height_above_points();
        // Least squares assume independent errors of the angles; a part of the error is common to all angles.
        let of_height = self.with_scale(d.position.z, above);
        figures.add("height of the platform", p.position.z + self.recording.origin.z, Some(of_height), "m");
        figures.add("height above the points", above, Some(of_height), "m");
        figures.add("climb", p.velocity.z, Some(d.velocity.z), "m/s");
        figures.add_angle("roll", p.roll, Some(d.roll));
        figures.add_angle("pitch", p.pitch, Some(d.pitch));
    }

    /// Standard deviation of `value`, a height or an angle of the mirror, by that of least squares and by the
    /// error that all scan angles have in common. Within the rounding to degrees least squares do not see
    /// the angles, but the rounding bounds them.
    fn with_scale(&self, deviation: f64, value: f64) -> f64 {
        let of_scale = self.solution.scale_deviation(&self.recording) * value;
        match self.recording.has_whole_angles() {
            true => hypot(deviation.min(of_scale), of_scale),
            false => hypot(deviation, of_scale),
        }
    }

    fn add_mirror(&self, figures: &mut Figures) {
        let (p, d) = (&self.solution.model.parameters.mirror, &self.solution.deviations.mirror);
        let of_angle = self.with_scale(d.angle, p.angle.abs());
        match self.solution.model.mirror {
            Mirror::Cone => {
                figures.add_angle("half angle of the cone", p.angle, Some(of_angle));
                let radius = self.height_above_points() * tan(p.angle);
                figures.add("radius on the ground", radius, None, "m");
                figures.add("revolutions", p.rate.abs(), Some(d.rate), "1/s");
            }
            Mirror::EllipticCone => {
                figures.add_angle("half angle across the flight", p.angle.abs(), Some(of_angle));
                let of_along = self.with_scale(d.angle_along, p.angle_along.abs());
                figures.add_angle("half angle along the flight", p.angle_along.abs(), Some(of_along));
                figures.add("revolutions", p.rate.abs(), Some(d.rate), "1/s");
                figures.add_angle("yaw of the ellipse", p.yaw, Some(d.yaw));
            }
            Mirror::Polygon => {
                figures.add_angle("angle per line", p.angle.abs(), Some(of_angle));
                figures.add("lines", p.rate, Some(d.rate), "1/s");
                figures.add_angle("yaw of the lines", p.yaw, Some(d.yaw));
                self.add_facets_and_channels(figures);
            }
            Mirror::Oscillating | Mirror::Turning | Mirror::Sine => {
                let [smallest, largest] = self.half_angles();
                // That of a uniform distribution between the bounds.
                let of_reversals = (largest - smallest) / 12f64.sqrt();
                figures.add_angle("half angle", largest, Some(hypot(of_angle, of_reversals)));
                figures.add("periods", p.rate, Some(d.rate), "1/s");
                if self.solution.model.mirror == Mirror::Turning {
                    figures.add("share of a sweep in reversals", p.turning, Some(d.turning), "");
                }
                figures.add_angle("yaw of the lines", p.yaw, Some(d.yaw));
            }
        }
    }

    /// Half angle of an oscillating mirror, rad. Reversals that have not been estimated take 50 pulses each,
    /// at most half of a sweep; between reversals the mirror moves evenly, and faster than a mirror of the
    /// same angle that reverses at once (docs/physics.md, kinematics).
    pub(super) fn half_angle(&self) -> f64 {
        const REVERSAL: f64 = 50.0;
        let mirror = &self.solution.model.parameters.mirror;
        if self.solution.model.mirror != Mirror::Oscillating {
            return mirror.angle.abs();
        }
        let pulses_of_sweep = self.rate.mean / (2.0 * mirror.rate.abs());
        mirror.angle.abs() * (1.0 - (REVERSAL / pulses_of_sweep).min(0.5))
    }

    /// Smallest and largest half angle of an oscillating mirror that explain its lines, rad.
    ///
    /// The bounds differ where the ends of sweeps are not in the cloud. The outermost pulse is within the
    /// half angle, and a mirror that reverses all the time has half the angle of one that moves evenly, if
    /// both have the same speed in the middle.
    pub(super) fn half_angles(&self) -> [f64; 2] {
        let model = &self.solution.model;
        let (p, phase) = (&model.parameters.mirror, model.parameters.channels[0].phase);
        let largest = self.half_angle();
        if model.mirror != Mirror::Oscillating {
            return [largest; 2];
        }
        let angle = |pulse: Pulse| {
            let beam = model.mirror.direction(p, phase, pulse.time);
            atan2(beam.x, -beam.z).abs()
        };
        let outermost = self.recording.pulses.iter().map(angle).fold(0.5 * p.angle.abs(), f64::max);
        [outermost.min(largest), largest]
    }

    fn add_facets_and_channels(&self, figures: &mut Figures) {
        let (p, d) = (&self.solution.model.parameters, &self.solution.deviations);
        for ((tilt, deviation), name) in p.facet_tilts.iter().zip(&d.facet_tilts).zip(OF_FACETS) {
            figures.add_angle(name, *tilt, Some(*deviation));
        }
        if !self.solution.model.has_channels() {
            return;
        }
        figures.add("channels", p.channels.len() as f64, None, "");
        for (number, (channel, (yaw, pitch))) in p.channels.iter().zip(OF_CHANNELS).enumerate() {
            // The last channel follows from the others.
            let deviation = &d.channels[number.min(p.channels.len() - 2)];
            figures.add_angle(yaw, channel.yaw, Some(deviation.yaw));
            figures.add_angle(pitch, channel.pitch, Some(deviation.pitch));
        }
    }

    fn add_rate(&self, figures: &mut Figures) {
        let rate = &self.rate;
        figures.add("pulse rate", rate.mean, Some(rate.deviation), "1/s");
        if !rate.is_constant() {
            figures.add("lowest pulse rate in a revolution", rate.range.0, None, "1/s");
            figures.add("highest pulse rate in a revolution", rate.range.1, None, "1/s");
            figures.add("deviation of the rates of lines", 100.0 * rate.of_lines, None, "%");
        }
        if let Some(pattern) = &rate.pattern {
            figures.add("lines after which their rates repeat", pattern.period as f64, None, "");
        }
        if !rate.dither.is_empty() {
            figures.add("pulses after which intervals repeat", rate.dither.len() as f64, None, "");
            let shares = rate.dither.iter().map(|factor| 100.0 * (factor - 1.0).abs());
            figures.add("largest deviation of these intervals", shares.fold(0.0, f64::max), None, "%");
        }
        figures.add("pulses without a point", 100.0 * rate.lost, Some(100.0 * rate.lost_deviation), "%");
    }

    /// Height of the platform in the middle of the flight above the mean of the points, m.
    fn height_above_points(&self) -> f64 {
        let pulses = &self.recording.pulses;
        let heights = (0..pulses.len()).map(|i| pulses.position(i).z);
        let mean = heights.sum::<f64>() / pulses.len() as f64;
        self.solution.model.parameters.position.z - mean
    }
}

/// The figures as lines of text: name, value ± standard deviation, unit.
pub fn table(figures: &[Figure]) -> String {
    figures.iter().map(|figure| format!("{:<36} {}\n", figure.name, figure.text())).collect()
}

/// The figures as JSON: an array of name, value, deviation, unit.
///
/// # Errors
/// [`Error::Input`] for values that JSON cannot hold.
pub fn json(figures: &[Figure]) -> Result<String> {
    serde_json::to_string_pretty(figures).map_err(|e| Error::input(e.to_string()))
}

impl Figure {
    /// Value ± standard deviation and unit, with the digits that the deviation allows.
    pub fn text(&self) -> String {
        let digits = match self.deviation {
            Some(deviation) if deviation > 0.0 => {
                (1.0 - libm::log10(deviation).floor()).clamp(0.0, 8.0) as usize
            }
            _ => (4.0 - libm::log10(self.value.abs().max(1e-3)).floor()).clamp(0.0, 6.0) as usize,
        };
        let deviation = self.deviation.map_or(String::new(), |deviation| format!(" ± {deviation:.digits$}"));
        format!("{}{deviation} {}", fixed(self.value, digits), self.unit).trim_end().to_owned()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn digits_follow_from_the_deviation() {
        let text = |value, deviation, unit| Figure { name: "speed", value, deviation, unit }.text();
        assert_eq!(text(58.912_34, Some(0.0123), "m/s"), "58.912 ± 0.012 m/s");
        assert_eq!(text(1.64e6, Some(250.0), "1/s"), "1640000 ± 250 1/s");
        assert_eq!(text(0.25, None, "%"), "0.25000 %");
        assert_eq!(text(2.0, None, ""), "2.0000");
        let figure = Figure { name: "climb", value: 0.5, deviation: Some(0.15), unit: "m/s" };
        assert_eq!(table(&[figure]), format!("{:<36} 0.50 ± 0.15 m/s\n", "climb"));
    }

    #[test]
    fn unknown_deviations_are_left_out() {
        let mut figures = Figures::default();
        figures.add("speed", 1.0, Some(f64::INFINITY), "m/s");
        figures.add_angle("roll", std::f64::consts::PI, Some(0.5));
        assert_eq!((figures.0[0].deviation, figures.0[1].value), (None, 180.0));
        assert_eq!(figures.0[1].deviation, Some(degrees(0.5)));
        assert!(json(&figures.0).unwrap().contains("\"deviation\": null"));
    }
}
