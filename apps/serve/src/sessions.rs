//! Browsers that are logged in.

use crate::tokens::random_name;
use axum::http::header::{self, HeaderMap};
use sha2::{Digest as _, Sha256};
use std::collections::HashMap;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Time for which a browser stays logged in.
const SESSION: Duration = Duration::from_secs(12 * 3600);
/// Most sessions; the oldest ones end earlier.
const MAX_SESSIONS: usize = 10_000;
const COOKIE: &str = "vlscan_session";

/// Browsers that are logged in.
#[derive(Debug, Default)]
pub struct Sessions(Mutex<HashMap<[u8; 32], (String, Instant)>>);

impl Sessions {
    /// Begins a session; returns the cookie.
    pub fn begin(&self, owner: &str, is_encrypted: bool) -> String {
        let name = random_name(32);
        let mut sessions = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        sessions.retain(|_, (_, begin)| begin.elapsed() < SESSION);
        if sessions.len() >= MAX_SESSIONS {
            let oldest = sessions.iter().min_by_key(|(_, (_, begin))| *begin).map(|(key, _)| *key);
            oldest.and_then(|key| sessions.remove(&key));
        }
        sessions.insert(key_of(&name), (owner.to_owned(), Instant::now()));
        let secure = if is_encrypted { "; Secure" } else { "" };
        format!("{COOKIE}={name}; Path=/; HttpOnly; SameSite=Strict; Max-Age={}{secure}", SESSION.as_secs())
    }

    /// Ends the session of a request; returns the cookie that says so.
    pub fn end(&self, headers: &HeaderMap) -> String {
        if let Some(name) = cookie(headers) {
            self.0.lock().unwrap_or_else(PoisonError::into_inner).remove(&key_of(name));
        }
        format!("{COOKIE}=; Path=/; HttpOnly; SameSite=Strict; Max-Age=0")
    }

    /// The owner whose session the cookie of a request names.
    pub fn owner(&self, headers: &HeaderMap) -> Option<String> {
        let sessions = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let (owner, begin) = sessions.get(&key_of(cookie(headers)?))?;
        (begin.elapsed() < SESSION).then(|| owner.clone())
    }
}

/// Sessions are found by a hash of their names, so that the time of the search tells nothing of them.
fn key_of(name: &str) -> [u8; 32] {
    Sha256::digest(name.as_bytes()).into()
}

fn cookie(headers: &HeaderMap) -> Option<&str> {
    let cookies = headers.get_all(header::COOKIE).iter().filter_map(|value| value.to_str().ok());
    cookies
        .flat_map(|line| line.split(';'))
        .find_map(|pair| pair.trim().strip_prefix(COOKIE)?.strip_prefix('='))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sessions_are_found_by_their_cookie_and_end() {
        let sessions = Sessions::default();
        let cookie = sessions.begin("anna", true);
        assert!(cookie.contains("HttpOnly; SameSite=Strict") && cookie.ends_with("; Secure"));
        let mut sent = HeaderMap::new();
        sent.insert(header::COOKIE, format!("a=b; {}", cookie.split(';').next().unwrap()).parse().unwrap());
        assert_eq!(sessions.owner(&sent).as_deref(), Some("anna"));
        assert_eq!(
            sessions
                .owner(&HeaderMap::from_iter([(header::COOKIE, "vlscan_session=guess".parse().unwrap())])),
            None
        );
        sessions.end(&sent);
        assert_eq!(sessions.owner(&sent), None);
    }
}
