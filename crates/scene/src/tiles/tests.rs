use super::*;
use crate::builder::{LoadOptions, Sharing};
use crate::fixture::{Fixture, report};
use crate::{Inventory, MaterialArea, Pack, PartFacts, pack};
use std::fmt::Write as _;
use vlscan_survey::{Loader, MaterialChoice, MeshReading, MotionSequence, XyzLoader};
use vlscan_trace::BuildOptions;

fn options(memory: u64) -> Option<TileOptions> {
    Some(TileOptions { memory, trees: BuildOptions::default() })
}

/// A square of `cells` × `cells` cells of one metre with its lower left corner at (x, y), in two materials;
/// neighbours share their border.
fn square(x: f64, y: f64, cells: usize) -> String {
    let mut text = "mtllib site.mtl\n".to_owned();
    for j in 0..=cells {
        for i in 0..=cells {
            let (px, py) = (x + i as f64, y + j as f64);
            writeln!(text, "v {px} {py} {}", (px * 0.7).sin() + (py * 0.4).cos()).unwrap();
        }
    }
    for j in 0..cells {
        writeln!(text, "usemtl {}", ["soil", "grass"][j % 2]).unwrap();
        for i in 0..cells {
            let a = j * (cells + 1) + i + 1;
            writeln!(text, "f {} {} {} {}", a, a + 1, a + cells + 2, a + cells + 1).unwrap();
        }
    }
    text
}

fn cloud(f: &mut Fixture, name: &str, x: f64) {
    let points: String =
        (0..60).map(|i| format!("{} {} {}\n", x + 0.7 * f64::from(i % 8), i % 7, 2 + i % 3)).collect();
    let files = vec![f.file(name, points)];
    f.part(Loader::Xyz(Box::new(XyzLoader {
        files,
        separator: " ".to_owned(),
        voxel_size: 0.5,
        max_color_value: 0.0,
        default_normal: None,
        rgb_columns: None,
        normal_columns: None,
        snap_neighbor_normal: false,
        estimate_normals: 0,
        material: MaterialChoice::default(),
    })));
}

/// A scene of tiles beside a part that moves, a part that is an instance, and clouds.
fn site() -> Fixture {
    let mut f = Fixture::new();
    f.file(
        "site.mtl",
        "newmtl soil\nhelios_reflectance 0.3\nhelios_isGround true\nhelios_classification 2\n\
         newmtl grass\nhelios_reflectance 0.4\nhelios_classification 3\n",
    );
    f.obj("a.obj", square(0.0, 0.0, 8));
    cloud(&mut f, "a.xyz", 1.0);
    f.obj("m.obj", square(3.0, 3.0, 4)).motions =
        vec![MotionSequence { id: "m".to_owned(), loops: 1, next: None, motions: Vec::new() }];
    f.obj("b.obj", square(8.0, 0.0, 8));
    cloud(&mut f, "b.xyz", 9.0);
    // The same place as the first one: its triangles never win.
    f.obj("c.obj", square(0.0, 0.0, 8));
    f.obj("d.obj", square(16.0, 0.0, 8)).transform.offset = DVec3::new(0.0, 0.0, 0.25);
    let files = vec![f.file("e.obj", square(0.0, 8.0, 3)), f.file("f.obj", square(3.0, 8.0, 3))];
    f.part(Loader::MeshFiles { files, reading: MeshReading::default() }).id = Some("pair".to_owned());
    f.obj("g.obj", square(0.0, 8.0, 3));
    f
}

fn rays() -> impl Iterator<Item = (DVec3, DVec3)> {
    let mut state = 1u64;
    let mut random = move || {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 11) as f64 / (1u64 << 53) as f64
    };
    (0..400).map(move |i| {
        let from = DVec3::new(random() * 30.0 - 3.0, random() * 12.0 - 2.0, 6.0);
        // Along edges and through corners, too.
        let from = if i % 3 == 0 { from.round() } else { from };
        let aside = if i % 2 == 0 { 0.0 } else { 0.4 };
        (from, DVec3::new(random() - 0.5, random() - 0.5, 0.0) * aside - DVec3::Z)
    })
}

#[test]
fn tiles_are_hit_as_if_they_were_stored() {
    let mut f = site();
    let stored = f.load().unwrap().0;
    let flat_tree = Tree::build(&stored.geometry, &BuildOptions::default());
    let (all, instances) = (Sharing::Never, Sharing::Always);
    let (mut peak, plenty) = (0, 1 << 30);
    for (is_short, sharing, count) in [(false, all, 8), (true, all, 8), (false, instances, 3)] {
        let memory = if is_short { peak * 6 / 10 } else { plenty };
        f.options.tiles = options(memory);
        f.options.sharing = sharing;
        let scene = f.load().unwrap().0;
        let tiles = scene.tiles.clone().expect("tiles");
        assert_eq!(tiles.facts().len(), count);
        assert_eq!((scene.shift, scene.bounds), (stored.shift, stored.bounds));
        assert_eq!((&scene.parts, &scene.materials), (&stored.parts, &stored.materials));
        assert_eq!((scene.primitives(), scene.sizes()), (stored.primitives(), stored.sizes()));
        let options = BuildOptions::default();
        let tree = Tree::build(&scene.geometry, &options);
        let tree = match &scene.instances {
            Some(set) => tree.with_instances(&set.instances, &options),
            None => tree,
        };
        let mut reader = TileReader::new(&tiles);
        let mut hits = 0;
        for (from, direction) in rays() {
            let (from, direction) = (stored.to_local(from), direction.normalize());
            let expected = flat_tree.nearest_where(&stored.geometry, from, direction, |_| true);
            let found = scene.nearest_where(&tree, from, direction, |_, _| true);
            let order = |hit: Hit| (hit.t.to_bits(), scene.number_when_stored(hit.primitive));
            assert_eq!(found.map(order), expected.map(|hit| (hit.t.to_bits(), hit.primitive)));
            let Some((found, expected)) = found.zip(expected) else { continue };
            hits += 1;
            let surface = stored.surface(expected.primitive);
            let (part, material) = match reader.locate(found.primitive) {
                None => (scene.part_of(found.primitive), scene.material_of(found.primitive)),
                Some((facts, tile, local)) => {
                    assert_eq!(tile.scene.triangle(local), stored.triangle(expected.primitive));
                    assert_eq!(tile.scene.voxel(local), stored.voxel(expected.primitive));
                    let material = tile.scene.surface(local).material;
                    assert_eq!(
                        scene.materials[facts.materials[material as usize] as usize],
                        tile.scene.materials[material as usize]
                    );
                    (facts.part, tile.scene.material_of(local))
                }
            };
            assert_eq!(part, surface.part);
            assert_eq!(material, &stored.materials[surface.material as usize]);
            reader.release().unwrap();
        }
        assert!(hits > 200, "{hits}");
        for (x, y) in [(1.3, 2.2), (12.0, 4.0), (20.5, 7.9), (-9.0, 0.0)] {
            let p = stored.to_local(DVec3::new(x, y, 0.0));
            let heights = [&stored, &scene].map(|s| s.ground_height(p.x, p.y).map(f64::to_bits));
            assert_eq!(heights[0], heights[1], "{x} {y}");
        }
        tiles.check().unwrap();
        let s = tiles.statistics();
        assert!(s.peak <= memory && (s.dropped > 0) == is_short, "{s:?}");
        peak = s.peak;
    }
}

/// Packs a site as tiles.
fn packed(f: &Fixture) -> std::path::PathBuf {
    let path = f.path().join("site.vlscene");
    pack(&f.recipe(), &f.options, &BuildOptions::default(), &path, &|_| Ok(())).unwrap();
    path
}

#[test]
fn packed_tiles_are_those_of_their_files() {
    let mut f = site();
    f.options.tiles = options(1 << 30);
    for sharing in [Sharing::Never, Sharing::Always] {
        f.options.sharing = sharing;
        let scene = f.load().unwrap().0;
        let pack = Pack::open(&packed(&f)).unwrap();
        pack.verify().unwrap();
        assert!(pack.has_tiles(0));
        let tree = scene.tree(&BuildOptions::default());
        let facts = |scene: &Scene| {
            let facts = scene.tiles.as_ref().expect("tiles").facts().iter();
            format!("{:?}", facts.map(|of| TileFacts { bytes: 0, ..of.clone() }).collect::<Vec<_>>())
        };
        let all = pack.scene(&f.options, 0).unwrap().tiles.unwrap().bytes();
        for tiles in [None, options(1 << 30), options(all * 9 / 10)] {
            let again = pack.scene(&LoadOptions { tiles, ..f.options.clone() }, 0).unwrap();
            assert_eq!(facts(&again), facts(&scene));
            assert_eq!((again.sizes(), again.primitives()), (scene.sizes(), scene.primitives()));
            let own_tree = again.tree(&BuildOptions::default());
            for (from, direction) in rays() {
                let (from, direction) = (scene.to_local(from), direction.normalize());
                let hit = |scene: &Scene, tree: &Tree| {
                    let hit = scene.nearest_where(tree, from, direction, |_, _| true);
                    hit.map(|hit| (hit.t.to_bits(), hit.primitive, scene.number_when_stored(hit.primitive)))
                };
                assert_eq!(hit(&again, &own_tree), hit(&scene, &tree));
            }
            again.tiles.as_ref().unwrap().check().unwrap();
        }
        if sharing == Sharing::Never {
            let whole = LoadOptions { max_memory: Some(all), tiles: None, ..f.options.clone() };
            let error = report(&pack.scene(&whole, 0).unwrap_err());
            assert!(error.contains("with all tiles") && error.contains("--scene-memory"), "{error}");
        }
    }
}

#[test]
fn a_packed_tile_that_is_damaged_is_told_with_its_file() {
    let mut f = site();
    f.options.tiles = options(1 << 30);
    let path = packed(&f);
    let scene = Pack::open(&path).unwrap().scene(&f.options, 0).unwrap();
    // The arrays of tiles are in the middle of the file.
    let mut bytes = std::fs::read(&path).unwrap();
    let middle = bytes.len() / 4..bytes.len() / 2;
    bytes[middle].fill(0x55);
    std::fs::write(&path, bytes).unwrap();
    let mut reader = TileReader::new(scene.tiles.as_ref().unwrap());
    let damaged = (0..reader.facts().len()).filter_map(|tile| {
        let is_read = reader.get(tile).is_some();
        let error = reader.release().err().map(|error| report(&error));
        assert_eq!(is_read, error.is_none());
        error
    });
    let damaged: Vec<String> = damaged.collect();
    assert!(!damaged.is_empty());
    for error in damaged {
        assert!(error.contains("site.vlscene") && error.contains("damaged"), "{error}");
    }
    assert!(Pack::open(&path).unwrap().verify().is_err());
}

#[test]
fn tiles_are_counted_as_if_they_were_stored() {
    let mut f = site();
    let stored = f.load().unwrap().0;
    for sharing in [Sharing::Never, Sharing::Always] {
        f.options.sharing = sharing;
        f.options.tiles = None;
        let whole = Inventory::of(&f.load().unwrap().0);
        f.options.tiles = options(1 << 30);
        let scene = f.load().unwrap().0;
        let all = Inventory::of(&scene);
        assert_eq!(
            (all.primitives(), &all.of_part, &all.of_material),
            (whole.primitives(), &whole.of_part, &whole.of_material)
        );
        assert_eq!((all.bounds, all.slivers), (whole.bounds, whole.slivers));
        let facts = PartFacts::of_scene(&scene);
        for (found, expected) in facts.iter().zip(PartFacts::of_scene(&stored)) {
            let is_near =
                |(a, b): (&MaterialArea, &MaterialArea)| (a.total() - b.total()).abs() <= 1e-9 * b.total();
            assert!(found.areas.iter().zip(&expected.areas).all(is_near), "{found:?} {expected:?}");
            assert_eq!(*found, PartFacts { areas: found.areas.clone(), ..expected });
        }
        assert_eq!(facts.len(), stored.parts.len());
    }
}

#[test]
fn numbers_are_those_of_the_stored_scene() {
    let mut f = site();
    let stored = f.load().unwrap().0;
    f.options.tiles = options(1 << 30);
    let scene = f.load().unwrap().0;
    let end = (scene.numbers() + scene.tiles.as_ref().unwrap().primitives()) as u32;
    let mut numbers: Vec<u32> = (0..end).map(|i| scene.number_when_stored(i)).collect();
    numbers.sort_unstable();
    assert_eq!(numbers, (0..stored.primitives() as u32).collect::<Vec<_>>());
}

#[test]
fn a_tile_that_was_changed_or_damaged_is_told_with_its_file() {
    let mut f = site();
    f.options.tiles = options(1 << 30);
    let scene = f.load().unwrap().0;
    f.file("b.obj", square(8.0, 0.5, 8));
    f.file("d.obj", "v 0 0 nonsense\n");
    let mut reader = TileReader::new(scene.tiles.as_ref().unwrap());
    let mut error = |part: u32| {
        let tile = reader.facts().iter().position(|tile| tile.part == part).unwrap();
        assert!(reader.get(tile).is_none());
        report(&reader.release().unwrap_err())
    };
    let changed = error(3);
    assert!(changed.contains("b.obj") && changed.contains("has changed since"), "{changed}");
    let damaged = error(6);
    assert!(damaged.contains("d.obj") && damaged.contains("nonsense"), "{damaged}");
    assert!(reader.get(0).is_some());
    reader.release().unwrap();
}

#[test]
fn too_little_memory_for_one_place_is_told_with_what_it_needs() {
    let mut f = site();
    f.options.tiles = options(1000);
    let scene = f.load().unwrap().0;
    let mut reader = TileReader::new(scene.tiles.as_ref().unwrap());
    assert!(reader.get(0).is_none() && reader.is_over_budget());
    let error = report(&reader.release().unwrap_err());
    assert!(
        error.contains("--scene-memory is 1.00 kB") && error.contains("give --scene-memory more than"),
        "{error}"
    );
}

#[test]
fn parts_that_stay_in_memory_are_told_where_they_are_large() {
    let mut f = site();
    f.options.tiles = options(1 << 30);
    let reported = |f: &Fixture| f.load().unwrap().1.text();
    assert!(!reported(&f).contains("--scene-memory"));
    // The part that moves.
    f.options.tiles = options(100);
    let said = reported(&f);
    assert!(
        said.contains("--scene-memory is 100 B, but parts that cannot be tiles") && said.contains("\"2\""),
        "{said}"
    );
}

#[test]
fn parts_that_are_dropped_to_the_ground_need_the_scene_in_memory() {
    let mut f = site();
    f.obj("tree.obj", square(2.0, 2.0, 1)).transform.on_ground = 1;
    f.options.tiles = options(1 << 30);
    let error = f.error();
    assert!(error.contains("is dropped to the ground") && error.contains("scene.xml:19"), "{error}");
}
