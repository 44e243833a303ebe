//! Parameters of addresses: names and values behind the `?`, decoded.

use crate::answers::{Failure, encoded};
use crate::request::suggestion;
use axum::http::{StatusCode, Uri};
use std::collections::BTreeMap;

/// Most jobs or processes of a list, as the standard has it.
pub const MAX_LISTED: u32 = 10_000;
/// Jobs or processes of a list, unless the request says how many.
pub const DEFAULT_LISTED: u32 = 10;

/// Parameters of a request.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Parameters(BTreeMap<String, String>);

impl Parameters {
    /// Parses a query. `known` are the parameters of the address. Values of a repeated parameter are joined
    /// by commas, as lists have them.
    ///
    /// # Errors
    /// A failure for an unknown parameter, and for what cannot be decoded.
    pub fn of(query: Option<&str>, known: &[&str]) -> Result<Parameters, Failure> {
        let mut found: BTreeMap<String, String> = BTreeMap::new();
        for pair in query.unwrap_or_default().split('&').filter(|pair| !pair.is_empty()) {
            let (name, value) = pair.split_once('=').unwrap_or((pair, ""));
            let (Some(name), Some(value)) = (decoded(name), decoded(value)) else {
                return Err(damaged(pair));
            };
            if !known.contains(&name.as_str()) {
                let advice = suggestion(&name, known.iter().copied());
                let message = format!("the address has no parameter `{name}`; {advice}");
                return Err(Failure::new(StatusCode::BAD_REQUEST, message));
            }
            let values = found.entry(name).or_default();
            if !values.is_empty() {
                values.push(',');
            }
            values.push_str(&value);
        }
        Ok(Parameters(found))
    }

    /// The value of a parameter.
    pub fn get(&self, name: &str) -> Option<&str> {
        self.0.get(name).map(String::as_str)
    }

    /// The address of a path with these parameters.
    pub fn address(&self, path: &str) -> String {
        let pairs = self.0.iter().map(|(name, value)| format!("{}={}", encoded(name), encoded(value)));
        match pairs.collect::<Vec<_>>().join("&") {
            query if query.is_empty() => path.to_owned(),
            query => format!("{path}?{query}"),
        }
    }

    /// The parameters with another value of one.
    #[must_use]
    pub fn with(&self, name: &str, value: &str) -> Parameters {
        let mut all = self.0.clone();
        all.insert(name.to_owned(), value.to_owned());
        Parameters(all)
    }
}

/// Checks the encoding of an address.
///
/// # Errors
/// A failure that quotes the part that cannot be decoded.
pub fn check_encoding(address: &Uri) -> Result<(), Failure> {
    let mut parts = address.path().split('/').chain(address.query().unwrap_or_default().split('&'));
    match parts.find(|part| decoded(part).is_none()) {
        Some(part) => Err(damaged(part)),
        None => Ok(()),
    }
}

fn damaged(part: &str) -> Failure {
    let part: String = part.chars().take(100).collect();
    let message = format!("`{part}`: expected UTF-8 with each special byte as % and two hexadecimal digits");
    Failure::new(StatusCode::BAD_REQUEST, message)
}

/// Decodes a part of a query; `None` if it is damaged, or not UTF-8.
fn decoded(text: &str) -> Option<String> {
    let mut bytes = Vec::with_capacity(text.len());
    let mut rest = text.as_bytes();
    while let Some((&byte, after)) = rest.split_first() {
        rest = after;
        match byte {
            b'%' => {
                let (digits, after) = rest.split_at_checked(2)?;
                let digit = |at: usize| char::from(digits[at]).to_digit(16);
                bytes.push(u8::try_from(digit(0)? * 16 + digit(1)?).ok()?);
                rest = after;
            }
            b'+' => bytes.push(b' '),
            byte => bytes.push(byte),
        }
    }
    String::from_utf8(bytes).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    const KNOWN: [&str; 3] = ["status", "limit", "f"];

    #[test]
    fn parameters_are_decoded() {
        let found =
            Parameters::of(Some("status=failed%2Crunning&limit=7&f=a+b&status=accepted"), &KNOWN).unwrap();
        assert_eq!(found.get("status"), Some("failed,running,accepted"));
        assert_eq!((found.get("f"), found.get("offset")), (Some("a b"), None));
        let address = found.with("limit", "9").address("/jobs");
        assert_eq!(address, "/jobs?f=a%20b&limit=9&status=failed%2Crunning%2Caccepted");
        assert_eq!(Parameters::of(None, &KNOWN).unwrap(), Parameters::default());
        assert_eq!(Parameters::default().address("/jobs"), "/jobs");
    }

    #[test]
    fn unknown_and_damaged_parameters_are_refused() {
        for (query, told) in [
            ("statsu=failed", "did you mean `status`?"),
            ("datetime=2024", "it has f, limit, status"),
            ("status=%4", "`status=%4`"),
            ("status=%zz", "%zz"),
            ("%ff=1", "%ff"),
            ("limit=%C3", "%C3"),
        ] {
            let failure = Parameters::of(Some(query), &KNOWN).unwrap_err();
            assert_eq!(failure.status, StatusCode::BAD_REQUEST);
            assert!(failure.detail.contains(told), "{query}: {}", failure.detail);
        }
    }

    #[test]
    fn addresses_are_checked_as_a_whole() {
        for (address, is_sound) in [
            ("/jobs/a%20b?f=json", true),
            ("/uploads/%C3%A4", true),
            ("/jobs/%", false),
            ("/uploads/%C3/%A4", false),
            ("/map.png?scene=%f", false),
        ] {
            assert_eq!(check_encoding(&address.parse().unwrap()).is_ok(), is_sound, "{address}");
        }
    }
}
