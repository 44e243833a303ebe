//! Sources of the figures of an instrument.

use serde::{Serialize, Serializer};
use std::collections::BTreeMap;
use vlscan_survey::{FigureSource, Scanner};

/// Remark on figures without a source.
const UNVERIFIED: &str = "not compared with a data sheet";
/// Remark on figures for which pipelines have another one.
const REPLACED: &str = "of HELIOS++'s catalogue, replaced in pipelines";
/// Beginning of the name of the source of a figure that an entry leaves to the default of the catalogue.
const DEFAULT: &str = "default";
/// Beginnings of the names of sources that are none.
const NO_SOURCES: [&str; 3] = ["assumption", DEFAULT, "not verified"];
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
        self.source_of(figure).is_some()
    }

    fn source_of(&self, figure: &str) -> Option<&str> {
        Some(&source_among(self.sources, figure)?.name)
    }

    /// The sources of `figures`, and which of them have none; empty for what is no figure.
    pub fn of_figures(&self, figures: &[&str]) -> String {
        let (known, others): (Vec<&str>, Vec<&str>) =
            figures.iter().copied().partition(|figure| self.has(figure));
        let (replaced, unknown): (Vec<&str>, Vec<&str>) =
            others.into_iter().partition(|figure| source_among(self.stated, figure).is_some());
        let mut told: Vec<String> = Vec::new();
        for name in known.iter().filter_map(|figure| self.source_of(figure)) {
            if !told.iter().any(|other| other == name) {
                told.push(name.to_owned());
            }
        }
        for (found, remark) in [(replaced, REPLACED), (unknown, UNVERIFIED)] {
            match found.len() {
                0 => {}
                count if count == figures.len() => told.push(remark.to_owned()),
                _ => told.push(format!("{} {remark}", found.join(", "))),
            }
        }
        told.join("; ")
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
    let is_source = |name: &str| NO_SOURCES.iter().all(|none| !name.starts_with(none));
    let has_source = |figure: &str| {
        let mut sources = scanner.sources.iter().chain(&device.stated.sources);
        sources.any(|source| is_source(&source.name) && source.figures.iter().any(|own| own == figure))
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

    #[test]
    fn most_figures_of_widely_used_instruments_have_a_source() {
        let (known, _) = catalogue().unwrap();
        let (mut stated, mut sourced) = (0, 0);
        let mut missing = Vec::new();
        for id in WIDELY_USED {
            let (_, scanner) = known.scanners.iter().find(|(name, _)| name.ends_with(id)).unwrap();
            let (sources, unverified) = (Sources::of(scanner), unverified_figures(scanner));
            // What an entry leaves to the default of the catalogue is not a figure of the instrument.
            let is_default = |figure: &str| sources.source_of(figure).is_some_and(|s| s.starts_with(DEFAULT));
            for figure in FIGURES.into_iter().filter(|figure| !is_default(figure)) {
                stated += 1;
                match unverified.contains(&figure) {
                    true => missing.push(format!("{id} {figure}")),
                    false => sourced += 1,
                }
            }
        }
        assert!(100 * sourced >= 64 * stated, "{sourced} of {stated}; without a source: {missing:?}");
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
        assert_eq!(of("#riegl_vz400"), ["accuracy_m", "pulseLength_ns", "rangeMin_m", "wavelength_nm"]);
        assert_eq!(of("#riegl_vz600i"), FIGURES);
        assert_eq!(of("#leica_als50-ii"), ["accuracy_m", "rangeMin_m"]);
        assert_eq!(of("#livox_mid-70"), ["pulseLength_ns"], "a default is not a source");
        assert!(unverified_figures(&Scanner::new("own", 1000, Device::new(Deflector::Conic))).is_empty());
        let (_, puck) = known.scanners.iter().find(|(name, _)| name.ends_with("#vlp16")).unwrap();
        let sources = Sources::of(puck);
        assert!(sources.of_figures(&["beamDivergence_rad"]).contains("User Manual"));
        assert_eq!(sources.of_figures(&["pulseLength_ns"]), REPLACED);
        let (_, hdl) = known.scanners.iter().find(|(name, _)| name.ends_with("#velodyne_hdl-64e")).unwrap();
        assert_eq!(Sources::of(hdl).of_figures(&["maxNOR"]), UNVERIFIED);
        let partly = Sources::of(hdl).of_figures(&["rangeMin_m", "rangeMax_m"]);
        assert!(partly.ends_with(&format!("; rangeMin_m {UNVERIFIED}")), "{partly}");
        assert_eq!(sources.of_figures(&[]), "");
        let (channels, both) = (sources.of_figures(&["channels"]), ["channels", "pulseFreqs_Hz"]);
        assert_eq!(sources.of_figures(&both), channels);
        let partly = sources.of_figures(&["rangeMin_m", "channels"]);
        assert_eq!(partly, format!("{channels}; rangeMin_m {REPLACED}"));
    }
}
