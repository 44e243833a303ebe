//! Parameters of the geometry loaders (spec input-formats §3.5, §4). Files are resolved here, not read.

use super::fields::{Fields, Reading};
use super::keys::Key;
use super::{Loader, MaterialChoice, MeshReading, RasterFiles, UpAxis, VoxelLoader, VoxelMode, XyzLoader};
use std::path::PathBuf;
use vlscan_base::quantity::NOT_NEGATIVE;
use vlscan_geom::{DVec3, direction};

/// Types of filters that load geometry.
pub(super) const LOADERS: [&str; 5] =
    ["objloader", "meshloader", "geotiffloader", "xyzloader", "detailedvoxels"];

/// Reads the loader of type `kind` (lower case). `None`: problems have been recorded.
pub(super) fn read_loader(kind: &str, mut params: Fields) -> Option<Loader> {
    let loader = match kind {
        "objloader" | "meshloader" => read_meshes(&mut params),
        "geotiffloader" => read_geotiff(&mut params),
        "xyzloader" => read_xyz(&mut params),
        _ => read_voxels(&mut params),
    };
    params.done(&[]);
    loader
}

impl Loader {
    /// Splits the loader into one per file, except for rasters, whose files are tiles of one grid.
    pub(super) fn per_file(self) -> Vec<Loader> {
        let one = |file: &PathBuf| {
            let mut loader = self.clone();
            match &mut loader {
                Loader::MeshFiles { files, .. } => *files = vec![file.clone()],
                Loader::Xyz(xyz) => xyz.files = vec![file.clone()],
                Loader::DetailedVoxels(voxels) => voxels.files = vec![file.clone()],
                Loader::GeoTiff { .. } | Loader::Mesh(_) => {}
            }
            loader
        };
        if matches!(self, Loader::Mesh(_) | Loader::GeoTiff { .. }) {
            vec![self]
        } else {
            self.files().iter().map(one).collect()
        }
    }
}

fn read_meshes(params: &mut Fields) -> Option<Loader> {
    let files = read_files(params);
    params.ignore(&["recomputeVertexNormals"]);
    let up = params.choice("up", &UpAxis::NAMES, Some("z"));
    let up = up.or(params.has("up").then_some(UpAxis::Z));
    let unit = params.text("unit").map(|text| MeshReading::unit(&text));
    if unit == Some(None) {
        params.refuse("unit", MeshReading::UNITS);
    }
    let materials = params.file("materials");
    let reading = MeshReading { up, unit_m: unit.flatten(), materials };
    Some(Loader::MeshFiles { files: files?, reading })
}

fn read_geotiff(params: &mut Fields) -> Option<Loader> {
    let files = match params.text("efilepath") {
        Some(expression) => matching_files(params, &expression).map(RasterFiles::Tiles),
        None if params.has("filepath") => params.raster("filepath"),
        None => {
            params.missing("filepath");
            None
        }
    };
    let material = read_material(params, false);
    Some(Loader::GeoTiff { files: files?, material })
}

fn read_xyz(params: &mut Fields) -> Option<Loader> {
    let files = read_files(params);
    let separator = params.text("separator");
    let has_columns = |f: &PathBuf| !f.extension().is_some_and(is_binary_cloud);
    if separator.is_none() && files.as_ref().is_none_or(|files| files.iter().any(has_columns)) {
        params.missing("separator");
    }
    let voxel_size = params.optional("voxelSize");
    match voxel_size {
        Some(0.0) => params.warn("voxelSize", "is 0; cubes of 1 m are used, as in HELIOS++"),
        None if !params.has("voxelSize") => params.missing("voxelSize"),
        Some(size) if size < 0.0 => params.refuse("voxelSize", "a number of at least 0"),
        _ => {}
    }
    let max_color_value = params.optional("maxColorValue").unwrap_or(0.0);
    if params.has("maxColorValue") && max_color_value == 0.0 {
        params.warn("maxColorValue", "is 0; 255 is used, as in HELIOS++");
    }
    let default_normal = params.vector("defaultNormal");
    if default_normal == Some(DVec3::ZERO) {
        params.refuse("defaultNormal", "a direction");
    }
    let rgb_columns = read_columns(params, ["rgbRIndex", "rgbGIndex", "rgbBIndex"], 6);
    let normal_columns = read_columns(params, ["normalXIndex", "normalYIndex", "normalZIndex"], 3);
    let snap_neighbor_normal = params.flag("snapNeighborNormal", false);
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

/// True if files with this extension are point clouds whose columns need no separator.
fn is_binary_cloud(extension: &std::ffi::OsStr) -> bool {
    ["las", "laz", "ply", "pcd", "e57", "pts", "ptx", "arrow", "parquet"]
        .iter()
        .any(|e| extension.eq_ignore_ascii_case(e))
}

/// Columns of a cloud that hold its coordinates.
const COORDINATES: [&str; 3] = ["x", "y", "z"];

/// Three column numbers, which take effect only when the first of them is present.
fn read_columns(params: &mut Fields, keys: [&'static str; 3], first: u32) -> Option<[usize; 3]> {
    let given = params.has(keys[0]);
    if !given {
        params.without_effect(&keys[1..], &format!("without `{}`", keys[0]));
        return None;
    }
    let mut columns = [0; 3];
    for (column, (key, default)) in columns.iter_mut().zip(keys.iter().zip(first..)) {
        *column = params.count(*key, default) as usize;
        if *column < COORDINATES.len() {
            let axis = COORDINATES[*column];
            params.warn(*key, &format!("is {column}, the column of {axis}: columns are counted from 0"));
        }
    }
    for (i, key) in keys.iter().enumerate() {
        if let Some(j) = (0..i).find(|&j| columns[j] == columns[i]) {
            params.warn(*key, &format!("is {}, as `{}`: one column is read twice", columns[i], keys[j]));
        }
    }
    Some(columns)
}

fn read_voxels(params: &mut Fields) -> Option<Loader> {
    let files = read_files(params);
    let argument = params.optional(Key::attribute("intersectionArgument", &NOT_NEGATIVE));
    let drop_empty = !params.has("intersectionMode");
    let modes = [
        ("transmittive", VoxelMode::Transmittive),
        ("fixed", VoxelMode::Fixed),
        ("scaled", VoxelMode::Scaled(argument.unwrap_or(0.5))),
    ];
    params.reading = Reading::Lenient;
    let mode = params.choice("intersectionMode", &modes, Some("transmittive"));
    params.reading = Reading::Required;
    let mode = mode.unwrap_or(VoxelMode::Transmittive);
    if !matches!(mode, VoxelMode::Scaled(_)) {
        params.without_effect(&["intersectionArgument"], "without `intersectionMode` scaled");
    }
    let random_shift = params.flag("randomShift", false);
    let lad_table = params.file("ladlut");
    let material = read_material(params, true);
    let loader = VoxelLoader { files: files?, mode, drop_empty, random_shift, lad_table, material };
    Some(Loader::DetailedVoxels(Box::new(loader)))
}

/// The files of `efilepath`, else of `filepath`.
fn read_files(params: &mut Fields) -> Option<Vec<PathBuf>> {
    let single = params.has("filepath");
    let Some(expression) = params.text("efilepath") else {
        if !single {
            params.missing("filepath");
        }
        return params.file("filepath").map(|f| vec![f]);
    };
    matching_files(params, &expression)
}

/// The files that match the expression of `efilepath`.
fn matching_files(params: &mut Fields, expression: &str) -> Option<Vec<PathBuf>> {
    params.ignore(&["filepath"]);
    let place = params.place("efilepath");
    params.context.files_matching(expression, expression, params.folder(), Some(place))
}

fn read_material(params: &mut Fields, variants: bool) -> MaterialChoice {
    if !params.has("matfile") {
        params.without_effect(&["matname", "randomMaterials", "randomRange"], "without `matfile`");
    }
    let file = params.file("matfile");
    let name = params.text("matname");
    let (random_variants, random_range) = match variants {
        true => {
            if !params.has("randomMaterials") {
                params.without_effect(&["randomRange"], "without `randomMaterials`");
            }
            (params.count("randomMaterials", 0), params.optional("randomRange").unwrap_or(1.0))
        }
        false => {
            params.without_effect(&["randomMaterials", "randomRange"], "for rasters");
            (0, 1.0)
        }
    };
    MaterialChoice { file, name, random_variants, random_range }
}
