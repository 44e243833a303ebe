//! Noise of measured ranges (spec pulse-physics §4.8).

use super::batch::Batch;
use super::echo::{Echo, WaveformRecord};
use super::instrument::InstrumentTable;
use std::collections::HashSet;
use vlscan_base::Result;
use vlscan_base::rng::{NORMALS_PER_BLOCK, Stream};

/// Adds noise to the ranges of at most [`NORMALS_PER_BLOCK`] echoes, rounds them to the steps of the
/// instrument and computes their positions. The noise is a function of device, pulse and return number alone.
/// Returns whether it puts an echo outside the instrument's range limits.
#[inline(always)]
pub(super) fn apply_noise(
    echoes: &mut [Echo],
    stream: &Stream,
    instruments: &InstrumentTable,
    leg: u32,
) -> Result<bool> {
    let mut is_outside = false;
    let (mut device, mut number, mut counter) =
        ([0; NORMALS_PER_BLOCK], [0; NORMALS_PER_BLOCK], [0; NORMALS_PER_BLOCK]);
    let (mut accuracy, mut has_step) = ([0.0; NORMALS_PER_BLOCK], false);
    for (i, echo) in echoes.iter().enumerate() {
        (device[i], number[i], counter[i]) = (echo.device, echo.pulse_number, echo.return_number - 1);
        let instrument = instruments.instrument(leg, echo.device)?;
        accuracy[i] = instrument.range_sigma(echo);
        has_step |= instrument.range_step > 0.0;
    }
    if accuracy != [0.0; NORMALS_PER_BLOCK] {
        let drawn = stream.normals(&device, &number, &counter);
        for (i, echo) in echoes.iter_mut().enumerate() {
            let mut noise = accuracy[i] * drawn[i];
            if let Some(factor) = &instruments.instrument(leg, echo.device)?.distance_error {
                noise *= factor.number("distance measurement error", echo.range)?;
            }
            if accuracy[i] != 0.0 {
                echo.range += noise;
                is_outside |= !instruments.instrument(leg, echo.device)?.detector.is_in_range(echo.range);
            }
        }
    }
    if has_step {
        for echo in echoes.iter_mut() {
            let instrument = instruments.instrument(leg, echo.device)?;
            if instrument.range_step > 0.0 {
                echo.range = libm::rint(echo.range / instrument.range_step) * instrument.range_step;
                is_outside |= !instrument.detector.is_in_range(echo.range);
            }
        }
    }
    for echo in echoes {
        echo.position = echo.origin + echo.direction * echo.range;
    }
    Ok(is_outside)
}

/// Removes the echoes of `batch` from number `first` on whose noisy range is outside the limits of their
/// instrument, as its range gate does, and renumbers the returns of their pulses. Waveforms of pulses that
/// lose all echoes go, too.
#[inline(never)]
pub(super) fn remove_outside(
    batch: &mut Batch,
    first: usize,
    instruments: &InstrumentTable,
    leg: u32,
) -> Result<()> {
    let pulse_of = |echo: &Echo| (echo.device, echo.pulse_number);
    let mut empty = HashSet::new();
    let (mut from, mut to) = (first, first);
    while from < batch.echoes.len() {
        let pulse = pulse_of(&batch.echoes[from]);
        let count = batch.echoes[from..].iter().take_while(|echo| pulse_of(echo) == pulse).count();
        let instrument = instruments.instrument(leg, pulse.0)?;
        let kept_from = to;
        let mut removed = 0;
        for i in from..from + count {
            let echo = batch.echoes[i];
            if instrument.moves_ranges() && !instrument.detector.is_in_range(echo.range) {
                removed += 1;
                continue;
            }
            batch.echoes[to] = Echo { return_number: echo.return_number - removed, ..echo };
            to += 1;
        }
        for echo in &mut batch.echoes[kept_from..to] {
            echo.number_of_returns -= removed;
        }
        if kept_from == to {
            empty.insert(pulse);
        }
        from += count;
    }
    batch.echoes.truncate(to);
    remove_waveforms(batch, |wave| empty.contains(&(wave.device, wave.pulse_number)));
    Ok(())
}

/// Removes waveforms and their samples.
fn remove_waveforms(batch: &mut Batch, is_removed: impl Fn(&WaveformRecord) -> bool) {
    let Batch { waveforms, samples, .. } = batch;
    let mut len = 0;
    waveforms.retain_mut(|wave| {
        if is_removed(wave) {
            return false;
        }
        samples.copy_within(wave.first_sample..wave.first_sample + wave.samples, len);
        wave.first_sample = len;
        len += wave.samples;
        true
    });
    samples.truncate(len);
}
