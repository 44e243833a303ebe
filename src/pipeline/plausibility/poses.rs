//! Check of a streamed flight, pose by pose.

use super::angles::AngleCheck;
use super::boxes;
use crate::diag::Diagnostics;
use crate::geom::Aabb;
use crate::platform::PoseEvent;
use crate::survey::{AngleConvention, PoseStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};

/// Distance from the scene at which a flight towards it may begin, m.
const MAX_APPROACH: f64 = 50_000.0;

#[derive(Debug)]
pub struct PoseCheck {
    scene: Aabb,
    /// Box around all poses. A flight past the scene is detected by its points per pulse instead.
    flight: Aabb,
    angles: AngleCheck,
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
        PoseCheck { scene, flight: Aabb::EMPTY, angles, is_reported }
    }

    /// Checks the next pose, or the complete flight at the end of the stream.
    pub fn add(&mut self, seen: PoseEvent) -> Diagnostics {
        let mut found = Diagnostics::default();
        let finding = match seen {
            PoseEvent::Pose(pose, angles) => {
                self.flight = self.flight.with(pose.position);
                if !self.is_reported.load(Relaxed)
                    && let Some(finding) =
                        boxes::compare("the flight", &self.scene, &self.flight, MAX_APPROACH)
                {
                    self.is_reported.store(true, Relaxed);
                    found.extend(finding.into_warning(None));
                }
                angles.and_then(|angles| self.angles.add(pose.position, angles))
            }
            PoseEvent::End => self.angles.end(),
        };
        finding.into_iter().for_each(|finding| found.extend(finding.into_warning(None)));
        found
    }
}
