//! Settings of a session, with every choice resolved.

use crate::output::OutputRequest;
use crate::shards::Records;
use std::num::NonZero;
use std::thread::available_parallelism;
use std::time::Duration;
use vlscan_base::error::{Error, Result};
use vlscan_base::machine;
use vlscan_lidar::flight::{FlightOptions, default_gps_start};
use vlscan_lidar::pulse::{Corrections, PhysicsOptions, PhysicsProfile};
use vlscan_scene::LoadOptions;
use vlscan_survey::Survey;
use vlscan_trace::BuildOptions;
use vlscan_warehouse::{MAX_THREADS, Policy, RunError, Schedule};

/// Maximum delay for which points of a live trajectory may wait, s.
pub const MAX_LATENCY_S: f64 = 3600.0;

/// Pulses per chunk: enough to make the cost of the queues negligible, few enough to keep all threads busy on
/// short legs.
pub const DEFAULT_CHUNK_SIZE: u32 = 1024;

/// Maximum queued chunks per worker.
pub const DEFAULT_WAREHOUSE_FACTOR: usize = 4;

/// Default maximum latency of points of a live trajectory.
pub const DEFAULT_LATENCY: Duration = Duration::from_millis(250);

/// Settings of a [`Session`](super::Session). A session reads neither the command line nor the environment
/// nor the clock.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Settings {
    /// Legs, platform, scanner and the description of the scene.
    pub survey: Survey,
    /// True if warnings end the session as errors.
    pub strict: bool,
    /// Options of scene loading.
    pub load: LoadOptions,
    /// Options of tree construction.
    pub tree: BuildOptions,
    /// Clock, noise of the platform, navigation errors.
    pub flight: FlightOptions,
    /// Options of the echo simulation. A run also records everything that its outputs need.
    pub physics: PhysicsOptions,
    /// Number of threads, and the distribution of pulses to them.
    pub schedule: Schedule,
    /// Maximum latency of points of a live trajectory.
    pub max_latency: Duration,
}

impl Settings {
    /// The settings of `vlscan run` without options: the survey's seed, or 0, the physics of HELIOS++, a
    /// clock that starts at [`DEFAULT_DAY`](vlscan_lidar::flight::DEFAULT_DAY), all cores, the memory of the
    /// machine.
    pub fn new(survey: Survey) -> Settings {
        let seed = survey.seed.unwrap_or(0);
        let gps_start_ns = default_gps_start(FlightOptions::default().kinematics.leap_seconds);
        Settings {
            strict: false,
            load: LoadOptions { seed, max_memory: machine::memory(), ..LoadOptions::default() }
                .with_wavelengths_of(&survey.scanner),
            tree: BuildOptions::default(),
            flight: FlightOptions { seed, gps_start_ns, ..FlightOptions::default() },
            physics: PhysicsOptions { seed, ..PhysicsOptions::helios() },
            schedule: Schedule {
                threads: available_parallelism().map_or(1, NonZero::get).min(MAX_THREADS),
                policy: Policy::Warehouse { size: DEFAULT_CHUNK_SIZE, factor: DEFAULT_WAREHOUSE_FACTOR },
                leg_barrier: false,
            },
            max_latency: DEFAULT_LATENCY,
            survey,
        }
    }

    /// Sets the seed of every random draw: of materials, noise of the platform, and pulses.
    pub fn set_seed(&mut self, seed: u64) {
        (self.load.seed, self.flight.seed, self.physics.seed) = (seed, seed, seed);
    }

    /// Sets the number of threads, from 1 to [`MAX_THREADS`], that load the scene, build the tree and trace
    /// pulses. Points do not depend on it.
    pub fn set_threads(&mut self, threads: usize) {
        (self.load.jobs, self.schedule.threads) = (threads, threads);
        (self.tree.jobs, self.tree.geometry_jobs) = (threads, threads);
    }

    /// Sets where physics, motions and materials depart from the reference's. The default start of the clock
    /// stays the same moment, with leap seconds or without.
    pub fn set_corrections(&mut self, corrections: Corrections) {
        self.physics.corrections = corrections;
        let kinematics = corrections.and(Corrections::MOTION.or(Corrections::RECORD));
        let flight = &mut self.flight;
        if flight.gps_start_ns == default_gps_start(flight.kinematics.leap_seconds) {
            flight.gps_start_ns = default_gps_start(kinematics.leap_seconds);
        }
        flight.kinematics = kinematics;
        self.load.rules = corrections;
        self.load = std::mem::take(&mut self.load).with_wavelengths_of(&self.survey.scanner);
    }

    /// Sets which problems of a flight are errors. A leg on the ground needs ground below it, unless a survey
    /// of HELIOS++ is flown with the physics of HELIOS++, which then takes the height of the scene's centre.
    /// A pipeline or a program has a separate flight.
    pub fn set_flight_rules(&mut self, has_own_flight: bool, profile: PhysicsProfile) {
        self.flight.needs_ground = has_own_flight || profile == PhysicsProfile::Refined;
    }

    /// Checks the limits that the command has: threads, sizes of chunks and of the queue, latency. Sessions
    /// and scenes check them before they start anything.
    ///
    /// # Errors
    /// [`Error::Input`] for numbers outside of their limits.
    pub fn check(&self) -> Result<()> {
        if self.schedule.threads > MAX_THREADS {
            return Err(too_many("--threads", self.schedule.threads));
        }
        check_jobs(&self.load, &self.tree)?;
        self.schedule.check().map_err(RunError::from)?;
        let latency = self.max_latency.as_secs_f64();
        if latency > MAX_LATENCY_S {
            return Err(Error::input(format!(
                "--latency {latency}: expected seconds from 0 to {MAX_LATENCY_S}"
            )));
        }
        Ok(())
    }

    /// Returns the options of the physics of a run, with everything recorded that its outputs need. The
    /// settings themselves only record additional requests.
    pub(super) fn physics_for(&self, outputs: &OutputRequest) -> PhysicsOptions {
        Records::of(&self.physics).union(outputs.records()).recorded_by(self.physics)
    }
}

/// Checks the numbers of threads that load a scene and build the tree over it; 0 means all.
pub(super) fn check_jobs(load: &LoadOptions, tree: &BuildOptions) -> Result<()> {
    let jobs = [("--threads", load.jobs), ("--tree-jobs", tree.jobs), ("--tree-jobs", tree.geometry_jobs)];
    match jobs.into_iter().find(|(_, jobs)| *jobs > MAX_THREADS) {
        Some((option, jobs)) => Err(too_many(option, jobs)),
        None => Ok(()),
    }
}

fn too_many(option: &str, threads: usize) -> Error {
    Error::input(format!("{option} {threads}: expected at most {MAX_THREADS}"))
}
