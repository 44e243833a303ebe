//! Rasters that GDAL (by rasterio) and tifffile write, against what rasterio reads of them: compressions,
//! types of numbers, predictors, strips and tiles, masks, rotations, scales.

use crate::common::{folder, judge, python, run, succeed, text};
use serde_json::Value;
use std::fs;

/// Writes variants of a terrain of 40 by 50 pixels, and prints for each what rasterio reads: the number of
/// triangles with data at all corners, the lowest and the highest corner of their box.
const VARIANTS: &str = r#"
import json, warnings
import numpy as np
import rasterio
from rasterio.enums import ColorInterp
import tifffile
warnings.filterwarnings("ignore")
rows, columns = 50, 40
y, x = np.mgrid[0:rows, 0:columns]
heights = 100 + 20 * np.sin(x / 7) * np.cos(y / 9)
north_up = rasterio.Affine(2, 0, 500000, 0, -3, 5400000)
files = []

def write(name, data, transform=north_up, mask=None, alpha=None, scale=None, internal=False, **options):
    files.append(name)
    data = np.atleast_3d(data)
    bands = [data[:, :, i] for i in range(data.shape[2])] + ([] if alpha is None else [alpha.astype(data.dtype)])
    options = {"driver": "GTiff", "crs": "EPSG:25832", **({} if alpha is None else {"ALPHA": "YES"}), **options}
    with rasterio.Env(GDAL_TIFF_INTERNAL_MASK=internal):
        with rasterio.open(name, "w", width=columns, height=rows, count=len(bands), dtype=data.dtype,
                           transform=transform, **options) as file:
            if alpha is not None:
                file.colorinterp = [ColorInterp.gray] * data.shape[2] + [ColorInterp.alpha]
            if scale is not None:
                file.scales, file.offsets = [scale[0]] * len(bands), [scale[1]] * len(bands)
            for i, band in enumerate(bands):
                file.write(band, i + 1)
            if mask is not None:
                file.write_mask(mask)

single = heights.astype("float32")
whole = heights.round().astype("int16")
for compress in ["NONE", "LZW", "DEFLATE", "ZSTD", "PACKBITS", "LERC", "LERC_DEFLATE", "LERC_ZSTD"]:
    write(f"float_{compress}.tif", single, compress=compress)
    write(f"int_{compress}.tif", whole, compress=compress, tiled=True, blockxsize=16, blockysize=32)
for compress in ["LZW", "DEFLATE", "ZSTD"]:
    write(f"differences_{compress}.tif", whole, compress=compress, predictor=2)
    write(f"float_differences_{compress}.tif", single, compress=compress, predictor=3, tiled=True, blockxsize=16, blockysize=16)
    write(f"double_differences_{compress}.tif", heights, compress=compress, predictor=3)
for kind in ["uint8", "int8", "uint16", "int32", "uint32", "int64", "uint64", "float64"]:
    write(f"{kind}.tif", heights.round().astype(kind), compress="DEFLATE")
    write(f"{kind}_big.tif", heights.round().astype(kind), ENDIANNESS="BIG", compress="LZW", predictor=2)
write("negative.tif", (heights - 110).round().astype("int16"), compress="LZW", predictor=2)
write("bits.tif", (x % 16).astype("uint8"), NBITS=4)
write("bigtiff.tif", single, BIGTIFF="YES", compress="ZSTD")
write("cog.tif", single, driver="COG", compress="ZSTD", predictor="YES", blocksize=128)
write("cog_lerc.tif", single, driver="COG", compress="LERC", blocksize=128)
write("white_is_zero.tif", heights.round().astype("uint16"), photometric="MINISWHITE")
hole = single.copy(); hole[5:9, 7:20] = -9999; hole[30, 30] = np.nan
write("no_data.tif", hole, nodata=-9999)
write("no_data_is_nan.tif", np.where(hole == -9999, np.nan, hole).astype("float32"), nodata=float("nan"), compress="LERC")
write("no_data_out_of_type.tif", heights.round().astype("uint8"), nodata=None)
write("no_data_lowest.tif", np.where(hole == -9999, np.finfo("float32").min, hole).astype("float32"), nodata=float(np.finfo("float32").min))
seen = (x + y) % 11 < 9
write("mask.tif", np.where(seen, single, 0).astype("float32"), mask=seen, internal=True, compress="DEFLATE")
write("mask_beside.tif", np.where(seen, single, 0).astype("float32"), mask=seen)
for interleave in ["pixel", "band"]:
    write(f"alpha_{interleave}.tif", heights.round().astype("uint16"), alpha=np.where(seen, 65535, 0), interleave=interleave, compress="ZSTD")
    write(f"bands_{interleave}.tif", np.dstack([single, single * 0, single * 0]), interleave=interleave, compress="LZW")
write("bands_lerc.tif", np.dstack([single, single + 1]), compress="LERC")
write("turned.tif", single, transform=north_up * rasterio.Affine.rotation(30))
write("south_up.tif", single, transform=rasterio.Affine(2, 0, 500000, 0, 3, 5400000))
write("scaled.tif", ((heights - 50) * 100).round().astype("uint16"), scale=(0.01, 50))

# What GDAL does not write: halves, and pixels that are points.
files.append("half.tif")
place = [(33550, "d", 3, (2.0, 3.0, 0.0), True), (33922, "d", 6, (0.0, 0.0, 0.0, 500000.0, 5400000.0, 0.0), True)]
keys = lambda kind: [(34735, "H", 16, (1, 1, 0, 3, 1024, 0, 1, 1, 1025, 0, 1, kind, 3072, 0, 1, 25832), True)]
tifffile.imwrite("half.tif", heights.astype("float16"), extratags=place + keys(1), metadata=None)
files.append("point.tif")
tifffile.imwrite("point.tif", single, extratags=place + keys(2), metadata=None)
files.append("packed_rows.tif")
tifffile.imwrite("packed_rows.tif", single, rowsperstrip=7, compression="zlib", extratags=place + keys(1), metadata=None)

found = {}
for name in files:
    with rasterio.open(name) as file:
        z = file.read(1).astype("float64")
        has_data = (file.read_masks(1) != 0) & np.isfinite(z)
        z = z * file.scales[0] + file.offsets[0]
        a, b, c, d = has_data[:-1, :-1], has_data[1:, :-1], has_data[1:, 1:], has_data[:-1, 1:]
        first, second = a & b & d, b & c & d
        used = np.zeros_like(has_data)
        for corner, rows_, columns_, of in [("a", 0, 0, first), ("b", 1, 0, first | second), ("c", 1, 1, second), ("d", 0, 1, first | second)]:
            used[rows_:rows_ + rows - 1, columns_:columns_ + columns - 1] |= of
        at = np.argwhere(used)
        east, north = file.transform * (at[:, 1] + 0.5, at[:, 0] + 0.5)
        heights_used = z[used]
        found[name] = {"triangles": int(first.sum() + second.sum()),
                       "box": [east.min(), north.min(), heights_used.min(), east.max(), north.max(), heights_used.max()]}
print(json.dumps(found))
"#;

#[test]
fn rasters_of_other_programs_are_read_as_they_read_them() {
    let Some(python) = python("rasterio, tifffile") else { return };
    let dir = folder();
    let known: Value = serde_json::from_str(&judge(&python, dir.path(), VARIANTS)).unwrap();
    let known = known.as_object().unwrap();
    assert!(known.len() > 50, "{}", known.len());
    for (file, expected) in known {
        let output = succeed(dir.path(), &["scene", "info", file, "--json"]);
        let facts: Value = serde_json::from_slice(&output.stdout).unwrap();
        assert_eq!(facts["triangles"], expected["triangles"], "{file}: {}", text(&output.stderr));
        let found = ["min", "max"].iter().flat_map(|end| facts["bounds_m"][end].as_array().unwrap());
        for (found, expected) in found.zip(expected["box"].as_array().unwrap()) {
            let (found, expected) = (found.as_f64().unwrap(), expected.as_f64().unwrap());
            assert!((found - expected).abs() < 1e-6, "{file}: {facts} is not {expected}");
        }
        let warnings = text(&succeed(dir.path(), &["scene", "info", file]).stderr);
        let is_told = |words: &str| warnings.contains(words);
        assert_eq!(is_told("bands"), file.starts_with("bands"), "{file}: {warnings}");
        assert_eq!(is_told("its metadata says"), file == "scaled.tif", "{file}: {warnings}");
        let is_warned_of = is_told(&format!("{file}: "));
        assert_eq!(is_warned_of, is_told("bands") || is_told("its metadata says"), "{file}: {warnings}");
    }
}

/// A raster that GDAL compresses as the program does not read.
const UNREAD: &str = r#"
import numpy as np
import rasterio
with rasterio.open("lzma.tif", "w", driver="GTiff", width=8, height=8, count=1, dtype="float32", compress="LZMA",
                   crs="EPSG:25832", transform=rasterio.Affine(1, 0, 0, 0, -1, 0)) as file:
    file.write(np.zeros((8, 8), "float32"), 1)
"#;

#[test]
fn an_unread_compression_is_named_with_the_command_that_replaces_it() {
    let Some(python) = python("rasterio") else { return };
    let dir = folder();
    judge(&python, dir.path(), UNREAD);
    let output = run(dir.path(), &["scene", "info", "lzma.tif"]);
    let message = text(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{message}");
    assert!(
        message.contains("compressed by LZMA") && message.contains("gdal_translate -co COMPRESS=DEFLATE"),
        "{message}"
    );
}

#[test]
fn world_files_that_cannot_be_read_are_errors() {
    let dir = folder();
    let with_keys = crate::common::raster([0.0, 8.0], 1.0, None);
    // Without its georeference: the tags of pixel scale and tie point get numbers that no reader knows.
    let mut bytes = with_keys;
    for tag in [33_550u16, 33_922] {
        let at = bytes.windows(2).position(|two| two == tag.to_le_bytes()).unwrap();
        bytes[at..at + 2].copy_from_slice(&(tag + 1000).to_le_bytes());
    }
    fs::write(dir.path().join("dem.tif"), bytes).unwrap();
    fs::write(dir.path().join("dem.TFW"), "2\n0\n0\n-2\n500000\n5400000\n").unwrap();
    let facts = succeed(dir.path(), &["scene", "info", "dem.tif", "--json", "-q"]);
    let facts: Value = serde_json::from_slice(&facts.stdout).unwrap();
    assert_eq!(facts["bounds_m"]["min"][0], 500_000.0);
    fs::write(dir.path().join("dem.TFW"), "2,0\n0,0\n0,0\n-2,0\n500000,0\n5400000,0\n").unwrap();
    let output = run(dir.path(), &["scene", "info", "dem.tif"]);
    let message = text(&output.stderr);
    assert!(output.status.code() == Some(2) && message.contains("a decimal comma"), "{message}");
}

#[test]
fn a_raster_of_one_pixel_is_explained() {
    let dir = folder();
    let grid = "ncols 1\nnrows 1\nxllcorner 0\nyllcorner 0\ncellsize 1\n5\n";
    fs::write(dir.path().join("one.asc"), grid).unwrap();
    let out = run(dir.path(), &["scene", "info", "one.asc"]);
    assert_eq!(out.status.code(), Some(2));
    assert!(text(&out.stderr).contains("at least 2 by 2 pixels"), "{}", text(&out.stderr));
}
