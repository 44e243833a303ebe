//! The comparison as a picture (SVG): times and speedups by threads and schedules, and chunk sizes during a run, like
//! the paper's figures 10 and 13 to 16, and speedups of simulated machines.

use super::report::Report;
use crate::cli::svg::{COLOURS, begin};
use std::fmt::Write as _;
use vlscan_base::markup::escaped;

const WIDTH: f64 = 680.0;
const HEIGHT: f64 = 380.0;
/// Space for axes and title within a chart, without the legend at its right: left, right, top, bottom, px.
const MARGINS: [f64; 4] = [70.0, 20.0, 44.0, 48.0];

/// Name and points of a line.
type Line = (String, Vec<(f64, f64)>);

struct Chart {
    title: String,
    x: &'static str,
    y: &'static str,
    /// Whether the axes are logarithmic.
    log: [bool; 2],
    lines: Vec<Line>,
    /// Category names on the x axis; the lines' points are then bars beside one another.
    bars: Option<Vec<String>>,
}

pub fn of(report: &Report) -> String {
    let charts: Vec<Chart> =
        charts(report).into_iter().filter(|c| c.lines.iter().any(|l| !l.1.is_empty())).collect();
    let rows = charts.len().div_ceil(2).max(1);
    let (width, height) = (2.0 * WIDTH, 40.0 + rows as f64 * HEIGHT);
    let mut svg = begin(width, height);
    let _ = writeln!(
        svg,
        "<text x=\"{}\" y=\"26\" font-size=\"17\" text-anchor=\"middle\">{}</text>",
        0.5 * width,
        escaped(&format!(
            "{}, {} primitives",
            report.survey,
            vlscan_base::quantity::amount(report.primitives as f64)
        ))
    );
    for (i, chart) in charts.iter().enumerate() {
        let _ = writeln!(
            svg,
            "<g transform=\"translate({} {})\">",
            (i % 2) as f64 * WIDTH,
            40.0 + (i / 2) as f64 * HEIGHT
        );
        chart.draw(&mut svg);
        svg.push_str("</g>\n");
    }
    svg.push_str("</svg>\n");
    svg
}

fn charts(report: &Report) -> Vec<Chart> {
    let by_tree = |y: &dyn Fn(&super::measure::Cell) -> f64| {
        let line = |tree: &'static str| {
            let points =
                report.best_by_threads(tree).into_iter().map(|c| (c.of.threads as f64, y(c))).collect();
            (tree.to_owned(), points)
        };
        report.trees().into_iter().map(line).collect::<Vec<_>>()
    };
    let chart =
        |title: &str, x, y, log, lines| Chart { title: title.to_owned(), x, y, log, lines, bars: None };
    let mut charts = vec![
        chart(
            "Build and simulation, best schedule",
            "threads",
            "seconds",
            [true, false],
            by_tree(&|c| c.total_s),
        ),
        chart(
            "Speedup of the simulation, best schedule",
            "threads",
            "speedup",
            [true, true],
            by_tree(&|c| c.speedup),
        ),
    ];
    charts.push(schedules(report));
    // At most as many lines as there are colours, those with the most threads.
    let most = report.cells.iter().map(|c| c.of.threads).max().unwrap_or(1);
    let sizes: Vec<Line> = report
        .cells
        .iter()
        .filter(|c| !c.sizes.is_empty() && c.of.threads == most)
        .take(COLOURS.len())
        .map(|c| {
            let points = c.sizes.iter().map(|s| (s.tasks as f64 / 1e3, f64::from(s.size))).collect();
            (format!("{} from {}{}", c.of.tree, c.of.chunk_size, barrier(c.of.leg_barrier)), points)
        })
        .collect();
    charts.push(chart(
        &format!("Size of dynamic chunks, {most} threads"),
        "thousand pulses",
        "pulses per chunk",
        [false, false],
        sizes,
    ));
    for tree in report.trees() {
        let mut lines: Vec<Line> = Vec::new();
        for f in report.forecasts.iter().filter(|f| f.of.tree == tree) {
            let size =
                if f.of.schedule == "single" { String::new() } else { format!(" {}", f.of.chunk_size) };
            let factor = f.of.warehouse_factor.map_or_else(String::new, |n| format!("×{n}"));
            let name = format!("{}{size}{factor}{}", f.of.schedule, barrier(f.of.leg_barrier));
            line(&mut lines, name).push((f.of.threads as f64, f.speedup));
        }
        lines.iter_mut().for_each(|l| l.1.sort_by(|a, b| a.0.total_cmp(&b.0)));
        charts.push(chart(&format!("Simulated speedup, {tree}"), "threads", "speedup", [true, true], lines));
    }
    charts
}

/// Returns the points of the line `name`, which is added if it does not exist.
fn line(lines: &mut Vec<Line>, name: String) -> &mut Vec<(f64, f64)> {
    let at = lines.iter().position(|line| line.0 == name).unwrap_or_else(|| {
        lines.push((name, Vec::new()));
        lines.len() - 1
    });
    &mut lines[at].1
}

fn barrier(is_kept: bool) -> &'static str {
    if is_kept { " + barrier" } else { "" }
}

/// Bars of the best simulation of every schedule with the maximum number of threads, by tree.
fn schedules(report: &Report) -> Chart {
    let most = report.cells.iter().map(|c| c.of.threads).max().unwrap_or(1);
    let trees = report.trees();
    let mut lines: Vec<Line> = Vec::new();
    for cell in report.cells.iter().filter(|c| c.of.threads == most || c.of.threads == 1) {
        let place = trees.iter().position(|t| *t == cell.of.tree).unwrap_or(0) as f64;
        let points = line(&mut lines, cell.of.schedule_text());
        match points.iter_mut().find(|p| p.0 == place) {
            Some(point) => point.1 = point.1.min(cell.simulation_s),
            None => points.push((place, cell.simulation_s)),
        }
    }
    Chart {
        title: format!("Simulation with {most} threads, best chunks"),
        x: "",
        y: "seconds",
        log: [false, false],
        lines,
        bars: Some(trees.into_iter().map(str::to_owned).collect()),
    }
}

impl Chart {
    fn draw(&self, svg: &mut String) {
        let [left, right, top, bottom] = MARGINS;
        let (w, h) = (WIDTH - left - right - self.legend_width(), HEIGHT - top - bottom);
        let points = || {
            self.lines.iter().flat_map(|l| l.1.iter().copied()).filter(|p| p.0.is_finite() && p.1.is_finite())
        };
        let x = match &self.bars {
            Some(places) => Axis { lo: -0.5, hi: places.len() as f64 - 0.5, log: false },
            None => Axis::around(points().map(|p| p.0), self.log[0], false),
        };
        let y = Axis::around(points().map(|p| p.1), self.log[1], true);
        let at = |p: (f64, f64)| (left + w * x.place(p.0), top + h * (1.0 - y.place(p.1)));
        let _ = writeln!(
            svg,
            "<text x=\"{}\" y=\"26\" font-size=\"14\" text-anchor=\"middle\">{}</text>",
            left + 0.5 * w,
            escaped(&self.title)
        );
        for tick in y.ticks() {
            let (_, py) = at((x.lo, tick));
            let _ = writeln!(
                svg,
                "<line x1=\"{left}\" x2=\"{}\" y1=\"{py:.1}\" y2=\"{py:.1}\" stroke=\"#dddddd\"/>\
                 <text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\">{}</text>",
                left + w,
                left - 6.0,
                py + 4.0,
                short(tick)
            );
        }
        let names: Vec<(f64, String)> = match &self.bars {
            Some(places) => places.iter().enumerate().map(|(i, name)| (i as f64, name.clone())).collect(),
            None if self.log[0] => {
                let mut xs: Vec<f64> = points().map(|p| p.0).collect();
                xs.sort_by(f64::total_cmp);
                xs.dedup();
                xs.into_iter().map(|t| (t, short(t))).collect()
            }
            None => x.ticks().into_iter().map(|t| (t, short(t))).collect(),
        };
        for (tick, name) in names {
            let (px, _) = at((tick, y.lo));
            let _ = writeln!(
                svg,
                "<text x=\"{px:.1}\" y=\"{}\" text-anchor=\"middle\">{}</text>",
                top + h + 18.0,
                escaped(&name)
            );
        }
        let _ = writeln!(
            svg,
            "<rect x=\"{left}\" y=\"{top}\" width=\"{w}\" height=\"{h}\" fill=\"none\" stroke=\"#888888\"/>\
             <text x=\"{}\" y=\"{}\" text-anchor=\"middle\">{}</text>\
             <text transform=\"translate(18 {}) rotate(-90)\" text-anchor=\"middle\">{}</text>",
            left + 0.5 * w,
            top + h + 38.0,
            self.x,
            top + 0.5 * h,
            self.y
        );
        for (i, (_, points)) in self.lines.iter().enumerate() {
            let colour = COLOURS[i % COLOURS.len()];
            let points: Vec<_> = points.iter().filter(|p| p.0.is_finite() && p.1.is_finite()).collect();
            if self.bars.is_some() {
                let width = 0.8 / self.lines.len() as f64;
                for p in points {
                    let (x0, y1) = at((p.0 - 0.4 + i as f64 * width, p.1));
                    let (x1, _) = at((p.0 - 0.4 + (i + 1) as f64 * width, p.1));
                    let _ = writeln!(
                        svg,
                        "<rect x=\"{x0:.1}\" y=\"{y1:.1}\" width=\"{:.1}\" height=\"{:.1}\" fill=\"{colour}\"/>",
                        (x1 - x0 - 1.0).max(1.0),
                        top + h - y1
                    );
                }
                continue;
            }
            let path: Vec<String> =
                points.iter().map(|p| at(**p)).map(|(x, y)| format!("{x:.1},{y:.1}")).collect();
            let _ = writeln!(
                svg,
                "<polyline points=\"{}\" fill=\"none\" {} stroke-width=\"2\"/>",
                path.join(" "),
                self.stroke(i)
            );
            for (px, py) in points.iter().take(if points.len() > 40 { 0 } else { 40 }).map(|p| at(**p)) {
                let _ = writeln!(svg, "<circle cx=\"{px:.1}\" cy=\"{py:.1}\" r=\"3\" fill=\"{colour}\"/>");
            }
        }
        self.legend(svg);
    }

    fn legend_width(&self) -> f64 {
        let longest = self.lines.iter().map(|l| l.0.chars().count()).max().unwrap_or(0);
        36.0 + 6.8 * longest as f64
    }

    fn legend(&self, svg: &mut String) {
        let [_, right, top, _] = MARGINS;
        let left = WIDTH - right - self.legend_width() + 10.0;
        for (i, (name, _)) in self.lines.iter().enumerate() {
            let y = top + 13.0 + 16.0 * i as f64;
            let middle = y - 4.0;
            let _ = writeln!(
                svg,
                "<line x1=\"{left}\" x2=\"{}\" y1=\"{middle}\" y2=\"{middle}\" {} stroke-width=\"4\"/>\
                 <text x=\"{}\" y=\"{y}\">{}</text>",
                left + 18.0,
                self.stroke(i),
                left + 24.0,
                escaped(name)
            );
        }
    }

    /// Returns the stroke of a line: every other line is dashed, so that a covered line stays visible.
    fn stroke(&self, line: usize) -> String {
        let dashes = if self.bars.is_none() && line % 2 == 1 { " stroke-dasharray=\"7 4\"" } else { "" };
        format!("stroke=\"{}\"{dashes}", COLOURS[line % COLOURS.len()])
    }
}

struct Axis {
    lo: f64,
    hi: f64,
    log: bool,
}

impl Axis {
    fn around(values: impl Iterator<Item = f64>, log: bool, from_zero: bool) -> Axis {
        let (mut lo, mut hi) = values
            .filter(|v| v.is_finite() && (!log || *v > 0.0))
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), v| (lo.min(v), hi.max(v)));
        if lo > hi {
            (lo, hi) = (1.0, 2.0);
        }
        match (log, from_zero) {
            (true, false) => (lo, hi) = (lo / 1.15, hi * 1.15),
            (true, true) => (lo, hi) = (lo / 1.2, hi * 1.2),
            (false, true) => (lo, hi) = (0.0, hi * 1.05),
            (false, false) => {}
        }
        if hi <= lo {
            hi = lo + 1.0;
        }
        Axis { lo, hi, log }
    }

    /// Position of a value on the axis, 0 at the lower end and 1 at the upper end.
    fn place(&self, value: f64) -> f64 {
        let scale = |v: f64| if self.log { libm::log(v.max(1e-300)) } else { v };
        (scale(value) - scale(self.lo)) / (scale(self.hi) - scale(self.lo))
    }

    /// Returns round values on the axis.
    fn ticks(&self) -> Vec<f64> {
        if self.log {
            let first = libm::floor(libm::log2(self.lo)) as i32;
            let last = libm::floor(libm::log2(self.hi)) as i32;
            let every = ((last - first) / 8).max(1);
            let ticks: Vec<f64> = (first..=last)
                .step_by(every as usize)
                .map(|e| libm::ldexp(1.0, e))
                .filter(|t| *t >= self.lo)
                .collect();
            // Within two doublings there are too few ticks.
            if ticks.len() > 2 {
                return ticks;
            }
        }
        let raw = (self.hi - self.lo) / 5.0;
        let power = libm::pow(10.0, libm::floor(libm::log10(raw)));
        let step = [1.0, 2.0, 5.0, 10.0].into_iter().map(|f| f * power).find(|s| *s >= raw).unwrap_or(raw);
        let first = libm::ceil(self.lo / step) as i64;
        (first..).map(|i| i as f64 * step).take_while(|t| *t <= self.hi).take(12).collect()
    }
}

fn short(value: f64) -> String {
    if value.abs() >= 100.0 || value == value.round() {
        format!("{value:.0}")
    } else {
        format!("{value:.4}").trim_end_matches('0').to_owned()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_hold_all_values_and_have_round_ticks() {
        for (values, log) in
            [(vec![0.13, 7.9], false), (vec![1.0, 512.0], true), (vec![3.0], true), (vec![], false)]
        {
            let axis = Axis::around(values.iter().copied(), log, true);
            assert!(values.iter().all(|v| (0.0..=1.0).contains(&axis.place(*v))), "{values:?}");
            let ticks = axis.ticks();
            assert!((1..=12).contains(&ticks.len()), "{values:?}: {ticks:?}");
        }
        assert_eq!(short(0.25), "0.25");
        assert_eq!(short(512.0), "512");
        assert_eq!(escaped("a<b & c"), "a&lt;b &amp; c");
    }
}
