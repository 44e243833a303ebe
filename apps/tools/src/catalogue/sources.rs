//! Sources of the figures of an instrument.

use serde::{Serialize, Serializer};
use std::collections::BTreeMap;
use vlscan_survey::{FigureSource, Scanner};

/// Remark on figures for which pipelines have another one.
const REPLACED: &str = "of HELIOS++'s catalogue, replaced in pipelines";
/// Figures that a run depends on, of which [`unverified_figures`] lists those without a source.
const FIGURES: [&str; 5] =
    ["accuracy_m", "beamDivergence_rad", "pulseLength_ns", "rangeMin_m", "wavelength_nm"];

/// The sources of an instrument's figures. As JSON: names of figures with their sources.
pub struct Sources<'s> {
    sources: &'s [FigureSource],
    /// Sources of the figures that pipelines use instead.
    stated: &'s [FigureSource],
}

impl Sources<'_> {
    /// The sources of a scanner's figures.
    pub fn of(scanner: &Scanner) -> Sources<'_> {
        let stated: &[FigureSource] = match scanner.devices.first() {
            Some(device) => &device.stated.sources,
            None => &[],
        };
        Sources { sources: &scanner.sources, stated }
    }

    /// True if a figure has a source.
    pub fn has(&self, figure: &str) -> bool {
        source_among(self.sources, figure).is_some_and(FigureSource::is_verified)
    }

    /// True if a figure has a source or a remark in place of one.
    pub fn names(&self, figure: &str) -> bool {
        source_among(self.sources, figure).is_some()
    }

    /// The sources of `figures`, then remarks on those without a source; empty for what is no figure.
    pub fn of_figures(&self, figures: &[&str]) -> String {
        // Each text once, with its figures, and false if it is a remark.
        let mut texts: Vec<(&str, Vec<&str>, bool)> = Vec::new();
        for &figure in figures {
            let (text, is_source) = match source_among(self.sources, figure) {
                Some(source) => (source.name.as_str(), source.is_verified()),
                None if source_among(self.stated, figure).is_some() => (REPLACED, false),
                None => (FigureSource::NOT_VERIFIED, false),
            };
            match texts.iter_mut().find(|known| known.0 == text) {
                Some((_, of_text, _)) => of_text.push(figure),
                None => texts.push((text, vec![figure], is_source)),
            }
        }
        texts.sort_by_key(|(.., is_source)| !is_source);
        let written = texts.iter().map(|(text, of_text, is_source)| {
            // A remark names its figures where others have a source.
            match *is_source || of_text.len() == figures.len() {
                true => (*text).to_owned(),
                false => format!("{} {text}", of_text.join(", ")),
            }
        });
        written.collect::<Vec<_>>().join("; ")
    }
}

/// The first of `sources` that states a figure.
fn source_among<'s>(sources: &'s [FigureSource], figure: &str) -> Option<&'s FigureSource> {
    sources.iter().find(|source| source.figures.iter().any(|own| own == figure))
}

/// The figures of an instrument of the built-in catalogue that have not been compared with a data sheet;
/// empty for other instruments.
pub fn unverified_figures(scanner: &Scanner) -> Vec<&'static str> {
    let Some(device) = scanner.devices.first().filter(|device| device.stated.is_built_in) else {
        return Vec::new();
    };
    let has_source = |figure: &str| {
        let mut sources = scanner.sources.iter().chain(&device.stated.sources);
        sources.any(|source| source.is_verified() && source.figures.iter().any(|own| own == figure))
    };
    FIGURES.into_iter().filter(|&figure| !has_source(figure)).collect()
}

impl Serialize for Sources<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let of_source = |source: &'_ FigureSource| {
            let name = source.name.clone();
            source.figures.clone().into_iter().map(move |figure| (figure, name.clone()))
        };
        let map: BTreeMap<String, String> = self.sources.iter().flat_map(of_source).collect();
        map.serialize(serializer)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use vlscan_survey::{Deflector, Device, catalogue};

    /// Entries of instruments in wide use: on robots and cars, below drones, on tripods and in aeroplanes.
    const WIDELY_USED: [&str; 20] = [
        "#vlp16",
        "#velodyne_hdl-32e",
        "#velodyne_hdl-64e",
        "#velodyne_alpha_prime",
        "#hesai_xt32",
        "#hesai_pandar128",
        "#ouster_os0-128",
        "#ouster_os1-128",
        "#livox_mid-40",
        "#livox_mid-70",
        "#livox_mid-360",
        "#livox-avia-non-repetitive",
        "#dji-zenmuse-l1-non-repetitive",
        "#dji-zenmuse-l2-non-repetitive",
        "#riegl_vux-1uav",
        "#riegl_vz400",
        "#riegl_vz400i",
        "#leica_rtc360",
        "#leica_blk360",
        "#leica_als50-ii",
    ];

    /// 71 of 92 figures have a source, 67 of them one that can be looked up.
    #[test]
    fn most_figures_of_widely_used_instruments_have_a_source() {
        let (known, _) = catalogue().unwrap();
        let (mut stated, mut sourced, mut traceable) = (0, 0, 0);
        let mut missing = Vec::new();
        for id in WIDELY_USED {
            let (_, scanner) = known.scanners.iter().find(|(name, _)| name.ends_with(id)).unwrap();
            let of_figure = |figure: &str| -> Vec<&FigureSource> {
                let sources = scanner.sources.iter().chain(&scanner.devices[0].stated.sources);
                sources.filter(|source| source.figures.iter().any(|own| own == figure)).collect()
            };
            for figure in FIGURES {
                let sources = of_figure(figure);
                // What an entry leaves to the default of the catalogue is not a figure of the instrument.
                if sources.iter().any(|source| source.name == FigureSource::DEFAULT_PULSE_LENGTH) {
                    continue;
                }
                stated += 1;
                let named: Vec<&&FigureSource> =
                    sources.iter().filter(|source| source.is_verified()).collect();
                sourced += usize::from(!named.is_empty());
                // A data sheet of unknown edition cannot be looked up.
                match named.iter().any(|source| !source.name.contains("not recorded")) {
                    true => traceable += 1,
                    false => missing.push(format!("{id} {figure}")),
                }
            }
        }
        let counts = format!("{traceable} and {sourced} of {stated}");
        assert!(100 * traceable >= 72 * stated, "{counts}; without a source: {missing:?}");
        assert!(100 * sourced >= 77 * stated, "{counts}; without a source: {missing:?}");
    }

    #[test]
    fn sources_name_figures_that_exist() {
        let (known, _) = catalogue().unwrap();
        let figures = [
            "accuracy_m",
            "beamDivergence_rad",
            "beamDivergenceY_rad",
            "beamOrigin",
            "channels",
            "facetTilts_deg",
            "field",
            "headRotatePerSecMax_deg",
            "maxNOR",
            "maxRange",
            "optics",
            "pulseFreqs_Hz",
            "pulseLength_ns",
            "rangeMin_m",
            "rangeMax_m",
            "rangeNoise",
            "rangeStep_m",
            "receiverFov_rad",
            "scanAngleMax_deg",
            "scanAngleEffectiveMax_deg",
            "scanAngleAlongMax_deg",
            "scanFreqMin_Hz",
            "scanFreqMax_Hz",
            "thresholdPhotons",
            "wavelength_nm",
        ];
        for (name, scanner) in &known.scanners {
            let mut seen = Vec::new();
            for figure in scanner.sources.iter().flat_map(|source| &source.figures) {
                assert!(figures.contains(&figure.as_str()), "{name}: {figure}");
                assert!(!seen.contains(figure), "{name}: {figure} has two sources");
                seen.push(figure.clone());
            }
        }
        // A source that is none does not count.
        let of = |name: &str| {
            let (_, scanner) = known.scanners.iter().find(|(found, _)| found.ends_with(name)).unwrap();
            unverified_figures(scanner)
        };
        assert_eq!(of("#riegl_vz400"), ["pulseLength_ns", "rangeMin_m"]);
        assert_eq!(of("#riegl_vz600i"), FIGURES);
        assert_eq!(of("#leica_als50-ii"), ["accuracy_m", "rangeMin_m"]);
        assert_eq!(of("#livox_mid-70"), ["pulseLength_ns"], "a default is not a source");
        assert!(unverified_figures(&Scanner::new("own", 1000, Device::new(Deflector::Conic))).is_empty());
        let (_, puck) = known.scanners.iter().find(|(name, _)| name.ends_with("#vlp16")).unwrap();
        let sources = Sources::of(puck);
        assert!(sources.of_figures(&["beamDivergence_rad"]).contains("User Manual"));
        assert_eq!(sources.of_figures(&["pulseLength_ns"]), REPLACED);
        let (_, hdl) = known.scanners.iter().find(|(name, _)| name.ends_with("#velodyne_hdl-64e")).unwrap();
        assert_eq!(Sources::of(hdl).of_figures(&["maxNOR"]), "not verified");
        let (_, hovermap) = known.scanners.iter().find(|(name, _)| name.ends_with("#hovermap")).unwrap();
        let partly = Sources::of(hovermap).of_figures(&["rangeMin_m", "rangeMax_m"]);
        assert!(partly.ends_with("; rangeMin_m not verified"), "{partly}");
        let (_, mid360) = known.scanners.iter().find(|(name, _)| name.ends_with("#livox_mid-360")).unwrap();
        let divergence = Sources::of(mid360).of_figures(&["beamDivergence_rad"]);
        assert!(divergence.starts_with("not verified: "), "{divergence}");
        assert_eq!(sources.of_figures(&[]), "");
        // A remark is shown, but is not a source.
        let (_, mid40) = known.scanners.iter().find(|(name, _)| name.ends_with("#livox_mid-40")).unwrap();
        let of_mid40 = Sources::of(mid40);
        assert!(of_mid40.names("optics") && !of_mid40.has("optics") && !of_mid40.names("maxNOR"));
        let length = of_mid40.of_figures(&["pulseLength_ns"]);
        assert_eq!(length, "not verified: default of the catalogue, 4 ns, in no data sheet");
        let (channels, both) = (sources.of_figures(&["channels"]), ["channels", "pulseFreqs_Hz"]);
        assert_eq!(sources.of_figures(&both), channels);
        let partly = sources.of_figures(&["rangeMin_m", "channels"]);
        assert_eq!(partly, format!("{channels}; rangeMin_m {REPLACED}"));
    }
}
