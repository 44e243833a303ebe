//! Where the nanoseconds of a pulse go: the stages of the river one after the other on one thread, and the whole of it.
//!
//! ```text
//! cargo bench --bench stages                       a forest of a million triangles, made for it
//! cargo bench --bench stages -- survey.xml 5       any survey without moving parts, best of 5 passes
//! ```
//!
//! Times are those of the computing thread, so that what else the machine does hardly shows; every figure is the best of
//! some passes over the same 131 072 pulses, from where the beam first meets the scene mostly.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use vlscan::flight::{FlightOptions, FlightPlan, FlightSink, FlightState, PoseSample, Pulse, Step};
use vlscan::generate;
use vlscan::output::{NoOffload, OutputContext, OutputPlan, OutputRequest, PointFormat, Target};
use vlscan::pulse::{Batch, Phase, Physics, PhysicsOptions, PulseSimulator};
use vlscan::scene::{self, LoadOptions, Scene};
use vlscan::survey::{ReadOptions, Survey, read_survey};
use vlscan::tree::{BuildOptions, Tree};
use vlscan::{Error, Result};

/// Pulses of a pass.
const PULSES: usize = 1 << 17;
/// Pulses per chunk, as in runs.
const CHUNK: usize = 1024;

/// Seconds that this thread has computed.
#[cfg(target_os = "linux")]
fn computed() -> f64 {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
    time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
}

/// Seconds since the first call.
#[cfg(not(target_os = "linux"))]
fn computed() -> f64 {
    static START: std::sync::OnceLock<std::time::Instant> = std::sync::OnceLock::new();
    START.get_or_init(std::time::Instant::now).elapsed().as_secs_f64()
}

/// Counts what the producer of chunks sees, and keeps the pulses that workers compute.
#[derive(Default)]
struct Replay {
    keep: bool,
    seen: usize,
    pulses: Vec<Pulse>,
}

impl FlightSink for Replay {
    fn pulse(&mut self, pulse: impl FnOnce() -> Pulse) {
        self.seen += 1;
        if self.keep {
            self.pulses.push(pulse());
        }
    }

    fn pose(&mut self, _: impl FnOnce() -> PoseSample) {}
}

impl Replay {
    /// Steps until so many pulses have left, or the flight ends.
    fn step(&mut self, state: &mut FlightState, plan: &FlightPlan, pulses: usize) -> Result<()> {
        self.seen = 0;
        self.pulses.clear();
        while self.seen < pulses && matches!(state.step(plan, self)?, Step::Advanced | Step::LegChanged) {}
        Ok(())
    }
}

/// Seconds of each stage in one pass.
#[derive(Clone, Copy, Debug)]
struct Pass {
    count: f64,
    replay: f64,
    aim: f64,
    trace: f64,
    receive: f64,
    las: f64,
    laz: f64,
    text: f64,
}

const UNMEASURED: Pass = Pass {
    count: f64::INFINITY,
    replay: f64::INFINITY,
    aim: f64::INFINITY,
    trace: f64::INFINITY,
    receive: f64::INFINITY,
    las: f64::INFINITY,
    laz: f64::INFINITY,
    text: f64::INFINITY,
};

impl Pass {
    fn best(self, other: Pass) -> Pass {
        Pass {
            count: self.count.min(other.count),
            replay: self.replay.min(other.replay),
            aim: self.aim.min(other.aim),
            trace: self.trace.min(other.trace),
            receive: self.receive.min(other.receive),
            las: self.las.min(other.las),
            laz: self.laz.min(other.laz),
            text: self.text.min(other.text),
        }
    }
}

/// A survey, ready to fly.
struct River<'a> {
    flight: &'a FlightPlan,
    physics: &'a Physics<'a>,
    las: Arc<OutputPlan>,
    laz: Arc<OutputPlan>,
    text: Arc<OutputPlan>,
}

impl River<'_> {
    /// The flight from where at least half of the pulses have echoes, or from its start if there is no such place.
    fn over_the_scene(&self) -> Result<FlightState> {
        let mut state = FlightState::start(self.flight);
        let (mut skipped, mut replay) = (Replay::default(), Replay { keep: true, ..Replay::default() });
        let mut simulator = PulseSimulator::new(&self.physics);
        loop {
            let mut batch = Batch::default();
            replay.step(&mut state.clone(), self.flight, CHUNK)?;
            if replay.seen < CHUNK || state.leg_index() > 0 {
                return Ok(FlightState::start(self.flight));
            }
            simulator.simulate(0, &replay.pulses, &mut batch)?;
            if 2 * batch.echoes.len() >= replay.seen {
                return Ok(state);
            }
            skipped.step(&mut state, self.flight, 32 * CHUNK)?;
        }
    }

    /// Flies the pulses through one stage after the other; returns the echoes, too.
    fn pass(&self) -> Result<(Pass, usize)> {
        let mut pass = Pass {
            count: 0.0,
            replay: 0.0,
            aim: 0.0,
            trace: 0.0,
            receive: 0.0,
            las: 0.0,
            laz: 0.0,
            text: 0.0,
        };
        let (mut counter, mut replay) = (Replay::default(), Replay { keep: true, ..Replay::default() });
        let mut counting = self.over_the_scene()?;
        let mut simulator = PulseSimulator::new(&self.physics);
        let mut batches = Vec::new();
        for _ in 0..PULSES / CHUNK {
            let mut state = counting.clone();
            let mut before = computed();
            let mut lap = || {
                let now = computed();
                now - std::mem::replace(&mut before, now)
            };
            counter.step(&mut counting, self.flight, CHUNK)?;
            pass.count += lap();
            replay.step(&mut state, self.flight, CHUNK)?;
            pass.replay += lap();
            let mut batch = Batch::default();
            simulator.simulate_timed(0, &replay.pulses, &mut batch, |stage| match stage {
                Phase::RayGeneration => pass.aim += lap(),
                Phase::Traversal => pass.trace += lap(),
                Phase::Detection => pass.receive += lap(),
            })?;
            batches.push(batch);
        }
        pass.las = encode(&self.las, &batches)?;
        pass.laz = encode(&self.laz, &batches)?;
        pass.text = encode(&self.text, &batches)?;
        Ok((pass, batches.iter().map(|b| b.echoes.len()).sum()))
    }
}

/// Seconds that it takes to encode the batches and hand the bytes to the system.
fn encode(plan: &Arc<OutputPlan>, batches: &[Batch]) -> Result<f64> {
    let mut writer = plan.open(Arc::new(NoOffload))?;
    let before = computed();
    batches.iter().try_for_each(|batch| writer.append(plan.encode(batch)))?;
    writer.finish()?;
    Ok(computed() - before)
}

fn plan(survey: &Survey, scene: &Scene, format: PointFormat) -> Result<Arc<OutputPlan>> {
    let nowhere = Target::File(PathBuf::from("/dev/null"));
    let request = OutputRequest { sinks: vec![(nowhere, format)], ..OutputRequest::default() };
    Ok(Arc::new(OutputPlan::new(request, &OutputContext { survey, scene })?))
}

fn measure(path: &Path, passes: usize) -> Result<()> {
    let (survey, _) = read_survey(path, &ReadOptions::default())?;
    let wavelength_nm = survey.scanner.devices[0].beam.wavelength;
    let (scene, _) = scene::load(&survey.scene, &LoadOptions { wavelength_nm, ..LoadOptions::default() })?;
    let tree: Tree = scene.tree(&BuildOptions::default());
    let ground = |x, y| scene.ground_height(x, y);
    let (flight, _) = FlightPlan::new(&survey, scene.shift, &ground, &FlightOptions::default())?;
    let physics = Physics::new(&scene, &tree, &survey, PhysicsOptions::helios())?;
    let river = River {
        flight: &flight,
        physics: &physics,
        las: plan(&survey, &scene, PointFormat::Las)?,
        laz: plan(&survey, &scene, PointFormat::Laz)?,
        text: plan(&survey, &scene, PointFormat::Xyz)?,
    };
    let (mut best, mut echoes) = (UNMEASURED, 0);
    for _ in 0..passes {
        let (pass, found) = river.pass()?;
        (best, echoes) = (best.best(pass), found);
    }
    println!("{} primitives, {PULSES} pulses, {echoes} echoes; best of {passes} passes", scene.primitives());
    println!("{:<38}{:>10}{:>14}", "stage (one thread)", "ns/pulse", "M pulses/s");
    let row = |name: &str, seconds: f64| {
        let ns = seconds / PULSES as f64 * 1e9;
        println!("{name:<38}{ns:>10.1}{:>14.2}", 1e3 / ns);
    };
    row("count steps (producer)", best.count);
    row("replay: steps to pulses", best.replay);
    row("aim: pulses to subrays", best.aim);
    row("trace", best.trace);
    row("receive: hits to echoes", best.receive);
    row("encode LAS", best.las);
    row("encode LAZ", best.laz);
    row("encode text", best.text);
    let river = best.count + best.replay + best.aim + best.trace + best.receive;
    row("the whole river to LAS", river + best.las);
    row("the whole river to LAZ", river + best.laz);
    row("the whole river to text", river + best.text);
    Ok(())
}

/// The survey of a forest of a million triangles, made once.
fn forest() -> Result<PathBuf> {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("forest-1m");
    let survey = folder.join("survey.xml");
    if !survey.exists() {
        let options = generate::SceneOptions::new(generate::Kind::Forest, 1_000_000);
        let options = generate::SceneOptions { overwrite: true, ..options };
        generate::write_scene(&options, &folder, |_| ())?;
    }
    Ok(survey)
}

fn main() -> Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).filter(|a| !a.starts_with("--")).collect();
    let survey = match arguments.first() {
        Some(path) => PathBuf::from(path),
        None => forest()?,
    };
    let passes = arguments.get(1).map_or(Ok(5), |n| n.parse());
    measure(&survey, passes.map_err(|_| Error::input("expected a number of passes"))?)
}
