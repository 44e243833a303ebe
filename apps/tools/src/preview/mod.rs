//! Draws a point cloud as a picture (from above and from the south, with coordinates and a legend) or as an
//! interactive page for a browser, writes it for viewers of large clouds, and draws the waveform of one pulse
//! as a chart.
//!
//! The same points and options give the same picture.
//!
//! | file | what it does |
//! |---|---|
//! | `layout` | the layout of a picture: title, views, legend |
//! | `panel`, `section` | a view, and the part of the cloud that it shows |
//! | `samples` | the nearest points of a view, and shading |
//! | `colour`, `ranges`, `legend` | colours of points, the values that they span, and what they mean |
//! | `axes`, `style` | captions, ticks in the coordinates of the scene; colours of all but the points |
//! | `flight` | planned flights over their scene |
//! | `map` | pictures from above whose pixels have known coordinates |
//! | `bands` | maps of the bands of a raster |
//! | `page` | pages for a browser |
//! | `octree` | clouds for viewers that read ranges |
//! | `chart` | charts of waveforms |

mod axes;
mod bands;
mod chart;
mod colour;
mod flight;
mod layout;
mod legend;
mod map;
mod octree;
mod page;
mod panel;
mod ranges;
mod samples;
mod section;
mod style;

pub use crate::chart::{Picture, Rgb};
use crate::cloud::Points;
pub use bands::{BandMap, draw_bands};
pub use chart::Chart;
pub use colour::ColourBy;
use colour::Colouring;
pub use flight::{FlightMap, draw_flight};
pub use map::Map;
pub use octree::write_octree;
pub use page::{Page, write_page};

/// How a cloud is drawn, as a picture or as a page.
#[derive(Clone, Debug, PartialEq)]
pub struct PreviewOptions {
    /// Attribute that colours show; height if the points lack the attribute.
    pub colour: ColourBy,
    /// Width of the picture, dots; 320 to 16384.
    pub width: u32,
    /// Height of the picture, dots; 240 to 16384.
    pub height: u32,
    /// Dark on white, for print, instead of light on black; a page begins in this style.
    pub light: bool,
    /// Heights of the lowest and the highest colour, world coordinates; by default those of the points.
    pub heights: Option<(f64, f64)>,
    /// Start of the title of a picture, name of the cloud on a page, usually the name of the file; may be
    /// empty.
    pub title: String,
    /// Maximum number of points of a page; beyond it the points are divided into this number of equal runs,
    /// one point of each is kept.
    pub max_points: usize,
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
            max_points: 5_000_000,
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
    let colouring = Colouring::new(points, options.colour, options.heights);
    layout::Sheet::new(points, &[], options).draw(points, &colouring)
}
