//! Interpolated platforms: the trajectory files of the legs and their settings (spec input-formats §2.8).

use super::context::Context;
use super::fields::{Fields, Reading};
use super::xml::Element;
use super::{Interpolated, LegTrajectory, RotationSpec, TrajectoryFile};
use std::path::PathBuf;
use std::sync::Arc;

/// Attributes of columns, in the order of their default numbers, and their contents.
const COLUMNS: [(&str, &str); 7] = [
    ("tIndex", "time"),
    ("rollIndex", "roll"),
    ("pitchIndex", "pitch"),
    ("yawIndex", "yaw"),
    ("xIndex", "x"),
    ("yIndex", "y"),
    ("zIndex", "z"),
];
/// Spellings of the separator attribute; the first is HELIOS++'s.
const SEPARATOR: [&str; 2] = ["trajectory_seperator", "trajectory_separator"];
/// Indices of the angles in [`COLUMNS`].
const ANGLES: std::ops::RangeInclusive<usize> = 1..=3;

/// Settings of a trajectory in `<platformSettings>`.
#[derive(Clone, Debug, Default)]
pub(super) struct TrajectoryLayer {
    pub file: Option<String>,
    /// The element that names the file, for messages and the search path.
    pub file_at: Option<Element>,
    pub columns: Option<[usize; 7]>,
    pub separator: Option<char>,
    pub start: Option<f64>,
    pub end: Option<f64>,
    pub teleport: bool,
    pub position_only: Option<bool>,
    pub degrees: Option<bool>,
    pub sync_gps: bool,
    pub slope_filter: f64,
}

impl TrajectoryLayer {
    /// These settings with the attributes of an element applied.
    pub fn with(&self, fields: &mut Fields, element: &Element) -> TrajectoryLayer {
        let domains = [("position_and_attitude", false), ("position", true)];
        let domain = fields.choice("interpolationDomain", &domains, None);
        fields.reading = Reading::Lenient;
        let file = fields.text("trajectory");
        let file_at = file.is_some().then(|| element.clone());
        let degrees = fields.flag("toRadians", self.degrees.unwrap_or(true));
        let layer = TrajectoryLayer {
            columns: read_columns(fields).or(self.columns),
            separator: read_separator(fields).or(self.separator),
            start: fields.optional("tStart").or(self.start),
            end: fields.optional("tEnd").or(self.end),
            teleport: fields.flag("teleportToStart", self.teleport),
            position_only: domain.or(self.position_only),
            degrees: fields.has("toRadians").then_some(degrees).or(self.degrees),
            sync_gps: fields.flag("syncGPSTime", self.sync_gps),
            slope_filter: fields.number("slopeFilterThreshold", self.slope_filter),
            file_at: file_at.or(self.file_at.clone()),
            file: file.or(self.file.clone()),
        };
        if let (Some(start), Some(end)) = (layer.start, layer.end) {
            fields.in_order((start, end), ["tStart", "tEnd"], "");
        }
        layer
    }
}

/// All columns when at least one is given; the others keep their default positions.
fn read_columns(fields: &mut Fields) -> Option<[usize; 7]> {
    let given = COLUMNS.iter().any(|(name, _)| fields.has(*name));
    let mut columns = [0; 7];
    for (column, ((name, _), default)) in columns.iter_mut().zip(COLUMNS.iter().zip(0..)) {
        *column = fields.count(*name, default) as usize;
    }
    given.then_some(columns)
}

fn read_separator(fields: &mut Fields) -> Option<char> {
    let found = SEPARATOR.map(|name| fields.text(name).map(|text| (name, text)));
    let (name, text) = found.into_iter().flatten().next()?;
    let mut letters = text.chars();
    match (text.as_str(), letters.next(), letters.next()) {
        ("\\t", ..) => Some('\t'),
        (_, Some(letter), None) => Some(letter),
        _ => {
            fields.refuse(name, "one character");
            None
        }
    }
}

/// Collects the trajectory files of a survey leg by leg.
pub(super) struct Trajectories {
    platform: Interpolated,
    position_only: Option<bool>,
}

impl Trajectories {
    pub fn new(rotation_spec: RotationSpec) -> Trajectories {
        let platform = Interpolated {
            rotation_spec,
            position_only: false,
            degrees: true,
            sync_gps_time: false,
            files: Vec::new(),
            grid: super::ProjectionGrid::FirstFix,
        };
        Trajectories { platform, position_only: None }
    }

    /// Adds the file of a leg and returns the part that the leg flies.
    pub fn add(&mut self, context: &Context, leg: &Element, says: &TrajectoryLayer) -> Option<LegTrajectory> {
        let degrees = says.degrees.unwrap_or(true);
        if !self.platform.files.is_empty() && degrees != self.platform.degrees {
            let message =
                "the legs differ in `toRadians`: one of them is false, so the angles of all are radians";
            context.warn(place_of(leg, "toRadians"), message);
        }
        self.platform.degrees &= degrees;
        self.platform.sync_gps_time |= says.sync_gps;
        match (self.position_only, says.position_only) {
            (Some(before), Some(now)) if before != now => {
                let message = "the legs have different `interpolationDomain`s";
                let help = "give all legs the same domain, or only one of them";
                context.limit(Some(place_of(leg, "interpolationDomain")), message, help);
            }
            (None, now) => self.position_only = now,
            _ => {}
        }
        let (Some(name), Some(at)) = (&says.file, &says.file_at) else {
            let message = "a leg of an interpolated platform needs the attribute `trajectory`";
            context.error(leg.child("platformSettings").as_ref().unwrap_or(leg).place(), message);
            return None;
        };
        check_columns(context, leg, says);
        let content = context.trajectory(name);
        let path = match content {
            Some(_) => PathBuf::from(name),
            None => context.file(name, at.folder(), at.value_place("trajectory"))?,
        };
        let file = self.file(context, leg, says, (path, content));
        Some(LegTrajectory { file, start: says.start, end: says.end, teleport: says.teleport })
    }

    fn file(
        &mut self,
        context: &Context,
        leg: &Element,
        says: &TrajectoryLayer,
        (path, content): (PathBuf, Option<Arc<[u8]>>),
    ) -> usize {
        let files = &mut self.platform.files;
        // A trajectory in memory may have the path of a file as its name.
        let is_known = |f: &TrajectoryFile| f.path == path && f.content.is_some() == content.is_some();
        let Some(known) = files.iter().position(is_known) else {
            if says.slope_filter > 0.0 && !files.is_empty() {
                let message = "`slopeFilterThreshold` has no effect: it thins the first trajectory file only";
                context.warn(place_of(leg, "slopeFilterThreshold"), message);
            }
            files.push(TrajectoryFile {
                path,
                content,
                columns: says.columns,
                separator: says.separator,
                slope_filter: says.slope_filter,
            });
            return files.len() - 1;
        };
        let file = &mut files[known];
        let other_separator = says.separator.is_some() && says.separator != file.separator;
        if other_separator || says.slope_filter != 0.0 && says.slope_filter != file.slope_filter {
            let name = if other_separator { "trajectory_separator" } else { "slopeFilterThreshold" };
            let message = format!(
                "`{name}` has no effect: what an earlier leg says about {} is used",
                file.path.display()
            );
            context.warn(place_of(leg, name), message);
        }
        match (file.columns, says.columns) {
            (Some(before), Some(now)) if before != now => {
                let message =
                    format!("the columns of {} differ from those an earlier leg gave", file.path.display());
                context.limit(Some(place_of(leg, "tIndex")), message, "give the columns of a file only once");
            }
            (None, now) => file.columns = now,
            _ => {}
        }
        known
    }

    /// The platform's settings after all legs have been added.
    pub fn finish(mut self) -> Interpolated {
        self.platform.position_only = self.position_only.unwrap_or(false);
        self.platform
    }
}

/// Warns of two quantities that are read from one column, and of columns that are not read.
fn check_columns(context: &Context, leg: &Element, says: &TrajectoryLayer) {
    let Some(columns) = says.columns else { return };
    let position_only = says.position_only.unwrap_or(false);
    let is_read = |i: usize| !(position_only && ANGLES.contains(&i));
    let written = |i: usize| leg.child("platformSettings").is_some_and(|e| e.value(COLUMNS[i].0).is_some());
    for i in 0..columns.len() {
        let (name, quantity) = COLUMNS[i];
        if !is_read(i) {
            if written(i) {
                let message = format!("`{name}` has no effect with interpolationDomain=\"position\"");
                context.warn(place_of(leg, name), message);
            }
            continue;
        }
        let earlier = (0..i).find(|&j| is_read(j) && columns[j] == columns[i]);
        if let Some(j) = earlier {
            // Report the column that has its default number: the user may not know of it.
            let at = if written(i) || !written(j) { name } else { COLUMNS[j].0 };
            let message = format!("{} and {quantity} are both column {}", COLUMNS[j].1, columns[i]);
            let help = if i == 0 || j == 0 {
                "a path without times needs a column of them: name it with tIndex"
            } else if ANGLES.contains(&i) || ANGLES.contains(&j) {
                "name the columns of all angles, or give interpolationDomain=\"position\" for a path without \
                 attitude"
            } else {
                "give each its own column; those that are not named are 0 to 6: time, roll, pitch, yaw, x, \
                 y, z"
            };
            context.warn_help(place_of(leg, at), message, help);
        }
    }
}

fn place_of(leg: &Element, attribute: &str) -> vlscan_base::diag::Place {
    leg.child("platformSettings").map_or_else(|| leg.place(), |settings| settings.value_place(attribute))
}
