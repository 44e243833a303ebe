//! `vlscan fit`: a flight and its scanner from a recorded point cloud.

use super::Console;
use super::args::FitArgs;
use vlscan_base::diag::Diagnostics;
use vlscan_base::error::Result;
use vlscan_base::files::{refuse_existing, write_stdout};
use vlscan_base::quantity::amount;
use vlscan_fit::flight::{FlightRequest, fit_flight, json, table};

pub fn run(args: &FitArgs, console: &Console) -> Result<()> {
    refuse_existing(&args.out, args.force)?;
    let mut found = Diagnostics::default();
    let fit = fit_flight(&args.cloud, &FlightRequest { flight_line: args.flight_line }, &mut found);
    console.warnings(&found.finish(false)?)?;
    let fit = fit?;
    let files = fit.write(&args.out, &format!("vlscan fit {}", args.cloud.display()), args.force)?;
    let figures = fit.figures();
    match args.json {
        true => write_stdout(&(json(&figures)? + "\n"))?,
        false => write_stdout(&table(&figures))?,
    }
    let beside: Vec<String> = files.all().skip(1).map(|path| path.display().to_string()).collect();
    console.say(format!(
        "{}: {} pulses fitted; beside it {}",
        files.pipeline.display(),
        amount(fit.recording.pulses.len() as f64),
        beside.join(", ")
    ));
    Ok(())
}
