//! Errors of mesh files.

use std::io;
use std::path::PathBuf;
use vlscan_base::diag::{Problem, ProblemKind};
use vlscan_base::quantity;
use vlscan_formats::PlyError;

/// A mesh file that cannot be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum MeshError {
    /// A PLY file.
    #[error(transparent)]
    Ply(#[from] PlyMeshError),
    /// An STL file.
    #[error(transparent)]
    Stl(#[from] StlError),
    /// An OFF file.
    #[error(transparent)]
    Off(#[from] OffError),
    /// A glTF document.
    #[error(transparent)]
    Gltf(#[from] GltfError),
}

/// A mesh in a PLY file that cannot be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PlyMeshError {
    /// A header that cannot be read.
    #[error("expected a PLY file: {0}")]
    Header(#[source] PlyError),
    /// A header that the parser does not accept.
    #[error("expected a PLY file: {what}")]
    Malformed {
        /// The message of the parser.
        what: String,
    },
    /// Bytes on which the parser fails.
    #[error("the file is damaged")]
    Damaged,
    /// An element that cannot be read.
    #[error("{source} after {at} of {count} elements \"{name}\"")]
    Element {
        /// Number of elements before.
        at: usize,
        /// Number of elements of the name.
        count: usize,
        /// The name of the element.
        name: String,
        /// The reason.
        source: Box<PlyMeshError>,
    },
    /// A word that is not a number.
    #[error(transparent)]
    Number(#[from] PlyError),
    /// A binary element that the parser does not accept.
    #[error("{what}; is the file truncated?")]
    Truncated {
        /// The message of the parser.
        what: String,
    },
    /// Corners that are floats.
    #[error("{name} {at}: expected whole numbers as corners, found a list of floats")]
    Fractions {
        /// The name of the element.
        name: String,
        /// Number of the element.
        at: usize,
    },
    /// A corner of a face that is not the number of a vertex.
    #[error("face {at} has the corner {corner}")]
    Corner {
        /// Number of the face.
        at: usize,
        /// The corner.
        corner: i64,
    },
    /// A corner of a strip that is not the number of a vertex.
    #[error("a strip has the corner {corner}")]
    StripCorner {
        /// The corner.
        corner: i64,
    },
    /// Values behind the last element.
    #[error(
        "values are left over after the last element: a line has more values than its element has \
         properties, or the header states too few elements"
    )]
    Rest,
    /// A file without faces.
    #[error("the PLY file holds points and no faces; <filter type=\"xyzloader\"> makes voxels of points")]
    NoFaces,
}

/// An STL file that cannot be read.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum StlError {
    /// A file that is shorter than a header.
    #[error("expected an STL file, found fewer bytes than its header has")]
    NoHeader,
    /// A binary file with fewer triangles than its header states.
    #[error(
        "the file states {count} triangles and has bytes for {held}; is it truncated, or not an STL file?"
    )]
    Truncated {
        /// Number of triangles by the header.
        count: usize,
        /// Number of triangles in the file.
        held: usize,
    },
    /// An unexpected line of a text file.
    #[error("line {line}: {expected}, found \"{found}\"{note}")]
    Line {
        /// Number of the line.
        line: usize,
        /// The expectation.
        expected: &'static str,
        /// The beginning of the line.
        found: String,
        /// A note about a decimal comma.
        note: &'static str,
    },
    /// A text file without its last line.
    #[error("expected endsolid at the end; is the file truncated?")]
    NoEnd,
}

/// An OFF file that cannot be read.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum OffError {
    /// Vertices of other than three dimensions.
    #[error("{word} has vertices of other than three dimensions")]
    Dimensions {
        /// The first word of the file.
        word: String,
    },
    /// A binary file.
    #[error("binary OFF is not read; write it as text, or convert it to PLY or glTF with MeshLab")]
    Binary,
    /// A file that ends early.
    #[error("line {line}: expected {expected}, found the end of the file; is it truncated?")]
    Truncated {
        /// Number of the last line.
        line: usize,
        /// The expectation.
        expected: &'static str,
    },
    /// A line whose numbers do not match the elements.
    #[error("line {line}: expected the numbers of vertices, faces and edges, found \"{found}\"")]
    Counts {
        /// Number of the line.
        line: usize,
        /// The beginning of the line.
        found: String,
    },
    /// A word that is not a number.
    #[error("line {line}: expected a number, found \"{found}\"{note}")]
    Number {
        /// Number of the line.
        line: usize,
        /// The beginning of the word.
        found: String,
        /// A note about a decimal comma.
        note: &'static str,
    },
    /// A vertex of too many or too few numbers.
    #[error("line {line}: expected {expected} numbers of a vertex, found {found}")]
    Vertex {
        /// Number of the line.
        line: usize,
        /// The possible numbers of numbers.
        expected: String,
        /// The number of numbers.
        found: usize,
    },
    /// A face without its corners.
    #[error("line {line}: expected the number of corners and as many corners, found \"{found}\"")]
    Corners {
        /// Number of the line.
        line: usize,
        /// The beginning of the line.
        found: String,
    },
    /// A face with numbers after its corners that are not a colour.
    #[error("line {line}: expected {count} corners and the numbers of a colour, found {found} more numbers")]
    Colour {
        /// Number of the line.
        line: usize,
        /// Number of corners.
        count: f64,
        /// Number of numbers behind them.
        found: usize,
    },
    /// A corner that is not the number of a vertex.
    #[error("line {line}: vertex {corner} does not exist; there are {count}, from 0")]
    OutOfRange {
        /// Number of the line.
        line: usize,
        /// The corner.
        corner: f64,
        /// Number of vertices.
        count: usize,
    },
}

/// A glTF document that cannot be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum GltfError {
    /// A file that the system cannot read.
    #[error(transparent)]
    Io(#[from] io::Error),
    /// A GLB file that ends early.
    #[error("the GLB file is shorter than it states; is it truncated?")]
    Truncated,
    /// A GLB file of another version.
    #[error("expected GLB of version 2, found version {0}")]
    GlbVersion(usize),
    /// A document of another version.
    #[error("expected glTF 2.0, found version {0}")]
    Version(String),
    /// A document that is not JSON of glTF.
    #[error("expected glTF 2.0: {0}")]
    Json(#[source] serde_json::Error),
    /// An extension that is not read.
    #[error("the file requires the extension {0}, which is not read; export it without this extension")]
    Extension(String),
    /// A compression that is not read.
    #[error(
        "its geometry is compressed by {extension}, which is not read; import it in Blender and export it \
         without compression{tool}"
    )]
    Compressed {
        /// The extension.
        extension: String,
        /// Another program that decompresses it.
        tool: &'static str,
    },
    /// A reference to something that does not exist.
    #[error("there is no {what} {number}")]
    Missing {
        /// Mesh, accessor, node …
        what: &'static str,
        /// Its number.
        number: usize,
    },
    /// A mesh that cannot be read.
    #[error("mesh \"{name}\": {source}")]
    Mesh {
        /// Name of the mesh.
        name: String,
        /// The reason.
        source: Box<GltfError>,
    },
    /// A primitive without positions.
    #[error("a primitive has no POSITION")]
    NoPosition,
    /// A primitive of an unknown mode.
    #[error("a primitive has the unknown mode {0}")]
    Mode(u32),
    /// Too many vertices.
    #[error("it has too many vertices to be numbered")]
    TooManyVertices,
    /// A corner that is not the number of a vertex.
    #[error("a triangle has the vertex {corner}; there are {count}")]
    OutOfRange {
        /// The corner.
        corner: u32,
        /// Number of vertices.
        count: u32,
    },
    /// Meshes that are larger than the memory limit.
    #[error("the meshes need at least {}, the memory limit leaves {}", shown(.needed), shown(.free))]
    TooLarge {
        /// Memory of the meshes, bytes.
        needed: u64,
        /// Memory that the limit leaves, bytes.
        free: u64,
    },
    /// Too many placed meshes.
    #[error("the nodes place {count} meshes; at most {max} are read")]
    TooManyMeshes {
        /// Number of meshes.
        count: usize,
        /// Maximum number.
        max: usize,
    },
    /// An accessor of another shape.
    #[error("expected an accessor of {expected}, found {found}")]
    Shape {
        /// The expected shape.
        expected: &'static str,
        /// The shape.
        found: String,
    },
    /// An accessor of an unknown type of numbers.
    #[error("an accessor has the unknown component type {0}")]
    ComponentType(u32),
    /// Indices that are floats.
    #[error("indices are whole numbers, found floats")]
    FloatIndices,
    /// An index below 0.
    #[error("a negative index")]
    NegativeIndex,
    /// An accessor of fewer bytes than its values need.
    #[error("an accessor of {count} values has {bytes} bytes; is the file truncated?")]
    ShortAccessor {
        /// Number of values.
        count: usize,
        /// Number of bytes.
        bytes: usize,
    },
    /// An accessor without bytes.
    #[error("an accessor of {count} values has no data")]
    EmptyAccessor {
        /// Number of values.
        count: usize,
    },
    /// An accessor of instances without bytes.
    #[error("the accessor {0} of instances has no data")]
    EmptyInstances(usize),
    /// A sparse accessor of fewer bytes than its values need.
    #[error("a sparse accessor has fewer bytes than values; is the file truncated?")]
    ShortSparse,
    /// A sparse accessor whose values do not match its accessor.
    #[error("a sparse accessor replaces a value that is not there")]
    SparseOutOfRange,
    /// Elements that overlap.
    #[error("the elements of a buffer view overlap")]
    Overlap,
    /// A view behind the end of its buffer.
    #[error("a buffer view reaches beyond its buffer; is the file truncated?")]
    ViewBehindEnd,
    /// A buffer without bytes.
    #[error("the buffer {0} has no data")]
    EmptyBuffer(usize),
    /// A buffer of fewer bytes than it states.
    #[error("the buffer {index} has {held} of {stated} bytes; is the file truncated?")]
    ShortBuffer {
        /// Number of the buffer.
        index: usize,
        /// Number of its bytes.
        held: usize,
        /// Stated number of bytes.
        stated: usize,
    },
    /// A buffer within the document in another encoding than base64.
    #[error("a buffer within the file is not base64")]
    NotBase64,
    /// A buffer of invalid base64.
    #[error("the buffer {index} is not valid base64: {what}")]
    Base64 {
        /// Number of the buffer.
        index: usize,
        /// The message of the decoder.
        what: String,
    },
    /// A buffer on another machine.
    #[error("the buffer {0} is not on this machine; only files beside the document are read")]
    Remote(String),
    /// A buffer in another folder.
    #[error("the buffer {0} is not beside the document; only files in its folder are read")]
    Elsewhere(String),
    /// A buffer that is a folder, a pipe or a device.
    #[error("the buffer {} is not a regular file", file.display())]
    NotRegular {
        /// The file.
        file: PathBuf,
    },
    /// A buffer that the system cannot read.
    #[error("cannot read the buffer {}: {source}", file.display())]
    Buffer {
        /// The file.
        file: PathBuf,
        /// The reason.
        source: io::Error,
    },
    /// A node with two parents.
    #[error("the node {0} has two parents")]
    TwoParents(usize),
    /// A node whose transform is not finite.
    #[error("the transform of the node {0} is not finite")]
    Transform(usize),
    /// An invalid extra of a material.
    #[error("the material \"{name}\": expected {expected} as {key}, found {found}")]
    Material {
        /// Name of the material.
        name: String,
        /// Key of the extra.
        key: String,
        /// The expectation.
        expected: String,
        /// The beginning of the value.
        found: String,
    },
}

fn shown(bytes: &u64) -> String {
    quantity::bytes(*bytes)
}

/// The kind of an error of the system.
fn kind_of(error: &io::Error) -> ProblemKind {
    match error.kind() {
        io::ErrorKind::NotFound => ProblemKind::NotFound,
        io::ErrorKind::UnexpectedEof => ProblemKind::Truncated,
        io::ErrorKind::OutOfMemory => ProblemKind::TooLarge,
        _ => ProblemKind::Invalid,
    }
}

impl Problem for MeshError {
    fn kind(&self) -> ProblemKind {
        match self {
            MeshError::Ply(error) => error.kind(),
            MeshError::Stl(error) => error.kind(),
            MeshError::Off(error) => error.kind(),
            MeshError::Gltf(error) => error.kind(),
        }
    }
}

impl Problem for PlyMeshError {
    fn kind(&self) -> ProblemKind {
        match self {
            PlyMeshError::Header(error) | PlyMeshError::Number(error) => error.kind(),
            PlyMeshError::Element { source, .. } => source.kind(),
            PlyMeshError::Truncated { .. } => ProblemKind::Truncated,
            PlyMeshError::NoFaces => ProblemKind::Unsupported,
            _ => ProblemKind::Invalid,
        }
    }
}

impl Problem for StlError {
    fn kind(&self) -> ProblemKind {
        match self {
            StlError::NoHeader | StlError::Truncated { .. } | StlError::NoEnd => ProblemKind::Truncated,
            StlError::Line { .. } => ProblemKind::Invalid,
        }
    }
}

impl Problem for OffError {
    fn kind(&self) -> ProblemKind {
        match self {
            OffError::Truncated { .. } => ProblemKind::Truncated,
            OffError::Dimensions { .. } | OffError::Binary => ProblemKind::Unsupported,
            _ => ProblemKind::Invalid,
        }
    }
}

impl Problem for GltfError {
    fn kind(&self) -> ProblemKind {
        match self {
            GltfError::Io(e) | GltfError::Buffer { source: e, .. } => kind_of(e),
            GltfError::Mesh { source, .. } => source.kind(),
            GltfError::Truncated
            | GltfError::ShortAccessor { .. }
            | GltfError::ShortSparse
            | GltfError::ViewBehindEnd
            | GltfError::ShortBuffer { .. } => ProblemKind::Truncated,
            GltfError::GlbVersion(_)
            | GltfError::Version(_)
            | GltfError::Extension(_)
            | GltfError::Compressed { .. }
            | GltfError::Remote(_)
            | GltfError::Elsewhere(_) => ProblemKind::Unsupported,
            GltfError::TooManyVertices | GltfError::TooLarge { .. } | GltfError::TooManyMeshes { .. } => {
                ProblemKind::TooLarge
            }
            _ => ProblemKind::Invalid,
        }
    }
}
