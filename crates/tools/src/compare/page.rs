//! A comparison as one page for a browser: table, histograms, pictures of both clouds.

use super::measures::{Comparison, Histogram};
use super::report::table;
use crate::chart::{Anchor, Axis, Drawing, Mark, Plot, Role, Theme, style};
use crate::cloud::Points;
use crate::preview::{PreviewOptions, common_heights, draw};
use base64::prelude::{BASE64_STANDARD, Engine};
use std::fmt::Write as _;
use vlscan_base::error::Result;
use vlscan_base::markup::escaped;
use vlscan_formats::PointRow;
use vlscan_geom::DVec3;

/// Width and height of a histogram, px.
const CHART: [f64; 2] = [560.0, 220.0];

/// The page; nothing in it is loaded from elsewhere.
///
/// # Errors
/// None that a user could cause.
pub fn page(comparison: &Comparison, clouds: [&Points; 2]) -> Result<String> {
    let names = [&comparison.first.name, &comparison.second.name].map(|name| escaped(name));
    let mut out = String::from("<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\n");
    // Writing to a string does not fail.
    let mut add = |text: std::fmt::Arguments| {
        let _ = out.write_fmt(text);
    };
    add(format_args!("<title>{} and {}</title>\n", names[0], names[1]));
    add(format_args!(
        "<style>body{{font:15px/1.4 system-ui,sans-serif;margin:2em auto;max-width:75em;padding:0 1em;color-scheme:light dark}}\
         pre{{overflow-x:auto}}img{{max-width:100%}}figure{{display:inline-block;margin:0 1em 1em 0}}\n{}</style></head><body>\n",
        style(Theme::Reader)
    ));
    add(format_args!(
        "<h1><span class=\"s0\">{}</span> and <span class=\"s1\">{}</span></h1>\n<pre>{}</pre>\n",
        names[0],
        names[1],
        escaped(&table(comparison))
    ));
    add(format_args!("{}", chart("Heights above the lowest point, m", &comparison.heights)));
    add(format_args!("{}", chart("Canopy height per cell, m", &comparison.canopy.heights)));
    if let Some(intensity) = &comparison.intensity {
        add(format_args!("{}", chart("Intensity in units of the median", intensity)));
    }
    let heights = common_heights(&clouds);
    for (points, (name, class)) in clouds.into_iter().zip(names.iter().zip(["s0", "s1"])) {
        let options =
            PreviewOptions { width: 1100, height: 800, light: true, heights, ..PreviewOptions::default() };
        let picture = BASE64_STANDARD.encode(draw(points, &options).png()?);
        add(format_args!(
            "<h2 class=\"{class}\">{name}</h2>\n<img alt=\"{name} from above and from the side\" src=\"data:image/png;base64,{picture}\">\n"
        ));
    }
    let reach = comparison.change.map.iter().map(|cell| cell[2].abs()).fold(0.1, f64::max);
    let mut change = Points::default();
    for cell in &comparison.change.map {
        change.push(&PointRow { position: DVec3::from(*cell), ..PointRow::default() }, None);
    }
    let options = PreviewOptions {
        width: 1100,
        height: 800,
        light: true,
        heights: Some((-reach, reach)),
        title: "lowest point per cell, second minus first".to_owned(),
        ..PreviewOptions::default()
    };
    let picture = BASE64_STANDARD.encode(draw(&change, &options).png()?);
    add(format_args!(
        "<h2>Change</h2>\n<img alt=\"differences of the lowest points of each cell\" src=\"data:image/png;base64,{picture}\">\n"
    ));
    add(format_args!("</body></html>\n"));
    Ok(out)
}

/// Both histograms as steps.
fn chart(title: &str, histogram: &Histogram) -> String {
    let [width, height] = CHART;
    let (most, cut) = scale(histogram);
    let note = if cut { format!("; bars above {:.0} % are cut", 100.0 * most) } else { String::new() };
    let mut drawing = Drawing::new(width, height + 20.0, 1.2);
    let x = Axis::new(histogram.from, histogram.to);
    let plot = Plot { left: 0.0, right: width, top: 0.0, bottom: height, x, y: Axis::new(0.0, most) };
    for (n, fractions) in histogram.fractions.iter().enumerate() {
        let step = (x.high - x.low) / fractions.len() as f64;
        let side = |at: usize, fraction: f64| plot.at(x.low + step * at as f64, fraction.min(most));
        let path = fractions.iter().enumerate().flat_map(|(i, f)| [side(i, *f), side(i + 1, *f)]).collect();
        let role = Role::Series(n);
        drawing.add(Mark::Below { path: Vec::clone(&path), floor: height, opacity: 0.25, role });
        drawing.add(Mark::Stroke { path, width: 1.5, dashed: false, role });
    }
    let ends = [(x.low, Anchor::Start), (0.5 * (x.low + x.high), Anchor::Middle), (x.high, Anchor::End)];
    for (value, anchor) in ends {
        drawing.write([plot.at(value, 0.0)[0], height + 6.0], format!("{value:.1}"), Role::Ink, anchor);
    }
    let size = format!("width:{width}px;max-width:100%");
    let svg = drawing.svg(title);
    format!("<figure style=\"{size}\"><figcaption>{title}{note}</figcaption>{svg}</figure>\n")
}

/// The fraction at the top of a chart, and whether bars are cut there: the ground of a forest has so many points that nothing
/// else would be seen.
fn scale(histogram: &Histogram) -> (f64, bool) {
    const MAX_RATIO: f64 = 4.0;
    let mut heights: Vec<f64> = Vec::new();
    for i in 0..histogram.fractions[0].len() {
        heights.push(histogram.fractions.iter().map(|f| f[i]).fold(0.0, f64::max));
    }
    heights.sort_by(|a, b| b.total_cmp(a));
    let [first, second] = [0, 1].map(|i| heights.get(i).copied().unwrap_or_default());
    if second > 0.0 && first > MAX_RATIO * second { (1.5 * second, true) } else { (first.max(1e-9), false) }
}
