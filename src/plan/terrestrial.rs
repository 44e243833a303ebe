//! Terrestrial surveys: positions of a tripod.

use super::area::Area;
use super::document::{Document, Waypoint};
use super::swath::Instrument;
use crate::geom::{DVec3, degrees};
use crate::quantity::{amount, duration};
use std::f64::consts::TAU;

/// Most positions of a plan.
const MAX_POSITIONS: usize = 100_000;

/// Where the tripod stands.
#[derive(Clone, Debug)]
pub enum Arrangement {
    /// On a square grid, this far apart (m), inside an area.
    Grid { area: Area, spacing: f64 },
    /// Evenly on a circle around a plot's centre, the first one to the north.
    Around { centre: [f64; 2], radius: f64, count: u32, at_centre: bool },
}

/// What a terrestrial survey shall be.
#[derive(Clone, Debug)]
pub struct TerrestrialOptions {
    pub arrangement: Arrangement,
    /// Angle between neighbouring points, degrees.
    pub resolution: f64,
    /// Pulses per second.
    pub pulse_rate: Option<u32>,
    /// Height of the ground where the scene tells none, m.
    pub level: f64,
    /// Whether there is a scene whose ground the tripod is set on.
    pub on_ground: bool,
}

/// Plans full turns of the head at each position.
///
/// # Errors
/// A sentence: no position, too many, an instrument without a turning head.
pub fn plan_terrestrial(instrument: &Instrument, options: &TerrestrialOptions) -> Result<Document, String> {
    if instrument.head_rate <= 0.0 {
        return Err(format!("the head of {} does not turn; it is no terrestrial scanner", instrument.name));
    }
    let pulse_rate = match (options.pulse_rate, instrument.pulse_rates.first()) {
        (Some(rate), _) | (None, Some(&rate)) if rate > 0 => rate,
        _ => return Err("the instrument has no usual pulse rate: --pulse-rate is needed".to_owned()),
    };
    let places = positions(&options.arrangement)?;
    let mut document = Document { scanner: instrument.reference.clone(), ..Document::default() };
    document.setting("pulse_freq_hz", f64::from(pulse_rate));
    document.setting("vertical_resolution_deg", options.resolution);
    document.setting("horizontal_resolution_deg", options.resolution);
    document.setting("head_start_deg", 0.0);
    document.setting("head_stop_deg", 360.0);
    document.waypoints = places
        .iter()
        .enumerate()
        .map(|(i, [x, y])| Waypoint {
            position: DVec3::new(*x, *y, options.level),
            active: true,
            on_ground: options.on_ground,
            strip: Some(format!("position{:03}", i + 1)),
            speed: None,
        })
        .collect();
    describe(&mut document, instrument, options, pulse_rate);
    Ok(document)
}

fn positions(arrangement: &Arrangement) -> Result<Vec<[f64; 2]>, String> {
    let places = match arrangement {
        Arrangement::Grid { area, spacing } => {
            let (low, high) = area.bounds();
            // Centred: as far from both edges.
            let axis = |i: usize| {
                let count = ((high[i] - low[i]) / spacing).floor().max(0.0);
                let first = 0.5 * (low[i] + high[i]) - 0.5 * count * spacing;
                (first, count as usize + 1)
            };
            let ((x0, columns), (y0, rows)) = (axis(0), axis(1));
            if columns.saturating_mul(rows) > 16 * MAX_POSITIONS {
                return Err(format!(
                    "a grid of {columns} by {rows} positions, expected at most {MAX_POSITIONS}"
                ));
            }
            let at = |first: f64, i: usize| first + i as f64 * spacing;
            let all = (0..rows).flat_map(|r| (0..columns).map(move |c| (r, c)));
            all.map(|(r, c)| [at(x0, c), at(y0, r)]).filter(|p| area.contains(*p)).collect()
        }
        Arrangement::Around { centre: [x, y], radius, count, at_centre } => {
            let mut places: Vec<[f64; 2]> = if *at_centre { vec![[*x, *y]] } else { Vec::new() };
            places.extend((0..*count).map(|i| {
                let (s, c) = libm::sincos(TAU * f64::from(i) / f64::from(*count));
                [x + radius * s, y + radius * c]
            }));
            places
        }
    };
    match places.len() {
        0 => Err("no position is inside the area; a smaller spacing is needed".to_owned()),
        n if n > MAX_POSITIONS => Err(format!("{n} positions, expected at most {MAX_POSITIONS}")),
        _ => Ok(places),
    }
}

fn describe(document: &mut Document, instrument: &Instrument, options: &TerrestrialOptions, pulse_rate: u32) {
    let count = document.waypoints.len();
    // Lines of one turn of the head, and the time that the mirror takes for each (spec kinematics §4.2): pulses are counted
    // over its whole mechanical angle.
    let lines = 360.0 / options.resolution;
    let pulses_per_line = 2.0 * degrees(instrument.mechanical_angle()) / options.resolution;
    let seconds = lines * pulses_per_line / f64::from(pulse_rate);
    let fired = lines * pulses_per_line * instrument.usable_fraction();
    let at = |range: f64| range * options.resolution.to_radians();
    document.comments = vec![
        format!("{} at {count} positions, {}° from point to point", instrument.name, options.resolution),
        format!("duration   {} per position, {} in all", duration(seconds), duration(seconds * count as f64)),
        format!("pulses     {} per position, {} in all", amount(fired), amount(fired * count as f64)),
        format!("spacing    R·Δ = {:.4} m at 10 m, {:.4} m at 50 m", at(10.0), at(50.0)),
        format!(
            "footprint  {:.4} m at 10 m, {:.4} m at 50 m",
            instrument.footprint(10.0),
            instrument.footprint(50.0)
        ),
    ];
    let (least, most) = instrument.scan_frequencies();
    let scan_freq = f64::from(pulse_rate) / pulses_per_line;
    if scan_freq < least || (most > 0.0 && scan_freq > most) {
        document.warnings.push(format!(
            "the mirror would draw {scan_freq:.1} lines a second, and the instrument {least} to {most}; choose another resolution \
             or pulse rate"
        ));
    }
    let head_rate = 360.0 / seconds;
    if head_rate > degrees(instrument.head_rate) {
        document.warnings.push(format!(
            "the head would turn at {head_rate:.2}°/s, faster than the instrument's {:.2}°/s; raise the resolution or lower the \
             pulse rate",
            degrees(instrument.head_rate)
        ));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_grid_is_centred_and_inside() {
        let area = Area::new(vec![[0.0, 0.0], [30.0, 0.0], [30.0, 30.0], [0.0, 30.0]]).unwrap();
        let places = positions(&Arrangement::Grid { area, spacing: 12.0 }).unwrap();
        assert_eq!(places.len(), 9);
        assert_eq!((places[0], places[8]), ([3.0, 3.0], [27.0, 27.0]));
    }

    #[test]
    fn positions_around_a_plot_are_on_its_circle() {
        let around = Arrangement::Around { centre: [100.0, 50.0], radius: 15.0, count: 4, at_centre: true };
        let places = positions(&around).unwrap();
        assert_eq!(places.len(), 5);
        assert_eq!(places[0], [100.0, 50.0]);
        assert!((places[1][1] - 65.0).abs() < 1e-12 && (places[2][0] - 115.0).abs() < 1e-12);
    }

    #[test]
    fn what_cannot_be_is_refused() {
        let area = Area::rectangle([0.0, 0.0], [1e6, 1e6]).unwrap();
        assert!(positions(&Arrangement::Grid { area, spacing: 0.1 }).unwrap_err().contains("at most"));
    }
}
