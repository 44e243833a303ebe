//! The blocks of a flight from which its coverage is measured: a period of the scan pattern, which stands for
//! the whole periods half way to the blocks before and behind it.

use super::super::chunk::Chunk;
use super::cells::Repeats;
use std::f64::consts::TAU;
use vlscan_base::error::Result;
use vlscan_geom::DVec3;
use vlscan_lidar::flight::{FlightPlan, FlightState, LegClock, Step};
use vlscan_scene::{MotionPlan, MotionState};
use vlscan_survey::{Deflector, Survey};
use vlscan_warehouse::Tasks;

/// Steps of a chunk.
const CHUNK_STEPS: u32 = 1 << 12;
/// Steps of a block: whole periods as long as they are short, and the beginning of long ones.
const MIN_BLOCK_STEPS: f64 = 256.0;
const MAX_BLOCK_STEPS: f64 = 262_144.0;
/// Steps between looks at a requested stop.
const STEPS_PER_LOOK: u64 = 1 << 16;
/// Speed from which a head spins all the time, rad/s.
pub const MIN_SPIN: f64 = 2.0 * TAU;
/// Duration of a block of a pattern that does not repeat, s.
const UNEVEN_S: f64 = 0.05;

/// A chunk of a block.
pub struct BlockChunk {
    pub chunk: Chunk,
    /// Periods that its period stands for.
    pub repeats: Repeats,
    /// Number of pulses of which one is measured.
    pub pulses: u32,
    /// Number of the first measured step, or remainder of the numbers of measured pulses, below `pulses`.
    pub phase: u64,
}

impl Tasks for BlockChunk {
    fn tasks(&self) -> u32 {
        self.chunk.pulses
    }
}

/// Shares of the periods and pulses that are measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stride {
    /// Number of periods of which one is measured.
    pub periods: u64,
    /// Number of pulses of a period of which one is measured.
    pub pulses: u32,
}

/// A flight that is divided into blocks.
pub struct Blocks<'a> {
    pub survey: &'a Survey,
    pub flight: &'a FlightPlan,
    pub state: FlightState,
    /// The moving parts of the scene, if there are any.
    pub motion: Option<(&'a MotionPlan, MotionState)>,
}

impl Blocks<'_> {
    /// Flies to the end and passes the chunks of all blocks to `put`, unless `is_stopped`.
    pub fn divide(
        &mut self,
        stride: Stride,
        is_stopped: &dyn Fn() -> bool,
        put: &mut dyn FnMut(BlockChunk) -> Result<()>,
    ) -> Result<()> {
        loop {
            let clock = self.flight.leg(self.state.leg_index());
            let last = match clock.active {
                true => self.divide_leg(period_steps(self.survey, clock), stride, is_stopped, put)?,
                false => self.pass(u64::MAX, is_stopped)?.last,
            };
            if last != Step::LegChanged {
                return Ok(());
            }
        }
    }

    /// Divides the rest of a leg. Returns the outcome of its last step.
    fn divide_leg(
        &mut self,
        period: u32,
        stride: Stride,
        is_stopped: &dyn Fn() -> bool,
        put: &mut dyn FnMut(BlockChunk) -> Result<()>,
    ) -> Result<Step> {
        let mut waiting = Block::default();
        let mut phase = 0;
        let left_out = stride.periods.saturating_sub(1);
        let gap = u64::from(period).saturating_mul(left_out);
        let behind = u64::from(period).saturating_mul(left_out / 2);
        let mut before = self.lead(period, gap - behind, is_stopped)?;
        loop {
            let from = self.state.position();
            let (chunks, measured) = self.measure(period)?;
            if measured.steps < u64::from(period) {
                // A part of a period represents only itself.
                waiting.around[1] += std::mem::take(&mut before.steps);
            }
            waiting.put(stride.pulses, put)?;
            let drift = measured.drift(from);
            waiting = Block { chunks, steps: measured.steps, around: [before.steps, 0], drift, phase };
            phase += 1;
            let after = self.pass_on(measured, behind, is_stopped)?;
            before = self.pass_on(after, gap - behind, is_stopped)?;
            waiting.around[1] = after.steps;
            if before.last != Step::Advanced || is_stopped() {
                waiting.around[1] += before.steps;
                waiting.put(stride.pulses, put)?;
                return Ok(before.last);
            }
        }
    }

    /// Skips the steps at the start of a leg that its first block represents: at the edge of a scene the
    /// first period differs from later ones. Shorter legs begin with their block.
    fn lead(&mut self, period: u32, steps: u64, is_stopped: &dyn Fn() -> bool) -> Result<Passed> {
        let start = (self.state.clone(), self.motion.clone());
        let probe = self.pass(steps.saturating_add(u64::from(period)), is_stopped)?;
        (self.state, self.motion) = start;
        self.pass_on(probe, steps, is_stopped).map(|passed| match passed.last {
            Step::Advanced => passed,
            _ => Passed::NOTHING,
        })
    }

    /// Passes over steps of the leg, unless it has ended in the steps before.
    fn pass_on(&mut self, before: Passed, steps: u64, is_stopped: &dyn Fn() -> bool) -> Result<Passed> {
        match before.last {
            Step::Advanced => self.pass(steps, is_stopped),
            last => Ok(Passed { last, ..Passed::NOTHING }),
        }
    }

    /// Takes the chunks of a period.
    fn measure(&mut self, period: u32) -> Result<(Vec<Chunk>, Passed)> {
        let mut chunks = Vec::new();
        let mut all = Passed::NOTHING;
        while all.steps < u64::from(period) && all.last == Step::Advanced {
            let left = u64::from(period) - all.steps;
            let moving = self.motion.as_ref().map(|(_, state)| state);
            let limit = left.min(u64::from(CHUNK_STEPS)) as u32;
            let (chunk, last) = Chunk::take_steps(self.flight, &mut self.state, moving, limit)?;
            self.follow(&mut all, chunk.steps, last);
            if chunk.pulses > 0 {
                chunks.push(chunk);
            }
        }
        Ok((chunks, all))
    }

    /// Passes over steps of the leg, up to a number.
    fn pass(&mut self, steps: u64, is_stopped: &dyn Fn() -> bool) -> Result<Passed> {
        let mut all = Passed::NOTHING;
        while all.steps < steps && all.last == Step::Advanced && !is_stopped() {
            let limit = (steps - all.steps).min(STEPS_PER_LOOK) as u32;
            let skipped = self.state.skip(self.flight, u32::MAX, limit)?;
            self.follow(&mut all, skipped.steps, skipped.last);
        }
        Ok(all)
    }

    /// Counts steps that were taken, in which the parts of the scene move, too.
    fn follow(&mut self, all: &mut Passed, steps: u32, last: Step) {
        if let Some((motion, state)) = &mut self.motion {
            let motion: &MotionPlan = motion;
            (0..steps).for_each(|_| state.step(motion, |_, _| ()));
        }
        all.steps += u64::from(steps);
        all.last = last;
        if last == Step::Advanced {
            all.reached = Some((self.state.position(), all.steps));
        }
    }
}

/// Steps that were taken.
#[derive(Clone, Copy, Debug)]
struct Passed {
    steps: u64,
    /// Outcome of the last one.
    last: Step,
    /// The last position on the leg, and the steps to there.
    reached: Option<(DVec3, u64)>,
}

impl Passed {
    const NOTHING: Passed = Passed { steps: 0, last: Step::Advanced, reached: None };

    /// Way of the platform from a position in these steps, m; where a leg ends its position is already that
    /// of the next one.
    fn drift(&self, from: DVec3) -> DVec3 {
        match self.reached {
            Some((to, steps)) if steps > 0 => (to - from) * (self.steps as f64 / steps as f64),
            _ => DVec3::ZERO,
        }
    }
}

/// A period that was measured.
#[derive(Default)]
struct Block {
    chunks: Vec<Chunk>,
    steps: u64,
    /// Number of steps before and after it that it represents.
    around: [u64; 2],
    /// Way of the platform, m.
    drift: DVec3,
    /// Its number on the leg, which changes the pulses that are measured.
    phase: u64,
}

impl Block {
    /// Passes the chunks to `put`, one in `pulses` pulses of which is measured, and leaves an empty block.
    fn put(&mut self, pulses: u32, put: &mut dyn FnMut(BlockChunk) -> Result<()>) -> Result<()> {
        let Block { chunks, steps, around, drift, phase } = std::mem::take(self);
        let around = around.map(|passed| passed as f64 / (steps as f64).max(1.0));
        let repeats = Repeats { around, drift: [drift.x, drift.y] };
        let phase = phase_of(phase, u64::from(pulses.max(1)));
        chunks.into_iter().try_for_each(|chunk| put(BlockChunk { chunk, repeats, pulses, phase }))
    }
}

/// The phase, below `every`, of the period with a number: far from those of the periods beside it, and each
/// phase once in `every` periods.
fn phase_of(number: u64, every: u64) -> u64 {
    // Without a common divisor, no phase is left out. At the latest `every` - 1 or `every` - 2 has none.
    let mut factors = (((every * 5 / 8) | 1)..=every).step_by(2);
    let factor = factors.find(|factor| common_divisor(*factor, every) == 1).unwrap_or(1);
    number % every * factor % every
}

/// Greatest common divisor.
fn common_divisor(a: u64, b: u64) -> u64 {
    if b == 0 { a } else { common_divisor(b, a % b) }
}

/// Steps after which the scan pattern of a leg repeats, or several times as many if these are few.
fn period_steps(survey: &Survey, clock: LegClock) -> u32 {
    let steps = period_s(survey, clock.number) * clock.frequency;
    let steps = if steps > 0.0 { steps } else { 1.0 };
    let several = (MIN_BLOCK_STEPS / steps).ceil().max(1.0);
    (several * steps).round().clamp(1.0, MAX_BLOCK_STEPS) as u32
}

/// Time after which the scan pattern of a leg repeats, s; 0 for a beam that the scanner does not deflect.
pub fn period_s(survey: &Survey, leg: u32) -> f64 {
    let leg = survey.legs.get(leg as usize).filter(|found| found.number == leg);
    let (Some(leg), Some(device)) = (leg, survey.scanner.devices.first()) else { return 0.0 };
    let settings = &leg.scanner;
    let head_rate = settings.head_rate.abs().min(device.head.max_rate);
    if head_rate >= MIN_SPIN {
        return TAU / head_rate;
    }
    let lines = |count: f64| if settings.scan_freq > 0.0 { count / settings.scan_freq } else { 0.0 };
    match &device.deflector {
        Deflector::Polygon { facet_tilts, .. } => lines(facet_tilts.len().max(1) as f64),
        Deflector::Oscillating { .. } | Deflector::Conic | Deflector::EllipticConic { .. } => lines(1.0),
        Deflector::Fibres { count } => f64::from((*count).max(1)) / settings.pulse_rate().max(1.0),
        Deflector::Pattern(table) => f64::from(table.steps()) / settings.pulse_rate().max(1.0),
        Deflector::Risley { .. } | Deflector::Custom(_) => UNEVEN_S,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use vlscan_lidar::flight::FlightOptions;
    use vlscan_survey::{PlatformKind, testkit};

    /// 100 m at 10 m/s with 1000 pulses and 10 scan lines per second, and a leg beside it that does not fire.
    fn survey() -> Survey {
        let mut survey = testkit::survey(vec![testkit::device()]);
        survey.platform.kind = PlatformKind::LinearPath;
        survey.legs = (0..3).map(|i| testkit::leg(i, testkit::scanner_settings(1000))).collect();
        for (leg, x) in survey.legs.iter_mut().zip([0.0, 100.0, 200.0]) {
            leg.platform.position.x = x;
            leg.platform.speed = 10.0;
            leg.scanner.scan_freq = 10.0;
            leg.scanner.active = x == 0.0;
        }
        survey
    }

    /// Steps, repeats and stride of the chunks.
    fn blocks(survey: &Survey, stride: Stride) -> Vec<(u32, Repeats, u32)> {
        let plan = FlightPlan::new(survey, DVec3::ZERO, &|_, _| None, &FlightOptions::default());
        let (flight, _) = plan.unwrap();
        let state = FlightState::start(&flight);
        let mut flown = Blocks { survey, flight: &flight, state, motion: None };
        let mut found = Vec::new();
        let mut put = |block: BlockChunk| -> Result<()> {
            found.push((block.chunk.steps, block.repeats, block.pulses));
            Ok(())
        };
        flown.divide(stride, &|| false, &mut put).unwrap();
        found
    }

    #[test]
    fn blocks_stand_for_all_steps_of_the_legs_that_fire() {
        let survey = survey();
        // Of 1000 periods the leg has only 33: it begins with its block.
        for (periods, lead) in [(1, 0.0), (2, 1.0), (7, 3.0), (1000, 0.0)] {
            let found = blocks(&survey, Stride { periods, pulses: 1 });
            let steps: f64 =
                found.iter().map(|(steps, repeats, _)| f64::from(*steps) * repeats.periods()).sum();
            assert!((steps - 10_000.0).abs() < 20.0, "{periods}: {steps}");
            // 256 steps are less than three periods of 100.
            assert_eq!(found[0].0, 300);
            let (_, first, _) = found[0];
            assert!((first.drift[0] - 3.0).abs() < 0.05 && first.drift[1].abs() < 1e-9, "{first:?}");
            assert_eq!(first.around[0], lead);
        }
        // One period in seven: three before it and three behind it.
        let found = blocks(&survey, Stride { periods: 7, pulses: 1 });
        assert!(found[..4].iter().all(|(_, repeats, _)| repeats.around == [3.0, 3.0]), "{found:?}");
        // One in four: whole periods, one behind it and two before it.
        let found = blocks(&survey, Stride { periods: 4, pulses: 1 });
        assert!(found[..4].iter().all(|(_, repeats, _)| repeats.around == [2.0, 1.0]), "{found:?}");
        // All of them.
        let found = blocks(&survey, Stride { periods: 1, pulses: 4 });
        assert!(
            found.iter().all(|(_, repeats, pulses)| repeats.periods() == 1.0 && *pulses == 4),
            "{found:?}"
        );
    }

    #[test]
    fn successive_periods_see_all_phases() {
        for every in 1..=32 {
            let phases: Vec<u64> = (0..every).map(|number| phase_of(number, every)).collect();
            let mut sorted = phases.clone();
            sorted.sort_unstable();
            assert!(sorted.into_iter().eq(0..every), "{every}: {phases:?}");
        }
        assert_eq!([0, 1, 2, 16].map(|number| phase_of(number, 16)), [0, 11, 6, 0]);
    }

    #[test]
    fn periods_are_those_of_head_and_mirror() {
        let mut survey = survey();
        let steps = |survey: &Survey| {
            period_steps(survey, LegClock { number: 0, active: true, frequency: 1e5, sample_interval: 0.0 })
        };
        assert_eq!(steps(&survey), 10_000);
        survey.scanner.devices[0].deflector = Deflector::Fibres { count: 8 };
        // 8 ms of 1000 pulses per second.
        assert_eq!(steps(&survey), 800);
        survey.scanner.devices[0].head.max_rate = 100.0;
        survey.legs[0].scanner.head_rate = -40.0 * TAU / 4.0;
        assert_eq!(steps(&survey), 10_000);
        survey.legs[0].scanner.scan_freq = 0.0;
        survey.legs[0].scanner.head_rate = 0.0;
        survey.scanner.devices[0].deflector = Deflector::Conic;
        assert_eq!(steps(&survey), 256);
    }
}
