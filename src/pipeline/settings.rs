//! What a session is asked to do, with every choice made.

use crate::flight::FlightOptions;
use crate::output::OutputRequest;
use crate::pulse::PhysicsOptions;
use crate::scene::LoadOptions;
use crate::schedule::{Policy, Schedule};
use crate::survey::Survey;
use crate::tree::BuildOptions;
use std::num::NonZero;
use std::thread::available_parallelism;
use std::time::Duration;

/// Pulses per chunk: enough to make the cost of the queues negligible, few enough to keep all threads busy on short legs.
pub const DEFAULT_CHUNK_SIZE: u32 = 1024;

/// Chunks that may wait for each worker.
pub const DEFAULT_WAREHOUSE_FACTOR: usize = 4;

/// How long points of a live trajectory wait for others.
pub const DEFAULT_LATENCY: Duration = Duration::from_millis(250);

/// Settings of a [`Session`](super::Session). Nothing in the session reads the command line, the environment or the clock.
#[derive(Clone, Debug)]
pub struct Settings {
    /// Legs, platform, scanner and the description of the scene.
    pub survey: Survey,
    /// Warnings end the session as errors.
    pub strict: bool,
    /// How the scene is loaded.
    pub load: LoadOptions,
    /// How trees are built.
    pub tree: BuildOptions,
    /// Clock, noise of the platform, errors of navigation.
    pub flight: FlightOptions,
    /// How echoes are computed.
    pub physics: PhysicsOptions,
    /// Threads, and how pulses are distributed to them.
    pub schedule: Schedule,
    /// How long points of a live trajectory may wait for others.
    pub max_latency: Duration,
}

impl Settings {
    /// The survey's own seed, or 0, the physics of HELIOS++, all cores.
    pub fn new(survey: Survey) -> Settings {
        let seed = survey.seed.unwrap_or(0);
        let wavelength = survey.scanner.devices.first().map(|device| device.beam.wavelength);
        let usual = LoadOptions::default();
        Settings {
            strict: false,
            load: LoadOptions { wavelength_nm: wavelength.unwrap_or(usual.wavelength_nm), seed, ..usual },
            tree: BuildOptions::default(),
            flight: FlightOptions { seed, ..FlightOptions::default() },
            physics: PhysicsOptions { seed, ..PhysicsOptions::helios() },
            schedule: Schedule {
                threads: available_parallelism().map_or(1, NonZero::get),
                policy: Policy::Warehouse { size: DEFAULT_CHUNK_SIZE, factor: DEFAULT_WAREHOUSE_FACTOR },
                leg_barrier: false,
            },
            max_latency: DEFAULT_LATENCY,
            survey,
        }
    }

    /// The options of the physics, with everything recorded that the outputs need.
    pub(super) fn physics_for(&self, outputs: &OutputRequest) -> PhysicsOptions {
        let has_truth = outputs.columns.iter().flatten().any(|column| column.is_truth());
        let physics = self.physics;
        PhysicsOptions {
            record_waveforms: physics.record_waveforms || outputs.waveforms || outputs.las.packets.is_some(),
            record_pulses: physics.record_pulses || outputs.pulses || outputs.misses,
            record_truth: physics.record_truth || has_truth,
            ..physics
        }
    }
}
