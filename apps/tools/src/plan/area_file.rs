//! Areas and lines from files of GeoJSON, KML, KMZ, GPX, shapefiles, GeoPackages and well-known text.

use super::area::{Area, AreaError, check_coordinates};
use super::corridor::corridor;
use super::geometries::{Format, Geometry, Line, Shape, System, is_well_known_text, read_geometries};
use super::vector::{MAX_FILE_BYTES, VectorError, read_file_geometries};
use std::collections::BTreeMap;
use std::path::Path;
use vlscan_base::diag::{Diagnostics, Place, ProblemKind};
use vlscan_base::error::{Error, Result};
use vlscan_base::quantity::number;
use vlscan_base::recognise::{self, foreign};
use vlscan_crs as crs;
use vlscan_geom::{UtmZone, radians};
use vlscan_tables::input::read_file;

/// Extent below which coordinates without a system are degrees in every format: as metres such an area is too
/// small to be scanned.
const MAX_DEGREES: f64 = 1.0;

/// Reads an area: a file of GeoJSON, KML, KMZ, GPX or well-known text, a shapefile, a GeoPackage, or
/// well-known text itself. Its first polygon or closed track counts, without its holes; with `buffer` (m)
/// everything within that distance of its first line. `scene_crs` is the system of the scene as WKT, if its
/// files name one: coordinates of other systems are projected to it, if it is a UTM zone. Also returns notes
/// for the user.
///
/// # Errors
/// [`Error::Input`], [`Error::Io`].
pub fn read_area(source: &str, scene_crs: Option<&str>, buffer: Option<f64>) -> Result<(Area, Diagnostics)> {
    if let Some(distance) = buffer {
        let (_, area, found) = read_corridor(source, scene_crs, distance)?;
        return Ok((area, found));
    }
    let (corners, found) = Source::read(source, Expected::Polygon)?.positions(scene_crs)?;
    Ok((Area::new(corners).map_err(|problem| wrong_area(source, problem))?, found))
}

/// Reads a line as [`read_line`] does. Returns it with the area of everything within `distance` m of it.
///
/// # Errors
/// As [`read_area`].
pub fn read_corridor(
    source: &str,
    scene_crs: Option<&str>,
    distance: f64,
) -> Result<(Vec<[f64; 2]>, Area, Diagnostics)> {
    let (line, found) = read_line(source, scene_crs)?;
    let area = corridor(&line, distance).map_err(|problem| wrong_area(source, problem))?;
    Ok((line, area, found))
}

fn wrong_area(source: &str, problem: AreaError) -> Error {
    Error::input(format!("{source}: {problem}"))
}

/// Reads a line, at least two positions, from the same sources as [`read_area`].
///
/// # Errors
/// As [`read_area`].
pub fn read_line(source: &str, scene_crs: Option<&str>) -> Result<(Vec<[f64; 2]>, Diagnostics)> {
    let failed = |what: String| Error::input(format!("{source}: {what}"));
    let (mut line, found) = Source::read(source, Expected::Line)?.positions(scene_crs)?;
    line.dedup();
    check_coordinates(&line).map_err(|e| failed(e.to_string()))?;
    match line.len() {
        0 | 1 => Err(failed("a line of one position, expected at least 2".to_owned())),
        _ => Ok((line, found)),
    }
}

/// The kind of geometry that is read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Expected {
    Polygon,
    Line,
}

/// Kind of the coordinates of a geometry.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Coordinates {
    OfScene,
    Degrees,
    Utm(UtmZone),
}

/// Coordinates that cannot be placed in the scene.
#[derive(Debug, thiserror::Error)]
enum SystemError {
    /// A system in another unit than metres or degrees.
    #[error("it is in {system}: {problem}; {reproject}", reproject = REPROJECT)]
    Unit { system: String, problem: String },
    /// A system other than the scene's, from which nothing is projected.
    #[error(
        "its coordinates are in {system}, those of the scene in {scene}; {reproject}",
        reproject = REPROJECT
    )]
    OtherSystem { system: String, scene: String },
    /// Degrees for a scene whose system is not a UTM zone.
    #[error(
        "its coordinates are degrees, and the scene is in {scene}, which is not a UTM zone; expected metres \
         in the scene's coordinates: {reproject}{or_metres}",
        reproject = REPROJECT
    )]
    NotUtm { scene: String, or_metres: &'static str },
    /// Degrees for a scene without a system.
    #[error(
        "its coordinates are degrees, and the scene's UTM zone is unknown; expected metres in the scene's \
         coordinates: {reproject}{or_metres}",
        reproject = REPROJECT
    )]
    NoZone { or_metres: &'static str },
    /// A position that cannot be projected to the scene's zone.
    #[error(
        "the position {x} {y} is too far from the scene's UTM zone {zone}{or_metres}",
        x = .position[0],
        y = .position[1]
    )]
    TooFar { position: [f64; 2], zone: UtmZone, or_metres: &'static str },
}

/// A geometry with where it is from.
struct Source<'s> {
    name: &'s str,
    /// The file; `None` for text of the command line.
    place: Option<Place>,
    format: Format,
    line: Line,
    system: System,
    found: Diagnostics,
}

impl<'s> Source<'s> {
    /// Reads the first geometry of the requested kind, and warns of everything unused.
    fn read(name: &'s str, wanted: Expected) -> Result<Source<'s>> {
        let failed = |what: String| Error::input(format!("{name}: {what}"));
        let (read, place) = match is_well_known_text(name) {
            true => (read_geometries(name).map_err(VectorError::from), None),
            false if !Path::new(name).exists() && !is_like_file(name) => {
                return Err(neither_file_nor_text(name, wanted));
            }
            false => (read_file_of(Path::new(name))?, Some(Place::of_file(Path::new(name)))),
        };
        let (format, all) = read.map_err(|problem| failed(problem.to_string()))?;
        let (mut used, mut others) = (Vec::new(), BTreeMap::<String, usize>::new());
        for Geometry { shape, system } in all {
            let kind = match (shape, wanted) {
                (Shape::Polygon(rings), Expected::Polygon) => {
                    used.push((rings, system));
                    continue;
                }
                (Shape::Line(line) | Shape::Track(line), Expected::Line) => {
                    used.push((vec![line], system));
                    continue;
                }
                (Shape::Track(line), Expected::Polygon) if is_closed(&line) => {
                    used.push((vec![line], system));
                    continue;
                }
                (Shape::Track(_), _) => OPEN_TRACK.to_owned(),
                (Shape::Polygon(_), _) => "Polygon".to_owned(),
                (Shape::Line(_), _) => "LineString".to_owned(),
                (Shape::Other(kind), _) => kind,
            };
            *others.entry(kind).or_default() += 1;
        }
        let count = used.len();
        let (mut rings, system) =
            used.into_iter().next().ok_or_else(|| failed(missing(wanted, format, &others)))?;
        let line = if rings.is_empty() { Line::default() } else { rings.remove(0) };
        let mut source = Source { name, place, format, line, system, found: Diagnostics::default() };
        source.warn_of_unused(wanted, count, rings.len(), &others);
        if format == Format::Gpx
            && wanted == Expected::Polygon
            && source.line.positions.first() != source.line.positions.last()
        {
            source.note("the ends of the track are joined".to_owned());
        }
        Ok(source)
    }

    fn warn_of_unused(
        &mut self,
        wanted: Expected,
        count: usize,
        holes: usize,
        others: &BTreeMap<String, usize>,
    ) {
        let (many, one) = match wanted {
            Expected::Polygon => ("polygons", "polygon"),
            Expected::Line => ("lines", "line"),
        };
        if count > 1 {
            let message = format!("of {count} {many} only the first one is used");
            self.warn(message, &format!("join them to one {one}, or write each to its own file"));
        }
        if holes > 0 {
            let message = format!("the holes of the polygon ({holes}) are treated as part of the area");
            self.warn(message, "remove them, or divide what is around them into polygons without holes");
        }
        if !others.is_empty() {
            let kinds: Vec<String> = others.iter().map(|(kind, count)| format!("{count} {kind}")).collect();
            self.warn(
                format!("not used, only the first {one} is: {}", kinds.join(", ")),
                &format!("remove everything that is not a {one}"),
            );
        }
        if self.line.has_heights {
            let help =
                "heights are those of the scene's ground, or of --ground; leave them out of the positions";
            self.warn(format!("the heights of the {one} are not used"), help);
        }
    }

    /// The text of a message: text of the command line has no place.
    fn told(&self, message: String) -> String {
        if self.place.is_some() { message } else { format!("{}: {message}", self.name) }
    }

    fn warn(&mut self, message: String, help: &str) {
        let message = self.told(message);
        self.found.warn(self.place.clone(), message).help(help);
    }

    fn note(&mut self, message: String) {
        let message = self.told(message);
        self.found.note(self.place.clone(), message);
    }

    /// The positions in the scene's coordinates.
    fn positions(mut self, scene_crs: Option<&str>) -> Result<(Vec<[f64; 2]>, Diagnostics)> {
        let positions =
            self.coordinates(scene_crs).and_then(|coordinates| self.projected(coordinates, scene_crs));
        match positions {
            Ok(positions) => Ok((positions, self.found)),
            Err(problem) => Err(Error::input(format!("{}: {problem}", self.name))),
        }
    }

    /// Decides what the coordinates are, with a note where they are ambiguous.
    fn coordinates(&mut self, scene_crs: Option<&str>) -> Result<Coordinates, SystemError> {
        match self.system.clone() {
            System::OfScene => Ok(Coordinates::OfScene),
            System::Degrees => Ok(Coordinates::Degrees),
            System::Epsg(code) => {
                let own = crs::wkt_of_epsg(code).ok();
                let is_of_scene =
                    |scene: &str| crs::epsg(scene).is_some_and(|(_, of_scene)| u32::from(of_scene) == code);
                let has_same_code = match &own {
                    Some(own) => {
                        scene_crs.is_some_and(|scene| crs::epsg(scene).is_some() && !crs::differ(own, scene))
                    }
                    None => scene_crs.is_some_and(is_of_scene),
                };
                self.of_system(&format!("EPSG:{code}"), own.as_deref(), has_same_code, scene_crs)
            }
            System::Wkt(own) => {
                let is_same =
                    scene_crs.is_some_and(|scene| scene.trim() == own || crs::name(scene) == crs::name(&own));
                self.of_system(&crs::name(&own), Some(&own), is_same, scene_crs)
            }
            System::Unstated => Ok(self.unstated(scene_crs.is_some())),
        }
    }

    /// Decides by the file's own system, which `name` names and `own` describes.
    fn of_system(
        &mut self,
        name: &str,
        own: Option<&str>,
        is_same: bool,
        scene_crs: Option<&str>,
    ) -> Result<Coordinates, SystemError> {
        if let Some(problem) = own.and_then(crs::unit_problem) {
            return Err(SystemError::Unit { system: name.to_owned(), problem });
        }
        let Some(scene_crs) = scene_crs else {
            self.note(format!(
                "its coordinates are in {name}, but the scene's system is unknown; they are used as scene \
                 coordinates"
            ));
            return Ok(Coordinates::OfScene);
        };
        let [zone, of_scene] = [own, Some(scene_crs)].map(|wkt| wkt.and_then(UtmZone::of_wkt));
        match zone.zip(of_scene) {
            Some((zone, of_scene)) if zone != of_scene => Ok(Coordinates::Utm(zone)),
            // ETRS89 and WGS 84 have zones of their own, which differ by less than a metre.
            Some(_) => Ok(Coordinates::OfScene),
            None if is_same => Ok(Coordinates::OfScene),
            None => Err(SystemError::OtherSystem { system: name.to_owned(), scene: crs::name(scene_crs) }),
        }
    }

    /// GeoJSON without a system has degrees (RFC 7946, §4), well-known text the coordinates of the scene,
    /// unless it is too small for metres.
    fn unstated(&mut self, has_scene_crs: bool) -> Coordinates {
        let positions = &self.line.positions;
        let in_range = positions.iter().all(|p| p[0].abs() <= 180.0 && p[1].abs() <= 90.0);
        if !in_range || positions.is_empty() {
            return Coordinates::OfScene;
        }
        let spread = spread(positions);
        let is_geojson = self.format == Format::GeoJson;
        if spread < MAX_DEGREES {
            if !is_geojson {
                let or_metres = self.or_metres();
                self.note(format!(
                    "its coordinates are read as longitude and latitude in degrees{or_metres}"
                ));
            }
            return Coordinates::Degrees;
        }
        match (is_geojson, has_scene_crs) {
            (false, _) => Coordinates::OfScene,
            (true, true) => {
                let message = format!(
                    "its coordinates, which extend over {}, are read as degrees, as usual for GeoJSON \
                     without `crs`",
                    number(spread)
                );
                let help = "write \"crs\": null behind the first { if they are metres in the scene's \
                            coordinates; \"crs\": {\"type\": \"name\", \"properties\": {\"name\": \
                            \"OGC:CRS84\"}} says that they are degrees";
                self.warn(message, help);
                Coordinates::Degrees
            }
            (true, false) => {
                let message = "its coordinates are read as metres in the scene's system, although GeoJSON \
                               without `crs` is in degrees: the scene's system is unknown, so degrees cannot \
                               be projected";
                let help = "write \"crs\": null after the first { if they are metres; degrees must be \
                            projected, for example with ogr2ogr -t_srs EPSG:25832";
                self.warn(message.to_owned(), help);
                Coordinates::OfScene
            }
        }
    }

    /// How to say that coordinates without a system are metres.
    fn or_metres(&self) -> &'static str {
        match (&self.system, self.format) {
            (System::Unstated, Format::GeoJson) => {
                "; if they are metres, write \"crs\": null after the first {"
            }
            (System::Unstated, Format::Shapefile) => {
                "; if they are metres, a .prj file beside it must name their system"
            }
            (System::Unstated, _) => "; if they are metres, write SRID=0; before it",
            _ => "",
        }
    }

    fn projected(
        &self,
        coordinates: Coordinates,
        scene_crs: Option<&str>,
    ) -> Result<Vec<[f64; 2]>, SystemError> {
        let geographic = |[x, y]: [f64; 2]| match coordinates {
            Coordinates::Utm(zone) => zone.unproject(x, y),
            _ => (radians(y), radians(x)),
        };
        if coordinates == Coordinates::OfScene {
            return Ok(self.line.positions.clone());
        }
        let or_metres = self.or_metres();
        let Some(zone) = scene_crs.and_then(UtmZone::of_wkt) else {
            return Err(match scene_crs {
                Some(wkt) => SystemError::NotUtm { scene: crs::name(wkt), or_metres },
                None => SystemError::NoZone { or_metres },
            });
        };
        let project = |position: &[f64; 2]| {
            let (latitude, longitude) = geographic(*position);
            let place = zone.project(latitude, longitude).map(|place| [place.easting, place.northing]);
            place.ok_or(SystemError::TooFar { position: *position, zone, or_metres })
        };
        self.line.positions.iter().map(project).collect()
    }
}

const REPROJECT: &str = "reproject it, for example with ogr2ogr -t_srs EPSG:25832";

/// Name of tracks that are no areas.
const OPEN_TRACK: &str = "open track";
/// Maximum distance of the ends of a closed track, as a fraction of its length: receivers err by metres.
const MAX_GAP: f64 = 0.05;

/// True if a track, in degrees, ends about where it begins.
fn is_closed(track: &Line) -> bool {
    let [Some(first), Some(last)] = [track.positions.first(), track.positions.last()] else { return false };
    let narrowing = libm::cos(radians(first[1]));
    let distance = |a: &[f64; 2], b: &[f64; 2]| libm::hypot((b[0] - a[0]) * narrowing, b[1] - a[1]);
    let length: f64 = track.positions.windows(2).map(|pair| distance(&pair[0], &pair[1])).sum();
    track.positions.len() > 3 && distance(first, last) <= MAX_GAP * length
}

/// The geometries of a file, or its problem.
type ReadGeometries = Result<(Format, Vec<Geometry>), VectorError>;

fn read_file_of(path: &Path) -> Result<ReadGeometries> {
    let bytes = read_file(path, MAX_FILE_BYTES).map_err(|e| Error::open(path, e))?;
    match foreign(path, &bytes, &recognise::Expected::AREA) {
        Some(found) => Err(found.error(path)),
        None => Ok(read_file_geometries(path, &bytes)),
    }
}

/// The larger extent of the positions.
fn spread(positions: &[[f64; 2]]) -> f64 {
    let extent = |axis: usize| {
        let values = positions.iter().map(|position| position[axis]);
        values.clone().fold(f64::NEG_INFINITY, f64::max) - values.fold(f64::INFINITY, f64::min)
    };
    extent(0).max(extent(1))
}

/// True if a name has a folder, or an ending as names of files have it.
fn is_like_file(name: &str) -> bool {
    let ending = Path::new(name).extension().and_then(|ending| ending.to_str()).unwrap_or_default();
    let is_word = ending.chars().all(|c| c.is_ascii_alphanumeric());
    let has_ending = is_word && ending.starts_with(|c: char| c.is_ascii_alphabetic());
    has_ending || name.contains(['/', '\\']) && !name.contains('(')
}

fn neither_file_nor_text(name: &str, wanted: Expected) -> Error {
    let example = match wanted {
        Expected::Polygon => "POLYGON ((0 0, 100 0, 100 80, 0 80))",
        Expected::Line => "LINESTRING (0 0, 100 0, 100 80)",
    };
    let message = format!(
        "{name}: neither a file nor well-known text; expected a file (GeoJSON, KML, KMZ, GPX, shapefile, \
         GeoPackage, well-known text), or well-known text itself: \"{example}\""
    );
    Error::input_of(ProblemKind::NotFound, message)
}

/// The message for a source without the geometry that is wanted.
fn missing(wanted: Expected, format: Format, others: &BTreeMap<String, usize>) -> String {
    let kind = match wanted {
        Expected::Polygon => "Polygon",
        Expected::Line => "LineString",
    };
    let help = match wanted {
        Expected::Polygon if others.contains_key("LineString") || others.contains_key(OPEN_TRACK) => {
            "--buffer makes an area of a line"
        }
        Expected::Polygon => "draw the area as a polygon",
        Expected::Line if others.contains_key("Polygon") => {
            "draw the line itself; `vlscan plan airborne --area` takes polygons"
        }
        Expected::Line => "draw the way as a line",
    };
    let found: Vec<String> = others.iter().map(|(kind, count)| format!("{count} {kind}")).collect();
    let found = if found.is_empty() { "no geometry".to_owned() } else { found.join(", ") };
    format!("no {kind} in the {}, which has {found}; {help}", format.name())
}

#[cfg(test)]
mod tests;
