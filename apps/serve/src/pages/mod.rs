//! Pages, written here and sent whole: they work without scripts, but for the turning of clouds. Everything
//! that others chose is escaped, because it only gets into a page through `html!`.
//!
//! | file | pages |
//! |---|---|
//! | `layout` | what all pages have |
//! | `home` | uploads and jobs |
//! | `examples` | scans that visitors without files can try |
//! | `titles` | what jobs are called |
//! | `trail` | the path from the files to a page |
//! | `new`, `scan_form`, `choices` | forms of new jobs, by their kind; files to choose from |
//! | `upload` | an upload, and what can be done with its files |
//! | `map` | pictures of scenes to draw on |
//! | `job` | a job and its results |
//! | `cloud` | points to turn around |
//! | `compared` | reports of comparisons |
//! | `assets` | styles and scripts |
//! | `instruments` | the catalogue |
//! | `forms` | what forms do |
//! | `form_body` | the fields that a form sends |
//! | `plan_fields` | the fields of the forms of plans |
//! | `plan_words` | a plan in words, and its figures |
//! | `fixes` | problems of plans at their fields, and what solves them |
//! | `mesh` | the height of level ground below a mesh |

mod assets;
mod choices;
mod cloud;
mod compared;
mod examples;
mod fixes;
mod form_body;
mod forms;
mod home;
mod instruments;
mod job;
mod layout;
mod map;
mod mesh;
mod new;
mod plan_fields;
mod plan_words;
mod scan_form;
mod titles;
mod trail;
mod upload;

pub use home::{home, jobs, upload_failed};
pub use job::job;
pub use layout::{failure, interface};
pub use titles::titled;
pub use upload::upload;

use crate::app::App;
use axum::Router;
use axum::routing::{get, post};
use std::sync::Arc;

/// The addresses of pages, besides those that the interface for programs shares.
pub fn router() -> Router<Arc<App>> {
    Router::new()
        .route("/static/{*path}", get(assets::asset))
        .route("/new", get(new::new))
        .route("/compare", get(new::compare))
        .route("/compared/{id}/report.html", get(compared::report))
        .route("/map.png", get(map::picture))
        .route("/map.json", get(map::frame))
        .route("/instruments", get(instruments::list))
        .route("/instruments/{number}", get(instruments::show))
        .route("/instruments/{number}/pattern.svg", get(instruments::pattern))
        .route("/login", get(forms::login_page).post(forms::login))
        .route("/forms/logout", post(forms::logout))
        .route("/forms/example", post(examples::example))
        .route("/forms/run", post(forms::run))
        .route("/forms/plan", post(forms::plan))
        .route("/forms/trajectory", post(forms::trajectory))
        .route("/forms/stand", post(forms::stand))
        .route("/forms/corner", post(new::corner))
        .route("/forms/compare", post(forms::compare))
        .route("/forms/view", post(forms::view))
        .route("/forms/again", post(forms::again))
        .route("/forms/dismiss", post(forms::dismiss))
        .route("/forms/remove-upload", post(forms::remove_upload))
}
