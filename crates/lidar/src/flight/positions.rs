//! Positions along a planned flight, without flying it.

use super::FlightPlan;
use vlscan_geom::{DVec3, Rotation};

/// A place of the platform along a planned leg.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlannedPosition {
    /// Number of the leg in the survey.
    pub leg: u32,
    /// Position of the platform, m, scene frame.
    pub position: DVec3,
    /// Recorded attitude, from the axes of the platform to those of the scene; `None` where it is not
    /// recorded.
    pub attitude: Option<Rotation>,
}

impl FlightPlan {
    /// Up to `per_leg` positions along each active leg: the position of a static platform, evenly spaced
    /// positions between two waypoints, positions of a recorded flight at equal time intervals; none for a
    /// stream, whose poses are not known yet. A maximum duration ends a leg before its waypoint, from where
    /// the next one begins. Vehicles and multicopters deviate little from the straight line between
    /// waypoints.
    pub fn planned_positions(&self, per_leg: u32) -> Vec<PlannedPosition> {
        let courses = &self.platform.legs;
        let mut positions = Vec::new();
        let mut reached = courses.first().map_or(DVec3::ZERO, |course| course.position);
        for (i, (leg, course)) in self.legs.iter().zip(courses).enumerate() {
            let way = self.way_of(i, reached);
            reached = way[1];
            if !leg.settings.active || self.platform.is_stream() {
                continue;
            }
            let mut add = |position: DVec3| {
                positions.push(PlannedPosition { leg: leg.number, position, attitude: None });
            };
            let fractions = (0..per_leg.max(2)).map(|k| f64::from(k) / f64::from(per_leg.max(2) - 1));
            match (self.platform.table(), course.span) {
                (Some(table), Some(span)) => {
                    let longest = if leg.max_duration > 0.0 { leg.max_duration } else { f64::INFINITY };
                    let seconds = (span.end - span.start).min(longest);
                    positions.extend(fractions.map(|s| {
                        let time = span.start + s * seconds;
                        let (position, attitude) = table.pose_at(time, self.platform.rotation_spec);
                        PlannedPosition { leg: leg.number, position, attitude: Some(attitude) }
                    }));
                }
                (Some(_), None) => {}
                (None, _) if self.platform.has_waypoints() && i + 1 < courses.len() => {
                    fractions.for_each(|s| add(way[0].lerp(way[1], s)));
                }
                (None, _) if self.platform.has_waypoints() => add(way[0]),
                (None, _) => add(course.position),
            }
        }
        positions
    }

    /// The first and the last position of a leg of a platform that flies from waypoint to waypoint, which
    /// begins where the leg before has ended.
    fn way_of(&self, leg: usize, from: DVec3) -> [DVec3; 2] {
        let Some(next) = self.platform.legs.get(leg + 1) else { return [from; 2] };
        let (longest, speed) = (self.legs[leg].max_duration, self.platform.legs[leg].speed.max(0.0));
        let way = (next.position - from).length();
        // The last step of a leg ends at its waypoint.
        let is_cut = longest > 0.0 && longest * speed < way;
        [from, if is_cut { from.lerp(next.position, longest * speed / way) } else { next.position }]
    }
}

#[cfg(test)]
mod tests {
    use crate::flight::FlightPlan;
    use crate::flight::testing::*;
    use vlscan_geom::DVec3;
    use vlscan_survey::{Mount, PlatformKind};

    #[test]
    fn positions_are_on_active_legs() {
        let mut legs = [[0.0, 0.0, 50.0], [100.0, 0.0, 60.0], [100.0, 50.0, 60.0]]
            .map(|p| leg(p, 30.0, |_| {}))
            .to_vec();
        legs[1].scanner.active = false;
        let flight = survey(PlatformKind::LinearPath, Mount::IDENTITY, straight(), legs.clone());
        let positions = plan_of(&flight).unwrap().0.planned_positions(3);
        let of = |leg: u32| positions.iter().filter(|p| p.leg == leg).map(|p| p.position).collect::<Vec<_>>();
        assert_eq!(of(0), [[0.0, 0.0, 50.0], [50.0, 0.0, 55.0], [100.0, 0.0, 60.0]].map(DVec3::from));
        assert_eq!((of(1).len(), of(2)), (0, vec![DVec3::new(100.0, 50.0, 60.0)]));
    }

    #[test]
    fn maximum_durations_end_legs_before_their_waypoints() {
        let mut legs = [[0.0, 0.0, 50.0], [100.0, 0.0, 50.0], [40.0, 30.0, 50.0]]
            .map(|p| leg(p, 20.0, |l| l.scanner.max_duration = Some(2.0)))
            .to_vec();
        let flight = survey(PlatformKind::LinearPath, Mount::IDENTITY, straight(), legs.clone());
        let (plan, _) = plan_of(&flight).unwrap();
        let ends = |plan: &FlightPlan| -> Vec<DVec3> {
            plan.planned_positions(2).iter().map(|place| place.position).collect()
        };
        // 40 m towards the second waypoint, from there on to the third one, 30 m away, where it stays.
        let corner = DVec3::new(40.0, 0.0, 50.0);
        let last = DVec3::new(40.0, 30.0, 50.0);
        assert_eq!(ends(&plan), [DVec3::new(0.0, 0.0, 50.0), corner, corner, last, last]);
        for (flown, leg) in fly_plan(&plan).iter().zip([corner, last]) {
            let end = flown.pulses.last().unwrap().origin;
            assert!((end - leg).length() < 0.5, "{end}");
        }
        legs.iter_mut().for_each(|leg| leg.scanner.max_duration = Some(60.0));
        let flight = survey(PlatformKind::LinearPath, Mount::IDENTITY, straight(), legs);
        assert_eq!(ends(&plan_of(&flight).unwrap().0)[1], DVec3::new(100.0, 0.0, 50.0));
    }
}
