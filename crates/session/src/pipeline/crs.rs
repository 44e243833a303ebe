//! Coordinate reference system of a run: chosen, named by the scene's files, or the UTM zone of the flight.

use super::settings::Settings;
use crate::output::{OutputContext, OutputRequest, check_system};
use vlscan_base::diag::Diagnostics;
use vlscan_crs as crs;
use vlscan_geom::{DVec3, UtmZone};
use vlscan_lidar::flight::FlightPlan;
use vlscan_lidar::platform::{PoseReader, adjusted_time_origin};
use vlscan_scene::Scene;
use vlscan_survey::{PlatformKind, ProjectionGrid};
use vlscan_warehouse::Stop;

/// Coordinates from which a scene is taken to be on a projected grid, m.
const MIN_PROJECTED_COORDINATE: f64 = 100_000.0;

/// Sets the system of the survey to the one that the scene's files name, unless one is chosen, and the grid
/// of its flight to its UTM zone. Returns contradictions as warnings, and a note on the place of a scene
/// whose files name no system, by the chosen one.
pub(super) fn adopt(settings: &mut Settings, scene: &Scene) -> (Diagnostics, Option<String>) {
    let (mut found, mut note) = (Diagnostics::default(), None);
    let survey = &mut settings.survey;
    if let (Some(chosen), Some(named)) = (&survey.crs_wkt, &scene.crs)
        && crs::differ(chosen, named)
    {
        let message =
            format!("--crs is {}, but the files of the scene are in {}", crs::name(chosen), crs::name(named));
        found
            .warn(None, message)
            .help("--crs does not reproject points: leave it out, or reproject the scene first");
    }
    let is_confirmed = scene.crs.is_some();
    let is_chosen = survey.crs_wkt.is_some();
    survey.crs_wkt = survey.crs_wkt.take().or_else(|| scene.crs.clone());
    let wkt = survey.crs_wkt.as_deref();
    if let Some(wkt) = wkt {
        let centre = (!scene.bounds.is_empty()).then(|| scene.to_world(scene.bounds.centre()));
        note = check_chosen(wkt, centre, &mut found).filter(|_| is_chosen && !is_confirmed);
    }
    let grid = match &mut survey.platform.kind {
        PlatformKind::Stream(stream) => &mut stream.grid,
        PlatformKind::Interpolated(files) => &mut files.grid,
        _ => return (found, note),
    };
    if let (ProjectionGrid::Utm(zone), Some(wkt)) = (&grid, wkt)
        && UtmZone::of_wkt(wkt).is_some_and(|of_scene| of_scene != *zone)
    {
        let message =
            format!("the flight is projected to UTM zone {zone}, but the scene is in {}", crs::name(wkt));
        found.warn(None, message).help("leave out --utm-zone: the flight follows the scene");
    }
    *grid = grid.of_scene(wkt);
    (found, note)
}

/// Warns of a system that does not fit a scene around `centre`. Returns a note on the place of the scene in
/// it, for scenes whose files name no system.
fn check_chosen(wkt: &str, centre: Option<DVec3>, found: &mut Diagnostics) -> Option<String> {
    let place = check_system(wkt, centre, found)?;
    Some(format!("in {}, the scene is at {place}", crs::name(wkt)))
}

/// Warns of a system of merged outputs that does not fit the scene of the shards, and notes its place in the
/// system or that there is none, as a run does.
pub(super) fn check_merged(outputs: &OutputRequest, context: &OutputContext, found: &mut Diagnostics) {
    if let Some(wkt) = outputs.cloud.crs.as_deref() {
        let centre = (!context.bounds.is_empty()).then(|| context.bounds.centre() + context.shift);
        let note = check_chosen(wkt, centre, found);
        if let Some(note) = note.filter(|_| context.crs.is_none()) {
            found.note(None, note);
        }
    }
    if let Some(missing) = without_crs(outputs, context) {
        found.note(None, missing);
    }
}

/// Returns the system of a flight that is projected: its UTM zone. Waits for the first pose of a flight that
/// is streamed through `poses`.
pub(super) fn of_flight(flight: &FlightPlan, poses: Option<&mut PoseReader>, stop: &Stop) -> Option<String> {
    let zone = match (flight.trajectory_table(), poses) {
        (Some(table), _) => table.zone(),
        (None, Some(poses)) => poses.first_zone(&|| stop.is_requested()),
        (None, None) => None,
    };
    zone.and_then(crs::wkt_of_zone)
}

/// Returns the time that times of records count from, s: of a flight whose poses have adjusted standard GPS
/// time; otherwise 0. Waits for the first pose.
pub(super) fn time_origin(settings: &Settings, poses: Option<&mut PoseReader>, stop: &Stop) -> f64 {
    let poses = poses.filter(|_| settings.flight.kinematics.adjusted_times);
    let first = poses.and_then(|poses| poses.first_time(&|| stop.is_requested()));
    first.and_then(adjusted_time_origin).unwrap_or(0.0)
}

/// Describes a missing coordinate reference system in formats that have a place for it, over a scene that
/// seems to have one.
pub(super) fn without_crs(outputs: &OutputRequest, context: &OutputContext) -> Option<String> {
    let is_projected = [context.shift.x, context.shift.y].iter().any(|c| c.abs() >= MIN_PROJECTED_COORDINATE);
    let has_place = outputs.sinks.iter().any(|(_, format)| format.holds_crs());
    let is_lacking = is_projected && has_place && outputs.cloud.crs.is_none() && context.crs.is_none();
    is_lacking.then(|| {
        "the coordinate reference system is unknown, so the outputs have none; add it with --crs EPSG:25832 \
         (the scene's code)"
            .to_owned()
    })
}
