//! Forecast of the cost and the points of a run: [`Session::dry_run`].
//!
//! | file | what it does |
//! |---|---|
//! | `timeline` | legs, duration, pulses; states along the flight |
//! | `sample` | a few chunks of each stratum, measured and written as the run would |
//! | `area` | the ground that is covered |
//! | `spacing` | footprint, distance of points along and across |
//! | `coverage` | densities, strips, gaps, incidence and occlusion in cells |
//! | `sampler` | the sample that is measured for it |
//! | `blocks`, `cells` | the periods of the scan pattern that are measured; their returns in cells |
//! | `sweeps` | the beams of a period that are measured where they turn steadily |
//! | `beams` | beams beside those that are measured, and the edge of the scene |
//!
//! Points, sizes and time are those of the sample in proportion to the pulses, with twice the standard error
//! of the mean over the strata as uncertainty.

mod area;
mod beams;
mod blocks;
mod cells;
mod coverage;
mod sample;
mod sampler;
mod spacing;
mod sweeps;
mod timeline;

pub use coverage::{CoverageBand, CoverageMap};

use super::pass::RunContext;
use super::run::Epochs;
use super::session::Session;
use crate::output::{
    FileKind, FileSummary, NoOffload, OutputContext, OutputPlan, OutputRequest, OutputSummary, Target,
};
use sample::{Sample, Stratum};
use serde::Serialize;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Instant;
use timeline::{LegTime, Timeline};
use vlscan_base::diag::{Notice, ProblemKind};
use vlscan_base::error::{Error, Result};
use vlscan_base::machine;
use vlscan_geom::DVec3;
use vlscan_lidar::flight::{FlightOptions, FlightPlan};
use vlscan_survey::{PlatformKind, Survey};

/// Positions of a leg in a sketch.
const PLACES_PER_TRACK: u32 = 33;
/// Steps per second of the coarse clock that long flights are timed with, Hz.
const COARSE_FREQUENCY: u32 = 200;
/// Bytes of a sample of the trajectory as text, about.
const BYTES_PER_POSE: f64 = 95.0;
/// Uncertainty of times in addition to the sample's: variation of the machine's speed.
const MIN_TIME_UNCERTAINTY: f64 = 0.1;

/// A number with its relative uncertainty (two standard errors).
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Estimate {
    /// The number itself.
    pub value: f64,
    /// Fraction of the value.
    pub uncertainty: f64,
}

/// A leg of the survey.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct LegEstimate {
    /// Number of the leg in the survey.
    pub leg: u32,
    /// Duration, s.
    pub seconds: f64,
    /// Number of pulses of all devices.
    pub pulses: f64,
    /// `None` where the sample has no pulse of the leg.
    pub points: Option<f64>,
    /// Mean range of first echoes, m.
    pub range_m: Option<f64>,
    /// Diameter of the beam there, m.
    pub footprint_m: Option<f64>,
    /// Distance of points along the flight, of scan lines of a static scanner, m.
    pub along_m: Option<f64>,
    /// Distance of successive points, m.
    pub across_m: Option<f64>,
}

/// A file that the run will write.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FileEstimate {
    /// Path, or a description of the file.
    pub name: String,
    /// Kind of its records: points, waveforms, pulses, poses.
    pub content: &'static str,
    /// Size, bytes.
    pub bytes: f64,
}

/// Pulses that the run will not measure.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Missed {
    /// Fraction of the pulses without an echo.
    pub pulses: f64,
    /// Fraction of the pulses that miss the scene's box.
    pub beside_scene: f64,
    /// Fraction of the pulses for which the scene's box is nearer or farther than the scanner measures.
    pub out_of_range: f64,
    /// Fraction of the scene's box, seen from above, that no swath covers.
    pub area: f64,
    /// Legs that fire and of which the sample has no point.
    pub legs: Vec<u32>,
}

/// The time of the run on this machine, s.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct TimeEstimate {
    /// Loading of scene and tree, measured.
    pub loading_s: f64,
    /// From the first pulse to the last byte.
    pub simulation_s: f64,
    /// All of it.
    pub total_s: f64,
    /// Fraction of the total (two standard errors).
    pub uncertainty: f64,
    /// Number of threads of the run.
    pub threads: usize,
}

/// Forecast of the cost and the results of a run.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct DryRunReport {
    /// Legs that take time, in the order of the survey.
    pub legs: Vec<LegEstimate>,
    /// Number of times that the survey is flown, once for each state of a scene with swapped parts.
    pub epochs: u32,
    /// Time of the survey, s.
    pub duration_s: f64,
    /// Number of pulses, over all epochs.
    pub pulses: f64,
    /// True if the pulses were counted and not estimated.
    pub pulses_are_counted: bool,
    /// Number of points, over all epochs.
    pub points: Estimate,
    /// Ground within the scene's box that swaths cover, m².
    pub covered_m2: f64,
    /// Points per m² of the covered ground.
    pub points_per_m2: Option<f64>,
    /// Pulses with echoes per m² of the covered ground.
    pub pulses_per_m2: Option<f64>,
    /// The files that the run writes.
    pub files: Vec<FileEstimate>,
    /// The most memory that loading and sample have needed, bytes.
    pub memory_bytes: u64,
    /// How long the run takes.
    pub time: TimeEstimate,
    /// Pulses that the run does not measure.
    pub missed: Missed,
    /// Pulses of the sample.
    pub sampled_pulses: f64,
}

/// Course and coverage of a survey, world coordinates, m.
#[derive(Clone, Debug, Default)]
pub struct FlightCoverage {
    /// Positions along each leg, by its number in the survey.
    pub tracks: Vec<(u32, Vec<DVec3>)>,
    /// Strips and sectors of ground by leg, four corners each; only x and y of corners count.
    pub swaths: Vec<(u32, [DVec3; 4])>,
    /// Number of pulses of legs; a leg may have several numbers, which add up.
    pub pulses: Vec<(u32, f64)>,
}

impl Session {
    /// Flies a sample of the survey and estimates what [`Session::run`] will do. Outputs are checked and not
    /// touched: the sample is written to a folder that is removed. `started` is when the program began to
    /// load the scene.
    ///
    /// # Errors
    /// As for [`Session::run`].
    pub fn dry_run(
        &mut self,
        outputs: &OutputRequest,
        started: Instant,
        control: RunContext<'_>,
    ) -> Result<DryRunReport> {
        self.try_flight(outputs, None, started, control).map(|(report, _)| report)
    }

    /// Flies the sample of [`Session::dry_run`], and another one for the coverage in square cells of `side`
    /// m, as [`Session::coverage`] does.
    ///
    /// # Errors
    /// As for [`Session::dry_run`] and [`Session::coverage`].
    pub fn dry_run_with_coverage(
        &mut self,
        outputs: &OutputRequest,
        side: f64,
        started: Instant,
        control: RunContext<'_>,
    ) -> Result<(DryRunReport, CoverageMap)> {
        let (report, map) = self.try_flight(outputs, Some(side), started, control)?;
        Ok((report, map.unwrap_or_default()))
    }

    /// Flies a sample of the survey, and another one for the coverage in cells of a side, m, if one is given.
    fn try_flight(
        &mut self,
        outputs: &OutputRequest,
        side: Option<f64>,
        started: Instant,
        control: RunContext<'_>,
    ) -> Result<(DryRunReport, Option<CoverageMap>)> {
        side.map_or(Ok(()), |side| self.check_cells(side))?;
        let (flight, _) = self.plan_checked_flight(control.stop)?;
        let outputs = &self.complete(outputs.clone());
        let context = self.output_context();
        self.check_outputs(outputs, &context)?;
        let loading_s = started.elapsed().as_secs_f64();
        let (timeline, sample, summary) = self.sample_flight(&flight, outputs, &context, control)?;
        let seen =
            Observations { session: self, flight: &flight, timeline: &timeline, sample: &sample, outputs };
        // Made first, because the run does not need the memory of the coverage.
        let report = seen.forecast(&summary, loading_s, control);
        let measure = |side| self.measure_coverage(&flight, &timeline, side, control);
        let map = side.map(measure).transpose()?;
        Ok((report, map))
    }

    /// Checks the outputs of the run. Existing files cause a note and no error, since a dry run does not
    /// write them.
    fn check_outputs(&self, outputs: &OutputRequest, context: &OutputContext) -> Result<()> {
        match self.check_output(outputs.clone(), context) {
            Err(Error::Input(problems)) if problems.has(ProblemKind::Exists) => {
                for problem in problems.items().iter().filter(|item| item.kind == ProblemKind::Exists) {
                    let help = problem.help.as_deref().map_or(String::new(), |help| format!("; {help}"));
                    self.notify(Notice::Note(format!("the run would be refused: {}{help}", problem.message)));
                }
                self.check_output(OutputRequest { force: true, ..outputs.clone() }, context)
            }
            checked => checked,
        }
    }

    /// Measures a sample of the flight over the first epoch, whose outputs are removed.
    fn sample_flight(
        &mut self,
        flight: &FlightPlan,
        outputs: &OutputRequest,
        context: &OutputContext,
        control: RunContext<'_>,
    ) -> Result<(Timeline, Sample, [OutputSummary; 2])> {
        let timeline = self.timeline(flight, control)?;
        let folder = tempfile::tempdir().map_err(|e| Error::io("create", std::env::temp_dir(), e))?;
        let sinks = outputs.sinks.iter().enumerate().map(|(i, (_, format))| {
            (Target::File(folder.path().join(format!("{i}.{}", format.extension()))), *format)
        });
        let output = OutputRequest {
            sinks: sinks.collect(),
            trajectory: None,
            companions: Vec::new(),
            counts_parts: false,
            division: None,
            tables: Vec::new(),
            inputs: Vec::new(),
            force: true,
            ..outputs.clone()
        };
        let options = self.settings().physics_for(outputs);
        let epochs = Epochs { range: 0..=0, options, is_checked: false, has_legs: true };
        let output = Arc::new(OutputPlan::new(output, context)?);
        // Headers do not grow with the points.
        let empty = output.open(Arc::new(NoOffload))?.finish()?;
        let mut sample = Sample::default();
        let report = self.run_epochs(output, epochs, control, &AtomicBool::new(true), |_, pass, _, _| {
            let (ended, measured) = sample::measure(pass, flight, &timeline)?;
            sample = measured;
            Ok(ended)
        })?;
        if report.interrupted {
            return Err(Error::Interrupted);
        }
        Ok((timeline, sample, [empty, report.summary]))
    }

    /// Course and coverage of the survey, from a sample of the flight.
    ///
    /// # Errors
    /// As for [`Session::run`].
    pub fn sketch(&mut self, control: RunContext<'_>) -> Result<FlightCoverage> {
        self.enter_epoch(0, control.stop)?;
        let flight = self.plan_flight()?;
        let context = self.output_context();
        let nothing = OutputRequest::default();
        let (timeline, sample, _) = self.sample_flight(&flight, &nothing, &context, control)?;
        let shift = self.scene().shift;
        let mut tracks: Vec<(u32, Vec<DVec3>)> = Vec::new();
        let planned = flight.planned_positions(PLACES_PER_TRACK).into_iter().map(|p| (p.leg, p.position));
        let seen = sample.strata.iter().map(|stratum| (stratum.leg, stratum.view.origin));
        let places: Vec<(u32, DVec3)> = if flight.is_stream() { seen.collect() } else { planned.collect() };
        for (leg, position) in places {
            match tracks.last_mut().filter(|(last, _)| *last == leg) {
                Some((_, track)) => track.push(position + shift),
                None => tracks.push((leg, vec![position + shift])),
            }
        }
        let quads = area::swaths(&flight, &sample.strata).into_iter();
        let swaths = quads.map(|(leg, quad)| (leg, quad.map(|corner| corner + shift))).collect();
        let pulses = timeline.legs.iter().map(|leg| (leg.clock.number, leg.pulses)).collect();
        Ok(FlightCoverage { tracks, swaths, pulses })
    }

    /// Legs, duration and pulses of the flight.
    fn timeline(&self, flight: &FlightPlan, control: RunContext<'_>) -> Result<Timeline> {
        if let PlatformKind::Stream(stream) = &self.survey().platform.kind {
            let Some(mut poses) = self.open_poses()? else { return Ok(Timeline::default()) };
            return timeline::follow(flight, &mut poses, stream.max_gap, control.stop);
        }
        if let Some(timeline) = timeline::step_through(flight, control.stop)? {
            return Ok(timeline);
        }
        if control.stop.is_requested() {
            return Err(Error::Interrupted);
        }
        let mut coarse: Survey = self.survey().clone();
        for leg in &mut coarse.legs {
            (leg.scanner.pulse_freq, leg.scanner.pulse_times) = (COARSE_FREQUENCY, None);
            leg.scanner.active = false;
        }
        let (scene, options) = (self.scene(), &self.settings().flight);
        let ground = |x, y| scene.ground_height(x, y);
        let (mut coarse, _) =
            FlightPlan::new(&coarse, scene.shift, &ground, &FlightOptions { ..options.clone() })?;
        coarse.end_as(flight);
        timeline::estimate(flight, &coarse, control.stop)
    }
}

/// Everything that a forecast is made from.
struct Observations<'a> {
    session: &'a Session,
    flight: &'a FlightPlan,
    timeline: &'a Timeline,
    sample: &'a Sample,
    outputs: &'a OutputRequest,
}

impl Observations<'_> {
    fn forecast(
        &self,
        written: &[OutputSummary; 2],
        loading_s: f64,
        control: RunContext<'_>,
    ) -> DryRunReport {
        let Observations { session, timeline, sample, .. } = self;
        let epochs = f64::from(session.epochs());
        let pulses = timeline.pulses() * epochs;
        let sum = |of: fn(&Stratum) -> f64| sample.strata.iter().map(of).sum::<f64>();
        let sampled_pulses = sum(|s| s.pulses);
        let scale = if sampled_pulses > 0.0 { pulses / sampled_pulses } else { 0.0 };
        // What has been measured completely is certain.
        let share_left = (1.0 - sampled_pulses / timeline.pulses().max(1.0)).max(0.0).sqrt();
        let uncertainty = |of: fn(&Stratum) -> f64| share_left * relative_error(&sample.strata, of);
        let misses = self.outputs.cloud.misses;
        let points = Estimate {
            value: sum(if misses { |s| s.points + s.pulses - s.hits } else { |s| s.points }) * scale,
            uncertainty: uncertainty(|s| s.points),
        };
        let quads = area::swaths(self.flight, &sample.strata);
        let coverage = area::coverage(&quads, &session.scene().bounds);
        let per_area = |value: f64| (coverage.covered > 0.0).then(|| value / epochs / coverage.covered);
        let [before, simulated] = sample.seconds;
        let simulation_s = simulated * scale;
        let total_s = loading_s + before + simulation_s;
        let share = if total_s > 0.0 { simulation_s / total_s } else { 0.0 };
        let time = TimeEstimate {
            loading_s,
            simulation_s,
            total_s,
            uncertainty: (share * uncertainty(|s| s.seconds)).hypot(MIN_TIME_UNCERTAINTY),
            threads: session.settings().schedule.threads,
        };
        let legs = self.legs();
        let beam_counts = control.progress.beam_counts().sum;
        let of_sampled = |count: u64| {
            if beam_counts.sampled > 0 { count as f64 / beam_counts.sampled as f64 } else { 0.0 }
        };
        let is_empty = |leg: &&LegEstimate| leg.pulses > 0.0 && leg.points == Some(0.0);
        let missed = Missed {
            pulses: if sampled_pulses > 0.0 { 1.0 - sum(|s| s.hits) / sampled_pulses } else { 0.0 },
            beside_scene: of_sampled(beam_counts.sampled - beam_counts.towards),
            out_of_range: of_sampled(beam_counts.towards - beam_counts.within),
            area: if coverage.scene > 0.0 { 1.0 - coverage.covered / coverage.scene } else { 0.0 },
            legs: legs.iter().filter(is_empty).map(|leg| leg.leg).collect(),
        };
        let memory = session.loaded().map_or(0, |loaded| loaded.facts().memory);
        DryRunReport {
            epochs: session.epochs(),
            duration_s: timeline.seconds() * epochs,
            pulses,
            pulses_are_counted: timeline.is_exact,
            points_per_m2: per_area(points.value),
            pulses_per_m2: per_area(sum(|s| s.hits) * scale),
            points,
            covered_m2: coverage.covered,
            files: self.files(written, scale),
            memory_bytes: machine::peak_memory().unwrap_or(memory),
            time,
            missed,
            sampled_pulses,
            legs,
        }
    }

    /// The survey's legs that take time, added ones with those that they belong to.
    fn legs(&self) -> Vec<LegEstimate> {
        let mut legs: Vec<LegEstimate> = Vec::new();
        for LegTime { clock, seconds, pulses } in &self.timeline.legs {
            match legs.last_mut().filter(|last| last.leg == clock.number) {
                Some(last) => (last.seconds, last.pulses) = (last.seconds + seconds, last.pulses + pulses),
                None => {
                    let (leg, seconds, pulses) = (clock.number, *seconds, *pulses);
                    legs.push(LegEstimate { leg, seconds, pulses, ..LegEstimate::default() });
                }
            }
        }
        legs.retain(|leg| leg.seconds > 0.0);
        let shares = self.sample.strata.chunk_by(|a, b| a.leg == b.leg);
        for strata in shares {
            let Some(leg) = legs.iter_mut().find(|leg| leg.leg == strata[0].leg) else { continue };
            let (points, pulses) =
                strata.iter().fold((0.0, 0.0), |sum, s| (sum.0 + s.points, sum.1 + s.pulses));
            leg.points = Some(points / pulses * leg.pulses);
            let found = spacing::of_leg(self.session.survey(), leg.leg, strata);
            leg.range_m = found.range;
            (leg.footprint_m, leg.along_m, leg.across_m) = (found.footprint, found.along, found.across);
        }
        legs
    }

    /// The files with their sizes, in proportion to those of the sample.
    fn files(&self, [empty, written]: &[OutputSummary; 2], scale: f64) -> Vec<FileEstimate> {
        // A file of the sample, scaled but for what an empty one has already.
        let bytes_of = |is_selected: &dyn Fn(&FileSummary) -> bool| {
            let sum = |of: &OutputSummary| {
                of.files.iter().filter(|f| is_selected(f)).map(|f| f.bytes as f64).sum::<f64>()
            };
            let (fixed, all) = (sum(empty), sum(written));
            fixed + (all - fixed).max(0.0) * scale
        };
        let is_points_of = |i: usize, file: &FileSummary| {
            let path = file.path.as_deref().and_then(Path::file_name).unwrap_or_default();
            let name = path.to_string_lossy();
            file.kind == FileKind::Points && name.split(['.', '_']).next() == Some(i.to_string().as_str())
        };
        let mut files = Vec::new();
        for (i, (target, format)) in self.outputs.sinks.iter().enumerate() {
            let name = match target {
                Target::Stdout => "standard output".to_owned(),
                Target::File(path) => path.display().to_string(),
                Target::Directory(path) | Target::Helios(path) => {
                    format!("{}/…/*.{}", path.display(), format.extension())
                }
            };
            let bytes = bytes_of(&|file| is_points_of(i, file));
            files.push(FileEstimate { name, content: "points", bytes });
        }
        for (kind, content) in [
            (FileKind::Waveforms, "waveforms"),
            (FileKind::Pulses, "pulses"),
            (FileKind::Packets, "waveform packets"),
        ] {
            if written.files.iter().any(|file| file.kind == kind) {
                let name = format!("{content} beside the points");
                files.push(FileEstimate { name, content, bytes: bytes_of(&|file| file.kind == kind) });
            }
        }
        let is_helios = |(target, _): &(Target, _)| matches!(target, Target::Helios(_));
        let poses: f64 = self.timeline.legs.iter().map(LegTime::poses).sum();
        if poses > 0.0 && (self.outputs.trajectory.is_some() || self.outputs.sinks.iter().any(is_helios)) {
            let bytes = poses * BYTES_PER_POSE * f64::from(self.session.epochs());
            files.push(FileEstimate { name: "the trajectory".to_owned(), content: "poses", bytes });
        }
        files
    }
}

/// Twice the standard error of the mean of a rate per pulse, as a fraction of the mean.
fn relative_error(strata: &[Stratum], of: fn(&Stratum) -> f64) -> f64 {
    let n = strata.len() as f64;
    if n < 2.0 {
        return 1.0;
    }
    let rates = strata.iter().map(|s| of(s) / s.pulses);
    let mean = rates.clone().sum::<f64>() / n;
    let variance = rates.map(|rate| (rate - mean).powi(2)).sum::<f64>() / (n - 1.0);
    if mean > 0.0 { 2.0 * (variance / n).sqrt() / mean } else { 0.0 }
}
