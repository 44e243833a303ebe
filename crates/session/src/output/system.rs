//! Checks of the coordinate reference system of points.

use vlscan_base::diag::Diagnostics;
use vlscan_crs as crs;
use vlscan_geom::DVec3;

/// Warns of a system whose coordinates or heights are not metres, in which points around `centre` can hardly
/// be, or whose lengths there are not those on the ground; returns where the points are if they can be there.
pub fn check_system(wkt: &str, centre: Option<DVec3>, found: &mut Diagnostics) -> Option<crs::Place> {
    for problem in [crs::unit_problem(wkt), crs::height_problem(wkt)].into_iter().flatten() {
        found
            .warn(None, format!("{} does not fit: {problem}", crs::name(wkt)))
            .help("name a system in metres such as EPSG:25832, and project the scene to it");
    }
    let centre = centre?;
    match crs::misfit(wkt, centre.x, centre.y) {
        Some((message, hint)) => {
            found.warn(None, message).help(hint);
            None
        }
        None => {
            if let Some((message, hint)) = crs::distortion(wkt, centre.x, centre.y) {
                found.warn(None, message).help(hint);
            }
            crs::place_of(wkt, centre.x, centre.y)
        }
    }
}
