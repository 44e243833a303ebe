//! The legend of a picture: a bar of colours with values, or colours with names.

use super::colour::{Legend, mixed};
use super::style::Style;
use crate::chart::{Axis, Frame, Picture, Rgb, font};

/// Distance of lines, units of the font.
const LINE: f64 = 12.0;

/// Number of lines of a list of colours that a frame has room for.
pub(super) fn lines(frame: Frame, text: f64) -> usize {
    ((f64::from(frame.height) / (LINE * text)) as usize).saturating_sub(3).clamp(1, 24)
}

/// Draws the legend in its frame.
pub(super) fn draw(picture: &mut Picture, frame: Frame, legend: &Legend, text: f64, style: Style) {
    match legend {
        Legend::Marks { title, marks, table } => {
            bar(picture, frame, (*title, *table, &marks[..]), text, style);
        }
        Legend::Bar { title, low, high, table } => {
            let axis = Axis::new(f64::from(*low), f64::from(*high));
            let marks = axis.ticks(4.0).into_iter().map(|(value, name)| (axis.place(value) as f32, name));
            let marks: Vec<(f32, String)> = marks.collect();
            bar(picture, frame, (*title, *table, &marks[..]), text, style);
        }
        Legend::Nothing => {}
        Legend::List { title, entries, more } => {
            let [x, y] = [frame.x, frame.y].map(f64::from);
            picture.text([x, y], title, text, style.faint);
            let mut at = y + 2.0 * LINE * text;
            let [width, height] = [8.0 * text, font::HEIGHT * text].map(|dots| dots.round() as u32);
            for entry in entries {
                picture.fill(Frame { x: frame.x, y: at.round() as u32, width, height }, entry.colour);
                picture.text([x + 14.0 * text, at.round()], &entry.label, text, style.ink);
                at += LINE * text;
            }
            if *more > 0 {
                picture.text([x + 14.0 * text, at], &format!("and {more} more"), text, style.faint);
            }
        }
    }
}

/// A title, colours from low to high, and names at shares of the way from low to high.
type Bar<'a> = (&'a str, &'a [Rgb], &'a [(f32, String)]);

/// Draws a bar of colours with its title above and names at its right.
fn bar(picture: &mut Picture, frame: Frame, (title, table, marks): Bar, text: f64, style: Style) {
    let [x, y] = [frame.x, frame.y].map(f64::from);
    let line = LINE * text;
    let top = y + 2.0 * line;
    let rows = (f64::from(frame.height) - 3.0 * line).clamp(1.0, 26.0 * line).round();
    let right = x + 14.0 * text;
    picture.text([x, y], title, text, style.faint);
    for row in 0..rows as u32 {
        let colour = mixed(table, 1.0 - row as f32 / rows as f32);
        let width = (14.0 * text).round() as u32;
        picture.fill(Frame { x: frame.x, y: top.round() as u32 + row, width, height: 1 }, colour);
    }
    for (share, name) in marks {
        let at = top + rows * (1.0 - f64::from(*share));
        picture.path(&[[right, at], [right + 4.0 * text, at]], text, style.faint);
        picture.text([right + 8.0 * text, at - 0.5 * font::HEIGHT * text], name, text, style.ink);
    }
}
