//! Built-in scanners and platforms.

use super::assets::Found;
use super::context::{Context, ReadOptions};
use super::platform_xml::read_platform;
use super::scanner_xml::read_scanner;
use super::shipped::FILES;
use super::{Platform, Scanner};
use crate::diag::Diagnostics;
use crate::error::Result;

/// All built-in entries, each with the reference by which surveys and pipelines name it.
#[derive(Clone, Debug, Default)]
pub struct Catalogue {
    pub scanners: Vec<(String, Scanner)>,
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::survey::shipped::find;
    use crate::survey::{Deflector, PlatformKind};

    #[test]
    fn every_entry_loads_without_a_warning() {
        let (catalogue, warnings) = catalogue().unwrap_or_else(|e| panic!("{e}"));
        assert!(warnings.is_empty(), "{}", warnings.render(false));
        assert_eq!((catalogue.scanners.len(), catalogue.platforms.len()), (32, 12));
        let mut names: Vec<_> = catalogue.scanners.iter().map(|s| &s.0).collect();
        names.sort();
        names.dedup();
        assert_eq!(names.len(), 32);
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
            matches!(vz400.deflector, Deflector::Polygon { effective_max } if effective_max == 50f64.to_radians())
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
