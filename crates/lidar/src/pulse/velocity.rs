//! Radial velocities of echoes: how fast the way of their light grows.
//!
//! The way of a subray from the instrument to a surface grows by v·d₁ − u·d₀, with the velocities u of the
//! instrument and v of the surface and the directions d₀ and d₁ in which the light leaves the one and arrives
//! at the other. The light of an echo has the mean and the spread of its subrays. Mirrors, panes, water and
//! the air are at rest.

use super::echo::EchoVelocity;
use super::reflections::Reflections;
use super::sources::ReflectionSources;
use super::traced::TracedPulse;
use super::view::SceneView;
use libm::sqrt;
use vlscan_geom::DVec3;
use vlscan_trace::Hits;

/// Radial velocity of return `number` (from 1), or of the reflection `nearest` if it has no subrays. The
/// origin of the pulse has the velocity `origin`, m/s, at `step_rate` simulation steps per second.
#[inline(never)]
pub(super) fn of_return(
    number: u32,
    nearest: usize,
    view: &SceneView,
    (traced, origin, step_rate): (&TracedPulse, DVec3, f64),
    (sources, reflections): (&ReflectionSources, &Reflections),
) -> EchoVelocity {
    let radial = |i: usize| {
        let subray = sources.subray_of(i) as usize;
        let leaving = traced.direction(subray);
        let (at, arriving) = match reflections.end_of(i) {
            Some(end) => (end.surface, end.direction),
            None => (traced.start(subray) + leaving * reflections.ranges()[i], leaving),
        };
        let of_surface = match reflections.primitives()[i] {
            Hits::MISS => DVec3::ZERO,
            primitive => view.velocity(primitive, at) * step_rate,
        };
        of_surface.dot(arriving) - origin.dot(leaving)
    };
    // Relative to the first of them: a single reflection has its velocity exactly and no spread.
    let reference = radial(sources.of_number(number).next().unwrap_or(nearest));
    let (mut light, mut first) = (0.0, 0.0);
    for i in sources.of_number(number) {
        light += reflections.intensities()[i];
        first += reflections.intensities()[i] * (radial(i) - reference);
    }
    if light <= 0.0 || light.is_nan() {
        return EchoVelocity { radial: radial(nearest), spread: 0.0 };
    }
    let mean = first / light;
    let squares = sources.of_number(number).map(|i| {
        let off = radial(i) - reference - mean;
        reflections.intensities()[i] * off * off
    });
    EchoVelocity { radial: reference + mean, spread: sqrt(squares.sum::<f64>() / light) }
}
