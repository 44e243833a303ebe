//! References and templates of a survey in XML.

use super::Leg;
use super::assets::Found;
use super::context::{Context, ReadOptions};
use super::legs::LegReader;
use super::xml::{BUILT_IN, Element};
use std::path::Path;
use vlscan_base::error::Result;
use vlscan_base::files::reads;

/// Elements that a survey in XML refers to. References are `file.xml#id` with an absolute path, or a path of
/// the built-in catalogue.
#[derive(Clone, Debug, Default)]
#[non_exhaustive]
pub struct SurveySources {
    /// Reference of the scanner.
    pub scanner: Option<String>,
    /// Reference of the platform; with recorded poses that of the base platform, if there is one.
    pub platform: Option<String>,
    /// True if the survey has `<FWFSettings>`.
    pub has_waveform: bool,
    /// Templates of the legs, in their order.
    pub templates: Vec<LegTemplates>,
}

/// Templates of the settings of a leg, each with its id, as a leg with the settings of the template alone.
#[derive(Clone, Debug, Default)]
pub struct LegTemplates {
    /// Template of the scanner settings.
    pub scanner: Option<(String, Leg)>,
    /// Template of the platform settings.
    pub platform: Option<(String, Leg)>,
}

/// Reads what a survey in XML refers to: of a file, or of a `text` that stands for it. The survey itself is
/// not checked, see [`read_survey`](super::read_survey).
///
/// # Errors
/// [`Error::Input`](vlscan_base::error::Error::Input) for documents and references that cannot be read;
/// [`Error::Io`](vlscan_base::error::Error::Io).
pub fn survey_sources(path: &Path, text: Option<&str>, options: &ReadOptions) -> Result<SurveySources> {
    let context = Context::new(options);
    let root = match text {
        Some(text) => context.open_text(path, text),
        None if reads::is_file(path) => context.open(&Found::File(path.to_path_buf())),
        None => context.referred_document(&path.to_string_lossy(), Path::new(""), None),
    };
    let sources = root.map(|root| match root.child("survey") {
        Some(survey) => sources_of(&context, &survey),
        None => SurveySources::default(),
    });
    context.finish(sources).map(|(sources, _)| sources)
}

fn sources_of(context: &Context, survey: &Element) -> SurveySources {
    let reference = |kind: &str, attribute: &str| context.asset(kind, survey, attribute).map(|e| address(&e));
    let is_recorded = survey.value("platform") == Some("interpolated");
    let mut reader = LegReader::new(context, None, None);
    SurveySources {
        scanner: reference("scanner", "scanner"),
        platform: reference("platform", if is_recorded { "basePlatform" } else { "platform" }),
        has_waveform: survey.child("FWFSettings").is_some(),
        templates: survey.named("leg").map(|leg| reader.templates(&leg)).collect(),
    }
}

/// The reference of an element.
fn address(element: &Element) -> String {
    let path = element.path();
    let file = match path.strip_prefix(BUILT_IN) {
        Ok(built_in) => built_in.to_string_lossy().replace('\\', "/"),
        Err(_) => std::path::absolute(path).unwrap_or_else(|_| path.to_path_buf()).display().to_string(),
    };
    match element.value("id") {
        Some(id) => format!("{file}#{id}"),
        None => file,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use vlscan_geom::degrees;

    #[test]
    fn references_and_templates_of_a_survey_are_found() {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures/forest/survey.xml");
        let sources = survey_sources(&file, None, &ReadOptions::default()).unwrap();
        let ends = |reference: &Option<String>, end: &str| {
            let reference = reference.as_deref().unwrap().replace('\\', "/");
            assert!(reference.ends_with(end), "{reference}");
            let file = reference.split('#').next().unwrap();
            assert!(Path::new(file).is_absolute(), "{file}");
        };
        ends(&sources.scanner, "fixtures/forest/scanners.xml#als_polygon");
        ends(&sources.platform, "fixtures/forest/platforms.xml#plane");
        assert!(!sources.has_waveform);
        assert_eq!(sources.templates.len(), 4);
        let (id, strip) = sources.templates[1].scanner.as_ref().unwrap();
        assert_eq!((id.as_str(), strip.scanner.pulse_freq, strip.scanner.active), ("strip", 137_700, true));
        assert!((degrees(strip.scanner.scan_angle) - 5.94).abs() < 1e-12);
        let (id, cruise) = sources.templates[1].platform.as_ref().unwrap();
        assert_eq!((id.as_str(), cruise.platform.speed, cruise.platform.position.z), ("cruise", 60.0, 301.5));
    }

    #[test]
    fn built_in_entries_keep_their_names() {
        let survey = r#"scanner="data/scanners_tls.xml#riegl_vz400" platform="interpolated""#;
        let text = format!("<document><survey {survey}><FWFSettings/><leg/></survey></document>");
        let sources = survey_sources(Path::new("<text>"), Some(&text), &ReadOptions::default()).unwrap();
        assert_eq!(sources.scanner.as_deref(), Some("data/scanners_tls.xml#riegl_vz400"));
        assert_eq!((sources.platform, sources.has_waveform), (None, true));
        assert!(sources.templates[0].scanner.is_none() && sources.templates[0].platform.is_none());
        let missing =
            survey_sources(Path::new("<text>"), Some(&text.replace("vz400", "vz4")), &ReadOptions::default());
        assert!(missing.is_err());
    }
}
