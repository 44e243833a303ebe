//! Instruments for tests.

use super::SwathModel;
use vlscan_survey::{ReadOptions, catalogue, find_scanner};

/// The first instrument of the catalogue whose reference ends with `id`.
pub fn instrument(id: &str) -> SwathModel {
    let (known, _) = catalogue().unwrap();
    let is_meant = |reference: &str| {
        reference.ends_with(id) && reference[..reference.len() - id.len()].ends_with(['#', '/'])
    };
    let (reference, scanner) = known.scanners.iter().find(|(reference, _)| is_meant(reference)).unwrap();
    SwathModel::new(reference.clone(), scanner, None)
}

/// A scanner of one beam with a mirror of 20° to either side on a head of ten turns a second, with these
/// attributes besides.
pub fn spinning(attributes: &str) -> SwathModel {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("s.xml");
    let text = format!(
        "<document><scanner id='s' name='S' optics='rotating' pulseFreqs_Hz='100000' scanAngleMax_deg='20' \
         scanAngleEffectiveMax_deg='20' headRotatePerSecMax_deg='3600' {attributes}/></document>"
    );
    std::fs::write(&path, text).unwrap();
    let reference = format!("{}#s", path.display());
    let (scanner, _) = find_scanner(&reference, &ReadOptions::default()).unwrap();
    SwathModel::new(reference, &scanner, None)
}
