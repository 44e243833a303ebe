//! A raster picture with rectangles, text and PNG output.

use super::font;
use vlscan_base::error::{Error, Result};

/// Red, green, blue, 0–255 (sRGB).
pub type Rgb = [u8; 3];

/// A raster image of 8 bits per channel, row by row from the top left.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Picture {
    width: u32,
    height: u32,
    dots: Vec<Rgb>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Frame {
    pub(crate) x: u32,
    pub(crate) y: u32,
    pub(crate) width: u32,
    pub(crate) height: u32,
}

impl Picture {
    pub(crate) fn new(width: u32, height: u32, colour: Rgb) -> Picture {
        Picture { width, height, dots: vec![colour; width as usize * height as usize] }
    }

    #[cfg(test)]
    pub(crate) fn width(&self) -> u32 {
        self.width
    }

    #[cfg(test)]
    pub(crate) fn height(&self) -> u32 {
        self.height
    }

    /// Dots from left to right and from top to bottom.
    pub(crate) fn size(&self) -> [u32; 2] {
        [self.width, self.height]
    }

    /// All dots, row by row.
    pub(crate) fn dots(&self) -> &[Rgb] {
        &self.dots
    }

    /// The colour of a dot; black outside the picture.
    pub fn dot(&self, x: u32, y: u32) -> Rgb {
        let inside = x < self.width && y < self.height;
        if inside { self.dots[y as usize * self.width as usize + x as usize] } else { [0; 3] }
    }

    pub(crate) fn set(&mut self, x: u32, y: u32, colour: Rgb) {
        if x < self.width && y < self.height {
            self.dots[y as usize * self.width as usize + x as usize] = colour;
        }
    }

    pub(crate) fn fill(&mut self, frame: Frame, colour: Rgb) {
        for y in frame.y..frame.y.saturating_add(frame.height).min(self.height) {
            for x in frame.x..frame.x.saturating_add(frame.width).min(self.width) {
                self.set(x, y, colour);
            }
        }
    }

    /// Covers a share of a dot, 0–1, with a colour.
    fn blend(&mut self, x: u32, y: u32, colour: Rgb, share: f64) {
        if share > 0.0 {
            let below = self.dot(x, y).map(f64::from);
            let mix = |c: usize| below[c] + (f64::from(colour[c]) - below[c]) * share.min(1.0);
            self.set(x, y, std::array::from_fn(|c| mix(c).round() as u8));
        }
    }

    /// Draws a straight line `pen` dots wide, with round ends and smooth edges.
    fn line(&mut self, line: [[f64; 2]; 2], pen: f64, colour: Rgb) {
        let [from, to] = line;
        let reach = 0.5 * pen + 0.5;
        let (low, high) = (from[1].min(to[1]) - reach, from[1].max(to[1]) + reach);
        let (across, down) = (to[0] - from[0], to[1] - from[1]);
        for y in low.max(0.0) as u32..(high.ceil().max(0.0) as u32).min(self.height) {
            let middle = f64::from(y) + 0.5;
            // The part of the line that comes within reach of the row.
            let part = [middle - reach, middle + reach].map(|v| match down == 0.0 {
                true => f64::from(u8::from(v > from[1])),
                false => ((v - from[1]) / down).clamp(0.0, 1.0),
            });
            let [a, b] = part.map(|share| from[0] + share * across);
            let (first, last) = (a.min(b) - reach, a.max(b) + reach);
            for x in first.max(0.0) as u32..(last.ceil().max(0.0) as u32).min(self.width) {
                let distance = distance(line, [f64::from(x) + 0.5, middle]);
                self.blend(x, y, colour, reach - distance);
            }
        }
    }

    /// Draws a line `pen` dots wide through points.
    pub(crate) fn path(&mut self, path: &[[f64; 2]], pen: f64, colour: Rgb) {
        path.windows(2).for_each(|pair| self.line([pair[0], pair[1]], pen, colour));
    }

    /// Draws text with its upper left corner at `at`; a unit of the font is `size` dots.
    pub(crate) fn text(&mut self, at: [f64; 2], text: &str, size: f64, colour: Rgb) {
        self.letters(at, text, [size, stem(size)], colour);
    }

    /// Draws text as [`Picture::text`] does, on a halo that sets it off from the picture below.
    pub(crate) fn text_on(&mut self, at: [f64; 2], text: &str, size: f64, colour: Rgb, halo: Rgb) {
        self.letters(at, text, [size, 3.0 * stem(size)], halo);
        self.text(at, text, size, colour);
    }

    /// Draws an arrow to the north, which is up, with its letter: [`NORTH_HEIGHT`] units above its foot.
    pub(crate) fn north_arrow(&mut self, foot: [f64; 2], size: f64, colour: Rgb, halo: Rgb) {
        let (x, pen) = (foot[0].floor() + 0.5, size.max(1.0));
        let at = |right: f64, up: f64| [x + right * size, foot[1] - up * size];
        let barbs = [at(-3.0, 9.0), at(0.0, 13.0), at(3.0, 9.0)];
        for (pen, colour) in [(3.0 * pen, halo), (pen, colour)] {
            self.path(&[at(0.0, 0.0), at(0.0, 13.0)], pen, colour);
            self.path(&barbs, pen, colour);
        }
        self.text_on(at(-2.5, NORTH_HEIGHT), "N", size, colour, halo);
    }

    /// Draws text; a unit of the font is `size` dots, its strokes are `pen` dots wide.
    fn letters(&mut self, at: [f64; 2], text: &str, [size, pen]: [f64; 2], colour: Rgb) {
        // Stems that cover whole dots have sharp edges.
        let phase = if stem(size) % 2.0 == 1.0 { 0.5 } else { 0.0 };
        let mut left = at[0];
        for c in text.chars() {
            let place =
                |[x, y]: [f64; 2]| [left + x * size, at[1] + y * size].map(|v| (v - phase).round() + phase);
            let strokes: Vec<[[f64; 2]; 2]> = font::segments(c).map(|segment| segment.map(place)).collect();
            self.strokes(&strokes, pen, colour);
            left += font::ADVANCE * size;
        }
    }

    /// Draws the lines of a character at once, so that no dot is covered twice where they meet.
    fn strokes(&mut self, lines: &[[[f64; 2]; 2]], pen: f64, colour: Rgb) {
        let reach = 0.5 * pen + 0.5;
        let range = |axis: usize, dots: u32| {
            let (low, high) = lines
                .iter()
                .flatten()
                .fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), p| (l.min(p[axis]), h.max(p[axis])));
            (low - reach).max(0.0) as u32..((high + reach).ceil().max(0.0) as u32).min(dots)
        };
        let (columns, rows) = (range(0, self.width), range(1, self.height));
        for (y, x) in rows.flat_map(|y| columns.clone().map(move |x| (y, x))) {
            let centre = [x, y].map(|v| f64::from(v) + 0.5);
            let nearest = lines.iter().map(|line| distance(*line, centre)).fold(f64::INFINITY, f64::min);
            self.blend(x, y, colour, reach - nearest);
        }
    }

    /// The picture at half its size; each dot is the mean of four.
    pub(crate) fn halved(&self) -> Picture {
        let (width, height) = (self.width / 2, self.height / 2);
        let mut half = Picture::new(width, height, [0; 3]);
        for (y, x) in (0..height).flat_map(|y| (0..width).map(move |x| (y, x))) {
            let four = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(i, j)| self.dot(2 * x + i, 2 * y + j));
            let mean = |c: usize| four.iter().map(|dot| u32::from(dot[c])).sum::<u32>() / 4;
            half.set(x, y, std::array::from_fn(|c| mean(c) as u8));
        }
        half
    }

    /// The image as an sRGB PNG file.
    ///
    /// # Errors
    /// [`Error::Internal`] if the encoder fails.
    pub fn png(&self) -> Result<Vec<u8>> {
        let failed = |e: png::EncodingError| Error::Internal(format!("PNG encoding: {e}"));
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, self.width, self.height);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
        let mut writer = encoder.write_header().map_err(failed)?;
        writer.write_image_data(self.dots.as_flattened()).map_err(failed)?;
        writer.finish().map_err(failed)?;
        Ok(bytes)
    }
}

/// Height of the arrow to the north with its letter, units of the font.
pub(crate) const NORTH_HEIGHT: f64 = 23.0;

/// Width of the strokes of text, whole dots, for units of the font of `size` dots.
fn stem(size: f64) -> f64 {
    (0.9 * size).round().max(1.0)
}

/// Distance of a place from a straight line between two points.
fn distance([from, to]: [[f64; 2]; 2], at: [f64; 2]) -> f64 {
    let (way, off) = ([to[0] - from[0], to[1] - from[1]], [at[0] - from[0], at[1] - from[1]]);
    let square = way[0] * way[0] + way[1] * way[1];
    let share = if square > 0.0 { (off[0] * way[0] + off[1] * way[1]) / square } else { 0.0 };
    let share = share.clamp(0.0, 1.0);
    let [x, y] = [off[0] - share * way[0], off[1] - share * way[1]];
    (x * x + y * y).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_png_holds_the_dots() {
        let mut picture = Picture::new(7, 5, [1, 2, 3]);
        picture.set(6, 4, [200, 100, 50]);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("p.png");
        std::fs::write(&path, picture.png().unwrap()).unwrap();
        let file = std::io::BufReader::new(std::fs::File::open(&path).unwrap());
        let mut reader = png::Decoder::new(file).read_info().unwrap();
        let mut dots = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut dots).unwrap();
        assert_eq!((info.width, info.height), (7, 5));
        assert_eq!(&dots[..3], [1, 2, 3]);
        assert_eq!(&dots[dots.len() - 3..], [200, 100, 50]);
    }

    #[test]
    fn drawing_outside_is_harmless() {
        let mut picture = Picture::new(10, 10, [0; 3]);
        picture.text([5.0, 5.0], "gW", 3.0, [255; 3]);
        picture.text([f64::NAN, -1e300], "W", 1e300, [255; 3]);
        picture.path(&[[-1e300, 0.0], [1e300, f64::INFINITY], [4.0, f64::NAN]], 2.0, [255; 3]);
        picture.fill(Frame { x: 8, y: 8, width: u32::MAX, height: u32::MAX }, [9; 3]);
        assert_eq!(picture.dot(9, 9), [9; 3]);
        assert_eq!(picture.dot(99, 9), [0; 3]);
    }
    /// Rows and columns of the dots unlike the ground: first and last of each.
    fn drawn(picture: &Picture) -> [[u32; 2]; 2] {
        let inked = |i: &u32| picture.dot(i % picture.width(), i / picture.width()) != [0; 3];
        let dots: Vec<u32> = (0..picture.width() * picture.height()).filter(inked).collect();
        [0, 1].map(|axis| {
            let of = |i: &u32| if axis == 0 { i % picture.width() } else { i / picture.width() };
            [dots.iter().map(of).min().unwrap(), dots.iter().map(of).max().unwrap()]
        })
    }

    #[test]
    fn the_height_of_text_follows_its_size() {
        for size in [1.0, 1.5, 2.28, 4.0, 10.0] {
            let mut picture = Picture::new(200, 200, [0; 3]);
            picture.text([20.0, 30.0], "HE", size, [255; 3]);
            let [[left, right], [top, bottom]] = drawn(&picture);
            let (height, width) = (f64::from(bottom + 1 - top), f64::from(right + 1 - left));
            assert!((height - font::HEIGHT * size).abs() <= 2.0, "{size}: {height}");
            assert!((width - font::width("HE") * size).abs() <= 2.0, "{size}: {width}");
            assert!(top.abs_diff(30) <= 1 && left.abs_diff(20) <= 1, "{size}: {left} {top}");
        }
    }

    #[test]
    fn lines_cover_the_dots_that_they_cross() {
        let mut picture = Picture::new(40, 40, [0; 3]);
        picture.line([[5.5, 10.5], [30.5, 10.5]], 1.0, [200; 3]);
        assert_eq!([picture.dot(5, 10), picture.dot(30, 10)], [[200; 3]; 2]);
        assert_eq!([picture.dot(20, 9), picture.dot(20, 12), picture.dot(33, 10)], [[0; 3]; 3]);
        picture.line([[35.5, 2.5], [2.5, 35.5]], 3.0, [100; 3]);
        assert_eq!([picture.dot(35, 2), picture.dot(25, 12), picture.dot(2, 35)], [[100; 3]; 3]);
        assert_eq!(picture.dot(30, 30), [0; 3]);
    }
}
