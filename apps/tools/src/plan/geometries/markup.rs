//! Geometries of KML and GPX.

use super::error::GeometryError;
use super::shape::{Geometry, Line, Shape, System};

/// OGC 12-007r2.
pub fn read_kml(document: &roxmltree::Document, found: &mut Vec<Geometry>) -> Result<(), GeometryError> {
    for node in document.descendants() {
        let boundaries = |name: &'static str| {
            node.children().filter(move |child: &roxmltree::Node| child.tag_name().name() == name)
        };
        let shape = match node.tag_name().name() {
            "Polygon" => {
                let outer = boundaries("outerBoundaryIs").next().ok_or(GeometryError::NoOuterRing)?;
                let rings = std::iter::once(outer).chain(boundaries("innerBoundaryIs"));
                Shape::Polygon(rings.map(coordinates).collect::<Result<_, _>>()?)
            }
            "LineString" => Shape::Line(coordinates(node)?),
            kind @ ("Point" | "Model" | "Track") => Shape::Other(kind.to_owned()),
            "LinearRing" if !is_boundary(node) => Shape::Other("LinearRing".to_owned()),
            _ => continue,
        };
        found.push(Geometry { shape, system: System::Degrees });
    }
    Ok(())
}

/// The segments of tracks, and routes (GPX 1.1, <https://www.topografix.com/GPX/1/1/>).
pub fn read_gpx(document: &roxmltree::Document, found: &mut Vec<Geometry>) -> Result<(), GeometryError> {
    for node in document.descendants() {
        let shape = match node.tag_name().name() {
            "trkseg" => Shape::Track(track(node, "trkpt")?),
            "rte" => Shape::Track(track(node, "rtept")?),
            "wpt" => Shape::Other("waypoint".to_owned()),
            _ => continue,
        };
        found.push(Geometry { shape, system: System::Degrees });
    }
    Ok(())
}

/// The positions of the points of a track or a route.
fn track(node: roxmltree::Node, name: &str) -> Result<Line, GeometryError> {
    let points = node.children().filter(|child| child.tag_name().name() == name);
    Line::of(points.map(|point| {
        let number = |name: &str| point.attribute(name).and_then(|text| text.trim().parse::<f64>().ok());
        let (longitude, latitude) =
            number("lon").zip(number("lat")).ok_or_else(|| GeometryError::TrackPoint {
                latitude: point.attribute("lat").map(str::to_owned),
                longitude: point.attribute("lon").map(str::to_owned),
            })?;
        let height = point.children().find(|child| child.tag_name().name() == "ele");
        let height = height.and_then(|ele| ele.text()).map_or("", str::trim);
        let height = match height.is_empty() {
            true => 0.0,
            false => height.parse::<f64>().map_err(|_| GeometryError::TrackHeight(height.to_owned()))?,
        };
        Ok(vec![longitude, latitude, height])
    }))
}

fn is_boundary(ring: roxmltree::Node) -> bool {
    ring.parent().is_some_and(|parent| parent.tag_name().name().ends_with("BoundaryIs"))
}

/// The positions of the first element `coordinates` within a node.
fn coordinates(node: roxmltree::Node) -> Result<Line, GeometryError> {
    let coordinates = node.descendants().find(|node| node.tag_name().name() == "coordinates");
    let texts = coordinates.into_iter().flat_map(|node| node.children()).filter(|child| child.is_text());
    let text: String = texts.filter_map(|child| child.text()).collect();
    Line::of(text.split_whitespace().map(|tuple| {
        let numbers = tuple.split(',').map(|number| number.parse().ok()).collect::<Option<Vec<f64>>>();
        let numbers = numbers.filter(|numbers| (2..=3).contains(&numbers.len()));
        numbers.ok_or_else(|| GeometryError::Position {
            found: format!("`{tuple}`"),
            expected: "longitude,latitude",
        })
    }))
}
