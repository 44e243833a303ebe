//! Noise of measured ranges (spec pulse-physics §4.8).

use super::Echo;
use super::instrument::Fleet;
use crate::Result;
use crate::rng::{self, Stream};

/// Adds noise to the ranges of some echoes, as many as are drawn together or less, and puts them where they are measured.
/// The noise is a function of device, pulse and return number alone.
#[inline(always)]
pub(super) fn disturb(echoes: &mut [Echo], stream: &Stream, fleet: &Fleet, leg: u32) -> Result<()> {
    let (mut device, mut number, mut counter) = ([0; rng::LANES], [0; rng::LANES], [0; rng::LANES]);
    let mut accuracy = [0.0; rng::LANES];
    for (i, echo) in echoes.iter().enumerate() {
        (device[i], number[i], counter[i]) = (echo.device, echo.pulse_number, echo.return_number - 1);
        accuracy[i] = fleet.instrument(leg, echo.device)?.range_accuracy;
    }
    if accuracy != [0.0; rng::LANES] {
        let drawn = stream.normals(&device, &number, &counter);
        for (i, echo) in echoes.iter_mut().enumerate() {
            let mut noise = accuracy[i] * drawn[i];
            if let Some(factor) = &fleet.instrument(leg, echo.device)?.distance_error {
                noise *= factor.eval(echo.range);
            }
            if accuracy[i] != 0.0 {
                echo.range += noise;
            }
        }
    }
    for echo in echoes {
        echo.position = echo.origin + echo.direction * echo.range;
    }
    Ok(())
}
