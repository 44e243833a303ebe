//! Pulse and beam of a device.

use super::fmcw;
use super::footprint::Footprint;
use super::sampled;
use super::shape::{self, PulseShape, sample_count};
use super::subray::Subrays;
use vlscan_base::corrections::Corrections;
use vlscan_base::quantity::number;
use vlscan_base::{Error, Result};
use vlscan_survey::{Device, pulse_length_of_width};

/// Maximum number of rings of subrays: 512 rings are 822,000 rays per pulse.
const MAX_RINGS: u32 = 512;
const MAX_PULSE_BINS: f64 = (1u32 << 20) as f64;

/// The pulse that a device emits, in its bins.
pub(super) fn pulse_shape(device: &Device, corrections: &Corrections) -> PulseShape {
    match &device.receiver.pulse_shape {
        Some(pulse) if corrections.receiver => PulseShape::measured(pulse, device.waveform.bin),
        _ => {
            let length = pulse_length(device, corrections);
            match corrections.symmetric_pulse {
                true => PulseShape::raised_cosine(length, device.waveform.bin),
                false => PulseShape::new(length, corrections.whole_pulse, &device.waveform),
            }
        }
    }
}

/// Length of the pulse of a device, ns, in the reference's measure; that of the echo of a chirp.
fn pulse_length(device: &Device, corrections: &Corrections) -> f64 {
    let wave = device.receiver.fmcw.as_ref().filter(|_| corrections.receiver);
    wave.map_or_else(
        || device.beam.length(corrections.stated_pulse_widths),
        |wave| pulse_length_of_width(fmcw::width(wave)),
    )
}

/// The subrays of a beam.
pub(super) fn subrays(device: &Device, half_angles: [f64; 2], c: &Corrections) -> Subrays {
    let rings = device.waveform.quality;
    if c.equal_energy {
        Subrays::of_equal_energy(&footprint(device, half_angles), rings)
    } else {
        Subrays::new(half_angles[0], rings)
    }
}

/// The distribution of a beam's energy across its axis.
pub(super) fn footprint(device: &Device, half_angles: [f64; 2]) -> Footprint {
    Footprint { profile: device.beam.profile, half_angles, exit_radius: device.beam.aperture * 0.5 }
}

/// Rejects settings of pulse and beam that no device can have.
pub(super) fn check(device: &Device, corrections: &Corrections) -> Result<()> {
    let w = &device.waveform;
    let duration = match &device.receiver.pulse_shape {
        Some(pulse) if corrections.receiver => sampled::duration(pulse),
        _ => shape::duration_of(pulse_length(device, corrections), corrections),
    };
    let problem = if !(w.bin > 0.0 && w.bin.is_finite()) {
        format!("binSize_ns is {}, expected a positive number", w.bin)
    } else if !(duration.is_finite() && duration / w.bin <= MAX_PULSE_BINS) {
        format!(
            "a pulse of {} ns does not fit into a million bins of {} ns; choose a larger bin_ns (in XML \
             binSize_ns)",
            number(duration),
            number(w.bin)
        )
    } else if w.quality > MAX_RINGS {
        format!("beamSampleQuality is {}, expected at most {MAX_RINGS}", w.quality)
    } else {
        debug_assert!(sample_count(duration, w.bin) <= MAX_PULSE_BINS as usize);
        return Ok(());
    };
    Err(Error::input(format!("device {}: {problem}", device.id)))
}
