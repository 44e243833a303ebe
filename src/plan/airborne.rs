//! Airborne surveys: parallel lines over an area.

use super::area::Area;
use super::document::{Document, Waypoint};
use super::height::{Ground, Heights, Level, mean_ground};
use super::line::{Line, turn};
use super::swath::{Instrument, Swath};
use crate::geom::{DVec3, degrees, radians};
use crate::quantity::{amount, duration};
use std::f64::consts::PI;

/// Most flight lines of a plan.
const MAX_LINES: f64 = 10_000.0;

/// Relative departure from the requested density above which a plan warns.
const MAX_DENSITY_ERROR: f64 = 0.03;

/// What an airborne survey shall be. Of speed, overlap and density at least one is given besides those with defaults;
/// density with overlap yields the speed, density with speed the distance of the lines.
#[derive(Clone, Debug)]
pub struct AirborneOptions {
    /// Height above the ground, m.
    pub height: f64,
    /// Speed, m/s.
    pub speed: Option<f64>,
    /// Side overlap of neighbouring strips, a fraction of the swath.
    pub overlap: Option<f64>,
    /// Mean pulses per m².
    pub density: Option<f64>,
    /// Half opening angle, degrees.
    pub scan_angle: Option<f64>,
    /// Pulses per second.
    pub pulse_rate: Option<u32>,
    /// Hz.
    pub scan_freq: Option<f64>,
    /// Direction of the lines, degrees clockwise from +y; the one with the fewest lines if `None`.
    pub heading: Option<f64>,
    /// Lines across the others.
    pub cross_lines: u32,
    /// Length by which each line begins before the area and ends behind it, m.
    pub run_in: Option<f64>,
    /// Angle by which the scanner looks behind the vertical, rad: lines are shifted ahead so that their strips lie over the area.
    pub look_back: f64,
    /// Radius of the turns between lines, m; straight to the next line if `None`.
    pub turn_radius: Option<f64>,
    /// Steepest climb of lines that follow the ground, degrees; level lines if `None`.
    pub climb: Option<f64>,
}

/// A frame in the direction of the lines.
#[derive(Clone, Copy)]
struct Frame {
    /// Unit vectors.
    along: [f64; 2],
    across: [f64; 2],
    /// An origin near the area, so that no digits are lost.
    origin: [f64; 2],
}

impl Frame {
    /// `heading` is rad clockwise from +y.
    fn new(heading: f64, origin: [f64; 2]) -> Frame {
        let (s, c) = libm::sincos(heading);
        Frame { along: [s, c], across: [c, -s], origin }
    }

    fn project(&self, axis: [f64; 2], p: [f64; 2]) -> f64 {
        (p[0] - self.origin[0]) * axis[0] + (p[1] - self.origin[1]) * axis[1]
    }

    fn point(&self, along: f64, across: f64) -> [f64; 2] {
        [0, 1].map(|i| self.origin[i] + along * self.along[i] + across * self.across[i])
    }

    /// The extent of the area along where its distance across is within `limits`.
    fn extent(&self, area: &Area, limits: [f64; 2]) -> Option<[f64; 2]> {
        area.extent(|p| self.project(self.along, p), |p| self.project(self.across, p), limits)
    }

    /// The extent of the area across.
    fn width(&self, area: &Area) -> [f64; 2] {
        let distances = area.corners().iter().map(|p| self.project(self.across, *p));
        distances.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], d| [low.min(d), high.max(d)])
    }
}

/// Speed, distance of the lines and scan of a plan.
struct Choice {
    swath: Swath,
    speed: f64,
    spacing: f64,
    /// Mean over the area of the parallel lines, pulses/m².
    density: f64,
}

/// Plans parallel lines over an area, flown to and fro, so that every point of it is covered as often as by an endless
/// row of such lines; then the cross lines.
///
/// # Errors
/// A sentence: options that contradict each other or exceed the instrument.
pub fn plan_airborne(
    area: &Area,
    instrument: &Instrument,
    options: &AirborneOptions,
    ground: &Ground,
) -> Result<Document, String> {
    let height = options.height;
    let mut document = Document::default();
    let heading = options.heading.map_or_else(|| best_heading(area), radians);
    let frame = Frame::new(heading, area.corners()[0]);
    let choice = choose(area, &frame, instrument, options)?;
    let Choice { swath, speed, spacing, .. } = &choice;
    let width = swath.width(height);
    let run_in = options.run_in.unwrap_or_else(|| match instrument.looks_ahead() {
        // The ring of a conic scan reaches that far ahead.
        true => width / 2.0,
        // At least one whole scan line.
        false => speed / swath.line_rate.max(1.0),
    });
    let mut lines = parallel_lines(area, &frame, width, *spacing, run_in)?;
    let parallel = lines.len();
    lines.extend(cross_lines(area, heading + PI / 2.0, options.cross_lines, run_in));
    turn_every_second(&mut lines);
    let ahead = height * options.look_back.tan();
    lines.iter_mut().for_each(|line| line.shift(ahead));
    let level = mean_ground(area, ground);
    let heights = Heights { ground, level: level.mean, above: height, climb: options.climb.map(radians) };
    let mut active = 0.0;
    for (i, line) in lines.iter().enumerate() {
        let strip = format!("{}{:03}", if i < parallel { "line" } else { "cross" }, i + 1);
        let points = heights.follow(line)?;
        active += length(&points);
        let last = points.len() - 1;
        for (k, position) in points.iter().enumerate() {
            document.waypoints.push(Waypoint {
                position: *position,
                speed: Some(*speed),
                active: k < last,
                on_ground: false,
                strip: (k < last).then(|| strip.clone()),
            });
        }
        if let (Some(radius), Some(next)) = (options.turn_radius, lines.get(i + 1)) {
            let z = points[last].z;
            document.waypoints.extend(turn(line, next, radius).into_iter().map(|[x, y]| Waypoint {
                position: DVec3::new(x, y, z),
                speed: Some(*speed),
                ..Waypoint::default()
            }));
        }
    }
    settings(&mut document, instrument, swath);
    let report =
        PlanReport { area, instrument, choice: &choice, height, heading, run_in, parallel, active, level };
    report.describe(&mut document, options);
    Ok(document)
}

fn choose(
    area: &Area,
    frame: &Frame,
    instrument: &Instrument,
    options: &AirborneOptions,
) -> Result<Choice, String> {
    let half_angle = instrument.half_angle(options.scan_angle)?;
    let pulse_rate = match (options.pulse_rate, instrument.pulse_rates.first()) {
        (Some(rate), _) | (None, Some(&rate)) if rate > 0 => rate,
        _ => return Err("the instrument has no usual pulse rate: --pulse-rate is needed".to_owned()),
    };
    let width = 2.0 * options.height * half_angle.tan();
    let scan = |speed: f64| instrument.swath(half_angle, pulse_rate, options.scan_freq, [speed, width]);
    // Its rate does not depend on the speed.
    let swath = scan(1.0)?;
    let spacing_of = |overlap: Option<f64>| width * (1.0 - overlap.unwrap_or(0.3));
    // The density over the area at 1 m/s.
    let slow_density = |spacing: f64| -> Result<f64, String> {
        let places = line_places(area, frame, width, spacing)?;
        Ok(density_over(area, frame, &places, instrument, &swath, options.height))
    };
    let (speed, spacing) = match (options.density, options.speed, options.overlap) {
        (Some(_), Some(_), Some(_)) => {
            return Err("density, speed and overlap determine each other: leave one out".to_owned());
        }
        (Some(density), Some(speed), None) => {
            let mut spacing = swath.fired_rate / (density * speed);
            // Edges and the number of lines change the density over the area a little.
            // Where it jumps there may be no such spacing: the nearest one counts.
            let mut best = (f64::INFINITY, spacing);
            for _ in 0..12 {
                let found = slow_density(spacing)? / speed;
                let off = (found / density - 1.0).abs();
                best = if off < best.0 { (off, spacing) } else { best };
                spacing *= (found / density).clamp(0.5, 2.0);
            }
            let spacing = best.1;
            if spacing > width * 1.001 {
                return Err(format!(
                    "at {speed} m/s one strip has {:.2} pulses/m² already, more than {density}; fly higher or faster, or \
                     lower the pulse rate",
                    swath.fired_rate / (speed * width)
                ));
            }
            (speed, spacing)
        }
        (Some(density), None, overlap) => {
            let spacing = spacing_of(overlap);
            (slow_density(spacing)? / density, spacing)
        }
        (None, Some(speed), overlap) => (speed, spacing_of(overlap)),
        (None, None, _) => {
            return Err("how fast? --speed, or --density from which it follows, is needed".to_owned());
        }
    };
    if !(speed > 1e-3 && speed < 1000.0) {
        return Err(format!(
            "a speed of {speed:.4} m/s follows, expected 0.001 to 1000 m/s; change density, pulse rate or height"
        ));
    }
    Ok(Choice { density: slow_density(spacing)? / speed, swath: scan(speed)?, speed, spacing })
}

/// Mean density over the area of strips flown at 1 m/s at these distances across, pulses/m²: the integral across of what the
/// strips have there and of how long the area is there.
fn density_over(
    area: &Area,
    frame: &Frame,
    places: &[f64],
    instrument: &Instrument,
    swath: &Swath,
    height: f64,
) -> f64 {
    const STEPS: u32 = 4000;
    let [low, high] = frame.width(area);
    let step = (high - low) / f64::from(STEPS);
    let half = swath.width(height) / 2.0;
    let first = |x: f64| places.partition_point(|place| *place < x - half);
    let (mut pulses, mut square) = (0.0, 0.0);
    for i in 0..STEPS {
        let x = low + (f64::from(i) + 0.5) * step;
        let Some([from, to]) = frame.extent(area, [x; 2]) else { continue };
        let near = places[first(x)..].iter().take_while(|place| **place <= x + half);
        let per_metre: f64 = near.map(|place| instrument.profile(x - place, height, swath.half_angle)).sum();
        pulses += per_metre * (to - from);
        square += to - from;
    }
    swath.fired_rate * pulses / square
}

/// The heading, rad, of the side of the area along which lines are fewest: the one across which it is narrowest.
fn best_heading(area: &Area) -> f64 {
    let across = |heading: f64| {
        let [low, high] = Frame::new(heading, area.corners()[0]).width(area);
        high - low
    };
    let headings = area.sides().map(|[a, b]| libm::atan2(b[0] - a[0], b[1] - a[1]));
    let best = headings.min_by(|a, b| across(*a).total_cmp(&across(*b))).unwrap_or(0.0);
    // Of the two directions of a line the one between north and south-east.
    let best = best.rem_euclid(PI);
    if PI - best < 1e-9 { 0.0 } else { best }
}

/// Distances across of lines `spacing` apart. The outermost line lies so that the next one, which is not flown, would not
/// reach the area.
fn line_places(area: &Area, frame: &Frame, width: f64, spacing: f64) -> Result<Vec<f64>, String> {
    let [low, high] = frame.width(area);
    let needed = (high - low) + width - 2.0 * spacing;
    let count = if needed > 1e-9 { (needed / spacing - 1e-9).ceil() + 1.0 } else { 1.0 };
    if count > MAX_LINES {
        return Err(format!("{count:.0} flight lines, expected at most {MAX_LINES}"));
    }
    let first = 0.5 * (low + high) - 0.5 * (count - 1.0) * spacing;
    Ok((0..count as u32).map(|i| first + f64::from(i) * spacing).collect())
}

fn parallel_lines(
    area: &Area,
    frame: &Frame,
    width: f64,
    spacing: f64,
    run_in: f64,
) -> Result<Vec<Line>, String> {
    let lines = line_places(area, frame, width, spacing)?.into_iter().filter_map(|across| {
        let half = width / 2.0;
        let [from, to] = frame.extent(area, [across - half, across + half])?;
        Some(Line { from: frame.point(from - run_in, across), to: frame.point(to + run_in, across) })
    });
    Ok(lines.collect())
}

/// Lines across, at the middles of equal shares of the area's length.
fn cross_lines(area: &Area, heading: f64, count: u32, run_in: f64) -> Vec<Line> {
    let frame = Frame::new(heading, area.corners()[0]);
    let [low, high] = frame.width(area);
    let lines = (0..count).filter_map(|i| {
        let across = low + (high - low) * (f64::from(i) + 0.5) / f64::from(count);
        let [from, to] = frame.extent(area, [across; 2])?;
        Some(Line { from: frame.point(from - run_in, across), to: frame.point(to + run_in, across) })
    });
    lines.collect()
}

fn turn_every_second(lines: &mut [Line]) {
    lines.iter_mut().skip(1).step_by(2).for_each(|line| std::mem::swap(&mut line.from, &mut line.to));
}

fn length(points: &[DVec3]) -> f64 {
    points.windows(2).map(|pair| pair[0].distance(pair[1])).sum()
}

pub(super) fn settings(document: &mut Document, instrument: &Instrument, swath: &Swath) {
    document.scanner = instrument.reference.clone();
    document.setting("pulse_freq_hz", f64::from(swath.pulse_rate));
    if swath.scan_freq > 0.0 {
        document.setting("scan_freq_hz", swath.scan_freq);
    }
    if swath.head_rate > 0.0 {
        document.setting("head_rate_deg_per_s", degrees(swath.head_rate));
    }
    document.setting("scan_angle_deg", degrees(swath.half_angle));
}

/// What the comments of a plan report.
struct PlanReport<'f> {
    area: &'f Area,
    instrument: &'f Instrument,
    choice: &'f Choice,
    height: f64,
    heading: f64,
    run_in: f64,
    parallel: usize,
    /// Length of the lines, m.
    active: f64,
    level: Level,
}

impl PlanReport<'_> {
    fn describe(&self, document: &mut Document, options: &AirborneOptions) {
        let Choice { swath, speed, spacing, .. } = self.choice;
        let (height, width) = (self.height, swath.width(self.height));
        let hectares = self.area.square_metres() / 1e4;
        let flown = document.length();
        let range = height / swath.half_angle.cos();
        let footprint = self.instrument.footprint(height);
        let [nadir, edge] = swath.density_in_strip(*speed, height);
        let lines = &mut document.comments;
        lines.push(format!(
            "{} over {hectares:.2} ha, {height} m above the ground at {speed:.2} m/s",
            self.instrument.name
        ));
        lines.push(format!(
            "lines      {} at heading {:.1}°, {spacing:.2} m apart, {} across; {:.2} km of {:.2} km flown measure",
            self.parallel,
            degrees(self.heading),
            options.cross_lines,
            self.active / 1e3,
            flown / 1e3
        ));
        lines.push(format!("duration   {} ({:.1} s)", duration(flown / speed), flown / speed));
        lines.push(format!(
            "pulses     {} leave the instrument, {} per second",
            amount(self.active / speed * swath.fired_rate),
            amount(swath.fired_rate)
        ));
        lines.push(format!(
            "swath      2·h·tan θ = {width:.2} m, overlap 1 − S/W = {:.1} %, lines begin and end {:.1} m outside the area",
            100.0 * (1.0 - spacing / width),
            self.run_in
        ));
        if options.look_back.abs() > 1e-6 {
            lines.push(format!(
                "shift      h·tan = {:.1} m ahead, since the platform's mount tilts the scanner back by {:.1}°",
                height * options.look_back.tan(),
                degrees(options.look_back)
            ));
        }
        lines.push(format!(
            "density    {:.3} pulses/m² over the area, N/(v·S) = {:.3} far from its edges; one strip {nadir:.3} below, {edge:.3} at its \
             edge",
            self.choice.density,
            swath.density(*speed, *spacing)
        ));
        if swath.line_rate > 0.0 {
            lines.push(format!(
                "spacing    v/f = {:.3} m along, W·f/N = {:.3} m across",
                speed / swath.line_rate,
                width * swath.line_rate / swath.fired_rate
            ));
        }
        lines.push(format!("footprint  {footprint:.3} m below the platform; range at the edge {range:.0} m"));
        let mut warn = |text: String| document.warnings.push(text);
        if let Some(asked) = options.density
            && (self.choice.density / asked - 1.0).abs() > MAX_DENSITY_ERROR
        {
            warn(format!(
                "the density over the area is {:.3} pulses/m² and not {asked}: the number of lines jumps there; at {:.3} m/s it \
                 would be {asked}",
                self.choice.density,
                speed * self.choice.density / asked
            ));
        }
        if range > self.instrument.range_max {
            warn(format!(
                "the edge of the swath is {range:.0} m away, farther than the instrument's {:.0} m",
                self.instrument.range_max
            ));
        }
        if height < self.instrument.range_min {
            warn(format!(
                "the ground is {height:.0} m away, nearer than the instrument measures: {:.0} m",
                self.instrument.range_min
            ));
        }
        let relief = self.level.high - self.level.low;
        if options.climb.is_none() && relief > 0.1 * height {
            warn(format!(
                "the ground differs by {relief:.0} m within the area, and level lines have other swaths and densities over \
                 it; --follow-terrain keeps the height above it"
            ));
        }
        if self.level.known == 0.0 {
            warn(format!(
                "the scene has no ground in the area, which is taken as {:.1} m high; --ground gives another height",
                self.level.mean
            ));
        } else if self.level.known < 0.99 {
            warn(format!(
                "{:.0} % of the area have no ground in the scene",
                100.0 * (1.0 - self.level.known)
            ));
        }
        let pieces = self.active / speed * swath.fired_rate;
        if pieces > 1e11 {
            warn(format!("{} pulses are more than most computers compute", amount(pieces)));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::survey::catalogue;

    fn instrument() -> Instrument {
        let (known, _) = catalogue().unwrap();
        let found = known.scanners.iter().find(|(reference, _)| reference.ends_with("#riegl_lms-q780"));
        let (reference, scanner) = found.unwrap();
        Instrument::new(reference.clone(), scanner)
    }

    fn options() -> AirborneOptions {
        AirborneOptions {
            height: 500.0,
            speed: Some(60.0),
            overlap: None,
            density: None,
            scan_angle: None,
            pulse_rate: None,
            scan_freq: None,
            heading: None,
            cross_lines: 0,
            run_in: None,
            look_back: 0.0,
            turn_radius: None,
            climb: None,
        }
    }

    const FLAT: Ground = Ground { height: &|_, _| Some(100.0), level: 0.0 };

    #[test]
    fn lines_are_along_the_longer_side_and_cover_the_area() {
        let area = Area::rectangle([0.0, 0.0], [3000.0, 1000.0]).unwrap();
        let plan = plan_airborne(&area, &instrument(), &options(), &FLAT).unwrap();
        // Swath 577.35 m, spacing 404.15 m: (1000 + 577.35) / 404.15 - 2 = 1.9, so 2 + 1 lines.
        let starts: Vec<_> = plan.waypoints.iter().filter(|w| w.active).collect();
        assert_eq!(starts.len(), 3);
        assert!(plan.waypoints.iter().all(|w| w.position.z == 600.0));
        let y: Vec<f64> = starts.iter().map(|w| w.position.y).collect();
        assert!((y.iter().sum::<f64>() / 3.0 - 500.0).abs() < 1e-9, "{y:?}");
        assert!(y.iter().any(|y| *y - 404.2 <= -577.35 / 2.0 + 1e-6), "{y:?}");
        // To and fro.
        assert!(starts[0].position.x < 0.0 && starts[1].position.x > 3000.0);
    }

    #[test]
    fn density_yields_speed_or_spacing() {
        let area = Area::rectangle([0.0, 0.0], [3000.0, 1000.0]).unwrap();
        let frame = Frame::new(best_heading(&area), [0.0; 2]);
        let chosen = |options: &AirborneOptions| choose(&area, &frame, &instrument(), options);
        let with_density = AirborneOptions { density: Some(8.0), speed: None, ..options() };
        let choice = chosen(&with_density).unwrap();
        assert!((choice.density - 8.0).abs() < 1e-9);
        assert!((choice.swath.density(choice.speed, choice.spacing) - 8.0).abs() < 0.8);
        assert!((choice.spacing / choice.swath.width(500.0) - 0.7).abs() < 1e-12);
        let both = AirborneOptions { density: Some(12.0), speed: Some(60.0), ..options() };
        let choice = chosen(&both).unwrap();
        assert!((choice.density / 12.0 - 1.0).abs() < 0.03, "{}", choice.density);
        // Of small areas the number of lines decides: a density that is missed is a warning, with the speed that would meet it.
        let tiny = Area::rectangle([0.0, 0.0], [900.0, 600.0]).unwrap();
        let mut warnings = 0;
        for density in [3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0] {
            let options = AirborneOptions { density: Some(density), ..both.clone() };
            let Ok(plan) = plan_airborne(&tiny, &instrument(), &options, &FLAT) else { continue };
            let found = plan.comments.iter().find(|line| line.starts_with("density")).unwrap();
            let found: f64 = found.split_whitespace().nth(1).unwrap().parse().unwrap();
            let has_warned = plan.warnings.iter().any(|text| text.contains("lines jumps"));
            assert_eq!(has_warned, (found / density - 1.0).abs() > MAX_DENSITY_ERROR, "{density}: {found}");
            warnings += usize::from(has_warned);
        }
        assert!(warnings > 0);
        let sparse = AirborneOptions { density: Some(0.1), ..both };
        assert!(chosen(&sparse).err().unwrap().contains("already"));
        assert!(
            plan_airborne(&area, &instrument(), &AirborneOptions { speed: None, ..options() }, &FLAT)
                .is_err()
        );
    }

    #[test]
    fn lines_follow_the_ground_no_more_steeply_than_allowed() {
        let area = Area::rectangle([0.0, 0.0], [4000.0, 200.0]).unwrap();
        // A step of 200 m.
        let hill = Ground { height: &|x, _| Some(if x > 2000.0 { 200.0 } else { 0.0 }), level: 0.0 };
        let follow = AirborneOptions { climb: Some(10.0), ..options() };
        let plan = plan_airborne(&area, &instrument(), &follow, &hill).unwrap();
        let line: Vec<DVec3> = plan.waypoints.iter().map(|w| w.position).take(4).collect();
        assert!(line.len() > 2);
        for pair in line.windows(2) {
            let run = libm::hypot(pair[1].x - pair[0].x, pair[1].y - pair[0].y);
            assert!((pair[1].z - pair[0].z).abs() <= 10f64.to_radians().tan() * run * 1.05 + 5.0);
        }
        for p in &line {
            assert!(p.z >= (hill.height)(p.x, p.y).unwrap() + 495.0, "{p}");
        }
    }

    #[test]
    fn cross_lines_are_perpendicular() {
        let area = Area::rectangle([0.0, 0.0], [3000.0, 1000.0]).unwrap();
        let plan =
            plan_airborne(&area, &instrument(), &AirborneOptions { cross_lines: 2, ..options() }, &FLAT)
                .unwrap();
        let crossing: Vec<_> = plan
            .waypoints
            .iter()
            .filter(|w| w.strip.as_deref().is_some_and(|s| s.starts_with("cross")))
            .collect();
        let mut x: Vec<f64> = crossing.iter().map(|w| w.position.x).collect();
        x.sort_by(f64::total_cmp);
        assert!(x.len() == 2 && (x[0] - 750.0).abs() < 1e-6 && (x[1] - 2250.0).abs() < 1e-6, "{x:?}");
    }
}
