//! Built-in scanners and platforms.

use super::assets::Found;
use super::context::{Context, ReadOptions};
use super::instrument::read_scanner;
use super::platform_xml::read_platform;
use super::shipped::FILES;
use super::{Platform, Scanner};
use vlscan_base::diag::Diagnostics;
use vlscan_base::error::Result;

/// All built-in entries, each with the reference by which surveys and pipelines name it.
#[derive(Clone, Debug, Default)]
pub struct Catalogue {
    /// Scanners.
    pub scanners: Vec<(String, Scanner)>,
    /// Platforms.
    pub platforms: Vec<(String, Platform)>,
}

/// Reads the built-in catalogue.
///
/// # Errors
/// None that a user could cause; the built-in files are tested.
pub fn catalogue() -> Result<(Catalogue, Diagnostics)> {
    let context = Context::new(&ReadOptions::default());
    let mut catalogue = Catalogue::default();
    for file in &FILES {
        let Some(root) = context.open(&Found::BuiltIn(file)) else { continue };
        let reference = |id: &str| format!("{}#{id}", file.path);
        for element in root.named("scanner") {
            catalogue.scanners.extend(read_scanner(&context, &element).map(|s| (reference(&s.id), s)));
        }
        for element in root.named("platform") {
            catalogue.platforms.extend(read_platform(&context, &element).map(|p| (reference(&p.id), p)));
        }
    }
    context.finish(Some(catalogue))
}

/// The files of the built-in catalogue: the path by which surveys refer to each, and its text.
pub fn catalogue_files() -> impl Iterator<Item = (&'static str, &'static str)> {
    FILES.iter().map(|file| (file.path, file.text))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shipped::find;
    use crate::{Deflector, FigureSource, PlatformKind};
    use vlscan_geom::Rotation;
    use vlscan_render::Render as _;

    #[test]
    fn every_entry_loads_without_a_warning() {
        let (catalogue, warnings) = catalogue().unwrap_or_else(|e| panic!("{e}"));
        assert!(warnings.is_empty(), "{}", warnings.render(false));
        assert_eq!((catalogue.scanners.len(), catalogue.platforms.len()), (60, 12));
        let mut names: Vec<_> = catalogue.scanners.iter().map(|s| &s.0).collect();
        names.sort();
        names.dedup();
        assert_eq!(names.len(), 60);
    }

    #[test]
    fn figures_of_some_entries() {
        let (catalogue, _) = catalogue().unwrap();
        let scanner = |name: &str| &catalogue.scanners.iter().find(|s| s.0.ends_with(name)).unwrap().1;
        let channels = |name: &str| scanner(name).devices.len();
        assert_eq!(
            (channels("#vlp16"), channels("#velodyne_hdl-64e"), channels("#riegl_vz400")),
            (16, 64, 1)
        );
        assert_eq!((channels("als.xml#livox-mid-100"), channels("#dji-zenmuse-l2-repetitive")), (3, 6));
        let vz400 = &scanner("#riegl_vz400").devices[0];
        assert!(
            matches!(vz400.deflector, Deflector::Polygon { effective_max, .. } if effective_max == 50f64.to_radians())
        );
        assert_eq!((vz400.scan_freq, vz400.beam_origin.offset.z), ((3.0, 120.0), 0.2));
        let Deflector::Risley { prisms, incident, .. } =
            &scanner("#livox-avia-non-repetitive").devices[5].deflector
        else {
            panic!("the Avia has prisms");
        };
        assert_eq!((prisms.len(), prisms[2].rotor_freq), (3, 213.1611));
        assert!((incident.x - 0.05300785).abs() < 1e-7);
        assert_eq!(scanner("#velodyne_hdl-64e").devices[0].beam.divergence, 0.0034);
        let copter = catalogue.platforms.iter().find(|p| p.0.ends_with("#quadcopter")).unwrap();
        assert!(matches!(&copter.1.kind, PlatformKind::Multicopter(m) if m.drag == 0.01));
    }

    /// Published figures: points per second of all channels, channels, lowest and highest elevation of the
    /// channels in degrees (or the half angles of a single one), wavelength, nm. Sources: the comments of the
    /// catalogue's files.
    #[test]
    fn entries_are_within_their_data_sheets() {
        let (catalogue, _) = catalogue().unwrap();
        for (name, points_per_s, channels, view, wavelength) in [
            ("#velodyne_hdl-32e", 695e3, 32, (-30.67, 10.67), 905.0),
            ("#hesai_pandar128", 2.304e6, 128, (-25.016, 14.436), 905.0),
            ("#hesai_xt32", 640e3, 32, (-16.0, 15.0), 905.0),
            ("#hesai_xt32m2x", 640e3, 32, (-20.8, 19.5), 905.0),
            ("#hesai_xt16", 320e3, 16, (-15.0, 15.0), 905.0),
            ("#ouster_os0-128", 2_621_440.0, 128, (-46.0, 46.0), 865.0),
            ("#ouster_os1-128", 2_621_440.0, 128, (-21.48, 21.48), 865.0),
            ("#ouster_os2-128", 2_621_440.0, 128, (-10.93, 10.93), 865.0),
            ("#leica_rtc360", 2e6, 1, (-150.0, 150.0), 1550.0),
            ("#leica_blk360", 360e3, 1, (-150.0, 150.0), 830.0),
            ("#leica_blk360-g2", 680e3, 1, (-135.0, 135.0), 830.0),
            ("#riegl_vz400i", 1.2e6, 1, (-50.0, 50.0), 1550.0),
            ("#riegl_minivux-3uav", 300e3, 1, (-180.0, 180.0), 905.0),
            ("#riegl_vq-1560ii", 4e6, 2, (-29.0, 29.0), 1064.0),
            ("#riegl_vq-840-g", 200e3, 1, (-20.0, 20.0), 532.0),
            ("#riegl_vux-120", 1.8e6, 1, (-50.0, 50.0), 1550.0),
            ("#velodyne_alpha_prime", 2.4e6, 128, (-25.0, 15.0), 903.0),
            ("#velodyne_vlp-32c", 578_704.0, 32, (-25.0, 15.0), 903.0),
            ("#livox_hap", 452e3, 1, (-60.0, 60.0), 905.0),
            ("#livox_mid-360", 200e3, 1, (-29.5, 29.5), 905.0),
            ("#hovermap", 300e3, 16, (-180.0, 180.0), 903.0),
        ] {
            let scanner = &catalogue.scanners.iter().find(|s| s.0.ends_with(name)).unwrap().1;
            let rate = scanner.pulse_freqs.iter().copied().max().unwrap();
            let found = f64::from(rate) * scanner.devices.len() as f64;
            assert!((found / points_per_s - 1.0).abs() < 0.002, "{name}: {found} points/s");
            assert_eq!(scanner.devices.len(), channels, "{name}");
            let device = &scanner.devices[0];
            let angles: Vec<f64> = match device.deflector {
                Deflector::Polygon { ref facet_tilts, .. }
                    if device.head.max_rate > 0.0 && channels > 1 && facet_tilts.is_empty() =>
                {
                    let elevation = |d: &crate::Device| {
                        let beam = d.beam_origin.rotation.forward();
                        libm::asin(beam.z).to_degrees()
                    };
                    scanner.devices.iter().map(elevation).collect()
                }
                Deflector::Polygon { effective_max, .. } => {
                    [-1.0, 1.0].map(|s| s * effective_max.to_degrees()).to_vec()
                }
                _ => [-1.0, 1.0].map(|s| s * device.scan_angle_max.to_degrees()).to_vec(),
            };
            let (low, high) = angles.iter().fold((f64::MAX, f64::MIN), |(l, h), &a| (l.min(a), h.max(a)));
            assert!((low - view.0).abs() < 1e-9 && (high - view.1).abs() < 1e-9, "{name}: {low} to {high}");
            assert_eq!(device.beam.wavelength, wavelength, "{name}");
        }
        let xt32 = &catalogue.scanners.iter().find(|s| s.0.ends_with("#hesai_xt32")).unwrap().1;
        let z: Vec<f64> =
            xt32.devices.iter().map(|d| libm::asin(d.beam_origin.rotation.forward().z)).collect();
        assert!(z.windows(2).all(|pair| ((pair[0] - pair[1]).to_degrees() - 1.0).abs() < 1e-9));
    }

    /// Last channel's offset, µs, and offset of a channel in between. Sources: the comments of the
    /// catalogue's files.
    #[test]
    fn channels_fire_as_their_manuals_say() {
        let (catalogue, _) = catalogue().unwrap();
        for (name, between, last, cycle_us) in [
            ("#vlp16", (5, 11.52), 34.56, 55.296),
            ("#hovermap", (5, 11.52), 34.56, 55.296),
            ("#velodyne_hdl-32e", (2, 2.304), 35.712, 46.08),
            ("#hesai_xt32", (10, 15.12), 46.872, 50.0),
            ("#velodyne_alpha_prime", (64, 23.985), 42.64, 53.3),
            ("#velodyne_vlp-32c", (24, 27.648), 34.56, 55.296),
            ("#ouster_os1-128", (1, 0.0), 0.0, 48.828125),
        ] {
            let scanner = &catalogue.scanners.iter().find(|s| s.0.ends_with(name)).unwrap().1;
            let offsets: Vec<f64> = scanner.devices.iter().map(|d| d.firing_offset * 1e6).collect();
            assert!(offsets.is_sorted() && offsets[0] == 0.0, "{name}: {offsets:?}");
            assert!((offsets[between.0] - between.1).abs() < 1e-9, "{name}: {}", offsets[between.0]);
            assert!((offsets.last().unwrap() - last).abs() < 1e-9, "{name}: {:?}", offsets.last());
            let period_us = 1e6 / f64::from(scanner.pulse_freqs[0]);
            assert!(last < period_us && (period_us / cycle_us - 1.0).abs() < 0.04, "{name}");
        }
    }

    #[test]
    fn entries_state_a_pulse_length_or_have_the_default() {
        let (catalogue, _) = catalogue().unwrap();
        for (reference, scanner) in &catalogue.scanners {
            let (path, id) = reference.split_once('#').unwrap();
            let text = catalogue_files().find(|file| file.0 == path).unwrap().1;
            let entry = &text[text.find(&format!("<scanner id=\"{id}\"")).unwrap()..];
            let is_stated = entry[..entry.find('>').unwrap()].contains("pulseLength_ns=");
            let of_default = |source: &&FigureSource| source.name == FigureSource::DEFAULT_PULSE_LENGTH;
            let defaults: Vec<&FigureSource> = scanner.sources.iter().filter(of_default).collect();
            assert_eq!(defaults.len(), usize::from(!is_stated), "{reference}");
            if let [default] = defaults[..] {
                assert_eq!(default.figures, ["pulseLength_ns"], "{reference}");
                let beam = &scanner.devices[0].beam;
                assert_eq!((beam.pulse_length, beam.stated_width), (4.0, Some(4.0)), "{reference}");
            }
        }
    }

    #[test]
    fn lines_of_the_hap_fill_its_field() {
        let (catalogue, _) = catalogue().unwrap();
        let hap = &catalogue.scanners.iter().find(|s| s.0.ends_with("#livox_hap")).unwrap().1.devices[0];
        let Deflector::Polygon { facet_tilts, .. } = &hap.deflector else { panic!("the HAP has lines") };
        let elevation = |tilt: &f64| {
            // A facet turns the beam towards +x of the emitter.
            let beam = hap.beam_origin.rotation.apply(Rotation::about_z(-tilt).forward());
            libm::asin(beam.z).to_degrees()
        };
        let elevations: Vec<f64> = facet_tilts.iter().map(elevation).collect();
        let (low, high) = elevations.iter().fold((f64::MAX, f64::MIN), |(l, h), &e| (l.min(e), h.max(e)));
        assert_eq!(elevations.len(), 64);
        assert!((low + 12.5).abs() < 1e-9 && (high - 12.5).abs() < 1e-9, "{low} to {high}");
    }

    #[test]
    fn references_by_path_or_file_name() {
        for name in ["data/platforms.xml", "./data/platforms.xml", "platforms.xml"] {
            assert_eq!(find(name).map(|f| f.path), Some("data/platforms.xml"), "{name}");
        }
        for name in ["", "data", "other/platforms.xml", "xplatforms.xml", ".."] {
            assert!(find(name).is_none(), "{name}");
        }
    }
}
