//! Measurement of flights and tree builds.

use crate::args::Args;
use crate::matrix::{Combination, Matrix};
use crate::workload::{ChunkCosts, Overheads, Workload};
use serde::Serialize;
use std::hint::black_box;
use std::thread::available_parallelism;
use std::time::Instant;
use vlscan::lidar::flight::{FlightPlan, FlightState, Step};
use vlscan::lidar::pulse::Physics;
use vlscan::{
    LoadedScene, OneOf, Options, OutputRequest, PointFormat, Progress, Recorder, ResolvedRun, RunContext,
    Session, Settings, ShardSet, Target, merge,
};
use vlscan_base::diag::Notice;
use vlscan_base::error::{Error, Result};
use vlscan_base::machine;
use vlscan_render::Render as _;
use vlscan_survey::PlatformKind;
use vlscan_trace::{BuildOptions, Statistics};
use vlscan_warehouse::{Log, Policy, Schedule, SizeChange, Stop, thread_cpu_s};

/// The survey, ready for repeated flights.
pub struct Bench {
    settings: Settings,
    output: OutputRequest,
    format: String,
    /// Temporary directory of the points of all runs.
    folder: tempfile::TempDir,
}

/// The measurements of one combination. Times are the minimum of all repetitions.
#[derive(Clone, Debug, Serialize)]
pub struct Cell {
    #[serde(flatten)]
    pub of: Combination,
    /// Time to build the tree, s.
    pub build_s: f64,
    /// Time from the first pulse to the last point written, s.
    pub simulation_s: f64,
    /// Of these, the time of completing the file after its last point, with waiting for the disk.
    pub completing_s: f64,
    /// Build and simulation, s.
    pub total_s: f64,
    /// Simulation time of every repetition, s.
    pub simulations_s: Vec<f64>,
    /// Processor time of the simulation's threads together, s, minimum of all repetitions: unlike the other
    /// times it is not lengthened by other programs.
    pub cpu_s: f64,
    /// Simulation time of the same tree on one thread with chunks of this size, divided by this one.
    pub speedup: f64,
    /// Speedup per thread.
    pub efficiency: f64,
    /// Total time of the median tree on one thread, divided by this total (eq 17).
    pub global_speedup: f64,
    /// 1 − 1 / global speedup (eq 18).
    pub time_reduction: f64,
    pub pulses: u64,
    pub echoes: u64,
    /// Pulses per second of simulation.
    pub pulses_per_s: f64,
    /// Rays per second of simulation, without those that continue behind a voxel.
    pub rays_per_s: f64,
    /// Echoes per second of simulation.
    pub echoes_per_s: f64,
    pub tree_bytes: usize,
    /// Interior nodes of the tree, without the trees of instances, like the following figures.
    pub tree_nodes: usize,
    pub tree_leaves: usize,
    /// References to primitives in all leaves.
    pub tree_references: usize,
    /// Depth of the deepest leaf.
    pub tree_depth: u32,
    /// Expected cost of a ray, C_T of the paper with the costs of the build.
    pub tree_cost: f64,
    /// Peak memory of the process so far, bytes; 0 where the system does not report it.
    pub peak_bytes: u64,
    /// Fraction of the workers' time without work.
    pub idle: f64,
    /// Number of times that the producer found all workers busy or the warehouse full.
    pub refusals: u64,
    /// Mean number of chunks in the warehouse, or being computed, at a hand-over.
    pub queue_depth: f64,
    /// History of the size of dynamic chunks, in the fastest repetition.
    pub sizes: Vec<SizeChange>,
}

/// The scene with one tree, and the minimum time of building the tree with each number of threads, s.
pub struct Built {
    pub session: Session,
    /// Time to load the scene, s.
    pub load_s: f64,
    loaded: LoadedScene,
    tree: Statistics,
    tree_bytes: usize,
    /// Rays per pulse, without those that continue behind a voxel.
    rays: usize,
    seconds: Vec<(usize, f64)>,
}

/// Shows what the first session warns of; the later ones would repeat it.
fn show(notice: Notice) {
    if let Notice::Warnings(found) = notice {
        eprint!("{}", found.render(false));
    }
}

/// A schedule of one thread.
fn alone(chunk: u32) -> Schedule {
    Schedule { threads: 1, policy: Policy::Static { size: chunk }, leg_barrier: false }
}

impl Bench {
    /// Reads the survey with the options of `vlscan run` that follow `--`.
    pub fn prepare(args: &Args) -> Result<Bench> {
        let (job, warnings) = ResolvedRun::resolve(&args.survey, &Options::parse(args.run.iter().cloned())?)?;
        show(Notice::Warnings(warnings));
        let ResolvedRun { settings, output, .. } = job;
        if matches!(settings.survey.platform.kind, PlatformKind::Stream(_)) {
            return Err(Error::input(
                "vlscan bench flies the survey many times, but a stream of poses can be read only once",
            ));
        }
        let folder =
            tempfile::tempdir().map_err(|e| Error::io("create", std::env::temp_dir().as_path(), e))?;
        Ok(Bench { settings, output, format: args.format.clone(), folder })
    }

    /// Loads the scene and builds one kind of tree with every number of threads.
    pub fn build(&self, options: &BuildOptions, matrix: &Matrix) -> Result<Built> {
        let tree = with_jobs(options, 0);
        let started = Instant::now();
        let Settings { survey, load, strict, physics, .. } = &self.settings;
        let loaded = LoadedScene::load(&survey.scene, load, &tree, *strict, &show)?;
        let load_s = started.elapsed().as_secs_f64();
        if loaded.epochs() > 1 {
            return Err(Error::input(
                "the scene's swaps require several flights; an experiment has only one",
            ));
        }
        let mut seconds: Vec<(usize, f64)> = Vec::new();
        let (mut statistics, mut tree_bytes, mut rays) = (Statistics::default(), 0, 0);
        for variant in &matrix.variants {
            let threads = variant.schedule.threads;
            if seconds.iter().any(|build| build.0 == threads) {
                continue;
            }
            let mut least = f64::INFINITY;
            for _ in 0..matrix.repetitions {
                // Strict trees can fill half of the memory: each is dropped before the next is built.
                let started = Instant::now();
                let tree = loaded.scene().tree(&with_jobs(options, threads));
                least = least.min(started.elapsed().as_secs_f64());
                (statistics, tree_bytes) = (*tree.statistics(), tree.memory());
                rays = Physics::new(loaded.scene(), &tree, survey, *physics)?.max_rays();
            }
            seconds.push((threads, least));
        }
        let session = self.session(&loaded, options.clone(), alone(1))?;
        Ok(Built { session, load_s, loaded, tree: statistics, tree_bytes, rays, seconds })
    }

    /// A session over a loaded scene.
    fn session(&self, loaded: &LoadedScene, options: BuildOptions, schedule: Schedule) -> Result<Session> {
        let mut settings = self.settings.clone();
        (settings.tree, settings.schedule) = (with_jobs(&options, 1), schedule);
        Session::new(settings, loaded.clone(), |_| ())
    }

    /// Measures all cells of a tree. Repetitions take turns, so that other load affects all of them alike.
    pub fn cells(
        &self,
        tree_name: &'static str,
        built: &Built,
        matrix: &Matrix,
        say: &dyn Fn(String),
    ) -> Result<Vec<Cell>> {
        let mut best: Vec<Option<Flown>> = vec![None; matrix.variants.len()];
        let mut all = vec![(Vec::new(), f64::INFINITY); matrix.variants.len()];
        for turn in 0..matrix.warm_up + matrix.repetitions {
            let kind = if turn < matrix.warm_up { "warm-up" } else { "repetition" };
            say(format!("{tree_name}: {kind} {}", turn + 1));
            for (i, variant) in matrix.variants.iter().enumerate() {
                let flown = self.fly(built, variant.schedule)?;
                if turn < matrix.warm_up {
                    continue;
                }
                all[i].0.push(flown.seconds);
                all[i].1 = all[i].1.min(flown.log.cpu_s());
                if best[i].as_ref().is_none_or(|best| flown.seconds < best.seconds) {
                    best[i] = Some(flown);
                }
            }
        }
        let build_of =
            |threads: usize| built.seconds.iter().find(|b| b.0 == threads).map_or(f64::NAN, |b| b.1);
        let cells = matrix.variants.iter().zip(best).zip(all).filter_map(|((variant, best), seconds)| {
            let build_s = build_of(variant.schedule.threads);
            Some(cell(variant.with_tree(tree_name), build_s, best?, seconds, built))
        });
        Ok(cells.collect())
    }

    fn fly(&self, built: &Built, schedule: Schedule) -> Result<Flown> {
        // A flight that was stopped has no valid time.
        self.fly_until(&Stop::new(), &self.format, built, schedule)?.ok_or(Error::Interrupted)
    }

    /// Flies once; `None` when the flight was stopped.
    fn fly_until(
        &self,
        stop: &Stop,
        format: &str,
        built: &Built,
        schedule: Schedule,
    ) -> Result<Option<Flown>> {
        let (progress, recorder) = (Progress::default(), Recorder::new());
        let mut session = self.session(&built.loaded, built.session.settings().tree.clone(), schedule)?;
        let control = RunContext { progress: &progress, stop, recorder: Some(&recorder) };
        let report = match session.run(self.request(format)?, control) {
            Ok(report) if !report.interrupted => report,
            Ok(_) | Err(Error::Interrupted) => return Ok(None),
            Err(error) => return Err(error),
        };
        let (done, log) = (progress.snapshot(), recorder.finish());
        Ok(Some(Flown { seconds: report.seconds, pulses: done.pulses, echoes: done.echoes, log }))
    }

    fn request(&self, format: &str) -> Result<OutputRequest> {
        let points = match format {
            "none" => None,
            "xyz" => Some(PointFormat::Xyz),
            "las" => Some(PointFormat::Las),
            "laz" => Some(PointFormat::Laz),
            other => return Err(Error::input(format!("--format {other}: expected none, xyz, las or laz"))),
        };
        let file = self.folder.path().join(format!("points.{format}"));
        let mut request = self.output.clone();
        request.sinks = points.map(|points| (Target::File(file), points)).into_iter().collect();
        (request.waveforms, request.pulses, request.trajectory) = (false, false, None);
        request.force = true;
        Ok(request)
    }

    /// Measures the task times in chunks of all possible sizes, on one thread while the other cores are busy,
    /// and the other costs.
    pub fn workload(&self, built: &Built, matrix: &Matrix) -> Result<Workload> {
        let mut sizes: Vec<u32> =
            matrix.variants.iter().flat_map(|v| [1, v.schedule.policy.size()]).collect();
        // Dynamic chunks can have any size; their costs near a measured size are known accurately enough.
        if matrix.variants.iter().any(|v| matches!(v.schedule.policy, Policy::Dynamic { .. })) {
            for more in [8, 64, 512] {
                if !sizes.iter().any(|&size| (size / 4..=size.saturating_mul(4)).contains(&more)) {
                    sizes.push(more);
                }
            }
        }
        sizes.sort_unstable();
        sizes.dedup();
        let mut logs: Vec<(u32, Vec<Log>)> = sizes.iter().map(|&size| (size, Vec::new())).collect();
        let mut making: Vec<(u32, f64)> = sizes.iter().map(|&size| (size, f64::INFINITY)).collect();
        let flight = built.session.plan_flight()?;
        self.under_load(built, || {
            for _ in 0..matrix.repetitions.max(2) {
                for (size, least) in &mut making {
                    *least = least.min(chunk_making_s(&flight, *size)?);
                }
                for (size, logs) in &mut logs {
                    logs.push(self.fly(built, alone(*size))?.log);
                }
            }
            Ok(())
        })?;
        let alone = self.under_load(built, || ChunkCosts::measure(1))?;
        Ok(Workload::from_logs(&logs, making, Overheads::measure(alone)?))
    }

    /// Measures what a run in shards costs: stepping through the flight, computing the only shard of a run
    /// and merging it, each on one thread.
    pub fn shard_costs(&self, built: &Built, chunk: u32) -> Result<ShardCosts> {
        let run = self.fly(built, alone(chunk))?;
        let flight = built.session.plan_flight()?;
        let began = Instant::now();
        let now = || thread_cpu_s().unwrap_or_else(|| began.elapsed().as_secs_f64());
        let started = now();
        let mut state = FlightState::start(&flight);
        while state.skip(&flight, u32::MAX, u32::MAX)?.last != Step::Ended {}
        let index_s = now() - started;

        let folder = self.folder.path().join("shards");
        let (stop, shard) = (Stop::new(), OneOf { number: 0, of: 1 });
        let tree = built.session.settings().tree.clone();
        let (progress, recorder) = (Progress::default(), Recorder::new());
        let control = RunContext { recorder: Some(&recorder), ..RunContext::new(&progress, &stop) };
        let mut session = self.session(&built.loaded, tree, alone(chunk))?;
        let mut shards = session.shards(&folder, &self.output, true, &stop)?;
        shards.run(shard, control)?;
        let (path, shard) = (shards.path(shard), recorder.finish());

        let (progress, recorder) = (Progress::default(), Recorder::new());
        let control = RunContext { recorder: Some(&recorder), ..RunContext::new(&progress, &stop) };
        let merged = merge(&ShardSet::open(&folder)?, self.request(&self.format)?, alone(chunk), control)?;
        let log = recorder.finish();
        Ok(ShardCosts {
            pulses: run.pulses,
            index_s,
            start_s: built.load_s
                + built.seconds.iter().fold(f64::INFINITY, |least, build| least.min(build.1)),
            run_cpu_s: run.log.cpu_s(),
            shard_cpu_s: shard.cpu_s(),
            merge_cpu_s: log.cpu_s() - log.collector.cpu_s,
            collect_s: log.collector.cpu_s,
            shard_bytes: std::fs::metadata(&path).map_err(|e| Error::io("read", &path, e))?.len(),
            out_bytes: merged.summary.files.iter().map(|file| file.bytes).sum(),
        })
    }

    /// Measures while all other cores fly the same survey, as in the simulated flights: the threads share
    /// memory bandwidth, and waking a thread on a sleeping core costs several times as much.
    fn under_load<T>(&self, built: &Built, measure: impl FnOnce() -> Result<T>) -> Result<T> {
        struct AtEnd<'a>(&'a Stop);
        impl Drop for AtEnd<'_> {
            fn drop(&mut self) {
                self.0.request();
            }
        }
        let (end, others) = (Stop::new(), available_parallelism().map_or(0, |n| n.get() - 1));
        std::thread::scope(|scope| {
            let _end = AtEnd(&end);
            for _ in 0..others {
                // Until the end, or until an error, which the measured flight reports.
                let fly = || self.fly_until(&end, "none", built, alone(256));
                machine::spawn_scoped(scope, "load", move || while let Ok(Some(_)) = fly() {})?;
            }
            measure()
        })
    }
}

/// Pulses after which [`chunk_making_s`] ends a flight, and processor time up to which it repeats it, s.
const TIMED_PULSES: u64 = 1 << 22;
const MIN_TIMED_S: f64 = 0.02;

/// Measures the processor time of making chunks of `size` pulses as a run does, s per pulse: the flight's
/// state is copied, and the flight is stepped over the chunk.
fn chunk_making_s(plan: &FlightPlan, size: u32) -> Result<f64> {
    let (mut pulses, mut seconds) = (0, 0.0);
    while seconds < MIN_TIMED_S {
        let mut state = FlightState::start(plan);
        let (began, started, end) = (thread_cpu_s(), Instant::now(), pulses + TIMED_PULSES);
        while pulses < end {
            drop(black_box(state.clone()));
            let skipped = state.skip(plan, size, u32::MAX)?;
            pulses += u64::from(skipped.pulses);
            if skipped.last == Step::Ended {
                break;
            }
        }
        seconds += match (began, thread_cpu_s()) {
            (Some(from), Some(to)) => to - from,
            _ => started.elapsed().as_secs_f64(),
        };
        if pulses == 0 {
            return Ok(0.0);
        }
    }
    Ok(seconds / pulses as f64)
}

/// Costs of a run in shards on one thread. Times are processor times, s, but for that of the start.
#[derive(Clone, Debug, Serialize)]
pub struct ShardCosts {
    pub pulses: u64,
    /// Stepping through the flight once.
    pub index_s: f64,
    /// Loading the scene and building its tree, on all threads of this machine.
    pub start_s: f64,
    /// Computing everything without shards, and as a shard.
    pub run_cpu_s: f64,
    pub shard_cpu_s: f64,
    /// Merging: reading and encoding, which threads share, and collecting.
    pub merge_cpu_s: f64,
    pub collect_s: f64,
    /// Bytes of the shards and of the output.
    pub shard_bytes: u64,
    pub out_bytes: u64,
}

#[derive(Clone)]
struct Flown {
    seconds: f64,
    pulses: u64,
    echoes: u64,
    log: Log,
}

/// Computes the figures of a combination. `simulations_s` and `cpu_s` are those of all its flights, `flown`
/// is the fastest.
fn cell(
    of: Combination,
    build_s: f64,
    flown: Flown,
    (simulations_s, cpu_s): (Vec<f64>, f64),
    built: &Built,
) -> Cell {
    let known = &built.tree;
    let per_second = |n: f64| n / flown.seconds.max(1e-9);
    let (busy, idle) = flown
        .log
        .workers
        .iter()
        .fold((0.0, 0.0), |(busy, idle), w| (busy + w.busy_s + w.jobs_s, idle + w.idle_s));
    let depths = flown.log.depths.iter().enumerate();
    let waited: u64 = depths.map(|(depth, &count)| depth as u64 * count).sum();
    Cell {
        of,
        build_s,
        simulation_s: flown.seconds,
        completing_s: flown.log.completing_s,
        total_s: build_s + flown.seconds,
        simulations_s,
        cpu_s,
        speedup: f64::NAN,
        efficiency: f64::NAN,
        global_speedup: f64::NAN,
        time_reduction: f64::NAN,
        pulses: flown.pulses,
        echoes: flown.echoes,
        pulses_per_s: per_second(flown.pulses as f64),
        rays_per_s: per_second(flown.pulses as f64 * built.rays as f64),
        echoes_per_s: per_second(flown.echoes as f64),
        tree_bytes: built.tree_bytes,
        tree_nodes: known.interior,
        tree_leaves: known.leaves,
        tree_references: known.references,
        tree_depth: known.max_depth,
        tree_cost: known.cost,
        peak_bytes: peak(),
        idle: if busy + idle > 0.0 { idle / (busy + idle) } else { 0.0 },
        refusals: flown.log.refusals,
        queue_depth: if flown.log.handed_over > 0 {
            waited as f64 / flown.log.handed_over as f64
        } else {
            0.0
        },
        sizes: flown.log.sizes.entries().to_vec(),
    }
}

/// `options` on `jobs` threads, of which as many help with large nodes as the rules say.
fn with_jobs(options: &BuildOptions, jobs: usize) -> BuildOptions {
    let geometry_jobs = if options.geometry_jobs == 0 { jobs } else { options.geometry_jobs };
    BuildOptions { jobs, geometry_jobs, ..options.clone() }
}

/// Peak resident size of this process so far, bytes.
fn peak() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    let kib = line.and_then(|rest| rest.split_whitespace().next()?.parse::<u64>().ok());
    kib.unwrap_or(0) * 1024
}
