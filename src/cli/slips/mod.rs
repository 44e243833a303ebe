//! Inputs that are valid and cannot be meant: a flight beside its scene, below its terrain, with radians read as degrees; a
//! run that hits almost nothing. Each is a warning that names the cause and what to do, and an error with `--strict`.
//!
//! | file | what it looks at |
//! |---|---|
//! | `boxes` | the box of the flight and that of the scene: zones, units, swapped axes, local coordinates |
//! | `ground` | rays up and down from places of the flight: below the terrain, or on it |
//! | `angles` | angles as written against the course: radians read as degrees and the reverse |
//! | `poses` | a streamed flight, pose by pose |
//! | `hits` | points per pulse, and where the beams pointed |

mod angles;
mod boxes;
mod ground;
mod hits;
mod poses;

use super::run::Stage;
use crate::diag::{Diagnostics, Place};
use crate::flight::FlightPlan;
use crate::geom::{Aabb, DVec3};
use crate::pipeline::AimTarget;
use crate::scene::Scene;
use crate::survey::{AngleConvention, Interpolated, PlatformKind, RotationSpec, Survey};
use angles::AngleWatch;
pub use hits::{Yield, judge_yield};
pub use poses::PoseWatch;

/// Something that cannot be meant.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Slip {
    /// What was compared and found.
    message: String,
    /// The likely cause and what to do.
    help: String,
}

impl Slip {
    fn new(message: impl Into<String>, help: impl Into<String>) -> Slip {
        Slip { message: message.into(), help: help.into() }
    }

    /// The slip as a warning.
    pub fn warning(self, place: Option<Place>) -> Diagnostics {
        let mut found = Diagnostics::default();
        found.warn(place, self.message).help(self.help);
        found
    }
}

/// Places of a leg that are looked at.
const PLACES_PER_LEG: u32 = 33;

/// What the beams of a survey are compared with.
pub fn target(survey: &Survey, scene: &Scene) -> AimTarget {
    let detectors = survey.scanner.devices.iter().map(|d| &d.detector);
    let least = detectors.clone().map(|d| d.range_min).fold(f64::INFINITY, f64::min);
    let most = detectors.map(|d| d.range_max).fold(0.0, f64::max);
    AimTarget { bounds: scene.bounds, ranges: [least.min(most), most] }
}

/// Looks at a planned flight over its scene before anything is fired.
pub fn before_flight(survey: &Survey, stage: &Stage, flight: &FlightPlan) -> Diagnostics {
    let mut found = Diagnostics::default();
    if let PlatformKind::Interpolated(settings) = &survey.platform.kind
        && let Some(slip) = recorded_angles(settings, flight)
    {
        found.extend(slip.warning(None));
    }
    let scene = &stage.scene;
    let mount = DVec3::Z * survey.platform.mount.offset.z;
    let places = flight.places(PLACES_PER_LEG);
    let reach = target(survey, scene).ranges[1].min(boxes::MAX_REACH);
    let bounds = scene.bounds.moved(scene.shift);
    let leg =
        |number: u32| survey.legs.iter().find(|leg| leg.number == number).and_then(|leg| leg.place.clone());
    if matches!(survey.platform.kind, PlatformKind::Static) {
        for place in &places {
            let who = format!("leg {}", place.leg);
            let at = scene.to_world(place.position);
            let slip = boxes::compare(&who, &bounds, &Aabb::around([at]), reach)
                .or_else(|| ground::check(&who, stage, &[place.position + mount], mount.z));
            slip.into_iter().for_each(|slip| found.extend(slip.warning(leg(place.leg))));
        }
        return found;
    }
    let own: Vec<DVec3> = places.iter().map(|place| place.position + mount).collect();
    if own.is_empty() {
        return found;
    }
    let around = Aabb::around(places.iter().map(|place| scene.to_world(place.position)));
    let slip = boxes::compare("the flight", &bounds, &around, reach)
        .or_else(|| ground::check("the flight", stage, &own, mount.z));
    slip.into_iter().for_each(|slip| found.extend(slip.warning(None)));
    found
}

/// Angles of a recorded flight that its survey reads in the wrong unit.
fn recorded_angles(settings: &Interpolated, flight: &FlightPlan) -> Option<Slip> {
    if settings.position_only {
        return None;
    }
    let convention = match settings.rotation_spec {
        RotationSpec::Arinc705 => AngleConvention::Heading,
        RotationSpec::Canonical => AngleConvention::Canonical,
    };
    let option = "the survey's toRadians";
    let mut watch = AngleWatch::new(convention, settings.degrees, option);
    for (angles, position) in flight.recorded()?.poses() {
        let written = if settings.degrees { angles.map(f64::to_degrees) } else { angles };
        if let Some(slip) = watch.see(position, written) {
            return Some(slip);
        }
    }
    watch.end()
}

/// A length for people: three digits and a unit.
fn metres(length: f64) -> String {
    match length.abs() {
        m if m >= 10_000.0 => format!("{:.0} km", length / 1000.0),
        m if m >= 1000.0 => format!("{:.1} km", length / 1000.0),
        m if m >= 10.0 => format!("{length:.0} m"),
        _ => format!("{length:.1} m"),
    }
}
