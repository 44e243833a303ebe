//! The surroundings of a view: caption, scale bar, and ticks in the coordinates of the scene.

use super::panel::{Panel, View};
use super::style::Style;
use crate::chart::label::{round_below, round_number};
use crate::chart::{Axis, Picture, font};

/// Room for the caption above a view, units of the font.
pub(super) const ABOVE: f64 = 14.0;
/// Room for the ticks and their names below a view, units of the font.
pub(super) const BELOW: f64 = 16.0;
/// Room for the ticks left of a view beside their names, units of the font.
pub(super) const LEFT: f64 = 7.0;
/// Number of letters of the names of axes.
pub(super) const NAME_LETTERS: usize = 4;
/// Maximum number of letters of the name of a tick.
pub(super) const MAX_LETTERS: usize = 12;
/// Maximum number of ticks that are requested; axes may have 2.5 times as many.
const MAX_TICKS: f64 = 8.0;

/// Number of letters of the longest name of a tick on an axis.
pub(super) fn letters([low, high]: [f64; 2]) -> usize {
    let step = round_below((high - low) / MAX_TICKS);
    let [low, high] = [low, high].map(|value| round_number(value, step).chars().count());
    low.max(high).min(MAX_LETTERS)
}

/// Writes the caption above a view, and draws a bar of a round length beside it, if both fit.
pub(super) fn caption(picture: &mut Picture, panel: &Panel, caption: &str, text: f64, style: Style) {
    let [x, y, width] = [panel.frame.x, panel.frame.y, panel.frame.width].map(f64::from);
    let length = round_below(0.25 * width / panel.scale);
    let (dots, name) = (length * panel.scale, format!("{} m", round_number(length, length)));
    let bar = dots + (font::width(&name) + 8.0) * text;
    let mut room = width;
    if bar + (font::width(caption) + 12.0) * text <= width {
        let (from, to, at) = (x + width - dots, x + width, y - 6.0 * text);
        let tick = at - 3.0 * text;
        picture.path(&[[from, tick], [from, at], [to, at], [to, tick]], text, style.ink);
        let left = from - (font::width(&name) + 6.0) * text;
        picture.text([left, y - 11.0 * text], &name, text, style.ink);
        room = width - bar;
    }
    let size = text.min(room / font::width(caption).max(1.0));
    picture.text([x, y - 11.0 * text], caption, size, style.faint);
}

/// Draws the ticks below and left of a view, whose points are relative to `origin`, world coordinates.
pub(super) fn draw(picture: &mut Picture, panel: &Panel, origin: [f64; 3], text: f64, style: Style) {
    across(picture, panel, panel.range(0, origin), text, style);
    let (axis, name) = match panel.view {
        View::Above => (1, "y, m"),
        View::South => (2, "z, m"),
    };
    upwards(picture, panel, (panel.range(axis, origin), name), text, style);
}

/// Draws the axis below a view.
fn across(picture: &mut Picture, panel: &Panel, [low, high]: [f64; 2], text: f64, style: Style) {
    let [x, width] = [panel.frame.x, panel.frame.width].map(f64::from);
    let bottom = f64::from(panel.frame.y + panel.frame.height);
    let (below, letter) = (bottom + 5.0 * text, font::ADVANCE * text);
    // The name of the axis is at its end.
    let end = x + width - font::width("x, m") * text;
    picture.text([end, below], "x, m", text, style.faint);
    let widest = (letters([low, high]) as f64 + 2.0) * letter;
    let mut free = x - widest;
    for (value, name) in Axis::new(low, high).ticks((width / (2.5 * widest)).clamp(1.0, MAX_TICKS)) {
        let at = tick_place(x + (value - low) / (high - low) * width);
        picture.path(&[[at, bottom], [at, bottom + 3.0 * text]], text, style.faint);
        let wide = font::width(&name) * text;
        let left = at - 0.5 * wide;
        if left >= free && left + wide + letter <= end {
            picture.text([left, below], &name, text, style.faint);
            free = left + wide + letter;
        }
    }
}

/// Draws the axis left of a view.
fn upwards(
    picture: &mut Picture,
    panel: &Panel,
    ([low, high], title): ([f64; 2], &str),
    text: f64,
    style: Style,
) {
    let [x, y, height] = [panel.frame.x, panel.frame.y, panel.frame.height].map(f64::from);
    let right = x - 5.0 * text;
    // The name of the axis is at its end.
    picture.text([right - font::width(title) * text, y], title, text, style.faint);
    let mut free = f64::INFINITY;
    for (value, name) in Axis::new(low, high).ticks((height / (35.0 * text)).clamp(1.0, MAX_TICKS)) {
        let at = tick_place(y + (high - value) / (high - low) * height);
        picture.path(&[[x - 3.0 * text, at], [x, at]], text, style.faint);
        let (left, top) = (right - font::width(&name) * text, at - 0.5 * font::HEIGHT * text);
        let has_room = top >= y + 11.0 * text && top + 10.0 * text <= free;
        if has_room && name.chars().count() <= MAX_LETTERS {
            picture.text([left, top], &name, text, style.faint);
            free = top;
        }
    }
}

/// The middle of the dot at a place.
fn tick_place(at: f64) -> f64 {
    at.floor() + 0.5
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::chart::Frame;
    use crate::preview::style::DARK;

    fn panel(view: View, scale: f64, centre: [f64; 3]) -> Panel {
        let frame = Frame { x: 100, y: 50, width: 400, height: 200 };
        Panel { view, frame, scale, exaggeration: 1.0, centre, keep: [[0.0; 3], [0.0; 3]], haze: 0.0 }
    }

    #[test]
    fn ticks_are_at_round_coordinates_of_the_scene() {
        // 200 by 100 m around (500 100, 5 400 050), with ticks every 50 and every 10 m.
        let panel = panel(View::Above, 2.0, [80.0, 30.0, 0.0]);
        let origin = [500_020.0, 5_400_020.0, 0.0];
        assert_eq!(panel.range(0, origin), [500_000.0, 500_200.0]);
        assert_eq!(panel.range(1, origin), [5_400_000.0, 5_400_100.0]);
        let mut picture = Picture::new(600, 300, [0; 3]);
        draw(&mut picture, &panel, origin, 1.0, DARK);
        // Below x = 500 100, and left of y = 5 400 000, the lower edge.
        assert_eq!(picture.dot(300, 251), DARK.faint);
        assert_eq!(picture.dot(98, 250), DARK.faint);
        // Names are drawn below and left of the view.
        let faint = |xs: std::ops::Range<u32>, ys: std::ops::Range<u32>| {
            ys.flat_map(|y| xs.clone().map(move |x| (x, y)))
                .filter(|(x, y)| picture.dot(*x, *y) == DARK.faint)
                .count()
        };
        assert!(faint(270..330, 255..263) > 20 && faint(40..95, 60..255) > 20);
    }

    #[test]
    fn the_room_for_names_is_that_of_the_longest_one() {
        assert_eq!(letters([0.0, 200.0]), 3);
        assert_eq!(letters([-5.0, 5.0]), 2);
        assert_eq!(letters([0.0, 1.0]), 3);
        assert_eq!(letters([5_400_000.0, 5_400_100.0]), 7);
        assert_eq!(letters([-1e300, 1e300]), MAX_LETTERS);
    }
}
