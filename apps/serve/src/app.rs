//! State that all requests share, and identity of who asks.

use crate::answers::Failure;
use crate::sessions::Sessions;
use crate::shares::{Share, Shares};
use crate::tokens::{LOCAL, Tokens, hex};
use crate::worker::Workshop;
use axum::http::StatusCode;
use axum::http::header::{self, HeaderMap};
use sha2::{Digest as _, Sha256};
use std::sync::Arc;
use std::time::Duration;
use subtle::ConstantTimeEq as _;

/// Identity of who asks.
#[derive(Clone, Debug)]
pub struct Identity {
    /// Owner of uploads and jobs.
    pub owner: String,
    /// True if a browser vouches for it, which sends a cookie or nothing along with requests of other pages,
    /// too.
    pub is_ambient: bool,
}

/// State that all requests share.
#[derive(Debug)]
pub struct App {
    /// Store, program, limits and queue.
    pub workshop: Arc<Workshop>,
    /// Tokens of who may use the service.
    pub tokens: Tokens,
    /// Browsers that are logged in.
    pub sessions: Sessions,
    /// Secret by which forms are recognised.
    pub(crate) secret: String,
    /// Names of the service.
    pub(crate) hosts: Vec<String>,
    /// Streams of progress that may be opened.
    pub streams: Shares,
    /// Uploads that may be received.
    pub uploads: Shares,
    /// Pictures that may be drawn.
    pub pictures: Shares,
    /// Requests that may be checked.
    pub requests: Shares,
}

/// Longest wait for the turn to draw a picture.
const MAX_PICTURE_WAIT: Duration = Duration::from_secs(120);

/// Longest wait for the turn to have a request checked.
const MAX_REQUEST_WAIT: Duration = Duration::from_secs(60);

impl App {
    /// The turn of an owner to have a request checked, which may take seconds.
    ///
    /// # Errors
    /// If it does not come.
    async fn turn_to_submit(&self, owner: &str) -> Result<Share, Failure> {
        let turn = self.requests.take(owner, MAX_REQUEST_WAIT).await;
        turn.ok_or_else(|| {
            Failure::new(
                StatusCode::TOO_MANY_REQUESTS,
                "too many requests at the same time; try again in a minute",
            )
        })
    }

    /// The turn of an owner to draw a picture.
    ///
    /// # Errors
    /// If it does not come.
    pub async fn turn_to_draw(&self, owner: &str) -> Result<Share, Failure> {
        let turn = self.pictures.take(owner, MAX_PICTURE_WAIT).await;
        turn.ok_or_else(|| {
            Failure::new(
                StatusCode::SERVICE_UNAVAILABLE,
                "other pictures are being drawn; load the page again in a minute",
            )
        })
    }

    /// Text of the hidden field of forms for this owner.
    pub fn form_token(&self, owner: &str) -> String {
        let mut hash = Sha256::new();
        hash.update(self.secret.as_bytes());
        hash.update(owner.as_bytes());
        hex(&hash.finalize())
    }

    /// True if a form is from a page of the service that was made for this owner.
    pub fn is_genuine(&self, owner: &str, token: &str) -> bool {
        self.form_token(owner).as_bytes().ct_eq(token.as_bytes()).into()
    }

    /// Identity of who asks with these headers.
    pub fn identity(&self, headers: &HeaderMap) -> Option<Identity> {
        if self.tokens.is_empty() {
            return Some(Identity { owner: LOCAL.to_owned(), is_ambient: true });
        }
        if let Some(value) = headers.get(header::AUTHORIZATION) {
            let (scheme, token) = value.to_str().ok()?.trim().split_once(' ')?;
            if !scheme.eq_ignore_ascii_case("bearer") {
                return None;
            }
            let owner = self.tokens.owner_of(token.trim())?;
            return Some(Identity { owner: owner.name, is_ambient: false });
        }
        self.sessions.owner(headers).map(|owner| Identity { owner, is_ambient: true })
    }

    /// True if the name by which the service was reached is one of its own. A page of another site can have
    /// its name lead to the loopback address and would then be of the same origin.
    pub fn is_own_host(&self, headers: &HeaderMap) -> bool {
        let host = headers.get(header::HOST).and_then(|host| host.to_str().ok()).unwrap_or_default();
        let name = match host.strip_prefix('[') {
            Some(rest) => rest.split(']').next().unwrap_or_default(),
            None => host.split(':').next().unwrap_or_default(),
        };
        let is_named = self.hosts.iter().any(|known| is_same_host(known, name));
        match self.tokens.is_empty() {
            true => {
                is_named || ["localhost", "127.0.0.1", "::1"].iter().any(|known| is_same_host(known, name))
            }
            false => is_named || self.hosts.is_empty(),
        }
    }
}

/// True if two names are those of one host: case does not matter, nor a dot at the end.
fn is_same_host(known: &str, name: &str) -> bool {
    let bare = |name: &str| name.strip_suffix('.').unwrap_or(name).to_ascii_lowercase();
    !name.is_empty() && bare(known) == bare(name)
}

/// Does work with the store or files beside the threads that answer.
///
/// # Errors
/// Errors of the work.
pub async fn blocking<T, E>(
    app: &Arc<App>,
    work: impl FnOnce(&Workshop) -> Result<T, E> + Send + 'static,
) -> Result<T, Failure>
where
    T: Send + 'static,
    E: Send + 'static,
    Failure: From<E>,
{
    let workshop = Arc::clone(&app.workshop);
    match tokio::task::spawn_blocking(move || work(&workshop)).await {
        Ok(done) => Ok(done?),
        Err(error) => {
            eprintln!("vlscan serve: {error}");
            Err(Failure::new(
                StatusCode::INTERNAL_SERVER_ERROR,
                "the service has a fault; its operator finds the reason in its log",
            ))
        }
    }
}

/// Does work that checks a request of an owner, at the turn of the owner, which ends with the work and not
/// with the connection.
///
/// # Errors
/// If the turn does not come, and errors of the work.
pub async fn submitting<T, E>(
    app: &Arc<App>,
    owner: &str,
    work: impl FnOnce(&Workshop) -> Result<T, E> + Send + 'static,
) -> Result<T, Failure>
where
    T: Send + 'static,
    E: Send + 'static,
    Failure: From<E>,
{
    let turn = app.turn_to_submit(owner).await?;
    let in_turn = move |workshop: &Workshop| {
        let done = work(workshop);
        drop(turn);
        done
    };
    blocking(app, in_turn).await
}

#[cfg(test)]
mod tests {
    use super::is_same_host;

    #[test]
    fn names_of_hosts_have_no_case() {
        for (known, name, is_same) in [
            ("localhost", "LocalHost", true),
            ("localhost", "localhost.", true),
            ("Scans.example.org", "scans.EXAMPLE.org.", true),
            ("::1", "::1", true),
            ("localhost", "localhost..", false),
            ("localhost", "localhos", false),
            (".", "", false),
        ] {
            assert_eq!(is_same_host(known, name), is_same, "{known} {name}");
        }
    }
}
