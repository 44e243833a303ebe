//! Remarks about the names of columns.

use super::{Attribute, Columns, MAX_LISTED_NAMES, clause, factor, name_of, unit_of};
use vlscan_base::diag::listed;
use vlscan_tables::{Dimension, did_you_mean, is_usually_unused, plain, similar_name};

/// Two names of an attribute that tables usually have together, with different values, so that having both is
/// not a mistake: those of this program's own tables, and intensity and amplitude of other scanners'
/// programs.
const COMMON_PAIRS: [[&str; 2]; 5] = [
    ["intensity", "amplitude"],
    ["intensity", "heliosamplitude"],
    ["surfaceclass", "classification"],
    ["objectid", "part"],
    ["hitobjectid", "part"],
];

impl Columns {
    /// Remarks about the names of a file: names that occur twice or mean the same, units that are not known,
    /// and names that are neither read nor known.
    pub fn remarks(&self, names: &[&str]) -> Vec<String> {
        let plain: Vec<String> = names.iter().copied().map(name_of).collect();
        let mut remarks = self.repeated(names, "column");
        for (attribute, column) in self.used() {
            if let Some(dimension) = attribute.dimension()
                && let Some(unit) = unit_of(names[column])
                && factor(attribute, names[column]).is_none()
            {
                let assumed = match dimension {
                    Dimension::Time => "seconds",
                    Dimension::Angle => "degrees",
                    _ => "metres",
                };
                remarks.push(format!(
                    "the unit {unit:?} of column {} ({:?}) is not known; {assumed} are assumed (expected {})",
                    column + 1,
                    names[column],
                    dimension.units()
                ));
            }
        }
        let is_known = |name: &str| {
            name.is_empty()
                || is_usually_unused(name)
                || Attribute::ALL.iter().any(|attribute| attribute.has_name(name))
        };
        let unknown: Vec<&str> =
            names.iter().zip(&plain).filter(|(_, plain)| !is_known(plain)).map(|(name, _)| *name).collect();
        if !unknown.is_empty() {
            let columns = if unknown.len() == 1 { "column" } else { "columns" };
            remarks.push(format!(
                "{columns} with no known meaning, not read: {}{}",
                listed(&unknown, MAX_LISTED_NAMES),
                clause(self.question(&unknown).as_deref())
            ));
        }
        remarks
    }

    /// Remarks about names that occur twice or mean the same; `noun` is the singular of what has the names.
    pub(crate) fn repeated(&self, names: &[&str], noun: &str) -> Vec<String> {
        let plain: Vec<String> = names.iter().copied().map(name_of).collect();
        let remark = |what: &str, chosen: usize, is_alike: &dyn Fn(&str) -> bool| {
            let other = (0..names.len()).find(|column| *column != chosen && is_alike(&plain[*column]))?;
            Some(format!(
                "{noun}s {} ({:?}) and {} ({:?}) both name {what}; {noun} {} is read",
                chosen + 1,
                names[chosen],
                other + 1,
                names[other],
                chosen + 1
            ))
        };
        let of_attributes = self.used().filter_map(|(attribute, chosen)| {
            let own = plain[chosen].as_str();
            remark(attribute.described(), chosen, &|name| {
                // A single letter is the name of a coordinate only if there is no better one.
                let may_differ = name.len() == 1
                    || COMMON_PAIRS.iter().any(|pair| pair.contains(&name) && pair.contains(&own));
                name == own || (!may_differ && attribute.has_name(name))
            })
        });
        let of_colours =
            self.colours.iter().flatten().filter_map(|&chosen| {
                remark("a component of the colour", chosen, &|name| name == plain[chosen])
            });
        of_attributes.chain(of_colours).collect()
    }

    /// The question whether unknown names mean attributes without a column.
    pub(super) fn question(&self, unknown: &[&str]) -> Option<String> {
        let open = Attribute::ALL.into_iter().filter(|attribute| !self.has(*attribute));
        let names: Vec<&str> = open.flat_map(|attribute| attribute.quantity().names()).collect();
        did_you_mean(unknown, |name| similar_name(&plain(name), names.iter().copied()))
    }
}
