//! A flight and its scanner, estimated from a recorded cloud with GPS times and scan angles.
//!
//! The beam of a model (a platform on a parabola, a mirror that turns or swings) is intersected with the
//! height of each recorded point. Least squares match the intersection with the position of the point, and
//! the angle across the track with that of the file. The attitude of each line is estimated with the
//! parameters, as a random walk. The height of the flight follows from the scan angles.
//!
//! | file | what it does |
//! |---|---|
//! | `flight_lines`, `straight` | the flight lines of a cloud, without turns |
//! | `points`, `windows` | the points of one flight line, or those of some windows of time |
//! | `grouping`, `pulses` | points as pulses, in little memory |
//! | `search` | order statistics of values that are not kept |
//! | `recording`, `outliers` | pulses of one flight line, cut to lines of the scanner; noise |
//! | `turning` | scanners that stand and turn, which are rejected |
//! | `sweeps` | lines that no gap divides: sweeps of a mirror that swings, full turns |
//! | `phases`, `level` | rates and phases of what recurs; straight flights and their height |
//! | `guess`, `cones`, `lines`, `facets` | first guesses for each kind of mirror |
//! | `model`, `mirror`, `parameters` | intersection of the beam of a flown scanner with the ground |
//! | `sections`, `residuals`, `equations`, `solve`, `solution` | least squares for parameters and attitudes |
//! | `choice` | the kind of mirror that explains the points |
//! | `rate`, `repeat` | when pulses leave: by the place of the mirror, and patterns that repeat |
//! | `finer_times` | times by the positions of points |
//! | `clock` | the pulses of thinned clouds |
//! | `ground` | noise of ranges |
//! | `trend` | changes of the pitch that look like another speed |
//! | `doubts` | estimates that are not plausible, which are left out |
//! | `error` | reasons why no flight is fitted |
//! | `report`, `write`, `pipeline` | figures with uncertainties; written files; text of the pipeline file |

mod choice;
mod clock;
mod cones;
mod doubts;
mod equations;
mod error;
mod facets;
mod finer_times;
mod flight_lines;
mod ground;
mod grouping;
mod guess;
mod level;
mod lines;
mod mirror;
mod model;
mod outliers;
mod parameters;
mod phases;
mod pipeline;
mod points;
mod pulses;
mod rate;
mod recording;
mod repeat;
mod report;
mod residuals;
mod search;
mod sections;
mod solution;
mod solve;
mod straight;
mod sweeps;
#[cfg(test)]
mod tests;
mod trend;
mod turning;
mod windows;
mod write;

pub use error::{FlightError, Misfit};
pub use flight_lines::FlightLineName;
pub use ground::RangeScatter;
pub use mirror::{Mirror, MirrorParameters};
pub use model::{Attitude, Footprint, Model};
pub use parameters::{Channel, Parameters};
pub use pulses::{Pulse, Pulses};
pub use rate::{MAX_LOST_SHARE, PulseRate};
pub use recording::Recording;
pub use report::{Figure, json, table};
pub use solution::Solution;
pub(crate) use turning::steady_turn;
pub use write::FlightFiles;

use crate::limit::DEFAULT_MEMORY;
use choice::{NoSolution, best_solution};
use std::path::{Path, PathBuf};
use vlscan_base::diag::{Diagnostics, Place};
use vlscan_base::error::{Error, Result};
use vlscan_geom::degrees;

/// Maximum time by which a flight is extended beyond its recording, s.
const MAX_EXTENSION: f64 = 86_400.0;
/// Residual above which a flight is doubtful, m on the ground.
const DOUBTFUL_RESIDUAL: f64 = 0.15;
/// Relative deviation of the height above which a warning is issued.
const DOUBTFUL_SCALE: f64 = 0.01;
/// Relative difference of the bounds of a half angle above which a warning is issued.
const DOUBTFUL_SWEEP: f64 = 0.03;

/// Choices of a fit.
#[derive(Clone, Debug, Default)]
pub struct FlightRequest {
    /// The flight line; if missing, the one with the most points.
    pub flight_line: Option<FlightLineName>,
    /// Time by which the written flight is extended after the recording, s.
    pub extend: f64,
    /// Memory that the points may take, bytes; 1 GiB by default. Of a flight line with more points the scan
    /// lines of some seconds are fitted.
    pub max_memory: Option<u64>,
}

/// A flight with its scanner.
#[derive(Clone, Debug)]
pub struct FlightFit {
    /// The recorded cloud.
    pub cloud: PathBuf,
    /// The pulses.
    pub recording: Recording,
    /// Model and attitudes.
    pub solution: Solution,
    /// When pulses leave.
    pub rate: PulseRate,
    /// Standard deviation of ranges, with the roughness of the ground.
    pub noise: Option<RangeScatter>,
    /// Standard deviation of the speed by steady changes of the pitch that the points do not show, m/s.
    pub speed_by_pitch: f64,
    /// Time by which the written flight is extended after the recording, s: straight on, with the last
    /// attitude.
    pub extend: f64,
}

/// Fits a flight and its scanner to one flight line of a cloud. Warnings are added to `found`.
///
/// # Errors
/// [`Error::Io`]; [`Error::Input`] for clouds without GPS times or scan angles, with too few pulses, or with
/// pulses that are neither on the circles of a cone nor on lines across a flight.
pub fn fit_flight(path: &Path, request: &FlightRequest, found: &mut Diagnostics) -> Result<FlightFit> {
    if !(0.0..=MAX_EXTENSION).contains(&request.extend) {
        let message = format!("--extend {}: expected seconds from 0 to {MAX_EXTENSION}", request.extend);
        return Err(Error::input(message));
    }
    let max_memory = request.max_memory.unwrap_or(DEFAULT_MEMORY);
    let mut recording = Recording::read(path, request.flight_line, max_memory, found)?;
    reject_tripod(path, &recording)?;
    if let Some(lines) = sweeps::of_undivided(&recording) {
        recording.lines = lines;
    }
    recording.leave_out_cut_lines();
    lines::find_channels(&mut recording);
    let solution = match best_solution(&recording) {
        Ok(solution) => solution,
        Err(failed) => match best_turned_solution(&mut recording, &failed) {
            Some(solution) => {
                let message = "scan angles are positive to the left of the flight, against the LAS \
                               specification; their sign is reversed";
                found.warn(Some(Place::of_file(path)), message);
                solution
            }
            None => return Err(no_flight(path, &recording, failed.reason)),
        },
    };
    let rate = PulseRate::of(&recording, &solution);
    if !rate.is_plausible() {
        let reason = format!("needs {:.0} pulses a second", rate.mean);
        let misfit = Misfit { mirror: solution.model.mirror.name().to_string(), reason };
        return Err(no_flight(path, &recording, FlightError::Unexplained(vec![misfit])));
    }
    let noise = ground::range_noise(&recording, &solution);
    let speed_by_pitch = trend::speed_deviation(&recording, &solution);
    let (cloud, extend) = (path.to_path_buf(), request.extend);
    let fit = FlightFit { cloud, recording, solution, rate, noise, speed_by_pitch, extend };
    fit.warn_of_fit(found);
    fit.warn_of_rate(found);
    fit.warn_of_doubts(found);
    Ok(fit)
}

/// The error for a scanner that turns at a fixed position, or a flight with turns.
fn reject_tripod(path: &Path, recording: &Recording) -> Result<()> {
    let Some(turn) = turning::steady_turn(recording) else { return Ok(()) };
    let message = format!(
        "{}: the scan lines turn steadily by {:.0}° in {:.0} s, as those of a scanner on a tripod or of a \
         platform that turns do: this is no flight line",
        path.display(),
        degrees(turn),
        recording.duration()
    );
    let help = "a flight and its scanner are estimated from a straight flight line; the straight parts of a \
                flight with turns are found if they last 7 s, and here is none. For a scanner on a tripod, \
                --still-at X,Y,Z writes its scan pattern instead";
    Err(Error::input_with_help(message, help))
}

/// The best solution with scan angles that some files count to the left; `None` if a flight that is not
/// possible otherwise meets the angles as they are. The sign of the angles stays reversed if there is one.
fn best_turned_solution(recording: &mut Recording, failed: &NoSolution) -> Option<Solution> {
    if failed.has_angles {
        return None;
    }
    recording.pulses.reverse_angles();
    let solution = best_solution(recording).ok();
    if solution.is_none() {
        recording.pulses.reverse_angles();
    }
    solution
}

fn no_flight(path: &Path, recording: &Recording, reason: FlightError) -> Error {
    let name = path.display();
    let message = format!(
        "{name}: no flight matches these points: {reason}; the cloud has {}",
        recording.description()
    );
    let mut problems = Diagnostics::default();
    problems.error(None, message).because_of(reason).help(
        "a fit needs all pulses of a straight flight line, not thinned, from a cone (also an elliptic one), \
         a polygon mirror (also one whose facets differ by their tilt) or an oscillating mirror, not from \
         prisms or a sensor that spins, with scan angles in degrees that change across the track, and times \
         in seconds",
    );
    Error::Input(Box::new(problems))
}

impl FlightFit {
    /// Warns of a flight whose position, height or angles are doubtful.
    fn warn_of_fit(&self, found: &mut Diagnostics) {
        let (recording, solution) = (&self.recording, &self.solution);
        if solution.residual > DOUBTFUL_RESIDUAL {
            let message = format!(
                "the fitted flight misses its points by {:.2} m on the ground: its estimates are unreliable",
                solution.residual
            );
            found.warn(Some(Place::of_file(&self.cloud)), message);
        }
        let share = solution.scale_deviation(recording);
        if share > DOUBTFUL_SCALE {
            let rounded = if recording.has_whole_angles() { ", rounded to degrees," } else { "" };
            let message = format!(
                "the scan angles{rounded} change so little across these points (standard deviation {:.1}°) \
                 that height and angles of the mirror are known to {:.0} % only",
                degrees(recording.angle_spread()),
                100.0 * share
            );
            found.warn(Some(Place::of_file(&self.cloud)), message).help("fit a wider part of the swath");
        }
        if let Some(message) = self.doubt_of_speed() {
            let help = "fit a line over relief, houses or trees, or replace the trajectory by a measured one";
            found.warn(Some(Place::of_file(&self.cloud)), message).help(help);
        }
        if let Some(message) = self.doubt_of_sweeps() {
            found.warn(Some(Place::of_file(&self.cloud)), message).help("fit a wider part of the swath");
        }
    }

    /// Bounds of the half angle of an oscillating mirror as text, if they differ.
    fn doubt_of_sweeps(&self) -> Option<String> {
        let [smallest, largest] = self.half_angles();
        (largest - smallest > DOUBTFUL_SWEEP * largest).then(|| {
            format!(
                "the reversals of the mirror are not in the cloud: its half angle is between {:.1} and \
                 {:.1}°, and the larger one is written",
                degrees(smallest),
                degrees(largest)
            )
        })
    }

    /// Warns of a pulse rate or a range noise that is doubtful.
    fn warn_of_rate(&self, found: &mut Diagnostics) {
        let rate = &self.rate;
        if let Some(step) = rate.coarse_step {
            let message = format!(
                "GPS times have steps of {:.3} µs, too coarse for the intervals of pulses: the pulse rate \
                 of {:.0} per second is doubtful",
                1e6 * step,
                rate.mean
            );
            found.warn(Some(Place::of_file(&self.cloud)), message);
        }
        if rate.lost > MAX_LOST_SHARE {
            let message = format!(
                "{:.0} % of the pulses have no point: the cloud is thinned, or its ground reflects little; \
                 no dropout_rate is written, and if neighbouring pulses are hardly ever in the cloud the \
                 pulse rate is too low",
                100.0 * rate.lost
            );
            found.warn(Some(Place::of_file(&self.cloud)), message);
        }
        if self.noise.is_none() {
            let message = "too few ground points lie close together to estimate the range noise";
            found.warn(Some(Place::of_file(&self.cloud)), message);
        }
    }
}
