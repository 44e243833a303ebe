//! Tests of complete rasters, written byte by byte and read as stored triangles.

use crate::fixture::{Fixture, report};
use crate::{Material, Scene};
use proptest::prelude::*;
use tiff::encoder::{Compression, TiffEncoder, colortype};
use tiff::tags::Tag;
use vlscan_geom::{Aabb, DVec3};
use vlscan_survey::{Loader, MaterialChoice};

/// A little-endian TIFF of one directory: tags with their values, and blocks of pixels.
pub(super) struct TiffFile {
    tags: Vec<(u16, Values)>,
    pub blocks: Vec<Vec<u8>>,
    tiled: bool,
}

pub(super) enum Values {
    Short(Vec<u16>),
    Long(Vec<u32>),
    Double(Vec<f64>),
    Text(&'static str),
}

impl TiffFile {
    /// Single-band floats in one strip at (100, 50), pixels of 2 m × 4 m.
    pub fn new(width: u32, heights: &[f32]) -> TiffFile {
        let rows = heights.len() as u32 / width;
        let tags = vec![
            (256, Values::Long(vec![width])),
            (257, Values::Long(vec![rows])),
            (258, Values::Short(vec![32])),
            (259, Values::Short(vec![1])),
            (262, Values::Short(vec![1])),
            (277, Values::Short(vec![1])),
            (278, Values::Long(vec![rows])),
            (339, Values::Short(vec![3])),
            (33550, Values::Double(vec![2.0, 4.0, 0.0])),
            (33922, Values::Double(vec![0.0, 0.0, 0.0, 100.0, 50.0, 0.0])),
        ];
        TiffFile { tags, blocks: vec![heights.iter().flat_map(|h| h.to_le_bytes()).collect()], tiled: false }
    }

    pub fn with(mut self, tag: u16, values: Values) -> TiffFile {
        self.tags.retain(|t| t.0 != tag);
        self.tags.push((tag, values));
        self
    }

    fn without(mut self, tag: u16) -> TiffFile {
        self.tags.retain(|t| t.0 != tag);
        self
    }

    pub fn bytes(mut self) -> Vec<u8> {
        let mut out = b"II\x2a\0\0\0\0\0".to_vec();
        let mut offsets = Vec::new();
        for block in &self.blocks {
            offsets.push(if block.is_empty() { 0 } else { out.len() as u32 });
            out.extend(block);
        }
        let counts = self.blocks.iter().map(|b| b.len() as u32).collect();
        let (offset_tag, count_tag) = if self.tiled { (324, 325) } else { (273, 279) };
        self.tags.push((offset_tag, Values::Long(offsets)));
        self.tags.push((count_tag, Values::Long(counts)));
        self.tags.sort_by_key(|t| t.0);
        let mut entries = Vec::new();
        for (tag, values) in &self.tags {
            let (kind, count, data): (u16, usize, Vec<u8>) = match values {
                Values::Short(v) => (3, v.len(), v.iter().flat_map(|v| v.to_le_bytes()).collect()),
                Values::Long(v) => (4, v.len(), v.iter().flat_map(|v| v.to_le_bytes()).collect()),
                Values::Double(v) => (12, v.len(), v.iter().flat_map(|v| v.to_le_bytes()).collect()),
                Values::Text(t) => (2, t.len() + 1, t.bytes().chain([0]).collect()),
            };
            entries.extend(tag.to_le_bytes());
            entries.extend(kind.to_le_bytes());
            entries.extend((count as u32).to_le_bytes());
            if data.len() <= 4 {
                entries.extend(data.iter().chain(&[0; 4]).take(4));
            } else {
                entries.extend((out.len() as u32).to_le_bytes());
                out.extend(data);
            }
        }
        let directory = out.len() as u32;
        out[4..8].copy_from_slice(&directory.to_le_bytes());
        out.extend((self.tags.len() as u16).to_le_bytes());
        out.extend(entries);
        out.extend([0; 4]);
        out
    }
}

fn fixture(bytes: Vec<u8>) -> Fixture {
    fixture_named("dem.tif", bytes)
}

fn fixture_named(name: &str, bytes: Vec<u8>) -> Fixture {
    let mut f = Fixture::new();
    f.options.triangulate_rasters = true;
    let file = f.file(name, bytes);
    f.part(Loader::GeoTiff { files: file.into(), material: MaterialChoice::default() });
    f
}

/// World coordinates of all vertices used by triangles, and the triangles.
fn mesh(scene: &Scene) -> (Vec<DVec3>, &[[u32; 3]]) {
    (scene.geometry.vertices.iter().map(|v| scene.to_world(*v)).collect(), &scene.geometry.triangles)
}

const HEIGHTS: [f32; 6] = [10.0, 11.0, 12.0, 20.0, 21.0, 22.0];

#[test]
fn vertices_lie_at_pixel_centres_and_blocks_are_cut_as_the_reference_cuts_them() {
    let scene = fixture(TiffFile::new(3, &HEIGHTS).bytes()).scene();
    let (vertices, triangles) = mesh(&scene);
    assert_eq!(vertices[0], DVec3::new(101.0, 48.0, 10.0));
    assert_eq!(vertices[5], DVec3::new(105.0, 44.0, 22.0));
    assert_eq!(triangles, [[0, 3, 1], [3, 4, 1], [1, 4, 2], [4, 5, 2]]);
    let half = DVec3::new(2.0, 2.0, 6.0);
    assert_eq!(scene.bounds, Aabb { min: -half, max: half });
    assert_eq!(*scene.material_of(0), Material::unnamed("default", Default::default()));
}

#[test]
fn pixel_is_point_moves_by_half_a_pixel() {
    let keys = Values::Short(vec![1, 1, 0, 1, 1025, 0, 1, 2]);
    let scene = fixture(TiffFile::new(3, &HEIGHTS).with(34735, keys).bytes()).scene();
    assert_eq!(mesh(&scene).0[0], DVec3::new(100.0, 50.0, 10.0));
}

#[test]
fn transformations_may_turn_rasters_and_have_south_above() {
    let mut m = vec![0.0; 16];
    (m[0], m[3], m[5], m[7]) = (2.0, 100.0, 4.0, 50.0);
    let south_up = TiffFile::new(3, &HEIGHTS).without(33550).with(34264, Values::Double(m.clone()));
    assert_eq!(mesh(&fixture(south_up.bytes()).scene()).0[5], DVec3::new(105.0, 56.0, 22.0));
    // A quarter turn: rows run to the north, columns to the west.
    (m[0], m[1], m[4], m[5]) = (0.0, -2.0, 4.0, 0.0);
    let turned = TiffFile::new(3, &HEIGHTS).with(34264, Values::Double(m.clone()));
    let scene = fixture(turned.bytes()).scene();
    let expected = [[99.0, 52.0, 10.0], [99.0, 56.0, 11.0], [99.0, 60.0, 12.0], [97.0, 52.0, 20.0]];
    assert_eq!(mesh(&scene).0[..4], expected.map(DVec3::from));
    (m[0], m[5]) = (1.0, -8.0);
    let without_area = TiffFile::new(3, &HEIGHTS).with(34264, Values::Double(m));
    assert!(fixture(without_area.bytes()).error().contains("pixel size"));
}

/// Loads a file with warnings, which must contain these texts.
fn warned(file: TiffFile, expected: &[&str]) -> Scene {
    let (scene, warnings) = fixture(file.bytes()).load().unwrap_or_else(|e| panic!("{}", report(&e)));
    let text = warnings.text();
    assert_eq!(warnings.items().len(), expected.len(), "{text}");
    expected.iter().for_each(|part| assert!(text.contains(part), "{part} is missing from {text}"));
    scene
}

/// GeoKeys of a projected raster with these keys.
fn geo_keys(keys: &[(u16, u16)]) -> Values {
    let head = [1, 1, 0, keys.len() as u16 + 1, 1024, 0, 1, 1];
    Values::Short(head.into_iter().chain(keys.iter().flat_map(|&(key, value)| [key, 0, 1, value])).collect())
}

#[test]
fn coordinates_in_feet_become_metres_with_a_warning() {
    let foot = 1200.0 / 3937.0;
    let near = |found: DVec3, expected: [f64; 3]| {
        assert!((found - DVec3::from(expected)).length() < 1e-9, "{found} is not {expected:?}");
    };
    for keys in [&[(3072, 2227)][..], &[(3072, 2227), (3076, 9003)], &[(3072, 32767), (3076, 9003)]] {
        let file = TiffFile::new(3, &HEIGHTS).with(34735, geo_keys(keys));
        let scene = warned(file, &["US survey f"]);
        near(mesh(&scene).0[0], [101.0 * foot, 48.0 * foot, 10.0 * foot]);
    }
    for (key, value, metres) in [(4096, 6360, foot), (4099, 9002, 0.3048)] {
        let file = TiffFile::new(3, &HEIGHTS).with(34735, geo_keys(&[(3072, 25832), (key, value)]));
        near(mesh(&warned(file, &["its heights are"])).0[0], [101.0, 48.0, 10.0 * metres]);
    }
    let both = TiffFile::new(3, &HEIGHTS).with(34735, geo_keys(&[(3072, 2227), (4099, 9001)]));
    near(mesh(&warned(both, &["its heights metres"])).0[0], [101.0 * foot, 48.0 * foot, 10.0]);
    let own = TiffFile::new(3, &HEIGHTS)
        .with(34736, Values::Double(vec![0.5]))
        .with(34735, Values::Short(vec![1, 1, 0, 3, 1024, 0, 1, 1, 3076, 0, 1, 32767, 3077, 34736, 1, 0]));
    near(mesh(&warned(own, &["units of 0.5 m"])).0[0], [50.5, 24.0, 5.0]);
    let esri = "ESRI PE String = PROJCS[\"mine\",GEOGCS[\"GCS\",UNIT[\"Degree\",0.0174532925199433]],UNIT[\"Foot_US\",\
                0.3048006096012192]],VERTCS[\"height\",UNIT[\"Meter\",1.0]]|";
    let by_citation =
        TiffFile::new(3, &HEIGHTS).with(34735, geo_keys(&[(3072, 32767)])).with(34737, Values::Text(esri));
    let scene = warned(by_citation, &["its coordinates are US survey feet, its heights metres"]);
    near(mesh(&scene).0[0], [101.0 * foot, 48.0 * foot, 10.0]);
    let unknown = TiffFile::new(3, &HEIGHTS).with(34735, geo_keys(&[(3076, 9999)]));
    warned(unknown, &["EPSG code 9999"]);
    let metres =
        TiffFile::new(3, &HEIGHTS).with(34735, geo_keys(&[(3072, 25832), (3076, 9001), (4099, 9001)]));
    warned(metres, &[]);
}

#[test]
fn units_of_a_prj_file_count_like_those_of_keys() {
    let foot = 0.304_800_609_601_219_2;
    let utm = vlscan_crs::wkt_of_epsg(25832).unwrap();
    let feet = "PROJCS[\"mine\",GEOGCS[\"GCS\",UNIT[\"Degree\",0.0174532925199433]],UNIT[\"Foot\",0.3048]]";
    let heights = format!("[\"h\",VERT_DATUM[\"d\",2005],UNIT[\"Foot_US\",{foot}]]");
    let grid = "ncols 3\nnrows 2\nxllcorner 100\nyllcorner 46\ncellsize 2\n10 11 12\n20 21 22\n";
    let files =
        [("dem.asc", grid.as_bytes().to_vec(), 49.0), ("dem.tif", TiffFile::new(3, &HEIGHTS).bytes(), 48.0)];
    for (prj, warning, scale) in [
        (feet.to_owned(), "its coordinates are feet, so are its heights", [0.3048; 3]),
        (format!("{feet},VERTCS{heights}"), "are feet, its heights US survey feet", [0.3048, 0.3048, foot]),
        (format!("{utm},VERTCS{heights}"), "its heights are US survey feet", [1.0, 1.0, foot]),
        (format!("COMPD_CS[\"both\",{utm},VERT_CS{heights}]"), "its heights are US", [1.0, 1.0, foot]),
        ("EPSG:2222".to_owned(), "its coordinates are feet", [0.3048; 3]),
    ] {
        for (name, bytes, y) in &files {
            let f = fixture_named(name, bytes.clone());
            f.file("dem.prj", prj.as_bytes());
            let (scene, warnings) = f.load().unwrap_or_else(|e| panic!("{}", report(&e)));
            assert!(warnings.text().contains(warning), "{name} {prj}: {}", warnings.text());
            let expected = DVec3::new(101.0, *y, 10.0) * DVec3::from(scale);
            let found = mesh(&scene).0[0];
            assert!((found - expected).length() < 1e-9, "{name} {prj}: {found} is not {expected}");
        }
    }
}

#[test]
fn units_of_ones_own_without_a_length_are_those_of_the_system_or_warned_of() {
    let foot = 1200.0 / 3937.0;
    let first = |file: TiffFile, expected: &[&str]| mesh(&warned(file, expected)).0[0];
    let keys = |keys: &[(u16, u16)]| TiffFile::new(3, &HEIGHTS).with(34735, geo_keys(keys));
    let by_system = first(keys(&[(3072, 2227), (3076, 32767)]), &["US survey feet"]);
    assert!((by_system.x - 101.0 * foot).abs() < 1e-9, "{by_system}");
    let esri = "PROJCS[\"mine\",GEOGCS[\"GCS\",UNIT[\"Degree\",0.0174532925199433]],UNIT[\"Foot\",0.3048]]|";
    let by_citation = keys(&[(3072, 32767), (3076, 32767)]).with(34737, Values::Text(esri));
    assert!((first(by_citation, &["its coordinates are feet"]).x - 101.0 * 0.3048).abs() < 1e-9);
    for (keys_of_file, problem) in [
        (&[(3072, 32767), (3076, 32767)][..], "its length (key 3077) is missing; it is taken as metres"),
        (&[(3076, 32767)], "its length (key 3077) is missing; it is taken as metres"),
        (&[(3072, 32767)], "(key 3076) is missing, and their system is user-defined; it is taken as metres"),
        (&[(3072, 1999)], "EPSG:1999, is not a built-in projected system; it is taken as metres"),
        (&[(3072, 25832), (4096, 32767)], "the unit of its heights (key 4099) is user-defined or missing"),
        (&[(3072, 25832), (4099, 32767)], "the unit of its heights (key 4099) is user-defined or missing"),
    ] {
        assert_eq!(first(keys(keys_of_file), &[problem]), DVec3::new(101.0, 48.0, 10.0));
    }
    // Heights whose unit is not known have that of the coordinates, and the message says so.
    let heights = keys(&[(3072, 2227), (4099, 32767)]);
    let z = first(
        heights,
        &["or missing, and so is their system; it is taken as US survey feet", "so are its heights"],
    )
    .z;
    assert!((z - 10.0 * foot).abs() < 1e-9, "{z}");
    for keys_of_file in
        [&[(4096, 5773)][..], &[(3072, 25832), (4096, 5103)], &[(3072, 25832), (4096, 5773), (4099, 32767)]]
    {
        first(keys(keys_of_file), &[]);
    }
}

#[test]
fn systems_of_depths_are_warned_of() {
    let keys = |keys: &[(u16, u16)]| TiffFile::new(3, &HEIGHTS).with(34735, geo_keys(keys));
    let depth =
        "are in a system of depths (EPSG:5715), whose numbers grow downwards, and are taken as heights";
    let scene = warned(keys(&[(3072, 25832), (4096, 5715)]), &[depth]);
    assert_eq!(mesh(&scene).0[0].z, 10.0, "not turned");
    let feet = ["a system of depths (EPSG:6358)", "its heights are US survey feet"];
    let scene = warned(keys(&[(3072, 25832), (4096, 6358)]), &feet);
    assert!((mesh(&scene).0[0].z - 12_000.0 / 3937.0).abs() < 1e-9);
    for (citation, warnings) in [
        (
            "VERTCS[\"Caspian\",VDATUM[\"V\"],PARAMETER[\"Direction\",-1.0],UNIT[\"Meter\",1.0]]|",
            &["(Caspian)"][..],
        ),
        ("VERTCS[\"NAVD_1988\",VDATUM[\"V\"],PARAMETER[\"Direction\",1.0],UNIT[\"Meter\",1.0]]|", &[]),
        ("VERT_CS[\"sea\",VERT_DATUM[\"V\",2005],UNIT[\"metre\",1],AXIS[\"Depth\",DOWN]]|", &["(sea)"]),
    ] {
        warned(keys(&[(3072, 25832), (4096, 32767)]).with(34737, Values::Text(citation)), warnings);
    }
}

#[test]
fn heights_are_scaled_as_their_metadata_says() {
    let metadata = "<GDALMetadata><Item name=\"SCALE\" sample=\"0\" role=\"scale\">0.1</Item>\
        <Item name=\"OFFSET\" sample=\"0\" role=\"offset\">5</Item><Item sample=\"1\" role=\"scale\">9</Item></GDALMetadata>";
    let file = TiffFile::new(3, &HEIGHTS).with(42112, Values::Text(metadata));
    assert_eq!(mesh(&warned(file, &["times 0.1 plus 5"])).0[0].z, 6.0);
    let feet = "<GDALMetadata><Item name=\"UNITTYPE\" sample=\"0\" role=\"unittype\">US survey foot</Item></GDALMetadata>";
    let file = TiffFile::new(3, &HEIGHTS).with(42112, Values::Text(feet));
    assert!((mesh(&warned(file, &["US survey feet"])).0[0].z - 12_000.0 / 3937.0).abs() < 1e-9);
    let damaged = TiffFile::new(3, &HEIGHTS).with(42112, Values::Text("<GDALMetadata><Item"));
    assert!(fixture(damaged.bytes()).error().contains("no XML"));
}

#[test]
fn numbers_are_heights_whatever_black_is() {
    let file = TiffFile::new(3, &HEIGHTS).with(262, Values::Short(vec![0]));
    assert_eq!(mesh(&fixture(file.bytes()).scene()).0[5].z, 22.0);
    let palette = TiffFile::new(3, &HEIGHTS).with(262, Values::Short(vec![3]));
    assert_eq!(mesh(&warned(palette, &["numbers of colours"])).0[5].z, 22.0);
}

#[test]
fn an_alpha_band_makes_holes_and_other_bands_are_warned_of() {
    let two: Vec<f32> =
        HEIGHTS.iter().enumerate().flat_map(|(i, &h)| [h, if i == 0 { 0.0 } else { 255.0 }]).collect();
    let bands = |kinds: Option<u16>| {
        let mut file = TiffFile::new(3, &HEIGHTS)
            .with(258, Values::Short(vec![32, 32]))
            .with(339, Values::Short(vec![3, 3]))
            .with(277, Values::Short(vec![2]));
        file.blocks = vec![two.iter().flat_map(|v| v.to_le_bytes()).collect()];
        match kinds {
            Some(kind) => file.with(338, Values::Short(vec![kind])),
            None => file,
        }
    };
    assert_eq!(mesh(&warned(bands(Some(2)), &[])).1.len(), 3);
    assert_eq!(mesh(&warned(bands(Some(0)), &["2 bands"])).1.len(), 4);
    assert_eq!(mesh(&warned(bands(None), &["2 bands"])).1.len(), 4);
}

#[test]
fn values_that_often_mean_no_data_are_warned_of() {
    let mut heights = HEIGHTS;
    heights[0] = -9999.0;
    assert_eq!(mesh(&warned(TiffFile::new(3, &heights), &["1 pixels are -9999"])).1.len(), 4);
    assert_eq!(mesh(&warned(TiffFile::new(3, &heights).with(42113, Values::Text("-1")), &[])).1.len(), 4);
    heights[0] = f32::MIN;
    assert_eq!(mesh(&warned(TiffFile::new(3, &heights), &["are holes"])).1.len(), 3);
    let not_a_number = TiffFile::new(3, &HEIGHTS).with(42113, Values::Text("-1.#QNAN"));
    warned(not_a_number, &[]);
}

#[test]
fn compressions_and_files_that_are_not_read_are_named() {
    for (code, name) in [
        (7, "JPEG"),
        (34_712, "JPEG 2000"),
        (34_925, "LZMA"),
        (50_001, "WebP"),
        (4, "CCITT"),
        (99, "code 99"),
    ] {
        let report = fixture(TiffFile::new(3, &HEIGHTS).with(259, Values::Short(vec![code])).bytes()).error();
        assert!(report.contains(name) && report.contains("COMPRESS=DEFLATE"), "{report}");
    }
    for (bytes, name) in [
        (&b""[..], "the file is empty"),
        (b"\x89HDF\r\n", "an HDF5 or NetCDF 4 file"),
        (b"\x01\x02\x03", "binary data of an unknown format"),
    ] {
        let report = fixture(bytes.to_vec()).error();
        assert!(report.contains(name) && report.contains("gdal_translate"), "{report}");
    }
}

#[test]
fn a_hole_takes_only_the_triangles_that_need_it() {
    // The missing pixel is corner a of the first block and not a corner of the second.
    for (hole, tag) in
        [(-9999.0f32, "-9999"), (f32::MIN, "-3.40282346638529e+38"), (f32::NAN, "nan"), (-1e10, "")]
    {
        let mut heights = HEIGHTS;
        heights[0] = hole;
        let mut file = TiffFile::new(3, &heights);
        if !tag.is_empty() {
            file = file.with(42113, Values::Text(tag));
        }
        let scene = fixture(file.bytes()).scene();
        let (vertices, triangles) = mesh(&scene);
        assert_eq!((vertices.len(), triangles.len()), (5, 3), "no-data {tag:?}");
        assert_eq!(vertices[0], DVec3::new(103.0, 48.0, 11.0));
    }
}

#[test]
fn tiles_and_a_tile_that_is_left_out() {
    let (width, rows) = (20usize, 18usize);
    let z = |column: usize, row: usize| (column * 100 + row) as f32;
    let tile = |left: usize, top: usize| -> Vec<u8> {
        (0..256).flat_map(|i| z(left + i % 16, top + i / 16).to_le_bytes()).collect()
    };
    let tiled = |blocks| {
        let mut file = TiffFile::new(1, &[0.0])
            .without(278)
            .with(256, Values::Long(vec![width as u32]))
            .with(257, Values::Long(vec![rows as u32]))
            .with(322, Values::Long(vec![16]))
            .with(323, Values::Long(vec![16]));
        (file.blocks, file.tiled) = (blocks, true);
        file.bytes()
    };
    let scene = fixture(tiled(vec![tile(0, 0), tile(16, 0), tile(0, 16), tile(16, 16)])).scene();
    let (vertices, triangles) = mesh(&scene);
    assert_eq!((vertices.len(), triangles.len()), (width * rows, 2 * (width - 1) * (rows - 1)));
    for (i, v) in vertices.iter().enumerate() {
        assert!((v.z - f64::from(z(i % width, i / width))).abs() < 1e-9, "pixel {i}: {v}");
    }
    let sparse = fixture(tiled(vec![tile(0, 0), Vec::new(), tile(0, 16), Vec::new()])).scene();
    assert_eq!(mesh(&sparse).0.len(), 16 * rows);
}

fn encoded<C: colortype::ColorType>(width: u32, values: &[C::Inner], compression: Compression) -> Vec<u8>
where
    [C::Inner]: tiff::encoder::TiffValue,
{
    let mut out = std::io::Cursor::new(Vec::new());
    let mut encoder = TiffEncoder::new(&mut out).unwrap().with_compression(compression);
    let rows = (values.len() / C::BITS_PER_SAMPLE.len()) as u32 / width;
    let mut image = encoder.new_image::<C>(width, rows).unwrap();
    image.rows_per_strip(1).unwrap();
    image.encoder().write_tag(Tag::ModelPixelScaleTag, &[2.0, 4.0, 0.0][..]).unwrap();
    image.encoder().write_tag(Tag::ModelTiepointTag, &[0.0, 0.0, 0.0, 100.0, 50.0, 0.0][..]).unwrap();
    image.write_data(values).unwrap();
    out.into_inner()
}

#[test]
fn every_number_type_and_compression() {
    use Compression::{Deflate, Lzw, Uncompressed};
    let plain = fixture(TiffFile::new(3, &HEIGHTS).bytes()).scene();
    let shorts: Vec<i16> = HEIGHTS.iter().map(|&h| h as i16).collect();
    let bytes: Vec<u8> = HEIGHTS.iter().map(|&h| h as u8).collect();
    let doubles: Vec<f64> = HEIGHTS.iter().map(|&h| f64::from(h)).collect();
    let longs: Vec<u32> = HEIGHTS.iter().map(|&h| h as u32).collect();
    let words: Vec<u16> = HEIGHTS.iter().map(|&h| h as u16).collect();
    let colours: Vec<u8> = bytes.iter().flat_map(|&b| [b, 1, 2]).collect();
    assert_eq!(
        mesh(&fixture(encoded::<colortype::RGB8>(3, &colours, Uncompressed)).load().unwrap().0),
        mesh(&plain)
    );
    for file in [
        encoded::<colortype::GrayI16>(3, &shorts, Uncompressed),
        encoded::<colortype::Gray8>(3, &bytes, Lzw),
        encoded::<colortype::Gray64Float>(3, &doubles, Deflate(Default::default())),
        encoded::<colortype::Gray32>(3, &longs, Deflate(Default::default())),
        encoded::<colortype::Gray32Float>(3, &HEIGHTS, Lzw),
        encoded::<colortype::Gray16>(3, &words, Compression::Packbits),
    ] {
        assert_eq!(mesh(&fixture(file).scene()), mesh(&plain));
    }
}

#[test]
fn the_material_comes_from_its_file() {
    let mut f = Fixture::new();
    let file = f.file("dem.tif", TiffFile::new(3, &HEIGHTS).bytes());
    let mtl = f.file("dem.mtl", "newmtl b\nnewmtl meadow\nhelios_isGround 1\nhelios_reflectance 40\n");
    let material =
        MaterialChoice { file: Some(mtl), name: Some("meadow".to_owned()), ..MaterialChoice::default() };
    f.part(Loader::GeoTiff { files: file.into(), material });
    let scene = f.scene();
    assert!(scene.material_of(3).is_ground);
    assert_eq!(scene.ground_height(0.0, 0.0), Some(0.0));
}

#[test]
fn the_need_of_a_large_raster_is_stated_before_it_is_built() {
    // 10 000 × 10 000 single-precision pixels: 100 M vertices of 24 bytes, 200 M triangles of 16. The file
    // itself is small, because all but one of its tiles are sparse.
    let mut file = TiffFile::new(1, &[0.0])
        .without(278)
        .with(256, Values::Long(vec![10_000]))
        .with(257, Values::Long(vec![10_000]))
        .with(322, Values::Long(vec![1024]))
        .with(323, Values::Long(vec![1024]));
    file.tiled = true;
    file.blocks = vec![Vec::new(); 100];
    file.blocks[0] = vec![0; 1024 * 1024 * 4];
    let mut f = fixture(file.bytes());
    f.options.max_memory = Some(4_000_000_000);
    let report = f.error();
    assert!(report.contains("5.60 GB") && report.contains("4.00 GB"), "{report}");
}

#[test]
fn damaged_files_are_errors_of_their_part() {
    let good = TiffFile::new(3, &HEIGHTS).bytes();
    let too_large = TiffFile::new(3, &HEIGHTS)
        .with(256, Values::Long(vec![60_000]))
        .with(257, Values::Long(vec![60_000]));
    let flat = TiffFile::new(3, &HEIGHTS).with(33550, Values::Double(vec![0.0, 1.0, 0.0]));
    let vast_tiles = TiffFile { tiled: true, ..TiffFile::new(3, &HEIGHTS) }
        .without(278)
        .with(322, Values::Long(vec![1 << 20]))
        .with(323, Values::Long(vec![16]));
    let jpeg = TiffFile::new(3, &HEIGHTS).with(259, Values::Short(vec![7]));
    for bytes in [
        Vec::new(),
        b"no tiff".to_vec(),
        good[..30].to_vec(),
        too_large.bytes(),
        flat.bytes(),
        jpeg.bytes(),
        vast_tiles.bytes(),
    ] {
        let report = fixture(bytes).error();
        assert!(report.contains("dem.tif") && report.contains("scene.xml:10"), "{report}");
    }
    let lost = TiffFile::new(3, &HEIGHTS).without(33550).without(33922).bytes();
    let (scene, d) = fixture(lost).load().unwrap();
    assert_eq!((mesh(&scene).0[0], d.items().len()), (DVec3::new(0.5, 0.5, 10.0), 1));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]
    #[test]
    fn no_change_of_bytes_makes_the_reader_panic(changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6), cut in any::<prop::sample::Index>(), compressed in any::<bool>()) {
        let mut bytes = if compressed {
            encoded::<colortype::Gray32Float>(3, &HEIGHTS, Compression::Deflate(Default::default()))
        } else {
            TiffFile::new(3, &HEIGHTS).with(42113, Values::Text("-1")).bytes()
        };
        for (at, value) in changes {
            let at = at.index(bytes.len());
            bytes[at] = value;
        }
        if cut.index(4) == 0 {
            bytes.truncate(cut.index(bytes.len()));
        }
        if let Err(e) = fixture(bytes).load() {
            prop_assert_eq!(e.exit_status(), 2);
        }
    }
}
