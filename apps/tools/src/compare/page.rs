//! A comparison as one page for a browser and for paper: results, contents, tables, charts, pictures of both
//! clouds.

use super::change::Change;
use super::comparison::Comparison;
use super::histogram::Histogram;
use super::map::picture_of;
use super::quantity::Figure;
use super::report::{Section, described, sections};
use crate::chart::{Anchor, Axis, Drawing, Mark, Plot, Role, Theme, style};
use crate::cloud::Points;
use crate::preview::{PreviewOptions, common_heights, draw};
use base64::prelude::{BASE64_STANDARD, Engine};
use std::fmt::Write as _;
use std::path::Path;
use vlscan_base::error::Result;
use vlscan_base::markup::escaped;
use vlscan_base::quantity::{fixed, signed};

/// Width and height of the field of a histogram, px.
const FIELD: [f64; 2] = [430.0, 190.0];
/// Room at the left and below for the numbers of the axes, px.
const MARGIN: [f64; 2] = [46.0, 40.0];
/// Size of pictures, dots.
const PICTURE: [u32; 2] = [1100, 800];

const STYLE: &str = "body{font:15px/1.45 system-ui,sans-serif;margin:2em auto;max-width:76em;padding:0 \
 1em;color-scheme:light dark}\
 table{border-collapse:collapse;font-variant-numeric:tabular-nums;margin:.3em 0 .8em}\
 td,th{padding:.1em .9em .1em 0;text-align:right}\
 td:first-child,th:first-child{text-align:left;min-width:13em}th{font-weight:600;border-bottom:1px solid}\
 tr.out td{font-weight:700}p.m{margin:.2em 0;opacity:.8;max-width:60em}img{max-width:100%}\
 figure{margin:0 0 1em}\
 h1,h3{overflow-wrap:anywhere}h1{font-size:clamp(1.2em,4vw,2em);line-height:1.25}\
 section{break-inside:avoid;margin:0 0 1.6em}\
 .pair{display:flex;flex-wrap:wrap;gap:0 1.5em;align-items:flex-start}\
 h2{margin:1.6em 0 .4em;border-bottom:2px solid}h3{margin:.8em 0 .1em}.pair figure{flex:0 1 490px}\
 @media (min-width:62em){.pair{flex-wrap:nowrap}}\
 @media print{body{margin:0;max-width:none;font-size:11px}a{color:inherit}}";

/// The page; nothing in it is loaded from elsewhere. It begins with the results.
///
/// # Errors
/// None that a user could cause.
pub fn page(comparison: &Comparison, clouds: [&Points; 2]) -> Result<String> {
    let names = [&comparison.first.name, &comparison.second.name].map(|name| escaped(name));
    let (body, contents) = details(comparison);
    let mut out = String::from(
        "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n",
    );
    // Writing to a string does not fail.
    let mut add = |text: std::fmt::Arguments| {
        let _ = out.write_fmt(text);
    };
    add(format_args!(
        "<title>{}</title>\n",
        escaped(&title([&comparison.first.name, &comparison.second.name]))
    ));
    add(format_args!("<style>{STYLE}\n{}</style></head><body>\n", style(Theme::Reader)));
    add(format_args!(
        "<h1><span class=\"s0\">{}</span> and <span class=\"s1\">{}</span></h1>\n",
        names[0], names[1]
    ));
    add(format_args!("<h2>Results</h2>\n<section>{}", volumes(&comparison.change)));
    let picture = BASE64_STANDARD.encode(picture_of(&comparison.change.map, PICTURE).png()?);
    add(format_args!(
        "<h3>Second minus first</h3>\n<p class=\"m\">Differences of the ground beyond the level of detection \
         in colour, others in grey; white where a cloud has no surface.</p>\n\
         <img alt=\"differences of the ground from above\" src=\"data:image/png;base64,{picture}\">\
         </section>\n"
    ));
    add(format_args!("{}{}{body}", summary(comparison), list_of(&contents)));
    if !comparison.missing.is_empty() {
        add(format_args!("<h2 id=\"missing\">Missing</h2>\n<ul>"));
        comparison.missing.iter().for_each(|missing| add(format_args!("<li>{}</li>", escaped(missing))));
        add(format_args!("</ul>\n"));
    }
    add(format_args!(
        "<h2 id=\"pictures\">Pictures</h2>\n<p class=\"m\">Both clouds have one scale of heights.</p>\n"
    ));
    let heights = common_heights(&clouds);
    for (points, (name, class)) in clouds.into_iter().zip(names.iter().zip(["s0", "s1"])) {
        let [width, height] = PICTURE;
        let options = PreviewOptions { width, height, light: true, heights, ..PreviewOptions::default() };
        let picture = BASE64_STANDARD.encode(draw(points, &options).png()?);
        add(format_args!(
            "<section><h3 class=\"{class}\">{name}</h3>\n<img alt=\"{name} from above and from the side\" \
             src=\"data:image/png;base64,{picture}\"></section>\n"
        ));
    }
    add(format_args!("</body></html>\n"));
    Ok(out)
}

/// All sections with their charts, and the headings above them, each with its anchor.
fn details(comparison: &Comparison) -> (String, Vec<(String, String)>) {
    let (mut out, mut contents) = (String::new(), Vec::new());
    // Writing to a string does not fail.
    let mut add = |text: std::fmt::Arguments| {
        let _ = out.write_fmt(text);
    };
    let mut group = "";
    for section in sections(comparison) {
        let quantity = section.quantity.map(|i| &comparison.quantities[i]);
        let heading = match quantity {
            Some(quantity) if quantity.group == group => None,
            Some(quantity) => Some(quantity.group),
            None => Some(section.title.as_str()),
        };
        if let Some(heading) = heading {
            let anchor = format!("part{}", contents.len() + 1);
            add(format_args!("<h2 id=\"{anchor}\">{}</h2>\n", escaped(heading)));
            contents.push((anchor, heading.to_owned()));
        }
        group = quantity.map_or(group, |quantity| quantity.group);
        add(format_args!("<section>"));
        if quantity.is_some() {
            add(format_args!("<h3>{}</h3>", escaped(&section.title)));
        }
        add(format_args!(
            "<p class=\"m\">{}</p>\n<div class=\"pair\">{}",
            escaped(&section.meaning),
            rows(&section)
        ));
        // A single bar shows nothing that the table does not.
        if let Some(quantity) = quantity.filter(|quantity| bars(&quantity.histogram) > 1) {
            let unit = if quantity.unit.is_empty() { String::new() } else { format!(", {}", quantity.unit) };
            add(format_args!("{}", chart(&format!("{}{unit}", quantity.name), &quantity.histogram)));
        }
        add(format_args!("</div></section>\n"));
    }
    if !comparison.missing.is_empty() {
        contents.push(("missing".to_owned(), "Missing".to_owned()));
    }
    contents.push(("pictures".to_owned(), "Pictures".to_owned()));
    (out, contents)
}

/// Number of classes with values of either cloud.
fn bars(histogram: &Histogram) -> usize {
    let [first, second] = &histogram.fractions;
    first.iter().zip(second).filter(|(a, b)| **a > 0.0 || **b > 0.0).count()
}

/// The list of contents, with links.
fn list_of(contents: &[(String, String)]) -> String {
    let item = |(anchor, heading): &(String, String)| {
        format!("<li><a href=\"#{anchor}\">{}</a></li>\n", escaped(heading))
    };
    let items: String = contents.iter().map(item).collect();
    format!("<nav><h2>Contents</h2>\n<ul>\n{items}</ul></nav>\n")
}

/// The volumes of the change with their standard uncertainties.
fn volumes(change: &Change) -> String {
    let mut text =
        "<table><tr><th>change of the ground</th><th>volume, m³</th><th>area, m²</th></tr>\n".to_owned();
    let net_area = change.cells as f64 * change.map.side_m * change.map.side_m;
    for (name, volume, uncertainty, area) in [
        ("fill", fixed(change.fill.volume_m3, 1), change.fill.uncertainty_m3, change.fill.area_m2),
        ("cut", fixed(change.cut.volume_m3, 1), change.cut.uncertainty_m3, change.cut.area_m2),
        ("net, all cells", signed(change.net_m3, 1), change.net_uncertainty_m3, net_area),
    ] {
        // Without cells the uncertainty is NaN.
        let volume = match uncertainty.is_nan() {
            true => "unknown".to_owned(),
            false => format!("{volume} ± {}", fixed(uncertainty, 1)),
        };
        let _ = writeln!(text, "<tr><td>{name}</td><td>{volume}</td><td>{}</td></tr>", fixed(area, 0));
    }
    text + "</table>\n"
}

/// The title of the page: the names of both files, with their folders only if they are the same without.
fn title(paths: [&str; 2]) -> String {
    let [first, second] =
        paths.map(|path| Path::new(path).file_name().map_or(path.into(), |name| name.to_string_lossy()));
    let [first, second] = if first == second { paths } else { [&*first, &*second] };
    format!("{first} and {second}, compared")
}

/// Summary: the clouds, and the number of figures beyond chance.
fn summary(c: &Comparison) -> String {
    let mut text = format!(
        "<p>vlscan {} compared {} points of the first cloud with {} of the second one, on {:.0} m² that both \
         share. Differences are second minus first.",
        env!("CARGO_PKG_VERSION"),
        c.first.points,
        c.second.points,
        c.area_m2
    );
    if let Some(chance) = &c.chance {
        let figures = || c.quantities.iter().flat_map(|quantity| &quantity.figures);
        let beyond = figures().filter(|figure| figure.is_within_chance == Some(false)).count();
        let _ = write!(
            text,
            " Chance is {}: one more such difference exceeds it with a probability of 1 in {}. Of {} figures \
             {beyond} lie beyond it, marked by ● and bold.",
            escaped(&described(chance)),
            chance.splits + 1,
            figures().count()
        );
    }
    text + "</p>\n" + &beyond(c)
}

/// The figures that lie beyond chance, by quantity.
fn beyond(c: &Comparison) -> String {
    let mut items = String::new();
    for quantity in &c.quantities {
        let is_beyond = |figure: &&Figure| figure.is_within_chance == Some(false);
        let mut names: Vec<&str> =
            quantity.figures.iter().filter(is_beyond).map(|f| f.name.as_str()).collect();
        if quantity.distribution.is_within_chance == Some(false) {
            names.push("distribution");
        }
        if !names.is_empty() {
            let _ = writeln!(items, "<li>{}: {}</li>", escaped(&quantity.name), escaped(&names.join(", ")));
        }
    }
    if items.is_empty() { items } else { format!("<p>Beyond chance:</p>\n<ul>\n{items}</ul>\n") }
}

fn rows(section: &Section) -> String {
    let has_chance = section.rows.iter().any(|row| !row.chance.is_empty());
    let chance = if has_chance { "<th>chance</th><th></th>" } else { "" };
    let mut text = format!(
        "<table><tr><th></th><th class=\"s0\">first</th><th class=\"s1\">second</th>\
         <th>difference</th>{chance}</tr>\n"
    );
    for row in &section.rows {
        let (class, mark) = if row.is_within == Some(false) { (" class=\"out\"", "●") } else { ("", "") };
        let _ = write!(text, "<tr{class}><td>{}</td>", escaped(&row.name));
        for value in [&row.first, &row.second, &row.difference] {
            let _ = write!(text, "<td>{}</td>", escaped(value));
        }
        if has_chance {
            let _ = write!(text, "<td>{}</td><td>{mark}</td>", escaped(&row.chance));
        }
        text.push_str("</tr>\n");
    }
    text + "</table>\n"
}

/// Both histograms as steps.
fn chart(title: &str, histogram: &Histogram) -> String {
    let (most, is_cut) = scale(histogram);
    let [left, below] = MARGIN;
    let (width, height) = (left + FIELD[0] + 10.0, 10.0 + FIELD[1] + below);
    let mut drawing = Drawing::new(width, height, 1.0);
    let (x, y) = (Axis::new(histogram.from, histogram.to), Axis::new(0.0, 100.0 * most));
    let plot = Plot { left, right: left + FIELD[0], top: 10.0, bottom: 10.0 + FIELD[1], x, y };
    plot.grid(&mut drawing, x.ticks(6.0), y.ticks(4.0));
    for (n, fractions) in histogram.fractions.iter().enumerate() {
        let step = (x.high - x.low) / fractions.len() as f64;
        let side = |at: usize, fraction: f64| plot.at(x.low + step * at as f64, 100.0 * fraction.min(most));
        let path: Vec<[f64; 2]> =
            fractions.iter().enumerate().flat_map(|(i, f)| [side(i, *f), side(i + 1, *f)]).collect();
        let role = Role::Series(n);
        drawing.add(Mark::Below { path: path.clone(), floor: plot.bottom, opacity: 0.22, role });
        drawing.add(Mark::Stroke { path, width: 1.5, dashed: n == 1, role });
    }
    drawing.write([plot.right, plot.bottom + 24.0], title, Role::Faint, Anchor::End);
    let mut notes =
        vec![format!("percent per class of {}; common area {:.3}", width_of(histogram), histogram.overlap)];
    let beyond = [0, 1].map(|i: usize| histogram.below[i] + histogram.above[i]);
    if beyond[0].max(beyond[1]) > 5e-4 {
        notes.push(format!(
            "{:.2} and {:.2} % lie beyond these classes",
            100.0 * beyond[0],
            100.0 * beyond[1]
        ));
    }
    if is_cut {
        notes.push(format!("bars above {:.0} % are cut", 100.0 * most));
    }
    let svg = drawing.svg(title);
    format!(
        "<figure style=\"width:{width}px;max-width:100%\">{svg}<figcaption class=\"m\">{}</figcaption>\
         </figure>\n",
        escaped(&notes.join("; "))
    )
}

fn width_of(histogram: &Histogram) -> String {
    let width = (histogram.to - histogram.from) / histogram.fractions[0].len() as f64;
    // The rounding of a decimal number.
    format!("{}", (width * 1e9).round() / 1e9)
}

/// The fraction at the top of a chart, and whether bars are cut there: the ground of a forest has so many
/// points that nothing else would be seen.
fn scale(histogram: &Histogram) -> (f64, bool) {
    const MAX_RATIO: f64 = 4.0;
    let mut heights: Vec<f64> = Vec::new();
    for i in 0..histogram.fractions[0].len() {
        heights.push(histogram.fractions.iter().map(|f| f[i]).fold(0.0, f64::max));
    }
    heights.sort_by(|a, b| b.total_cmp(a));
    let [first, second] = [0, 1].map(|i| heights.get(i).copied().unwrap_or_default());
    if heights.len() > 8 && second > 0.0 && first > MAX_RATIO * second {
        (1.5 * second, true)
    } else {
        (1.05 * first.max(1e-9), false)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compare::{CompareOptions, compare};
    use vlscan_base::Observer;
    use vlscan_formats::{AttributeSet, PointRow};
    use vlscan_geom::DVec3;

    #[test]
    fn a_page_begins_with_its_results_and_has_no_chart_of_one_bar() {
        let mut cloud = Points::new(AttributeSet::of(|_| true));
        for i in 0..1600 {
            let position =
                DVec3::new(0.5 * f64::from(i % 40), 0.5 * f64::from(i / 40), 0.01 * f64::from(i % 7));
            let returns = PointRow { return_number: 1, number_of_returns: 1, ..PointRow::default() };
            let row = PointRow { position, intensity: 5.0, class: 2, ..returns };
            cloud.push(&row, None);
        }
        let clouds = [("a", &cloud), ("b", &cloud)];
        let comparison = compare(clouds, &CompareOptions::default(), &Observer::default()).unwrap();
        let text = page(&comparison, [&cloud, &cloud]).unwrap();
        let parts = [
            "<h2>Results</h2>",
            "<td>fill</td>",
            "differences of the ground from above",
            "compared 1600 points",
            "<h2>Contents</h2>",
            "<svg",
        ];
        assert!(text.contains("name=\"viewport\"") && text.contains("h1{font-size:clamp("), "phones");
        let places = parts.map(|part| text.find(part).unwrap_or_else(|| panic!("no {part} in {text}")));
        assert!(places.is_sorted(), "{places:?}");
        for link in text.split("href=\"#").skip(1) {
            let anchor = link.split('"').next().unwrap();
            assert!(text.contains(&format!("<h2 id=\"{anchor}\">")), "{anchor} leads nowhere");
        }
        let several = comparison.quantities.iter().filter(|q| bars(&q.histogram) > 1).count();
        assert!(several > 0 && several < comparison.quantities.len());
        assert_eq!(text.matches("<svg").count(), several);
        assert_eq!(bars(&comparison.quantity("intensity over its median").unwrap().histogram), 1);
    }

    #[test]
    fn a_histogram_of_one_class_has_one_bar() {
        let of = |first: &[f64], second: &[f64]| bars(&Histogram::of([first, second], false));
        assert_eq!(of(&[7.0; 5], &[7.0; 3]), 1);
        assert!(of(&[7.0; 5], &[7.0, 7.0, 9.0]) > 1);
        let empty_classes = Histogram {
            from: 0.0,
            to: 3.0,
            fractions: [vec![0.0, 1.0, 0.0], vec![0.0, 1.0, 0.0]],
            below: [0.0; 2],
            above: [0.0; 2],
            overlap: 1.0,
        };
        assert_eq!(bars(&empty_classes), 1);
    }
}
