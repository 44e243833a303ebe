//! Airborne surveys: parallel lines over an area.

use super::area::Area;
use super::bends::{Course, SharpBend};
use super::choice::{Choice, Frame, check_clearance, choose, line_places, planned_width, shares};
use super::document::{PlannedSurvey, Promise, Waypoint};
use super::error::PlanError;
use super::height::{GroundLevel, Heights, PlanGround, mean_ground};
use super::line::{Line, turn};
use super::report::PlanReport;
use super::requirements::{AirborneOptions, Carrier};
use super::swath::SwathModel;
use std::f64::consts::PI;
use vlscan_base::error::{Error, Result};
use vlscan_geom::{DVec3, radians};

/// Steepest climb of lines that follow the ground if none is requested, degrees.
const DEFAULT_CLIMB: f64 = 10.0;
/// Rounds of laying out lines beside a line with bends, on whose radius the width of the corridor depends.
const BEND_ROUNDS: u32 = 3;
/// Radius of the innermost line in a bend, m.
const MIN_RADIUS: f64 = 1.0;

/// Plans parallel lines over an area, flown in alternating directions, so that every point of it is covered
/// as often as by an endless row of such lines; then the cross lines.
///
/// # Errors
/// [`Error::Input`]: options that contradict each other or exceed the instrument, and a minimum density.
pub fn plan_airborne(
    area: &Area,
    instrument: &SwathModel,
    carrier: &Carrier,
    options: &AirborneOptions,
    ground: &PlanGround,
) -> Result<PlannedSurvey> {
    let flight = Inputs { area, instrument, carrier, options, ground };
    flight.checked().and_then(|level| flight.complete(flight.straight()?, level)).map_err(Error::from)
}

/// Plans lines that follow the bends of a line, for the corridor of everything within `buffer` m of it, which
/// is `area`. Corners are flown as arcs. Headings and cross lines of the options do not apply.
///
/// # Errors
/// As for [`plan_airborne`], and for corners that are too sharp for the outermost line.
pub fn plan_corridor(
    line: &[[f64; 2]],
    buffer: f64,
    area: &Area,
    instrument: &SwathModel,
    carrier: &Carrier,
    options: &AirborneOptions,
    ground: &PlanGround,
) -> Result<PlannedSurvey> {
    let flight = Inputs { area, instrument, carrier, options, ground };
    flight.checked().and_then(|level| flight.complete(flight.bent(line, buffer)?, level)).map_err(Error::from)
}

/// Inputs of the plan of a flight.
struct Inputs<'f> {
    area: &'f Area,
    instrument: &'f SwathModel,
    carrier: &'f Carrier,
    options: &'f AirborneOptions,
    ground: &'f PlanGround<'f>,
}

/// The lines of a flight.
struct Layout {
    choice: Choice,
    /// How far before the area lines begin and behind it they end, m.
    margins: [f64; 2],
    /// Direction of the lines, rad; `None` if they follow a line.
    heading: Option<f64>,
    /// Lines in the order of the flight, from corner to corner.
    paths: Vec<Vec<[f64; 2]>>,
    /// Number of parallel lines, which are the first ones.
    parallel: usize,
}

impl Inputs<'_> {
    /// Checks the options. Returns the level of the ground.
    fn checked(&self) -> Result<GroundLevel, PlanError> {
        let Inputs { area, instrument, options, ground, .. } = *self;
        options.check()?;
        if options.min_density.is_some() {
            return Err(PlanError::NoSample);
        }
        let level = mean_ground(area, ground);
        // A level line is above the mean ground.
        let relief = if options.follow_terrain { 0.0 } else { level.high - level.mean };
        check_clearance(instrument, options, relief)?;
        Ok(level)
    }

    /// Straight lines over the area.
    fn straight(&self) -> Result<Layout, PlanError> {
        let Inputs { area, instrument, carrier, options, .. } = *self;
        let heading = options.heading.map_or_else(|| best_heading(area), radians);
        let frame = Frame::new(heading, area.corners()[0]);
        let choice = choose(area, &frame, instrument, carrier, options)?;
        let margins = choice.margins(options.run_in);
        let width = planned_width(&choice.field, instrument, options);
        let places = line_places(area, &frame, width, choice.spacing)?;
        let mut lines = lines_at(area, &frame, places, width / 2.0, margins);
        let parallel = lines.len();
        lines.extend(cross_lines(area, heading + PI / 2.0, options.cross_lines, margins));
        turn_every_second(&mut lines, margins);
        let paths = lines.iter().map(|line| vec![line.from, line.to]).collect();
        Ok(Layout { choice, margins, heading: Some(heading), paths, parallel })
    }

    /// Lines beside a line, laid out beside a straight one of its length.
    fn bent(&self, line: &[[f64; 2]], buffer: f64) -> Result<Layout, PlanError> {
        let Inputs { instrument, carrier, options, .. } = *self;
        let mut line = line.to_vec();
        line.dedup();
        if line.len() < 2 {
            return Err(PlanError::NoLine);
        }
        let pieces = line.windows(2).map(|pair| Line { from: pair[0], to: pair[1] });
        let mut length: f64 = pieces.map(|piece| piece.length()).sum();
        let mut half = buffer;
        let mut round = 1;
        loop {
            // x is along the line, y to the left of it.
            let straight = Area::rectangle([-buffer, -half], [length + buffer, half])?;
            let frame = Frame::new(PI / 2.0, straight.corners()[0]);
            let choice = choose(&straight, &frame, instrument, carrier, options)?;
            let margins = choice.margins(options.run_in);
            let width = planned_width(&choice.field, instrument, options);
            let places = line_places(&straight, &frame, width, choice.spacing)?;
            let mut lines = lines_at(&straight, &frame, places.iter().copied(), width / 2.0, margins);
            let outermost = lines.iter().map(|line| line.from[1].abs()).fold(0.0, f64::max);
            // On the inner side of a bend strips do not turn back.
            let course = Course::new(&line, outermost + 0.5 * width, outermost + MIN_RADIUS);
            let course = course.map_err(|SharpBend { place, radius }| PlanError::SharpBend {
                place,
                radius,
                needed: outermost + MIN_RADIUS,
            })?;
            if round == BEND_ROUNDS || course.departure == 0.0 {
                let parallel = lines.len();
                turn_every_second(&mut lines, margins);
                let paths = lines.iter().map(|line| course.parallel(line.from, line.to)).collect();
                // The density is that of the corridor alone.
                let corridor = Area::rectangle([0.0, -buffer], [length, buffer])?;
                let [pulses, square] = shares(&corridor, &frame, &places, &choice.field);
                let choice = choice.with_density(pulses / square, options);
                return Ok(Layout { choice, margins, heading: None, paths, parallel });
            }
            // Arcs are shorter than their corners, and leave them at a distance.
            (length, half) = (course.length(), buffer + course.departure);
            round += 1;
        }
    }

    /// The plan of lines.
    fn complete(&self, layout: Layout, level: GroundLevel) -> Result<PlannedSurvey, PlanError> {
        let Inputs { area, instrument, options, ground, .. } = *self;
        let Layout { choice, margins, heading, paths, parallel } = layout;
        let height = options.height;
        let climb = options.follow_terrain.then(|| radians(options.climb.unwrap_or(DEFAULT_CLIMB)));
        let heights = Heights { ground, level: level.mean, above: height, climb };
        let mut document = PlannedSurvey { turned: choice.turned, ..PlannedSurvey::default() };
        let turn_radius = options.turn_radius;
        let active = add_waypoints(&mut document, &paths, parallel, choice.speed, &heights, turn_radius)?;
        document.scanner.clone_from(&instrument.reference);
        document.settings = choice.scan.settings();
        document.promise = Some(Promise { density: choice.density, width: choice.field.width(), height });
        document.reaches = instrument.reaches(choice.scan.pulse_rate);
        let report = PlanReport {
            area,
            instrument,
            choice: &choice,
            height,
            heading,
            margins,
            parallel,
            active,
            level,
        };
        report.describe(&mut document, options);
        Ok(document)
    }
}

/// Adds the waypoints of all lines, the first `parallel` of which are parallel ones. Returns their length, m.
fn add_waypoints(
    document: &mut PlannedSurvey,
    paths: &[Vec<[f64; 2]>],
    parallel: usize,
    speed: f64,
    heights: &Heights,
    turn_radius: Option<f64>,
) -> Result<f64, PlanError> {
    let mut active = 0.0;
    for (i, path) in paths.iter().enumerate() {
        let strip = format!("{}{:03}", if i < parallel { "line" } else { "cross" }, i + 1);
        let points = heights.follow(path)?;
        active += length(&points);
        let last = points.len() - 1;
        for (k, position) in points.iter().enumerate() {
            document.waypoints.push(Waypoint {
                position: *position,
                speed: Some(speed),
                active: k < last,
                on_ground: false,
                strip: (k < last).then(|| strip.clone()),
            });
        }
        let end = path.last_chunk::<2>().map(|[from, to]| Line { from: *from, to: *to });
        let next = paths.get(i + 1).and_then(|next| next.first_chunk::<2>());
        let next = next.map(|[from, to]| Line { from: *from, to: *to });
        if let (Some(radius), Some(end), Some(next)) = (turn_radius, end, next) {
            let z = points[last].z;
            document.waypoints.extend(turn(&end, &next, radius).into_iter().map(|[x, y]| Waypoint {
                position: DVec3::new(x, y, z),
                speed: Some(speed),
                ..Waypoint::default()
            }));
        }
    }
    Ok(active)
}

/// The heading, rad, of the side of the area along which lines are fewest: the one across which it is
/// narrowest.
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

/// The lines at distances across over what is at most `half` from them, with margins before the area and
/// behind it.
fn lines_at(
    area: &Area,
    frame: &Frame,
    places: impl IntoIterator<Item = f64>,
    half: f64,
    margins: [f64; 2],
) -> Vec<Line> {
    let line = |across: f64| {
        let [from, to] = frame.extent(area, [across - half, across + half])?;
        Some(Line { from: frame.point(from - margins[0], across), to: frame.point(to + margins[1], across) })
    };
    places.into_iter().filter_map(line).collect()
}

/// Lines across, at the middles of equal shares of the area's length.
fn cross_lines(area: &Area, heading: f64, count: u32, margins: [f64; 2]) -> Vec<Line> {
    let frame = Frame::new(heading, area.corners()[0]);
    let [low, high] = frame.width(area);
    let places = (0..count).map(|i| low + (high - low) * (f64::from(i) + 0.5) / f64::from(count));
    lines_at(area, &frame, places, 0.0, margins)
}

/// Turns every second line round, which then begins and ends as the others do.
fn turn_every_second(lines: &mut [Line], [before, behind]: [f64; 2]) {
    for line in lines.iter_mut().skip(1).step_by(2) {
        std::mem::swap(&mut line.from, &mut line.to);
        line.shift(behind - before);
    }
}

fn length(points: &[DVec3]) -> f64 {
    points.windows(2).map(|pair| pair[0].distance(pair[1])).sum()
}

#[cfg(test)]
mod tests;
