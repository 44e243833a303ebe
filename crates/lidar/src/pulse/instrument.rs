//! The instruments of a survey: the constants of each device, computed once.

use super::cluster::ClusterRule;
use super::detector_settings::{DetectorSettings, PeakRule};
use super::echo::Echo;
use super::emission::{check, footprint, pulse_shape, subrays};
use super::energy::{BeamState, Energy, half_angle};
use super::fmcw::Chirps;
use super::noise::signal_to_noise;
use super::options::PhysicsOptions;
use super::peaks::Peaks;
use super::photon_counter::PhotonCounter;
use super::receiver::{FalseAlarms, ReceiverModel};
use super::reception::{Reception, peak_rule};
use super::selection::ReturnSelection;
use super::single_bin::SingleBinDetector;
use super::specular::Aperture;
use super::subray::Subrays;
use super::water_column;
use super::waveform::Waveform;
use super::weather_drops::WeatherModel;
use libm::sqrt;
use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::sync::Arc;
use vlscan_base::corrections::Corrections;
use vlscan_base::{Error, Result};
use vlscan_geom::LIGHT_SPEED;
use vlscan_survey::{
    Beam, Device, Formula, RangeNoise, Receiver, ReferenceTarget, ScannerSettings, Survey, Weather,
};
use vlscan_trace::simd::portable::Portable;

/// Cosine of the angle of incidence below which the depth of a footprint no longer grows: 84°.
const MIN_INCIDENCE_COSINE: f64 = 0.1;

/// A device with one divergence.
#[derive(Clone, Debug)]
pub(super) struct Instrument {
    pub subrays: Subrays,
    pub energy: Energy,
    /// Half angle of the beam, the larger one of an elliptical beam, rad.
    pub footprint_angle: f64,
    pub detector: DetectorSettings,
    /// Fast path for light within one bin, where ranges are not read between bins and waveforms are not cut
    /// off.
    pub single_bin: Option<SingleBinDetector>,
    /// Fast path where ranges are read between bins.
    pub clusters: Option<ClusterRule>,
    /// 1σ range noise of echoes of any strength, m.
    pub range_accuracy: f64,
    /// Range noise by the strength of echoes, and the threshold that it refers to, instead of the accuracy.
    pub range_noise: Option<(RangeNoise, f64)>,
    /// Step of reported ranges, m; 0 = any range.
    pub range_step: f64,
    /// Selection of the reported returns; `None` for all.
    pub selection: Option<ReturnSelection>,
    /// Factor on the range noise.
    pub distance_error: Option<Formula>,
    pub waveform_noise: WaveformNoise,
    /// Field of view of the receiver, full angle, rad, as far as it matters to light in water.
    pub field_of_view: Option<f64>,
    /// The receiver as it meets light that mirrors send straight back, with the lidar equation.
    pub aperture: Option<Aperture>,
    /// Amplitude of waveforms below which the light of a column of water no longer counts; `None` if it
    /// counts up to the last surface of a pulse only.
    pub lowest_of_column: Option<f64>,
    /// True if points below water are corrected for its refraction and speed of light.
    pub corrects_refraction: bool,
    /// Simulation steps per second: the pulse rate.
    pub step_rate: f64,
    /// Chirps, if the device has no pulses.
    pub chirps: Option<Chirps>,
    /// The weather of the leg, unless it is clear.
    pub weather: Option<WeatherModel>,
    /// The receiver, if it is not ideal.
    pub receiver: Option<ReceiverModel>,
    /// The receiver, if it counts photons.
    pub counter: Option<PhotonCounter>,
}

impl Instrument {
    fn new(
        device: &Device,
        divergence: Divergence,
        (frequency, weather): (f64, &Weather),
        context: &Context,
    ) -> Result<Instrument> {
        let (o, c) = (context.options, context.options.corrections);
        let ideal = Receiver::default();
        let receiver = if c.receiver { &device.receiver } else { &ideal };
        let shape = pulse_shape(device, &c);
        let average_power = device.beam.average_power * shape.power_factor();
        let beam = Beam { pulse_length: shape.length_of_equal_energy(), average_power, ..device.beam };
        let state = BeamState {
            beam: &beam,
            rings: device.waveform.quality,
            range_min: device.detector.range_min,
            start_divergence: divergence.start,
            leg_divergence: divergence.leg,
            frequency,
        };
        let across = device.beam.divergence_y.unwrap_or(divergence.start);
        let half_angles = [half_angle(divergence.start, &c), half_angle(across, &c)];
        let subrays = subrays(device, half_angles, &c);
        let light_speed = if c.two_way_time { LIGHT_SPEED * 0.5 } else { LIGHT_SPEED };
        let amplitude_of = |target: &ReferenceTarget| {
            let frequency = target.pulse_freq.unwrap_or(context.first_frequency);
            let energy =
                Energy::new(BeamState { frequency, ..state }, subrays.len(), context.multi_channel, o);
            energy.of_beam(subrays.len(), target.range) * target.reflectance * shape.top
        };
        let speeds = (light_speed, frequency);
        let reception = Reception::new(device, receiver, &shape, amplitude_of, speeds, o)
            .map_err(|problem| Error::caused_by(format!("device {}: {problem}", device.id), problem))?;
        let Reception { threshold, rule, selection, model, counter, has_noise } = reception;
        let waveform_noise = WaveformNoise::new(device, shape.width() * light_speed, has_noise, o);
        let has_fast_path = model.is_none()
            && counter.is_none()
            && receiver.pulse_shape.is_none()
            && !receiver.digitiser_clock
            && !o.echo_width
            && device.waveform.max_range <= 0.0;
        let single_bin = has_fast_path && !c.fractional_bins && !c.clip_dead_zone;
        let clusters = has_fast_path && c.fractional_bins && c.clip_dead_zone;
        let counts_photons = counter.is_some();
        let has_tail = has_noise
            || counts_photons
            || model.as_ref().is_some_and(ReceiverModel::has_false_alarms)
            || o.record_waveforms
            || o.record_subrays
            || (o.echo_width && !c.local_fit);
        let lowest_of_column =
            has_tail.then(|| water_column::lowest_amplitude(rule.threshold, counts_photons));
        let footprint = footprint(device, half_angles);
        // Only the lidar equation has weather; figures of data sheets hold in the air of the scanner.
        let clear = Weather::CLEAR;
        let weather = if c.radiometry { weather } else { &clear };
        let in_weather = Beam { visibility: weather.haze_visibility(beam.visibility), ..beam };
        let state = BeamState { beam: &in_weather, ..state };
        Ok(Instrument {
            energy: Energy::new(state, subrays.len(), context.multi_channel, o),
            subrays,
            footprint_angle: half_angles.into_iter().fold(0.0, f64::max),
            single_bin: if single_bin { SingleBinDetector::new(&shape, &rule) } else { None },
            clusters: if clusters { ClusterRule::new(&shape, &rule) } else { None },
            detector: DetectorSettings {
                shape,
                rule,
                // The selection counts itself.
                max_returns: if selection.is_some() { 0 } else { device.detector.max_returns },
                range_min: device.detector.range_min,
                range_max: device.detector.range_max,
                max_duration: device.waveform.max_range,
                light_speed,
                digitiser_clock: receiver.digitiser_clock,
                corrections: c,
            },
            range_accuracy: if c.own_accuracy { device.detector.accuracy } else { context.first_accuracy },
            range_noise: receiver.range_noise.map(|noise| (noise, threshold)),
            range_step: receiver.range_step,
            selection,
            distance_error: device.detector.distance_error.clone(),
            waveform_noise,
            field_of_view: receiver.field_of_view,
            lowest_of_column,
            aperture: Aperture::new(&beam, &footprint, receiver.field_of_view).filter(|_| c.radiometry),
            corrects_refraction: receiver.corrects_refraction,
            step_rate: frequency,
            chirps: receiver.fmcw.map(|wave| Chirps::new(&wave, device.beam.wavelength)),
            weather: WeatherModel::new(weather, beam.wavelength, footprint, beam.overlap.is_some()),
            receiver: model,
            counter,
        })
    }
}

impl Instrument {
    /// Standard deviation of the range of an echo, m.
    #[inline(always)]
    pub fn range_sigma(&self, echo: &Echo) -> f64 {
        match &self.range_noise {
            Some((noise, threshold)) => noise.sigma(echo.intensity, *threshold, self.footprint_depth(echo)),
            None => self.range_accuracy,
        }
    }

    /// Standard deviation of the depths within the footprint on the slope that caused the echo, m: a Gaussian
    /// beam has half of its half angle at 1/e² as the standard deviation of its directions.
    fn footprint_depth(&self, echo: &Echo) -> f64 {
        let cosine = echo.incidence_cosine.abs().clamp(MIN_INCIDENCE_COSINE, 1.0);
        echo.true_range * self.footprint_angle * 0.5 * sqrt(1.0 - cosine * cosine) / cosine
    }

    /// True if noise or the step of ranges moves echoes.
    pub fn moves_ranges(&self) -> bool {
        self.range_accuracy != 0.0 || self.range_noise.is_some() || self.range_step > 0.0
    }
}

/// Noise that is added to recorded waveforms on request, without effect on points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum WaveformNoise {
    None,
    /// Standard deviation as an amplitude.
    Amplitude(f64),
    /// Standard deviation relative to the waveform's peak.
    OverPeak(f64),
}

impl WaveformNoise {
    /// The noise that `options` request, for a pulse with a width of `depth` metres of range. `has_noise` is
    /// true if the samples have noise already.
    fn new(device: &Device, depth: f64, has_noise: bool, options: &PhysicsOptions) -> WaveformNoise {
        let accuracy = device.detector.accuracy;
        match (options.waveform_noise, options.corrections.receiver) {
            (false, _) => WaveformNoise::None,
            (true, false) => WaveformNoise::Amplitude(accuracy * 0.5),
            (true, true) if has_noise => WaveformNoise::None,
            (true, true) => WaveformNoise::OverPeak(1.0 / signal_to_noise(depth, accuracy)),
        }
    }

    pub fn sigma(self, samples: &[f64]) -> f64 {
        match self {
            WaveformNoise::None => 0.0,
            WaveformNoise::Amplitude(sigma) => sigma,
            WaveformNoise::OverPeak(share) => share * samples.iter().copied().fold(0.0, f64::max),
        }
    }
}

/// Beam divergence, rad.
#[derive(Clone, Copy, Debug)]
struct Divergence {
    /// When the simulation starts.
    start: f64,
    /// In the current leg.
    leg: f64,
}

struct Context<'a> {
    options: &'a PhysicsOptions,
    multi_channel: bool,
    first_accuracy: f64,
    /// Pulse rate of data sheet figures that state none, Hz.
    first_frequency: f64,
}

/// The instruments of a survey by leg and device. Clones share them.
#[derive(Clone, Debug)]
pub struct InstrumentTable {
    instruments: Arc<[Instrument]>,
    devices: usize,
    /// Index into `instruments` for each leg and device.
    indices: Arc<[u32]>,
}

impl InstrumentTable {
    /// Computes the instruments that `survey` uses.
    ///
    /// # Errors
    /// Settings that no instrument can have (bins without width), or that need too much memory (millions of
    /// subrays or of pulse samples).
    pub fn new(survey: &Survey, options: &PhysicsOptions) -> Result<InstrumentTable> {
        let devices = &survey.scanner.devices;
        devices.iter().try_for_each(|d| check(d, &options.corrections))?;
        let context = Context {
            options,
            multi_channel: survey.scanner.multi_channel,
            first_accuracy: devices.first().map_or(0.0, |d| d.detector.accuracy),
            first_frequency: survey.scanner.pulse_freqs.first().map_or(1.0, |f| f64::from(*f)),
        };
        let (mut instruments, mut indices) = (Vec::new(), Vec::new());
        let mut known: HashMap<(usize, u64, u32, usize), u32> = HashMap::new();
        // Weathers by number.
        let mut weathers: Vec<&Weather> = Vec::new();
        for leg in &survey.legs {
            let own = &leg.scanner.weather;
            let weather = weathers.iter().position(|known| *known == own).unwrap_or_else(|| {
                weathers.push(own);
                weathers.len() - 1
            });
            for (i, device) in devices.iter().enumerate() {
                let divergence = divergence(survey, &leg.scanner, i, device, options);
                // Only the lidar equation depends on the pulse rate.
                let rate = if options.corrections.radiometry { leg.scanner.pulse_freq } else { 0 };
                let index = match known.entry((i, divergence.leg.to_bits(), rate, weather)) {
                    Entry::Occupied(known) => *known.get(),
                    Entry::Vacant(new) => {
                        let frequency = f64::from(leg.scanner.pulse_freq.max(1));
                        instruments.push(Instrument::new(device, divergence, (frequency, own), &context)?);
                        *new.insert(instruments.len() as u32 - 1)
                    }
                };
                indices.push(index);
            }
        }
        Ok(InstrumentTable {
            instruments: instruments.into(),
            devices: devices.len(),
            indices: indices.into(),
        })
    }

    /// True if a device has chirps, whose ranges depend on velocities.
    pub(super) fn has_chirps(&self) -> bool {
        self.instruments.iter().any(|instrument| instrument.chirps.is_some())
    }

    /// True if the air of a leg has fog, rain, snow or dust.
    pub fn has_weather(&self) -> bool {
        self.instruments.iter().any(|instrument| instrument.weather.is_some())
    }

    /// The false alarms of the instrument that has the most per pulse; `None` if no receiver has noise.
    pub fn false_alarms(&self) -> Option<FalseAlarms> {
        let receivers = self.instruments.iter().filter_map(|instrument| instrument.receiver.as_ref());
        receivers
            .filter_map(ReceiverModel::false_alarms)
            .max_by(|one, other| one.per_pulse.total_cmp(&other.per_pulse))
    }

    pub(super) fn devices(&self) -> usize {
        self.devices
    }

    pub(super) fn max_rays(&self) -> usize {
        self.instruments.iter().map(|i| i.subrays.len()).max().unwrap_or(0)
    }

    /// The instrument of `device` in `leg` (index into the survey's legs).
    #[inline]
    pub(super) fn instrument(&self, leg: u32, device: u32) -> Result<&Instrument> {
        let known = (device as usize) < self.devices;
        let at = (leg as usize).checked_mul(self.devices).and_then(|l| l.checked_add(device as usize));
        at.filter(|_| known)
            .and_then(|at| self.indices.get(at))
            .map(|i| &self.instruments[*i as usize])
            .ok_or_else(|| {
                Error::Internal(format!(
                    "a pulse of device {device} in leg {leg}, which the survey does not have"
                ))
            })
    }
}

/// Leg settings reach device 0 only, and the rays only before the first leg (spec pulse-physics §5.3, trap
/// 8).
fn divergence(
    survey: &Survey,
    leg: &ScannerSettings,
    i: usize,
    device: &Device,
    options: &PhysicsOptions,
) -> Divergence {
    if i > 0 {
        return Divergence { start: device.beam.divergence, leg: device.beam.divergence };
    }
    if options.corrections.divergence_per_leg {
        let own = leg.written_divergence.unwrap_or(leg.beam_divergence);
        return Divergence { start: own, leg: own };
    }
    let first = survey.legs.first().map_or(device.beam.divergence, |l| l.scanner.beam_divergence);
    Divergence { start: first, leg: leg.beam_divergence }
}

/// Number of echoes of a single strong pulse of a device; `None` if its settings are impossible.
pub fn count_echoes_of_one_pulse(device: &Device, corrections: &Corrections) -> Option<usize> {
    check(device, corrections).ok()?;
    let shape = pulse_shape(device, corrections);
    let rule = PeakRule { threshold: f64::MIN_POSITIVE, ..peak_rule(device, corrections) };
    // A waveform has another bin behind its last pulse.
    let samples: Vec<f64> = shape.samples.iter().copied().chain([0.0]).collect();
    let waveform = Waveform::of_samples(&samples);
    Some(Peaks::of(Portable, &waveform, rule).count())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pulse::testkit::{survey, tls_device};

    #[test]
    fn impossible_settings_are_named() {
        let cases = [
            ("binSize_ns", 0.0, 3),
            ("binSize_ns", f64::NAN, 3),
            ("million bins", 1e-9, 3),
            ("beamSampleQuality", 0.25, u32::MAX),
        ];
        for (word, bin, quality) in cases {
            let mut device = tls_device(5.0);
            (device.waveform.bin, device.waveform.quality) = (bin, quality);
            let error = InstrumentTable::new(&survey(vec![device]), &PhysicsOptions::helios()).unwrap_err();
            assert!(error.to_string().contains(word), "{error} does not name {word}");
        }
        let mut device = tls_device(f64::MAX);
        device.waveform.bin = f64::MAX;
        let survey = survey(vec![device]);
        assert!(InstrumentTable::new(&survey, &PhysicsOptions::helios()).is_ok(), "one bin");
        let error = InstrumentTable::new(&survey, &PhysicsOptions::refined()).unwrap_err();
        assert!(error.to_string().contains("million bins"), "the whole pulse is twice as long: {error}");
    }

    #[test]
    fn legs_with_the_same_divergence_share_an_instrument() {
        let mut s = survey(vec![tls_device(5.0), tls_device(4.0)]);
        s.legs.push(s.legs[0].clone());
        s.legs.push(s.legs[0].clone());
        s.legs[1].scanner.beam_divergence = 2e-3;
        let table = InstrumentTable::new(&s, &PhysicsOptions::helios()).unwrap();
        assert_eq!((&*table.indices, table.instruments.len()), ([0, 1, 2, 1, 0, 1].as_slice(), 3));
        assert!(table.instrument(2, 1).is_ok());
        assert!(table.instrument(3, 0).is_err() && table.instrument(0, 2).is_err());
        assert!(table.instrument(u32::MAX, u32::MAX).is_err());
    }
}
