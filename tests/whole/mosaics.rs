//! Tiles of a terrain are one raster: in folders, patterns, virtual rasters; and what does not go together.

use crate::common::{folder, judge, python, raster_of, run, succeed, text};
use serde_json::Value;
use std::fs;
use std::path::Path;
use vlscan::scene::LoadOptions;
use vlscan::{ReadOptions, read_scene};

/// Columns and rows of the terrain.
const SIZE: [usize; 2] = [53, 37];
/// Ends of tiles.
const COLUMNS: [usize; 4] = [0, 20, 37, 53];
const ROWS: [usize; 3] = [0, 16, 37];
const ORIGIN: [f64; 2] = [500_000.25, 5_400_000.1];
const STEP: f64 = 0.7;

/// Hills with holes, one of them over a corner of four tiles.
fn height(column: usize, row: usize) -> f32 {
    let is_hole = (18..22).contains(&column) && (14..17).contains(&row) || (column * 7 + row * 11) % 41 == 3;
    match is_hole {
        true => f32::NAN,
        false => 20.0 + ((column * 5 + row * 3) % 13) as f32 * 0.3 + (column as f32 * 0.2).sin(),
    }
}

/// The raster of some columns and rows, with 16-bit heights put in floats and holes as this number.
fn part(columns: [usize; 2], rows: [usize; 2], hole: f32) -> Vec<u8> {
    let heights: Vec<f32> = (rows[0]..rows[1])
        .flat_map(|row| (columns[0]..columns[1]).map(move |column| height(column, row)))
        .map(|z| if z.is_nan() { hole } else { z })
        .collect();
    let origin = [ORIGIN[0] + STEP * columns[0] as f64, ORIGIN[1] - STEP * rows[0] as f64];
    raster_of(columns[1] - columns[0], &heights, origin, STEP, Some(25832))
}

/// Six tiles in `tiles/`, the same terrain as one raster, and virtual rasters of the tiles.
fn terrain(folder: &Path) {
    fs::write(folder.join("single.tif"), part([0, SIZE[0]], [0, SIZE[1]], f32::NAN)).unwrap();
    fs::create_dir(folder.join("tiles")).unwrap();
    fs::create_dir(folder.join("marked")).unwrap();
    let mut sources = String::new();
    for (r, rows) in ROWS.windows(2).enumerate() {
        for (c, columns) in COLUMNS.windows(2).enumerate() {
            let ([left, right], [top, bottom]) = ([columns[0], columns[1]], [rows[0], rows[1]]);
            let name = format!("dem_{r}{c}.tif");
            fs::write(folder.join("tiles").join(&name), part([left, right], [top, bottom], f32::NAN))
                .unwrap();
            fs::write(folder.join("marked").join(&name), part([left, right], [top, bottom], -77.5)).unwrap();
            let (width, height) = (right - left, bottom - top);
            sources += &format!(
                "<ComplexSource>\n<SourceFilename relativeToVRT=\"1\">{name}</SourceFilename>\n<SourceBand>1</SourceBand>\n\
                 <SrcRect xOff=\"0\" yOff=\"0\" xSize=\"{width}\" ySize=\"{height}\"/>\n\
                 <DstRect xOff=\"{left}\" yOff=\"{top}\" xSize=\"{width}\" ySize=\"{height}\"/>\n<NODATA>-77.5</NODATA>\
                 <OpenOptions><OOI key=\"OVERVIEW_LEVEL\">NONE</OOI></OpenOptions>\n\
                 </ComplexSource>\n"
            );
        }
    }
    let document = format!(
        "<VRTDataset rasterXSize=\"{}\" rasterYSize=\"{}\">\n<SRS>EPSG:25832</SRS>\n\
         <GeoTransform>{}, {STEP}, 0, {}, 0, -{STEP}</GeoTransform>\n\
         <VRTRasterBand dataType=\"Float32\" band=\"1\">\n<NoDataValue>-77.5</NoDataValue>\n{sources}</VRTRasterBand>\n</VRTDataset>\n",
        SIZE[0], SIZE[1], ORIGIN[0], ORIGIN[1]
    );
    fs::write(folder.join("marked/all.vrt"), document).unwrap();
}

/// A scan from above whose lines cross all tiles.
fn pipeline(scene: &str) -> String {
    let [x, y] = [ORIGIN[0] + 18.5, ORIGIN[1] - 13.0];
    format!(
        "scene = \"{scene}\"\nseed = 3\n[platform]\ncatalogue = \"data/platforms.xml#copter_linearpath\"\n\
         [scanner]\ncatalogue = \"data/scanners_als.xml#riegl_vux-1uav\"\n\
         [settings]\npulse_freq_hz = 50000\nscan_freq_hz = 100\nscan_angle_deg = 25\n\
         [[leg]]\nposition_m = [{}, {y}, 60]\nspeed_m_per_s = 30\n[[leg]]\nposition_m = [{}, {y}, 60]\nactive = false\n",
        x - 25.0,
        x + 25.0
    )
}

fn points(folder: &Path, scene: &str, options: &[&str]) -> Vec<u8> {
    fs::write(folder.join("run.toml"), pipeline(scene)).unwrap();
    let args = [&["run", "run.toml", "-q", "--force", "-o", "out.xyz"], options].concat();
    succeed(folder, &args);
    fs::read(folder.join("out.xyz")).unwrap()
}

#[test]
fn tiles_give_the_points_of_one_raster() {
    let dir = folder();
    terrain(dir.path());
    for physics in ["helios", "refined"] {
        let points =
            |scene: &str, more: &[&str]| points(dir.path(), scene, &[&["--physics", physics], more].concat());
        let single = points("single.tif", &["-j", "1"]);
        assert!(single.len() > 50_000, "{}", single.len());
        for scene in ["tiles", "tiles/", "tiles/dem_*.tif", "marked/all.vrt"] {
            for threads in ["1", "2"] {
                assert!(points(scene, &["-j", threads]) == single, "{scene}, {physics}, {threads} threads");
            }
        }
        let scene = dir.path().join("marked/all.vrt");
        for (scene, pack) in [("tiles", "tiles.vlscene"), (scene.to_str().unwrap(), "all.vlscene")] {
            succeed(dir.path(), &["scene", "pack", scene, "--physics", physics, "-o", pack, "--force", "-q"]);
            assert!(points(pack, &[]) == single, "{pack}, {physics}");
        }
    }
    let facts = |scene: &str| -> Value {
        let output = succeed(dir.path(), &["scene", "info", scene, "--json"]);
        assert!(output.stderr.is_empty(), "{}", text(&output.stderr));
        let mut facts: Value = serde_json::from_slice(&output.stdout).unwrap();
        for named in ["file", "name", "scene", "path"] {
            facts.as_object_mut().unwrap().remove(named);
        }
        facts
    };
    let single = facts("single.tif");
    for scene in ["tiles", "marked/all.vrt"] {
        let facts = facts(scene);
        for key in ["triangles", "bounds_m", "crs"] {
            assert_eq!(facts[key], single[key], "{scene}: {key}");
        }
    }
}

#[test]
fn tiles_are_parts_of_surveys_and_pipelines() {
    let dir = folder();
    terrain(dir.path());
    let scene = |key: &str, value: &str| {
        format!(
            "<document><scene id=\"s\"><part><filter type=\"geotiffloader\">\
             <param type=\"string\" key=\"{key}\" value=\"{value}\"/></filter></part></scene></document>"
        )
    };
    let with_part = |file: &str| {
        let text = pipeline("").replace("scene = \"\"\n", "") + &format!("[[part]]\nfile = \"{file}\"\n");
        fs::create_dir_all(dir.path().join("runs")).unwrap();
        fs::write(dir.path().join("runs/run.toml"), text).unwrap();
        succeed(dir.path(), &["run", "runs/run.toml", "-q", "--force", "-o", "out.xyz"]);
        fs::read(dir.path().join("out.xyz")).unwrap()
    };
    let single = with_part("../single.tif");
    // By itself a raster is soil, as in parts that say so.
    let soil = "name = \"soil\"\nreflectance = 0.3\nclassification = 2\nis_ground = true\n";
    let as_soil = with_part(&format!("../single.tif\"\n[[part.material]]\n{soil}# \""));
    assert!(points(dir.path(), "single.tif", &[]) == as_soil && as_soil != single);
    for (key, value) in [
        ("filepath", "single.tif"),
        ("filepath", "tiles"),
        ("efilepath", r"tiles/dem_.*\.tif"),
        ("filepath", "marked/all.vrt"),
    ] {
        fs::write(dir.path().join("scene.xml"), scene(key, value)).unwrap();
        assert!(points(dir.path(), "scene.xml#s", &[]) == single, "{value}");
    }
    for file in ["../tiles", "../tiles/*.tif", "../marked/all.vrt"] {
        assert!(with_part(file) == single, "{file}");
    }
}

#[test]
fn pages_of_rasters_come_and_go_without_a_trace() {
    let dir = folder();
    terrain(dir.path());
    for physics in ["helios", "refined"] {
        let points =
            |scene: &str, more: &[&str]| points(dir.path(), scene, &[&["--physics", physics], more].concat());
        let whole = points("single.tif", &["-j", "1"]);
        for scene in ["single.tif", "tiles", "marked/all.vrt"] {
            for (memory, threads) in [("25k", "1"), ("25k", "2"), ("500M", "2")] {
                let found = points(scene, &["--scene-memory", memory, "-j", threads]);
                assert!(found == whole, "{scene}, {memory}, {physics}, {threads} threads");
            }
        }
    }
    fs::write(dir.path().join("run.toml"), pipeline("tiles")).unwrap();
    let small = run(dir.path(), &["run", "run.toml", "--scene-memory", "100", "--force", "-o", "out.xyz"]);
    let message = text(&small.stderr);
    assert!(!small.status.success() && message.contains("give --scene-memory more than"), "{message}");
}

/// Number of triangles of a scene of flat tiles, each with its first column and row, and its height.
fn flat_tiles(folder: &Path, tiles: &[([usize; 2], [usize; 2], f32)]) {
    let _ = fs::remove_dir_all(folder.join("flat"));
    fs::create_dir(folder.join("flat")).unwrap();
    for (i, (at, [columns, rows], z)) in tiles.iter().enumerate() {
        let origin = [1000.0 + at[0] as f64, 2000.0 - at[1] as f64];
        let heights = vec![*z; columns * rows];
        fs::write(folder.join(format!("flat/t{i}.tif")), raster_of(*columns, &heights, origin, 1.0, None))
            .unwrap();
    }
}

fn facts(folder: &Path, scene: &str) -> Value {
    serde_json::from_slice(&succeed(folder, &["scene", "info", scene, "--json", "-q"]).stdout).unwrap()
}

#[test]
fn later_tiles_cover_earlier_ones_where_they_have_data() {
    let dir = folder();
    // Beside each other without overlap: the cells between them are there. Apart: between them is nothing.
    flat_tiles(dir.path(), &[([0, 0], [4, 4], 1.0), ([4, 0], [4, 4], 1.0), ([0, 6], [8, 2], 1.0)]);
    assert_eq!(facts(dir.path(), "flat")["triangles"], 2 * (7 * 3 + 7));
    flat_tiles(dir.path(), &[([0, 0], [6, 4], 1.0), ([2, 1], [6, 4], 5.0)]);
    let found = facts(dir.path(), "flat");
    // Of 7 x 4 cells two at the upper right and two at the lower left have a corner without a tile.
    assert_eq!(found["triangles"], 2 * (7 * 4 - 4), "{found}");
    // The later tile has no data: the earlier one remains.
    flat_tiles(dir.path(), &[([0, 0], [6, 4], 1.0), ([2, 1], [4, 3], f32::NAN)]);
    let found = facts(dir.path(), "flat");
    assert_eq!((&found["triangles"], &found["bounds_m"]["max"][2]), (&Value::from(30), &Value::from(1.0)));
}

/// Changes the terrain in `tiles/` or `marked/`, and expects these words in the refusal of a scene.
#[test]
fn what_is_not_one_grid_is_refused() {
    let dir = folder();
    let refused = |change: &dyn Fn(&Path), scene: &str, expected: &[&str]| {
        let _ = fs::remove_dir_all(dir.path().join("tiles"));
        let _ = fs::remove_dir_all(dir.path().join("marked"));
        terrain(dir.path());
        change(dir.path());
        let output = run(dir.path(), &["scene", "info", scene]);
        let message = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{scene}: {message}");
        for words in expected {
            assert!(message.contains(words), "{scene}: {words}: {message}");
        }
    };
    let small = |step: f64, origin: [f64; 2], epsg: Option<u16>| raster_of(4, &[9.0; 16], origin, step, epsg);
    let put = |name: &'static str, bytes: Vec<u8>| move |at: &Path| fs::write(at.join(name), &bytes).unwrap();
    let placed = [ORIGIN[0] + 20.0 * STEP, ORIGIN[1]];
    refused(
        &put("tiles/dem_01.tif", small(1.4, placed, Some(25832))),
        "tiles",
        &["dem_00.tif", "dem_01.tif", "0.7 x -0.7", "1.4 x -1.4"],
    );
    let beside = [placed[0] + 0.3, placed[1]];
    refused(
        &put("tiles/dem_01.tif", small(STEP, beside, Some(25832))),
        "tiles",
        &["dem_00.tif", "dem_01.tif", "0.429 columns"],
    );
    refused(
        &put("tiles/dem_01.tif", small(STEP, placed, Some(25833))),
        "tiles",
        &["dem_00.tif", "dem_01.tif", "EPSG:25832", "EPSG:25833"],
    );
    refused(&put("tiles/dem_01.tif", small(STEP, placed, None)), "tiles", &["dem_01.tif", "no system"]);
    refused(&put("tiles/dem_01.tif", b"II*\0".to_vec()), "tiles", &["cannot read the raster", "dem_01.tif"]);
    refused(&put("tiles/dem_01.tif", Vec::new()), "tiles", &["dem_01.tif", "the file is empty"]);
    let far = small(STEP, [ORIGIN[0] + 1e6 * STEP, ORIGIN[1] - 1e6 * STEP], Some(25832));
    refused(
        &put("tiles/dem_01.tif", far),
        "tiles",
        &["more pixels than can be numbered", "1000004 x 1000004"],
    );
    // Truncated within its numbers.
    let cut = |at: &Path| {
        let bytes = fs::read(at.join("tiles/dem_12.tif")).unwrap();
        fs::write(at.join("tiles/dem_12.tif"), &bytes[..bytes.len() - 40]).unwrap();
    };
    refused(&cut, "tiles", &["dem_12.tif", "is it truncated?"]);
    let missing = |at: &Path| fs::remove_file(at.join("marked/dem_11.tif")).unwrap();
    refused(&missing, "marked/all.vrt", &["all.vrt:", "cannot find the raster `dem_11.tif`"]);
    refused(
        &put("marked/dem_01.tif", small(1.4, placed, Some(25832))),
        "marked/all.vrt",
        &["all.vrt:", "beyond the 4 x 4 that there are"],
    );
    let other_size = raster_of(17, &[9.0; 17 * 16], placed, 1.4, Some(25832));
    refused(
        &put("marked/dem_01.tif", other_size),
        "marked/all.vrt",
        &["all.vrt:", "dem_01.tif", "1.4 x -1.4"],
    );
    let moved = raster_of(17, &[9.0; 17 * 16], ORIGIN, STEP, Some(25832));
    refused(
        &put("marked/dem_01.tif", moved),
        "marked/all.vrt",
        &["all.vrt:", "dem_01.tif", "-20 columns and 0 rows"],
    );
    let replaced = |from: &'static str, to: &'static str| {
        move |at: &Path| {
            let text = fs::read_to_string(at.join("marked/all.vrt")).unwrap();
            assert!(text.contains(from));
            fs::write(at.join("marked/all.vrt"), text.replacen(from, to, 1)).unwrap();
        }
    };
    refused(
        &replaced("<NODATA>", "<LUT>0:1</LUT><NODATA>"),
        "marked/all.vrt",
        &["<LUT> is not supported", "all.vrt:11"],
    );
    refused(
        &replaced(">NONE<", ">0<"),
        "marked/all.vrt",
        &["<OOI> is not supported: it sets `OVERVIEW_LEVEL`", "all.vrt:"],
    );
    refused(&replaced("xSize=\"20\"", "xSize=\"10\""), "marked/all.vrt", &["resampled", "all.vrt:"]);
    refused(&replaced("Float32", "Int16"), "marked/all.vrt", &["does not hold every number of"]);
    refused(
        &replaced("rasterXSize=\"53\"", "rasterXSize=\"50\""),
        "marked/all.vrt",
        &["<DstRect>", "beyond the 50 x 37"],
    );
    refused(&replaced("</VRTDataset>", ""), "marked/all.vrt", &["not well-formed XML"]);
    refused(
        &|at: &Path| fs::create_dir_all(at.join("none")).unwrap(),
        "none",
        &["the folder none holds no raster"],
    );
}

/// Tiles as GDAL writes them, with masks, alpha, scales, compressions; what rasterio reads of them in one
/// raster.
const TILES: &str = r#"
import os
import numpy as np
import rasterio
import rasterio.shutil
from rasterio.windows import Window
rng = np.random.default_rng(4)
rows, columns = 150, 190
y, x = np.mgrid[0:rows, 0:columns]
heights = 100 + 20 * np.sin(x / 17) * np.cos(y / 29) + rng.normal(0, 0.2, (rows, columns))
place = rasterio.Affine(2.5, 0, 500000, 0, -2.5, 5400000)
seen = (x // 5 + y // 7) % 13 > 0

def write(name, window, data, seen, options):
    options = {"driver": "GTiff", "crs": "EPSG:25832", "dtype": data.dtype, **options}
    scale = options.pop("scale", None)
    mask = options.pop("mask", False)
    with rasterio.open(name, "w", width=window.width, height=window.height, count=1,
                       transform=rasterio.windows.transform(window, place), **options) as file:
        cut = (slice(window.row_off, window.row_off + window.height), slice(window.col_off, window.col_off + window.width))
        if scale:
            file.scales, file.offsets = [scale[0]], [scale[1]]
        file.write(data[cut], 1)
        if mask:
            file.write_mask(seen[cut])

whole = Window(0, 0, columns, rows)
kinds = {
    "float": (heights.astype("float32"), {"compress": "DEFLATE", "predictor": 3}),
    "tiled": (heights.astype("float32"), {"compress": "ZSTD", "tiled": True, "blockxsize": 32, "blockysize": 48}),
    "short": (np.where(seen, heights.round(), -9999).astype("int16"), {"nodata": -9999, "compress": "LZW", "predictor": 2}),
    "double": (heights, {"compress": "DEFLATE", "tiled": True, "blockxsize": 64, "blockysize": 16}),
    "mask": (np.where(seen, heights, 0).astype("float32"), {"mask": True}),
    "scaled": ((heights * 100).round().astype("uint16"), {"scale": (0.01, 3.0)}),
}
for kind, (data, options) in kinds.items():
    write(f"{kind}.tif", whole, data, seen, options)
    rasterio.shutil.copy(f"{kind}.tif", f"{kind}.vrt", driver="VRT")
    os.mkdir(kind)
    for top, bottom in [(0, 40), (40, 41), (41, 150)]:
        for left, right in [(0, 33), (33, 130), (130, 190)]:
            write(f"{kind}/{top}_{left}.tif", Window(left, top, right - left, bottom - top), data, seen, options)
print(*kinds)
"#;

#[test]
fn tiles_that_gdal_writes_are_one_raster() {
    let Some(python) = python("rasterio") else { return };
    let dir = folder();
    let kinds = judge(&python, dir.path(), TILES);
    assert_eq!(kinds.split_whitespace().count(), 6);
    for kind in kinds.split_whitespace() {
        let load = |name: String| {
            let name = dir.path().join(name);
            let (recipe, _) = read_scene(name.to_str().unwrap(), &ReadOptions::default()).unwrap();
            let (scene, warnings) = vlscan::scene::load(&recipe, &LoadOptions::default()).unwrap();
            let field = &scene.geometry.fields[0];
            let numbers: Vec<u64> =
                (0..field.heights().len()).map(|i| field.heights().get(i).to_bits()).collect();
            assert!(field.triangles() > 20_000);
            (*field.grid(), numbers, field.triangles(), scene.bounds, scene.crs, warnings.items().len())
        };
        let single = load(format!("{kind}.tif"));
        assert!(single == load(kind.to_owned()), "{kind}");
        assert!(single == load(format!("{kind}.vrt")), "{kind}.vrt");
    }
}

/// The terrain as a raster and as an ESRI ASCII grid, with steps that binary numbers hold.
fn grid_and_twin(columns: [usize; 2], rows: [usize; 2]) -> [Vec<u8>; 2] {
    const STEP: f64 = 0.75;
    let heights: Vec<f32> = (rows[0]..rows[1])
        .flat_map(|row| (columns[0]..columns[1]).map(move |column| height(column, row)))
        .collect();
    let origin = [500_000.25 + STEP * columns[0] as f64, 5_400_000.5 - STEP * rows[0] as f64];
    let (width, count) = (columns[1] - columns[0], rows[1] - rows[0]);
    let south = origin[1] - STEP * count as f64;
    let mut text = format!("ncols {width}\nnrows {count}\nxllcorner {}\nyllcorner {south}\n", origin[0]);
    text += "cellsize 0.75\nNODATA_value -9999\n";
    for row in heights.chunks(width) {
        let words: Vec<String> =
            row.iter().map(|z| if z.is_nan() { "-9999".to_owned() } else { z.to_string() }).collect();
        text += &(words.join(" ") + "\n");
    }
    [raster_of(width, &heights, origin, STEP, Some(25832)), text.into_bytes()]
}

#[test]
fn grids_of_text_are_the_rasters_of_the_same_heights() {
    let dir = folder();
    let at = |name: &str| dir.path().join(name);
    let prj = vlscan::crs::wkt_of_epsg(25832).unwrap();
    let [raster, grid] = grid_and_twin([0, SIZE[0]], [0, SIZE[1]]);
    fs::write(at("single.tif"), raster).unwrap();
    fs::write(at("single.asc"), &grid).unwrap();
    fs::write(at("single.prj"), &prj).unwrap();
    fs::write(at("heights.txt"), text(&grid).to_uppercase().replace('\n', "\r\n")).unwrap();
    fs::create_dir(at("tiles")).unwrap();
    let mut sources = String::new();
    for (r, rows) in ROWS.windows(2).enumerate() {
        for (c, columns) in COLUMNS.windows(2).enumerate() {
            let [_, grid] = grid_and_twin([columns[0], columns[1]], [rows[0], rows[1]]);
            let (name, size) = (format!("tiles/dem_{r}{c}"), [columns[1] - columns[0], rows[1] - rows[0]]);
            fs::write(at(&format!("{name}.asc")), grid).unwrap();
            fs::write(at(&format!("{name}.prj")), &prj).unwrap();
            sources += &format!(
                "<ComplexSource><SourceFilename relativeToVRT=\"1\">{name}.asc</SourceFilename><SourceBand>1</SourceBand>\
                 <SrcRect xOff=\"0\" yOff=\"0\" xSize=\"{0}\" ySize=\"{1}\"/>\
                 <DstRect xOff=\"{2}\" yOff=\"{3}\" xSize=\"{0}\" ySize=\"{1}\"/><NODATA>-9999</NODATA></ComplexSource>",
                size[0], size[1], columns[0], rows[0]
            );
        }
    }
    let document = format!(
        "<VRTDataset rasterXSize=\"{}\" rasterYSize=\"{}\"><SRS>EPSG:25832</SRS>\
         <GeoTransform>500000.25, 0.75, 0, 5400000.5, 0, -0.75</GeoTransform>\
         <VRTRasterBand dataType=\"Float32\" band=\"1\"><NoDataValue>-9999</NoDataValue>{sources}</VRTRasterBand></VRTDataset>",
        SIZE[0], SIZE[1]
    );
    fs::write(at("all.vrt"), document).unwrap();
    let single = points(dir.path(), "single.tif", &[]);
    assert!(single.len() > 50_000, "{}", single.len());
    for scene in ["single.asc", "heights.txt", "tiles", "tiles/*.asc", "all.vrt"] {
        for memory in ["500M", "25k"] {
            let found = points(dir.path(), scene, &["--scene-memory", memory]);
            assert!(found == single, "{scene}, {memory}");
        }
        assert!(points(dir.path(), scene, &[]) == single, "{scene}");
    }
    let facts = |scene: &str| -> Value {
        let output = succeed(dir.path(), &["scene", "info", scene, "--json"]);
        assert!(output.stderr.is_empty(), "{}", text(&output.stderr));
        serde_json::from_slice(&output.stdout).unwrap()
    };
    let single = facts("single.tif");
    for scene in ["single.asc", "tiles", "all.vrt"] {
        let facts = facts(scene);
        ["triangles", "bounds_m", "crs"]
            .iter()
            .for_each(|key| assert_eq!(facts[key], single[key], "{scene}: {key}"));
    }
    fs::write(at("cut.asc"), &grid[..grid.len() / 2]).unwrap();
    let said = text(&run(dir.path(), &["scene", "info", "cut.asc"]).stderr);
    assert!(said.contains("cut.asc") && said.contains("expected 53 heights (ncols)"), "{said}");
}
