//! Time per pulse of the stages of the pipeline, run one after the other on one thread, and in total.
//!
//! ```text
//! cargo bench --bench stages                       a generated forest of a million triangles
//! cargo bench --bench stages -- survey.xml 5       any survey without moving parts, best of 5 passes
//! ```
//!
//! Times are processor times of the computing thread, so that other load has little effect. Every figure is
//! the best of several passes over the same 131 072 pulses, normally from where the beam first hits the
//! scene.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use vlscan::lidar::flight::{FlightPlan, FlightSink, FlightState, PoseSample, Pulse, Step};
use vlscan::lidar::pulse::{Batch, Phase, Physics, PulseSimulator};
use vlscan::output::{NoOffload, OutputContext, OutputPlan};
use vlscan::scene::Scene;
use vlscan::survey::Survey;
use vlscan::tools::generate::{SceneKind, SceneOptions, write_scene};
use vlscan::{
    Error, OutputRequest, PointFormat, ReadOptions, Result, Session, Settings, Target, read_survey,
};

const PULSES: usize = 1 << 17;
/// Pulses per chunk, as in runs.
const CHUNK: usize = 1024;

/// Processor time of this thread so far, s.
#[cfg(target_os = "linux")]
fn computed() -> f64 {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
    time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
}

/// Wall time since the first call, s.
#[cfg(not(target_os = "linux"))]
fn computed() -> f64 {
    static START: std::sync::OnceLock<std::time::Instant> = std::sync::OnceLock::new();
    START.get_or_init(std::time::Instant::now).elapsed().as_secs_f64()
}

/// Counts like the producer of chunks, and collects the pulses like a worker.
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
    /// Steps until `pulses` pulses have been emitted or the flight ends.
    fn step(&mut self, state: &mut FlightState, plan: &FlightPlan, pulses: usize) -> Result<()> {
        self.seen = 0;
        self.pulses.clear();
        while self.seen < pulses && matches!(state.step(plan, self)?, Step::Advanced | Step::LegChanged) {}
        Ok(())
    }
}

/// The number of stages before the outputs; the names of all stages follow.
const COMPUTING: usize = 5;
const STAGES: [&str; 8] = [
    "count steps (producer)",
    "replay: steps to pulses",
    "pulses to subrays",
    "trace",
    "hits to echoes",
    "encode LAS",
    "encode LAZ",
    "encode text",
];

/// Seconds of each stage in one pass.
type Pass = [f64; STAGES.len()];

struct Stages<'a> {
    flight: &'a FlightPlan,
    physics: &'a Physics<'a>,
    outputs: [Arc<OutputPlan>; STAGES.len() - COMPUTING],
}

impl Stages<'_> {
    /// Returns the state of the flight from which at least half of the pulses have echoes, or its start if
    /// there is none.
    fn over_the_scene(&self) -> Result<FlightState> {
        let mut state = FlightState::start(self.flight);
        let (mut skipped, mut replay) = (Replay::default(), Replay { keep: true, ..Replay::default() });
        let mut simulator = PulseSimulator::new(self.physics);
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

    /// Runs the pulses through one stage after the other. Also returns the number of echoes.
    fn pass(&self) -> Result<(Pass, usize)> {
        let mut pass = Pass::default();
        let (mut counter, mut replay) = (Replay::default(), Replay { keep: true, ..Replay::default() });
        let mut counting = self.over_the_scene()?;
        let mut simulator = PulseSimulator::new(self.physics);
        let mut batches = Vec::new();
        for _ in 0..PULSES / CHUNK {
            let mut state = counting.clone();
            let mut before = computed();
            let mut lap = || {
                let now = computed();
                now - std::mem::replace(&mut before, now)
            };
            counter.step(&mut counting, self.flight, CHUNK)?;
            pass[0] += lap();
            replay.step(&mut state, self.flight, CHUNK)?;
            pass[1] += lap();
            let mut batch = Batch::default();
            simulator.simulate_timed(0, &replay.pulses, &mut batch, |stage| match stage {
                Phase::RayGeneration => pass[2] += lap(),
                Phase::Traversal => pass[3] += lap(),
                Phase::Detection => pass[4] += lap(),
            })?;
            batches.push(batch);
        }
        for (seconds, output) in pass[COMPUTING..].iter_mut().zip(&self.outputs) {
            *seconds = encode(output, &batches)?;
        }
        Ok((pass, batches.iter().map(|b| b.echoes.len()).sum()))
    }
}

/// Measures the seconds of encoding the batches and passing the bytes to the operating system.
fn encode(plan: &Arc<OutputPlan>, batches: &[Batch]) -> Result<f64> {
    let mut writer = plan.open(Arc::new(NoOffload))?;
    let before = computed();
    batches.iter().try_for_each(|batch| writer.append(plan.encode(batch, None)))?;
    writer.finish()?;
    Ok(computed() - before)
}

fn plan(survey: &Survey, scene: &Scene, format: PointFormat) -> Result<Arc<OutputPlan>> {
    let nowhere = Target::File(PathBuf::from("/dev/null"));
    let mut request = OutputRequest::default();
    request.sinks = vec![(nowhere, format)];
    Ok(Arc::new(OutputPlan::new(request, &OutputContext::new(survey, scene))?))
}

fn measure(path: &Path, passes: usize) -> Result<()> {
    let (survey, _) = read_survey(path, &ReadOptions::default())?;
    let session = Session::open_for_flight(Settings::new(survey), |_| ())?;
    let (settings, scene) = (session.settings(), session.scene());
    let tree = session.build_tree(&settings.tree)?;
    let [las, laz, text] = [PointFormat::Las, PointFormat::Laz, PointFormat::Xyz];
    let stages = Stages {
        flight: &session.plan_flight()?,
        physics: &Physics::new(scene, &tree, &settings.survey, settings.physics)?,
        outputs: [
            plan(&settings.survey, scene, las)?,
            plan(&settings.survey, scene, laz)?,
            plan(&settings.survey, scene, text)?,
        ],
    };
    let (mut best, mut echoes) = ([f64::INFINITY; STAGES.len()], 0);
    for _ in 0..passes {
        let (pass, found) = stages.pass()?;
        best = std::array::from_fn(|i| best[i].min(pass[i]));
        echoes = found;
    }
    println!("{} primitives, {PULSES} pulses, {echoes} echoes; best of {passes} passes", scene.primitives());
    println!("{:<38}{:>10}{:>14}", "stage (one thread)", "ns/pulse", "M pulses/s");
    let row = |name: &str, seconds: f64| {
        let ns = seconds / PULSES as f64 * 1e9;
        println!("{name:<38}{ns:>10.1}{:>14.2}", 1e3 / ns);
    };
    STAGES.iter().zip(best).for_each(|(name, seconds)| row(name, seconds));
    let computing: f64 = best[..COMPUTING].iter().sum();
    for (name, seconds) in ["LAS", "LAZ", "text"].iter().zip(&best[COMPUTING..]) {
        row(&format!("all stages to {name}"), computing + seconds);
    }
    Ok(())
}

/// Returns the survey of a forest of a million triangles, generated once.
fn forest() -> Result<PathBuf> {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("forest-1m");
    let survey = folder.join("survey.xml");
    if !survey.exists() {
        let options = SceneOptions::new(SceneKind::Forest, 1_000_000);
        let options = SceneOptions { overwrite: true, ..options };
        write_scene(&options, &folder)?;
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
