//! The layout of a picture: views, captions, scale bars, legend.

use super::PreviewOptions;
use super::colour::{Colouring, Legend, mixed};
use super::panel::{Panel, View};
use crate::chart::label::{grouped, metres, round_below, round_number};
use crate::chart::{Frame, Picture, Rgb, font};
use crate::cloud::Points;

/// Colours of everything but the points.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Style {
    paper: Rgb,
    /// Background of the views.
    ground: Rgb,
    ink: Rgb,
    faint: Rgb,
}

/// Background of views for screens.
pub(super) const DARK_GROUND: Rgb = [23, 29, 38];
/// For screens.
const DARK: Style =
    Style { paper: [16, 20, 27], ground: DARK_GROUND, ink: [226, 231, 236], faint: [142, 152, 164] };
/// For paper.
const LIGHT: Style =
    Style { paper: [255, 255, 255], ground: [243, 245, 247], ink: [22, 32, 43], faint: [82, 96, 109] };

/// The layout of one picture.
pub(super) struct Sheet {
    width: u32,
    height: u32,
    /// Scale of the font: dots of the picture per dot of the font.
    text: u32,
    title: String,
    style: Style,
    panels: Vec<(Panel, String)>,
    legend: Frame,
}

/// The cloud's box relative to its origin.
struct Extent {
    low: [f64; 3],
    high: [f64; 3],
}

impl Extent {
    fn of(points: &Points) -> Extent {
        let (bounds, origin) = (points.bounds(), points.origin());
        Extent { low: (bounds.min - origin).to_array(), high: (bounds.max - origin).to_array() }
    }

    fn size(&self, axis: usize) -> f64 {
        (self.high[axis] - self.low[axis]).max(1e-3)
    }

    fn centre(&self) -> [f64; 3] {
        [0, 1, 2].map(|a| 0.5 * (self.low[a] + self.high[a]))
    }

    /// Limits that include all points, slightly enlarged for rounding.
    fn keep(&self) -> [[f32; 3]; 2] {
        [[0, 1, 2].map(|a| (self.low[a] - 1.0) as f32), [0, 1, 2].map(|a| (self.high[a] + 1.0) as f32)]
    }
}

/// The frames of the two views and their scale, dots per metre.
struct Split {
    above: (Frame, f64),
    south: (Frame, f64, f64),
    legend: Frame,
    is_stacked: bool,
    quality: f64,
}

/// Margin around what a view shows, as a fraction of it.
const MARGIN: f64 = 0.06;

/// Largest ratio of the scales of both views: the smaller view is not blown up beyond it.
const MAX_SCALE_RATIO: f64 = 2.0;

impl Sheet {
    pub(super) fn new(points: &Points, options: &PreviewOptions) -> Sheet {
        let (width, height) = (options.width.clamp(320, 16_384), options.height.clamp(240, 16_384));
        let text = (width.min(height * 4 / 3) / 760).max(1);
        let mut sheet = Sheet {
            width,
            height,
            text,
            title: String::new(),
            style: if options.light { LIGHT } else { DARK },
            panels: Vec::new(),
            legend: Frame::NONE,
        };
        sheet.title = title(points, &options.title, width / (text * font::ADVANCE));
        if points.is_empty() {
            return sheet;
        }
        let extent = Extent::of(points);
        let section = Section::choose(points, &extent);
        let split = sheet.split(&extent);
        let centre = extent.centre();
        let mut keep = extent.keep();
        let mut caption = "from above".to_owned();
        if let Some(cut) = section.cut_above {
            keep[1][2] = keep[1][2].min((cut - points.origin().z) as f32);
            caption += &format!(", cut at {} m height", metres(cut));
        }
        let (frame, scale) = split.above;
        let above = Panel { view: View::Above, frame, scale, exaggeration: 1.0, centre, keep, haze: 0.0 };
        sheet.panels.push((above, caption));

        let (frame, scale, exaggeration) = split.south;
        let mut keep = extent.keep();
        keep[0][1] = section.south as f32;
        keep[1][1] = section.north as f32;
        let mut caption = format!("from the south, {} m deep", metres(section.north - section.south));
        if exaggeration > 1.0 {
            caption += &format!(", heights × {exaggeration:.0}");
        }
        let middle = [centre[0], 0.5 * (section.south + section.north), centre[2]];
        let south =
            Panel { view: View::South, frame, scale, exaggeration, centre: middle, keep, haze: section.haze };
        sheet.panels.push((south, caption));
        sheet.legend = split.legend;
        sheet
    }

    /// The better of the side-by-side and the stacked layout, each at its best ratio.
    fn split(&self, extent: &Extent) -> Split {
        let (gap, line) = (6 * self.text, (font::HEIGHT + 6) * self.text);
        let left = 2 * gap;
        let top = 2 * line + gap;
        let legend = (24 * font::ADVANCE * self.text).min(self.width / 4);
        let (full, tall) =
            (self.width.saturating_sub(2 * left).max(16), self.height.saturating_sub(top + gap).max(16));
        let beside = full.saturating_sub(legend + 2 * gap).max(8);
        let mut best: Option<Split> = None;
        for percent in (15..=75).step_by(1) {
            // Stacked: the view from the south is as wide as the picture.
            let rows = tall.saturating_sub(line);
            let lower = (rows * percent / 100).max(8);
            let upper = rows.saturating_sub(lower).max(8);
            let above = Frame { x: left, y: top, width: beside, height: upper };
            let south = Frame { x: left, y: top + upper + line, width: full, height: lower };
            let beside_above = Frame { x: left + beside + 2 * gap, y: top, width: legend, height: upper };
            consider(&mut best, extent, above, south, beside_above, true);
            // Side by side.
            let right = (beside.saturating_sub(2 * gap) * percent / 100).max(8);
            let wide = beside.saturating_sub(2 * gap + right).max(8);
            let above = Frame { x: left, y: top, width: wide, height: tall };
            let south = Frame { x: left + wide + 2 * gap, y: top, width: right, height: tall };
            let legend = Frame { x: south.x + right + 2 * gap, y: top, width: legend, height: tall };
            consider(&mut best, extent, above, south, legend, false);
        }
        let mut split = best.expect("at least one arrangement was considered");
        split.trim(extent, gap, line, top + tall, font::ADVANCE * self.text);
        split
    }

    pub(super) fn draw(&self, points: &Points, colouring: &Colouring) -> Picture {
        let mut picture = Picture::new(self.width, self.height, self.style.paper);
        let line = (font::HEIGHT + 6) * self.text;
        picture.text(12 * self.text, 6 * self.text, &self.title, self.text, self.style.ink);
        for (panel, caption) in &self.panels {
            picture.fill(panel.frame, self.style.ground);
            panel.draw(&mut picture, points, colouring, self.style.ground);
            let (x, y) = (panel.frame.x, panel.frame.y.saturating_sub(line - 3 * self.text));
            picture.text(x, y, caption, self.text, self.style.faint);
            self.scale_bar(&mut picture, panel, caption);
        }
        if !self.panels.is_empty() {
            self.draw_legend(&mut picture, points, colouring);
        }
        picture
    }

    /// Draws a bar of a round length at the right end of the panel's caption line, if it fits.
    fn scale_bar(&self, picture: &mut Picture, panel: &Panel, caption: &str) {
        let frame = panel.frame;
        let length = round_below(f64::from(frame.width) * 0.25 / panel.scale);
        let dots = (length * panel.scale).round() as u32;
        let name = format!("{} m", round_number(length, length));
        let needed = dots + (font::width(&name) + font::width(caption) + 24) * self.text;
        if needed > frame.width {
            return;
        }
        let x = frame.x + frame.width - dots;
        let y = frame.y - 6 * self.text;
        picture.fill(Frame { x, y, width: dots, height: self.text }, self.style.ink);
        for end in [x, x + dots - self.text.min(dots)] {
            let tick = Frame { x: end, y: y - 3 * self.text, width: self.text, height: 4 * self.text };
            picture.fill(tick, self.style.ink);
        }
        let text_x = x - (font::width(&name) + 6) * self.text;
        picture.text(text_x, frame.y - 10 * self.text, &name, self.text, self.style.ink);
    }

    fn draw_legend(&self, picture: &mut Picture, points: &Points, colouring: &Colouring) {
        let Frame { x, y, height, .. } = self.legend;
        let (t, line) = (self.text, (font::HEIGHT + 5) * self.text);
        let lines = (height / line).saturating_sub(3).clamp(1, 24) as usize;
        let top = y + 2 * line;
        let bar = height.saturating_sub(3 * line).clamp(1, 26 * line);
        let draw_bar = |picture: &mut Picture, title: &str, table: &[Rgb]| {
            picture.text(x, y, title, t, self.style.faint);
            for row in 0..bar {
                let colour = mixed(table, 1.0 - row as f32 / bar as f32);
                picture.fill(Frame { x, y: top + row, width: 14 * t, height: 1 }, colour);
            }
        };
        match colouring.legend(points, lines) {
            Legend::Marks { title, marks, table } => {
                draw_bar(picture, title, table);
                for (share, text) in marks {
                    let at = top + (bar as f32 * (1.0 - share)) as u32;
                    picture.fill(Frame { x: x + 14 * t, y: at, width: 4 * t, height: t }, self.style.faint);
                    picture.text(x + 22 * t, at.saturating_sub(3 * t), &text, t, self.style.ink);
                }
            }
            Legend::Bar { title, low, high, table } => {
                draw_bar(picture, title, table);
                let (low, high) = (f64::from(low), f64::from(high));
                let step = round_below((high - low) / 4.0).max(1e-6);
                let mut tick = (low / step).ceil() * step;
                while tick <= high {
                    let at = top + (f64::from(bar) * (high - tick) / (high - low)) as u32;
                    picture.fill(Frame { x: x + 14 * t, y: at, width: 4 * t, height: t }, self.style.faint);
                    picture.text(
                        x + 22 * t,
                        at.saturating_sub(3 * t),
                        &round_number(tick, step),
                        t,
                        self.style.ink,
                    );
                    if tick + step <= tick {
                        // The height is too large for such a small step.
                        break;
                    }
                    tick += step;
                }
            }
            Legend::List { title, entries, more } => {
                picture.text(x, y, title, t, self.style.faint);
                let mut at = y + 2 * line;
                for entry in entries {
                    picture.fill(Frame { x, y: at, width: 8 * t, height: 7 * t }, entry.colour);
                    picture.text(x + 14 * t, at, &entry.label, t, self.style.ink);
                    at += line;
                }
                if more > 0 {
                    picture.text(x + 14 * t, at, &format!("and {more} more"), t, self.style.faint);
                }
            }
        }
    }
}

/// Replaces the layout if this one shows the cloud at a larger scale.
fn consider(
    best: &mut Option<Split>,
    extent: &Extent,
    above: Frame,
    south: Frame,
    legend: Frame,
    is_stacked: bool,
) {
    let (dx, dy, dz) = (extent.size(0), extent.size(1), extent.size(2));
    let fit =
        |frame: Frame, w: f64, h: f64| (f64::from(frame.width) / w).min(f64::from(frame.height) / h) * 0.97;
    let above_scale = fit(above, dx, dy);
    // Flat terrain would otherwise be drawn as a line.
    let wanted = 0.1 * dx / dz;
    let exaggeration = [1.0, 2.0, 5.0, 10.0, 20.0].into_iter().find(|e| *e >= wanted).unwrap_or(20.0);
    let south_scale = fit(south, dx, dz * exaggeration).min(MAX_SCALE_RATIO * above_scale);
    let seen = dx * dy * above_scale * above_scale;
    let seen_south = dx * dz * exaggeration * south_scale * south_scale;
    let quality = seen * seen_south.sqrt();
    if best.as_ref().is_none_or(|b| quality > b.quality) {
        let (above, south) = ((above, above_scale), (south, south_scale, exaggeration));
        *best = Some(Split { above, south, legend, is_stacked, quality });
    }
}

impl Split {
    /// Makes the frames as large as what they show and their captions, and moves what follows them; `bottom`
    /// is the lower edge of all frames, `letter` the width of a letter.
    fn trim(&mut self, extent: &Extent, gap: u32, line: u32, bottom: u32, letter: u32) {
        const CAPTION_LETTERS: [u32; 2] = [24, 40];
        let (dx, dy, dz) = (extent.size(0), extent.size(1), extent.size(2));
        let shown = |frame: Frame, scale: f64, width: f64, height: f64, letters: u32| {
            let dots = |metres: f64, least: u32, room: u32| {
                ((metres * scale * (1.0 + MARGIN)).ceil() as u32).clamp(least.min(room), room)
            };
            let width = dots(width, letters * letter, frame.width);
            Frame { width, height: dots(height, 8, frame.height), ..frame }
        };
        let (above, scale) = self.above;
        let above = shown(above, scale, dx, dy, CAPTION_LETTERS[0]);
        let (south, scale, exaggeration) = self.south;
        let mut south = shown(south, scale, dx, dz * exaggeration, CAPTION_LETTERS[1]);
        match self.is_stacked {
            true => {
                south.y = above.y + above.height + line;
                self.legend.x = above.x + above.width + 2 * gap;
                let is_free = south.x + south.width < self.legend.x;
                self.legend.height = if is_free { bottom.saturating_sub(above.y) } else { above.height };
            }
            false => {
                south.x = above.x + above.width + 2 * gap;
                self.legend.x = south.x + south.width + 2 * gap;
            }
        }
        (self.above.0, self.south.0) = (above, south);
    }
}

/// Height above which the view from above omits points, in world coordinates; `None` if no ceiling hides the
/// rest.
pub(super) fn ceiling(points: &Points) -> Option<f64> {
    if points.is_empty() { None } else { Section::choose(points, &Extent::of(points)).cut_above }
}

/// The points that the views show.
struct Section {
    south: f64,
    north: f64,
    haze: f32,
    cut_above: Option<f64>,
}

impl Section {
    fn choose(points: &Points, extent: &Extent) -> Section {
        let room = is_room(points, extent);
        let middle = 0.5 * (extent.low[1] + extent.high[1]);
        let cut_above = room.then(|| 0.5 * (extent.low[2] + extent.high[2]) + points.origin().z);
        if room {
            return Section { south: middle, north: extent.high[1], haze: 0.35, cut_above };
        }
        let thickness = slice(points, extent, middle);
        let middle = fullest(points, extent, thickness);
        Section { south: middle - 0.5 * thickness, north: middle + 0.5 * thickness, haze: 0.5, cut_above }
    }
}

/// Thickness of the thinnest slice about `middle` that contains enough points for a readable view, m.
fn slice(points: &Points, extent: &Extent, middle: f64) -> f64 {
    const MIN_POINTS: usize = 60_000;
    let depth = extent.size(1);
    // A third of the height shows crowns rather than single twigs.
    let mut thickness = (extent.size(2) / 3.0).clamp(0.04 * depth, 0.25 * depth);
    while thickness < depth {
        let half = (0.5 * thickness) as f32;
        let inside = points.offsets().filter(|p| (p[1] - middle as f32).abs() <= half).count();
        if inside >= MIN_POINTS.min(points.len() / 2) {
            return thickness;
        }
        thickness *= 1.5;
    }
    depth
}

/// The middle of the slice of a thickness that shows most: whose points fill most cells of the view from the
/// south.
fn fullest(points: &Points, extent: &Extent, thickness: f64) -> f64 {
    const SLICES: usize = 96;
    const COLUMNS: usize = 64;
    const ROWS: usize = 32;
    let cell = |p: &[f32; 3], axis: usize, count: usize| {
        let share = (f64::from(p[axis]) - extent.low[axis]) / extent.size(axis);
        ((share * count as f64) as usize).min(count - 1)
    };
    // A bit for each cell of the view.
    let mut filled = vec![[0u64; ROWS]; SLICES];
    for p in points.offsets() {
        filled[cell(&p, 1, SLICES)][cell(&p, 2, ROWS)] |= 1 << cell(&p, 0, COLUMNS);
    }
    let depth = extent.size(1);
    let width = ((thickness / depth * SLICES as f64).round() as usize).clamp(1, SLICES);
    let seen = |first: usize| {
        let slices = &filled[first..first + width];
        (0..ROWS).map(|row| slices.iter().fold(0, |all, slice| all | slice[row]).count_ones()).sum::<u32>()
    };
    // Of equals the one nearest to the middle.
    let off_middle = |first: usize| (2 * first + width).abs_diff(SLICES);
    let best = (0..=SLICES - width).max_by_key(|&first| (seen(first), std::cmp::Reverse(off_middle(first))));
    let middle = (best.unwrap_or(0) as f64 + 0.5 * width as f64) / SLICES as f64 * depth + extent.low[1];
    let half = 0.5 * thickness.min(depth);
    // No clamp: rounding may leave the upper limit below the lower one.
    middle.max(extent.low[1] + half).min(extent.high[1] - half)
}

/// True if a ceiling covers most of the floor.
fn is_room(points: &Points, extent: &Extent) -> bool {
    const CELLS: usize = 48;
    let height = extent.size(2);
    if height < 0.12 * extent.size(0).max(extent.size(1)) {
        return false;
    }
    let (roof, floor) = (extent.low[2] + 0.85 * height, extent.low[2] + 0.3 * height);
    let mut cells = vec![(false, false); CELLS * CELLS];
    for p in points.offsets() {
        let cell = |axis: usize| {
            let share = (f64::from(p[axis]) - extent.low[axis]) / extent.size(axis);
            ((share * CELLS as f64) as usize).min(CELLS - 1)
        };
        let (has_roof, has_floor) = &mut cells[cell(1) * CELLS + cell(0)];
        *has_roof |= f64::from(p[2]) > roof;
        *has_floor |= f64::from(p[2]) < floor;
    }
    let with_floor = cells.iter().filter(|c| c.1).count();
    let with_both = cells.iter().filter(|c| c.0 && c.1).count();
    with_floor > 0 && 2 * with_both > with_floor
}

fn title(points: &Points, name: &str, room: u32) -> String {
    let mut parts = Vec::new();
    if points.is_empty() {
        parts.push("no points".to_owned());
    } else {
        let size = points.bounds().size();
        parts.push(format!("{} points", grouped(points.total())));
        parts.push(format!("{} × {} × {} m", metres(size.x), metres(size.y), metres(size.z)));
    }
    let facts = parts.join(" · ");
    let left = (room as usize).saturating_sub(facts.chars().count() + 8);
    let name: String = name.chars().take(left).collect();
    if name.is_empty() { facts } else { format!("{name} · {facts}") }
}

impl Frame {
    const NONE: Frame = Frame { x: 0, y: 0, width: 0, height: 0 };
}

#[cfg(test)]
mod tests {
    use super::super::{ColourBy, draw};
    use super::*;
    use vlscan_formats::{AttributeSet, PointRow};
    use vlscan_geom::DVec3;

    fn cloud(n: usize, at: impl Fn(f64, f64) -> f64) -> Points {
        use vlscan_formats::Attribute::{Class, Intensity, Object, ReturnNumber};
        let mut points =
            Points::new(AttributeSet::of(|a| [Intensity, Class, ReturnNumber, Object].contains(&a)));
        for i in 0..n * n {
            let (x, y) = ((i % n) as f64, (i / n) as f64);
            let position = DVec3::new(500_000.0 + x, 5_400_000.0 + y, at(x, y));
            let object = if i % 7 == 0 { "7" } else { "8" };
            let (class, return_number) = ((i % 3) as u8, 1 + (i % 4) as u8);
            let row = PointRow { position, intensity: i as f32, class, return_number, ..PointRow::default() };
            points.push(&row, Some(object));
        }
        points
    }

    fn drawn_share(picture: &Picture) -> f64 {
        let dots = picture.width() * picture.height();
        let drawn = (0..dots)
            .map(|i| picture.dot(i % picture.width(), i / picture.width()))
            .filter(|c| ![DARK.paper, DARK.ground, DARK.ink, DARK.faint].contains(c))
            .count();
        drawn as f64 / f64::from(dots)
    }

    #[test]
    fn every_colouring_fills_a_good_part_of_the_picture() {
        let points = cloud(200, |x, y| 20.0 + 5.0 * libm::sin(x * 0.1) * libm::cos(y * 0.07));
        for colour in ColourBy::ALL {
            let options = PreviewOptions { colour, width: 800, height: 600, ..PreviewOptions::default() };
            let picture = draw(&points, &options);
            assert_eq!((picture.width(), picture.height()), (800, 600));
            assert!(drawn_share(&picture) > 0.25, "{colour:?}: {}", drawn_share(&picture));
        }
    }

    #[test]
    fn the_views_do_not_leave_the_picture_or_touch() {
        for (width, height) in [(1600, 1200), (800, 2000), (2400, 500), (320, 240)] {
            let points = cloud(50, |x, y| 0.1 * x * y);
            let sheet = Sheet::new(&points, &PreviewOptions { width, height, ..PreviewOptions::default() });
            let [a, b] = [&sheet.panels[0].0.frame, &sheet.panels[1].0.frame];
            for f in [a, b] {
                assert!(f.x + f.width <= width && f.y + f.height <= height, "{f:?} in {width} × {height}");
            }
            assert!(a.x + a.width <= b.x || a.y + a.height <= b.y, "{a:?} {b:?}");
        }
    }

    #[test]
    fn odd_clouds_are_drawn_without_panic() {
        let mut single = Points::default();
        single.push(&PointRow { position: DVec3::new(1e7, -1e7, 1e5), ..PointRow::default() }, None);
        let mut line = Points::default();
        let mut vast = Points::default();
        for i in 0..100 {
            line.push(
                &PointRow { position: DVec3::new(f64::from(i), 0.0, 0.0), ..PointRow::default() },
                None,
            );
            let sign = if i % 2 == 0 { 1e300 } else { -1e300 };
            vast.push(
                &PointRow { position: DVec3::new(sign, f64::from(i), 0.0), ..PointRow::default() },
                None,
            );
        }
        let empty = Points::default();
        for points in [single, line, vast, empty] {
            for (width, height) in [(0, 0), (500, 400), (1, 5000)] {
                draw(&points, &PreviewOptions { width, height, ..PreviewOptions::default() });
            }
        }
    }

    #[test]
    fn a_room_is_cut_open_and_a_forest_is_not() {
        let mut room = Points::default();
        let mut forest = Points::default();
        for i in 0..40_000u32 {
            let (x, y) = (f64::from(i % 200) * 0.04, f64::from(i / 200) * 0.03);
            for z in [0.0, 2.8] {
                room.push(&PointRow { position: DVec3::new(x, y, z), ..PointRow::default() }, None);
            }
            let tree = 12.0 + 9.0 * libm::sin(0.9 * x * 25.0) * libm::cos(1.1 * y * 25.0);
            for z in [0.0, tree] {
                forest.push(
                    &PointRow { position: DVec3::new(x * 25.0, y * 25.0, z), ..PointRow::default() },
                    None,
                );
            }
        }
        assert!(is_room(&room, &Extent::of(&room)));
        assert!(!is_room(&forest, &Extent::of(&forest)));
        let section = Section::choose(&room, &Extent::of(&room));
        assert!(section.cut_above.is_some_and(|c| (1.0..2.0).contains(&c)));
    }
}
