//! Browsers that are logged in.

use crate::tokens::{hex, random_name};
use axum::http::header::{self, HeaderMap};
use sha2::{Digest as _, Sha256};
use std::collections::HashMap;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Time for which a browser stays logged in.
const SESSION: Duration = Duration::from_secs(12 * 3600);
/// Most sessions; the oldest ones end earlier.
const MAX_SESSIONS: usize = 10_000;
/// First part of the names of cookies. Browsers send cookies to all ports of a host, so the rest is that of
/// the service.
const COOKIE: &str = "vlscan_session_";

/// Browsers that are logged in.
#[derive(Debug)]
pub struct Sessions {
    /// Name of the cookie.
    cookie: String,
    /// Owners and the begin of their sessions, by the hash of the session's name.
    begun: Mutex<HashMap<[u8; 32], (String, Instant)>>,
}

impl Sessions {
    /// No sessions, of the service with this id.
    pub fn of(service: &str) -> Sessions {
        let cookie = format!("{COOKIE}{}", hex(&key_of(service)[..4]));
        Sessions { cookie, begun: Mutex::default() }
    }

    /// Begins a session; returns the cookie.
    pub fn begin(&self, owner: &str, is_encrypted: bool) -> String {
        let name = random_name(32);
        let mut sessions = self.begun.lock().unwrap_or_else(PoisonError::into_inner);
        sessions.retain(|_, (_, begin)| begin.elapsed() < SESSION);
        if sessions.len() >= MAX_SESSIONS {
            let oldest = sessions.iter().min_by_key(|(_, (_, begin))| *begin).map(|(key, _)| *key);
            oldest.and_then(|key| sessions.remove(&key));
        }
        sessions.insert(key_of(&name), (owner.to_owned(), Instant::now()));
        let secure = if is_encrypted { "; Secure" } else { "" };
        let cookie = &self.cookie;
        format!("{cookie}={name}; Path=/; HttpOnly; SameSite=Strict; Max-Age={}{secure}", SESSION.as_secs())
    }

    /// Ends the session of a request; returns the cookie that says so.
    pub fn end(&self, headers: &HeaderMap) -> String {
        if let Some(name) = self.name(headers) {
            self.begun.lock().unwrap_or_else(PoisonError::into_inner).remove(&key_of(name));
        }
        format!("{}=; Path=/; HttpOnly; SameSite=Strict; Max-Age=0", self.cookie)
    }

    /// Ends the sessions of owners.
    pub fn end_of(&self, owners: &[String]) {
        let mut sessions = self.begun.lock().unwrap_or_else(PoisonError::into_inner);
        sessions.retain(|_, (owner, _)| !owners.contains(owner));
    }

    /// The owner whose session the cookie of a request names.
    pub fn owner(&self, headers: &HeaderMap) -> Option<String> {
        let sessions = self.begun.lock().unwrap_or_else(PoisonError::into_inner);
        let (owner, begin) = sessions.get(&key_of(self.name(headers)?))?;
        (begin.elapsed() < SESSION).then(|| owner.clone())
    }

    /// The name of the session in the cookie of a request.
    fn name<'h>(&self, headers: &'h HeaderMap) -> Option<&'h str> {
        let cookies = headers.get_all(header::COOKIE).iter().filter_map(|value| value.to_str().ok());
        cookies
            .flat_map(|line| line.split(';'))
            .find_map(|pair| pair.trim().strip_prefix(self.cookie.as_str())?.strip_prefix('='))
    }
}

/// Sessions are found by a hash of their names, so that the time of the search tells nothing of them.
fn key_of(name: &str) -> [u8; 32] {
    Sha256::digest(name.as_bytes()).into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sessions_are_found_by_their_cookie_and_end() {
        let sessions = Sessions::of("an id");
        let cookie = sessions.begin("anna", true);
        assert!(cookie.contains("HttpOnly; SameSite=Strict") && cookie.ends_with("; Secure"));
        let mut sent = HeaderMap::new();
        sent.insert(header::COOKIE, format!("a=b; {}", cookie.split(';').next().unwrap()).parse().unwrap());
        assert_eq!(sessions.owner(&sent).as_deref(), Some("anna"));
        let guess = format!("{}=guess", sessions.cookie);
        assert_eq!(sessions.owner(&HeaderMap::from_iter([(header::COOKIE, guess.parse().unwrap())])), None);
        sessions.end(&sent);
        assert_eq!(sessions.owner(&sent), None);
    }

    #[test]
    fn services_on_ports_of_a_host_have_cookies_of_their_own() {
        let (first, second) = (Sessions::of("first"), Sessions::of("second"));
        let pair = |cookie: &str| cookie.split(';').next().unwrap().to_owned();
        let cookies = [pair(&first.begin("anna", false)), pair(&second.begin("ben", false))];
        let sent: HeaderMap = HeaderMap::from_iter([(header::COOKIE, cookies.join("; ").parse().unwrap())]);
        assert_eq!(first.owner(&sent).as_deref(), Some("anna"));
        assert_eq!(second.owner(&sent).as_deref(), Some("ben"));
        first.end(&sent);
        assert_eq!((first.owner(&sent), second.owner(&sent).as_deref()), (None, Some("ben")));
    }

    #[test]
    fn sessions_of_an_owner_end_together() {
        let sessions = Sessions::of("an id");
        let sent = ["anna", "ben"].map(|owner| -> HeaderMap {
            let cookie = sessions.begin(owner, false);
            let pair = cookie.split(';').next().unwrap().parse().unwrap();
            HeaderMap::from_iter([(header::COOKIE, pair)])
        });
        sessions.end_of(&["anna".to_owned()]);
        assert_eq!((sessions.owner(&sent[0]), sessions.owner(&sent[1]).as_deref()), (None, Some("ben")));
    }
}
