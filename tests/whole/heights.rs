//! Terrain as height fields gives the bytes of terrain as stored triangles.

use crate::common::folder;
use crate::scenes::everything;
use crate::storage::{leaves_no_trace, packs_and_instruction_sets_leave_no_trace};
use std::fs;
use std::path::Path;

/// A terrain of 8 by 8 heights in place of the floor of [`everything`], with a hole, and the same raster once
/// more: translated and dropped to the first.
fn with_terrain(folder: &Path) {
    everything(folder);
    let mut tiff = crate::common::raster([-21.0, 21.0], 6.0, Some(25832));
    let start = tiff.len() - 4 * 64;
    for (i, number) in tiff[start..].chunks_exact_mut(4).enumerate() {
        let height = if i == 29 { f32::NAN } else { -1.0 + 0.25 * ((i * 7) % 11) as f32 };
        number.copy_from_slice(&height.to_le_bytes());
    }
    fs::write(folder.join("dem.tif"), tiff).unwrap();
    fs::write(
        folder.join("g.mtl"),
        "newmtl soil\nhelios_isGround true\nhelios_reflectance 30\nhelios_classification 2\n",
    )
    .unwrap();
    let param = |key: &str, value: &str| format!("<param type=\"string\" key=\"{key}\" value=\"{value}\"/>");
    let terrain = format!(
        "<filter type=\"geotiffloader\">{}{}</filter>",
        param("filepath", "dem.tif"),
        param("matfile", "g.mtl")
    );
    let moved = "<filter type=\"translate\"><param type=\"vec3\" key=\"offset\" value=\"12;-3;9\"/>\
        <param type=\"integer\" key=\"onGround\" value=\"-1\"/></filter>";
    let scene = fs::read_to_string(folder.join("scene.xml")).unwrap();
    let floor = format!("<filter type=\"objloader\">{}</filter>", param("filepath", "floor.obj"));
    assert!(scene.contains(&floor), "{scene}");
    let scene = scene
        .replace(&floor, &terrain)
        .replace("</scene>", &format!("<part>{terrain}{moved}</part></scene>"));
    fs::write(folder.join("scene.xml"), scene).unwrap();
}

#[test]
fn height_fields_leave_no_trace() {
    let dir = folder();
    with_terrain(dir.path());
    leaves_no_trace(
        &dir.path().join("survey.xml"),
        |settings, is_compact| settings.load.triangulate_rasters = !is_compact,
        |geometry| geometry.fields.len(),
        2,
    );
}

#[test]
fn packs_and_instruction_sets_leave_no_trace_in_terrain() {
    let dir = folder();
    with_terrain(dir.path());
    packs_and_instruction_sets_leave_no_trace(
        dir.path(),
        |settings, is_compact| settings.load.triangulate_rasters = !is_compact,
        |geometry| geometry.fields.len(),
        2,
    );
}
