//! Pages, written here and sent whole: they work without scripts, but for the turning of clouds. Everything that others chose is escaped,
//! because it only gets into a page through `html!`.
//!
//! | file | pages |
//! |---|---|
//! | `layout` | what all pages have |
//! | `home` | uploads and jobs |
//! | `new` | forms of new jobs |
//! | `job` | a job and its results |
//! | `instruments` | the catalogue |
//! | `forms` | what forms do |

mod forms;
mod home;
mod instruments;
mod job;
mod layout;
mod new;

pub use home::{home, jobs};
pub use job::job;
pub use layout::{failure, interface};

use crate::app::App;
use axum::Router;
use axum::http::header;
use axum::response::{IntoResponse as _, Response};
use axum::routing::{get, post};
use std::sync::Arc;

/// The addresses of pages, besides those that the interface for programs shares.
pub fn router() -> Router<Arc<App>> {
    let style = || async { asset("text/css; charset=utf-8", include_str!("../../static/style.css")) };
    let follow = || async { asset("text/javascript; charset=utf-8", include_str!("../../static/follow.js")) };
    Router::new()
        .route("/static/style.css", get(style))
        .route("/static/follow.js", get(follow))
        .route("/new", get(new::new))
        .route("/compare", get(new::compare))
        .route("/instruments", get(instruments::list))
        .route("/instruments/{number}", get(instruments::show))
        .route("/instruments/{number}/pattern.svg", get(instruments::pattern))
        .route("/login", get(forms::login_page).post(forms::login))
        .route("/forms/logout", post(forms::logout))
        .route("/forms/run", post(forms::run))
        .route("/forms/plan", post(forms::plan))
        .route("/forms/compare", post(forms::compare))
        .route("/forms/dismiss", post(forms::dismiss))
        .route("/forms/remove-upload", post(forms::remove_upload))
}

fn asset(media: &'static str, text: &'static str) -> Response {
    ([(header::CONTENT_TYPE, media), (header::CACHE_CONTROL, "max-age=3600")], text).into_response()
}
