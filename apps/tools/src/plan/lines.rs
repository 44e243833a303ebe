//! The flight lines, drive or positions of a plan for maps and flight management: GeoJSON (RFC 7946), KML
//! (OGC 12-007r2) and CSV.
//!
//! GeoJSON and KML are in longitude and latitude of WGS 84, CSV in the coordinates of the plan, with
//! longitude and latitude if its system is known. Heights are those of the plan.

use super::document::Waypoint;
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::path::Path;
use vlscan_base::columns::quoted;
use vlscan_base::error::{Error, Result};
use vlscan_crs as crs;
use vlscan_crs::{Place, Wgs84};
use vlscan_geom::DVec3;

/// A format of lines.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LineFormat {
    /// GeoJSON.
    GeoJson,
    /// KML.
    Kml,
    /// Comma-separated values, a row per vertex.
    Csv,
}

impl LineFormat {
    /// The format that the extension of a file denotes.
    ///
    /// # Errors
    /// [`Error::Input`] for other extensions.
    pub fn of(path: &Path) -> Result<LineFormat> {
        let ending = path.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
        match ending.as_str() {
            "geojson" | "json" => Ok(LineFormat::GeoJson),
            "kml" => Ok(LineFormat::Kml),
            "csv" => Ok(LineFormat::Csv),
            _ => Err(Error::input(format!(
                "--lines {}: expected a name that ends in .geojson, .kml or .csv",
                path.display()
            ))),
        }
    }
}

/// A line along which the scanner fires, or a position at which it does.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PlanLine {
    /// Name of its strip.
    pub name: String,
    /// m/s; none for a position.
    pub speed: Option<f64>,
    /// In the coordinates of the plan, m.
    pub vertices: Vec<DVec3>,
}

impl PlanLine {
    fn length(&self) -> f64 {
        self.vertices.windows(2).map(|pair| pair[0].distance(pair[1])).sum()
    }
}

/// The lines of a plan as the text of a file. `carriers` are the references to platform and scanner, `wkt` is
/// the system of the coordinates.
///
/// # Errors
/// [`Error::Input`] for GeoJSON and KML where the system is unknown or cannot be converted to WGS 84.
pub fn plan_lines(
    lines: &[PlanLine],
    carriers: [&str; 2],
    format: LineFormat,
    wkt: Option<&str>,
) -> Result<String> {
    let converter = wkt.map(Wgs84::of);
    let to_wgs84 = match (format, &converter) {
        (_, Some(Ok(converter))) => Some(converter),
        (LineFormat::Csv, _) => None,
        (_, Some(Err(problem))) => {
            return Err(Error::input(format!("--lines: {problem}; write .csv instead")));
        }
        (_, None) => {
            return Err(Error::input_with_help(
                "--lines: GeoJSON and KML are in longitude and latitude, but the coordinate reference system \
                 of the plan is unknown",
                "name it with --crs EPSG:25832, plan over a scene whose files name it, or write .csv",
            ));
        }
    };
    let place = |p: &DVec3| -> Result<Option<Place>> {
        let Some(converter) = to_wgs84 else { return Ok(None) };
        let found = converter.place(p.x, p.y);
        let outside = || {
            let name = crs::name(wkt.unwrap_or_default());
            Error::input(format!(
                "--lines: x {:.0}, y {:.0} are outside of the projection of {name}",
                p.x, p.y
            ))
        };
        found.map(Some).ok_or_else(outside)
    };
    let mut places = Vec::with_capacity(lines.len());
    for line in lines {
        places.push(line.vertices.iter().map(place).collect::<Result<Vec<_>>>()?);
    }
    match format {
        LineFormat::GeoJson => geojson(lines, &places, carriers),
        LineFormat::Kml => Ok(kml(lines, &places)),
        LineFormat::Csv => Ok(csv(lines, &places, wkt)),
    }
}

/// The lines on which the scanner fires: consecutive waypoints of one strip, and the one behind them. Without
/// a speed each waypoint is a position. `height` is that of the ground for waypoints that stand on it, m.
pub fn lines_of(waypoints: &[Waypoint], height: &dyn Fn(f64, f64) -> Option<f64>) -> Vec<PlanLine> {
    let place = |waypoint: &Waypoint| {
        let p = waypoint.position;
        let ground = waypoint.on_ground.then(|| height(p.x, p.y)).flatten();
        DVec3::new(p.x, p.y, ground.unwrap_or(p.z))
    };
    let mut lines: Vec<PlanLine> = Vec::new();
    let mut continues = false;
    for (i, waypoint) in waypoints.iter().enumerate() {
        if !waypoint.active {
            continues = false;
            continue;
        }
        let name = waypoint.strip.as_deref().unwrap_or_default();
        let next = waypoints.get(i + 1).filter(|_| waypoint.speed.is_some());
        match lines.last_mut().filter(|line| continues && line.name == name) {
            Some(line) => line.vertices.extend(next.map(place)),
            None => {
                let vertices = std::iter::once(place(waypoint)).chain(next.map(place)).collect();
                lines.push(PlanLine { name: name.to_owned(), speed: waypoint.speed, vertices });
            }
        }
        continues = waypoint.speed.is_some();
    }
    lines
}

/// Digits of degrees: 0.1 mm.
fn degrees(value: f64) -> f64 {
    (value * 1e9).round() / 1e9
}

fn millimetres(value: f64) -> f64 {
    (value * 1e3).round() / 1e3 + 0.0
}

fn geojson(
    lines: &[PlanLine],
    places: &[Vec<Option<Place>>],
    [platform, scanner]: [&str; 2],
) -> Result<String> {
    let feature = |(line, places): (&PlanLine, &Vec<Option<Place>>)| {
        let vertices = line.vertices.iter().zip(places);
        let mut corners: Vec<Value> = vertices
            .filter_map(|(p, place)| {
                let place = (*place)?;
                Some(json!([degrees(place.longitude), degrees(place.latitude), millimetres(p.z)]))
            })
            .collect();
        let geometry = match corners.len() {
            1 => json!({ "type": "Point", "coordinates": corners.remove(0) }),
            _ => json!({ "type": "LineString", "coordinates": corners }),
        };
        let properties = json!({
            "name": line.name, "speed_m_per_s": line.speed, "length_m": millimetres(line.length()),
        });
        json!({ "type": "Feature", "geometry": geometry, "properties": properties })
    };
    let features: Vec<Value> = lines.iter().zip(places).map(feature).collect();
    let collection = json!({
        "type": "FeatureCollection",
        "platform": platform,
        "scanner": scanner,
        "features": features,
    });
    let text = serde_json::to_string_pretty(&collection).map_err(|e| Error::Internal(e.to_string()))?;
    Ok(text + "\n")
}

fn kml(lines: &[PlanLine], places: &[Vec<Option<Place>>]) -> String {
    let mut out = String::from(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<kml xmlns=\"http://www.opengis.net/kml/2.2\">\n\
         <Document>\n",
    );
    for (line, places) in lines.iter().zip(places) {
        let vertices = line.vertices.iter().zip(places);
        let corners: Vec<String> = vertices
            .filter_map(|(p, place)| {
                let place = (*place)?;
                Some(format!("{:.9},{:.9},{:.3}", place.longitude, place.latitude, p.z))
            })
            .collect();
        let shape = if corners.len() == 1 { "Point" } else { "LineString" };
        let name = line.name.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;");
        let _ = writeln!(
            out,
            "<Placemark><name>{name}</name><{shape}><altitudeMode>absolute</altitudeMode>\
             <coordinates>{}</coordinates></{shape}></Placemark>",
            corners.join(" ")
        );
    }
    out + "</Document>\n</kml>\n"
}

fn csv(lines: &[PlanLine], places: &[Vec<Option<Place>>], wkt: Option<&str>) -> String {
    let system = wkt.map(crs::short_name).map_or_else(String::new, |name| quoted(&name));
    let mut out = String::from("line,vertex,x,y,z,longitude,latitude,speed_m_per_s,crs\n");
    for (line, places) in lines.iter().zip(places) {
        let speed = line.speed.map_or_else(String::new, |speed| speed.to_string());
        for (number, (p, place)) in line.vertices.iter().zip(places).enumerate() {
            let place = place.map(|at| format!("{:.9},{:.9}", at.longitude, at.latitude));
            let place = place.unwrap_or_else(|| ",".to_owned());
            let name = quoted(&line.name);
            let _ =
                writeln!(out, "{name},{number},{:.3},{:.3},{:.3},{place},{speed},{system}", p.x, p.y, p.z);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use vlscan_crs::wkt_of_epsg;

    fn waypoint(x: f64, active: bool, strip: &str) -> Waypoint {
        Waypoint {
            position: DVec3::new(500_000.0 + x, 5_400_000.0, 300.0),
            speed: Some(50.0),
            active,
            on_ground: false,
            strip: active.then(|| strip.to_owned()),
        }
    }

    #[test]
    fn lines_are_the_legs_on_which_the_scanner_fires() {
        let mut waypoints = vec![
            waypoint(0.0, true, "a"),
            waypoint(10.0, true, "a"),
            waypoint(20.0, false, ""),
            waypoint(30.0, false, ""),
            waypoint(40.0, true, "<b>"),
            waypoint(50.0, true, "c"),
            waypoint(60.0, false, ""),
        ];
        let found = lines_of(&waypoints, &|_, _| None);
        let shapes: Vec<_> =
            found.iter().map(|line| (line.name.as_str(), line.vertices.len(), line.length())).collect();
        assert_eq!(shapes, [("a", 3, 20.0), ("<b>", 2, 10.0), ("c", 2, 10.0)]);
        let wkt = wkt_of_epsg(25832).unwrap();
        let carriers = ["sr22", "vlp16"];
        let text = plan_lines(&found, carriers, LineFormat::GeoJson, Some(&wkt)).unwrap();
        let json: Value = serde_json::from_str(&text).unwrap();
        // x 500 000 is the central meridian.
        let first = &json["features"][0]["geometry"]["coordinates"][0];
        assert_eq!((first[0].as_f64(), first[2].as_f64()), (Some(9.0), Some(300.0)));
        assert!((first[1].as_f64().unwrap() - 48.752).abs() < 0.01, "{first}");
        let text = plan_lines(&found, carriers, LineFormat::Kml, Some(&wkt)).unwrap();
        assert!(
            roxmltree::Document::parse(&text).is_ok_and(|d| d.descendants().any(|n| n.text() == Some("<b>")))
        );
        let text = plan_lines(&found, carriers, LineFormat::Csv, None).unwrap();
        assert!(text.contains("\na,1,500010.000,5400000.000,300.000,,,50,\n"), "{text}");
        for format in [LineFormat::GeoJson, LineFormat::Kml] {
            let Err(Error::Input(problem)) = plan_lines(&found, carriers, format, None) else {
                panic!("no system")
            };
            assert!(problem.text().contains("--crs"));
        }
        // Positions on the ground.
        waypoints.truncate(2);
        waypoints.iter_mut().for_each(|w| (w.speed, w.on_ground) = (None, true));
        let found = lines_of(&waypoints, &|_, _| Some(7.5));
        let text = plan_lines(&found, carriers, LineFormat::Csv, Some(&wkt)).unwrap();
        assert!(text.contains("\na,0,500010.000,5400000.000,7.500,9.000"), "{text}");
        assert!(text.ends_with(",EPSG:25832\n"), "{text}");
    }

    #[test]
    fn formats_are_those_of_the_extension() {
        let of = |name: &str| LineFormat::of(Path::new(name)).ok();
        assert_eq!(of("a.GeoJSON"), Some(LineFormat::GeoJson));
        assert_eq!(
            (of("a.kml"), of("a.csv"), of("a.shp")),
            (Some(LineFormat::Kml), Some(LineFormat::Csv), None)
        );
    }
}
