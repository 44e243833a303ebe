//! Changes to one value of a text.

use std::ops::Range;

/// Place of a value.
pub struct Place {
    /// Element and attribute, table and key, or file and column.
    pub label: String,
    /// The value, without quotes.
    pub value: Range<usize>,
    /// The name of the attribute, key or column; empty for values without one.
    pub name: Range<usize>,
    /// All that has to go if the value is removed.
    pub whole: Range<usize>,
    /// The text that goes in the place of `whole`.
    pub instead: &'static str,
    /// Quotes that a word needs, for values that stand without.
    pub quote: &'static str,
}

/// The consequence that a change must have.
#[derive(Clone, Copy, PartialEq)]
pub enum Effect {
    /// Nothing: the same value, written otherwise.
    None,
    /// Other points, or a message.
    Value,
    /// A message.
    Message,
}

/// A changed text.
pub struct Change {
    pub name: &'static str,
    /// The value that stands in the changed text; empty if it was removed.
    pub value: String,
    pub content: String,
    pub effect: Effect,
}

/// The text with `new` in `range`.
fn replaced(content: &str, range: &Range<usize>, new: &str) -> String {
    format!("{}{new}{}", &content[..range.start], &content[range.end..])
}

/// Values in the place of one that is a number.
fn numbers(value: &str, number: f64) -> Vec<(&'static str, String, Effect)> {
    let mut all = vec![
        ("decimal comma", format!("{value},5"), Effect::Message),
        ("unit", format!("{value} m"), Effect::Message),
        ("nan", "nan".to_owned(), Effect::Message),
        ("infinite", "inf".to_owned(), Effect::Message),
        ("minus infinite", "-inf".to_owned(), Effect::Message),
        ("huge", "1e30".to_owned(), Effect::Message),
        ("minus huge", "-1e30".to_owned(), Effect::Message),
        ("twice", format!("{value} {value}"), Effect::Message),
        ("hexadecimal", "0x1p3".to_owned(), Effect::Message),
        ("plus", format!("+{}", value.trim_start_matches('-')), Effect::None),
    ];
    if value.starts_with('-') || value.starts_with('+') {
        all.pop();
    }
    if number == 0.0 {
        all.push(("one", "1".to_owned(), Effect::Value));
        all.push(("minus one", "-1".to_owned(), Effect::Value));
    } else {
        all.push(("zero", "0".to_owned(), Effect::Value));
        all.push(("negative", format!("{}", -number), Effect::Value));
        all.push(("thousandfold", format!("{}", number * 1000.0), Effect::Value));
        all.push(("thousandth", format!("{}", number / 1000.0), Effect::Value));
    }
    all
}

/// Values in the place of one that is a word or a list.
fn words(value: &str) -> Vec<(&'static str, String, Effect)> {
    let mut all = vec![
        ("number", "7.25".to_owned(), Effect::Message),
        (
            "cut",
            value[..value.len() - value.chars().next_back().map_or(0, char::len_utf8)].to_owned(),
            Effect::Message,
        ),
        ("longer", format!("{value}x"), Effect::Message),
        ("twice", format!("{value} {value}"), Effect::Message),
    ];
    let inverted = if value == "true" { "false" } else { "true" };
    let is_switch = matches!(value, "true" | "false");
    all.push(("switched", inverted.to_owned(), if is_switch { Effect::Value } else { Effect::Message }));
    all
}

/// All changes to a value.
pub fn changes(place: &Place, content: &str) -> Vec<Change> {
    let value = &content[place.value.clone()];
    let mut values =
        vec![("empty", String::new(), Effect::Message), ("word", "abc".to_owned(), Effect::Message)];
    let number = value.parse::<f64>().ok().filter(|n| n.is_finite());
    values.extend(number.map_or_else(|| words(value), |number| numbers(value, number)));
    let mut all: Vec<Change> = values
        .into_iter()
        .map(|(name, new, effect)| {
            let is_number = new.parse::<f64>().is_ok_and(f64::is_finite);
            let quote = if is_number { "" } else { place.quote };
            let content = replaced(content, &place.value, &format!("{quote}{new}{quote}"));
            Change { name, value: new, content, effect }
        })
        .collect();
    let removed = replaced(content, &place.whole, place.instead);
    let value = String::new();
    all.push(Change { name: "removed", value, content: removed, effect: Effect::Value });
    if !place.name.is_empty() {
        let name = &content[place.name.clone()];
        let other_case: String = name
            .chars()
            .map(|c| if c.is_lowercase() { c.to_ascii_uppercase() } else { c.to_ascii_lowercase() })
            .collect();
        for (change, new) in [
            ("misspelt", format!("{name}x")),
            ("cut name", name[..name.len() - 1].to_owned()),
            ("other case", other_case),
        ] {
            all.push(Change {
                name: change,
                content: replaced(content, &place.name, &new),
                value: new,
                effect: Effect::Message,
            });
        }
    }
    all
}
