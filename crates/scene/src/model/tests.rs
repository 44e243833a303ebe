//! Tests of scenes.

use super::*;
use vlscan_trace::Geometry;

fn scene() -> Scene {
    let vertices =
        [[0.0, 0.0, 1.0], [4.0, 0.0, 1.0], [4.0, 4.0, 5.0], [0.0, 4.0, 5.0]].map(DVec3::from).to_vec();
    let lifted: Vec<DVec3> = vertices.iter().map(|v| *v + DVec3::Z * 10.0).collect();
    let roof: Vec<DVec3> = vertices.iter().map(|v| *v - DVec3::Z * 10.0).collect();
    Scene {
        geometry: Geometry {
            vertices: [vertices, lifted, roof].concat(),
            triangles: vec![[0, 1, 2], [0, 2, 3], [4, 5, 6], [8, 9, 10]],
            cubes: vec![Cube { centre: DVec3::new(6.0, 1.0, 0.0), half: 0.5 }],
            ..Geometry::default()
        },
        surface_ids: vec![0, 0, 0, 1, 0].into(),
        surfaces: vec![Surface { part: 0, material: 0 }, Surface { part: 0, material: 1 }],
        materials: vec![
            Material { is_ground: true, ..Material::unnamed("soil", Corrections::NONE) },
            Material::unnamed("tile", Corrections::NONE),
        ],
        voxels: vec![Voxel::default()],
        shift: DVec3::new(1000.0, 2000.0, 3.0),
        ..Scene::default()
    }
}

#[test]
fn the_lowest_ground_counts_and_only_ground() {
    let s = scene();
    assert_eq!(s.ground_height(3.0, 1.0), Some(2.0));
    assert_eq!(s.ground_height(2.0, 2.0), Some(3.0), "on the common edge of two triangles");
    assert_eq!(s.ground_height(4.0, 4.0), Some(5.0), "on a corner");
    assert_eq!(s.ground_height(6.2, 1.2), Some(0.5), "the upper face of a cube");
    assert_eq!(s.ground_height(-1.0, 1.0), None);
}

#[test]
fn the_box_of_the_ground_has_neither_roofs_nor_voxels() {
    let mut s = scene();
    let bounds = s.ground_bounds().unwrap();
    assert_eq!(bounds.min, DVec3::new(0.0, 0.0, -0.5), "the tile lies ten metres lower");
    assert_eq!(bounds.max, DVec3::new(6.5, 4.0, 15.0));
    s.materials[0].is_ground = false;
    assert_eq!(s.ground_bounds(), None);
}

#[test]
fn frames_and_primitives() {
    let s = scene();
    assert_eq!(s.to_world(DVec3::ONE), DVec3::new(1001.0, 2001.0, 4.0));
    assert_eq!(s.to_local(s.to_world(DVec3::ONE)), DVec3::ONE);
    assert!(s.voxel(3).is_none() && s.voxel(4).is_some() && s.voxel(5).is_none());
    assert_eq!((s.part_of(4), s.material_of(3).name.as_str()), (0, "tile"));
    assert!(s.memory() > 12 * 24 + 4 * 12 + 32 + 24 + 20);
}
