//! One of several equal shares.

use std::str::FromStr;

/// `K/N`: one of N shares, number K from 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OneOf {
    /// K.
    pub number: u32,
    /// N.
    pub of: u32,
}

/// Maximum number of shares.
const MAX_SHARES: u32 = 1_000_000;

/// A text that is not one of several shares.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("expected K/N with K from 0 to N-1, such as 3/256, found {0:?}")]
pub struct OneOfError(pub String);

impl FromStr for OneOf {
    type Err = OneOfError;

    fn from_str(text: &str) -> Result<OneOf, OneOfError> {
        let numbers =
            text.split_once('/').and_then(|(k, n)| Some((k.trim().parse().ok()?, n.trim().parse().ok()?)));
        match numbers {
            Some((number, of)) if number < of && of <= MAX_SHARES => Ok(OneOf { number, of }),
            _ => Err(OneOfError(text.to_owned())),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_are_parsed() {
        for (text, expected) in [("3/256", Some((3, 256))), ("0/1", Some((0, 1)))]
            .into_iter()
            .chain(["256/256", "1", "-1/2", "0/0", "/", "0/1000001"].map(|text| (text, None)))
        {
            let read = text.parse::<OneOf>().ok().map(|share| (share.number, share.of));
            assert_eq!(read, expected, "{text}");
        }
    }
}
