//! Documents of glTF 2.0 (Khronos, ISO/IEC 12113:2022), as JSON with buffers next to it or within it, or as
//! GLB: buffers, accessors, meshes and materials. Triangles are read; points, lines, skins and morph targets
//! are not, and textures only if colours are requested.

use super::gltf_buffers::{Buffer, BufferJson, open_buffer, split_chunks};
use super::gltf_colours::{ColourJson, complete_colours};
use super::gltf_extensions::{COMPRESSIONS, compressed, refused};
use super::gltf_materials::{MaterialJson, definitions, doubts, misplaced_extras};
use super::{FileFrame, GltfError, RawMesh};
use crate::builder::memory_of;
use crate::text::{Source, printable};
use glam::DMat3;
use serde::Deserialize;
use std::collections::HashMap;
use std::path::Path;
use vlscan_geom::DVec3;
use vlscan_survey::MaterialDefinition;

/// Maximum number of vertices of an accessor whose values are nearly all 0 and not in the file.
const MAX_SPARSE: usize = 1 << 24;

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Json {
    asset: Asset,
    #[serde(default)]
    extensions_required: Vec<String>,
    #[serde(default)]
    buffers: Vec<BufferJson>,
    #[serde(default)]
    buffer_views: Vec<View>,
    #[serde(default)]
    pub accessors: Vec<Accessor>,
    #[serde(default)]
    meshes: Vec<MeshJson>,
    #[serde(default)]
    pub materials: Vec<MaterialJson>,
    #[serde(default)]
    pub nodes: Vec<NodeJson>,
    #[serde(default)]
    pub scenes: Vec<SceneJson>,
    #[serde(default)]
    pub scene: usize,
}

#[derive(Debug, Deserialize)]
struct Asset {
    version: String,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
struct View {
    buffer: usize,
    #[serde(default)]
    byte_offset: usize,
    byte_length: usize,
    byte_stride: Option<usize>,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Accessor {
    buffer_view: Option<usize>,
    #[serde(default)]
    byte_offset: usize,
    component_type: u32,
    #[serde(default)]
    normalized: bool,
    count: usize,
    #[serde(rename = "type")]
    pub shape: String,
    sparse: Option<Sparse>,
}

#[derive(Debug, Deserialize)]
struct Sparse {
    count: usize,
    indices: SparsePart,
    values: SparsePart,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
struct SparsePart {
    buffer_view: usize,
    #[serde(default)]
    byte_offset: usize,
    component_type: Option<u32>,
}

#[derive(Debug, Deserialize)]
struct MeshJson {
    #[serde(default)]
    name: String,
    #[serde(default)]
    extras: serde_json::Value,
    primitives: Vec<Primitive>,
}

#[derive(Debug, Deserialize)]
struct Primitive {
    attributes: HashMap<String, usize>,
    indices: Option<usize>,
    material: Option<usize>,
    mode: Option<u32>,
    #[serde(default)]
    targets: Vec<serde_json::Value>,
    #[serde(default)]
    extensions: HashMap<String, serde_json::Value>,
}

#[derive(Debug, Deserialize)]
pub(super) struct SceneJson {
    #[serde(default)]
    pub nodes: Vec<usize>,
}

#[derive(Debug, Deserialize)]
pub(super) struct NodeJson {
    #[serde(default)]
    pub name: String,
    #[serde(default)]
    pub children: Vec<usize>,
    pub mesh: Option<usize>,
    pub skin: Option<usize>,
    pub matrix: Option<[f64; 16]>,
    pub translation: Option<[f64; 3]>,
    pub rotation: Option<[f64; 4]>,
    pub scale: Option<[f64; 3]>,
    #[serde(default)]
    extras: serde_json::Value,
    #[serde(default)]
    pub extensions: NodeExtensions,
}

#[derive(Debug, Default, Deserialize)]
pub(super) struct NodeExtensions {
    #[serde(rename = "EXT_mesh_gpu_instancing")]
    pub instancing: Option<Instancing>,
}

#[derive(Debug, Deserialize)]
pub(super) struct Instancing {
    pub attributes: HashMap<String, usize>,
}

/// A document with its buffers.
pub(super) struct GltfDocument {
    pub source: Source,
    pub json: Json,
    buffers: Vec<Buffer>,
    /// The materials of the document, and after them that of primitives without one.
    pub materials: Vec<MaterialDefinition>,
    /// Number of the texture coordinates that each of these materials uses; empty unless colours are
    /// requested.
    pub texel_sets: Vec<usize>,
    /// Memory that its meshes may still take, bytes.
    pub free_memory: u64,
    pub warnings: Vec<String>,
}

/// First vertex and number of vertices of the accessors of positions that a mesh has appended.
type Appended = HashMap<usize, (u32, u32)>;

impl GltfDocument {
    /// Opens a document and the buffers that it names. Its meshes may take `free_memory` bytes. Errors are
    /// sentences about the file.
    /// With `colours`, its materials have colours and its meshes texture coordinates.
    pub fn open(path: &Path, free_memory: u64, colours: bool) -> Result<GltfDocument, GltfError> {
        let source = Source::open(path)?;
        let (text, chunk) = split_chunks(source.bytes())?;
        let json: Json = serde_json::from_slice(text).map_err(GltfError::Json)?;
        if !json.asset.version.starts_with("2.") {
            return Err(GltfError::Version(json.asset.version));
        }
        if let Some(problem) = json.extensions_required.iter().find_map(|name| refused(name)) {
            return Err(problem);
        }
        let mut warnings = Vec::new();
        let buffers = (0..)
            .zip(&json.buffers)
            .map(|(i, b)| open_buffer(path, i, b, &chunk, &mut warnings))
            .collect::<Result<_, _>>()?;
        let materials = definitions(&json.materials)?;
        warnings.extend(doubts(&json.materials, &materials));
        let of_colours: Option<ColourJson> =
            colours.then(|| serde_json::from_slice(text)).transpose().map_err(GltfError::Json)?;
        let texel_sets = Vec::new();
        let mut document =
            GltfDocument { source, json, buffers, materials, texel_sets, free_memory, warnings };
        if let Some(of_colours) = of_colours {
            document.add_colours(&of_colours);
        }
        Ok(document)
    }

    /// Warnings about omitted features that change the shape of meshes, about files in another spelling, and
    /// about misplaced extras, as sentences about the file.
    pub fn warnings(&self) -> Vec<String> {
        let mut all = self.warnings.clone();
        let of_nodes = self.json.nodes.iter().map(|node| &node.extras);
        all.extend(misplaced_extras(of_nodes.chain(self.json.meshes.iter().map(|mesh| &mesh.extras))));
        if self.json.nodes.iter().any(|node| node.skin.is_some()) {
            all.push("skins are left out: the meshes have the shape in which they are stored".to_owned());
        }
        let has_targets =
            |mesh: &MeshJson| mesh.primitives.iter().any(|primitive| !primitive.targets.is_empty());
        if self.json.meshes.iter().any(has_targets) {
            all.push(
                "morph targets are left out: the meshes have the shape in which they are stored".to_owned(),
            );
        }
        all
    }

    /// The files of the document.
    pub fn files(&self) -> impl Iterator<Item = &Path> {
        let others = self.buffers.iter().filter_map(|b| match b {
            Buffer::File(source) => Some(source.path()),
            _ => None,
        });
        std::iter::once(self.source.path()).chain(others)
    }

    pub fn mesh_name(&self, mesh: usize) -> String {
        match self.json.meshes.get(mesh).map(|m| m.name.as_str()) {
            Some(name) if !name.is_empty() => printable(name),
            _ => format!("mesh_{mesh}"),
        }
    }

    /// All meshes where the nodes place them, as one.
    pub fn whole(&self, frame: FileFrame) -> Result<RawMesh, GltfError> {
        let mut all = RawMesh::default();
        for node in self.placed_meshes()? {
            let first = all.vertices.len();
            self.append_mesh(node.mesh, &mut all)?;
            let place = |v: DVec3| frame.apply(node.transform.transform_point3(v));
            all.vertices[first..].iter_mut().for_each(|v| *v = place(*v));
        }
        self.add_materials(&mut all);
        complete_colours(&mut all);
        Ok(all)
    }

    /// A mesh in the frame of the scene, after the linear map `linear`.
    pub fn mesh(&mut self, mesh: usize, linear: DMat3, frame: FileFrame) -> Result<RawMesh, GltfError> {
        let mut raw = RawMesh::default();
        self.append_mesh(mesh, &mut raw)?;
        raw.vertices.iter_mut().for_each(|v| *v = frame.apply(linear * *v));
        self.add_materials(&mut raw);
        complete_colours(&mut raw);
        let taken = memory_of(raw.vertices.len(), raw.triangles.len(), 0);
        self.free_memory = self.free_memory.saturating_sub(taken);
        Ok(raw)
    }

    /// Fails if the memory limit leaves less than `needed` bytes.
    pub fn check_memory(&self, needed: u64) -> Result<(), GltfError> {
        if needed <= self.free_memory {
            return Ok(());
        }
        Err(GltfError::TooLarge { needed, free: self.free_memory })
    }

    /// Gives a mesh the materials of its triangles, whose numbers were those of the document.
    fn add_materials(&self, mesh: &mut RawMesh) {
        let mut number = HashMap::new();
        for material in &mut mesh.material_of {
            let of_document = *material as usize;
            *material = *number.entry(of_document).or_insert_with(|| {
                mesh.materials.push(self.materials[of_document].clone());
                mesh.materials.len() as u32 - 1
            });
        }
    }

    /// Appends the triangles of a mesh in its own frame.
    fn append_mesh(&self, mesh: usize, raw: &mut RawMesh) -> Result<(), GltfError> {
        let found = self.json.meshes.get(mesh).ok_or(missing("mesh", mesh))?;
        let mut appended = Appended::new();
        for primitive in &found.primitives {
            self.append_primitive(primitive, raw, &mut appended)
                .map_err(|e| GltfError::Mesh { name: self.mesh_name(mesh), source: Box::new(e) })?;
        }
        Ok(())
    }

    fn append_primitive(
        &self,
        primitive: &Primitive,
        raw: &mut RawMesh,
        appended: &mut Appended,
    ) -> Result<(), GltfError> {
        let mode = primitive.mode.unwrap_or(4);
        if mode < 4 {
            return Ok(());
        }
        if let Some(name) = primitive.extensions.keys().find(|name| COMPRESSIONS.contains(&name.as_str()))
            && self.lacks_fallback(primitive)
        {
            return Err(compressed(name));
        }
        let positions = *primitive.attributes.get("POSITION").ok_or(GltfError::NoPosition)?;
        let corners = self.count_of(primitive.indices.unwrap_or(positions))?;
        let triangles = if mode == 4 { corners / 3 } else { corners.saturating_sub(2) };
        let vertices = if appended.contains_key(&positions) { 0 } else { self.count_of(positions)? };
        self.check_memory(memory_of(
            raw.vertices.len().saturating_add(vertices),
            raw.triangles.len().saturating_add(triangles),
            0,
        ))?;
        let (first, count) = match appended.get(&positions) {
            Some(&known) => known,
            None => {
                let read = self.vectors::<3>(positions)?;
                let number = |n: usize| u32::try_from(n).map_err(|_| GltfError::TooManyVertices);
                number(raw.vertices.len() + read.len())?;
                let place = (number(raw.vertices.len())?, number(read.len())?);
                raw.vertices.extend(read.into_iter().map(DVec3::from));
                appended.insert(positions, place);
                place
            }
        };
        let indices = match primitive.indices {
            Some(accessor) => self.indices(accessor)?,
            None => (0..count).collect(),
        };
        if let Some(&corner) = indices.iter().find(|&&i| i >= count) {
            return Err(GltfError::OutOfRange { corner, count });
        }
        let material = primitive.material.unwrap_or(self.materials.len() - 1);
        if material >= self.materials.len() {
            return Err(missing("material", material));
        }
        let texels = self.corner_colours(&primitive.attributes, material, count as usize)?;
        let mut add = |corners: [u32; 3]| {
            raw.add_polygon(&corners.map(|c| c + first), material as u32);
            if let Some(of_vertices) = &texels {
                of_vertices.add_triangle(raw, corners);
            }
        };
        match mode {
            4 => indices.chunks_exact(3).for_each(|t| add([t[0], t[1], t[2]])),
            5 => (0..).zip(indices.windows(3)).for_each(|(i, t)| {
                let odd = i % 2;
                add([t[0], t[1 + odd], t[2 - odd]]);
            }),
            6 => {
                let rim = indices.get(1..).unwrap_or_default();
                rim.windows(2).for_each(|t| add([indices[0], t[0], t[1]]));
            }
            other => return Err(GltfError::Mode(other)),
        }
        Ok(())
    }

    /// True if a compressed primitive has no uncompressed positions or indices in addition to the compressed
    /// ones.
    fn lacks_fallback(&self, primitive: &Primitive) -> bool {
        let accessors = primitive.attributes.get("POSITION").into_iter().chain(&primitive.indices);
        let has_data = |&accessor: &usize| {
            self.json.accessors.get(accessor).is_some_and(|a| a.buffer_view.is_some() || a.sparse.is_some())
        };
        !accessors.into_iter().all(has_data)
    }

    /// The number of values that an accessor states.
    fn count_of(&self, accessor: usize) -> Result<usize, GltfError> {
        let found = self.json.accessors.get(accessor);
        found.map(|a| a.count).ok_or(missing("accessor", accessor))
    }

    /// The number of instances that an accessor places, whose values must be in the file.
    pub fn count_of_instances(&self, accessor: usize) -> Result<usize, GltfError> {
        let found = self.json.accessors.get(accessor);
        if found.is_some_and(|a| a.buffer_view.is_none() && a.sparse.is_none()) {
            return Err(GltfError::EmptyInstances(accessor));
        }
        self.count_of(accessor)
    }

    fn indices(&self, accessor: usize) -> Result<Vec<u32>, GltfError> {
        let accessor = self.accessor(accessor, "SCALAR")?;
        if accessor.component_type == 5126 {
            return Err(GltfError::FloatIndices);
        }
        let numbers = self.numbers::<1>(accessor, false)?;
        numbers
            .into_iter()
            .map(|[v]| if v < 0.0 { Err(GltfError::NegativeIndex) } else { Ok(v as u32) })
            .collect()
    }

    /// The vectors of an accessor; normalised integers become fractions (`KHR_mesh_quantization`).
    pub fn vectors<const N: usize>(&self, accessor: usize) -> Result<Vec<[f64; N]>, GltfError> {
        let shape = match N {
            2 => "VEC2",
            4 => "VEC4",
            _ => "VEC3",
        };
        let accessor = self.accessor(accessor, shape)?;
        self.numbers::<N>(accessor, accessor.normalized)
    }

    fn accessor(&self, index: usize, shape: &'static str) -> Result<&Accessor, GltfError> {
        let accessor = self.json.accessors.get(index).ok_or(missing("accessor", index))?;
        if accessor.shape != shape {
            return Err(GltfError::Shape { expected: shape, found: accessor.shape.clone() });
        }
        Ok(accessor)
    }

    fn numbers<const N: usize>(
        &self,
        accessor: &Accessor,
        normalised: bool,
    ) -> Result<Vec<[f64; N]>, GltfError> {
        let (decode, size) = component(accessor.component_type, normalised)?;
        let element =
            |bytes: &[u8]| -> [f64; N] { std::array::from_fn(|i| decode(&bytes[i * size..(i + 1) * size])) };
        let mut values = match accessor.buffer_view {
            Some(view) => {
                let (bytes, stride) = self.view(view, accessor.byte_offset, N * size)?;
                let is_enough = (accessor.count.max(1) - 1)
                    .checked_mul(stride)
                    .and_then(|bytes| bytes.checked_add(N * size))
                    .is_some_and(|need| accessor.count == 0 || need <= bytes.len());
                if !is_enough {
                    return Err(GltfError::ShortAccessor { count: accessor.count, bytes: bytes.len() });
                }
                (0..accessor.count).map(|i| element(&bytes[i * stride..])).collect()
            }
            None if accessor.count <= MAX_SPARSE => vec![[0.0; N]; accessor.count],
            None => return Err(GltfError::EmptyAccessor { count: accessor.count }),
        };
        if let Some(sparse) = &accessor.sparse {
            let (read_index, index_size) = component(sparse.indices.component_type.unwrap_or(5125), false)?;
            let (indices, _) =
                self.view(sparse.indices.buffer_view, sparse.indices.byte_offset, index_size)?;
            let (replaced, _) = self.view(sparse.values.buffer_view, sparse.values.byte_offset, N * size)?;
            if sparse.count > indices.len() / index_size || sparse.count > replaced.len() / (N * size) {
                return Err(GltfError::ShortSparse);
            }
            for i in 0..sparse.count {
                let at = read_index(&indices[i * index_size..(i + 1) * index_size]);
                let value = values.get_mut(at as usize).ok_or(GltfError::SparseOutOfRange)?;
                *value = element(&replaced[i * N * size..]);
            }
        }
        Ok(values)
    }

    /// The bytes of a view from `offset` on, and the distance of its elements.
    pub fn view(&self, index: usize, offset: usize, element: usize) -> Result<(&[u8], usize), GltfError> {
        let view = self.json.buffer_views.get(index).ok_or(missing("buffer view", index))?;
        let buffer = self.buffers.get(view.buffer).ok_or(missing("buffer", view.buffer))?;
        let buffer = buffer.bytes(&self.source);
        let end = view.byte_offset.checked_add(view.byte_length);
        let bytes =
            end.and_then(|end| buffer.get(view.byte_offset..end)).and_then(|bytes| bytes.get(offset..));
        let stride = view.byte_stride.filter(|s| *s > 0).unwrap_or(element);
        match bytes {
            Some(bytes) if stride >= element => Ok((bytes, stride)),
            Some(_) => Err(GltfError::Overlap),
            None => Err(GltfError::ViewBehindEnd),
        }
    }
}

fn missing(what: &'static str, number: usize) -> GltfError {
    GltfError::Missing { what, number }
}

/// How a component is decoded from its bytes, and their number.
type Component = (fn(&[u8]) -> f64, usize);

fn component(kind: u32, normalised: bool) -> Result<Component, GltfError> {
    Ok(match (kind, normalised) {
        (5120, false) => (|b| f64::from(b[0] as i8), 1),
        (5120, true) => (|b| (f64::from(b[0] as i8) / 127.0).max(-1.0), 1),
        (5121, false) => (|b| f64::from(b[0]), 1),
        (5121, true) => (|b| f64::from(b[0]) / 255.0, 1),
        (5122, false) => (|b| f64::from(i16::from_le_bytes([b[0], b[1]])), 2),
        (5122, true) => (|b| (f64::from(i16::from_le_bytes([b[0], b[1]])) / 32767.0).max(-1.0), 2),
        (5123, false) => (|b| f64::from(u16::from_le_bytes([b[0], b[1]])), 2),
        (5123, true) => (|b| f64::from(u16::from_le_bytes([b[0], b[1]])) / 65535.0, 2),
        (5125, _) => (|b| f64::from(u32::from_le_bytes([b[0], b[1], b[2], b[3]])), 4),
        (5126, _) => (|b| f64::from(f32::from_le_bytes([b[0], b[1], b[2], b[3]])), 4),
        (other, _) => return Err(GltfError::ComponentType(other)),
    })
}
