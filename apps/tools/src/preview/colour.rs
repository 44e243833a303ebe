//! Colours of points, and the legend.

use super::ranges::{inner_range, quantiles, rank};
use crate::chart::{Rgb, label};
use crate::cloud::Points;
use libm::{cos, sin};
use std::path::Path;
use vlscan_base::diag::{Diagnostics, Place};
use vlscan_formats::{Attribute, AttributeSet};

/// Attribute that colours show.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum ColourBy {
    /// Height.
    #[default]
    Height,
    /// Class of the surface.
    Class,
    /// Echo strength.
    Intensity,
    /// Part that was hit.
    Object,
    /// Number of the return.
    Return,
    /// Leg that was flown (point source id of LAS).
    Leg,
    /// Device of a scanner of several channels.
    Channel,
    /// Time of the pulse.
    Time,
    /// Red, green and blue of the point.
    Rgb,
}

impl ColourBy {
    /// All of them.
    pub const ALL: [ColourBy; 9] = {
        use ColourBy::{Channel, Class, Height, Intensity, Leg, Object, Return, Rgb, Time};
        [Height, Class, Intensity, Object, Return, Leg, Channel, Time, Rgb]
    };

    /// Its name on the command line.
    pub fn name(self) -> &'static str {
        ["height", "class", "intensity", "object", "return", "leg", "channel", "time", "rgb"][self as usize]
    }

    /// The attribute that this colouring shows beside the position.
    fn attribute(self) -> Option<Attribute> {
        Some(match self {
            ColourBy::Height | ColourBy::Rgb => return None,
            ColourBy::Class => Attribute::Class,
            ColourBy::Intensity => Attribute::Intensity,
            ColourBy::Object => Attribute::Object,
            ColourBy::Return => Attribute::ReturnNumber,
            ColourBy::Leg => Attribute::Leg,
            ColourBy::Channel => Attribute::Channel,
            ColourBy::Time => Attribute::Time,
        })
    }

    /// The attributes that a picture in these colours needs beside the positions, and the points' own
    /// colours for [`ColourBy::Rgb`], which are read with all attributes.
    pub fn attributes(self) -> AttributeSet {
        AttributeSet::of(|attribute| self.attribute() == Some(attribute))
    }

    /// True if the points have the attribute of this colouring.
    pub(super) fn shown_by(self, points: &Points) -> bool {
        match self {
            ColourBy::Rgb => points.has_colours(),
            _ => self.attribute().is_none_or(|attribute| points.has(attribute)),
        }
    }

    /// A warning of the points of the file `path` that lack what this colouring shows, or whose colour is
    /// that of other numbers.
    pub fn doubts(self, points: &Points, path: &Path) -> Diagnostics {
        if points.total() > 0 && !self.shown_by(points) {
            return self.lack(path);
        }
        let (legs, channels) = points.beyond_bytes();
        let (count, what) = match self {
            ColourBy::Leg => (legs, "legs"),
            ColourBy::Channel => (channels, "channels"),
            _ => (0, ""),
        };
        let mut found = Diagnostics::default();
        if count > 0 {
            let message = format!("{count} points have {what} above 255, shown as 255");
            found.warn(Some(Place::of_file(path)), message);
        }
        found
    }

    /// A warning that the points of the file `path` lack what this colouring shows.
    fn lack(self, path: &Path) -> Diagnostics {
        let what = self.attribute().map_or("a colour", Attribute::described);
        let message = format!("no point has {what}; `--colour {}` shows the heights instead", self.name());
        let mut found = Diagnostics::default();
        let warning = found.warn(Some(Place::of_file(path)), message);
        if self == ColourBy::Rgb {
            warning.help("`vlscan run` writes colours with `--columns Red,Green,Blue`");
        }
        found
    }
}

/// From low to high: dark to light and blue to yellow, readable in greyscale and with colour vision
/// deficiency.
pub(super) const HEIGHTS: [Rgb; 8] = [
    [62, 54, 130],
    [54, 92, 168],
    [36, 130, 160],
    [38, 162, 138],
    [86, 189, 104],
    [164, 209, 76],
    [240, 222, 84],
    [255, 247, 204],
];
/// From weak to strong: violet over red to pale yellow.
const STRENGTHS: [Rgb; 7] = [
    [58, 36, 98],
    [112, 44, 122],
    [168, 54, 116],
    [218, 82, 92],
    [244, 132, 76],
    [252, 190, 106],
    [254, 244, 190],
];
const RETURNS: [Rgb; 6] =
    [[236, 240, 244], [96, 178, 240], [246, 174, 66], [118, 204, 120], [226, 100, 130], [178, 140, 230]];

/// Places that no flight line of a survey covers.
const NO_LINE: Rgb = [112, 118, 126];

/// Heights of the lowest and the highest colour of a cloud by itself, world coordinates.
pub(super) fn height_range(points: &Points) -> (f64, f64) {
    let (low, high) = inner_range(points.offsets().map(|p| p[2]));
    let z = points.origin().z;
    (f64::from(low) + z, f64::from(high) + z)
}

/// How values are mapped to colours.
pub(super) enum Colouring {
    /// A continuous value between two limits.
    Ramp { value: ColourBy, low: f32, high: f32, table: &'static [Rgb] },
    /// A continuous value by its rank: equal numbers of points have equal parts of the colours, however
    /// skewed the values are. `quantiles` ascend from the lowest to the highest value.
    Ranks { quantiles: Vec<f32>, table: &'static [Rgb] },
    /// A value of each point from 0 to `high`; points of 0 have none.
    Values { title: &'static str, values: Vec<f32>, high: f32, table: &'static [Rgb] },
    /// The colours of the points themselves.
    Own,
    /// A colour for each number.
    Table { value: ColourBy, colours: Vec<Rgb> },
}

/// A line of the legend.
pub(super) struct Entry {
    pub(super) colour: Rgb,
    pub(super) label: String,
}

/// The legend beside the picture.
pub(super) enum Legend {
    /// A bar of colours with numbers beside it.
    Bar { title: &'static str, low: f32, high: f32, table: &'static [Rgb] },
    /// A bar of colours with values at given places, 0–1 from the low end.
    Marks { title: &'static str, marks: Vec<(f32, String)>, table: &'static [Rgb] },
    /// Colours with names; `more` is the number of entries that did not fit.
    List { title: &'static str, entries: Vec<Entry>, more: usize },
    /// Nothing: colours have no meaning but their own.
    Nothing,
}

impl Colouring {
    /// Colours by `wanted`, or by height if the points lack that attribute; `heights` are those of the lowest
    /// and the highest colour, world coordinates, if not those of the points.
    pub(super) fn new(points: &Points, wanted: ColourBy, heights: Option<(f64, f64)>) -> Colouring {
        let table = |colours: Vec<Rgb>| Colouring::Table { value: wanted, colours };
        match wanted {
            _ if !wanted.shown_by(points) => Colouring::of_heights(points, heights),
            ColourBy::Height => Colouring::of_heights(points, heights),
            ColourBy::Rgb => Colouring::Own,
            ColourBy::Intensity => Colouring::Ranks {
                quantiles: quantiles(points.intensity.iter(), points.intensity.len()),
                table: &STRENGTHS,
            },
            ColourBy::Time => {
                let (low, high) = inner_range(points.time.iter().map(|t| t as f32));
                Colouring::Ramp { value: wanted, low, high, table: &HEIGHTS }
            }
            ColourBy::Leg => {
                let colour = |n: usize| match (points.legs_from_one(), n) {
                    (true, 0) => NO_LINE,
                    (true, n) => object_colour(n - 1),
                    (false, n) => object_colour(n),
                };
                table((0..=255).map(colour).collect())
            }
            ColourBy::Channel => table((0..=255).map(object_colour).collect()),
            ColourBy::Class => table((0..=255).map(class_colour).collect()),
            ColourBy::Return => {
                table((0..=255usize).map(|r| RETURNS[r.saturating_sub(1) % RETURNS.len()]).collect())
            }
            ColourBy::Object => table((0..points.objects.len()).map(object_colour).collect()),
        }
    }

    /// Colours by a value of each point, in their order; points without a positive one are grey.
    pub(super) fn of_values(title: &'static str, values: Vec<f32>) -> Colouring {
        let (_, high) = inner_range(values.iter().copied().filter(|value| *value > 0.0));
        Colouring::Values { title, values, high, table: &STRENGTHS }
    }

    fn of_heights(points: &Points, heights: Option<(f64, f64)>) -> Colouring {
        let z = points.origin().z;
        let (low, high) = match heights {
            Some((low, high)) => ((low - z) as f32, (high - z) as f32),
            None => inner_range(points.offsets().map(|p| p[2])),
        };
        Colouring::Ramp { value: ColourBy::Height, low, high, table: &HEIGHTS }
    }

    pub(super) fn of(&self, points: &Points, i: usize) -> Rgb {
        match self {
            Colouring::Values { values, .. } if values.get(i).is_none_or(|value| *value <= 0.0) => NO_LINE,
            Colouring::Ramp { table, .. }
            | Colouring::Ranks { table, .. }
            | Colouring::Values { table, .. } => mixed(table, self.fraction(points, i)),
            Colouring::Own => points.colour_of(i),
            Colouring::Table { value, colours } => colours[number(points, *value, i)],
        }
    }

    /// Place of a continuous value between the lowest and the highest colour, 0–1; NaN for values that are
    /// all equal.
    pub(super) fn fraction(&self, points: &Points, i: usize) -> f32 {
        match self {
            Colouring::Ramp { value: ColourBy::Time, low, high, .. } => {
                (points.time.at(i) as f32 - low) / (high - low)
            }
            Colouring::Ramp { low, high, .. } => (points.offset(i)[2] - low) / (high - low),
            Colouring::Ranks { quantiles, .. } => rank(quantiles, points.intensity.at(i)),
            Colouring::Values { values, high, .. } => values.get(i).map_or(0.0, |value| value / high),
            Colouring::Own | Colouring::Table { .. } => 0.0,
        }
    }

    /// The distinct values of the `chosen` points with name, colour and number of points; objects in order of
    /// decreasing count, all others by value. Empty for continuous values.
    pub(super) fn names(&self, points: &Points, chosen: &[u32]) -> Vec<(usize, String, Rgb, u64)> {
        let Colouring::Table { value, colours } = self else { return Vec::new() };
        let mut counts = vec![0u64; colours.len()];
        chosen.iter().for_each(|&i| counts[number(points, *value, i as usize)] += 1);
        let mut present: Vec<usize> = (0..counts.len()).filter(|&n| counts[n] > 0).collect();
        if *value == ColourBy::Object {
            present.sort_by_key(|&n| std::cmp::Reverse(counts[n]));
        }
        present.into_iter().map(|n| (n, name(points, *value, n), colours[n], counts[n])).collect()
    }

    /// The legend with at most `lines` lines.
    pub(super) fn legend(&self, points: &Points, lines: usize) -> Legend {
        match self {
            Colouring::Ramp { value, low, high, table } => {
                let (title, shift) = match value {
                    ColourBy::Time => ("time, s", 0.0),
                    _ => ("height, m", points.origin().z as f32),
                };
                Legend::Bar { title, low: low + shift, high: high + shift, table }
            }
            Colouring::Ranks { quantiles, table, .. } => {
                let mark = |quarter: usize| {
                    let value = quantiles[quarter * (quantiles.len() - 1) / 4];
                    (0.25 * quarter as f32, label::significant(f64::from(value)))
                };
                Legend::Marks { title: "intensity", marks: (0..=4).map(mark).collect(), table }
            }
            Colouring::Values { title, high, table, .. } => {
                Legend::Bar { title, low: 0.0, high: *high, table }
            }
            Colouring::Own => Legend::Nothing,
            Colouring::Table { value, colours } => {
                let mut counts = vec![0u64; colours.len()];
                (0..points.len()).for_each(|i| counts[number(points, *value, i)] += 1);
                let mut present: Vec<usize> = (0..counts.len()).filter(|&n| counts[n] > 0).collect();
                present.sort_by_key(|&n| std::cmp::Reverse(counts[n]));
                let more = present.len().saturating_sub(lines);
                present.truncate(lines);
                if *value != ColourBy::Object {
                    present.sort_unstable();
                }
                let entry = |n: usize| {
                    let share = 100.0 * counts[n] as f64 / points.len() as f64;
                    let letters = if *value == ColourBy::Object { 14 } else { usize::MAX };
                    let name: String = name(points, *value, n).chars().take(letters).collect();
                    Entry { colour: colours[n], label: format!("{name} {}", label::share(share)) }
                };
                let title = match value {
                    ColourBy::Class => "class",
                    ColourBy::Return => "return",
                    ColourBy::Leg if points.legs_from_one() => "line",
                    ColourBy::Leg => "leg",
                    ColourBy::Channel => "channel",
                    _ => "object",
                };
                Legend::List { title, entries: present.into_iter().map(entry).collect(), more }
            }
        }
    }
}

/// Name of the value `n`, as shown in the legend.
fn name(points: &Points, value: ColourBy, n: usize) -> String {
    match value {
        ColourBy::Class => class_name(n),
        ColourBy::Return if n == 0 => "unknown".to_owned(),
        ColourBy::Return => format!("return {n}"),
        ColourBy::Leg if !points.legs_from_one() => format!("leg {n}"),
        ColourBy::Leg if n == 0 => "no line".to_owned(),
        ColourBy::Leg => format!("line {n}"),
        ColourBy::Channel => format!("channel {n}"),
        _ => match points.objects.get(n) {
            Some(object) if !object.is_empty() => object.clone(),
            _ => "no object".to_owned(),
        },
    }
}

fn number(points: &Points, value: ColourBy, i: usize) -> usize {
    match value {
        ColourBy::Class => usize::from(points.class.at(i)),
        ColourBy::Return => usize::from(points.return_number.at(i)),
        ColourBy::Leg => usize::from(points.leg.at(i).min(255)),
        ColourBy::Channel => usize::from(points.channel.at(i)),
        _ => usize::from(points.object.at(i)),
    }
}

/// The colour at the fraction `t` of a table, 0–1.
pub(super) fn mixed(table: &[Rgb], t: f32) -> Rgb {
    let at = t.clamp(0.0, 1.0) * (table.len() - 1) as f32;
    // A range of zero width results in NaN, which maps to the lowest colour.
    let i = (at as usize).min(table.len().saturating_sub(2));
    let part = if at.is_nan() { 0.0 } else { at - i as f32 };
    std::array::from_fn(|c| {
        let (a, b) = (f32::from(table[i][c]), f32::from(table[(i + 1).min(table.len() - 1)][c]));
        (a + (b - a) * part).round() as u8
    })
}

/// Colours of point classes: bare ground like sand, trunks (4) brown, leaves (5) green.
const CLASSES: [(usize, Rgb); 18] = [
    (0, [150, 158, 166]),
    (1, [150, 158, 166]),
    (2, [198, 178, 142]),
    (3, [166, 204, 98]),
    (4, [142, 88, 48]),
    (5, [66, 160, 84]),
    (6, [222, 100, 78]),
    (7, [220, 60, 160]),
    (8, [214, 196, 120]),
    (9, [70, 130, 214]),
    (10, [132, 126, 140]),
    (11, [132, 126, 140]),
    (13, [240, 220, 110]),
    (14, [240, 220, 110]),
    (15, [240, 220, 110]),
    (16, [240, 220, 110]),
    (17, [180, 150, 190]),
    (18, [220, 60, 160]),
];

fn class_colour(class: usize) -> Rgb {
    let known = CLASSES.iter().find(|(code, _)| *code == class);
    known.map_or_else(|| object_colour(class), |(_, colour)| *colour)
}

/// Name of a point class.
fn class_name(class: usize) -> String {
    let known = u8::try_from(class).ok().and_then(crate::cloud::class_name);
    known.map_or_else(|| format!("class {class}"), |name| format!("{class} {name}"))
}

/// Colour of an object. Distinct colours of equal lightness for any number of objects: hues a golden angle
/// apart in the Oklab space (Ottosson 2020), with two chroma levels.
pub(super) fn object_colour(number: usize) -> Rgb {
    let hue = (number as f64 * 2.399_963_229_728_653 + 0.6) % std::f64::consts::TAU;
    let lightness = if number.is_multiple_of(2) { 0.78 } else { 0.68 };
    let chroma = 0.12;
    let (a, b) = (chroma * cos(hue), chroma * sin(hue));
    let cube = |x: f64| x * x * x;
    let l = cube(lightness + 0.396_337_777_4 * a + 0.215_803_757_3 * b);
    let m = cube(lightness - 0.105_561_345_8 * a - 0.063_854_172_8 * b);
    let s = cube(lightness - 0.089_484_177_5 * a - 1.291_485_548 * b);
    let linear = [
        4.076_741_662_1 * l - 3.307_711_591_3 * m + 0.230_969_929_2 * s,
        -1.268_438_004_6 * l + 2.609_757_401_1 * m - 0.341_319_396_5 * s,
        -0.004_196_086_3 * l - 0.703_418_614_7 * m + 1.707_614_701 * s,
    ];
    linear.map(|c| {
        let c = c.clamp(0.0, 1.0);
        let coded = if c <= 0.003_130_8 { 12.92 * c } else { 1.055 * libm::pow(c, 1.0 / 2.4) - 0.055 };
        (255.0 * coded).round() as u8
    })
}

#[cfg(test)]
mod tests;
