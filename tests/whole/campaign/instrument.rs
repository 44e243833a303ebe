//! Random scanners: every deflector, channels, errors, detectors.

use super::draw::Draw;
use std::fmt::Write as _;

/// Properties of a scanner that legs need.
pub struct Instrument {
    pub xml: String,
    pub pulse_freqs: [u32; 2],
    pub optics: &'static str,
    /// True if its head turns.
    pub has_head: bool,
}

/// A `<scanner id="s">` for a platform that stands still, or not.
pub fn draw(draw: &mut Draw, is_static: bool) -> Instrument {
    let optics = draw.pick(&["rotating", "oscillating", "conic", "line", "risley"]);
    let first = draw.pick(&[1000, 3000, 5000]);
    let pulse_freqs = [first, first * 2];
    let has_head = is_static || draw.chance(0.2);
    let mut xml = format!(
        "<scanner id=\"s\" name=\"s\" optics=\"{optics}\" pulseFreqs_Hz=\"{},{}\" accuracy_m=\"{}\" beamDivergence_rad=\"{}\" \
         pulseLength_ns=\"{}\" rangeMin_m=\"{}\" rangeMax_m=\"{}\" wavelength_nm=\"{}\" maxNOR=\"{}\" \
         receivedEnergyMin_W=\"{}\" headRotatePerSecMax_deg=\"{}\" scanFreqMin_Hz=\"1\" scanFreqMax_Hz=\"400\" \
         atmosphericVisibility_km=\"{}\"",
        pulse_freqs[0],
        pulse_freqs[1],
        draw.pick(&[0.0, 0.005, 0.05]),
        draw.pick(&[0.0003, 0.001, 0.01]),
        draw.pick(&[2, 4, 6]),
        draw.number(0.0, 2.0),
        draw.pick(&["40", "1000", "inf"]),
        draw.pick(&[532, 905, 1064, 1550]),
        draw.pick(&[0, 1, 4]),
        draw.pick(&["0.0001", "0.00001", "0.0000000001"]),
        if has_head { 7200 } else { 0 },
        draw.pick(&[5, 23, 60]),
    );
    write_optics(draw, optics, &mut xml);
    write_beam(draw, &mut xml);
    xml.push('>');
    let _ = write!(
        xml,
        "<beamOrigin x=\"{}\" y=\"{}\" z=\"{}\">",
        draw.number(-0.2, 0.2),
        draw.number(-0.2, 0.2),
        draw.number(0.0, 0.5)
    );
    if optics == "rotating" && draw.chance(0.5) {
        let _ = write!(xml, "<rot axis=\"z\" angle_deg=\"{}\"/>", draw.number(-90.0, 90.0));
    }
    xml.push_str("</beamOrigin><headRotateAxis x=\"0\" y=\"0\" z=\"1\"/>");
    write_errors(draw, optics, &mut xml);
    if draw.chance(0.4) {
        let _ = write!(
            xml,
            "<FWFSettings binSize_ns=\"{}\" winSize_ns=\"{}\" beamSampleQuality=\"{}\" maxFullwaveRange_ns=\"{}\"/>",
            draw.pick(&[0.1, 0.25, 0.5]),
            draw.pick(&[0.5, 1.0, 2.0]),
            draw.between(1, 5),
            draw.pick(&[0, 0, 50]),
        );
    }
    if draw.chance(0.25) {
        xml.push_str("<channels>");
        for i in 0..draw.between(1, 4) {
            let _ = write!(
                xml,
                "<channel id=\"c{i}\" beamDivergence_rad=\"{}\" accuracy_m=\"{}\"><beamOrigin z=\"{}\"><rot axis=\"x\" \
                 angle_deg=\"{}\"/></beamOrigin></channel>",
                draw.pick(&[0.0005, 0.002]),
                draw.pick(&[0.0, 0.01]),
                draw.number(0.0, 0.2),
                draw.number(-15.0, 15.0),
            );
        }
        xml.push_str("</channels>");
    }
    xml.push_str("</scanner>");
    Instrument { xml, pulse_freqs, optics, has_head }
}

fn write_optics(draw: &mut Draw, optics: &str, xml: &mut String) {
    let angle = draw.pick(&[20, 45, 60]);
    let _ = write!(xml, " scanAngleMax_deg=\"{angle}\" scanAngleEffectiveMax_deg=\"{angle}\"");
    match optics {
        "line" => {
            let _ = write!(xml, " numFibers=\"{}\"", draw.between(1, 64));
        }
        "oscillating" => xml.push_str(" scanProduct=\"1000000\""),
        "risley" => {
            for i in 1..=draw.between(2, 3) {
                let _ = write!(
                    xml,
                    " rotorFreq{i}_Hz=\"{}\" angle{i}_deg=\"{}\" refrIndex{i}=\"{}\"",
                    draw.number(-120.0, 120.0),
                    draw.number(2.0, 20.0),
                    draw.number(1.4, 1.9)
                );
            }
            xml.push_str(" refrIndex_air=\"1\"");
        }
        _ => {}
    }
}

/// Properties that only the refined physics reads.
fn write_beam(draw: &mut Draw, xml: &mut String) {
    if draw.chance(0.2) {
        let _ = write!(xml, " beamProfile=\"{}\"", draw.pick(&["gaussian", "top_hat"]));
    }
    if draw.chance(0.2) {
        let _ = write!(xml, " beamDivergenceY_rad=\"{}\"", draw.pick(&[0.0005, 0.004]));
    }
    if draw.chance(0.2) {
        let _ = write!(xml, " exitAperture_m=\"{}\"", draw.number(0.0, 0.05));
    }
    if draw.chance(0.2) {
        let _ = write!(xml, " nep_W=\"{}\"", draw.pick(&["1e-9", "1e-7"]));
    }
    if draw.chance(0.2) {
        let _ = write!(xml, " detector=\"{}\"", draw.pick(&["peak", "centroid", "gaussian"]));
    }
    if draw.chance(0.1) {
        xml.push_str(" digitiserClock=\"true\"");
    }
}

fn write_errors(draw: &mut Draw, optics: &str, xml: &mut String) {
    if draw.chance(0.25) {
        xml.push_str("<rangeError expr=\"0.002 + 1e-3*cos(THETA)\"/>");
    }
    if optics == "rotating" && draw.chance(0.2) {
        xml.push_str("<deflectionError expr=\"0.0005*sin(2*THETA)\"/>");
    }
    if optics == "rotating" && draw.chance(0.2) {
        xml.push_str("<headError expr=\"0.0002*cos(THETA)\" zeroSinThreshold_deg=\"0.1\"/>");
    }
}
