//! Check of the points per pulse: detects runs that hit nothing or almost nothing.

use super::{Finding, boxes, ground, target};
use crate::diag::Notice;
use crate::error::Result;
use crate::geom::{DVec3, Rotation};
use crate::pipeline::aim::AimLog;
use crate::pipeline::progress::Progress;
use crate::pipeline::settings::Settings;
use crate::quantity::{amount, metres};
use crate::scene::Scene;
use crate::tree::Tree;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};

/// Points per pulse below which a run is reported.
const MIN_YIELD: f64 = 0.01;
/// Points per pulse whose beam hits the box of the scene, below which a run is reported.
const MIN_YIELD_WITHIN: f64 = 0.05;
/// Fraction of beams above the horizon from which the scanner is taken to point upwards.
const MIN_SHARE_UPWARDS: f64 = 0.95;

/// When the yield of a run is checked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CheckTime {
    /// After the first ten thousands of pulses.
    Early,
    /// At the end of the run.
    End,
}

/// Checks whether a run finds too few points for its pulses. The cause is reported once, unless another check has
/// reported it.
pub struct YieldCheck<'a> {
    pub settings: &'a Settings,
    pub scene: &'a Scene,
    pub tree: &'a Tree,
    /// Whether the flight is streamed, so that a check before its end is useful.
    pub is_live: bool,
    /// Whether the cause has been reported.
    pub is_reported: &'a AtomicBool,
    pub observer: &'a (dyn Fn(Notice) + Send + Sync),
}

impl YieldCheck<'_> {
    /// Checks the counters so far.
    ///
    /// # Errors
    /// [`Error::Input`](crate::Error::Input) where warnings are errors.
    pub fn run(&self, progress: &Progress, time: CheckTime) -> Result<()> {
        if self.is_reported.load(Relaxed) || time == CheckTime::Early && !self.is_live {
            return Ok(());
        }
        let (done, aim) = (progress.snapshot(), progress.aim());
        if let Some(finding) = self.find(done.pulses, done.echoes, &aim, time) {
            self.is_reported.store(true, Relaxed);
            (self.observer)(Notice::Warnings(finding.into_warning(None).finish(self.settings.strict)?));
        }
        Ok(())
    }

    /// Finds a run with too few points for its pulses. With [`CheckTime::Early`], a platform still approaching the
    /// scene is accepted.
    fn find(&self, pulses: u64, echoes: u64, log: &AimLog, time: CheckTime) -> Option<Finding> {
        let (scene, mount) = (self.scene, self.settings.survey.platform.mount);
        let (target, aim) = (target(&self.settings.survey, scene), &log.sum);
        if pulses == 0 {
            let help = "a leg fires when it is active and lasts for at least one pulse period; an oscillating or rotating mirror \
                        fires within its scan angle";
            return (time == CheckTime::End)
                .then(|| Finding::new("no pulse was fired: no leg was active, or all were too short", help));
        }
        let fired = pulses as f64;
        let of_sampled = |count: u64| count as f64 / (aim.sampled as f64).max(1.0);
        let (towards, within) = (of_sampled(aim.towards), of_sampled(aim.within));
        let share = echoes as f64 / fired;
        if share >= MIN_YIELD && share >= MIN_YIELD_WITHIN * within {
            return None;
        }
        let bounds = scene.bounds.translated(scene.shift);
        let flight = aim.origins.translated(scene.shift);
        let gap = (bounds.min - flight.max).max(flight.min - bounds.max).max(DVec3::ZERO);
        let across = gap.x.hypot(gap.y);
        let below = ground::check("the flight", scene, self.tree, &log.places, mount.offset.z);
        if time == CheckTime::Early && below.is_none() && towards < 0.5 && across > 0.0 {
            return None;
        }
        let message = format!(
            "{} points for {} pulses: {:.0} % of the beams point at the box of the scene and {:.0} % meet it within the \
             scanner's range; the scene is at {}, the scanner was at {}",
            amount(echoes as f64),
            amount(fired),
            100.0 * towards,
            100.0 * within,
            boxes::extent(&bounds),
            boxes::extent(&flight)
        );
        let [nearest, farthest] = target.ranges;
        let help = if across > farthest.min(boxes::MAX_REACH) || across > 0.0 && towards < 0.01 {
            format!(
                "the flight stays {} beside the scene; {}",
                metres(across),
                boxes::away(&bounds, &flight, gap)
            )
        } else if let Some(below) = below {
            format!("{}; {}", below.message, below.help)
        } else if flight.max.z < bounds.min.z {
            let depth = bounds.min.z - flight.max.z;
            format!(
                "the flight is {} below the scene; {}",
                metres(depth),
                boxes::heights(&flight.translated(DVec3::Z * -mount.offset.z), depth)
            )
        } else if towards < 0.5 && mount.rotation == Rotation::IDENTITY {
            "no mount turns the scanner towards the scene: name the platform that carries it ([platform] catalogue = \
             \"data/platforms.xml#sr22\"), or give it a mount of its own"
                .to_owned()
        } else if of_sampled(aim.upwards) > MIN_SHARE_UPWARDS {
            "all beams point upwards: the scanner's mount, or roll and pitch of the flight, turn it the wrong way"
                .to_owned()
        } else if towards < 0.5 {
            "the beams pass the scene by: attitude, mount or scan angle turn them elsewhere, or the flight leads past it; \
             `vlscan pulses` shows origins and directions"
                .to_owned()
        } else if within < 0.5 * towards {
            format!(
                "the scanner measures from {} to {}; fly lower, or name another scanner",
                metres(nearest),
                range(farthest)
            )
        } else {
            "the beams meet the box and find little in it: surfaces fill a small part of it, or their echoes are too weak; \
             `vlscan scene info` tells its materials, -v the settings"
                .to_owned()
        };
        Some(Finding::new(message, help))
    }
}

fn range(farthest: f64) -> String {
    if farthest < 1e6 { metres(farthest) } else { "any distance".to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::Aabb;
    use crate::pipeline::aim::Aim;
    use crate::survey::{Mount, ReadOptions, read_survey};
    use crate::tree::{BuildOptions, Builder, Geometry};

    /// Returns the help for a run of 10 000 pulses from `place`, of a scanner for 1 to 500 m, over a square of 20 m
    /// at height 0. `beams` counts, of a hundred, the beams that point at its box, hit it within the range, and point
    /// upwards.
    fn find(place: [f64; 3], echoes: u64, beams: [u64; 3], time: CheckTime) -> Option<String> {
        let corners = [[-10.0, -10.0, 0.0], [10.0, -10.0, 0.0], [10.0, 10.0, 0.0], [-10.0, 10.0, 0.0]];
        let geometry = Geometry {
            vertices: corners.map(DVec3::from).to_vec().into(),
            triangles: vec![[0, 1, 2], [0, 2, 3]].into(),
            ..Geometry::default()
        };
        let scene = Scene { bounds: geometry.bounds(), geometry, ..Scene::default() };
        let tree = scene.tree(&BuildOptions::of(Builder::Bvh));
        let (place, [towards, within, upwards]) = (DVec3::from(place), beams);
        let mut aim = AimLog::default();
        let origins = Aabb::around([place]);
        aim.add(&Aim { sampled: 100, towards, within, upwards, origins, place: Some(place) });
        let path = std::path::Path::new("fixtures/room/survey.xml");
        let mut settings = Settings::new(read_survey(path, &ReadOptions::default()).unwrap().0);
        let detector = &mut settings.survey.scanner.devices[0].detector;
        (detector.range_min, detector.range_max) = (1.0, 500.0);
        // A mount with rotation, so that a missing mount is not the cause.
        settings.survey.platform.mount = Mount { rotation: Rotation::about_x(1.0), ..Mount::IDENTITY };
        let check = YieldCheck {
            settings: &settings,
            scene: &scene,
            tree: &tree,
            is_live: true,
            is_reported: &AtomicBool::new(false),
            observer: &|_| (),
        };
        check.find(10_000, echoes, &aim, time).map(|finding| finding.help)
    }

    #[test]
    fn few_points_have_a_cause() {
        let end = |place, echoes, beams| find(place, echoes, beams, CheckTime::End);
        assert_eq!(end([0.0, 0.0, 50.0], 9000, [100, 100, 0]), None);
        assert_eq!(
            end([0.0, 0.0, 50.0], 101, [20, 20, 0]),
            None,
            "more than a hundredth, and than a twentieth of a fifth"
        );
        for (place, beams, cause) in [
            ([0.0, 0.0, 50.0], [0, 0, 100], "point upwards"),
            ([0.0, 0.0, 50.0], [0, 0, 0], "pass the scene by"),
            ([0.0, 0.0, 900.0], [100, 0, 0], "measures from"),
            ([0.0, 0.0, -50.0], [0, 0, 0], "below the terrain"),
            ([300.0, 0.0, 50.0], [0, 0, 0], "290 m beside the scene"),
            ([0.0, 0.0, 50.0], [100, 100, 0], "find little"),
        ] {
            let help = end(place, 0, beams).expect(cause);
            assert!(help.contains(cause), "{cause}: {help}");
        }
    }

    #[test]
    fn a_flight_on_its_way_is_left_alone() {
        assert_eq!(find([300.0, 0.0, 50.0], 0, [0, 0, 0], CheckTime::Early), None);
        assert!(find([0.0, 0.0, -50.0], 0, [0, 0, 0], CheckTime::Early).is_some());
        assert!(find([0.0, 0.0, 50.0], 0, [0, 0, 100], CheckTime::Early).is_some());
    }
}
