//! Beams of a sample: where those beside a measured one meet the ground, and where the scene ends.

use std::collections::BTreeMap;
use vlscan_geom::{Aabb, DVec3, HeightModel};
use vlscan_lidar::flight::Pulse;
use vlscan_lidar::pulse::Echo;

/// Height above the ground up to which an echo is from the ground, m.
const GROUND_TOLERANCE: f64 = 0.5;
/// Height above the ground at which a beam counts as arrived, m.
const ARRIVAL: f64 = 0.1;
/// Descent per metre below which a beam is not followed to the ground.
const MIN_DESCENT: f64 = 0.02;
/// Steps in which a beam approaches the ground, at most.
const MAX_APPROACHES: u32 = 12;
/// Change of direction from pulse to pulse beyond which a beam is that of another scan line.
const MAX_SWING: f64 = 0.05;
/// Maximum ratio of the path of a beam over level ground to its path across the beam.
const MAX_STRETCH: f64 = 5.0;
/// Distance from the edge of a scene at which its ground is looked up, m.
const EDGE: f64 = 0.01;

/// Changes of direction of a pulse that represents only itself.
pub const ITSELF: &[DVec3] = &[DVec3::ZERO];

/// The scene around returns, in its frame.
#[derive(Clone, Copy)]
pub struct Surroundings<'a> {
    /// Height of the ground, or of the lowest surface of a scene without ground.
    pub heights: &'a dyn HeightModel,
    /// True if the scene has ground, to which pulses are followed.
    pub has_ground: bool,
    /// The box of the ground: level with it nothing beyond returns a pulse.
    pub bounds: Aabb,
}

impl Surroundings<'_> {
    /// True if a place lies within the box in plan.
    pub fn has(&self, [x, y]: [f64; 2]) -> bool {
        let Aabb { min, max } = &self.bounds;
        (min.x..=max.x).contains(&x) && (min.y..=max.y).contains(&y)
    }

    /// The place where a beam that misses the box would meet level ground beyond its edge, and a place at
    /// this edge. `None` for other beams, and for beams whose distance from the box exceeds `way`, m, plus
    /// the reach of a change of direction by `swing`.
    pub fn past_edge(&self, beam: &Beam, swing: f64, way: f64) -> Option<(DVec3, [f64; 2])> {
        let (Beam { origin, direction }, lowest) = (*beam, self.bounds.min.z);
        if direction.z > -MIN_DESCENT || origin.z <= lowest {
            return None;
        }
        let at_height = |z: f64| origin + direction * ((z - origin.z) / direction.z);
        let ends = [lowest, self.bounds.max.z.min(origin.z)].map(at_height);
        // A slanted beam may be outside at the height of the edge only.
        let outside = ends.into_iter().find(|end| !self.has([end.x, end.y]))?;
        let off = |place: DVec3| {
            let [x, y] = self.nearest([place.x, place.y]);
            (x - place.x).hypot(y - place.y)
        };
        let reach = way + MAX_STRETCH * swing * (ends[0] - origin).length() + EDGE;
        if off(ends[0]).min(off(ends[1])) > reach {
            return None;
        }
        let edge = self.nearest([outside.x, outside.y]);
        let ground = self.heights.height(edge[0], edge[1]).filter(|z| *z < origin.z)?;
        let place = at_height(ground);
        (!self.has([place.x, place.y]) && off(place) <= reach).then_some((place, edge))
    }

    /// Narrows a range of whole numbers n to those for which `place` + n·`step` lies within the box in plan.
    /// An empty range ends before it begins.
    pub fn within(&self, place: [f64; 2], step: [f64; 2], [low, high]: [f64; 2]) -> [f64; 2] {
        let Aabb { min, max } = &self.bounds;
        let axes = [(place[0], step[0], min.x, max.x), (place[1], step[1], min.y, max.y)];
        axes.into_iter().fold([low, high], |[low, high], (at, step, min, max)| {
            if step == 0.0 {
                return if (min..=max).contains(&at) { [low, high] } else { [1.0, 0.0] };
            }
            let (one, two) = ((min - at) / step, (max - at) / step);
            [low.max(one.min(two).ceil()), high.min(one.max(two).floor())]
        })
    }

    /// The nearest place of the box in plan.
    fn nearest(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let Aabb { min, max } = &self.bounds;
        // Within its edges, which a vertical ray may miss.
        let within = |value: f64, low: f64, high: f64| {
            let inset = EDGE.min(0.5 * (high - low)).max(0.0);
            value.max(low + inset).min(high - inset)
        };
        [within(x, min.x, max.x), within(y, min.y, max.y)]
    }
}

/// A pulse, scene frame.
#[derive(Clone, Copy, Debug)]
pub struct Beam {
    /// Its origin, m.
    pub origin: DVec3,
    /// Its direction, a unit vector.
    pub direction: DVec3,
}

impl Beam {
    /// The beam of an echo.
    pub fn of(echo: &Echo) -> Beam {
        Beam { origin: echo.origin, direction: echo.direction }
    }
}

/// True for an echo of a surface, not of the air or of noise.
pub fn is_of_surface(echo: &Echo) -> bool {
    echo.part != u32::MAX
}

/// The place, for a place on a beam, on another beam from the same origin: on a level plane, or across the
/// beam where this is nearly level. `swing` is the change of direction.
pub fn moved(beam: &Beam, place: DVec3, swing: DVec3) -> [f64; 2] {
    if swing == DVec3::ZERO {
        return [place.x, place.y];
    }
    let (way, other) = (beam.direction, beam.direction + swing);
    let range = (place - beam.origin).dot(way);
    let across = swing * range;
    let on_plane = other * (range * way.z / other.z) - way * range;
    let is_steep = other.z < -MIN_DESCENT && on_plane.length() <= MAX_STRETCH * across.length();
    let step = if is_steep { on_plane } else { across };
    [place.x + step.x, place.y + step.y]
}

/// Horizontal ways, m, from a place on a beam to those on others from its origin, by their changes of
/// direction.
pub fn offsets(beam: &Beam, place: DVec3, swings: &[DVec3]) -> Vec<[f64; 2]> {
    let offset = |swing: &DVec3| {
        let [x, y] = moved(beam, place, *swing);
        [x - place.x, y - place.y]
    };
    swings.iter().map(offset).collect()
}

/// Leaves one in `every` pulses of a device: those whose number has the remainder `phase`, each of which
/// stands for the pulses around it, and one for pulses at an end without it. Returns for each of them, in
/// their order, the changes of direction to the beams that it stands for, itself among them; nothing if all
/// pulses are left.
pub fn thin(pulses: &mut Vec<Pulse>, every: u32, phase: u64) -> Vec<Vec<DVec3>> {
    if every <= 1 {
        return Vec::new();
    }
    let every = u64::from(every);
    let mut groups: BTreeMap<(u32, u64), Vec<usize>> = BTreeMap::new();
    for (i, pulse) in pulses.iter().enumerate() {
        let group = (pulse.number + every + every / 2 - phase) / every;
        groups.entry((pulse.device, group)).or_default().push(i);
    }
    let keep = |members: &Vec<usize>| {
        let is_it = |i: &usize| pulses[*i].number % every == phase;
        let at = members.iter().copied().find(is_it).unwrap_or(members[members.len() / 2]);
        let (number, direction) = (pulses[at].number, pulses[at].attitude.forward());
        let swing_to =
            |pulse: &Pulse| swing(direction, pulse.attitude.forward(), pulse.number.abs_diff(number));
        let swings: Vec<DVec3> = members.iter().map(|i| swing_to(&pulses[*i])).collect();
        (at, swings)
    };
    let mut kept: Vec<(usize, Vec<DVec3>)> = groups.values().map(keep).collect();
    kept.sort_unstable_by_key(|(at, _)| *at);
    let mut places = kept.iter().map(|(at, _)| *at).peekable();
    let mut at = 0;
    pulses.retain(|_| {
        at += 1;
        places.next_if_eq(&(at - 1)).is_some()
    });
    kept.into_iter().map(|(_, swings)| swings).collect()
}

/// The change of direction to a beam that is fired some pulses before or after; 0 if it belongs to another
/// scan line.
fn swing(direction: DVec3, other: DVec3, pulses: u64) -> DVec3 {
    let swing = other - direction;
    if swing.length() <= MAX_SWING * pulses as f64 { swing } else { DVec3::ZERO }
}

/// The place where the beam of a pulse's last echo meets the ground, scene frame, and true if the echo is
/// from there; `None` for beams that are level or rise, and where there is no ground.
pub fn below(echo: &Echo, ground: &dyn HeightModel) -> Option<(DVec3, bool)> {
    let mut at = echo.position;
    let mut above = at.z - ground.height(at.x, at.y)?;
    if above <= GROUND_TOLERANCE {
        return Some((at, true));
    }
    let way = echo.direction;
    if way.z > -MIN_DESCENT {
        return None;
    }
    for _ in 0..MAX_APPROACHES {
        at += way * (above / -way.z);
        above = at.z - ground.height(at.x, at.y)?;
        if above.abs() <= ARRIVAL {
            break;
        }
    }
    Some((at, false))
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use vlscan_geom::Rotation;

    /// A pulse from the origin.
    pub fn pulse(number: u64, attitude: Rotation) -> Pulse {
        Pulse {
            origin: DVec3::ZERO,
            attitude,
            exact_attitude: attitude,
            reported_attitude: attitude,
            scanner_attitude: attitude,
            origin_error: DVec3::ZERO,
            time_ns: number as f64,
            number,
            device: 0,
            scan_angle: 0.0,
            range_error: 0.0,
            velocity: None,
        }
    }

    /// Pulses 1 to `count` of two devices, whose beams turn by 0.01 rad from one to the next.
    fn pulses(count: u64) -> Vec<Pulse> {
        let turned = |i: u64| pulse(i, Rotation::about_z(0.01 * i as f64));
        (1..=count).flat_map(|i| [0, 1].map(|device| Pulse { device, ..turned(i) })).collect()
    }

    #[test]
    fn one_in_a_few_pulses_is_left_and_stands_for_those_around_it() {
        let mut some = pulses(10);
        let beams = thin(&mut some, 4, 2);
        let left: Vec<(u64, u32)> = some.iter().map(|pulse| (pulse.number, pulse.device)).collect();
        assert_eq!(left, [(2, 0), (2, 1), (6, 0), (6, 1), (10, 0), (10, 1)]);
        // Pulses 1 to 3, 4 to 7, 8 to 10.
        assert_eq!(beams.iter().map(Vec::len).collect::<Vec<_>>(), [3, 3, 4, 4, 3, 3]);
        let angles: Vec<f64> = beams[2].iter().map(|swing| swing.length()).collect();
        let near = |(found, expected): (&f64, f64)| (found - expected).abs() < 1e-5;
        assert!(angles.iter().zip([0.02, 0.01, 0.0, 0.01]).all(near), "{angles:?}");
        // Pulses 1 to 5 have pulse 2; 6 to 8, without pulse 10, have another one.
        let mut cut = pulses(8);
        let beams = thin(&mut cut, 8, 2);
        let left: Vec<(u64, usize)> =
            cut.iter().zip(&beams).map(|(p, beam)| (p.number, beam.len())).collect();
        assert_eq!(left, [(2, 5), (2, 5), (7, 3), (7, 3)]);
        // All of them, and none.
        let mut all = pulses(10);
        assert!(thin(&mut all, 1, 0).is_empty() && all.len() == 20);
        assert!(thin(&mut Vec::new(), 8, 0).is_empty());
    }

    #[test]
    fn beams_beside_another_one_meet_a_level_plane() {
        let slanted = Beam { direction: DVec3::new(0.0, 0.6, -0.8), origin: DVec3::new(0.0, -60.0, 80.0) };
        let found = moved(&slanted, DVec3::ZERO, DVec3::new(0.0, 0.008, 0.006));
        // Across the beam 1 m, on the plane 1 / 0.8 m and a little more.
        assert!(found[0] == 0.0 && (found[1] - 1.25).abs() < 0.02, "{found:?}");
        // A level beam moves across, a jump to the next line does not count.
        let level = Beam { direction: DVec3::Y, origin: DVec3::new(0.0, -100.0, 0.0) };
        assert_eq!(moved(&level, DVec3::ZERO, DVec3::new(0.01, 0.0, 0.0)), [1.0, 0.0]);
        assert_eq!(swing(DVec3::Y, DVec3::NEG_Z, 4), DVec3::ZERO);
        assert_eq!(swing(DVec3::ZERO, DVec3::X * 0.08, 1), DVec3::ZERO);
        assert_eq!(swing(DVec3::ZERO, DVec3::X * 0.08, 2), DVec3::X * 0.08);
    }

    #[test]
    fn beams_that_pass_the_scene_would_meet_its_ground_beside_the_edge() {
        // Ground from x = 0 to 40, at z = 5 there.
        let heights = |x: f64, _: f64| (0.0..=40.0).contains(&x).then_some(5.0);
        let bounds = Aabb { min: DVec3::new(0.0, -50.0, 0.0), max: DVec3::new(40.0, 50.0, 20.0) };
        let scene = Surroundings { heights: &heights, has_ground: true, bounds };
        let down = |x: f64| Beam { origin: DVec3::new(x, 7.0, 105.0), direction: DVec3::NEG_Z };
        let (place, edge) = scene.past_edge(&down(41.5), 0.0, 2.0).unwrap();
        assert_eq!((place, edge), (DVec3::new(41.5, 7.0, 5.0), [40.0 - EDGE, 7.0]));
        // The next beam 0.02 rad beside it would be 2.1 m farther on, or five times as far on a slope.
        assert!(scene.past_edge(&down(41.5), 0.0, 1.4).is_none());
        assert!(scene.past_edge(&down(41.5), 0.02, 0.0).is_some());
        // One that comes from outside, and is below the scene farther on.
        let slanted = Beam { origin: DVec3::new(116.0, 7.0, 105.0), direction: DVec3::new(-0.6, 0.0, -0.8) };
        let (place, _) = scene.past_edge(&slanted, 0.0, 2.0).unwrap();
        assert!((place - DVec3::new(41.0, 7.0, 5.0)).length() < 1e-9, "{place}");
        // A beam in the scene has no return for another reason; others rise, or begin below it.
        assert!(scene.past_edge(&down(20.0), 0.02, 2.0).is_none());
        let up = Beam { direction: DVec3::Z, ..down(41.5) };
        let deep = Beam { origin: DVec3::new(41.5, 7.0, -1.0), ..down(41.5) };
        assert!(scene.past_edge(&up, 0.0, 2.0).is_none() && scene.past_edge(&deep, 0.0, 2.0).is_none());
    }
}
