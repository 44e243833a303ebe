//! Footprint and distances of points on the surfaces that a leg has measured.

use super::sample::Stratum;
use std::f64::consts::TAU;
use vlscan_survey::{Deflector, PlatformKind, Survey, footprint};

/// Lengths at the mean range of first echoes, m.
#[derive(Clone, Copy, Debug, Default)]
pub struct Spacing {
    pub range: Option<f64>,
    pub footprint: Option<f64>,
    pub along: Option<f64>,
    pub across: Option<f64>,
}

/// The spacing of leg `number` of the survey.
///
/// With the mean range R, beam diameter d at the instrument, divergence γ, speed v, f scan lines per second,
/// the angle α between successive beams and the head's speed ω: footprint sqrt(d² + (R·γ)²), across R·α,
/// along v/f or, of a static scanner, R·ω/f.
pub fn of_leg(survey: &Survey, number: u32, strata: &[Stratum]) -> Spacing {
    let (ranges, hits) = strata.iter().fold((0.0, 0.0), |sum, s| (sum.0 + s.ranges, sum.1 + s.hits));
    let Some(leg) = survey.legs.iter().find(|leg| leg.number == number).filter(|_| hits > 0.0) else {
        return Spacing::default();
    };
    let range = ranges / hits;
    let (settings, device) = (&leg.scanner, &survey.scanner.devices[0]);
    let footprint = footprint(device.beam.aperture, settings.beam_divergence, range);
    let mut angles: Vec<f64> = strata.iter().map(|s| s.beam_angle).collect();
    angles.sort_by(f64::total_cmp);
    let head_rate = settings.head_rate.abs().min(device.head.max_rate);
    let sweeps = match device.deflector {
        Deflector::Polygon { .. } => settings.scan_freq,
        Deflector::Oscillating { .. } | Deflector::Conic | Deflector::EllipticConic { .. } => {
            2.0 * settings.scan_freq
        }
        Deflector::Fibres { count } => f64::from(settings.pulse_freq) / f64::from(count.max(1)),
        Deflector::Risley { .. } | Deflector::Custom(_) | Deflector::Pattern(_) => 0.0,
    };
    let speed = match &survey.platform.kind {
        PlatformKind::Static => 0.0,
        PlatformKind::LinearPath | PlatformKind::GroundVehicle { .. } | PlatformKind::Multicopter(_) => {
            leg.platform.speed
        }
        PlatformKind::Interpolated(_) | PlatformKind::Stream(_) => speed_between(strata),
    };
    let along = match (speed > 0.0, sweeps > 0.0) {
        (true, true) => Some(speed / sweeps),
        // Lines of a head that spins.
        (true, false) if head_rate > 0.0 => Some(speed * TAU / head_rate),
        (false, true) if head_rate > 0.0 => Some(range * head_rate / sweeps),
        _ => None,
    };
    let across = angles.get(angles.len() / 2).map(|angle| range * angle).filter(|d| *d > 0.0);
    Spacing { range: Some(range), footprint: Some(footprint), along, across }
}

/// The mean speed of a platform that follows recorded poses, m/s.
fn speed_between(strata: &[Stratum]) -> f64 {
    let (way, time) = strata.iter().fold((0.0, 0.0), |sum, s| (sum.0 + s.way, sum.1 + s.flown_s));
    if time > 0.0 { way / time } else { 0.0 }
}
