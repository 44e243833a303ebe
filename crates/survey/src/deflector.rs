//! Deflectors of scanners and channels (spec input-formats §6.1, §6.4).

use super::fields::Fields;
use super::keys::{InstrumentKeys, Key, PrismKeys};
use super::pattern::unread;
use super::{Deflector, Device, Prism};
use vlscan_base::quantity::{COUNT_ABOVE_0, NUMBER, REFRACTIVE_INDEX, ROTOR_FREQ, WEDGE, number};
use vlscan_geom::{DVec3, radians, unit};

const K: InstrumentKeys = InstrumentKeys::KEYS;

/// Wedges flatter than this (degrees) do not deflect and are left out.
const NO_WEDGE_DEG: f64 = 1e-6;
/// A prism that does not deflect.
const NO_PRISM: Prism = Prism { rotor_freq: 0.0, angle: 0.0, index: 1.0 };

/// The attributes of a prism: rotor frequency, wedge angle, refractive index.
type PrismAttributes = [Key; 3];

const fn prism(rotor_freq: &'static str, wedge: &'static str, index: &'static str) -> PrismAttributes {
    [
        Key::attribute(rotor_freq, &ROTOR_FREQ),
        Key::attribute(wedge, &WEDGE),
        Key::attribute(index, &REFRACTIVE_INDEX),
    ]
}

const PRISM_1: PrismAttributes = prism("rotorFreq1_Hz", "angle1_deg", "refrIndex1");
const PRISM_2: PrismAttributes = prism("rotorFreq2_Hz", "angle2_deg", "refrIndex2");
const PRISM_3: PrismAttributes = prism("rotorFreq3_Hz", "angle3_deg", "refrIndex3");

/// Keys that only one kind of optics has.
const OWN_KEYS: [(&str, &[&[Key]]); 6] = [
    ("rotating", &[&[K.scan_angle_effective_max_deg, K.facet_tilts_deg]]),
    ("oscillating", &[&[K.scan_product_deg_hz, K.mirror_motion, K.turning_part]]),
    ("conic", &[&[K.scan_angle_along_max_deg]]),
    ("line", &[&[K.fibres]]),
    ("risley", &[&[K.prisms, K.air_index, K.incident_beam], &PRISM_1, &PRISM_2, &PRISM_3]),
    ("pattern", &[&[K.pattern, K.pattern_repeat, K.pattern_azimuth]]),
];

impl Deflector {
    /// The name of its kind of optics.
    pub fn optics(&self) -> &'static str {
        match self {
            Deflector::Polygon { .. } => "rotating",
            Deflector::Oscillating { .. } => "oscillating",
            Deflector::Conic | Deflector::EllipticConic { .. } => "conic",
            Deflector::Fibres { .. } => "line",
            Deflector::Risley { .. } => "risley",
            Deflector::Custom(_) => "custom",
            Deflector::Pattern(_) => "pattern",
        }
    }
}

/// Applies optics, angles, frequencies and prisms to a device. Flat prisms stay until
/// [`leave_out_flat_prisms`]. `None` for unknown optics.
pub(super) fn change_deflector(fields: &mut Fields, device: &mut Device, in_channel: bool) -> Option<()> {
    let is_toml = fields.is_toml();
    let is_new = change_optics(fields, device, in_channel)?;
    fields.set_angle(K.scan_angle_max_deg, &mut device.scan_angle_max);
    change_frequencies(fields, device);
    let optics = device.deflector.optics();
    for (own, keys) in OWN_KEYS.iter().filter(|(own, _)| *own != optics) {
        keys.iter().for_each(|keys| refuse_unused(fields, keys, own, optics));
    }
    // In XML, only channels have an incident beam, for all optics.
    let beam = (is_toml || in_channel).then(|| fields.xyz(K.incident_beam)).flatten().map(unit);
    if beam.is_some_and(|beam| !beam.is_finite()) {
        fields.error(K.incident_beam, "must have a direction");
    }
    let are_tilts = |tilts: &[f64]| (1..=64).contains(&tilts.len()) && tilts.iter().all(|t| t.abs() < 90.0);
    let tilts = fields.numbers(K.facet_tilts_deg, are_tilts, "up to 64 angles between -90 and 90");
    if let Deflector::Polygon { effective_max, .. } = &mut device.deflector
        && is_new
        && is_toml
    {
        *effective_max = device.scan_angle_max;
    }
    change_parameters(fields, &mut device.deflector, beam, tilts);
    if is_toml && (fields.has(K.scan_angle_along_max_deg) || fields.has(K.scan_angle_max_deg)) {
        check_cone(fields, device);
    }
    Some(())
}

/// Gives a device the optics that the fields name. Returns true if they are new; `None` for unknown optics.
fn change_optics(fields: &mut Fields, device: &mut Device, in_channel: bool) -> Option<bool> {
    let is_toml = fields.is_toml();
    let kinds = [
        Deflector::Polygon { effective_max: 0.0, facet_tilts: Vec::new() },
        Deflector::Oscillating { scan_product: 1_000_000.0 },
        Deflector::Conic,
        Deflector::Fibres { count: 1 },
        Deflector::Risley { prisms: vec![NO_PRISM; 3], air: 1.0, incident: DVec3::Y },
        unread(),
    ]
    .map(|kind| (kind.optics(), kind));
    // XML has no patterns, and a channel inherits the pattern of its scanner.
    let known = if is_toml && !in_channel { &kinds[..] } else { &kinds[..kinds.len() - 1] };
    let chosen = fields.choice(K.optics, known, None);
    if chosen.is_none() && (fields.has(K.optics) || !is_toml && !in_channel) {
        fields.ignore(InstrumentKeys::ALL);
        fields.ignore(&[PRISM_1, PRISM_2, PRISM_3].concat());
        return None;
    }
    // In XML a channel with other optics starts from defaults, one with the same optics from the scanner's
    // settings.
    let chosen = chosen.filter(|new| is_toml || new.optics() != device.deflector.optics());
    let is_new = chosen.is_some();
    if let Some(new) = chosen {
        device.deflector = new;
        if !is_toml {
            (device.scan_angle_max, device.scan_freq) = (0.0, (0.0, 0.0));
        }
    }
    Some(is_new)
}

/// Sets the limits of the scan frequency.
fn change_frequencies(fields: &mut Fields, device: &mut Device) {
    fields.set(K.scan_freq_min_hz, &mut device.scan_freq.0);
    fields.set(K.scan_freq_max_hz, &mut device.scan_freq.1);
    if device.scan_freq.1 > 0.0 {
        let limits = [K.scan_freq_min_hz, K.scan_freq_max_hz];
        fields.in_order(device.scan_freq, limits, ", or 0 for no limit");
    } else if fields.has(K.scan_freq_max_hz) && device.scan_freq.0 > 0.0 {
        let (low, least) = (fields.name(K.scan_freq_min_hz), number(device.scan_freq.0));
        let message = format!("is 0, which means no limit, although `{low}` is {least}");
        fields.warn(K.scan_freq_max_hz, &message);
    }
}

/// Sets the parameters that the optics have of their own. `beam` is the direction of the incident beam and
/// `tilts` are those of facets in degrees, if the fields have them.
fn change_parameters(
    fields: &mut Fields,
    deflector: &mut Deflector,
    beam: Option<DVec3>,
    tilts: Option<Vec<f64>>,
) {
    let is_toml = fields.is_toml();
    match deflector {
        Deflector::Polygon { effective_max, facet_tilts } => {
            fields.set_angle(K.scan_angle_effective_max_deg, effective_max);
            if let Some(tilts) = tilts {
                *facet_tilts = tilts.into_iter().map(radians).collect();
            }
        }
        Deflector::Oscillating { scan_product } if is_toml => fields.set(K.scan_product_deg_hz, scan_product),
        Deflector::Oscillating { scan_product } => {
            let key = Key { bounds: &COUNT_ABOVE_0, ..K.scan_product_deg_hz };
            *scan_product = f64::from(fields.count(key, *scan_product as u32));
        }
        Deflector::Fibres { count } => *count = fields.count(K.fibres, *count),
        Deflector::Risley { prisms, air, incident } => {
            fields.set(K.air_index, air);
            if is_toml {
                change_prisms(fields, prisms, *air);
            } else {
                for (prism, keys) in prisms.iter_mut().zip([PRISM_1, PRISM_2, PRISM_3]) {
                    read_prism(fields, &keys, prism);
                }
            }
            *incident = beam.unwrap_or(*incident);
        }
        // No file describes one, so that none can be changed here.
        Deflector::Custom(_) => {}
        // Its table is read once for all channels.
        Deflector::Pattern(_) => {}
        conic @ (Deflector::Conic | Deflector::EllipticConic { .. }) => {
            let mut along_max =
                if let Deflector::EllipticConic { along_max } = conic { *along_max } else { 0.0 };
            fields.set_angle(K.scan_angle_along_max_deg, &mut along_max);
            *conic = match along_max > 0.0 || is_toml && fields.has(K.scan_angle_along_max_deg) {
                true => Deflector::EllipticConic { along_max },
                false => Deflector::Conic,
            };
        }
    }
}

/// Rejects an ellipse without its larger angle.
fn check_cone(fields: &Fields, device: &Device) {
    if matches!(device.deflector, Deflector::EllipticConic { .. }) && device.scan_angle_max <= 0.0 {
        let [along, other] = [K.scan_angle_along_max_deg, K.scan_angle_max_deg];
        let place = fields.place(if fields.has(along) || !fields.is_toml() { along } else { other });
        let [along, other] = [along, other].map(|key| fields.name(key));
        let message = format!("an elliptic cone (`{along}`) needs a `{other}` above 0");
        fields.context.error(place, message);
    }
}

/// Reports keys that only the optics `own` have: an error in TOML, a warning in XML. Numbers are checked
/// anyway.
pub(super) fn refuse_unused(fields: &mut Fields, keys: &[Key], own: &str, optics: &str) {
    if fields.is_toml() {
        for key in keys.iter().filter(|key| fields.has(**key)) {
            fields.error(*key, &format!("needs optics = \"{own}\""));
        }
        fields.ignore(keys);
    } else {
        fields.without_effect(keys, &format!("with {optics} optics"));
        for key in keys.iter().filter(|key| *key.bounds != NUMBER) {
            if *key == K.fibres || *key == K.scan_product_deg_hz {
                fields.count(Key { bounds: &COUNT_ABOVE_0, ..*key }, 1);
            } else {
                fields.optional(*key);
            }
        }
    }
}

/// Replaces the prisms by a list of tables.
fn change_prisms(fields: &mut Fields, prisms: &mut Vec<Prism>, air: f64) {
    if fields.has(K.prisms) {
        prisms.clear();
    }
    for mut table in fields.children(K.prisms, &PrismKeys::TABLE) {
        let mut prism = NO_PRISM;
        PrismKeys::ALL.iter().filter(|key| !table.has(**key)).for_each(|key| table.missing(*key));
        read_prism(&mut table, PrismKeys::ALL, &mut prism);
        check_prism(&table, PrismKeys::ALL, &prism, air);
        table.done(&[]);
        prisms.push(prism);
    }
}

fn read_prism(fields: &mut Fields, keys: &[Key], prism: &mut Prism) {
    fields.set(keys[0], &mut prism.rotor_freq);
    fields.set_angle(keys[1], &mut prism.angle);
    fields.set(keys[2], &mut prism.index);
}

fn is_flat(prism: &Prism) -> bool {
    prism.angle.abs() <= radians(NO_WEDGE_DEG)
}

/// Removes prisms that do not deflect.
pub(super) fn leave_out_flat_prisms(device: &mut Device) {
    if let Deflector::Risley { prisms, .. } = &mut device.deflector {
        prisms.retain(|prism| !is_flat(prism));
    }
}

/// Warns of a prism that does not deflect or does not turn.
fn check_prism(fields: &Fields, keys: &[Key], prism: &Prism, air: f64) {
    let [rotor_freq, wedge, index] = [keys[0], keys[1], keys[2]].map(|key| fields.name(key));
    let (at, message) = match (prism.rotor_freq != 0.0, !is_flat(prism)) {
        (true, false) => (keys[0], format!("has no effect without `{wedge}`")),
        (false, false) if fields.is_toml() => {
            (keys[1], "is 0: this prism does not deflect the beam".to_owned())
        }
        (false, true) => (keys[1], format!("without `{rotor_freq}`: this prism does not turn")),
        (true, true) if prism.index == air => {
            (keys[1], format!("has no effect with `{index}` as that of air, {}", number(air)))
        }
        _ => return,
    };
    fields.warn(at, &message);
}

/// True if conic or line optics have an angle, or are on a head that turns them instead.
fn can_deflect(device: &Device) -> bool {
    device.scan_angle_max > 0.0 || device.head.max_rate > 0.0
}

/// Keys that decide whether a deflector deflects.
pub(super) const DEFLECTING: [Key; 4] =
    [K.optics, K.prisms, K.scan_angle_max_deg, K.scan_angle_effective_max_deg];

/// Warns of half angles above half a turn. Only polygons, which fire within a part of their revolution, have
/// larger ones.
fn check_half_angles(fields: &Fields, device: &Device) {
    let along = match device.deflector {
        Deflector::EllipticConic { along_max } => along_max,
        Deflector::Conic | Deflector::Oscillating { .. } | Deflector::Fibres { .. } => 0.0,
        Deflector::Polygon { .. }
        | Deflector::Risley { .. }
        | Deflector::Custom(_)
        | Deflector::Pattern(_) => {
            return;
        }
    };
    let angles = [(K.scan_angle_max_deg, device.scan_angle_max), (K.scan_angle_along_max_deg, along)];
    for (key, angle) in angles {
        // Rounding of the conversion to radians.
        if fields.has(key) && angle > std::f64::consts::PI * (1.0 + 1e-9) {
            let angle = number(angle.to_degrees());
            fields.warn(key, &format!("is {angle}; half angles of these optics are at most 180 degrees"));
        }
    }
}

/// Warns of a mirror or of prisms whose settings prevent all pulses or leave the beam as it is, and rejects a
/// cone that XML describes incompletely.
pub(super) fn check_deflector(fields: &Fields, device: &Device, in_channel: bool) {
    check_half_angles(fields, device);
    match &device.deflector {
        Deflector::EllipticConic { .. } if !fields.is_toml() => check_cone(fields, device),
        Deflector::Polygon { effective_max, .. } => {
            let angles = [
                (K.scan_angle_max_deg, device.scan_angle_max),
                (K.scan_angle_effective_max_deg, *effective_max),
            ];
            // In TOML the usable angle is the mechanical one by default, so that one warning is enough.
            let count = if fields.is_toml() { 1 } else { 2 };
            for (key, _) in angles.iter().filter(|(_, angle)| *angle == 0.0).take(count) {
                let message = format!("rotating optics without `{}` emit no pulses", fields.name(*key));
                fields.context.warn(fields.place(*key), message);
            }
        }
        // Channels differ by the directions of their beams, so no deflector is needed.
        Deflector::Conic | Deflector::Fibres { .. } if !in_channel && !can_deflect(device) => {
            let optics = device.deflector.optics();
            let message = format!(
                "{optics} optics without `{}` never deflect the beam: all pulses leave in one direction",
                fields.name(K.scan_angle_max_deg)
            );
            fields.context.warn(fields.place(K.scan_angle_max_deg), message);
        }
        Deflector::Fibres { count: 1 }
            if !in_channel && !fields.has(K.fibres) && device.head.max_rate == 0.0 =>
        {
            let message = format!(
                "line optics without `{}` have a single fibre: all pulses leave in one direction",
                fields.name(K.fibres)
            );
            fields.context.warn(fields.own_place(), message);
        }
        Deflector::Risley { prisms, air, .. } if !prisms.iter().any(|p| !is_flat(p) && p.index != *air) => {
            let (keys, help) = match fields.is_toml() {
                true => ("`prisms`", ""),
                false => (
                    "`angle1_deg`, `angle2_deg` and their `refrIndex1`, `refrIndex2`",
                    "files for HELIOS++ 1 do not have them; data/scanners_tls.xml#livox_mid-70 of the \
                     catalogue has them",
                ),
            };
            let message = format!(
                "risley optics without {keys}: the beam is never deflected, all pulses leave in one direction"
            );
            fields.context.warn_help(fields.own_place(), message, help);
        }
        Deflector::Risley { prisms, air, .. } if !fields.is_toml() => {
            for (prism, keys) in prisms.iter().zip([PRISM_1, PRISM_2, PRISM_3]) {
                check_prism(fields, &keys, prism, *air);
            }
        }
        _ => {}
    }
}
