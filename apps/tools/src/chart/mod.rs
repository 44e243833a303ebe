//! Charts: marks on a plane, drawn as SVG for browsers and paper or as pixels, and axes with round numbers.
//!
//! ```
//! use vlscan_tools::chart::{Anchor, Axis, Drawing, Mark, Plot, Role, Theme, labelled, steps};
//!
//! let mut drawing = Drawing::new(400.0, 300.0, 1.0);
//! drawing.write([200.0, 8.0], "Speedup", Role::Ink, Anchor::Middle);
//! let (x, y) = (Axis::new(1.0, 4.0), Axis::new(0.0, 4.0));
//! let plot = Plot { left: 50.0, right: 380.0, top: 30.0, bottom: 260.0, x, y };
//! let ticks = |axis: &Axis| labelled(steps(axis.low, axis.high, 1.0), 1.0);
//! plot.grid(&mut drawing, ticks(&plot.x), ticks(&plot.y));
//! let path = [(1.0, 1.0), (2.0, 1.9), (4.0, 3.5)].map(|(x, y)| plot.at(x, y)).to_vec();
//! drawing.add(Mark::Stroke { path, width: 2.0, dashed: false, role: Role::Series(0) });
//! assert!(drawing.file(Theme::Light).starts_with("<svg xmlns="));
//! ```
//!
//! | file | what it does |
//! |---|---|
//! | `drawing` | marks, their colours, and the drawing as SVG |
//! | `raster` | the drawing as pixels |
//! | `axis` | values on axes, ticks, the grid |
//! | `picture`, `font`, `label` | pixels and PNG, letters of strokes, numbers as text |
//! | `indexed` | small PNG files with a palette |

mod axis;
mod drawing;
pub(crate) mod font;
mod indexed;
pub(crate) mod label;
mod picture;
mod raster;

pub use axis::{Axis, Plot, labelled, steps};
pub use drawing::{Anchor, Drawing, Mark, Role, Theme, style};
pub(crate) use picture::{Frame, NORTH_HEIGHT};
pub use picture::{Picture, Rgb};
