//! Places where the beams of an instrument meet flat ground, sampled from the optics that the simulator
//! turns: whatever deflector, channels, facets and head an instrument has, no separate formula is needed.

use super::error::PlanError;
use super::reach::{Reach, Seen};
use vlscan_base::corrections::Corrections;
use vlscan_base::rng::GOLDEN;
use vlscan_geom::{DVec3, Rotation};
use vlscan_lidar::scanner::{DevicePlan, DeviceState};
use vlscan_survey::{Device, Mount, ScannerSettings};

/// Maximum number of samples of all devices together.
const MAX_SAMPLES: f64 = 60_000.0;
/// Intervals of the profile across a strip.
const BINS: usize = 256;
/// Share of the pulses ahead and behind that may be left out of the reach along the flight.
const TAIL: f64 = 0.005;

/// Attitudes of the beam for a sample of the pulses of one device, in the axes of the mount (x right, y
/// ahead, z up).
#[derive(Clone, Debug)]
struct DeviceBeams {
    attitudes: Vec<Rotation>,
    /// Origin of the beams relative to the mount, m.
    offset: DVec3,
    reach: Reach,
}

/// A sample of an instrument's pulses.
#[derive(Clone, Debug)]
pub(super) struct Beams {
    devices: Vec<DeviceBeams>,
    /// Pulse periods from one sample to the next.
    stride: u32,
    /// Pulses that leave the instrument, per pulse that it counts and device.
    pub fired: f64,
}

impl Beams {
    /// Samples `steps` pulse periods of a leg with these settings.
    ///
    /// # Errors
    /// A formula of a mechanical error without a value, optics that emit nothing.
    pub fn of(
        devices: &[(Device, Reach)],
        settings: &ScannerSettings,
        steps: f64,
    ) -> Result<Beams, PlanError> {
        let steps = steps.clamp(1.0, f64::from(u32::MAX / 2));
        // Odd, so that halves and quarters of a line are met.
        let stride = (steps * devices.len() as f64 / MAX_SAMPLES).floor().max(0.0) as u32 / 2 * 2 + 1;
        let count = (steps / f64::from(stride)).ceil() as u32;
        let mut fired = 0.0;
        let mut beams = Vec::with_capacity(devices.len());
        for (index, (device, reach)) in devices.iter().enumerate() {
            // Channels that turn together are sampled at different angles, so that together they meet the
            // edges of a strip.
            let first = ((index as f64 * GOLDEN).fract() * f64::from(stride)) as u32;
            let attitudes = attitudes(device, settings, first, count, stride)?;
            fired += attitudes.len() as f64;
            beams.push(DeviceBeams { attitudes, offset: device.beam_origin.offset, reach: *reach });
        }
        if fired == 0.0 {
            return Err(PlanError::NoPulses);
        }
        Ok(Beams { devices: beams, stride, fired: fired / (f64::from(count) * devices.len() as f64) })
    }

    /// Points in which the beams meet flat ground `height` m below a platform that carries the instrument on
    /// `mount`.
    pub fn over_ground(&self, mount: &Mount, height: f64) -> Field {
        let mut places = Vec::new();
        let (mut all, mut down, mut lost) = (0.0, 0.0, Lost::default());
        for device in &self.devices {
            let above = height + mount.offset.z + mount.rotation.apply(device.offset).z;
            all += device.attitudes.len() as f64;
            for attitude in &device.attitudes {
                let attitude = mount.rotation.after(*attitude);
                let beam = attitude.forward();
                if beam.z >= -1e-9 {
                    continue;
                }
                down += 1.0;
                let range = above / -beam.z;
                match device.reach.of_ground(range, &attitude) {
                    Seen::Measured => places.push([beam.x * range, beam.y * range]),
                    Seen::TooNear => lost.too_near += 1.0,
                    Seen::TooFar => lost.too_far += 1.0,
                    Seen::TooWeak => lost.too_weak += 1.0,
                }
            }
        }
        Field::of(&places, all, down, lost)
    }

    /// The same beams of devices that measure ground up to a range, m, however weak its echo.
    pub fn up_to(&self, range: f64) -> Beams {
        let far = |device: &DeviceBeams| DeviceBeams { reach: Reach::up_to(range), ..device.clone() };
        Beams { devices: self.devices.iter().map(far).collect(), ..*self }
    }

    /// Fewer samples of the same beams, about `count`.
    fn thinned(&self, count: usize) -> Beams {
        let all: usize = self.devices.iter().map(|device| device.attitudes.len()).sum();
        // Odd, as in sampling.
        let stride = all / count / 2 * 2 + 1;
        // Devices that turn together are sampled at different angles.
        let thin = |(i, device): (usize, &DeviceBeams)| DeviceBeams {
            attitudes: device.attitudes.iter().skip(i % stride).step_by(stride).copied().collect(),
            ..*device
        };
        Beams { devices: self.devices.iter().enumerate().map(thin).collect(), ..*self }
    }

    /// How far the beams leave a plane along the direction of travel, as the root mean square of the sine of
    /// their angle to it: 0 if a drive sweeps only that plane. Also the mean upward component of the beams.
    fn across_road(&self, rotation: &Rotation) -> (f64, f64) {
        let (mut xx, mut xz, mut zz, mut up, mut count) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for attitude in self.devices.iter().flat_map(|device| &device.attitudes) {
            let beam = rotation.apply(attitude.forward());
            xx += beam.x * beam.x;
            xz += beam.x * beam.z;
            zz += beam.z * beam.z;
            up += beam.z;
            count += 1.0;
        }
        // The smaller eigenvalue of the second moments across the direction of travel, which is y.
        let least = 0.5 * (xx + zz) - libm::hypot(0.5 * (xx - zz), xz);
        ((least.max(0.0) / count).sqrt(), up / count)
    }

    /// The median angle between successive pulses of a device, rad; 0 if there are fewer than two.
    pub fn step_angle(&self) -> f64 {
        let Some(device) = self.devices.first() else { return 0.0 };
        let pairs = device.attitudes.windows(2).map(|pair| [pair[0].forward(), pair[1].forward()]);
        let mut angles: Vec<f64> = pairs.map(|[a, b]| libm::asin(a.cross(b).length().min(1.0))).collect();
        angles.sort_by(f64::total_cmp);
        angles.get(angles.len() / 2).copied().unwrap_or(0.0) / f64::from(self.stride)
    }
}

/// Attitudes of the beam for every `stride`-th pulse of a device after the `first` ones, as far as it fires.
fn attitudes(
    device: &Device,
    settings: &ScannerSettings,
    first: u32,
    count: u32,
    stride: u32,
) -> Result<Vec<Rotation>, PlanError> {
    let plan = DevicePlan::new(device, Corrections::MOTION);
    let mut state = DeviceState::at_rest(&plan);
    state.start_leg(&plan, settings);
    let mut found = Vec::with_capacity(count as usize);
    let skip = |state: &mut DeviceState, steps: u32| match plan.errors.any() {
        false => {
            state.advance(&plan, true, steps);
        }
        true => (0..steps).for_each(|_| {
            state.step_head(&plan);
            state.step_deflector(&plan);
        }),
    };
    skip(&mut state, first);
    for _ in 0..count {
        skip(&mut state, stride - 1);
        state.step_head(&plan);
        state.step_deflector(&plan);
        if state.deflector.is_firing() {
            found.push(state.emitter(&plan).after(state.deflector.rotation(&plan)));
        }
    }
    match found.iter().all(|attitude| attitude.forward().is_finite()) {
        true => Ok(found),
        false => Err(PlanError::Optics(Box::new(state.formula_error(&plan)))),
    }
}

/// Numbers of pulses that point at ground which the instrument does not measure.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Lost {
    pub too_near: f64,
    pub too_far: f64,
    pub too_weak: f64,
}

/// Points in which an instrument's beams meet flat ground below it, m from the platform.
#[derive(Clone, Debug)]
pub(super) struct Field {
    /// The outermost beams to the left and to the right within the instrument's ranges, m.
    pub across: [f64; 2],
    /// How far behind (negative) and ahead beams reach the ground, m; all but a hundredth of them.
    pub along: [f64; 2],
    /// Share of the fired pulses whose ground the instrument measures.
    pub measured: f64,
    /// Shares of those that point down whose ground the instrument does not measure.
    pub lost: Lost,
    /// Share of the fired pulses per metre across, in equal intervals of `across`.
    profile: Vec<f64>,
}

impl Field {
    fn of(places: &[[f64; 2]], all: f64, down: f64, lost: Lost) -> Field {
        let of_down = |number: f64| if down > 0.0 { number / down } else { 0.0 };
        let mut field = Field {
            across: [0.0; 2],
            along: [0.0; 2],
            measured: places.len() as f64 / all,
            lost: Lost {
                too_near: of_down(lost.too_near),
                too_far: of_down(lost.too_far),
                too_weak: of_down(lost.too_weak),
            },
            profile: vec![0.0; BINS],
        };
        if places.is_empty() {
            return field;
        }
        let ends = |values: &[f64]| {
            let fold = |ends: [f64; 2], v: &f64| [ends[0].min(*v), ends[1].max(*v)];
            values.iter().fold([f64::INFINITY, f64::NEG_INFINITY], fold)
        };
        let x: Vec<f64> = places.iter().map(|place| place[0]).collect();
        let mut y: Vec<f64> = places.iter().map(|place| place[1]).collect();
        field.across = ends(&x);
        y.sort_by(f64::total_cmp);
        let tail = (TAIL * y.len() as f64) as usize;
        field.along = ends(&y[tail..y.len() - tail]);
        let bin = field.width() / BINS as f64;
        for x in x {
            let index = ((x - field.across[0]) / bin.max(f64::MIN_POSITIVE)) as usize;
            field.profile[index.min(BINS - 1)] += 1.0 / (all * bin.max(f64::MIN_POSITIVE));
        }
        field
    }

    /// Width of the strip, m.
    pub fn width(&self) -> f64 {
        self.across[1] - self.across[0]
    }

    /// The larger distance from the flight line at which there are points, m.
    pub fn reach(&self) -> f64 {
        self.across[1].max(-self.across[0])
    }

    /// Share of the fired pulses per metre across, `x` m to the right of the flight line.
    pub fn profile(&self, x: f64) -> f64 {
        let bin = self.width() / BINS as f64;
        if x < self.across[0] || x >= self.across[1] || bin <= 0.0 {
            return 0.0;
        }
        self.profile[(((x - self.across[0]) / bin) as usize).min(BINS - 1)]
    }

    /// Mean share of the fired pulses per metre across between two distances to the right of the flight line.
    pub fn mean_profile(&self, [from, to]: [f64; 2]) -> f64 {
        const STEPS: u32 = 200;
        let at = |i: u32| from + (to - from) * (f64::from(i) + 0.5) / f64::from(STEPS);
        (0..STEPS).map(|i| self.profile(at(i))).sum::<f64>() / f64::from(STEPS)
    }

    /// Share of the fired pulses that reach the ground no farther than `distance` m to either side.
    pub fn share_within(&self, distance: f64) -> f64 {
        2.0 * distance * self.mean_profile([-distance, distance])
    }

    /// True if the strip lies on both sides of the flight line alike.
    pub fn is_symmetric(&self) -> bool {
        let width = self.width();
        width > 0.0 && (self.across[0] + self.across[1]).abs() < 0.06 * width
    }

    /// How far ahead (positive) of the platform the middle of the strip is, m.
    pub fn ahead(&self) -> f64 {
        0.5 * (self.along[0] + self.along[1])
    }
}

/// A rotation of a mount by quarter turns, as a pipeline file writes it: about x, then y, then z of the
/// platform, degrees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct QuarterTurns(pub [f64; 3]);

impl QuarterTurns {
    /// The rotation from the axes of the scanner to those of the platform.
    pub fn rotation(self) -> Rotation {
        let [x, y, z] = self.0.map(f64::to_radians);
        Rotation::about_z(z).after(Rotation::about_y(y)).after(Rotation::about_x(x))
    }

    /// The turns, in order, with their axes.
    pub fn steps(self) -> impl Iterator<Item = (char, f64)> {
        ['x', 'y', 'z'].into_iter().zip(self.0).filter(|(_, angle)| *angle != 0.0)
    }

    /// The mount in words: `turned by 90° about z`, or `not turned`.
    pub fn text(self) -> String {
        let steps: Vec<String> = self.steps().map(|(axis, angle)| format!("{angle}° about {axis}")).collect();
        match steps.is_empty() {
            true => "not turned".to_owned(),
            false => format!("turned by {}", steps.join(", then ")),
        }
    }

    /// All 24 of them, those of fewer turns first.
    fn all() -> Vec<QuarterTurns> {
        let angles = [0.0, 90.0, 180.0, -90.0];
        let mut all: Vec<QuarterTurns> = angles
            .iter()
            .flat_map(|x| angles.iter().map(move |y| [*x, *y]))
            .flat_map(|[x, y]| angles.iter().map(move |z| QuarterTurns([x, y, *z])))
            .collect();
        all.sort_by_key(|turns| turns.0.iter().filter(|angle| **angle != 0.0).count());
        let image = |turns: &QuarterTurns| {
            let rotation = turns.rotation();
            [DVec3::X, DVec3::Y].map(|axis| rotation.apply(axis).round())
        };
        let mut different: Vec<QuarterTurns> = Vec::new();
        for turns in all {
            if different.iter().all(|other| image(other) != image(&turns)) {
                different.push(turns);
            }
        }
        different
    }
}

/// Suitability of a field for a strip below a flight: the width of the strip times the share of the pulses in
/// its middle half.
fn merit(field: &Field) -> f64 {
    if !field.is_symmetric() { 0.0 } else { field.width() * field.share_within(0.25 * field.width()) }
}

/// Samples by which mounts are compared.
const MERIT_SAMPLES: usize = 10_000;
/// How much of the best merit of any mount one must have.
const MIN_MERIT: f64 = 0.9;
/// Largest tangent of the angle by which the middle of the strip may lie ahead of the platform or behind it:
/// 45°.
const MAX_TILT: f64 = 1.0;

/// The quarter turns that serve strips below a flight best, the simplest among equals, and whether `mount`
/// does as well.
pub(super) fn best_mount(beams: &Beams, mount: &Mount, height: f64) -> Option<(QuarterTurns, bool)> {
    let beams = beams.thinned(MERIT_SAMPLES);
    let merit_of = |rotation: Rotation| {
        let field = beams.over_ground(&Mount { rotation, ..*mount }, height);
        if field.ahead().abs() > MAX_TILT * height { 0.0 } else { merit(&field) }
    };
    let mut best: Option<(QuarterTurns, f64)> = None;
    for turns in QuarterTurns::all() {
        let found = merit_of(turns.rotation());
        if found > 0.0 && best.is_none_or(|(_, most)| found > 1.02 * most) {
            best = Some((turns, found));
        }
    }
    best.map(|(turns, most)| (turns, merit_of(mount.rotation) >= MIN_MERIT * most))
}

/// Root mean square of the sine of the angle of beams to a plane along the road, below which a drive measures
/// no more than that plane: that of a fan 2° wide.
const MIN_ACROSS: f64 = 0.01;

/// The quarter turns with which a drive sweeps the most, where `mount` turns all beams into a plane along the
/// road and others do not. Fans look to a side rather than up or down.
pub(super) fn turned_across(beams: &Beams, mount: &Mount) -> Option<QuarterTurns> {
    let beams = beams.thinned(MERIT_SAMPLES);
    let (across, _) = beams.across_road(&mount.rotation);
    if across >= MIN_ACROSS {
        return None;
    }
    let mut best: Option<(QuarterTurns, f64, f64)> = None;
    for turns in QuarterTurns::all() {
        let (found, up) = beams.across_road(&turns.rotation());
        let merit = found * (1.0 - up.abs());
        if best.is_none_or(|(_, _, most)| merit > 1.02 * most) {
            best = Some((turns, found, merit));
        }
    }
    // A single beam sweeps a plane on any mount.
    best.filter(|(_, found, _)| *found > MIN_ACROSS.max(2.0 * across)).map(|(turns, ..)| turns)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quarter_turns_are_the_rotations_of_a_cube() {
        let all = QuarterTurns::all();
        assert_eq!((all.len(), all[0]), (24, QuarterTurns([0.0; 3])));
    }

    /// A sine is slow at the edges: its density at nadir is 2/π of that of an even mirror.
    #[test]
    fn the_field_of_a_mirror_follows_how_it_swings() {
        let scanners = vlscan_survey::catalogue().unwrap().0.scanners;
        let (_, als50) = scanners.iter().find(|(name, _)| name.ends_with("#leica_als50")).unwrap();
        let nadir = |swing: vlscan_survey::Swing| {
            let mut device = als50.devices[0].clone();
            device.scan_motion.swing = swing;
            let mut settings = vlscan_survey::testkit::scanner_settings(100_000);
            (settings.scan_freq, settings.scan_angle) = (50.0, 20f64.to_radians());
            let beams = Beams::of(&[(device, Reach::up_to(1e4))], &settings, 20_000.0).unwrap();
            let count = beams.devices[0].attitudes.len() as f64;
            let is_near = |beam: &&Rotation| beam.forward().y > libm::cos(2f64.to_radians());
            beams.devices[0].attitudes.iter().filter(is_near).count() as f64 / count
        };
        let even = nadir(vlscan_survey::Swing::TurningPart(0.0));
        assert!((even - 0.1).abs() < 0.002, "{even}");
        let sine = nadir(vlscan_survey::Swing::Sine);
        assert!((sine / even - std::f64::consts::FRAC_2_PI).abs() < 0.02, "{sine} {even}");
        let turning = nadir(vlscan_survey::Swing::TurningPart(0.4));
        assert!((turning / even - 0.8).abs() < 0.02, "{turning} {even}");
    }

    #[test]
    fn a_field_is_that_of_its_beams() {
        // A line of beams across, evenly spaced in angle, 30 degrees to either side.
        let attitudes = (0..40_000).map(|i| {
            let angle = (f64::from(i) / 39_999.0 * 60.0 - 30.0).to_radians();
            Rotation::between(DVec3::Y, DVec3::new(libm::sin(angle), 0.0, -libm::cos(angle)))
        });
        let mut device = vlscan_survey::catalogue().unwrap().0.scanners[0].1.devices[0].clone();
        (device.detector.range_min, device.detector.range_max) = (1.0, 113.0);
        let reach = Reach::of(&device, 1.0, 1.0);
        let device = DeviceBeams { attitudes: attitudes.collect(), offset: DVec3::ZERO, reach };
        let beams = Beams { devices: vec![device], stride: 1, fired: 1.0 };
        let field = beams.over_ground(&Mount::IDENTITY, 100.0);
        let edge = (113.0f64 * 113.0 - 100.0 * 100.0).sqrt();
        assert!((field.width() / (2.0 * edge) - 1.0).abs() < 1e-3, "{} {edge}", field.width());
        // The density of a mirror at constant speed is proportional to cos².
        let nadir = 100.0 / (100.0 * 100.0) / (60f64.to_radians());
        assert!((field.mean_profile([-2.0, 2.0]) / nadir - 1.0).abs() < 0.01);
        let at = |x: f64| field.mean_profile([x - 1.0, x + 1.0]) / nadir;
        assert!((at(40.0) - 1.0 / 1.16).abs() < 0.02, "{}", at(40.0));
        assert!((field.measured + field.lost.too_far - 1.0).abs() < 1e-12 && field.is_symmetric());
    }
}
