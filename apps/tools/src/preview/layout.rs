//! The layout of a picture: title, views with captions and axes, legend.

use super::PreviewOptions;
use super::axes;
use super::colour::{ColourBy, Colouring};
use super::legend;
use super::panel::{Panel, View};
use super::section::{Extent, Section};
use super::style::{DARK, LIGHT, Style};
use crate::chart::label::{grouped, metres};
use crate::chart::{Frame, NORTH_HEIGHT, Picture, font};
use crate::cloud::Points;

/// Dots of the shorter side of a picture (of its height four thirds) per unit of the font.
const DOTS_PER_UNIT: f64 = 700.0;
/// Part of its frame that a view fills along at least one axis.
const FILLED: f64 = 0.98;
/// Largest ratio of the scales of both views: the smaller view is not blown up beyond it.
const MAX_SCALE_RATIO: f64 = 2.0;
/// Room for the title, from the upper edge of the picture, units of the font.
const TITLE: f64 = 18.0;
/// Margin of the picture, units of the font.
const MARGIN: f64 = 6.0;
/// Distance between a view and what is at its right, units of the font.
const GAP: f64 = 10.0;
/// Letters that captions have room for: of the view from above, and of that from the south.
const CAPTION_LETTERS: [f64; 2] = [24.0, 40.0];

/// The layout of one picture.
pub(super) struct Sheet {
    width: u32,
    height: u32,
    /// Size of the text: dots per unit of the font.
    pub(super) text: f64,
    title: String,
    pub(super) style: Style,
    /// The views with their captions: from above, and from the south.
    panels: Vec<(Panel, String)>,
    legend: Frame,
    /// World coordinates of the origin of the points, m.
    pub(super) origin: [f64; 3],
}

impl Sheet {
    /// Lays out a picture of points. The view from above includes the horizontal positions `also`, world
    /// coordinates.
    pub(super) fn new(points: &Points, also: &[[f64; 2]], options: &PreviewOptions) -> Sheet {
        let (width, height) = (options.width.clamp(320, 16_384), options.height.clamp(240, 16_384));
        let text = (f64::from(width).min(f64::from(height) * 4.0 / 3.0) / DOTS_PER_UNIT).max(1.0);
        let letters = (f64::from(width) / (text * font::ADVANCE)) as usize;
        let mut sheet = Sheet {
            width,
            height,
            text,
            title: title(points, &options.title, letters),
            style: if options.light { LIGHT } else { DARK },
            panels: Vec::new(),
            legend: Frame { x: 0, y: 0, width: 0, height: 0 },
            origin: [0.0; 3],
        };
        if points.is_empty() {
            return sheet;
        }
        sheet.origin = points.origin().to_array();
        let extent = Extent::of(points);
        let wide = extent.including(also.iter().map(|[x, y]| [x - sheet.origin[0], y - sheet.origin[1]]));
        let shown = Shown::of(&extent, &wide);
        let room = sheet.room(&extent, &wide, options.colour);
        let split = Split::best(&room, &shown);
        let section = Section::choose(points, &extent);
        sheet.legend = split.legend;
        sheet.panels = vec![
            from_above(&split, &extent, &wide, section.cut_above, sheet.origin[2]),
            from_south(&split, &extent, &section, shown.exaggeration),
        ];
        sheet
    }

    /// The space for views and legend.
    fn room(&self, extent: &Extent, wide: &Extent, colour: ColourBy) -> Room {
        let dots = |units: f64| (units * self.text).ceil() as u32;
        let range = |extent: &Extent, axis: usize| extent.range(axis).map(|v| v + self.origin[axis]);
        let names =
            axes::letters(range(wide, 1)).max(axes::letters(range(extent, 2))).max(axes::NAME_LETTERS);
        let names = dots(names as f64 * font::ADVANCE + axes::LEFT).min(self.width / 5);
        // Numbers are shorter than names of classes and objects.
        let letters = match colour {
            ColourBy::Height | ColourBy::Intensity => 14.0,
            _ => 24.0,
        };
        let (margin, top) = (dots(MARGIN), dots(TITLE + axes::ABOVE));
        Room {
            left: margin + names,
            top,
            right: self.width - margin,
            bottom: self.height.saturating_sub(dots(axes::BELOW)).max(top + 16),
            names,
            gap: dots(GAP),
            line: dots(axes::BELOW + axes::ABOVE),
            legend: dots(letters * font::ADVANCE).min(self.width / 4),
            legend_height: dots(130.0),
            captions: CAPTION_LETTERS.map(|letters| dots(letters * font::ADVANCE)),
        }
    }

    /// The view from above; none of an empty cloud.
    pub(super) fn above(&self) -> Option<&Panel> {
        self.panels.first().map(|(panel, _)| panel)
    }

    pub(super) fn draw(&self, points: &Points, colouring: &Colouring) -> Picture {
        let (text, style) = (self.text, self.style);
        let mut picture = Picture::new(self.width, self.height, style.paper);
        picture.text([MARGIN * text, 6.0 * text], &self.title, text, style.ink);
        for (panel, caption) in &self.panels {
            picture.fill(panel.frame, style.ground);
            panel.draw(&mut picture, points, colouring, style.ground);
            axes::caption(&mut picture, panel, caption, text, style);
            axes::draw(&mut picture, panel, self.origin, text, style);
        }
        if let Some(panel) = self.above() {
            let lines = legend::lines(self.legend, text);
            legend::draw(&mut picture, self.legend, &colouring.legend(points, lines), text, style);
            if let Some(foot) = north_foot(panel.frame, text) {
                picture.north_arrow(foot, text, style.ink, style.ground);
            }
        }
        picture
    }
}

/// Foot of the arrow to the north, in the upper right corner of a frame that has room for it.
fn north_foot(frame: Frame, text: f64) -> Option<[f64; 2]> {
    let [x, y, width, height] = [frame.x, frame.y, frame.width, frame.height].map(f64::from);
    let has_room = width >= 24.0 * text && height >= (NORTH_HEIGHT + 8.0) * text;
    has_room.then_some([x + width - 8.0 * text, y + (NORTH_HEIGHT + 4.0) * text])
}

/// The view from above, with its caption. `wide` is what it shows, `lowest` the height of the points' origin,
/// world coordinates.
fn from_above(
    split: &Split,
    extent: &Extent,
    wide: &Extent,
    cut: Option<f64>,
    lowest: f64,
) -> (Panel, String) {
    let mut keep = extent.keep();
    let mut caption = "from above".to_owned();
    if let Some(cut) = cut {
        keep[1][2] = keep[1][2].min((cut - lowest) as f32);
        caption += &format!(", cut at {} m height", metres(cut));
    }
    let (frame, scale) = split.above;
    let centre = wide.centre();
    let panel = Panel { view: View::Above, frame, scale, exaggeration: 1.0, centre, keep, haze: 0.0 };
    (panel, caption)
}

/// The view from the south, with its caption.
fn from_south(split: &Split, extent: &Extent, section: &Section, exaggeration: f64) -> (Panel, String) {
    let mut keep = extent.keep();
    keep[0][1] = section.south as f32;
    keep[1][1] = section.north as f32;
    let mut caption = format!("from the south, {} m deep", metres(section.north - section.south));
    if exaggeration > 1.0 {
        caption += &format!(", heights × {exaggeration:.0}");
    }
    let (frame, scale) = split.south;
    let [x, _, z] = extent.centre();
    let centre = [x, 0.5 * (section.south + section.north), z];
    let panel = Panel { view: View::South, frame, scale, exaggeration, centre, keep, haze: section.haze };
    (panel, caption)
}

/// Sizes of what the views show, m, with exaggerated heights.
struct Shown {
    above: [f64; 2],
    south: [f64; 2],
    /// Vertical exaggeration in the view from the south.
    exaggeration: f64,
}

impl Shown {
    fn of(extent: &Extent, wide: &Extent) -> Shown {
        let (dx, dz) = (extent.size(0), extent.size(2));
        // Flat terrain would otherwise be drawn as a line.
        let least = 0.1 * dx / dz;
        let exaggeration = [1.0, 2.0, 5.0, 10.0, 20.0].into_iter().find(|e| *e >= least).unwrap_or(20.0);
        Shown { above: [wide.size(0), wide.size(1)], south: [dx, dz * exaggeration], exaggeration }
    }
}

/// The space of a picture for its views and the legend, dots.
struct Room {
    /// Left edge of the first view.
    left: u32,
    /// Upper edge of the first view.
    top: u32,
    right: u32,
    /// Lower edge of the last view.
    bottom: u32,
    /// Width of ticks and their names left of a view.
    names: u32,
    gap: u32,
    /// Height of the ticks of a view and the caption of the one below it.
    line: u32,
    /// Width of the legend.
    legend: u32,
    /// Height of a legend below a view.
    legend_height: u32,
    /// Minimum widths of the views, for their captions.
    captions: [u32; 2],
}

/// Arrangement of the view from the south and the legend.
#[derive(Clone, Copy)]
enum Arrangement {
    /// Below the view from above, with the legend at the right of that view.
    Stacked,
    /// Side by side, with the legend at the right of both.
    SideBySide,
    /// At the right of the view from above, with the legend below.
    Column,
}

/// The frames of the two views and their scale, dots per metre.
struct Split {
    arrangement: Arrangement,
    above: (Frame, f64),
    south: (Frame, f64),
    legend: Frame,
    quality: f64,
}

impl Split {
    /// The arrangement that shows the cloud at the largest scale, without empty parts of frames.
    fn best(room: &Room, shown: &Shown) -> Split {
        let all = (8..=75).flat_map(|percent| {
            let arrangements = [Arrangement::Stacked, Arrangement::SideBySide, Arrangement::Column];
            arrangements.map(|arrangement| Split::of(arrangement, percent, room, shown))
        });
        let first = Split::of(Arrangement::Stacked, 50, room, shown);
        let mut best = all.fold(first, |best, split| if split.quality > best.quality { split } else { best });
        best.trim(room, shown);
        best
    }

    /// An arrangement whose view from the south has a share of the space, per cent.
    fn of(arrangement: Arrangement, percent: u32, room: &Room, shown: &Shown) -> Split {
        let Room { left, top, names, gap, line, .. } = *room;
        let full = room.right.saturating_sub(left).max(16);
        let tall = room.bottom.saturating_sub(top).max(16);
        // The width without a legend at the right.
        let narrow = full.saturating_sub(room.legend + gap).max(8);
        let frame = |x: u32, y: u32, width: u32, height: u32| Frame { x, y, width, height };
        let (above, south, legend) = match arrangement {
            Arrangement::Stacked => {
                let rows = tall.saturating_sub(line);
                let lower = (rows * percent / 100).max(8);
                let upper = rows.saturating_sub(lower).max(8);
                (
                    frame(left, top, narrow, upper),
                    frame(left, top + upper + line, full, lower),
                    frame(left + narrow + gap, top, room.legend, upper),
                )
            }
            Arrangement::SideBySide => {
                let columns = narrow.saturating_sub(gap + names);
                let right = (columns * percent / 100).max(8);
                let wide = columns.saturating_sub(right).max(8);
                let x = left + wide + gap + names;
                let legend = frame(x + right + gap, top, room.legend, tall);
                (frame(left, top, wide, tall), frame(x, top, right, tall), legend)
            }
            Arrangement::Column => {
                let columns = full.saturating_sub(gap + names);
                let right = (columns * percent / 100).max(room.legend.min(columns / 2)).max(8);
                let wide = columns.saturating_sub(right).max(8);
                let x = left + wide + gap + names;
                let upper = tall.saturating_sub(line + room.legend_height.min(tall / 2)).max(8);
                let legend = frame(x, top + upper + line, right, tall.saturating_sub(upper + line));
                (frame(left, top, wide, tall), frame(x, top, right, upper), legend)
            }
        };
        let fit = |frame: Frame, [width, height]: [f64; 2]| {
            (f64::from(frame.width) / width).min(f64::from(frame.height) / height) * FILLED
        };
        let scale = fit(above, shown.above);
        let south_scale = fit(south, shown.south).min(MAX_SCALE_RATIO * scale);
        let seen = |[width, height]: [f64; 2], scale: f64| (width * scale) * (height * scale);
        // The view from above matters more.
        let quality = seen(shown.above, scale) * seen(shown.south, south_scale).sqrt().sqrt();
        Split { arrangement, above: (above, scale), south: (south, south_scale), legend, quality }
    }

    /// Makes the frames as large as what they show and their captions, and moves what follows them.
    fn trim(&mut self, room: &Room, shown: &Shown) {
        let trimmed = |(frame, scale): (Frame, f64), [width, height]: [f64; 2], least: u32| {
            let dots = |metres: f64, least: u32, room: u32| {
                ((metres * scale / FILLED).ceil() as u32).clamp(least.min(room), room)
            };
            let (width, height) = (dots(width, least, frame.width), dots(height, 8, frame.height));
            Frame { width, height, ..frame }
        };
        let above = trimmed(self.above, shown.above, room.captions[0]);
        let mut south = trimmed(self.south, shown.south, room.captions[1]);
        let legend = &mut self.legend;
        let right = above.x + above.width + room.gap;
        match self.arrangement {
            Arrangement::Stacked => {
                south.y = above.y + above.height + room.line;
                legend.x = right;
                let is_free = south.x + south.width < right;
                legend.height = if is_free { room.bottom.saturating_sub(above.y) } else { above.height };
            }
            Arrangement::SideBySide => {
                south.x = right + room.names;
                legend.x = south.x + south.width + room.gap;
            }
            Arrangement::Column => {
                south.x = right + room.names;
                (legend.x, legend.y) = (south.x, south.y + south.height + room.line);
                legend.height = room.bottom.saturating_sub(legend.y);
            }
        }
        (self.above.0, self.south.0) = (above, south);
    }
}

/// The title: name, number of points, size. It has at most about `room` letters.
fn title(points: &Points, name: &str, room: usize) -> String {
    let mut parts = Vec::new();
    if points.is_empty() {
        parts.push("no points".to_owned());
    } else {
        let size = points.bounds().size();
        parts.push(format!("{} points", grouped(points.total())));
        parts.push(format!("{} × {} × {} m", metres(size.x), metres(size.y), metres(size.z)));
    }
    let facts = parts.join(" · ");
    let left = room.saturating_sub(facts.chars().count() + 8);
    let name: String = name.chars().take(left).collect();
    if name.is_empty() { facts } else { format!("{name} · {facts}") }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::preview::draw;
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
            let sheet =
                Sheet::new(&points, &[], &PreviewOptions { width, height, ..PreviewOptions::default() });
            let [a, b] = [&sheet.panels[0].0.frame, &sheet.panels[1].0.frame];
            for f in [a, b] {
                assert!(f.x + f.width <= width && f.y + f.height <= height, "{f:?} in {width} × {height}");
            }
            assert!(a.x + a.width <= b.x || a.y + a.height <= b.y, "{a:?} {b:?}");
        }
    }

    #[test]
    fn clouds_fill_the_frames_of_their_views() {
        let points = cloud(200, |x, y| 20.0 + 5.0 * libm::sin(x * 0.1) * libm::cos(y * 0.07));
        for (width, height) in [(800, 500), (500, 800), (1200, 300)] {
            let options = PreviewOptions { width, height, ..PreviewOptions::default() };
            let sheet = Sheet::new(&points, &[], &options);
            let picture = sheet.draw(&points, &Colouring::new(&points, ColourBy::Height, None));
            let [mut right, mut bottom] = [sheet.legend.x + sheet.legend.width, 0];
            for (panel, caption) in &sheet.panels {
                let f = panel.frame;
                (right, bottom) = (right.max(f.x + f.width), bottom.max(f.y + f.height));
                let is_drawn = |x: u32, y: u32| picture.dot(f.x + x, f.y + y) != DARK.ground;
                let columns = (0..f.width).filter(|x| (0..f.height).any(|y| is_drawn(*x, y)));
                let rows = (0..f.height).filter(|y| (0..f.width).any(|x| is_drawn(x, *y)));
                let is_filled = |drawn: Vec<u32>, all: u32| {
                    let (first, last) = (drawn[0], drawn[drawn.len() - 1]);
                    50 * first <= all && 50 * (all - 1 - last) <= all
                };
                let filled = is_filled(columns.collect(), f.width) || is_filled(rows.collect(), f.height);
                assert!(filled, "{caption} in {width} × {height}");
            }
            assert!(10 * right >= 9 * width || 10 * bottom >= 9 * height, "{width} × {height}");
        }
    }

    #[test]
    fn the_arrow_to_the_north_is_in_the_view_from_above() {
        let points = cloud(100, |x, y| 0.1 * (x + y));
        let options = PreviewOptions { width: 1400, height: 1050, ..PreviewOptions::default() };
        let sheet = Sheet::new(&points, &[], &options);
        let picture = draw(&points, &options);
        let frame = sheet.above().unwrap().frame;
        let [x, y] = north_foot(frame, sheet.text).unwrap();
        let shaft = [4.0, 6.0, 8.0].map(|up| picture.dot(x as u32, (y - up * sheet.text) as u32));
        assert_eq!(shaft, [DARK.ink; 3]);
        assert!((f64::from(frame.x + frame.width) - x) < 20.0 * sheet.text && y > f64::from(frame.y));
        assert_eq!(north_foot(Frame { width: 10, ..frame }, sheet.text), None);
    }

    #[test]
    fn the_size_of_text_follows_that_of_the_picture() {
        let points = cloud(10, |x, _| x);
        let sizes = [(320, 240), (700, 525), (1400, 1050), (2800, 2100)].map(|(width, height)| {
            Sheet::new(&points, &[], &PreviewOptions { width, height, ..PreviewOptions::default() }).text
        });
        assert_eq!(sizes, [1.0, 1.0, 2.0, 4.0]);
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
}
