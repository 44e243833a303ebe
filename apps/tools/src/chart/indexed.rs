//! Small PNG files: pictures with a palette of sixteen colours.

use super::picture::{Picture, Rgb};
use vlscan_base::error::{Error, Result};

/// Colours of the palette, which four bits count.
const COLOURS: usize = 16;

/// Colours of a cell of the histogram: five bits of each channel.
#[derive(Clone, Copy, Default)]
struct Cell {
    count: u64,
    sum: [u64; 3],
}

impl Cell {
    fn add(&mut self, count: u64, sum: [u64; 3]) {
        self.count += count;
        self.sum = std::array::from_fn(|c| self.sum[c] + sum[c]);
    }

    /// Mean colour.
    fn mean(&self) -> Rgb {
        self.sum.map(|sum| (sum / self.count.max(1)) as u8)
    }
}

fn cell_of(dot: Rgb) -> usize {
    dot.iter().fold(0, |cell, channel| (cell << 5) | usize::from(channel >> 3))
}

fn distance(a: Rgb, b: Rgb) -> u64 {
    let square = |c: usize| u64::from(a[c].abs_diff(b[c])).pow(2);
    square(0) + square(1) + square(2)
}

/// Index of the nearest colour, and its distance squared.
fn nearest(palette: &[Rgb], colour: Rgb) -> (usize, u64) {
    let distances = palette.iter().enumerate().map(|(index, other)| (index, distance(*other, colour)));
    distances.min_by_key(|(_, distance)| *distance).unwrap_or((0, 0))
}

/// Colours that stand for all colours of the histogram: each is the one most in need of a nearer colour, and
/// then the mean of those nearest to it.
fn palette_of(cells: &[Cell]) -> Vec<Rgb> {
    let mut palette: Vec<Rgb> = Vec::new();
    while palette.len() < COLOURS {
        let need = |cell: &&Cell| match palette.is_empty() {
            true => cell.count,
            false => nearest(&palette, cell.mean()).1.saturating_mul(cell.count),
        };
        match cells.iter().max_by_key(need) {
            Some(cell) if need(&cell) > 0 => palette.push(cell.mean()),
            _ => break,
        }
    }
    let mut groups = vec![Cell::default(); palette.len()];
    for cell in cells {
        groups[nearest(&palette, cell.mean()).0].add(cell.count, cell.sum);
    }
    groups.iter().map(Cell::mean).collect()
}

impl Picture {
    /// The image as a small PNG file of sixteen colours.
    ///
    /// # Errors
    /// [`Error::Internal`] if the encoder fails.
    pub fn indexed_png(&self) -> Result<Vec<u8>> {
        let mut histogram = vec![Cell::default(); 1 << 15];
        for dot in self.dots() {
            histogram[cell_of(*dot)].add(1, dot.map(u64::from));
        }
        let used: Vec<Cell> = histogram.iter().filter(|cell| cell.count > 0).copied().collect();
        let palette = palette_of(&used);
        let index: Vec<u8> = histogram.iter().map(|cell| nearest(&palette, cell.mean()).0 as u8).collect();
        let [width, height] = self.size();
        let mut packed = Vec::new();
        for row in self.dots().chunks(width.max(1) as usize) {
            packed.extend(row.chunks(2).map(|pair| {
                let [left, right] = [0_usize, 1].map(|i| pair.get(i).map_or(0, |dot| index[cell_of(*dot)]));
                (left << 4) | right
            }));
        }
        let failed = |e: png::EncodingError| Error::Internal(format!("PNG encoding: {e}"));
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, width, height);
        encoder.set_color(png::ColorType::Indexed);
        encoder.set_depth(png::BitDepth::Four);
        encoder.set_palette(palette.as_flattened());
        encoder.set_compression(png::Compression::High);
        encoder.set_filter(png::Filter::NoFilter);
        let mut writer = encoder.write_header().map_err(failed)?;
        writer.write_image_data(&packed).map_err(failed)?;
        writer.finish().map_err(failed)?;
        Ok(bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_indexed_png_has_the_colours_that_are_frequent_or_far_from_others() {
        let mut picture = Picture::new(31, 9, [10, 20, 30]);
        picture.set(30, 8, [250, 0, 0]);
        for x in 0..31 {
            picture.set(x, 0, [0, 8 * x as u8, 200]);
        }
        let bytes = picture.indexed_png().unwrap();
        let mut decoder = png::Decoder::new(std::io::Cursor::new(&bytes));
        decoder.set_transformations(png::Transformations::EXPAND);
        let mut reader = decoder.read_info().unwrap();
        let mut dots = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut dots).unwrap();
        assert_eq!((info.width, info.height), (31, 9));
        assert_eq!(
            (&dots[dots.len() - 3..], &dots[31 * 3..31 * 3 + 3]),
            (&[250, 0, 0][..], &[10, 20, 30][..])
        );
        assert!(distance([dots[30], dots[31], dots[32]], [0, 80, 200]) < 400, "{:?}", &dots[30..33]);
    }
}
