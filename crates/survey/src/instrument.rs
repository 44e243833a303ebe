//! Scanners and their channels, from XML and TOML (spec input-formats §6).

use super::beams::{channels_of_beams, level};
use super::context::Context;
use super::deflector::{DEFLECTING, check_deflector, leave_out_flat_prisms};
use super::device::{MULTI_CHANNEL_PULSE_LENGTH, change_device, change_waveform_of};
use super::documents::find_asset;
use super::fields::{Fields, warn_of_repeated_keys};
use super::keys::{AZIMUTHS, FIRING_OFFSETS, InstrumentKeys, ORIGIN_RADII};
use super::ouster::{is_calibration, read_beams, read_calibration};
use super::pattern::{apply_pattern, corrected_channels};
use super::scene_xml::warn_of_repeated_ids;
use super::xml::Element;
use super::{Deflector, Device, FigureSource, Scanner, StatedFigures};
use std::ops::RangeInclusive;
use std::path::Path;
use vlscan_base::diag::Place;
use vlscan_base::quantity::{FIRING_OFFSET_US, PULSE_FREQ, number};

const K: InstrumentKeys = InstrumentKeys::KEYS;

/// Reads a `<scanner>`.
pub(super) fn read_scanner(context: &Context, element: &Element) -> Option<Scanner> {
    let mut fields = Fields::new(context, element);
    let id = fields.text(K.id).unwrap_or_default();
    let name = fields.text(K.name).unwrap_or_else(|| id.clone());
    let pulse_freqs = read_pulse_freqs(&mut fields);
    if !fields.has(K.optics) {
        fields.missing(K.optics);
    }
    let stated = read_stated(context, element);
    let mut base = Device { id: id.clone(), stated, ..Device::new(Deflector::Conic) };
    let is_known = change_device(&mut fields, &mut base, false);
    let channels = element.child("channels");
    let pulse_length = if channels.is_some() { MULTI_CHANNEL_PULSE_LENGTH } else { base.beam.pulse_length };
    change_waveform_of(&mut fields, &mut base, pulse_length);
    let mut written = fields.written_keys(None);
    if is_known.is_some() && channels.is_none() {
        check_deflector(&fields, &base, false);
    }
    let mut sources: Vec<FigureSource> =
        element.named("source").filter_map(|source| read_source(context, &source)).collect();
    if fields.is_built_in() && !fields.has(K.pulse_length_ns) {
        let figures = vec![fields.name(K.pulse_length_ns).to_owned()];
        sources.push(FigureSource { figures, name: FigureSource::DEFAULT_PULSE_LENGTH.to_owned() });
    }
    let children: &[&'static str] =
        if fields.is_built_in() { &["channels", "source", "stated"] } else { &["channels", "source"] };
    fields.done(children);
    is_known?;
    let mut devices = match &channels {
        None => vec![base],
        Some(channels) => read_channels(context, channels, &base, &mut written),
    };
    devices.iter_mut().for_each(leave_out_flat_prisms);
    let pulse_freqs = pulse_freqs?;
    (!devices.is_empty()).then_some(Scanner {
        id,
        name,
        pulse_freqs,
        devices,
        multi_channel: channels.is_some(),
        written,
        sources,
        turn: None,
        pulse_times: None,
    })
}

/// Reads the `<stated>` figures of a scanner of the built-in catalogue, each with its source: figures that
/// pipelines use instead of those of HELIOS++'s catalogue.
fn read_stated(context: &Context, element: &Element) -> StatedFigures {
    let mut stated = StatedFigures { is_built_in: element.is_built_in(), ..StatedFigures::default() };
    for child in element.named("stated").filter(|_| element.is_built_in()) {
        let mut fields = Fields::new(context, &child);
        let source = fields.required("source");
        let mut figures = Vec::new();
        for (key, target) in [
            (K.wavelength_nm, &mut stated.wavelength),
            (K.pulse_length_ns, &mut stated.pulse_width),
            (K.range_min_m, &mut stated.range_min),
            (K.dead_time_ns, &mut stated.dead_time),
            (K.accuracy_m, &mut stated.accuracy),
            (K.beam_divergence_rad, &mut stated.divergence),
        ] {
            if let Some(value) = fields.optional(key) {
                *target = Some(value);
                figures.push(fields.name(key).to_owned());
            }
        }
        fields.done(&[]);
        stated.sources.extend(source.map(|name| FigureSource { figures, name }));
    }
    stated
}

/// Reads the source of figures of a scanner: `<source figures="beamDivergence_rad …" name="…"/>`.
fn read_source(context: &Context, element: &Element) -> Option<FigureSource> {
    let mut fields = Fields::new(context, element);
    let (figures, name) = (fields.required("figures"), fields.required("name"));
    fields.done(&[]);
    Some(FigureSource { figures: figures?.split_whitespace().map(str::to_owned).collect(), name: name? })
}

fn read_pulse_freqs(fields: &mut Fields) -> Option<Vec<u32>> {
    if fields.is_toml() {
        let expected = "whole numbers above 0 in brackets";
        let freqs = fields.counts(K.pulse_freqs_hz, &PULSE_FREQ, expected)?;
        if freqs.is_empty() {
            fields.refuse(K.pulse_freqs_hz, expected);
        }
        return (!freqs.is_empty()).then_some(freqs);
    }
    let text = fields.required(K.pulse_freqs_hz)?;
    let whole = |word: &str| word.trim().parse::<u32>().ok().filter(|f| PULSE_FREQ.contains(f64::from(*f)));
    let freqs: Option<Vec<u32>> = text.split(',').map(whole).collect();
    if freqs.is_none() {
        fields.refuse(K.pulse_freqs_hz, "whole numbers above 0 separated by commas");
    }
    freqs
}

fn read_channels(
    context: &Context,
    channels: &Element,
    base: &Device,
    written: &mut Vec<super::WrittenKey>,
) -> Vec<Device> {
    let mut fields = Fields::new(context, channels);
    let table = channels_of_table(&mut fields, base);
    written.extend(fields.written_keys(None));
    fields.done(&["channel"]);
    if let Some(devices) = table {
        if let Some(extra) = channels.child("channel") {
            context.error(extra.place(), "<channels> has either `elevations_deg` or <channel> elements");
        }
        return devices;
    }
    let elements: Vec<Element> = channels.named("channel").collect();
    warn_of_repeated_ids(context, "channel", elements.iter().cloned());
    if elements.is_empty() {
        context.error(channels.place(), "<channels> needs at least one <channel>");
    }
    let read = |(index, element): (usize, &Element)| {
        let mut fields = Fields::new(context, element);
        let mut device = base.clone();
        device.id = fields.text(K.id).unwrap_or_else(|| index.to_string());
        change_device(&mut fields, &mut device, true)?;
        change_waveform_of(&mut fields, &mut device, MULTI_CHANNEL_PULSE_LENGTH);
        fields.ignore(&[K.name]);
        let why = "in a <channel>; that of the scanner applies to all channels";
        fields.without_effect(&[K.pulse_freqs_hz], why);
        check_deflector(&fields, &device, true);
        written.extend(fields.written_keys(Some(index)));
        fields.done(&[]);
        Some(device)
    };
    elements.iter().enumerate().filter_map(read).collect()
}

/// Channels that differ by the elevation of their beams, `elevations_deg`, from channel 0 on, by their
/// azimuth, `azimuths_deg`, their origin, `originRadii_m`, and their firing time within a cycle,
/// `firingOffsets_us`. `None` without elevations.
fn channels_of_table(fields: &mut Fields, base: &Device) -> Option<Vec<Device>> {
    let elevations = fields.text("elevations_deg");
    let others = [AZIMUTHS, ORIGIN_RADII, FIRING_OFFSETS].map(|key| (key, fields.text(key)));
    let Some(elevations) = elevations else {
        for (key, _) in others.iter().filter(|(_, text)| text.is_some()) {
            let own = if *key == FIRING_OFFSETS { "firingOffset_us" } else { "<beamOrigin>" };
            fields.refuse(*key, &format!("beside `elevations_deg`; a <channel> has `{own}`"));
        }
        return None;
    };
    let Some(elevations) = listed(&elevations, -90.0..=90.0) else {
        let expected =
            format!("up to {MAX_CHANNELS} angles from -90 to 90 with semicolons, or first;...;last;count");
        fields.refuse("elevations_deg", &expected);
        return Some(Vec::new());
    };
    let ranges = [
        (-MAX_AZIMUTH..=MAX_AZIMUTH, "azimuths in degrees"),
        (-MAX_ORIGIN_RADIUS..=MAX_ORIGIN_RADIUS, "lengths in m"),
        (0.0..=FIRING_OFFSET_US.high, "times in µs"),
    ];
    let mut lists = [const { Vec::new() }; 3];
    for ((list, (key, text)), (range, what)) in lists.iter_mut().zip(others).zip(ranges) {
        let (low, high) = (number(*range.start()), number(*range.end()));
        let found = text.map_or_else(|| Some(vec![0.0]), |text| listed(&text, range));
        let found = found.filter(|found| {
            found.len() == elevations.len() || found.len() == 1 && (key != FIRING_OFFSETS || found[0] == 0.0)
        });
        let Some(found) = found else {
            let count = elevations.len();
            fields.refuse(key, &format!("{count} {what} from {low} to {high}, one for each elevation"));
            return Some(Vec::new());
        };
        *list = found;
    }
    let [azimuths, radii, offsets] = lists;
    Some(channels_of_beams(base, &elevations, &azimuths, &radii, &offsets))
}

/// The channels that `elevations_deg` of a pipeline file lists, or `None` where they cannot be read. Outer
/// `None` without elevations.
fn listed_channels(fields: &mut Fields, scanner: &Scanner) -> Option<Option<Vec<Device>>> {
    let others = [K.azimuths_deg, K.origin_radii_m];
    if !fields.has(K.elevations_deg) {
        for key in others.iter().filter(|key| fields.has(**key)) {
            fields.error(*key, "needs `elevations_deg` beside it, of the same channels");
        }
        fields.ignore(&others);
        return None;
    }
    let within = |limit: f64| move |list: &[f64]| list.iter().all(|value| value.abs() <= limit);
    let expected = format!("1 to {MAX_CHANNELS} angles from -90 to 90 degrees in brackets");
    let is_usable = |list: &[f64]| (1..=MAX_CHANNELS as usize).contains(&list.len()) && within(90.0)(list);
    let elevations = fields.numbers(K.elevations_deg, is_usable, &expected);
    let count = elevations.as_ref().map_or(1, Vec::len);
    let of_all = format!("{count} angles in degrees in brackets, one for each elevation");
    let is_azimuth = |list: &[f64]| list.len() == count && within(MAX_AZIMUTH)(list);
    let azimuths = fields.numbers(K.azimuths_deg, is_azimuth, &of_all);
    let expected = format!("1 or {count} lengths of at most {MAX_ORIGIN_RADIUS} m in brackets");
    let is_radius =
        |list: &[f64]| (list.len() == 1 || list.len() == count) && within(MAX_ORIGIN_RADIUS)(list);
    let radii = fields.numbers(K.origin_radii_m, is_radius, &expected);
    let [azimuths, radii] = [azimuths, radii].map(|list| list.unwrap_or_else(|| vec![0.0]));
    let mut base = scanner.devices[0].clone();
    if scanner.multi_channel && !fields.has(K.beam_origin) {
        // Angles count from the axes of the scanner, not from the nominal ones of the entry's first channel.
        base.beam_origin = level(&base.beam_origin);
        if fields.has(K.origin_radii_m) {
            base.beam_origin.offset.y = 0.0;
        }
    }
    let offsets = [base.firing_offset * 1e6];
    Some(elevations.map(|elevations| channels_of_beams(&base, &elevations, &azimuths, &radii, &offsets)))
}

/// The scanner of a reference: `file.xml#id`, a calibration file, or the id of a built-in one. Files are
/// searched from `folder`; `place` is the place of the reference.
pub(super) fn scanner_named(
    context: &Context,
    reference: &str,
    folder: &Path,
    place: Option<Place>,
) -> Option<Scanner> {
    if is_calibration(reference) {
        return read_calibration(context, reference, folder, place);
    }
    let element = find_asset(context, "scanner", reference, folder, place)?;
    read_scanner(context, &element)
}

/// Parses numbers within `range`, separated by semicolons or evenly spaced as `first;...;last;count`.
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
/// Largest azimuth of a beam, degrees.
const MAX_AZIMUTH: f64 = 360.0;
/// Largest distance of the origin of a beam from the emitter's, m.
const MAX_ORIGIN_RADIUS: f64 = 1.0;

/// The instrument of a `[scanner]` table, based on `inherited` (the scanner of a survey) or its catalogue
/// entry.
pub(super) fn read_instrument(fields: &mut Fields, inherited: Option<Scanner>) -> Option<Scanner> {
    let base = match fields.has(K.catalogue) {
        false => inherited,
        true => {
            let name = fields.near_name(K.catalogue)?;
            let place = Some(fields.place(K.catalogue));
            let mut scanner = scanner_named(fields.context, &name, fields.folder(), place)?;
            // Figures of data sheets apply here in every physics; XML surveys keep the reference's figures
            // and its definition of pulse lengths.
            scanner.devices.iter_mut().for_each(Device::take_stated_figures);
            Some(scanner)
        }
    };
    // Patterns may have times of their own.
    let has_pulses = fields.has(K.pulse_freqs_hz) || fields.has(K.pattern);
    if base.is_none() && !(fields.has(K.optics) && has_pulses) {
        let message = "[scanner] needs `catalogue`, or both `optics` and `pulse_freqs_hz`";
        let help = "`vlscan catalogue` lists the scanners";
        fields.context.error_help(fields.own_place(), message, help);
        // The other keys are checked anyway.
        let _ = change_device(fields, &mut Device::new(Deflector::Conic), false);
        return None;
    }
    let mut scanner = base.unwrap_or_else(|| Scanner {
        id: "scanner".to_owned(),
        name: "scanner".to_owned(),
        pulse_freqs: Vec::new(),
        devices: vec![Device::new(Deflector::Conic)],
        multi_channel: false,
        written: Vec::new(),
        sources: Vec::new(),
        turn: None,
        pulse_times: None,
    });
    scanner.written.extend(fields.written_keys(None));
    let (id, name) = (fields.text(K.id), fields.text(K.name));
    if let Some(name) = name.or(id.clone()) {
        scanner.name = name;
    }
    scanner.id = id.unwrap_or(scanner.id);
    if fields.has(K.pulse_freqs_hz) {
        scanner.pulse_freqs = read_pulse_freqs(fields)?;
    }
    for device in &mut scanner.devices {
        change_device(fields, device, false)?;
    }
    if !scanner.multi_channel {
        scanner.devices[0].id.clone_from(&scanner.id);
    }
    let mut channels = fields.children(K.channel, &InstrumentKeys::TABLE);
    apply_pattern(fields, &mut scanner)?;
    if scanner.pulse_freqs.is_empty() {
        fields.missing(K.pulse_freqs_hz);
        return None;
    }
    let states_channels = !channels.is_empty() || fields.has(K.elevations_deg);
    if fields.has(K.pattern) && states_channels && scanner.devices.len() > 1 {
        let message = "has channels of its own; leave out the `[[scanner.channel]]` tables and \
                       `elevations_deg`";
        fields.error(K.pattern, message);
    }
    if let Some(listed) = listed_channels(fields, &scanner) {
        if !channels.is_empty() {
            fields.error(
                K.elevations_deg,
                "lists channels; leave out the `[[scanner.channel]]` tables or the list",
            );
        }
        check_deflector(fields, &scanner.devices[0], true);
        (scanner.devices, scanner.multi_channel) = (listed?, true);
    }
    // Firing times apply to all channels, including listed ones.
    if let Some(corrected) = corrected_channels(fields, &scanner, read_beams) {
        (scanner.devices, scanner.multi_channel) = (corrected?, true);
    }
    let of_files = [K.corrections, K.firing_times].into_iter().find(|key| fields.has(*key));
    if let Some(key) = of_files.filter(|_| !channels.is_empty() && scanner.devices.len() > 1) {
        fields.error(key, "has channels of its own; leave out the `[[scanner.channel]]` tables");
    }
    if channels.is_empty() && DEFLECTING.iter().any(|key| fields.has(*key)) && !fields.has(K.elevations_deg) {
        check_deflector(fields, &scanner.devices[0], fields.has(K.corrections));
    }
    if !channels.is_empty() {
        let base = scanner.devices[0].clone();
        let read = |(index, fields): (usize, &mut Fields)| read_channel(fields, &base, index);
        scanner.devices = channels.iter_mut().enumerate().filter_map(read).collect();
        scanner.multi_channel = true;
        warn_of_repeated_keys(&channels, K.id);
        for (index, fields) in channels.into_iter().enumerate() {
            scanner.written.extend(fields.written_keys(Some(index)));
            fields.done(&[]);
        }
    }
    scanner.devices.iter_mut().for_each(leave_out_flat_prisms);
    (!scanner.devices.is_empty()).then_some(scanner)
}

/// A `[[scanner.channel]]` table.
fn read_channel(fields: &mut Fields, base: &Device, index: usize) -> Option<Device> {
    let of_scanner = [
        K.catalogue,
        K.name,
        K.pulse_freqs_hz,
        K.channel,
        K.elevations_deg,
        K.azimuths_deg,
        K.origin_radii_m,
        K.pattern,
        K.pattern_repeat,
        K.pattern_azimuth,
        K.corrections,
        K.firing_times,
    ];
    if let Some(key) = of_scanner.iter().find(|key| fields.has(**key)) {
        let message = format!("a channel has no `{}` of its own", key.key);
        fields.context.error(fields.own_place(), message);
    }
    fields.ignore(&of_scanner);
    let mut device = base.clone();
    device.id = fields.text(K.id).unwrap_or_else(|| index.to_string());
    change_device(fields, &mut device, true)?;
    check_deflector(fields, &device, true);
    Some(device)
}
