//! Rasters as height fields are the scene that they are as stored triangles.

use super::tests::{TiffFile, Values};
use crate::fixture::{Fixture, report};
use crate::{Fallback, MotionPlan, Pack, fingerprint, pack};
use crate::{GroundModel, Inventory, PartFacts, Scene, Sharing};
use std::sync::Arc;
use vlscan_geom::{DVec3, Rotation, unit};
use vlscan_survey::{
    Loader, MaterialChange, MaterialChoice, MaterialDefinition, MotionSequence, Replaced, VoxelLoader,
    VoxelMode,
};
use vlscan_trace::{BuildOptions, Builder, Hits, RayGroup, TraceScratch};

const COLUMNS: u32 = 23;
const ROWS: u32 = 14;
const NO_DATA: f32 = -9999.0;

/// Hills with whole heights in places, and holes.
fn heights(seed: u32, has_holes: bool) -> Vec<f32> {
    let height = |i: u32| {
        let (x, y) = (i % COLUMNS, i / COLUMNS);
        let mixed = (x * 7 + y * 13 + seed * 5 + x * y) % 17;
        match (has_holes && mixed == 3, (x / 5 + y / 4) % 2) {
            (true, _) => NO_DATA,
            (_, 0) => mixed as f32 * 0.37,
            _ => (mixed / 4) as f32,
        }
    };
    (0..COLUMNS * ROWS).map(height).collect()
}

fn raster(seed: u32, has_holes: bool) -> TiffFile {
    TiffFile::new(COLUMNS, &heights(seed, has_holes)).with(42_113, Values::Text("-9999"))
}

/// A raster of whole numbers of 16 bits or of floats of 64.
fn raster_of(bits: u16) -> TiffFile {
    let numbers = heights(2, true);
    let bytes = |z: &f32| match bits {
        16 => (*z as i16).to_le_bytes().to_vec(),
        _ => (f64::from(*z) / 3.0).to_le_bytes().to_vec(),
    };
    let mut file = raster(2, true)
        .with(258, Values::Short(vec![bits]))
        .with(339, Values::Short(vec![if bits == 16 { 2 } else { 3 }]));
    file.blocks = vec![numbers.iter().flat_map(bytes).collect()];
    if bits == 64 { file.with(42_113, Values::Text("-3333")) } else { file }
}

const GROUND: &str = "newmtl g\nhelios_isGround true\nhelios_classification 2\nhelios_reflectance 40\n";
const MESH: &str = "v 104 30 0\nv 112 30 0\nv 104 22 6\nv 112 40 3\nf 1 2 3\nf 1 2 4\nf 2 3 4\n";

fn add(f: &mut Fixture, name: &str, bytes: Vec<u8>) -> usize {
    let file = f.file(name, bytes);
    let material = f.file("g.mtl", GROUND);
    f.part(Loader::GeoTiff {
        files: file.into(),
        material: MaterialChoice { file: Some(material), ..MaterialChoice::default() },
    });
    f.parts.len() - 1
}

fn load(f: &mut Fixture, triangulate: bool) -> (Scene, String) {
    f.options.triangulate_rasters = triangulate;
    let (scene, warnings) = f.load().unwrap_or_else(|e| panic!("{}", report(&e)));
    (scene, warnings.text())
}

/// Compares the scene with `fields` height fields to the one with stored triangles.
fn check(f: &mut Fixture, fields: usize) {
    let ((field, reported), (stored, expected)) = (load(f, false), load(f, true));
    assert_eq!(reported, expected);
    assert_eq!((field.geometry.fields.len(), stored.geometry.fields.len()), (fields, 0));
    assert_eq!((field.shift, field.bounds, field.sizes()), (stored.shift, stored.bounds, stored.sizes()));
    assert_eq!((field.primitives(), stored.primitives()), (stored.primitives(), stored.numbers()));
    assert_eq!(field.ground_bounds(), stored.ground_bounds());
    assert_eq!(format!("{:?}", Inventory::of(&field)), format!("{:?}", Inventory::of(&stored)));
    let facts = [&field, &stored].map(|scene| format!("{:?}", PartFacts::of_scene(scene)));
    assert_eq!(facts[0], facts[1]);
    let is_there = |i: &u32| field.triangle(*i).is_some() || field.voxel(*i).is_some();
    let numbers: Vec<u32> = (0..field.numbers() as u32).filter(is_there).collect();
    assert_eq!(numbers.len(), stored.primitives());
    for (n, &i) in numbers.iter().enumerate() {
        let n = n as u32;
        assert_eq!(field.number_when_stored(i), stored.number_when_stored(n), "{i}");
        assert_eq!(field.triangle(i), stored.triangle(n), "{i}");
        assert_eq!(field.voxel(i), stored.voxel(n), "{i}");
        assert_eq!((field.part_of(i), field.is_still(i)), (stored.part_of(n), stored.is_still(n)), "{i}");
        assert_eq!(field.material_of(i), stored.material_of(n), "{i}");
    }
    let plans = [&field, &stored].map(|scene| MotionPlan::new(scene, 100.0));
    assert_eq!(plans[0].is_some(), plans[1].is_some());
    check_places(&field, &stored);
    check_rays(&field, &stored);
    check_pack(f);
}

fn check_places(field: &Scene, stored: &Scene) {
    let model = |scene: &Scene| {
        let scene = Arc::new(scene.clone());
        let tree = scene.tree(&BuildOptions::default());
        GroundModel::new(scene, tree, Fallback::Highest)
    };
    let models = [model(field), model(stored)];
    let size = stored.bounds.size();
    for i in 0..900 {
        let (a, b) = (f64::from(i % 30) / 28.0 - 0.02, f64::from(i / 30) / 28.0 - 0.02);
        let place = stored.bounds.min + DVec3::new(a * size.x, b * size.y, 0.0);
        assert_eq!(field.ground_height(place.x, place.y), stored.ground_height(place.x, place.y), "{place}");
        let [one, other] = models.each_ref().map(|model| model.local_height(place.x, place.y));
        assert_eq!(one, other, "{place}");
    }
}

fn check_rays(field: &Scene, stored: &Scene) {
    let (size, mut group) = (stored.bounds.size(), RayGroup::new(5));
    for i in 0..4000 {
        let (a, b) = (f64::from(i % 63) / 63.0, f64::from(i / 63) / 64.0);
        let height = [50.0, 1.0, -20.0][i as usize % 3];
        let origin = stored.bounds.min + DVec3::new(a * size.x, b * size.y, size.z + height);
        group.push(origin, |x, y, z| {
            for r in 0..5 {
                let aside = 0.01 * r as f64;
                let direction = unit(DVec3::new(0.4 * a - 0.2 + aside, 0.3 - b, -f64::signum(height)));
                (x[r], y[r], z[r]) = direction.into();
            }
        });
    }
    let mut found = 0;
    for builder in [Builder::Bvh, Builder::Fsah] {
        let options = BuildOptions::of(builder);
        let [one, other] = [field, stored].map(|scene| {
            let (tree, mut hits) = (scene.tree(&options), Hits::default());
            tree.trace_group(&scene.geometry, &group, &mut hits, &mut TraceScratch::default());
            let number = |i: &u32| if *i == Hits::MISS { *i } else { scene.number_when_stored(*i) };
            (
                hits.t.iter().map(|t| t.to_bits()).collect::<Vec<_>>(),
                hits.primitive.iter().map(number).collect::<Vec<_>>(),
            )
        });
        for pulse in 0..group.len() {
            for at in (0..5).map(|ray| pulse * group.stride() + ray) {
                assert_eq!((one.0[at], one.1[at]), (other.0[at], other.1[at]), "{builder:?}, pulse {pulse}");
                found += usize::from(one.1[at] != Hits::MISS);
            }
        }
    }
    assert!(found > 1000, "{found}");
}

/// A packed scene has the fields of its sources.
fn check_pack(f: &mut Fixture) {
    let (scene, _) = load(f, false);
    let path = f.path().join("s.vlscene");
    pack(&f.recipe(), &f.options, &BuildOptions::default(), &path, &|_| Ok(())).unwrap();
    let packed = Pack::open(&path).unwrap();
    packed.verify().unwrap();
    let again = packed.scene(&f.options, 0).unwrap();
    assert_eq!(again.sizes(), scene.sizes());
    assert_eq!(again.field_surfaces, scene.field_surfaces);
    let sums = [&again, &scene].map(|scene| fingerprint(scene, &f.recipe()).unwrap());
    assert_eq!(sums[0], sums[1]);
    assert_eq!(again.numbers(), scene.numbers());
    for i in 0..scene.numbers() as u32 {
        assert_eq!((again.triangle(i), again.surface(i)), (scene.triangle(i), scene.surface(i)), "{i}");
    }
}

#[test]
fn a_raster_alone_is_its_triangles() {
    for has_holes in [false, true] {
        let mut f = Fixture::new();
        add(&mut f, "dem.tif", raster(1, has_holes).bytes());
        check(&mut f, 1);
    }
}

#[test]
fn numbers_of_all_widths_are_kept() {
    for bits in [16, 64] {
        let mut f = Fixture::new();
        add(&mut f, "dem.tif", raster_of(bits).bytes());
        check(&mut f, 1);
    }
}

#[test]
fn turned_rasters_and_far_ones_are_their_triangles() {
    let mut m = vec![0.0; 16];
    (m[0], m[1], m[3], m[4], m[5], m[7]) = (1.6, 1.2, 500_000.3, 1.2, -1.6, 5_400_000.7);
    let mut f = Fixture::new();
    add(&mut f, "dem.tif", raster(3, true).with(34_264, Values::Double(m)).bytes());
    check(&mut f, 1);
}

#[test]
fn rasters_stand_among_meshes_voxels_and_moving_parts() {
    let mut f = Fixture::new();
    f.obj("first.obj", MESH);
    add(&mut f, "dem.tif", raster(1, true).bytes());
    f.obj("moving.obj", MESH).motions =
        vec![MotionSequence { id: "m".to_owned(), loops: 0, next: None, motions: Vec::new() }];
    // The triangles of both rasters are at the same places.
    add(&mut f, "dem.tif", raster(1, true).bytes());
    let voxels = "VOXEL SPACE\n#min_corner: 105 20 5\n#max_corner: 106 21 6\n#split: 2 2 2\n#res:0.5 #max_pad:4.0\n\
        i j k PadBVTotal a b c d e f g h n transmittance m l\n0 0 1 1.5 54.2 0.4 0.1 0.6 1.25 0.3 12.5 7 60 0.5 0.9 0.0\n";
    let files = vec![f.file("v.vox", voxels)];
    f.part(Loader::DetailedVoxels(Box::new(VoxelLoader {
        files,
        mode: VoxelMode::Fixed,
        drop_empty: false,
        random_shift: false,
        lad_table: None,
        material: MaterialChoice::default(),
    })));
    f.obj("last.obj", MESH);
    f.obj("last.obj", MESH).transform.offset = DVec3::new(1.0, 2.0, 3.0);
    for sharing in [Sharing::Never, Sharing::Always] {
        f.options.sharing = sharing;
        check(&mut f, 2);
    }
}

#[test]
fn parts_are_dropped_to_rasters_and_rasters_to_parts() {
    for mode in [1, -1, 2, 50] {
        let mut f = Fixture::new();
        let ground = add(&mut f, "dem.tif", raster(1, true).bytes());
        f.parts[ground].transform.offset = DVec3::new(0.5, -0.0, 2.25);
        f.obj("thing.obj", MESH).transform.on_ground = mode;
        let upper = add(&mut f, "upper.tif", raster(4, true).bytes());
        f.parts[upper].transform.on_ground = mode;
        f.parts[upper].transform.offset = DVec3::new(2.0, 1.0, 100.0);
        check(&mut f, 2);
        assert!(load(&mut f, false).0.geometry.fields[1].grid().raise != 0.0);
    }
}

#[test]
fn materials_of_rasters_are_replaced() {
    let change = |replaced| MaterialChange {
        replaced,
        material: MaterialDefinition { classification: 9, ..MaterialDefinition::new("new") },
    };
    for (replaced, fields) in [
        (Replaced::All, 1),
        (Replaced::Named("g".to_owned()), 1),
        (Replaced::Named("other".to_owned()), 1),
        (Replaced::Faces(vec![0, 5, 6]), 0),
    ] {
        let mut f = Fixture::new();
        let part = add(&mut f, "dem.tif", raster(1, true).bytes());
        f.parts[part].changes = vec![change(replaced)].into();
        check(&mut f, fields);
    }
}

#[test]
fn rasters_that_are_turned_and_scaled_are_their_triangles() {
    let rotations =
        [Rotation::IDENTITY, Rotation::about_z(0.3), Rotation::about(DVec3::new(1.0, 0.4, 2.0), 0.5)];
    for (rotation, scale, has_holes) in
        rotations.into_iter().flat_map(|r| [(r, 1.0, true), (r, 1.5, false), (r, -0.5, true)])
    {
        let mut f = Fixture::new();
        let part = add(&mut f, "dem.tif", raster(1, has_holes).bytes());
        let transform = &mut f.parts[part].transform;
        (transform.rotation, transform.scale) = (rotation, scale);
        transform.offset = DVec3::new(3.0, -2.0, 1.25);
        // Stands on it.
        f.obj("thing.obj", MESH).transform.on_ground = -1;
        let upper = add(&mut f, "upper.tif", raster(4, true).bytes());
        f.parts[upper].transform.rotation = rotation;
        f.parts[upper].transform.on_ground = 1;
        check(&mut f, 2);
    }
}

#[test]
fn rasters_that_move_are_stored() {
    let mut f = Fixture::new();
    let part = add(&mut f, "dem.tif", raster(1, true).bytes());
    f.obj("thing.obj", MESH);
    f.parts[part].motions =
        vec![MotionSequence { id: "m".to_owned(), loops: 0, next: None, motions: Vec::new() }];
    let ((one, _), (other, _)) = (load(&mut f, false), load(&mut f, true));
    assert!(one.geometry.fields.is_empty());
    assert_eq!(one.geometry.vertices, other.geometry.vertices);
}

#[test]
fn a_raster_without_data_is_left_out() {
    let mut f = Fixture::new();
    let nothing = vec![NO_DATA; (COLUMNS * ROWS) as usize];
    add(&mut f, "none.tif", TiffFile::new(COLUMNS, &nothing).with(42_113, Values::Text("-9999")).bytes());
    f.obj("thing.obj", MESH);
    let ((one, reported), (other, expected)) = (load(&mut f, false), load(&mut f, true));
    assert_eq!(
        (reported, one.primitives(), one.parts.len()),
        (expected, other.primitives(), other.parts.len())
    );
    assert!(one.geometry.fields.is_empty());
}
