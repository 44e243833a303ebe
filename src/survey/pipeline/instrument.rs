//! The `[scanner]` table.

use super::super::context::Context;
use super::super::scanner_xml::{DETECTOR, DEVICE_BEAM, WAVEFORM, read_scanner};
use super::super::{Deflector, Device, Formula, Head, MechanicalErrors, Mount, Prism, Receiver, Scanner};
use super::build::{pose, reference};
use super::keys::{InstrumentKeys, Key};
use super::receiver::{change_emission, change_receiver};
use super::source::Source;
use crate::geom::{DVec3, radians, unit};
use toml::Spanned;

/// What tables are read with.
pub(super) struct Values<'c> {
    pub context: &'c Context,
    pub source: &'c Source,
}

impl Values<'_> {
    /// Sets `target` if the key is given; it must be a finite number for which `holds`.
    pub fn set(&self, target: &mut f64, key: &Key<f64>, expected: &str, holds: fn(f64) -> bool) {
        let Some(key) = key else { return };
        let value = *key.get_ref();
        if value.is_finite() && holds(value) {
            *target = value;
        } else {
            self.refuse(key, expected);
        }
    }

    pub fn positive(&self, target: &mut f64, key: &Key<f64>) {
        self.set(target, key, "a number above 0", |v| v > 0.0);
    }

    pub fn not_negative(&self, target: &mut f64, key: &Key<f64>) {
        self.set(target, key, "a number of at least 0", |v| v >= 0.0);
    }

    pub fn number(&self, target: &mut f64, key: &Key<f64>) {
        self.set(target, key, "a finite number", |_| true);
    }

    /// Degrees in the file, radians in `target`.
    pub fn angle(&self, target: &mut f64, key: &Key<f64>) {
        if key.is_some() {
            let mut degrees = crate::geom::degrees(*target);
            self.number(&mut degrees, key);
            *target = radians(degrees);
        }
    }

    /// Three finite numbers.
    pub fn vector(&self, key: &Key<[f64; 3]>) -> Option<DVec3> {
        let key = key.as_ref()?;
        let vector = DVec3::from(*key.get_ref());
        if vector.is_finite() {
            return Some(vector);
        }
        self.refuse(key, "three finite numbers");
        None
    }

    pub fn formula(&self, key: &Key<String>) -> Option<Formula> {
        let key = key.as_ref()?;
        match Formula::parse(key.get_ref()) {
            Ok(formula) => Some(formula),
            Err(e) => {
                self.context.error(self.source.part_of(key, &e.at), e.message);
                None
            }
        }
    }

    pub fn refuse<T>(&self, key: &Spanned<T>, expected: &str) {
        self.context.error(self.source.place(key.span()), format!("expected {expected}"));
    }
}

/// The instrument of a `[scanner]` table, based on `inherited` (that of a survey) or its catalogue entry.
pub(super) fn read_instrument(
    values: &Values,
    table: &Spanned<InstrumentKeys>,
    inherited: Option<Scanner>,
) -> Option<Scanner> {
    let (context, keys) = (values.context, table.get_ref());
    let place = || values.source.place(table.span());
    let catalogue = match &keys.catalogue {
        None => inherited,
        Some(name) => {
            let element = reference(context, values.source, name, "scanner")?;
            Some(read_scanner(context, &element)?)
        }
    };
    if catalogue.is_none() && (keys.optics.is_none() || keys.pulse_freqs_hz.is_none()) {
        let message = "[scanner] needs `catalogue`, or both `optics` and `pulse_freqs_hz`";
        context.error_help(place(), message, "`vlscan catalogue` lists the scanners that ship");
        return None;
    }
    let mut scanner = catalogue.unwrap_or_else(|| Scanner {
        id: "scanner".to_owned(),
        name: "scanner".to_owned(),
        pulse_freqs: Vec::new(),
        devices: vec![bare_device()],
        multi_channel: false,
    });
    if let Some(id) = &keys.id {
        scanner.id.clone_from(id);
    }
    if let Some(name) = keys.name.as_ref().or(keys.id.as_ref()) {
        scanner.name.clone_from(name);
    }
    if let Some(freqs) = &keys.pulse_freqs_hz {
        scanner.pulse_freqs.clone_from(freqs.get_ref());
        if freqs.get_ref().is_empty() || freqs.get_ref().iter().any(|&f| f == 0 || f > i32::MAX as u32) {
            values.refuse(freqs, "frequencies above 0");
            return None;
        }
    }
    for device in &mut scanner.devices {
        change_device(values, device, keys);
    }
    if !scanner.multi_channel {
        scanner.devices[0].id.clone_from(&scanner.id);
    }
    if !keys.channel.is_empty() {
        let base = scanner.devices[0].clone();
        scanner.devices =
            keys.channel.iter().enumerate().map(|(i, c)| read_channel(values, &base, i, c)).collect();
        scanner.multi_channel = true;
    }
    Some(scanner)
}

fn read_channel(values: &Values, base: &Device, index: usize, table: &Spanned<InstrumentKeys>) -> Device {
    let keys = table.get_ref();
    let place = || values.source.place(table.span());
    if keys.catalogue.is_some()
        || keys.pulse_freqs_hz.is_some()
        || keys.name.is_some()
        || !keys.channel.is_empty()
    {
        let message = "a channel has no `catalogue`, `name`, `pulse_freqs_hz` or `channel` of its own";
        values.context.error(place(), message);
    }
    let mut device = base.clone();
    change_device(values, &mut device, keys);
    device.beam.atmosphere_wavelength = base.beam.atmosphere_wavelength;
    device.id = keys.id.clone().unwrap_or_else(|| index.to_string());
    device
}

/// A device about which nothing is said.
fn bare_device() -> Device {
    Device {
        id: String::new(),
        deflector: Deflector::Conic,
        scan_angle_max: 0.0,
        scan_freq: (0.0, 0.0),
        head: Head { axis: DVec3::Z, max_rate: 0.0 },
        beam_origin: Mount::IDENTITY,
        beam: DEVICE_BEAM,
        detector: DETECTOR,
        receiver: Receiver::default(),
        waveform: WAVEFORM,
        errors: MechanicalErrors::default(),
    }
}

fn change_device(values: &Values, device: &mut Device, keys: &InstrumentKeys) {
    values.angle(&mut device.scan_angle_max, &keys.scan_angle_max_deg);
    values.not_negative(&mut device.scan_freq.0, &keys.scan_freq_min_hz);
    values.not_negative(&mut device.scan_freq.1, &keys.scan_freq_max_hz);
    change_deflector(values, device, keys);
    if let Some(axis) = values.vector(&keys.head_axis) {
        device.head.axis = axis;
        if let (Some(key), true) = (&keys.head_axis, axis.length() <= 0.1) {
            values.refuse(key, "an axis longer than 0.1");
        }
    }
    values.angle(&mut device.head.max_rate, &keys.head_rate_max_deg_per_s);
    device.head.max_rate = device.head.max_rate.abs();
    if let Some(keys) = &keys.beam_origin {
        device.beam_origin = pose(values, keys);
    }
    change_beam(values, device, keys);
    change_emission(values, device, keys);
    change_receiver(values, device, keys);
    let detector = &mut device.detector;
    values.not_negative(&mut detector.accuracy, &keys.accuracy_m);
    values.not_negative(&mut detector.range_min, &keys.range_min_m);
    values.positive(&mut detector.range_max, &keys.range_max_m);
    values.not_negative(&mut detector.threshold, &keys.received_energy_min_w);
    if let Some(returns) = &keys.max_returns {
        detector.max_returns = *returns.get_ref();
    }
    change_errors(values, device, keys);
}

fn change_beam(values: &Values, device: &mut Device, keys: &InstrumentKeys) {
    let beam = &mut device.beam;
    values.positive(&mut beam.divergence, &keys.beam_divergence_rad);
    values.positive(&mut beam.pulse_length, &keys.pulse_length_ns);
    values.positive(&mut beam.average_power, &keys.average_power_w);
    values.positive(&mut beam.quality, &keys.beam_quality);
    values.positive(&mut beam.efficiency, &keys.optical_efficiency);
    values.positive(&mut beam.receiver_diameter, &keys.receiver_diameter_m);
    values.positive(&mut beam.visibility, &keys.visibility_km);
    if let Some(wavelength) = &keys.wavelength_nm {
        if *wavelength.get_ref() == 0 {
            values.refuse(wavelength, "a whole number above 0");
        }
        beam.wavelength = f64::from(*wavelength.get_ref());
        beam.atmosphere_wavelength = beam.wavelength;
    }
}

fn change_deflector(values: &Values, device: &mut Device, keys: &InstrumentKeys) {
    let known = ["rotating", "oscillating", "conic", "line", "risley"];
    let optics = super::run::one_of(values.context, values.source, &keys.optics, &known);
    match optics.as_deref() {
        Some("rotating") => device.deflector = Deflector::Polygon { effective_max: device.scan_angle_max },
        Some("oscillating") => device.deflector = Deflector::Oscillating { scan_product: 1_000_000.0 },
        Some("conic") => device.deflector = Deflector::Conic,
        Some("line") => device.deflector = Deflector::Fibres { count: 1 },
        Some("risley") => {
            device.deflector = Deflector::Risley { prisms: Vec::new(), air: 1.0, incident: DVec3::Y };
        }
        _ => {}
    }
    let mut unused = Unused { values, optics: "" };
    match &mut device.deflector {
        Deflector::Polygon { effective_max } => {
            values.angle(effective_max, &keys.scan_angle_effective_max_deg)
        }
        _ => unused.of("rotating", &keys.scan_angle_effective_max_deg),
    }
    match &mut device.deflector {
        Deflector::Oscillating { scan_product } => values.positive(scan_product, &keys.scan_product_deg_hz),
        _ => unused.of("oscillating", &keys.scan_product_deg_hz),
    }
    match &mut device.deflector {
        Deflector::Fibres { count } => {
            if let Some(fibres) = &keys.fibres {
                *count = *fibres.get_ref();
                if *count == 0 {
                    values.refuse(fibres, "a whole number above 0");
                }
            }
        }
        _ => unused.of("line", &keys.fibres),
    }
    match &mut device.deflector {
        Deflector::Risley { prisms, air, incident } => change_risley(values, keys, prisms, air, incident),
        _ => {
            unused.of("risley", &keys.prisms);
            unused.of("risley", &keys.air_index);
            unused.of("risley", &keys.incident_beam);
        }
    }
}

/// Reports keys that belong to other optics.
struct Unused<'a> {
    values: &'a Values<'a>,
    optics: &'static str,
}

impl Unused<'_> {
    fn of<T>(&mut self, optics: &'static str, key: &Key<T>) {
        self.optics = optics;
        if let Some(key) = key {
            let message = format!("this key needs optics = \"{}\"", self.optics);
            self.values.context.error(self.values.source.place(key.span()), message);
        }
    }
}

fn change_risley(
    values: &Values,
    keys: &InstrumentKeys,
    prisms: &mut Vec<Prism>,
    air: &mut f64,
    incident: &mut DVec3,
) {
    values.positive(air, &keys.air_index);
    if let Some(key) = &keys.prisms {
        let read = |p: &super::keys::PrismKeys| Prism {
            rotor_freq: p.rotor_freq_hz,
            angle: radians(p.wedge_deg),
            index: p.index,
        };
        *prisms = key.get_ref().iter().map(read).filter(|p| p.angle != 0.0).collect();
        if prisms.iter().any(|p| !(p.rotor_freq.is_finite() && p.angle.is_finite() && p.index > 0.0)) {
            values.refuse(key, "prisms with finite figures and an index above 0");
        }
    }
    if let (Some(key), Some(beam)) = (&keys.incident_beam, values.vector(&keys.incident_beam)) {
        *incident = unit(beam);
        if !incident.is_finite() {
            values.refuse(key, "a direction");
        }
    }
}

fn change_errors(values: &Values, device: &mut Device, keys: &InstrumentKeys) {
    let errors = &mut device.errors;
    if let Some(formula) = values.formula(&keys.range_error_m) {
        errors.range = Some(formula);
    }
    if let Some(formula) = values.formula(&keys.deflection_error_rad) {
        errors.deflection = Some(formula);
    }
    if let Some(formula) = values.formula(&keys.head_error_rad) {
        errors.head = Some((formula, 0.0));
    }
    if !matches!(device.deflector, Deflector::Polygon { .. }) {
        for key in [&keys.deflection_error_rad, &keys.head_error_rad].into_iter().flatten() {
            values.context.error(values.source.place(key.span()), "this key needs optics = \"rotating\"");
        }
        (errors.deflection, errors.head) = (None, None);
    }
}
