//! Directions of beams without a flight: the view of a scanner from its platform.

use super::FlightPlan;
use super::leg::PlannedLeg;
use crate::scanner::{DevicePlan, DeviceState};
use std::f64::consts::TAU;
use vlscan_base::rng::GOLDEN;
use vlscan_geom::DVec3;

/// Maximum number of devices of a scanner that are sampled.
const MAX_DEVICES: usize = 8;
/// Beams of a device.
const BEAMS: u32 = 64;
/// Steps of a deflector over which the beams are spread, at least and at most.
const STEPS: (f64, f64) = (1024.0, 1_048_576.0);

impl FlightPlan {
    /// Directions of some beams of the first active leg, in the frame of the platform (x right, y forward, z
    /// up): those of up to eight channels, spread over some periods of the mirror and one turn of the head.
    /// Empty without an active leg.
    pub fn sample_beams(&self) -> Vec<DVec3> {
        let Some(leg) = self.legs.iter().find(|leg| leg.settings.active) else { return Vec::new() };
        let stride = self.devices.len().div_ceil(MAX_DEVICES).max(1);
        self.devices.iter().step_by(stride).flat_map(|device| self.beams_of(device, leg)).collect()
    }

    fn beams_of(&self, device: &DevicePlan, leg: &PlannedLeg) -> Vec<DVec3> {
        let mount = leg.mount.as_ref().unwrap_or(&self.mount).rotation;
        let period = |rate: f64| if rate > 0.0 { leg.frequency / rate } else { 0.0 };
        let turn = period(device.head_rate(leg.settings.head_rate).abs() / TAU);
        let all = (2.0 * period(leg.settings.scan_freq)).max(turn).clamp(STEPS.0, STEPS.1);
        let mut state = DeviceState::at_rest(device);
        state.start_leg(device, &leg.settings);
        let (mut beams, mut before) = (Vec::new(), 0);
        for i in 0..BEAMS {
            // At changing phases of the mirror, so that none is met more often than others.
            let at = ((f64::from(i) + (f64::from(i) * GOLDEN).fract()) * all / f64::from(BEAMS)) as u32 + 1;
            let steps = at.saturating_sub(before);
            if steps == 0 {
                continue;
            }
            state.head.jump(f64::from(steps));
            state.advance_deflector(device, steps);
            before = at;
            if state.deflector.is_firing() {
                let emitter = state.emitter(device);
                beams.push(mount.after(emitter).after(state.deflector.exact_rotation(device)).forward());
            }
        }
        beams
    }
}

#[cfg(test)]
mod tests {
    use crate::flight::testing::*;
    use vlscan_geom::{Rotation, radians};
    use vlscan_survey::{Mount, PlatformKind};

    #[test]
    fn beams_spread_over_the_swath_and_follow_the_mount() {
        let down = Rotation::about_z(radians(90.0)).after(Rotation::about_x(radians(-90.0)));
        for (rotation, is_down) in [(Rotation::IDENTITY, false), (down, true)] {
            let mount = Mount { rotation, ..Mount::IDENTITY };
            let legs = vec![leg([0.0, 0.0, 50.0], 30.0, |_| {}), leg([100.0, 0.0, 50.0], 30.0, |_| {})];
            let flight = survey(PlatformKind::LinearPath, mount, straight(), legs);
            let beams = plan_of(&flight).unwrap().0.sample_beams();
            assert!(beams.len() > 20, "{}", beams.len());
            assert!(beams.iter().all(|beam| (beam.length() - 1.0).abs() < 1e-12));
            assert_eq!(beams.iter().all(|beam| beam.z < -0.5), is_down, "{beams:?}");
        }
    }
}
