//! Pictures of scenes from above, and the coordinates of their pixels.

use crate::answers::{Failure, document};
use crate::app::{App, Identity, blocking};
use crate::request::RequestError;
use crate::scene_map::SceneMap;
use crate::store::StoreError;
use crate::submit::SubmitError;
use crate::worker::Workshop;
use axum::Extension;
use axum::extract::{Query, State};
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse as _, Response};
use serde_json::json;
use std::collections::BTreeMap;
use std::sync::Arc;

impl From<RequestError> for Failure {
    fn from(error: RequestError) -> Failure {
        SubmitError::from(error).into()
    }
}

/// The picture of a scene. Each owner draws one picture at a time.
pub async fn scene_map(app: &Arc<App>, owner: String, scene: String) -> Result<SceneMap, Failure> {
    let absent = || {
        Failure::new(
            StatusCode::NOT_FOUND,
            format!("there is no picture of `{scene}`; a forecast tells what is wrong with a scene"),
        )
    };
    let (of, wanted) = (owner.clone(), scene.clone());
    if let Some(known) = blocking(app, move |workshop| workshop.drawn_map(&of, &wanted)).await? {
        return Ok(known);
    }
    let turn = app.turn_to_draw(&owner).await?;
    let wanted = scene.clone();
    // The turn ends with the drawing, not with the connection.
    let draw = move |workshop: &Workshop| {
        let drawn = workshop.scene_map(&owner, &wanted);
        drop(turn);
        drawn
    };
    blocking(app, draw).await?.ok_or_else(absent)
}

fn wanted(query: &BTreeMap<String, String>) -> Result<String, Failure> {
    query.get("scene").cloned().ok_or_else(|| super::layout::bad("scene: name a scene, UPLOAD/FILE"))
}

pub async fn picture(
    State(app): State<Arc<App>>,
    Extension(identity): Extension<Identity>,
    Query(query): Query<BTreeMap<String, String>>,
) -> Result<Response, Failure> {
    let map = scene_map(&app, identity.owner, wanted(&query)?).await?;
    let picture = tokio::task::spawn_blocking(move || map.picture()).await;
    let picture = picture.map_err(std::io::Error::other).and_then(|read| read).map_err(StoreError::from)?;
    Ok(([(header::CONTENT_TYPE, "image/png")], picture).into_response())
}

pub async fn frame(
    State(app): State<Arc<App>>,
    Extension(identity): Extension<Identity>,
    Query(query): Query<BTreeMap<String, String>>,
) -> Result<Response, Failure> {
    let map = scene_map(&app, identity.owner, wanted(&query)?).await?;
    Ok(document(&json!(map.frame)))
}
