//! The `[[part]]` tables: a scene in a pipeline file.

use super::super::fields::{Fields, warn_of_repeated_keys};
use super::super::keys::{MaterialKeys, PartKeys};
use super::super::read::MESH_ENDINGS;
use super::super::read::{loader_of_file, raster_loader};
use super::super::{
    Loader, MaterialChange, MaterialDefinition, Mesh, MeshReading, OpticsDefinition, PartRecipe, Replaced,
    SceneRecipe, Transform, UpAxis, WaterDefinition,
};
use super::source::Source;
use std::path::Path;
use std::sync::Arc;
use vlscan_base::quantity::{CLASSES, COUNT};
use vlscan_geom::{DVec3, radians};

/// Maximum coordinate of an area of water, m.
const MAX_AREA: f64 = 1e8;

/// The scene of these parts. Problems are recorded; parts that cannot be read are left out.
pub(super) fn read_parts(fields: &Fields, source: &Source, tables: Vec<Fields>) -> SceneRecipe {
    warn_of_repeated_keys(&tables, PartKeys::KEYS.id);
    let read = |(mut table, number): (Fields, u32)| {
        let part = read_part(&mut table, number);
        table.done(&[]);
        part
    };
    SceneRecipe {
        id: source.path().file_stem().map_or_else(String::new, |s| s.to_string_lossy().into_owned()),
        path: source.path().to_path_buf(),
        parts: tables.into_iter().zip(0..).filter_map(read).collect(),
        dyn_step: 1,
        dyn_time_step: None,
        packed: None,
        asset_folders: fields.context.assets.folders(source.folder()),
    }
}

/// Checks parts that another scene replaces; their files are not searched for.
pub(super) fn check_parts(tables: Vec<Fields>) {
    let keys = PartKeys::KEYS;
    for mut table in tables {
        let _ = read_placed(&mut table);
        for key in [keys.file, keys.unit, keys.materials] {
            let _ = table.text(key);
        }
        let _ = read_water(&mut table);
        let _ = table.choice(keys.up, &UpAxis::NAMES, None);
        table.done(&[]);
    }
}

fn read_part(fields: &mut Fields, number: u32) -> Option<PartRecipe> {
    let part = read_placed(fields);
    Some(PartRecipe { number, loader: read_loader(fields)?, ..part })
}

/// Reads the placement of a part, in addition to its file.
fn read_placed(fields: &mut Fields) -> PartRecipe {
    let keys = PartKeys::KEYS;
    let scale = fields.number(keys.scale, 1.0);
    let rotation = fields.rotations(keys.rotate_deg, false);
    let offset = fields.vector(keys.position_m).unwrap_or(DVec3::ZERO);
    let on_ground = i64::from(fields.flag(keys.on_ground, false));
    let changes = read_changes(fields).into();
    let id = fields.text(keys.id);
    let transform = Transform { rotation, offset, scale, on_ground, ..Transform::IDENTITY };
    let nothing = Loader::MeshFiles { files: Vec::new(), reading: MeshReading::default() };
    PartRecipe { id, changes, place: Some(fields.own_place()), transform, ..PartRecipe::new(nothing) }
}

fn read_loader(fields: &mut Fields) -> Option<Loader> {
    let keys = PartKeys::KEYS;
    let of_meshes = [keys.up, keys.unit, keys.materials];
    if fields.has(keys.water_level_m) || fields.has(keys.water_area_m) {
        for key in of_meshes.into_iter().chain([keys.file]).filter(|key| fields.has(*key)) {
            fields.error(key, "has no meaning beside `water_level_m`");
        }
        fields.ignore(&of_meshes);
        fields.ignore(&[keys.file]);
        return read_water(fields);
    }
    if !fields.has(keys.file) {
        fields.context.error(fields.own_place(), "a [[part]] needs the key `file`");
    }
    let Some(name) = fields.text(keys.file) else {
        fields.ignore(&of_meshes);
        return None;
    };
    let extension = Path::new(&name).extension().unwrap_or_default().to_string_lossy().to_lowercase();
    let is_mesh = MESH_ENDINGS.contains(&extension.as_str());
    let is_raster = fields.context.is_terrain(&name, fields.folder());
    if !is_mesh && !is_raster && extension != "vox" {
        let expected = "a file that ends in .obj, .ply, .stl, .off, .gltf, .glb, .tif, .asc, .vrt or .vox, \
                        or a folder of rasters";
        fields.refuse(keys.file, expected);
        fields.ignore(&of_meshes);
        return None;
    }
    let mut reading = MeshReading::default();
    if is_mesh {
        reading.up = fields.choice(keys.up, &UpAxis::NAMES, None);
        reading.unit_m = fields.text(keys.unit).and_then(|unit| MeshReading::unit(&unit));
        if fields.has(keys.unit) && reading.unit_m.is_none() {
            fields.refuse(keys.unit, MeshReading::UNITS);
        }
        reading.materials = fields.file(keys.materials);
    } else {
        for key in of_meshes.iter().filter(|key| fields.has(**key)) {
            fields.error(*key, "has no meaning here: it is for meshes");
        }
        fields.ignore(&of_meshes);
    }
    if is_raster {
        return fields.raster(keys.file).map(raster_loader);
    }
    match loader_of_file(fields.file(keys.file)?) {
        Loader::MeshFiles { files, .. } => Some(Loader::MeshFiles { files, reading }),
        other => Some(other),
    }
}

/// The level surface of water of a part without a file.
fn read_water(fields: &mut Fields) -> Option<Loader> {
    let keys = PartKeys::KEYS;
    if !fields.has(keys.water_level_m) && !fields.has(keys.water_area_m) {
        return None;
    }
    let level = fields.required_number(keys.water_level_m);
    let is_area = |area: &[f64]| {
        let is_in_reach = |value: &f64| value.abs() <= MAX_AREA;
        area.len() == 4 && area.iter().all(is_in_reach) && area[0] < area[2] && area[1] < area[3]
    };
    let expected = "the smallest x and y, then the largest, in metres: [0, 0, 100, 50]";
    let area = match fields.has(keys.water_area_m) {
        true => fields.numbers(keys.water_area_m, is_area, expected),
        false => {
            fields.context.error(fields.own_place(), "`water_level_m` needs the key `water_area_m`");
            None
        }
    };
    let (level, area) = level.zip(area)?;
    let corner = |i: usize, j: usize| DVec3::new(area[i], area[j], level);
    let vertices = vec![corner(0, 1), corner(2, 1), corner(2, 3), corner(0, 3)];
    let water = WaterDefinition { index: Some(WaterDefinition::FRESH_INDEX), ..WaterDefinition::default() };
    let optics = OpticsDefinition { water, ..OpticsDefinition::default() };
    let material = MaterialDefinition { kd: [1.0; 3], optics, ..MaterialDefinition::new("water") };
    let mesh = Mesh::new(vertices, vec![[0, 1, 2], [0, 2, 3]], vec![material], Vec::new());
    mesh.map(|mesh| Loader::Mesh(Arc::new(mesh.with_name("water".to_owned())))).ok()
}

fn read_optics(fields: &mut Fields) -> OpticsDefinition {
    let keys = MaterialKeys::KEYS;
    fields.either(keys.water_attenuation, keys.water_secchi_m);
    OpticsDefinition {
        mirror: fields.optional(keys.mirror),
        index: fields.optional(keys.pane_index),
        thickness: fields.optional(keys.pane_thickness_m),
        absorption: fields.optional(keys.pane_absorption),
        sheets: fields.has(keys.pane_sheets).then(|| fields.count(keys.pane_sheets, 1)),
        retro: fields.optional(keys.retro),
        opacity: None,
        water: WaterDefinition {
            index: fields.optional(keys.water_index),
            group_index: fields.optional(keys.water_group_index),
            attenuation: fields.optional(keys.water_attenuation),
            secchi: fields.optional(keys.water_secchi_m),
            beam_attenuation: fields.optional(keys.water_beam_attenuation),
            backscatter: fields.optional(keys.water_backscatter),
            wind: fields.optional(keys.water_wind_m_s),
            wind_direction: fields.optional(keys.water_wind_deg),
        },
    }
}

/// The materials of a part that replace those of its file, in their order.
fn read_changes(fields: &mut Fields) -> Vec<MaterialChange> {
    let tables = fields.children(PartKeys::KEYS.material, &MaterialKeys::TABLE);
    let changes: Vec<MaterialChange> = tables.into_iter().map(read_change).collect();
    let last_of_all = changes.iter().rposition(|change| change.replaced == Replaced::All);
    if let Some(number) = last_of_all.filter(|number| *number > 0) {
        fields.context.warn_help(
            changes[number].material.place.clone(),
            "this [[part.material]] replaces all materials of the part, also those of the tables before it",
            "name the material of the file that it replaces with `of`; `name` only names the new material",
        );
    }
    changes
}

fn read_change(mut fields: Fields) -> MaterialChange {
    let keys = MaterialKeys::KEYS;
    let (of, name) = (fields.text(keys.of), fields.text(keys.name));
    let faces = fields.counts(keys.primitives, &COUNT, "whole numbers of at least 0 in brackets");
    let faces = faces.unwrap_or_default();
    if of.is_some() && !faces.is_empty() {
        let message = "`of` chooses no faces beside `primitives`; it only names the material";
        fields.context.warn(fields.own_place(), message);
    }
    let classification = fields.integer(keys.classification).unwrap_or(0);
    let classification = i32::try_from(classification).unwrap_or_else(|_| {
        fields.refuse(keys.classification, "a class from 0 to 255");
        0
    });
    if !CLASSES.contains(&classification) {
        let message =
            format!("class {classification} is written as 0 in LAS and LAZ, which have classes 0 to 255");
        fields.context.warn(fields.place(keys.classification), message);
    }
    let material = MaterialDefinition {
        kd: [1.0; 3],
        roughness: radians(fields.number(keys.roughness_deg, 0.0)),
        element_size: fields.number(keys.element_size_m, 0.0),
        reflectance: fields.optional(keys.reflectance),
        spectrum: fields.text(keys.spectrum),
        classification,
        is_ground: fields.flag(keys.is_ground, false),
        leaf: fields.has(keys.is_leaf).then(|| fields.flag(keys.is_leaf, false)),
        optics: read_optics(&mut fields),
        place: Some(fields.own_place()),
        ..MaterialDefinition::new(name.or(of.clone()).unwrap_or_else(|| "material".to_owned()))
    };
    fields.done(&[]);
    let replaced = match of {
        _ if !faces.is_empty() => Replaced::Faces(faces),
        Some(name) => Replaced::Named(name),
        None => Replaced::All,
    };
    MaterialChange { replaced, material }
}
