//! Colours of everything but the points.

use crate::chart::Rgb;

/// Colours of everything but the points.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Style {
    /// Background of the picture.
    pub(super) paper: Rgb,
    /// Background of the views.
    pub(super) ground: Rgb,
    /// Titles and numbers.
    pub(super) ink: Rgb,
    /// Captions and axes.
    pub(super) faint: Rgb,
}

/// Background of views for screens.
pub(super) const DARK_GROUND: Rgb = [23, 29, 38];
/// For screens.
pub(super) const DARK: Style =
    Style { paper: [16, 20, 27], ground: DARK_GROUND, ink: [226, 231, 236], faint: [142, 152, 164] };
/// For paper.
pub(super) const LIGHT: Style =
    Style { paper: [255, 255, 255], ground: [243, 245, 247], ink: [22, 32, 43], faint: [82, 96, 109] };
