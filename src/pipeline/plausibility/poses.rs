//! Check of a streamed flight, pose by pose.

use super::angles::AngleCheck;
use super::pace::Pace;
use super::{Finding, boxes, stream_place};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use vlscan_base::diag::{Diagnostics, Place};
use vlscan_geom::Aabb;
use vlscan_lidar::platform::PoseEvent;
use vlscan_survey::{AngleConvention, PoseStream};

/// Distance from the scene at which a flight towards it may begin, m.
const MAX_APPROACH: f64 = 50_000.0;

#[derive(Debug)]
pub struct PoseCheck {
    /// Where the flight comes from.
    place: Option<Place>,
    scene: Aabb,
    /// Box around all poses. A flight past the scene is detected by its points per pulse instead.
    flight: Aabb,
    /// Whether the user has been told that the flight has not come near the scene so far.
    is_noted: bool,
    angles: AngleCheck,
    pace: Pace,
    /// Whether the user has been told that the flight is slow so far.
    is_pace_noted: bool,
    /// Whether a misplaced flight has been reported, by this check or another one.
    is_reported: Arc<AtomicBool>,
}

impl PoseCheck {
    /// Creates a check of a stream over a scene with the box `scene`, world coordinates.
    pub fn new(stream: &PoseStream, scene: Aabb, is_reported: Arc<AtomicBool>) -> PoseCheck {
        let angles = AngleCheck::new(
            stream.rotation.unwrap_or(AngleConvention::Heading),
            stream.degrees,
            "--trajectory-angles",
        );
        PoseCheck {
            place: stream_place(stream),
            scene,
            flight: Aabb::EMPTY,
            is_noted: false,
            angles,
            pace: Pace::default(),
            is_pace_noted: false,
            is_reported,
        }
    }

    /// Checks the next pose, or the complete flight at the end of the stream. What the rest of the flight may yet disprove is
    /// a note until then.
    pub fn add(&mut self, seen: PoseEvent) -> Diagnostics {
        let mut found = Diagnostics::default();
        let finding = match seen {
            PoseEvent::Pose(pose, angles) => {
                self.flight = self.flight.with(pose.position);
                self.pace.add(pose.time, pose.position);
                if !self.is_pace_noted
                    && let Some(finding) = self.pace.find_early()
                {
                    self.is_pace_noted = true;
                    found.note(None, format!("so far {}; {}", finding.message, finding.help));
                }
                if !self.is_noted
                    && let Some(finding) = self.misplaced()
                {
                    self.is_noted = true;
                    found.note(None, format!("so far {}; {}", finding.message, finding.help));
                }
                angles.and_then(|angles| self.angles.add(pose.position, angles))
            }
            PoseEvent::End => {
                if !self.is_reported.load(Relaxed)
                    && let Some(finding) = self.misplaced()
                {
                    self.is_reported.store(true, Relaxed);
                    found.extend(finding.into_warning(self.place.clone()));
                }
                self.pace
                    .find()
                    .into_iter()
                    .for_each(|finding| found.extend(finding.into_warning(self.place.clone())));
                self.angles.end()
            }
        };
        finding.into_iter().for_each(|finding| found.extend(finding.into_warning(self.place.clone())));
        found
    }

    fn misplaced(&self) -> Option<Finding> {
        boxes::compare("the flight", &self.scene, &self.flight, MAX_APPROACH)
    }
}
