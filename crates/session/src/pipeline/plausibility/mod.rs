//! Detection of inputs that are valid but hardly intended: a flight outside its scene or below its terrain,
//! radians read as degrees, a run that hits almost nothing. Each is a warning that names cause and remedy,
//! and an error under [`Settings::strict`].
//!
//! | file | what it holds or checks |
//! |---|---|
//! | `finding` | an implausible property of the input, with its remedy |
//! | `boxes` | the box of the flight against that of the scene: zones, units, swapped axes, local coordinates |
//! | `ground` | rays up and down from places of the flight: in water, below the terrain, or on it |
//! | `angles` | angles as written against the course: radians read as degrees and the reverse |
//! | `view` | beams of the flight: heights in feet or beyond the range, scanners that look up |
//! | `poses` | a streamed flight, pose by pose |
//! | `instrument` | settings of the scanner that the physics ignores or replaces |
//! | `pace` | times of a recorded flight: milliseconds read as seconds |
//! | `mirror` | pulses that a mirror does not fire |
//! | `points` | points per pulse, and where the beams pointed |

mod angles;
mod boxes;
mod finding;
mod ground;
mod instrument;
mod mirror;
mod pace;
mod points;
mod poses;
mod view;

use super::beam_counts::BeamTarget;
#[cfg(doc)]
use super::settings::Settings;
use angles::AngleCheck;
use finding::Finding;
pub use instrument::{
    check_energy_model, check_instrument, check_noise, check_water, check_wavelengths, check_weather_times,
};
pub use mirror::describe_idle_mirror;
pub use points::YieldCheck;
pub use poses::PoseCheck;
use view::{Sight, ViewPoint};
use vlscan_base::diag::{Diagnostics, Place};
use vlscan_geom::{Aabb, DVec3};
use vlscan_lidar::flight::FlightPlan;
use vlscan_scene::Scene;
use vlscan_survey::{AngleConvention, Interpolated, PlatformKind, PoseStream, RotationSpec, Survey};
use vlscan_tables::input::is_stdin;
use vlscan_trace::Tree;

/// Positions per leg that are checked.
const PLACES_PER_LEG: u32 = 33;

/// Returns the scene properties that the beams of a survey are compared with.
pub fn target(survey: &Survey, scene: &Scene) -> BeamTarget {
    let detectors = survey.scanner.devices.iter().map(|d| &d.detector);
    let min = detectors.clone().map(|d| d.range_min).fold(f64::INFINITY, f64::min);
    let max = detectors.map(|d| d.range_max).fold(0.0, f64::max);
    BeamTarget { bounds: scene.bounds, ranges: [min.min(max), max] }
}

/// Checks a planned flight over its scene before the first pulse.
pub fn check_flight(survey: &Survey, scene: &Scene, tree: &Tree, flight: &FlightPlan) -> Diagnostics {
    let mut found = Diagnostics::default();
    if let PlatformKind::Interpolated(settings) = &survey.platform.kind
        && let Some(finding) = recorded_angles(settings, flight)
    {
        found.extend(finding.into_warning(flight_place(survey)));
    }
    if let Some(table) = flight.trajectory_table() {
        let mut pace = pace::Pace::default();
        table.timed_positions().for_each(|(time, position)| pace.add(time, position));
        // Between two files, which legs follow one after the other, a platform may be anywhere.
        let is_one = matches!(&survey.platform.kind, PlatformKind::Interpolated(i) if i.files.len() == 1);
        let finding = if is_one { pace.find() } else { pace.find_slow() };
        finding.into_iter().for_each(|finding| found.extend(finding.into_warning(flight_place(survey))));
    }
    let mount = DVec3::Z * survey.platform.mount.offset.z;
    let places = flight.planned_positions(PLACES_PER_LEG);
    let reach = target(survey, scene).ranges[1].min(boxes::MAX_REACH);
    let bounds = scene.bounds.translated(scene.shift);
    let leg =
        |number: u32| survey.legs.iter().find(|leg| leg.number == number).and_then(|leg| leg.place.clone());
    if matches!(survey.platform.kind, PlatformKind::Static) {
        for place in &places {
            let who = format!("leg {}", place.leg);
            let at = scene.to_world(place.position);
            let finding = boxes::compare(&who, &bounds, &Aabb::around([at]), reach)
                .or_else(|| ground::check(&who, scene, tree, &[place.position + mount], mount.z));
            finding.into_iter().for_each(|finding| found.extend(finding.into_warning(leg(place.leg))));
        }
        return found;
    }
    let scanner: Vec<DVec3> = places.iter().map(|place| place.position + mount).collect();
    if scanner.is_empty() {
        return found;
    }
    let around = Aabb::around(places.iter().map(|place| scene.to_world(place.position)));
    let legs = places.chunk_by(|one, other| one.leg == other.leg);
    let poses: Vec<ViewPoint> = legs.flat_map(ViewPoint::along).collect();
    let finding = boxes::compare("the flight", &bounds, &around, reach)
        .or_else(|| ground::check("the flight", scene, tree, &scanner, mount.z))
        .or_else(|| check_view(survey, scene, tree, flight, &poses));
    finding.into_iter().for_each(|finding| found.extend(finding.into_warning(flight_place(survey))));
    found
}

/// Checks the view of the beams of a flight.
fn check_view(
    survey: &Survey,
    scene: &Scene,
    tree: &Tree,
    flight: &FlightPlan,
    poses: &[ViewPoint],
) -> Option<Finding> {
    let beams = flight.sample_beams();
    let (mount, ranges) = (survey.platform.mount.offset.z, target(survey, scene).ranges);
    view::check("the flight", scene, tree, &Sight { beams: &beams, mount, ranges }, poses)
}

/// Checks a recorded flight before it is flown: all poses of a trajectory that can be read a second time, in
/// the same way as those of a stream, and the surfaces that the beams hit from them. A file with errors has
/// no findings: the flight reports the errors with their places.
pub fn check_recording(
    survey: &Survey,
    scene: &Scene,
    tree: &Tree,
    flight: &FlightPlan,
    is_stopped: &dyn Fn() -> bool,
) -> Diagnostics {
    let PlatformKind::Stream(stream) = &survey.platform.kind else { return Diagnostics::default() };
    // What was read from a pipe ahead would be lost.
    if !is_recording(stream) {
        return Diagnostics::default();
    }
    let bounds = scene.bounds.translated(scene.shift);
    let Some((mut found, poses)) = poses::read_ahead(stream, bounds, scene.shift, is_stopped) else {
        return Diagnostics::default();
    };
    if found.is_empty() {
        let mount = survey.platform.mount.offset.z;
        let places: Vec<DVec3> = poses.iter().map(|pose| pose.position + DVec3::Z * mount).collect();
        let finding = ground::check("the flight", scene, tree, &places, mount)
            .or_else(|| check_view(survey, scene, tree, flight, &poses));
        finding.into_iter().for_each(|finding| found.extend(finding.into_warning(stream_place(stream))));
    }
    found
}

/// True if the poses of a stream are checked before the flight: those of a file or of a table in memory.
pub fn is_recording(stream: &PoseStream) -> bool {
    stream.content.is_some() || !is_stdin(&stream.path) && stream.path.is_file()
}

/// The file that describes the flight: the trajectory if it is one file, otherwise the survey.
fn flight_place(survey: &Survey) -> Option<Place> {
    match &survey.platform.kind {
        PlatformKind::Stream(stream) => stream_place(stream),
        PlatformKind::Interpolated(Interpolated { files, .. }) if files.len() == 1 => {
            Some(Place::of_file(&files[0].path))
        }
        _ => survey_place(survey),
    }
}

/// The file of a survey; surveys in memory have none.
fn survey_place(survey: &Survey) -> Option<Place> {
    (!survey.path.as_os_str().is_empty()).then(|| Place::of_file(&survey.path))
}

/// The file of a trajectory; standard input has no place.
fn stream_place(stream: &PoseStream) -> Option<Place> {
    (!is_stdin(&stream.path)).then(|| Place::of_file(&stream.path))
}

/// Checks whether the survey reads the angles of a recorded flight in the wrong unit.
fn recorded_angles(settings: &Interpolated, flight: &FlightPlan) -> Option<Finding> {
    if settings.position_only {
        return None;
    }
    let convention = match settings.rotation_spec {
        RotationSpec::Arinc705 => AngleConvention::Heading,
        RotationSpec::Canonical => AngleConvention::Canonical,
    };
    let option = "the survey's toRadians";
    let mut check = AngleCheck::new(convention, settings.degrees, option);
    for (angles, position) in flight.trajectory_table()?.poses() {
        let written = if settings.degrees { angles.map(f64::to_degrees) } else { angles };
        if let Some(finding) = check.add(position, written) {
            return Some(finding);
        }
    }
    check.end()
}
