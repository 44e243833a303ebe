//! Colours of rasters: of their material, and of a texture that covers them.

use super::tests::TiffFile;
use crate::fixture::Fixture;
use crate::texture::tests::png_of;
use crate::{Pack, Scene, TileOptions, TileReader, pack};
use vlscan_geom::DVec3;
use vlscan_survey::{Loader, MaterialChoice, RasterFiles};
use vlscan_trace::BuildOptions;

const COLUMNS: usize = 13;
const ROWS: usize = 9;

/// Hills of pixels of 2 m by 4 m at (100, 50) with a material.
fn terrain(material: &str) -> Fixture {
    let mut f = Fixture::new();
    f.options.colours = true;
    let heights: Vec<f32> = (0..COLUMNS * ROWS).map(|i| ((i * 5) % 11) as f32 * 0.37).collect();
    let files = vec![f.file("a.tif", TiffFile::new(COLUMNS as u32, &heights).bytes())];
    let file = f.file("g.mtl", format!("newmtl g\nhelios_reflectance 0.4\n{material}"));
    let material = MaterialChoice { file: Some(file), ..MaterialChoice::default() };
    f.part(Loader::GeoTiff { files: RasterFiles::Tiles(files), material });
    f
}

/// The colours at the corners of the triangles of a scene, each with its position in the world.
fn corners(scene: &Scene) -> Vec<(DVec3, [u8; 3])> {
    let mut found = Vec::new();
    for i in 0..scene.primitives() as u32 {
        let Some(corners) = scene.triangle(i) else { continue };
        found.extend(corners.map(|at| (scene.to_world(at), scene.colour_at(i, Some(corners), at))));
    }
    found
}

#[test]
fn a_texture_covers_all_pixels_of_a_raster() {
    let mut f = terrain("Kd 1 1 1\nmap_Kd t.png\n");
    let texel = |column: usize, row: usize| [7 + 11 * column as u8, 3 + 17 * row as u8, 99];
    let texels: Vec<u8> = (0..COLUMNS * ROWS).flat_map(|i| texel(i % COLUMNS, i / COLUMNS)).collect();
    f.file("t.png", png_of(COLUMNS as u32, ROWS as u32, &texels));
    let tiles = TileOptions { memory: 1 << 30, trees: BuildOptions::default() };
    for (triangulated, tiles) in [(false, None), (true, None), (false, Some(tiles))] {
        f.options.triangulate_rasters = triangulated;
        f.options.tiles = tiles;
        let scene = f.load().unwrap().0;
        let found = corners(&scene);
        assert_eq!(found.len(), 6 * (COLUMNS - 1) * (ROWS - 1));
        for (at, colour) in found {
            let (column, row) = ((at.x - 100.0) / 2.0, (50.0 - at.y) / 4.0);
            assert_eq!(colour, texel(column as usize, row as usize), "{triangulated} {at:?}");
        }
    }
}

#[test]
fn rasters_have_the_colour_of_their_material_in_memory_in_pages_and_packed() {
    let mut f = terrain("Kd 1 0.5 0\n");
    let expected = [255, 128, 0];
    let are_expected = |scene: &Scene| {
        let found = corners(scene);
        assert!(!found.is_empty() && found.iter().all(|(_, colour)| *colour == expected), "{found:?}");
    };
    are_expected(&f.load().unwrap().0);
    f.options.tiles = Some(TileOptions { memory: 1 << 30, trees: BuildOptions::default() });
    let path = f.path().join("s.vlscene");
    pack(&f.recipe(), &f.options, &BuildOptions::default(), &path, &|_| Ok(())).unwrap();
    let packed = Pack::open(&path).unwrap();
    packed.verify().unwrap();
    for scene in [f.load().unwrap().0, packed.scene(&f.options, 0).unwrap()] {
        let tiles = scene.tiles.as_ref().expect("pages");
        let mut reader = TileReader::new(tiles);
        for i in 0..tiles.facts().len() {
            are_expected(&reader.get(i).unwrap().scene);
        }
        reader.release().unwrap();
    }
    f.options.colours = false;
    assert!(corners(&f.load().unwrap().0).iter().all(|(_, colour)| *colour == [0; 3]));
}
