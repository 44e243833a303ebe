//! Endings of mesh files, and recognition of mesh and point formats that the scene does not read, by their first bytes or the
//! name.

use std::path::Path;

/// Endings of the mesh files that the scene reads.
pub(super) const MESH_ENDINGS: [&str; 5] = ["obj", "ply", "stl", "gltf", "glb"];

/// A format, what a file of it begins with, and the endings of its names.
struct Format {
    name: &'static str,
    starts: &'static [&'static [u8]],
    endings: &'static [&'static str],
    help: &'static str,
}

const CONVERT: &str =
    "convert it to glTF: assimp export in.ext out.glb, or export it from Blender or MeshLab";
const POINTS: &str =
    "a point cloud becomes voxels: a scene of XML with <filter type=\"xyzloader\"> and a voxelSize";

const FORMATS: [Format; 10] = [
    Format { name: "FBX", starts: &[b"Kaydara FBX", b"; FBX"], endings: &["fbx"], help: CONVERT },
    Format { name: "COLLADA", starts: &[], endings: &["dae"], help: CONVERT },
    Format { name: "OFF", starts: &[b"OFF\n", b"OFF ", b"COFF"], endings: &["off"], help: CONVERT },
    Format { name: "3D Studio", starts: &[b"MM"], endings: &["3ds"], help: CONVERT },
    Format { name: "a Blender file", starts: &[b"BLENDER"], endings: &["blend"], help: CONVERT },
    Format {
        name: "USD",
        starts: &[b"#usda", b"PXR-USDC"],
        endings: &["usd", "usda", "usdc", "usdz"],
        help: CONVERT,
    },
    Format { name: "X3D or VRML", starts: &[b"#VRML", b"#X3D"], endings: &["wrl", "x3d"], help: CONVERT },
    Format { name: "IFC", starts: &[b"ISO-10303-21"], endings: &["ifc", "step", "stp"], help: CONVERT },
    Format {
        name: "CityGML or CityJSON",
        starts: &[b"{\"type\":\"CityJSON"],
        endings: &["gml", "json"],
        help: CONVERT,
    },
    Format { name: "LAS points", starts: &[b"LASF"], endings: &["las", "laz"], help: POINTS },
];

/// Returns the name of the format and what to do with it; `None` for a file that may be a mesh that is read.
pub(crate) fn foreign_mesh(path: &Path, bytes: &[u8]) -> Option<(&'static str, &'static str)> {
    let ending = path.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
    let by_bytes = FORMATS.iter().find(|format| format.starts.iter().any(|start| bytes.starts_with(start)));
    let by_name = || FORMATS.iter().find(|format| format.endings.contains(&ending.as_str()));
    by_bytes.or_else(by_name).map(|format| (format.name, format.help))
}

/// Whether files with this ending, in small letters, are of a format that the scene does not read.
pub(super) fn is_foreign_ending(ending: &str) -> bool {
    FORMATS.iter().any(|format| format.endings.contains(&ending))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn formats_are_recognised_by_bytes_and_by_name() {
        let name = |path: &str, bytes: &[u8]| foreign_mesh(Path::new(path), bytes).map(|found| found.0);
        assert_eq!(name("a.obj", b"OFF\n8 6 0\n"), Some("OFF"));
        assert_eq!(name("a.FBX", &[0; 84]), Some("FBX"));
        assert_eq!(name("a.obj", b"# solid block\nv 0 0 0\n"), None);
        assert_eq!(name("mesh", b"v 0 0 0\n"), None);
        assert!(is_foreign_ending("usdz") && !MESH_ENDINGS.iter().any(|ending| is_foreign_ending(ending)));
    }
}
