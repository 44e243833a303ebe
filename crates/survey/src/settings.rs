//! Scanner and platform settings of a leg: attributes and keys, merged from the leg, its template and the
//! scanner (spec input-formats §2.4–2.6, spec kinematics §1.7).

use super::context::Context;
use super::fields::Fields;
use super::keys::{Key, LegKeys, SettingsKeys};
use super::pulse_times::change_pulse_times;
use super::trajectories::TrajectoryLayer;
use super::weather::change_weather;
use super::xml::Element;
use super::{
    Deflector, Device, LegTrajectory, PlatformSettings, PulseTimes, Scanner, ScannerSettings, Weather,
};
use vlscan_base::diag::Place;
use vlscan_base::quantity::{ANGLE, Bounds, NUMBER, POSITIVE, number};
use vlscan_geom::{DVec3, degrees, radians};

const K: SettingsKeys = SettingsKeys::KEYS;

/// How a setting is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Whole,
    Number,
    /// Degrees; radians in the model.
    Angle,
}

/// A setting: its key, how it is written, and its value.
type Row = (Key, Kind, fn(&mut ScannerLayer) -> &mut f64);

/// Defines the settings, each with its key and the value that means "not given" in merging.
macro_rules! settings {
    ($($field:ident: $key:ident, $kind:ident = $default:expr;)*) => {
        /// Scanner settings as written, before merging, in the units of the model. Vertical angles that are
        /// NaN are not set.
        #[derive(Clone, Debug)]
        pub(super) struct ScannerLayer {
            pub active: bool,
            $(pub $field: f64,)*
            /// `beam_divergence` as written, NaN where it is not: here no value is reserved for "not given".
            own_divergence: f64,
            /// Times at which pulses leave, in place of a constant rate; only in pipeline files.
            pulse_times: Option<PulseTimes>,
            /// Fog, rain, snow and dust; only in pipeline files.
            weather: Weather,
            /// Place and name of a scan angle of 0, which counts as not given.
            zero_angle: Option<(Place, &'static str)>,
        }

        impl ScannerLayer {
            /// Values without a template; in merging they mean "not given".
            pub const DEFAULT: ScannerLayer =
                ScannerLayer {
                active: true,
                $($field: $default,)*
                own_divergence: f64::NAN,
                pulse_times: None,
                weather: Weather::CLEAR,
                zero_angle: None,
            };
            const ROWS: &'static [Row] = &[$((K.$key, Kind::$kind, |layer| &mut layer.$field)),*];
        }
    };
}

settings! {
    pulse_freq: pulse_freq_hz, Whole = 0.0;
    scan_freq: scan_freq_hz, Number = 0.0;
    scan_angle: scan_angle_deg, Angle = 0.0;
    vertical_min: vertical_angle_min_deg, Angle = f64::NAN;
    vertical_max: vertical_angle_max_deg, Angle = f64::NAN;
    head_rate: head_rate_deg_per_s, Angle = 0.0;
    head_start: head_start_deg, Angle = 0.0;
    head_stop: head_stop_deg, Angle = 0.0;
    beam_divergence: beam_divergence_rad, Number = 0.003;
    trajectory_interval: trajectory_interval_s, Number = 0.0;
    max_duration: max_duration_s, Number = NO_LIMIT;
    warmup: warmup_s, Number = 0.0;
    vertical_resolution: vertical_resolution_deg, Angle = 0.0;
    horizontal_resolution: horizontal_resolution_deg, Angle = 0.0;
}

/// The duration that means "no limit", s.
pub(super) const NO_LIMIT: f64 = -1.0;
/// Attitude of a multicopter at the end of a stop.
const YAW_AT_DEPARTURE: Key = Key::attribute("yawAtDeparture_deg", &ANGLE);
/// Pulses per second in XML, where 0 means "not given".
const PULSE_FREQ_OR_0: Bounds = Bounds::new(0.0, i32::MAX as f64, "a whole number above 0");

impl ScannerLayer {
    /// The scanner's default values.
    pub fn of_scanner(pulse_freq: u32, beam_divergence: f64) -> ScannerLayer {
        let pulse_freq = f64::from(pulse_freq);
        ScannerLayer { pulse_freq, beam_divergence, own_divergence: beam_divergence, ..ScannerLayer::DEFAULT }
    }

    /// The settings of a leg as a layer that keys change.
    pub fn of_leg(settings: &ScannerSettings) -> ScannerLayer {
        ScannerLayer {
            active: settings.active,
            pulse_freq: f64::from(settings.pulse_freq),
            scan_freq: settings.scan_freq,
            scan_angle: settings.scan_angle,
            vertical_min: settings.vertical_min.unwrap_or(f64::NAN),
            vertical_max: settings.vertical_max.unwrap_or(f64::NAN),
            head_rate: settings.head_rate,
            head_start: settings.head_start,
            head_stop: settings.head_stop,
            beam_divergence: settings.beam_divergence,
            own_divergence: settings.written_divergence.unwrap_or(settings.beam_divergence),
            pulse_times: settings.pulse_times.clone(),
            weather: settings.weather.clone(),
            trajectory_interval: settings.trajectory_interval,
            max_duration: settings.max_duration.unwrap_or(NO_LIMIT),
            warmup: settings.warmup,
            ..ScannerLayer::DEFAULT
        }
    }

    /// Reads a `<scannerSettings>` with `base` as defaults.
    pub fn read(context: &Context, element: &Element, base: &ScannerLayer) -> ScannerLayer {
        let (mut fields, mut layer) = (Fields::new(context, element), base.clone());
        layer.active = fields.flag("active", layer.active);
        layer.change(&mut fields);
        fields.ignore(&["id", "name", "template"]);
        fields.done(&[]);
        layer
    }

    /// Applies attributes or keys.
    pub fn change(&mut self, fields: &mut Fields) {
        for &(key, kind, value_of) in ScannerLayer::ROWS {
            let value = value_of(self);
            match kind {
                Kind::Whole => {
                    let bounds = if fields.is_toml() { key.bounds } else { &PULSE_FREQ_OR_0 };
                    *value = f64::from(fields.count(Key { bounds, ..key }, *value as u32));
                }
                Kind::Angle => fields.set_angle(key, value),
                // XML has a number for "no limit".
                Kind::Number if fields.is_toml() && key == K.max_duration_s => {
                    fields.set(Key { bounds: &POSITIVE, ..key }, value);
                }
                Kind::Number => fields.set(key, value),
            }
        }
        if fields.is_toml() {
            change_pulse_times(fields, &mut self.pulse_times);
            change_weather(fields, &mut self.weather);
        }
        if fields.has(K.scan_angle_deg) {
            let written = || (fields.place(K.scan_angle_deg), fields.name(K.scan_angle_deg));
            self.zero_angle = (self.scan_angle == 0.0).then(written);
        }
        self.read_duration(fields);
        if fields.has(K.beam_divergence_rad) {
            self.own_divergence = self.beam_divergence;
        }
        let window = (degrees(self.vertical_min), degrees(self.vertical_max));
        fields.in_order(window, [K.vertical_angle_min_deg, K.vertical_angle_max_deg], "");
        let way = self.head_stop - self.head_start;
        if fields.has(K.head_stop_deg) && way * self.head_rate < 0.0 {
            let direction = if self.head_rate > 0.0 { "at least" } else { "at most" };
            let start = number(degrees(self.head_start));
            fields
                .refuse(K.head_stop_deg, &format!("{direction} the start angle {start} for this head speed"));
        }
    }

    /// Checks the duration, which XML may also have in a child element.
    fn read_duration(&mut self, fields: &mut Fields) {
        if fields.is_toml() {
            return;
        }
        let is_attribute = fields.has(K.max_duration_s);
        let child = fields.element_child(K.max_duration_s).filter(|_| !is_attribute);
        if let Some(element) = child.as_ref().and_then(Fields::element) {
            let text = element.content().trim();
            match text.parse::<f64>() {
                Ok(value) if NUMBER.contains(value) => self.max_duration = value,
                _ => {
                    let used = self.max_duration;
                    let message =
                        format!("expected a number in <maxDuration_s>, found `{text}`; {used} is used");
                    fields.context.warn(element.place(), message);
                }
            }
        }
        if self.max_duration < 0.0 && self.max_duration != NO_LIMIT {
            fields.warn(K.max_duration_s, "is below 0: the leg has no limit");
        }
    }

    /// Selects each value from the leg (`self`), the template or the scanner by comparing values (spec
    /// input-formats §2.5).
    pub fn merged(&self, template: Option<&ScannerLayer>, scanner: &ScannerLayer) -> ScannerLayer {
        let mut default = ScannerLayer::DEFAULT;
        let (mut own, mut scanner) = (self.clone(), scanner.clone());
        let mut template = template.unwrap_or(&default).clone();
        for (_, _, value_of) in ScannerLayer::ROWS {
            let (template, default) = (*value_of(&mut template), *value_of(&mut default));
            let value = value_of(&mut own);
            if *value == template {
                *value = if template != default { template } else { *value_of(&mut scanner) };
            }
        }
        if own.own_divergence.is_nan() {
            own.own_divergence = scanner.own_divergence;
        }
        own
    }

    /// Warns of attributes of `element`, read as these settings, whose values count as not given in merging.
    pub fn report_unused(&self, context: &Context, element: &Element, merged: &ScannerLayer) {
        let (mut own, mut merged) = (self.clone(), merged.clone());
        for &(key, kind, value_of) in ScannerLayer::ROWS {
            let name = key.attribute;
            let [written, used] = [&mut own, &mut merged].map(|layer| match *value_of(layer) {
                angle if angle.is_nan() => "none".to_owned(),
                angle if kind == Kind::Angle => number(degrees(angle)),
                value => number(value),
            });
            if element.value(name).is_some() && written != used {
                let message = format!(
                    "`{name}` of {written} is a default and treated as not given; {used} is used, as in \
                     HELIOS++"
                );
                context.warn(element.value_place(name), message);
            }
        }
    }

    /// Warns of a scan angle of 0 where the scanner's maximum is used instead.
    pub fn report_zero_angle(&self, context: &Context, scanner: &Scanner) {
        let Some((place, name)) = self.zero_angle.clone().filter(|_| self.active && self.scan_angle == 0.0)
        else {
            return;
        };
        let has_window = !self.vertical_min.is_nan() && !self.vertical_max.is_nan();
        let widest = |device: &Device| match device.deflector {
            Deflector::Polygon { .. } if has_window => 0.0,
            Deflector::Polygon { effective_max, .. } => effective_max.min(device.scan_angle_max),
            Deflector::Conic | Deflector::EllipticConic { .. } | Deflector::Fibres { .. } => {
                device.scan_angle_max
            }
            // An oscillating mirror needs one, prisms have none.
            _ => 0.0,
        };
        let widest = scanner.devices.iter().map(widest).fold(0.0, f64::max);
        if widest > 0.0 {
            let widest = number(degrees(widest));
            let message =
                format!("`{name}` of 0 counts as not given; the scanner's {widest} degrees are used");
            context.warn_help(
                place,
                message,
                "for a single line give the smallest angle that you mean, such as 0.01",
            );
        }
    }

    /// Computes scan frequency and head speed from the angular resolutions in `fields` (spec input-formats
    /// §2.6).
    pub fn apply_resolution(&mut self, fields: &Fields, scanner: &Scanner) {
        let keys = [K.vertical_resolution_deg, K.horizontal_resolution_deg];
        let angles = [self.vertical_resolution, self.horizontal_resolution];
        let [given, other] = if angles[0] == 0.0 { [keys[1], keys[0]] } else { keys };
        let (context, device) = (fields.context, &scanner.devices[0]);
        let is_said = fields.is_toml() && (fields.has(given) || fields.has(other));
        if !self.active && !fields.is_toml() || angles == [0.0; 2] && !is_said {
            return;
        }
        if !matches!(device.deflector, Deflector::Polygon { .. }) {
            let message = "angular resolutions have no effect: the scanner has no rotating optics";
            match fields.is_toml() {
                true => context.error(fields.place(given), message),
                false => context.warn(fields.own_place(), message),
            }
        } else if angles.contains(&0.0) {
            let [given_name, other] = [given, other].map(|key| fields.name(key));
            let message = format!("`{given_name}` is given without `{other}`; the scanner would stand still");
            context.error_help(fields.place(given), message, format!("give `{other}` as well"));
        } else if let Some(i) = angles.iter().position(|angle| *angle < 0.0) {
            fields.error(keys[i], "must be above 0");
        } else if device.scan_angle_max <= 0.0 {
            let needed = if fields.is_toml() { "scan_angle_max_deg" } else { "scanAngleMax_deg" };
            let message = format!("angular resolutions need a scanner with `{needed}` above 0");
            context.error(fields.own_place(), message);
        } else {
            for (replaced, by) in [K.scan_freq_hz, K.head_rate_deg_per_s].into_iter().zip(keys) {
                if fields.has(replaced) && fields.has(by) {
                    let why = format!("beside `{}`, from which it follows", fields.name(by));
                    fields.warn_of_effect(replaced, &why);
                }
            }
            self.scan_freq = self.pulse_freq * self.vertical_resolution / (2.0 * device.scan_angle_max);
            self.head_rate = self.horizontal_resolution * self.scan_freq;
        }
    }

    /// Converts the settings to the model. A pulse rate below 1 has been reported.
    pub fn resolved(&self) -> ScannerSettings {
        let set = |angle: f64| (!angle.is_nan()).then_some(angle);
        let is_other = self.own_divergence != self.beam_divergence && !self.own_divergence.is_nan();
        let mean = self.pulse_times.as_ref().map(|times| times.mean_rate().round().max(1.0));
        ScannerSettings {
            active: self.active,
            pulse_freq: mean.unwrap_or(self.pulse_freq) as u32,
            pulse_times: self.pulse_times.clone(),
            scan_freq: self.scan_freq,
            scan_angle: self.scan_angle,
            vertical_min: set(self.vertical_min),
            vertical_max: set(self.vertical_max),
            head_rate: self.head_rate,
            head_start: self.head_start,
            head_stop: self.head_stop,
            beam_divergence: self.beam_divergence,
            written_divergence: is_other.then_some(self.own_divergence),
            trajectory_interval: self.trajectory_interval,
            max_duration: (self.max_duration > 0.0).then_some(self.max_duration),
            warmup: self.warmup,
            weather: self.weather.clone(),
        }
    }
}

/// Warns of a place of which some coordinates are given and others are missing, unless a template may have
/// them.
pub(super) fn warn_of_missing_coordinates(context: &Context, element: &Element) {
    let on_ground = matches!(element.value("onGround"), Some(value) if !matches!(value, "false" | "0"));
    let missing: Vec<&str> =
        ["x", "y", "z"].into_iter().filter(|name| element.value(name).is_none()).collect();
    let is_partial = missing.len() < 3 && missing.iter().any(|name| *name != "z" || !on_ground);
    if is_partial && element.value("template").is_none() {
        let (names, is) = (missing.join("` and `"), if missing.len() == 1 { "is" } else { "are" });
        context.warn(element.place(), format!("`{names}` of the platform {is} missing; 0 is used"));
    }
}

/// Platform settings as written.
#[derive(Clone, Debug)]
pub(super) struct PlatformLayer {
    settings: PlatformSettings,
    pub trajectory: TrajectoryLayer,
}

impl PlatformLayer {
    /// True if the element states how the platform turns at its departure.
    pub fn has_departure(&self) -> bool {
        self.settings.yaw_at_departure.is_some()
    }

    pub fn unset() -> PlatformLayer {
        PlatformLayer { settings: PlatformSettings::at(DVec3::ZERO), trajectory: TrajectoryLayer::default() }
    }

    /// Reads a `<platformSettings>` with `base` as defaults.
    pub fn read(context: &Context, element: &Element, base: &PlatformLayer) -> PlatformLayer {
        let mut fields = Fields::new(context, element);
        let (keys, default) = (LegKeys::KEYS, &base.settings);
        let smooth_turn = fields.flag("smoothTurn", default.smooth_turn);
        if smooth_turn && matches!(element.value("stopAndTurn"), Some("true" | "1")) {
            fields.warn("stopAndTurn", "has no effect beside `smoothTurn`");
        }
        let speed_is_given = fields.has(keys.speed_m_per_s);
        let DVec3 { x, y, z } = default.position;
        let position = [("x", x), ("y", y), ("z", z)].map(|(name, default)| fields.number(name, default));
        let settings = PlatformSettings {
            position: DVec3::from(position),
            on_ground: fields.flag(keys.on_ground, default.on_ground),
            speed: fields.number(keys.speed_m_per_s, default.speed),
            has_speed: default.has_speed || speed_is_given,
            // With smooth turns of a template the platform does not stop either.
            stop_and_turn: fields.flag("stopAndTurn", default.stop_and_turn) && !smooth_turn,
            smooth_turn,
            slowdown: fields.flag("slowdownEnabled", default.slowdown),
            // Takes effect only in the element of the leg, not in a template.
            yaw_at_departure: fields.optional(YAW_AT_DEPARTURE).map(radians),
            trajectory: None,
            mount: None,
        };
        let trajectory = base.trajectory.with(&mut fields, element);
        fields.ignore(&["id", "name", "template"]);
        fields.done(&[]);
        PlatformLayer { settings, trajectory }
    }

    /// Converts the settings to the model.
    pub fn resolved(self, trajectory: Option<LegTrajectory>) -> PlatformSettings {
        PlatformSettings { trajectory, ..self.settings }
    }
}
