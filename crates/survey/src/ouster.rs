//! Calibration files of Ouster sensors as instruments.
//!
//! The sensor exports its calibration as one JSON file. Its beams have altitudes and azimuths relative to the
//! column that fires, and all of them leave from a circle around the axis:
//!
//! ```text
//! position = n·ê(θ) + (r − n)·d(θ − azimuth, altitude)      θ = −2π·column/columns
//! ```
//!
//! with the range r that the sensor reports and the distance n of the beams' origin from the axis (Ouster,
//! "Sensor Data: Coordinate Frames and XYZ Calculation"). The axes here are those of an emitter: the sensor's
//! x axis, towards its connector, where column 0 fires, is y (forward); the sensor turns clockwise seen from
//! above. Ranges are measured from the origin of the beam, so they are r − n.
//!
//! The file does not describe beam and receiver: they come from the built-in entry of its product line.

use super::beams::{Beams, beam_pose};
use super::context::Context;
use super::documents::find_asset;
use super::instrument::read_scanner;
use super::{Device, HeadTurn, Mount, Scanner};
use serde_json::{Map, Value};
use std::f64::consts::TAU;
use std::path::Path;
use vlscan_base::diag::Place;
use vlscan_base::recognise::{Expected, foreign};
use vlscan_geom::DVec3;

/// Maximum size of a file, bytes.
const MAX_FILE_BYTES: u64 = 1 << 22;
const MAX_BEAMS: usize = 1024;
/// Maximum number of columns per revolution, eight times that of today's sensors.
const MAX_COLUMNS: f64 = 16384.0;
const MAX_FRAME_RATE: f64 = 100.0;
/// Largest distance of a beam's origin from the centre of the sensor, mm.
const MAX_ORIGIN: f64 = 1000.0;
/// Distance of the beams' origin from the axis in sensors whose firmware is older than 1.14 and does not
/// state it, mm (Ouster SDK, default for such files).
const ORIGIN_BEFORE_1_14: f64 = 12.163;
/// Product lines and the built-in entries of their beams and receivers.
const PRODUCTS: [(&str, &str); 3] =
    [("OS-0", "ouster_os0-128"), ("OS-1", "ouster_os1-128"), ("OS-2", "ouster_os2-128")];
/// The entry of other product lines.
const OTHER_PRODUCT: &str = "ouster_os1-128";

/// True if a scanner reference names a calibration file.
pub(super) fn is_calibration(reference: &str) -> bool {
    Path::new(reference).extension().is_some_and(|ending| ending.eq_ignore_ascii_case("json"))
}

/// Reads the calibration file `name`, searched from `folder`. Problems are recorded; `place` is that of the
/// reference.
pub(super) fn read_calibration(
    context: &Context,
    name: &str,
    folder: &Path,
    place: Option<Place>,
) -> Option<Scanner> {
    with_calibration(context, name, folder, place, |calibration| calibration.scanner())
}

/// Reads only the beams of a calibration file, like [`read_calibration`]; the file may lack the mode.
pub(super) fn read_beams(context: &Context, name: &str, folder: &Path, place: Place) -> Option<Beams> {
    with_calibration(context, name, folder, Some(place), |calibration| calibration.beams())
}

fn with_calibration<T>(
    context: &Context,
    name: &str,
    folder: &Path,
    place: Option<Place>,
    take: impl FnOnce(&Calibration) -> Option<T>,
) -> Option<T> {
    let path = context.file(name, folder, place.clone())?;
    let bytes = match context.read(&path, MAX_FILE_BYTES) {
        Ok(bytes) => bytes,
        Err(e) => {
            context.unread(place, &path, &e);
            return None;
        }
    };
    if let Some(found) = foreign(&path, &bytes, &Expected::CALIBRATION) {
        found.report(&path, &mut context.problems.borrow_mut());
        return None;
    }
    let text = context.text(&path, &bytes)?;
    match serde_json::from_str::<Map<String, Value>>(&text) {
        Ok(root) => take(&Calibration { context, path: &path, text: &text, root }),
        Err(e) => {
            let line = text.lines().nth(e.line().saturating_sub(1)).unwrap_or_default();
            let at = Place::in_line(&path, e.line().max(1), line, 0..line.len());
            context.error(at, format!("no calibration file: {e}"));
            None
        }
    }
}

struct Calibration<'a> {
    context: &'a Context,
    path: &'a Path,
    text: &'a str,
    root: Map<String, Value>,
}

/// A frame: columns of a revolution and revolutions per second.
struct Frame {
    columns: u32,
    rate: f64,
}

impl Calibration<'_> {
    fn beams(&self) -> Option<Beams> {
        let altitudes = self.angles(&["beam_altitude_angles", "beam_altitude_deg"], 90.0);
        let azimuths = self.angles(&["beam_azimuth_angles", "beam_azimuth_deg"], 360.0);
        let origin = self.origin();
        let (altitudes, azimuths, origin) = (altitudes?, azimuths?, origin?);
        self.check_counts(&altitudes, &azimuths)?;
        Some(Beams { altitudes, azimuths, origin })
    }

    fn scanner(&self) -> Option<Scanner> {
        let (beams, frame) = (self.beams(), self.frame());
        let (Beams { altitudes, azimuths, origin }, frame) = (beams?, frame?);
        self.warn_of_window(&frame);
        let product = self.product();
        let mut scanner = self.model(&product)?;
        let model = scanner.devices.swap_remove(0);
        let beam = |(i, (altitude, azimuth)): (usize, (&f64, &f64))| Device {
            id: i.to_string(),
            beam_origin: beam_pose(&Mount { offset: origin, ..Mount::IDENTITY }, *altitude, *azimuth),
            ..model.clone()
        };
        let step = TAU / f64::from(frame.columns);
        Some(Scanner {
            id: product.clone(),
            name: product,
            pulse_freqs: vec![(f64::from(frame.columns) * frame.rate).round() as u32],
            devices: altitudes.iter().zip(&azimuths).enumerate().map(beam).collect(),
            multi_channel: true,
            // From column 0 to the last one, with any rounding.
            turn: Some(HeadTurn {
                rate: -TAU * frame.rate,
                start: 0.0,
                stop: -(f64::from(frame.columns) - 0.5) * step,
            }),
            ..scanner
        })
    }

    /// The value of the first of these names, at the top or in a section, and the name.
    fn value<'n>(&self, names: &[&'n str]) -> Option<(&'n str, &Value)> {
        let sections =
            ["beam_intrinsics", "lidar_data_format", "data_format", "config_params", "sensor_info"];
        let tables = std::iter::once(&self.root)
            .chain(sections.into_iter().filter_map(|section| self.root.get(section)?.as_object()));
        tables.into_iter().find_map(|table| names.iter().find_map(|name| Some((*name, table.get(*name)?))))
    }

    /// The line of a key, or the file.
    fn place(&self, name: &str) -> Place {
        let quoted = format!("\"{name}\"");
        match self.text.find(&quoted) {
            Some(at) => Place::in_text(self.path, self.text, at..at + quoted.len()),
            None => Place::of_file(self.path),
        }
    }

    fn refuse<T>(&self, name: &str, expected: &str) -> Option<T> {
        self.context.error(self.place(name), format!("`{name}` must be {expected}"));
        None
    }

    fn missing<T>(&self, names: &[&str]) -> Option<T> {
        let message = format!("`{}` is missing in this calibration file", names[0]);
        let help = "expected the metadata that an Ouster sensor writes of itself: angles of the beams, \
                    origin and mode";
        self.context.error_help(Place::of_file(self.path), message, help);
        None
    }

    /// Angles of all beams, degrees.
    fn angles(&self, names: &[&str], limit: f64) -> Option<Vec<f64>> {
        let Some((name, value)) = self.value(names) else { return self.missing(names) };
        let list = numbers(value).filter(|list| {
            (1..=MAX_BEAMS).contains(&list.len()) && list.iter().all(|angle| angle.abs() <= limit)
        });
        list.or_else(|| {
            self.refuse(name, &format!("1 to {MAX_BEAMS} angles from -{limit} to {limit} degrees"))
        })
    }

    /// Origin of the beams in the frame of the emitter, m.
    fn origin(&self) -> Option<DVec3> {
        if let Some((name, value)) = self.value(&["beam_to_lidar_transform"]) {
            let rows = numbers(value).filter(|m| m.len() == 16 && m.iter().all(|x| x.abs() <= MAX_ORIGIN));
            let Some(m) = rows else { return self.refuse(name, "16 numbers, a transformation in mm") };
            if [m[0], m[5], m[10]].iter().any(|x| (x - 1.0).abs() > 1e-6) {
                return self.refuse(name, "a transformation without rotation");
            }
            return Some(DVec3::new(-m[7], m[3], m[11]) * 1e-3);
        }
        let radius = match self.value(&["lidar_origin_to_beam_origin_mm", "origin_to_beam_mm"]) {
            Some((name, value)) => match value.as_f64().filter(|mm| mm.abs() <= MAX_ORIGIN) {
                Some(mm) => mm,
                None => return self.refuse(name, &format!("a length of at most {MAX_ORIGIN} mm")),
            },
            None => {
                let message = format!(
                    "the file states no `lidar_origin_to_beam_origin_mm`; {ORIGIN_BEFORE_1_14} mm is used, \
                     that of sensors with firmware before 1.14"
                );
                self.context.warn(Place::of_file(self.path), message);
                ORIGIN_BEFORE_1_14
            }
        };
        Some(DVec3::new(0.0, radius * 1e-3, 0.0))
    }

    fn frame(&self) -> Option<Frame> {
        const MODE: &str = "a mode such as 1024x10: columns of a revolution and revolutions per second";
        let names = ["lidar_mode", "mode"];
        let Some((name, value)) = self.value(&names) else { return self.missing(&names) };
        let mode = value.as_str().and_then(|mode| {
            let (columns, rate) = mode.split_once('x')?;
            Some((columns.parse::<f64>().ok()?, rate.parse::<f64>().ok()?))
        });
        let is_usable = |(columns, rate): &(f64, f64)| {
            columns.fract() == 0.0
                && (1.0..=MAX_COLUMNS).contains(columns)
                && (0.01..=MAX_FRAME_RATE).contains(rate)
        };
        let Some((columns, rate)) = mode.filter(is_usable) else { return self.refuse(name, MODE) };
        for (other, stated) in [(["columns_per_frame", "columns"].as_slice(), columns), (&["fps"], rate)] {
            if let Some((other, value)) = self.value(other)
                && value.as_f64() != Some(stated)
            {
                return self.refuse(other, &format!("{stated}, as the `{name}` says"));
            }
        }
        Some(Frame { columns: columns as u32, rate })
    }

    fn check_counts(&self, altitudes: &[f64], azimuths: &[f64]) -> Option<()> {
        if altitudes.len() != azimuths.len() {
            let message = format!(
                "{} altitudes of beams and {} azimuths, expected the same number",
                altitudes.len(),
                azimuths.len()
            );
            self.context.error(Place::of_file(self.path), message);
            return None;
        }
        if altitudes.iter().all(|angle| *angle == 0.0) && altitudes.len() > 1 {
            return self
                .refuse("beam_altitude_angles", "the angles of a calibrated sensor; all of them are 0");
        }
        match self.value(&["pixels_per_column"]) {
            Some((name, value)) if value.as_u64() != Some(altitudes.len() as u64) => {
                self.refuse(name, &format!("{}, the number of altitudes", altitudes.len()))
            }
            _ => Some(()),
        }
    }

    /// Warns of a sensor that sends only some of its columns.
    fn warn_of_window(&self, frame: &Frame) {
        let Some((name, value)) = self.value(&["column_window"]) else { return };
        let last = f64::from(frame.columns - 1);
        if numbers(value).as_deref() != Some(&[0.0, last]) {
            let message = format!("the sensor sends the columns {value} alone; all of them are simulated");
            let help = "cut the points outside of the window, whose columns are the numbers of the pulses";
            self.context.warn_help(self.place(name), message, help);
        }
    }

    /// Product line, such as `OS-1-128`.
    fn product(&self) -> String {
        let name = self.value(&["prod_line", "product"]).and_then(|(_, value)| value.as_str());
        name.unwrap_or("Ouster").to_owned()
    }

    /// The built-in scanner whose beam and receiver a product has.
    fn model(&self, product: &str) -> Option<Scanner> {
        let entry = PRODUCTS.iter().find(|(line, _)| product.starts_with(line)).map(|(_, entry)| *entry);
        if entry.is_none() {
            let message = format!(
                "the product `{product}` is not in the catalogue; beam and receiver are those of \
                 {OTHER_PRODUCT}"
            );
            let help =
                "keys of [scanner] replace them: beam_divergence_rad, range_min_m, max_range, range_noise";
            self.context.warn_help(Place::of_file(self.path), message, help);
        }
        let entry = entry.unwrap_or(OTHER_PRODUCT);
        let element = find_asset(self.context, "scanner", entry, Path::new(""), None)?;
        read_scanner(self.context, &element)
    }
}

fn numbers(value: &Value) -> Option<Vec<f64>> {
    value.as_array()?.iter().map(Value::as_f64).collect()
}
