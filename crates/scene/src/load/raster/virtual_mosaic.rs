//! Virtual rasters of GDAL as tiles of one grid: which pixel of which source each pixel of the grid is.

use super::blocks::Window;
use super::georeference::Georeference;
use super::keys::{self, LengthUnit, System};
use super::mosaic::{
    ALIGN, Misalignment, Misplaced, Mosaic, Tile, UNPLACED, bands, check_same, differ, metres, scaled,
    start_in, whole,
};
use super::refusal::Refusal;
use super::tile::Raster;
use super::validity::NoData;
use vlscan_survey::{VirtualRaster, VirtualSource};

/// Advice for a virtual raster that cannot be read.
const ONE_RASTER: &str = "gdal_translate in.vrt out.tif makes one raster of it";
/// Advice for a virtual raster whose type differs from that of a source.
const OTHER_TYPE: &str = "write dataType=\"Float64\" in its <VRTRasterBand>, or give all files one type with \
                          gdal_translate -ot Float32 in.tif out.tif and make it anew with gdalbuildvrt";

impl Mosaic {
    /// The grid of a virtual raster.
    pub fn of_virtual(raster: &VirtualRaster, warnings: &mut Vec<String>) -> Result<Mosaic, Misplaced> {
        let rasters = rasters_of(raster)?;
        let first = &rasters[0];
        warn_of_system(raster, first, warnings);
        let grid = raster.geo_transform.map(|c| Georeference::from_affine(c, false)).transpose();
        let grid = grid.map_err(|problem| (None, Refusal::unusable(raster.files[0].clone(), problem)))?;
        if grid.is_none() {
            warnings.push(UNPLACED.to_owned());
        }
        let [columns, rows] = raster.size;
        let placed = |source: &VirtualSource| {
            let tile = tile_of(source, raster, &rasters[source.file - 1], grid.as_ref());
            tile.map_err(|refusal| (Some(Box::new(source.place.clone())), refusal))
        };
        let tiles = raster.sources.iter().map(placed).collect::<Result<Vec<Tile>, Misplaced>>()?;
        let units = units_of(raster, first, warnings);
        let (horizontal, vertical) = metres(&units, warnings);
        let (scale, offset) =
            (raster.scale.unwrap_or(first.band.scale), raster.offset.unwrap_or(first.band.offset));
        if (scale, offset) != (1.0, 0.0) {
            warnings.push(scaled(scale, offset));
        }
        if raster.other_bands > 0 {
            warnings.push(bands(raster.other_bands + 1));
        }
        let mosaic = Mosaic {
            columns,
            rows,
            georeference: grid.unwrap_or(Georeference::UNKNOWN).scaled(horizontal),
            scale: scale * vertical,
            offset: offset * vertical,
            rasters,
            tiles,
        };
        mosaic.finished(warnings).map_err(|refusal| (None, refusal))
    }
}

/// The files of the sources, which have the same system, units and scale.
fn rasters_of(raster: &VirtualRaster) -> Result<Vec<Raster>, Misplaced> {
    let place_of =
        |file: usize| raster.sources.iter().find(|s| s.file == file).map(|s| Box::new(s.place.clone()));
    let mut rasters: Vec<Raster> = Vec::new();
    for (number, path) in raster.files.iter().enumerate().skip(1) {
        let found = Raster::find(path).and_then(|found| {
            rasters.first().map_or(Ok(()), |first| check_same(first, &found)).map(|()| found)
        });
        rasters.push(found.map_err(|refusal| (place_of(number), refusal))?);
    }
    Ok(rasters)
}

/// Warns of a virtual raster in another system than its sources.
fn warn_of_system(raster: &VirtualRaster, first: &Raster, warnings: &mut Vec<String>) {
    let system = raster.crs.as_deref().map_or(System::Unknown, System::of_wkt);
    if system != first.system && system != System::Unknown && first.system != System::Unknown {
        warnings.push(format!(
            "its coordinates are taken to be in {}, but {} is in {}",
            system.name(),
            first.file.path().display(),
            first.system.name()
        ));
    }
}

/// The tile of a source in a file, whose raster is `found`.
fn tile_of(
    source: &VirtualSource,
    raster: &VirtualRaster,
    found: &Raster,
    grid: Option<&Georeference>,
) -> Result<Tile, Refusal> {
    let own = &raster.files[0];
    let (window, target) = windows(source, raster, found)?;
    let (shown, pixels) = (found.file.path().display(), found.blocks.pixels());
    if !raster.pixels.holds(pixels) {
        let message = format!(
            "{} has the type {}, which does not hold every number of {shown}, {pixels}",
            own.display(),
            raster.pixels
        );
        return Err(Refusal::Apart(message, OTHER_TYPE));
    }
    if source.band > found.blocks.bands {
        let (band, bands) = (source.band, found.blocks.bands);
        let message = format!("band {band} of {shown} is named, which has {bands}");
        return Err(Refusal::Apart(message, ONE_RASTER));
    }
    if let (Some(grid), Some(placed)) = (grid, &found.georeference) {
        check_place(grid, placed, found, [&window, &target])
            .map_err(|what| Refusal::Apart(differ(own, found.file.path(), &what), ALIGN))?;
    }
    let stated = [found.no_data, source.no_data, raster.no_data];
    Ok(Tile {
        raster: source.file - 1,
        band: source.band - 1,
        no_data: NoData::new(stated.into_iter().flatten(), pixels),
        window,
        at: [target.left, target.top],
        overlaps: false,
    })
}

/// The pixels of a source in its file and in the virtual raster.
fn windows(
    source: &VirtualSource,
    raster: &VirtualRaster,
    found: &Raster,
) -> Result<(Window, Window), Refusal> {
    let shown = found.file.path().display();
    let of = |[left, top, width, height]: [usize; 4]| Window { left, top, width, height };
    let extent = of([0, 0, raster.size[0], raster.size[1]]);
    let image = whole(found);
    let window = source.window.map_or(image, of);
    let target = source.target.map_or(extent, of);
    for (part, of, what) in [(window, image, "<SrcRect>"), (target, extent, "<DstRect>")] {
        if part.pixels() == 0 || part.intersection(&of) != Some(part) {
            let message = format!(
                "{what} of {shown} reaches from column {} and row {} over {} x {} pixels, beyond the {} x {} \
                 that there are",
                part.left, part.top, part.width, part.height, of.width, of.height
            );
            return Err(Refusal::Apart(message, ONE_RASTER));
        }
    }
    if (window.width, window.height) != (target.width, target.height) {
        let message = format!(
            "{} x {} pixels of {shown} would be resampled to {} x {}, which is not supported",
            window.width, window.height, target.width, target.height
        );
        return Err(Refusal::Apart(message, ONE_RASTER));
    }
    Ok((window, target))
}

/// Checks that a file lies where the virtual raster has it: the pixels of the first window, of the file, at
/// those of the second, of the grid.
fn check_place(
    grid: &Georeference,
    placed: &Georeference,
    found: &Raster,
    [window, target]: [&Window; 2],
) -> Result<(), Misalignment> {
    let start = start_in(grid, placed, found)?;
    let there = [0, 1].map(|a| [target.left, target.top][a] as i64 - [window.left, window.top][a] as i64);
    match [start[0] - there[0], start[1] - there[1]] {
        [0, 0] => Ok(()),
        apart => Err(Misalignment::Elsewhere(apart)),
    }
}

/// The units of a virtual raster: its own as far as it states them, else those of its sources.
fn units_of(raster: &VirtualRaster, first: &Raster, warnings: &mut Vec<String>) -> [Option<LengthUnit>; 2] {
    let [horizontal, vertical] = first.units.clone();
    let horizontal = horizontal.or_else(|| match System::of_wkt(raster.crs.as_deref()?) {
        System::Epsg(code) => vlscan_crs::length_unit(code.into()),
        System::Defined(text, _) => keys::length_in(&text),
        System::Unknown => None,
    });
    let vertical = vertical.or_else(|| keys::height_unit_in(raster.crs.as_deref()?));
    let Some(name) = &raster.unit else { return [horizontal, vertical] };
    let own = LengthUnit::of_name(name);
    if own.is_none() {
        warnings.push(format!(
            "the unit \"{name}\" of its heights is not known; it is taken as that of its sources"
        ));
    }
    [horizontal, own.or(vertical)]
}
