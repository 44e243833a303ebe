//! `vlscan fit`: a flight and its scanner from a recorded point cloud, a spinning sensor from a revolution,
//! the scan pattern of a sensor that stood still.

use super::args::{FitArgs, FittedHalf};
use super::watch::during;
use super::{Console, messages};
use std::path::Path;
use vlscan_base::diag::Diagnostics;
use vlscan_base::error::{Error, Result};
use vlscan_base::files::write_stdout;
use vlscan_base::quantity::amount;
use vlscan_fit::flight::{FlightFiles, FlightRequest, fit_flight, json, table};
use vlscan_fit::spinning::{Half, SpinningFiles, SpinningRequest, fit_spinning};
use vlscan_fit::still::{StillFiles, StillPattern};
use vlscan_geom::DVec3;
use vlscan_options::outputs::check_content;

pub fn run(args: &FitArgs, console: &Console) -> Result<()> {
    check_content("-o", &args.out, "TOML")?;
    args.planes.as_deref().map_or(Ok(()), |path| check_content("--planes", path, "OBJ"))?;
    if let Some(calibration) = &args.calibration {
        return run_spinning(args, calibration, console);
    }
    if let Some(place) = &args.still_at {
        return run_still(args, DVec3::from(place.0), console);
    }
    FlightFiles::check(&args.out, &args.cloud, args.force)?;
    let mut found = Diagnostics::default();
    let max_memory = args.max_memory.map(|bytes| bytes.0);
    let request = FlightRequest { flight_line: args.flight_line, extend: args.extend, max_memory };
    let fit = during(console, "fitting the instrument", || fit_flight(&args.cloud, &request, &mut found));
    console.warnings(&found.finish(false)?)?;
    let fit = fit?;
    let files = fit.write(&args.out, &format!("vlscan fit {}", args.cloud.display()), args.force)?;
    let figures = fit.figures();
    match args.json {
        true => write_stdout(&(json(&figures)? + "\n"))?,
        false => write_stdout(&table(&figures))?,
    }
    let others: Vec<String> = files.all().skip(1).map(|path| path.display().to_string()).collect();
    console.record(|result| result.files.extend(files.all().map(|path| messages::written(path, "fit"))));
    console.say(format!(
        "{}: {} pulses fitted; beside it {}",
        files.pipeline.display(),
        amount(fit.recording.pulses.len() as f64),
        others.join(", ")
    ));
    Ok(())
}

/// Fits the noise and the detection of a spinning sensor.
fn run_spinning(args: &FitArgs, calibration: &Path, console: &Console) -> Result<()> {
    let files = SpinningFiles::new(&args.out, args.planes.as_deref());
    files.check([&args.cloud, calibration], args.force)?;
    let mut found = Diagnostics::default();
    let half = match args.half {
        FittedHalf::Even => Half::Even,
        FittedHalf::Odd => Half::Odd,
    };
    let fit = during(console, "fitting the sensor", || {
        fit_spinning(&args.cloud, calibration, &SpinningRequest { half }, &mut found)
    });
    console.warnings(&found.finish(false)?)?;
    let fit = fit?;
    let command = format!("vlscan fit {} --calibration {}", args.cloud.display(), calibration.display());
    fit.write(&files, (calibration, &command), args.force)?;
    let figures = fit.figures();
    match args.json {
        true => write_stdout(&(figures.json()? + "\n"))?,
        false => write_stdout(&figures.table())?,
    }
    let others: Vec<String> = files.all().skip(1).map(|path| format!(", {}", path.display())).collect();
    console.record(|result| result.files.extend(files.all().map(|path| messages::written(path, "fit"))));
    console.say(format!(
        "{}: {} planes fitted{}",
        args.out.display(),
        amount(figures.planes as f64),
        others.concat()
    ));
    Ok(())
}

/// Writes the scan pattern of a sensor that stood still.
fn run_still(args: &FitArgs, place: DVec3, console: &Console) -> Result<()> {
    let files = StillFiles::new(&args.out);
    files.check(&args.cloud, args.force)?;
    let mut found = Diagnostics::default();
    let max_memory = args.max_memory.map(|bytes| bytes.0);
    let pattern = during(console, "reading the pattern", || {
        StillPattern::read(&args.cloud, place, max_memory, &mut found)
    });
    console.warnings(&found.finish(false)?)?;
    let pattern = pattern?;
    let [x, y, z] = place.to_array();
    let command = format!("vlscan fit {} --still-at {x},{y},{z}", args.cloud.display());
    pattern.write(&files, &command, args.force)?;
    let figures = pattern.figures();
    match args.json {
        true => {
            let text = serde_json::to_string_pretty(&figures).map_err(|e| Error::Internal(e.to_string()))?;
            write_stdout(&(text + "\n"))?;
        }
        false => write_stdout(&figures.table())?,
    }
    console.record(|result| result.files.extend(files.all().map(|path| messages::written(path, "fit"))));
    console.say(format!(
        "{}: a pattern of {} pulses, {}",
        files.pipeline.display(),
        amount(figures.pulses as f64),
        files.pattern.display()
    ));
    Ok(())
}
