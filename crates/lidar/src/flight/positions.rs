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
    /// stream, whose poses are not known yet. Vehicles and multicopters deviate little from the straight line
    /// between waypoints.
    pub fn planned_positions(&self, per_leg: u32) -> Vec<PlannedPosition> {
        let courses = &self.platform.legs;
        let mut positions = Vec::new();
        for (i, (leg, course)) in
            self.legs.iter().zip(courses).enumerate().filter(|(_, (l, _))| l.settings.active)
        {
            let mut add = |position: DVec3| {
                positions.push(PlannedPosition { leg: leg.number, position, attitude: None });
            };
            let fractions = (0..per_leg.max(2)).map(|k| f64::from(k) / f64::from(per_leg.max(2) - 1));
            match (self.platform.table(), course.span, courses.get(i + 1)) {
                _ if self.platform.is_stream() => {}
                (Some(table), Some(span), _) => {
                    positions.extend(fractions.map(|s| {
                        let time = span.start + s * (span.end - span.start);
                        let (position, attitude) = table.pose_at(time, self.platform.rotation_spec);
                        PlannedPosition { leg: leg.number, position, attitude: Some(attitude) }
                    }));
                }
                (None, _, Some(next)) if self.platform.has_waypoints() => {
                    fractions.for_each(|s| add(course.position.lerp(next.position, s)));
                }
                (None, _, _) => add(course.position),
                _ => {}
            }
        }
        positions
    }
}

#[cfg(test)]
mod tests {
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
}
