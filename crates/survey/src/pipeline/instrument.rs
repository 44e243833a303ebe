//! The `[scanner]` table.

use super::super::deflector_xml::{FACET_TILTS, are_facet_tilts};
use super::super::scanner_xml::{WAVELENGTHS, read_scanner, unusual_wavelength};
use super::super::{Deflector, Device, Prism, Scanner};
use super::keys::{InstrumentKeys, Key, Optics, PrismKeys};
use super::receiver::{change_emission, change_receiver};
use super::values::Values;
use toml::Spanned;
use vlscan_base::diag::Place;
use vlscan_base::quantity;
use vlscan_geom::{DVec3, radians, unit};

/// The instrument of a `[scanner]` table, based on `inherited` (the scanner of a survey) or its catalogue entry.
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
            let element = values.reference(name, "scanner")?;
            let mut scanner = read_scanner(context, &element)?;
            // The catalogue's widths count here whatever the physics; surveys in XML keep the reference's meaning.
            scanner.devices.iter_mut().for_each(|device| device.beam.take_stated_width());
            Some(scanner)
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
        devices: vec![Device::new(Deflector::Conic)],
        multi_channel: false,
        written: Vec::new(),
        sources: Vec::new(),
    });
    scanner.written.extend(values.source.instrument_keys());
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
    if keys.optics.is_some() || keys.prisms.is_some() || !keys.channel.is_empty() {
        check_deflectors(values, &scanner, place());
    }
    Some(scanner)
}

/// Warns of deflectors that do not deflect.
fn check_deflectors(values: &Values, scanner: &Scanner, place: Place) {
    let never = |device: &&Device| match &device.deflector {
        Deflector::Risley { prisms, .. } => prisms.is_empty(),
        Deflector::Polygon { effective_max, .. } => *effective_max == 0.0 || device.scan_angle_max == 0.0,
        _ => false,
    };
    let message = match scanner.devices.iter().find(never).map(|device| &device.deflector) {
        Some(Deflector::Risley { .. }) => {
            "risley optics without `prisms`: the beam is never deflected, all pulses leave in one direction"
        }
        Some(_) => "rotating optics without `scan_angle_max_deg` emit no pulse",
        None => return,
    };
    values.context.warn(place, message);
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

fn change_device(values: &Values, device: &mut Device, keys: &InstrumentKeys) {
    values.angle(&mut device.scan_angle_max, &keys.scan_angle_max_deg, &quantity::HALF_ANGLE);
    values.set(&mut device.scan_freq.0, &keys.scan_freq_min_hz, &quantity::SCAN_FREQ);
    values.set(&mut device.scan_freq.1, &keys.scan_freq_max_hz, &quantity::SCAN_FREQ);
    if device.scan_freq.1 > 0.0 {
        values.in_order(device.scan_freq, [&keys.scan_freq_min_hz, &keys.scan_freq_max_hz]);
    }
    change_deflector(values, device, keys);
    if let Some(axis) = values.vector(&keys.head_axis) {
        device.head.axis = axis;
        if let (Some(key), true) = (&keys.head_axis, axis.length() <= 0.1) {
            values.refuse(key, "an axis longer than 0.1");
        }
    }
    values.angle(&mut device.head.max_rate, &keys.head_rate_max_deg_per_s, &quantity::HEAD_RATE);
    device.head.max_rate = device.head.max_rate.abs();
    if let Some(keys) = &keys.beam_origin {
        device.beam_origin = values.pose(keys);
    }
    let mut offset_us = device.firing_offset * 1e6;
    if keys.firing_offset_us.is_some() {
        values.set(&mut offset_us, &keys.firing_offset_us, &quantity::FIRING_OFFSET_US);
        device.firing_offset = offset_us * 1e-6;
    }
    change_beam(values, device, keys);
    change_emission(values, device, keys);
    change_receiver(values, device, keys);
    let detector = &mut device.detector;
    values.set(&mut detector.accuracy, &keys.accuracy_m, &quantity::ACCURACY);
    values.set(&mut detector.range_min, &keys.range_min_m, &quantity::MIN_RANGE);
    values.set(&mut detector.range_max, &keys.range_max_m, &quantity::MAX_RANGE);
    values.in_order((detector.range_min, detector.range_max), [&keys.range_min_m, &keys.range_max_m]);
    values.not_negative(&mut detector.threshold, &keys.received_energy_min_w);
    if let Some(returns) = &keys.max_returns {
        detector.max_returns = *returns.get_ref();
    }
    change_errors(values, device, keys);
}

fn change_beam(values: &Values, device: &mut Device, keys: &InstrumentKeys) {
    let beam = &mut device.beam;
    values.set(&mut beam.divergence, &keys.beam_divergence_rad, &quantity::DIVERGENCE);
    values.set(&mut beam.pulse_length, &keys.pulse_length_ns, &quantity::PULSE_LENGTH_NS);
    beam.stated_width = beam.stated_width.filter(|_| keys.pulse_length_ns.is_none());
    values.set(&mut beam.average_power, &keys.average_power_w, &quantity::AVERAGE_POWER_W);
    values.set(&mut beam.quality, &keys.beam_quality, &quantity::BEAM_QUALITY);
    values.set(&mut beam.efficiency, &keys.optical_efficiency, &quantity::EFFICIENCY);
    values.set(&mut beam.receiver_diameter, &keys.receiver_diameter_m, &quantity::RECEIVER_DIAMETER);
    values.set(&mut beam.visibility, &keys.visibility_km, &quantity::VISIBILITY);
    if let Some(wavelength) = &keys.wavelength_nm {
        if !WAVELENGTHS.contains(wavelength.get_ref()) {
            let expected = format!("a whole number from {} to {}", WAVELENGTHS.start(), WAVELENGTHS.end());
            values.refuse(wavelength, &expected);
        } else if !quantity::USUAL_WAVELENGTHS.contains(wavelength.get_ref()) {
            let message = format!("this {}", unusual_wavelength(*wavelength.get_ref()));
            values.context.warn(values.source.place(wavelength.span()), message);
        }
        beam.wavelength = f64::from(*wavelength.get_ref());
        beam.atmosphere_wavelength = beam.wavelength;
    }
}

fn change_deflector(values: &Values, device: &mut Device, keys: &InstrumentKeys) {
    match keys.optics {
        Some(Optics::Rotating) => {
            let (effective_max, facet_tilts) = (device.scan_angle_max, Vec::new());
            device.deflector = Deflector::Polygon { effective_max, facet_tilts };
        }
        Some(Optics::Oscillating) => device.deflector = Deflector::Oscillating { scan_product: 1_000_000.0 },
        Some(Optics::Conic) => device.deflector = Deflector::Conic,
        Some(Optics::Line) => device.deflector = Deflector::Fibres { count: 1 },
        Some(Optics::Risley) => {
            device.deflector = Deflector::Risley { prisms: Vec::new(), air: 1.0, incident: DVec3::Y };
        }
        None => {}
    }
    if let (Deflector::Conic, Some(_)) = (&device.deflector, &keys.scan_angle_along_max_deg) {
        device.deflector = Deflector::EllipticConic { along_max: 0.0 };
    }
    match &mut device.deflector {
        Deflector::EllipticConic { along_max } => {
            values.angle(along_max, &keys.scan_angle_along_max_deg, &quantity::HALF_ANGLE)
        }
        _ => refuse_unused(values, "conic", &keys.scan_angle_along_max_deg),
    }
    let elliptic =
        matches!(&device.deflector, Deflector::EllipticConic { .. }) && device.scan_angle_max <= 0.0;
    if let (true, Some(key)) =
        (elliptic, keys.scan_angle_along_max_deg.as_ref().or(keys.scan_angle_max_deg.as_ref()))
    {
        values.refuse(key, "a `scan_angle_max_deg` above 0 for an elliptic cone");
    }
    match &mut device.deflector {
        Deflector::Polygon { effective_max, facet_tilts } => {
            values.angle(effective_max, &keys.scan_angle_effective_max_deg, &quantity::HALF_ANGLE);
            if let Some(tilts) = &keys.facet_tilts_deg {
                if !are_facet_tilts(tilts.get_ref()) {
                    values.refuse(tilts, FACET_TILTS);
                }
                *facet_tilts = tilts.get_ref().iter().copied().map(radians).collect();
            }
        }
        _ => {
            refuse_unused(values, "rotating", &keys.scan_angle_effective_max_deg);
            refuse_unused(values, "rotating", &keys.facet_tilts_deg);
        }
    }
    match &mut device.deflector {
        Deflector::Oscillating { scan_product } => values.positive(scan_product, &keys.scan_product_deg_hz),
        _ => refuse_unused(values, "oscillating", &keys.scan_product_deg_hz),
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
        _ => refuse_unused(values, "line", &keys.fibres),
    }
    match &mut device.deflector {
        Deflector::Risley { prisms, air, incident } => change_risley(values, keys, prisms, air, incident),
        _ => {
            refuse_unused(values, "risley", &keys.prisms);
            refuse_unused(values, "risley", &keys.air_index);
            refuse_unused(values, "risley", &keys.incident_beam);
        }
    }
}

/// Reports a key that does not apply to these optics.
fn refuse_unused<T>(values: &Values, optics: &str, key: &Key<T>) {
    if let Some(key) = key {
        let place = values.source.place(key.span());
        values.context.error(place, format!("this key needs optics = \"{optics}\""));
    }
}

fn change_risley(
    values: &Values,
    keys: &InstrumentKeys,
    prisms: &mut Vec<Prism>,
    air: &mut f64,
    incident: &mut DVec3,
) {
    values.set(air, &keys.air_index, &quantity::REFRACTIVE_INDEX);
    if let Some(key) = &keys.prisms {
        *prisms = key.get_ref().iter().map(|keys| read_prism(values, keys)).collect();
        for (prism, keys) in prisms.iter().zip(key.get_ref()) {
            let place = |key: &Spanned<f64>| values.source.place(key.span());
            if prism.angle == 0.0 || prism.index == *air {
                let wrong = if prism.angle == 0.0 { &keys.wedge_deg } else { &keys.index };
                values.context.warn(place(wrong), "this prism does not deflect the beam");
            } else if prism.rotor_freq == 0.0 {
                values.context.warn(place(&keys.rotor_freq_hz), "this prism does not turn");
            }
        }
        prisms.retain(|prism| prism.angle != 0.0);
    }
    if let (Some(key), Some(beam)) = (&keys.incident_beam, values.vector(&keys.incident_beam)) {
        *incident = unit(beam);
        if !incident.is_finite() {
            values.refuse(key, "a direction");
        }
    }
}

fn read_prism(values: &Values, keys: &PrismKeys) -> Prism {
    let mut prism = Prism { rotor_freq: 0.0, angle: 0.0, index: 1.0 };
    values.set(&mut prism.rotor_freq, &Some(keys.rotor_freq_hz.clone()), &quantity::ROTOR_FREQ);
    values.angle(&mut prism.angle, &Some(keys.wedge_deg.clone()), &quantity::WEDGE);
    values.set(&mut prism.index, &Some(keys.index.clone()), &quantity::REFRACTIVE_INDEX);
    prism
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
        refuse_unused(values, "rotating", &keys.deflection_error_rad);
        refuse_unused(values, "rotating", &keys.head_error_rad);
        (errors.deflection, errors.head) = (None, None);
    }
}
