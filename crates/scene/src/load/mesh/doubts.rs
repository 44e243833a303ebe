//! Meshes that are probably read in the wrong unit or with the wrong axis up: coordinates in millimetres are
//! taken as metres, and a mesh whose y is up lies on its side. The extent of most meshes reveals both; they
//! cause a warning unless the scene states unit or axis.

use crate::builder::SceneBuilder;
use crate::ground::{Body, bounds_of};
use std::path::{Path, PathBuf};
use vlscan_base::diag::Place;
use vlscan_base::quantity::metres;
use vlscan_geom::{Aabb, DVec3};
use vlscan_survey::{Loader, MeshReading, PartRecipe};

/// Height from which a mesh is doubted, m: more than nearly all buildings have.
const MIN_TALL: f64 = 400.0;
/// Ratio of height to width below which a tall mesh may be a landscape.
const MIN_STEEP: f64 = 0.25;
/// Heights that a mesh in another unit may have, m.
const PLAUSIBLE_HEIGHTS: std::ops::RangeInclusive<f64> = 0.2..=150.0;
/// Width and depth from which a thin sheet is doubted, m: a flat one, and one with relief.
const MIN_SHEET: f64 = 100.0;
const MIN_ROUGH_SHEET: f64 = 50.0;
/// Share of a sheet's width from which its thickness is relief.
const MIN_RELIEF: f64 = 0.01;
/// Width of a solid mesh relative to its length; thinner ones are beams, logs or cables.
const MIN_SOLID: f64 = 0.1;
/// Distance from 0 of coordinates that no height is, m.
const MIN_FAR: f64 = 20_000.0;

/// Warns of a part whose mesh is probably in another unit or lies on its side, once for each file.
pub(crate) fn check(scene: &mut SceneBuilder, part: &PartRecipe, files: &[PathBuf], body: &Body) {
    let (Loader::MeshFiles { reading, .. }, [file]) = (&part.loader, files) else { return };
    if reading.unit_m.is_some() && reading.up.is_some() || scene.doubted.contains(file) {
        return;
    }
    let (placed, own) = (bounds_of(scene, body), own_bounds(scene, part, body));
    report(scene, part, (file, reading), placed.size(), own);
}

/// As [`check`] for a glTF file whose meshes become separate parts; `own` is the box around all in the frame
/// of the file, z up.
pub(super) fn check_document(scene: &mut SceneBuilder, part: &PartRecipe, own: Aabb) {
    if let Loader::MeshFiles { reading, files } = &part.loader
        && let [file] = &files[..]
        && !own.is_empty()
    {
        report(scene, part, (file, reading), own.size() * part.transform.scale.abs(), own);
    }
}

fn report(
    scene: &mut SceneBuilder,
    part: &PartRecipe,
    (file, reading): (&Path, &MeshReading),
    size: DVec3,
    own: Aabb,
) {
    if !scene.doubted.insert(file.to_path_buf()) {
        return;
    }
    let place = Some(Place::of_file(file));
    if let (None, Some(message)) = (reading.unit_m, unit_doubt(size)) {
        scene.diagnostics.warn(place.clone(), message).help(
            "`unit` of its loader converts it (unit = \"mm\", <param type=\"string\" key=\"unit\" \
             value=\"mm\"/>); \"m\" confirms metres",
        );
    }
    if reading.up.is_some() || part.transform.rotation.apply(DVec3::Z).z <= 0.999 {
        return;
    }
    // The standard of glTF has y up, other formats are read with z up.
    let (doubt, help) = match super::expand::is_gltf(file) {
        true => (
            turned_doubt(own),
            "`up` of its loader reads it as it is (up = \"z\", <param type=\"string\" key=\"up\" \
             value=\"z\"/>); \"y\" confirms that y is up, the standard of glTF",
        ),
        false => (
            axis_doubt(own),
            "`up` of its loader turns it (up = \"y\", <param type=\"string\" key=\"up\" value=\"y\"/>); \
             \"z\" confirms that it is right",
        ),
    };
    if let Some(message) = doubt {
        scene.diagnostics.warn(place, message).help(help);
    }
}

/// The box of a part's mesh in its own frame.
fn own_bounds(scene: &SceneBuilder, part: &PartRecipe, body: &Body) -> Aabb {
    match body {
        Body::Stored(extent) => {
            let vertices = &scene.geometry.vertices[extent.vertices.clone()];
            crate::builder::bounds_of_points(vertices, |p| part.transform.undo(p))
        }
        Body::Instance(instance) => {
            let model = scene.meshes.placements[*instance].0;
            crate::builder::bounds_of_points(&scene.meshes.models[model as usize].geometry.vertices, |p| p)
        }
    }
}

/// Doubt about the unit of a mesh of this size in metres.
fn unit_doubt(size: DVec3) -> Option<String> {
    let wide = size.x.max(size.y);
    if size.z < MIN_TALL || size.z < MIN_STEEP * wide {
        return None;
    }
    let units = [("millimetres", 0.001), ("centimetres", 0.01)];
    let likely = units.iter().filter(|(_, unit)| PLAUSIBLE_HEIGHTS.contains(&(size.z * unit)));
    let likely: Vec<String> =
        likely.map(|(name, unit)| format!("{name} ({} high)", metres(size.z * unit))).collect();
    let likely = if likely.is_empty() { "another unit".to_owned() } else { likely.join(" or ") };
    Some(format!(
        "the mesh is {} wide and {} high: its coordinates are probably {likely}, and are taken as metres",
        metres(wide),
        metres(size.z)
    ))
}

/// Doubt about the axes of a mesh with this box, z up.
fn axis_doubt(bounds: Aabb) -> Option<String> {
    let (size, centre) = (bounds.size(), bounds.centre());
    let is_centred = |centre: f64, size: f64| centre.abs() <= 0.1 * size;
    let stands_on_y = (-0.2 * size.y..=0.05 * size.y).contains(&bounds.min.y) && centre.y >= 0.3 * size.y;
    let is_solid = size.x.min(size.z) >= MIN_SOLID * size.y;
    if stands_on_y && is_solid && is_centred(centre.x, size.x) && is_centred(centre.z, size.z) {
        return Some(
            "the mesh lies on its side: it stands on y = 0 and extends equally to both sides in x and z, so \
             y is probably up"
                .to_owned(),
        );
    }
    is_sheet(size).then(|| {
        format!(
            "the mesh stands upright like a wall, {} wide and {} high: it is probably a landscape whose y is \
             up",
            metres(size.x),
            metres(size.z)
        )
    })
}

/// True if a mesh of this size is a landscape on its side.
fn is_sheet(size: DVec3) -> bool {
    let smallest = size.x.min(size.z);
    let is_wide = smallest >= MIN_SHEET || smallest >= MIN_ROUGH_SHEET && size.y >= MIN_RELIEF * smallest;
    is_wide && size.y <= 0.2 * smallest
}

/// Returns doubts about the axes of a glTF mesh whose box is this after y of the file has become up: if z of
/// the file was up, it now points to -y.
fn turned_doubt(bounds: Aabb) -> Option<String> {
    let (size, centre, top) = (bounds.size(), bounds.centre(), bounds.max.y);
    let is_on_both_sides =
        |axis: usize| bounds.min[axis] <= -0.1 * size[axis] && bounds.max[axis] >= 0.1 * size[axis];
    let stands_on_z = (-0.05 * size.y..=0.2 * size.y).contains(&top) && centre.y <= -0.3 * size.y;
    let is_solid = size.x.min(size.z) >= MIN_SOLID * size.y;
    let message = match () {
        () if stands_on_z && is_solid && is_on_both_sides(0) && is_on_both_sides(2) => {
            "it stands on z = 0 of the file and extends to both sides in x and y".to_owned()
        }
        () if centre.z.abs() >= MIN_FAR && bounds.max.y.abs() < MIN_FAR => {
            format!("it is {} above 0, which is probably a northing", metres(centre.z))
        }
        () if is_sheet(size) => format!(
            "it stands upright like a wall, {} wide and {} high, and is probably a landscape",
            metres(size.x),
            metres(size.z)
        ),
        () => return None,
    };
    Some(format!("the mesh lies on its side: glTF has y up, and {message}, so z of the file is probably up"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture::Fixture;
    use vlscan_survey::UpAxis;

    /// A box as OBJ.
    fn solid(low: [f64; 3], high: [f64; 3]) -> String {
        let corner = |i: usize| [0, 1, 2].map(|axis| if i >> axis & 1 == 0 { low[axis] } else { high[axis] });
        let mut text: String = (0..8).map(corner).map(|[x, y, z]| format!("v {x} {y} {z}\n")).collect();
        text.push_str("f 1 3 4 2\nf 5 6 8 7\nf 1 2 6 5\nf 3 7 8 4\nf 1 5 7 3\nf 2 4 8 6\n");
        text
    }

    /// The warnings of a part with this mesh.
    fn warnings(obj: &str, change: impl Fn(&mut PartRecipe)) -> String {
        let mut f = Fixture::new();
        change(f.obj("house.obj", obj));
        f.load().unwrap().1.text()
    }

    #[test]
    fn millimetres_are_told_from_metres() {
        let house = solid([-6000.0, -4000.0, -1000.0], [6000.0, 4000.0, 8000.0]);
        let found = warnings(&house, |_| {});
        assert!(
            found.contains("millimetres (9.0 m high) or centimetres (90 m high)")
                && found.contains("house.obj"),
            "{found}"
        );
        let reading = |part: &mut PartRecipe, unit: f64| {
            let Loader::MeshFiles { reading, .. } = &mut part.loader else { panic!() };
            reading.unit_m = Some(unit);
        };
        for right in [
            warnings(&house, |part| reading(part, 0.001)),
            warnings(&house, |part| reading(part, 1.0)),
            warnings(&house, |part| part.transform.scale = 0.001),
            warnings(&solid([0.0, 0.0, 0.0], [20_000.0, 20_000.0, 3000.0]), |_| {}),
            warnings(&solid([-30.0, -30.0, 0.0], [30.0, 30.0, 380.0]), |_| {}),
        ] {
            assert!(right.is_empty(), "{right}");
        }
    }

    #[test]
    fn a_mesh_on_its_side_is_recognised() {
        let tree = solid([-2.0, 0.0, -2.1], [2.1, 12.0, 2.0]);
        let terrain = solid([0.0, 200.0, 0.0], [500.0, 230.0, -400.0]);
        let about_z = |part: &mut PartRecipe| part.transform.rotation = vlscan_geom::Rotation::about_z(0.5);
        // A tile of 100 m whose outermost points are 99 m apart.
        let tile = solid([0.0, 197.0, -99.0], [99.0, 203.0, 0.0]);
        let tower = solid([-5.0, 0.0, -5.0], [5.0, 60.0, 5.0]);
        for lying in [
            warnings(&tree, |_| {}),
            warnings(&tile, |_| {}),
            warnings(&tower, |_| {}),
            warnings(&tree, |part| part.transform.offset = DVec3::new(476_000.0, 5_429_000.0, 210.0)),
            warnings(&tree, about_z),
            warnings(&terrain, |_| {}),
        ] {
            assert!(lying.contains("y is") && lying.contains("up = \"y\""), "{lying}");
        }
        let up = |part: &mut PartRecipe, axis: UpAxis| {
            let Loader::MeshFiles { reading, .. } = &mut part.loader else { panic!() };
            reading.up = Some(axis);
        };
        for right in [
            warnings(&tree, |part| up(part, UpAxis::Y)),
            warnings(&tree, |part| up(part, UpAxis::Z)),
            warnings(&tree, |part| {
                part.transform.rotation = vlscan_geom::Rotation::about_x(std::f64::consts::FRAC_PI_2)
            }),
            warnings(&solid([-2.0, -2.0, 0.0], [2.0, 2.0, 12.0]), |_| {}),
            warnings(&solid([-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]), |_| {}),
            // A wall, the front of a house, and a log.
            warnings(&solid([0.0, 0.0, 0.0], [60.0, 0.1, 60.0]), |_| {}),
            warnings(&solid([0.0, 0.0, 0.0], [40.0, 2.0, 20.0]), |_| {}),
            warnings(&solid([-0.3, 0.0, -0.3], [0.3, 12.0, 0.3]), |_| {}),
            warnings(&solid([0.0, 0.0, 0.0], [3.0, 5.0, 2.0]), |_| {}),
            warnings(&solid([-5.0, 0.0, -0.1], [5.0, 80.0, 0.1]), |_| {}),
        ] {
            assert!(right.is_empty(), "{right}");
        }
    }

    /// The warnings of a glTF file that is this box with z up, as the axes of its file.
    fn warnings_of_gltf(low: [f64; 3], high: [f64; 3], change: impl Fn(&mut PartRecipe)) -> String {
        let corner = |i: usize| [0, 1, 2].map(|axis| if i >> axis & 1 == 0 { low[axis] } else { high[axis] });
        let faces = [0u16, 2, 3, 0, 3, 1, 4, 5, 7, 4, 7, 6, 0, 1, 5, 0, 5, 4, 2, 6, 7, 2, 7, 3];
        let mut bytes: Vec<u8> = (0..8).flat_map(corner).flat_map(|v| (v as f32).to_le_bytes()).collect();
        bytes.extend(faces.iter().flat_map(|i| i.to_le_bytes()));
        let document = serde_json::json!({
            "asset": { "version": "2.0" },
            "buffers": [{ "uri": "box.bin", "byteLength": bytes.len() }],
            "bufferViews": [{ "buffer": 0, "byteLength": 96 },
                { "buffer": 0, "byteOffset": 96, "byteLength": 48 }],
            "accessors": [{ "bufferView": 0, "componentType": 5126, "count": 8, "type": "VEC3" },
                { "bufferView": 1, "componentType": 5123, "count": 24, "type": "SCALAR" }],
            "materials": [{ "name": "wall", "extras": { "helios_reflectance": 0.5 } }],
            "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 }, "indices": 1, "material": 0 }] }],
            "nodes": [{ "mesh": 0 }], "scenes": [{ "nodes": [0] }], "scene": 0,
        });
        let mut f = Fixture::new();
        std::fs::write(f.file("box.bin", ""), bytes).unwrap();
        let path = f.file("town.gltf", document.to_string());
        let reading = vlscan_survey::MeshReading::default();
        change(f.part(Loader::MeshFiles { files: vec![path], reading }));
        f.load().unwrap().1.text()
    }

    #[test]
    fn a_gltf_file_with_z_up_is_recognised() {
        let town =
            |change: fn(&mut PartRecipe)| warnings_of_gltf([-100.0, -20.0, -0.2], [90.0, 25.0, 12.0], change);
        let has_motions_or_id: [fn(&mut PartRecipe); 2] = [|_| {}, |part| part.id = Some("town".to_owned())];
        for lying in [
            town(has_motions_or_id[0]),
            town(has_motions_or_id[1]),
            warnings_of_gltf([-2.0, -2.0, 0.0], [2.0, 2.0, 15.0], |_| {}),
            warnings_of_gltf([-5.0, -5.0, 0.0], [5.0, 5.0, 60.0], |_| {}),
            warnings_of_gltf([0.0, 0.0, 197.0], [99.0, 99.0, 203.0], |_| {}),
            warnings_of_gltf([0.0, 0.0, 200.0], [500.0, 400.0, 230.0], |_| {}),
            warnings_of_gltf([476_000.0, 5_429_000.0, 110.0], [476_050.0, 5_429_050.0, 120.0], |_| {}),
        ] {
            let is_reported = lying.contains("lies on its side") && lying.contains("up = \"z\"");
            assert!(is_reported && lying.contains("town.gltf"), "{lying}");
        }
        let up = |part: &mut PartRecipe, axis: UpAxis| {
            let Loader::MeshFiles { reading, .. } = &mut part.loader else { panic!() };
            reading.up = Some(axis);
        };
        for right in [
            warnings_of_gltf([-100.0, -20.0, -0.2], [90.0, 25.0, 12.0], |part| up(part, UpAxis::Z)),
            warnings_of_gltf([-100.0, -20.0, -0.2], [90.0, 25.0, 12.0], |part| up(part, UpAxis::Y)),
            // Files with y up.
            warnings_of_gltf([-100.0, -0.2, -25.0], [90.0, 12.0, 20.0], |_| {}),
            warnings_of_gltf([-1.0, -1.0, -1.0], [1.0, 1.0, 1.0], |_| {}),
            warnings_of_gltf([0.0, 0.0, 0.0], [3.0, 5.0, 2.0], |_| {}),
            warnings_of_gltf([0.0, 100.0, -400.0], [500.0, 130.0, 0.0], |_| {}),
        ] {
            assert!(right.is_empty(), "{right}");
        }
    }
}
