//! The picture of the differences of two epochs.

use super::change::ChangeMap;
use super::statistic::quantile;
use crate::chart::label::{metres, round_below};
use crate::chart::{Frame, NORTH_HEIGHT, Picture, Rgb, font};

/// From lower to higher: blue over white to red, distinguishable with all usual kinds of colour vision
/// (ColorBrewer RdBu).
const DIVERGING: [Rgb; 9] = [
    [5, 48, 97],
    [33, 102, 172],
    [67, 147, 195],
    [146, 197, 222],
    [235, 235, 235],
    [244, 165, 130],
    [214, 96, 77],
    [178, 24, 43],
    [103, 0, 31],
];
const PAPER: Rgb = [255, 255, 255];
const INK: Rgb = [22, 32, 43];
/// Differences within the level of detection.
const UNCHANGED: Rgb = [214, 217, 220];
/// Room for the scale at the right, dots.
const LEGEND: u32 = 130;
const BORDER: u32 = 24;
/// Size of the text, dots per unit of the font.
const TEXT: f64 = 2.0;

/// The differences from above, as large as fits into a width and height, with their scale.
pub(super) fn picture_of(map: &ChangeMap, [width, height]: [u32; 2]) -> Picture {
    let mut picture = Picture::new(width, height, PAPER);
    let reach = reach(map);
    let field = [width - LEGEND - BORDER, height - 2 * BORDER].map(f64::from);
    let dots = (field[0] / map.columns as f64).min(field[1] / map.rows as f64);
    for y in 0..(dots * map.rows as f64) as u32 {
        for x in 0..(dots * map.columns as f64) as u32 {
            let column = (f64::from(x) / dots) as usize;
            // North is at the top.
            let row = map.rows - 1 - ((f64::from(y) / dots) as usize).min(map.rows - 1);
            let cell = row * map.columns + column.min(map.columns - 1);
            let difference = map.differences[cell];
            if !difference.is_nan() {
                let colour = if map.is_changed[cell] { colour(difference / reach) } else { UNCHANGED };
                picture.set(BORDER + x, BORDER + y, colour);
            }
        }
    }
    draw_scale(&mut picture, width, height, reach);
    picture.north_arrow([f64::from(width - 50), f64::from(height - BORDER - 8)], TEXT, INK, PAPER);
    let size = [map.columns, map.rows].map(|cells| metres(cells as f64 * map.side_m));
    let place = format!(
        "{} × {} m from x {} m, y {} m",
        size[0],
        size[1],
        metres(map.corner[0]),
        metres(map.corner[1])
    );
    // Below the field, as large as it fits.
    let text = (f64::from(width - BORDER) / font::width(&place)).min(TEXT);
    let below = f64::from(BORDER) + dots * map.rows as f64 + 6.0;
    picture.text([f64::from(BORDER), below], &place, text, INK);
    picture
}

/// The difference of the last colours, m: 99 % of the significant ones are within it.
fn reach(map: &ChangeMap) -> f64 {
    let changed = map.differences.iter().zip(&map.is_changed).filter(|(_, is_changed)| **is_changed);
    let mut sizes: Vec<f64> = changed.map(|(d, _)| d.abs()).collect();
    sizes.sort_unstable_by(f64::total_cmp);
    if sizes.is_empty() { 0.1 } else { quantile(&sizes, 0.99).max(0.01) }
}

/// The colour of a difference in units of the last colours'.
fn colour(share: f64) -> Rgb {
    let at = (share.clamp(-1.0, 1.0) + 1.0) / 2.0 * (DIVERGING.len() - 1) as f64;
    let i = (at as usize).min(DIVERGING.len() - 2);
    let part = at - i as f64;
    std::array::from_fn(|c| {
        let (a, b) = (f64::from(DIVERGING[i][c]), f64::from(DIVERGING[i + 1][c]));
        (a + (b - a) * part).round() as u8
    })
}

fn draw_scale(picture: &mut Picture, width: u32, height: u32, reach: f64) {
    let north = (NORTH_HEIGHT * TEXT) as u32;
    let (left, top) = (width - LEGEND + 20, 2 * BORDER + 30);
    let tall = height.saturating_sub(4 * BORDER + 60 + north).max(2);
    for y in 0..tall {
        let share = 1.0 - 2.0 * f64::from(y) / f64::from(tall - 1);
        picture.fill(Frame { x: left, y: top + y, width: 22, height: 1 }, colour(share));
    }
    picture.text([f64::from(left - 10), f64::from(top - 30)], "change, m", TEXT, INK);
    let step = round_below(reach / 2.5);
    let count = (reach / step) as i32;
    for i in -count..=count {
        let value = f64::from(i) * step;
        let y = f64::from(top) + (1.0 - value / reach) / 2.0 * f64::from(tall - 1);
        let text = if i > 0 { format!("+{}", metres(value)) } else { metres(value) };
        picture.text([f64::from(left + 30), y - 0.5 * font::HEIGHT * TEXT], &text, TEXT, INK);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_rose_is_red_what_sank_blue_and_north_is_up() {
        let map = ChangeMap {
            side_m: 1.0,
            columns: 2,
            rows: 2,
            corner: [0.0; 2],
            differences: vec![1.0, -1.0, 0.001, f64::NAN],
            detection: vec![0.05, 0.05, 0.05, f64::NAN],
            is_changed: vec![true, true, false, false],
        };
        let picture = picture_of(&map, [400, 300]);
        let dots = (300 - 2 * BORDER).min(400 - LEGEND - BORDER) / 2;
        let at = |column: u32, row: u32| {
            picture.dot(BORDER + column * dots + dots / 2, BORDER + row * dots + dots / 2)
        };
        assert_eq!((at(0, 1), at(1, 1)), (DIVERGING[8], DIVERGING[0]));
        assert_eq!((at(0, 0), at(1, 0)), (UNCHANGED, PAPER));
        // The shaft of the arrow to the north.
        assert_eq!(picture.dot(350, 300 - BORDER - 16), INK);
    }
}
