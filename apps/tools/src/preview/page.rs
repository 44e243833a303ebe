//! Writes a point cloud as one interactive HTML page: hand-written WebGL 2, no external resources, points
//! packed into the page.

mod pack;

use super::colour::{Colouring, Legend};
use super::section;
use super::{ColourBy, PreviewOptions};
use crate::chart::Rgb;
use crate::chart::label::{grouped, metres};
use crate::cloud::Points;
use pack::{Packed, Scales, pack, sample};
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::io::{self, Write};
use vlscan_base::markup::escaped;

const PAGE: &str = include_str!("page/page.html");
const STYLE: &str = include_str!("page/page.css");
/// In order of dependency.
const SCRIPTS: [&str; 4] = [
    include_str!("page/points.js"),
    include_str!("page/draw.js"),
    include_str!("page/camera.js"),
    include_str!("page/main.js"),
];

/// Summary of a written page.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Page {
    /// Points in the page.
    pub shown: usize,
    /// Points of the cloud.
    pub total: usize,
}

/// Writes a cloud as a page that works offline. The same points and options result in the same bytes.
/// Positions have a resolution of 1 mm, or of 1/2 097 152 of the longest side of a larger cloud.
///
/// # Errors
/// When writing to `out` fails.
pub fn write_page(points: &Points, options: &PreviewOptions, out: &mut dyn Write) -> io::Result<Page> {
    let chosen = sample(points.len(), options.max_points);
    let page = Page { shown: chosen.len(), total: points.total() };
    let legends = Legends::new(points);
    let packed = pack(points, &chosen, &legends.scales());
    let parts = [
        ("title", escaped(&title(options))),
        ("heading", escaped(if options.title.is_empty() { "points" } else { &options.title })),
        ("facts", escaped(&facts(points, page))),
        ("css", STYLE.to_owned()),
        ("theme", if options.light { "light" } else { "dark" }.to_owned()),
        ("meta", legends.meta(points, &packed, &chosen, options)),
        ("blocks", String::new()),
        ("script", format!("'use strict';\n(() => {{\n{}}})();\n", SCRIPTS.join("\n"))),
    ];
    let mut rest = PAGE;
    while let Some((before, after)) = rest.split_once("{{") {
        out.write_all(before.as_bytes())?;
        let (name, after) = after.split_once("}}").unwrap_or((after, ""));
        match parts.iter().find(|part| part.0 == name) {
            Some(("blocks", _)) => packed.write(out)?,
            Some((_, text)) => out.write_all(text.as_bytes())?,
            None => {}
        }
        rest = after;
    }
    out.write_all(rest.as_bytes())?;
    Ok(page)
}

fn title(options: &PreviewOptions) -> String {
    if options.title.is_empty() { "vlscan".to_owned() } else { format!("{} · vlscan", options.title) }
}

fn facts(points: &Points, page: Page) -> String {
    let mut facts = match page {
        Page { total: 0, .. } => return "no points".to_owned(),
        Page { shown, total } if shown < total => {
            format!("{} of {} points, evenly sampled", grouped(shown), grouped(total))
        }
        Page { total, .. } => format!("{} points", grouped(total)),
    };
    let size = points.bounds().size();
    let _ = write!(facts, " · {} × {} × {} m", metres(size.x), metres(size.y), metres(size.z));
    facts
}

/// The colourings for which the points have attributes, with the colours of the picture.
struct Legends {
    ways: Vec<(ColourBy, Colouring)>,
}

impl Legends {
    fn new(points: &Points) -> Legends {
        let ways: Vec<(ColourBy, Colouring)> = ColourBy::ALL
            .into_iter()
            .filter(|way| way.shown_by(points))
            .map(|way| (way, Colouring::new(points, way, None)))
            .collect();
        Legends { ways }
    }

    /// The scales of the attributes that are stored as bytes.
    fn scales(&self) -> Scales<'_> {
        let of = |wanted: ColourBy| self.ways.iter().find(|(way, _)| *way == wanted).map(|(_, scale)| scale);
        Scales { intensity: of(ColourBy::Intensity), time: of(ColourBy::Time) }
    }

    /// Metadata for the page's script, as JSON.
    fn meta(&self, points: &Points, packed: &Packed, chosen: &[u32], options: &PreviewOptions) -> String {
        let bounds = points.bounds();
        let low = if points.is_empty() { [0.0; 3] } else { bounds.min.to_array() };
        let size = if points.is_empty() { [0.0; 3] } else { bounds.size().to_array() };
        let colour = if options.colour.shown_by(points) { options.colour } else { ColourBy::Height };
        let mut meta = json!({
            "name": options.title.rsplit('/').next(),
            "shown": chosen.len(),
            "low": low,
            "size": size.map(|side| side.max(1e-3)),
            "step": packed.step,
            "spacing": packed.spacing,
            "colour": colour.name(),
            "cut": section::ceiling(points),
        });
        for (way, colouring) in &self.ways {
            meta[way.name()] = entries(colouring, points, chosen, low[2]);
        }
        // The text of a script element must not contain anything that looks like its end.
        meta.to_string().replace('<', "\\u003c")
    }
}

fn entries(colouring: &Colouring, points: &Points, chosen: &[u32], lowest: f64) -> Value {
    match colouring.legend(points, 0) {
        Legend::Bar { low, high, table, .. } => {
            let height = matches!(colouring, Colouring::Ramp { value: ColourBy::Height, .. });
            let shift = if height { lowest } else { 0.0 };
            let [low, high] = [low, high].map(|value| f64::from(value) - shift);
            json!({ "low": low, "high": high, "shift": shift, "ramp": table })
        }
        Legend::Marks { marks, table, .. } => {
            json!({ "low": 0.0, "high": 1.0, "marks": marks, "ramp": table })
        }
        Legend::Nothing => json!({ "own": true }),
        Legend::List { .. } => {
            let entries: Vec<(usize, String, Rgb, u64)> = colouring.names(points, chosen);
            json!({ "entries": entries })
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use vlscan_formats::{AttributeSet, PointRow};
    use vlscan_geom::DVec3;

    fn cloud(n: u32) -> Points {
        let mut points = Points::new(AttributeSet::of(|_| true));
        for i in 0..n {
            let (x, y) = (f64::from(i % 100), f64::from(i / 100));
            let row = PointRow {
                position: DVec3::new(500_000.0 + x, 5_400_000.0 + y, 100.0 + 0.1 * x),
                intensity: i as f32,
                class: 2 + (i % 3) as u8,
                return_number: 1 + (i % 2) as u8,
                leg: (i % 3) as u16,
                channel: (i % 2) as u16,
                time: f64::from(i),
                ..PointRow::default()
            };
            points.push(&row, Some(if i % 2 == 0 { "</script><b>" } else { "8" }));
        }
        points
    }

    fn page(points: &Points, options: &PreviewOptions) -> (Page, String) {
        let mut text = Vec::new();
        let page = write_page(points, options, &mut text).unwrap();
        (page, String::from_utf8(text).unwrap())
    }

    fn meta(text: &str) -> Value {
        let (_, rest) = text.split_once("id=\"meta\">").unwrap();
        serde_json::from_str(rest.split_once("</script>").unwrap().0).unwrap()
    }

    #[test]
    fn a_page_tells_what_it_shows_and_asks_for_nothing() {
        let options = PreviewOptions { title: "<a> & b.laz".to_owned(), ..PreviewOptions::default() };
        let (shown, text) = page(&cloud(1000), &options);
        assert_eq!(shown, Page { shown: 1000, total: 1000 });
        assert!(text.contains("<title>&lt;a&gt; &amp; b.laz · vlscan</title>"));
        assert!(text.contains("1 000 points · 99.00 × 9.00 × 9.90 m"), "{text}");
        assert!(!text.contains("http:") && !text.contains("https:") && !text.contains("{{"));
        let meta = meta(&text);
        assert_eq!(meta["low"], json!([500_000.0, 5_400_000.0, 100.0]));
        assert_eq!(meta["class"]["entries"][0], json!([2, "2 ground", [198, 178, 142], 334]));
        assert_eq!(meta["object"]["entries"][0][1], "</script><b>");
        assert!((meta["height"]["high"].as_f64().unwrap() - 9.9).abs() < 0.2, "{}", meta["height"]);
        assert!(
            meta["intensity"]["marks"].as_array().is_some_and(|marks| marks.len() > 1),
            "{}",
            meta["intensity"]
        );
    }

    #[test]
    fn more_points_than_wanted_are_sampled_and_the_page_says_so() {
        let options = PreviewOptions { max_points: 100, ..PreviewOptions::default() };
        let (shown, text) = page(&cloud(1000), &options);
        assert_eq!(shown, Page { shown: 100, total: 1000 });
        assert!(text.contains("100 of 1 000 points"));
        let classes = meta(&text)["class"]["entries"].as_array().unwrap().len();
        assert_eq!(classes, 3);
        assert_eq!(page(&cloud(1000), &options).1, text, "the same again");
    }

    #[test]
    fn odd_clouds_become_pages() {
        let mut single = Points::default();
        single.push(&PointRow { position: DVec3::new(1e7, -1e7, 1e5), ..PointRow::default() }, None);
        let mut vast = Points::default();
        for i in 0..100 {
            let sign = if i % 2 == 0 { 1e300 } else { -1e300 };
            vast.push(
                &PointRow { position: DVec3::new(sign, f64::from(i), 0.0), ..PointRow::default() },
                None,
            );
        }
        for points in [Points::default(), single, vast] {
            let options = PreviewOptions { colour: ColourBy::Class, ..PreviewOptions::default() };
            let (_, text) = page(&points, &options);
            assert_eq!(meta(&text)["colour"], "height");
        }
    }
}
