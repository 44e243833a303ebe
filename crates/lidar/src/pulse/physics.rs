//! The pulse physics of a survey over a scene.

use super::instrument::InstrumentTable;
use super::options::PhysicsOptions;
use super::view::StaticView;
use vlscan_base::Result;
use vlscan_base::rng::{Purpose, Stream};
use vlscan_geom::{Aabb, DVec3};
use vlscan_scene::{Scene, Sizes};
use vlscan_survey::Survey;
use vlscan_trace::Tree;

/// The pulse physics of a survey over a scene: immutable, shared by all workers.
#[derive(Clone, Debug)]
pub struct Physics<'a> {
    pub(super) view: StaticView<'a>,
    /// Box that the beam's axis must hit for the pulse to be simulated.
    pub(super) bounds_cull: Option<Aabb>,
    pub(super) instruments: InstrumentTable,
    /// Number of each device's wavelength among those of the scene's spectra; empty if all devices have the
    /// first.
    pub(super) wavelengths: Vec<usize>,
    pub(super) options: PhysicsOptions,
    pub(super) range_noise: Stream,
    pub(super) waveform_noise: Stream,
    pub(super) free_paths: Stream,
    pub(super) pattern_turns: Stream,
    pub(super) facet_slopes: Stream,
    pub(super) weather_drops: Stream,
}

impl<'a> Physics<'a> {
    /// Computes the constants of all devices and legs of `survey`.
    ///
    /// # Errors
    /// As [`InstrumentTable::new`].
    pub fn new(scene: &'a Scene, tree: &'a Tree, survey: &Survey, o: PhysicsOptions) -> Result<Physics<'a>> {
        let sizes = scene.sizes();
        Ok(Physics {
            view: StaticView {
                scene,
                tree,
                visible_bounds: visible_bounds(scene, sizes, &o),
                fixed_incidence: o.fixed_incidence,
                max_cube_size: sizes.max_cube,
                has_optics: o.max_order > 0
                    && scene.materials.iter().any(|material| material.optics.is_some()),
                has_colours: o.record_colours,
            },
            // spec pulse-physics §2.1
            bounds_cull: (!o.corrections.no_axis_gate && !o.corrections.unbounded_scene)
                .then_some(scene.bounds),
            instruments: InstrumentTable::new(survey, &o)?,
            wavelengths: wavelengths(survey, &o),
            options: o,
            range_noise: Stream::new(o.seed, Purpose::Range),
            waveform_noise: Stream::new(o.seed, Purpose::Waveform),
            free_paths: Stream::new(o.seed, Purpose::FreePath),
            pattern_turns: Stream::new(o.seed, Purpose::PatternTurn),
            facet_slopes: Stream::new(o.seed, Purpose::FacetSlope),
            weather_drops: Stream::new(o.seed, Purpose::WeatherDrop),
        })
    }

    /// True if pulses need the velocity of their origin.
    pub fn records_velocities(&self) -> bool {
        self.options.record_velocities || self.instruments.has_chirps()
    }

    /// Maximum number of rays per pulse of a device.
    pub fn max_rays(&self) -> usize {
        self.instruments.max_rays()
    }

    /// The instruments of the survey.
    pub fn instruments(&self) -> &InstrumentTable {
        &self.instruments
    }

    /// True if a beam from `origin` along `axis` hits the culling box, if there is one; a box behind it is
    /// not hit.
    pub(super) fn hits_bounds(&self, origin: DVec3, axis: DVec3) -> bool {
        let Some(b) = self.bounds_cull else { return true };
        b.slabs(origin, axis).is_some_and(|(enter, exit)| !(enter < 0.0 && exit <= 0.0))
    }
}

/// See [`Physics::wavelengths`].
fn wavelengths(survey: &Survey, o: &PhysicsOptions) -> Vec<usize> {
    let all = survey.scanner.wavelengths();
    if !o.corrections.channel_spectra || all.len() < 2 {
        return Vec::new();
    }
    let number = |wavelength: f64| all.iter().position(|known| *known == wavelength).unwrap_or(0);
    survey.scanner.devices.iter().map(|device| number(device.beam.wavelength)).collect()
}

/// The scene's box, outside of which primitives are invisible; `None` unless some may lie there because they
/// move once the scene is loaded.
fn visible_bounds(scene: &Scene, sizes: Sizes, o: &PhysicsOptions) -> Option<Aabb> {
    let may_leave = !sizes.are_within_bounds || !scene.moving_parts.is_empty();
    (!o.corrections.unbounded_scene && may_leave).then_some(scene.bounds)
}
