//! Scanner and platform settings of a leg, merged from the leg, its template and the scanner (spec input-formats
//! §2.4–2.5, spec kinematics §1.7).

use super::context::Context;
use super::fields::Fields;
use super::xml::Element;
use super::{LegTrajectory, PlatformSettings, ScannerSettings};
use vlscan_base::quantity::{self, number};
use vlscan_geom::{DVec3, degrees};

/// Scanner settings as written, before merging. Angles are radians; vertical angles that are NaN are not set.
#[derive(Clone, Debug)]
pub(super) struct ScannerLayer {
    pub active: bool,
    pub pulse_freq: i32,
    pub scan_freq: f64,
    scan_angle: f64,
    vertical_min: f64,
    vertical_max: f64,
    pub head_rate: f64,
    head_start: f64,
    head_stop: f64,
    pub beam_divergence: f64,
    /// `beam_divergence` as written, NaN where it is not: here no value is reserved for "not given".
    own_divergence: f64,
    trajectory_interval: f64,
    max_duration: f64,
    warmup: f64,
    pub vertical_resolution: f64,
    pub horizontal_resolution: f64,
}

impl ScannerLayer {
    /// Values without a template; in merging they mean "not given".
    pub const DEFAULT: ScannerLayer = ScannerLayer {
        active: true,
        pulse_freq: 0,
        scan_freq: 0.0,
        scan_angle: 0.0,
        vertical_min: f64::NAN,
        vertical_max: f64::NAN,
        head_rate: 0.0,
        head_start: 0.0,
        head_stop: 0.0,
        beam_divergence: 0.003,
        own_divergence: f64::NAN,
        trajectory_interval: 0.0,
        max_duration: -1.0,
        warmup: 0.0,
        vertical_resolution: 0.0,
        horizontal_resolution: 0.0,
    };

    /// The scanner's default values.
    pub fn of_scanner(pulse_freq: u32, beam_divergence: f64) -> ScannerLayer {
        let pulse_freq = i32::try_from(pulse_freq).unwrap_or(i32::MAX);
        ScannerLayer { pulse_freq, beam_divergence, own_divergence: beam_divergence, ..ScannerLayer::DEFAULT }
    }

    /// Reads a `<scannerSettings>` with `base` as defaults.
    pub fn read(context: &Context, element: &Element, base: &ScannerLayer) -> ScannerLayer {
        let mut fields = Fields::new(context, element);
        let mut angle_or_nan = |name: &'static str, base: f64| match fields.has(name) {
            // NaN unsets the value of a template.
            true if fields.element.value(name).is_some_and(is_nan) => {
                fields.ignore(&[name]);
                f64::NAN
            }
            true => fields.optional_angle(name).unwrap_or(base),
            false => {
                fields.ignore(&[name]);
                base
            }
        };
        let vertical_min = angle_or_nan("verticalAngleMin_deg", base.vertical_min);
        let vertical_max = angle_or_nan("verticalAngleMax_deg", base.vertical_max);
        let beam_divergence =
            fields.within("beamDivergence_rad", base.beam_divergence, &quantity::DIVERGENCE);
        let layer = ScannerLayer {
            active: fields.flag("active", base.active),
            pulse_freq: fields.whole("pulseFreq_hz", base.pulse_freq),
            scan_freq: fields.within("scanFreq_hz", base.scan_freq, &quantity::SCAN_FREQ),
            scan_angle: fields.angle("scanAngle_deg", base.scan_angle, &quantity::HALF_ANGLE),
            vertical_min,
            vertical_max,
            head_rate: fields.angle("headRotatePerSec_deg", base.head_rate, &quantity::HEAD_RATE),
            head_start: fields.angle("headRotateStart_deg", base.head_start, &quantity::ANGLE),
            head_stop: fields.angle("headRotateStop_deg", base.head_stop, &quantity::ANGLE),
            beam_divergence,
            own_divergence: if fields.has("beamDivergence_rad") {
                beam_divergence
            } else {
                base.own_divergence
            },
            trajectory_interval: fields.within(
                "trajectoryTimeInterval_s",
                base.trajectory_interval,
                &quantity::SAMPLE_INTERVAL,
            ),
            max_duration: read_duration(context, &mut fields, base.max_duration),
            warmup: fields.within("opticsWarmupPhase_s", base.warmup, &quantity::WARMUP),
            vertical_resolution: fields.angle(
                "verticalResolution_deg",
                base.vertical_resolution,
                &quantity::ANGLE,
            ),
            horizontal_resolution: fields.angle(
                "horizontalResolution_deg",
                base.horizontal_resolution,
                &quantity::ANGLE,
            ),
        };
        if fields.has("pulseFreq_hz") && layer.pulse_freq < 0 {
            fields.refuse("pulseFreq_hz", "a whole number above 0");
        }
        if layer.vertical_min > layer.vertical_max {
            let name = if fields.has("verticalAngleMax_deg") {
                "verticalAngleMax_deg"
            } else {
                "verticalAngleMin_deg"
            };
            fields.refuse(name, "such that the lower vertical angle does not exceed the upper one");
        }
        if layer.max_duration < 0.0 && layer.max_duration != ScannerLayer::DEFAULT.max_duration {
            fields.warn("maxDuration_s", "is below 0: the leg has no limit");
        }
        layer.check_head(&mut fields);
        fields.ignore(&["id", "name", "template"]);
        fields.done(&["maxDuration_s"]);
        layer
    }

    /// Warns when the head does not turn towards its stop angle.
    fn check_head(&self, fields: &mut Fields) {
        let way = self.head_stop - self.head_start;
        if fields.has("headRotateStop_deg") && way * self.head_rate < 0.0 {
            let direction = if self.head_rate > 0.0 { "at least" } else { "at most" };
            let start = number(degrees(self.head_start));
            fields.refuse(
                "headRotateStop_deg",
                &format!("{direction} the start angle {start} for this head speed"),
            );
        }
    }

    /// Selects each value from the leg (`self`), the template or the scanner by comparing values (spec input-formats
    /// §2.5).
    pub fn merged(&self, template: Option<&ScannerLayer>, scanner: &ScannerLayer) -> ScannerLayer {
        let default = &ScannerLayer::DEFAULT;
        let template = template.unwrap_or(default);
        let own_divergence =
            if self.own_divergence.is_nan() { scanner.own_divergence } else { self.own_divergence };
        macro_rules! pick {
            ($($field:ident),*) => {
                ScannerLayer { own_divergence, $($field: {
                    if self.$field != template.$field {
                        self.$field
                    } else if template.$field != default.$field {
                        template.$field
                    } else {
                        scanner.$field
                    }
                }),* }
            };
        }
        pick!(
            active,
            pulse_freq,
            scan_freq,
            scan_angle,
            vertical_min,
            vertical_max,
            head_rate,
            head_start,
            head_stop,
            beam_divergence,
            trajectory_interval,
            max_duration,
            warmup,
            vertical_resolution,
            horizontal_resolution
        )
    }

    /// Warns of attributes of `element`, read as these settings, whose values count as not given in merging.
    pub fn report_unheeded(&self, context: &Context, element: &Element, merged: &ScannerLayer) {
        let angle = |value: f64| if value.is_nan() { "none".to_owned() } else { number(degrees(value)) };
        let pairs = [
            ("active", self.active.to_string(), merged.active.to_string()),
            ("pulseFreq_hz", self.pulse_freq.to_string(), merged.pulse_freq.to_string()),
            ("scanFreq_hz", number(self.scan_freq), number(merged.scan_freq)),
            ("scanAngle_deg", angle(self.scan_angle), angle(merged.scan_angle)),
            ("verticalAngleMin_deg", angle(self.vertical_min), angle(merged.vertical_min)),
            ("verticalAngleMax_deg", angle(self.vertical_max), angle(merged.vertical_max)),
            ("headRotatePerSec_deg", angle(self.head_rate), angle(merged.head_rate)),
            ("headRotateStart_deg", angle(self.head_start), angle(merged.head_start)),
            ("headRotateStop_deg", angle(self.head_stop), angle(merged.head_stop)),
            ("beamDivergence_rad", number(self.beam_divergence), number(merged.beam_divergence)),
            (
                "trajectoryTimeInterval_s",
                number(self.trajectory_interval),
                number(merged.trajectory_interval),
            ),
            ("maxDuration_s", number(self.max_duration), number(merged.max_duration)),
            ("opticsWarmupPhase_s", number(self.warmup), number(merged.warmup)),
            ("verticalResolution_deg", angle(self.vertical_resolution), angle(merged.vertical_resolution)),
            (
                "horizontalResolution_deg",
                angle(self.horizontal_resolution),
                angle(merged.horizontal_resolution),
            ),
        ];
        for (name, written, used) in pairs {
            if element.value(name).is_some() && written != used {
                let message = format!(
                    "`{name}` of {written} is a default and counts as not given; {used} is used, as in HELIOS++"
                );
                context.warn(element.value_place(name), message);
            }
        }
    }

    /// Converts the settings to the model. A pulse rate below 1 has been reported.
    pub fn resolved(&self) -> ScannerSettings {
        let set = |angle: f64| (!angle.is_nan()).then_some(angle);
        ScannerSettings {
            active: self.active,
            pulse_freq: u32::try_from(self.pulse_freq).unwrap_or(0),
            scan_freq: self.scan_freq,
            scan_angle: self.scan_angle,
            vertical_min: set(self.vertical_min),
            vertical_max: set(self.vertical_max),
            head_rate: self.head_rate,
            head_start: self.head_start,
            head_stop: self.head_stop,
            beam_divergence: self.beam_divergence,
            written_divergence: (self.own_divergence != self.beam_divergence
                && !self.own_divergence.is_nan())
            .then_some(self.own_divergence),
            trajectory_interval: self.trajectory_interval,
            max_duration: (self.max_duration > 0.0).then_some(self.max_duration),
            warmup: self.warmup,
        }
    }
}

fn is_nan(text: &str) -> bool {
    text.parse::<f64>().is_ok_and(f64::is_nan)
}

/// The value of the attribute, else of the child element's text.
fn read_duration(context: &Context, fields: &mut Fields, base: f64) -> f64 {
    let attribute = fields.within("maxDuration_s", base, &quantity::NUMBER);
    if fields.has("maxDuration_s") {
        return attribute;
    }
    let Some(child) = fields.element.child("maxDuration_s") else { return base };
    match child.content().trim().parse::<f64>() {
        Ok(value) if quantity::NUMBER.contains(value) => value,
        _ => {
            let found = child.content().trim();
            let message = format!("expected a number in <maxDuration_s>, found `{found}`; {base} is used");
            context.warn(child.place(), message);
            base
        }
    }
}

/// Platform settings as written.
#[derive(Clone, Debug)]
pub(super) struct PlatformLayer {
    position: DVec3,
    on_ground: bool,
    speed: f64,
    stop_and_turn: bool,
    smooth_turn: bool,
    slowdown: bool,
    /// Takes effect only in the leg's own element, not in a template.
    yaw_at_departure: Option<f64>,
    pub trajectory: TrajectoryLayer,
}

#[derive(Clone, Debug, Default)]
pub(super) struct TrajectoryLayer {
    pub file: Option<String>,
    /// The element that names the file, for messages and the search path.
    pub file_at: Option<Element>,
    pub columns: Option<[usize; 7]>,
    pub separator: Option<char>,
    pub start: Option<f64>,
    pub end: Option<f64>,
    pub teleport: bool,
    pub position_only: Option<bool>,
    pub degrees: Option<bool>,
    pub sync_gps: bool,
    pub slope_filter: f64,
}

impl PlatformLayer {
    /// Whether the element says how the platform turns at its departure.
    pub fn has_departure(&self) -> bool {
        self.yaw_at_departure.is_some()
    }

    pub fn unset() -> PlatformLayer {
        PlatformLayer {
            position: DVec3::ZERO,
            on_ground: false,
            speed: 70.0,
            stop_and_turn: true,
            smooth_turn: false,
            slowdown: true,
            yaw_at_departure: None,
            trajectory: TrajectoryLayer::default(),
        }
    }

    /// Reads a `<platformSettings>` with `base` as defaults.
    pub fn read(context: &Context, element: &Element, base: &PlatformLayer) -> PlatformLayer {
        let mut fields = Fields::new(context, element);
        let smooth_turn = fields.flag("smoothTurn", base.smooth_turn);
        if smooth_turn && matches!(fields.element.value("stopAndTurn"), Some("true" | "1")) {
            fields.warn("stopAndTurn", "has no effect beside `smoothTurn`");
        }
        let layer = PlatformLayer {
            position: DVec3::new(
                fields.number("x", base.position.x),
                fields.number("y", base.position.y),
                fields.number("z", base.position.z),
            ),
            on_ground: fields.flag("onGround", base.on_ground),
            speed: fields.within("movePerSec_m", base.speed, &quantity::SPEED),
            // A template with smooth turns passes on that the platform does not stop.
            stop_and_turn: fields.flag("stopAndTurn", base.stop_and_turn) && !smooth_turn,
            smooth_turn,
            slowdown: fields.flag("slowdownEnabled", base.slowdown),
            yaw_at_departure: fields.optional_angle("yawAtDeparture_deg"),
            trajectory: base.trajectory.with(&mut fields),
        };
        fields.ignore(&["id", "name", "template"]);
        fields.done(&[]);
        layer
    }

    /// Converts the settings to the model.
    pub fn resolved(&self, trajectory: Option<LegTrajectory>) -> PlatformSettings {
        PlatformSettings {
            position: self.position,
            on_ground: self.on_ground,
            speed: self.speed,
            stop_and_turn: self.stop_and_turn,
            smooth_turn: self.smooth_turn,
            slowdown: self.slowdown,
            yaw_at_departure: self.yaw_at_departure,
            trajectory,
            mount: None,
        }
    }
}

/// Column attributes in the order of their default positions.
const COLUMNS: [&str; 7] = ["tIndex", "rollIndex", "pitchIndex", "yawIndex", "xIndex", "yIndex", "zIndex"];
/// Spellings of the separator attribute; the first is HELIOS++'s.
const SEPARATOR: [&str; 2] = ["trajectory_seperator", "trajectory_separator"];

impl TrajectoryLayer {
    fn with(&self, fields: &mut Fields) -> TrajectoryLayer {
        let file = fields.text("trajectory").map(str::to_owned);
        let own = file.is_some().then(|| fields.element.clone());
        let optional = |fields: &mut Fields, name, base: Option<f64>| match fields.has(name) {
            true => Some(fields.lenient_number(name, base.unwrap_or(0.0))),
            false => {
                fields.ignore(&[name]);
                base
            }
        };
        let flag = |fields: &mut Fields, name, base: Option<bool>| match fields.has(name) {
            true => Some(fields.lenient_flag(name, base.unwrap_or(true))),
            false => {
                fields.ignore(&[name]);
                base
            }
        };
        let layer = TrajectoryLayer {
            columns: read_columns(fields).or(self.columns),
            separator: read_separator(fields).or(self.separator),
            start: optional(fields, "tStart", self.start),
            end: optional(fields, "tEnd", self.end),
            teleport: fields.lenient_flag("teleportToStart", self.teleport),
            position_only: read_domain(fields).or(self.position_only),
            degrees: flag(fields, "toRadians", self.degrees),
            sync_gps: fields.lenient_flag("syncGPSTime", self.sync_gps),
            slope_filter: fields.lenient_number("slopeFilterThreshold", self.slope_filter),
            file_at: own.or(self.file_at.clone()),
            file: file.or(self.file.clone()),
        };
        if let (Some(start), Some(end)) = (layer.start, layer.end)
            && start > end
        {
            fields.refuse(
                if fields.has("tEnd") { "tEnd" } else { "tStart" },
                "such that tStart does not exceed tEnd",
            );
        }
        layer
    }
}

/// All columns when at least one is given; the others keep their default positions.
fn read_columns(fields: &mut Fields) -> Option<[usize; 7]> {
    let given = COLUMNS.iter().any(|name| fields.has(name));
    let mut columns = [0; 7];
    for (i, name) in COLUMNS.iter().enumerate() {
        columns[i] = fields.lenient_count(name, i as u32) as usize;
    }
    given.then_some(columns)
}

fn read_separator(fields: &mut Fields) -> Option<char> {
    let found: Vec<(&str, &str)> =
        SEPARATOR.iter().filter_map(|n| fields.text(n).map(|text| (*n, text))).collect();
    let &(name, text) = found.first()?;
    let mut letters = text.chars();
    match (text, letters.next(), letters.next()) {
        ("\\t", ..) => Some('\t'),
        (_, Some(letter), None) => Some(letter),
        _ => {
            fields.refuse(name, "one character");
            None
        }
    }
}

fn read_domain(fields: &mut Fields) -> Option<bool> {
    match fields.text("interpolationDomain")? {
        "position_and_attitude" => Some(false),
        "position" => Some(true),
        _ => {
            fields.refuse("interpolationDomain", "position or position_and_attitude");
            None
        }
    }
}
