//! Headings of inventories, in English and German.

use vlscan_base::diag::{Diagnostics, Place};
use vlscan_tables::{Headings, Line, Quantity, Schema, Use};

/// Advice for longitudes and latitudes.
pub(super) const PROJECT: &str =
    "project them to the terrain's system, in metres: gdaltransform -s_srs EPSG:4326 -t_srs EPSG:25832";

/// The columns of an inventory. A height is that of the tree.
const SCHEMA: Schema = Schema {
    columns: &[
        (Quantity::X, Use::Required),
        (Quantity::Y, Use::Required),
        (Quantity::TreeHeight, Use::Required),
        (Quantity::TreeId, Use::Optional),
        (Quantity::Species, Use::Optional),
        (Quantity::Stem, Use::Optional),
        (Quantity::Crown, Use::Optional),
        (Quantity::CrownRadius, Use::Optional),
        (Quantity::Z, Use::Optional),
        (Quantity::Ground, Use::Optional),
        (Quantity::Longitude, Use::Unread(None)),
        (Quantity::Latitude, Use::Unread(None)),
    ],
    is_unique: false,
    help: "an inventory has the columns x, y, height (Rechtswert, Hochwert, Höhe), and optionally crown, \
           dbh, species, id, z; units follow the name: dbh_cm",
};

/// Reads the headings and reports everything that is wrong with them.
pub(super) fn read_headings(line: &Line, place: &Place, problems: &mut Diagnostics) -> Headings {
    let mut headings = Headings::of(&line.fields, &SCHEMA);
    if headings.has(Quantity::Z)
        && let Some(index) = headings.columns.iter().position(|column| column.quantity == Quantity::Ground)
    {
        let ground = headings.columns.remove(index);
        headings.unknown.push(ground.name);
    }
    let is_degrees = |name: &&String| {
        let plain = vlscan_tables::plain(vlscan_tables::split_unit(name).0);
        let axes = [Quantity::Longitude, Quantity::Latitude];
        axes.iter().any(|axis| axis.rank(&plain).is_some())
    };
    let degrees: Vec<&str> = headings.unknown.iter().filter(is_degrees).map(String::as_str).collect();
    if !(degrees.is_empty() || headings.has(Quantity::X) && headings.has(Quantity::Y)) {
        let missing = headings.missing(&SCHEMA).join(", ");
        let help = format!("{} are degrees; {PROJECT}", degrees.join(" and "));
        problems.error(Some(place.clone()), format!("no column {missing}")).help(help);
        return headings;
    }
    headings.report(&SCHEMA, Some(place), problems);
    headings
}
