//! Coordinate reference system of a scene: from the keys of its rasters and from `.prj` files next to its
//! geometry.

use crate::load::raster;
use std::collections::HashSet;
use std::path::{Path, PathBuf};
use vlscan_base::diag::Diagnostics;
use vlscan_base::files::reads;
use vlscan_crs as crs;
use vlscan_geom::DVec3;
use vlscan_survey::{Loader, PartRecipe, SceneRecipe, Transform};
use vlscan_tables::input::read_file;

/// Maximum size of a `.prj` file, bytes.
const MAX_PRJ_BYTES: u64 = 1 << 16;

/// A system and the file that names it.
struct Named {
    wkt: String,
    file: PathBuf,
}

/// Returns the system that the files of a scene name, as WKT: the first one; files that name another one are
/// reported. Parts that are moved or turned sideways have separate coordinates and are ignored.
pub(super) fn find_crs(recipe: &SceneRecipe, problems: &mut Diagnostics) -> Option<String> {
    let mut found: Option<Named> = None;
    let mut seen = HashSet::new();
    let mut is_reported = false;
    for part in recipe.parts.iter().filter(|part| keeps_coordinates(&part.transform)) {
        // Tiles of a raster are in one system.
        let count = if matches!(part.loader, Loader::GeoTiff { .. }) { 1 } else { usize::MAX };
        for file in part.loader.files().iter().take(count) {
            if !seen.insert(file) {
                continue;
            }
            let Some(named) = crs_of_file(file, part, problems) else { continue };
            match &found {
                None => found = Some(named),
                Some(first) if crs::differ(&first.wkt, &named.wkt) && !is_reported => {
                    is_reported = true;
                    let message = format!(
                        "{} is in {}, {} in {}",
                        first.file.display(),
                        crs::name(&first.wkt),
                        named.file.display(),
                        crs::name(&named.wkt)
                    );
                    problems.warn(part.place.clone(), message).help(
                        "files are not reprojected; convert all files of a scene to one system first \
                         (gdalwarp, ogr2ogr)",
                    );
                }
                Some(_) => {}
            }
        }
    }
    found.map(|named| named.wkt)
}

fn keeps_coordinates(transform: &Transform) -> bool {
    let sideways = DVec3::new(transform.offset.x, transform.offset.y, 0.0);
    sideways == DVec3::ZERO && transform.scale == 1.0 && transform.rotation == Transform::IDENTITY.rotation
}

fn crs_of_file(file: &Path, part: &PartRecipe, problems: &mut Diagnostics) -> Option<Named> {
    if let Loader::GeoTiff { files, .. } = &part.loader
        && let Some((wkt, file)) = raster::crs_of(files)
    {
        return Some(Named { wkt, file });
    }
    let prj = file.with_extension("prj");
    if !reads::is_file(&prj) {
        return None;
    }
    match read_file(&prj, MAX_PRJ_BYTES) {
        Ok(bytes) if crs::is_wkt(&String::from_utf8_lossy(&bytes)) => {
            let wkt = String::from_utf8_lossy(&bytes).trim().to_owned();
            // A raster in another unit is converted to metres, which are not in its system.
            let is_kept = !matches!(part.loader, Loader::GeoTiff { .. }) || is_metric(&wkt);
            is_kept.then_some(Named { wkt, file: prj })
        }
        Ok(_) => {
            let message = format!("{} holds no WKT such as PROJCS[...] and is left out", prj.display());
            problems.warn(part.place.clone(), message).help("name the system with --crs");
            None
        }
        Err(e) => {
            problems.warn(part.place.clone(), format!("cannot read {}: {e}", prj.display()));
            None
        }
    }
}

/// True unless coordinates of a system are lengths other than metres.
fn is_metric(wkt: &str) -> bool {
    let unit = crs::Units::of_wkt(wkt).horizontal;
    unit.as_ref().and_then(crs::Unit::length).is_none_or(crs::LengthUnit::is_metre)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn systems_in_feet_are_not_those_of_converted_rasters() {
        for (code, expected) in [(25832, true), (2263, false), (4326, true)] {
            assert_eq!(is_metric(&crs::wkt_of_epsg(code).unwrap()), expected, "{code}");
        }
        assert!(is_metric("PROJCS[\"mine\"]"));
    }
}
