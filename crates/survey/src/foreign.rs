//! Endings of mesh files, and recognition of formats of meshes, points and rasters that a loader does not read, by their first
//! bytes or the name.

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
const CAD: &str = "export it as OBJ or glTF from the program that made it, or from FreeCAD";
const IFC: &str =
    "convert it to glTF: IfcConvert in.ifc out.glb (IfcOpenShell), or export it from Blender (Bonsai)";
const CITY: &str = "convert it to OBJ: cjio in.city.json export obj out.obj; CityGML first: citygml-tools to-cityjson in.gml";
const RASTER: &str = "convert it: gdal_translate -co COMPRESS=DEFLATE in.ext out.tif, which <filter type=\"geotiffloader\"> reads";
const TIFF: &str = "a terrain raster is read by <filter type=\"geotiffloader\">";
const UNPACK: &str = "unpack it first: unzip, gunzip, 7z";

const fn format(
    name: &'static str,
    starts: &'static [&'static [u8]],
    endings: &'static [&'static str],
    help: &'static str,
) -> Format {
    Format { name, starts, endings, help }
}

const FORMATS: [Format; 28] = [
    format("FBX", &[b"Kaydara FBX", b"; FBX"], &["fbx"], CONVERT),
    format("COLLADA", &[b"<COLLADA"], &["dae"], CONVERT),
    format("OFF", &[b"OFF\n", b"OFF\r", b"OFF ", b"COFF", b"NOFF"], &["off"], CONVERT),
    // A TIFF file of big-endian numbers begins as one of 3D Studio does.
    format("a TIFF raster", &[b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"], &["tif", "tiff"], TIFF),
    format("3D Studio", &[b"MM"], &["3ds"], CONVERT),
    format("a Blender file", &[b"BLENDER"], &["blend"], CONVERT),
    format("USD", &[b"#usda", b"PXR-USDC"], &["usd", "usda", "usdc", "usdz"], CONVERT),
    format("X3D or VRML", &[b"#VRML", b"#X3D", b"<X3D"], &["wrl", "x3d", "vrml"], CONVERT),
    format("IFC", &[], &["ifc", "ifczip", "ifcxml"], IFC),
    format("STEP", &[b"ISO-10303-21"], &["step", "stp"], CAD),
    format("IGES", &[], &["igs", "iges"], CAD),
    format("DXF", &[b"0\nSECTION", b"0\r\nSECTION", b"AutoCAD Binary DXF"], &["dxf"], CAD),
    format("DWG", &[b"AC10"], &["dwg"], CAD),
    format("a Rhino file", &[b"3D Geometry File Format"], &["3dm"], CAD),
    format("a SketchUp file", &[], &["skp"], CAD),
    format("3MF", &[], &["3mf"], CONVERT),
    format(
        "CityGML or CityJSON",
        &[b"<CityModel", b"<core:CityModel"],
        &["gml", "json", "citygml", "cityjson"],
        CITY,
    ),
    format("LandXML", &[b"<LandXML"], &["landxml"], CAD),
    format("LAS points", &[b"LASF"], &["las", "laz", "copc"], POINTS),
    format("E57 points", &[b"ASTM-E57"], &["e57"], POINTS),
    format("PCD points", &[b"# .PCD"], &["pcd"], POINTS),
    format("points of text", &[], &["xyz", "pts", "ptx", "txt"], POINTS),
    format("an ESRI grid of text", &[b"ncols", b"NCOLS"], &["asc", "grd"], RASTER),
    format("ERDAS Imagine", &[b"EHFA_HEADER_TAG"], &["img"], RASTER),
    format("HDF or NetCDF", &[b"\x89HDF", b"CDF\x01", b"CDF\x02"], &["nc", "h5", "bag"], RASTER),
    format(
        "a raster in a format of GDAL",
        &[b"\x89PNG", b"\xff\xd8\xff", b"\0\0\0\x0cjP"],
        &["hgt", "jp2", "dem", "ecw"],
        RASTER,
    ),
    format("a virtual raster of GDAL", &[b"<VRTDataset"], &["vrt"], TIFF),
    format(
        "a compressed archive",
        &[b"PK\x03\x04", b"\x1f\x8b", b"7z\xbc\xaf"],
        &["zip", "gz", "7z"],
        UNPACK,
    ),
];

/// Bytes of a file's beginning in which the root of an XML or JSON file is looked for.
const MAX_ROOT_OFFSET: usize = 1 << 10;

/// Returns the name of the format and what to do with it; `None` for a file of a format that is read, or of an unknown one.
pub fn foreign_format(path: &Path, bytes: &[u8]) -> Option<(&'static str, &'static str)> {
    let ending = path.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
    let by_name = || FORMATS.iter().find(|format| format.endings.contains(&ending.as_str()));
    by_bytes(bytes).or_else(by_name).map(|format| (format.name, format.help))
}

fn by_bytes(bytes: &[u8]) -> Option<&'static Format> {
    let bytes = bytes[..bytes.len().min(MAX_ROOT_OFFSET)].trim_ascii_start();
    let holds = |word: &[u8]| memchr::memmem::find(bytes, word).is_some();
    let named = |name: &str| FORMATS.iter().find(|format| format.name == name);
    match bytes {
        [b'{', ..] if holds(b"\"CityJSON") => return named("CityGML or CityJSON"),
        [b'I', b'S', b'O', ..] if holds(b"ISO-10303-21") && holds(b"IFC") => return named("IFC"),
        _ => {}
    }
    let is_xml = bytes.starts_with(b"<?xml") || bytes.starts_with(b"<!");
    let begins = |start: &&[u8]| match (is_xml, start[0]) {
        (true, b'<') => holds(start),
        _ => bytes.starts_with(start),
    };
    FORMATS.iter().find(|format| format.starts.iter().any(begins))
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
        let name = |path: &str, bytes: &[u8]| foreign_format(Path::new(path), bytes).map(|found| found.0);
        assert_eq!(name("a.obj", b"OFF\n8 6 0\n"), Some("OFF"));
        assert_eq!(name("a.FBX", &[0; 84]), Some("FBX"));
        assert_eq!(name("a.obj", b"# solid block\nv 0 0 0\n"), None);
        assert_eq!(name("mesh", b"v 0 0 0\n"), None);
        assert_eq!(name("a.obj", b"MM\0*\0\0\0\x08"), Some("a TIFF raster"));
        assert_eq!(name("a.obj", b"<?xml version='1.0'?>\n<!-- house -->\n<COLLADA>"), Some("COLLADA"));
        assert_eq!(name("a", b"{ \"version\": \"2.0\", \"type\": \"CityJSON\""), Some("CityGML or CityJSON"));
        let step = "ISO-10303-21;\nHEADER;\nFILE_SCHEMA(('IFC4'));";
        assert_eq!(name("a", step.as_bytes()), Some("IFC"));
        assert_eq!(name("a", step.replace("IFC4", "AP214").as_bytes()), Some("STEP"));
        assert_eq!(name("dem.tif", b"ncols 4\nnrows 4\n"), Some("an ESRI grid of text"));
        assert!(is_foreign_ending("usdz") && !MESH_ENDINGS.iter().any(|ending| is_foreign_ending(ending)));
    }
}
