//! Interpolated platforms: the trajectory files of the legs and their settings (spec input-formats §2.8).

use super::context::Context;
use super::settings::{PlatformLayer, TrajectoryLayer};
use super::xml::Element;
use super::{Interpolated, LegTrajectory, RotationSpec, TrajectoryFile};

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
            grid: super::Grid::FirstFix,
        };
        Trajectories { platform, position_only: None }
    }

    /// Adds the file of a leg and returns the part that the leg flies.
    pub fn add(&mut self, context: &Context, leg: &Element, layer: &PlatformLayer) -> Option<LegTrajectory> {
        let says = &layer.trajectory;
        self.platform.degrees &= says.degrees.unwrap_or(true);
        self.platform.sync_gps_time |= says.sync_gps;
        match (self.position_only, says.position_only) {
            (Some(before), Some(now)) if before != now => {
                let message = "the legs disagree about `interpolationDomain`";
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
        let path = context.file(name, at.folder(), at.value_place("trajectory"))?;
        let file = self.file(context, leg, says, path);
        Some(LegTrajectory { file, start: says.start, end: says.end, teleport: says.teleport })
    }

    fn file(
        &mut self,
        context: &Context,
        leg: &Element,
        says: &TrajectoryLayer,
        path: std::path::PathBuf,
    ) -> usize {
        let files = &mut self.platform.files;
        let Some(known) = files.iter().position(|f| f.path == path) else {
            files.push(TrajectoryFile {
                path,
                columns: says.columns,
                separator: says.separator,
                slope_filter: says.slope_filter,
            });
            return files.len() - 1;
        };
        let file = &mut files[known];
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

fn place_of(leg: &Element, attribute: &str) -> crate::diag::Place {
    leg.child("platformSettings").map_or_else(|| leg.place(), |settings| settings.value_place(attribute))
}

/// The survey's `rotationSpec`.
pub(super) fn read_rotation_spec(context: &Context, survey: &Element) -> RotationSpec {
    match survey.value("rotationSpec") {
        None | Some("ARINC 705") => RotationSpec::Arinc705,
        Some("CANONICAL") => RotationSpec::Canonical,
        Some(other) => {
            let message = format!("unknown rotation specification `{other}`");
            let help = "the specifications are `ARINC 705` and `CANONICAL`";
            context.limit(Some(survey.value_place("rotationSpec")), message, help);
            RotationSpec::Arinc705
        }
    }
}
