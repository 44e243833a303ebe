//! Geometries of GeoPackage (OGC 12-128r19): tables of features in an SQLite database, with well-known binary
//! (OGC 06-103r4, §8).

use super::super::geometries::{Geometry, Line, Shape, System};
use super::sqlite::{Database, Row, SqliteError, Value};
use std::collections::HashMap;
use std::path::Path;
use vlscan_crs as crs;

/// Maximum depth of collections within collections.
const MAX_DEPTH: u32 = 64;
/// Systems of the format without a place on Earth, and with degrees of an unknown one.
const UNDEFINED_CARTESIAN: i64 = -1;
const UNDEFINED_GEOGRAPHIC: i64 = 0;

/// Problem of a GeoPackage.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum GeoPackageError {
    /// Changes that are not in the database yet.
    #[error("its last changes are in the journal beside it (-wal); close the program that has it open")]
    Journal,
    /// A database that cannot be read.
    #[error(transparent)]
    Database(#[from] SqliteError),
    /// No list of the tables with geometries.
    #[error("no table `gpkg_geometry_columns`, so it has no features")]
    NoFeatures,
    /// An entry of that list without a table.
    #[error("a layer without a name")]
    UnnamedLayer,
    /// A table of the list that is missing, by its name.
    #[error("no table `{0}`")]
    NoTable(String),
    /// A row of the table of systems that is too short.
    #[error("a system of coordinates without a definition")]
    UndefinedSystem,
    /// A geometry that cannot be read.
    #[error("{table}: the geometry of row {row}: {problem}")]
    Feature {
        /// Name of its table.
        table: String,
        /// Id of its row.
        row: i64,
        /// Problem of the geometry.
        problem: FeatureError,
    },
}

/// Problem of a geometry in a GeoPackage.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum FeatureError {
    /// A header with an unknown code.
    #[error("an envelope of an unknown kind")]
    Envelope,
    /// A coordinate reference system without a definition, by its number.
    #[error("the system {0} is not in the file")]
    System(i64),
    /// Fewer bytes than the geometry needs.
    #[error("it is truncated")]
    Truncated,
    /// More parts than the remaining bytes can hold.
    #[error("it states {0} parts, more than it holds")]
    Count(usize),
    /// Collections within collections, beyond the maximum depth.
    #[error("geometry collections are nested too deeply")]
    TooDeep,
    /// A byte order with an unknown code.
    #[error("a byte order other than 0 or 1")]
    ByteOrder,
    /// Dimensions with an unknown code.
    #[error("an unknown kind of geometry")]
    Dimensions,
}

/// All geometries of the tables of features, in the order of the tables and of their rows. `path` is where a
/// journal would be.
///
/// # Errors
/// Problem of the file, or a feature that is not supported.
pub(super) fn read(bytes: &[u8], path: &Path) -> Result<Vec<Geometry>, GeoPackageError> {
    let mut journal = path.as_os_str().to_owned();
    journal.push("-wal");
    if std::fs::metadata(&journal).is_ok_and(|about| about.len() > 0) {
        return Err(GeoPackageError::Journal);
    }
    let database = Database::open(bytes)?;
    let systems = systems(&database)?;
    let columns = database.table("gpkg_geometry_columns")?;
    let columns = columns.ok_or(GeoPackageError::NoFeatures)?;
    let mut tables: Vec<String> = Vec::new();
    database.rows(columns, |(_, row)| -> Result<(), GeoPackageError> {
        let name = row.first().and_then(Value::text).ok_or(GeoPackageError::UnnamedLayer)?;
        if !tables.iter().any(|table| table == name) {
            tables.push(name.to_owned());
        }
        Ok(())
    })?;
    let mut found = Vec::new();
    for table in tables {
        let root = database.table(&table)?.ok_or_else(|| GeoPackageError::NoTable(table.clone()))?;
        database.rows(root, |row| feature(&table, &row, &systems, &mut found))?;
    }
    Ok(found)
}

/// The systems by their number in the file.
fn systems(database: &Database) -> Result<HashMap<i64, System>, GeoPackageError> {
    let mut systems =
        HashMap::from([(UNDEFINED_CARTESIAN, System::OfScene), (UNDEFINED_GEOGRAPHIC, System::Degrees)]);
    let Some(root) = database.table("gpkg_spatial_ref_sys")? else { return Ok(systems) };
    // srs_name, srs_id (the id of the row), organization, organization_coordsys_id, definition
    database.rows(root, |(id, row)| {
        let [_, number, organization, code, definition, ..] = row.as_slice() else {
            return Err(GeoPackageError::UndefinedSystem);
        };
        let id = number.integer().unwrap_or(id);
        let is_epsg = organization.text().is_some_and(|name| name.eq_ignore_ascii_case("EPSG"));
        let code = code.integer().filter(|_| is_epsg).and_then(|code| u32::try_from(code).ok());
        let system = match (code, definition.text()) {
            (Some(code), _) => System::of_code(code),
            (None, Some(wkt)) if crs::is_wkt(wkt) => System::of_wkt(wkt),
            _ => System::Unstated,
        };
        systems.entry(id).or_insert(system);
        Ok(())
    })?;
    Ok(systems)
}

/// Appends the geometries of a row of a table: of all values that begin as they do.
fn feature(
    table: &str,
    (id, row): &Row,
    systems: &HashMap<i64, System>,
    found: &mut Vec<Geometry>,
) -> Result<(), GeoPackageError> {
    for value in row {
        let Value::Blob(bytes) = value else { continue };
        if bytes.starts_with(b"GP") {
            geometry(bytes, systems, found).map_err(|problem| GeoPackageError::Feature {
                table: table.to_owned(),
                row: *id,
                problem,
            })?;
        }
    }
    Ok(())
}

/// The header of a geometry (§2.1.3) and the well-known binary behind it.
fn geometry(
    bytes: &[u8],
    systems: &HashMap<i64, System>,
    found: &mut Vec<Geometry>,
) -> Result<(), FeatureError> {
    let mut reader = Reader { rest: &bytes[2..], is_little: true };
    let [_version, flags] = reader.array()?;
    reader.is_little = flags & 1 != 0;
    let id = i64::from(reader.u32()?.cast_signed());
    let envelope = match flags >> 1 & 7 {
        0 => 0,
        1 => 32,
        2 | 3 => 48,
        4 => 64,
        _ => return Err(FeatureError::Envelope),
    };
    reader.take(envelope)?;
    let (is_empty, is_extended) = (flags & 0x10 != 0, flags & 0x20 != 0);
    let system = systems.get(&id).cloned().ok_or(FeatureError::System(id))?;
    if is_extended {
        found.push(Geometry { shape: Shape::Other("extended geometry".to_owned()), system });
        return Ok(());
    }
    if is_empty {
        return Ok(());
    }
    let first = found.len();
    reader.geometry(MAX_DEPTH, found)?;
    found[first..].iter_mut().for_each(|geometry| geometry.system = system.clone());
    Ok(())
}

/// Well-known binary.
struct Reader<'b> {
    rest: &'b [u8],
    is_little: bool,
}

impl<'b> Reader<'b> {
    fn take(&mut self, count: usize) -> Result<&'b [u8], FeatureError> {
        let (taken, rest) = self.rest.split_at_checked(count).ok_or(FeatureError::Truncated)?;
        self.rest = rest;
        Ok(taken)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], FeatureError> {
        self.take(N)?.try_into().map_err(|_| FeatureError::Truncated)
    }

    fn u32(&mut self) -> Result<u32, FeatureError> {
        let bytes = self.array()?;
        Ok(if self.is_little { u32::from_le_bytes(bytes) } else { u32::from_be_bytes(bytes) })
    }

    fn f64(&mut self) -> Result<f64, FeatureError> {
        let bytes = self.array()?;
        Ok(if self.is_little { f64::from_le_bytes(bytes) } else { f64::from_be_bytes(bytes) })
    }

    /// A number of parts that take at least `bytes` each.
    fn count(&mut self, bytes: usize) -> Result<usize, FeatureError> {
        let count = self.u32()? as usize;
        let is_held = count.checked_mul(bytes).is_some_and(|bytes| bytes <= self.rest.len());
        is_held.then_some(count).ok_or(FeatureError::Count(count))
    }

    fn geometry(&mut self, depth: u32, found: &mut Vec<Geometry>) -> Result<(), FeatureError> {
        let depth = depth.checked_sub(1).ok_or(FeatureError::TooDeep)?;
        self.is_little = match self.take(1)? {
            [0] => false,
            [1] => true,
            _ => return Err(FeatureError::ByteOrder),
        };
        let code = self.u32()?;
        // Heights and measures: thousands of the code, or its first bits as PostGIS writes them.
        let bits = usize::from(code & 0x8000_0000 != 0) + usize::from(code & 0x4000_0000 != 0);
        // The number of the system, which PostGIS may put here.
        if code & 0x2000_0000 != 0 {
            self.u32()?;
        }
        let code = code & 0x1fff_ffff;
        let numbers = 2 + bits + [0, 1, 1, 2].get(code as usize / 1000).ok_or(FeatureError::Dimensions)?;
        let mut add = |shape| found.push(Geometry { shape, system: System::Unstated });
        match code % 1000 {
            1 => {
                self.take(8 * numbers)?;
                add(Shape::Other("Point".to_owned()));
            }
            2 => {
                let line = self.line(numbers)?;
                add(Shape::Line(line));
            }
            3 => {
                let count = self.count(4)?;
                let rings = (0..count).map(|_| self.line(numbers)).collect::<Result<_, _>>()?;
                add(Shape::Polygon(rings));
            }
            4..=7 => {
                for _ in 0..self.count(5)? {
                    self.geometry(depth, found)?;
                }
            }
            // Curves and surfaces, whose lengths are not known: nothing follows them in a geometry of its
            // own.
            other => {
                add(Shape::Other(format!("geometry of the kind {other}")));
                self.rest = &[];
            }
        }
        Ok(())
    }

    fn line(&mut self, numbers: usize) -> Result<Line, FeatureError> {
        let count = self.count(8 * numbers)?;
        Line::of((0..count).map(|_| (0..numbers).map(|_| self.f64()).collect()))
    }
}
