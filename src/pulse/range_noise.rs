//! Noise of measured ranges (spec pulse-physics §4.8).

use super::echo::Echo;
use super::instrument::InstrumentTable;
use crate::Result;
use crate::rng::{NORMALS_PER_BLOCK, Stream};

/// Adds noise to the ranges of at most [`NORMALS_PER_BLOCK`] echoes and computes their positions. The noise is a
/// function of device, pulse and return number alone.
#[inline(always)]
pub(super) fn apply_noise(
    echoes: &mut [Echo],
    stream: &Stream,
    instruments: &InstrumentTable,
    leg: u32,
) -> Result<()> {
    let (mut device, mut number, mut counter) =
        ([0; NORMALS_PER_BLOCK], [0; NORMALS_PER_BLOCK], [0; NORMALS_PER_BLOCK]);
    let mut accuracy = [0.0; NORMALS_PER_BLOCK];
    for (i, echo) in echoes.iter().enumerate() {
        (device[i], number[i], counter[i]) = (echo.device, echo.pulse_number, echo.return_number - 1);
        accuracy[i] = instruments.instrument(leg, echo.device)?.range_accuracy;
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
            }
        }
    }
    for echo in echoes {
        echo.position = echo.origin + echo.direction * echo.range;
    }
    Ok(())
}
