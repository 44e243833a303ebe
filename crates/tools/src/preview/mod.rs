//! Draws a point cloud as a picture (from above and from the south, with scale bars and a legend) or as an interactive
//! page for a browser, and the waveform of one pulse as a chart.
//!
//! A point takes at most 36 bytes of memory. The same points and options give the same picture.
//!
//! | file | what it does |
//! |---|---|
//! | `read`, `points` | point clouds in memory |
//! | `layout`, `panel`, `colour` | the layout of a picture, its views, colours and legend |
//! | `picture`, `font`, `label` | pixels, letters, numbers as text |
//! | `page` | pages for a browser |
//! | `wave`, `read_packets`, `chart` | waveforms from text and from LAS, and their chart |

mod chart;
mod colour;
mod font;
mod label;
mod layout;
mod page;
mod panel;
mod picture;
mod points;
mod read;
mod read_packets;
#[cfg(test)]
mod table_tests;
mod wave;

pub use chart::Chart;
pub use page::{PageOptions, write_page};
pub use picture::Picture;
pub use points::{Attributes, ColourBy, Point, Points};
pub use read::{points_of_table, read_points};
pub use read_packets::read_packet;
pub use wave::{Wave, read_wave};

use colour::Colouring;

/// How a cloud is drawn.
#[derive(Clone, Debug, PartialEq)]
pub struct PreviewOptions {
    /// What the colours show; height if the points lack the attribute.
    pub colour: ColourBy,
    /// Width of the picture, dots; 320 to 16384.
    pub width: u32,
    /// Height of the picture, dots; 240 to 16384.
    pub height: u32,
    /// Dark on white, for paper, instead of light on black.
    pub light: bool,
    /// Heights of the lowest and the highest colour, world coordinates; by default those of the points.
    pub heights: Option<(f64, f64)>,
    /// Start of the title, usually the name of the file; may be empty.
    pub title: String,
    /// Thickness of the slice in the view from the south, m; by default thin enough to distinguish trees, and the
    /// northern half of a room.
    pub section_m: Option<f64>,
    /// Height in world coordinates above which the view from above omits points; by default only the ceiling of a room
    /// is omitted.
    pub cut_above_m: Option<f64>,
}

impl Default for PreviewOptions {
    fn default() -> PreviewOptions {
        PreviewOptions {
            colour: ColourBy::Height,
            width: 1600,
            height: 1200,
            light: false,
            heights: None,
            title: String::new(),
            section_m: None,
            cut_above_m: None,
        }
    }
}

/// The heights that the colours of all clouds together span, world coordinates.
pub fn common_heights(clouds: &[&Points]) -> Option<(f64, f64)> {
    let ranges = clouds.iter().filter(|points| !points.is_empty()).map(|points| colour::height_range(points));
    ranges.reduce(|(low, high), (l, h)| (low.min(l), high.max(h)))
}

/// Draws a cloud. An empty cloud results in a picture that says so.
pub fn draw(points: &Points, options: &PreviewOptions) -> Picture {
    layout::Sheet::new(points, options).draw(points, &Colouring::new(points, options.colour, options.heights))
}
