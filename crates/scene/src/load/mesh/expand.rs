//! glTF files as parts: each mesh that a node places is a part, an instance of its mesh as any other part. A
//! part with an id, with motions, with swaps or with materials for faces by their numbers stays one part, and
//! so does a part that is dropped to the ground as a whole.

use super::gltf::GltfDocument;
use super::gltf_nodes::{PlacedMesh, similarity};
use super::materials::MaterialTable;
use super::{FileFrame, Format, doubts, finish, foreign_format, report, table_of, warn_of_unknown};
use crate::builder::SceneBuilder;
use crate::epoch::part_in_epoch;
use crate::text::Source;
use glam::{DMat3, DQuat};
use std::borrow::Cow;
use std::collections::HashMap;
use std::path::Path;
use std::sync::Arc;
use vlscan_base::diag::Place;
use vlscan_base::error::Result;
use vlscan_geom::{Aabb, DVec3, Rotation};
use vlscan_survey::{Loader, Mesh, MeshReading, PartRecipe, Replaced, SceneRecipe, Transform};

/// A part in an epoch.
pub(crate) struct EpochPart<'r> {
    pub recipe: Cow<'r, PartRecipe>,
    /// False for a part that has been swapped away.
    pub is_present: bool,
}

/// The parts of a scene in an epoch. Warnings and mistakes of glTF files go to the diagnostics of `scene`.
pub(crate) fn parts_in_epoch<'r>(
    scene: &mut SceneBuilder,
    recipe: &'r SceneRecipe,
    epoch: u32,
) -> Result<Vec<EpochPart<'r>>> {
    let mut parts = Vec::with_capacity(recipe.parts.len());
    let mut additional = 0;
    let mut are_gltf = HashMap::new();
    for part in &recipe.parts {
        let Some(present) = part_in_epoch(part, epoch) else {
            parts.push(EpochPart { recipe: Cow::Borrowed(part), is_present: false });
            continue;
        };
        if let Some(placed) = expand(scene, part, &mut are_gltf)? {
            let first = part.number + additional;
            additional += (placed.len() as u32).saturating_sub(1);
            let numbered = (first..).zip(placed).map(|(number, p)| PartRecipe { number, ..p });
            parts.extend(numbered.map(|p| EpochPart { recipe: Cow::Owned(p), is_present: true }));
            continue;
        }
        let renumbered = match additional {
            0 => present,
            n => Cow::Owned(PartRecipe { number: part.number + n, ..present.into_owned() }),
        };
        parts.push(EpochPart { recipe: renumbered, is_present: true });
    }
    Ok(parts)
}

/// The parts of a glTF file; `None` for a part that does not change. `are_gltf` are the files that have been
/// checked.
fn expand<'r>(
    scene: &mut SceneBuilder,
    part: &'r PartRecipe,
    are_gltf: &mut HashMap<&'r Path, bool>,
) -> Result<Option<Vec<PartRecipe>>> {
    let Loader::MeshFiles { files, reading } = &part.loader else { return Ok(None) };
    let has_id = part.id.as_ref().is_some_and(|id| !id.is_empty());
    let [file] = &files[..] else { return Ok(None) };
    let has_numbers = part.changes.iter().any(|change| matches!(change.replaced, Replaced::Faces(_)));
    let is_whole = has_id || has_numbers || part.transform.on_ground != 0;
    if is_whole || !part.motions.is_empty() || !part.swaps.is_empty() {
        return Ok(None);
    }
    // Many parts may be instances of one file.
    if !*are_gltf.entry(file).or_insert_with(|| is_gltf(file)) {
        return Ok(None);
    }
    let opened = GltfDocument::open(file, scene.free_memory(), scene.options.colours)
        .and_then(|document| Ok((document.placed_meshes()?, document)));
    let (placed, document) = match opened {
        Ok(opened) => opened,
        Err(error) => {
            report(scene, file, error.into());
            return Ok(Some(Vec::new()));
        }
    };
    scene.sources.extend(document.files().map(Path::to_path_buf));
    for warning in document.warnings() {
        scene.diagnostics.warn(Some(Place::of_file(file)), warning);
    }
    let table = table_of(scene, file, reading);
    let mut meshes = Meshes { document, file, reading, table, unknown: Vec::new(), known: HashMap::new() };
    let mut parts = Vec::with_capacity(placed.len());
    let mut around = Aabb::EMPTY;
    for placed in placed {
        let (linear, transform) = meshes.split(&placed);
        let Some(mesh) = meshes.get(scene, placed.mesh, linear)? else { continue };
        around = around.union(box_around(&mesh, &transform));
        parts.push(PartRecipe {
            loader: Loader::Mesh(mesh),
            name: placed.name,
            transform: part.transform.after(&transform),
            ..part.clone()
        });
    }
    warn_of_unknown(scene, file, (std::mem::take(&mut meshes.unknown), meshes.table.as_ref()));
    doubts::check_document(scene, part, around);
    if parts.is_empty() && !scene.diagnostics.is_fatal(false) {
        let message = "the glTF file shows no triangles and is left out";
        scene.diagnostics.warn(Some(Place::of_file(file)), message);
    }
    Ok(Some(parts))
}

/// A box around a placed mesh, which reaches a little further if it is turned.
fn box_around(mesh: &Mesh, transform: &Transform) -> Aabb {
    let Aabb { min, max } = Aabb::around(mesh.vertices().iter().copied());
    let corner =
        |i: usize| DVec3::from([0, 1, 2].map(|axis| if i >> axis & 1 == 0 { min[axis] } else { max[axis] }));
    Aabb::around((0..8).map(|i| transform.apply(corner(i))))
}

/// True if a file is glTF, by its name or its first bytes. A file that cannot be opened, or is of a format
/// that is not read, is reported where it is loaded.
pub(super) fn is_gltf(path: &Path) -> bool {
    let is_one = |source: &Source| {
        Format::of(path, source.bytes()) == Format::Gltf && foreign_format(source).is_none()
    };
    // Of a large file, only the pages that are looked at are read.
    Source::open_within(path, Some(0)).is_ok_and(|source| is_one(&source))
}

/// The meshes of a document that have been read.
struct Meshes<'f> {
    document: GltfDocument,
    file: &'f Path,
    reading: &'f MeshReading,
    table: Option<MaterialTable>,
    /// Names of materials without a reflectance.
    unknown: Vec<String>,
    /// By index and linear map, as bits; `None` for meshes without triangles.
    known: HashMap<(usize, [u64; 9]), Option<Arc<Mesh>>>,
}

impl Meshes<'_> {
    fn frame(&self) -> FileFrame {
        FileFrame::new(self.reading, Format::Gltf)
    }

    /// The linear map that the mesh itself gets, and the transform that places it: all of the linear map is
    /// in the transform if it rotates and scales equally along all axes.
    fn split(&self, placed: &PlacedMesh) -> (DMat3, Transform) {
        let frame = self.frame();
        let offset = frame.apply(placed.transform.translation);
        let (linear, rotation, scale) = match similarity(placed.transform.matrix3) {
            Some((rotation, scale)) => (DMat3::IDENTITY, rotation, scale),
            None => (placed.transform.matrix3, DQuat::IDENTITY, 1.0),
        };
        let rotation = Rotation { w: rotation.w, u: frame.rotate(rotation.xyz()) };
        (linear, Transform { rotation, scale, offset, ..Transform::IDENTITY })
    }

    fn get(&mut self, scene: &mut SceneBuilder, mesh: usize, linear: DMat3) -> Result<Option<Arc<Mesh>>> {
        let key = (mesh, linear.to_cols_array().map(f64::to_bits));
        if let Some(known) = self.known.get(&key) {
            return Ok(known.clone());
        }
        let read = match self.document.mesh(mesh, linear, self.frame()) {
            Ok(raw) if raw.triangles.is_empty() => None,
            Ok(raw) => finish(scene, self.file, self.table.as_ref(), raw, &mut self.unknown)?
                .map(|m| Arc::new(m.with_name(self.document.mesh_name(mesh)))),
            Err(error) => {
                report(scene, self.file, error.into());
                None
            }
        };
        self.known.insert(key, read.clone());
        Ok(read)
    }
}
