//! Uploads.

use crate::answers::{Failure, document, encoded, wants_page};
use crate::app::{App, Identity, blocking};
use crate::missing::missing;
use crate::pages;
use crate::store::{StoreError, Upload, UploadFile};
use crate::uploads;
use crate::worker::Workshop;
use axum::Extension;
use axum::extract::multipart::MultipartRejection;
use axum::extract::{Multipart, Path, Query, RawQuery, State};
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse as _, Redirect, Response};
use serde_json::json;
use std::collections::BTreeMap;
use std::sync::Arc;

pub async fn list(
    State(app): State<Arc<App>>,
    Extension(identity): Extension<Identity>,
) -> Result<Response, Failure> {
    let uploads = blocking(&app, move |workshop| workshop.store.uploads(&identity.owner)).await?;
    Ok(document(&json!({ "uploads": uploads })))
}

pub async fn show(
    State(app): State<Arc<App>>,
    Extension(identity): Extension<Identity>,
    Path(name): Path<String>,
    RawQuery(query): RawQuery,
    Query(asked): Query<BTreeMap<String, String>>,
    headers: HeaderMap,
) -> Result<Response, Failure> {
    let (upload, files) = find(&app, &identity, &name).await?;
    let (id, listed) = (upload.id.clone(), files.clone());
    let look = move |workshop: &Workshop| missing(&workshop.store, &workshop.program, &id, &listed);
    let missing = blocking(&app, look).await?;
    if wants_page(&headers, query.as_deref()) {
        let points = asked.get("points").map(String::as_str);
        return Ok(pages::upload(&app, &identity, &upload, &files, &missing, points));
    }
    let mut about = serde_json::to_value(&upload).unwrap_or_default();
    about["list"] = json!(files);
    about["missing"] = json!(missing);
    Ok(document(&about))
}

/// The upload of the one who asks, and its files.
pub async fn find(
    app: &Arc<App>,
    identity: &Identity,
    name: &str,
) -> Result<(Upload, Vec<UploadFile>), Failure> {
    let (wanted, owner) = (name.to_owned(), identity.owner.clone());
    let found = blocking(app, move |workshop| {
        let Some(upload) = workshop.store.upload(&owner, &wanted)? else { return Ok(None) };
        let files = workshop.store.files(&upload.id)?;
        Ok::<_, StoreError>(Some((upload, files)))
    })
    .await?;
    found.ok_or_else(|| no_upload(name))
}

pub async fn remove(
    State(app): State<Arc<App>>,
    Extension(identity): Extension<Identity>,
    Path(name): Path<String>,
) -> Result<Response, Failure> {
    let wanted = name.clone();
    let removed =
        blocking(&app, move |workshop| workshop.store.remove_upload(&identity.owner, &wanted)).await?;
    match removed {
        true => Ok(StatusCode::NO_CONTENT.into_response()),
        false => Err(no_upload(&name)),
    }
}

fn no_upload(name: &str) -> Failure {
    Failure::new(StatusCode::NOT_FOUND, format!("there is no upload `{name}`; /uploads lists them"))
}

/// Receives an upload: from programs, and from the form of a page, which leads to that of the upload.
pub async fn receive(
    State(app): State<Arc<App>>,
    Extension(identity): Extension<Identity>,
    headers: HeaderMap,
    form: Result<Multipart, MultipartRejection>,
) -> Result<Response, Failure> {
    let upload = match received(&app, &identity, form).await {
        Ok(upload) => upload,
        Err(failure) if wants_page(&headers, None) => {
            return pages::upload_failed(&app, &identity, &failure).await;
        }
        Err(failure) => return Err(failure),
    };
    let location = format!("/uploads/{}", encoded(&upload.name));
    if wants_page(&headers, None) {
        return Ok(Redirect::to(&location).into_response());
    }
    let body = serde_json::to_string(&upload).unwrap_or_default();
    let fields = [(header::LOCATION, location), (header::CONTENT_TYPE, "application/json".to_owned())];
    Ok((StatusCode::CREATED, fields, body).into_response())
}

async fn received(
    app: &Arc<App>,
    identity: &Identity,
    form: Result<Multipart, MultipartRejection>,
) -> Result<Upload, Failure> {
    let form = form.map_err(|_| {
        Failure::new(StatusCode::UNSUPPORTED_MEDIA_TYPE, "expected a form of the type multipart/form-data")
    })?;
    let Some(share) = app.uploads.try_take(&identity.owner) else {
        return Err(Failure::new(
            StatusCode::TOO_MANY_REQUESTS,
            "too many uploads at the same time; try again in a minute",
        ));
    };
    let is_genuine = |token: &str| app.is_genuine(&identity.owner, token);
    // Programs send no form of a page; a browser says where its forms come from.
    let check: Option<&(dyn Fn(&str) -> bool + Sync)> =
        if identity.is_ambient && !app.tokens.is_empty() { Some(&is_genuine) } else { None };
    let received = uploads::receive(form, &identity.owner, &app.workshop.store, &app.workshop.limits, check);
    let received = tokio::time::timeout(uploads::MAX_TIME, received).await.map_err(|_| {
        let message = format!("the upload took more than {} s", uploads::MAX_TIME.as_secs());
        Failure::new(StatusCode::REQUEST_TIMEOUT, message)
    })??;
    let owner = identity.owner.clone();
    // The share ends with the upload, not with the connection.
    let list = move |workshop: &Workshop| {
        let listed = received.list(&owner, &workshop.store, &workshop.limits);
        drop(share);
        listed
    };
    blocking(app, list).await
}
