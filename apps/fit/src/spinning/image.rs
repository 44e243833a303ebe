//! A recorded revolution of a spinning sensor as an image of ranges, with the beam of each pixel.

use libm::{atan2, cos, rint, sin};
use std::f64::consts::TAU;
use std::path::Path;
use vlscan_base::diag::{Diagnostics, Place};
use vlscan_base::error::{Error, Result};
use vlscan_formats::read_number_columns;
use vlscan_geom::DVec3;
use vlscan_survey::Scanner;

/// Columns of a recording; the last ones may be missing.
const COLUMNS: [&str; 5] = ["beam", "column", "range_mm", "reflectivity", SIGNAL];
/// Column of the strength of echoes.
const SIGNAL: &str = "signal";
/// Maximum valid range, m.
const MAX_RANGE: f64 = 10_000.0;
/// Reflectivities up to 100 are per cent of a Lambertian reflector; beyond, retroreflectors have a scale of
/// their own.
const LAMBERTIAN: f64 = 100.0;
/// Help for recordings that do not match the calibration.
const OTHER_SENSOR: &str = "give the calibration file of the sensor that recorded them";

/// Ranges of a revolution by row and azimuth: rows are beams by descending elevation, azimuths are columns,
/// from which beams that look aside are shifted.
#[derive(Clone, Debug)]
pub struct RangeImage {
    /// Rows, which are beams.
    pub rows: usize,
    /// Columns of a revolution.
    pub columns: usize,
    /// Pixels row by row.
    pub pixels: Vec<Pixel>,
    /// Reported ranges are multiples of it, m.
    pub range_step: f64,
    /// True if strengths are those of a recorded signal; otherwise reflectance over squared range.
    pub has_signal: bool,
}

/// A pulse and its echo.
#[derive(Clone, Copy, Debug)]
pub struct Pixel {
    /// Origin of the beam in the sensor's frame, m.
    pub origin: DVec3,
    /// Direction of the beam, unit.
    pub direction: DVec3,
    /// Column in which it fired.
    pub column: u32,
    /// Range from the origin of the beam, m; NaN without an echo.
    pub range: f64,
    /// Reflectance of a Lambertian target that faces the beam, as reported by the sensor; NaN for
    /// retroreflectors.
    pub reflectance: f64,
    /// Strength of the echo, in the unit of the signal; NaN without an echo.
    pub strength: f64,
}

impl Pixel {
    /// True if the pulse has an echo.
    pub fn is_seen(&self) -> bool {
        self.range.is_finite()
    }
}

impl RangeImage {
    /// Reads a recording of one revolution: a Parquet table with the columns `beam`, `column`, `range_mm` (0
    /// without an echo), `reflectivity` (per cent) and, if there is one, `signal`. `scanner` is the
    /// calibrated sensor. Other columns are noted in `found`.
    ///
    /// # Errors
    /// [`Error::Input`] for columns that are missing, for pixels that the sensor does not have, and for at
    /// most half of its beams.
    pub fn read(path: &Path, scanner: &Scanner, found: &mut Diagnostics) -> Result<RangeImage> {
        let mut table = read_number_columns(path, &|name| COLUMNS.contains(&name))?;
        if let Some(message) = table.unread_message() {
            found.note(Some(Place::of_file(path)), message);
        }
        let signal = table.take(SIGNAL);
        let mut needed = Vec::new();
        for name in &COLUMNS[..4] {
            let missing = || {
                let message = format!(
                    "{} has no column `{name}` of numbers; a recording of a spinning sensor has {}, and \
                     `{SIGNAL}` if it is recorded",
                    path.display(),
                    COLUMNS[..4].join(", ")
                );
                Error::input(message)
            };
            needed.push(table.take(name).ok_or_else(missing)?);
        }
        let mut image = RangeImage::empty(scanner)?;
        check_beams(path, &needed[0], image.rows)?;
        image.has_signal = signal.is_some();
        let place_of = image.places(scanner);
        let mut step = 0;
        for row in 0..needed[0].len() {
            let [beam, column, range_mm, reflectivity] = [0, 1, 2, 3].map(|i| needed[i][row]);
            let is_pixel = beam >= 0.0 && column >= 0.0 && beam.fract() == 0.0 && column.fract() == 0.0;
            let at = is_pixel.then(|| place_of(beam as usize, column as usize)).flatten();
            let Some(at) = at else {
                let message = format!(
                    "{}, row {row}: beam {beam} and column {column}, expected one of the {} beams and {} \
                     columns of the sensor",
                    path.display(),
                    image.rows,
                    image.columns
                );
                return Err(Error::input_with_help(message, OTHER_SENSOR));
            };
            if range_mm == 0.0 {
                continue;
            }
            let pixel = &mut image.pixels[at];
            // Sensors report the distance from their axis.
            let range = range_mm * 1e-3 - pixel.origin.length();
            if !(range > 0.0 && range < MAX_RANGE) {
                return Err(Error::input(format!(
                    "{}, row {row}: a range of {range_mm} mm, expected 0 or one up to {MAX_RANGE} m",
                    path.display()
                )));
            }
            step = greatest_divisor(step, range_mm as u64);
            pixel.range = range;
            if reflectivity <= LAMBERTIAN {
                pixel.reflectance = reflectivity / LAMBERTIAN;
            }
            pixel.strength = match &signal {
                Some(signal) => signal[row],
                None => reflectivity / LAMBERTIAN / (range * range),
            };
        }
        image.range_step = step as f64 * 1e-3;
        Ok(image)
    }

    /// The image of a sensor without echoes.
    pub(super) fn empty(scanner: &Scanner) -> Result<RangeImage> {
        let turn = scanner.turn.ok_or_else(|| {
            Error::input(
                "the calibration states no revolutions per second; expected the file of a spinning sensor",
            )
        })?;
        let step = turn.rate / f64::from(scanner.pulse_freqs[0]);
        let columns = rint(TAU / step.abs()) as usize;
        let (rows, mut pixels) = (scanner.devices.len(), Vec::new());
        for row in order(scanner) {
            let pose = scanner.devices[row].beam_origin;
            for at in 0..columns {
                let column = (at + columns - shift(scanner, row, columns)) % columns;
                let (sine, cosine) = (sin(step * column as f64), cos(step * column as f64));
                let turned = |v: DVec3| DVec3::new(v.x * cosine - v.y * sine, v.x * sine + v.y * cosine, v.z);
                pixels.push(Pixel {
                    origin: turned(pose.offset),
                    direction: turned(pose.rotation.forward()),
                    column: column as u32,
                    range: f64::NAN,
                    reflectance: f64::NAN,
                    strength: f64::NAN,
                });
            }
        }
        Ok(RangeImage { rows, columns, pixels, range_step: 0.0, has_signal: false })
    }

    /// The index of the pixel of a beam and a column of the recording.
    fn places<'s>(&self, scanner: &'s Scanner) -> impl Fn(usize, usize) -> Option<usize> + use<'s> {
        let (rows, columns) = (self.rows, self.columns);
        let mut row_of = vec![0; rows];
        order(scanner).into_iter().enumerate().for_each(|(row, beam)| row_of[beam] = row);
        let shifts: Vec<usize> = (0..rows).map(|beam| shift(scanner, beam, columns)).collect();
        move |beam, column| {
            (beam < rows && column < columns)
                .then(|| row_of[beam] * columns + (column + shifts[beam]) % columns)
        }
    }
}

/// Checks that more than half of the `rows` beams of the calibration are in the recording: sensors of a
/// product line have twice or four times the beams of others, at other angles.
fn check_beams(path: &Path, beams: &[f64], rows: usize) -> Result<()> {
    let recorded = beams.iter().copied().fold(-1.0, f64::max) + 1.0;
    if 2.0 * recorded > rows as f64 {
        return Ok(());
    }
    let message =
        format!("{} has rows of {recorded} beams, the sensor of the calibration {rows}", path.display());
    Err(Error::input_with_help(message, OTHER_SENSOR))
}

/// Beams by descending elevation.
fn order(scanner: &Scanner) -> Vec<usize> {
    let height = |beam: &usize| scanner.devices[*beam].beam_origin.rotation.forward().z;
    let mut beams: Vec<usize> = (0..scanner.devices.len()).collect();
    beams.sort_by(|a, b| height(b).total_cmp(&height(a)));
    beams
}

/// Columns by which a beam looks ahead of the column that fires, clockwise.
fn shift(scanner: &Scanner, beam: usize, columns: usize) -> usize {
    let forward = scanner.devices[beam].beam_origin.rotation.forward();
    let ahead = rint(atan2(forward.x, forward.y) / TAU * columns as f64) as i64;
    let is_clockwise = scanner.turn.is_none_or(|turn| turn.rate < 0.0);
    (if is_clockwise { ahead } else { -ahead }).rem_euclid(columns as i64) as usize
}

fn greatest_divisor(a: u64, b: u64) -> u64 {
    if b == 0 { a } else { greatest_divisor(b, a % b) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_recording_of_half_of_the_beams_is_of_another_sensor() {
        let beams = |count: u32| -> Vec<f64> { (0..count).map(f64::from).collect() };
        let check = |count: u32| check_beams(Path::new("a.parquet"), &beams(count), 128);
        assert!(check(128).is_ok() && check(65).is_ok());
        let message = check(64).unwrap_err().to_string();
        assert!(message.contains("a.parquet has rows of 64 beams") && message.contains("128"), "{message}");
        assert!(check(0).unwrap_err().to_string().contains("0 beams"));
    }
}
