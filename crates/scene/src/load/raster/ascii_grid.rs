//! ESRI ASCII grids: heights as text, read as the GeoTIFF of 32-bit floats that `gdal_translate` makes of
//! them, so that they behave like other rasters.

use super::error::GridError;
use super::prj::prj_text;
use std::io::Cursor;
use std::path::Path;
use tiff::encoder::TiffEncoder;
use tiff::encoder::colortype::Gray32Float;
use tiff::tags::Tag;
use vlscan_base::columns::comma_note;
use vlscan_crs as crs;

/// Maximum number of cells, so that the raster is a TIFF file of 32-bit offsets.
const MAX_CELLS: usize = 1 << 29;

/// GeoKeys and their values (OGC GeoTIFF 1.1).
const MODEL_TYPE: u16 = 1024;
const PROJECTED_MODEL: u16 = 1;
const GEOGRAPHIC_MODEL: u16 = 2;
const RASTER_TYPE: u16 = 1025;
const PIXEL_IS_AREA: u16 = 1;
const PROJECTED_SYSTEM: u16 = 3072;

/// A grid: its header, and its heights row by row from the north west.
#[derive(Debug, PartialEq)]
struct Grid<'t> {
    columns: usize,
    rows: usize,
    /// Steps to the east and to the north.
    steps: [f64; 2],
    /// South-western corner.
    corner: [f64; 2],
    /// The number of cells without a height, as written.
    no_data: Option<&'t str>,
    heights: Vec<f32>,
}

/// The bytes of a GeoTIFF with the heights of the grid in `text`. A `.prj` file beside `path` names its
/// system and the units.
///
/// # Errors
/// Problem of a grid, with its line.
pub(super) fn geotiff(text: &[u8], path: &Path) -> Result<Vec<u8>, GridError> {
    let text = std::str::from_utf8(text).map_err(|_| GridError::NotText)?;
    let grid = Grid::read(text.trim_start_matches('\u{feff}'))?;
    let wkt = prj_text(path).filter(|text| crs::is_wkt(text)).unwrap_or_default();
    encoded(&grid, &keys(&wkt), &wkt).map_err(GridError::Encoding)
}

/// The keys of a system in WKT: those of its code, or that its coordinates are degrees. A system without a
/// code is read from the `.prj` file itself.
fn keys(wkt: &str) -> Vec<[u16; 4]> {
    let mut keys = vec![[RASTER_TYPE, 0, 1, PIXEL_IS_AREA]];
    match crs::projected_epsg(wkt) {
        Some(code) => keys.extend([[MODEL_TYPE, 0, 1, PROJECTED_MODEL], [PROJECTED_SYSTEM, 0, 1, code]]),
        None if crs::Units::of_wkt(wkt).horizontal == Some(crs::Unit::Angle) => {
            keys.push([MODEL_TYPE, 0, 1, GEOGRAPHIC_MODEL]);
        }
        None => {}
    }
    keys.sort_unstable();
    keys
}

fn encoded(grid: &Grid, keys: &[[u16; 4]], wkt: &str) -> tiff::TiffResult<Vec<u8>> {
    let mut file = Cursor::new(Vec::new());
    let mut encoder = TiffEncoder::new(&mut file)?;
    let size = |count: usize| u32::try_from(count).map_err(|_| tiff::TiffError::IntSizeError);
    let mut image = encoder.new_image::<Gray32Float>(size(grid.columns)?, size(grid.rows)?)?;
    let ([dx, dy], [west, south]) = (grid.steps, grid.corner);
    let tags = image.encoder();
    tags.write_tag(Tag::ModelPixelScaleTag, &[dx, dy, 0.0][..])?;
    tags.write_tag(Tag::ModelTiepointTag, &[0.0, 0.0, 0.0, west, south + grid.rows as f64 * dy, 0.0][..])?;
    let head = [1, 1, 0, keys.len() as u16];
    let words: Vec<u16> = head.into_iter().chain(keys.iter().copied().flatten()).collect();
    tags.write_tag(Tag::GeoKeyDirectoryTag, &words[..])?;
    if !wkt.is_empty() {
        // As programs of ESRI do: the units of heights and of systems without a code are in the text.
        let plain: String = wkt.chars().map(|c| if matches!(c, ' '..='~') { c } else { ' ' }).collect();
        tags.write_tag(Tag::GeoAsciiParamsTag, plain.as_str())?;
    }
    if let Some(no_data) = grid.no_data {
        tags.write_tag(Tag::GdalNodata, no_data)?;
    }
    image.write_data(&grid.heights)?;
    Ok(file.into_inner())
}

/// A line with its number, from 1.
type NumberedLine<'t> = (usize, &'t str);

impl<'t> Grid<'t> {
    fn read(text: &'t str) -> Result<Grid<'t>, GridError> {
        let lines = (1..).zip(text.split('\n').flat_map(|line| line.split('\r')).map(str::trim));
        let mut lines = lines.filter(|(_, line)| !line.is_empty()).peekable();
        let mut header = Header::default();
        while let Some(line) =
            lines.next_if(|(_, line)| line.starts_with(|c: char| c.is_ascii_alphabetic()) && !is_number(line))
        {
            header.take(line)?;
        }
        let mut grid = header.grid()?;
        // A height and its separator take at least two bytes.
        let cells = grid.columns.checked_mul(grid.rows).filter(|cells| *cells <= MAX_CELLS);
        let (columns, rows) = (grid.columns, grid.rows);
        let cells = cells.ok_or(GridError::TooLarge { columns, rows })?;
        if cells > text.len() {
            return Err(GridError::Truncated { columns, rows });
        }
        grid.heights.reserve_exact(cells);
        let (mut counts, mut last) = (Vec::new(), 0);
        for (number, line) in lines {
            let before = grid.heights.len();
            for word in line.split_ascii_whitespace() {
                grid.heights.push(match height(word, number) {
                    // The number of missing heights may be beyond 32 bits.
                    Err(_) if grid.no_data == Some(word) => f32::NAN,
                    height => height?,
                });
            }
            counts.push((number, grid.heights.len() - before));
            last = number;
        }
        check_counts(&grid, &counts, last, cells)?;
        Ok(grid)
    }
}

/// Rejects grids with other numbers of heights than the header states. Rows may continue in further lines.
fn check_counts(grid: &Grid, counts: &[(usize, usize)], last: usize, cells: usize) -> Result<(), GridError> {
    if grid.heights.len() == cells {
        return Ok(());
    }
    let has_rows = counts.iter().any(|(_, count)| *count == grid.columns);
    let odd = counts.iter().find(|(_, count)| *count != grid.columns);
    Err(match odd {
        Some(&(line, found)) if has_rows => GridError::Row { line, columns: grid.columns, found },
        _ => GridError::Count {
            line: last,
            cells,
            rows: grid.rows,
            columns: grid.columns,
            found: grid.heights.len(),
        },
    })
}

/// The keys of a header.
#[derive(Default)]
struct Header<'t> {
    values: Vec<(String, usize, &'t str)>,
}

/// The keys that are read, in small letters.
const KEYS: [&str; 12] = [
    "ncols",
    "nrows",
    "xllcorner",
    "yllcorner",
    "xllcenter",
    "yllcenter",
    "xllcentre",
    "yllcentre",
    "cellsize",
    "dx",
    "dy",
    "nodata_value",
];

impl<'t> Header<'t> {
    fn take(&mut self, (number, line): NumberedLine<'t>) -> Result<(), GridError> {
        let mut words = line.split_ascii_whitespace();
        let key = words.next().unwrap_or_default().to_ascii_lowercase();
        if !KEYS.contains(&key.as_str()) {
            return Err(GridError::UnknownKey { line: number, key, known: KEYS.join(", ") });
        }
        let (Some(value), None) = (words.next(), words.next()) else {
            return Err(GridError::Value { line: number, key, found: line.to_owned() });
        };
        if self.values.iter().any(|(known, ..)| *known == key) {
            return Err(GridError::SecondKey { line: number, key });
        }
        self.values.push((key, number, value));
        Ok(())
    }

    fn text(&self, key: &str) -> Option<(usize, &'t str)> {
        self.values.iter().find(|(known, ..)| known == key).map(|(_, number, value)| (*number, *value))
    }

    fn number(&self, key: &str) -> Result<Option<f64>, GridError> {
        let Some((line, text)) = self.text(key) else { return Ok(None) };
        let value = text.parse::<f64>().ok().filter(|value| value.is_finite());
        value.map(Some).ok_or_else(|| not_a_number(line, key, text))
    }

    fn count(&self, key: &str) -> Result<usize, GridError> {
        let value = self.number(key)?.ok_or_else(|| GridError::MissingKey { key: key.to_owned() })?;
        let is_count = value.fract() == 0.0 && (1.0..=f64::from(u32::MAX)).contains(&value);
        is_count
            .then_some(value as usize)
            .ok_or_else(|| GridError::NotACount { key: key.to_owned(), found: value })
    }

    /// The step of an axis.
    fn step(&self, axis: &str) -> Result<f64, GridError> {
        let step = match (self.number("cellsize")?, self.number(axis)?) {
            (Some(step), None) | (None, Some(step)) => step,
            (Some(_), Some(_)) => {
                return Err(GridError::BothKeys { one: "cellsize".to_owned(), other: axis.to_owned() });
            }
            (None, None) => {
                return Err(GridError::MissingKey { key: "cellsize, or dx and dy,".to_owned() });
            }
        };
        (step > 0.0).then_some(step).ok_or(GridError::CellSize(step))
    }

    /// The western or southern border, of the corner or the centre of the first cell.
    fn border(&self, axis: char, step: f64) -> Result<f64, GridError> {
        let [corner, centre, other] = ["corner", "center", "centre"].map(|place| format!("{axis}ll{place}"));
        let centre = self.number(&centre)?.or(self.number(&other)?);
        match (self.number(&corner)?, centre) {
            (Some(corner), None) => Ok(corner),
            (None, Some(centre)) => Ok(centre - 0.5 * step),
            (Some(_), Some(_)) => Err(GridError::BothKeys { one: corner, other: format!("{axis}llcenter") }),
            (None, None) => Err(GridError::MissingKey { key: format!("{corner} or {axis}llcenter") }),
        }
    }

    fn grid(&self) -> Result<Grid<'t>, GridError> {
        let steps = [self.step("dx")?, self.step("dy")?];
        if let Some((line, text)) = self.text("nodata_value")
            && text.parse::<f64>().is_err()
        {
            return Err(not_a_number(line, "nodata_value", text));
        }
        Ok(Grid {
            columns: self.count("ncols")?,
            rows: self.count("nrows")?,
            steps,
            corner: [self.border('x', steps[0])?, self.border('y', steps[1])?],
            no_data: self.text("nodata_value").map(|(_, text)| text),
            heights: Vec::new(),
        })
    }
}

/// True if a line begins with a number that is a word: `nan`.
fn is_number(line: &str) -> bool {
    line.split_ascii_whitespace().next().is_some_and(|word| word.parse::<f64>().is_ok())
}

fn height(word: &str, number: usize) -> Result<f32, GridError> {
    let value = word.parse::<f32>().ok().filter(|value| !value.is_infinite());
    value.ok_or_else(|| GridError::Height { line: number, found: shown(word), note: comma_note(word) })
}

fn not_a_number(line: usize, key: &str, found: &str) -> GridError {
    GridError::NotANumber { line, key: key.to_owned(), found: found.to_owned() }
}

fn shown(word: &str) -> String {
    word.chars().take(40).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEAD: &str =
        "ncols 3\nnrows 2\nxllcorner 431000.5\nyllcorner 5412000\ncellsize 2\nNODATA_value -9999\n";

    fn read(text: &str) -> Result<Grid<'_>, String> {
        Grid::read(text).map_err(|e| e.to_string())
    }

    #[test]
    fn headers_in_all_forms_give_the_same_grid() {
        let heights = "1 2 3\n4.5 -9999 6\n";
        let text = format!("{HEAD}{heights}");
        let grid = read(&text).unwrap();
        assert_eq!(
            (grid.columns, grid.rows, grid.steps, grid.corner),
            (3, 2, [2.0, 2.0], [431_000.5, 5_412_000.0])
        );
        assert_eq!(
            (grid.no_data, &grid.heights[..]),
            (Some("-9999"), &[1.0, 2.0, 3.0, 4.5, -9999.0, 6.0][..])
        );
        for other in [
            text.to_uppercase(),
            text.replace('\n', "\r\n"),
            text.replace('\n', "\r"),
            text.replace("xllcorner 431000.5", "XLLCENTER 431001.5")
                .replace("yllcorner 5412000", "yllcenter\t5412001"),
            text.replace("cellsize 2", "dx 2.0\ndy 2"),
            text.replace("1 2 3\n4.5 -9999 6", " 1 2\n3 4.5\n-9999 6"),
            text.replace("1 2 3\n4.5", "1 2 3 4.5"),
        ] {
            assert_eq!(read(&other).unwrap(), grid, "{other}");
        }
    }

    #[test]
    fn wrong_grids_are_refused_with_their_line() {
        let whole = format!("{HEAD}1 2 3\n4 5 6\n");
        for (from, to, part) in [
            ("4 5 6", "4 5", "line 8: expected 3 heights (ncols), found 2"),
            ("4 5 6", "4 5 6 7", "line 8: expected 3 heights (ncols), found 4"),
            ("\n4 5 6", "", "line 7: expected 6 heights (2 rows of 3), found 3"),
            ("4 5 6", "4 5 6\n7 8 9", "line 9: expected 6 heights (2 rows of 3), found 9"),
            ("4 5 6", "4,5 5 6", "line 8: expected a height, found \"4,5\""),
            ("4 5 6", "4 inf 6", "line 8: expected a height, found \"inf\""),
            ("cellsize 2", "cellsize 0,5", "line 5: expected a number as cellsize, found \"0,5\""),
            ("cellsize 2", "cellsize 0", "a cell size above 0"),
            ("cellsize 2", "dx 2", "expected cellsize, or dx and dy"),
            ("cellsize 2", "cellsize 2\ncellsize 3", "line 6: a second cellsize"),
            ("ncols 3", "ncols 2.5", "a whole number above 0 as ncols"),
            ("ncols 3", "ncols 3 4", "line 1: expected ncols and one value"),
            ("nrows 2", "nrows 4000000000", "are too many"),
            ("nrows 2", "nrows 100000", "more than it holds; is it truncated?"),
            ("xllcorner", "xllcenter 1\nxllcorner", "expected xllcorner or xllcenter, found both"),
            ("yllcorner 5412000\n", "", "expected yllcorner or yllcenter"),
            ("NODATA_value -9999", "colour red", "line 6: unknown key `colour`"),
        ] {
            let text = whole.replacen(from, to, 1);
            let said = read(&text).unwrap_err();
            assert!(said.contains(part), "{text}: {said}");
        }
    }

    proptest::proptest! {
        #[test]
        fn any_text_is_read_or_refused(rest in "[-0-9a-z. \n,]{0,80}", columns in 0_u64..1 << 40) {
            let _ = read(&format!("ncols {columns}\nnrows 3\nxllcorner 0\nyllcorner 0\ncellsize 1\n{rest}"));
        }
    }
}
