//! Parameters of the geometry loaders (spec input-formats §3.5, §4). Files are resolved here, not read.

use super::assets::{Located, NoMatch};
use super::params::Params;
use super::{Loader, MaterialChoice, MeshReading, UpAxis, VoxelLoader, VoxelMode, XyzLoader};
use std::path::PathBuf;
use vlscan_geom::{DVec3, direction};

/// Types of filters that load geometry.
pub(super) const LOADERS: [&str; 5] =
    ["objloader", "meshloader", "geotiffloader", "xyzloader", "detailedvoxels"];

/// Reads the loader of type `kind` (lower case). `None`: problems have been recorded.
pub(super) fn read_loader(kind: &str, mut params: Params) -> Option<Loader> {
    let loader = match kind {
        "objloader" | "meshloader" => read_meshes(&mut params),
        "geotiffloader" => read_geotiff(&mut params),
        "xyzloader" => read_xyz(&mut params),
        _ => read_voxels(&mut params),
    };
    params.done();
    loader
}

impl Loader {
    /// Splits the loader into one for each of its files.
    pub(super) fn per_file(self) -> Vec<Loader> {
        match self {
            Loader::MeshFiles { files, reading } => {
                let one = |f| Loader::MeshFiles { files: vec![f], reading: reading.clone() };
                files.into_iter().map(one).collect()
            }
            Loader::GeoTiff { .. } | Loader::Mesh(_) => vec![self],
            Loader::Xyz(xyz) => {
                let files = xyz.files.clone();
                files
                    .into_iter()
                    .map(|f| Loader::Xyz(Box::new(XyzLoader { files: vec![f], ..*xyz.clone() })))
                    .collect()
            }
            Loader::DetailedVoxels(voxels) => {
                let one =
                    |f| Loader::DetailedVoxels(Box::new(VoxelLoader { files: vec![f], ..*voxels.clone() }));
                voxels.files.clone().into_iter().map(one).collect()
            }
        }
    }
}

fn read_meshes(params: &mut Params) -> Option<Loader> {
    let files = read_files(params);
    params.ignore(&["recomputeVertexNormals"]);
    let up = match params.text("up") {
        Some((text, _)) if text == "y" => Some(UpAxis::Y),
        Some((text, _)) if text == "z" => Some(UpAxis::Z),
        Some((text, param)) => {
            let message = format!("unknown up axis `{text}`; z is used");
            params.context.warn_help(param.value_place("value"), message, "the up axis is y or z");
            Some(UpAxis::Z)
        }
        None => None,
    };
    let unit = params.text("unit").map(|(text, _)| MeshReading::unit(&text));
    if unit == Some(None) {
        params.refuse("unit", MeshReading::UNITS);
    }
    let materials = read_file(params, "materials");
    let reading = MeshReading { up, unit_m: unit.flatten(), materials };
    Some(Loader::MeshFiles { files: files?, reading })
}

fn read_geotiff(params: &mut Params) -> Option<Loader> {
    let file = read_file(params, "filepath");
    if !params.has("filepath") {
        params.missing("filepath");
    }
    let material = read_material(params, false);
    Some(Loader::GeoTiff { file: file?, material })
}

fn read_xyz(params: &mut Params) -> Option<Loader> {
    let files = read_files(params);
    let separator = params.text("separator").map(|(text, _)| text);
    let has_columns = |f: &PathBuf| !f.extension().is_some_and(is_binary_cloud);
    if separator.is_none() && files.as_ref().is_none_or(|files| files.iter().any(has_columns)) {
        params.missing("separator");
    }
    let voxel_size = params.number("voxelSize");
    match voxel_size {
        Some(0.0) => params.warn("voxelSize", "is 0; cubes of 1 m are used, as in HELIOS++"),
        None if !params.has("voxelSize") => params.missing("voxelSize"),
        Some(size) if size < 0.0 => params.refuse("voxelSize", "a number of at least 0"),
        _ => {}
    }
    let max_color_value = params.number("maxColorValue").unwrap_or(0.0);
    if params.has("maxColorValue") && max_color_value == 0.0 {
        params.warn("maxColorValue", "is 0; 255 is used, as in HELIOS++");
    }
    let default_normal = params.vector("defaultNormal");
    if default_normal == Some(DVec3::ZERO) {
        params.refuse("defaultNormal", "a direction");
    }
    let rgb_columns = read_columns(params, ["rgbRIndex", "rgbGIndex", "rgbBIndex"], 6);
    let normal_columns = read_columns(params, ["normalXIndex", "normalYIndex", "normalZIndex"], 3);
    let snap_neighbor_normal = params.flag("snapNeighborNormal");
    let estimate_normals = params.count("estimateNormals", 0);
    params.ignore(&["sparse"]);
    let material = read_material(params, true);
    Some(Loader::Xyz(Box::new(XyzLoader {
        files: files?,
        separator: separator.unwrap_or_default(),
        voxel_size: voxel_size.map(|size| if size == 0.0 { 1.0 } else { size })?,
        max_color_value: if max_color_value == 0.0 { 255.0 } else { max_color_value },
        default_normal: default_normal.and_then(direction),
        rgb_columns,
        normal_columns,
        snap_neighbor_normal,
        estimate_normals,
        material,
    })))
}

/// Whether files with this extension are point clouds whose columns need no separator.
fn is_binary_cloud(extension: &std::ffi::OsStr) -> bool {
    ["las", "laz", "ply", "pcd", "e57", "pts", "ptx", "arrow", "parquet"]
        .iter()
        .any(|e| extension.eq_ignore_ascii_case(e))
}

/// Three column numbers, which take effect only when the first of them is present.
fn read_columns(params: &mut Params, keys: [&'static str; 3], first: u32) -> Option<[usize; 3]> {
    let given = params.has(keys[0]);
    if !given {
        params.without_effect(&keys[1..], &format!("without `{}`", keys[0]));
        return None;
    }
    let mut columns = [0; 3];
    for (column, (key, default)) in columns.iter_mut().zip(keys.iter().zip(first..)) {
        *column = params.count(key, default) as usize;
    }
    Some(columns)
}

fn read_voxels(params: &mut Params) -> Option<Loader> {
    let files = read_files(params);
    let argument = params.number("intersectionArgument");
    let mode = params.text("intersectionMode");
    let drop_empty = mode.is_none();
    let mode = match mode.as_ref().map(|(text, _)| text.to_ascii_lowercase()).as_deref() {
        None | Some("transmittive") => VoxelMode::Transmittive,
        Some("fixed") => VoxelMode::Fixed,
        Some("scaled") => VoxelMode::Scaled(argument.unwrap_or(0.5)),
        Some(other) => {
            if let Some((_, param)) = &mode {
                let message = format!("unknown intersection mode `{other}`; transmittive is used");
                let help = "the modes are transmittive, fixed and scaled";
                params.context.warn_help(param.value_place("value"), message, help);
            }
            VoxelMode::Transmittive
        }
    };
    if !matches!(mode, VoxelMode::Scaled(_)) {
        params.without_effect(&["intersectionArgument"], "without `intersectionMode` scaled");
    }
    let random_shift = params.flag("randomShift");
    let lad_table = read_file(params, "ladlut");
    let material = read_material(params, true);
    let loader = VoxelLoader { files: files?, mode, drop_empty, random_shift, lad_table, material };
    Some(Loader::DetailedVoxels(Box::new(loader)))
}

/// The files of `efilepath`, else of `filepath`.
fn read_files(params: &mut Params) -> Option<Vec<PathBuf>> {
    let single = params.has("filepath");
    let Some((expression, param)) = params.text("efilepath") else {
        if !single {
            params.missing("filepath");
        }
        return read_file(params, "filepath").map(|f| vec![f]);
    };
    params.ignore(&["filepath"]);
    let context = params.context;
    let place = param.value_place("value");
    match context.assets.matching(&expression, param.folder()) {
        Ok(Located { found, respelled }) => {
            context.warn_of_spelling(&expression, respelled.as_deref(), Some(place));
            Some(found)
        }
        Err(NoMatch::Expression(e)) => {
            let reason = e.lines().last().unwrap_or_default().trim().to_owned();
            context.error_help(place, "the part after the last `/` is no regular expression", reason);
            None
        }
        Err(NoMatch::Nothing) => {
            let help = context.assets.searched(&expression, param.folder());
            context.error_help(place, format!("no file matches `{expression}`"), help);
            None
        }
    }
}

pub(super) fn read_file(params: &mut Params, key: &'static str) -> Option<PathBuf> {
    let (name, param) = params.text(key)?;
    params.context.file(&name, param.folder(), param.value_place("value"))
}

fn read_material(params: &mut Params, variants: bool) -> MaterialChoice {
    if !params.has("matfile") {
        params.without_effect(&["matname", "randomMaterials", "randomRange"], "without `matfile`");
    }
    let file = read_file(params, "matfile");
    let name = params.text("matname").map(|(text, _)| text);
    let (random_variants, random_range) = match variants {
        true => {
            if !params.has("randomMaterials") {
                params.without_effect(&["randomRange"], "without `randomMaterials`");
            }
            (params.count("randomMaterials", 0), params.number("randomRange").unwrap_or(1.0))
        }
        false => {
            params.without_effect(&["randomMaterials", "randomRange"], "for rasters");
            (0, 1.0)
        }
    };
    MaterialChoice { file, name, random_variants, random_range }
}
