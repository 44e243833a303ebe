//! Kinds of files that each reader accepts, and the messages for all others.

use super::Family::{self, *};
use super::Foreign;
use super::kinds::{self, Kind};
use std::path::Path;

/// Purpose for which a file is read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// A survey or a pipeline.
    Survey,
    /// A scene, or a part of it.
    Scene,
    /// A raster of heights.
    Terrain,
    /// A point cloud.
    Points,
    /// Poses of a platform.
    Flight,
    /// An area or a line.
    Area,
    /// A log of messages.
    Log,
    /// A table of text with its own columns.
    Table,
    /// Another file with its own format.
    Other,
}

/// Kinds of files that a reader accepts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Expected {
    /// A noun with its article: "a survey".
    pub what: &'static str,
    /// Purpose of the file.
    pub role: Role,
    /// Families of which the files that are read may be.
    families: &'static [Family],
    /// True if a file of unknown contents is rejected because its extension belongs to another kind.
    pub(super) uses_endings: bool,
    /// Kinds of other families that are read, or of these that are not although vlscan reads them elsewhere.
    except: &'static [Kind],
}

const fn expected(what: &'static str, role: Role, families: &'static [Family]) -> Expected {
    Expected { what, role, families, uses_endings: false, except: &[] }
}

impl Expected {
    /// A survey, a scene or an instrument in XML.
    pub const DOCUMENT: Expected = Expected {
        except: &[kinds::XML],
        ..expected("an XML document (survey, scene, scanner, platform)", Role::Survey, &[Document])
    };
    /// A file for `vlscan run` whose extension is not `.toml`.
    pub const SURVEY: Expected =
        Expected { what: "a survey (.xml) or a pipeline (.toml)", ..Expected::DOCUMENT };
    /// A pipeline in TOML, whose errors of syntax name their lines.
    pub const PIPELINE: Expected = expected("a pipeline (TOML)", Role::Survey, &[Pipeline, Text, Empty]);
    /// The file of a campaign.
    pub const CAMPAIGN: Expected = expected("a campaign (TOML)", Role::Other, &[Pipeline, Text, Empty]);
    /// A mesh; OBJ begins with any words.
    pub const MESH: Expected = Expected {
        uses_endings: true,
        ..expected("a mesh (OBJ, PLY, STL, OFF, glTF)", Role::Scene, &[Mesh, PointsOrMesh, Text, Empty])
    };
    /// Vegetation voxels.
    pub const VOXELS: Expected =
        expected("voxels of AMAPVox (.vox)", Role::Scene, &[Voxels, Text, Table, Empty]);
    /// A raster of heights.
    pub const RASTER: Expected = Expected {
        except: &[kinds::VRT],
        ..expected("a raster (GeoTIFF, ESRI ASCII grid)", Role::Terrain, &[Terrain])
    };
    /// Ground as a raster or a mesh.
    pub const SURFACE: Expected = expected(
        "a raster (.tif, .asc, .vrt, a folder of tiles) or a mesh (.obj, .ply, .stl, .off)",
        Role::Terrain,
        &[Terrain, Mesh, PointsOrMesh],
    );
    /// A virtual raster.
    pub const VIRTUAL_RASTER: Expected = Expected {
        except: &[kinds::VRT, kinds::XML],
        ..expected("a virtual raster of GDAL (VRT)", Role::Terrain, &[])
    };
    /// Materials of OBJ.
    pub const MATERIALS: Expected = expected("a material file", Role::Other, &[Materials, Text, Empty]);
    /// A table of materials by name.
    pub const MATERIAL_TABLE: Expected = expected("a table of materials", Role::Table, TEXTS);
    /// Reflectance by wavelength.
    pub const SPECTRUM: Expected = expected("a spectrum", Role::Table, TEXTS);
    /// Directions of leaves.
    pub const LEAF_ANGLES: Expected = expected("a table of leaf angles", Role::Table, TEXTS);
    /// Meshes with their places.
    pub const INSTANCES: Expected = expected("a table of instances", Role::Table, TABLES);
    /// Trees with their places.
    pub const INVENTORY: Expected = expected("an inventory of trees as a table of text", Role::Table, TABLES);
    /// Other columns of numbers.
    pub const NUMBERS: Expected = expected("a table of numbers", Role::Table, TABLES);
    /// Points as a text of columns, or in a format that is recognised elsewhere.
    pub const POINTS: Expected =
        expected("a point cloud", Role::Points, &[Points, PointsOrMesh, Columnar, Table, Text, Empty]);
    /// Poses; rows of text and Arrow, SBET, TerraScan.
    pub const POSES: Expected = Expected {
        except: &[kinds::PARQUET],
        ..expected("poses of a platform", Role::Flight, &[Flight, Columnar, Table, Text, Empty])
    };
    /// Rows of text and Arrow, with any contents.
    pub const ROWS: Expected = Expected {
        except: &[kinds::PARQUET],
        ..expected("rows of text or Arrow", Role::Table, &[Columnar, Table, Text, Empty])
    };
    /// Polygons and lines.
    pub const AREA: Expected = Expected {
        uses_endings: true,
        except: &[kinds::JSON],
        ..expected(
            "polygons or lines (GeoJSON, KML, KMZ, GPX, shapefile, GeoPackage, well-known text)",
            Role::Area,
            &[Area, Empty],
        )
    };
    /// A coordinate reference system.
    pub const SYSTEM: Expected = expected(
        "a coordinate reference system (WKT or an EPSG code)",
        Role::Other,
        &[System, Text, Table, Empty],
    );
    /// The calibration of a sensor.
    pub const CALIBRATION: Expected = Expected {
        except: &[kinds::JSON],
        ..expected("the calibration of an Ouster sensor (JSON)", Role::Other, &[Calibration])
    };
    /// A log of frames.
    pub const LOG: Expected = expected("an MCAP log", Role::Log, &[Log]);
    /// Sampled pulses.
    pub const WAVEFORMS: Expected = expected("waveforms as text", Role::Other, &[Table, Text, Empty]);
    /// A packed scene.
    pub const PACKED: Expected = expected("a packed scene (.vlscene)", Role::Scene, &[Packed]);
    /// The shards of a run.
    pub const SHARDS: Expected = expected("a folder of shards", Role::Other, &[]);
    /// Compressed text.
    pub const COMPRESSED: Expected = Expected {
        except: &[kinds::COMPRESSED_TEXT],
        ..expected("compressed text of HELIOS++ or vlscan (.bin)", Role::Other, &[])
    };

    /// The same files under another name: a noun with its article.
    pub const fn named(self, what: &'static str) -> Expected {
        Expected { what, ..self }
    }

    /// True if the file may be one of those that are read. Kinds that need a converter are not.
    pub(super) fn accepts(&self, kind: &Kind) -> bool {
        let is_odd = self.except.contains(kind);
        // Readers of UTF-16 decode it themselves.
        let is_read = kind.convert.is_empty() || kind.family == Utf16;
        is_odd != (self.families.contains(&kind.family) && is_read)
    }

    /// True if the name has the extension of a supported kind.
    pub(super) fn accepts_name(&self, path: &Path) -> bool {
        let Some(ending) = path.extension() else { return false };
        let ending = ending.to_string_lossy().to_ascii_lowercase();
        let mut kinds = kinds::BY_START.iter().chain(kinds::BY_CONTENTS);
        kinds.any(|kind| kind.endings.contains(&ending.as_str()) && self.accepts(kind))
    }

    /// The message for a file of another kind.
    pub(super) fn refuse(&self, kind: &'static Kind, path: &Path) -> Foreign {
        let name = quoted(path);
        let help = match kind.convert {
            "" => self.advice(kind).unwrap_or_else(|| use_of(kind).to_owned()),
            convert => match (self.suits(kind.family), self.advice(kind), use_of(kind)) {
                (true, ..) | (_, None, "") => convert.to_owned(),
                (_, Some(advice), _) => format!("{convert}; {}", advice.replace("{f}", "FILE")),
                (_, _, of) => format!("{convert}; {}", of.replace("{f}", "FILE")),
            },
        };
        Foreign { kind, expected: self.what, help: help.replace("{f}", &name) }
    }

    /// True if a file of the family is as expected once it is converted.
    fn suits(&self, family: Family) -> bool {
        self.families.contains(&family)
            || matches!(
                (self.role, family),
                (Role::Table | Role::Flight | Role::Points, Array | Sheet | Utf16)
            )
    }

    /// Advice for files of a family, by the purpose of the reader.
    fn advice(&self, kind: &Kind) -> Option<String> {
        let text = match (self.role, kind.family) {
            (Role::Scene, Points) => {
                "a point cloud becomes voxels: a scene of XML with <filter type=\"xyzloader\"> and a \
                 voxelSize, or `vlscan scene reconstruct {f} -o DIR`"
            }
            (Role::Scene, Terrain) => {
                "a terrain raster is read by <filter type=\"geotiffloader\">, or as `--scene {f}`"
            }
            (Role::Terrain, Points | PointsOrMesh) => {
                "a terrain of points: `vlscan raster {f} --dtm dtm.tif`"
            }
            (Role::Terrain, Mesh) => "a mesh is read by <filter type=\"objloader\">, or as `--scene {f}`",
            (Role::Points, Terrain) => {
                "`vlscan scene info {f}` describes it as terrain; points of its cells: gdal_translate -of \
                 XYZ {f} out.xyz"
            }
            (Role::Flight, Area | Log | Mesh | Document | Markup) => {
                "write its positions as a table with headings: time,x,y,z,roll,pitch,yaw"
            }
            (Role::Flight, Points) => {
                "`vlscan fit {f} --output flight.toml` estimates the flight of a recorded cloud"
            }
            (Role::Area, Table) => "write the corners as well-known text: POLYGON ((x y, x y, x y))",
            (Role::Area, Flight) => "`vlscan run PIPELINE --trajectory {f}` flies it as it was recorded",
            (Role::Area, Points) => {
                "`vlscan info {f}` shows its extent; write the corners as well-known text: POLYGON ((x y, x \
                 y, x y))"
            }
            (Role::Table | Role::Flight, Columnar) => "write it as CSV, for example with Polars or pandas",
            (Role::Survey, Text | Utf16 | Binary | Empty | Markup) => {
                "`vlscan run` flies a survey (.xml) or a pipeline (.toml); docs/start.md shows both"
            }
            (Role::Scene, Table) => {
                "a table of instances ends in .csv; points become voxels: a scene of XML with <filter \
                 type=\"xyzloader\">"
            }
            (_, Binary | Text | Empty | Markup) => "",
            _ => return None,
        };
        Some(text.to_owned())
    }
}

const TEXTS: &[Family] = &[Table, Text, Empty];
const TABLES: &[Family] = &[Table, Text, Utf16, Empty];

/// The command for files of the kind, with `{f}` for the file.
fn use_of(kind: &Kind) -> &'static str {
    match kind.family {
        Points | Columnar => {
            "`vlscan info {f}` describes a point cloud, `vlscan preview {f} -o page.html` shows it"
        }
        PointsOrMesh => "`vlscan info {f}` describes its points, `vlscan scene info {f}` its mesh",
        Mesh | Voxels | Terrain => {
            "`vlscan scene info {f}` describes it, `vlscan run SURVEY --scene {f}` scans it"
        }
        Packed => "`vlscan scene info {f}` describes it, `vlscan run SURVEY --scene {f}` scans it",
        Materials => "name the OBJ file that uses it: `vlscan scene info model.obj`",
        Area => "`vlscan plan airborne --area {f}` takes areas, `vlscan plan mobile --along {f}` lines",
        System => "`--crs {f}` takes coordinate reference systems",
        Flight => "`vlscan run PIPELINE --trajectory {f}` flies it",
        Log => {
            "`vlscan frames {f} -o DIR --layout kitti` writes the frames of an MCAP log that vlscan wrote, \
             `vlscan info {f}` describes its points; `vlscan run -o a.mcap -o a.laz` also writes a cloud"
        }
        Document => {
            "`vlscan run {f}` flies a survey, `vlscan scene info {f}` describes a scene; `--scanner {f}#ID` \
             takes instruments"
        }
        Pipeline => {
            "`vlscan run {f}` flies a pipeline, `vlscan campaign {f}` makes the data set of a campaign"
        }
        Shard => "`vlscan merge FOLDER` makes points of the shards of a run",
        Calibration => "`--scanner {f}` takes calibrations",
        Table => {
            "points: `vlscan info {f}`; a trajectory: `vlscan run PIPELINE --trajectory {f}`; an inventory \
             of trees: `vlscan scene stand {f} -o DIR`"
        }
        Array | Sheet => "tables: points for `vlscan info {f}`, a trajectory for `--trajectory {f}`",
        Markup | Text | Utf16 | Archive | Picture | Other | Binary | Empty => "",
    }
}

/// The name of a file as a shell takes it; a placeholder for standard input.
fn quoted(path: &Path) -> String {
    let name = path.to_string_lossy();
    match name.as_ref() {
        "-" | "<stdin>" | "STDIN" | "/dev/stdin" | "" => "FILE".to_owned(),
        name if name.chars().all(|c| c.is_alphanumeric() || "/._-+=:@%\\".contains(c)) => name.to_owned(),
        name => format!("'{}'", name.replace('\'', "'\\''")),
    }
}
