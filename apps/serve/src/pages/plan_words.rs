//! A plan in words, and its figures.

use super::plan_fields::in_words_of_the_page;
use super::titles::instrument;
use crate::program::Program;
use maud::{Markup, html};
use serde_json::{Map, Value};

/// Formulas in front of figures, which the page leaves out.
const FORMULAS: [&str; 7] = ["1 − S/W = ", "N/(v·S) = ", "W·f/N = ", "v/f = ", "R·Δ = ", "W = ", "N = "];

/// A plan in words and figures: `inputs` are those of its request, `document` is its file.
pub fn plan(program: &Program, inputs: &Map<String, Value>, document: &str) -> Markup {
    let rows = figures(document);
    html! {
        p .lead { (in_words(program, inputs)) }
        @for (_, value) in rows.iter().filter(|(name, _)| name.is_empty()) { p { (value) } }
        table .figures { tbody {
            @for (name, value) in rows.iter().filter(|(name, _)| !name.is_empty()) {
                tr { th scope="row" { (name) } td { (value) } }
            }
        } }
    }
}

/// The request for a plan as a sentence.
fn in_words(program: &Program, inputs: &Map<String, Value>) -> String {
    let text = |key: &str| inputs.get(key).and_then(Value::as_str);
    let number = |key: &str| inputs.get(key).filter(|value| value.is_number()).map(Value::to_string);
    let with = text("scanner").map(|scanner| format!(" with the {}", instrument(program, scanner)));
    let mut parts = vec![
        match text("kind") {
            Some("terrestrial") if inputs.contains_key("at") => {
                let count = inputs["at"].as_array().map_or(1, Vec::len);
                format!("{count} tripod {}", if count == 1 { "position" } else { "positions" })
            }
            Some("terrestrial") => match (number("spacing"), number("radius"), text("around")) {
                (Some(spacing), ..) => format!("Tripod positions every {spacing} m"),
                (_, Some(radius), Some(around)) => {
                    let count = number("positions").unwrap_or_else(|| "4".to_owned());
                    format!("{count} tripod positions {radius} m around {around}")
                }
                _ => "Tripod positions".to_owned(),
            },
            Some("mobile") => "A drive along a line".to_owned(),
            _ => match number("height") {
                Some(height) => format!("A flight {height} m above the ground"),
                None => "A flight".to_owned(),
            },
        } + &with.unwrap_or_default(),
    ];
    parts.extend(number("density").map(|density| format!("{density} pulses per m²")));
    parts.extend(number("overlap").map(|overlap| format!("lines that overlap by {overlap} %")));
    parts.extend(number("speed").map(|speed| format!("{speed} m/s")));
    parts.extend(number("resolution").map(|resolution| format!("a point every {resolution}°")));
    if inputs.get("follow_terrain").is_some_and(|follows| *follows == true) {
        parts.push("following the terrain".to_owned());
    }
    parts.join(", ") + "."
}

/// Names and values of the comments at the start of a plan, without its command and its warnings, which have
/// places of their own on the page. Sentences have no name.
fn figures(document: &str) -> Vec<(String, String)> {
    let lines = document.lines().take_while(|line| line.starts_with('#') || line.is_empty());
    let lines = lines.map(|line| line.trim_start_matches('#').trim());
    let is_figure =
        |line: &&str| !line.is_empty() && !line.starts_with("vlscan plan") && !line.starts_with("warning:");
    lines.filter(is_figure).map(figure).collect()
}

fn figure(line: &str) -> (String, String) {
    let (name, value) = match line.split_once("  ") {
        Some((name, value)) if !name.contains(' ') => (name, value.trim()),
        _ => ("", line),
    };
    let mut letters = name.chars();
    let name: Option<String> = letters.next().map(|first| first.to_uppercase().chain(letters).collect());
    (
        name.unwrap_or_default(),
        in_words_of_the_page(
            &FORMULAS.iter().fold(value.to_owned(), |text, formula| text.replace(formula, "")),
        ),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;
    use std::path::PathBuf;

    fn program() -> Program {
        let scanners = json!([{ "reference": "data/scanners_als.xml#a1", "name": "Scanner A" }]);
        Program {
            path: PathBuf::new(),
            version: String::new(),
            pipeline: Value::Null,
            commands: Value::Null,
            catalogue: json!({ "scanners": scanners }),
        }
    }

    #[test]
    fn figures_have_names_and_no_formulas() {
        let document = "# vlscan plan airborne --height 60\n#\n# A over 1 ha, 60 m above the ground\n\
                        # duration   2 min\n# spacing    v/f = 0.800 m along, W·f/N = 0.900 m across\n\
                        # rate       50 kHz; a higher --pulse-rate flies faster\n# ground     N = 2 k of 3 k pulses\n# warning: too low\n\nscene = 1\n# later  no";
        let expected = [
            ("", "A over 1 ha, 60 m above the ground"),
            ("Duration", "2 min"),
            ("Spacing", "0.800 m along, 0.900 m across"),
            ("Rate", "50 kHz; a higher Pulse rate flies faster"),
            ("Ground", "2 k of 3 k pulses"),
        ];
        assert_eq!(figures(document), expected.map(|(name, value)| (name.to_owned(), value.to_owned())));
    }

    #[test]
    fn requests_are_sentences() {
        let said = |inputs: Value| in_words(&program(), inputs.as_object().unwrap());
        assert_eq!(
            said(
                json!({ "kind": "airborne", "scanner": "data/scanners_als.xml#a1", "height": 60, "density": 4, "overlap": 30,
                "follow_terrain": true })
            ),
            "A flight 60 m above the ground with the Scanner A, 4 pulses per m², lines that overlap by 30 %, following the terrain."
        );
        assert_eq!(
            said(
                json!({ "kind": "terrestrial", "scanner": "b2", "around": "1,2", "radius": 10, "positions": 3, "resolution": 0.1 })
            ),
            "3 tripod positions 10 m around 1,2 with the b2, a point every 0.1°."
        );
        let places = json!({ "kind": "terrestrial", "at": ["1,2", "3,4"] });
        assert_eq!(said(places), "2 tripod positions.");
        assert_eq!(said(json!({ "kind": "mobile", "speed": 8 })), "A drive along a line, 8 m/s.");
    }
}
