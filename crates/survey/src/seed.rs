//! The formats of a seed (spec outputs §9.3).

/// Seconds of a year, month, day, hour and minute in seeds: every month has 30 days.
const YEAR: i64 = 31_104_000;
const MONTH: i64 = 2_592_000;
const DAY: i64 = 86_400;
const HOUR: i64 = 3_600;
const MINUTE: i64 = 60;

/// Parses a seed: an integer; a decimal number, whose bit pattern is the seed; or a time stamp `YYYY-MM-DD
/// hh:mm:ss`, converted to seconds with months of 30 days.
///
/// # Errors
/// [`SeedError`] for any other text.
///
/// ```
/// use vlscan_survey::parse_seed;
/// assert_eq!(parse_seed("43"), Ok(43));
/// assert_eq!(parse_seed("1970-01-01 00:00:01"), Ok(2_592_000 + 86_400 + 1));
/// ```
pub fn parse_seed(text: &str) -> Result<u64, SeedError> {
    let text = text.trim();
    let seed = if text.contains(':') {
        time_stamp(text).map(|s| s as u64)
    } else if text.contains('.') {
        text.parse::<f64>().ok().filter(|s| s.is_finite()).map(f64::to_bits)
    } else {
        text.parse::<u64>().ok().or_else(|| text.parse::<i64>().ok().map(|s| s as u64))
    };
    seed.ok_or_else(|| SeedError { text: text.to_owned() })
}

/// A text that is not a seed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SeedError {
    /// The text.
    pub text: String,
}

impl std::fmt::Display for SeedError {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        let expected = "a whole number, a decimal number or a time stamp YYYY-MM-DD hh:mm:ss";
        write!(f, "`{}` is not a seed: expected {expected}", self.text)
    }
}

impl std::error::Error for SeedError {}

fn time_stamp(text: &str) -> Option<i64> {
    let (date, time) = text.split_once(' ')?;
    let [year, month, day] = numbers(date, '-')?;
    let [hour, minute, second] = numbers(time.trim_start(), ':')?;
    let valid = (1970..=9999).contains(&year)
        && (1..=12).contains(&month)
        && (1..=31).contains(&day)
        && hour < 24
        && minute < 60
        && second <= 60;
    let seconds = (year - 1970) * YEAR + month * MONTH + day * DAY + hour * HOUR + minute * MINUTE + second;
    valid.then_some(seconds)
}

fn numbers(text: &str, separator: char) -> Option<[i64; 3]> {
    let mut parts = text.split(separator).map(|p| {
        let digits = (1..=4).contains(&p.len()) && p.bytes().all(|b| b.is_ascii_digit());
        digits.then(|| p.parse().ok()).flatten()
    });
    let found = [parts.next()??, parts.next()??, parts.next()??];
    parts.next().is_none().then_some(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn three_forms() {
        assert_eq!(parse_seed(" 7 "), Ok(7));
        assert_eq!(parse_seed("-1"), Ok(u64::MAX));
        assert_eq!(parse_seed("1.5"), Ok(1.5f64.to_bits()));
        let stamp = 52 * YEAR + 3 * MONTH + 4 * DAY + 5 * HOUR + 6 * MINUTE + 7;
        assert_eq!(parse_seed("2022-03-04 05:06:07"), Ok(stamp as u64));
    }

    #[test]
    fn everything_else_is_refused() {
        for text in [
            "",
            "AUTO",
            "12abc",
            "1.2.3",
            "12:30",
            "2022-13-01 00:00:00",
            "2022-01-01 00:00",
            "nan.",
            "1:2:3",
        ] {
            assert!(parse_seed(text).unwrap_err().to_string().contains("time stamp"), "{text}");
        }
    }
}
