//! Switches: options without a value. Each has an opposite, by which the command line undoes the choice of a
//! file.

use clap::{Arg, ArgAction, ArgMatches, Args, Command, FromArgMatches};
use serde::Deserialize;
use std::any::TypeId;
use std::convert::Infallible;
use std::str::FromStr;

/// State of an option without a value.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(from = "bool")]
pub enum Switch {
    /// Nothing is said of it.
    #[default]
    Unset,
    /// It is chosen.
    On,
    /// It is not chosen, even if a source of less precedence chooses it.
    Off,
}

impl Switch {
    /// True if the option is chosen.
    pub fn is_on(self) -> bool {
        self == Switch::On
    }

    /// A switch that is chosen, or of which nothing is said.
    pub fn given(is_given: bool) -> Switch {
        if is_given { Switch::On } else { Switch::Unset }
    }

    /// The switch that has the opposite meaning.
    pub fn negated(self) -> Switch {
        match self {
            Switch::Unset => Switch::Unset,
            Switch::On => Switch::Off,
            Switch::Off => Switch::On,
        }
    }
}

impl From<bool> for Switch {
    fn from(on: bool) -> Switch {
        if on { Switch::On } else { Switch::Off }
    }
}

/// The value of an opposite on the command line.
const OFF: &str = "off";

/// Parses the values that clap gives to switches: `true` where one is typed, else `false`, and that of its
/// opposite.
impl FromStr for Switch {
    type Err = Infallible;

    fn from_str(text: &str) -> Result<Switch, Infallible> {
        Ok(match text {
            "true" => Switch::On,
            OFF => Switch::Off,
            _ => Switch::Unset,
        })
    }
}

/// The name of the opposite of a switch: `no-misses` for `misses`, `leg-noise` for `no-leg-noise`.
fn opposite(long: &str) -> String {
    long.strip_prefix("no-").map_or_else(|| format!("no-{long}"), str::to_owned)
}

/// The opposites of all switches of a command that are defined before it. The last one of a switch and its
/// opposite counts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Opposites;

impl Args for Opposites {
    fn augment_args(command: Command) -> Command {
        let is_switch = |arg: &&Arg| arg.get_value_parser().type_id() == TypeId::of::<Switch>();
        let names = |arg: &Arg| Some((arg.get_id().clone(), arg.get_long()?.to_owned()));
        let switches: Vec<_> = command.get_arguments().filter(is_switch).filter_map(names).collect();
        switches.into_iter().fold(command, |command, (id, long)| {
            let name = opposite(&long);
            if command.get_arguments().any(|arg| arg.get_long() == Some(&name)) {
                return command;
            }
            let help = format!("Undo --{long} of a pipeline file.");
            let arg = Arg::new(name.clone()).long(name.clone()).action(ArgAction::SetTrue).hide(true);
            command
                .mut_arg(&id, |arg| {
                    arg.default_value_if(name.clone(), clap::builder::ArgPredicate::IsPresent, OFF)
                        .overrides_with(name)
                })
                .arg(arg.help(help).help_heading(None).overrides_with(id))
        })
    }

    fn augment_args_for_update(command: Command) -> Command {
        Opposites::augment_args(command)
    }
}

impl FromArgMatches for Opposites {
    fn from_arg_matches(_: &ArgMatches) -> Result<Opposites, clap::Error> {
        Ok(Opposites)
    }

    fn update_from_arg_matches(&mut self, _: &ArgMatches) -> Result<(), clap::Error> {
        Ok(())
    }
}
