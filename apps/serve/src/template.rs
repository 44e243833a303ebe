//! Commands of an engine: words with placeholders, executed without a shell.

use std::fs::File;
use std::io::{self, Read as _, Seek as _};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// Longest time of a command.
const MAX_TIME: Duration = Duration::from_secs(60);
const POLL: Duration = Duration::from_millis(20);
/// Most bytes of its output that are read.
const MAX_OUTPUT: u64 = 64 << 10;

/// Words with placeholders in braces.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Template {
    words: Vec<String>,
}

/// Value of a placeholder.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Value {
    /// A text.
    Text(String),
    /// Words: as such where the placeholder is a word of its own, else as a shell quotes them.
    Words(Vec<String>),
}

/// End of a command.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Ended {
    /// With success, and this output.
    Success(String),
    /// With these messages.
    Failure(String),
    /// It was ended because its caller does not go on.
    GivenUp,
}

/// A command line that is not a template.
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum TemplateError {
    /// A line with a quote that does not end.
    #[error("`{0}`: a quote is not closed")]
    OpenQuote(String),
    /// A line without words.
    #[error("expected a command")]
    Empty,
    /// An unknown placeholder.
    #[error("{{{name}}} is no placeholder; expected {known}", known = in_braces(.known))]
    Placeholder {
        /// Its name.
        name: String,
        /// Names of the known placeholders.
        known: Vec<String>,
    },
}

/// Names of placeholders as they are written, with commas between them.
fn in_braces(names: &[String]) -> String {
    let names: Vec<String> = names.iter().map(|name| format!("{{{name}}}")).collect();
    names.join(", ")
}

impl Template {
    /// Divides a command line into words, as a shell does, and checks its placeholders against those that
    /// are known.
    ///
    /// # Errors
    /// A line that is not a command, and placeholders that are not known.
    pub fn new(line: &str, known: &[&str]) -> Result<Template, TemplateError> {
        let words = shlex::split(line).ok_or_else(|| TemplateError::OpenQuote(line.to_owned()))?;
        if words.is_empty() {
            return Err(TemplateError::Empty);
        }
        for word in &words {
            for name in placeholders(word) {
                if !known.contains(&name) {
                    let known = known.iter().map(|name| (*name).to_owned()).collect();
                    return Err(TemplateError::Placeholder { name: name.to_owned(), known });
                }
            }
        }
        Ok(Template { words })
    }

    /// The words with values for the placeholders.
    pub fn filled(&self, values: &[(&str, Value)]) -> Vec<String> {
        let mut filled = Vec::new();
        for word in &self.words {
            let own = values.iter().find(|(name, _)| *word == format!("{{{name}}}"));
            if let Some((_, Value::Words(words))) = own {
                filled.extend(words.iter().cloned());
                continue;
            }
            let mut word = word.clone();
            for (name, value) in values {
                let text = match value {
                    Value::Text(text) => text.clone(),
                    // Without zero bytes, which no word of ours has, everything can be quoted.
                    Value::Words(words) => {
                        shlex::try_join(words.iter().map(String::as_str)).unwrap_or_default()
                    }
                };
                word = word.replace(&format!("{{{name}}}"), &text);
            }
            filled.push(word);
        }
        filled
    }

    /// Executes the command. `goes_on` is asked again and again whether to.
    ///
    /// # Errors
    /// If it cannot be started, and those of `goes_on`.
    pub fn execute<E: From<io::Error>>(
        &self,
        values: &[(&str, Value)],
        goes_on: &mut dyn FnMut() -> Result<bool, E>,
    ) -> Result<Ended, E> {
        let words = self.filled(values);
        let (output, messages) = (tempfile::tempfile()?, tempfile::tempfile()?);
        let mut child = Command::new(&words[0])
            .args(&words[1..])
            .stdin(Stdio::null())
            .stdout(output.try_clone()?)
            .stderr(messages.try_clone()?)
            .spawn()
            .map_err(|e| io::Error::new(e.kind(), format!("{}: {e}", words[0])))?;
        let start = Instant::now();
        loop {
            if let Some(status) = child.try_wait()? {
                return Ok(match status.success() {
                    true => Ended::Success(text_of(output)?),
                    false => Ended::Failure(format!("{}: {status}: {}", words[0], text_of(messages)?.trim())),
                });
            }
            let is_late = start.elapsed() > MAX_TIME;
            if is_late || !goes_on()? {
                child.kill()?;
                child.wait()?;
                return Ok(match is_late {
                    true => Ended::Failure(format!("{}: no answer for {} s", words[0], MAX_TIME.as_secs())),
                    false => Ended::GivenUp,
                });
            }
            std::thread::sleep(POLL);
        }
    }
}

fn text_of(mut file: File) -> io::Result<String> {
    file.rewind()?;
    let mut bytes = Vec::new();
    file.take(MAX_OUTPUT).read_to_end(&mut bytes)?;
    Ok(String::from_utf8_lossy(&bytes).into_owned())
}

/// Names in braces; what else stands in braces is no placeholder.
fn placeholders(word: &str) -> impl Iterator<Item = &str> {
    word.split('{')
        .skip(1)
        .filter_map(|rest| rest.split_once('}'))
        .map(|(name, _)| name)
        .filter(|name| !name.is_empty() && name.bytes().all(|byte| byte.is_ascii_lowercase()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn placeholders_are_words_or_parts_of_them() {
        let template = Template::new(
            "sbatch --array=0-{last} '--wrap={command}' {command} -o '{.x}'",
            &["last", "command"],
        );
        let values = [
            ("last", Value::Text("7".to_owned())),
            ("command", Value::Words(["a b", "c"].map(str::to_owned).to_vec())),
        ];
        assert_eq!(
            template.unwrap().filled(&values),
            ["sbatch", "--array=0-7", "--wrap='a b' c", "a b", "c", "-o", "{.x}"]
        );
        assert!(Template::new("a {nme}", &["name"]).unwrap_err().to_string().ends_with("expected {name}"));
        assert!(matches!(Template::new("a 'b", &[]), Err(TemplateError::OpenQuote(_))));
        assert!(Template::new(" ", &[]).is_err());
    }

    #[test]
    #[cfg(unix)]
    fn commands_end_with_their_output_or_messages() {
        let execute = |line: &str, goes_on: bool| {
            let template = Template::new(line, &[]).unwrap();
            template.execute::<io::Error>(&[], &mut || Ok(goes_on)).unwrap()
        };
        assert_eq!(execute("echo a b", true), Ended::Success("a b\n".to_owned()));
        let Ended::Failure(message) = execute("sh -c 'echo no >&2; exit 3'", true) else { panic!("success") };
        assert!(message.ends_with("no"), "{message}");
        assert_eq!(execute("sleep 1000", false), Ended::GivenUp);
    }
}
