//! Draws a point cloud as a picture (from above and from the south, with scale bars and a legend) or as an interactive
//! page for a browser, and the waveform of one pulse as a chart.
//!
//! A point takes at most 20 bytes of memory. The same points and options give the same picture.
//!
//! | file | what it does |
//! |---|---|
//! | `read`, `read_table`, `points` | read point clouds of all formats; the clouds in memory |
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
mod read_table;
mod wave;

pub use chart::Chart;
pub use page::{PageOptions, write_page};
pub use picture::Picture;
pub use points::{Attributes, Point, Points};
pub use read::read_points;
pub use read_packets::read_packet;
pub use read_table::points_of_table;
pub use wave::{Wave, read_wave};

use colour::Colouring;

/// What the colours show.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ColourBy {
    /// Height above the datum.
    #[default]
    Height,
    /// Point class, in the customary colours of LAS classes.
    Class,
    /// Strength of the return.
    Intensity,
    /// Object that was hit.
    Object,
    /// Return number.
    Return,
    /// Leg that was flown.
    Leg,
    /// Device of the scanner.
    Channel,
    /// Time of the pulse.
    Time,
}

impl ColourBy {
    /// All of them.
    pub const ALL: [ColourBy; 8] = [
        ColourBy::Height,
        ColourBy::Class,
        ColourBy::Intensity,
        ColourBy::Object,
        ColourBy::Return,
        ColourBy::Leg,
        ColourBy::Channel,
        ColourBy::Time,
    ];

    /// Its name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            ColourBy::Height => "height",
            ColourBy::Class => "class",
            ColourBy::Intensity => "intensity",
            ColourBy::Object => "object",
            ColourBy::Return => "return",
            ColourBy::Leg => "leg",
            ColourBy::Channel => "channel",
            ColourBy::Time => "time",
        }
    }
}

/// How a cloud is drawn.
#[derive(Clone, Debug, PartialEq)]
pub struct PreviewOptions {
    /// What the colours show; height if the points lack the attribute.
    pub colour: ColourBy,
    /// Width of the picture, dots; 320 to 16384.
    pub width: u32,
    /// Height of the picture, dots; 240 to 16384.
    pub height: u32,
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
            title: String::new(),
            section_m: None,
            cut_above_m: None,
        }
    }
}

/// Draws a cloud. An empty cloud results in a picture that says so.
pub fn draw(points: &Points, options: &PreviewOptions) -> Picture {
    layout::Sheet::new(points, options).draw(points, &Colouring::new(points, options.colour))
}
