//! Report of an estimated flight, with uncertainties.

use super::FlightFit;
use super::mirror::Mirror;
use super::model::{CHANNEL_PARAMETERS, FIRST_OF_CHANNELS, MAX_CHANNELS, MAX_FACETS, PLATFORM_PARAMETERS};
use libm::{hypot, tan};
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
    /// Kind of the entry.
    pub name: &'static str,
    /// Its value.
    pub value: f64,
    /// Its standard deviation, where it is known.
    pub deviation: Option<f64>,
    /// Its unit.
    pub unit: &'static str,
}

impl FlightFit {
    /// The estimated quantities, in the order in which they are shown.
    pub fn figures(&self) -> Vec<Figure> {
        let (solution, rate) = (&self.solution, &self.rate);
        let (p, d) = (&solution.model.parameters, &solution.deviations);
        let (of_mirror, mirror_deviations) = (solution.model.of_mirror(), &d[PLATFORM_PARAMETERS..]);
        let mut figures = Vec::new();
        let mut add = |name, value: f64, deviation: Option<f64>, unit| {
            figures.push(Figure { name, value, deviation: deviation.filter(|d| d.is_finite()), unit });
        };
        add("speed", hypot(p[2], p[3]), Some(hypot(d[2], d[3])), "m/s");
        let course = degrees(solution.model.course());
        add("course", course.rem_euclid(360.0), Some(degrees(hypot(d[2], d[3]) / hypot(p[2], p[3]))), "deg");
        let above = p[6] - self.mean_height();
        // What least squares take for independent errors of the angles is in part one error of all.
        let scale = solution.scale_deviation(&self.recording);
        let of_height = hypot(d[6], scale * above);
        let of_angle = degrees(hypot(mirror_deviations[0], scale * of_mirror[0]));
        add("height of the platform", p[6] + self.recording.origin.z, Some(of_height), "m");
        add("height above the points", above, Some(of_height), "m");
        add("climb", p[7], Some(d[7]), "m/s");
        add("roll", degrees(p[8]), Some(degrees(d[8])), "deg");
        add("pitch", degrees(p[9]), Some(degrees(d[9])), "deg");
        match solution.model.mirror {
            Mirror::Cone => {
                add("half angle of the cone", degrees(of_mirror[0]), Some(of_angle), "deg");
                add("radius on the ground", above * tan(of_mirror[0]), None, "m");
                add("revolutions", of_mirror[1].abs(), Some(mirror_deviations[1]), "1/s");
            }
            Mirror::EllipticCone => {
                add("half angle across the flight", degrees(of_mirror[0].abs()), Some(of_angle), "deg");
                let of_along = degrees(hypot(mirror_deviations[4], scale * of_mirror[4]));
                add("half angle along the flight", degrees(of_mirror[4].abs()), Some(of_along), "deg");
                add("revolutions", of_mirror[1].abs(), Some(mirror_deviations[1]), "1/s");
                add("yaw of the ellipse", degrees(of_mirror[3]), Some(degrees(mirror_deviations[3])), "deg");
            }
            Mirror::Polygon => {
                add("angle per line", degrees(of_mirror[0].abs()), Some(of_angle), "deg");
                add("lines", of_mirror[1], Some(mirror_deviations[1]), "1/s");
                add("yaw of the lines", degrees(of_mirror[3]), Some(degrees(mirror_deviations[3])), "deg");
                let tilts = solution.model.facet_tilts();
                for (number, (tilt, name)) in tilts.iter().zip(OF_FACETS).enumerate() {
                    add(name, degrees(*tilt), Some(degrees(d[FIRST_OF_CHANNELS + number])), "deg");
                }
                let channels = solution.model.senses.len();
                if channels > 1 {
                    add("channels", channels as f64, None, "");
                }
                for (number, (yaw, pitch)) in
                    OF_CHANNELS.iter().enumerate().take(channels).filter(|_| channels > 1)
                {
                    let channel = solution.model.channel(number);
                    // The last one's follow from the others'.
                    let of = FIRST_OF_CHANNELS + CHANNEL_PARAMETERS * number.min(channels - 2);
                    add(yaw, degrees(channel.yaw), Some(degrees(d[of + 1])), "deg");
                    add(pitch, degrees(channel.pitch), Some(degrees(d[of + 2])), "deg");
                }
            }
            Mirror::Oscillating => {
                add("half angle", degrees(self.half_angle()), Some(of_angle), "deg");
                add("periods", of_mirror[1], Some(mirror_deviations[1]), "1/s");
                add("yaw of the lines", degrees(of_mirror[3]), Some(degrees(mirror_deviations[3])), "deg");
            }
        }
        add("pulse rate", rate.mean, Some(rate.deviation), "1/s");
        if !rate.is_constant() {
            add("lowest pulse rate in a revolution", rate.range.0, None, "1/s");
            add("highest pulse rate in a revolution", rate.range.1, None, "1/s");
            add("deviation of the rates of lines", 100.0 * rate.of_lines, None, "%");
        }
        if let Some(pattern) = &rate.pattern {
            add("lines after which their rates repeat", pattern.period as f64, None, "");
        }
        if !rate.dither.is_empty() {
            add("pulses after which intervals repeat", rate.dither.len() as f64, None, "");
            let shares = rate.dither.iter().map(|factor| 100.0 * (factor - 1.0).abs());
            add("largest deviation of these intervals", shares.fold(0.0, f64::max), None, "%");
        }
        add("pulses without a point", 100.0 * rate.lost, None, "%");
        if let Some(noise) = self.noise {
            add("range noise with roughness", noise, None, "m");
        }
        add("attitude changes, root mean square", degrees(solution.attitude_spread()), None, "deg");
        add("residual on the ground", solution.residual, None, "m");
        add("residual of the scan angle", degrees(solution.angle_residual), None, "deg");
        figures
    }

    /// Mean height of the points, m, relative to the origin.
    pub(super) fn mean_height(&self) -> f64 {
        let pulses = &self.recording.pulses;
        pulses.iter().map(|pulse| pulse.position.z).sum::<f64>() / pulses.len() as f64
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
