//! The page of an upload: its files, and what can be done with each.

use super::choices::{is_mesh, is_scene, is_table, is_trajectory};
use super::cloud::{is_cloud, is_octree, show_form, viewer};
use super::home::{encoded, remove_form};
use super::layout::{bytes_text, page};
use super::trail::{Crumb, path};
use crate::answers::encoded as in_path;
use crate::app::{App, Identity};
use crate::store::{FileKind, Upload, UploadFile};
use axum::response::Response;
use maud::{Markup, html};

/// Most files that the page lists.
const MAX_LISTED: usize = 500;

/// The page of an upload, with the points of the COPC `points` if it has one of that name.
pub fn upload(
    app: &App,
    identity: &Identity,
    upload: &Upload,
    files: &[UploadFile],
    missing: &[String],
    points: Option<&str>,
) -> Response {
    let shown = files.iter().find(|file| is_octree(&file.path) && Some(file.path.as_str()) == points);
    // Those of which something can be made come first.
    let mut sorted: Vec<(&UploadFile, Vec<Markup>)> =
        files.iter().map(|file| (file, actions(app, identity, &upload.name, file))).collect();
    let rank = |kind: FileKind| match kind {
        FileKind::Survey => 0,
        FileKind::Scene => 1,
        FileKind::Inventory => 2,
        FileKind::Other => 3,
    };
    sorted.sort_by_key(|(file, actions)| (actions.is_empty(), rank(file.kind)));
    let content = html! {
        (path(&[Crumb::files(), Crumb::here(&upload.name)]))
        h1 { (upload.name) }
        @if let Some(file) = shown {
            p { strong { (file.path) } }
            (viewer(
                &format!("/uploads/{}/files/{}", in_path(&upload.name), in_path(&file.path)),
                &show_form(app, identity, &format!("{}/{}", upload.name, file.path), "Show a copy of the points"),
            ))
        }
        p { (upload.files) @if upload.files == 1 { " file, " } @else { " files, " } (bytes_text(upload.bytes)) }
        @if !missing.is_empty() {
            div .card role="note" {
                p { "Surveys and scenes name files that are neither in this upload nor in the catalogue:" }
                ul { @for name in missing { li { code { (name) } } } }
                p { "Upload all of them together: as a folder, or as one zip archive." }
            }
        }
        table {
            thead { tr { th { "File" } th { "Size" } th { "What to do with it" } } }
            tbody {
                @for (file, actions) in sorted.iter().take(MAX_LISTED) {
                    tr {
                        td { (file.path) }
                        td { (bytes_text(file.bytes)) }
                        td .actions { @for action in actions { (action) " " } }
                    }
                }
            }
        }
        @if files.len() > MAX_LISTED { p { "and " (files.len() - MAX_LISTED) " more" } }
        (remove_form(app, identity, &upload.name))
    };
    page(app, identity, &upload.name, &content)
}

fn actions(app: &App, identity: &Identity, upload: &str, file: &UploadFile) -> Vec<Markup> {
    let name = format!("{upload}/{}", file.path);
    let link = |kind: &str, key: &str, label: &str| {
        html! { a .action href=(format!("/new?kind={kind}&{key}={}&upload={}", encoded(&name), encoded(upload))) { (label) } }
    };
    let mut found = Vec::new();
    if file.kind == FileKind::Survey || name.ends_with(".toml") {
        found.push(link("survey", "file", "Run"));
    }
    if file.kind == FileKind::Scene || is_scene(&name) {
        found.push(link("airborne", "scene", "Plan a scan"));
    }
    if file.kind == FileKind::Scene || is_mesh(&name) {
        found.push(link("terrestrial", "scene", "Place tripods"));
    }
    if is_table(&name) {
        found.push(link("stand", "inventory", "Make trees of an inventory"));
    }
    if file.kind == FileKind::Inventory {
        return found;
    }
    if is_trajectory(&name) {
        found.push(link("trajectory", "trajectory", "Fly along a trajectory"));
    }
    if is_octree(&name) {
        let page = format!("/uploads/{}?points={}", encoded(upload), encoded(&file.path));
        found.push(html! { a .action href=(page) { "Show points" } });
    } else if is_cloud(&name) {
        found.push(show_form(app, identity, &name, "Show points"));
    }
    if is_cloud(&name) {
        found.push(
            html! { a .action href=(format!("/compare?first={}", encoded(&name))) { "Compare points" } },
        );
    }
    found
}
