//! Forms of new jobs: a flight, a plot or a drive to plan, a recorded flight, a survey, a stand to make, two
//! clouds to compare.

use super::form_body::{FormBody, genuine};
use super::home::encoded;
use super::layout::{form_token, page};
use super::titles::file_title;
use crate::answers::Failure;
use crate::app::{App, Identity, blocking};
use crate::store::{FileKind, Listed, Result as StoreResult, Status, Store, UploadFile};
use axum::Extension;
use axum::extract::{Query, State};
use axum::http::StatusCode;
use axum::response::Response;
use maud::{Markup, html};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Prefix of references of airborne scanners.
const AIRBORNE: &str = "data/scanners_als.xml#";
/// Most files in a list to choose from.
const MAX_CHOICES: usize = 500;
/// The platform of recorded flights that is offered first.
const PLATFORM: &str = "data/platforms.xml#copter_linearpath";
/// Most jobs whose results are offered for comparisons.
const MAX_COMPARED: u32 = 50;
/// Most stands that are offered as scenes.
const MAX_STANDS: u32 = 20;
/// Endings of files that are scenes, areas, clouds.
const SCENES: [&str; 10] = ["obj", "ply", "stl", "gltf", "glb", "tif", "tiff", "vrt", "vox", "vlscene"];
const AREAS: [&str; 4] = ["geojson", "json", "kml", "wkt"];
const CLOUDS: [&str; 10] = ["laz", "las", "ply", "pcd", "e57", "pts", "xyz", "csv", "arrow", "parquet"];
const TRAJECTORIES: [&str; 5] = ["csv", "txt", "out", "sbet", "trj"];
const TABLES: [&str; 3] = ["csv", "txt", "tsv"];
const TERRAINS: [&str; 6] = ["tif", "tiff", "vrt", "obj", "ply", "stl"];

/// True if a scene can be made of the file by itself.
pub fn is_scene(name: &str) -> bool {
    has_ending(name, &SCENES)
}

/// True if the file may be an inventory.
pub fn is_table(name: &str) -> bool {
    has_ending(name, &TABLES)
}

/// True if the file may be a trajectory.
pub fn is_trajectory(name: &str) -> bool {
    has_ending(name, &TRAJECTORIES)
}

/// A file of an owner: the name that requests give it, and what lists call it.
#[derive(Debug)]
struct Named {
    name: String,
    label: String,
    kind: FileKind,
}

/// Files of an owner, newest upload first.
#[derive(Debug, Default)]
struct Files(Vec<Named>);

impl Files {
    fn of(store: &Store, owner: &str) -> StoreResult<Files> {
        let mut files = Vec::new();
        for upload in store.uploads(owner)? {
            let named = |file: UploadFile| {
                let name = format!("{}/{}", upload.name, file.path);
                Named { label: name.clone(), name, kind: file.kind }
            };
            files.extend(store.files(&upload.id)?.into_iter().map(named));
        }
        for job in
            store.jobs(Listed::States, owner, &[Status::Successful], &["stand".to_owned()], 0, MAX_STANDS)?
        {
            let label = file_title(store, &job, "stand")?;
            files.push(Named {
                name: format!("jobs/{}/stand/stand.xml", job.id),
                label,
                kind: FileKind::Scene,
            });
        }
        Ok(Files(files))
    }

    /// Files with these endings.
    fn with(&self, endings: &[&str]) -> Vec<&str> {
        self.chosen(|name, _| has_ending(name, endings)).take(MAX_CHOICES).collect()
    }

    /// Scenes: first XML files that hold one, then geometry.
    fn scenes(&self) -> Vec<&str> {
        let described = self.chosen(|_, kind| kind == FileKind::Scene);
        described.chain(self.chosen(|name, _| has_ending(name, &SCENES))).take(MAX_CHOICES).collect()
    }

    /// The newest upload with a scene, as names of its files begin; empty if there is none.
    fn newest(&self) -> &str {
        let first = self.chosen(|name, kind| kind == FileKind::Scene || has_ending(name, &SCENES)).next();
        first.and_then(|name| name.split_inclusive('/').next()).unwrap_or_default()
    }

    /// Surveys and pipelines.
    fn surveys(&self) -> Vec<&str> {
        let is_survey = |name: &str, kind: FileKind| kind == FileKind::Survey || has_ending(name, &["toml"]);
        self.chosen(is_survey).take(MAX_CHOICES).collect()
    }

    /// Folders that have files with this ending themselves.
    fn folders(&self, ending: &str) -> Vec<&str> {
        let parents =
            self.chosen(|name, _| has_ending(name, &[ending])).filter_map(|name| name.rsplit_once('/'));
        let mut folders: Vec<&str> = parents.map(|(folder, _)| folder).collect();
        folders.dedup();
        folders.truncate(MAX_CHOICES);
        folders
    }

    /// Name of a file or folder in lists.
    fn label<'f>(&'f self, name: &'f str) -> &'f str {
        self.0.iter().find(|file| file.name == name).map_or(name, |file| &file.label)
    }

    /// A list of files to choose from. `first` stands for no file, where none is needed; the first file that
    /// begins with `wanted` is chosen.
    fn choice(&self, name: &str, label: &str, files: &[&str], first: Option<&str>, wanted: &str) -> Markup {
        let chosen = files.iter().position(|file| !wanted.is_empty() && file.starts_with(wanted));
        html! {
            label {
                (label)
                select name=(name) required[first.is_none()] {
                    option value="" { (first.unwrap_or("choose …")) }
                    @for (at, file) in files.iter().enumerate() {
                        option value=(file) selected[chosen == Some(at)] { (self.label(file)) }
                    }
                }
            }
        }
    }

    fn chosen(&self, is_chosen: impl Fn(&str, FileKind) -> bool) -> impl Iterator<Item = &str> {
        self.0.iter().filter(move |file| is_chosen(&file.name, file.kind)).map(|file| file.name.as_str())
    }
}

fn has_ending(name: &str, endings: &[&str]) -> bool {
    name.rsplit_once('.').is_some_and(|(_, end)| endings.iter().any(|known| end.eq_ignore_ascii_case(known)))
}

fn scanners(app: &App, wanted: &str) -> Markup {
    html! {
        label {
            "Instrument"
            select name="scanner" required {
                option value="" { "choose …" }
                @for (label, is_of_group) in [("Airborne", true), ("Terrestrial and mobile", false)] {
                    optgroup label=(label) {
                        @for (number, (reference, scanner)) in app.workshop.program.entries("scanners").enumerate() {
                            @if reference.starts_with(AIRBORNE) == is_of_group {
                                option value=(reference) data-picture=(format!("/instruments/{number}/pattern.svg")) selected[reference == wanted] {
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

/// Kinds of new scans: the kind in addresses, and its name.
const KINDS: [(&str, &str); 6] = [
    ("airborne", "Flight"),
    ("terrestrial", "Tripod"),
    ("mobile", "Drive"),
    ("trajectory", "Recorded flight"),
    ("survey", "Survey file"),
    ("stand", "Trees of an inventory"),
];

/// Values of the fields of a form: those of an address or of a form that is shown again, else the first ones.
struct Values {
    given: BTreeMap<String, String>,
    /// True if fields without a value are empty.
    is_again: bool,
    /// A problem of one of them.
    wrong: String,
}

impl Values {
    fn of<'v>(&'v self, key: &str, first: &'v str) -> &'v str {
        match self.given.get(key) {
            Some(value) => value,
            None if self.is_again => "",
            None => first,
        }
    }

    /// A field for a number, with an example of one.
    fn number(&self, name: &str, label: &str, first: &str, example: &str, unit: &str) -> Markup {
        html! {
            label {
                (label) small { " " (unit) }
                input name=(name) value=(self.of(name, first)) placeholder=(example) inputmode="decimal" size="8";
            }
        }
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
struct Shape {
    field: &'static str,
    kind: &'static str,
    label: &'static str,
    example: &'static str,
}

const SHAPES: [Shape; 3] = [
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
    Shape { field: "around", kind: "point", label: "Centre x,y", example: "0,0" },
];

impl Shape {
    /// The text of a shape with these corners; empty while there are too few.
    fn text(self, corners: &[String]) -> String {
        let all = corners.join(", ");
        match (self.kind, corners) {
            ("polygon", [first, _, _, ..]) => format!("POLYGON (({all}, {first}))"),
            ("line", [_, _, ..]) => format!("LINESTRING ({all})"),
            ("point", [.., last]) => last.replace(' ', ","),
            _ => String::new(),
        }
    }
}

fn map_address(scene: &str) -> String {
    format!("/map.png?scene={}", encoded(scene))
}

pub async fn new(
    State(app): State<Arc<App>>,
    Extension(identity): Extension<Identity>,
    Query(given): Query<BTreeMap<String, String>>,
) -> Result<Response, Failure> {
    let is_again = given.contains_key("again");
    show(&app, &identity, &Values { given, is_again, wrong: String::new() }).await
}

/// Shows a form again, with what is wrong with a field.
pub async fn again(
    app: &Arc<App>,
    identity: &Identity,
    given: BTreeMap<String, String>,
    wrong: &str,
) -> Result<Response, Failure> {
    let mut response =
        show(app, identity, &Values { given, is_again: true, wrong: wrong.to_owned() }).await?;
    *response.status_mut() = StatusCode::BAD_REQUEST;
    Ok(response)
}

/// Shows the form again with one corner more, where the picture of the scene was clicked.
pub async fn corner(
    State(app): State<Arc<App>>,
    Extension(identity): Extension<Identity>,
    form: FormBody,
) -> Result<Response, Failure> {
    let mut given = genuine(&app, &identity, form)?;
    for shape in SHAPES {
        let mut click = |axis: &str| given.remove(&format!("{}.{axis}", shape.field))?.parse::<f64>().ok();
        let (Some(x), Some(y)) = (click("x"), click("y")) else { continue };
        let text = |key: &str| given.get(key).cloned().unwrap_or_default();
        let (scene, mapped) = (text("scene"), text("mapped"));
        // Another scene was chosen since: its picture comes first.
        let is_same = scene == mapped;
        let mut corners: Vec<String> = match is_same && shape.kind != "point" {
            true => text("corners").split(", ").filter(|one| !one.is_empty()).map(str::to_owned).collect(),
            false => Vec::new(),
        };
        if is_same {
            let owner = identity.owner.clone();
            let map = super::map::scene_map(&app, owner, scene).await?;
            let [x, y] = map.frame.place(x, y);
            corners.push(format!("{x} {y}"));
        }
        given.insert(shape.field.to_owned(), shape.text(&corners));
        given.insert("corners".to_owned(), corners.join(", "));
    }
    show(&app, &identity, &Values { given, is_again: true, wrong: String::new() }).await
}

async fn show(app: &Arc<App>, identity: &Identity, values: &Values) -> Result<Response, Failure> {
    let owner = identity.owner.clone();
    let files = blocking(app, move |workshop| Files::of(&workshop.store, &owner)).await?;
    let kind = KINDS.iter().find(|(kind, _)| *kind == values.of("kind", "")).unwrap_or(&KINDS[0]);
    let content = html! {
        h1 { "New scan" }
        @if files.0.is_empty() {
            p .lead { "There are no files yet: " a href="/" { "upload a scene" } " first." }
        }
        nav .kinds aria-label="Kinds of scans" {
            @for (other, name) in KINDS {
                a href=(address(other, values)) aria-current=[(other == kind.0).then_some("page")] { (name) }
            }
        }
        script src="/static/draw.js" defer {}
        @if !values.wrong.is_empty() { pre .message role="alert" { (values.wrong) } }
        section .card aria-labelledby="kind" {
            (form(app, identity, kind.0, &files, values))
        }
    };
    Ok(page(app, identity, kind.1, &content))
}

/// The address of another kind of scan, with what is chosen already.
fn address(kind: &str, values: &Values) -> String {
    let mut address = format!("/new?kind={kind}");
    for key in ["upload", "scene", "scanner"] {
        let value = values.of(key, "");
        if !value.is_empty() {
            address += &format!("&{key}={}", encoded(value));
        }
    }
    address
}

fn form(app: &App, identity: &Identity, kind: &str, files: &Files, values: &Values) -> Markup {
    let (scenes, areas) = (files.scenes(), files.with(&AREAS));
    let wanted = match (values.of("scene", ""), values.of("upload", "")) {
        ("", "") if !values.is_again => files.newest().to_owned(),
        ("", upload) => format!("{upload}/"),
        (scene, _) => scene.to_owned(),
    };
    // The one that the list shows.
    let shown = scenes.iter().find(|name| !wanted.is_empty() && name.starts_with(&wanted));
    let scene = shown.copied().unwrap_or_default();
    let begin = |title: &str| {
        html! {
            h2 #kind { (title) }
            (form_token(app, identity))
            input type="hidden" name="kind" value=(kind);
        }
    };
    let scene_choice = || files.choice("scene", "Scene", &scenes, None, &wanted);
    let named = |key: &str| {
        let given = values.of(key, "");
        if given.is_empty() { wanted.clone() } else { given.to_owned() }
    };
    let [area, along, around] = SHAPES;
    match kind {
        "terrestrial" => html! {
            form method="post" action="/forms/plan" {
                (begin("Tripod positions"))
                (scene_choice())
                (scanners(app, values.of("scanner", "")))
                (values.shape(around, scene))
                div .row {
                    (values.number("radius", "Radius", "10", "10", "m"))
                    (values.number("positions", "Positions on it", "4", "4", ""))
                    (values.number("spacing", "or, instead of centre and radius, spacing of a grid", "", "15", "m"))
                    (values.number("resolution", "Resolution", "0.1", "", "°"))
                }
                (ground(values))
                button type="submit" { "Plan the positions" }
            }
        },
        "mobile" => html! {
            form method="post" action="/forms/plan" {
                (begin("A drive along a line"))
                (scene_choice())
                (scanners(app, values.of("scanner", "")))
                div .row { (values.number("speed", "Speed", "8", "", "m/s")) }
                (ground(values))
                (values.shape(along, scene))
                (files.choice("along_file", "or a file with a line", &areas, Some("none"), values.of("along_file", "")))
                button type="submit" { "Plan the drive" }
            }
        },
        "trajectory" => html! {
            form method="post" action="/forms/trajectory" {
                (begin("A recorded flight or drive"))
                (files.choice("trajectory", "Trajectory", &files.with(&TRAJECTORIES), None, &named("trajectory")))
                (scene_choice())
                (scanners(app, values.of("scanner", "")))
                label {
                    "Platform" small { " tells how the instrument is mounted" }
                    select name="platform" required {
                        @for (reference, _) in app.workshop.program.entries("platforms") {
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
                (super::job::run_fields())
                (actions())
            }
        },
        "survey" => html! {
            form method="post" action="/forms/run" {
                (begin("A survey or pipeline file"))
                (files.choice("file", "File", &files.surveys(), None, &named("file")))
                (super::job::run_fields())
                (actions())
            }
        },
        "stand" => html! {
            form method="post" action="/forms/stand" {
                (begin("Trees of an inventory as a scene"))
                p { small {
                    "A table with the columns x, y and height, and perhaps crown, dbh and species, in English or German, as spreadsheets save it "
                    "(CSV)."
                } }
                (files.choice("inventory", "Inventory", &files.with(&TABLES), None, &named("inventory")))
                (files.choice("terrain", "Terrain", &files.with(&TERRAINS), Some("none"), values.of("terrain", "")))
                (files.choice("trees", "Tree models", &files.folders("obj"), Some("of vlscan"), values.of("trees", "")))
                p { small { "Tree models are OBJ files whose names begin with their species, as beech_1.obj, in a folder." } }
                label .flag { input type="checkbox" name="flat" checked[!values.of("flat", "on").is_empty()]; " Flat ground, unless a terrain is chosen" }
                button type="submit" { "Make the scene" }
            }
        },
        _ => html! {
            form method="post" action="/forms/plan" {
                (begin("A flight over a scene"))
                (scene_choice())
                (scanners(app, values.of("scanner", "")))
                div .row {
                    (values.number("height", "Height above ground", "80", "", "m"))
                    (values.number("density", "Density", "10", "", "pulses per m²"))
                    (values.number("overlap", "Overlap", "30", "", "%"))
                    (values.number("speed", "Speed, instead of one of them", "", "8", "m/s"))
                }
                div .row { (values.number("pulse_rate", "Pulse rate", "", "the instrument's", "Hz")) }
                (values.shape(area, scene))
                p { small { "Without an area the whole scene is flown." } }
                (files.choice("area_file", "or a file with an area", &areas, Some("none"), values.of("area_file", "")))
                label .flag { input type="checkbox" name="follow_terrain" checked[!values.of("follow_terrain", "").is_empty()]; " Follow the terrain" }
                button type="submit" { "Plan the flight" }
            }
        },
    }
}

/// The ground, where the scene has no terrain.
fn ground(values: &Values) -> Markup {
    html! {
        div .row { (values.number("ground", "Height of level ground", "", "0", "m")) }
        p { small { "Only for scenes without terrain, such as the mesh of a house: rasters are terrain, and meshes whose materials are ground." } }
    }
}

fn actions() -> Markup {
    html! {
        div .row {
            button type="submit" name="action" value="dry-run" { "Forecast" }
            button type="submit" name="action" value="run" { "Run" }
        }
    }
}

pub async fn compare(
    State(app): State<Arc<App>>,
    Extension(identity): Extension<Identity>,
    Query(query): Query<BTreeMap<String, String>>,
) -> Result<Response, Failure> {
    let owner = identity.owner.clone();
    let files = blocking(&app, move |workshop| -> StoreResult<_> {
        let store = &workshop.store;
        let mut files = Files::of(store, &owner)?;
        let mut results = Vec::new();
        let processes = ["run", "preview"].map(str::to_owned);
        for job in store.jobs(Listed::Results, &owner, &[Status::Successful], &processes, 0, MAX_COMPARED)? {
            for file in job.result_files().iter().filter(|file| has_ending(&file.path, &CLOUDS)) {
                let label = file_title(store, &job, &file.path)?;
                results.push(Named {
                    name: format!("jobs/{}/{}", job.id, file.path),
                    label,
                    kind: FileKind::Other,
                });
            }
        }
        results.append(&mut files.0);
        Ok(Files(results))
    })
    .await?;
    let clouds = files.with(&CLOUDS);
    let asked = |key: &str| query.get(key).map(String::as_str).unwrap_or_default();
    let content = html! {
        h1 { "Compare two clouds" }
        @if clouds.len() < 2 { p .lead { "This needs two clouds: upload one, or run a scan." } }
        form .card method="post" action="/forms/compare" {
            (form_token(&app, &identity))
            (files.choice("first", "First cloud, usually the measured one", &clouds, None, asked("first")))
            (files.choice("second", "Second cloud, usually the simulated one", &clouds, None, asked("second")))
            button type="submit" { "Compare" }
        }
    };
    Ok(page(&app, &identity, "Compare", &content))
}
