//! Check of a streamed flight, pose by pose.

use super::angles::AngleCheck;
use super::finding::Finding;
use super::pace::Pace;
use super::view::{PLACES, ViewPoint};
use super::{boxes, stream_place};
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;
use vlscan_base::diag::{Diagnostics, Place};
use vlscan_geom::{Aabb, DVec3};
use vlscan_lidar::platform::{PollResult, Pose, PoseEvent, PoseReader};
use vlscan_survey::{AngleConvention, PoseStream};
use vlscan_warehouse::Series;

/// Time for which a block of poses is waited for.
const PATIENCE: Duration = Duration::from_millis(50);
/// Distance from the scene at which a flight towards it may begin, m.
const MAX_APPROACH: f64 = 50_000.0;

#[derive(Debug)]
pub struct PoseCheck {
    /// Source of the flight.
    place: Option<Place>,
    scene: Aabb,
    /// Box around all poses. A flight past the scene is detected by its points per pulse instead.
    flight: Aabb,
    /// True if it has been reported that the flight has not come near the scene so far.
    is_noted: bool,
    angles: AngleCheck,
    pace: Pace,
    /// True if the whole flight is read before anything is reported.
    is_complete: bool,
    /// True if the flight has been reported to be slow.
    is_pace_reported: bool,
    /// True if a misplaced flight has been reported, by this check or another one.
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
            is_complete: false,
            is_pace_reported: false,
            is_reported,
        }
    }

    /// Checks the next pose, or the complete flight at the end of the stream. What the rest of the flight may
    /// yet disprove is a note until then.
    pub fn add(&mut self, seen: PoseEvent) -> Diagnostics {
        let mut found = Diagnostics::default();
        let finding = match seen {
            PoseEvent::Pose(pose, angles) => {
                self.flight = self.flight.with(pose.position);
                self.pace.add(pose.time, pose.position);
                if !self.is_complete
                    && !self.is_pace_reported
                    && let Some(finding) = self.pace.find_early()
                {
                    // A flight of hours is not waited for.
                    self.is_pace_reported = true;
                    found.extend(finding.into_warning(self.place.clone()));
                }
                if !self.is_complete
                    && !self.is_noted
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
                if let Some(finding) = self.pace.find().filter(|_| !self.is_pace_reported) {
                    found.extend(finding.into_warning(self.place.clone()));
                }
                self.angles.end()
            }
        };
        finding.into_iter().for_each(|finding| found.extend(finding.into_warning(self.place.clone())));
        found
    }

    fn misplaced(&self) -> Option<Finding> {
        // The reader reports flights without poses.
        if self.flight.is_empty() {
            return None;
        }
        boxes::compare("the flight", &self.scene, &self.flight, MAX_APPROACH)
    }
}

/// Reads all poses of a recorded trajectory and checks them over a scene with the box `scene` (world).
/// Returns the warnings and some of the poses, in the scene frame, whose origin is at `shift`. `None` for a
/// trajectory with errors.
pub(super) fn read_ahead(
    stream: &PoseStream,
    scene: Aabb,
    shift: DVec3,
    is_stopped: &dyn Fn() -> bool,
) -> Option<(Diagnostics, Vec<ViewPoint>)> {
    let check = PoseCheck { is_complete: true, ..PoseCheck::new(stream, scene, Arc::default()) };
    let seen = Arc::new(Mutex::new((check, Diagnostics::default(), Series::new(4 * PLACES))));
    let shared = seen.clone();
    let observe = move |event: PoseEvent| {
        let mut seen = shared.lock().unwrap_or_else(PoisonError::into_inner);
        if let PoseEvent::Pose(Pose { position, attitude, .. }, _) = event {
            seen.2.push(ViewPoint { position: position - shift, attitude });
        }
        let found = seen.0.add(event);
        seen.1.extend(found);
        Diagnostics::default()
    };
    let mut reader = PoseReader::open(stream).ok()?.on_pose(observe);
    while !is_stopped() {
        if reader.poll(PATIENCE).ok()? == PollResult::End {
            break;
        }
    }
    drop(reader);
    let (_, found, poses) = Arc::into_inner(seen)?.into_inner().unwrap_or_else(PoisonError::into_inner);
    Some((found, poses.entries().to_vec()))
}
