//! Rasters that are in memory page by page are the rasters in memory.

use super::tests::{TiffFile, Values};
use crate::fixture::{Fixture, report};
use crate::{Pack, Scene, TileOptions, TileReader, pack};
use std::path::PathBuf;
use vlscan_geom::{DVec3, Rotation};
use vlscan_survey::{Loader, MaterialChoice, RasterFiles};
use vlscan_trace::{BuildOptions, Hit, Tree};

const COLUMNS: usize = 23;
const ROWS: usize = 14;
const MESH: &str = "v 104 30 0\nv 112 30 0\nv 104 22 6\nv 112 40 3\nf 1 2 3\nf 1 2 4\nf 2 3 4\n";

/// Hills, with holes or without, whose first column is `first` of a larger terrain.
fn tile(first: usize, has_holes: bool) -> TiffFile {
    let height = |i: usize| {
        let (x, y) = (first + i % COLUMNS, i / COLUMNS);
        match has_holes && (x * 7 + y * 13 + x * y) % 19 == 3 {
            true => -9999.0,
            false => ((x * 5 + y * 3) % 11) as f32 * 0.37,
        }
    };
    let heights: Vec<f32> = (0..COLUMNS * ROWS).map(height).collect();
    let place = vec![0.0, 0.0, 0.0, 100.0 + 2.0 * first as f64, 50.0, 0.0];
    // Strips of three rows.
    let mut file = TiffFile::new(COLUMNS as u32, &heights)
        .with(42_113, Values::Text("-9999"))
        .with(33_922, Values::Double(place))
        .with(278, Values::Long(vec![3]));
    file.blocks = file.blocks[0].chunks(3 * COLUMNS * 4).map(<[u8]>::to_vec).collect();
    file
}

fn terrain(f: &mut Fixture, files: Vec<PathBuf>) -> &mut vlscan_survey::PartRecipe {
    let material = f.file("g.mtl", "newmtl g\nhelios_isGround true\nhelios_reflectance 0.4\n");
    let material = MaterialChoice { file: Some(material), ..MaterialChoice::default() };
    f.part(Loader::GeoTiff { files: RasterFiles::Tiles(files), material })
}

fn site(has_holes: bool, is_turned: bool) -> Fixture {
    let mut f = Fixture::new();
    f.obj("m.obj", MESH);
    let files =
        vec![f.file("a.tif", tile(0, has_holes).bytes()), f.file("b.tif", tile(COLUMNS, has_holes).bytes())];
    terrain(&mut f, files);
    f.obj("n.obj", MESH).transform.offset = DVec3::new(1.0, 1.0, 0.5);
    let files = vec![f.file("c.tif", tile(3, has_holes).bytes())];
    let transform = &mut terrain(&mut f, files).transform;
    transform.offset = DVec3::new(-3.0, 4.5, 2.5);
    if is_turned {
        let rotation = Rotation::about_z(0.2).after(Rotation::about(DVec3::new(1.0, 2.0, 0.0), 0.3));
        (transform.rotation, transform.scale) = (rotation, 0.9);
    }
    f
}

fn paged(f: &mut Fixture, memory: u64) -> Scene {
    f.options.tiles = Some(TileOptions { memory, trees: BuildOptions::default() });
    let scene = f.load().unwrap_or_else(|e| panic!("{}", report(&e))).0;
    f.options.tiles = None;
    scene
}

/// The scene that is packed and loaded with this memory.
fn packed(f: &mut Fixture, memory: u64) -> Scene {
    let path = f.path().join("site.vlscene");
    f.options.tiles = Some(TileOptions { memory, trees: BuildOptions::default() });
    pack(&f.recipe(), &f.options, &BuildOptions::default(), &path, &|_| Ok(())).unwrap();
    let pack = Pack::open(&path).unwrap();
    pack.verify().unwrap();
    let scene = pack.scene(&f.options, 0).unwrap_or_else(|e| panic!("{}", report(&e)));
    f.options.tiles = None;
    scene
}

#[test]
fn pages_are_hit_as_the_raster_in_memory() {
    for (has_holes, is_turned) in [(false, false), (true, false), (true, true)] {
        let mut f = site(has_holes, is_turned);
        let whole = f.load().unwrap().0;
        let tree = Tree::build(&whole.geometry, &BuildOptions::default());
        let mut peak = 0;
        for (is_short, is_packed) in [(false, false), (true, false), (false, true), (true, true)] {
            let memory = if is_short { peak * 7 / 10 } else { 1 << 30 };
            let scene = if is_packed { packed(&mut f, memory) } else { paged(&mut f, memory) };
            let tiles = scene.tiles.clone().unwrap();
            assert!(tiles.facts().len() > 15 && scene.geometry.is_empty(), "{}", tiles.facts().len());
            assert_eq!(
                (scene.shift, scene.bounds, scene.sizes()),
                (whole.shift, whole.bounds, whole.sizes())
            );
            assert_eq!((scene.primitives(), &scene.parts), (whole.primitives(), &whole.parts));
            let (own_tree, size) =
                (Tree::build(&scene.geometry, &BuildOptions::default()), scene.bounds.size());
            let mut reader = TileReader::new(&tiles);
            let mut hits = 0;
            for i in 0..3000 {
                let (a, b) = (f64::from(i % 60) / 59.0, f64::from(i / 60) / 49.0);
                let mut from = scene.bounds.min + DVec3::new(a * size.x, b * size.y, size.z + 5.0);
                if i % 3 == 0 {
                    // Through corners and along edges.
                    from = scene.to_local(scene.to_world(from).round());
                }
                let aside = if i % 2 == 0 { 0.0 } else { 0.5 };
                let direction = DVec3::new((a - 0.5) * aside, (b - 0.3) * aside, -1.0).normalize();
                let expected = tree.nearest_where(&whole.geometry, from, direction, |_| true);
                let found = scene.nearest_where(&own_tree, from, direction, |_, _| true);
                let of = |scene: &Scene, hit: Hit| (hit.t.to_bits(), scene.number_when_stored(hit.primitive));
                assert_eq!(found.map(|hit| of(&scene, hit)), expected.map(|hit| of(&whole, hit)));
                let Some((found, expected)) = found.zip(expected) else { continue };
                hits += 1;
                let (facts, tile, local) = reader.locate(found.primitive).unwrap();
                assert_eq!(tile.scene.triangle(local), whole.triangle(expected.primitive));
                let surface = whole.surface(expected.primitive);
                assert_eq!((facts.part, facts.materials[0]), (surface.part, surface.material));
                assert_eq!(reader.number_when_stored(&scene, found.primitive), of(&whole, expected).1);
                reader.release().unwrap();
            }
            assert!(hits > 1500, "{hits}");
            for i in 0..200 {
                let place = scene.bounds.min
                    + size * DVec3::new(f64::from(i % 20) / 19.0, f64::from(i / 20) / 9.0, 0.0);
                assert_eq!(scene.ground_height(place.x, place.y), whole.ground_height(place.x, place.y));
            }
            tiles.check().unwrap();
            let statistics = tiles.statistics();
            assert_eq!(statistics.dropped > 0, is_short, "{statistics:?}");
            peak = peak.max(statistics.peak);
        }
    }
}

#[test]
fn triangles_of_pages_have_the_numbers_of_the_raster() {
    let mut f = site(true, false);
    let scene = paged(&mut f, 1 << 30);
    let tiles = scene.tiles.clone().unwrap();
    let mut reader = TileReader::new(&tiles);
    let mut numbers = Vec::new();
    for (index, facts) in tiles.facts().iter().enumerate() {
        let tile = reader.get(index).unwrap();
        let there = (0..facts.triangles).filter(|local| tile.scene.triangle(*local).is_some());
        numbers.extend(there.map(|local| reader.number_when_stored(&scene, facts.first + local)));
    }
    reader.release().unwrap();
    numbers.sort_unstable();
    assert_eq!(numbers, (0..scene.primitives() as u32).collect::<Vec<_>>());
}

#[test]
fn files_that_change_or_are_damaged_are_told_when_a_page_is_read() {
    let mut f = site(false, false);
    let scene = paged(&mut f, 1 << 30);
    let tiles = scene.tiles.clone().unwrap();
    let bytes = tile(COLUMNS, false).bytes();
    f.file("b.tif", &bytes[..bytes.len() / 2]);
    let mut reader = TileReader::new(&tiles);
    let last = tiles.facts().iter().rposition(|tile| tile.part == 1).unwrap();
    assert!(reader.get(last).is_none());
    let error = report(&reader.release().unwrap_err());
    assert!(error.contains("b.tif") && error.contains("another program changed it"), "{error}");
}
