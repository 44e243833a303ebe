//! The comparison as a picture (SVG): times and speedups by threads and schedules, and chunk sizes during a
//! run, like the paper's figures 10 and 13 to 16, and speedups of simulated machines.

use crate::measure::Cell;
use crate::report::Report;
use vlscan_base::quantity::amount;
use vlscan_tools::chart::{Anchor, Axis, Drawing, Mark, Plot, Role, Theme};

/// Width and height of a chart, px; below the title of all.
const WIDTH: f64 = 680.0;
const HEIGHT: f64 = 380.0;
const TITLE: f64 = 40.0;

/// Name and points of a line.
type Line = (String, Vec<(f64, f64)>);

struct Chart {
    title: String,
    x: &'static str,
    y: &'static str,
    /// True for logarithmic axes.
    log: [bool; 2],
    lines: Vec<Line>,
    /// Category names on the x axis; the lines' points are then bars beside one another.
    bars: Option<Vec<String>>,
}

/// Draws the report.
pub fn of(report: &Report) -> String {
    let charts: Vec<Chart> =
        charts(report).into_iter().filter(|c| c.lines.iter().any(|l| !l.1.is_empty())).collect();
    let rows = charts.len().div_ceil(2).max(1);
    let mut drawing = Drawing::new(2.0 * WIDTH, TITLE + rows as f64 * HEIGHT, 1.1);
    let title = format!("{}, {} primitives", report.survey, amount(report.primitives as f64));
    drawing.write([WIDTH, 14.0], title, Role::Ink, Anchor::Middle);
    for (i, chart) in charts.iter().enumerate() {
        chart.draw(&mut drawing, [(i % 2) as f64 * WIDTH, TITLE + (i / 2) as f64 * HEIGHT]);
    }
    drawing.file(Theme::Light)
}

fn charts(report: &Report) -> Vec<Chart> {
    let by_tree = |y: &dyn Fn(&Cell) -> f64| {
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
        .take(Role::SERIES)
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
    /// Draws the chart with its upper left corner at `[left, top]`.
    fn draw(&self, drawing: &mut Drawing, [left, top]: [f64; 2]) {
        let finite = |p: &&(f64, f64)| p.0.is_finite() && p.1.is_finite();
        let points = || self.lines.iter().flat_map(|line| &line.1).filter(finite);
        let x = match &self.bars {
            Some(places) => Axis::new(-0.5, places.len() as f64 - 0.5),
            None => Axis::around(points().map(|p| p.0), self.log[0]),
        };
        let longest = self.lines.iter().map(|l| l.0.chars().count()).max().unwrap_or(0);
        let legend = left + WIDTH - 46.0 - 6.8 * longest as f64;
        let plot = Plot {
            left: left + 70.0,
            right: legend - 10.0,
            top: top + 44.0,
            bottom: top + HEIGHT - 48.0,
            x,
            y: Axis::around(points().map(|p| p.1), self.log[1]),
        };
        let middle = 0.5 * (plot.left + plot.right);
        drawing.write([middle, top + 16.0], &*self.title, Role::Ink, Anchor::Middle);
        drawing.write([plot.left - 8.0, top + 26.0], self.y, Role::Faint, Anchor::End);
        drawing.write([middle, plot.bottom + 28.0], self.x, Role::Ink, Anchor::Middle);
        let names = match &self.bars {
            Some(places) => places.iter().enumerate().map(|(i, name)| (i as f64, name.clone())).collect(),
            None => x.ticks(5.0),
        };
        plot.grid(drawing, names, plot.y.ticks(5.0));
        for (n, (name, points)) in self.lines.iter().enumerate() {
            let role = Role::Series(n);
            // Every other line is dashed, so that a covered line stays visible.
            let dashed = self.bars.is_none() && n % 2 == 1;
            let y = plot.top + 13.0 + 16.0 * n as f64;
            let path = vec![[legend, y], [legend + 18.0, y]];
            drawing.add(Mark::Stroke { path, width: 4.0, dashed, role });
            drawing.write([legend + 24.0, y - 4.0], &**name, Role::Ink, Anchor::Start);
            let points: Vec<_> = points.iter().filter(finite).copied().collect();
            if self.bars.is_some() {
                let width = 0.8 / self.lines.len() as f64;
                for (place, value) in points {
                    let from = place - 0.4 + n as f64 * width;
                    let path = [from, from + 0.95 * width].map(|x| plot.at(x, value)).to_vec();
                    drawing.add(Mark::Below { path, floor: plot.bottom, opacity: 1.0, role });
                }
                continue;
            }
            let path: Vec<[f64; 2]> = points.iter().map(|p| plot.at(p.0, p.1)).collect();
            if path.len() <= 40 {
                for (at, (x, y)) in path.iter().zip(&points) {
                    drawing.add(Mark::Dot {
                        at: *at,
                        radius: 3.0,
                        role,
                        note: format!("{name}: {x}, {y:.4}"),
                    });
                }
            }
            drawing.add(Mark::Stroke { path, width: 2.0, dashed, role });
        }
    }
}
