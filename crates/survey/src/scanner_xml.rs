//! Scanners and their channels (spec input-formats §6).

use super::context::Context;
use super::deflector_xml::{DeflectorSettings, read_optics};
use super::documents::is_built_in;
use super::fields::{Fields, read_mount};
use super::receiver_xml::{read_emission, read_pulse_shape, read_receiver};
use super::xml::Element;
use super::{
    Beam, BeamProfile, Detector, Device, FigureSource, Head, KeyUse, MechanicalErrors, Mount, Receiver,
    Scanner, WaveformPlace, WaveformSettings, WrittenKey, key_of_attribute,
};
use std::ops::RangeInclusive;
use vlscan_base::quantity;
use vlscan_geom::{DVec3, Rotation, radians};

pub(super) fn read_scanner(context: &Context, element: &Element) -> Option<Scanner> {
    let mut fields = Fields::new(context, element);
    let id = fields.text("id").unwrap_or_default().to_owned();
    let name = fields.text("name").unwrap_or(&id).to_owned();
    let pulse_freqs = read_pulse_freqs(&mut fields);
    if !fields.has("optics") {
        fields.required("optics");
    }
    let deflector = read_optics(&mut fields, context).map(|o| DeflectorSettings::new(o).with(&mut fields));
    let beam = read_beam(&mut fields);
    let detector = read_detector(&mut fields, &DETECTOR);
    let receiver = read_pulse_shape(context, &mut fields, &Receiver::default());
    let receiver = read_receiver(context, &mut fields, receiver, &detector);
    let head =
        Head { axis: read_head_axis(context, element, DVec3::Z), max_rate: read_head_rate(&mut fields, 0.0) };
    check_listed(&fields);
    fields.done(&[
        "beamOrigin",
        "headRotateAxis",
        "FWFSettings",
        "channels",
        "rangeError",
        "deflectionError",
        "headError",
        "snr",
        "maxRange",
        "source",
    ]);
    let deflector = deflector?;

    let channels = element.child("channels");
    let pulse_length = if channels.is_some() { MULTI_CHANNEL_PULSE_LENGTH } else { beam.pulse_length };
    let base = Device {
        id: id.clone(),
        deflector: deflector.build(),
        scan_angle_max: deflector.angle_max,
        scan_freq: deflector.scan_freq,
        head,
        beam_origin: element.child("beamOrigin").map_or(Mount::IDENTITY, |o| read_mount(context, &o)),
        firing_offset: 0.0,
        beam,
        detector,
        receiver,
        waveform: read_waveform(context, element, &WAVEFORM, pulse_length),
        waveform_place: waveform_place(element),
        errors: read_errors(context, element, &deflector),
    };
    let devices = match &channels {
        None => {
            deflector.check(context, element);
            vec![base]
        }
        Some(channels) => read_channels(context, channels, &base, &deflector),
    };
    let pulse_freqs = pulse_freqs?;
    (!devices.is_empty()).then_some(Scanner {
        id,
        name,
        pulse_freqs,
        devices,
        multi_channel: channels.is_some(),
        written: written_keys(element),
        sources: element.named("source").filter_map(|source| read_source(context, &source)).collect(),
    })
}

/// Where figures of a scanner come from: `<source figures="beamDivergence_rad …" name="…"/>`.
fn read_source(context: &Context, element: &Element) -> Option<FigureSource> {
    let mut fields = Fields::new(context, element);
    let figures =
        fields.required("figures").map(|names| names.split_whitespace().map(str::to_owned).collect());
    let name = fields.required("name").map(str::to_owned);
    fields.done(&[]);
    Some(FigureSource { figures: figures?, name: name? })
}

/// The pulse length that the waveform settings of a multi-channel scanner assume, ns (spec input-formats §2.11).
pub(super) const MULTI_CHANNEL_PULSE_LENGTH: f64 = 4.0;

pub(super) const WAVEFORM: WaveformSettings =
    WaveformSettings { bin: 0.25, window: 1.0, quality: 3, max_range: 0.0 };

/// Maximum number of rings of subrays; such a pulse has about 3 million subrays.
pub(super) const MAX_QUALITY: u32 = 1000;

/// Wavelengths, nm.
pub(super) const WAVELENGTHS: RangeInclusive<u32> = 1..=1_000_000;

pub(super) const DETECTOR: Detector = Detector {
    accuracy: 0.0,
    range_min: 0.0,
    range_max: f64::MAX,
    max_returns: 0,
    threshold: 0.0001,
    threshold_given: false,
    distance_error: None,
};

pub(super) const DEVICE_BEAM: Beam = Beam {
    divergence: 0.0003,
    divergence_y: None,
    profile: BeamProfile::Gaussian,
    aperture: 0.0,
    pulse_length: 4.0,
    wavelength: 1064.0,
    atmosphere_wavelength: 1064.0,
    stated_width: None,
    average_power: 4.0,
    pulse_energy: None,
    quality: 1.0,
    efficiency: 0.99,
    receiver_diameter: 0.15,
    visibility: 23.0,
};

fn read_pulse_freqs(fields: &mut Fields) -> Option<Vec<u32>> {
    let text = fields.required("pulseFreqs_Hz")?;
    let rates =
        text.split(',').map(|t| t.trim().parse::<u32>().ok().filter(|&f| f > 0 && f <= i32::MAX as u32));
    let rates: Option<Vec<u32>> = rates.collect();
    if rates.is_none() {
        fields.refuse("pulseFreqs_Hz", "whole numbers above 0 separated by commas");
    }
    rates
}

fn read_beam(fields: &mut Fields) -> Beam {
    let base = DEVICE_BEAM;
    let wavelength = read_wavelength(fields, base.wavelength);
    let pulse_length = fields.within("pulseLength_ns", base.pulse_length, &quantity::PULSE_LENGTH_NS);
    let beam = Beam {
        divergence: fields.within("beamDivergence_rad", base.divergence, &quantity::DIVERGENCE),
        pulse_length,
        stated_width: is_built_in(fields.element).then_some(pulse_length),
        wavelength,
        atmosphere_wavelength: wavelength,
        average_power: fields.within("averagePower_w", base.average_power, &quantity::AVERAGE_POWER_W),
        quality: fields.within("beamQualityFactor", base.quality, &quantity::BEAM_QUALITY),
        efficiency: fields.within("opticalEfficiency", base.efficiency, &quantity::EFFICIENCY),
        receiver_diameter: fields.within(
            "receiverDiameter_m",
            base.receiver_diameter,
            &quantity::RECEIVER_DIAMETER,
        ),
        visibility: fields.within("atmosphericVisibility_km", base.visibility, &quantity::VISIBILITY),
        ..base
    };
    read_emission(fields, beam)
}

/// The wavelength, nm.
fn read_wavelength(fields: &mut Fields, base: f64) -> f64 {
    let wavelength = fields.whole_within("wavelength_nm", base as u32, WAVELENGTHS);
    if fields.has("wavelength_nm") && !quantity::USUAL_WAVELENGTHS.contains(&wavelength) {
        fields.warn("wavelength_nm", &unusual_wavelength(wavelength));
    }
    f64::from(wavelength)
}

/// Describes a wavelength that laser scanners do not have.
pub(super) fn unusual_wavelength(wavelength: u32) -> String {
    let usual = quantity::USUAL_WAVELENGTHS;
    format!("is {wavelength} nm; usual are {} to {} nm", usual.start(), usual.end())
}

fn read_detector(fields: &mut Fields, base: &Detector) -> Detector {
    let ranges = read_ranges(fields, base);
    Detector {
        max_returns: fields.whole_within("maxNOR", base.max_returns, 0..=u32::MAX),
        threshold: fields.not_negative("receivedEnergyMin_W", base.threshold),
        threshold_given: base.threshold_given || fields.has("receivedEnergyMin_W"),
        ..ranges
    }
}

/// `base` with the accuracy and the range limits of the element applied.
pub(super) fn read_ranges(fields: &mut Fields, base: &Detector) -> Detector {
    let accuracy = fields.within("accuracy_m", base.accuracy, &quantity::ACCURACY);
    let range_min = fields.within("rangeMin_m", base.range_min, &quantity::MIN_RANGE);
    // "unlimited" may also be written out
    let unlimited = matches!(fields.element.value("rangeMax_m"), Some("inf" | "Inf" | "INF" | "infinity"));
    let range_max = match unlimited {
        true => {
            fields.ignore(&["rangeMax_m"]);
            f64::MAX
        }
        false => fields.within("rangeMax_m", base.range_max, &quantity::MAX_RANGE),
    };
    if range_max < range_min {
        let name = if fields.has("rangeMax_m") { "rangeMax_m" } else { "rangeMin_m" };
        fields.refuse(name, "such that rangeMin_m does not exceed rangeMax_m");
    }
    Detector { accuracy, range_min, range_max, ..base.clone() }
}

fn read_head_rate(fields: &mut Fields, base: f64) -> f64 {
    fields.angle("headRotatePerSecMax_deg", base, &quantity::HEAD_RATE).abs()
}

/// The axis of the head; vectors shorter than 0.1 are ignored.
fn read_head_axis(context: &Context, element: &Element, base: DVec3) -> DVec3 {
    let Some(child) = element.child("headRotateAxis") else { return base };
    let mut fields = Fields::new(context, &child);
    let axis = fields.xyz();
    fields.done(&[]);
    if axis.length() > 0.1 {
        return axis;
    }
    context.warn(
        child.place(),
        format!("the head axis is shorter than 0.1; {} {} {} is used", base.x, base.y, base.z),
    );
    base
}

/// `base` with the element's `<FWFSettings>` applied. Whenever that element exists, the window is reset to a quarter
/// of the pulse length (spec input-formats §2.11).
pub(super) fn read_waveform(
    context: &Context,
    parent: &Element,
    base: &WaveformSettings,
    pulse_length: f64,
) -> WaveformSettings {
    let Some(element) = parent.child("FWFSettings") else { return *base };
    let mut fields = Fields::new(context, &element);
    let waveform = WaveformSettings {
        bin: fields.within("binSize_ns", base.bin, &quantity::BIN_NS),
        window: fields.within("winSize_ns", pulse_length / 4.0, &quantity::BIN_NS),
        quality: fields.whole_within("beamSampleQuality", base.quality, 1..=MAX_QUALITY),
        max_range: fields.not_negative("maxFullwaveRange_ns", base.max_range),
    };
    fields.without_effect(
        &["apertureDiameter_m"],
        "here, as in HELIOS++; `receiverDiameter_m` of the scanner has",
    );
    fields.done(&[]);
    waveform
}

/// Where the element sets bins and window of the waveform; `None` if it does not, or in the built-in catalogue.
pub(super) fn waveform_place(parent: &Element) -> Option<WaveformPlace> {
    let element = parent.child("FWFSettings").filter(|_| !is_built_in(parent))?;
    let keys = ["binSize_ns", "winSize_ns"];
    let written = keys.into_iter().rev().find(|key| element.value(key).is_some());
    let place = written.map_or_else(|| element.place(), |key| element.value_place(key));
    Some(WaveformPlace { place, keys })
}

/// The keys of a scanner, of its channels, or of `<detectorSettings>` that not every physics makes use of; none in the
/// built-in catalogue, which serves all.
pub(super) fn written_keys(element: &Element) -> Vec<WrittenKey> {
    if is_built_in(element) {
        return Vec::new();
    }
    let channels = element.child("channels");
    let each = channels.iter().flat_map(|all| all.named("channel").collect::<Vec<_>>());
    let owners = std::iter::once((element.clone(), None)).chain(channels.clone().map(|all| (all, None)));
    let owners = owners.chain(each.zip((0..).map(Some)));
    let keys_of = |(element, channel): (Element, Option<usize>)| {
        let attributes = element.attribute_names().map(|name| (name.to_owned(), element.name_place(name)));
        let children = element.children().map(|child| (child.name().to_owned(), child.place()));
        let written = attributes.chain(children).filter_map(|(name, place)| {
            let key = key_of_attribute(&name).filter(|key| key.used != KeyUse::Always)?;
            Some(WrittenKey { key, name: key.attribute, place, channel })
        });
        written.collect::<Vec<_>>()
    };
    owners.flat_map(keys_of).collect()
}

fn read_errors(context: &Context, element: &Element, deflector: &DeflectorSettings) -> MechanicalErrors {
    let rotating = deflector.optics == super::deflector_xml::Optics::Rotating;
    let formula = |name: &str, only_rotating: bool| {
        let child = element.child(name)?;
        if only_rotating && !rotating {
            context.error(child.place(), format!("<{name}> needs rotating optics"));
            return None;
        }
        let mut fields = Fields::new(context, &child);
        let formula = fields.formula("expr");
        let threshold = match name {
            "headError" => radians(fields.not_negative("zeroSinThreshold_deg", 0.0)),
            _ => 0.0,
        };
        fields.done(&[]);
        Some((formula?, threshold))
    };
    MechanicalErrors {
        range: formula("rangeError", false).map(|f| f.0),
        deflection: formula("deflectionError", true).map(|f| f.0),
        head: formula("headError", true),
    }
}

fn read_channels(
    context: &Context,
    channels: &Element,
    base: &Device,
    deflector: &DeflectorSettings,
) -> Vec<Device> {
    let mut fields = Fields::new(context, channels);
    let table = channels_of_table(&mut fields, base);
    fields.done(&["channel"]);
    if let Some(devices) = table {
        if let Some(extra) = channels.child("channel") {
            context.error(extra.place(), "<channels> has either `elevations_deg` or <channel> elements");
        }
        return devices;
    }
    let elements = channels.named("channel").enumerate();
    let devices: Vec<Device> =
        elements.filter_map(|(i, e)| read_channel(context, &e, i, base, deflector)).collect();
    if channels.named("channel").next().is_none() {
        context.error(channels.place(), "<channels> needs at least one <channel>");
    }
    devices
}

/// Channels that differ by the elevation of their beams, `elevations_deg`, from channel 0 on, and by when they fire within a
/// cycle, `firingOffsets_us`. `None` without elevations.
fn channels_of_table(fields: &mut Fields, base: &Device) -> Option<Vec<Device>> {
    let elevations = fields.text("elevations_deg");
    let offsets = fields.text("firingOffsets_us");
    let Some(elevations) = elevations else {
        if offsets.is_some() {
            fields.refuse("firingOffsets_us", "beside `elevations_deg`; a <channel> has `firingOffset_us`");
        }
        return None;
    };
    let Some(elevations) = listed(elevations, -90.0..=90.0) else {
        let expected =
            format!("up to {MAX_CHANNELS} angles from -90 to 90 with semicolons, or first;...;last;count");
        fields.refuse("elevations_deg", &expected);
        return Some(Vec::new());
    };
    let range = 0.0..=quantity::FIRING_OFFSET_US.high;
    let offsets = match offsets.map(|text| listed(text, range)) {
        None => vec![0.0; elevations.len()],
        Some(Some(list)) if list.len() == elevations.len() => list,
        Some(_) => {
            let expected = format!("{} times in µs from 0 to 1e6, one for each elevation", elevations.len());
            fields.refuse("firingOffsets_us", &expected);
            return Some(Vec::new());
        }
    };
    let channel = |(index, (elevation, offset)): (usize, (f64, f64))| {
        let rotation = base.beam_origin.rotation.after(Rotation::about_x(radians(elevation)));
        let beam_origin = Mount { rotation, ..base.beam_origin };
        Device { id: index.to_string(), beam_origin, firing_offset: offset * 1e-6, ..base.clone() }
    };
    Some(elevations.into_iter().zip(offsets).enumerate().map(channel).collect())
}

/// Numbers within `range` that are separated by semicolons, or evenly spaced as `first;...;last;count` says.
fn listed(text: &str, range: RangeInclusive<f64>) -> Option<Vec<f64>> {
    let words: Vec<&str> = text.split(';').map(str::trim).collect();
    let number = |word: &str| word.parse::<f64>().ok().filter(|value| range.contains(value));
    match &words[..] {
        [first, "...", last, count] => {
            let count = count.parse::<u32>().ok().filter(|count| (2..=MAX_CHANNELS).contains(count));
            count.zip(number(first)).zip(number(last)).map(|((count, first), last)| {
                let step = (last - first) / f64::from(count - 1);
                (0..count).map(|i| first + f64::from(i) * step).collect()
            })
        }
        list if list.len() <= MAX_CHANNELS as usize => list.iter().map(|word| number(word)).collect(),
        _ => None,
    }
}

/// Maximum number of channels in a table.
const MAX_CHANNELS: u32 = 1024;

fn read_channel(
    context: &Context,
    element: &Element,
    index: usize,
    base: &Device,
    deflector: &DeflectorSettings,
) -> Option<Device> {
    let mut fields = Fields::new(context, element);
    let id = fields.text("id").map_or_else(|| index.to_string(), str::to_owned);
    // a channel with other optics starts from defaults, one with the same optics from the scanner's settings
    let start = match (fields.has("optics"), read_optics(&mut fields, context)) {
        (true, None) => return None,
        (_, Some(optics)) if optics != deflector.optics => DeflectorSettings::new(optics),
        _ => deflector.clone(),
    };
    let mut deflector = start.with(&mut fields);
    deflector.read_incident_beam(context, element);
    let wavelength = read_wavelength(&mut fields, base.beam.wavelength);
    let pulse_length = fields.within("pulseLength_ns", base.beam.pulse_length, &quantity::PULSE_LENGTH_NS);
    let beam = Beam {
        divergence: fields.within("beamDivergence_rad", base.beam.divergence, &quantity::DIVERGENCE),
        pulse_length,
        stated_width: is_built_in(fields.element).then_some(pulse_length),
        wavelength,
        ..base.beam
    };
    let beam = read_emission(&mut fields, beam);
    let detector = read_detector(&mut fields, &base.detector);
    let receiver = read_pulse_shape(context, &mut fields, &base.receiver);
    let receiver = read_receiver(context, &mut fields, receiver, &detector);
    let max_rate = read_head_rate(&mut fields, base.head.max_rate);
    let firing_offset = fields.within("firingOffset_us", 0.0, &quantity::FIRING_OFFSET_US) * 1e-6;
    fields.ignore(&["name"]);
    warn_without_effect(context, &mut fields);
    check_listed(&fields);
    fields.done(&["beamOrigin", "FWFSettings", "incidentBeam", "headRotateAxis", "snr", "maxRange"]);
    deflector.check(context, element);
    let rotating = deflector.optics == super::deflector_xml::Optics::Rotating;
    let mut errors = base.errors.clone();
    if !rotating {
        (errors.deflection, errors.head) = (None, None);
    }
    Some(Device {
        id,
        deflector: deflector.build(),
        scan_angle_max: deflector.angle_max,
        scan_freq: deflector.scan_freq,
        head: Head { axis: read_head_axis(context, element, base.head.axis), max_rate },
        beam_origin: element.child("beamOrigin").map_or(base.beam_origin, |o| read_mount(context, &o)),
        firing_offset,
        beam,
        detector,
        receiver,
        waveform: read_waveform(context, element, &base.waveform, MULTI_CHANNEL_PULSE_LENGTH),
        waveform_place: waveform_place(element).or_else(|| base.waveform_place.clone()),
        errors,
    })
}

/// Every attribute that is read is in the list that [`key_of_attribute`] searches, which says what makes use of it.
pub(super) fn check_listed(fields: &Fields) {
    debug_assert!(
        fields.known().iter().all(|name| key_of_attribute(name).is_some()),
        "an attribute of a scanner is missing in INSTRUMENT_KEYS: {:?}",
        fields.known()
    );
}

/// Warns about attributes of a channel that take effect only in the scanner element.
fn warn_without_effect(context: &Context, fields: &mut Fields) {
    let names = [
        "pulseFreqs_Hz",
        "averagePower_w",
        "beamQualityFactor",
        "opticalEfficiency",
        "receiverDiameter_m",
        "atmosphericVisibility_km",
    ];
    for name in names {
        if fields.has(name) {
            let message =
                format!("`{name}` of a <channel> has no effect; the scanner's holds for all channels");
            context.warn(fields.element.name_place(name), message);
        }
    }
    fields.ignore(&names);
}
