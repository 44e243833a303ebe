//! Values with names on the command line.

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use vlscan_choice::{Choice, first_paragraph};

/// A parser of the names of `T`, which help texts and messages list.
pub fn choice<T: Choice>() -> impl TypedValueParser<Value = T> {
    let values = T::ALL.iter().map(|value| {
        PossibleValue::new(value.label())
            .aliases(value.aliases().iter().copied())
            .help(first_paragraph(value.about()))
            .hide(value.is_hidden())
    });
    PossibleValuesParser::new(values)
        .try_map(|name| T::named(&name).ok_or_else(|| format!("no value is called {name}")))
}
