//! The legs of a survey (spec input-formats §2.3).

use super::context::Context;
use super::fields::{Fields, read_mount};
use super::platform_xml::{mount_of_other, read_platform};
use super::settings::{NO_LIMIT, PlatformLayer, ScannerLayer, warn_of_missing_coordinates};
use super::sources::LegTemplates;
use super::templates::Templates;
use super::trajectories::Trajectories;
use super::xml::Element;
use super::{Leg, Platform, Scanner};

/// The state of the reader of legs.
pub(super) struct LegReader<'c> {
    context: &'c Context,
    scanner: Option<&'c Scanner>,
    scanner_templates: Templates<ScannerLayer>,
    platform_templates: Templates<PlatformLayer>,
    /// Only for interpolated platforms.
    pub trajectories: Option<Trajectories>,
}

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
        let strip = fields.text("stripId").filter(|s| *s != NO_STRIP);
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

    /// The templates that the settings of a leg name.
    pub fn templates(&mut self, element: &Element) -> LegTemplates {
        let leg = |platform: PlatformLayer, scanner: &ScannerLayer| Leg {
            number: 0,
            strip: None,
            platform: platform.resolved(None),
            scanner: scanner.resolved(),
            place: None,
        };
        let context = self.context;
        let id = |settings: &Element| {
            let template = context.asset(settings.name(), settings, "template")?;
            Some(template.value("id").unwrap_or_default().to_owned())
        };
        let (unset, default) = (PlatformLayer::unset(), ScannerLayer::DEFAULT);
        let scanner = element.child("scannerSettings").and_then(|settings| {
            let template = self.scanner_templates.of(context, &settings, &default)?;
            Some((id(&settings)?, leg(PlatformLayer::unset(), &template)))
        });
        let platform = element.child("platformSettings").and_then(|settings| {
            let template = self.platform_templates.of(context, &settings, &unset)?;
            Some((id(&settings)?, leg(template, &default)))
        });
        LegTemplates { scanner, platform }
    }

    /// Sets the mount of `leg` to that of the platform that `element` names, unless the leg has a mount.
    pub fn use_other_platform(context: &Context, leg: &mut Leg, element: &Element, platform: &Platform) {
        if element.value("platform").is_none() {
            return;
        }
        let other = context.asset("platform", element, "platform").and_then(|e| read_platform(context, &e));
        let Some(other) = other else { return };
        if leg.platform.mount.is_some() {
            let message = "`platform` has no effect beside the <scannerMount> of the leg";
            context.warn(element.value_place("platform"), message);
        }
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
                warn_of_missing_coordinates(self.context, &element);
                PlatformLayer::read(self.context, &element, template.as_ref().unwrap_or(&default))
            }
        };
        let trajectory = self.trajectories.as_mut().and_then(|t| t.add(self.context, leg, &layer.trajectory));
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
        layer.report_unused(self.context, &element, &merged);
        if let Some(scanner) = self.scanner {
            merged.report_zero_angle(self.context, scanner);
            merged.apply_resolution(&Fields::new(self.context, &element), scanner);
        }
        merged
    }
}
