//! Options as words of a command line, for callers without a command line.

use super::groups::{FILES, Options};
use super::python::python_type;
use clap::{Arg, ArgAction, Args, Command, FromArgMatches};
use vlscan_base::error::{Error, Result};

/// An option of a run as a program may list it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct OptionName {
    /// Name on the command line, without hyphens before it.
    pub long: String,
    /// Effect of the option.
    pub help: String,
    /// True if the option takes a value.
    pub has_value: bool,
    /// True if the option may be given more than once.
    pub is_list: bool,
    /// True if the option concerns only the writing of files.
    pub is_of_files: bool,
    /// Type of its values in Python, if they have one.
    pub python_type: Option<String>,
}

/// Options that programs pass by their own arguments, and options of terminals.
const NOT_LISTED: [&str; 8] =
    ["out", "trajectory", "scene", "waveforms", "pulses", "schedule-log", "progress", "parts"];

/// True if an option may be given more than once.
pub(super) fn is_list(option: &Arg) -> bool {
    matches!(option.get_action(), ArgAction::Append)
}

pub(super) fn command() -> Command {
    let options = Options::augment_args(Command::new("options").no_binary_name(true));
    with_negative_numbers(options).disable_help_flag(true)
}

/// Makes negative numbers after options their values, so that messages say what the options expect; they
/// would be unknown options.
pub fn with_negative_numbers(command: Command) -> Command {
    command
        .mut_args(|arg| {
            let has_value = !arg.is_positional() && arg.get_action().takes_values();
            if has_value { arg.allow_negative_numbers(true) } else { arg }
        })
        .mut_subcommands(with_negative_numbers)
}

impl Options {
    /// Parses options as `vlscan run` takes them behind the name of the file: `--seed=1 --misses`.
    ///
    /// # Errors
    /// [`Error::Input`] for unknown options and invalid values.
    pub fn parse(words: impl IntoIterator<Item = String>) -> Result<Options> {
        let found = command().try_get_matches_from(words).and_then(|found| Options::from_arg_matches(&found));
        found.map_err(|error| {
            let text = error.render().to_string();
            let message = text.split("\n\nUsage:").next().unwrap_or_default();
            let message = message.trim().trim_start_matches("error: ");
            Error::input(message.split("\n\nFor more information").next().unwrap_or_default().trim())
        })
    }

    /// The options of a run that a program may pass, without the opposites of switches.
    pub fn names() -> Vec<OptionName> {
        let command = command();
        let options = command.get_arguments().filter(|option| !option.is_hide_set()).filter_map(|option| {
            let long = option.get_long().filter(|long| !NOT_LISTED.contains(long))?;
            let help = option.get_long_help().or(option.get_help()).map(ToString::to_string);
            Some(OptionName {
                long: long.to_owned(),
                help: help.unwrap_or_default(),
                has_value: option.get_action().takes_values(),
                is_list: is_list(option),
                is_of_files: option.get_help_heading() == Some(FILES) || long == "output",
                python_type: python_type(option),
            })
        });
        options.collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_become_options() {
        let words = |text: &str| Options::parse(text.split_whitespace().map(str::to_owned));
        let options = words("--threads=3 --misses --columns=X,Y").unwrap();
        assert_eq!((options.schedule.threads, options.output.misses.is_on()), (Some(3), true));
        let unknown = words("--thread=3").unwrap_err().to_string();
        assert!(unknown.contains("--threads") && !unknown.contains("Usage"), "{unknown}");
        assert!(words("--columns=Q").unwrap_err().to_string().contains("no column is called"));
        assert!(words("--tile -5").unwrap_err().to_string().contains("expected a number above 0"));
    }

    #[test]
    fn options_are_listed_with_their_help() {
        let names = Options::names();
        let of = |long: &str| names.iter().find(|option| option.long == long).unwrap();
        assert!(of("seed").has_value && !of("misses").has_value && of("navigation-error").is_list);
        assert!(of("labels").is_of_files && !of("columns").is_of_files);
        assert_eq!(of("gps-start").python_type.as_deref(), Some("float | str | datetime"));
        assert!(names.iter().all(|option| !option.help.is_empty() && option.python_type.is_some()));
    }
}
