//! A survey over its scene as points: surfaces with the leg that covers them, and the flight lines.

use crate::options::ResolvedRun;
use crate::options::{InputOptions, Options, Switch};
use arrow_array::cast::AsArray;
use arrow_array::types::{Float64Type, Int32Type};
use std::path::{Path, PathBuf};
use vlscan_base::Observer;
use vlscan_base::diag::Place;
use vlscan_base::error::{Error, Result};
use vlscan_base::quantity::CLASSES;
use vlscan_formats::{Attribute, AttributeSet, PointRow};
use vlscan_geom::{DVec3, is_inside};
use vlscan_session::{FlightCoverage, LoadedScene, Progress, RunContext, Session};
use vlscan_tools::cloud::Points;
use vlscan_warehouse::Stop;

/// Most points on the surfaces of the scene.
const MAX_SURFACE_POINTS: usize = 1_000_000;
/// Dots along the larger extent of the picture, at most.
const MAX_DOTS: f64 = 2000.0;
/// Lines of dots beside each other that a flight line consists of.
const LINE_WIDTH: i32 = 3;

/// The scene of a survey or pipeline as points, whose leg is the first one that covers them plus one, or 0,
/// and the flight lines. Files are looked for in `assets`, too.
///
/// # Errors
/// Those of [`ResolvedRun::resolve`] and of a flight; [`Error::Interrupted`].
pub fn survey_points(survey: &Path, assets: &[PathBuf], observer: &Observer, stop: &Stop) -> Result<Points> {
    let strict = Switch::given(observer.is_strict());
    let input = InputOptions { assets: assets.to_vec(), strict, ..InputOptions::default() };
    let (job, warnings) = ResolvedRun::resolve(survey, &Options { input, ..Options::default() })?;
    observer.warnings(warnings)?;
    let mut session = Session::open(job.settings, observer.callback())?;
    session_points(&mut session, survey, observer, stop)
}

/// The same of the survey of a session, which `name` names in messages.
///
/// # Errors
/// Those of a flight; [`Error::Interrupted`].
pub fn session_points(
    session: &mut Session,
    name: &Path,
    observer: &Observer,
    stop: &Stop,
) -> Result<Points> {
    let progress = Progress::default();
    let sketch = session.sketch(RunContext::new(&progress, stop))?;
    let loaded = session.loaded().ok_or_else(|| Error::Internal("the scene is not loaded".to_owned()))?;
    let cover = Cover::of(&sketch);
    let mut points = surface_points(&loaded, name, &|place| cover.leg(place), observer)?;
    draw_tracks(&sketch, &mut points);
    Ok(points)
}

/// The surfaces of a scene as points, which `name` names in messages.
///
/// # Errors
/// Those of [`LoadedScene::sample`].
pub fn scene_points(loaded: &LoadedScene, name: &Path, observer: &Observer) -> Result<Points> {
    surface_points(loaded, name, &|_| 0, observer)
}

/// Points on the surfaces of a scene with the legs that `leg` tells.
fn surface_points(
    loaded: &LoadedScene,
    name: &Path,
    leg: &dyn Fn(DVec3) -> u16,
    observer: &Observer,
) -> Result<Points> {
    let attributes = AttributeSet::of(|attribute| matches!(attribute, Attribute::Class | Attribute::Leg));
    let mut points = Points::new(attributes);
    points.count_legs_from_one();
    let table = loaded.sample(MAX_SURFACE_POINTS)?;
    let axis = |i: usize| table.column(i).as_primitive::<Float64Type>().values();
    let classes = table.column(3).as_primitive::<Int32Type>().values();
    let (x, y, z) = (axis(0), axis(1), axis(2));
    for i in 0..table.num_rows() {
        let position = DVec3::new(x[i], y[i], z[i]);
        let class = classes[i].clamp(0, 255) as u8;
        points.push(&PointRow { position, class, leg: leg(position), ..PointRow::default() }, None);
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

/// Adds dots along the flight lines.
fn draw_tracks(sketch: &FlightCoverage, points: &mut Points) {
    let all = sketch.tracks.iter().flat_map(|(_, track)| track);
    let bounds = all.fold(points.bounds(), |bounds, position| bounds.with(*position));
    let step = bounds.size().max_element().max(1e-3) / MAX_DOTS;
    for (leg, track) in &sketch.tracks {
        let mut dot = |position: DVec3| {
            for i in -LINE_WIDTH / 2..=LINE_WIDTH / 2 {
                for j in -LINE_WIDTH / 2..=LINE_WIDTH / 2 {
                    let beside = DVec3::new(f64::from(i), f64::from(j), 0.0) * step;
                    let row =
                        PointRow { position: position + beside, leg: shown(*leg), ..PointRow::default() };
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

/// The number of a leg in the picture; 0 is none.
fn shown(leg: u32) -> u16 {
    u16::try_from(leg).unwrap_or(u16::MAX - 1) + 1
}

/// Swaths, sorted into the columns of a grid.
struct Cover<'s> {
    sketch: &'s FlightCoverage,
    low: f64,
    width: f64,
    /// Indices of the swaths that reach into each column.
    columns: Vec<Vec<u32>>,
}

const COLUMNS: usize = 512;

impl<'s> Cover<'s> {
    fn of(sketch: &'s FlightCoverage) -> Cover<'s> {
        let corners = || sketch.swaths.iter().flat_map(|(_, quad)| quad).map(|corner| corner.x);
        let (low, high) =
            corners().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| (l.min(x), h.max(x)));
        let width = ((high - low) / COLUMNS as f64).max(1e-9);
        let mut columns = vec![Vec::new(); COLUMNS];
        for (index, (_, quad)) in (0..).zip(&sketch.swaths) {
            let of = |x: f64| (((x - low) / width).max(0.0) as usize).min(COLUMNS - 1);
            let (from, to) = quad.iter().fold((COLUMNS - 1, 0), |(a, b), p| (a.min(of(p.x)), b.max(of(p.x))));
            columns[from..=to].iter_mut().for_each(|column| column.push(index));
        }
        Cover { sketch, low, width, columns }
    }

    /// The number in the picture of the first leg that covers a place.
    fn leg(&self, place: DVec3) -> u16 {
        let column = (place.x - self.low) / self.width;
        let swaths =
            if (0.0..COLUMNS as f64).contains(&column) { &self.columns[column as usize][..] } else { &[] };
        let covering = swaths.iter().map(|i| &self.sketch.swaths[*i as usize]);
        let mut covering =
            covering.filter(|(_, quad)| is_inside(&quad.map(|p| [p.x, p.y]), [place.x, place.y]));
        covering.next().map_or(0, |(leg, _)| shown(*leg))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_have_the_first_leg_that_covers_them() {
        let strip = |x: f64| {
            let p = |x: f64, y: f64| DVec3::new(x, y, 50.0);
            [p(x, 0.0), p(x + 10.0, 0.0), p(x + 10.0, 100.0), p(x, 100.0)]
        };
        let sketch = FlightCoverage { tracks: Vec::new(), swaths: vec![(3, strip(0.0)), (4, strip(5.0))] };
        let cover = Cover::of(&sketch);
        let leg = |x: f64, y: f64| cover.leg(DVec3::new(x, y, 0.0));
        assert_eq!([leg(2.0, 50.0), leg(7.0, 50.0), leg(12.0, 50.0)], [4, 4, 5]);
        assert_eq!([leg(2.0, 150.0), leg(-1.0, 50.0), leg(16.0, 50.0)], [0, 0, 0]);
        assert_eq!(Cover::of(&FlightCoverage::default()).leg(DVec3::ZERO), 0);
    }
}
