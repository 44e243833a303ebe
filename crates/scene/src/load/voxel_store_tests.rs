//! Voxels on grids are the cubes that would be stored, in every part of a scene.

use crate::fixture::{Fixture, report};
use crate::{
    Fallback, GroundModel, Inventory, MotionPlan, Pack, PartFacts, Scene, VoxelKind, fingerprint, pack,
};
use std::fmt::Write as _;
use std::sync::Arc;
use vlscan_geom::{DVec3, Rotation, unit};
use vlscan_survey::{
    Loader, MaterialChange, MaterialChoice, MaterialDefinition, MotionSequence, Replaced, VoxelLoader,
    VoxelMode, XyzLoader,
};
use vlscan_trace::{BuildOptions, Builder, Hits, RayGroup, TraceScratch};

const GROUND: &str = "newmtl g\nhelios_isGround true\nhelios_classification 2\nhelios_reflectance 40\n\
    newmtl h\nhelios_classification 3\nhelios_reflectance 20\n";
const MESH: &str = "v 3 1 0\nv 5 1 0\nv 3 2 6\nv 2 1 3\nf 1 2 3\nf 1 2 4\nf 2 3 4\n";

/// Cells of a bushy grid of 9 by 8 by 21 cells in the order of some axes, from the slowest to the fastest.
fn cells(order: [usize; 3]) -> Vec<[u32; 3]> {
    let counts = order.map(|axis| [9, 8, 21][axis]);
    let in_scene = |at: [u32; 3]| {
        let mut cell = [0; 3];
        order.iter().zip(at).for_each(|(axis, at)| cell[*axis] = at);
        cell
    };
    let all = (0..counts[0])
        .flat_map(|a| (0..counts[1]).flat_map(move |b| (0..counts[2]).map(move |c| in_scene([a, b, c]))));
    all.filter(|[x, y, z]| (x * 7 + y * 5 + z * 3) % 11 < 7).collect()
}

/// A voxel file of these cells.
fn voxel_file(cells: &[[u32; 3]], corner: &str) -> String {
    let mut text = format!(
        "VOXEL SPACE\n#min_corner: {corner}\n#max_corner: 0 0 0\n#split: 9 8 21\n#res: 0.3 #max_pad: 4\n\
         i j k PadBVTotal transmittance\n"
    );
    for (n, [x, y, z]) in cells.iter().enumerate() {
        let density = [0.0, 0.1, 1.25, f64::NAN, 3.3][n % 5];
        let _ = writeln!(text, "{x} {y} {z} {density} {}", [0.5, 1.0][n % 7 / 6]);
    }
    text
}

fn voxels(f: &mut Fixture, name: &str, text: String, mode: VoxelMode) -> usize {
    let files = vec![f.file(name, text)];
    let material = f.file("g.mtl", GROUND);
    f.part(Loader::DetailedVoxels(Box::new(VoxelLoader {
        files,
        mode,
        drop_empty: false,
        random_shift: false,
        lad_table: None,
        material: MaterialChoice { file: Some(material), ..MaterialChoice::default() },
    })));
    f.parts.len() - 1
}

fn bush(f: &mut Fixture, mode: VoxelMode) -> usize {
    voxels(f, "bush.vox", voxel_file(&cells([0, 1, 2]), "1.1 -2.3 0.7"), mode)
}

fn cloud(f: &mut Fixture, has_normals: bool, class: &str) -> usize {
    let mut text = String::from("//X Y Z Classification Nx Ny Nz\n");
    for i in 0..3000u32 {
        let [x, y, z] = [i * 37 % 101, i * 53 % 89, i * 29 % 67].map(|n| f64::from(n) * 0.07);
        let class = if class == "mixed" { (i * 37 % 101 / 40 + 1).to_string() } else { class.to_owned() };
        let _ = writeln!(text, "{x} {y} {z} {class} {} 0.5 0.7", f64::from(i % 7) - 3.0);
    }
    let files = vec![f.file("cloud.xyz", text)];
    f.part(Loader::Xyz(Box::new(XyzLoader {
        files,
        separator: " ".to_owned(),
        voxel_size: 0.4,
        max_color_value: 255.0,
        default_normal: None,
        rgb_columns: None,
        normal_columns: has_normals.then_some([4, 5, 6]),
        snap_neighbor_normal: false,
        estimate_normals: 0,
        material: MaterialChoice::default(),
    })));
    f.parts.len() - 1
}

fn load(f: &mut Fixture, are_grids: bool) -> (Scene, String) {
    f.options.min_grid_voxels = if are_grids { 1 } else { usize::MAX };
    let (scene, warnings) = f.load().unwrap_or_else(|e| panic!("{}", report(&e)));
    (scene, warnings.text())
}

/// Compares the scene with `grids` grids to the one with stored cubes.
fn check(f: &mut Fixture, grids: usize) {
    let ((grid, reported), (stored, expected)) = (load(f, true), load(f, false));
    assert_eq!(reported, expected);
    assert_eq!((grid.geometry.grids.len(), stored.geometry.grids.len()), (grids, 0));
    assert_eq!((grid.shift, grid.bounds, grid.sizes()), (stored.shift, stored.bounds, stored.sizes()));
    assert_eq!((grid.primitives(), grid.numbers()), (stored.primitives(), stored.numbers()));
    assert_eq!(grid.ground_bounds(), stored.ground_bounds());
    assert_eq!(format!("{:?}", Inventory::of(&grid)), format!("{:?}", Inventory::of(&stored)));
    let facts = [&grid, &stored].map(|scene| format!("{:?}", PartFacts::of_scene(scene)));
    assert_eq!(facts[0], facts[1]);
    for i in 0..stored.numbers() as u32 {
        assert_eq!(grid.triangle(i), stored.triangle(i), "{i}");
        assert_eq!(grid.geometry.cube_of(i), stored.geometry.cube_of(i), "{i}");
        assert_eq!(format!("{:?}", grid.voxel_and_cube(i)), format!("{:?}", stored.voxel_and_cube(i)), "{i}");
        assert_eq!(grid.number_when_stored(i), stored.number_when_stored(i), "{i}");
        assert_eq!((grid.part_of(i), grid.is_still(i)), (stored.part_of(i), stored.is_still(i)), "{i}");
        assert_eq!(grid.material_of(i), stored.material_of(i), "{i}");
    }
    let plans = [&grid, &stored].map(|scene| MotionPlan::new(scene, 100.0).is_some());
    assert_eq!(plans[0], plans[1]);
    check_places(&grid, &stored);
    check_rays(&grid, &stored);
    check_pack(f);
}

fn check_places(grid: &Scene, stored: &Scene) {
    let model = |scene: &Scene| {
        let scene = Arc::new(scene.clone());
        let tree = scene.tree(&BuildOptions::default());
        GroundModel::new(scene, tree, Fallback::Highest)
    };
    let models = [model(grid), model(stored)];
    let size = stored.bounds.size();
    for i in 0..100 {
        let (a, b) = (f64::from(i % 10) / 8.0 - 0.02, f64::from(i / 10) / 8.0 - 0.02);
        let place = stored.bounds.min + DVec3::new(a * size.x, b * size.y, 0.0);
        assert_eq!(grid.ground_height(place.x, place.y), stored.ground_height(place.x, place.y), "{place}");
        let [one, other] = models.each_ref().map(|model| model.local_height(place.x, place.y));
        assert_eq!(one, other, "{place}");
    }
}

fn check_rays(grid: &Scene, stored: &Scene) {
    let (size, mut group) = (stored.bounds.size(), RayGroup::new(5));
    for i in 0..2000 {
        let (a, b) = (f64::from(i % 63) / 63.0, f64::from(i / 63) / 32.0);
        let height = [50.0, 1.0, -0.5][i as usize % 3];
        let origin = stored.bounds.min + DVec3::new(a * size.x, b * size.y, size.z + height);
        group.push(origin, |x, y, z| {
            for r in 0..5 {
                let aside = 0.01 * r as f64;
                let direction = unit(DVec3::new(0.4 * a - 0.2 + aside, 0.3 - b, -1.0));
                (x[r], y[r], z[r]) = direction.into();
            }
        });
    }
    let mut found = 0;
    for builder in [Builder::Bvh, Builder::Fsah] {
        let options = BuildOptions::of(builder);
        let [one, other] = [grid, stored].map(|scene| {
            let (tree, mut hits) = (scene.tree(&options), Hits::default());
            tree.trace_group(&scene.geometry, &group, &mut hits, &mut TraceScratch::default());
            (hits.t.iter().map(|t| t.to_bits()).collect::<Vec<_>>(), hits.primitive)
        });
        for pulse in 0..group.len() {
            for at in (0..5).map(|ray| pulse * group.stride() + ray) {
                assert_eq!((one.0[at], one.1[at]), (other.0[at], other.1[at]), "{builder:?}, pulse {pulse}");
                found += usize::from(one.1[at] != Hits::MISS);
            }
        }
    }
    assert!(found > 2000, "{found}");
}

/// A packed scene has the grids of its sources.
fn check_pack(f: &mut Fixture) {
    let (scene, _) = load(f, true);
    let path = f.path().join("s.vlscene");
    pack(&f.recipe(), &f.options, &BuildOptions::default(), &path, &|_| Ok(())).unwrap();
    let packed = Pack::open(&path).unwrap();
    packed.verify().unwrap();
    let again = packed.scene(&f.options, 0).unwrap();
    assert_eq!(again.sizes(), scene.sizes());
    let sums = [&again, &scene].map(|scene| fingerprint(scene, &f.recipe()).unwrap());
    assert_eq!(sums[0], sums[1]);
    assert_eq!(again.numbers(), scene.numbers());
    for i in 0..scene.numbers() as u32 {
        assert_eq!((again.triangle(i), again.surface(i)), (scene.triangle(i), scene.surface(i)), "{i}");
        assert_eq!(format!("{:?}", again.voxel_and_cube(i)), format!("{:?}", scene.voxel_and_cube(i)), "{i}");
    }
    check_rays(&again, &scene);
}

#[test]
fn files_in_the_order_of_any_axes_are_grids() {
    for order in [[0, 1, 2], [2, 1, 0], [1, 0, 2], [0, 2, 1], [1, 2, 0], [2, 0, 1]] {
        for mode in [VoxelMode::Transmittive, VoxelMode::Fixed] {
            let mut f = Fixture::new();
            voxels(&mut f, "a.vox", voxel_file(&cells(order), "1.1 -2.3 0.7"), mode);
            check(&mut f, 1);
        }
    }
}

#[test]
fn files_in_no_order_and_cells_that_occur_twice_or_outside_are_cubes() {
    let all = cells([0, 1, 2]);
    let mut swapped = all.clone();
    swapped.swap(300, 500);
    let twice = [&all[..], &all[all.len() - 1..]].concat();
    let outside = [&all[..], &[[9, 0, 0]]].concat();
    for cells in [swapped, twice, outside] {
        let mut f = Fixture::new();
        voxels(&mut f, "a.vox", voxel_file(&cells, "500000.1 5400000.3 0.7"), VoxelMode::Transmittive);
        check(&mut f, 0);
    }
}

#[test]
fn grids_stand_among_meshes_cubes_and_moving_parts() {
    let mut f = Fixture::new();
    f.obj("first.obj", MESH);
    let moving = |part: &mut vlscan_survey::PartRecipe| {
        part.motions = vec![MotionSequence { id: "m".to_owned(), loops: 0, next: None, motions: Vec::new() }];
    };
    let own = bush(&mut f, VoxelMode::Transmittive);
    moving(&mut f.parts[own]);
    bush(&mut f, VoxelMode::Transmittive);
    // At the same places: the first cube has the hit.
    bush(&mut f, VoxelMode::Fixed);
    let scaled = bush(&mut f, VoxelMode::Scaled(0.5));
    f.parts[scaled].transform.offset = DVec3::new(0.3, 4.0, 0.0);
    let own = cloud(&mut f, true, "1");
    f.parts[own].transform.offset = DVec3::new(2.0, -1.0, 0.5);
    let own = bush(&mut f, VoxelMode::Fixed);
    f.parts[own].transform.offset = DVec3::new(-3.0, 0.1, 0.0);
    moving(&mut f.parts[own]);
    moving(f.obj("last.obj", MESH));
    check(&mut f, 3);
    let plan = [true, false].map(|are_grids| {
        let (scene, _) = load(&mut f, are_grids);
        let plan = MotionPlan::new(&scene, 100.0).unwrap();
        let objects = crate::DynamicScene::new(&plan, BuildOptions::default()).rebuild_moved().to_vec();
        let numbers = |i: u32| objects.iter().map(|o| o.to_object_index(i)).collect::<Vec<_>>();
        (0..scene.numbers() as u32).map(numbers).collect::<Vec<_>>()
    });
    assert_eq!(plan[0], plan[1]);
}

#[test]
fn clouds_are_grids() {
    for has_normals in [true, false] {
        for class in ["0", "5", "mixed"] {
            let mut f = Fixture::new();
            let part = cloud(&mut f, has_normals, class);
            check(&mut f, 1);
            f.parts[part].transform.scale = 1.7;
            f.parts[part].transform.offset = DVec3::new(500_000.2, 0.1, -3.0);
            check(&mut f, 1);
        }
    }
}

#[test]
fn several_files_of_a_part_follow_each_other() {
    let mut f = Fixture::new();
    let part = bush(&mut f, VoxelMode::Transmittive);
    let mut swapped = cells([0, 1, 2]);
    swapped.swap(3, 40);
    let files = [
        f.file("b.vox", voxel_file(&swapped, "5 0 0")),
        f.file("c.vox", voxel_file(&cells([2, 1, 0]), "9 0 0.2")),
    ];
    let Loader::DetailedVoxels(loader) = &mut f.parts[part].loader else { panic!("voxels") };
    loader.files.extend(files);
    f.parts[part].id = Some("three".to_owned());
    check(&mut f, 2);
    f.parts[part].transform.on_ground = -1;
    bush(&mut f, VoxelMode::Fixed);
    check(&mut f, 3);
}

#[test]
fn parts_are_dropped_to_grids_and_grids_to_parts() {
    for mode in [1, -1, 2, 50] {
        let mut f = Fixture::new();
        let ground = bush(&mut f, VoxelMode::Fixed);
        f.parts[ground].transform.offset = DVec3::new(0.5, -0.0, 2.25);
        f.obj("thing.obj", MESH).transform.on_ground = mode;
        let upper = bush(&mut f, VoxelMode::Transmittive);
        f.parts[upper].transform.on_ground = mode;
        f.parts[upper].transform.offset = DVec3::new(0.2, 0.1, 100.0);
        check(&mut f, 2);
        assert!(load(&mut f, true).0.geometry.grids[1].place().raise != 0.0);
    }
}

#[test]
fn grids_that_grow_or_move_stay_grids_and_turned_ones_do_not() {
    for (scale, offset) in [(1.0, DVec3::new(0.25, -7.1, 1e5)), (0.5, DVec3::ZERO), (1.7, DVec3::ONE)] {
        let mut f = Fixture::new();
        let part = bush(&mut f, VoxelMode::Fixed);
        (f.parts[part].transform.scale, f.parts[part].transform.offset) = (scale, offset);
        check(&mut f, 1);
    }
    for (rotation, scale) in [(Rotation::about_z(0.3), 1.0), (Rotation::IDENTITY, -1.0)] {
        let mut f = Fixture::new();
        let part = bush(&mut f, VoxelMode::Fixed);
        (f.parts[part].transform.rotation, f.parts[part].transform.scale) = (rotation, scale);
        check(&mut f, 0);
    }
}

#[test]
fn materials_of_grids_are_replaced_and_taken_in_turn() {
    let change = |replaced| MaterialChange {
        replaced,
        material: MaterialDefinition { classification: 9, ..MaterialDefinition::new("new") },
    };
    for (replaced, grids) in [
        (Replaced::All, 1),
        (Replaced::Named("g".to_owned()), 1),
        (Replaced::Named("other".to_owned()), 1),
        (Replaced::Faces(vec![0, 5, 6]), 0),
    ] {
        let mut f = Fixture::new();
        let part = bush(&mut f, VoxelMode::Fixed);
        f.parts[part].changes = vec![change(replaced)].into();
        check(&mut f, grids);
    }
    let mut f = Fixture::new();
    let part = bush(&mut f, VoxelMode::Transmittive);
    let Loader::DetailedVoxels(loader) = &mut f.parts[part].loader else { panic!("voxels") };
    loader.material.random_variants = 5;
    check(&mut f, 1);
}

#[test]
fn a_large_file_is_read_piece_by_piece() {
    let side = 120u32;
    let all = (0..side).flat_map(|x| (0..side).flat_map(move |y| (0..side).map(move |z| [x, y, z])));
    let cells: Vec<[u32; 3]> = all.filter(|[x, y, z]| (x ^ y ^ z) % 3 != 0).collect();
    let text = voxel_file(&cells, "0 0 0").replace("#split: 9 8 21", "#split: 120 120 120");
    assert!(text.len() > 17 << 20, "{}: a file that is mapped", text.len());
    let mut f = Fixture::new();
    voxels(&mut f, "large.vox", text.trim_end().to_owned(), VoxelMode::Fixed);
    let ((grid, reported), (stored, expected)) = (load(&mut f, true), load(&mut f, false));
    assert_eq!((reported, grid.numbers()), (expected, stored.numbers()));
    assert!(grid.geometry.grids[0].cubes().eq(stored.geometry.cubes.iter().copied()));
    assert!((0..stored.numbers() as u32).all(|i| {
        let kinds = [&grid, &stored].map(|s| s.voxel(i).map(|v| (v.density.to_bits(), v.kind())));
        kinds[0] == kinds[1] && kinds[0].is_some_and(|k| k.1 != VoxelKind::Transmittive)
    }));
    let bytes = grid.memory() as f64 / cells.len() as f64;
    assert!(bytes < 8.0, "{bytes}");
}
