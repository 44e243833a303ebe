//! Turns the hits of a pulse into its records: reflections, waveform, returns, echoes.

use super::batch::{Batch, NearPulses, WeakPulses};
use super::cluster::ClusterDetector;
use super::detector_settings::{DetectorSettings, Return};
use super::echo::{Echo, EchoTruth, EchoVelocity, PulseRecord, WaveformRecord};
use super::foliage::FreePaths;
use super::instrument::Instrument;
use super::options::PhysicsOptions;
use super::paths::LightPaths;
use super::peak_detection::{attribute, detect};
use super::photon_counter::PhotonCounter;
use super::physics::Physics;
use super::receiver::ReceiverModel;
use super::reflect::ReflectScratch;
use super::reflections::{PathEnd, Reflections};
use super::return_profile::ReturnProfile;
use super::slope::SlopeMerger;
use super::sources::ReflectionSources;
use super::traced::{SubrayGains, TracedPulse};
use super::velocity;
use super::view::SceneView;
use super::water::WaterPlane;
use super::waveform::{MAX_RECORD_SAMPLES, Waveform};
use super::weather_light::WeatherLight;
use crate::flight::Pulse;
use vlscan_base::{Error, Result};
use vlscan_geom::{DVec3, Rotation};
use vlscan_trace::Hits;
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

/// Class of an echo of a surface with this class, at the end of a path if it has one.
fn class_of(end: Option<&PathEnd>, classification: i32) -> i32 {
    end.map_or(classification, |end| end.path.kind.classification(classification))
}

/// Part and class of a primitive; the air has no part.
fn part_and_class(view: &SceneView, primitive: u32) -> (u32, i32) {
    if primitive == Hits::MISS { (u32::MAX, 0) } else { view.part_and_class(primitive) }
}

/// Number of a primitive in outputs; [`u32::MAX`] for the air.
fn number_of(view: &SceneView, primitive: u32) -> u32 {
    if primitive == Hits::MISS { u32::MAX } else { view.number_when_stored(primitive) }
}

/// The reflection to which a return is attributed.
#[inline(always)]
fn source_near(reflections: &Reflections, range: f64, detector: &DetectorSettings) -> usize {
    let half_pulse = 0.5 * detector.light_speed * detector.shape.duration;
    reflections.source_in_medium(attribute(reflections, range), range, half_pulse)
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

    /// Appends an echo for each return: its range error and the surface it is attributed to (spec
    /// pulse-physics §4.7–4.9). `records_truth` is true if the truth of the echoes is recorded, `scanner` is
    /// the attitude of the scanner where it is recorded.
    #[inline(always)]
    fn emit_echoes(
        &mut self,
        view: &SceneView,
        instrument: &Instrument,
        (traced, (records_truth, scanner)): (&TracedPulse, (bool, Rotation)),
        pulse: &Pulse,
        batch: &mut Batch,
    ) {
        let is_of_chirps = instrument.chirps.is_some();
        let all_traced = traced;
        let traced = records_truth.then_some(traced);
        let direction = pulse.reported_attitude.forward();
        let origin = pulse.origin + pulse.origin_error;
        let has_navigation_error =
            pulse.origin_error != DVec3::ZERO || pulse.reported_attitude != pulse.exact_attitude;
        let beam = [pulse.origin, pulse.exact_attitude.forward()];
        for (number, r) in (1..).zip(&self.returns) {
            let source = if r.is_noise { None } else { self.source_of(r, instrument) };
            let Some(source) = source else {
                let mut truth_index = Echo::NO_TRUTH;
                if traced.is_some() {
                    truth_index = batch.truths.len() as u32;
                    batch.truths.push(EchoTruth::unknown(beam));
                }
                batch.echoes.push(Echo { truth_index, scanner, ..self.false_alarm(pulse, number, r) });
                continue;
            };
            let primitive = self.reflections.primitives()[source];
            let mut range = r.range + pulse.range_error;
            let mut velocity = None;
            if is_of_chirps || (records_truth && pulse.velocity.is_some()) {
                (range, velocity) =
                    self.measure_velocity(number, source, view, (all_traced, pulse), instrument, range);
            }
            if is_too_near(range, &instrument.detector) {
                continue;
            }
            let end = self.reflections.end_of(source);
            let triangle = match primitive {
                Hits::MISS => None,
                primitive => self.scratch.triangles.look_up(view, primitive),
            };
            let (part, classification) = match triangle {
                Some(triangle) => (triangle.part, triangle.classification),
                None => part_and_class(view, primitive),
            };
            if let Some(plane) = end.and_then(|end| end.plane).filter(|_| instrument.corrects_refraction) {
                self.refracted.push((batch.echoes.len(), plane));
            }
            let classification = class_of(end, classification);
            let mut truth_index = Echo::NO_TRUTH;
            if traced.is_some() || has_navigation_error {
                truth_index = batch.truths.len() as u32;
                // Without a separate subray of the return the nearest hit counts.
                let (hits, nearest) = match &self.scratch.hits {
                    Some(hits) => (hits, source_near(hits, r.range, &instrument.detector)),
                    None => (&self.reflections, source),
                };
                let traced = traced.filter(|_| hits.count() > 0);
                batch.truths.push(traced.map_or(EchoTruth::unknown(beam), |traced| {
                    let found = (hits, &mut self.scratch.triangles);
                    self.sources.of_return(number, nearest, view, (traced, beam), found)
                }));
                if let Some(velocity) = velocity.filter(|_| traced.is_some() && pulse.velocity.is_some()) {
                    batch.push_velocity(velocity);
                }
            }
            batch.echoes.push(Echo {
                // Set together with the range noise.
                position: origin,
                origin,
                direction,
                scanner,
                range,
                true_range: self.reflections.ranges()[source],
                intensity: r.amplitude,
                echo_width: r.width,
                return_number: number,
                number_of_returns: self.returns.len() as u32,
                pulse_number: pulse.number,
                device: pulse.device,
                part,
                primitive: number_of(view, primitive),
                classification,
                incidence_cosine: self.reflections.cosines()[source],
                scan_angle: pulse.scan_angle,
                time_ns: pulse.time_ns,
                truth_index,
            });
        }
    }

    /// Range of return `number`, attributed to the reflection `source`, as chirps measure it, and its radial
    /// velocity.
    #[inline(never)]
    fn measure_velocity(
        &self,
        number: u32,
        source: usize,
        view: &SceneView,
        (traced, pulse): (&TracedPulse, &Pulse),
        instrument: &Instrument,
        range: f64,
    ) -> (f64, Option<EchoVelocity>) {
        let (hits, nearest) = match &self.scratch.hits {
            Some(hits) => (hits, source_near(hits, range, &instrument.detector)),
            None => (&self.reflections, source),
        };
        if hits.is_empty() {
            return (range, None);
        }
        let of_pulse = (traced, pulse.velocity.unwrap_or(DVec3::ZERO), instrument.step_rate);
        let velocity = velocity::of_return(number, nearest, view, of_pulse, (&self.sources, hits));
        let measured = instrument.chirps.as_ref().map(|chirps| chirps.measured(range, velocity));
        let (range, velocity) = measured.unwrap_or((range, velocity));
        (range, Some(velocity))
    }

    /// Index of the reflection to which a return is attributed; `None` if it is farther from all reflections
    /// than the pulse length, so that only noise of the receiver can have caused it.
    #[inline(always)]
    fn source_of(&self, r: &Return, instrument: &Instrument) -> Option<usize> {
        let source = source_near(&self.reflections, r.range, &instrument.detector);
        let pulse_depth = instrument.detector.light_speed * instrument.detector.shape.duration;
        let is_far = || (self.reflections.ranges()[source] - r.range).abs() > pulse_depth;
        (instrument.receiver.is_none() || !is_far()).then_some(source)
    }

    /// Appends every reflection of a subray as an echo at the position of the surface, in the order of the
    /// subrays. Its return number is the number of the return that contains it, or 0.
    #[inline(never)]
    fn emit_subrays(&mut self, view: &SceneView, traced: &TracedPulse, pulse: &Pulse, batch: &mut Batch) {
        let hits = self.scratch.hits.as_ref().unwrap_or(&self.reflections);
        for i in 0..hits.count() {
            let subray = self.sources.subray_of(i) as usize;
            let (origin, direction) = (traced.start(subray), traced.direction(subray));
            let found = (hits, &mut self.scratch.triangles);
            let truth = self.sources.of_reflection(i, view, (traced, [origin, direction]), found);
            let primitive = hits.primitives()[i];
            let (part, classification) = part_and_class(view, primitive);
            let classification = class_of(hits.end_of(i), classification);
            let range = hits.ranges()[i];
            batch.echoes.push(Echo {
                position: truth.surface,
                origin,
                direction,
                scanner: pulse.scanner_attitude,
                range,
                true_range: range,
                intensity: hits.intensities()[i],
                return_number: self.sources.return_of(i),
                number_of_returns: self.returns.len().max(1) as u32,
                part,
                primitive: number_of(view, primitive),
                classification,
                incidence_cosine: hits.cosines()[i],
                truth_index: batch.truths.len() as u32,
                ..Echo::miss(&pulse_record(pulse))
            });
            batch.truths.push(truth);
        }
    }

    /// An echo that noise of the receiver caused: it has a range, but neither part nor primitive.
    #[inline(never)]
    fn false_alarm(&self, pulse: &Pulse, number: u32, r: &Return) -> Echo {
        Echo {
            direction: pulse.exact_attitude.forward(),
            range: r.range + pulse.range_error,
            intensity: r.amplitude,
            echo_width: r.width,
            return_number: number,
            number_of_returns: self.returns.len() as u32,
            ..Echo::miss(&pulse_record(pulse))
        }
    }

    #[inline(never)]
    fn emit_waveform(
        &self,
        physics: &Physics,
        instrument: &Instrument,
        pulse: &Pulse,
        batch: &mut Batch,
    ) -> Result<()> {
        let is_saturated = instrument.receiver.as_ref().is_some_and(ReceiverModel::can_saturate);
        let waveform = if is_saturated { &self.saturated } else { &self.waveform };
        if waveform.bins > MAX_RECORD_SAMPLES {
            return Err(Error::input(format!(
                "the waveform of pulse {} of device {} has {} samples, at most {MAX_RECORD_SAMPLES} can be \
                 recorded; set maxFullwaveRange_ns or a larger binSize_ns",
                pulse.number, pulse.device, waveform.bins
            )));
        }
        let first_sample = batch.samples.len();
        let skipped = match instrument.detector.corrections.clip_dead_zone {
            true => waveform.first_beyond(instrument.detector.range_min, &instrument.detector),
            false => 0,
        };
        waveform.append_to(&mut batch.samples, skipped);
        let sigma = instrument.waveform_noise.sigma(&batch.samples[first_sample..]);
        if sigma != 0.0 {
            for (j, sample) in (0..).zip(&mut batch.samples[first_sample..]) {
                *sample += sigma * physics.waveform_noise.normal(pulse.device, pulse.number, j);
            }
        }
        batch.waveforms.push(WaveformRecord {
            pulse_number: pulse.number,
            device: pulse.device,
            origin: pulse.origin,
            direction: traced_axis(pulse),
            start_ns: waveform.start + skipped as f64 * instrument.detector.shape.bin,
            end_ns: waveform.end(instrument.detector.shape.bin),
            time_ns: pulse.time_ns,
            first_sample,
            samples: batch.samples.len() - first_sample,
        });
        Ok(())
    }
}
