//! The types of values, and how each is read from XML (spec input-formats §1.3).

use serde::de::DeserializeOwned;
use vlscan_base::quantity::NUMBER;

/// How values in XML are read; values in TOML have types.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Reading {
    /// A value that does not parse completely is replaced by its default with a warning.
    Strict,
    /// As [`Reading::Strict`], but numbers may have blanks around them and any text after them.
    Lenient,
    /// A value that does not parse is an error; blanks around it are skipped.
    Required,
    /// As [`Reading::Required`], but blanks are not skipped.
    Exact,
}

/// A type of values.
pub(crate) trait Value: DeserializeOwned {
    /// The types that a `<param>` may declare for it.
    const DECLARED: &'static [&'static str];

    fn parse(text: &str, reading: Reading) -> Option<Self>;
}

/// A type of numbers.
pub(crate) trait Number: Value {
    /// The number as `f64`, the type of all bounds.
    fn to_f64(self) -> f64;

    /// The number at the beginning of a text.
    fn beginning(text: &str) -> Option<f64>;

    /// Expected value, for messages.
    fn expected(reading: Reading) -> &'static str;
}

impl Number for f64 {
    fn to_f64(self) -> f64 {
        self
    }

    fn beginning(text: &str) -> Option<f64> {
        let text = text.trim_start();
        let end = text.bytes().take_while(|b| b.is_ascii_digit() || b"+-.eE".contains(b)).count().min(40);
        (1..=end).rev().find_map(|n| text[..n].parse::<f64>().ok().filter(|v| NUMBER.contains(*v)))
    }

    fn expected(_: Reading) -> &'static str {
        "a number"
    }
}

impl Number for i64 {
    fn to_f64(self) -> f64 {
        self as f64
    }

    fn beginning(text: &str) -> Option<f64> {
        let digits = text.trim().bytes().take_while(u8::is_ascii_digit).count();
        text.trim()[..digits].parse::<u32>().ok().map(f64::from)
    }

    fn expected(reading: Reading) -> &'static str {
        match reading {
            Reading::Strict => "a whole number without decimals or exponent",
            _ => "a whole number",
        }
    }
}

impl Value for f64 {
    const DECLARED: &'static [&'static str] = &["double"];

    fn parse(text: &str, reading: Reading) -> Option<f64> {
        match reading {
            Reading::Strict | Reading::Exact => text.parse().ok(),
            Reading::Lenient | Reading::Required => text.trim().parse().ok(),
        }
    }
}

impl Value for i64 {
    const DECLARED: &'static [&'static str] = &["integer", "int"];

    /// Decimals such as 2.0 are integers of parameters. Lenient integers are counts: any negative one stands
    /// for itself.
    fn parse(text: &str, reading: Reading) -> Option<i64> {
        let whole = |value: f64| (value.fract() == 0.0 && value.abs() < 1e15).then_some(value as i64);
        match reading {
            Reading::Strict | Reading::Exact => text.parse::<i32>().ok().map(i64::from),
            Reading::Lenient if text.trim().starts_with('-') => Some(-1),
            Reading::Lenient => text.trim().parse::<u32>().ok().map(i64::from),
            Reading::Required => text.trim().parse().ok().or_else(|| whole(text.trim().parse().ok()?)),
        }
    }
}

impl Value for bool {
    const DECLARED: &'static [&'static str] = &["boolean", "bool"];

    fn parse(text: &str, reading: Reading) -> Option<bool> {
        match (reading, text.trim()) {
            (Reading::Strict | Reading::Exact, _) => match text {
                "true" | "1" => Some(true),
                "false" | "0" => Some(false),
                _ => None,
            },
            (Reading::Lenient, "True" | "TRUE") => Some(true),
            (Reading::Lenient, "False" | "FALSE") => Some(false),
            (Reading::Lenient, text) => {
                text.parse().ok().or_else(|| text.parse::<i64>().ok().map(|n| n != 0))
            }
            (Reading::Required, text) => bool::parse(&text.to_ascii_lowercase(), Reading::Strict),
        }
    }
}

impl Value for String {
    const DECLARED: &'static [&'static str] = &["string", ""];

    fn parse(text: &str, _: Reading) -> Option<String> {
        Some(text.to_owned())
    }
}

/// Numbers, in XML separated by semicolons.
impl Value for Vec<f64> {
    const DECLARED: &'static [&'static str] = &["vec3"];

    fn parse(text: &str, _: Reading) -> Option<Vec<f64>> {
        text.split(';').map(|word| word.trim().parse().ok()).collect()
    }
}

/// Whole numbers, in XML separated by semicolons.
impl Value for Vec<i64> {
    const DECLARED: &'static [&'static str] = &["string", ""];

    fn parse(text: &str, reading: Reading) -> Option<Vec<i64>> {
        text.split(';').map(|word| i64::parse(word, reading)).collect()
    }
}

/// Three numbers separated by semicolons.
pub(crate) fn parse_vector(text: &str) -> Option<[f64; 3]> {
    Vec::parse(text, Reading::Required)?.try_into().ok()
}
