//! The legs of a survey (spec input-formats §2.3).

use super::context::Context;
use super::fields::{Fields, read_mount};
use super::platform_xml::{mount_of_other, read_platform};
use super::settings::{PlatformLayer, ScannerLayer};
use super::templates::Templates;
use super::trajectories::Trajectories;
use super::xml::Element;
use super::{Deflector, Leg, Platform, Scanner};

/// The state of the reader of legs.
pub(super) struct LegReader<'c> {
    context: &'c Context,
    scanner: Option<&'c Scanner>,
    scanner_templates: Templates<ScannerLayer>,
    platform_templates: Templates<PlatformLayer>,
    /// Only for interpolated platforms.
    pub trajectories: Option<Trajectories>,
}

/// The duration that means "no limit", s.
const NO_LIMIT: f64 = -1.0;
/// The text that means "no strip".
const NO_STRIP: &str = "NULL_STRIP_ID";

impl<'c> LegReader<'c> {
    pub fn new(
        context: &'c Context,
        scanner: Option<&'c Scanner>,
        trajectories: Option<Trajectories>,
    ) -> Self {
        LegReader {
            context,
            scanner,
            scanner_templates: Templates::new("scannerSettings", ScannerLayer::read),
            platform_templates: Templates::new("platformSettings", PlatformLayer::read),
            trajectories,
        }
    }

    pub fn read(&mut self, element: &Element, number: u32) -> Leg {
        let mut fields = Fields::new(self.context, element);
        let strip = fields.text("stripId").filter(|s| *s != NO_STRIP).map(str::to_owned);
        let max_duration = fields.number("maxDuration_s", NO_LIMIT);
        if max_duration < 0.0 && max_duration != NO_LIMIT {
            fields.warn("maxDuration_s", "is below 0: the leg has no limit of its own");
        }
        fields.ignore(&["id", "platform"]);
        fields.done(&["platformSettings", "scannerSettings", "scannerMount"]);
        let mut platform = self.read_platform(element);
        platform.mount = element.child("scannerMount").map(|mount| read_mount(self.context, &mount));
        let mut scanner = self.read_scanner(element).resolved();
        if max_duration > 0.0 {
            scanner.max_duration = Some(max_duration);
        }
        Leg { number, strip, platform, scanner, place: Some(element.place()) }
    }

    /// Gives `leg` the mount of the platform that `element` names instead of that of the survey, unless it has a mount.
    pub fn use_other_platform(context: &Context, leg: &mut Leg, element: &Element, platform: &Platform) {
        if element.value("platform").is_none() {
            return;
        }
        let other = context.asset("platform", element, "platform").and_then(|e| read_platform(context, &e));
        let Some(other) = other else { return };
        let mount = mount_of_other(context, &other, platform, element.value_place("platform"));
        leg.platform.mount = leg.platform.mount.or(mount);
    }

    fn read_platform(&mut self, leg: &Element) -> super::PlatformSettings {
        let default = PlatformLayer::unset();
        let layer = match leg.child("platformSettings") {
            None => {
                self.context.error(leg.place(), "a <leg> needs <platformSettings>");
                return default.resolved(None);
            }
            Some(element) => {
                let template = self.platform_templates.of(self.context, &element, &default);
                if template.as_ref().is_some_and(PlatformLayer::has_departure) {
                    let message =
                        "`yawAtDeparture_deg` of this template has no effect: a leg needs one of its own";
                    self.context.warn(element.value_place("template"), message);
                }
                PlatformLayer::read(self.context, &element, template.as_ref().unwrap_or(&default))
            }
        };
        let trajectory = self.trajectories.as_mut().and_then(|t| t.add(self.context, leg, &layer));
        layer.resolved(trajectory)
    }

    /// The scanner settings of a leg, with the scanner's default values, templates and resolutions applied.
    fn read_scanner(&mut self, leg: &Element) -> ScannerLayer {
        let own = match self.scanner {
            None => ScannerLayer::DEFAULT,
            Some(s) => ScannerLayer::of_scanner(s.pulse_freqs[0], s.devices[0].beam.divergence),
        };
        let Some(element) = leg.child("scannerSettings") else { return own };
        let template = self.scanner_templates.of(self.context, &element, &ScannerLayer::DEFAULT);
        let layer =
            ScannerLayer::read(self.context, &element, template.as_ref().unwrap_or(&ScannerLayer::DEFAULT));
        let mut merged = layer.merged(template.as_ref(), &own);
        layer.report_unheeded(self.context, &element, &merged);
        if let Some(scanner) = self.scanner {
            apply_resolution(self.context, &element, &mut merged, scanner);
        }
        merged
    }
}

/// Computes scan frequency and head speed from the angular resolutions (spec input-formats §2.6).
fn apply_resolution(context: &Context, element: &Element, layer: &mut ScannerLayer, scanner: &Scanner) {
    let (vertical, horizontal) = (layer.vertical_resolution, layer.horizontal_resolution);
    if !layer.active || vertical == 0.0 && horizontal == 0.0 {
        return;
    }
    let device = &scanner.devices[0];
    if !matches!(device.deflector, Deflector::Polygon { .. }) {
        let message = "angular resolutions have no effect: the scanner has no rotating optics";
        return context.warn(element.place(), message);
    }
    if vertical == 0.0 || horizontal == 0.0 {
        let (given, missing) = match vertical == 0.0 {
            true => ("horizontalResolution_deg", "verticalResolution_deg"),
            false => ("verticalResolution_deg", "horizontalResolution_deg"),
        };
        let message = format!("`{given}` is given without `{missing}`; the scanner would stand still");
        return context.error_help(element.value_place(given), message, format!("give `{missing}` as well"));
    }
    if vertical < 0.0 || horizontal < 0.0 {
        let name = if vertical < 0.0 { "verticalResolution_deg" } else { "horizontalResolution_deg" };
        return context.error(element.value_place(name), format!("`{name}` must be above 0"));
    }
    if device.scan_angle_max <= 0.0 {
        return context
            .error(element.place(), "angular resolutions need a scanner with `scanAngleMax_deg` above 0");
    }
    let given =
        [("scanFreq_hz", "verticalResolution_deg"), ("headRotatePerSec_deg", "horizontalResolution_deg")];
    for (replaced, by) in given {
        if element.value(replaced).is_some() && element.value(by).is_some() {
            context.warn(
                element.name_place(replaced),
                format!("`{replaced}` has no effect beside `{by}`, from which it follows"),
            );
        }
    }
    layer.scan_freq = f64::from(layer.pulse_freq) * vertical / (2.0 * device.scan_angle_max);
    layer.head_rate = horizontal * layer.scan_freq;
}
