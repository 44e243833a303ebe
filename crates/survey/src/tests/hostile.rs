//! Damaged input yields a result or an error, never a panic.

use super::*;
use proptest::prelude::*;

/// A survey that uses nearly every element.
fn everything() -> String {
    document(
        "<scannerSettings id='t' scanFreq_hz='50'/><platformSettings id='p' x='5'/>
         <scanner id='duo' optics='risley' pulseFreqs_Hz='10' rotorFreq1_Hz='5' angle1_deg='3'><headRotateAxis z='1'/>
         <channels><channel><incidentBeam y='1'/><FWFSettings binSize_ns='1'/></channel></channels></scanner>",
        "platform='plane' seed='2020-01-01 00:00:00'",
        "<FWFSettings winSize_ns='2'/><detectorSettings distanceMeasurementError='1+t^2'/><positionXNoise stdev='1'/>
         <leg stripId='A' maxDuration_s='1'><platformSettings template='p'/><scannerSettings template='t'/></leg>",
    )
}

fn answer(text: &str) {
    let folder = Folder::new(&[("survey.xml", text), ("a.obj", "")]);
    let result = folder.read(&ReadOptions::default());
    match result {
        Ok((_, warnings)) => drop(warnings.render(false)),
        Err(e) => drop(report(&e)),
    }
}

#[test]
fn deep_documents() {
    let deep = format!("<document>{}{}</document>", "<a>".repeat(50_000), "</a>".repeat(50_000));
    answer(&deep);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn damaged_surveys_are_answered(at in 0.0..1.0f64, cut in 0usize..12, put in "[-<>/='\"#&;a-z0-9. é]{0,6}") {
        let text = everything();
        let start = text.floor_char_boundary((at * text.len() as f64) as usize);
        let end = text.floor_char_boundary((start + cut).min(text.len())).max(start);
        answer(&format!("{}{put}{}", &text[..start], &text[end..]));
    }

    #[test]
    fn any_attribute_value_is_answered(which in 0usize..60, value in "[-+0-9.eEinfatrux;:# ]{0,12}") {
        let text = everything();
        let quotes: Vec<usize> = text.match_indices('\'').map(|(i, _)| i).collect();
        let pair = (which * 2) % (quotes.len() - 1) / 2 * 2;
        answer(&format!("{}{value}{}", &text[..=quotes[pair]], &text[quotes[pair + 1]..]));
    }
}
