//! Mesh files: OBJ, PLY, STL, OFF and glTF, recognised by their contents.
//!
//! | file | what it does |
//! |---|---|
//! | `error` | errors of the other formats |
//! | `obj` | OBJ |
//! | `ply` | PLY |
//! | `stl` | STL |
//! | `off` | OFF |
//! | `gltf`, `gltf_buffers` | documents of glTF 2.0: accessors, meshes, materials; their bytes |
//! | `gltf_extensions` | extensions that a document may require |
//! | `gltf_materials` | materials of a glTF document with their extras |
//! | `gltf_colours` | colours and textures of a glTF document |
//! | `gltf_nodes` | the nodes of a glTF document with their transforms |
//! | `expand` | glTF files as parts, one for each mesh that a node places |
//! | `materials` | tables of materials by name |
//! | `memory` | meshes in memory |
//! | `polygon` | polygons as triangles, for all formats |
//! | `doubts` | meshes that are probably in another unit, or with another axis up |

pub(super) mod doubts;
mod error;
mod expand;
mod gltf;
mod gltf_buffers;
mod gltf_colours;
mod gltf_extensions;
mod gltf_materials;
mod gltf_nodes;
mod materials;
pub(super) mod memory;
mod obj;
mod off;
mod ply;
mod polygon;
mod stl;
#[cfg(test)]
mod tests;

pub use error::{GltfError, MeshError, OffError, PlyMeshError, StlError};
pub(crate) use expand::{EpochPart, parts_in_epoch};
pub use obj::obj_materials;

use crate::builder::{PartSource, SceneBuilder};
use crate::library::{DefinedBy, Names};
use crate::optics::is_diffuse_free;
use crate::reflectance_issues::missing;
use crate::text::{Source, printable};
use materials::MaterialTable;
use polygon::Fan;
use std::collections::HashSet;
use std::path::Path;
use vlscan_base::diag::{Place, listed};
use vlscan_base::error::{Error, Result};
use vlscan_base::quantity::number;
use vlscan_base::recognise::{Expected, Foreign, foreign, is_off};
use vlscan_formats::is_ply;
use vlscan_geom::DVec3;
use vlscan_survey::{MaterialDefinition, Mesh, MeshColours, MeshReading, UpAxis};

/// Warning of colours in formats that are read without.
const UNREAD_COLOURS: &str = "its colours are not read; OBJ, PLY and glTF files may have colours";

/// Largest step of coordinates of 32 bits that is not warned of, m.
const MAX_STEP_M: f64 = 0.01;

/// Formats of mesh files.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Format {
    Obj,
    Ply,
    Stl,
    Off,
    Gltf,
}

impl Format {
    fn of(path: &Path, bytes: &[u8]) -> Format {
        let ending = path.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
        match ending.as_str() {
            _ if is_ply(bytes) => Format::Ply,
            _ if bytes.starts_with(b"glTF") => Format::Gltf,
            "gltf" | "glb" => Format::Gltf,
            _ if is_off(bytes) => Format::Off,
            "ply" => Format::Ply,
            "stl" => Format::Stl,
            _ if stl::is_stl(bytes) => Format::Stl,
            _ => Format::Obj,
        }
    }

    fn up(self) -> UpAxis {
        if self == Format::Gltf { UpAxis::Y } else { UpAxis::Z }
    }
}

/// The frame of a file's coordinates.
#[derive(Clone, Copy, Debug)]
struct FileFrame {
    up: UpAxis,
    unit_m: f64,
}

impl FileFrame {
    fn new(reading: &MeshReading, format: Format) -> FileFrame {
        FileFrame { up: reading.up.unwrap_or(format.up()), unit_m: reading.metres_per_unit() }
    }

    /// A direction of the file in the frame of the scene, z up.
    fn rotate(&self, v: DVec3) -> DVec3 {
        match self.up {
            UpAxis::Z => v,
            UpAxis::Y => DVec3::new(v.x, -v.z, v.y),
        }
    }

    /// A point of the file in metres, z up.
    fn apply(&self, v: DVec3) -> DVec3 {
        self.rotate(v) * self.unit_m
    }
}

/// A mesh as a file holds it.
#[derive(Debug, Default)]
struct RawMesh {
    /// Metres, z up.
    vertices: Vec<DVec3>,
    triangles: Vec<[u32; 3]>,
    materials: Vec<MaterialDefinition>,
    /// Index in `materials` of each triangle.
    material_of: Vec<u32>,
    /// The face of each triangle, as the file has them.
    face_of: Vec<u32>,
    /// Number of faces.
    faces: u32,
    /// The faces of more than three corners.
    fans: Vec<Fan>,
    /// Number of faces of fewer than three corners, which have no triangle.
    edges: usize,
    /// True if the file has coordinates of 32 bits.
    is_single: bool,
    /// Omissions, as sentences about the file.
    warnings: Vec<String>,
    /// Colours of triangles, if they are requested.
    colours: MeshColours,
    /// Colours of vertices, in place of those of triangles.
    vertex_colours: Vec<[u16; 3]>,
}

impl RawMesh {
    /// Adds a polygon, which is divided when all corners are known.
    fn add_polygon(&mut self, corners: &[u32], material: u32) {
        self.edges += usize::from(corners.len() < 3);
        if corners.len() > 3 {
            self.fans.push(Fan { first: self.triangles.len() as u32, triangles: corners.len() as u32 - 2 });
        }
        for pair in corners.get(1..).unwrap_or_default().windows(2) {
            self.triangles.push([corners[0], pair[0], pair[1]]);
            self.material_of.push(material);
            self.face_of.push(self.faces);
        }
        self.faces += 1;
    }

    /// Warns of coordinates of 32 bits that are too large to be exact. `unit_m` is their unit.
    fn check_precision(&mut self, unit_m: f64) {
        let sizes = self.vertices.iter().filter(|v| v.is_finite()).map(|v| v.abs().max_element());
        let farthest = sizes.fold(0.0, f64::max);
        let stored = farthest as f32;
        let step = (f64::from(stored.next_up()) - f64::from(stored)) * unit_m;
        if self.is_single && step > MAX_STEP_M && step.is_finite() {
            self.warnings.push(format!(
                "its coordinates are numbers of 32 bits, which have steps of {} m at {}: all surfaces are \
                 rounded to them; write the mesh as OBJ or with 64 bits, or around 0, and move it by a \
                 translate filter",
                number(step),
                number(farthest * unit_m)
            ));
        }
    }

    /// Divides the polygons into triangles.
    fn divide_polygons(&mut self) {
        let crossings = polygon::divide(&self.fans, &mut self.triangles, &self.vertices);
        self.warnings.extend(crossings.map(|crossings| crossings.message()));
        if self.edges > 0 {
            self.warnings.push(format!("{} faces with fewer than three corners are left out", self.edges));
        }
        if self.triangles.contains(&polygon::UNUSED) {
            let is_used: Vec<bool> = self.triangles.iter().map(|t| *t != polygon::UNUSED).collect();
            let mut used = is_used.iter().copied().cycle();
            let mut keep = || used.next().unwrap_or(true);
            // Three arrays of the same length, one after the other.
            self.triangles.retain(|_| keep());
            self.material_of.retain(|_| keep());
            self.face_of.retain(|_| keep());
        }
        if !self.vertex_colours.is_empty() {
            let tint =
                |corner: u32| self.vertex_colours.get(corner as usize).copied().unwrap_or([u16::MAX; 3]);
            self.colours.tints = self.triangles.iter().map(|corners| corners.map(tint)).collect();
        }
    }
}

/// A material of a mesh file: it reflects diffusely.
fn diffuse(name: impl AsRef<str>) -> MaterialDefinition {
    MaterialDefinition { kd: [1.0; 3], ..MaterialDefinition::new(printable(name.as_ref())) }
}

/// Appends the triangles of a mesh file to the scene. `names` holds the materials known to the part's OBJ
/// files.
pub(crate) fn load(
    scene: &mut SceneBuilder,
    part: &PartSource,
    source: &Source,
    reading: &MeshReading,
    names: &mut Names,
) -> Result<()> {
    if let Some(found) = foreign_format(source) {
        let message = format!("{}: {}", found.message(), source.path().display());
        scene.diagnostics.error(part.place.cloned(), message).help(found.help);
        return Ok(());
    }
    let format = Format::of(source.path(), source.bytes());
    let frame = FileFrame::new(reading, format);
    let found = match format {
        Format::Obj => return load_obj(scene, part, source, reading, names),
        Format::Ply => ply::read(source, scene.options.colours).map_err(MeshError::from),
        Format::Stl => stl::read(source, scene.options.colours).map_err(MeshError::from),
        Format::Off => off::read(source, scene.options.colours).map_err(MeshError::from),
        Format::Gltf => {
            let document =
                gltf::GltfDocument::open(source.path(), scene.free_memory(), scene.options.colours);
            let raw = document.and_then(|document| {
                scene.sources.extend(document.files().map(Path::to_path_buf));
                let warnings = document.warnings();
                document.whole(frame).map(|raw| RawMesh { warnings, ..raw })
            });
            raw.map_err(MeshError::from)
        }
    };
    let mut raw = match found {
        Ok(raw) => raw,
        Err(error) => {
            report(scene, source.path(), error);
            return Ok(());
        }
    };
    raw.check_precision(frame.unit_m);
    raw.divide_polygons();
    for warning in std::mem::take(&mut raw.warnings) {
        scene.diagnostics.warn(Some(Place::of_file(source.path())), warning);
    }
    if format != Format::Gltf {
        raw.vertices.iter_mut().for_each(|v| *v = frame.apply(*v));
    }
    let face_of = std::mem::take(&mut raw.face_of);
    let table = table_of(scene, source.path(), reading);
    let mut unknown = Vec::new();
    let mesh = finish(scene, source.path(), table.as_ref(), raw, &mut unknown)?;
    warn_of_unknown(scene, source.path(), (unknown, table.as_ref()));
    let Some(mesh) = mesh else { return Ok(()) };
    let by = DefinedBy::MeshFile(source.path().to_path_buf(), reading.materials.clone());
    let materials = scene.library.of(by, || mesh.materials().to_vec(), &mut scene.diagnostics);
    memory::load_with(scene, part, &mesh, materials, &face_of)
}

/// Reports a file that cannot be read.
fn report(scene: &mut SceneBuilder, path: &Path, error: MeshError) {
    scene.diagnostics.error(Some(Place::of_file(path)), error.to_string()).because_of(error);
}

/// A file in an unknown format. A binary STL file can start with any bytes.
fn foreign_format(source: &Source) -> Option<Foreign> {
    let bytes = source.bytes();
    let is_known = is_ply(bytes) || bytes.starts_with(b"glTF") || stl::is_stl(bytes);
    (!is_known).then(|| foreign(source.path(), bytes, &Expected::MESH)).flatten()
}

/// The table of a mesh file's materials, if it has one.
fn table_of(scene: &mut SceneBuilder, path: &Path, reading: &MeshReading) -> Option<MaterialTable> {
    let table = MaterialTable::of(path, reading, &mut scene.diagnostics)?;
    scene.sources.push(table.path().to_path_buf());
    Some(table)
}

/// Most names of a table in a message.
const MAX_NAMES: usize = 8;

/// Warns of materials whose reflectance is not known, and of which the table of the file has no line.
fn warn_of_unknown(
    scene: &mut SceneBuilder,
    path: &Path,
    (mut unknown, table): (Vec<String>, Option<&MaterialTable>),
) {
    let mut seen = HashSet::new();
    unknown.retain(|name| seen.insert(name.clone()));
    if unknown.is_empty() {
        return;
    }
    let names: Vec<String> = unknown.iter().map(|n| format!("\"{n}\"")).collect();
    let message = missing(&names, scene.options.rules);
    let help = table.map_or_else(
        || {
            "a file materials.csv beside it, with a line name,reflectance,class,ground and one for each \
             material, gives reflectances from 0 to 1"
                .to_owned()
        },
        |table| {
            let names = table.names();
            let names = if names.is_empty() { "none".to_owned() } else { listed(&names, MAX_NAMES) };
            format!("{} has no line for it, but for: {names}", table.path().display())
        },
    );
    scene.diagnostics.warn(Some(Place::of_file(path)), message).help(help);
}

/// Gives the materials of a mesh the properties of its table, and checks the mesh; `None` after an error in
/// the input. Names of materials without a reflectance are appended to `unknown`, but for those that a row of
/// the table describes: the library reports these at their lines.
fn finish(
    scene: &mut SceneBuilder,
    path: &Path,
    table: Option<&MaterialTable>,
    mut raw: RawMesh,
    unknown: &mut Vec<String>,
) -> Result<Option<Mesh>> {
    for material in &mut raw.materials {
        material.place = Some(Place::of_file(path));
        if let Some(table) = table {
            table.apply(material);
        }
    }
    let rules = scene.options.rules;
    let is_lacking = |m: &&MaterialDefinition| {
        let is_given = m.reflectance.is_some() || m.spectrum.is_some();
        !is_given && !m.has_line() && !is_diffuse_free(m, rules)
    };
    unknown.extend(raw.materials.iter().filter(is_lacking).map(|m| m.name.clone()));
    let colours = raw.colours;
    let mesh = Mesh::new(raw.vertices, raw.triangles, raw.materials, raw.material_of);
    match mesh.and_then(|mesh| mesh.with_colours(colours)) {
        Ok(mesh) => Ok(Some(mesh)),
        Err(Error::Input(problems)) => {
            let message = problems.items().first().map_or_else(String::new, |p| p.message.clone());
            scene.diagnostics.error(Some(Place::of_file(path)), message);
            Ok(None)
        }
        Err(e) => Err(e),
    }
}

fn load_obj(
    scene: &mut SceneBuilder,
    part: &PartSource,
    source: &Source,
    reading: &MeshReading,
    names: &mut Names,
) -> Result<()> {
    if reading.materials.is_some()
        && let Some(table) = MaterialTable::of(source.path(), reading, &mut scene.diagnostics)
    {
        scene.sources.push(table.path().to_path_buf());
        scene.library.add_definitions(table.path(), || table.definitions(), names);
    }
    let start = scene.end();
    let y_up = reading.up == Some(UpAxis::Y);
    let (drop_polygons, number_faces) = (scene.options.drop_polygons, scene.faces.are_requested);
    let lines = obj::Reading { y_up, drop_polygons, number_faces };
    obj::load(scene, part, source, lines, names)?;
    let unit_m = reading.metres_per_unit();
    if unit_m != 1.0 {
        let vertices = scene.since(&start).vertices;
        scene.geometry.vertices[vertices].iter_mut().for_each(|v| *v *= unit_m);
    }
    Ok(())
}
