//! Checks of a flight by its beams, before it is flown: heights in feet, in centimetres or beyond the range,
//! scanners that look up. The ground below a place is taken to be level, and the scene to fill its box.

use super::boxes;
use super::finding::Finding;
use crate::pipeline::beam_counts::SampledBeam;
use vlscan_base::quantity::metres;
use vlscan_geom::{Aabb, DVec3, Rotation};
use vlscan_lidar::flight::PlannedPosition;
use vlscan_scene::Scene;
use vlscan_trace::Tree;

/// A foot, m.
const FOOT: f64 = 0.3048;
/// Height above the scene from which heights are compared with ones in feet, m.
const MIN_SUSPECT_HEIGHT: f64 = 100.0;
/// Share of the downward beams that meet the scene, below which a height is considered doubtful.
pub(super) const MIN_SHARE: f64 = 0.3;
/// Factor by which more of them meet it where the heights are read as feet; a swath is at most 3.28 times as
/// wide.
const MIN_GAIN: f64 = 2.5;
/// Share of the downward beams that meet a scene which a flight fits. High flights over small scenes miss
/// much of it from a third of their height, too.
pub(super) const FITTING_SHARE: f64 = 0.7;
/// Height above the ground from which heights are compared with ones in centimetres, m.
const MIN_SUSPECT_CENTIMETRES: f64 = 10_000.0;
/// Vertical component of beams that count as downward: within 60° of straight down.
const DOWNWARD: f64 = -0.5;
/// Share of the downward beams whose ground is out of range, above which a height is reported.
const MAX_SHARE_FAR: f64 = 0.8;
/// Share of beams above the horizon, above which a scanner that does not look down is reported.
const MAX_SHARE_UP: f64 = 0.4;
/// Vertical component of beams that look down: within 30° of straight down.
const STEEP: f64 = -0.866;
/// Height above the ground from which a scanner is expected to look down, m.
const MIN_AIRBORNE: f64 = 30.0;
/// Number of positions at which a flight is checked, and that number over a scene of tiles, each of which may
/// have to be loaded.
pub(super) const PLACES: usize = 48;
const PLACES_OVER_TILES: usize = 8;

/// A pose of a platform, scene frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct ViewPoint {
    pub position: DVec3,
    /// Rotation from the axes of the platform to those of the scene.
    pub attitude: Rotation,
}

impl ViewPoint {
    /// Poses of a leg: the recorded ones, otherwise level ones with the nose towards the next position.
    pub fn along(places: &[PlannedPosition]) -> Vec<ViewPoint> {
        let pose = |(i, place): (usize, &PlannedPosition)| {
            let (from, to) = match places.get(i + 1) {
                Some(next) => (place, next),
                None => (&places[i.saturating_sub(1)], place),
            };
            let way = to.position - from.position;
            let ahead = || Rotation::about_z(-libm::atan2(way.x, way.y));
            ViewPoint { position: place.position, attitude: place.attitude.unwrap_or_else(ahead) }
        };
        places.iter().enumerate().map(pose).collect()
    }
}

/// The scanner of a flight: directions of its beams in the frame of the platform, and the ranges that it
/// measures, m.
pub(super) struct Sight<'a> {
    pub beams: &'a [DVec3],
    /// Place of the scanner above the platform, m.
    pub mount: f64,
    pub ranges: [f64; 2],
}

/// Finds flights over the scene whose beams mostly miss it, end before it, or point above the horizon.
/// `poses` are those of the whole flight.
pub(super) fn check(
    who: &str,
    scene: &Scene,
    tree: &Tree,
    sight: &Sight,
    poses: &[ViewPoint],
) -> Option<Finding> {
    let count = if scene.tiles.is_some() { PLACES_OVER_TILES } else { PLACES };
    let bounds = &scene.bounds;
    let above = |pose: &ViewPoint| {
        let from = pose.position + DVec3::Z * sight.mount;
        let is_over = (bounds.min.x..=bounds.max.x).contains(&from.x)
            && (bounds.min.y..=bounds.max.y).contains(&from.y);
        let below = is_over.then(|| scene.nearest_where(tree, from, -DVec3::Z, |_, _| true)).flatten()?;
        Some((below.t, from, pose.attitude))
    };
    let step = poses.len().div_ceil(count).max(1);
    let places: Vec<(f64, DVec3, Rotation)> = poses.iter().step_by(step).filter_map(above).collect();
    let mut heights: Vec<f64> = places.iter().map(|(height, ..)| *height).collect();
    heights.sort_by(f64::total_cmp);
    let height = *heights.get(heights.len() / 2)?;
    let directions =
        |attitude: &Rotation| sight.beams.iter().map(|beam| attitude.apply(*beam)).collect::<Vec<_>>();
    let all: Vec<(f64, SampledBeam)> = places
        .iter()
        .flat_map(|(height, origin, attitude)| {
            directions(attitude)
                .into_iter()
                .map(|direction| (*height, SampledBeam { origin: *origin, direction }))
        })
        .collect();
    let beams: Vec<SampledBeam> = all.iter().map(|(_, beam)| *beam).collect();
    upwards(who, &beams, height).or_else(|| too_high(who, scene, &beams, height, sight.ranges)).or_else(
        || {
            let finding = out_of_range(who, &all, height, sight.ranges)?;
            let feet = in_feet(bounds, scene.shift.z, &beams, sight.ranges, 0.0);
            let help =
                feet.map_or(finding.help.clone(), |feet| format!("{feet}; otherwise {}", finding.help));
            Some(Finding { help, ..finding })
        },
    )
}

/// A scanner in the air whose beams mostly point above the horizon and never down.
fn upwards(who: &str, beams: &[SampledBeam], height: f64) -> Option<Finding> {
    let share = share_of(beams, |beam| beam.direction.z > 0.0);
    let looks_down = beams.iter().any(|beam| beam.direction.z < STEEP);
    (height > MIN_AIRBORNE && share > MAX_SHARE_UP && !looks_down).then(|| {
        let message = format!(
            "{:.0} % of the beams point above the horizon and none straight down, while {who} is {} above \
             the ground",
            100.0 * share,
            metres(height)
        );
        let help = "the scanner's mount, or roll and pitch of the flight, turn it the wrong way: name the \
                    platform it is mounted on ([platform] catalogue = \"data/platforms.xml#sr22\"), or give \
                    it a mount of its own; `vlscan pulses` shows directions";
        Finding::new(message, help)
    })
}

/// A flight whose swath is several times as wide as the scene, because its heights are in another unit.
fn too_high(
    who: &str,
    scene: &Scene,
    beams: &[SampledBeam],
    height: f64,
    ranges: [f64; 2],
) -> Option<Finding> {
    let down: Vec<SampledBeam> = beams.iter().copied().filter(is_downward).collect();
    let share = share_of(&down, |beam| meets(&scene.bounds, beam, 0.0, ranges));
    let unit = in_feet(&scene.bounds, scene.shift.z, beams, ranges, FITTING_SHARE)
        .or_else(|| in_centimetres(scene, beams, height).filter(|_| !down.is_empty() && share < MIN_SHARE))?;
    let share = 100.0 * share;
    let message = format!(
        "{who} is {} above the ground, from where only {share:.0} % of the downward beams meet the scene \
         within the scanner's range",
        metres(height)
    );
    let help = format!("{unit}; otherwise fly lower, or with a narrower scan angle, or extend the scene");
    Some(Finding::new(message, help))
}

/// A flight whose ground is mostly nearer, or mostly farther, than the scanner measures. `beams` have the
/// height above the ground.
fn out_of_range(
    who: &str,
    beams: &[(f64, SampledBeam)],
    height: f64,
    [nearest, farthest]: [f64; 2],
) -> Option<Finding> {
    let down = beams.iter().filter(|(_, beam)| is_downward(beam));
    let mut ranges: Vec<f64> = down.map(|(height, beam)| -height / beam.direction.z).collect();
    ranges.sort_by(f64::total_cmp);
    let typical = *ranges.get(ranges.len() / 2)?;
    let far = share_of(&ranges, |range| *range > farthest);
    let near = share_of(&ranges, |range| *range < nearest);
    let (limit, remedy) = match (far > MAX_SHARE_FAR, near > MAX_SHARE_FAR) {
        (true, _) => (format!("measures up to {}", metres(farthest)), "fly lower, or name another scanner"),
        (_, true) => (format!("measures from {} on", metres(nearest)), "fly higher, or name another scanner"),
        _ => return None,
    };
    let message = format!(
        "{who} is {} above the ground, which most beams meet after about {}, and the scanner {limit}",
        metres(height),
        metres(typical)
    );
    Some(Finding::new(message, remedy))
}

/// A hint where few of the beams that point down meet the scene within the ranges of the scanner, and many
/// more, at least a share of `fitting`, would if heights were in feet. `level` is the height of the origin of
/// the scene's frame, m.
pub(super) fn in_feet(
    scene: &Aabb,
    level: f64,
    beams: &[SampledBeam],
    ranges: [f64; 2],
    fitting: f64,
) -> Option<String> {
    let down: Vec<SampledBeam> = beams.iter().copied().filter(is_downward).collect();
    let mut heights: Vec<f64> = down.iter().map(|beam| beam.origin.z + level).collect();
    heights.sort_by(f64::total_cmp);
    let height = *heights.get(heights.len() / 2)?;
    let as_feet = height * FOOT;
    let (low, high) = (scene.min.z + level, scene.max.z + level);
    if height - high <= MIN_SUSPECT_HEIGHT
        || as_feet <= high
        || as_feet - low > ranges[1].min(boxes::MAX_REACH)
    {
        return None;
    }
    let share = |lower: f64| share_of(&down, |beam| meets(scene, beam, lower, ranges));
    let (now, then) = (share(0.0), share(height - as_feet));
    (now < MIN_SHARE && then > MIN_GAIN * now && then >= fitting)
        .then(|| format!("if its heights are in feet, {height:.0} ft are {as_feet:.0} m"))
}

/// A hint at heights in centimetres or millimetres of beams that start `height` metres above the ground.
fn in_centimetres(scene: &Scene, beams: &[SampledBeam], height: f64) -> Option<String> {
    let mut heights: Vec<f64> = beams.iter().map(|beam| beam.origin.z + scene.shift.z).collect();
    heights.sort_by(f64::total_cmp);
    let typical = *heights.get(heights.len() / 2)?;
    let bounds = scene.bounds.translated(scene.shift);
    (height > MIN_SUSPECT_CENTIMETRES).then(|| boxes::in_centimetres(&bounds, typical)).flatten()
}

fn is_downward(beam: &SampledBeam) -> bool {
    beam.direction.z < DOWNWARD
}

/// True if a beam from `lower` metres below its origin meets the box of the scene within the ranges.
fn meets(scene: &Aabb, beam: &SampledBeam, lower: f64, [nearest, farthest]: [f64; 2]) -> bool {
    let farthest = farthest.min(boxes::MAX_REACH);
    let slabs = scene.slabs(beam.origin - DVec3::Z * lower, beam.direction);
    slabs.is_some_and(|(enter, leave)| enter <= farthest && leave >= nearest)
}

fn share_of<T>(all: &[T], is_counted: impl Fn(&T) -> bool) -> f64 {
    all.iter().filter(|one| is_counted(one)).count() as f64 / all.len().max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use vlscan_geom::radians;
    use vlscan_trace::{BuildOptions, Builder, Geometry};

    /// A square of ground, `half` metres to each side, at height `z`.
    fn ground(half: f64, z: f64) -> (Scene, std::sync::Arc<Tree>) {
        let corners = [[-half, -half, z], [half, -half, z], [half, half, z], [-half, half, z]];
        let geometry = Geometry {
            vertices: corners.map(DVec3::from).to_vec(),
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            ..Geometry::default()
        };
        let scene = Scene { bounds: geometry.bounds(), geometry, ..Scene::default() };
        let tree = scene.tree(&BuildOptions::of(Builder::Bvh));
        (scene, tree)
    }

    /// Beams within `half` degrees of `middle` degrees from straight down, across the flight.
    fn fan(middle: f64, half: f64) -> Vec<DVec3> {
        let at = |i: i32| radians(middle + half * f64::from(i) / 20.0);
        (-20..=20).map(|i| DVec3::new(at(i).sin(), 0.0, -at(i).cos())).collect()
    }

    /// Finding of a flight northwards at height `z` over ground at `at` of 300 m across.
    fn fly(z: f64, at: f64, beams: &[DVec3], farthest: f64) -> Option<String> {
        fly_with(z, at, beams, farthest, None)
    }

    /// Finding of such a flight with recorded attitudes.
    fn fly_with(
        z: f64,
        at: f64,
        beams: &[DVec3],
        farthest: f64,
        attitude: Option<Rotation>,
    ) -> Option<String> {
        let (scene, tree) = ground(150.0, at);
        let position = |i| DVec3::new(0.0, 10.0 * f64::from(i), z);
        let places: Vec<PlannedPosition> =
            (-20..=20).map(|i| PlannedPosition { leg: 0, position: position(i), attitude }).collect();
        let sight = Sight { beams, mount: 0.0, ranges: [1.0, farthest] };
        let found = check("the flight", &scene, &tree, &sight, &ViewPoint::along(&places));
        found.map(|finding| format!("{}; {}", finding.message, finding.help))
    }

    #[test]
    fn heights_in_feet_are_doubted_where_the_swath_tells_and_only_there() {
        let beams = fan(0.0, 45.0);
        let found = fly(1017.0, 202.0, &beams, 1e9).unwrap();
        assert!(found.contains("1017 ft are 310 m") && found.contains("815 m above the ground"), "{found}");
        for z in [310.0, 600.0] {
            assert_eq!(fly(z, 202.0, &beams, 1e9), None, "{z}");
        }
        // A narrow swath stays on the scene from any height.
        assert_eq!(fly(1017.0, 202.0, &fan(0.0, 8.0), 1e9), None);
        // In feet the flight would be below the ground.
        assert_eq!(fly(1017.0, 400.0, &beams, 1e9), None);
    }

    #[test]
    fn flights_that_fit_in_feet_or_centimetres_are_told_from_high_ones() {
        let beams = fan(0.0, 20.0);
        for (z, hint) in [
            (1500.0, "1500 ft are 457 m"),
            (31_000.0, "31000 cm are 310 m"),
            (310_000.0, "310000 mm are 310 m"),
        ] {
            let found = fly(z, 0.0, &beams, f64::MAX).unwrap();
            assert!(found.contains(hint) && found.contains("of the downward beams meet"), "{z}: {found}");
        }
        // The swath is wider than the scene in feet, too.
        for z in [600.0, 900.0, 3000.0, 6000.0] {
            assert_eq!(fly(z, 0.0, &beams, f64::MAX), None, "{z}");
        }
        let far = fly(31_000.0, 0.0, &beams, 1500.0).unwrap();
        assert!(far.contains("31000 cm are 310 m"), "{far}");
        let far = fly(3000.0, 0.0, &beams, 1500.0).unwrap();
        assert!(far.contains("3000 ft are 914 m; otherwise fly lower"), "{far}");
    }

    #[test]
    fn ground_out_of_range_is_reported() {
        assert!(fly(100.0, 0.0, &fan(0.0, 20.0), 80.0).unwrap().contains("measures up to 80 m"));
        assert_eq!(fly(100.0, 0.0, &fan(0.0, 20.0), 120.0), None);
    }

    #[test]
    fn scanners_that_look_up_are_reported_in_the_air() {
        let ahead: Vec<DVec3> = (-20..=20)
            .map(|i| radians(2.0 * f64::from(i)))
            .map(|angle| DVec3::new(0.0, angle.cos(), angle.sin()))
            .collect();
        assert!(fly(60.0, 0.0, &ahead, 1e9).unwrap().contains("above the horizon"));
        assert_eq!(fly(10.0, 0.0, &ahead, 1e9), None, "a vehicle");
        let nose_down = Some(Rotation::about_x(radians(-90.0)));
        assert_eq!(fly_with(60.0, 0.0, &ahead, 1e9, nose_down), None, "the recorded attitude turns it down");
        assert_eq!(fly(60.0, 0.0, &fan(0.0, 180.0), 1e9), None, "a mirror that turns all round");
    }
}
