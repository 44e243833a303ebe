//! The texts of `scanners.xml`, `platforms.xml`, `scene.xml` and `survey.xml` of generated scenes.

use super::{Part, SceneKind, room};
use libm::{atan, tan};
use std::fmt::Write as _;
use vlscan_geom::{DVec3, degrees, radians};

/// The XML texts of a survey and the number of pulses that it emits.
pub(super) struct SurveyTexts {
    pub(super) scanners: String,
    pub(super) platforms: String,
    pub(super) survey: String,
    pub(super) pulses: u64,
}

/// Detection threshold of airborne scanners, W: about that of an avalanche photodiode. In the physics of the
/// reference, which compares it with nanowatts that fall with the fourth power of the range, surfaces of
/// ordinary reflectance are seen from flying heights with it, and not with the reference's default of 0.0001.
const DETECTION_THRESHOLD_W: f64 = 1e-9;
const XML: &str = "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n";
/// The root of a document whose files are next to it, regardless of the working directory.
pub(super) const DOCUMENT: &str = "<document paths=\"beside\">";

/// Text of `scene.xml` with its parts in order; their ids are 0, 1, ….
pub(super) fn scene_text(kind: SceneKind, parts: &[Part]) -> String {
    let mut text = format!("{XML}{DOCUMENT}\n  <scene id=\"{0}\" name=\"{0}\">\n", kind.name());
    for (id, part) in parts.iter().enumerate() {
        let file = format!("<param type=\"string\" key=\"filepath\" value=\"{}\"/>", part.file);
        // Without an id every instance becomes a separate part.
        let (id, filter) = match part.file.rsplit('.').next() {
            Some("csv") => (String::new(), format!("<filter type=\"instances\">{file}</filter>")),
            Some("vox") => (
                format!(" id=\"{id}\""),
                format!(
                    "<filter type=\"detailedvoxels\">\n        {file}\n        \
                     <param type=\"string\" key=\"intersectionMode\" value=\"fixed\"/>\n        \
                     <param type=\"string\" key=\"matfile\" value=\"forest.mtl\"/>\n        \
                     <param type=\"string\" key=\"matname\" value=\"beech_leaves\"/>\n      </filter>"
                ),
            ),
            _ => (format!(" id=\"{id}\""), format!("<filter type=\"objloader\">{file}</filter>")),
        };
        let _ = writeln!(text, "    <part{id}> <!-- {} -->\n      {filter}\n    </part>", part.name);
    }
    text.push_str("  </scene>\n</document>\n");
    text
}

/// The survey of a scene of `extent` metres whose mean ground height is `ground`, m. `pulses` overrides the
/// default pulse rate or resolution.
pub(super) fn survey_texts(kind: SceneKind, extent: f64, ground: f64, pulses: Option<u64>) -> SurveyTexts {
    match kind {
        SceneKind::Forest => Airborne::FOREST.texts(kind, extent, ground, pulses),
        SceneKind::Terrain => Airborne::TERRAIN.texts(kind, extent, ground, pulses),
        SceneKind::Room => room_texts(extent, pulses),
    }
}

#[derive(Clone, Copy, PartialEq)]
enum Mirror {
    Polygon,
    Oscillating,
}

/// Parameters of an airborne scan.
struct Airborne {
    mirror: Mirror,
    height: f64,
    speed: f64,
    /// Maximum half angle, degrees.
    half_angle: f64,
    pulse_rate: f64,
    scanner_id: &'static str,
    /// Attributes of the scanner that do not depend on the survey.
    scanner: &'static str,
}

impl Airborne {
    const FOREST: Airborne = Airborne {
        mirror: Mirror::Polygon,
        height: 300.0,
        speed: 60.0,
        half_angle: 20.0,
        pulse_rate: 1_000_000.0,
        scanner_id: "als_polygon",
        scanner: "name=\"Airborne polygon mirror scanner\" optics=\"rotating\" accuracy_m=\"0.02\" \
                  beamDivergence_rad=\"0.00025\" pulseLength_ns=\"4\" rangeMin_m=\"100\" \
                  wavelength_nm=\"1064\" scanAngleMax_deg=\"20\" scanAngleEffectiveMax_deg=\"20\" \
                  scanFreqMin_Hz=\"1\" scanFreqMax_Hz=\"1200\"",
    };
    const TERRAIN: Airborne = Airborne {
        mirror: Mirror::Oscillating,
        height: 400.0,
        speed: 60.0,
        half_angle: 20.0,
        pulse_rate: 150_000.0,
        scanner_id: "als_oscillating",
        scanner: "name=\"Airborne oscillating mirror scanner\" optics=\"oscillating\" accuracy_m=\"0.03\" \
                  beamDivergence_rad=\"0.00033\" pulseLength_ns=\"8\" rangeMin_m=\"150\" \
                  wavelength_nm=\"1064\" scanAngleMax_deg=\"25\" scanFreqMin_Hz=\"0\" scanFreqMax_Hz=\"400\" \
                  maxNOR=\"4\"",
    };

    fn texts(&self, kind: SceneKind, extent: f64, ground: f64, pulses: Option<u64>) -> SurveyTexts {
        let swath = |angle: f64| 2.0 * self.height * tan(radians(angle));
        // Neighbouring strips overlap by at least an eighth.
        let strips = (extent / (0.87 * swath(self.half_angle))).ceil().max(2.0);
        let spacing = extent / strips;
        let reach = 0.53 * extent + 0.5 * (strips - 1.0) * spacing;
        let angle = rounded(degrees(atan(reach / self.height)).min(self.half_angle), 2);
        let length = 1.1 * extent;
        let emitting = match self.mirror {
            Mirror::Polygon => angle / self.half_angle,
            Mirror::Oscillating => 1.0,
        };
        let rate_for = |n: u64| n as f64 * self.speed / (strips * length * emitting);
        let rate = (pulses.map_or(self.pulse_rate, rate_for) / 100.0).round().clamp(10.0, 1e7) * 100.0;
        // Equal spacing of lines and of pulses within a line.
        let full = if self.mirror == Mirror::Polygon { self.half_angle } else { angle };
        let lines = (self.speed * rate / swath(full)).sqrt();
        let scan_rate = match self.mirror {
            Mirror::Polygon => lines.clamp(1.0, 1200.0),
            Mirror::Oscillating => (0.5 * lines).clamp(1.0, (rate / 300.0).min(400.0)),
        };
        let emitted = (strips * length / self.speed * rate * emitting).round() as u64;
        let id = self.scanner_id;
        let scanners = format!(
            "{XML}{DOCUMENT}\n  <scanner id=\"{id}\" {} pulseFreqs_Hz=\"{rate}\" averagePower_w=\"4\" \
             opticalEfficiency=\"0.99\" receiverDiameter_m=\"0.15\" \
             atmosphericVisibility_km=\"23\" receivedEnergyMin_W=\"{DETECTION_THRESHOLD_W:e}\">\n    \
             <FWFSettings beamSampleQuality=\"3\" binSize_ns=\"0.25\"/>\n    <beamOrigin x=\"0\" y=\"0\" \
             z=\"0\"/>\n  </scanner>\n</document>\n",
            self.scanner
        );
        let mut survey = format!(
            "{XML}{DOCUMENT}\n  <!-- {strips} strips of {} m, {} m above the ground: about {emitted} pulses \
             -->\n  \
             <platformSettings id=\"cruise\" z=\"{}\" movePerSec_m=\"{}\"/>\n  \
             <scannerSettings id=\"strip\" active=\"true\" pulseFreq_hz=\"{rate}\" scanAngle_deg=\"{angle}\" \
             scanFreq_hz=\"{}\" trajectoryTimeInterval_s=\"0.01\"/>\n  \
             <survey name=\"{}\" scene=\"scene.xml#{}\" platform=\"platforms.xml#plane\" \
             scanner=\"scanners.xml#{id}\">\n",
            rounded(length, 1),
            self.height,
            rounded(ground + self.height, 1),
            self.speed,
            scan_rate.round(),
            kind.name(),
            kind.name(),
        );
        // From east to west, alternately northwards and southwards.
        for strip in 0..strips as u64 {
            let x = rounded(0.5 * (strips - 1.0) * spacing - strip as f64 * spacing, 2);
            let y = rounded(0.5 * length, 2) * if strip % 2 == 0 { 1.0 } else { -1.0 };
            let _ = write!(
                survey,
                "    <leg stripId=\"{0}\">\n      <platformSettings template=\"cruise\" x=\"{x}\" \
                 y=\"{1}\"/>\n      \
                 <scannerSettings template=\"strip\"/>\n    </leg>\n    \
                 <leg stripId=\"{0}\">\n      <platformSettings template=\"cruise\" x=\"{x}\" \
                 y=\"{y}\"/>\n      \
                 <scannerSettings template=\"strip\" active=\"false\"/>\n    </leg>\n",
                strip + 1,
                -y,
            );
        }
        survey.push_str("  </survey>\n</document>\n");
        SurveyTexts { scanners, platforms: PLANE.to_owned(), survey, pulses: emitted }
    }
}

const PLANE: &str = "<?xml version=\"1.0\" encoding=\"UTF-8\"?>
<document>
  <platform id=\"plane\" name=\"Aeroplane\" type=\"linearpath\">
    <scannerMount x=\"0\" y=\"0\" z=\"0.7\"> <!-- looks down, scans across the track -->
      <rot axis=\"x\" angle_deg=\"-90\"/>
      <rot axis=\"z\" angle_deg=\"90\"/>
    </scannerMount>
  </platform>
</document>
";

const TRIPOD: &str = "<?xml version=\"1.0\" encoding=\"UTF-8\"?>
<document>
  <platform id=\"tripod\" name=\"Tripod\" type=\"static\">
    <scannerMount x=\"0\" y=\"0\" z=\"1.25\"/>
  </platform>
</document>
";

/// Two positions of a panoramic scanner.
fn room_texts(extent: f64, pulses: Option<u64>) -> SurveyTexts {
    const FIELD: f64 = 105.0;
    const LINES_PER_SECOND: f64 = 120.0;
    let per_position = (pulses.unwrap_or(4_000_000) as f64 / 2.0).max(1000.0);
    let wanted = (FIELD * 360.0 / per_position).sqrt();
    let rate = (LINES_PER_SECOND * FIELD / wanted / 100.0).round().max(1.0) * 100.0;
    let resolution = rounded(LINES_PER_SECOND * FIELD / rate, 5);
    let turn = rounded(resolution * LINES_PER_SECOND, 4);
    let emitted = (2.0 * 360.0 / turn * rate).round() as u64;
    let scanners = format!(
        "{XML}{DOCUMENT}\n  <scanner id=\"tls_polygon\" name=\"Terrestrial polygon mirror scanner\" \
         optics=\"rotating\" accuracy_m=\"0.003\" beamDivergence_rad=\"0.00035\" pulseFreqs_Hz=\"{rate}\" \
         pulseLength_ns=\"3\" rangeMin_m=\"0.3\" wavelength_nm=\"1550\" scanAngleMax_deg=\"52.5\" \
         scanAngleEffectiveMax_deg=\"52.5\" scanFreqMin_Hz=\"4\" scanFreqMax_Hz=\"420\" \
         headRotatePerSecMax_deg=\"3600\" averagePower_w=\"4\" opticalEfficiency=\"0.99\" \
         receiverDiameter_m=\"0.15\" atmosphericVisibility_km=\"23\" maxNOR=\"5\">\n    \
         <FWFSettings beamSampleQuality=\"3\" binSize_ns=\"0.25\"/>\n    <beamOrigin x=\"0\" y=\"0\" \
         z=\"0.2\"/>\n    \
         <headRotateAxis x=\"0\" y=\"0\" z=\"1\"/>\n  </scanner>\n</document>\n"
    );
    let mut survey = format!(
        "{XML}{DOCUMENT}\n  <!-- two positions, {resolution} degrees in both directions: about {emitted} \
         pulses -->\n  \
         <scannerSettings id=\"panorama\" active=\"true\" pulseFreq_hz=\"{rate}\" \
         scanFreq_hz=\"{LINES_PER_SECOND}\" headRotatePerSec_deg=\"{turn}\" headRotateStart_deg=\"0\" \
         headRotateStop_deg=\"360\" scanAngle_deg=\"52.5\" trajectoryTimeInterval_s=\"1\"/>\n  \
         <survey name=\"room\" scene=\"scene.xml#room\" platform=\"platforms.xml#tripod\" \
         scanner=\"scanners.xml#tls_polygon\">\n"
    );
    let positions = [(-0.25 * extent + 0.2, -0.11 * extent), (0.25 * extent, 0.16 * extent)];
    for (x, y) in positions {
        let DVec3 { x, y, .. } = room::placed(x, y, 0.0);
        let _ = write!(
            survey,
            "    <leg>\n      <platformSettings x=\"{}\" y=\"{}\" z=\"0\"/>\n      \
             <scannerSettings template=\"panorama\"/>\n    </leg>\n",
            rounded(x, 3),
            rounded(y, 3)
        );
    }
    survey.push_str("  </survey>\n</document>\n");
    SurveyTexts { scanners, platforms: TRIPOD.to_owned(), survey, pulses: emitted }
}

fn rounded(value: f64, decimals: i32) -> f64 {
    let scale = [1.0, 10.0, 100.0, 1e3, 1e4, 1e5][decimals.clamp(0, 5) as usize];
    (value * scale).round() / scale
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn surveys_are_well_formed_and_name_what_is_there() {
        for kind in SceneKind::ALL {
            let parts = [Part { file: "a.obj".into(), name: "a" }, Part { file: "b.obj".into(), name: "b" }];
            let texts = survey_texts(kind, 200.0, 1.5, None);
            for text in [&scene_text(kind, &parts), &texts.scanners, &texts.platforms, &texts.survey] {
                let document = roxmltree::Document::parse(text).unwrap();
                assert_eq!(document.root_element().tag_name().name(), "document");
            }
            let document = roxmltree::Document::parse(&texts.survey).unwrap();
            let survey = document.descendants().find(|n| n.has_tag_name("survey")).unwrap();
            let scene = survey.attribute("scene").unwrap();
            assert_eq!(scene, format!("scene.xml#{}", kind.name()));
            for (attribute, tag, text) in
                [("scanner", "scanner", &texts.scanners), ("platform", "platform", &texts.platforms)]
            {
                let id = survey.attribute(attribute).unwrap().split('#').next_back().unwrap();
                let file = roxmltree::Document::parse(text).unwrap();
                assert!(file.descendants().any(|n| n.has_tag_name(tag) && n.attribute("id") == Some(id)));
            }
            let rates: Vec<_> = document.descendants().filter_map(|n| n.attribute("pulseFreq_hz")).collect();
            // Every reader accepts integer pulse rates of at most nine digits.
            assert!(rates.iter().all(|r| r.parse::<u32>().is_ok()), "{rates:?}");
        }
    }

    #[test]
    fn the_forest_of_a_million_triangles_is_flown_at_a_megahertz_and_twenty_degrees() {
        let texts = survey_texts(SceneKind::Forest, 200.0, 0.0, None);
        assert!(texts.survey.contains("pulseFreq_hz=\"1000000\" scanAngle_deg=\"20\""), "{}", texts.survey);
        assert!((7_000_000..8_000_000).contains(&texts.pulses), "{}", texts.pulses);
    }

    #[test]
    fn the_number_of_pulses_can_be_chosen() {
        for (kind, extent) in [(SceneKind::Forest, 40.0), (SceneKind::Terrain, 240.0), (SceneKind::Room, 8.0)]
        {
            let n = survey_texts(kind, extent, 0.0, Some(50_000)).pulses;
            assert!((48_000..52_000).contains(&n), "{kind:?}: {n}");
        }
    }
}
