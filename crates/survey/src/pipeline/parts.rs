//! The `[[part]]` tables: a scene in a pipeline file.

use super::super::foreign::MESH_ENDINGS;
use super::super::read::loader_of_file;
use super::super::{
    Loader, MaterialChange, MaterialDefinition, MeshReading, MotionTiming, PartRecipe, Replaced, SceneRecipe,
    Transform,
};
use super::keys::{MaterialKeys, PartKeys, PoseKeys};
use super::source::near;
use super::values::Values;
use std::path::Path;
use toml::Spanned;
use vlscan_base::quantity::{self, Bounds};

/// Extensions of the files that can be parts beside those of meshes.
const OTHER_EXTENSIONS: [&str; 3] = ["tif", "tiff", "vox"];

const REFLECTANCE: Bounds = Bounds::new(0.0, 1.0, "a reflectance from 0 to 1");
const ROUGHNESS: Bounds = Bounds::new(0.0, 90.0, "a roughness of 0 to 90 degrees");

/// The scene of these parts. Problems are recorded; parts that cannot be read are left out.
pub(super) fn read_parts(values: &Values, tables: &[Spanned<PartKeys>]) -> SceneRecipe {
    let source = values.source;
    let numbered = tables.iter().zip(0..);
    SceneRecipe {
        id: source.path().file_stem().map_or_else(String::new, |s| s.to_string_lossy().into_owned()),
        path: source.path().to_path_buf(),
        parts: numbered.filter_map(|(table, number)| read_part(values, table, number)).collect(),
        dyn_step: 1,
        dyn_time_step: None,
        packed: None,
        asset_folders: values.context.assets.folders(source.folder()),
    }
}

fn read_part(values: &Values, table: &Spanned<PartKeys>, number: u32) -> Option<PartRecipe> {
    let (keys, place) = (table.get_ref(), values.source.place(table.span()));
    let Some(name) = &keys.file else {
        values.context.error(place, "a [[part]] needs the key `file`");
        return None;
    };
    let extension =
        Path::new(name.get_ref()).extension().unwrap_or_default().to_string_lossy().to_lowercase();
    if !MESH_ENDINGS.iter().chain(&OTHER_EXTENSIONS).any(|known| *known == extension) {
        values.refuse(name, "a file that ends in .obj, .ply, .stl, .gltf, .glb, .tif or .vox");
        return None;
    }
    let file = near(values.source, name.get_ref());
    let path = values.context.file(&file, values.source.folder(), values.source.place(name.span()))?;
    let mut loader = loader_of_file(path);
    if let Loader::MeshFiles { reading, .. } = &mut loader {
        reading.up = keys.up.as_ref().map(|axis| *axis.get_ref());
        if let Some(unit) = &keys.unit {
            match MeshReading::unit(unit.get_ref()) {
                Some(metres) => reading.unit_m = Some(metres),
                None => values.refuse(unit, MeshReading::UNITS),
            }
        }
        reading.materials = keys.materials.as_ref().and_then(|table| {
            let name = near(values.source, table.get_ref());
            values.context.file(&name, values.source.folder(), values.source.place(table.span()))
        });
    } else {
        let refuse = |key: &Spanned<String>| values.refuse(key, "nothing here: it is for meshes");
        keys.unit.iter().chain(&keys.materials).for_each(refuse);
        keys.up.iter().for_each(|axis| values.refuse(axis, "no `up`, which is for meshes"));
    }
    let pose = PoseKeys {
        offset_m: keys.position_m.clone(),
        rotate_deg: keys.rotate_deg.clone(),
        ..PoseKeys::default()
    };
    let pose = values.pose(&pose);
    let on_ground = i64::from(keys.on_ground);
    let mut transform = Transform { rotation: pose.rotation, offset: pose.offset, scale: 1.0, on_ground };
    values.set(&mut transform.scale, &keys.scale, &quantity::SCALE);
    Some(PartRecipe {
        id: keys.id.clone(),
        number,
        loader,
        changes: keys.material.iter().map(|material| read_change(values, material)).collect(),
        transform,
        motions: Vec::new(),
        timing: MotionTiming { dyn_step: 1, tree_step: 1, dyn_time_step: None, tree_time_step: None },
        swaps: Vec::new(),
        place: Some(place),
    })
}

fn read_change(values: &Values, table: &Spanned<MaterialKeys>) -> MaterialChange {
    let keys = table.get_ref();
    if keys.of.is_some() && !keys.primitives.is_empty() {
        let message = "`of` chooses no faces beside `primitives`; it only names the material";
        values.context.warn(values.source.place(table.span()), message);
    }
    let name = keys.name.clone().or(keys.of.clone()).unwrap_or_else(|| "material".to_owned());
    let mut roughness_deg = 0.0;
    values.set(&mut roughness_deg, &keys.roughness_deg, &ROUGHNESS);
    let mut reflectance = 0.0;
    values.set(&mut reflectance, &keys.reflectance, &REFLECTANCE);
    let classification = keys.classification.as_ref().map_or(0, |class| *class.get_ref());
    if let Some(key) = keys.classification.as_ref().filter(|_| !quantity::CLASSES.contains(&classification)) {
        let message =
            format!("class {classification} is written as 0 in LAS and LAZ, which have classes 0 to 255");
        values.context.warn(values.source.place(key.span()), message);
    }
    let replaced = match (&keys.of, keys.primitives.is_empty()) {
        (_, false) => Replaced::Faces(keys.primitives.clone()),
        (Some(name), true) => Replaced::Named(name.clone()),
        (None, true) => Replaced::All,
    };
    let material = MaterialDefinition {
        kd: [1.0; 3],
        roughness: vlscan_geom::radians(roughness_deg),
        reflectance: keys.reflectance.is_some().then_some(reflectance),
        spectrum: keys.spectrum.clone(),
        classification,
        is_ground: keys.is_ground,
        place: Some(values.source.place(table.span())),
        ..MaterialDefinition::new(name)
    };
    MaterialChange { replaced, material }
}
