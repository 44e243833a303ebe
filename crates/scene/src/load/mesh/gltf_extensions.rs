//! Extensions that glTF documents require: which are read, which change nothing that a ray hits, and what to
//! do with others.

use super::GltfError;

/// Extensions that are read.
const READ_EXTENSIONS: [&str; 2] = ["KHR_mesh_quantization", "EXT_mesh_gpu_instancing"];
/// Beginnings of the names of extensions that concern textures, materials, lights, cameras, animations,
/// sounds and data about the file, which are left out anyway.
const EXTENSIONS_WITHOUT_GEOMETRY: [&str; 22] = [
    "KHR_materials_",
    "EXT_materials_",
    "ADOBE_materials_",
    "MSFT_packing_",
    "KHR_texture_",
    "EXT_texture_",
    "MSFT_texture_",
    "GOOGLE_texture_",
    "KHR_techniques_webgl",
    "KHR_blend",
    "KHR_lights_",
    "EXT_lights_",
    "KHR_audio",
    "KHR_xmp",
    "KHR_animation_",
    "KHR_interactivity",
    "KHR_physics_rigid_bodies",
    "EXT_structural_metadata",
    "EXT_mesh_features",
    "EXT_instance_features",
    "EXT_feature_metadata",
    "AGI_",
];
/// Extensions that compress geometry.
pub(super) const COMPRESSIONS: [&str; 3] =
    ["KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_meshopt_compression"];

/// Reason why a file that requires an extension is rejected; `None` if the extension changes nothing that a
/// ray hits, or is read.
pub(super) fn refused(extension: &str) -> Option<GltfError> {
    if COMPRESSIONS.contains(&extension) {
        return Some(compressed(extension));
    }
    let is_read = READ_EXTENSIONS.contains(&extension)
        || EXTENSIONS_WITHOUT_GEOMETRY.iter().any(|start| extension.starts_with(start));
    (!is_read).then(|| GltfError::Extension(extension.to_owned()))
}

/// Advice for a compressed file.
pub(super) fn compressed(extension: &str) -> GltfError {
    let tool = match extension {
        "KHR_draco_mesh_compression" => "",
        _ => ", or gltfpack -noq -i in.glb -o out.glb",
    };
    GltfError::Compressed { extension: extension.to_owned(), tool }
}
