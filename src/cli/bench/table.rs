//! Tables for people.

use super::report::Report;
use crate::quantity::amount;
use std::fmt::Write as _;

/// Rows of text in columns: the first column to the left, all others to the right.
pub struct Table {
    rows: Vec<Vec<String>>,
}

impl Table {
    /// Only its head.
    pub fn new(head: &[&str]) -> Table {
        Table { rows: vec![head.iter().map(|h| (*h).to_owned()).collect()] }
    }

    /// Adds a row.
    pub fn row(&mut self, row: Vec<String>) {
        self.rows.push(row);
    }

    /// Aligned, two spaces apart.
    pub fn text(&self) -> String {
        let columns = self.rows.iter().map(Vec::len).max().unwrap_or(0);
        let width = |c: usize| {
            self.rows.iter().filter_map(|r| r.get(c)).map(|t| t.chars().count()).max().unwrap_or(0)
        };
        let widths: Vec<usize> = (0..columns).map(width).collect();
        let mut text = String::new();
        for row in &self.rows {
            let mut line = String::new();
            for (c, (cell, width)) in row.iter().zip(&widths).enumerate() {
                let gap = if c > 0 { "  " } else { "" };
                let fill = " ".repeat(width - cell.chars().count());
                let _ = if c == 0 {
                    write!(line, "{gap}{cell}{fill}")
                } else {
                    write!(line, "{gap}{fill}{cell}")
                };
            }
            text.push_str(line.trim_end());
            text.push('\n');
        }
        text
    }
}

/// Everything measured and simulated.
pub fn of(report: &Report) -> String {
    let mut text = format!(
        "{}: {} primitives, {} legs, {} pulses, {} echoes; loaded in {:.2} s; points as {}\n\n",
        report.survey,
        amount(report.primitives as f64),
        report.legs,
        amount(report.cells.first().map_or(0.0, |c| c.pulses as f64)),
        amount(report.cells.first().map_or(0.0, |c| c.echoes as f64)),
        report.load_s,
        report.format,
    );
    text.push_str(&measured(report));
    if !report.forecasts.is_empty() {
        text.push_str("\nSimulated from measured task times:\n");
        text.push_str(&simulated(report));
    }
    text
}

fn factor(factor: Option<usize>) -> String {
    factor.map_or_else(String::new, |f| f.to_string())
}

fn schedule(name: &str, leg_barrier: bool) -> String {
    if leg_barrier { format!("{name} + barrier") } else { name.to_owned() }
}

fn measured(report: &Report) -> String {
    let mut table = Table::new(&[
        "tree",
        "schedule",
        "chunk",
        "factor",
        "threads",
        "build s",
        "simulation s",
        "total s",
        "speedup",
        "efficiency",
        "global",
        "reduction",
        "idle",
        "depth",
        "pulses/s",
        "rays/s",
        "echoes/s",
        "tree MB",
    ]);
    for c in &report.cells {
        table.row(vec![
            c.tree.to_owned(),
            schedule(c.schedule, c.leg_barrier),
            c.chunk_size.to_string(),
            factor(c.warehouse_factor),
            c.threads.to_string(),
            format!("{:.3}", c.build_s),
            format!("{:.3}", c.simulation_s),
            format!("{:.3}", c.total_s),
            format!("{:.2}", c.speedup),
            format!("{:.2}", c.efficiency),
            format!("{:.2}", c.global_speedup),
            format!("{:.1} %", 100.0 * c.time_reduction),
            format!("{:.0} %", 100.0 * c.idle),
            format!("{:.1}", c.queue_depth),
            amount(c.pulses_per_s),
            amount(c.rays_per_s),
            amount(c.echoes_per_s),
            format!("{:.1}", c.tree_bytes as f64 / 1e6),
        ]);
    }
    let peak = report.cells.iter().map(|c| c.peak_bytes).max().unwrap_or(0);
    format!(
        "{}scene {:.1} MB, most memory held {:.1} MB\n",
        table.text(),
        report.scene_bytes as f64 / 1e6,
        peak as f64 / 1e6
    )
}

fn simulated(report: &Report) -> String {
    let mut table = Table::new(&[
        "tree",
        "schedule",
        "chunk",
        "factor",
        "threads",
        "simulation s",
        "speedup",
        "efficiency",
        "computing",
        "producing",
        "measured s",
        "off",
    ]);
    for f in &report.forecasts {
        let off = f.measured_s.map(|m| format!("{:+.1} %", 100.0 * (f.simulation_s / m - 1.0)));
        table.row(vec![
            f.tree.to_owned(),
            schedule(f.schedule, f.leg_barrier),
            f.chunk_size.to_string(),
            factor(f.warehouse_factor),
            f.threads.to_string(),
            format!("{:.4}", f.simulation_s),
            format!("{:.2}", f.speedup),
            format!("{:.2}", f.speedup / f.threads as f64),
            format!("{:.0} %", 100.0 * f.utilisation),
            format!("{:.0} %", 100.0 * f.producing),
            f.measured_s.map_or_else(String::new, |m| format!("{m:.4}")),
            off.unwrap_or_default(),
        ]);
    }
    table.text()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_are_aligned() {
        let mut table = Table::new(&["tree", "s"]);
        table.row(vec!["a".into(), "10.5".into()]);
        table.row(vec!["median".into(), "2".into()]);
        assert_eq!(table.text(), "tree       s\na       10.5\nmedian     2\n");
    }
}
