//! A comparison as a table of text.

use super::measures::{Cloud, Comparison, PERCENTILES};
use super::neighbours::Distances;
use std::fmt::Write as _;
use vlscan_base::error::{Error, Result};
use vlscan_base::quantity::amount;

/// The comparison as JSON.
///
/// # Errors
/// [`Error::Internal`] for numbers that JSON has not.
pub fn json(comparison: &Comparison) -> Result<String> {
    let text = serde_json::to_string_pretty(comparison);
    text.map_err(|e| Error::Internal(format!("a comparison: {e}")))
}

/// The comparison in lines: what, first cloud, second cloud, difference.
pub fn table(c: &Comparison) -> String {
    let mut out = String::new();
    let mut line = |name: &str, a: String, b: String, rest: String| {
        // Writing to a string does not fail.
        let _ = writeln!(out, "{}", format!("{name:<26}{a:>16}{b:>16}   {rest}").trim_end());
    };
    let none = String::new;
    line("", "first".into(), "second".into(), "second against first".into());
    let counts = [&c.first, &c.second].map(|cloud| amount(cloud.points as f64));
    line("points", counts[0].clone(), counts[1].clone(), none());
    let both = |of: &dyn Fn(&Cloud) -> f64, decimals: usize| {
        let [a, b] = [of(&c.first), of(&c.second)];
        (format!("{a:.decimals$}"), format!("{b:.decimals$}"), a, b)
    };
    let (a, b, x, y) = both(&|cloud| cloud.points_in_box, 0);
    line("in the box of both", a, b, ratio(x, y));
    let (a, b, x, y) = both(&|cloud| cloud.density_per_m2, 3);
    line("density, points/m²", a, b, ratio(x, y));
    line(
        &format!("  per cell of {} m", c.cell_m),
        none(),
        none(),
        format!("correlation {} on {:.0} m²", correlation(c.density_correlation), c.area_m2),
    );
    for (i, percent) in PERCENTILES.iter().enumerate() {
        let (a, b, x, y) = both(&|cloud| cloud.height_percentiles_m[i], 2);
        line(&format!("height, {percent:.0} %, m"), a, b, signed(y - x));
    }
    line("height histogram", none(), none(), format!("overlap {:.3}", c.heights.overlap));
    line(
        "canopy height, m",
        none(),
        none(),
        format!(
            "mean {:+.2}, RMS {:.2}, correlation {} in {} cells",
            c.canopy.mean_difference_m,
            c.canopy.rms_difference_m,
            correlation(c.canopy.correlation),
            c.canopy.cells
        ),
    );
    line(
        "lowest points per cell, m",
        none(),
        none(),
        format!("mean {}, RMS {:.2} in {} cells", signed(c.change.mean_m), c.change.rms_m, c.change.cells),
    );
    line(
        "  volume between, m³",
        none(),
        none(),
        format!("raised {:.1}, lowered {:.1}", c.change.raised_m3, c.change.lowered_m3),
    );
    if let (Some(a), Some(b)) = (c.first.intensity_percentiles, c.second.intensity_percentiles) {
        let overlap =
            c.intensity.as_ref().map(|h| format!("overlap of histograms over medians {:.3}", h.overlap));
        line(
            "intensity, median",
            format!("{:.4}", a[3]),
            format!("{:.4}", b[3]),
            overlap.unwrap_or_default(),
        );
    }
    if let (Some(a), Some(b)) = (c.first.returns, c.second.returns) {
        for (i, (a, b)) in a.iter().zip(b).enumerate().filter(|(_, (a, b))| **a > 0.0 || *b > 0.0) {
            let name =
                if i == 6 { "returns 7 and later, %".to_owned() } else { format!("returns {}, %", i + 1) };
            line(&name, format!("{:.2}", 100.0 * a), format!("{:.2}", 100.0 * b), signed(100.0 * (b - a)));
        }
    }
    type Figure = (&'static str, fn(&Distances) -> f64);
    let distances: [Figure; 4] = [
        ("distance, mean, m", |d| d.mean_m),
        ("  median, m", |d| d.median_m),
        ("  95 %, m", |d| d.percentile_95_m),
        ("  largest, m", |d| d.max_m),
    ];
    for (i, (name, of)) in distances.into_iter().enumerate() {
        let [a, b] = [&c.first_to_second, &c.second_to_first].map(|d| format!("{:.3}", of(d)));
        line(name, a, b, if i == 0 { "to the other cloud".into() } else { none() });
    }
    let v = &c.voxels;
    line(
        &format!("voxels of {} m", v.side_m),
        (v.both + v.only_first).to_string(),
        (v.both + v.only_second).to_string(),
        format!("{} in both, agreement {:.3}", v.both, v.agreement),
    );
    out
}

/// A correlation, which values that are all equal do not have.
fn correlation(value: f64) -> String {
    if value.is_nan() { "none".to_owned() } else { format!("{value:.3}") }
}

/// A difference with its sign, without that of a zero.
fn signed(value: f64) -> String {
    let text = format!("{value:+.2}");
    if text.trim_start_matches(['+', '-']) == "0.00" { "0.00".to_owned() } else { text }
}

fn ratio(a: f64, b: f64) -> String {
    if a > 0.0 { format!("× {:.3}", b / a) } else { String::new() }
}
