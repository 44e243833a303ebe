//! Forms of new jobs: a survey to fly, a flight, a plot or a drive to plan, two clouds to compare.

use super::layout::{form_token, page};
use crate::answers::Failure;
use crate::app::{App, Identity, blocking};
use crate::store::{FileKind, Result as StoreResult, Status, Store, UploadFile};
use axum::Extension;
use axum::extract::{Query, State};
use axum::response::Response;
use maud::{Markup, html};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Most files in a list to choose from.
const MAX_CHOICES: usize = 500;
/// Endings of files that are scenes, areas, clouds.
const SCENES: [&str; 10] = ["obj", "ply", "stl", "gltf", "glb", "tif", "tiff", "vrt", "vox", "vlscene"];
const AREAS: [&str; 4] = ["geojson", "json", "kml", "wkt"];
const CLOUDS: [&str; 10] = ["laz", "las", "ply", "pcd", "e57", "pts", "xyz", "csv", "arrow", "parquet"];

/// Files of an owner by the names that requests give them, newest upload first.
#[derive(Debug, Default)]
struct Files(Vec<(String, FileKind)>);

impl Files {
    fn of(store: &Store, owner: &str) -> StoreResult<Files> {
        let mut files = Vec::new();
        for upload in store.uploads(owner)? {
            let named = |file: UploadFile| (format!("{}/{}", upload.name, file.path), file.kind);
            files.extend(store.files(&upload.id)?.into_iter().map(named));
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

    /// Surveys and pipelines.
    fn surveys(&self) -> Vec<&str> {
        let is_survey = |name: &str, kind: FileKind| kind == FileKind::Survey || has_ending(name, &["toml"]);
        self.chosen(is_survey).take(MAX_CHOICES).collect()
    }

    fn chosen(&self, is_chosen: impl Fn(&str, FileKind) -> bool) -> impl Iterator<Item = &str> {
        self.0.iter().filter(move |(name, kind)| is_chosen(name, *kind)).map(|(name, _)| name.as_str())
    }
}

fn has_ending(name: &str, endings: &[&str]) -> bool {
    name.rsplit_once('.').is_some_and(|(_, end)| endings.iter().any(|known| end.eq_ignore_ascii_case(known)))
}

/// A list of files to choose from. `first` stands for no file, where none is needed; the first file that begins with `wanted` is
/// chosen.
fn choice(name: &str, label: &str, files: &[&str], first: Option<&str>, wanted: &str) -> Markup {
    let chosen = files.iter().position(|file| !wanted.is_empty() && file.starts_with(wanted));
    html! {
        label {
            (label)
            select name=(name) required[first.is_none()] {
                option value="" { (first.unwrap_or("choose …")) }
                @for (at, file) in files.iter().enumerate() {
                    option value=(file) selected[chosen == Some(at)] { (file) }
                }
            }
        }
    }
}

fn scanners(app: &App, wanted: &str) -> Markup {
    html! {
        label {
            "Instrument"
            select name="scanner" required {
                option value="" { "choose …" }
                @for (reference, scanner) in app.workshop.program.entries("scanners") {
                    option value=(reference) selected[reference == wanted] {
                        (scanner["name"].as_str().filter(|name| !name.is_empty()).unwrap_or(reference)) " (" (reference.rsplit('#').next().unwrap_or(reference)) ")"
                    }
                }
            }
        }
    }
}

/// A field for a number, with the value that it begins with or an example of one.
fn number(name: &str, label: &str, value: &str, example: &str, unit: &str) -> Markup {
    html! {
        label {
            (label) small { " " (unit) }
            input name=(name) value=(value) placeholder=(example) inputmode="decimal" autocomplete="off" size="8";
        }
    }
}

pub async fn new(
    State(app): State<Arc<App>>,
    Extension(identity): Extension<Identity>,
    Query(query): Query<BTreeMap<String, String>>,
) -> Result<Response, Failure> {
    let owner = identity.owner.clone();
    let files = blocking(&app, move |workshop| Files::of(&workshop.store, &owner)).await?;
    let asked = |key: &str| query.get(key).map(String::as_str).unwrap_or_default();
    let wanted = if asked("upload").is_empty() { String::new() } else { format!("{}/", asked("upload")) };
    let scanner = asked("scanner");
    let (scenes, areas) = (files.scenes(), files.with(&AREAS));
    let start = |action: &str| html! { (form_token(&app, &identity)) input type="hidden" name="kind" value=(action); };
    let content = html! {
        h1 { "New scan" }
        @if files.0.is_empty() {
            p .lead { "There are no files yet: " a href="/" { "upload a scene" } " first." }
        }
        section .card aria-labelledby="flight" {
            h2 #flight { "A flight over a scene" }
            form method="post" action="/forms/plan" {
                (start("airborne"))
                (choice("scene", "Scene", &scenes, None, &wanted))
                (scanners(&app, scanner))
                div .row {
                    (number("height", "Height above ground", "80", "", "m"))
                    (number("density", "Density", "10", "", "pulses per m²"))
                    (number("overlap", "Overlap", "30", "", "%"))
                    (number("speed", "or, instead of one of them, speed", "", "8", "m/s"))
                }
                (choice("area_file", "Area", &areas, Some("the whole scene"), ""))
                label { "or as text " small { "WKT or GeoJSON" } textarea name="area" rows="2" placeholder="POLYGON ((0 0, 100 0, 100 100, 0 100))" {} }
                label .flag { input type="checkbox" name="follow_terrain"; " Follow the terrain" }
                button type="submit" { "Plan the flight" }
            }
        }
        section .card aria-labelledby="plot" {
            h2 #plot { "Tripod positions" }
            form method="post" action="/forms/plan" {
                (start("terrestrial"))
                (choice("scene", "Scene", &scenes, None, &wanted))
                (scanners(&app, scanner))
                div .row {
                    (number("around", "Centre x,y", "", "0,0", "m"))
                    (number("radius", "Radius", "", "10", "m"))
                    (number("positions", "Positions", "", "4", ""))
                    (number("spacing", "or spacing of a grid", "", "15", "m"))
                    (number("resolution", "Resolution", "0.1", "", "°"))
                }
                button type="submit" { "Plan the positions" }
            }
        }
        section .card aria-labelledby="drive" {
            h2 #drive { "A drive along a line" }
            form method="post" action="/forms/plan" {
                (start("mobile"))
                (choice("scene", "Scene", &scenes, None, &wanted))
                (scanners(&app, scanner))
                div .row { (number("speed", "Speed", "8", "", "m/s")) }
                (choice("along_file", "Line", &areas, Some("as text"), ""))
                label { "or as text " small { "WKT or GeoJSON" } textarea name="along" rows="2" placeholder="LINESTRING (0 0, 50 0, 80 40)" {} }
                button type="submit" { "Plan the drive" }
            }
        }
        section .card aria-labelledby="survey" {
            h2 #survey { "A survey or pipeline file" }
            form method="post" action="/forms/run" {
                (form_token(&app, &identity))
                (choice("file", "File", &files.surveys(), None, &wanted))
                (super::job::run_fields())
                div .row {
                    button type="submit" name="action" value="dry-run" { "Forecast" }
                    button type="submit" name="action" value="run" { "Run" }
                }
            }
        }
    };
    Ok(page(&app, &identity, "New scan", &content))
}

pub async fn compare(
    State(app): State<Arc<App>>,
    Extension(identity): Extension<Identity>,
    Query(query): Query<BTreeMap<String, String>>,
) -> Result<Response, Failure> {
    let owner = identity.owner.clone();
    let clouds = blocking(&app, move |workshop| -> StoreResult<_> {
        let store = &workshop.store;
        let files = Files::of(store, &owner)?;
        let mut clouds: Vec<String> = Vec::new();
        for job in store.jobs(&owner, &[Status::Successful], &["run".to_owned()], 0, 50)? {
            let own = job.result_files().into_iter().map(|file| format!("jobs/{}/{}", job.id, file.path));
            clouds.extend(own.filter(|name| has_ending(name, &CLOUDS)));
        }
        clouds.extend(files.with(&CLOUDS).into_iter().map(str::to_owned));
        Ok(clouds)
    })
    .await?;
    let clouds: Vec<&str> = clouds.iter().map(String::as_str).take(MAX_CHOICES).collect();
    let asked = |key: &str| query.get(key).map(String::as_str).unwrap_or_default();
    let content = html! {
        h1 { "Compare two clouds" }
        @if clouds.len() < 2 { p .lead { "This needs two clouds: upload one, or run a scan." } }
        form .card method="post" action="/forms/compare" {
            (form_token(&app, &identity))
            (choice("first", "First cloud, usually the measured one", &clouds, None, asked("first")))
            (choice("second", "Second cloud, usually the simulated one", &clouds, None, asked("second")))
            button type="submit" { "Compare" }
        }
    };
    Ok(page(&app, &identity, "Compare", &content))
}
