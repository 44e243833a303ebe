//! The fields that a form sends, checked to come from a page of ours.

use super::layout::bad;
use crate::answers::Failure;
use crate::app::{App, Identity};
use axum::extract::Form;
use axum::extract::rejection::FormRejection;
use axum::http::StatusCode;
use std::collections::BTreeMap;

/// Fields of a form; empty ones count as not given.
pub type Fields = BTreeMap<String, String>;
pub type FormBody = Result<Form<Fields>, FormRejection>;

/// The fields of a form that comes from a page of ours.
pub fn genuine(app: &App, identity: &Identity, form: FormBody) -> Result<Fields, Failure> {
    let Form(mut fields) = form.map_err(|_| bad("the form is damaged"))?;
    let token = fields.remove("csrf").unwrap_or_default();
    if !app.is_genuine(&identity.owner, &token) {
        let message = "the form is from an older page; load the page again";
        return Err(Failure::new(StatusCode::FORBIDDEN, message));
    }
    fields.retain(|_, value| !value.trim().is_empty());
    Ok(fields)
}
