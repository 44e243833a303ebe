//! A comparison as a table of text and as JSON.

use super::chance::{BlockKind, Chance};
use super::change::{Change, Volume};
use super::comparison::{Agreement, Cloud, Comparison};
use super::neighbours::Distances;
use crate::chart::label::significant;
use std::fmt::Write as _;
use vlscan_base::error::{Error, Result};
use vlscan_base::quantity::{amount, fixed, signed};

/// The comparison as JSON.
///
/// # Errors
/// [`Error::Internal`] for numbers that JSON has not.
pub fn json(comparison: &Comparison) -> Result<String> {
    let text = serde_json::to_string_pretty(comparison);
    text.map_err(|e| Error::Internal(format!("a comparison: {e}")))
}

/// A row of the table.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Row {
    pub name: String,
    pub first: String,
    pub second: String,
    pub difference: String,
    pub chance: String,
    /// True if the difference is within chance, if that is estimated.
    pub is_within: Option<bool>,
}

/// Rows about one subject.
pub(super) struct Section {
    pub title: String,
    pub meaning: String,
    pub rows: Vec<Row>,
    /// The quantity with its distribution, if it is one: its index in the comparison.
    pub quantity: Option<usize>,
}

/// All sections of a comparison.
pub(super) fn sections(c: &Comparison) -> Vec<Section> {
    let quantities = c.quantities.iter().enumerate().map(|(index, quantity)| {
        let mut rows: Vec<Row> = quantity
            .figures
            .iter()
            .filter(|figure| figure.unit != "%" || figure.first.max(figure.second) > 0.0)
            .map(|figure| {
                let unit = if figure.unit.is_empty() { String::new() } else { format!(", {}", figure.unit) };
                Row {
                    name: format!("{}{unit}", figure.name),
                    first: fixed(figure.first, decimals(figure.unit)),
                    second: fixed(figure.second, decimals(figure.unit)),
                    difference: signed(figure.difference, decimals(figure.unit)),
                    chance: figure
                        .chance
                        .map_or(String::new(), |chance| fixed(chance, decimals(figure.unit))),
                    is_within: figure.is_within_chance,
                }
            })
            .collect();
        rows.push(Row {
            name: "largest distance of distributions".to_owned(),
            first: String::new(),
            second: String::new(),
            difference: format!("{:.4}", quantity.distribution.largest),
            chance: quantity.distribution.chance.map_or(String::new(), |chance| format!("{chance:.4}")),
            is_within: quantity.distribution.is_within_chance,
        });
        let [a, b] = quantity.counts.map(|count| amount(count as f64));
        let per = quantity.per;
        Section {
            title: format!("{} ({a} and {b} {per}s)", quantity.name),
            meaning: quantity.meaning.clone(),
            rows,
            quantity: Some(index),
        }
    });
    [clouds(c)].into_iter().chain(quantities).chain([agreement(c), change(&c.change)]).collect()
}

/// The comparison in lines: what, first cloud, second cloud, second minus first, chance.
pub fn table(c: &Comparison) -> String {
    let mut out = String::new();
    // Writing to a string does not fail.
    let mut line = |name: &str, row: [&str; 4], mark: &str| {
        let [a, b, difference, chance] = row;
        let text = format!("{name:<36}{a:>16}{b:>16}{difference:>16}{chance:>14} {mark}");
        let _ = writeln!(out, "{}", text.trim_end());
    };
    line("", ["first", "second", "difference", if c.chance.is_some() { "chance" } else { "" }], "");
    for (number, section) in sections(c).into_iter().enumerate() {
        if number > 0 {
            line(&section.title, [""; 4], "");
        }
        for row in &section.rows {
            let mark = if row.is_within == Some(false) { "*" } else { "" };
            let name = if number > 0 { format!("  {}", row.name) } else { row.name.clone() };
            line(&name, [&row.first, &row.second, &row.difference, &row.chance], mark);
        }
    }
    if let Some(chance) = &c.chance {
        let _ = writeln!(out, "chance: {}; * is beyond it", described(chance));
    }
    for missing in &c.missing {
        let _ = writeln!(out, "missing: {missing}");
    }
    out
}

/// Description of the bounds by chance.
pub(super) fn described(chance: &Chance) -> String {
    let Chance { kind, count, splits } = chance;
    let blocks = match kind {
        BlockKind::ScanLines => "scan lines".to_owned(),
        BlockKind::Cells { side_m } => format!("cells of {side_m:.2} m"),
    };
    format!(
        "the largest difference of {splits} random splits of the first cloud's {count} {blocks} into halves"
    )
}

fn clouds(c: &Comparison) -> Section {
    let mut rows = Vec::new();
    let mut row = |name: &str, of: &dyn Fn(&Cloud) -> String, difference: String| {
        let [first, second] = [&c.first, &c.second].map(of);
        rows.push(Row {
            name: name.to_owned(),
            first,
            second,
            difference,
            chance: String::new(),
            is_within: None,
        });
    };
    let ratio = |of: &dyn Fn(&Cloud) -> f64| match of(&c.first) {
        first if first > 0.0 => format!("× {:.4}", of(&c.second) / first),
        _ => String::new(),
    };
    row("points", &|cloud| amount(cloud.points as f64), String::new());
    row("in the box of both", &|cloud| fixed(cloud.points_in_box, 0), ratio(&|cloud| cloud.points_in_box));
    row(
        &format!("density on {:.0} m², points/m²", c.area_m2),
        &|cloud| fixed(cloud.density_per_m2, 3),
        ratio(&|cloud| cloud.density_per_m2),
    );
    if c.first.intensity_median.is_some() && c.second.intensity_median.is_some() {
        let of = |cloud: &Cloud| cloud.intensity_median.unwrap_or_default();
        row("intensity, median", &|cloud| significant(of(cloud)), ratio(&of));
    }
    for (i, name) in ["pulses", "scan lines"].into_iter().enumerate() {
        let count = |cloud: &Cloud| cloud.pulses_and_lines.map_or(0, |counts| counts[i]);
        let shown = |cloud: &Cloud| match count(cloud) {
            // The clouds have points: their pulses or lines could not be told apart.
            0 => "unknown".to_owned(),
            count => count.to_string(),
        };
        let [first, second] = [count(&c.first), count(&c.second)];
        if first + second > 0 {
            let of = |cloud: &Cloud| count(cloud) as f64;
            row(name, &shown, if second > 0 { ratio(&of) } else { String::new() });
        }
    }
    Section {
        title: "Clouds".to_owned(),
        meaning: "the box is the one that both share".to_owned(),
        rows,
        quantity: None,
    }
}

fn agreement(c: &Comparison) -> Section {
    let mut rows = Vec::new();
    let halves = c.agreement_of_halves.as_ref();
    // True if a value that is small where clouds agree is at most that of halves.
    let mut row = |name: String, of: &dyn Fn(&Agreement) -> f64, decimals: usize, is_small: Option<bool>| {
        let value = of(&c.agreement);
        let chance = halves.map(of);
        let shown = |value: f64| if value.is_nan() { "none".to_owned() } else { fixed(value, decimals) };
        let is_within = chance.zip(is_small).map(|(chance, is_small)| match is_small {
            true => value.abs() <= chance.abs(),
            false => value >= chance,
        });
        rows.push(Row {
            name,
            first: String::new(),
            second: String::new(),
            difference: shown(value),
            chance: chance.map_or(String::new(), shown),
            is_within,
        });
    };
    row("correlation of densities".to_owned(), &|a| a.density_correlation, 3, None);
    row("canopy height, mean, m".to_owned(), &|a| a.canopy.mean_difference_m, 3, None);
    row("canopy height, RMS, m".to_owned(), &|a| a.canopy.rms_difference_m, 3, Some(true));
    row("canopy height, correlation".to_owned(), &|a| a.canopy.correlation, 3, Some(false));
    type Figure = (&'static str, fn(&Distances) -> f64);
    let distances: [Figure; 4] = [
        ("mean", |d| d.mean_m),
        ("median", |d| d.median_m),
        ("95 %", |d| d.percentile_95_m),
        ("largest", |d| d.max_m),
    ];
    for (name, of) in distances {
        let is_small = (name != "largest").then_some(true);
        row(format!("distance to second, {name}, m"), &|a| of(&a.first_to_second), 3, is_small);
        row(format!("distance to first, {name}, m"), &|a| of(&a.second_to_first), 3, is_small);
    }
    let side = c.agreement.voxels.side_m;
    row(format!("voxels of {side} m in both / all"), &|a| a.voxels.agreement, 3, Some(false));
    Section {
        title: "both together".to_owned(),
        meaning: format!(
            "cells of {} m: numbers of points and highest points; distances to the nearest point of the \
             other cloud; voxels that both occupy, of all. Chance is the same of two halves of the first \
             cloud, which have half its points",
            c.cell_m
        ),
        rows,
        quantity: None,
    }
}

fn change(change: &Change) -> Section {
    let row = |name: &str, difference: String| Row {
        name: name.to_owned(),
        first: String::new(),
        second: String::new(),
        difference,
        chance: String::new(),
        is_within: None,
    };
    // Without cells the uncertainty is NaN.
    let with_uncertainty = |shown: String, uncertainty: f64| match uncertainty.is_nan() {
        true => "unknown".to_owned(),
        false => format!("{shown} ± {}", fixed(uncertainty, 1)),
    };
    let volume = |v: &Volume| with_uncertainty(fixed(v.volume_m3, 1), v.uncertainty_m3);
    let of_each = |counts: [usize; 2]| format!("{} and {}", counts[0], counts[1]);
    Section {
        title: format!("change of the ground ({} cells)", change.cells),
        meaning: format!(
            "second minus first, planes through {} at the centres of cells that both have; cut and fill \
             beyond the level of detection at 95 %, with standard uncertainties, which contain the volumes \
             below that level and of cells left out",
            change.surface
        ),
        rows: vec![
            row("mean, m", signed(change.mean_m, 4)),
            row("median, m", signed(change.median_m, 4)),
            row("robust spread, m", fixed(change.spread_m, 4)),
            row("level of detection, m", fixed(change.detection_m, 4)),
            row("offset where nothing changed, m", signed(change.offset_m, 4)),
            row("shared errors about it, m", fixed(change.shared_m, 4)),
            row("fill, m³", volume(&change.fill)),
            row("  on m²", fixed(change.fill.area_m2, 0)),
            row("  below the level of detection, m³", fixed(change.fill.undetected_m3, 1)),
            row("  perhaps in cells left out, m³", fixed(change.fill.unmeasured_m3, 1)),
            row("cut, m³", volume(&change.cut)),
            row("  on m²", fixed(change.cut.area_m2, 0)),
            row("  below the level of detection, m³", fixed(change.cut.undetected_m3, 1)),
            row("  perhaps in cells left out, m³", fixed(change.cut.unmeasured_m3, 1)),
            row("net, all cells, m³", with_uncertainty(signed(change.net_m3, 1), change.net_uncertainty_m3)),
            row("cells filled from cells around them", change.cells_interpolated.to_string()),
            row("cells left out as extrapolated", of_each(change.cells_extrapolated)),
            row("cells left out, with those that have no points", change.cells_unmeasured.to_string()),
            row("cells with one surface alone", of_each(change.cells_of_one)),
        ],
        quantity: None,
    }
}

/// Decimals of a number of a unit: a millimetre, a tenth of one of residuals.
fn decimals(unit: &str) -> usize {
    match unit {
        "mm" => 2,
        "m" | "1/m²" => 3,
        "%" | "1/s" => 3,
        _ => 4,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn differences_of_a_millimetre_are_seen_and_zeros_have_no_sign() {
        assert_eq!(signed(0.0012, decimals("m")), "+0.001");
        assert_eq!(signed(-0.0001, decimals("m")), "0.000");
        assert_eq!(signed(-8.9, decimals("mm")), "-8.90");
    }
}
