//! Loads Wavefront OBJ files (spec input-formats §4.1): the file is divided at line ends and read by all
//! threads in parallel; the pieces are appended in the order of the file, so the result does not depend on
//! their number.

mod colours;
mod slice;
#[cfg(test)]
mod tests;
mod used;

use crate::builder::{PartSource, SceneBuilder};
use crate::library::{Known, Names};
use crate::load::mesh::polygon::{self, Fan};
use crate::material::DEFAULT;
use crate::mtl::name_of;
use crate::reflectance_issues::{ReflectanceIssue, assumed};
use crate::text::{Problems, Source, cut_into_pieces};
use colours::Untextured;
use rayon::prelude::*;
pub(crate) use slice::Reading;
use slice::{NO_VERTEX, Slice, Statement, Switch};
use std::collections::HashSet;
use std::ops::Range;
use std::path::{Path, PathBuf};
use vlscan_base::columns::decoded;
use vlscan_base::diag::{Place, nearest};
use vlscan_base::error::Result;
use vlscan_base::files::reads;
use vlscan_base::quantity::counted;
use vlscan_base::recognise::Expected;
use vlscan_geom::DVec3;

pub use used::obj_materials;

/// Bytes read by one task: small enough to keep all threads busy, large enough to make the overhead per task
/// negligible.
const PIECE_BYTES: usize = 1 << 20;

/// Pieces per thread that are read before they are appended; limits the memory held twice.
const PIECES_PER_THREAD: usize = 4;

/// Maximum number of names in a folder that are searched for a similar one.
const MAX_LISTED_NAMES: usize = 10_000;

/// Appends the triangles of an OBJ file to the scene. `names` holds the materials known to the part's files.
pub(crate) fn load(
    scene: &mut SceneBuilder,
    part: &PartSource,
    source: &Source,
    reading: Reading,
    names: &mut Names,
) -> Result<()> {
    let other = source.with_other_line_ends();
    let source = other.as_ref().unwrap_or(source);
    if !source.is_text(&Expected::MESH.named("an OBJ file"), &mut scene.diagnostics) {
        return Ok(());
    }
    let start = scene.end();
    let first_face = scene.faces.count;
    let (mesh, problems) = read_pieces(scene, source, reading)?;
    problems.report(source, &mut scene.diagnostics);
    check_whole(scene, source, &mesh);
    if mesh.polygons > 0 && reading.drop_polygons {
        let message = format!("{} faces with more than four vertices are left out", mesh.polygons);
        scene.diagnostics.warn(Some(Place::of_file(source.path())), message);
    }
    divide_polygons(scene, source, reading, &mesh);
    assign_materials(scene, part, source, &mesh, names)?;
    let faults = leave_out_faults(scene, source, reading, &mesh);
    faults.report(source, &mut scene.diagnostics);
    let vertices = scene.geometry.vertices.len();
    if scene.options.colours {
        add_colours(scene, source, reading, (mesh.first_triangle, first_face));
    }
    scene.finish_mesh(&start)?;
    let unused = vertices - scene.geometry.vertices.len();
    if let Some((number, at, text)) = source.unended_line().filter(|_| unused > 0) {
        let message = format!(
            "the last line has no end and {unused} vertices belong to no face; is the file truncated?"
        );
        scene.diagnostics.warn(Some(source.place(number, at..at + text.len())), message);
    }
    Ok(())
}

/// Adds the colours of the triangles of a file, whose first triangle and face have these numbers in the
/// scene. Warns of triangles that cannot show their texture.
fn add_colours(
    scene: &mut SceneBuilder,
    source: &Source,
    reading: Reading,
    (first_triangle, first_face): (usize, usize),
) {
    let triangles = &scene.geometry.triangles[first_triangle..];
    let faces = &scene.faces.of_triangles;
    let faces = &faces[faces.len().saturating_sub(triangles.len())..];
    let faces: Vec<u32> = faces.iter().map(|face| face - first_face as u32).collect();
    let is_textured = |triangle: usize| scene.is_textured(first_triangle + triangle);
    let mut untextured = Untextured::default();
    let colours = colours::read(source.bytes(), reading, (triangles, &faces), is_textured, &mut untextured);
    scene.add_colours(first_triangle, colours);
    let Untextured { wrong, missing } = untextured;
    for (found, what) in [
        (wrong, "texture coordinates do not exist or are not numbers"),
        (missing, "the material has one, but the faces have no texture coordinates"),
    ] {
        if found.count > 0 {
            let (line, at) = found.first;
            let message = format!("{} without texture: {what}", counted(found.count, "triangle"));
            scene.diagnostics.warn(Some(source.place(line, at)), message);
        }
    }
}

/// Reports a mesh that is probably incomplete. Vertices come first in nearly all files, so a file truncated
/// in its first half has no face.
fn check_whole(scene: &mut SceneBuilder, source: &Source, mesh: &Mesh) {
    let vertices = scene.geometry.vertices.len() - mesh.first_vertex;
    let has_elements = scene.geometry.triangles.len() > mesh.first_triangle || mesh.elements > 0;
    let message = match (has_elements || mesh.polygons > 0, vertices) {
        (true, _) => return,
        (false, 0) if mesh.unknown == 0 => return,
        (false, 0) => "expected a mesh (OBJ, PLY, STL, OFF, glTF), found no vertex and no face".to_owned(),
        (false, n) => format!("expected faces of the {n} vertices, found none; is the file truncated?"),
    };
    let end = source.bytes().len();
    scene.diagnostics.error(Some(source.place(mesh.lines.max(1), end.saturating_sub(1)..end)), message);
}

/// Divides the faces of more than three corners; those that cross themselves are reported.
fn divide_polygons(scene: &mut SceneBuilder, source: &Source, reading: Reading, mesh: &Mesh) {
    let vertices = &scene.geometry.vertices[mesh.first_vertex..];
    let triangles = &mut scene.geometry.triangles[mesh.first_triangle..];
    if let Some(crossings) = polygon::divide(&mesh.fans, triangles, vertices) {
        let (line, at) = mesh.locate(source, reading, crossings.first);
        scene.diagnostics.warn(Some(source.place(line, at)), crossings.message());
    }
}

/// The position of a file's triangles and vertices in the scene, and counts of the reading.
struct Mesh {
    first_vertex: usize,
    first_triangle: usize,
    pieces: Vec<Piece>,
    switches: Vec<Switch>,
    fans: Vec<Fan>,
    polygons: usize,
    elements: usize,
    unknown: usize,
    lines: usize,
}

/// Maps triangles (counted within the file) to bytes of the file.
struct Piece {
    first_triangle: usize,
    first_line: usize,
    bytes: Range<usize>,
}

fn read_pieces(scene: &mut SceneBuilder, source: &Source, reading: Reading) -> Result<(Mesh, Problems)> {
    let bytes = source.bytes();
    let mut mesh = Mesh {
        first_vertex: scene.geometry.vertices.len(),
        first_triangle: scene.geometry.triangles.len(),
        pieces: Vec::new(),
        switches: Vec::new(),
        fans: Vec::new(),
        polygons: 0,
        elements: 0,
        unknown: 0,
        lines: 0,
    };
    let mut problems = Problems::default();
    for wave in cut_into_pieces(bytes, PIECE_BYTES).chunks(PIECES_PER_THREAD * rayon::current_num_threads()) {
        let read: Vec<Slice> =
            wave.par_iter().map(|piece| slice::read(&bytes[piece.clone()], reading)).collect();
        let count = |of: fn(&Slice) -> usize| read.iter().map(of).sum();
        scene.reserve(count(|s| s.vertices.len()), count(|s| s.triangles.len()), 0, source.path())?;
        for (slice, piece) in read.into_iter().zip(wave) {
            append(scene, &mut mesh, &mut problems, slice, piece.clone());
        }
        if let (Some(first), Some(last)) = (wave.first(), wave.last()) {
            source.release(first.start..last.end);
        }
    }
    Ok((mesh, problems))
}

fn append(
    scene: &mut SceneBuilder,
    mesh: &mut Mesh,
    problems: &mut Problems,
    mut slice: Slice,
    bytes: Range<usize>,
) {
    let lines = mesh.lines;
    mesh.lines += slice.lines;
    let vertices_before = (scene.geometry.vertices.len() - mesh.first_vertex) as i64;
    for &corner in &slice.relative {
        let number = &mut slice.triangles[corner as usize / 3][corner as usize % 3];
        *number = u32::try_from(vertices_before + i64::from(*number as i32)).unwrap_or(NO_VERTEX);
    }
    let first_triangle = scene.geometry.triangles.len() - mesh.first_triangle;
    mesh.switches.extend(slice.switches.into_iter().map(|s| Switch {
        triangle: s.triangle + first_triangle,
        line: s.line + lines,
        at: s.at.start + bytes.start..s.at.end + bytes.start,
        ..s
    }));
    mesh.fans.extend(slice.fans.iter().map(|fan| Fan { first: fan.first + first_triangle as u32, ..*fan }));
    problems.append(slice.problems, lines, bytes.start);
    mesh.polygons += slice.polygons;
    mesh.elements += slice.elements;
    mesh.unknown += slice.unknown;
    mesh.pieces.push(Piece { first_triangle, first_line: lines, bytes });
    let faces = &mut scene.faces;
    faces.of_triangles.extend(slice.face_of.iter().map(|face| face + faces.count as u32));
    faces.count += slice.faces;
    scene.geometry.vertices.append(&mut slice.vertices);
    scene.geometry.triangles.append(&mut slice.triangles);
}

/// Assigns every triangle the material in force at its face. Materials are looked up at the faces, so
/// libraries must be named before them.
fn assign_materials(
    scene: &mut SceneBuilder,
    part: &PartSource,
    source: &Source,
    mesh: &Mesh,
    names: &mut Names,
) -> Result<()> {
    let count = scene.geometry.triangles.len() - mesh.first_triangle;
    let mut current: (String, Option<&Switch>) = (DEFAULT.to_owned(), None);
    let mut reported = HashSet::new();
    let ends = mesh.switches.iter().map(|s| s.triangle).chain([count]);
    let switches = mesh.switches.iter().map(Some).chain([None]);
    let mut start = 0;
    for (end, switch) in ends.zip(switches) {
        if end > start {
            let (material, known) = scene.library.named(&current.0, names, &mut scene.diagnostics);
            let place = || {
                let place = current.1.map(|s| source.place(s.line, s.at.clone()));
                place.unwrap_or_else(|| source.place(0, 0..0))
            };
            let is_replaced = scene.replaces_material(&current.0);
            if current.0 == DEFAULT && !is_replaced && reported.insert(current.0.clone()) {
                scene.library.issues.add(ReflectanceIssue::Missing, DEFAULT, place());
            }
            match known {
                Known::Whole => {}
                Known::Nowhere if is_replaced => {}
                _ if !reported.insert(current.0.clone()) => {}
                Known::FirstWord(other) => {
                    let message = format!(
                        "no material file defines \"{}\"; \"{other}\" is used, which has the same first word",
                        current.0
                    );
                    scene.diagnostics.warn(Some(place()), message);
                }
                Known::Nowhere => {
                    let assumed = assumed(scene.options.rules);
                    let message =
                        format!("no material file defines \"{}\"; it reflects {assumed}", current.0);
                    scene.diagnostics.warn(Some(place()), message);
                }
            }
            let surface = scene.surface(part.index, material);
            scene.triangle_surfaces.resize(mesh.first_triangle + end, surface);
            start = end;
        }
        match switch.map(|s| (&s.statement, s)) {
            Some((Statement::Use(name), s)) => current = (name_of(name), Some(s)),
            Some((Statement::Library(file), s)) => add_library(scene, source, names, file, s),
            None => {}
        }
    }
    Ok(())
}

/// Reads a material library in the folder of the OBJ file. The rest of the line after `mtllib` is one file
/// name; if no such file exists, `\` separates folders, and then each word is a name.
fn add_library(
    scene: &mut SceneBuilder,
    source: &Source,
    names: &mut Names,
    operand: &[u8],
    switch: &Switch,
) {
    let folder = source.path().parent().map_or_else(PathBuf::new, PathBuf::from);
    let place = || source.place(switch.line, switch.at.clone());
    let whole = decoded(operand);
    let with_slashes = whole.replace('\\', "/");
    if let Some(paths) = library_files(&folder, &whole) {
        if whole.contains('\\') && paths.first() != Some(&folder.join(&whole)) {
            let message = format!("there is no file `{whole}`; `{with_slashes}` is read");
            scene.diagnostics.warn(Some(place()), message).help("write / between folders");
        }
        for path in paths {
            scene.library.add_file(&path, names, &mut scene.diagnostics);
        }
        return;
    }
    let message = format!("there is no material file \"{whole}\" in {}", shown_folder(&folder));
    let default = format!("materials that it should define reflect {}", assumed(scene.options.rules));
    let help = match similar_file(&folder, &with_slashes) {
        Some(similar) => format!("did you mean `{similar}`? {default}"),
        None => default,
    };
    scene.diagnostics.warn(Some(place()), message).help(help);
}

/// The files in `folder` that the rest of a line `mtllib` names, all of which exist: one file, as it is
/// written or with `/` in place of `\`, else one for each word.
fn library_files(folder: &Path, whole: &str) -> Option<Vec<PathBuf>> {
    let with_slashes = whole.replace('\\', "/");
    let words: Vec<&str> = with_slashes.split_whitespace().collect();
    let spellings = [vec![whole], vec![with_slashes.as_str()], words];
    let mut found =
        spellings.iter().map(|files| -> Vec<PathBuf> { files.iter().map(|f| folder.join(f)).collect() });
    found.find(|paths| paths.iter().all(reads::is_file))
}

/// The name of a file in `folder` that differs from `name` by capitals or a few letters.
fn similar_file(folder: &Path, name: &str) -> Option<String> {
    let paths = reads::list(folder).ok()?.into_iter().take(MAX_LISTED_NAMES);
    let names: Vec<String> =
        paths.map(|path| path.file_name().unwrap_or_default().to_string_lossy().into_owned()).collect();
    let with_ending = names.iter().filter(|n| n.to_lowercase().ends_with(".mtl")).map(String::as_str);
    nearest(name, with_ending).map(str::to_owned)
}

fn shown_folder(folder: &Path) -> String {
    if folder.as_os_str().is_empty() {
        "the working directory".to_owned()
    } else {
        folder.display().to_string()
    }
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Fault {
    /// See [`polygon::UNUSED`].
    Unused,
    MissingVertex,
    UnusableVertex,
    NoArea,
}

fn fault(triangle: [u32; 3], vertices: &[DVec3]) -> Option<Fault> {
    if triangle == polygon::UNUSED {
        return Some(Fault::Unused);
    }
    if triangle.iter().any(|&v| v as usize >= vertices.len()) {
        return Some(Fault::MissingVertex);
    }
    let [a, b, c] = triangle.map(|v| vertices[v as usize]);
    if a.is_nan() || b.is_nan() || c.is_nan() {
        return Some(Fault::UnusableVertex);
    }
    ((b - a).cross(c - a) == DVec3::ZERO).then_some(Fault::NoArea)
}

/// Removes triangles that cannot be hit and reports them.
fn leave_out_faults(scene: &mut SceneBuilder, source: &Source, reading: Reading, mesh: &Mesh) -> Problems {
    let mut problems = Problems::default();
    let (vertices, first) = (&scene.geometry.vertices[mesh.first_vertex..], mesh.first_triangle);
    let triangles = &scene.geometry.triangles[first..];
    if triangles.par_iter().all(|&t| fault(t, vertices).is_none()) {
        return problems;
    }
    let faults: Vec<Option<Fault>> = triangles.par_iter().map(|&t| fault(t, vertices)).collect();
    let mut without_area = Vec::new();
    for (i, fault) in faults.iter().enumerate() {
        match fault {
            Some(Fault::MissingVertex) => {
                let (line, at) = if problems.is_full() { (0, 0..0) } else { mesh.locate(source, reading, i) };
                let message = || format!("a face has a vertex beyond the {} of the file", vertices.len());
                problems.error(line, at, message);
            }
            Some(Fault::NoArea) => without_area.push(i),
            Some(Fault::UnusableVertex | Fault::Unused) | None => {}
        }
    }
    if let Some(&i) = without_area.first() {
        let (line, at) = mesh.locate(source, reading, i);
        let triangles = counted(without_area.len(), "triangle");
        let message = format!("left out: {triangles} without area; this is the first");
        scene.diagnostics.warn(Some(source.place(line, at)), message);
    }
    let mut kept = first;
    let faces = &mut scene.faces.of_triangles;
    // Not recorded unless they are requested.
    let first_face = faces.len().checked_sub(faults.len());
    for (i, fault) in faults.iter().enumerate() {
        if fault.is_none() {
            scene.geometry.triangles[kept] = scene.geometry.triangles[first + i];
            scene.triangle_surfaces[kept] = scene.triangle_surfaces[first + i];
            if let Some(first_face) = first_face {
                faces[first_face + kept - first] = faces[first_face + i];
            }
            kept += 1;
        }
    }
    if let Some(first_face) = first_face {
        faces.truncate(first_face + kept - first);
    }
    scene.geometry.triangles.truncate(kept);
    scene.triangle_surfaces.truncate(kept);
    problems
}

impl Mesh {
    /// Line and bytes of the face that became triangle `i` of the file.
    fn locate(&self, source: &Source, reading: Reading, i: usize) -> (usize, Range<usize>) {
        let piece = &self.pieces[self.pieces.partition_point(|p| p.first_triangle <= i) - 1];
        let (line, at) =
            slice::locate(&source.bytes()[piece.bytes.clone()], reading, i - piece.first_triangle)
                .unwrap_or((1, 0..0));
        (line + piece.first_line, at.start + piece.bytes.start..at.end + piece.bytes.start)
    }
}
