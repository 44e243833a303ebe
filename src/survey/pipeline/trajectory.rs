//! The `[trajectory]` table.

use super::super::{AngleConvention, PoseChoices, PoseFormat, PoseStream};
use super::build::near;
use super::instrument::Values;
use super::keys::{Key, TrajectoryKeys};
use super::run::one_of;
use crate::geom::{UtmZone, radians};
use crate::input::is_stdin;
use std::path::{Path, PathBuf};
use toml::Spanned;

/// The trajectory of a pipeline: what the caller chose comes before what the table says. The inner value is `None` when
/// neither names a trajectory.
pub(super) fn read_trajectory(
    values: &Values,
    table: Option<&TrajectoryKeys>,
    chosen: &PoseChoices,
) -> Option<Option<PoseStream>> {
    let Some(keys) = table else { return Some(chosen.clone().stream()) };
    let mut said = read_choices(values, keys);
    match &keys.path {
        // Somebody else's file need not be here.
        _ if chosen.path.is_some() => {}
        Some(path) => said.path = Some(find(values, path)?),
        None => {
            values.context.error_help(
                values.source.place(0..0),
                "[trajectory] needs the key `path`",
                "path = \"-\" is standard input",
            );
            return None;
        }
    }
    Some(chosen.clone().or(said).stream())
}

fn find(values: &Values, path: &Spanned<String>) -> Option<PathBuf> {
    let name = path.get_ref();
    if is_stdin(Path::new(name)) {
        return Some(PathBuf::from("-"));
    }
    values.context.file(&near(values.source, name), values.source.folder(), values.source.place(path.span()))
}

fn read_choices(values: &Values, keys: &TrajectoryKeys) -> PoseChoices {
    let (context, source) = (values.context, values.source);
    let one_of = |key: &Key<String>, known: &[&str]| one_of(context, source, key, known);
    let separator = keys.separator.as_ref().and_then(|key| {
        let mut letters = key.get_ref().chars();
        let letter = letters.next();
        if letter.is_none() || letters.next().is_some() {
            values.refuse(key, "one character");
        }
        letter
    });
    let angles = one_of(&keys.angles, &["deg", "rad"]).map(|unit| unit == "deg");
    if let (Some(key), Some(_)) = (&keys.angles, keys.degrees) {
        context.error(source.place(key.span()), "give either `angles` or `degrees`");
    }
    let utm_zone = keys.utm_zone.as_ref().and_then(|key| {
        let zone = UtmZone::parse(key.get_ref());
        if zone.is_none() {
            values.refuse(key, "a UTM zone such as \"32N\" or \"55S\"");
        }
        zone
    });
    let number = |key: &Key<f64>| {
        let mut value = None;
        if key.is_some() {
            values.number(value.get_or_insert(0.0), key);
        }
        value
    };
    let mut max_gap = None;
    if keys.max_gap_s.is_some() {
        values.positive(max_gap.get_or_insert(0.0), &keys.max_gap_s);
    }
    if let Some(key) = keys.latency_s.as_ref().filter(|key| !(0.0..=3600.0).contains(key.get_ref())) {
        values.refuse(key, "seconds from 0 to 3600");
    }
    PoseChoices {
        path: None,
        format: one_of(&keys.format, &PoseFormat::NAMES).and_then(|name| PoseFormat::named(&name)),
        rotation: one_of(&keys.rotation, &AngleConvention::NAMES)
            .and_then(|name| AngleConvention::named(&name)),
        degrees: angles.or(keys.degrees),
        columns: keys.columns.as_ref().map(|c| c.get_ref().clone()),
        separator,
        utm_zone,
        height_offset: number(&keys.height_offset_m),
        lever_arm: values.vector(&keys.lever_arm_m),
        boresight: values.vector(&keys.boresight_deg).map(|angles| angles.to_array().map(radians)),
        max_gap,
    }
}
