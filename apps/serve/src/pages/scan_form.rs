//! Forms of new scans, by their kind.

use super::choices::{AREAS, Files, TABLES, TERRAINS, TRAJECTORIES, run_fields};
use super::fixes::Problem;
use super::home::encoded;
use super::layout::form_token;
use crate::app::{App, Identity};
use maud::{Markup, html};
use serde_json::Value;
use std::collections::BTreeMap;

/// Prefix of references of airborne scanners.
const AIRBORNE: &str = "data/scanners_als.xml#";
/// Height of a flight above the ground that is offered first, m.
const HEIGHT: f64 = 80.0;
/// The platform of recorded flights that is offered first.
const PLATFORM: &str = "data/platforms.xml#copter_linearpath";

/// The form of a kind of scan.
/// `level` is where level ground would be, m, of a scene without ground.
pub(super) fn form(
    app: &App,
    identity: &Identity,
    kind: &str,
    files: &Files,
    values: &Values,
    level: Option<f64>,
) -> Markup {
    let scenes = files.scenes();
    let wanted = first_scene(files, values);
    let scene = shown_scene(files, values);
    let form = Form { app, identity, kind, files, values, scenes, scene, wanted, level };
    match kind {
        "terrestrial" => form.terrestrial(),
        "mobile" => form.mobile(),
        "trajectory" => form.trajectory(),
        "survey" => form.survey(),
        "stand" => form.stand(),
        _ => form.airborne(),
    }
}

/// Beginning of the name of the scene that is chosen first; empty for none.
fn first_scene(files: &Files, values: &Values) -> String {
    match (values.of("scene", ""), values.of("upload", "")) {
        ("", "") if !values.is_again => files.newest().to_owned(),
        ("", upload) => format!("{upload}/"),
        (scene, _) => scene.to_owned(),
    }
}

/// The scene that the list of a form shows; empty if there is none.
pub(super) fn shown_scene<'f>(files: &'f Files, values: &Values) -> &'f str {
    let wanted = first_scene(files, values);
    let is_first = |name: &&str| !wanted.is_empty() && name.starts_with(&wanted);
    files.scenes().into_iter().find(is_first).unwrap_or_default()
}

/// Common parts of the forms of all kinds.
struct Form<'f> {
    app: &'f App,
    identity: &'f Identity,
    kind: &'f str,
    files: &'f Files,
    values: &'f Values,
    scenes: Vec<&'f str>,
    /// The scene that the list shows; empty if there is none.
    scene: &'f str,
    /// Beginning of the names of files that are chosen first; empty for none.
    wanted: String,
    /// Height of level ground, m, of a scene without ground.
    level: Option<f64>,
}

impl Form<'_> {
    fn begin(&self, title: &str) -> Markup {
        html! {
            h2 #kind { (title) }
            (form_token(self.app, self.identity))
            input type="hidden" name="kind" value=(self.kind);
        }
    }

    fn scene_choice(&self) -> Markup {
        let choice = self.files.choice("scene", "Scene", &self.scenes, None, &self.wanted);
        self.values.with_problem("scene", &choice)
    }

    fn scanners(&self) -> Markup {
        let is_airborne = matches!(self.kind, "airborne" | "trajectory");
        let choice = scanners(self.app, self.values.of("scanner", ""), is_airborne);
        self.values.with_problem("scanner", &choice)
    }

    /// Height of level ground, where the scene has no terrain.
    fn ground(&self) -> Markup {
        let level = self.level.map(|level| level.to_string()).unwrap_or_default();
        html! {
            div .row { (self.values.number("ground", "Height of level ground", &level, "0", "m")) }
            p { small { "Only for scenes without terrain, such as the mesh of a house: rasters are terrain, and meshes whose materials are ground." } }
        }
    }

    /// Beginning of the name of the file that is chosen first in a list.
    fn first_choice(&self, key: &str) -> String {
        let given = self.values.of(key, "");
        if given.is_empty() { self.wanted.clone() } else { given.to_owned() }
    }

    /// A flight over a scene.
    fn airborne(&self) -> Markup {
        let values = self.values;
        let areas = self.files.with(&AREAS);
        let [area, ..] = SHAPES;
        let height = height_for(self.app, values.of("scanner", "")).to_string();
        html! {
            form method="post" action="/forms/plan" {
                (self.begin("A flight over a scene"))
                (self.scene_choice())
                (self.scanners())
                div .row {
                    (values.number("height", "Height above ground", &height, "", "m"))
                    (values.number("density", "Density", "10", "", "pulses per m²"))
                    (values.number("overlap", "Overlap", "30", "", "%"))
                    (values.number("speed", "Speed, instead of one of them", "", "8", "m/s"))
                }
                div .row { (values.number("pulse_rate", "Pulse rate", "", "the instrument's", "Hz")) }
                (values.with_problem("area", &values.shape(area, self.scene)))
                p { small { "Without an area the whole scene is flown." } }
                (self.files.choice("area_file", "or a file with an area", &areas, Some("none"), values.of("area_file", "")))
                label .flag { input type="checkbox" name="follow_terrain" checked[!values.of("follow_terrain", "").is_empty()]; " Follow the terrain" }
                button type="submit" { "Plan the flight" }
            }
        }
    }

    /// Positions of a tripod.
    fn terrestrial(&self) -> Markup {
        let values = self.values;
        let [.., at] = SHAPES;
        let is_other = ["around", "spacing"].iter().any(|key| !values.of(key, "").is_empty());
        html! {
            form method="post" action="/forms/plan" {
                (self.begin("Tripod positions"))
                (self.scene_choice())
                (self.scanners())
                (values.with_problem("at", &values.shape(at, self.scene)))
                details open[is_other] {
                    summary { "On a circle or a grid instead" }
                    div .row {
                        (values.with_problem("around", &html! {
                            label { "Centre x,y" input name="around" value=(values.of("around", "")) placeholder="0,0" autocomplete="off"; }
                        }))
                        (values.number("radius", "Radius", "10", "10", "m"))
                        (values.number("positions", "Positions on it", "4", "4", ""))
                        (values.number("spacing", "Spacing of a grid", "", "15", "m"))
                    }
                }
                div .row { (values.number("resolution", "Resolution", "0.1", "", "°")) }
                (self.ground())
                button type="submit" { "Plan the positions" }
            }
        }
    }

    /// A drive along a line.
    fn mobile(&self) -> Markup {
        let values = self.values;
        let areas = self.files.with(&AREAS);
        let [_, along, _] = SHAPES;
        html! {
            form method="post" action="/forms/plan" {
                (self.begin("A drive along a line"))
                (self.scene_choice())
                (self.scanners())
                div .row { (values.number("speed", "Speed", "8", "", "m/s")) }
                (self.ground())
                (values.with_problem("along", &values.shape(along, self.scene)))
                (self.files.choice("along_file", "or a file with a line", &areas, Some("none"), values.of("along_file", "")))
                button type="submit" { "Plan the drive" }
            }
        }
    }

    /// A recorded flight or drive.
    fn trajectory(&self) -> Markup {
        let values = self.values;
        html! {
            form method="post" action="/forms/trajectory" {
                (self.begin("A recorded flight or drive"))
                (self.files.choice("trajectory", "Trajectory", &self.files.with(&TRAJECTORIES), None, &self.first_choice("trajectory")))
                (self.scene_choice())
                (self.scanners())
                label {
                    "Platform" small { " tells how the instrument is mounted" }
                    select name="platform" required {
                        @for (reference, _) in self.app.workshop.program.entries("platforms") {
                            option value=(reference) selected[reference == values.of("platform", PLATFORM)] { (reference.rsplit('#').next().unwrap_or(reference)) }
                        }
                    }
                }
                div .row {
                    (values.number("pulse_freq_hz", "Pulse rate", "100000", "", "Hz"))
                    (values.number("scan_freq_hz", "Scan frequency", "50", "", "Hz"))
                    label {
                        "UTM zone" small { " of latitudes and longitudes" }
                        input name="utm_zone" value=(values.of("utm_zone", "")) placeholder="32N" autocomplete="off" size="8";
                    }
                }
                (run_fields())
                (actions())
            }
        }
    }

    /// A survey or pipeline file.
    fn survey(&self) -> Markup {
        html! {
            form method="post" action="/forms/run" {
                (self.begin("A survey or pipeline file"))
                (self.files.choice("file", "File", &self.files.surveys(), None, &self.first_choice("file")))
                (run_fields())
                (actions())
            }
        }
    }

    /// A scene of the trees of an inventory.
    fn stand(&self) -> Markup {
        let values = self.values;
        html! {
            form method="post" action="/forms/stand" {
                (self.begin("Trees of an inventory as a scene"))
                p { small {
                    "A table with the columns x, y and height, and perhaps crown, dbh and species, in English or German, as spreadsheets save it "
                    "(CSV)."
                } }
                (self.files.choice("inventory", "Inventory", &self.files.with(&TABLES), None, &self.first_choice("inventory")))
                (self.files.choice("terrain", "Terrain", &self.files.with(&TERRAINS), Some("none"), values.of("terrain", "")))
                (self.files.choice("trees", "Tree models", &self.files.folders("obj"), Some("of vlscan"), values.of("trees", "")))
                p { small { "Tree models are OBJ files whose names begin with their species, as beech_1.obj, in a folder." } }
                label .flag { input type="checkbox" name="flat" checked[!values.of("flat", "on").is_empty()]; " Flat ground, unless a terrain is chosen" }
                button type="submit" { "Make the scene" }
            }
        }
    }
}

/// The first height of a flight, m, within the range of an instrument.
fn first_height(scanner: &Value) -> f64 {
    let [near, far] = [&scanner["range_min_m"], &scanner["range_max_m"]].map(Value::as_f64);
    // To the sides of the flight the ground is farther away, and hills are nearer.
    let least = (near.unwrap_or(0.0) * 1.25 / 10.0).ceil() * 10.0;
    let most = far.map_or(f64::INFINITY, |far| (far * 0.5 / 5.0).floor() * 5.0);
    HEIGHT.max(least).min(most).max(1.0)
}

/// The first height of a flight for an instrument by its reference, m.
pub(super) fn height_for(app: &App, wanted: &str) -> f64 {
    let known = app.workshop.program.entries("scanners").find(|(reference, _)| *reference == wanted);
    known.map_or(HEIGHT, |(_, scanner)| first_height(scanner))
}

fn scanners(app: &App, wanted: &str, is_airborne: bool) -> Markup {
    let mut groups = [("Airborne", true), ("Terrestrial and mobile", false)];
    // The usual ones of a kind of scan come first.
    if !is_airborne {
        groups.reverse();
    }
    html! {
        label {
            "Instrument"
            select name="scanner" required {
                option value="" { "choose …" }
                @for (label, is_of_group) in groups {
                    optgroup label=(label) {
                        @for (number, (reference, scanner)) in app.workshop.program.entries("scanners").enumerate() {
                            @if reference.starts_with(AIRBORNE) == is_of_group {
                                option value=(reference) data-picture=(format!("/instruments/{number}/pattern.svg")) data-height=(first_height(scanner).to_string()) selected[reference == wanted] {
                                    (scanner["name"].as_str().filter(|name| !name.is_empty()).unwrap_or(reference)) " (" (reference.rsplit('#').next().unwrap_or(reference)) ")"
                                }
                            }
                        }
                    }
                }
            }
        }
        img #instrument .pattern hidden alt="";
        p { small { a href="/instruments" { "All instruments with their pictures and figures" } } }
    }
}

/// Values of the fields of a form: those of an address or of a form that is shown again, else the first ones.
pub(super) struct Values {
    pub given: BTreeMap<String, String>,
    /// True if fields without a value are empty.
    pub is_again: bool,
    /// A problem of one of them.
    pub problem: Option<Problem>,
}

impl Values {
    /// The value of a field; `first` if the form is shown for the first time.
    pub fn of<'v>(&'v self, key: &str, first: &'v str) -> &'v str {
        match self.given.get(key) {
            Some(value) => value,
            None if self.is_again => "",
            None => first,
        }
    }

    /// The message of the problem of a field.
    fn problem_of(&self, field: &str) -> Option<&str> {
        self.problem
            .as_ref()
            .filter(|problem| problem.field == Some(field))
            .map(|problem| problem.text.as_str())
    }

    /// Fields with the message of their problem.
    fn with_problem(&self, field: &str, fields: &Markup) -> Markup {
        html! {
            @if let Some(text) = self.problem_of(field) {
                div .wrong { (fields) p #wrong .problem { (text) } }
            } @else { (fields) }
        }
    }

    /// A field for a number, with an example of one.
    fn number(&self, name: &str, label: &str, first: &str, example: &str, unit: &str) -> Markup {
        let is_wrong = self.problem_of(name).is_some();
        let field = html! {
            label {
                (label) small { " " (unit) }
                input name=(name) value=(self.of(name, first)) placeholder=(example) inputmode="decimal" size="8"
                    aria-invalid=[is_wrong.then_some("true")] aria-describedby=[is_wrong.then_some("wrong")];
            }
        };
        self.with_problem(name, &field)
    }

    /// A field for a shape as text, which a script has drawn on the scene; without scripts a click on the
    /// picture adds a corner.
    fn shape(&self, shape: Shape, scene: &str) -> Markup {
        let Shape { field, kind, example, .. } = shape;
        let text = self.of(field, "");
        let corners = self.of("corners", "");
        html! {
            div .map data-shape=(kind) data-field=(field) hidden {}
            @if !scene.is_empty() {
                noscript {
                    p { "A click on the scene adds a corner" @if corners.is_empty() { "." } @else { ": " (corners) } }
                    input type="hidden" name="corners" value=(corners);
                    input type="hidden" name="mapped" value=(scene);
                    div .wide {
                        input type="image" name=(field) src=(map_address(scene)) alt="The scene from above: add a corner" formaction="/forms/corner" formnovalidate;
                    }
                }
            }
            label {
                (shape.label) small { " as text" }
                textarea name=(field) rows="2" placeholder=(example) { (text) }
            }
        }
    }
}

/// A shape that is drawn on a scene.
#[derive(Clone, Copy)]
pub(super) struct Shape {
    pub field: &'static str,
    pub kind: &'static str,
    label: &'static str,
    example: &'static str,
}

pub(super) const SHAPES: [Shape; 3] = [
    Shape {
        field: "area",
        kind: "polygon",
        label: "Area (WKT or GeoJSON)",
        example: "POLYGON ((0 0, 100 0, 100 100, 0 100))",
    },
    Shape {
        field: "along",
        kind: "line",
        label: "Line (WKT or GeoJSON)",
        example: "LINESTRING (0 0, 50 0, 80 40)",
    },
    Shape { field: "at", kind: "points", label: "Places of the tripod, x,y in each line", example: "0,0" },
];

impl Shape {
    /// The text of a shape with these corners; empty while there are too few.
    pub fn text(self, corners: &[String]) -> String {
        let all = corners.join(", ");
        match (self.kind, corners) {
            ("polygon", [first, _, _, ..]) => format!("POLYGON (({all}, {first}))"),
            ("line", [_, _, ..]) => format!("LINESTRING ({all})"),
            ("points", [_, ..]) => {
                corners.iter().map(|at| at.replace(' ', ",")).collect::<Vec<_>>().join("\n")
            }
            _ => String::new(),
        }
    }
}

fn map_address(scene: &str) -> String {
    format!("/map.png?scene={}", encoded(scene))
}

fn actions() -> Markup {
    html! {
        div .row {
            button type="submit" name="action" value="run" { "Run" }
            button .quiet type="submit" name="action" value="dry-run" { "Forecast" }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn the_first_height_is_within_the_range() {
        for (near, far, expected) in
            [(json!(5), json!(1000), 80.0), (json!(100), json!(null), 130.0), (json!(0.5), json!(50), 25.0)]
        {
            let scanner = json!({ "range_min_m": near, "range_max_m": far });
            assert_eq!(first_height(&scanner), expected, "{scanner}");
        }
    }
}
