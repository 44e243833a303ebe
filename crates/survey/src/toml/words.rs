//! Errors of TOML in the words of its users: no names of types, and hints at backslashes in texts.

use crate::KeyTable;
use vlscan_base::columns::has_decimal_comma;

/// A problem in words, with a hint or an empty text.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Wording {
    pub message: String,
    pub hint: String,
}

/// Names of types in serde, and their names in a pipeline file.
const TYPES: [(&str, &str); 27] = [
    ("f64", "a number"),
    ("f32", "a number"),
    ("i8", "a whole number"),
    ("i16", "a whole number"),
    ("i32", "a whole number"),
    ("i64", "a whole number"),
    ("u8", "a whole number from 0 to 255"),
    ("u16", "a whole number from 0 to 65535"),
    ("u32", "a whole number from 0 to 4294967295"),
    ("u64", "a whole number of at least 0"),
    ("usize", "a whole number of at least 0"),
    ("bool", "true or false"),
    ("a boolean", "true or false"),
    ("a character", "one character in quotes"),
    ("char", "one character in quotes"),
    ("a string", "a text in quotes"),
    ("a borrowed string", "a text in quotes"),
    ("path string", "a path in quotes"),
    ("a sequence", "a list in brackets"),
    ("a map", "a table"),
    ("option", "a value"),
    ("unit", "nothing"),
    ("string or table", "a text in quotes"),
    ("a tuple of size 2", "two values in brackets"),
    ("a tuple of size 3", "three values in brackets"),
    ("an array of length 2", "two numbers in brackets"),
    ("an array of length 3", "three numbers in brackets"),
];

/// The message of an error of serde about a value: "invalid type: FOUND, expected TYPE" and the like.
pub(crate) fn of_value(message: &str) -> String {
    let Some((before, expected)) = message.split_once(", expected ") else { return message.to_owned() };
    let length = before.strip_prefix("invalid length ").map(|length| ("invalid length", length));
    let Some((kind, found)) = length.or_else(|| before.split_once(": ")) else { return message.to_owned() };
    let expected = expected.trim();
    let type_name = match expected.strip_prefix("struct ") {
        Some(_) => "a table".to_owned(),
        None if expected.starts_with("enum ") || expected == "variant identifier" => {
            "one of its names in quotes".to_owned()
        }
        None => match TYPES.iter().find(|known| known.0 == expected) {
            Some((_, words)) => (*words).to_owned(),
            None => expected.to_owned(),
        },
    };
    match kind {
        "invalid type" | "invalid value" => format!("expected {type_name}, found {}", found_value(found)),
        "invalid length" => format!("expected {type_name}, found {found} of them"),
        _ => message.to_owned(),
    }
}

/// A table with its keys.
pub(crate) fn table(table: &KeyTable) -> String {
    let keys: Vec<&str> = table.keys.iter().map(|(key, _)| *key).collect();
    match &keys[..] {
        few if few.len() <= 6 => {
            let pairs: Vec<String> = few.iter().map(|key| format!("{key} = …")).collect();
            format!("a table such as {{ {} }}", pairs.join(", "))
        }
        many => format!("a table with keys such as {}", many[..4].join(", ")),
    }
}

/// A value as serde names it, as the file has it.
fn found_value(text: &str) -> String {
    let quoted = || text.split_once('`').and_then(|(_, rest)| rest.strip_suffix('`'));
    match text.split(' ').next().unwrap_or_default() {
        "floating" | "integer" => format!("the number {}", quoted().unwrap_or(text)),
        "boolean" => quoted().unwrap_or(text).to_owned(),
        "string" => text.strip_prefix("string ").unwrap_or(text).to_owned(),
        "character" => quoted().map_or_else(|| text.to_owned(), |c| format!("\"{c}\"")),
        "sequence" => "a list".to_owned(),
        "map" => "a table".to_owned(),
        _ => text.to_owned(),
    }
}

/// A syntax error of a file, `at` bytes from its beginning.
pub(crate) fn of_form(message: &str, text: &str, at: Option<usize>) -> Wording {
    let message = format!("not well-formed TOML: {message}");
    let at = at.unwrap_or(0).min(text.len());
    let at = text.floor_char_boundary(at);
    let start = text[..at].rfind('\n').map_or(0, |i| i + 1);
    let line = text[start..].lines().next().unwrap_or_default();
    let hint = if has_escape(line) {
        ESCAPES
    } else if is_with_decimal_comma(line) {
        "numbers have a decimal point: write 0.5, not 0,5"
    } else {
        ""
    };
    Wording { message, hint: hint.to_owned() }
}

/// How paths of Windows are written in TOML.
const ESCAPES: &str = "within \"…\" a backslash begins an escape: write the path in single quotes, \
                       'C:\\Users\\me', or with forward slashes, \"C:/Users/me\"";

/// A hint for a name that contains the result of an escape, such as a tab from `C:\temp`; an empty text for
/// other names.
pub(crate) fn hint_for_name(name: &str) -> String {
    if name.chars().any(|c| c.is_control()) { ESCAPES.to_owned() } else { String::new() }
}

/// True if a text in double quotes in this line has a backslash.
fn has_escape(line: &str) -> bool {
    line.split_once('"').is_some_and(|(before, text)| !before.contains('#') && text.contains('\\'))
}

/// True if the value in this line is a number with a decimal comma.
fn is_with_decimal_comma(line: &str) -> bool {
    let Some((_, value)) = line.split_once('=') else { return false };
    let value = value.split('#').next().unwrap_or_default().trim();
    has_decimal_comma(value)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::keys::RatioKeys;

    #[test]
    fn values_are_named_as_they_are_written() {
        for (message, words) in [
            ("invalid type: string \"x\", expected f64", "expected a number, found \"x\""),
            (
                "invalid value: integer `-1`, expected u32",
                "expected a whole number from 0 to 4294967295, found the number -1",
            ),
            (
                "invalid length 2, expected an array of length 3",
                "expected three numbers in brackets, found 2 of them",
            ),
            ("invalid type: sequence, expected a boolean", "expected true or false, found a list"),
            ("invalid type: map, expected a string", "expected a text in quotes, found a table"),
            ("invalid type: integer `1`, expected struct Unknown", "expected a table, found the number 1"),
            ("expected one number or three", "expected one number or three"),
        ] {
            assert_eq!(of_value(message), words);
        }
        let keys = "{ range_m = …, reflectance = …, pulse_freq_hz = …, value = … }";
        assert_eq!(table(&RatioKeys::TABLE), format!("a table such as {keys}"));
    }

    #[test]
    fn paths_of_windows_and_decimal_commas_are_recognised() {
        let hint = |text: &str| of_form("wrong", text, Some(text.len())).hint;
        assert!(hint("a = 1\nscene = \"C:\\Users\\me\"").contains("single quotes"));
        assert!(hint("seconds = 0,5").contains("decimal point"));
        assert_eq!(hint("scene = 'C:\\Users"), "");
        assert_eq!(hint("list = [1, 2"), "");
        assert!(hint_for_name("C:\temp").contains("forward slashes") && hint_for_name("C:/temp").is_empty());
    }
}
