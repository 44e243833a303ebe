//! Points per pulse: a run that hits nothing or almost nothing.

use super::{Slip, boxes, ground, metres};
use crate::cli::run::Stage;
use crate::cli::watch::amount;
use crate::geom::{DVec3, Rotation};
use crate::pipeline::{AimLog, AimTarget, Moment};
use crate::survey::Mount;

/// Fewer points per pulse than this are almost none.
const MIN_YIELD: f64 = 0.01;
/// The same for pulses whose beams meet the box of the scene.
const MIN_YIELD_WITHIN: f64 = 0.05;
/// Share of beams above which they point all the same way.
const MOST: f64 = 0.95;

/// What a run came to.
pub struct Yield<'a> {
    /// Pulses fired.
    pub pulses: u64,
    /// Echoes measured.
    pub echoes: u64,
    /// Where beams pointed.
    pub aim: &'a AimLog,
    /// What they were compared with.
    pub target: AimTarget,
    /// The scanner on its platform.
    pub mount: Mount,
}

/// Finds a run whose points are too few for its pulses. While it goes on ([`Moment::Early`]) a platform that is still on its
/// way to the scene is left alone.
pub fn judge_yield(run: &Yield, stage: &Stage, moment: Moment) -> Option<Slip> {
    let Yield { pulses, echoes, aim, target, mount } = run;
    let (log, aim) = (aim, &aim.sum);
    if *pulses == 0 {
        let help = "a leg fires when it is active and lasts for at least one pulse period; an oscillating or rotating mirror \
                    fires within its scan angle";
        return (moment == Moment::End)
            .then(|| Slip::new("no pulse was fired: no leg was active, or all were too short", help));
    }
    let fired = *pulses as f64;
    let of_sampled = |count: u64| count as f64 / (aim.sampled as f64).max(1.0);
    let (towards, within) = (of_sampled(aim.towards), of_sampled(aim.within));
    let share = *echoes as f64 / fired;
    if share >= MIN_YIELD && share >= MIN_YIELD_WITHIN * within {
        return None;
    }
    let scene = target.bounds.moved(stage.scene.shift);
    let flight = aim.origins.moved(stage.scene.shift);
    let gap = (scene.min - flight.max).max(flight.min - scene.max).max(DVec3::ZERO);
    let across = gap.x.hypot(gap.y);
    let below = ground::check("the flight", stage, &log.places, mount.offset.z);
    if moment == Moment::Early && below.is_none() && towards < 0.5 && across > 0.0 {
        return None;
    }
    let message = format!(
        "{} points for {} pulses: {:.0} % of the beams point at the box of the scene and {:.0} % meet it within the \
         scanner's range; the scene is at {}, the scanner was at {}",
        amount(*echoes as f64),
        amount(fired),
        100.0 * towards,
        100.0 * within,
        boxes::extent(&scene),
        boxes::extent(&flight)
    );
    let [nearest, farthest] = target.ranges;
    let help = if across > farthest.min(boxes::MAX_REACH) || across > 0.0 && towards < 0.01 {
        format!("the flight stays {} beside the scene; {}", metres(across), boxes::away(&scene, &flight, gap))
    } else if let Some(below) = below {
        format!("{}; {}", below.message, below.help)
    } else if flight.max.z < scene.min.z {
        let depth = scene.min.z - flight.max.z;
        format!(
            "the flight is {} below the scene; {}",
            metres(depth),
            boxes::heights(&flight.moved(DVec3::Z * -mount.offset.z), depth)
        )
    } else if towards < 0.5 && mount.rotation == Rotation::IDENTITY {
        "no mount turns the scanner towards the scene: name the platform that carries it ([platform] catalogue = \
         \"data/platforms.xml#sr22\"), or give it a mount of its own"
            .to_owned()
    } else if of_sampled(aim.upwards) > MOST {
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
    Some(Slip::new(message, help))
}

fn range(farthest: f64) -> String {
    if farthest < 1e6 { metres(farthest) } else { "any distance".to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::Aabb;
    use crate::pipeline::Aim;
    use crate::scene::Scene;
    use crate::tree::{BuildOptions, Builder, Geometry};

    /// A square of 20 m at height 0.
    fn square() -> Stage {
        let corners = [[-10.0, -10.0, 0.0], [10.0, -10.0, 0.0], [10.0, 10.0, 0.0], [-10.0, 10.0, 0.0]];
        let geometry = Geometry {
            vertices: corners.map(DVec3::from).to_vec().into(),
            triangles: vec![[0, 1, 2], [0, 2, 3]].into(),
            ..Geometry::default()
        };
        let bounds = geometry.bounds();
        let scene = Scene { geometry, bounds, ..Scene::default() };
        let tree = scene.tree(&BuildOptions::of(Builder::Bvh));
        Stage { scene, tree, movers: None }
    }

    /// A mount that is not the lack of one.
    fn turned() -> Mount {
        Mount { rotation: Rotation::about_x(1.0), ..Mount::IDENTITY }
    }

    fn judge(
        place: [f64; 3],
        echoes: u64,
        [towards, within, upwards]: [u64; 3],
        moment: Moment,
    ) -> Option<String> {
        let stage = square();
        let place = DVec3::from(place);
        let mut aim = AimLog::default();
        aim.add(&Aim {
            sampled: 100,
            towards,
            within,
            upwards,
            origins: Aabb::around([place]),
            place: Some(place),
        });
        let target = AimTarget { bounds: stage.scene.bounds, ranges: [1.0, 500.0] };
        let slip = judge_yield(
            &Yield { pulses: 10_000, echoes, aim: &aim, target, mount: turned() },
            &stage,
            moment,
        );
        slip.map(|slip| slip.help)
    }

    #[test]
    fn few_points_have_a_cause() {
        let end = |place, echoes, beams| judge(place, echoes, beams, Moment::End);
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
        assert_eq!(judge([300.0, 0.0, 50.0], 0, [0, 0, 0], Moment::Early), None);
        assert!(judge([0.0, 0.0, -50.0], 0, [0, 0, 0], Moment::Early).is_some());
        assert!(judge([0.0, 0.0, 50.0], 0, [0, 0, 100], Moment::Early).is_some());
    }
}
