//! Measured pulse shapes: text files of two columns, time in nanoseconds and power in any unit.

use super::PulseSamples;
use super::context::Context;
use super::rows::{MAX_FILE_BYTES, RowLayout, RowProblem, read_rows};
use std::path::Path;
use std::sync::Arc;
use vlscan_base::diag::Place;

const MAX_SAMPLES: usize = 1 << 16;
/// Minimum number of samples for which a width is defined.
const MIN_SAMPLES: usize = 3;

/// The pulse shape of the file `name`, searched from `folder`. Problems are recorded with file and line;
/// `place` is the place of the reference.
pub(super) fn read_pulse_file(
    context: &Context,
    name: &str,
    folder: &Path,
    place: Place,
) -> Option<Arc<PulseSamples>> {
    let mut samples = PulseSamples { times: Vec::new(), powers: Vec::new() };
    read_rows(context, name, (folder, MAX_FILE_BYTES), &place, &FORMAT, |row| add(&mut samples, row))?;
    match normalised(samples) {
        Ok(samples) => Some(Arc::new(samples)),
        Err(expected) => {
            context.error_help(place, format!("expected {expected}"), FORMAT.help);
            None
        }
    }
}

const FORMAT: RowLayout<2> = RowLayout {
    columns: "two finite numbers: time in ns and power",
    help: "a line is a time in ns and a power, such as `0.25, 0.7`",
    headings: ["time_ns", "power"],
};

fn add(samples: &mut PulseSamples, &[time, power]: &[f64; 2]) -> Result<(), RowProblem> {
    if samples.times.last().is_some_and(|last| time <= *last) {
        return Err(RowProblem::NotLater);
    }
    if power < 0.0 {
        return Err(RowProblem::NegativePower);
    }
    if samples.times.len() == MAX_SAMPLES {
        return Err(RowProblem::TooMany { max: MAX_SAMPLES });
    }
    samples.times.push(time);
    samples.powers.push(power);
    Ok(())
}

/// Shifts times to begin at 0 and divides powers by their maximum.
///
/// # Errors
/// The expected content of the file.
fn normalised(mut samples: PulseSamples) -> Result<PulseSamples, RowProblem> {
    let largest = samples.powers.iter().copied().fold(0.0, f64::max);
    if samples.times.len() < MIN_SAMPLES || largest <= 0.0 {
        return Err(RowProblem::TooFew { min: MIN_SAMPLES });
    }
    let first = samples.times[0];
    samples.times.iter_mut().for_each(|time| *time -= first);
    samples.powers.iter_mut().for_each(|power| *power /= largest);
    Ok(samples)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rows::parse_rows;

    fn parse(text: &str) -> Result<PulseSamples, (Option<usize>, String)> {
        let mut samples = PulseSamples { times: Vec::new(), powers: Vec::new() };
        parse_rows(text, &FORMAT, |row| add(&mut samples, row))
            .map_err(|(line, expected)| (Some(line), expected.to_string()))?;
        normalised(samples).map_err(|expected| (None, expected.to_string()))
    }

    #[test]
    fn samples_begin_at_0_and_peak_at_1() {
        let text = "time_ns,power\n# measured\n10, 0\n11.5;4 # front\n13\t8\n\n20 2\n";
        let samples = parse(text).unwrap();
        assert_eq!(samples.times, [0.0, 1.5, 3.0, 10.0]);
        assert_eq!(samples.powers, [0.0, 0.5, 1.0, 0.25]);
    }

    #[test]
    fn lines_that_are_no_samples_are_named() {
        let cases = [
            ("0 1\n1 2\n2\n", Some(3), "two finite numbers"),
            ("0 1\n1 2 3\n", Some(2), "two finite numbers"),
            ("0 1\n1 inf\n", Some(2), "two finite numbers"),
            ("0 1\ntime power\n", Some(2), "two finite numbers"),
            ("power,time_ns\n0 1\n", Some(1), "`time_ns` as column 1, found `power`"),
            ("time_ps,power\n0 1\n", None, "at least 3"),
            ("time_us,power\n0 1\n", Some(1), "`time_ns` as column 1, found `time_us`"),
            ("0 1\n0 2\n", Some(2), "later"),
            ("0 1\n1 -2\n", Some(2), "at least 0"),
            ("0 1\n1 2\n", None, "at least 3"),
            ("0 0\n1 0\n2 0\n", None, "above 0"),
        ];
        for (text, line, words) in cases {
            let (found, message) = parse(text).unwrap_err();
            assert_eq!(found, line, "{text:?}");
            assert!(message.contains(words), "{message} does not say {words}");
        }
    }
}
