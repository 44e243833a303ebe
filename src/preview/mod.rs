//! Draws a point cloud as a picture (from above and from the south, with scale bars and a legend) or as an interactive page
//! for a browser, and the waveform of one pulse as a chart.
//!
//! A point takes at most 20 bytes of memory. The same points and options give the same picture.
//!
//! | file | what it does |
//! |---|---|
//! | `points` | point clouds in memory |
//! | `read`, `read_table` | reads point clouds of all formats |
//! | `layout`, `panel`, `colour` | the arrangement of a picture, its views, colours and legend |
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
mod read_table;
mod wave;

pub use chart::Chart;
pub use page::{PageOptions, write_page};
pub use picture::Picture;
pub use points::Points;
pub use read::read_points;
pub use read_packets::read_packet;
pub use wave::{Wave, read_wave};

use colour::Colouring;

/// What the colours show.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ColourBy {
    /// Height above the datum.
    #[default]
    Height,
    /// Point class, in the colours that are usual for LAS classes.
    Class,
    /// Strength of the echo.
    Intensity,
    /// Object that was hit.
    Object,
    /// Number of the return.
    Return,
}

impl ColourBy {
    /// All ways.
    pub const ALL: [ColourBy; 5] =
        [ColourBy::Height, ColourBy::Class, ColourBy::Intensity, ColourBy::Object, ColourBy::Return];

    /// Name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            ColourBy::Height => "height",
            ColourBy::Class => "class",
            ColourBy::Intensity => "intensity",
            ColourBy::Object => "object",
            ColourBy::Return => "return",
        }
    }
}

/// How a cloud is drawn.
#[derive(Clone, Debug, PartialEq)]
pub struct PreviewOptions {
    /// What the colours show; height where the points lack the attribute.
    pub colour: ColourBy,
    /// Width of the picture, dots; 320 to 16384.
    pub width: u32,
    /// Height of the picture, dots; 240 to 16384.
    pub height: u32,
    /// What the title begins with, usually the name of the file; may be empty.
    pub title: String,
    /// Thickness of the slice that is seen from the south, m; by default thin enough to tell trees apart, and the northern
    /// half of a room.
    pub section_m: Option<f64>,
    /// Height (as in the data) above which points are left out in the view from above; by default only a room loses its
    /// ceiling.
    pub cut_above_m: Option<f64>,
}

impl Default for PreviewOptions {
    fn default() -> PreviewOptions {
        PreviewOptions {
            colour: ColourBy::Height,
            width: 1600,
            height: 1200,
            title: String::new(),
            section_m: None,
            cut_above_m: None,
        }
    }
}

/// Draws a cloud. A cloud without points gives a picture that says so.
pub fn draw(points: &Points, options: &PreviewOptions) -> Picture {
    layout::Sheet::new(points, options).draw(points, &Colouring::new(points, options.colour))
}
