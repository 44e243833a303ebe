//! Beam deflectors (spec kinematics §4).

use super::DevicePlan;
use crate::geom::{DVec3, Rotation, degrees};
use crate::survey::{Deflector, ScannerSettings};
use std::f64::consts::TAU;

/// Where a deflector stands and how it moves per step of the current leg. Angles are rad.
#[derive(Clone, Debug)]
pub enum DeflectorState {
    /// Polygon mirror.
    Polygon(Polygon),
    /// Oscillating mirror.
    Oscillating(Oscillating),
    /// Palmer scanner.
    Conic {
        /// Turn of the cone.
        turn: f64,
        /// Turn per step.
        step: f64,
        /// Half opening angle.
        half_angle: f64,
    },
    /// Fibre array.
    Fibres {
        /// Current deflection.
        angle: f64,
        /// The fibre of the next step.
        next: u32,
        /// Number of fibres.
        count: u32,
        /// Half opening angle.
        half_angle: f64,
    },
    /// Risley prisms.
    Risley {
        /// Seconds since the prisms' common zero.
        time: f64,
        /// Seconds per step.
        step: f64,
        /// The last direction that left the prisms, where it has to be remembered.
        last: Option<DVec3>,
    },
}

/// State of a polygon mirror (spec kinematics §4.2).
#[derive(Clone, Debug, Default)]
pub struct Polygon {
    angle: f64,
    exact: f64,
    step: f64,
    /// Angles within `lower < angle ≤ upper` fire.
    lower: f64,
    upper: f64,
}

/// State of an oscillating mirror (spec kinematics §4.3).
#[derive(Clone, Debug, Default)]
pub struct Oscillating {
    angle: f64,
    /// Periods per pulse of the corrected motion; the other fields but `count` and `half_angle` are the reference's.
    rate: Option<f64>,
    /// Pulses since the period began, and pulses per period.
    count: i64,
    period: i64,
    half_angle: f64,
    /// Change per step between the turning points.
    step: f64,
}

/// Pulses that an oscillating mirror takes to gain its speed, as in the reference.
const TURNING_PULSES: f64 = 50.0;

/// The angle at pulse `count` of a mirror that goes to and fro `rate` times per pulse, from −1 to 1: even speed between two
/// parabolas of constant acceleration. Sweeps of less than 100 pulses are two parabolas.
fn swept(count: i64, rate: f64) -> f64 {
    let phase = (count as f64 * rate).fract();
    let (x, sign) = if phase < 0.5 { (2.0 * phase, 1.0) } else { (2.0 * phase - 1.0, -1.0) };
    // Share of a sweep, of which a period has two, for either turn.
    let r = (TURNING_PULSES * 2.0 * rate).min(0.5);
    let speed = 1.0 / (1.0 - r);
    let way = if x < r {
        speed * x * x / (2.0 * r)
    } else if x <= 1.0 - r {
        speed * (x - 0.5 * r)
    } else {
        1.0 - speed * (1.0 - x) * (1.0 - x) / (2.0 * r)
    };
    sign * (2.0 * way - 1.0)
}

impl DeflectorState {
    pub(super) fn at_rest(deflector: &Deflector) -> DeflectorState {
        match deflector {
            Deflector::Polygon { .. } => DeflectorState::Polygon(Polygon::default()),
            Deflector::Oscillating { .. } => DeflectorState::Oscillating(Oscillating::default()),
            Deflector::Conic => DeflectorState::Conic { turn: 0.0, step: 0.0, half_angle: 0.0 },
            Deflector::Fibres { .. } => {
                DeflectorState::Fibres { angle: 0.0, next: 0, count: 1, half_angle: 0.0 }
            }
            Deflector::Risley { .. } => DeflectorState::Risley { time: 0.0, step: 0.0, last: None },
        }
    }

    /// Takes a leg's settings. Only what the spec names is reset.
    pub(super) fn start_leg(&mut self, plan: &DevicePlan, settings: &ScannerSettings, frequency: f64) {
        let scan_angle = plan.scan_angle(settings.scan_angle);
        match (self, &plan.deflector) {
            (DeflectorState::Polygon(mirror), Deflector::Polygon { effective_max }) => {
                let (lower, upper) = window(*effective_max, scan_angle, settings);
                let most = plan.scan_angle_max;
                let step = (settings.scan_freq * (most - (-most))) / frequency;
                *mirror = Polygon { angle: 0.0, exact: 0.0, step, lower, upper };
            }
            (DeflectorState::Oscillating(mirror), Deflector::Oscillating { scan_product }) => {
                let even = plan.kinematics.oscillation_at_leg_frequency;
                mirror.start_leg(scan_angle, settings.scan_freq, *scan_product, frequency, even);
            }
            (DeflectorState::Conic { step, half_angle, .. }, _) => {
                let asked = plan.kinematics.conic_at_leg_frequency;
                let turns = if asked { settings.scan_freq } else { plan.scan_freq_max };
                *step = TAU * turns / frequency;
                *half_angle = scan_angle;
            }
            (DeflectorState::Fibres { count, half_angle, next, .. }, Deflector::Fibres { count: fibres }) => {
                *count = (*fibres).max(1);
                *next %= *count;
                *half_angle = scan_angle;
            }
            (DeflectorState::Risley { step, .. }, _) => *step = 1.0 / frequency,
            _ => {}
        }
    }

    /// An active leg after an inactive one begins (spec kinematics §4.1): the angle is 0 again.
    pub fn restart(&mut self) {
        match self {
            DeflectorState::Polygon(mirror) => (mirror.angle, mirror.exact) = (0.0, 0.0),
            DeflectorState::Oscillating(mirror) => (mirror.angle, mirror.count) = (0.0, 0),
            DeflectorState::Conic { turn, .. } => *turn = 0.0,
            DeflectorState::Fibres { angle, .. } => *angle = 0.0,
            DeflectorState::Risley { .. } => {}
        }
    }

    /// Moves on by one step.
    #[inline]
    pub fn step(&mut self, plan: &DevicePlan) {
        match self {
            DeflectorState::Polygon(mirror) => mirror.step(plan),
            DeflectorState::Oscillating(mirror) => mirror.step(),
            DeflectorState::Conic { turn, step, .. } => {
                *turn += *step;
                if *turn >= TAU {
                    *turn %= TAU;
                }
            }
            DeflectorState::Fibres { angle, next, count, half_angle } => {
                let from_edge = if plan.kinematics.centred_fibres { 0.5 } else { 0.0 };
                *angle =
                    -*half_angle + (f64::from(*next) + from_edge) * (2.0 * *half_angle / f64::from(*count));
                *next = if *next + 1 < *count { *next + 1 } else { 0 };
            }
            DeflectorState::Risley { time, step, last } => {
                *time += *step;
                // Where no beam can be lost, only pulses need its direction.
                if let Some(prisms) = plan.prisms.as_ref().filter(|p| p.may_fail) {
                    *last = prisms.refracted(*time).or(*last);
                }
            }
        }
    }

    /// Whether the deflector lets a pulse out at its present angle.
    #[inline]
    pub fn emits(&self) -> bool {
        match self {
            DeflectorState::Polygon(mirror) => mirror.lower < mirror.angle && mirror.angle <= mirror.upper,
            _ => true,
        }
    }

    /// The angle without errors: what error formulas see, and the scan angle of a pulse. 0 for Risley prisms.
    #[inline]
    pub fn exact_angle(&self) -> f64 {
        match self {
            DeflectorState::Polygon(mirror) => mirror.exact,
            DeflectorState::Oscillating(mirror) => mirror.angle,
            DeflectorState::Conic { turn, .. } => *turn,
            DeflectorState::Fibres { angle, .. } => *angle,
            DeflectorState::Risley { .. } => 0.0,
        }
    }

    /// The scan angle of a pulse in rad: the deflection in the scan plane, for two-dimensional patterns the component about
    /// x of the deflection, whose exact rotation is `deflection`.
    pub fn scan_angle(&self, deflection: &Rotation) -> f64 {
        match self {
            DeflectorState::Conic { .. } | DeflectorState::Risley { .. } => {
                let beam = deflection.forward();
                libm::atan2(beam.z, beam.y)
            }
            _ => self.exact_angle(),
        }
    }

    /// Whether the deflection has an error now.
    pub fn has_error(&self) -> bool {
        matches!(self, DeflectorState::Polygon(mirror) if mirror.angle != mirror.exact)
    }

    /// The deflection with its error.
    pub fn rotation(&self, plan: &DevicePlan) -> Rotation {
        match self {
            DeflectorState::Polygon(mirror) => Rotation::about_x(mirror.angle),
            _ => self.exact_rotation(plan),
        }
    }

    /// The deflection without error.
    pub fn exact_rotation(&self, plan: &DevicePlan) -> Rotation {
        match self {
            DeflectorState::Conic { turn, half_angle, .. } => {
                Rotation::about_y(*turn).after(Rotation::about_x(*half_angle))
            }
            DeflectorState::Risley { time, last, .. } => {
                let beam = match &plan.prisms {
                    Some(prisms) if !prisms.may_fail => prisms.refracted(*time),
                    _ => *last,
                };
                beam.map_or(Rotation::IDENTITY, |b| Rotation::between(DVec3::Y, b))
            }
            _ => Rotation::about_x(self.exact_angle()),
        }
    }
}

/// The angles (lower, excluded, and upper) between which a polygon mirror fires.
pub(crate) fn window(effective_max: f64, scan_angle: f64, settings: &ScannerSettings) -> (f64, f64) {
    let usable = effective_max.min(scan_angle);
    (settings.vertical_min.unwrap_or(-usable), settings.vertical_max.unwrap_or(usable))
}

impl Polygon {
    #[inline]
    fn step(&mut self, plan: &DevicePlan) {
        let most = plan.scan_angle_max;
        self.exact += self.step;
        if plan.kinematics.polygon_keeps_excess {
            if self.exact >= most && most > 0.0 {
                self.exact -= 2.0 * most * ((self.exact + most) / (2.0 * most)).floor();
            }
            self.angle = self.exact + plan.errors.deflection.as_ref().map_or(0.0, |e| e.eval(self.exact));
            return;
        }
        let Some(error) = &plan.errors.deflection else {
            // The excess over a whole line is discarded.
            if self.exact >= most {
                self.exact = -most;
            }
            self.angle = self.exact;
            return;
        };
        self.angle = self.exact + error.eval(self.exact);
        if self.exact >= most {
            self.exact = -most;
        }
        if self.angle >= most {
            self.angle = -most;
        }
    }
}

impl Oscillating {
    fn start_leg(&mut self, half_angle: f64, scan_freq: f64, product: f64, frequency: f64, even: bool) {
        let scan_freq =
            if degrees(half_angle) * scan_freq > product { product / degrees(half_angle) } else { scan_freq };
        self.half_angle = half_angle;
        if even {
            (self.rate, self.count) = (Some(scan_freq / frequency), 0);
        }
        // A scan frequency of 0 makes a period without end.
        self.period = (frequency / scan_freq) as i64;
        self.step = 2.0 * half_angle / ((self.period / 2) as f64 - 50.5);
    }

    /// A quarter period is 50 pulses of turning, the rest moves evenly. With periods of less than 200 pulses the stretches
    /// overlap, and the first rule that fits is taken.
    #[inline]
    fn step(&mut self) {
        if let Some(rate) = self.rate {
            self.angle = self.half_angle * swept(self.count, rate);
            self.count += 1;
            return;
        }
        if self.count >= self.period {
            self.count = 0;
        }
        let (j, n, d) = (self.count, self.period, self.step);
        let half = n / 2;
        if j == 0 {
            self.angle = -self.half_angle;
        } else if j == half {
            self.angle = self.half_angle;
        } else if (1..50).contains(&j) {
            self.angle += d * (j - 1) as f64 / 49.0;
        } else if (50..half - 50).contains(&j) {
            self.angle += d;
        } else if (half - 50..half).contains(&j) {
            self.angle += d * (half - j) as f64 / 50.0;
        } else if (half + 1..half + 51).contains(&j) {
            self.angle -= d * (j - half - 1) as f64 / 50.0;
        } else if (half + 51..n - 49).contains(&j) {
            self.angle -= d;
        } else if j >= n - 49 {
            self.angle -= d * (n - j) as f64 / 49.0;
        }
        self.count += 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::radians;
    use crate::scanner::testing::{device, settings};
    use crate::survey::Formula;
    use crate::survey::{Device, Kinematics, Prism};

    fn started(device: &Device, settings: &ScannerSettings) -> (DevicePlan, DeflectorState) {
        started_as(device, settings, Kinematics::HELIOS)
    }

    fn started_as(
        device: &Device,
        settings: &ScannerSettings,
        kinematics: Kinematics,
    ) -> (DevicePlan, DeflectorState) {
        let plan = DevicePlan::new(device, kinematics);
        let mut state = DeflectorState::at_rest(&device.deflector);
        state.start_leg(&plan, settings, f64::from(settings.pulse_freq));
        (plan, state)
    }

    fn angles(device: &Device, settings: &ScannerSettings, steps: usize) -> Vec<f64> {
        angles_as(device, settings, steps, Kinematics::HELIOS)
    }

    fn angles_as(
        device: &Device,
        settings: &ScannerSettings,
        steps: usize,
        kinematics: Kinematics,
    ) -> Vec<f64> {
        let (plan, mut state) = started_as(device, settings, kinematics);
        (0..steps)
            .map(|_| {
                state.step(&plan);
                degrees(state.exact_angle())
            })
            .collect()
    }

    fn assert_close(found: &[f64], wanted: &[f64], tolerance: f64) {
        assert_eq!(found.len(), wanted.len());
        for (i, (f, w)) in found.iter().zip(wanted).enumerate() {
            assert!((f - w).abs() < tolerance, "{i}: {f} is not {w}");
        }
    }

    #[test]
    fn polygon_lines() {
        // spec kinematics §4.2, examples A and B
        let mut d = device(Deflector::Polygon { effective_max: radians(50.0) });
        let mut s = settings(100);
        (s.scan_freq, s.scan_angle) = (10.0, radians(120.0));
        let lines = [24.0, 48.0, 72.0, 96.0, -120.0, -96.0, -72.0, -48.0, -24.0, 0.0, 24.0];
        let found = angles(&d, &s, 15);
        assert_close(&found[..4], &lines[..4], 1e-9);
        assert!((found[4] - 120.0).abs() < 1e-9, "the fifth addition falls short of 120°: {}", found[4]);
        assert_close(&found[5..12], &lines[4..], 1e-9);
        d.scan_angle_max = radians(30.0);
        let mut s = settings(160);
        s.scan_freq = 20.0;
        let b = [7.5, 15.0, 22.5, -30.0, -22.5, -15.0, -7.5, 0.0, 7.5, 15.0, 22.5, 30.0, -30.0, -22.5];
        assert_close(&angles(&d, &s, 14), &b, 1e-9);
    }

    #[test]
    fn a_corrected_polygon_turns_as_often_as_asked() {
        // 133 lines a second at 1000 Hz: 7.5188 pulses a line, so that the excess counts; the sum of steps is the angle.
        let mut d = device(Deflector::Polygon { effective_max: radians(50.0) });
        d.scan_angle_max = radians(30.0);
        let mut s = settings(1000);
        s.scan_freq = 133.0;
        let found = angles_as(&d, &s, 10_000, Kinematics::CORRECTED);
        for (k, angle) in found.iter().enumerate() {
            let turned = (k + 1) as f64 * 60.0 * 0.133 + 30.0;
            let off = (turned - 60.0 * (turned / 60.0).floor() - 30.0 - angle).abs();
            assert!(off.min(60.0 - off) < 1e-6, "{k}: {angle}");
        }
        let lines = found.windows(2).filter(|w| w[1] < w[0]).count();
        assert_eq!(lines, 1330);
        let helios = angles(&d, &s, 10_000).windows(2).filter(|w| w[1] < w[0]).count();
        assert_eq!(helios, 1250, "the reference needs 8 pulses a line");
    }

    #[test]
    fn a_corrected_mirror_oscillates_as_often_as_asked_and_within_its_limits() {
        let d = device(Deflector::Oscillating { scan_product: 1e6 });
        for (freq, turning) in [(70.0, 0.07), (7.3, 0.0073), (430.0, 0.43), (2000.0, 0.5)] {
            let mut s = settings(100_000);
            (s.scan_freq, s.scan_angle) = (freq, radians(20.0));
            let found = angles_as(&d, &s, 100_000, Kinematics::CORRECTED);
            assert!((found[0] + 20.0).abs() < 1e-9);
            assert!(found.iter().all(|a| a.abs() <= 20.0 + 1e-9));
            let up = found.windows(2).filter(|w| w[0] < 0.0 && w[1] >= 0.0).count();
            assert!((up as f64 - freq).abs() <= 1.0, "{up} periods in a second, not {freq}");
            // Between the turns the speed is 2s over the share of a half period that is left: 2s · 2f / (1 − r).
            let speed = 4.0 * 20.0 * freq / 1e5 / (1.0 - turning);
            let fastest = found.windows(2).map(|w| (w[1] - w[0]).abs()).fold(0.0, f64::max);
            assert!((fastest / speed - 1.0).abs() < 0.06, "{freq} Hz: {fastest} {speed}");
        }
        let mut s = settings(1000);
        (s.scan_freq, s.scan_angle) = (2.0, radians(200.0));
        let widest = angles_as(&d, &s, 500, Kinematics::CORRECTED).into_iter().fold(0.0, f64::max);
        assert!((widest - 120.0).abs() < 0.1, "{widest} is beyond the device");
    }

    #[test]
    fn the_polygon_window_is_open_below() {
        let d = device(Deflector::Polygon { effective_max: radians(50.0) });
        let mut s = settings(100);
        s.scan_freq = 10.0;
        let fired = |s: &ScannerSettings| {
            let (plan, mut state) = started(&d, s);
            let mut fired = Vec::new();
            for _ in 0..12 {
                state.step(&plan);
                if state.emits() {
                    fired.push(degrees(state.exact_angle()).round());
                }
            }
            fired
        };
        assert_eq!(fired(&s), [24.0, 48.0, -48.0, -24.0, 0.0, 24.0]);
        (s.vertical_min, s.vertical_max) = (Some(0.0), Some(0.0));
        assert!(fired(&s).is_empty());
        s.vertical_min = Some(radians(-30.0));
        assert_eq!(fired(&s), [-24.0, 0.0]);
    }

    #[test]
    fn deflection_errors_disturb_the_angle_and_not_the_clockwork() {
        // spec kinematics §4.2: M_max 50°, Δ 10°, E = −0.05 cos θ
        let mut d = device(Deflector::Polygon { effective_max: radians(50.0) });
        d.scan_angle_max = radians(50.0);
        d.errors.deflection = Some(Formula::parse("-0.05*cos(THETA)").unwrap());
        let mut s = settings(100);
        s.scan_freq = 10.0;
        let (plan, mut state) = started(&d, &s);
        let mut rows = Vec::new();
        for _ in 0..6 {
            state.step(&plan);
            let DeflectorState::Polygon(m) = &state else { unreachable!() };
            rows.extend([degrees(m.exact), degrees(m.angle)]);
        }
        assert_close(&rows[..2], &[10.0, 7.1787], 1e-4);
        assert_close(&rows[6..], &[40.0, 37.8054, -50.0, 48.1585, -40.0, -42.1946], 1e-4);
    }

    #[test]
    fn oscillating_period() {
        // spec kinematics §4.3
        let d = device(Deflector::Oscillating { scan_product: 1e6 });
        let mut s = settings(1000);
        (s.scan_freq, s.scan_angle) = (2.0, radians(20.0));
        let found = angles(&d, &s, 501);
        for (j, wanted) in [
            (0, -20.0),
            (1, -20.0),
            (2, -19.995908),
            (3, -19.987724),
            (49, -15.18797),
            (50, -14.987469),
            (100, -4.962406),
            (125, 0.050125),
            (200, 15.087719),
            (249, 20.0),
            (250, 20.0),
            (251, 20.0),
            (252, 19.99599),
            (499, -20.0),
            (500, -20.0),
        ] {
            assert!((found[j] - wanted).abs() < 1e-6, "{j}: {}", found[j]);
        }
    }

    #[test]
    fn the_scan_product_limits_the_frequency() {
        let d = device(Deflector::Oscillating { scan_product: 1000.0 });
        let mut s = settings(100_000);
        (s.scan_freq, s.scan_angle) = (100.0, radians(20.0));
        let (_, DeflectorState::Oscillating(m)) = started(&d, &s) else { unreachable!() };
        assert_eq!(m.period, 2000);
    }

    #[test]
    fn a_shorter_period_does_not_lose_the_mirror() {
        let d = device(Deflector::Oscillating { scan_product: 1e6 });
        let mut s = settings(1000);
        (s.scan_freq, s.scan_angle) = (1.0, radians(20.0));
        let (plan, mut state) = started(&d, &s);
        (0..900).for_each(|_| state.step(&plan));
        s.scan_freq = 2.0;
        state.start_leg(&plan, &s, 1000.0);
        for _ in 0..2000 {
            state.step(&plan);
            assert!(state.exact_angle().abs() < radians(20.3));
        }
    }

    #[test]
    fn conic_circle() {
        // spec kinematics §4.4
        let mut d = device(Deflector::Conic);
        d.scan_freq = (0.0, 5.0);
        let mut s = settings(100);
        s.scan_angle = radians(20.0);
        let (plan, mut state) = started(&d, &s);
        let mut beams = Vec::new();
        for _ in 0..5 {
            state.step(&plan);
            beams.push(state.rotation(&plan).forward());
        }
        for (i, wanted) in [
            (0, [0.105690, 0.939693, 0.325280]),
            (1, [0.201034, 0.939693, 0.276700]),
            (4, [0.342020, 0.939693, 0.0]),
        ] {
            assert!((beams[i] - DVec3::from(wanted)).length() < 1e-6, "{}", beams[i]);
        }
    }

    #[test]
    fn fibre_order() {
        // spec kinematics §4.5
        let d = device(Deflector::Fibres { count: 8 });
        let mut s = settings(100);
        s.scan_angle = radians(20.0);
        assert_close(&angles(&d, &s, 9), &[-20.0, -15.0, -10.0, -5.0, 0.0, 5.0, 10.0, 15.0, -20.0], 1e-9);
    }

    #[test]
    fn corrected_fibres_are_symmetric_and_all_there() {
        let d = device(Deflector::Fibres { count: 8 });
        let mut s = settings(100);
        s.scan_angle = radians(20.0);
        let found = angles_as(&d, &s, 9, Kinematics::CORRECTED);
        assert_close(&found, &[-17.5, -12.5, -7.5, -2.5, 2.5, 7.5, 12.5, 17.5, -17.5], 1e-9);
        let one = device(Deflector::Fibres { count: 1 });
        assert_close(&angles_as(&one, &s, 2, Kinematics::CORRECTED), &[0.0, 0.0], 1e-12);
    }

    #[test]
    fn a_totally_reflected_beam_keeps_its_last_direction() {
        let prism = |rotor_freq, angle: f64| Prism { rotor_freq, angle: radians(angle), index: 1.5 };
        let deflector = Deflector::Risley {
            prisms: vec![prism(1.0, -30.0), prism(-3.0, -30.0)],
            air: 1.0,
            incident: DVec3::Y,
        };
        let d = device(deflector);
        let (plan, mut state) = started(&d, &settings(100));
        let train = plan.prisms.clone().unwrap();
        assert!(train.may_fail);
        let (mut last, mut failures) = (None, 0);
        for _ in 0..100 {
            state.step(&plan);
            let DeflectorState::Risley { time, .. } = state else { unreachable!() };
            match train.refracted(time) {
                Some(beam) => last = Some(beam),
                None => failures += 1,
            }
            let found = state.rotation(&plan).forward();
            assert!((found - last.unwrap_or(DVec3::Y)).length() < 1e-12);
        }
        assert!(failures > 0 && failures < 100, "{failures}");
    }
}
