//! Turns the hits of a pulse into its returns: reflections, waveform, peaks. `records` makes records of them.

mod records;

use super::batch::{Batch, NearPulses, WeakPulses};
use super::cluster::ClusterDetector;
use super::detector_settings::{DetectorSettings, Return};
use super::echo::{Echo, PulseRecord};
use super::foliage::FreePaths;
use super::instrument::Instrument;
use super::options::PhysicsOptions;
use super::paths::LightPaths;
use super::peak_detection::detect;
use super::photon_counter::PhotonCounter;
use super::physics::Physics;
use super::receiver::ReceiverModel;
use super::reflect::ReflectScratch;
use super::reflections::Reflections;
use super::return_profile::ReturnProfile;
use super::slope::SlopeMerger;
use super::sources::ReflectionSources;
use super::traced::{SubrayGains, TracedPulse};
use super::view::SceneView;
use super::water::WaterPlane;
use super::waveform::Waveform;
use super::weather_light::WeatherLight;
use crate::flight::Pulse;
use vlscan_base::Result;
use vlscan_geom::DVec3;
use vlscan_trace::simd::Simd;

/// Scratch memory of everything after the traversal.
#[derive(Clone, Debug, Default)]
pub(super) struct Detection {
    pub scratch: ReflectScratch,
    reflections: Reflections,
    light_paths: LightPaths,
    weather_light: WeatherLight,
    profile: ReturnProfile,
    slopes: SlopeMerger,
    sources: ReflectionSources,
    clusters: ClusterDetector,
    waveform: Waveform,
    /// The waveform after saturation, where it is needed.
    saturated: Waveform,
    returns: Vec<Return>,
    /// Echoes behind the surface of water, by their index in the batch, whose positions are to be corrected
    /// for refraction.
    pub refracted: Vec<(usize, WaterPlane)>,
}

/// Direction of the beam as it is traced; no component is a negative zero.
pub(super) fn traced_axis(pulse: &Pulse) -> DVec3 {
    pulse.attitude.forward() + DVec3::ZERO
}

pub(super) fn pulse_record(pulse: &Pulse) -> PulseRecord {
    PulseRecord {
        origin: pulse.origin,
        direction: traced_axis(pulse),
        time_ns: pulse.time_ns,
        number: pulse.number,
        device: pulse.device,
        scan_angle: pulse.scan_angle,
    }
}

/// The near-range filter. NaN passes.
fn is_too_near(range: f64, detector: &DetectorSettings) -> bool {
    range < detector.range_min
}

/// True if the device's range error puts a return beyond the maximum range.
fn is_moved_too_far(range: f64, pulse: &Pulse, detector: &DetectorSettings) -> bool {
    detector.corrections.range_gate
        && pulse.range_error > 0.0
        && range + pulse.range_error > detector.range_max
}

impl Detection {
    #[inline(always)]
    pub fn detect<S: Simd>(
        &mut self,
        simd: S,
        physics: &Physics,
        view: &SceneView,
        (instrument, pulse): (&Instrument, &Pulse),
        (traced, gains): (TracedPulse, SubrayGains),
        batch: &mut Batch,
    ) -> Result<()> {
        let (options, detector) = (&physics.options, &instrument.detector);
        let corrections = &detector.corrections;
        self.reflect(physics, view, (instrument, pulse), (traced, gains));
        let weather = instrument.weather.as_ref().and_then(|model| Some((model, model.air(pulse.time_ns)?)));
        if let Some((_, air)) = &weather {
            let hits = self.scratch.hits.iter_mut();
            hits.chain([&mut self.reflections]).for_each(|all| all.dim(air.extinction));
        }
        let weather = weather.filter(|_| !options.dark_air);
        let model = instrument.receiver.as_ref();
        let counter = instrument.counter.as_ref();
        let is_idle = !model.is_some_and(ReceiverModel::has_false_alarms)
            && !counter.is_some_and(PhotonCounter::has_background);
        if self.reflections.is_empty() && is_idle && weather.is_none() {
            return Ok(());
        }
        self.profile.sort_by_range(simd, &self.reflections, corrections.sum_equal_ranges);
        self.returns.clear();
        let is_kept = |range: f64| {
            (!corrections.count_kept_returns || !is_too_near(range + pulse.range_error, detector))
                && !is_moved_too_far(range, pulse, detector)
        };
        if corrections.smooth_slopes && !self.reflections.is_empty() {
            let triangles = &mut self.scratch.triangles;
            self.slopes.merge(
                view,
                instrument,
                (traced, gains),
                &self.reflections,
                triangles,
                &mut self.profile,
            );
        }
        if let Some((model, air)) = &weather {
            let hits = &mut self.scratch.hits;
            self.weather_light.add(
                (view, instrument),
                (*model, air),
                (&traced, &gains),
                (pulse, &physics.weather_drops),
                hits,
                &mut self.reflections,
            );
            if self.reflections.is_empty() && is_idle {
                return Ok(());
            }
            self.profile.add(&self.weather_light.light);
        }
        if options.record_waveforms || !self.detect_without_waveform(instrument, is_kept) {
            let has_light = self.detect_in_waveform(simd, options, (instrument, pulse), is_kept)?;
            if !has_light {
                self.count_unseen(detector, pulse, batch);
                return Ok(());
            }
        }
        if let Some(selection) = &instrument.selection {
            selection.select((pulse.device, pulse.number), &mut self.returns);
        }
        if self.scratch.records_hits {
            let hits = self.scratch.hits.as_ref().unwrap_or(&self.reflections);
            self.sources.assign(instrument, (&traced, &gains), hits, &self.returns);
        }
        if options.record_subrays {
            self.emit_subrays(view, &traced, pulse, batch);
            return Ok(());
        }
        if self.returns.is_empty() {
            self.count_unseen(detector, pulse, batch);
            return Ok(());
        }
        let scanner = if options.record_scanner_axes { pulse.scanner_attitude } else { Echo::NO_ATTITUDE };
        let recorded = (options.record_truth, scanner);
        self.emit_echoes(view, instrument, (&traced, recorded), pulse, batch);
        if options.record_waveforms && self.waveform.bins > 0 {
            self.emit_waveform(physics, instrument, pulse, batch)?;
        }
        Ok(())
    }

    /// Collects the light that surfaces reflect, and the light behind mirrors and panes.
    #[inline(always)]
    fn reflect(
        &mut self,
        physics: &Physics,
        view: &SceneView,
        (instrument, pulse): (&Instrument, &Pulse),
        (traced, gains): (TracedPulse, SubrayGains),
    ) {
        let options = &physics.options;
        let mut paths =
            FreePaths { stream: physics.free_paths, device: pulse.device, pulse: pulse.number, drawn: 0 };
        self.scratch.records_hits =
            options.record_truth || options.record_subrays || instrument.chirps.is_some();
        view.reflect(instrument, (traced, gains), &mut paths, &mut self.scratch, &mut self.reflections);
        if view.has_optics {
            let draws = (&physics.facet_slopes, &mut paths);
            let rules = (options.max_order, draws);
            let hits = &mut self.scratch.hits;
            self.light_paths.follow(view, instrument, (traced, gains), rules, hits, &mut self.reflections);
        }
    }

    /// Detects returns in the sampled waveform; `false` if the pulse has no waveform.
    #[inline(always)]
    fn detect_in_waveform<S: Simd>(
        &mut self,
        simd: S,
        options: &PhysicsOptions,
        (instrument, pulse): (&Instrument, &Pulse),
        is_kept: impl Fn(f64) -> bool,
    ) -> Result<bool> {
        let (detector, model) = (&instrument.detector, instrument.receiver.as_ref());
        if !self.waveform.receive(&self.profile, detector) {
            return Ok(false);
        }
        let draw = (pulse.device, pulse.number);
        if let Some(model) = model {
            model.add_noise(&mut self.waveform, options.record_waveforms, draw);
        }
        let mut output = &self.waveform;
        if let Some(model) = model.filter(|m| m.can_saturate())
            && (options.echo_width || options.record_waveforms)
        {
            model.saturate(&self.waveform, &mut self.saturated);
            output = &self.saturated;
        }
        let fitted = options.echo_width.then_some(output);
        match &instrument.counter {
            Some(counter) => counter.count(&self.waveform, detector, draw, is_kept, &mut self.returns)?,
            None => detect(simd, &self.waveform, (detector, model), fitted, is_kept, &mut self.returns),
        }
        if let Some(model) = model {
            model.add_false_alarms(&self.waveform, detector, draw, &mut self.returns);
        }
        Ok(true)
    }

    /// Counts a pulse without a return that met something beyond the minimum range. Its waveform is discarded
    /// if it starts in the dead zone. Otherwise its light stays below the threshold, be it all at once or
    /// because it is spread over time.
    #[inline(never)]
    fn count_unseen(&self, detector: &DetectorSettings, pulse: &Pulse, batch: &mut Batch) {
        let is_measured = |range: &f64| !is_too_near(*range + pulse.range_error, detector);
        let count = self.reflections.count_without_air();
        if !self.reflections.ranges()[..count].iter().any(is_measured) {
            return;
        }
        if let Some(&nearest) = self.profile.ranges().first() {
            let (start, _) = detector.waveform_start(nearest);
            if detector.is_in_dead_zone(start) {
                let range_min = detector.range_min;
                let dead_zone = range_min + (nearest - start * detector.light_speed);
                batch.near.add(&NearPulses { count: 1, nearest, dead_zone, range_min });
                return;
            }
        }
        let light = self.reflections.intensities()[..count].iter().sum::<f64>() * detector.shape.top;
        let threshold = detector.rule.threshold;
        let strongest = light.min(threshold);
        batch.weak.add(&WeakPulses { count: 1, strongest, threshold });
    }

    /// Detects returns without a sampled waveform; `false` if that is not possible.
    #[inline(always)]
    fn detect_without_waveform(&mut self, instrument: &Instrument, is_kept: impl Fn(f64) -> bool) -> bool {
        if let Some(rule) = &instrument.clusters {
            return self.clusters.detect(
                rule,
                &self.profile,
                &instrument.detector,
                is_kept,
                &mut self.returns,
            );
        }
        let found =
            instrument.single_bin.as_ref().and_then(|d| d.detect(&self.profile, &instrument.detector));
        self.returns.extend(found.into_iter().flatten().filter(|r| is_kept(r.range)));
        found.is_some()
    }
}
