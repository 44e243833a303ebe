//! Precedence of options: the command line over the file.

use super::switch::Switch;

/// Options that may be given in two places.
pub trait Precedence {
    /// These options, and those of `file` where nothing is chosen here. Lists are joined, those of the file
    /// first.
    fn over(self, file: Self) -> Self;
}

impl<T> Precedence for Option<T> {
    fn over(self, file: Self) -> Self {
        self.or(file)
    }
}

impl Precedence for bool {
    fn over(self, file: Self) -> Self {
        self || file
    }
}

impl Precedence for Switch {
    fn over(self, file: Self) -> Self {
        if self == Switch::Unset { file } else { self }
    }
}

impl<T> Precedence for Vec<T> {
    fn over(self, mut file: Self) -> Self {
        file.extend(self);
        file
    }
}

/// Defines a struct of options and its precedence, field by field; `with opposites` adds the opposites of its
/// switches.
macro_rules! group {
    ($(#[$about:meta])* pub struct $name:ident with opposites {
        $($(#[$doc:meta])* pub $field:ident: $type:ty,)*
    }) => {
        $(#[$about])*
        pub struct $name {
            $($(#[$doc])* pub $field: $type,)*
            /// The opposites of all switches.
            #[command(flatten)]
            #[serde(skip)]
            pub opposites: $crate::switch::Opposites,
        }

        impl $crate::Precedence for $name {
            fn over(self, file: Self) -> Self {
                $name { $($field: self.$field.over(file.$field),)* opposites: self.opposites }
            }
        }
    };
    ($(#[$about:meta])* pub struct $name:ident { $($(#[$doc:meta])* pub $field:ident: $type:ty,)* }) => {
        $(#[$about])*
        pub struct $name {
            $($(#[$doc])* pub $field: $type,)*
        }

        impl $crate::Precedence for $name {
            fn over(self, file: Self) -> Self {
                $name { $($field: self.$field.over(file.$field),)* }
            }
        }
    };
}
pub(super) use group;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_chosen_comes_first_and_lists_are_joined() {
        assert_eq!((Some(1).over(Some(2)), None.over(Some(2))), (Some(1), Some(2)));
        assert_eq!((true.over(false), false.over(true), false.over(false)), (true, true, false));
        let (unset, on, off) = (Switch::Unset, Switch::On, Switch::Off);
        assert_eq!((unset.over(on), off.over(on), on.over(off), off.over(unset)), (on, off, on, off));
        assert_eq!(vec![3].over(vec![1, 2]), [1, 2, 3]);
    }
}
