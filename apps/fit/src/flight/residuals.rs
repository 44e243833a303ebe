//! Differences between the footprints of a model and the pulses of a recording, and their weights.

use super::model::Posed;
use super::pulses::Pulse;
use super::recording::Recording;
use vlscan_geom::DVec3;

/// Residuals beyond this many standard deviations get less weight (Huber).
const HUBER: f64 = 2.5;

/// Number of residuals of a pulse.
pub const RESIDUALS: usize = 5;

/// Residuals of a pulse whose beam is in the axes of the scanner: on the ground (m), of the scan angle (rad),
/// and at the height of its last return (m), if it has several.
///
/// The residual of an angle that is rounded to degrees is its distance from the interval of the rounding.
pub fn residuals(recording: &Recording, model: &Posed, beam: DVec3, pulse: &Pulse) -> [f64; RESIDUALS] {
    let at = model.footprint(beam, pulse.time, pulse.position.z);
    let mut angle = at.angle - pulse.angle;
    if recording.has_whole_angles() {
        angle -= angle.clamp(-0.5 * recording.angle_step, 0.5 * recording.angle_step);
    }
    let (x, y) = pulse.last.map_or((0.0, 0.0), |last| {
        let at = model.footprint(beam, pulse.time, last.z);
        (at.x - last.x, at.y - last.y)
    });
    [at.x - pulse.position.x, at.y - pulse.position.y, angle, x, y]
}

/// The beam of a pulse in the axes of the scanner.
pub fn beam_of(model: &Posed, pulse: &Pulse) -> DVec3 {
    model.beam(usize::from(pulse.channel), pulse.time)
}

/// Weight of a residual of `ratio` standard deviations, and its share of the cost.
pub fn huber(ratio: f64) -> (f64, f64) {
    let size = ratio.abs();
    if size <= HUBER { (1.0, ratio * ratio) } else { (HUBER / size, HUBER * (2.0 * size - HUBER)) }
}

/// Standard deviations of the residuals of a pulse.
pub fn scales(ground: f64, angle: f64) -> [f64; RESIDUALS] {
    [ground, ground, angle, ground, ground]
}
