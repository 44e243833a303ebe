//! The flight alone: [`emit`] flies a survey and writes its poses or pulses, as input of other commands.

use super::chunk::{Chunk, produce};
use super::pass::RunContext;
use super::progress::Progress;
use std::io::Write;
use std::sync::Arc;
use vlscan_base::error::{Error, Result};
use vlscan_geom::DVec3;
use vlscan_lidar::flight::{FlightPlan, FlightSink, FlightState, PoseSample, Pulse};
use vlscan_lidar::platform::PoseReader;
use vlscan_survey::Survey;
use vlscan_warehouse::{Collect, Feed, JobQueue, Outcome, Schedule};

/// The flight alone, ready to be written by [`emit`].
pub struct Emission {
    /// The planned flight.
    pub flight: FlightPlan,
    /// World position of the scene frame's origin, m.
    pub shift: DVec3,
    /// Number of times that the survey is flown.
    pub epochs: u32,
    /// Poses of a streamed platform, as they arrive.
    pub poses: Option<PoseReader>,
    /// Threads, and how the flight is divided among them.
    pub schedule: Schedule,
    /// The survey that is flown.
    pub survey: Survey,
}

/// Poses and pulses of a chunk of steps.
#[derive(Debug, Default)]
pub struct Emitted {
    /// Number of the leg in the survey.
    pub leg: u32,
    /// Number of the flight, from 0.
    pub epoch: u32,
    /// Pulses, each with the number of simulation steps before it in its epoch.
    pub pulses: Vec<(Pulse, u64)>,
    /// Samples of the trajectory.
    pub poses: Vec<PoseSample>,
    /// The time that their times count from, s; 0 for times of the week.
    pub time_origin: f64,
    step: u64,
}

impl FlightSink for Emitted {
    fn pulse(&mut self, pulse: impl FnOnce() -> Pulse) {
        self.pulses.push((pulse(), self.step));
    }

    fn pose(&mut self, pose: impl FnOnce() -> PoseSample) {
        self.poses.push(pose());
    }
}

struct Written {
    bytes: Vec<u8>,
    pulses: u64,
    leg: u32,
    done: f64,
}

impl Outcome for Written {
    fn join(&mut self, next: Written) -> Option<Written> {
        self.bytes.extend_from_slice(&next.bytes);
        (self.pulses, self.leg, self.done) = (self.pulses + next.pulses, next.leg, next.done);
        None
    }
}

/// Flies the survey and writes the output of `encode` for each chunk to `out`, in order. Returns `out` when
/// everything is written, or everything before a requested stop.
///
/// # Errors
/// [`Error::ClosedPipe`] when the reader has closed the stream, [`Error::Io`], and the errors of the flight.
pub fn emit<W: Write + Send>(
    emission: Emission,
    control: RunContext<'_>,
    encode: impl Fn(&Emitted, &mut Vec<u8>) + Sync,
    mut out: W,
) -> Result<W> {
    let Emission { flight, epochs, mut poses, schedule, .. } = emission;
    let RunContext { progress, stop, .. } = control;
    let open_outputs = stop.outputs();
    open_outputs.open();
    let flight = &flight;
    let mut state = FlightState::start(flight);
    for epoch in (0..epochs).take_while(|_| !stop.is_requested()) {
        let jobs = Arc::new(JobQueue::new(1));
        if epoch > 0 {
            state.repeat(flight);
        }
        let make_worker = || {
            let mut emitted = Emitted { epoch, ..Emitted::default() };
            let encode = &encode;
            move |chunk: Chunk| {
                replay(flight, &chunk, &mut emitted)?;
                let mut bytes = Vec::new();
                encode(&emitted, &mut bytes);
                let pulses = u64::from(chunk.pulses);
                Ok(Written { bytes, pulses, leg: chunk.leg, done: chunk.done })
            }
        };
        let collector = Append { out, progress };
        let fly =
            |feed: &mut Feed<'_, _, _, _>| produce(flight, None, &mut state, poses.take(), u64::MAX, feed);
        out = vlscan_warehouse::run(schedule, &jobs, stop, control.recorder, make_worker, fly, collector)?;
    }
    Ok(out)
}

/// Replays the chunk's steps.
fn replay(flight: &FlightPlan, chunk: &Chunk, emitted: &mut Emitted) -> Result<()> {
    emitted.pulses.clear();
    emitted.poses.clear();
    emitted.leg = chunk.leg;
    emitted.step = chunk.start.steps();
    let mut state = chunk.start.clone();
    for _ in 0..chunk.steps {
        state.step(flight, emitted)?;
        emitted.step += 1;
    }
    emitted.time_origin = state.time_origin(flight);
    Ok(())
}

struct Append<'a, W> {
    out: W,
    progress: &'a Progress,
}

impl<W: Write + Send> Collect<Written> for Append<'_, W> {
    type Summary = W;
    type Error = Error;

    fn take(&mut self, chunk: Written, more_waiting: bool) -> Result<()> {
        let failed = |e| Error::io("write", "standard output", e);
        self.out.write_all(&chunk.bytes).map_err(failed)?;
        if !more_waiting {
            self.out.flush().map_err(failed)?;
        }
        self.progress.add(chunk.pulses, 0, chunk.leg, chunk.done);
        Ok(())
    }

    fn finish(mut self) -> Result<W> {
        self.out.flush().map_err(|e| Error::io("write", "standard output", e))?;
        Ok(self.out)
    }

    fn cut(self) -> Result<W> {
        self.finish()
    }

    fn abort(self) {}
}
