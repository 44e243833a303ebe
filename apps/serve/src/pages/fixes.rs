//! Problems of plans: the field of the form that each belongs to, and values that solve it.

use super::form_body::Fields;
use super::layout::form_token;
use super::plan_fields::{FieldError, field_of_message, in_words_of_the_page};
use crate::app::{App, Identity};
use crate::terms::Terms;
use maud::{Markup, html};

/// A problem of a form.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Problem {
    /// The message.
    pub text: String,
    /// Name of the field, if the problem belongs to one.
    pub field: Option<&'static str>,
    /// Values that solve it.
    pub fixes: Vec<Fix>,
}

/// A value of a field that solves a problem.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Fix {
    /// Label of its button.
    label: String,
    field: &'static str,
    value: String,
}

/// Heights that a form offers first, m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Usual {
    /// Height of level ground below the scene.
    pub level: f64,
    /// Height of a flight above the ground, for the instrument.
    pub flight: f64,
}

impl Problem {
    /// A slip in the fields of a form.
    pub fn of_fields(error: &FieldError) -> Problem {
        Problem { text: error.to_string(), field: error.field(), fixes: Vec::new() }
    }

    /// A request that was refused.
    pub fn of_request(message: &str) -> Problem {
        Problem { text: message.to_owned(), ..Problem::default() }
    }

    /// The failure of a plan with these fields.
    pub fn of_plan(message: &str, fields: &Fields, usual: Usual) -> Problem {
        // Jobs of earlier versions have messages with options in place of inputs.
        let message = &Terms::Inputs.message(message);
        let fixes = fixes(message, fields, usual);
        let is_of_height = message.contains("fly higher") || message.contains("fly lower");
        let field = match fixes.first() {
            Some(fix) if !is_of_height => Some(fix.field),
            _ if is_of_height => Some("height"),
            _ => field_of_message(message),
        };
        // The help is in the message above the form.
        let first = message.lines().next().unwrap_or_default();
        let text = in_words_of_the_page(first.trim_start_matches("error: "));
        Problem { text, field, fixes }
    }
}

/// Values that solve the problem of a message.
fn fixes(message: &str, fields: &Fields, Usual { level, flight }: Usual) -> Vec<Fix> {
    let given = |key: &str| fields.get(key).and_then(|text| text.parse::<f64>().ok());
    let mut found = Vec::new();
    let mut add = |label: String, field: &'static str, value: String| found.push(Fix { label, field, value });
    let height = if message.contains("fly higher") {
        let above =
            number_after(message, "fly higher than ").or_else(|| number_after(message, "measures from "));
        above.map(|above| ((above + 1.0) / 10.0).ceil() * 10.0)
    } else if message.contains("fly lower") {
        let lower = |below: f64| (below * 0.07).floor() * 10.0;
        // From how far an instrument detects ground is known only for its usual height.
        let usual = || given("height").map(|given| if flight < given { flight } else { lower(given) });
        let height = number_after(message, "measures up to ").map(lower).or_else(usual);
        height.filter(|height| *height > 0.0)
    } else {
        None
    };
    if let Some(height) = height {
        add(format!("Fly at {height} m"), "height", height.to_string());
    }
    if message.contains("`follow_terrain`") {
        add("Follow the terrain".to_owned(), "follow_terrain", "on".to_owned());
    }
    if message.contains("`ground`") {
        add(format!("Level ground at {level} m"), "ground", level.to_string());
    }
    // The last number is the possible one.
    let possible = message.rsplit_once("at most ").and_then(|(_, rest)| first_number(rest));
    if let Some(possible) = possible.filter(|_| message.contains("° is possible")) {
        add(format!("Resolution {possible}°"), "resolution", possible.to_string());
    }
    if let Some(spacing) = given("spacing").filter(|_| message.contains("smaller `spacing`")) {
        let half = spacing / 2.0;
        add(format!("Spacing {half} m"), "spacing", half.to_string());
    }
    if let Some(density) = number_after(message, "one strip has ") {
        let density = (density * 10.0).ceil() / 10.0;
        add(format!("Density {density} pulses per m²"), "density", density.to_string());
    }
    found
}

/// The number that follows words in a message.
fn number_after(text: &str, words: &str) -> Option<f64> {
    text.split_once(words).and_then(|(_, rest)| first_number(rest))
}

/// The number that a text begins with.
fn first_number(text: &str) -> Option<f64> {
    let end = text.find(|c: char| !c.is_ascii_digit() && c != '.').unwrap_or(text.len());
    text[..end].trim_end_matches('.').parse().ok()
}

/// Buttons that plan again with a value that solves the problem.
pub fn buttons(app: &App, identity: &Identity, problem: &Problem, fields: &Fields) -> Markup {
    html! {
        @if !problem.fixes.is_empty() {
            div .views {
                @for fix in &problem.fixes {
                    form .inline method="post" action="/forms/plan" {
                        (form_token(app, identity))
                        @for (key, value) in fields.iter().filter(|(key, _)| key.as_str() != fix.field) {
                            input type="hidden" name=(key) value=(value);
                        }
                        input type="hidden" name=(fix.field) value=(fix.value);
                        button type="submit" { (fix.label) }
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn problem(message: &str) -> (Option<&'static str>, Vec<String>) {
        let fields = [("height", "80"), ("spacing", "40")];
        let fields = fields.map(|(key, value)| (key.to_owned(), value.to_owned())).into_iter().collect();
        let problem = Problem::of_plan(message, &fields, Usual { level: 2.5, flight: 70.0 });
        let fixes = problem.fixes.iter().map(|fix| format!("{}: {}={}", fix.label, fix.field, fix.value));
        (problem.field, fixes.collect())
    }

    #[test]
    fn messages_of_plans_belong_to_fields_and_have_fixes() {
        for (message, field, fixes) in [
            (
                "error: the ground is 80 m away, but A measures from 100 m; fly higher than 116 m",
                Some("height"),
                &["Fly at 120 m: height=120"][..],
            ),
            (
                "error: the ground is 60 m away at the highest place, 20 m above the mean ground, but A measures from 70 m; \
                 fly higher than 91 m, or keep the height above the ground with --follow-terrain",
                Some("height"),
                &["Fly at 100 m: height=100", "Follow the terrain: follow_terrain=on"],
            ),
            (
                "error: the ground is 80 m away, but A measures up to 60 m only; fly lower",
                Some("height"),
                &["Fly at 40 m: height=40"],
            ),
            (
                "error: the ground is 80 m away, where A does not detect ground that reflects 50 %; fly lower, or lower the pulse rate",
                Some("height"),
                &["Fly at 70 m: height=70"],
            ),
            (
                "error: --scene a.obj: none of its materials is ground\nhelp: give the height of level ground with --ground",
                Some("ground"),
                &["Level ground at 2.5 m: ground=2.5"],
            ),
            (
                "error: 0.01: the head would turn at 0.5°/s, and that of A at most at 60°/s; at most 0.02° is possible",
                Some("resolution"),
                &["Resolution 0.02°: resolution=0.02"],
            ),
            (
                "error: no position is inside the area; choose a smaller --spacing",
                Some("spacing"),
                &["Spacing 20 m: spacing=20"],
            ),
            (
                "error: `scene` a.obj: none of its materials is ground\nhelp: give the height of level ground with `ground`",
                Some("ground"),
                &["Level ground at 2.5 m: ground=2.5"],
            ),
            (
                "error: no position is inside the area; choose a smaller `spacing`",
                Some("spacing"),
                &["Spacing 20 m: spacing=20"],
            ),
            (
                "error: the ground is 60 m away, but A measures from 70 m; fly higher than 91 m, or keep the height above the ground \
                 with `follow_terrain`",
                Some("height"),
                &["Fly at 100 m: height=100", "Follow the terrain: follow_terrain=on"],
            ),
            (
                "error: at 5 m/s one strip has 12.34 pulses/m² already, more than 4; increase --height or --speed",
                Some("density"),
                &["Density 12.4 pulses per m²: density=12.4"],
            ),
            (
                "error: the speed would be 0 m/s; change --density, --pulse-rate or --height",
                Some("density"),
                &[],
            ),
            ("error: something else", None, &[]),
        ] {
            let (found, all) = problem(message);
            assert_eq!(found, field, "{message}");
            assert_eq!(all, fixes, "{message}");
        }
    }

    #[test]
    fn messages_at_fields_have_words_of_the_page() {
        let usual = Usual { level: 0.0, flight: 80.0 };
        let problem = Problem::of_plan("error: change --density\nhelp: or not", &Fields::new(), usual);
        assert_eq!(problem.text, "change Density");
    }
}
