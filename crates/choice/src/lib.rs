//! Enumerations whose values have names, as command lines and files write them.

#![deny(unsafe_code)]

// The macro names this crate, also in its own tests.
extern crate self as vlscan_choice;

#[doc(hidden)]
pub use serde;

/// An enumeration whose values have names. [`choices!`] defines one.
pub trait Choice: Copy + Send + Sync + 'static {
    /// All values, in the order in which they are listed.
    const ALL: &'static [Self];

    /// The name that is listed and written.
    fn label(self) -> &'static str;

    /// Further names that are read.
    fn aliases(self) -> &'static [&'static str] {
        &[]
    }

    /// The meaning: the first paragraph is shown beside the name.
    fn about(self) -> &'static str;

    /// True if the value is read, but not listed.
    fn is_hidden(self) -> bool {
        false
    }

    /// The value of that name, in any case.
    fn named(name: &str) -> Option<Self> {
        let is = |known: &str| known.eq_ignore_ascii_case(name);
        Self::ALL.iter().copied().find(|value| is(value.label()) || value.aliases().iter().any(|a| is(a)))
    }
}

/// The first paragraph of a comment, without line breaks and without a full stop at its end.
pub fn first_paragraph(text: &str) -> String {
    let lines = text.lines().map(str::trim).take_while(|line| !line.is_empty());
    let text = lines.collect::<Vec<_>>().join(" ");
    text.strip_suffix('.').map_or(text.clone(), str::to_owned)
}

/// Defines an enumeration whose values have names, for serde and as a [`Choice`]:
///
/// ```
/// use vlscan_choice::Choice as _;
///
/// vlscan_choice::choices! {
///     /// The unit of angles.
///     #[derive(Clone, Copy, Debug, PartialEq, Eq)]
///     pub enum Unit: default Unit::Deg {
///         /// Degrees.
///         Deg = "deg" | "degree",
///         /// Radians.
///         Rad = "rad",
///     }
/// }
/// assert_eq!((Unit::named("degree"), Unit::default()), (Some(Unit::Deg), Unit::Deg));
/// ```
#[macro_export]
macro_rules! choices {
    (
        $(#[$about:meta])*
        pub enum $name:ident $(: default $default:path)? {
            $($(#[doc = $doc:literal])* $variant:ident = $label:literal $(| $alias:literal)*,)*
        }
    ) => {
        $(#[$about])*
        #[derive($crate::serde::Serialize, $crate::serde::Deserialize)]
        #[serde(crate = "vlscan_choice::serde")]
        pub enum $name {
            $(
                $(#[doc = $doc])*
                #[serde(rename = $label $(, alias = $alias)*)]
                $variant,
            )*
        }

        impl $crate::Choice for $name {
            const ALL: &'static [$name] = &[$($name::$variant),*];

            fn label(self) -> &'static str {
                match self {
                    $($name::$variant => $label,)*
                }
            }

            fn aliases(self) -> &'static [&'static str] {
                match self {
                    $($name::$variant => &[$($alias),*],)*
                }
            }

            fn about(self) -> &'static str {
                match self {
                    $($name::$variant => concat!($($doc, "\n"),*),)*
                }
            }
        }

        $(
            impl Default for $name {
                fn default() -> $name {
                    $default
                }
            }
        )?
    };
}

#[cfg(test)]
mod tests {
    use super::*;

    crate::choices! {
        /// The colours of the test.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum Colour: default Colour::Green {
            /// Like leaves
            /// in May.
            ///
            /// A second paragraph.
            Green = "green" | "verde",
            /// Like the sky.
            Blue = "blue",
        }
    }

    #[test]
    fn values_are_found_by_their_names() {
        assert_eq!(Colour::default(), Colour::Green);
        assert_eq!(Colour::named("VERDE"), Some(Colour::Green));
        assert_eq!(Colour::named("blue"), Some(Colour::Blue));
        assert_eq!((Colour::named("red"), Colour::Blue.label()), (None, "blue"));
        assert_eq!(first_paragraph(Colour::Green.about()), "Like leaves in May");
    }
}
