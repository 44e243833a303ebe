//! Terrestrial surveys: positions of a tripod.

use super::area::Area;
use super::document::{Document, Waypoint};
use super::swath::{Instrument, Scan, span};
use std::f64::consts::TAU;
use vlscan_base::quantity::{amount, duration, number};
use vlscan_geom::{DVec3, degrees, radians};

/// Most positions of a plan.
const MAX_POSITIONS: usize = 100_000;

/// Where the tripod stands.
#[derive(Clone, Debug)]
pub enum Arrangement {
    /// On a square grid inside an area.
    Grid {
        /// The area that contains all positions.
        area: Area,
        /// Distance between neighbouring positions, m.
        spacing: f64,
    },
    /// Evenly on a circle around a plot's centre, the first one to the north.
    Around {
        /// Centre of the plot, x and y in m.
        centre: [f64; 2],
        /// Radius of the circle, m.
        radius: f64,
        /// Number of positions on the circle.
        count: u32,
        /// Whether there is also a position at the centre, which comes first.
        at_centre: bool,
    },
}

/// What a terrestrial survey shall be.
#[derive(Clone, Debug)]
pub struct TerrestrialOptions {
    /// Positions of the tripod.
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
/// A sentence: no position, too many, an instrument without a turning head, a resolution that it cannot draw.
pub fn plan_terrestrial(instrument: &Instrument, options: &TerrestrialOptions) -> Result<Document, String> {
    if instrument.head_rate() <= 0.0 {
        return Err(format!("the head of {} does not turn; it is no terrestrial scanner", instrument.name()));
    }
    let scan = resolved_scan(instrument, options)?;
    let places = positions(&options.arrangement)?;
    let mut document =
        Document { scanner: instrument.reference.clone(), settings: scan.settings(), ..Document::default() };
    document.settings.extend([("head_start_deg", 0.0), ("head_stop_deg", 360.0)]);
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
    describe(&mut document, instrument, options, &scan)?;
    Ok(document)
}

/// The scan with the requested resolution at the requested pulse rate, else at the first of the instrument's rates that its
/// mirror and its head can draw it with.
fn resolved_scan(instrument: &Instrument, options: &TerrestrialOptions) -> Result<Scan, String> {
    let first = instrument.pulse_rate(options.pulse_rate)?;
    let others = instrument.pulse_rates().iter().copied().filter(|_| options.pulse_rate.is_none());
    let mut refused = None;
    for rate in [first].into_iter().chain(others) {
        match scan_of(instrument, options.resolution, rate) {
            Ok(scan) => return Ok(scan),
            Err(reason) => {
                refused.get_or_insert(reason);
            }
        }
    }
    Err(refused.unwrap_or_default())
}

/// The scan with that resolution, degrees, at that pulse rate. Lines of a mirror and steps of the head are that far apart (spec
/// kinematics §4.2: pulses are counted over the mirror's whole mechanical angle); of a scanner whose channels the head alone
/// turns the steps of the head.
fn scan_of(instrument: &Instrument, resolution: f64, pulse_rate: u32) -> Result<Scan, String> {
    let (rate, most_head) = (f64::from(pulse_rate), instrument.head_rate());
    let step = radians(resolution);
    let asked = || format!("--resolution {} at {} kHz", number(resolution), number(rate / 1e3));
    if !instrument.has_mirror() {
        if !instrument.spins() {
            return Err(format!("{} has neither a mirror nor channels that draw lines", instrument.name()));
        }
        let head_rate = step * rate;
        return match head_rate <= most_head * (1.0 + 1e-9) {
            true => Ok(Scan { half_angle: None, pulse_rate, scan_freq: 0.0, line_rate: 0.0, head_rate }),
            false => Err(format!(
                "{}: the head would turn at {}°/s, and that of {} at most at {}°/s; at most {}° is possible",
                asked(),
                number(degrees(head_rate)),
                instrument.name(),
                number(degrees(most_head)),
                number(degrees(most_head / rate))
            )),
        };
    }
    let mechanical = instrument.mechanical_angle();
    if !instrument.has_polygon() || mechanical <= 0.0 {
        return Err(format!(
            "{} has no polygon mirror, for which resolutions are defined",
            instrument.name()
        ));
    }
    let scan_freq = rate * step / (2.0 * mechanical);
    let head_rate = step * scan_freq;
    let (least, most) = instrument.scan_frequencies();
    let resolution_at = |freq: f64| degrees(freq * 2.0 * mechanical / rate);
    if scan_freq < least * (1.0 - 1e-9) || scan_freq > most * (1.0 + 1e-9) {
        return Err(format!(
            "{}: the mirror would draw {} lines a second, and that of {} draws {}; resolutions of {}° are possible",
            asked(),
            number(scan_freq),
            instrument.name(),
            span(least, most),
            span(resolution_at(least), resolution_at(most))
        ));
    }
    if head_rate > most_head * (1.0 + 1e-9) {
        return Err(format!(
            "{}: the head would turn at {}°/s, and that of {} at most at {}°/s; choose a finer resolution or a lower pulse rate",
            asked(),
            number(degrees(head_rate)),
            instrument.name(),
            number(degrees(most_head))
        ));
    }
    let scan_freq = scan_freq.max(least).min(most);
    Ok(Scan {
        half_angle: None,
        pulse_rate,
        scan_freq,
        line_rate: scan_freq,
        head_rate: head_rate.min(most_head),
    })
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

fn describe(
    document: &mut Document,
    instrument: &Instrument,
    options: &TerrestrialOptions,
    scan: &Scan,
) -> Result<(), String> {
    let count = document.waypoints.len() as f64;
    let seconds = TAU / scan.head_rate;
    let beams = instrument.beams(scan)?;
    let fired = seconds * f64::from(scan.pulse_rate) * beams.fired * instrument.devices();
    let at = |range: f64| range * radians(options.resolution);
    let kilohertz = number(f64::from(scan.pulse_rate) / 1e3);
    document.comments = vec![
        format!(
            "{} at {count} positions, {}° from point to point at {kilohertz} kHz",
            instrument.name(),
            number(options.resolution)
        ),
        format!("duration   {} per position, {} in all", duration(seconds), duration(seconds * count)),
        format!("pulses     {} per position, {} in all", amount(fired), amount(fired * count)),
        format!("spacing    R·Δ = {:.4} m at 10 m, {:.4} m at 50 m", at(10.0), at(50.0)),
        format!("footprint  {} at 10 m, {} at 50 m", instrument.footprint(10.0), instrument.footprint(50.0)),
    ];
    if !instrument.has_mirror() {
        document.comments.push(format!(
            "channels   {} of them, whose angles to one another are the instrument's: the resolution is that of the turning head",
            instrument.devices()
        ));
    }
    if scan.pulse_rate != instrument.pulse_rate(options.pulse_rate)? {
        document.warnings.push(format!(
            "the pulse rate is {kilohertz} kHz, since the instrument cannot draw {}° at its first one",
            number(options.resolution)
        ));
    }
    Ok(())
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
