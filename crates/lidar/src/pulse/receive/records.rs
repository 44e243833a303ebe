//! Records of a pulse whose returns are known: echoes, hits of subrays, waveforms.

use super::{Detection, is_too_near, pulse_record, traced_axis};
use crate::flight::Pulse;
use crate::pulse::batch::Batch;
use crate::pulse::detector_settings::{DetectorSettings, Return};
use crate::pulse::echo::{Echo, EchoTruth, EchoVelocity, WaveformRecord};
use crate::pulse::instrument::Instrument;
use crate::pulse::peak_detection::attribute;
use crate::pulse::physics::Physics;
use crate::pulse::receiver::ReceiverModel;
use crate::pulse::reflections::{PathEnd, Reflections};
use crate::pulse::traced::TracedPulse;
use crate::pulse::velocity;
use crate::pulse::view::SceneView;
use crate::pulse::waveform::MAX_RECORD_SAMPLES;
use vlscan_base::{Error, Result};
use vlscan_geom::{DVec3, Rotation};
use vlscan_trace::Hits;

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
    /// Appends an echo for each return: its range error and the surface it is attributed to (spec
    /// pulse-physics §4.7–4.9). `records_truth` is true if the truth of the echoes is recorded, `scanner` is
    /// the attitude of the scanner where it is recorded.
    #[inline(always)]
    pub(super) fn emit_echoes(
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
    pub(super) fn emit_subrays(
        &mut self,
        view: &SceneView,
        traced: &TracedPulse,
        pulse: &Pulse,
        batch: &mut Batch,
    ) {
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
    pub(super) fn emit_waveform(
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
