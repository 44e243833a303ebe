//! Draws the waveform of a pulse as a chart: amplitude over range and travel time, returns with the Gaussians fitted to
//! them. The chart is a list of marks that is rendered as a picture or as a page with an SVG drawing.

use super::font;
use super::label::{grouped, round_below, round_number};
use super::picture::{Frame, Picture, Rgb};
use crate::cloud::Wave;
use std::fmt::Write as _;
use vlscan_base::markup::escaped;
use vlscan_lidar::pulse::{RecordedEcho, recorded_echoes};

/// Speed of light, m/ns.
const LIGHT_SPEED: f64 = 0.299_792_458;
const PAPER: Rgb = [16, 20, 27];
const ECHOES: [Rgb; 5] = [[246, 174, 66], [118, 204, 120], [226, 100, 130], [178, 140, 230], [236, 220, 110]];

/// The role of a mark, which decides its colour: taken from the reader's colour scheme on a page, dark on a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Role {
    Ink,
    Faint,
    Grid,
    Curve,
    Area,
    Echo(usize),
}

impl Role {
    fn colour(self) -> Rgb {
        match self {
            Role::Ink => [226, 231, 236],
            Role::Faint => [142, 152, 164],
            Role::Grid => [38, 46, 57],
            Role::Curve => [106, 176, 243],
            Role::Area => [28, 44, 62],
            Role::Echo(n) => ECHOES[n % ECHOES.len()],
        }
    }

    fn class(self) -> String {
        match self {
            Role::Ink => "ink".to_owned(),
            Role::Faint => "faint".to_owned(),
            Role::Grid => "grid".to_owned(),
            Role::Curve => "curve".to_owned(),
            Role::Area => "area".to_owned(),
            Role::Echo(n) => format!("echo{}", n % ECHOES.len()),
        }
    }
}

/// A graphic element, in dots from the upper left corner.
enum Mark {
    Stroke {
        path: Vec<[f64; 2]>,
        width: f64,
        dashed: bool,
        role: Role,
    },
    /// The area between a path and a horizontal line.
    Below {
        path: Vec<[f64; 2]>,
        floor: f64,
        role: Role,
    },
    Dot {
        at: [f64; 2],
        radius: f64,
        role: Role,
        note: String,
    },
    /// Text whose upper left corner is `at`, or whose upper right corner it is if `at_end`.
    Text {
        at: [f64; 2],
        text: String,
        role: Role,
        at_end: bool,
    },
}

/// Chart of a recorded waveform with its echoes, to be drawn as a picture or as an HTML page.
pub struct Chart {
    width: f64,
    height: f64,
    /// Scale of the font: dots of the chart per dot of the font.
    text: f64,
    title: String,
    marks: Vec<Mark>,
}

/// The ranges of the values and their positions on the chart.
struct Axes {
    left: f64,
    right: f64,
    top: f64,
    bottom: f64,
    time: (f64, f64),
    amplitude: (f64, f64),
}

impl Axes {
    fn x(&self, time: f64) -> f64 {
        let share = (time - self.time.0) / (self.time.1 - self.time.0);
        self.left + share * (self.right - self.left)
    }

    fn y(&self, amplitude: f64) -> f64 {
        let share = (amplitude - self.amplitude.0) / (self.amplitude.1 - self.amplitude.0);
        self.bottom - share * (self.bottom - self.top)
    }
}

impl Chart {
    /// Draws a waveform. `name` is the name of its file and may be empty. The size is clamped to 320 to 16384 by 240 to
    /// 16384 dots.
    pub fn new(wave: &Wave, name: &str, width: u32, height: u32) -> Chart {
        let (width, height) = (f64::from(width.clamp(320, 16_384)), f64::from(height.clamp(240, 16_384)));
        let text = (width.min(height * 4.0 / 3.0) / 620.0).floor().max(1.0);
        let title = if name.is_empty() {
            format!("pulse {}", wave.pulse)
        } else {
            format!("pulse {} · {name}", wave.pulse)
        };
        let mut chart = Chart { width, height, text, title, marks: Vec::new() };
        let echoes = recorded_echoes(&wave.samples);
        let interval = wave.interval();
        let span = (wave.end - wave.start).max(interval).max(1e-3);
        let low = wave.samples.iter().copied().fold(0.0, f64::min);
        let high = wave.samples.iter().copied().fold(low, f64::max);
        let high = if high > low { low + 1.12 * (high - low) } else { low + 1.0 };
        let axes = Axes {
            left: 70.0 * text,
            right: width - 20.0 * text,
            top: 74.0 * text,
            bottom: height - (58.0 + 14.0 * echoes.len().min(8) as f64) * text,
            time: (wave.start - 0.03 * span, wave.start + 1.03 * span),
            amplitude: (low, high),
        };
        chart.head(wave, interval);
        chart.scales(&axes);
        chart.curve(&axes, wave, interval);
        chart.echoes(&axes, wave, &echoes, interval);
        chart
    }

    fn write(&mut self, x: f64, y: f64, text: String, role: Role) {
        self.marks.push(Mark::Text { at: [x, y], text, role, at_end: false });
    }

    fn line(&mut self, from: [f64; 2], to: [f64; 2], role: Role) {
        let width = self.text.max(1.0);
        self.marks.push(Mark::Stroke { path: vec![from, to], width, dashed: false, role });
    }

    fn head(&mut self, wave: &Wave, interval: f64) {
        let (t, title) = (self.text, self.title.clone());
        self.write(20.0 * t, 14.0 * t, title, Role::Ink);
        let vector = |v: vlscan_geom::DVec3, digits: usize| {
            format!("({:.digits$}, {:.digits$}, {:.digits$})", v.x, v.y, v.z)
        };
        let facts = format!(
            "from {} m towards {} · GPS time {:.6} s · {} samples of {} ns",
            vector(wave.origin, 2),
            vector(wave.direction, 4),
            wave.gps_time,
            grouped(wave.samples.len()),
            round_number(interval, 0.01)
        );
        self.write(20.0 * t, 28.0 * t, facts, Role::Faint);
        if wave.duplicates > 0 {
            let note = format!("the first of {} channels with a pulse of this number", wave.duplicates + 1);
            self.write(20.0 * t, 42.0 * t, note, Role::Faint);
        }
    }

    fn scales(&mut self, axes: &Axes) {
        let t = self.text;
        let available = axes.right - axes.left;
        let (low, high) = axes.amplitude;
        let mut heights = Vec::new();
        for value in ticks(low, high, 5.0) {
            let y = axes.y(value);
            heights.push(y);
            self.line([axes.left, y], [axes.right, y], Role::Grid);
            let text = round_number(value, round_below((high - low) / 5.0));
            self.marks.push(Mark::Text {
                at: [axes.left - 8.0 * t, y - 3.0 * t],
                text,
                role: Role::Faint,
                at_end: true,
            });
        }
        let count = (available / (90.0 * t)).clamp(2.0, 12.0);
        let range = (axes.time.0 * LIGHT_SPEED, axes.time.1 * LIGHT_SPEED);
        for value in ticks(range.0, range.1, count) {
            let x = axes.x(value / LIGHT_SPEED);
            self.line([x, axes.top], [x, axes.bottom + 4.0 * t], Role::Grid);
            let text = round_number(value, round_below((range.1 - range.0) / count));
            let half = 0.5 * f64::from(font::width(&text)) * t;
            self.write(x - half, axes.bottom + 10.0 * t, text, Role::Ink);
        }
        for value in ticks(axes.time.0, axes.time.1, count) {
            let x = axes.x(value);
            self.line([x, axes.top - 4.0 * t], [x, axes.top], Role::Faint);
            let text = round_number(value, round_below((axes.time.1 - axes.time.0) / count));
            let half = 0.5 * f64::from(font::width(&text)) * t;
            self.write(x - half, axes.top - 14.0 * t, text, Role::Faint);
        }
        self.line([axes.left, axes.bottom], [axes.right, axes.bottom], Role::Faint);
        self.write(20.0 * t, axes.top - 14.0 * t, "time, ns".to_owned(), Role::Faint);
        self.write(20.0 * t, axes.bottom + 10.0 * t, "range, m".to_owned(), Role::Ink);
        // Between the numbers, so as not to hide them.
        let between = match heights[..] {
            [.., second, first] => 0.5 * (first + second) - 3.0 * t,
            _ => axes.top + 2.0 * t,
        };
        self.write(20.0 * t, between, "amplitude".to_owned(), Role::Faint);
    }

    fn curve(&mut self, axes: &Axes, wave: &Wave, interval: f64) {
        let time = |i: usize| wave.start + interval * i as f64;
        let path: Vec<[f64; 2]> =
            wave.samples.iter().enumerate().map(|(i, s)| [axes.x(time(i)), axes.y(*s)]).collect();
        self.marks.push(Mark::Below { path: path.clone(), floor: axes.y(0.0), role: Role::Area });
        self.marks.push(Mark::Stroke {
            path: path.clone(),
            width: 1.6 * self.text,
            dashed: false,
            role: Role::Curve,
        });
        // Dots are drawn only if they can be distinguished.
        if path.len() >= 2 && path[1][0] - path[0][0] >= 4.0 * self.text {
            for (i, at) in path.into_iter().enumerate() {
                let note = format!("{:.3} m, {:.3} ns: {}", time(i) * LIGHT_SPEED, time(i), wave.samples[i]);
                self.marks.push(Mark::Dot { at, radius: 1.8 * self.text, role: Role::Curve, note });
            }
        }
    }

    fn echoes(&mut self, axes: &Axes, wave: &Wave, echoes: &[RecordedEcho], interval: f64) {
        let t = self.text;
        for (n, echo) in echoes.iter().enumerate() {
            let role = Role::Echo(n);
            let centre = wave.start + interval * echo.sample as f64;
            let (width, whole) = (echo.width * interval, (wave.end - wave.start).max(interval));
            let fits = width.is_finite()
                && width > 0.0
                && width < whole
                && echo.centre.is_finite()
                && echo.height.is_finite();
            let label = if fits { format!("{width:.2} ns") } else { "no Gaussian fits".to_owned() };
            if fits {
                let middle = wave.start + interval * echo.centre;
                let bell = |off: f64| echo.pedestal + echo.height * libm::exp(-(off / width) * (off / width));
                let at = |i: u32| {
                    let off = 2.5 * width * (f64::from(i) / 48.0 - 1.0);
                    let time = (middle + off).clamp(axes.time.0, axes.time.1);
                    [axes.x(time), axes.y(bell(time - middle).clamp(axes.amplitude.0, axes.amplitude.1))]
                };
                let path = (0..=96).map(at).collect();
                self.marks.push(Mark::Stroke { path, width: 1.2 * t, dashed: true, role });
                // Marks the fitted width, where the Gaussian has fallen to 1/e.
                let y = axes.y(bell(width).clamp(axes.amplitude.0, axes.amplitude.1));
                let [from, to] =
                    [middle, middle + width].map(|time| axes.x(time.clamp(axes.time.0, axes.time.1)));
                self.marks.push(Mark::Stroke {
                    path: vec![[from, y], [to, y]],
                    width: 2.0 * t,
                    dashed: false,
                    role,
                });
            }
            let top = [axes.x(centre), axes.y(echo.amplitude)];
            let note = format!("echo {}: {:.3} m, width {label}", n + 1, centre * LIGHT_SPEED);
            self.marks.push(Mark::Dot { at: top, radius: 4.0 * t, role, note });
            self.write(top[0] - 2.5 * t, top[1] - 14.0 * t, (n + 1).to_string(), role);
            if n < 8 {
                let line = format!(
                    "echo {}: range {:.3} m, {:.3} ns · amplitude {} · fitted width {label}",
                    n + 1,
                    centre * LIGHT_SPEED,
                    centre,
                    significant(echo.amplitude)
                );
                self.write(axes.left, axes.bottom + (34.0 + 14.0 * n as f64) * t, line, role);
            }
        }
        if echoes.is_empty() {
            self.write(axes.left, axes.bottom + 34.0 * t, "no echo".to_owned(), Role::Faint);
        }
    }

    /// The chart as a raster image, rendered with antialiasing.
    pub fn picture(&self) -> Picture {
        // Rendered at twice the size, then halved, which smooths slanted lines.
        let dots = |v: f64| (2.0 * v).round().max(0.0) as u32;
        let mut fine = Picture::new(dots(self.width), dots(self.height), PAPER);
        for mark in &self.marks {
            match mark {
                Mark::Stroke { path, width, dashed, role } => {
                    stroke(&mut fine, path, *width, *dashed, role.colour())
                }
                Mark::Below { path, floor, role } => below(&mut fine, path, *floor, role.colour()),
                Mark::Dot { at, radius, role, .. } => disc(&mut fine, *at, *radius, role.colour()),
                Mark::Text { at, text, role, at_end } => {
                    let wide = f64::from(font::width(text)) * self.text;
                    let x = at[0] - if *at_end { wide } else { 0.0 };
                    fine.text(dots(x), dots(at[1]), text, dots(self.text), role.colour());
                }
            }
        }
        fine.halved()
    }

    /// The chart as a self-contained HTML page with an inline SVG.
    pub fn page(&self) -> String {
        let mut page = format!(
            "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n<meta name=\"generator\" content=\"vlscan\">\n\
             <meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; style-src 'unsafe-inline'; img-src data:\">\n\
             <link rel=\"icon\" href=\"data:,\">\n<title>{0} · vlscan</title>\n<style>\n{STYLE}</style>\n</head>\n<body>\n\
             <svg viewBox=\"0 0 {1} {2}\" role=\"img\" aria-label=\"{0}\" font-size=\"{3}\">\n",
            escaped(&self.title),
            self.width,
            self.height,
            11.0 * self.text
        );
        for mark in &self.marks {
            self.svg(mark, &mut page);
        }
        page + "</svg>\n</body>\n</html>\n"
    }

    fn svg(&self, mark: &Mark, page: &mut String) {
        let list = |path: &[[f64; 2]]| {
            path.iter().map(|[x, y]| format!("{x:.1},{y:.1}")).collect::<Vec<_>>().join(" ")
        };
        // Writing to a string does not fail.
        let _ = match mark {
            Mark::Stroke { path, width, dashed, role } => writeln!(
                page,
                "<polyline class=\"{} stroke\" stroke-width=\"{width}\"{} points=\"{}\"/>",
                role.class(),
                if *dashed {
                    format!(" stroke-dasharray=\"{0} {0}\"", 4.0 * self.text)
                } else {
                    String::new()
                },
                list(path)
            ),
            Mark::Below { path, floor, role } => {
                let [from, to] = [path.first(), path.last()].map(|p| p.map_or(0.0, |p| p[0]));
                let points = list(path);
                writeln!(
                    page,
                    "<polygon class=\"{}\" points=\"{from:.1},{floor:.1} {points} {to:.1},{floor:.1}\"/>",
                    role.class()
                )
            }
            Mark::Dot { at, radius, role, note } => writeln!(
                page,
                "<circle class=\"{}\" cx=\"{:.1}\" cy=\"{:.1}\" r=\"{radius}\"><title>{}</title></circle>",
                role.class(),
                at[0],
                at[1],
                escaped(note)
            ),
            Mark::Text { at, text, role, at_end } => writeln!(
                page,
                "<text class=\"{}\" x=\"{:.1}\" y=\"{:.1}\"{}>{}</text>",
                role.class(),
                at[0],
                at[1] + 8.0 * self.text,
                if *at_end { " text-anchor=\"end\"" } else { "" },
                escaped(text)
            ),
        };
    }
}

const STYLE: &str = "\
:root { color-scheme: dark; --paper: #10141b; --ink: #e2e7ec; --faint: #8e98a4; --grid: #262e39; --curve: #6ab0f3; --area: #1c2c3e; --e0: #f6ae42; --e1: #76cc78; --e2: #e26482; --e3: #b28ce6; --e4: #ecdc6e; }
@media (prefers-color-scheme: light) { :root { color-scheme: light; --paper: #fff; --ink: #16202b; --faint: #52606d; --grid: #e3e7eb; --curve: #0b63b6; --area: #dceafa; --e0: #b06a00; --e1: #1f7a2e; --e2: #b3214b; --e3: #6b3fb0; --e4: #7d6a00; } }
html, body { margin: 0; height: 100%; background: var(--paper); font-family: system-ui, sans-serif; }
svg { display: block; width: 100%; height: 100%; font-variant-numeric: tabular-nums; }
.ink { fill: var(--ink); stroke: var(--ink); } .faint { fill: var(--faint); stroke: var(--faint); } .grid { stroke: var(--grid); }
.curve { fill: var(--curve); stroke: var(--curve); } .area { fill: var(--area); }
.echo0 { fill: var(--e0); stroke: var(--e0); } .echo1 { fill: var(--e1); stroke: var(--e1); } .echo2 { fill: var(--e2); stroke: var(--e2); }
.echo3 { fill: var(--e3); stroke: var(--e3); } .echo4 { fill: var(--e4); stroke: var(--e4); }
.stroke { fill: none; stroke-linejoin: round; } text, circle { stroke: none !important; }
";

/// Formats a number with four significant digits.
fn significant(value: f64) -> String {
    if value == 0.0 {
        return "0".to_owned();
    }
    let digits = 3 - libm::floor(libm::log10(value.abs())).clamp(-12.0, 12.0) as i32;
    format!("{value:.*}", digits.max(0) as usize)
}

/// About `count` round numbers from `low` to `high`.
fn ticks(low: f64, high: f64, count: f64) -> impl Iterator<Item = f64> {
    let step = round_below((high - low) / count);
    let first = (low / step).ceil();
    (0..64).map(move |i| (first + f64::from(i)) * step).take_while(move |v| *v <= high)
}

fn disc(fine: &mut Picture, at: [f64; 2], radius: f64, colour: Rgb) {
    let (x, y, r) = (2.0 * at[0], 2.0 * at[1], 2.0 * radius);
    let mut row = (y - r).floor().max(0.0);
    while row <= y + r {
        let half = (r * r - (row - y) * (row - y)).max(0.0).sqrt();
        let from = (x - half).round().max(0.0);
        let width = ((x + half).round() - from).max(0.0) as u32;
        fine.fill(Frame { x: from as u32, y: row as u32, width, height: 1 }, colour);
        row += 1.0;
    }
}

fn stroke(fine: &mut Picture, path: &[[f64; 2]], width: f64, dashed: bool, colour: Rgb) {
    let mut gone = 0.0;
    for pair in path.windows(2) {
        let [from, to] = [pair[0], pair[1]];
        let length = libm::hypot(to[0] - from[0], to[1] - from[1]).min(1e5);
        let steps = (3.0 * length).ceil().max(1.0);
        let mut i = 0.0;
        while i <= steps {
            let share = i / steps;
            let dash = ((gone + share * length) / (4.0 * width.max(1.0))) as u64;
            if !dashed || dash.is_multiple_of(2) {
                disc(
                    fine,
                    [from[0] + share * (to[0] - from[0]), from[1] + share * (to[1] - from[1])],
                    0.5 * width,
                    colour,
                );
            }
            i += 1.0;
        }
        gone += length;
    }
}

fn below(fine: &mut Picture, path: &[[f64; 2]], floor: f64, colour: Rgb) {
    for pair in path.windows(2) {
        let [from, to] = [pair[0], pair[1]];
        let mut x = (2.0 * from[0]).round().max(0.0);
        while x < 2.0 * to[0] {
            let share = ((x / 2.0 - from[0]) / (to[0] - from[0])).clamp(0.0, 1.0);
            let y = 2.0 * (from[1] + share * (to[1] - from[1]));
            let (upper, lower) = (y.min(2.0 * floor).max(0.0), y.max(2.0 * floor));
            let height = (lower - upper).max(0.0) as u32;
            fine.fill(Frame { x: x as u32, y: upper as u32, width: 1, height }, colour);
            x += 1.0;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use vlscan_geom::DVec3;

    fn wave(samples: Vec<f64>) -> Wave {
        let end = 955.0 + 0.25 * (samples.len().max(1) - 1) as f64;
        Wave {
            pulse: 12,
            origin: DVec3::new(1.0, 2.0, 300.0),
            direction: DVec3::NEG_Z,
            start: 955.0,
            end,
            gps_time: 86391.5,
            samples,
            duplicates: 1,
        }
    }

    #[test]
    fn echoes_are_drawn_and_told() {
        let bell = |i: i32, centre: i32, top: f64| top * libm::exp(-f64::from((i - centre).pow(2)) / 16.0);
        let chart = Chart::new(
            &wave((0..80).map(|i| bell(i, 20, 2.0) + bell(i, 55, 0.7)).collect()),
            "<w>.txt",
            1000,
            600,
        );
        let page = chart.page();
        for text in [
            "echo 1: range 287.801 m",
            "echo 2: range 290.424 m",
            "fitted width 1.00 ns",
            "&lt;w&gt;.txt",
            "2 channels",
        ] {
            assert!(page.contains(text), "{text} is not in {page}");
        }
        assert!(!page.contains("<w>") && page.matches("<svg").count() == 1);
        let picture = chart.picture();
        assert_eq!((picture.width(), picture.height()), (1000, 600));
        let dots =
            |colour: Rgb| (0..600 * 1000).filter(|i| picture.dot(i % 1000, i / 1000) == colour).count();
        for role in [Role::Ink, Role::Curve, Role::Area, Role::Echo(0), Role::Echo(1)] {
            assert!(dots(role.colour()) > 60, "{role:?}: {}", dots(role.colour()));
        }
    }

    #[test]
    fn odd_waveforms_are_drawn() {
        for samples in
            [vec![0.0; 5], vec![1.0], vec![1e300, -1e300, 1e300], vec![-3.0, -2.0, -3.0], vec![0.1; 5000]]
        {
            for (width, height) in [(0, 0), (1600, 400)] {
                let chart = Chart::new(&wave(samples.clone()), "", width, height);
                chart.picture();
                chart.page();
            }
        }
    }
}
