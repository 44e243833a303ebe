//! Virtual rasters of GDAL (VRT, <https://gdal.org/en/stable/drivers/raster/vrt.html>): windows of files,
//! pixel by pixel, in one grid. Anything that would change values or positions of pixels, such as resampling,
//! warping or lookup tables, is an error.

use super::context::Context;
use super::xml::{Element, XmlDocument};
use super::xml_limits::MAX_DOCUMENT_BYTES;
use super::{PixelType, VirtualRaster, VirtualSource};
use std::path::{Path, PathBuf};
use std::str::FromStr;
use vlscan_base::error::Error;
use vlscan_base::files::reads;
use vlscan_base::recognise::{Expected, foreign};

/// Elements of a virtual raster without effect on heights.
const OF_DATASET: [&str; 9] = [
    "SRS",
    "GeoTransform",
    "Metadata",
    "VRTRasterBand",
    "MaskBand",
    "OverviewList",
    "BlockXSize",
    "BlockYSize",
    "OverviewListResampling",
];
/// Elements of a band that are read or have no effect on heights.
const OF_BAND: [&str; 15] = [
    "NoDataValue",
    "HideNoDataValue",
    "Scale",
    "Offset",
    "UnitType",
    "Description",
    "ColorInterp",
    "CategoryNames",
    "Metadata",
    "Histograms",
    "GDALRasterAttributeTable",
    "Overview",
    "MaskBand",
    SIMPLE,
    COMPLEX,
];
/// Elements of a source that are read or have no effect on heights.
const OF_SOURCE: [&str; 11] = [
    "SourceFilename",
    "SourceBand",
    "SourceProperties",
    "SrcRect",
    "DstRect",
    "NODATA",
    "NoDataValue",
    "UseMaskBand",
    "ScaleOffset",
    "ScaleRatio",
    OPEN_OPTIONS,
];
const OPEN_OPTIONS: &str = "OpenOptions";
/// Open options of a source without effect on heights: they concern speed, or how damage is treated.
const NEUTRAL_OPTIONS: [&str; 3] = ["NUM_THREADS", "IGNORE_COG_LAYOUT_BREAK", "WARN_ABOUT_COG_LAYOUT_BREAK"];
const SIMPLE: &str = "SimpleSource";
const COMPLEX: &str = "ComplexSource";

/// Maximum distance of the borders of a window from those of pixels, pixels: GDAL computes them from
/// coordinates.
const MAX_WINDOW_ERROR: f64 = 1e-3;

/// Reads a virtual raster. Problems are recorded in `context`.
pub(super) fn read_virtual_raster(context: &Context, path: &Path) -> Option<VirtualRaster> {
    let bytes = match context.read(path, MAX_DOCUMENT_BYTES) {
        Ok(bytes) => bytes,
        Err(e) => {
            context.failure.borrow_mut().get_or_insert(Error::open(path, e));
            return None;
        }
    };
    if let Some(found) = foreign(path, &bytes, &Expected::VIRTUAL_RASTER) {
        found.report(path, &mut context.problems.borrow_mut());
        return None;
    }
    let document = XmlDocument::parse(path, &bytes, &mut context.problems.borrow_mut())?;
    Reader { context, files: vec![path.to_path_buf()] }.dataset(&document.root())
}

struct Reader<'c> {
    context: &'c Context,
    files: Vec<PathBuf>,
}

impl Reader<'_> {
    fn dataset(mut self, root: &Element) -> Option<VirtualRaster> {
        if root.name() != "VRTDataset" {
            let message = format!("the root element is `{}`, expected `VRTDataset`", root.name());
            self.context.error(root.place(), message);
            return None;
        }
        self.refuse_kind(root)?;
        self.refuse_others(root, &OF_DATASET)?;
        let size = [self.attribute(root, "rasterXSize")?, self.attribute(root, "rasterYSize")?];
        if size.contains(&0) {
            self.context.error(root.place(), "a virtual raster of 0 pixels has no heights");
            return None;
        }
        let geo_transform = match root.child("GeoTransform") {
            Some(element) => Some(self.geo_transform(&element)?),
            None => None,
        };
        let mut bands = root.named("VRTRasterBand").collect::<Vec<_>>();
        let first = bands.iter().position(|band| band.value("band").is_none_or(|number| number == "1"));
        let Some(first) = first else {
            self.context.error(root.place(), "expected a <VRTRasterBand> with band=\"1\", found none");
            return None;
        };
        let band = bands.remove(first);
        let is_alpha =
            |band: &Element| band.child("ColorInterp").is_some_and(|kind| kind.content().trim() == "Alpha");
        let crs = root.child("SRS").map(|srs| srs.content().trim().to_owned()).filter(|srs| !srs.is_empty());
        self.refuse_kind(&band)?;
        self.refuse_others(&band, &OF_BAND)?;
        let type_name = band.value("dataType").unwrap_or("Byte");
        let Some((_, pixels)) = PixelType::NAMES.into_iter().find(|(name, _)| *name == type_name) else {
            let names = PixelType::NAMES.map(|(name, _)| name).join(", ");
            let message = format!("the type of pixels is `{type_name}`, expected one of {names}");
            self.context.error(band.value_place("dataType"), message);
            return None;
        };
        if let Some(hidden) = band.child("HideNoDataValue").filter(|element| element.content().trim() != "0")
        {
            self.unsupported(&hidden, "hides the number of pixels without data");
            return None;
        }
        let sources: Vec<_> = band.children().filter(|e| [SIMPLE, COMPLEX].contains(&e.name())).collect();
        let no_data = self.number_in(&band, "NoDataValue")?;
        sources.iter().for_each(|source| self.warn_of_no_data(source, no_data));
        let sources: Vec<_> = sources.iter().map(|source| self.source(source)).collect();
        let raster = VirtualRaster {
            size,
            geo_transform,
            crs,
            pixels,
            no_data,
            scale: self.number_in(&band, "Scale")?,
            offset: self.number_in(&band, "Offset")?,
            unit: band
                .child("UnitType")
                .map(|unit| unit.content().trim().to_owned())
                .filter(|unit| !unit.is_empty()),
            other_bands: bands.iter().filter(|band| !is_alpha(band)).count(),
            sources: sources.into_iter().collect::<Option<_>>()?,
            files: self.files,
        };
        if raster.sources.is_empty() {
            self.context.error(band.place(), format!("the band has neither a <{SIMPLE}> nor a <{COMPLEX}>"));
            return None;
        }
        Some(raster)
    }

    /// Warns of a `NoDataValue` in a source, which GDAL ignores, if it differs from the band's.
    fn warn_of_no_data(&self, source: &Element, of_band: Option<f64>) {
        let Some(element) = source.child("NoDataValue") else { return };
        let is_same = |value: f64| of_band.is_some_and(|of| of == value || of.is_nan() && value.is_nan());
        if !element.content().trim().parse().is_ok_and(is_same) {
            let message = "<NoDataValue> in a source has no effect, as in GDAL";
            let help = "<NODATA> in a <ComplexSource> states the value of pixels without data of a file";
            self.context.warn_help(element.place(), message, help);
        }
    }

    fn source(&mut self, source: &Element) -> Option<VirtualSource> {
        self.refuse_others(source, &OF_SOURCE)?;
        self.refuse_options(source)?;
        for (name, neutral) in [("ScaleOffset", 0.0), ("ScaleRatio", 1.0)] {
            if let Some(element) = source.child(name)
                && self.number::<f64>(&element)? != neutral
            {
                self.unsupported(&element, "changes the numbers of pixels");
                return None;
            }
        }
        let Some(name) = source.child("SourceFilename") else {
            self.context.error(source.place(), format!("a <{}> needs a <SourceFilename>", source.name()));
            return None;
        };
        let band = match source.child("SourceBand") {
            Some(element) if element.content().trim().starts_with("mask") => {
                self.unsupported(&element, "names a mask, which holds no heights");
                return None;
            }
            Some(element) => self.number(&element)?,
            None => 1,
        };
        if band == 0 {
            self.context.error(source.place(), "bands are numbered from 1, found band 0");
            return None;
        }
        let (window, target) = (self.window(source, "SrcRect")?, self.window(source, "DstRect")?);
        if let (Some([.., width, height]), Some([.., columns, rows])) = (window, target)
            && [width, height] != [columns, rows]
        {
            let message = format!(
                "a window of {width} x {height} pixels is resampled to {columns} x {rows}, which is not \
                 supported: <SrcRect> and <DstRect> must have the same size"
            );
            let place = source.child("DstRect").unwrap_or_else(|| source.clone()).place();
            self.context.error_help(place, message, "gdalwarp -tr brings tiles to one pixel size first");
            return None;
        }
        let no_data = self.number_in(source, "NODATA")?;
        Some(VirtualSource { file: self.file(&name)?, band, window, target, no_data, place: name.place() })
    }

    /// The index of a file, which is added if it is new.
    fn file(&mut self, name: &Element) -> Option<usize> {
        let written = name.content().trim();
        if written.starts_with("/vsi") {
            self.unsupported(name, &format!("names `{written}`, a virtual file of GDAL"));
            return None;
        }
        if written.to_lowercase().ends_with(".vrt") {
            self.unsupported(name, &format!("names `{written}`, which is virtual itself"));
            return None;
        }
        let is_relative = name.value("relativeToVRT").is_some_and(|value| value.trim() == "1");
        let path = match is_relative {
            true => Some(name.folder().join(written)).filter(|path| reads::is_file(path)),
            false => self.context.assets.file(written, name.folder()).map(|located| located.found),
        };
        let Some(path) = path else {
            let help = match is_relative {
                true => format!("searched in: {}", folder_shown(name.folder())),
                false => self.context.assets.searched(written, name.folder()),
            };
            let message = format!("cannot find the raster `{written}` of <SourceFilename>");
            self.context.not_found(name.place(), message, help);
            return None;
        };
        let known = self.files.iter().skip(1).position(|file| *file == path);
        Some(known.map_or_else(
            || {
                self.files.push(path);
                self.files.len() - 1
            },
            |at| at + 1,
        ))
    }

    fn geo_transform(&self, element: &Element) -> Option<[f64; 6]> {
        let numbers: Option<Vec<f64>> = element
            .content()
            .split(',')
            .map(|word| word.trim().parse().ok().filter(|n: &f64| n.is_finite()))
            .collect();
        let numbers = numbers.and_then(|numbers| <[f64; 6]>::try_from(numbers).ok());
        if numbers.is_none() {
            let message = format!("<GeoTransform> is \"{}\", expected six numbers", element.content().trim());
            self.context.error(element.place(), message);
        }
        numbers
    }

    /// First column and row, number of columns and rows; `Some(None)` without the element.
    fn window(&self, source: &Element, name: &str) -> Option<Option<[usize; 4]>> {
        let Some(element) = source.child(name) else { return Some(None) };
        let mut window = [0; 4];
        for (number, attribute) in window.iter_mut().zip(["xOff", "yOff", "xSize", "ySize"]) {
            let written: f64 = self.attribute(&element, attribute)?;
            let whole = written.round();
            if !(0.0..=f64::from(u32::MAX)).contains(&whole) || (written - whole).abs() > MAX_WINDOW_ERROR {
                let message =
                    format!("`{attribute}` of <{name}> is {written}, expected a whole number of pixels");
                let help = "parts of pixels would be resampled, which is not supported; gdalwarp -tap aligns \
                            tiles first";
                self.context.error_help(element.value_place(attribute), message, help);
                return None;
            }
            *number = whole as usize;
        }
        Some(Some(window))
    }

    /// The number in a child element; `Some(None)` without it.
    fn number_in(&self, parent: &Element, name: &str) -> Option<Option<f64>> {
        parent.child(name).map_or(Some(None), |element| self.number(&element).map(Some))
    }

    fn number<T: FromStr>(&self, element: &Element) -> Option<T> {
        let text = element.content().trim();
        let number = text.parse().ok();
        if number.is_none() {
            let message = format!("<{}> is \"{text}\", expected a number", element.name());
            self.context.error(element.place(), message);
        }
        number
    }

    fn attribute<T: FromStr>(&self, element: &Element, name: &str) -> Option<T> {
        let Some(text) = element.value(name) else {
            self.context.error(element.place(), format!("<{}> needs the attribute `{name}`", element.name()));
            return None;
        };
        let number = text.trim().parse().ok();
        if number.is_none() {
            let message = format!("`{name}` of <{}> is \"{text}\", expected a number", element.name());
            self.context.error(element.value_place(name), message);
        }
        number
    }

    /// Rejects warped, pansharpened and derived rasters and bands.
    fn refuse_kind(&self, element: &Element) -> Option<()> {
        let Some(kind) = element.value("subClass") else { return Some(()) };
        let message = format!("<{}> of the kind `{kind}` is not supported", element.name());
        self.context.error_help(element.value_place("subClass"), message, MAKE_FILE);
        None
    }

    fn refuse_others(&self, element: &Element, known: &[&str]) -> Option<()> {
        let unknown: Vec<_> = element.children().filter(|child| !known.contains(&child.name())).collect();
        unknown.iter().for_each(|child| self.unsupported(child, "may change heights or where they are"));
        unknown.is_empty().then_some(())
    }

    /// Rejects open options of a source that may change its pixels.
    fn refuse_options(&self, source: &Element) -> Option<()> {
        let Some(options) = source.child(OPEN_OPTIONS) else { return Some(()) };
        for option in options.children() {
            let key = option.value("key").unwrap_or_default().trim().to_uppercase();
            let is_default = key == "OVERVIEW_LEVEL" && option.content().trim().eq_ignore_ascii_case("NONE");
            if !is_default && !NEUTRAL_OPTIONS.contains(&key.as_str()) {
                self.unsupported(
                    &option,
                    &format!("sets `{key}`, which may change heights or where they are"),
                );
                return None;
            }
        }
        Some(())
    }

    fn unsupported(&self, element: &Element, why: &str) {
        let message = format!("<{}> is not supported: it {why}", element.name());
        self.context.error_help(element.place(), message, MAKE_FILE);
    }
}

const MAKE_FILE: &str = "gdal_translate in.vrt out.tif makes a raster of it";

fn folder_shown(folder: &Path) -> String {
    if folder.as_os_str().is_empty() { ".".to_owned() } else { folder.display().to_string() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ReadOptions;
    use vlscan_render::Render as _;

    const SOURCE: &str = "<SourceFilename relativeToVRT=\"1\">a.tif</SourceFilename><SourceBand>1</SourceBand>
        <SourceProperties RasterXSize=\"9\" RasterYSize=\"7\" DataType=\"Float32\" BlockXSize=\"9\" BlockYSize=\"7\"/>
        <SrcRect xOff=\"0\" yOff=\"1\" xSize=\"9\" ySize=\"6\"/><DstRect xOff=\"3.0000001\" yOff=\"2\" xSize=\"9\" ySize=\"6\"/>";

    fn document(source: &str, band: &str, dataset: &str) -> String {
        format!(
            "<VRTDataset rasterXSize=\"12\" rasterYSize=\"8\">\n<SRS dataAxisToSRSAxisMapping=\"1,2\">EPSG:25832</SRS>\n\
             <GeoTransform> 1.0e+02, 2, 0, 50, 0,-4 </GeoTransform>{dataset}\n\
             <VRTRasterBand dataType=\"Float32\" band=\"1\">{band}\n<ComplexSource>{source}</ComplexSource>\n</VRTRasterBand>\n\
             </VRTDataset>"
        )
    }

    fn read(text: &str) -> Result<VirtualRaster, String> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("all.vrt");
        std::fs::write(folder.path().join("a.tif"), "").unwrap();
        std::fs::write(&path, text).unwrap();
        let context = Context::new(&ReadOptions::default());
        let raster = read_virtual_raster(&context, &path);
        context.finish(raster).map(|found| found.0).map_err(|e| match e {
            Error::Input(problems) => problems.render(false),
            other => other.to_string(),
        })
    }

    #[test]
    fn windows_and_numbers_are_read() {
        let found = read(&document(
            &format!("{SOURCE}<NODATA>-9999</NODATA>"),
            "<NoDataValue>nan</NoDataValue><Scale>0.1</Scale><UnitType>metre</UnitType>",
            "",
        ))
        .unwrap();
        assert_eq!((found.size, found.geo_transform), ([12, 8], Some([100.0, 2.0, 0.0, 50.0, 0.0, -4.0])));
        assert_eq!((found.crs.as_deref(), found.unit.as_deref()), (Some("EPSG:25832"), Some("metre")));
        assert!(found.no_data.unwrap().is_nan() && found.scale == Some(0.1) && found.offset.is_none());
        let source = &found.sources[0];
        assert_eq!((source.window, source.target), (Some([0, 1, 9, 6]), Some([3, 2, 9, 6])));
        assert_eq!((source.no_data, source.band, source.file), (Some(-9999.0), 1, 1));
        assert_eq!(found.files.len(), 2);
    }

    #[test]
    fn what_changes_heights_is_an_error_with_its_line() {
        let of_source = |more: &str| document(&format!("{SOURCE}{more}"), "", "");
        let changed = |from: &str, to: &str| document(&SOURCE.replace(from, to), "", "");
        for (text, expected) in [
            (of_source("<LUT>0:0,1:5</LUT>"), "<LUT> is not supported"),
            (of_source("\n<ScaleRatio>2</ScaleRatio>"), "<ScaleRatio> is not supported"),
            (of_source("<NODATA>none</NODATA>"), "<NODATA> is \"none\", expected a number"),
            (
                changed("xSize=\"9\" ySize=\"6\"/><Dst", "xSize=\"9\" ySize=\"5\"/><Dst"),
                "is resampled to 9 x 6",
            ),
            (changed("yOff=\"1\"", "yOff=\"1.5\""), "`yOff` of <SrcRect> is 1.5"),
            (changed("yOff=\"1\" ", ""), "<SrcRect> needs the attribute `yOff`"),
            (changed("a.tif", "b.tif"), "cannot find the raster `b.tif`"),
            (changed("a.tif", "/vsizip/a.zip/a.tif"), "a virtual file of GDAL"),
            (changed("<SourceBand>1", "<SourceBand>mask,1"), "names a mask"),
            (document(SOURCE, "<KernelFilteredSource/>", ""), "<KernelFilteredSource> is not supported"),
            (document(SOURCE, "", "<GCPList/>"), "<GCPList> is not supported"),
            (
                document(SOURCE, "", "").replace("Float32\" b", "CFloat32\" b"),
                "the type of pixels is `CFloat32`",
            ),
            (
                document(SOURCE, "", "").replace("<VRTDataset", "<VRTDataset subClass=\"VRTWarpedDataset\""),
                "VRTWarpedDataset",
            ),
            (document(SOURCE, "", "").replace("1.0e+02,", ""), "expected six numbers"),
            (document(SOURCE, "", "").replace("band=\"1\"", "band=\"2\""), "with band=\"1\", found none"),
            ("<VRTDataset rasterXSize=\"1\"/>".to_owned(), "needs the attribute `rasterYSize`"),
            ("<document/>".to_owned(), "expected a virtual raster"),
        ] {
            let report = read(&text).unwrap_err();
            assert!(report.contains(expected) && report.contains("all.vrt"), "{expected}: {report}");
        }
    }
}
