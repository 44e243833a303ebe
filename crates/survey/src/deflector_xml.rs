//! Deflector attributes of scanners and channels (spec input-formats §6.1, §6.4).

use super::context::Context;
use super::fields::Fields;
use super::xml::Element;
use super::{Deflector, Prism};
use vlscan_base::quantity::{self, HALF_ANGLE, number};
use vlscan_geom::{DVec3, radians, unit};

/// Kinds of optics; no others exist.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Optics {
    Rotating,
    Oscillating,
    Conic,
    Line,
    Risley,
}

impl Optics {
    pub const ALL: [Optics; 5] =
        [Optics::Rotating, Optics::Oscillating, Optics::Conic, Optics::Line, Optics::Risley];

    pub fn name(self) -> &'static str {
        match self {
            Optics::Rotating => "rotating",
            Optics::Oscillating => "oscillating",
            Optics::Conic => "conic",
            Optics::Line => "line",
            Optics::Risley => "risley",
        }
    }
}

/// All parameters of a deflector, for every kind of optics.
#[derive(Clone, Debug)]
pub(super) struct DeflectorSettings {
    pub optics: Optics,
    /// Mechanical half angle, rad.
    pub angle_max: f64,
    /// Usable half angle, rad.
    effective_max: f64,
    /// Tilts of the facets of a mirror, rad.
    facet_tilts: Vec<f64>,
    /// Usable half angle of a cone at right angles to the other one, rad; 0: circular.
    along_max: f64,
    /// Limits of the scan frequency, Hz.
    pub scan_freq: (f64, f64),
    scan_product: f64,
    fibres: u32,
    prisms: [Prism; 3],
    air: f64,
    incident: DVec3,
}

/// Wedges flatter than this (degrees) do not deflect and are left out.
const NO_WEDGE_DEG: f64 = 1e-6;

/// Attributes that only one kind of optics has.
const OWN_ATTRIBUTES: [(Optics, &[&str]); 5] = [
    (Optics::Rotating, &["scanAngleEffectiveMax_deg", "facetTilts_deg"]),
    (Optics::Oscillating, &["scanProduct"]),
    (Optics::Conic, &["scanAngleAlongMax_deg"]),
    (Optics::Line, &["numFibers"]),
    (
        Optics::Risley,
        &[
            "rotorFreq1_Hz",
            "rotorFreq2_Hz",
            "rotorFreq3_Hz",
            "angle1_deg",
            "angle2_deg",
            "angle3_deg",
            "refrIndex1",
            "refrIndex2",
            "refrIndex3",
            "refrIndex_air",
        ],
    ),
];

const ROTOR_FREQ: [&str; 3] = ["rotorFreq1_Hz", "rotorFreq2_Hz", "rotorFreq3_Hz"];
const WEDGE: [&str; 3] = ["angle1_deg", "angle2_deg", "angle3_deg"];
const INDEX: [&str; 3] = ["refrIndex1", "refrIndex2", "refrIndex3"];

impl DeflectorSettings {
    pub fn new(optics: Optics) -> DeflectorSettings {
        DeflectorSettings {
            optics,
            angle_max: 0.0,
            effective_max: 0.0,
            facet_tilts: Vec::new(),
            along_max: 0.0,
            scan_freq: (0.0, 0.0),
            scan_product: 1_000_000.0,
            fibres: 1,
            prisms: [Prism { rotor_freq: 0.0, angle: 0.0, index: 1.0 }; 3],
            air: 1.0,
            incident: DVec3::Y,
        }
    }

    /// These settings with the attributes of the element applied.
    pub fn with(&self, fields: &mut Fields) -> DeflectorSettings {
        let mut prisms = self.prisms;
        for (i, prism) in prisms.iter_mut().enumerate() {
            prism.rotor_freq = fields.within(ROTOR_FREQ[i], prism.rotor_freq, &quantity::ROTOR_FREQ);
            prism.angle = fields.angle(WEDGE[i], prism.angle, &quantity::WEDGE);
            prism.index = fields.within(INDEX[i], prism.index, &quantity::REFRACTIVE_INDEX);
        }
        for (optics, names) in OWN_ATTRIBUTES {
            if optics != self.optics {
                fields.without_effect(names, &format!("with {} optics", self.optics.name()));
            }
        }
        let scan_freq = (
            fields.within("scanFreqMin_Hz", self.scan_freq.0, &quantity::SCAN_FREQ),
            fields.within("scanFreqMax_Hz", self.scan_freq.1, &quantity::SCAN_FREQ),
        );
        check_scan_freqs(fields, scan_freq);
        DeflectorSettings {
            optics: self.optics,
            angle_max: fields.angle("scanAngleMax_deg", self.angle_max, &HALF_ANGLE),
            effective_max: fields.angle("scanAngleEffectiveMax_deg", self.effective_max, &HALF_ANGLE),
            facet_tilts: read_facet_tilts(fields).unwrap_or_else(|| self.facet_tilts.clone()),
            along_max: fields.angle("scanAngleAlongMax_deg", self.along_max, &HALF_ANGLE),
            scan_freq,
            scan_product: f64::from(fields.whole_within(
                "scanProduct",
                self.scan_product as u32,
                1..=u32::MAX,
            )),
            fibres: fields.whole_within("numFibers", self.fibres, 1..=u32::MAX),
            prisms,
            air: fields.within("refrIndex_air", self.air, &quantity::REFRACTIVE_INDEX),
            incident: self.incident,
        }
    }

    /// Sets the incident beam by the `<incidentBeam>` of a channel.
    pub fn read_incident_beam(&mut self, context: &Context, element: &Element) {
        let Some(beam) = element.child("incidentBeam") else { return };
        let mut fields = Fields::new(context, &beam);
        let direction = fields.xyz();
        fields.done(&[]);
        if direction.length_squared() > 0.0 {
            self.incident = unit(direction);
        } else {
            context.error(beam.place(), "the incident beam must have a direction");
        }
    }

    pub fn build(&self) -> Deflector {
        match self.optics {
            Optics::Rotating => Deflector::Polygon {
                effective_max: self.effective_max,
                facet_tilts: self.facet_tilts.clone(),
            },
            Optics::Oscillating => Deflector::Oscillating { scan_product: self.scan_product },
            Optics::Conic if self.along_max > 0.0 => Deflector::EllipticConic { along_max: self.along_max },
            Optics::Conic => Deflector::Conic,
            Optics::Line => Deflector::Fibres { count: self.fibres },
            Optics::Risley => {
                let wedge = radians(NO_WEDGE_DEG);
                let prisms = self.prisms.iter().filter(|p| p.angle.abs() > wedge).copied().collect();
                Deflector::Risley { prisms, air: self.air, incident: self.incident }
            }
        }
    }

    /// Warns about a mirror whose settings prevent all pulses, and refuses an ellipse without its larger angle.
    pub fn check(&self, context: &Context, element: &Element) {
        if self.optics == Optics::Conic && self.along_max > 0.0 && self.angle_max <= 0.0 {
            let message = "an elliptic cone (`scanAngleAlongMax_deg`) needs a `scanAngleMax_deg` above 0";
            context.error(element.value_place("scanAngleAlongMax_deg"), message);
        }
        if self.optics == Optics::Risley {
            self.check_prisms(context, element);
        }
        if self.optics != Optics::Rotating {
            return;
        }
        for (angle, name) in
            [(self.angle_max, "scanAngleMax_deg"), (self.effective_max, "scanAngleEffectiveMax_deg")]
        {
            if angle == 0.0 {
                let message = format!("rotating optics without `{name}` emit no pulse");
                context.warn(element.value_place(name), message);
            }
        }
    }
}

impl DeflectorSettings {
    /// Warns of prisms that do not deflect or do not turn.
    fn check_prisms(&self, context: &Context, element: &Element) {
        let wedge = radians(NO_WEDGE_DEG);
        let deflects = |p: &Prism| p.angle.abs() > wedge && p.index != self.air;
        if !self.prisms.iter().any(deflects) {
            let message = "risley optics without `angle1_deg`, `angle2_deg` and their `refrIndex1`, `refrIndex2`: the beam \
                           is never deflected, all pulses leave in one direction";
            let help = "files for HELIOS++ 1 leave them out; data/scanners_tls.xml#livox_mid-70 of the catalogue has them";
            context.warn_help(element.place(), message, help);
            return;
        }
        for (i, prism) in self.prisms.iter().enumerate() {
            let (freq, angle, index) = (ROTOR_FREQ[i], WEDGE[i], INDEX[i]);
            let message = match (prism.rotor_freq != 0.0, prism.angle.abs() > wedge) {
                (true, false) => format!("`{freq}` has no effect without `{angle}`"),
                (false, true) => format!("`{angle}` without `{freq}`: this prism does not turn"),
                (_, true) if prism.index == self.air => {
                    format!("`{angle}` has no effect with `{index}` as that of air, {}", number(self.air))
                }
                _ => continue,
            };
            context.warn(element.value_place(if prism.rotor_freq != 0.0 { freq } else { angle }), message);
        }
    }
}

/// Refuses limits of the scan frequency that no leg can meet both, where the element states one of them (spec input-formats §2.7).
fn check_scan_freqs(fields: &Fields, (least, most): (f64, f64)) {
    if most == 0.0 || least <= most {
        return;
    }
    if fields.has("scanFreqMax_Hz") {
        fields.refuse(
            "scanFreqMax_Hz",
            &format!("at least scanFreqMin_Hz, {}, or 0 for no limit", number(least)),
        );
    } else if fields.has("scanFreqMin_Hz") {
        fields.refuse("scanFreqMin_Hz", &format!("at most scanFreqMax_Hz, {}", number(most)));
    }
}

/// The angles in `facetTilts_deg`, separated by semicolons, as rad.
fn read_facet_tilts(fields: &mut Fields) -> Option<Vec<f64>> {
    let text = fields.text("facetTilts_deg")?.to_owned();
    let tilts: Option<Vec<f64>> = text.split(';').map(|word| word.trim().parse().ok()).collect();
    let tilts = tilts.filter(|tilts| are_facet_tilts(tilts));
    if tilts.is_none() {
        fields.refuse("facetTilts_deg", FACET_TILTS);
    }
    tilts.map(|tilts| tilts.into_iter().map(radians).collect())
}

/// What is expected of the tilts of facets.
pub(super) const FACET_TILTS: &str = "up to 64 angles between -90 and 90";

/// Whether these can be the tilts of a mirror's facets, degrees.
pub(super) fn are_facet_tilts(tilts: &[f64]) -> bool {
    (1..=64).contains(&tilts.len()) && tilts.iter().all(|tilt| tilt.abs() < 90.0)
}

pub(super) fn read_optics(fields: &mut Fields, context: &Context) -> Option<Optics> {
    let text = fields.text("optics")?;
    let found = Optics::ALL.into_iter().find(|optics| optics.name() == text);
    if found.is_none() {
        let known = Optics::ALL.map(Optics::name);
        let help = match vlscan_base::diag::nearest(text, known) {
            Some(near) => format!("did you mean `{near}`?"),
            None => format!("the optics are {}", known.join(", ")),
        };
        context.error_help(fields.element.value_place("optics"), format!("unknown optics `{text}`"), help);
    }
    found
}
