//! Styles and scripts, which are part of the program.

use crate::answers::Failure;
use axum::extract::Path;
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse as _, Response};

/// Policy of the worker that decompresses points: it runs its own scripts and the decoder that the page hands
/// it. It loads nothing and sends nothing.
const DECODER_POLICY: &str = "default-src 'none'; script-src 'self' 'wasm-unsafe-eval'";

const SCRIPT: &str = "text/javascript; charset=utf-8";

macro_rules! assets {
    ($($path:literal: $media:expr,)*) => {
        &[$(($path, $media, include_bytes!(concat!("../../static/", $path)))),*]
    };
}

/// Path, media type and content of all files.
const ASSETS: &[(&str, &str, &[u8])] = assets! {
    "style.css": "text/css; charset=utf-8",
    "icon.svg": "image/svg+xml",
    "follow.js": SCRIPT,
    "page.js": SCRIPT,
    "draw.js": SCRIPT,
    "upload.js": SCRIPT,
    "viewer/viewer.js": SCRIPT,
    "viewer/hands.js": SCRIPT,
    "viewer/camera.js": SCRIPT,
    "viewer/copc.js": SCRIPT,
    "viewer/painter.js": SCRIPT,
    "viewer/decoder.js": SCRIPT,
    "laz-perf.js": SCRIPT,
    "laz-perf.wasm": "application/wasm",
};

pub async fn asset(Path(path): Path<String>) -> Result<Response, Failure> {
    let found = ASSETS.iter().find(|(known, ..)| *known == path);
    let Some((_, media, content)) = found else {
        return Err(Failure::new(StatusCode::NOT_FOUND, "there is no such file"));
    };
    let fields = [(header::CONTENT_TYPE, *media), (header::CACHE_CONTROL, "max-age=3600")];
    let mut response = (fields, *content).into_response();
    if path == "viewer/decoder.js" {
        let policy = header::HeaderValue::from_static(DECODER_POLICY);
        response.headers_mut().insert(header::CONTENT_SECURITY_POLICY, policy);
    }
    Ok(response)
}
