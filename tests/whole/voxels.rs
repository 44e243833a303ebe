//! Voxels on grids give the bytes of voxels as stored cubes.

use crate::common::folder;
use crate::scenes::everything;
use crate::storage::{leaves_no_trace, packs_and_instruction_sets_leave_no_trace};
use std::fmt::Write as _;
use std::fs;
use std::path::Path;

/// [`everything`] with opaque and scaled voxels, transmittive ones that touch those with a leaf angle table,
/// a point cloud of cubes with normals, and moving voxels.
fn with_voxels(folder: &Path) {
    everything(folder);
    let param = |key: &str, value: &str| format!("<param type=\"string\" key=\"{key}\" value=\"{value}\"/>");
    let mut crowns = String::from(
        "VOXEL SPACE\n#min_corner: 3 -3 -1\n#max_corner: 8 3 3\n#split: 20 24 16\n#res: 0.25 #max_pad: 5\n\
         i j k PadBVTotal transmittance\n",
    );
    for i in 0..20 * 24 * 16 {
        let [x, y, z] = [i / 384, i / 16 % 24, i % 16];
        if (x * 5 + y * 3 + z * 7) % 9 < 2 {
            let _ = writeln!(
                crowns,
                "{x} {y} {z} {} {}",
                0.013 * f64::from(i % 300),
                if i % 13 == 0 { 1.0 } else { 0.5 }
            );
        }
    }
    fs::write(folder.join("crowns.vox"), crowns).unwrap();
    let mut points = String::from("X Y Z Nx Ny Nz Classification\n");
    for i in 0..4000u32 {
        let [x, y, z] = [i * 37 % 101, i * 53 % 89, i * 29 % 67].map(|n| f64::from(n) * 0.05);
        let _ =
            writeln!(points, "{} {} {z} {} 0.4 1 {}", x - 9.0, y - 4.0, f64::from(i % 5) - 2.0, i % 4 + 1);
    }
    fs::write(folder.join("cloud.xyz"), points).unwrap();
    fs::write(
        folder.join("v.mtl"),
        "newmtl leaf\nhelios_reflectance 30\nhelios_classification 5\nnewmtl bark\nhelios_reflectance 20\nhelios_classification 6\n",
    )
    .unwrap();
    let voxels = |mode: &str, extra: &str| {
        format!(
            "<filter type=\"detailedvoxels\">{}{}{}{extra}</filter>",
            param("filepath", "crowns.vox"),
            param("intersectionMode", mode),
            param("matfile", "v.mtl"),
        )
    };
    let at = |offset: &str| {
        format!(
            "<filter type=\"translate\"><param type=\"vec3\" key=\"offset\" value=\"{offset}\"/></filter>"
        )
    };
    let cloud = format!(
        "<filter type=\"xyzloader\">{}{}<param type=\"double\" key=\"voxelSize\" value=\"0.3\"/></filter>",
        param("filepath", "cloud.xyz"),
        param("separator", " ")
    );
    let scaled = "<filter type=\"scale\"><param type=\"double\" key=\"scale\" value=\"0.8\"/></filter>";
    let moving = "<dmotion id=\"m\" loop=\"0\"><motion type=\"translation\" vec=\"0.02;0;0\"/></dmotion>";
    let turned = "<param type=\"boolean\" key=\"randomShift\" value=\"true\"/>";
    let parts = [
        voxels("transmittive", "") + &at("-6;0;0"),
        voxels("fixed", ""),
        voxels("fixed", "") + scaled + &at("-1;9;0.1"),
        voxels("scaled", turned) + &at("-9;-12;0"),
        cloud,
        voxels("transmittive", "") + &at("-4;-14;0") + moving,
    ];
    let parts: String = parts.iter().map(|part| format!("<part dynStep=\"10\">{part}</part>")).collect();
    let scene = fs::read_to_string(folder.join("scene.xml")).unwrap();
    fs::write(folder.join("scene.xml"), scene.replace("</scene>", &format!("{parts}</scene>"))).unwrap();
}

#[test]
fn grids_of_voxels_leave_no_trace() {
    let dir = folder();
    with_voxels(dir.path());
    leaves_no_trace(
        &dir.path().join("survey.xml"),
        |settings, is_compact| settings.load.min_grid_voxels = if is_compact { 1 } else { usize::MAX },
        |geometry| geometry.grids.len(),
        5,
    );
}

#[test]
fn packs_and_instruction_sets_leave_no_trace_in_voxels() {
    let dir = folder();
    with_voxels(dir.path());
    packs_and_instruction_sets_leave_no_trace(
        dir.path(),
        |settings, is_compact| settings.load.min_grid_voxels = if is_compact { 1 } else { usize::MAX },
        |geometry| geometry.grids.len(),
        5,
    );
}
