//! A streamed flight, pose by pose.

use super::angles::AngleWatch;
use super::boxes;
use crate::diag::Diagnostics;
use crate::geom::Aabb;
use crate::platform::Seen;
use crate::survey::{AngleConvention, PoseStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};

/// So far from a scene no flight towards it begins, m.
const MAX_APPROACH: f64 = 50_000.0;

/// Watches poses as they arrive.
#[derive(Debug)]
pub struct PoseWatch {
    scene: Aabb,
    /// Box around all poses; points per pulse tell of a flight that passes a scene by.
    flight: Aabb,
    angles: AngleWatch,
    /// Whether something of the flight's place has been told, by this or by others.
    told: Arc<AtomicBool>,
}

impl PoseWatch {
    /// Watches a stream over a scene with this box, world coordinates.
    pub fn new(stream: &PoseStream, scene: Aabb, told: Arc<AtomicBool>) -> PoseWatch {
        let angles = AngleWatch::new(
            stream.rotation.unwrap_or(AngleConvention::Heading),
            stream.degrees,
            "--trajectory-angles",
        );
        PoseWatch { scene, flight: Aabb::EMPTY, angles, told }
    }

    /// Looks at the next pose, or at the whole when the stream has ended.
    pub fn see(&mut self, seen: Seen) -> Diagnostics {
        let mut found = Diagnostics::default();
        let slip = match seen {
            Seen::Pose(pose, angles) => {
                self.flight = self.flight.with(pose.position);
                if !self.told.load(Relaxed)
                    && let Some(slip) = boxes::compare("the flight", &self.scene, &self.flight, MAX_APPROACH)
                {
                    self.told.store(true, Relaxed);
                    found.extend(slip.warning(None));
                }
                angles.and_then(|angles| self.angles.see(pose.position, angles))
            }
            Seen::End => self.angles.end(),
        };
        slip.into_iter().for_each(|slip| found.extend(slip.warning(None)));
        found
    }
}
