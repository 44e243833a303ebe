//! A survey over its scene: surfaces with the flight line that covers them, the flight lines, and the pulses
//! that the ground receives.

use arrow_array::cast::AsArray;
use arrow_array::types::{Float64Type, Int32Type};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use vlscan_base::Observer;
use vlscan_base::diag::Place;
use vlscan_base::error::{Error, Result};
use vlscan_base::quantity::CLASSES;
use vlscan_formats::{Attribute, AttributeSet, PointRow};
use vlscan_geom::{Aabb, DVec3, is_inside};
use vlscan_options::{InputOptions, Options, ResolvedRun, Switch};
use vlscan_session::{FlightCoverage, LoadedScene, Progress, RunContext, Session};
use vlscan_tools::cloud::Points;
use vlscan_tools::preview::{FlightMap, Picture, PreviewOptions, draw_flight};
use vlscan_warehouse::Stop;

/// Most points on the surfaces of the scene.
const MAX_SURFACE_POINTS: usize = 1_000_000;
/// Dots along the larger extent of the picture, at most.
const MAX_DOTS: f64 = 2000.0;
/// Number of parallel lines of dots in a flight line.
const LINE_WIDTH: i32 = 3;
/// Cosine of the largest change of direction within a flight line whose legs name no strip, 10°.
const STRAIGHT: f64 = 0.985;
/// Cells of the map of pulses along the longer side of the scene.
const CELLS_PER_SIDE: f64 = 400.0;

/// A survey over its scene, before it is flown.
pub struct SurveySketch {
    points: Points,
    /// Positions along each flight line, world coordinates, m.
    lines: Vec<Vec<DVec3>>,
    flight: FlightMap,
}

impl SurveySketch {
    /// Flies a sample of a survey or pipeline file. Files are looked for in `assets`, too.
    ///
    /// # Errors
    /// The errors of [`ResolvedRun::resolve`] and of a flight; [`Error::Interrupted`].
    pub fn of_file(
        survey: &Path,
        assets: &[PathBuf],
        observer: &Observer,
        stop: &Stop,
    ) -> Result<SurveySketch> {
        let strict = Switch::given(observer.is_strict());
        let input = InputOptions { assets: assets.to_vec(), strict, ..InputOptions::default() };
        let (job, warnings) = ResolvedRun::resolve(survey, &Options { input, ..Options::default() })?;
        observer.warnings(warnings)?;
        let mut session = Session::open(job.settings, observer.callback())?;
        SurveySketch::of_session(&mut session, survey, observer, stop)
    }

    /// Flies a sample of the survey of a session, which `name` names in messages.
    ///
    /// # Errors
    /// The errors of a flight; [`Error::Interrupted`].
    pub fn of_session(
        session: &mut Session,
        name: &Path,
        observer: &Observer,
        stop: &Stop,
    ) -> Result<SurveySketch> {
        let progress = Progress::default();
        let coverage = session.sketch(RunContext::new(&progress, stop))?;
        let loaded = session.loaded().ok_or_else(|| Error::Internal("the scene is not loaded".to_owned()))?;
        let legs = &session.survey().legs;
        let strips: BTreeMap<u32, &str> =
            legs.iter().filter_map(|leg| Some((leg.number, leg.strip.as_deref()?))).collect();
        let (numbers, lines) = flight_lines(&coverage.tracks, &strips);
        let cover = Cover::of(&coverage, &numbers);
        let points = surface_points(&loaded, MAX_SURFACE_POINTS, name, &|place| cover.line(place), observer)?;
        let density = DensityMap::of(&coverage, &points.bounds());
        let flight = FlightMap {
            lines: lines.iter().map(|line| line.iter().map(|p| [p.x, p.y]).collect()).collect(),
            outline: density.outline(),
            density: points.positions().map(|position| density.at(position)).collect(),
        };
        Ok(SurveySketch { points, lines, flight })
    }

    /// The surfaces of the scene as points, whose leg is the number of the first flight line that covers
    /// them, from 1, or 0.
    pub fn points(&self) -> &Points {
        &self.points
    }

    /// A picture of the flight over the scene. If colours show legs, they show the density of pulses instead.
    pub fn picture(&self, options: &PreviewOptions) -> Picture {
        draw_flight(&self.points, &self.flight, options)
    }

    /// The points with dots along the flight lines, for pages.
    pub fn into_points(mut self) -> Points {
        draw_tracks(&self.lines, &mut self.points);
        self.points
    }
}

/// The scene of a survey or pipeline as points, whose leg is the number of the first flight line that covers
/// them, from 1, or 0, and the flight lines. Files are looked for in `assets`, too.
///
/// # Errors
/// The errors of [`ResolvedRun::resolve`] and of a flight; [`Error::Interrupted`].
pub fn survey_points(survey: &Path, assets: &[PathBuf], observer: &Observer, stop: &Stop) -> Result<Points> {
    SurveySketch::of_file(survey, assets, observer, stop).map(SurveySketch::into_points)
}

/// The points of [`survey_points`] of the survey of a session, which `name` names in messages.
///
/// # Errors
/// The errors of a flight; [`Error::Interrupted`].
pub fn session_points(
    session: &mut Session,
    name: &Path,
    observer: &Observer,
    stop: &Stop,
) -> Result<Points> {
    SurveySketch::of_session(session, name, observer, stop).map(SurveySketch::into_points)
}

/// The surfaces of a scene as about `count` points, which `name` names in messages.
///
/// # Errors
/// The errors of [`LoadedScene::sample`].
pub fn scene_points(loaded: &LoadedScene, count: usize, name: &Path, observer: &Observer) -> Result<Points> {
    surface_points(loaded, count, name, &|_| 0, observer)
}

/// Points on the surfaces of a scene, whose legs are the numbers of lines that `line` returns.
fn surface_points(
    loaded: &LoadedScene,
    count: usize,
    name: &Path,
    line: &dyn Fn(DVec3) -> u16,
    observer: &Observer,
) -> Result<Points> {
    let attributes = AttributeSet::of(|attribute| matches!(attribute, Attribute::Class | Attribute::Leg));
    let mut points = Points::new(attributes);
    points.count_legs_from_one();
    let table = loaded.sample(count)?;
    let axis = |i: usize| table.column(i).as_primitive::<Float64Type>().values();
    let classes = table.column(3).as_primitive::<Int32Type>().values();
    let (x, y, z) = (axis(0), axis(1), axis(2));
    for i in 0..table.num_rows() {
        let position = DVec3::new(x[i], y[i], z[i]);
        let class = classes[i].clamp(0, 255) as u8;
        points.push(&PointRow { position, class, leg: line(position), ..PointRow::default() }, None);
    }
    let mut found = points.doubts(name);
    let odd = classes.iter().filter(|class| !CLASSES.contains(class)).count();
    if odd > 0 {
        let message = format!("{odd} points have classes beyond 0 to 255, which are shown as 0 or 255");
        found.warn(Some(Place::of_file(name)), message);
    }
    observer.warnings(found)?;
    Ok(points)
}

/// The flight lines of tracks of legs: the number of the line of each leg, from 1, and the positions along
/// each line. Legs in a row are one line if they share a strip, or if they name none and go straight on.
fn flight_lines(
    tracks: &[(u32, Vec<DVec3>)],
    strips: &BTreeMap<u32, &str>,
) -> (BTreeMap<u32, u16>, Vec<Vec<DVec3>>) {
    let (mut numbers, mut lines) = (BTreeMap::new(), Vec::<Vec<DVec3>>::new());
    let mut before: Option<u32> = None;
    for (leg, track) in tracks {
        let last = lines.last_mut().filter(|line| line.len() > 1 && track.len() > 1);
        match last.zip(before).filter(|(line, before)| match (strips.get(before), strips.get(leg)) {
            (Some(a), Some(b)) => a == b && *leg == before + 1,
            (None, None) => continues(line, track),
            _ => false,
        }) {
            Some((line, _)) => line.extend(&track[1..]),
            None => lines.push(track.clone()),
        }
        numbers.insert(*leg, u16::try_from(lines.len()).unwrap_or(u16::MAX));
        before = Some(*leg);
    }
    (numbers, lines)
}

/// True if a track begins where a line ends, in about the same direction.
fn continues(line: &[DVec3], track: &[DVec3]) -> bool {
    let ([.., a, b], [c, d, ..]) = (line, track) else { return false };
    let direction = |from: DVec3, to: DVec3| {
        let way = to - from;
        DVec3::new(way.x, way.y, 0.0).normalize_or_zero()
    };
    b.distance(*c) < 1e-3 && direction(*a, *b).dot(direction(*c, *d)) > STRAIGHT
}

/// Adds dots along the flight lines.
fn draw_tracks(lines: &[Vec<DVec3>], points: &mut Points) {
    let bounds = lines.iter().flatten().fold(points.bounds(), |bounds, position| bounds.with(*position));
    let step = bounds.size().max_element().max(1e-3) / MAX_DOTS;
    for (number, track) in (1_usize..).zip(lines) {
        let leg = u16::try_from(number).unwrap_or(u16::MAX);
        let mut dot = |position: DVec3| {
            for i in -LINE_WIDTH / 2..=LINE_WIDTH / 2 {
                for j in -LINE_WIDTH / 2..=LINE_WIDTH / 2 {
                    let offset = DVec3::new(f64::from(i), f64::from(j), 0.0) * step;
                    let row = PointRow { position: position + offset, leg, ..PointRow::default() };
                    points.push(&row, None);
                }
            }
        };
        track.iter().for_each(|position| dot(*position));
        for pair in track.windows(2) {
            let count = (pair[0].distance(pair[1]) / step).ceil().min(MAX_DOTS * 10.0) as u32;
            (1..count).for_each(|i| dot(pair[0].lerp(pair[1], f64::from(i) / f64::from(count))));
        }
    }
}

/// A strip or sector of ground with the number of its flight line.
type Swath = (u16, [DVec3; 4]);

/// Swaths, sorted into the cells of a grid: there may be thousands of them, and a million points.
struct Cover {
    swaths: Vec<Swath>,
    /// South-western corner of the grid, m.
    low: [f64; 2],
    /// Width and height of a cell, m.
    side: [f64; 2],
    /// Indices of the swaths that reach into each cell, row by row.
    cells: Vec<Vec<u32>>,
}

/// Cells along each side of the grid.
const CELLS: usize = 32;

impl Cover {
    fn of(coverage: &FlightCoverage, numbers: &BTreeMap<u32, u16>) -> Cover {
        let numbered = |(leg, quad): &(u32, [DVec3; 4])| Some((*numbers.get(leg)?, *quad));
        let swaths: Vec<Swath> = coverage.swaths.iter().filter_map(numbered).collect();
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for corner in swaths.iter().flat_map(|(_, quad)| quad) {
            for (axis, value) in [corner.x, corner.y].into_iter().enumerate() {
                (low[axis], high[axis]) = (low[axis].min(value), high[axis].max(value));
            }
        }
        let side = [0, 1].map(|axis| ((high[axis] - low[axis]) / CELLS as f64).max(1e-9));
        let mut cells = vec![Vec::new(); CELLS * CELLS];
        for (index, (_, quad)) in (0..).zip(&swaths) {
            let range = |axis: usize| {
                let places = quad.map(|p| {
                    (((p.to_array()[axis] - low[axis]) / side[axis]).max(0.0) as usize).min(CELLS - 1)
                });
                places.into_iter().fold((CELLS - 1, 0), |(first, last), at| (first.min(at), last.max(at)))
            };
            let ((west, east), (south, north)) = (range(0), range(1));
            for row in south..=north {
                let row = &mut cells[row * CELLS..][west..=east];
                row.iter_mut().for_each(|cell: &mut Vec<u32>| cell.push(index));
            }
        }
        Cover { swaths, low, side, cells }
    }

    /// The number of the first flight line that covers a place; 0 is none.
    fn line(&self, place: DVec3) -> u16 {
        let cell = |axis: usize| {
            let at = (place.to_array()[axis] - self.low[axis]) / self.side[axis];
            (0.0..CELLS as f64).contains(&at).then_some(at as usize)
        };
        let Some((column, row)) = cell(0).zip(cell(1)) else { return 0 };
        let mut swaths = self.cells[row * CELLS + column].iter().map(|i| &self.swaths[*i as usize]);
        let covering = swaths.find(|(_, quad)| is_inside(&quad.map(|p| [p.x, p.y]), [place.x, place.y]));
        covering.map_or(0, |(line, _)| *line)
    }
}

/// Expected pulses per m² in the cells of a grid over the scene.
struct DensityMap {
    low: [f64; 2],
    /// Side of a cell, m.
    side: f64,
    columns: usize,
    /// Row by row from the south west.
    values: Vec<f32>,
}

impl DensityMap {
    /// The pulses of each leg, spread evenly over its swaths.
    fn of(coverage: &FlightCoverage, bounds: &Aabb) -> DensityMap {
        let (low, size) = ([bounds.min.x, bounds.min.y], bounds.size());
        let side = size.x.max(size.y) / CELLS_PER_SIDE;
        if !(side.is_finite() && side > 0.0) {
            return DensityMap { low, side: 1.0, columns: 0, values: Vec::new() };
        }
        let [columns, rows] = [size.x, size.y].map(|length| ((length / side).ceil() as usize).max(1));
        let (mut areas, mut pulses) = (BTreeMap::<u32, f64>::new(), BTreeMap::<u32, f64>::new());
        coverage.swaths.iter().for_each(|(leg, quad)| *areas.entry(*leg).or_insert(0.0) += area(quad));
        coverage.pulses.iter().for_each(|(leg, count)| *pulses.entry(*leg).or_insert(0.0) += count);
        let mut values = vec![0.0; columns * rows];
        for (leg, quad) in &coverage.swaths {
            let density: f64 = pulses.get(leg).copied().unwrap_or(0.0) / areas[leg];
            if !(density.is_finite() && density > 0.0) {
                continue;
            }
            let corners = quad.map(|p| [(p.x - low[0]) / side, (p.y - low[1]) / side]);
            let range = |axis: usize, most: usize| {
                let (first, last) = corners
                    .iter()
                    .fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), p| (l.min(p[axis]), h.max(p[axis])));
                (first.floor().max(0.0) as usize)..((last.ceil().max(0.0) as usize).min(most))
            };
            let columns_of_quad = range(0, columns);
            for row in range(1, rows) {
                for column in columns_of_quad.clone() {
                    if is_inside(&corners, [column as f64 + 0.5, row as f64 + 0.5]) {
                        values[row * columns + column] += density as f32;
                    }
                }
            }
        }
        DensityMap { low, side, columns, values }
    }

    fn rows(&self) -> usize {
        self.values.len() / self.columns.max(1)
    }

    /// The density at a place of the scene; 0 where no pulse arrives.
    fn at(&self, place: DVec3) -> f32 {
        let cell = |value: f64, axis: usize, count: usize| {
            (((value - self.low[axis]) / self.side).max(0.0) as usize).min(count.saturating_sub(1))
        };
        let (column, row) = (cell(place.x, 0, self.columns), cell(place.y, 1, self.rows()));
        self.values.get(row * self.columns + column).copied().unwrap_or(0.0)
    }

    /// Sides of cells between those that receive pulses and others, world coordinates, m.
    fn outline(&self) -> Vec<[[f64; 2]; 2]> {
        let is_covered = |column: Option<usize>, row: Option<usize>| match (column, row) {
            (Some(column), Some(row)) if column < self.columns && row < self.rows() => {
                self.values[row * self.columns + column] > 0.0
            }
            _ => false,
        };
        let corner = |column: usize, row: usize| {
            [self.low[0] + column as f64 * self.side, self.low[1] + row as f64 * self.side]
        };
        let mut sides = Vec::new();
        // The cells at the left and below of each corner may be beyond the grid, like those at the far sides.
        for row in 0..=self.rows() {
            for column in 0..=self.columns {
                let here = is_covered(Some(column), Some(row));
                if here != is_covered(column.checked_sub(1), Some(row)) {
                    sides.push([corner(column, row), corner(column, row + 1)]);
                }
                if here != is_covered(Some(column), row.checked_sub(1)) {
                    sides.push([corner(column, row), corner(column + 1, row)]);
                }
            }
        }
        sides
    }
}

/// The area of a quadrilateral from above, m².
fn area(quad: &[DVec3; 4]) -> f64 {
    let next = quad.iter().cycle().skip(1);
    // Relative to a corner, since coordinates are large.
    let cross = |(a, b): (&DVec3, &DVec3)| {
        let (a, b) = (*a - quad[0], *b - quad[0]);
        a.x * b.y - b.x * a.y
    };
    0.5 * quad.iter().zip(next).map(cross).sum::<f64>().abs()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn p(x: f64, y: f64) -> DVec3 {
        DVec3::new(x, y, 50.0)
    }

    fn strip(x: f64) -> [DVec3; 4] {
        [p(x, 0.0), p(x + 10.0, 0.0), p(x + 10.0, 100.0), p(x, 100.0)]
    }

    #[test]
    fn places_have_the_first_line_that_covers_them() {
        let swaths = vec![(3, strip(0.0)), (4, strip(5.0))];
        let coverage = FlightCoverage { swaths, ..FlightCoverage::default() };
        let cover = Cover::of(&coverage, &BTreeMap::from([(3, 1), (4, 2)]));
        let line = |x: f64, y: f64| cover.line(DVec3::new(x, y, 0.0));
        assert_eq!([line(2.0, 50.0), line(7.0, 50.0), line(12.0, 50.0)], [1, 1, 2]);
        assert_eq!([line(2.0, 150.0), line(-1.0, 50.0), line(16.0, 50.0)], [0, 0, 0]);
        assert_eq!(Cover::of(&FlightCoverage::default(), &BTreeMap::new()).line(DVec3::ZERO), 0);
    }

    #[test]
    fn sub_legs_are_one_line_and_turns_separate_lines() {
        let track = |leg: u32, from: DVec3, to: DVec3| (leg, vec![from, from.lerp(to, 0.5), to]);
        let out = [track(0, p(0.0, 0.0), p(50.0, 1.0)), track(1, p(50.0, 1.0), p(100.0, 0.0))];
        let back = [track(3, p(100.0, 40.0), p(50.0, 40.0)), track(4, p(50.0, 40.0), p(0.0, 40.0))];
        let tracks = [out, back].concat();
        let lines_by_leg = |strips: &[(u32, &'static str)]| {
            let (numbers, lines) = flight_lines(&tracks, &strips.iter().copied().collect());
            assert_eq!(lines.iter().map(Vec::len).sum::<usize>(), 12 - (4 - lines.len()));
            numbers.into_values().collect::<Vec<u16>>()
        };
        assert_eq!(lines_by_leg(&[]), [1, 1, 2, 2]);
        assert_eq!(lines_by_leg(&[(0, "a"), (1, "a"), (3, "b"), (4, "b")]), [1, 1, 2, 2]);
        assert_eq!(lines_by_leg(&[(0, "a"), (1, "b"), (3, "b"), (4, "c")]), [1, 2, 3, 4]);
        // A corner, and positions of an instrument that stands.
        let corner = [track(0, p(0.0, 0.0), p(50.0, 0.0)), track(1, p(50.0, 0.0), p(50.0, 50.0))];
        assert_eq!(flight_lines(&corner, &BTreeMap::new()).1.len(), 2);
        let stands = [(0, vec![p(0.0, 0.0)]), (1, vec![p(0.0, 0.0)])];
        assert_eq!(flight_lines(&stands, &BTreeMap::from([(0, "a"), (1, "a")])).1.len(), 2);
    }

    #[test]
    fn pulses_are_spread_over_swaths_and_add_up_where_these_overlap() {
        let swaths = vec![(3, strip(0.0)), (4, strip(5.0))];
        let pulses = vec![(3, 2000.0), (3, 1000.0), (4, 5000.0), (5, 1.0)];
        let coverage = FlightCoverage { swaths, pulses, ..FlightCoverage::default() };
        let bounds = Aabb { min: DVec3::new(-20.0, 20.0, 0.0), max: DVec3::new(60.0, 60.0, 9.0) };
        let density = DensityMap::of(&coverage, &bounds);
        let at = |x: f64, y: f64| density.at(DVec3::new(x, y, 0.0));
        assert_eq!([at(2.0, 30.0), at(7.0, 30.0), at(12.0, 60.0)], [3.0, 8.0, 5.0]);
        assert_eq!([at(-5.0, 30.0), at(15.5, 30.0), at(60.0, 60.0)], [0.0; 3]);
        // The outline is that of 15 by 40 m.
        let length = |[a, b]: &[[f64; 2]; 2]| (a[0] - b[0]).abs() + (a[1] - b[1]).abs();
        let outline = density.outline();
        assert!((outline.iter().map(length).sum::<f64>() - 110.0).abs() < 1e-6, "{}", outline.len());
        assert!(outline.iter().flatten().all(|[x, _]| (-1e-9..=15.0 + 1e-9).contains(x)));
        let nothing = DensityMap::of(&coverage, &Aabb::EMPTY);
        assert!(nothing.outline().is_empty() && nothing.at(p(2.0, 30.0)) == 0.0);
    }
}
