//! Checks of the coordinate reference system of points.

use vlscan_base::diag::Diagnostics;
use vlscan_crs as crs;
use vlscan_geom::DVec3;

/// Warns of a system in which points around `centre` can hardly be; returns where they are otherwise.
pub fn check_place(wkt: &str, centre: DVec3, found: &mut Diagnostics) -> Option<crs::Place> {
    match crs::misfit(wkt, centre.x, centre.y) {
        Some((message, hint)) => {
            found.warn(None, message).help(hint);
            None
        }
        None => crs::place_of(wkt, centre.x, centre.y),
    }
}

/// Warns of a system whose coordinates are not metres.
pub fn check_unit(wkt: &str, found: &mut Diagnostics) {
    if let Some(problem) = crs::unit_problem(wkt) {
        found
            .warn(None, format!("{} does not fit: {problem}", crs::name(wkt)))
            .help("name a system in metres such as EPSG:25832, and project the scene to it");
    }
}
