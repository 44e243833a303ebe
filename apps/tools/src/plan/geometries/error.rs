//! Problems of texts of geometries.

/// Problem of a text of geometries.
#[non_exhaustive]
#[derive(Debug, thiserror::Error)]
pub enum GeometryError {
    /// A text that begins like GeoJSON but is not JSON.
    #[error("no GeoJSON: {0}")]
    Json(serde_json::Error),
    /// A text that begins like KML but is not XML.
    #[error("no KML or GPX: {0}")]
    Xml(roxmltree::Error),
    /// Text in an unknown notation.
    #[error(
        "expected GeoJSON, KML, GPX or well-known text, POLYGON ((x y, x y, …)) or LINESTRING (x y, x y, …)"
    )]
    Notation,
    /// A member `crs` of GeoJSON without a name.
    #[error(
        "its `crs` is {0}, expected {{\"type\": \"name\", \"properties\": {{\"name\": \"EPSG:25832\"}}}}"
    )]
    NoCrsName(String),
    /// A member `crs` of GeoJSON with the name of an unknown system.
    #[error("its `crs` is `{0}`, expected a name such as EPSG:25832")]
    CrsName(String),
    /// An object of GeoJSON without its type.
    #[error("not GeoJSON: an object without `type`")]
    NoType,
    /// Another value in place of a list of GeoJSON, which is named.
    #[error("{0}: expected a list")]
    NoList(String),
    /// A position that is not one.
    #[error("a position {found}, expected {expected}")]
    Position {
        /// The text, quoted if its notation has no quotes.
        found: String,
        /// The form of positions in the notation.
        expected: &'static str,
    },
    /// A point of a track without its place.
    #[error("a point of a track with lat {latitude:?} and lon {longitude:?}, expected degrees")]
    TrackPoint {
        /// Its attribute `lat`.
        latitude: Option<String>,
        /// Its attribute `lon`.
        longitude: Option<String>,
    },
    /// A point of a track with a height that is not a number.
    #[error("a point of a track with the height `{0}`, expected metres")]
    TrackHeight(String),
    /// A polygon of KML without its outer ring.
    #[error("a Polygon without outerBoundaryIs")]
    NoOuterRing,
    /// The number of a system that is not one.
    #[error("`{0}`, expected SRID=25832")]
    Srid(String),
    /// Well-known text that lacks brackets.
    #[error("`{0}`, expected (x y, x y, …)")]
    Brackets(String),
    /// Collections within collections, beyond the maximum depth.
    #[error("geometry collections are nested too deeply")]
    TooDeep,
}
