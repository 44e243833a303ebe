//! Polygons and lines of shapefiles (ESRI Shapefile Technical Description, 1998).

use super::super::geometries::{Geometry, Line, Shape as Found, System};
use shapefile::record::PolygonRing;
use shapefile::record::polygon::GenericPolygon;
use shapefile::record::polyline::GenericPolyline;
use shapefile::record::traits::HasXY;
use shapefile::{Shape, ShapeReader};
use std::io::Cursor;
use std::path::{Path, PathBuf};
use vlscan_base::damage::catch_decoder_panic;
use vlscan_base::files::reads;
use vlscan_crs as crs;
use vlscan_tables::input::read_file;

/// Maximum size of a `.prj` file, bytes.
const MAX_PRJ_BYTES: u64 = 1 << 16;

/// Problem of a shapefile, or of the `.prj` file beside it.
#[non_exhaustive]
#[derive(Debug, thiserror::Error)]
pub enum ShapefileError {
    /// Content on which the decoder fails.
    #[error("the shapefile is damaged")]
    Undecodable,
    /// Content that does not follow the format.
    #[error("the shapefile is damaged: {0}")]
    Damaged(Box<shapefile::Error>),
    /// A `.prj` file that cannot be read.
    #[error("cannot read {}: {error}", .path.display())]
    Unreadable {
        /// The `.prj` file.
        path: PathBuf,
        /// The error of the operating system.
        error: std::io::Error,
    },
    /// A `.prj` file without a system.
    #[error("{} holds no WKT such as PROJCS[...]", .0.display())]
    NoSystem(PathBuf),
}

/// All polygons and lines of the file, each part of a line by itself.
///
/// # Errors
/// A damaged file.
pub(super) fn read(bytes: &[u8], path: &Path) -> Result<Vec<Geometry>, ShapefileError> {
    let system = system(path)?;
    let shapes = catch_decoder_panic(|| ShapeReader::new(Cursor::new(bytes)).and_then(ShapeReader::read));
    let shapes = shapes.ok_or(ShapefileError::Undecodable)?;
    let shapes = shapes.map_err(|error| ShapefileError::Damaged(Box::new(error)))?;
    let mut found = Vec::new();
    for shape in shapes {
        match shape {
            Shape::NullShape => {}
            Shape::Polygon(polygon) => polygons(&polygon, |_| false, &mut found),
            Shape::PolygonM(polygon) => polygons(&polygon, |_| false, &mut found),
            Shape::PolygonZ(polygon) => polygons(&polygon, |point| point.z != 0.0, &mut found),
            Shape::Polyline(line) => lines(&line, |_| false, &mut found),
            Shape::PolylineM(line) => lines(&line, |_| false, &mut found),
            Shape::PolylineZ(line) => lines(&line, |point| point.z != 0.0, &mut found),
            Shape::Point(_) | Shape::PointM(_) | Shape::PointZ(_) => {
                found.push(Found::Other("Point".to_owned()))
            }
            Shape::Multipatch(_) => found.push(Found::Other("MultiPatch".to_owned())),
            _ => found.push(Found::Other("MultiPoint".to_owned())),
        }
    }
    Ok(found.into_iter().map(|shape| Geometry { shape, system: system.clone() }).collect())
}

/// The system in the `.prj` file beside the shapefile.
fn system(path: &Path) -> Result<System, ShapefileError> {
    let prj = ["prj", "PRJ"].iter().map(|ending| path.with_extension(ending)).find(|prj| reads::is_file(prj));
    let Some(prj) = prj else { return Ok(System::Unstated) };
    let bytes = match read_file(&prj, MAX_PRJ_BYTES) {
        Ok(bytes) => bytes,
        Err(error) => return Err(ShapefileError::Unreadable { path: prj, error }),
    };
    let text = String::from_utf8_lossy(&bytes);
    let text = text.trim_start_matches('\u{feff}').trim();
    match crs::is_wkt(text) {
        true => Ok(System::of_wkt(text)),
        false => Err(ShapefileError::NoSystem(prj)),
    }
}

fn line<P: HasXY>(points: &[P], has_height: impl Fn(&P) -> bool) -> Line {
    Line {
        positions: points.iter().map(|point| [point.x(), point.y()]).collect(),
        has_heights: points.iter().any(has_height),
    }
}

/// An outer ring with the inner ones behind it is a polygon.
fn polygons<P: HasXY>(polygon: &GenericPolygon<P>, has_height: impl Fn(&P) -> bool, found: &mut Vec<Found>) {
    let first = found.len();
    for ring in polygon.rings() {
        let line = line(ring.points(), &has_height);
        match (ring, found[first..].last_mut()) {
            (PolygonRing::Inner(_), Some(Found::Polygon(rings))) => rings.push(line),
            _ => found.push(Found::Polygon(vec![line])),
        }
    }
}

fn lines<P>(polyline: &GenericPolyline<P>, has_height: impl Fn(&P) -> bool, found: &mut Vec<Found>)
where
    P: HasXY,
{
    found.extend(polyline.parts().iter().map(|part| Found::Line(line(part, &has_height))));
}
