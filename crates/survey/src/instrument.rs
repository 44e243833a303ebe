//! Scanners and their channels, from XML and TOML (spec input-formats §6).

use super::context::Context;
use super::deflector::{check_deflector, leave_out_flat_prisms};
use super::device::{MULTI_CHANNEL_PULSE_LENGTH, change_device, change_waveform_of};
use super::documents::named_asset;
use super::fields::Fields;
use super::keys::{FIRING_OFFSETS, InstrumentKeys};
use super::xml::Element;
use super::{Deflector, Device, FigureSource, Mount, Scanner};
use std::ops::RangeInclusive;
use vlscan_base::quantity::{FIRING_OFFSET_US, PULSE_FREQ};
use vlscan_geom::{Rotation, radians};

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
    let mut base = Device { id: id.clone(), ..Device::new(Deflector::Conic) };
    let is_known = change_device(&mut fields, &mut base, false);
    let channels = element.child("channels");
    let pulse_length = if channels.is_some() { MULTI_CHANNEL_PULSE_LENGTH } else { base.beam.pulse_length };
    change_waveform_of(&mut fields, &mut base, pulse_length);
    let mut written = fields.written_keys(None);
    if is_known.is_some() && channels.is_none() {
        check_deflector(&fields, &base);
    }
    fields.done(&["channels", "source"]);
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
        sources: element.named("source").filter_map(|source| read_source(context, &source)).collect(),
    })
}

/// Where figures of a scanner come from: `<source figures="beamDivergence_rad …" name="…"/>`.
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
        let why = "in a <channel>; the scanner's holds for all channels";
        fields.without_effect(&[K.pulse_freqs_hz], why);
        check_deflector(&fields, &device);
        written.extend(fields.written_keys(Some(index)));
        fields.done(&[]);
        Some(device)
    };
    elements.iter().enumerate().filter_map(read).collect()
}

/// Channels that differ by the elevation of their beams, `elevations_deg`, from channel 0 on, and by when they fire within a
/// cycle, `firingOffsets_us`. `None` without elevations.
fn channels_of_table(fields: &mut Fields, base: &Device) -> Option<Vec<Device>> {
    let elevations = fields.text("elevations_deg");
    let offsets = fields.text(FIRING_OFFSETS);
    let Some(elevations) = elevations else {
        if offsets.is_some() {
            fields.refuse(FIRING_OFFSETS, "beside `elevations_deg`; a <channel> has `firingOffset_us`");
        }
        return None;
    };
    let Some(elevations) = listed(&elevations, -90.0..=90.0) else {
        let expected =
            format!("up to {MAX_CHANNELS} angles from -90 to 90 with semicolons, or first;...;last;count");
        fields.refuse("elevations_deg", &expected);
        return Some(Vec::new());
    };
    let range = 0.0..=FIRING_OFFSET_US.high;
    let offsets = match offsets.map(|text| listed(&text, range)) {
        None => vec![0.0; elevations.len()],
        Some(Some(list)) if list.len() == elevations.len() => list,
        Some(_) => {
            let expected = format!("{} times in µs from 0 to 1e6, one for each elevation", elevations.len());
            fields.refuse(FIRING_OFFSETS, &expected);
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

/// The instrument of a `[scanner]` table, based on `inherited` (the scanner of a survey) or its catalogue entry.
pub(super) fn read_instrument(fields: &mut Fields, inherited: Option<Scanner>) -> Option<Scanner> {
    let base = match fields.has(K.catalogue) {
        false => inherited,
        true => {
            let element = named_asset(fields, K.catalogue, "scanner")?;
            let mut scanner = read_scanner(fields.context, &element)?;
            // The catalogue's widths count here whatever the physics; surveys in XML keep the reference's meaning.
            scanner.devices.iter_mut().for_each(|device| device.beam.take_stated_width());
            Some(scanner)
        }
    };
    if base.is_none() && !(fields.has(K.optics) && fields.has(K.pulse_freqs_hz)) {
        let message = "[scanner] needs `catalogue`, or both `optics` and `pulse_freqs_hz`";
        let help = "`vlscan catalogue` lists the scanners that ship";
        fields.context.error_help(fields.own_place(), message, help);
        // What the other keys say is checked all the same.
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
    if channels.is_empty() && (fields.has(K.optics) || fields.has(K.prisms)) {
        check_deflector(fields, &scanner.devices[0]);
    }
    if !channels.is_empty() {
        let base = scanner.devices[0].clone();
        let read = |(index, fields): (usize, &mut Fields)| read_channel(fields, &base, index);
        scanner.devices = channels.iter_mut().enumerate().filter_map(read).collect();
        scanner.multi_channel = true;
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
    let of_scanner = [K.catalogue, K.name, K.pulse_freqs_hz, K.channel];
    if of_scanner.iter().any(|key| fields.has(*key)) {
        let message = "a channel has no `catalogue`, `name`, `pulse_freqs_hz` or `channel` of its own";
        fields.context.error(fields.own_place(), message);
    }
    fields.ignore(&of_scanner);
    let mut device = base.clone();
    device.id = fields.text(K.id).unwrap_or_else(|| index.to_string());
    change_device(fields, &mut device, true)?;
    check_deflector(fields, &device);
    Some(device)
}
