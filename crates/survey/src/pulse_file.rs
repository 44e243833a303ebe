//! Measured pulse shapes: text files of two columns, time in nanoseconds and power in any unit.

use super::PulseSamples;
use super::context::Context;
use super::text::{decode, line_of_bytes};
use std::path::Path;
use std::sync::Arc;
use vlscan_base::diag::Place;

const MAX_SAMPLES: usize = 1 << 16;
/// Maximum size of a file, bytes.
const MAX_FILE_BYTES: u64 = 1 << 24;
/// Minimum number of samples for which a width is defined.
const MIN_SAMPLES: usize = 3;

/// The pulse shape of the file `name`, searched from `folder`. Problems are recorded with file and line; `place` is
/// the place of the reference.
pub(super) fn read_pulse_file(
    context: &Context,
    name: &str,
    folder: &Path,
    place: Place,
) -> Option<Arc<PulseSamples>> {
    let path = context.file(name, folder, place.clone())?;
    let bytes = match context.read(&path, MAX_FILE_BYTES) {
        Ok(bytes) => bytes,
        Err(e) => {
            context.error(place, format!("cannot read {}: {e}", path.display()));
            return None;
        }
    };
    let text = match decode(&bytes) {
        Ok(text) => text,
        Err(e) => {
            let (line, excerpt) = line_of_bytes(&bytes, e.at);
            context.error(Place::in_line(&path, line, &excerpt, 0..0), e.message);
            return None;
        }
    };
    match parse(&text) {
        Ok(samples) => Some(Arc::new(samples)),
        Err((line, message)) => {
            let number = line.unwrap_or(1);
            let excerpt = text.lines().nth(number - 1).unwrap_or_default();
            let at = match line {
                Some(_) => Place::in_line(&path, number, excerpt, 0..excerpt.len()),
                None => place,
            };
            context.error_help(at, message, "a line is a time in ns and a power, such as `0.25, 0.7`");
            None
        }
    }
}

/// Parses lines of time and power, separated by comma, semicolon or blanks; empty lines, `#` comments and a header
/// line are skipped. Times are shifted to begin at 0, powers divided by their maximum.
///
/// # Errors
/// The expected content, with the line number unless the error concerns the complete file.
fn parse(text: &str) -> Result<PulseSamples, (Option<usize>, String)> {
    let (mut times, mut powers): (Vec<f64>, Vec<f64>) = (Vec::new(), Vec::new());
    let mut header_allowed = true;
    for (i, line) in text.lines().enumerate() {
        let content = line.split('#').next().unwrap_or_default().trim();
        if content.is_empty() {
            continue;
        }
        let fields: Vec<&str> = content
            .split(|c: char| c == ',' || c == ';' || c.is_whitespace())
            .filter(|field| !field.is_empty())
            .collect();
        let is_header = header_allowed && fields.iter().all(|field| field.parse::<f64>().is_err());
        header_allowed = false;
        if is_header {
            continue;
        }
        let refuse = |expected: &str| Err((Some(i + 1), format!("expected {expected}")));
        let numbers: Vec<f64> =
            fields.iter().filter_map(|f| f.parse().ok()).filter(|v: &f64| v.is_finite()).collect();
        let (&[time, power], 2) = (numbers.as_slice(), fields.len()) else {
            return refuse("two finite numbers: time in ns and power");
        };
        if times.last().is_some_and(|last| time <= *last) {
            return refuse("a time later than that of the line before");
        }
        if power < 0.0 {
            return refuse("a power of at least 0");
        }
        if times.len() == MAX_SAMPLES {
            return refuse(&format!("at most {MAX_SAMPLES} samples"));
        }
        times.push(time);
        powers.push(power);
    }
    let largest = powers.iter().copied().fold(0.0, f64::max);
    if times.len() < MIN_SAMPLES || largest <= 0.0 {
        let message = format!("expected at least {MIN_SAMPLES} samples of a pulse, one of them above 0");
        return Err((None, message));
    }
    let first = times[0];
    times.iter_mut().for_each(|time| *time -= first);
    powers.iter_mut().for_each(|power| *power /= largest);
    Ok(PulseSamples { times, powers })
}

#[cfg(test)]
mod tests {
    use super::*;

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
