//! Terrestrial surveys: positions of a tripod.

use super::area::Area;
use super::document::{PlannedSurvey, Waypoint};
use super::error::{PlanError, Resolution};
use super::swath::{Scan, SwathModel};
use crate::args;
use std::f64::consts::TAU;
use vlscan_base::error::{Error, Result};
use vlscan_base::quantity::{POSITIVE, amount, duration, number};
use vlscan_geom::{DVec3, degrees, radians};

/// Most positions of a plan.
const MAX_POSITIONS: usize = 100_000;

/// Share of a spacing by which an area may be too small for another position.
const ROUNDING: f64 = 1e-9;

/// Positions around a plot if no number is given.
const DEFAULT_POSITIONS: u32 = 4;

/// Requirements of a terrestrial survey: the positions themselves, or a grid if there is a spacing, else
/// positions around a plot.
#[derive(Clone, Debug, clap::Args)]
pub struct TerrestrialOptions {
    /// Distance of the positions on a square grid over the area, m.
    #[arg(
        long,
        value_name = "M",
        required_unless_present_any = ["around", "at"],
        conflicts_with_all = ["around", "at"],
        value_parser = args::positive,
    )]
    pub spacing: Option<f64>,
    /// Centre of a plot; the positions are on a circle around it.
    #[arg(
        long,
        value_name = "X,Y",
        requires = "radius",
        allow_hyphen_values = true,
        value_parser = args::position,
    )]
    pub around: Option<[f64; 2]>,
    /// Radius of that circle, m.
    #[arg(long, value_name = "M", requires = "around", value_parser = args::positive)]
    pub radius: Option<f64>,
    /// Positions around the plot. [default: 4]
    #[arg(
        short = 'n',
        long,
        value_name = "N",
        conflicts_with_all = ["spacing", "at"],
        value_parser = clap::value_parser!(u32).range(1..=100_000),
    )]
    pub positions: Option<u32>,
    /// One position at the plot's centre as well.
    #[arg(long, requires = "around")]
    pub at_centre: bool,
    /// Place of the tripod, repeatable, instead of a grid or a plot.
    #[arg(
        long,
        value_name = "X,Y",
        conflicts_with = "around",
        allow_hyphen_values = true,
        value_parser = args::position,
    )]
    pub at: Vec<[f64; 2]>,
    /// Angle between points, degrees.
    #[arg(long, value_name = "DEG", default_value = "0.04", value_parser = args::positive)]
    pub resolution: f64,
}

/// Plans full turns of the head at each position, at the height `level`, m, or on the ground of the scene. A
/// grid lies over `area`.
///
/// # Errors
/// [`Error::Input`]: no position, too many, an instrument without a turning head, a resolution that it cannot
/// draw.
pub fn plan_terrestrial(
    area: Option<&Area>,
    instrument: &SwathModel,
    options: &TerrestrialOptions,
    level: f64,
    on_ground: bool,
) -> Result<PlannedSurvey> {
    plan(area, instrument, options, level, on_ground).map_err(Error::from)
}

/// Checks what does not depend on the place: that the instrument can draw points of the resolution.
///
/// # Errors
/// [`Error::Input`].
pub fn check_terrestrial(instrument: &SwathModel, options: &TerrestrialOptions) -> Result<()> {
    scan(instrument, options).map(drop).map_err(Error::from)
}

fn scan(instrument: &SwathModel, options: &TerrestrialOptions) -> Result<Scan, PlanError> {
    args::check([
        ("spacing", options.spacing, POSITIVE),
        ("radius", options.radius, POSITIVE),
        ("resolution", Some(options.resolution), POSITIVE),
    ])?;
    if instrument.head_rate() <= 0.0 {
        return Err(PlanError::NoHead { instrument: instrument.name().to_owned() });
    }
    resolved_scan(instrument, options)
}

fn plan(
    area: Option<&Area>,
    instrument: &SwathModel,
    options: &TerrestrialOptions,
    level: f64,
    on_ground: bool,
) -> Result<PlannedSurvey, PlanError> {
    let scan = scan(instrument, options)?;
    let places = positions(area, options)?;
    let mut document = PlannedSurvey {
        scanner: instrument.reference.clone(),
        settings: scan.settings(),
        ..PlannedSurvey::default()
    };
    document.settings.extend([("head_start_deg", 0.0), ("head_stop_deg", 360.0)]);
    document.waypoints = places
        .iter()
        .enumerate()
        .map(|(i, [x, y])| Waypoint {
            position: DVec3::new(*x, *y, level),
            active: true,
            on_ground,
            strip: Some(format!("position{:03}", i + 1)),
            speed: None,
        })
        .collect();
    describe(&mut document, instrument, options, &scan)?;
    Ok(document)
}

/// The scan with the requested resolution at the requested pulse rate, else at the first of the instrument's
/// rates that its mirror and its head can draw it with.
fn resolved_scan(instrument: &SwathModel, options: &TerrestrialOptions) -> Result<Scan, PlanError> {
    let first = instrument.pulse_rate()?;
    let mut others = instrument.pulse_rates().iter().copied().filter(|_| instrument.wanted_rate.is_none());
    scan_of(instrument, options.resolution, first).or_else(|refused| {
        others.find_map(|rate| scan_of(instrument, options.resolution, rate).ok()).ok_or(refused)
    })
}

/// The scan with that resolution, degrees, at that pulse rate. Lines of a mirror and steps of the head are
/// that far apart (spec kinematics §4.2: pulses are counted over the mirror's whole mechanical angle); of a
/// scanner whose channels the head alone turns the steps of the head.
fn scan_of(instrument: &SwathModel, resolution: f64, pulse_rate: u32) -> Result<Scan, PlanError> {
    let (rate, max_head) = (f64::from(pulse_rate), instrument.head_rate());
    let step = radians(resolution);
    let name = || instrument.name().to_owned();
    let requested = Resolution { degrees: resolution, pulse_rate: rate };
    if !instrument.has_mirror() {
        if !instrument.spins() {
            return Err(PlanError::NoLines { instrument: name() });
        }
        let head_rate = step * rate;
        return match head_rate <= max_head * (1.0 + 1e-9) {
            true => Ok(Scan { half_angle: None, pulse_rate, scan_freq: 0.0, line_rate: 0.0, head_rate }),
            false => Err(PlanError::ChannelHead {
                resolution: requested,
                instrument: name(),
                rate: degrees(head_rate),
                max: degrees(max_head),
                possible: degrees(max_head / rate),
            }),
        };
    }
    let mechanical = instrument.mechanical_angle();
    if !instrument.has_polygon() || mechanical <= 0.0 {
        return Err(PlanError::NoPolygon { instrument: name() });
    }
    let scan_freq = rate * step / (2.0 * mechanical);
    let head_rate = step * scan_freq;
    let (least, most) = instrument.scan_frequencies();
    let resolution_at = |freq: f64| degrees(freq * 2.0 * mechanical / rate);
    if scan_freq < least * (1.0 - 1e-9) || scan_freq > most * (1.0 + 1e-9) {
        return Err(PlanError::MirrorLines {
            resolution: requested,
            instrument: name(),
            lines: scan_freq,
            limits: [least, most],
            possible: [least, most].map(resolution_at),
        });
    }
    if head_rate > max_head * (1.0 + 1e-9) {
        return Err(PlanError::MirrorHead {
            resolution: requested,
            instrument: name(),
            rate: degrees(head_rate),
            max: degrees(max_head),
        });
    }
    let scan_freq = scan_freq.max(least).min(most);
    Ok(Scan {
        half_angle: None,
        pulse_rate,
        scan_freq,
        line_rate: scan_freq,
        head_rate: head_rate.min(max_head),
    })
}

fn positions(area: Option<&Area>, options: &TerrestrialOptions) -> Result<Vec<[f64; 2]>, PlanError> {
    let TerrestrialOptions { spacing, around, radius, positions, at_centre, at, .. } = options;
    let has_plot = around.is_some() || radius.is_some() || positions.is_some() || *at_centre;
    // The command does not accept several, but programs may have given them.
    if [spacing.is_some(), has_plot, !at.is_empty()].into_iter().filter(|given| *given).count() > 1 {
        return Err(PlanError::SeveralPlaces);
    }
    let places = match (options.around.zip(options.radius), area.zip(options.spacing)) {
        _ if !options.at.is_empty() => options.at.clone(),
        // The first one stands to the north.
        (Some(([x, y], radius)), _) => {
            let count = options.positions.unwrap_or(DEFAULT_POSITIONS);
            let on_circle = (0..count).map(|i| {
                let (s, c) = libm::sincos(TAU * f64::from(i) / f64::from(count));
                [x + radius * s, y + radius * c]
            });
            options.at_centre.then_some([x, y]).into_iter().chain(on_circle).collect()
        }
        (None, Some((area, spacing))) => grid(area, spacing)?,
        _ => return Err(PlanError::NoPlace),
    };
    match places.len() {
        0 => Err(PlanError::NoPosition),
        n if n > MAX_POSITIONS => Err(PlanError::Positions { count: n, max: MAX_POSITIONS }),
        _ => Ok(places),
    }
}

/// The positions of a square grid within an area and on its outline, centred: as far from both edges, so that
/// a symmetric area has a symmetric grid.
fn grid(area: &Area, spacing: f64) -> Result<Vec<[f64; 2]>, PlanError> {
    let (low, high) = area.bounds();
    let [(x0, columns), (y0, rows)] = [0, 1].map(|i| {
        // A whole number of spacings may be rounded down.
        let count = ((high[i] - low[i]) / spacing + ROUNDING).floor().max(0.0);
        (0.5 * (low[i] + high[i]) - 0.5 * count * spacing, count as usize + 1)
    });
    if columns.saturating_mul(rows) > 16 * MAX_POSITIONS {
        return Err(PlanError::Grid { columns, rows, max: MAX_POSITIONS });
    }
    let at = |first: f64, i: usize| first + i as f64 * spacing;
    let all = (0..rows).flat_map(|r| (0..columns).map(move |c| [at(x0, c), at(y0, r)]));
    Ok(all.filter(|p| area.covers(*p)).collect())
}

fn describe(
    document: &mut PlannedSurvey,
    instrument: &SwathModel,
    options: &TerrestrialOptions,
    scan: &Scan,
) -> Result<(), PlanError> {
    let count = document.waypoints.len() as f64;
    let seconds = TAU / scan.head_rate;
    let beams = instrument.beams(scan)?;
    let fired = seconds * f64::from(scan.pulse_rate) * beams.fired * instrument.devices();
    let at = |range: f64| range * radians(options.resolution);
    let kilohertz = number(f64::from(scan.pulse_rate) / 1e3);
    document.comments = vec![
        format!(
            "{} at {count} {}, {}° from point to point at {kilohertz} kHz",
            instrument.name(),
            if count == 1.0 { "position" } else { "positions" },
            number(options.resolution)
        ),
        format!("duration   {} per position, {} in all", duration(seconds), duration(seconds * count)),
        format!("pulses     {} per position, {} in all", amount(fired), amount(fired * count)),
        format!("spacing    R·Δ = {:.4} m at 10 m, {:.4} m at 50 m", at(10.0), at(50.0)),
        format!("footprint  {} at 10 m, {} at 50 m", instrument.footprint(10.0), instrument.footprint(50.0)),
    ];
    if !instrument.has_mirror() {
        document.comments.push(format!(
            "channels   {}, at the instrument's fixed angles: the resolution is that of the rotating head",
            instrument.devices()
        ));
    }
    if scan.pulse_rate != instrument.pulse_rate()? {
        document.warnings.push(format!(
            "the pulse rate is {kilohertz} kHz, because the instrument cannot reach {}° at its first one",
            number(options.resolution)
        ));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn options() -> TerrestrialOptions {
        TerrestrialOptions {
            spacing: None,
            around: None,
            radius: None,
            positions: None,
            at_centre: false,
            at: Vec::new(),
            resolution: 0.04,
        }
    }

    #[test]
    fn a_grid_is_centred_and_inside() {
        let area = Area::new(vec![[0.0, 0.0], [30.0, 0.0], [30.0, 30.0], [0.0, 30.0]]).unwrap();
        let places =
            positions(Some(&area), &TerrestrialOptions { spacing: Some(12.0), ..options() }).unwrap();
        assert_eq!(places.len(), 9);
        assert_eq!((places[0], places[8]), ([3.0, 3.0], [27.0, 27.0]));
    }

    #[test]
    fn a_grid_that_meets_the_outline_is_symmetric() {
        let spacing = |spacing: f64| TerrestrialOptions { spacing: Some(spacing), ..options() };
        // 0.3 / 0.1 is a little less than 3.
        for (side, step, count) in [(30.0, 15.0, 3), (30.0, 10.0, 4), (0.3, 0.1, 4)] {
            let area = Area::rectangle([0.0, 0.0], [side, side]).unwrap();
            let places = positions(Some(&area), &spacing(step)).unwrap();
            assert_eq!(places.len(), count * count, "{side} {step}");
            let mirrored = |p: &[f64; 2]| {
                places.iter().any(|q| (p[0] + q[0] - side).abs() < 1e-9 && (p[1] + q[1] - side).abs() < 1e-9)
            };
            assert!(places.iter().all(mirrored));
        }
        // A diamond whose corners and sides are positions.
        let diamond = Area::new(vec![[0.0, -20.0], [20.0, 0.0], [0.0, 20.0], [-20.0, 0.0]]).unwrap();
        assert_eq!(positions(Some(&diamond), &spacing(10.0)).unwrap().len(), 13);
    }

    #[test]
    fn positions_around_a_plot_are_on_its_circle() {
        let around = TerrestrialOptions {
            around: Some([100.0, 50.0]),
            radius: Some(15.0),
            at_centre: true,
            ..options()
        };
        let places = positions(None, &around).unwrap();
        assert_eq!(places.len(), 5);
        assert_eq!(places[0], [100.0, 50.0]);
        assert!((places[1][1] - 65.0).abs() < 1e-12 && (places[2][0] - 115.0).abs() < 1e-12);
    }

    #[test]
    fn places_are_positions_in_their_order() {
        let places = vec![[5.0, -2.0], [0.0, 7.5]];
        assert_eq!(positions(None, &TerrestrialOptions { at: places.clone(), ..options() }).unwrap(), places);
        let both = TerrestrialOptions { at: places, positions: Some(3), ..options() };
        assert!(matches!(positions(None, &both), Err(PlanError::SeveralPlaces)));
    }

    #[test]
    fn what_cannot_be_is_refused() {
        let area = Area::rectangle([0.0, 0.0], [1e6, 1e6]).unwrap();
        let dense = TerrestrialOptions { spacing: Some(0.1), ..options() };
        assert!(positions(Some(&area), &dense).unwrap_err().to_string().contains("at most"));
        assert!(positions(Some(&area), &options()).unwrap_err().to_string().contains("--spacing"));
    }
}
