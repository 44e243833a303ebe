//! Measurement of flights and tree builds.

use super::matrix::{Combination, Matrix};
use crate::cli::{Console, RunArgs, interrupt};
use crate::output::{OutputContext, OutputPlan, OutputRequest, PointFormat, ShardOutput, Target};
use crate::pipeline::ResolvedRun;
use crate::pipeline::{
    Ended, Pass, Progress, RunContext, Session, Settings, chunk_making_s, fly, merge, target,
};
use crate::shards::{Fingerprint, OneOf, Records, ShardHead, ShardSet, shard_path};
use serde::Serialize;
use std::sync::Arc;
use std::thread::available_parallelism;
use std::time::Instant;
use vlscan_base::error::{Error, Result};
use vlscan_base::machine;
use vlscan_lidar::flight::{FlightPlan, FlightState, Step};
use vlscan_lidar::pulse::Physics;
use vlscan_survey::PlatformKind;
use vlscan_trace::{BuildOptions, Tree};
use vlscan_warehouse::{
    ChunkCosts, Log, Overheads, Policy, Recorder, Schedule, SizeChange, Stop, Workload, thread_cpu_s,
};

/// The survey, ready for repeated flights.
pub struct Bench {
    pub session: Session,
    pub load_s: f64,
    pub format: String,
    output: OutputRequest,
    flight: FlightPlan,
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
    /// Processor time of the simulation's threads together, s, minimum of all repetitions: unlike the other times it
    /// is not lengthened by other programs.
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

impl Bench {
    pub fn prepare(args: &RunArgs, format: &str, console: &Console) -> Result<Bench> {
        let (job, warnings) = ResolvedRun::resolve(&args.file, &args.options)?;
        console.warnings(&warnings)?;
        let ResolvedRun { settings, output, .. } = job;
        if matches!(settings.survey.platform.kind, PlatformKind::Stream(_)) {
            return Err(Error::input(
                "a stream of poses passes only once, and a comparison flies many times",
            ));
        }
        let started = Instant::now();
        let session = Session::open_for_flight(settings, console.observer())?;
        let load_s = started.elapsed().as_secs_f64();
        if session.epochs() > 1 {
            console.say("the scene's swaps ask for several flights; the first is compared");
        }
        let flight = session.plan_flight()?;
        let folder =
            tempfile::tempdir().map_err(|e| Error::io("create", std::env::temp_dir().as_path(), e))?;
        Ok(Bench { session, load_s, format: format.to_owned(), output, flight, folder })
    }

    /// Measures all cells of a tree. Repetitions take turns, so that other load affects all of them alike.
    pub fn cells(
        &self,
        tree_name: &'static str,
        options: &BuildOptions,
        built: &Built,
        matrix: &Matrix,
        console: &Console,
    ) -> Result<Vec<Cell>> {
        let Built { tree, seconds: builds } = built;
        let physics = self.physics(tree)?;
        let mut best: Vec<Option<(f64, Flown)>> = vec![None; matrix.variants.len()];
        let mut all = vec![(Vec::new(), f64::INFINITY); matrix.variants.len()];
        for turn in 0..matrix.warm_up + matrix.repetitions {
            console.detail(format!(
                "{tree_name}: {} {}",
                if turn < matrix.warm_up { "warm-up" } else { "repetition" },
                turn + 1
            ));
            for (i, variant) in matrix.variants.iter().enumerate() {
                let flown = self.fly(&physics, options, variant.schedule)?;
                if turn < matrix.warm_up {
                    continue;
                }
                all[i].0.push(flown.seconds);
                all[i].1 = all[i].1.min(flown.log.cpu_s());
                if best[i].as_ref().is_none_or(|(least, _)| flown.seconds < *least) {
                    best[i] = Some((flown.seconds, flown));
                }
            }
        }
        let build_of = |threads: usize| builds.iter().find(|b| b.0 == threads).map_or(f64::NAN, |b| b.1);
        let cells = matrix.variants.iter().zip(best).zip(all).filter_map(|((variant, best), seconds)| {
            let (_, flown) = best?;
            Some(cell(variant.with_tree(tree_name), build_of(variant.schedule.threads), flown, seconds, tree))
        });
        Ok(cells.collect())
    }

    pub fn build(&self, options: &BuildOptions, matrix: &Matrix) -> Result<Built> {
        let mut seconds: Vec<(usize, f64)> = Vec::new();
        let mut tree = None;
        for variant in &matrix.variants {
            let threads = variant.schedule.threads;
            if seconds.iter().any(|b| b.0 == threads) {
                continue;
            }
            let mut least = f64::INFINITY;
            for _ in 0..matrix.repetitions {
                // Strict trees can fill half of the memory.
                drop(tree.take());
                let started = Instant::now();
                tree = Some(self.session.scene().tree(&with_jobs(options, threads)));
                least = least.min(started.elapsed().as_secs_f64());
                if interrupt::STOP.is_requested() {
                    return Err(Error::Interrupted);
                }
            }
            seconds.push((threads, least));
        }
        let tree = tree.unwrap_or_else(|| self.session.scene().tree(&with_jobs(options, 0)));
        Ok(Built { tree, seconds })
    }

    fn physics<'a>(&'a self, tree: &'a Tree) -> Result<Physics<'a>> {
        let Settings { survey, physics, .. } = self.session.settings();
        Physics::new(self.session.scene(), tree, survey, *physics)
    }

    fn fly(&self, physics: &Physics, options: &BuildOptions, schedule: Schedule) -> Result<Flown> {
        // A flight that was stopped has no valid time.
        self.fly_until(&interrupt::STOP, &self.format, physics, options, schedule)?.ok_or(Error::Interrupted)
    }

    /// Flies once; `None` when the flight was stopped.
    fn fly_until(
        &self,
        stop: &Stop,
        format: &str,
        physics: &Physics,
        options: &BuildOptions,
        schedule: Schedule,
    ) -> Result<Option<Flown>> {
        self.fly_to(stop, self.request(format)?, physics, options, schedule)
    }

    /// Flies once and writes the outputs of a request; `None` when the flight was stopped.
    fn fly_to(
        &self,
        stop: &Stop,
        request: OutputRequest,
        physics: &Physics,
        options: &BuildOptions,
        schedule: Schedule,
    ) -> Result<Option<Flown>> {
        let (progress, recorder) = (Progress::default(), Recorder::new());
        let (survey, scene) = (self.session.survey(), self.session.scene());
        let two_way = self.session.settings().physics.corrections.two_way_time;
        let output = OutputPlan::new(request, &OutputContext::new(survey, scene).with_times(two_way))?;
        let pass = Pass {
            physics,
            motion: self.session.motion(),
            trees: &with_jobs(options, 1),
            output: Arc::new(output),
            ground: None,
            schedule,
            control: RunContext { progress: &progress, stop, recorder: Some(&recorder) },
            target: target(survey, scene),
            check: None,
            epoch: 0,
            is_last: true,
        };
        let started = Instant::now();
        let mut state = FlightState::start(&self.flight);
        if let Ended::Interrupted(_) = fly(&pass, &self.flight, &mut state, None, u64::MAX, None)? {
            return Ok(None);
        }
        let seconds = started.elapsed().as_secs_f64();
        let (done, log) = (progress.snapshot(), recorder.finish());
        let rays = physics.max_rays();
        Ok(Some(Flown { seconds, pulses: done.pulses, echoes: done.echoes, rays, log }))
    }

    fn request(&self, format: &str) -> Result<OutputRequest> {
        let points = match format {
            "none" => None,
            "xyz" => Some(PointFormat::Xyz),
            "las" => Some(PointFormat::Las),
            "laz" => Some(PointFormat::Laz),
            other => return Err(Error::input(format!("--format: {other:?} is none of none, xyz, las, laz"))),
        };
        let file = self.folder.path().join(format!("points.{format}"));
        Ok(OutputRequest {
            sinks: points.map(|points| (Target::File(file), points)).into_iter().collect(),
            waveforms: false,
            pulses: false,
            trajectory: None,
            force: true,
            epochs: 1,
            ..self.output.clone()
        })
    }

    /// Measures the task times in chunks of all possible sizes, on one thread while the other cores are busy, and the
    /// other costs.
    pub fn workload(&self, options: &BuildOptions, tree: &Tree, matrix: &Matrix) -> Result<Workload> {
        let physics = self.physics(tree)?;
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
        self.under_load(&physics, options, || {
            for _ in 0..matrix.repetitions.max(2) {
                for (size, least) in &mut making {
                    *least = least.min(chunk_making_s(&self.flight, *size)?);
                }
                for (size, logs) in &mut logs {
                    let policy = Policy::Static { size: *size };
                    let settings = Schedule { threads: 1, policy, leg_barrier: false };
                    logs.push(self.fly(&physics, options, settings)?.log);
                }
            }
            Ok(())
        })?;
        let alone = self.under_load(&physics, options, || ChunkCosts::measure(1))?;
        Ok(Workload::from_logs(&logs, making, Overheads::measure(alone)?))
    }

    /// Measures what a run in parts costs: stepping through the flight, computing the only part of a run and merging it,
    /// each on one thread.
    pub fn part_costs(&self, options: &BuildOptions, built: &Built, chunk: u32) -> Result<PartCosts> {
        let physics = self.physics(&built.tree)?;
        let settings = Schedule { threads: 1, policy: Policy::Static { size: chunk }, leg_barrier: false };
        let run = self.fly(&physics, options, settings)?;
        let started = thread_cpu_s().unwrap_or_default();
        let mut state = FlightState::start(&self.flight);
        while state.skip(&self.flight, u32::MAX, u32::MAX)?.last != Step::Ended {}
        let plan_s = thread_cpu_s().unwrap_or_default() - started;

        let folder = self.folder.path().join("parts");
        std::fs::create_dir_all(&folder).map_err(|e| Error::io("create", &folder, e))?;
        let context = OutputContext::new(self.session.survey(), self.session.scene());
        let internal = |e| Error::Internal(format!("a part: {e}"));
        let head = ShardHead {
            fingerprint: Fingerprint::default(),
            number: 0,
            of: 1,
            total: run.pulses,
            epochs: 1,
            creation: self.output.creation,
            records: Records::default(),
            context: postcard::to_stdvec(&context).map_err(internal)?,
        };
        let path = shard_path(&folder, OneOf { number: 0, of: 1 });
        let part = ShardOutput { path: path.clone(), head: head.bytes()? };
        let request = OutputRequest { shard: Some(part), ..OutputRequest::default() };
        let flown = self.fly_to(&interrupt::STOP, request, &physics, options, settings)?;
        let part = flown.ok_or(Error::Interrupted)?;

        let (progress, recorder) = (Progress::default(), Recorder::new());
        let control = RunContext { progress: &progress, stop: &interrupt::STOP, recorder: Some(&recorder) };
        let parts = ShardSet::open(&folder)?;
        let merged = merge(&parts, self.request(&self.format)?, settings, control)?;
        if merged.interrupted {
            return Err(Error::Interrupted);
        }
        let log = recorder.finish();
        Ok(PartCosts {
            pulses: run.pulses,
            plan_s,
            start_s: self.load_s
                + built.seconds.iter().fold(f64::INFINITY, |least, build| least.min(build.1)),
            run_cpu_s: run.log.cpu_s(),
            part_cpu_s: part.log.cpu_s(),
            merge_cpu_s: log.cpu_s() - log.collector.cpu_s,
            collect_s: log.collector.cpu_s,
            part_bytes: std::fs::metadata(&path).map_err(|e| Error::io("read", &path, e))?.len(),
            out_bytes: merged.summary.files.iter().map(|file| file.bytes).sum(),
        })
    }

    /// Measures while all other cores fly the same survey, as in the simulated flights: the threads share memory
    /// bandwidth, and waking a thread on a sleeping core costs several times as much.
    fn under_load<T>(
        &self,
        physics: &Physics,
        options: &BuildOptions,
        measure: impl FnOnce() -> Result<T>,
    ) -> Result<T> {
        struct AtEnd<'a>(&'a Stop);
        impl Drop for AtEnd<'_> {
            fn drop(&mut self) {
                self.0.request();
            }
        }
        let (end, others) = (Stop::new(), available_parallelism().map_or(0, |n| n.get() - 1));
        let settings = Schedule { threads: 1, policy: Policy::Static { size: 256 }, leg_barrier: false };
        std::thread::scope(|scope| {
            let _end = AtEnd(&end);
            for _ in 0..others {
                // Until the end, or until an error, which the measured flight reports.
                let fly = || self.fly_until(&end, "none", physics, options, settings);
                machine::spawn_scoped(scope, "load", move || while let Ok(Some(_)) = fly() {})?;
            }
            measure()
        })
    }
}

/// What a run in parts costs on one thread. Times are processor times, s, but for that of the start.
#[derive(Clone, Debug, Serialize)]
pub struct PartCosts {
    pub pulses: u64,
    /// Stepping through the flight once.
    pub plan_s: f64,
    /// Loading the scene and building its tree, on all threads of this machine.
    pub start_s: f64,
    /// Computing everything without parts, and as a part.
    pub run_cpu_s: f64,
    pub part_cpu_s: f64,
    /// Merging: reading and encoding, which threads share, and collecting.
    pub merge_cpu_s: f64,
    pub collect_s: f64,
    /// Bytes of the parts and of the output.
    pub part_bytes: u64,
    pub out_bytes: u64,
}

/// A tree, and the minimum time of building it with each number of threads, s.
pub struct Built {
    pub tree: Arc<Tree>,
    seconds: Vec<(usize, f64)>,
}

#[derive(Clone)]
struct Flown {
    seconds: f64,
    pulses: u64,
    echoes: u64,
    rays: usize,
    log: Log,
}

/// Computes the figures of a combination. `simulations_s` and `cpu_s` are those of all its flights, `flown` is the
/// fastest.
fn cell(
    of: Combination,
    build_s: f64,
    flown: Flown,
    (simulations_s, cpu_s): (Vec<f64>, f64),
    tree: &Tree,
) -> Cell {
    let known = tree.statistics();
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
        rays_per_s: per_second(flown.pulses as f64 * flown.rays as f64),
        echoes_per_s: per_second(flown.echoes as f64),
        tree_bytes: tree.memory(),
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
