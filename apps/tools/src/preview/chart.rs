//! Draws the waveform of a pulse as a chart: amplitude over range and travel time, returns with the Gaussians
//! fitted to them. The chart becomes a picture or a page.

use crate::chart::label::{grouped, round_number};
use crate::chart::{Anchor, Axis, Drawing, Mark, Picture, Plot, Role, Theme, style};
use crate::cloud::Wave;
use vlscan_base::markup::escaped;
use vlscan_base::quantity::fixed;
use vlscan_lidar::pulse::{RecordedEcho, recorded_echoes};

/// Speed of light, m/ns.
const LIGHT_SPEED: f64 = 0.299_792_458;
/// Echoes that are described below the chart, at most.
const MAX_DESCRIBED: usize = 8;
const CURVE: Role = Role::Series(0);

fn echo_role(n: usize) -> Role {
    Role::Series(1 + n % 5)
}

/// Chart of a recorded waveform with its echoes, to be drawn as a picture or as an HTML page.
pub struct Chart {
    title: String,
    drawing: Drawing,
}

/// The field of the chart, whose x axis is the range, m.
struct Field {
    plot: Plot,
    /// One-way travel times at its sides, ns.
    time: (f64, f64),
}

impl Field {
    /// The place of an amplitude at a travel time; both are kept within the field if they are `clamped`.
    fn at(&self, time: f64, amplitude: f64) -> [f64; 2] {
        self.plot.at(time * LIGHT_SPEED, amplitude)
    }

    fn clamped(&self, time: f64, amplitude: f64) -> [f64; 2] {
        let y = &self.plot.y;
        self.at(time.clamp(self.time.0, self.time.1), amplitude.clamp(y.low, y.high))
    }
}

impl Chart {
    /// Draws a waveform. `name` is the name of its file and may be empty. The size is clamped to 320 to 16384
    /// by 240 to 16384 dots.
    pub fn new(wave: &Wave, name: &str, width: u32, height: u32) -> Chart {
        let (width, height) = (f64::from(width.clamp(320, 16_384)), f64::from(height.clamp(240, 16_384)));
        let t = (width.min(height * 4.0 / 3.0) / 700.0).max(1.0);
        let aside = if name.is_empty() { String::new() } else { format!(" · {name}") };
        let title = format!("pulse {}{aside}", wave.pulse);
        let mut chart = Chart { title, drawing: Drawing::new(width, height, t) };
        let echoes = recorded_echoes(&wave.samples);
        let interval = wave.interval();
        let span = (wave.end - wave.start).max(interval).max(1e-3);
        let time = (wave.start - 0.03 * span, wave.start + 1.03 * span);
        let low = wave.samples.iter().copied().fold(0.0, f64::min);
        let high = wave.samples.iter().copied().fold(low, f64::max);
        let plot = Plot {
            left: 70.0 * t,
            right: width - 20.0 * t,
            top: 74.0 * t,
            bottom: height - (58.0 + 14.0 * echoes.len().min(MAX_DESCRIBED) as f64) * t,
            x: Axis::new(time.0 * LIGHT_SPEED, time.1 * LIGHT_SPEED),
            y: Axis::new(low, low + 1.12 * (high - low)),
        };
        let field = Field { plot, time };
        chart.head(wave, interval);
        chart.scales(&field);
        chart.curve(&field, wave, interval);
        chart.echoes(&field, wave, &echoes, interval);
        chart
    }

    fn write(&mut self, x: f64, y: f64, text: impl Into<String>, role: Role) {
        self.drawing.write([x, y], text, role, Anchor::Start);
    }

    fn head(&mut self, wave: &Wave, interval: f64) {
        let (t, title) = (self.drawing.text, self.title.clone());
        self.write(20.0 * t, 14.0 * t, title, Role::Ink);
        let vector = |v: vlscan_geom::DVec3, digits: usize| {
            format!("({}, {}, {})", fixed(v.x, digits), fixed(v.y, digits), fixed(v.z, digits))
        };
        let beam = format!("from {} m towards {}", vector(wave.origin, 2), vector(wave.direction, 4));
        self.write(20.0 * t, 28.0 * t, beam, Role::Faint);
        let mut facts = format!(
            "GPS time {:.6} s · {} samples of {} ns",
            wave.gps_time,
            grouped(wave.samples.len()),
            round_number(interval, 0.01)
        );
        if wave.duplicates > 0 {
            facts += &format!(" · the first of {} channels with a pulse of this number", wave.duplicates + 1);
        }
        self.write(20.0 * t, 42.0 * t, facts, Role::Faint);
    }

    fn scales(&mut self, Field { plot, time }: &Field) {
        let t = self.drawing.text;
        let amplitudes = plot.y.ticks(5.0);
        // Between the numbers, so as not to hide them.
        let between = match amplitudes[..] {
            [.., (second, _), (first, _)] => plot.at(0.0, 0.5 * (first + second))[1] - 3.0 * t,
            _ => plot.top + 2.0 * t,
        };
        let count = ((plot.right - plot.left) / (90.0 * t)).clamp(2.0, 12.0);
        plot.grid(&mut self.drawing, plot.x.ticks(count), amplitudes);
        for (value, name) in Axis::new(time.0, time.1).ticks(count) {
            let [x, _] = plot.at(value * LIGHT_SPEED, 0.0);
            self.drawing.line([x, plot.top - 4.0 * t], [x, plot.top], Role::Faint);
            self.drawing.write([x, plot.top - 14.0 * t], name, Role::Faint, Anchor::Middle);
        }
        self.write(20.0 * t, plot.top - 14.0 * t, "time, ns", Role::Faint);
        self.write(20.0 * t, plot.bottom + 10.0 * t, "range, m", Role::Ink);
        self.write(20.0 * t, between, "amplitude", Role::Faint);
    }

    fn curve(&mut self, field: &Field, wave: &Wave, interval: f64) {
        let t = self.drawing.text;
        let time = |i: usize| wave.start + interval * i as f64;
        let path: Vec<[f64; 2]> =
            wave.samples.iter().enumerate().map(|(i, s)| field.at(time(i), *s)).collect();
        let floor = field.at(0.0, 0.0)[1];
        self.drawing.add(Mark::Below { path: path.clone(), floor, opacity: 1.0, role: Role::Area });
        self.drawing.add(Mark::Stroke { path: path.clone(), width: 1.6 * t, dashed: false, role: CURVE });
        // Dots are drawn only if they can be distinguished.
        if path.len() >= 2 && path[1][0] - path[0][0] >= 4.0 * t {
            for (i, at) in path.into_iter().enumerate() {
                let note = format!("{:.3} m, {:.3} ns: {}", time(i) * LIGHT_SPEED, time(i), wave.samples[i]);
                self.drawing.add(Mark::Dot { at, radius: 1.8 * t, role: CURVE, note });
            }
        }
    }

    fn echoes(&mut self, field: &Field, wave: &Wave, echoes: &[RecordedEcho], interval: f64) {
        let t = self.drawing.text;
        let below = field.plot.bottom + 34.0 * t;
        for (n, echo) in echoes.iter().enumerate() {
            let role = echo_role(n);
            let centre = wave.start + interval * echo.sample as f64;
            let (width, whole) = (echo.width * interval, (wave.end - wave.start).max(interval));
            let fits = width.is_finite()
                && width > 0.0
                && width < whole
                && echo.centre.is_finite()
                && echo.height.is_finite();
            let label = match fits {
                true => {
                    let full = half_maximum(width);
                    format!(
                        "fit: {width:.2} ns half width at 1/e, {:.2} ns at half maximum",
                        full[1] - full[0]
                    )
                }
                false => "no Gaussian fits".to_owned(),
            };
            if fits {
                self.gaussian(field, echo, (wave.start + interval * echo.centre, width), role);
            }
            let at = field.at(centre, echo.amplitude);
            let range = centre * LIGHT_SPEED;
            let note = format!("echo {}: {range:.3} m, {label}", n + 1);
            self.drawing.add(Mark::Dot { at, radius: 4.0 * t, role, note });
            self.write(at[0] - 2.5 * t, at[1] - 14.0 * t, (n + 1).to_string(), role);
            if n < MAX_DESCRIBED {
                let line = format!(
                    "echo {}: range {range:.3} m, {centre:.3} ns · amplitude {} · {label}",
                    n + 1,
                    significant(echo.amplitude)
                );
                self.write(20.0 * t, below + 14.0 * n as f64 * t, line, role);
            }
        }
        if echoes.is_empty() {
            self.write(20.0 * t, below, "no echo", Role::Faint);
        }
    }

    /// Draws the Gaussian fitted to an echo, and its full width at half maximum. `middle` and `width`, the
    /// half width at 1/e, are times, ns.
    fn gaussian(&mut self, field: &Field, echo: &RecordedEcho, (middle, width): (f64, f64), role: Role) {
        let t = self.drawing.text;
        let bell = |off: f64| echo.pedestal + echo.height * libm::exp(-(off / width) * (off / width));
        let at = |i: u32| {
            let off = 2.5 * width * (f64::from(i) / 48.0 - 1.0);
            let time = (middle + off).clamp(field.time.0, field.time.1);
            field.clamped(time, bell(time - middle))
        };
        let path = (0..=96).map(at).collect();
        self.drawing.add(Mark::Stroke { path, width: 1.2 * t, dashed: true, role });
        let [from, to] = half_maximum(width).map(|off| field.clamped(middle + off, bell(off)));
        // A bar with ends across it.
        let across = |[x, y]: [f64; 2], by: f64| [x, y + by * t];
        let path = vec![across(from, -3.0), across(from, 3.0), from, to, across(to, -3.0), across(to, 3.0)];
        self.drawing.add(Mark::Stroke { path, width: 2.0 * t, dashed: false, role });
    }

    /// The chart as a raster image, rendered with antialiasing.
    pub fn picture(&self) -> Picture {
        self.drawing.picture()
    }

    /// The chart as a self-contained HTML page with an inline SVG.
    pub fn page(&self) -> String {
        format!(
            "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
             <meta name=\"generator\" content=\"vlscan\">\n\
             <meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; style-src \
             'unsafe-inline'; img-src data:\">\n\
             <link rel=\"icon\" href=\"data:,\">\n<title>{} · vlscan</title>\n<style>\n{}{STYLE}</style>\n\
             </head>\n<body>\n\
             {}</body>\n</html>\n",
            escaped(&self.title),
            style(Theme::Reader),
            self.drawing.svg(&self.title)
        )
    }
}

const STYLE: &str = "\
:root { color-scheme: dark light; }
html, body { margin: 0; height: 100%; background: #10141b; font-family: system-ui, sans-serif; }
@media (prefers-color-scheme: light) { html, body { background: #fff; } }
svg { display: block; width: 100%; height: 100%; font-variant-numeric: tabular-nums; }
";

/// Positions, from its centre, at which a Gaussian of a half width at 1/e has half its height.
fn half_maximum(width: f64) -> [f64; 2] {
    /// √(ln 2).
    const HALF: f64 = 0.832_554_611_157_697_8;
    [-HALF * width, HALF * width]
}

/// Formats a number with four significant digits.
fn significant(value: f64) -> String {
    if value == 0.0 {
        return "0".to_owned();
    }
    let digits = 3 - libm::floor(libm::log10(value.abs())).clamp(-12.0, 12.0) as i32;
    format!("{value:.*}", digits.max(0) as usize)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::chart::{Rgb, font};
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
            "fit: 1.00 ns half width at 1/e, 1.6",
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
        for role in [Role::Ink, CURVE, Role::Area, echo_role(0), echo_role(1)] {
            assert!(dots(role.colour()) > 60, "{role:?}: {}", dots(role.colour()));
        }
    }

    #[test]
    fn the_width_is_drawn_across_the_gaussian_at_half_its_height() {
        let [from, to] = half_maximum(4.0);
        for off in [from, to] {
            assert!((libm::exp(-(off / 4.0) * (off / 4.0)) - 0.5).abs() < 1e-12, "{off}");
        }
        let bell = |i: i32| 2.0 * libm::exp(-f64::from((i - 40).pow(2)) / 16.0);
        let wave = wave((0..80).map(bell).collect());
        let chart = Chart::new(&wave, "", 1000, 600);
        let bar = chart.drawing.marks.iter().find_map(|mark| match mark {
            Mark::Stroke { path, dashed: false, role, .. } if *role == echo_role(0) => Some(path),
            _ => None,
        });
        let [.., from, to, _, _] = bar.unwrap()[..] else { panic!("{bar:?}") };
        // The curve of the samples crosses both ends of the bar.
        let curve = chart.drawing.marks.iter().find_map(|mark| match mark {
            Mark::Stroke { path, role: CURVE, .. } => Some(path),
            _ => None,
        });
        for end in [from, to] {
            let crosses = |pair: &[[f64; 2]]| {
                let share = (end[0] - pair[0][0]) / (pair[1][0] - pair[0][0]);
                let height = pair[0][1] + share * (pair[1][1] - pair[0][1]);
                (0.0..=1.0).contains(&share) && (height - end[1]).abs() < 4.0
            };
            assert!(curve.unwrap().windows(2).any(crosses), "{end:?}");
        }
        assert!(from[1] == to[1] && to[0] > from[0], "{from:?} {to:?}");
    }

    #[test]
    fn texts_are_within_a_picture_of_usual_shape() {
        let bell = |i: i32| 2.0 * libm::exp(-f64::from((i - 40).pow(2)) / 16.0);
        let origin = DVec3::new(455_610.12, 5_428_000.12, 1234.56);
        let wave =
            Wave { origin, direction: DVec3::new(-0.1, -0.2, -0.9), ..wave((0..80).map(bell).collect()) };
        let chart = Chart::new(&wave, "", 1000, 750);
        let texts = chart.drawing.marks.iter().filter_map(|mark| match mark {
            Mark::Text { at, text, anchor: Anchor::Start, .. } => Some((at[0], text)),
            _ => None,
        });
        for (left, text) in texts {
            assert!(left + font::width(text) * chart.drawing.text <= 1000.0, "{text}");
        }
    }

    #[test]
    fn the_size_of_text_follows_that_of_the_picture() {
        let sizes = [[700, 600], [1400, 1200], [2800, 2400]].map(|[width, height]| {
            let chart = Chart::new(&wave(vec![0.0, 1.0, 0.0]), "", width, height);
            chart.drawing.text
        });
        assert_eq!(sizes, [1.0, 2.0, 4.0]);
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
