//! Messages of vlscan in the terms of requests: options of its command line are inputs of processes, and
//! hints that name options which only the service gives are left out.

use serde::{Deserialize, Serialize};

/// Terms of messages.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Terms {
    /// Options, which requests of campaigns have in texts.
    #[default]
    Options,
    /// Inputs of a process, which have the names of options with underscores.
    Inputs,
}

/// Options that only the service gives.
const OWN: [&str; 10] =
    ["force", "json", "list", "message-format", "progress", "resume", "retry", "shard", "task", "threads"];

impl Terms {
    /// The terms of a command.
    pub(crate) fn of(words: &[String]) -> Terms {
        match words.first().map(String::as_str) {
            Some("campaign") => Terms::Options,
            _ => Terms::Inputs,
        }
    }

    /// A message in these terms, without an advice at its end that names options of the service.
    pub(crate) fn message(self, text: &str) -> String {
        let text = match text.rsplit_once("; ") {
            Some((start, advice)) if has_own(advice) => start,
            _ => text,
        };
        match self {
            Terms::Options => text.to_owned(),
            Terms::Inputs => with_inputs(text),
        }
    }

    /// A hint in these terms; `None` for one that names options of the service.
    pub(crate) fn help(self, text: &str) -> Option<String> {
        (!has_own(text)).then(|| self.message(text))
    }
}

fn has_own(text: &str) -> bool {
    options(text).any(|(_, name)| OWN.contains(&name))
}

/// The options in a text: their places, and their names without dashes.
fn options(text: &str) -> impl Iterator<Item = (usize, &str)> {
    let mut from = 0;
    std::iter::from_fn(move || {
        let (at, name) = next_option(text, from)?;
        from = at + 2 + name.len();
        Some((at, name))
    })
}

fn next_option(text: &str, from: usize) -> Option<(usize, &str)> {
    text[from..].match_indices("--").find_map(|(at, _)| {
        let at = from + at;
        let before = text[..at].chars().next_back();
        let is_start = before.is_none_or(|c| c.is_whitespace() || "'\"(`".contains(c));
        let rest = &text[at + 2..];
        let end = rest.find(|c: char| !c.is_ascii_alphanumeric() && c != '-').unwrap_or(rest.len());
        let name = rest[..end].trim_end_matches('-');
        (is_start && name.starts_with(|c: char| c.is_ascii_lowercase())).then_some((at, name))
    })
}

/// A text with inputs in place of options, but for whole commands: `` `vlscan fit` ``.
fn with_inputs(text: &str) -> String {
    let mut written = String::new();
    for (number, part) in text.split('`').enumerate() {
        let is_quoted = number % 2 == 1;
        if number > 0 {
            written.push('`');
        }
        match is_quoted && part.starts_with("vlscan ") {
            true => written.push_str(part),
            false => written.push_str(&replaced(part, if is_quoted { "" } else { "`" })),
        }
    }
    written
}

/// A text with inputs in these quotes in place of options.
fn replaced(text: &str, quote: &str) -> String {
    let mut written = String::new();
    let mut from = 0;
    for (at, name) in options(text) {
        written.push_str(text.get(from..at).unwrap_or_default());
        let end = at + 2 + name.len();
        // `--height <M>`
        let value = text[end..].strip_prefix(" <").and_then(|rest| {
            let length = rest.find(['>', ' '])?;
            rest[length..].starts_with('>').then_some(length)
        });
        from = end + value.map_or(0, |length| length + 3);
        if written.ends_with('\'') && text[from..].starts_with('\'') {
            written.pop();
            from += 1;
        }
        written.extend([quote, &name.replace('-', "_"), quote]);
    }
    written.push_str(text.get(from..).unwrap_or_default());
    written
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_become_inputs() {
        for (text, expected) in [
            (
                "invalid value '-5' for '--height <M>': expected a number above 0",
                "invalid value '-5' for `height`: expected a number above 0",
            ),
            (
                "the following required arguments were not provided:\n  --height <M>\n  --follow-terrain",
                "the following required arguments were not provided:\n  `height`\n  `follow_terrain`",
            ),
            (
                "--density, --speed and --overlap determine each other: leave one out",
                "`density`, `speed` and `overlap` determine each other: leave one out",
            ),
            ("use `--physics refined` or `--correct gain`", "use `physics refined` or `correct gain`"),
            (
                "`vlscan fit a.laz --output f.toml` estimates it",
                "`vlscan fit a.laz --output f.toml` estimates it",
            ),
            ("a--b.obj: 5 -- 7 --- é--x (--crs)", "a--b.obj: 5 -- 7 --- é--x (`crs`)"),
            ("a.laz exists already; overwrite it with --force", "a.laz exists already"),
            ("'--a <--b>'", "`a`"),
            ("--a < 5, 7 > 5", "`a` < 5, 7 > 5"),
        ] {
            assert_eq!(Terms::Inputs.message(text), expected);
        }
        let campaign = Terms::of(&["campaign".to_owned()]);
        assert_eq!(campaign.message("unexpected argument '--sed'"), "unexpected argument '--sed'");
        assert_eq!(Terms::of(&["plan".to_owned()]), Terms::Inputs);
    }

    #[test]
    fn hints_about_options_of_the_service_are_left_out() {
        assert_eq!(Terms::Inputs.help("run without --shard to see the likely cause"), None);
        let retry = "vlscan campaign campaign.toml --cell a --retry computes it again";
        assert_eq!(Terms::Options.help(retry), None);
        assert_eq!(Terms::Inputs.help("name it with --crs").as_deref(), Some("name it with `crs`"));
        assert_eq!(Terms::Options.help("write b").as_deref(), Some("write b"));
    }
}
