//! Names of the classes of objects.

use crate::cloud::class_name;
use std::collections::BTreeMap;
use std::str::FromStr;
use vlscan_base::error::{Error, Result};

/// The name of a class.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Category {
    /// Class of the points.
    pub class: u8,
    /// Its name: not empty, without control characters.
    pub name: String,
}

/// A text that is not a [`Category`].
#[non_exhaustive]
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("expected CLASS=NAME with a class from 0 to 255, such as 64=Car")]
pub struct CategoryError {}

impl FromStr for Category {
    type Err = CategoryError;

    fn from_str(text: &str) -> std::result::Result<Category, CategoryError> {
        let (class, name) = text.split_once('=').ok_or(CategoryError {})?;
        let class = class.trim().parse().map_err(|_| CategoryError {})?;
        let name = name.trim();
        if name.is_empty() || name.contains(char::is_control) {
            return Err(CategoryError {});
        }
        Ok(Category { class, name: name.to_owned() })
    }
}

/// Names of classes.
#[derive(Clone, Debug, Default)]
pub(super) struct Names(BTreeMap<i64, String>);

impl Names {
    /// The chosen names.
    ///
    /// # Errors
    /// [`Error::Input`] for a class with two names.
    pub fn new(categories: &[Category]) -> Result<Names> {
        let mut names = BTreeMap::new();
        for Category { class, name } in categories {
            if names.insert(i64::from(*class), name.clone()).is_some_and(|other| other != *name) {
                return Err(Error::input(format!("--category: class {class} has two names")));
            }
        }
        Ok(Names(names))
    }

    /// The name of a class: the chosen one, that of the LAS specification, or its number.
    pub fn of(&self, class: i64) -> String {
        let chosen = self.0.get(&class).cloned();
        let known = || u8::try_from(class).ok().and_then(class_name).map(str::to_owned);
        chosen.or_else(known).unwrap_or_else(|| format!("class {class}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn classes_have_chosen_names_or_those_of_las() {
        let car: Category = "64 = vehicle.car".parse().unwrap();
        assert_eq!(car, Category { class: 64, name: "vehicle.car".to_owned() });
        let names = Names::new(&[car.clone(), car.clone()]).unwrap();
        let found = [64, 6, 65, -1, 300].map(|class| names.of(class));
        assert_eq!(found, ["vehicle.car", "building", "class 65", "class -1", "class 300"]);
        assert!(Names::new(&[car, "64=bus".parse().unwrap()]).is_err());
        for text in ["", "64", "64=", "=car", "256=car", "-1=car", "x=car", "64=a\nb"] {
            assert!(text.parse::<Category>().is_err(), "{text:?}");
        }
    }
}
