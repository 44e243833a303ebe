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

    /// Draws text with its upper left corner at (x, y); each dot of the font is `scale` × `scale` dots.
    pub(crate) fn text(&mut self, x: u32, y: u32, text: &str, scale: u32, colour: Rgb) {
        for (i, c) in text.chars().enumerate() {
            let (rows, drop) = font::glyph(c);
            for (row, bits) in rows.into_iter().enumerate() {
                for column in (0..5).filter(|column| bits >> (4 - column) & 1 == 1) {
                    let dot = Frame {
                        x: x + (i as u32 * font::ADVANCE + column) * scale,
                        y: y + (row as u32 + drop) * scale,
                        width: scale,
                        height: scale,
                    };
                    self.fill(dot, colour);
                }
            }
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
        picture.text(5, 5, "gW", 3, [255; 3]);
        picture.fill(Frame { x: 8, y: 8, width: u32::MAX, height: u32::MAX }, [9; 3]);
        assert_eq!(picture.dot(9, 9), [9; 3]);
        assert_eq!(picture.dot(99, 9), [0; 3]);
    }
}
