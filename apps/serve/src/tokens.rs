//! Tokens: who may use the service. Only their hashes are kept.

use crate::config::amount;
use sha2::{Digest as _, Sha256};
use std::path::{Path, PathBuf};
use std::sync::{PoisonError, RwLock};
use subtle::{Choice, ConditionallySelectable as _, ConstantTimeEq as _};

/// The owner of everything where there are no tokens.
pub const LOCAL: &str = "local";
/// The owner of the token in the environment.
pub const ADMIN: &str = "admin";
/// Shortest token of the environment, characters. Tokens that the service makes have 43.
const MIN_CHARACTERS: usize = 20;

/// Somebody who has uploads and jobs.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Owner {
    /// The name.
    pub name: String,
    /// Pulses within 24 hours, if they are other than everybody's.
    pub quota: Option<u64>,
}

/// Why tokens cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum TokenError {
    /// The file cannot be read.
    #[error("cannot read the token file {0}: {1}")]
    Read(std::path::PathBuf, std::io::Error),
    /// A line is not as `vlscan serve token` prints it.
    #[error(
        "{file}, line {line}: expected `OWNER sha256:HASH [PULSES]`, as `vlscan serve token OWNER` prints it"
    )]
    Line {
        /// The file.
        file: std::path::PathBuf,
        /// The line, from 1.
        line: usize,
    },
    /// The file has no tokens.
    #[error(
        "the token file {0} has no tokens, so nobody could log in; add one with `vlscan serve token OWNER >> {0}`, or leave out \
         --token-file"
    )]
    None(std::path::PathBuf),
    /// The name of an owner has other characters.
    #[error("invalid owner name `{0}`: expected up to 40 letters, digits, - and _")]
    Owner(String),
    /// The token of the environment can be guessed.
    #[error(
        "VLSCAN_TOKEN has fewer than {MIN_CHARACTERS} characters; `vlscan serve token OWNER` makes a token"
    )]
    Short,
}

/// All tokens.
#[derive(Debug, Default)]
pub struct Tokens {
    file: Option<PathBuf>,
    /// Hash of the token of the environment.
    environment: Option<[u8; 32]>,
    known: RwLock<Vec<Known>>,
}

/// An owner, and the hash of a token.
type Known = (Owner, [u8; 32]);

impl Tokens {
    /// Reads the tokens of a file and of the environment.
    ///
    /// # Errors
    /// [`TokenError`].
    pub fn read(file: Option<&Path>, environment: Option<&str>) -> Result<Tokens, TokenError> {
        let mut tokens = Tokens { file: file.map(Path::to_owned), ..Tokens::default() };
        if let Some(token) = environment {
            if token.chars().count() < MIN_CHARACTERS {
                return Err(TokenError::Short);
            }
            tokens.environment = Some(hash(token));
        }
        tokens.reload()?;
        Ok(tokens)
    }

    /// Reads the file again. Returns the owners who lost a token. After an error the tokens are the same as
    /// before.
    ///
    /// # Errors
    /// [`TokenError`].
    pub fn reload(&self) -> Result<Vec<String>, TokenError> {
        let mut next = self.file.as_deref().map_or(Ok(Vec::new()), read_file)?;
        next.extend(self.environment.map(|hash| (Owner { name: ADMIN.to_owned(), quota: None }, hash)));
        let mut known = self.known.write().unwrap_or_else(PoisonError::into_inner);
        let gone = known.iter().filter(|(owner, hash)| {
            !next.iter().any(|(other, kept)| other.name == owner.name && kept == hash)
        });
        let lost: Vec<String> = gone.map(|(owner, _)| owner.name.clone()).collect();
        *known = next;
        Ok(lost)
    }

    /// True if the tokens are in a file, which may change.
    pub fn has_file(&self) -> bool {
        self.file.is_some()
    }

    /// True if there are none.
    pub fn is_empty(&self) -> bool {
        self.known.read().unwrap_or_else(PoisonError::into_inner).is_empty()
    }

    /// True if an owner may use the service: one who has a token, or everybody if there are none.
    pub fn admits(&self, owner: &str) -> bool {
        let known = self.known.read().unwrap_or_else(PoisonError::into_inner);
        known.is_empty() || known.iter().any(|(other, _)| other.name == owner)
    }

    /// All owners.
    pub fn owners(&self) -> Vec<Owner> {
        let known = self.known.read().unwrap_or_else(PoisonError::into_inner);
        known.iter().map(|(owner, _)| owner.clone()).collect()
    }

    /// The owner of a token. The time does not depend on how much of it is right.
    pub fn owner_of(&self, token: &str) -> Option<Owner> {
        let given = hash(token);
        let known = self.known.read().unwrap_or_else(PoisonError::into_inner);
        // One past the last: none.
        let mut found = known.len() as u64;
        for (at, (_, hash)) in known.iter().enumerate() {
            let is_same: Choice = hash.ct_eq(&given);
            found.conditional_assign(&(at as u64), is_same);
        }
        known.get(found as usize).map(|(owner, _)| owner.clone())
    }
}

/// Reads the tokens of a file.
fn read_file(path: &Path) -> Result<Vec<Known>, TokenError> {
    let text = std::fs::read_to_string(path).map_err(|e| TokenError::Read(path.to_owned(), e))?;
    let mut tokens = Vec::new();
    for (at, line) in text.lines().enumerate() {
        if line.trim().is_empty() || line.trim_start().starts_with('#') {
            continue;
        }
        let wrong = || TokenError::Line { file: path.to_owned(), line: at + 1 };
        tokens.push(parse_line(line).ok_or_else(wrong)?);
    }
    // Without tokens everybody would be let in, which is the opposite of what the file is for.
    if tokens.is_empty() {
        return Err(TokenError::None(path.to_owned()));
    }
    Ok(tokens)
}

/// Makes a token; returns it and its line of the token file.
///
/// # Errors
/// [`TokenError::Owner`].
pub fn make(owner: &str, quota: Option<u64>) -> Result<(String, String), TokenError> {
    if !is_owner(owner) {
        return Err(TokenError::Owner(owner.to_owned()));
    }
    let token = random_name(32);
    let quota = quota.map_or(String::new(), |pulses| format!(" {pulses}"));
    let line = format!("{owner} sha256:{}{quota}", hex(&hash(&token)));
    Ok((token, line))
}

/// A random name of this many random bytes, in lower-case hexadecimal digits.
pub fn random_name(bytes: usize) -> String {
    let mut random = vec![0; bytes];
    getrandom::fill(&mut random).expect("the system has random numbers");
    hex(&random)
}

/// Bytes as hexadecimal digits.
pub fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// The hash by which a token is known.
pub fn hash(token: &str) -> [u8; 32] {
    Sha256::digest(token.as_bytes()).into()
}

fn is_owner(name: &str) -> bool {
    (1..=40).contains(&name.len()) && name.chars().all(|c| c.is_ascii_alphanumeric() || "-_".contains(c))
}

fn parse_line(line: &str) -> Option<(Owner, [u8; 32])> {
    let mut words = line.split_whitespace();
    let (name, hash, quota) = (words.next()?, words.next()?.strip_prefix("sha256:")?, words.next());
    if !is_owner(name) || hash.len() != 64 || !hash.is_ascii() || words.next().is_some() {
        return None;
    }
    let mut bytes = [0; 32];
    for (at, byte) in bytes.iter_mut().enumerate() {
        *byte = u8::from_str_radix(&hash[2 * at..2 * at + 2], 16).ok()?;
    }
    let quota = quota.map(amount).transpose().ok()?;
    Some((Owner { name: name.to_owned(), quota }, bytes))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tokens_are_found_by_their_hashes() {
        let (anna, line) = make("anna", Some(5)).unwrap();
        let (ben, second) = make("ben", None).unwrap();
        assert!(!line.contains(&anna) && anna.len() == 64);
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(&file, format!("# tokens\n\n{line}\n{second}\n")).unwrap();
        let tokens = Tokens::read(Some(file.path()), Some("a token of the environment")).unwrap();
        assert_eq!(tokens.owner_of(&anna), Some(Owner { name: "anna".to_owned(), quota: Some(5) }));
        assert_eq!(tokens.owner_of(&ben).unwrap().name, "ben");
        assert_eq!(tokens.owner_of("a token of the environment").unwrap().name, ADMIN);
        assert!(tokens.owner_of("").is_none() && tokens.owner_of(&line).is_none());
    }

    #[test]
    fn a_token_file_that_is_read_again_replaces_its_tokens() {
        let (anna, line) = make("anna", None).unwrap();
        let (ben, second) = make("ben", None).unwrap();
        let (new, third) = make("anna", Some(7)).unwrap();
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(&file, format!("{line}\n{second}\n")).unwrap();
        let tokens = Tokens::read(Some(file.path()), Some("a token of the environment")).unwrap();
        assert!(tokens.has_file() && tokens.reload().unwrap().is_empty());
        assert!(tokens.admits("anna") && tokens.admits(ADMIN) && !tokens.admits("carl"));
        assert!(Tokens::default().admits(LOCAL), "everybody");
        std::fs::write(&file, format!("{second}\n{third}\n")).unwrap();
        assert_eq!(tokens.reload().unwrap(), ["anna"]);
        assert_eq!((tokens.owner_of(&anna), tokens.owner_of(&new).unwrap().quota), (None, Some(7)));
        // What cannot be read changes nothing.
        for text in ["", "anna\n"] {
            std::fs::write(&file, text).unwrap();
            assert!(tokens.reload().is_err());
            assert_eq!(tokens.owner_of(&ben).unwrap().name, "ben");
        }
        assert_eq!(tokens.owner_of("a token of the environment").unwrap().name, ADMIN);
    }

    #[test]
    fn a_token_file_without_tokens_is_an_error() {
        let file = tempfile::NamedTempFile::new().unwrap();
        for text in ["", "\n\n", "# anna\n", " \t\n  # anna sha256:00\n", "\r\n"] {
            std::fs::write(&file, text).unwrap();
            for environment in [None, Some("a token of the environment")] {
                let read = Tokens::read(Some(file.path()), environment);
                assert!(matches!(read, Err(TokenError::None(_))), "{text:?}");
            }
        }
        assert!(Tokens::read(None, None).unwrap().is_empty());
    }

    #[test]
    fn what_is_no_token_file_is_refused_with_its_line() {
        let file = tempfile::NamedTempFile::new().unwrap();
        for line in ["anna", "anna sha256:00", "a/b sha256:00", &format!("anna sha256:{}", "é".repeat(32))] {
            std::fs::write(&file, format!("\n{line}")).unwrap();
            let error = Tokens::read(Some(file.path()), None).unwrap_err().to_string();
            assert!(error.contains("line 2"), "{error}");
        }
        for token in ["", "short"] {
            assert!(matches!(Tokens::read(None, Some(token)), Err(TokenError::Short)));
        }
        assert!(make("../x", None).is_err());
    }
}
