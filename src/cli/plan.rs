//! `vlscan plan`: surveys from an area, a plot or a line.

use super::args::PlanArgs;
use super::watch::during;
use super::{Console, interrupt, messages};
use vlscan_base::error::Result;
use vlscan_base::files::{is_stdout, write_stdout};
use vlscan_campaign::plan_survey;

pub fn run(args: &PlanArgs, console: &Console) -> Result<()> {
    let command = command_line();
    let work = || plan_survey(&args.request, &command, &console.listener(), &interrupt::STOP);
    let plan = during(console, "planning", work)?;
    for path in &args.request.common().lines {
        let text = format!("{}: lines of the plan", path.display());
        console.wrote(messages::written(path, "lines"), text);
    }
    let Some(path) = args.request.common().file() else { return write_stdout(&plan.text(&command)) };
    for comment in &plan.comments {
        console.say(comment);
    }
    // What went to a pipe has no name to be flown by.
    if !is_stdout(path) {
        let text = format!("{}; fly it with: vlscan run {0} -o points.laz", path.display());
        console.wrote(messages::written(path, "plan"), text);
    }
    Ok(())
}

/// The command line as typed, with quotes where a shell needs them. The form of its messages is left out:
/// plans do not depend on it.
fn command_line() -> String {
    let words = messages::without_format(std::env::args_os().skip(1)).into_iter().map(|word| {
        let word = word.to_string_lossy().into_owned();
        let is_plain = word.chars().all(|c| c.is_alphanumeric() || "-_./=,:#+%".contains(c));
        if is_plain && !word.is_empty() { word } else { format!("'{}'", word.replace('\'', r"'\''")) }
    });
    std::iter::once("vlscan".to_owned()).chain(words).collect::<Vec<_>>().join(" ")
}
