//! Receivers that count single photons: every photoelectron is a separate return.
//!
//! The photoelectrons of a waveform form a Poisson process whose rate follows the light that is received,
//! with a constant rate of background light under it (Goodman 2015, *Statistical Optics*, §9). After an event
//! the receiver is blind for its dead time, whatever arrives meanwhile (non-paralysable). The process has no
//! memory, so that events are drawn one after the other: the mean number of photoelectrons between an event,
//! or the end of its dead time, and the next one has the exponential distribution of mean 1.
//!
//! Pixels share the light of a pulse evenly, and each has a dead time. An event may cause an afterpulse,
//! which follows the dead time by an exponential delay unless a photon comes first. Jitter moves the times of
//! events, after all of this.

use super::detector_settings::{DetectorSettings, Return};
use super::receiver_error::ReceiverError;
use super::shape::PulseShape;
use super::waveform::Waveform;
use vlscan_base::error::{Error, Result};
use vlscan_base::rng::{self, Purpose, Stream};
use vlscan_survey::{PixelSettings, Ranging, Receiver};

/// Elementary charge, C.
const ELECTRON: f64 = 1.602_176_634e-19;
/// Most photons of a pulse that are recorded.
const MAX_EVENTS: u32 = 4096;
/// Most background photoelectrons per pulse, on average: so few that these alone are never more than are
/// recorded (46 standard deviations of the Poisson distribution).
const MAX_BACKGROUND: f64 = 2000.0;

/// Detection by single photoelectrons.
#[derive(Clone, Debug)]
pub(super) struct PhotonCounter {
    /// Photoelectrons per nanosecond and amplitude.
    per_light: f64,
    /// Photoelectrons of background light per nanosecond.
    background: f64,
    /// Amplitude of an echo of one photoelectron, on average.
    amplitude: f64,
    /// Travel times between which photons count, ns.
    gate: (f64, f64),
    dead_time: f64,
    pixels: PixelSettings,
    max_returns: usize,
    stream: Stream,
    afterpulses: Stream,
    jitter: Stream,
}

/// Draws of a pixel begin at a multiple of it.
const DRAWS_PER_PIXEL: u32 = 1 << 14;

/// An event of a pixel.
#[derive(Clone, Copy, Debug)]
struct Event {
    /// ns.
    time: f64,
    is_noise: bool,
}

/// A time from which on light comes at a constant rate.
#[derive(Clone, Copy, Debug)]
struct Piece {
    from: f64,
    /// Photoelectrons of the echo per ns.
    light: f64,
    /// Mean number of photoelectrons before it.
    before: f64,
}

impl PhotonCounter {
    /// The counter of a receiver with the detection threshold `threshold`; `None` if it detects echoes.
    /// `gate` are the travel times between which photons count, ns; 0 `max_returns` are any number.
    ///
    /// # Errors
    /// If no threshold determines the number of photoelectrons of an echo, or if there is too much background
    /// light.
    pub fn new(
        receiver: &Receiver,
        shape: &PulseShape,
        threshold: f64,
        (gate, max_returns): ((f64, f64), u32),
        seed: u64,
    ) -> Result<Option<PhotonCounter>, ReceiverError> {
        if receiver.ranging != Ranging::Photons {
            return Ok(None);
        }
        let photons = f64::from(receiver.threshold_photons.unwrap_or(1));
        if !(threshold > 0.0 && threshold.is_finite()) {
            return Err(ReceiverError::NoThreshold);
        }
        // The light of an echo whose peak is at the threshold.
        let light = threshold * shape.samples.iter().sum::<f64>() * shape.bin / shape.top;
        let pixels = receiver.pixels;
        let of_light = receiver.shot.map_or(0.0, |s| s.background * s.responsivity / ELECTRON * 1e-9);
        let background = of_light + f64::from(pixels.count) * pixels.dark_counts * 1e-9;
        let expected = background * (gate.1 - gate.0);
        if expected > MAX_BACKGROUND {
            return Err(ReceiverError::Background {
                photons: background * 1e9,
                returns: expected,
                max: MAX_BACKGROUND,
            });
        }
        Ok(Some(PhotonCounter {
            per_light: photons / light,
            background,
            amplitude: threshold / photons,
            gate,
            dead_time: receiver.dead_time,
            pixels,
            max_returns: if max_returns > 0 { max_returns as usize } else { usize::MAX },
            stream: Stream::new(seed, Purpose::PhotonCount),
            afterpulses: Stream::new(seed, Purpose::Afterpulse),
            jitter: Stream::new(seed, Purpose::PhotonJitter),
        }))
    }

    /// True if pulses have returns without reflections.
    pub fn has_background(&self) -> bool {
        self.background > 0.0
    }

    /// Appends the photons of a pulse by range, each as a return.
    ///
    /// # Errors
    /// [`Error::Input`] for a pulse of more than 4096 photons.
    pub fn count(
        &self,
        waveform: &Waveform,
        detector: &DetectorSettings,
        (device, pulse): (u32, u64),
        is_kept: impl Fn(f64) -> bool,
        returns: &mut Vec<Return>,
    ) -> Result<()> {
        let (pieces, total) = self.pieces(waveform, detector.shape.bin);
        let mut events = Vec::new();
        for pixel in 0..self.pixels.count {
            let is_in_time = |time: f64| is_kept(detector.light_speed * time);
            self.count_pixel(pixel, (&pieces, total), (device, pulse), &is_in_time, &mut events)?;
        }
        // Events of one pixel are in order.
        if self.pixels.count > 1 || self.pixels.jitter > 0.0 {
            events.sort_by(|a, b| a.time.total_cmp(&b.time));
        }
        events.truncate(self.max_returns.saturating_sub(returns.len()));
        returns.extend(events.iter().map(|event| Return {
            range: detector.light_speed * event.time,
            amplitude: self.amplitude,
            width: 0.0,
            is_noise: event.is_noise,
        }));
        Ok(())
    }

    /// Appends the events of a pixel, whose times `is_kept` accepts, by time before jitter.
    fn count_pixel(
        &self,
        pixel: u32,
        (pieces, total): (&[Piece], f64),
        (device, pulse): (u32, u64),
        is_kept: &impl Fn(f64) -> bool,
        events: &mut Vec<Event>,
    ) -> Result<()> {
        let (first, share) = (pixel * DRAWS_PER_PIXEL, 1.0 / f64::from(self.pixels.count));
        let (mut reached, mut kept) = (0.0, 0);
        let mut afterpulse: Option<f64> = None;
        for number in 0.. {
            let draw = self.stream.bits(device, pulse, first + number);
            reached -= libm::log(rng::open_unit(draw[0], draw[1])) / share;
            let piece = pieces[pieces.partition_point(|piece| piece.before <= reached).saturating_sub(1)];
            let rate = piece.light + self.background;
            let photon =
                if reached >= total { f64::INFINITY } else { piece.from + (reached - piece.before) / rate };
            let delayed = afterpulse.take().filter(|time| *time < photon.min(self.gate.1));
            if (delayed.is_none() && reached >= total) || kept == self.max_returns {
                break;
            }
            if number == MAX_EVENTS {
                return Err(too_many(device, pulse, total, self.dead_time));
            }
            let time = delayed.unwrap_or(photon);
            let is_noise = delayed.is_some() || rng::open_unit(draw[2], draw[3]) * rate > piece.light;
            let moved = self.with_jitter(time, (device, pulse), first + number);
            if is_kept(moved) {
                events.push(Event { time: moved, is_noise });
                kept += 1;
            }
            let blind = time + self.dead_time;
            if delayed.is_some() || self.dead_time > 0.0 {
                let next = self.mean_before(pieces, blind);
                // An afterpulse comes before the photon that was drawn.
                reached = if delayed.is_some() { next } else { reached.max(next) };
            }
            afterpulse = self.afterpulse(blind, (device, pulse), first + number);
        }
        Ok(())
    }

    /// Time of the afterpulse of event number `number` that ends the dead time at `blind` ns.
    fn afterpulse(&self, blind: f64, (device, pulse): (u32, u64), number: u32) -> Option<f64> {
        let (probability, delay) = self.pixels.afterpulse?;
        let draw = self.afterpulses.bits(device, pulse, number);
        let occurs = rng::open_unit(draw[0], draw[1]) <= probability;
        occurs.then(|| blind - delay * libm::log(rng::open_unit(draw[2], draw[3])))
    }

    /// Time of event number `number` with its jitter, ns.
    fn with_jitter(&self, time: f64, (device, pulse): (u32, u64), number: u32) -> f64 {
        let sigma = self.pixels.jitter;
        if sigma > 0.0 { time + sigma * self.jitter.normal(device, pulse, number) } else { time }
    }

    /// The rate of photoelectrons within the gate, in pieces, and their mean number.
    fn pieces(&self, waveform: &Waveform, bin: f64) -> (Vec<Piece>, f64) {
        let (begin, end) = self.gate;
        let mut pieces = vec![Piece { from: begin, light: 0.0, before: 0.0 }];
        let mut add = |from: f64, light: f64| {
            let from = from.clamp(begin, end);
            let last = pieces[pieces.len() - 1];
            let before = last.before + (from - last.from).max(0.0) * (last.light + self.background);
            pieces.push(Piece { from: from.max(last.from), light, before });
        };
        for (first, samples) in waveform.segments() {
            // A sample stands for the bin around it.
            let time = |k: usize| waveform.start + (first as f64 + k as f64 - 0.5) * bin;
            samples.iter().enumerate().for_each(|(k, sample)| add(time(k), sample.max(0.0) * self.per_light));
            add(time(samples.len()), 0.0);
        }
        add(end, 0.0);
        let total = pieces[pieces.len() - 1].before;
        (pieces, total)
    }

    /// Mean number of photoelectrons before a time.
    fn mean_before(&self, pieces: &[Piece], time: f64) -> f64 {
        let piece = pieces[pieces.partition_point(|piece| piece.from <= time).saturating_sub(1)];
        piece.before + (time - piece.from).max(0.0) * (piece.light + self.background)
    }
}

#[cold]
fn too_many(device: u32, pulse: u64, total: f64, dead_time: f64) -> Error {
    let verb = if dead_time > 0.0 { "raise" } else { "set" };
    Error::input_with_help(
        format!(
            "pulse {pulse} of device {device} has more than {MAX_EVENTS} photons, about {total:.0} without \
             dead time"
        ),
        format!(
            "{verb} the receiver's `dead_time_ns`, or limit the returns with `max_returns`; a mirror, pane \
             or flat water that faces the beam returns most of its light"
        ),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pulse::PhysicsOptions;
    use crate::pulse::instrument::InstrumentTable;
    use crate::pulse::testkit::{received, survey, tls_device};
    use vlscan_survey::ShotNoise;

    const LIGHT: f64 = vlscan_geom::LIGHT_SPEED * 0.5;

    /// A detector of refined physics, with a pulse of 4 ns.
    fn refined() -> DetectorSettings {
        let table = InstrumentTable::new(&survey(vec![tls_device(4.0)]), &PhysicsOptions::refined()).unwrap();
        table.instrument(0, 0).unwrap().detector.clone()
    }

    fn counter(receiver: &Receiver, shape: &PulseShape, gate: (f64, f64)) -> PhotonCounter {
        let receiver = Receiver { ranging: Ranging::Photons, ..receiver.clone() };
        PhotonCounter::new(&receiver, shape, 2.0, (gate, 0), 5).unwrap().unwrap()
    }

    /// Ranges of the photons of `n` pulses from a target at 30 m with `mean` photoelectrons.
    fn photons(receiver: &Receiver, mean: f64, n: u64) -> Vec<Vec<Return>> {
        let detector = refined();
        let counter = counter(receiver, &detector.shape, (20.0 / LIGHT, 40.0 / LIGHT));
        // One photoelectron at the threshold.
        let waveform = received(&[(30.0, 2.0 * mean / detector.shape.top)], &detector);
        let of = |pulse: u64| {
            let mut found = Vec::new();
            counter.count(&waveform, &detector, (0, pulse), |_| true, &mut found).unwrap();
            found
        };
        (0..n).map(of).collect()
    }

    #[test]
    fn photons_have_the_number_the_place_and_the_width_of_the_echo() {
        let n = 20_000;
        for mean in [0.3, 2.5] {
            let found = photons(&Receiver::default(), mean, n);
            let counts: Vec<f64> = found.iter().map(|f| f.len() as f64).collect();
            let average = counts.iter().sum::<f64>() / n as f64;
            let variance = counts.iter().map(|c| (c - average).powi(2)).sum::<f64>() / n as f64;
            let sigma = (mean / n as f64).sqrt();
            assert!((average - mean).abs() < 4.0 * sigma, "{average}");
            // Poisson: the variance is the mean; that of the variance is (mean + 2·mean²)/n.
            assert!(
                (variance - mean).abs() < 4.0 * ((mean + 2.0 * mean * mean) / n as f64).sqrt(),
                "{variance}"
            );
            let ranges: Vec<f64> = found.iter().flatten().map(|r| r.range - 30.0).collect();
            let count = ranges.len() as f64;
            let bias = ranges.iter().sum::<f64>() / count;
            // A raised cosine of the duration T has the variance T²·(1/12 − 1/(2π²)).
            let duration = 2.0 * vlscan_survey::width_of_pulse_length(4.0) * LIGHT;
            let width = duration * (1.0 / 12.0 - 0.5 / std::f64::consts::PI.powi(2)).sqrt();
            let spread = (ranges.iter().map(|r| (r - bias).powi(2)).sum::<f64>() / count).sqrt();
            assert!(bias.abs() < 4.0 * width / count.sqrt(), "{bias}");
            assert!((spread / width - 1.0).abs() < 0.02, "{spread} {width}");
            assert!(found.iter().flatten().all(|r| !r.is_noise && r.amplitude == 2.0));
        }
    }

    #[test]
    fn more_photons_than_are_recorded_are_an_error() {
        let (detector, gate) = (refined(), (20.0 / LIGHT, 40.0 / LIGHT));
        let waveform = received(&[(30.0, 2.0 * 10_000.0 / detector.shape.top)], &detector);
        let count = |receiver: &Receiver, max_returns: u32| {
            let receiver = Receiver { ranging: Ranging::Photons, ..receiver.clone() };
            let counter =
                PhotonCounter::new(&receiver, &detector.shape, 2.0, (gate, max_returns), 5).unwrap();
            let mut found = Vec::new();
            counter.unwrap().count(&waveform, &detector, (0, 7), |_| true, &mut found).map(|()| found.len())
        };
        let error = count(&Receiver::default(), 0).unwrap_err().to_string();
        assert!(error.contains("pulse 7") && error.contains("4096 photons"), "{error}");
        let help = |dead_time: f64| format!("{:?}", too_many(0, 7, 1e4, dead_time));
        assert!(help(0.0).contains("set the receiver's `dead_time_ns`"), "{}", help(0.0));
        assert!(help(1e-4).contains("raise the receiver's `dead_time_ns`"), "{}", help(1e-4));
        assert_eq!(count(&Receiver::default(), 20).unwrap(), 20);
        assert!(count(&Receiver { dead_time: 3.0, ..Receiver::default() }, 0).unwrap() < 10);
    }

    #[test]
    fn the_receiver_is_blind_after_a_photon() {
        let near = |dead_time: f64| {
            let found = photons(&Receiver { dead_time, ..Receiver::default() }, 5.0, 4000);
            let close =
                |f: &Vec<Return>| f.windows(2).filter(|p| p[1].range - p[0].range < 3.0 * LIGHT).count();
            found.iter().map(close).sum::<usize>()
        };
        assert_eq!(near(3.0), 0);
        assert!(near(0.0) > 1000);
    }

    #[test]
    fn pixels_share_the_light_and_count_it_once_each() {
        // The dead time is longer than the pulse: K·(1 − e^(−N/K)).
        for (pixels, mean, expected) in
            [(1, 0.5, 0.393469), (1, 1.0, 0.632121), (4, 4.22, 2.607230), (16, 4.22, 3.709351)]
        {
            let pixels = PixelSettings { count: pixels, ..PixelSettings::default() };
            let found = photons(&Receiver { pixels, dead_time: 20.0, ..Receiver::default() }, mean, 20_000);
            let average = found.iter().map(Vec::len).sum::<usize>() as f64 / 20_000.0;
            assert!((average - expected).abs() < 0.03, "{pixels:?}: {average} is not {expected}");
            assert!(found.iter().all(|f| f.is_sorted_by(|a, b| a.range <= b.range)));
        }
    }

    #[test]
    fn jitter_widens_the_times_of_photons() {
        let spread = |jitter: f64| {
            let pixels = PixelSettings { jitter, ..PixelSettings::default() };
            let found = photons(&Receiver { pixels, ..Receiver::default() }, 1.0, 20_000);
            let squares: Vec<f64> = found.iter().flatten().map(|r| (r.range - 30.0).powi(2)).collect();
            squares.iter().sum::<f64>() / squares.len() as f64
        };
        let (sharp, wide) = (spread(0.0), spread(2.0));
        let expected = sharp + (2.0 * LIGHT).powi(2);
        assert!((wide / expected - 1.0).abs() < 0.05, "{wide} is not {expected}");
    }

    #[test]
    fn afterpulses_follow_the_dead_time() {
        let of = |afterpulse: Option<(f64, f64)>| {
            let pixels = PixelSettings { afterpulse, ..PixelSettings::default() };
            photons(&Receiver { pixels, dead_time: 5.0, ..Receiver::default() }, 0.2, 30_000)
        };
        let count = |found: &[Vec<Return>]| found.iter().map(Vec::len).sum::<usize>() as f64;
        let (without, with) = (of(None), of(Some((0.3, 4.0))));
        // Each event has 0.3 afterpulses, which have afterpulses themselves.
        let ratio = count(&with) / count(&without);
        assert!((ratio * 0.7 - 1.0).abs() < 0.06, "{ratio}");
        let noise = with.iter().flatten().filter(|r| r.is_noise).count() as f64;
        assert!((noise / count(&with) - 0.3).abs() < 0.03, "{noise}");
        let gaps = with.iter().flat_map(|f| f.windows(2)).map(|pair| pair[1].range - pair[0].range);
        assert!(gaps.fold(f64::INFINITY, f64::min) >= 5.0 * LIGHT * (1.0 - 1e-12));
    }

    #[test]
    fn dark_counts_are_those_of_all_pixels() {
        // 0.1 per ns and pixel, a dead time of 10 ns: half of them in 1000 ns.
        let detector = refined();
        let pixels = PixelSettings { count: 2, dark_counts: 1e8, ..PixelSettings::default() };
        let receiver = Receiver { pixels, dead_time: 10.0, ..Receiver::default() };
        let counter = counter(&receiver, &detector.shape, (100.0, 1100.0));
        let (dark, mut sum) = (received(&[], &detector), 0.0);
        for pulse in 0..300 {
            let mut found = Vec::new();
            counter.count(&dark, &detector, (0, pulse), |_| true, &mut found).unwrap();
            sum += found.len() as f64 / 300.0;
        }
        assert!(counter.has_background() && (sum / 100.0 - 1.0).abs() < 0.02, "{sum}");
    }

    #[test]
    fn constant_light_is_counted_at_the_non_paralysable_rate() {
        // Background of rate r with dead time d: r/(1 + r·d) events per time (Müller 1973).
        let detector = refined();
        let shot = Some(ShotNoise { background: 1e-9, responsivity: ELECTRON * 1e9 * 0.2 * 1e9 });
        for (dead_time, expected) in [(0.0, 200.0), (10.0, 200.0 / 3.0)] {
            let receiver = Receiver { shot, dead_time, ..Receiver::default() };
            let counter = counter(&receiver, &detector.shape, (100.0, 1100.0));
            let (dark, mut sum) = (received(&[], &detector), 0.0);
            for pulse in 0..500 {
                let mut found = Vec::new();
                counter.count(&dark, &detector, (1, pulse), |_| true, &mut found).unwrap();
                assert!(
                    found.iter().all(|r| r.is_noise && (100.0 * LIGHT..1100.0 * LIGHT).contains(&r.range))
                );
                sum += found.len() as f64;
            }
            assert!((sum / 500.0 / expected - 1.0).abs() < 0.02, "{} for {expected}", sum / 500.0);
        }
    }

    #[test]
    fn photons_from_beyond_the_next_pulse_count_within_the_stated_window() {
        // 490 km away at 10 kHz; without a window, a range beyond the next pulse has no photons.
        for (range_max, expected) in [(490_020.0, 5.0), (f64::INFINITY, 0.0)] {
            let mut device = tls_device(4.0);
            (device.detector.range_min, device.detector.range_max) = (489_980.0, range_max);
            device.detector.threshold = 1e-9;
            device.detector.threshold_given = true;
            device.receiver.ranging = Ranging::Photons;
            let table = InstrumentTable::new(&survey(vec![device]), &PhysicsOptions::refined()).unwrap();
            let instrument = table.instrument(0, 0).unwrap();
            let (counter, detector) = (instrument.counter.as_ref().unwrap(), &instrument.detector);
            let waveform =
                received(&[(490_000.0, 5.0 * detector.rule.threshold / detector.shape.top)], detector);
            let mut sum = 0.0;
            for pulse in 0..400 {
                let mut found = Vec::new();
                counter.count(&waveform, detector, (0, pulse), |_| true, &mut found).unwrap();
                sum += found.len() as f64 / 400.0;
            }
            assert!((sum - expected).abs() < 0.5, "{sum} for {expected}");
        }
    }

    #[test]
    fn impossible_counters_are_named() {
        let shape = PulseShape::raised_cosine(4.0, 0.1);
        let of = |receiver: Receiver, threshold: f64| {
            PhotonCounter::new(&receiver, &shape, threshold, ((0.0, 1e6), 0), 1)
        };
        assert!(of(Receiver::default(), 2.0).unwrap().is_none());
        let photons = Receiver { ranging: Ranging::Photons, ..Receiver::default() };
        assert!(of(photons.clone(), 0.0).unwrap_err().to_string().contains("max_range"));
        let shot = Some(ShotNoise { background: 1e-6, responsivity: 0.5 });
        assert!(of(Receiver { shot, ..photons }, 2.0).unwrap_err().to_string().contains("background_w"));
    }
}
