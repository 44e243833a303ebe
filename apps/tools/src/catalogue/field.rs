//! The field of view of an instrument, as data sheets state it.

use super::sources::Sources;
use std::f64::consts::PI;
use vlscan_base::corrections::Corrections;
use vlscan_base::error::{Error, Result};
use vlscan_geom::{DVec3, degrees};
use vlscan_lidar::scanner::{DevicePlan, DeviceState};
use vlscan_survey::{Deflector, Device, Scanner, ScannerSettings};

/// Beams of a device that are sampled.
const SAMPLES: u32 = 2000;
/// Time over which they are spread, s.
const SAMPLED_S: f64 = 1.0;
/// Half angle of a scan above which elevations do not describe its field, rad.
const MAX_ELEVATION: f64 = 1.5;

/// Full angles of the field of view, degrees, each at most 360: one of scanners that draw lines in a plane or
/// circular cones; all around, and up and down, of those with a head that turns; of others the two extents at
/// right angles to each other.
///
/// # Errors
/// Formulas of mechanical errors without a value.
pub fn field_of_view(scanner: &Scanner) -> Result<Vec<f64>> {
    let first = &scanner.devices[0];
    let half = half_angle(first);
    if first.head.max_rate > 0.0 {
        return Ok(vec![360.0, tenths(elevations(scanner, half))]);
    }
    let across = tenths(2.0 * degrees(half));
    Ok(match &first.deflector {
        Deflector::Risley { .. } | Deflector::Pattern(_) => sampled(scanner)?.map(tenths).to_vec(),
        Deflector::EllipticConic { along_max } => vec![across, tenths(2.0 * degrees(*along_max))],
        Deflector::Polygon { facet_tilts, .. } if tilt_extent(facet_tilts) > 0.0 => {
            vec![across, tenths(degrees(tilt_extent(facet_tilts)))]
        }
        _ => vec![across],
    })
}

/// The field of view in words.
pub fn field_in_words(angles: &[f64], has_head: bool) -> String {
    match angles {
        [around, up] if has_head => format!("{around}° all around, {up}° up and down"),
        _ => angles.iter().map(|angle| format!("{angle}°")).collect::<Vec<_>>().join(" × "),
    }
}

/// The figures of the catalogue that state the field of view.
pub fn field_figures(scanner: &Scanner, sources: &Sources) -> Vec<&'static str> {
    let first = &scanner.devices[0];
    if sources.has("field") {
        return vec!["field"];
    }
    if first.head.max_rate > 0.0 && !has_mirror(scanner) {
        return vec!["channels"];
    }
    match first.deflector {
        Deflector::Polygon { effective_max, ref facet_tilts } => {
            // Where both state it, the one with a source.
            let is_effective = effective_max < first.scan_angle_max
                || effective_max == first.scan_angle_max && sources.has("scanAngleEffectiveMax_deg");
            let mut figures =
                vec![if is_effective { "scanAngleEffectiveMax_deg" } else { "scanAngleMax_deg" }];
            if tilt_extent(facet_tilts) > 0.0 {
                figures.push("facetTilts_deg");
            }
            figures
        }
        Deflector::EllipticConic { .. } => vec!["scanAngleMax_deg", "scanAngleAlongMax_deg"],
        Deflector::Risley { .. } | Deflector::Pattern(_) => vec!["field"],
        _ => vec!["scanAngleMax_deg"],
    }
}

/// Half angle of the lines or the cone of a device, rad; a mirror that turns round and round sees a full
/// circle.
fn half_angle(device: &Device) -> f64 {
    let half = match &device.deflector {
        Deflector::Polygon { effective_max, .. } => effective_max.min(device.scan_angle_max),
        _ => device.scan_angle_max,
    };
    half.min(PI)
}

/// Difference between the largest and the smallest tilt of the facets of a mirror, rad; 0 or less if all draw
/// the same line.
fn tilt_extent(facet_tilts: &[f64]) -> f64 {
    let ends = (f64::INFINITY, f64::NEG_INFINITY);
    let (low, high) = facet_tilts.iter().fold(ends, |(low, high), tilt| (low.min(*tilt), high.max(*tilt)));
    high - low
}

/// True if a mirror moves the beams. Channels that only the head turns have no mirror, though they state the
/// angle of one.
fn has_mirror(scanner: &Scanner) -> bool {
    scanner.devices[0].scan_freq.1 > 0.0 || !scanner.multi_channel
}

/// Full angle up and down of the beams of a head that turns about the upright axis, degrees.
fn elevations(scanner: &Scanner, half: f64) -> f64 {
    if half > MAX_ELEVATION {
        return 2.0 * degrees(half);
    }
    let swing = if has_mirror(scanner) { half } else { 0.0 };
    let upwards = |device: &Device| libm::asin(device.beam_origin.rotation.forward().z.clamp(-1.0, 1.0));
    let all = scanner.devices.iter().map(upwards);
    let (low, high) =
        all.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), angle| (l.min(angle), h.max(angle)));
    degrees(high - low + 2.0 * swing)
}

fn tenths(angle: f64) -> f64 {
    (angle * 10.0).round() / 10.0
}

/// Full angles of the beams of all devices about the axis of the middle one: across, and up and down,
/// degrees.
fn sampled(scanner: &Scanner) -> Result<[f64; 2]> {
    let middle = scanner.devices[scanner.devices.len() / 2].beam_origin.rotation.inverse();
    let pulse_freq = scanner.pulse_freqs.iter().max().copied().unwrap_or(1).max(1);
    let stride = (SAMPLED_S * f64::from(pulse_freq) / f64::from(SAMPLES)).max(1.0) as u32;
    let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
    for device in &scanner.devices {
        let settings = ScannerSettings {
            active: true,
            pulse_freq,
            scan_angle: device.scan_angle_max,
            ..scanner.own_settings()
        };
        let plan = DevicePlan::new(device, Corrections::MOTION);
        let mut state = DeviceState::at_rest(&plan);
        state.start_leg(&plan, &settings);
        for i in 0..SAMPLES {
            // Strides of changing length meet all phases of a mirror.
            let skipped = stride + i % 7 - 1;
            if plan.errors.any() {
                (0..skipped).for_each(|_| state.step_deflector(&plan));
            } else {
                state.advance(&plan, true, skipped);
            }
            state.step_deflector(&plan);
            if !state.has_deflection() {
                return Err(state.formula_error(&plan));
            }
            if !state.deflector.is_firing() {
                continue;
            }
            let turned = middle.after(device.beam_origin.rotation).after(state.deflector.rotation(&plan));
            let DVec3 { x, y, z } = turned.forward();
            for (axis, angle) in
                [libm::atan2(x, y), libm::asin(z.clamp(-1.0, 1.0))].map(degrees).into_iter().enumerate()
            {
                (low[axis], high[axis]) = (low[axis].min(angle), high[axis].max(angle));
            }
        }
    }
    match low[0] <= high[0] {
        true => Ok([high[0] - low[0], high[1] - low[1]]),
        false => Err(Error::input(format!("{} emits no pulse", scanner.name))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use vlscan_survey::catalogue;

    /// The fields of all instruments of the catalogue, as their data sheets state them where those are known.
    const FIELDS: [(&str, &[f64]); 60] = [
        ("als.xml#leica_als50", &[75.0]),
        ("als.xml#leica_als50-ii", &[75.0]),
        ("als.xml#optech_2033", &[40.0]),
        ("als.xml#optech_3100", &[50.0]),
        ("als.xml#optech_galaxy", &[60.0]),
        ("als.xml#riegl_lms-q560", &[45.0]),
        ("als.xml#riegl_lms-q780", &[60.0]),
        ("als.xml#riegl_vq_780i", &[60.0]),
        ("als.xml#riegl_vux-1uav", &[330.0]),
        ("als.xml#riegl_vux-1uav22", &[360.0]),
        ("als.xml#riegl_vux-1ha22", &[360.0]),
        ("als.xml#riegl_vq-880g", &[40.0]),
        ("als.xml#riegl_vq-880g-infrared", &[40.0]),
        ("als.xml#riegl_vq-1560i", &[60.0]),
        ("als.xml#riegl_minivux-3uav", &[360.0]),
        ("als.xml#riegl_vq-1560ii", &[58.0]),
        ("als.xml#riegl_vq-840-g", &[40.0, 28.0]),
        ("als.xml#riegl_vq-840-gl", &[40.0, 28.0]),
        ("als.xml#livox_mid-70", &[70.4, 70.4]),
        ("als.xml#livox-mid-100", &[98.4, 38.4]),
        ("als.xml#livox-mid-100a", &[38.4, 38.4]),
        ("als.xml#livox-mid-100b", &[38.4, 38.4]),
        ("als.xml#livox-mid-100c", &[38.4, 38.4]),
        ("als.xml#dji-zenmuse-l1-non-repetitive", &[77.2, 70.4]),
        ("als.xml#dji-zenmuse-l2-repetitive", &[5.7, 70.0]),
        ("als.xml#dji-zenmuse-l2-non-repetitive", &[74.5, 70.0]),
        ("als.xml#riegl_vux-120", &[100.0, 20.0]),
        ("tls.xml#riegl_vz400", &[360.0, 100.0]),
        ("tls.xml#riegl_vz400i", &[360.0, 100.0]),
        ("tls.xml#riegl_vz1000", &[360.0, 100.0]),
        ("tls.xml#riegl_vz2000i", &[360.0, 100.0]),
        ("tls.xml#riegl_vz600i", &[360.0, 105.0]),
        ("tls.xml#riegl_vq-450", &[360.0]),
        ("tls.xml#vlp16", &[360.0, 30.0]),
        ("tls.xml#velodyne_hdl-64e", &[360.0, 26.8]),
        ("tls.xml#tractorscanner", &[60.0]),
        ("tls.xml#panoscanner", &[360.0, 300.0]),
        ("tls.xml#velodyne_hdl-32e", &[360.0, 41.3]),
        ("tls.xml#hesai_xt32", &[360.0, 31.0]),
        ("tls.xml#hesai_xt32m2x", &[360.0, 40.3]),
        ("tls.xml#hesai_xt16", &[360.0, 30.0]),
        ("tls.xml#hesai_pandar128", &[360.0, 39.5]),
        ("tls.xml#ouster_os0-128", &[360.0, 92.0]),
        ("tls.xml#ouster_os1-128", &[360.0, 43.0]),
        ("tls.xml#ouster_os2-128", &[360.0, 21.9]),
        ("tls.xml#ouster_os0-128-rev7", &[360.0, 92.0]),
        ("tls.xml#ouster_os1-128-rev7", &[360.0, 43.0]),
        ("tls.xml#ouster_os2-128-rev7", &[360.0, 21.9]),
        ("tls.xml#leica_rtc360", &[360.0, 300.0]),
        ("tls.xml#leica_blk360", &[360.0, 300.0]),
        ("tls.xml#leica_blk360-g2", &[360.0, 270.0]),
        ("tls.xml#livox_mid-40", &[38.4, 38.4]),
        ("tls.xml#livox_mid-70", &[70.4, 70.4]),
        ("tls.xml#livox_mid-360", &[360.0, 59.0]),
        ("tls.xml#livox_hap", &[120.0, 25.0]),
        ("tls.xml#livox_mid-100", &[98.4, 38.4]),
        ("tls.xml#livox-avia-non-repetitive", &[77.2, 70.4]),
        ("tls.xml#velodyne_alpha_prime", &[360.0, 40.0]),
        ("tls.xml#velodyne_vlp-32c", &[360.0, 40.0]),
        ("tls.xml#hovermap", &[360.0, 360.0]),
    ];

    #[test]
    fn fields_are_those_of_heads_wedges_and_mirrors() {
        let (known, _) = catalogue().unwrap();
        assert_eq!(known.scanners.len(), FIELDS.len());
        for (name, scanner) in &known.scanners {
            let expected =
                FIELDS.iter().find(|(id, _)| name.ends_with(id)).unwrap_or_else(|| panic!("{name}")).1;
            let found = field_of_view(scanner).unwrap();
            // What is sampled has the accuracy of its sample.
            let is_sampled = matches!(scanner.devices[0].deflector, Deflector::Risley { .. });
            let tolerance = if is_sampled { 0.5 } else { 0.0 };
            let is_near = found.len() == expected.len()
                && found.iter().zip(expected).all(|(a, b)| (a - b).abs() <= tolerance && *a <= 360.0);
            assert!(is_near, "{name}: {found:?}, expected {expected:?}");
        }
    }

    #[test]
    fn fields_are_told_as_data_sheets_do() {
        assert_eq!(field_in_words(&[58.0], false), "58°");
        assert_eq!(field_in_words(&[40.0, 28.0], false), "40° × 28°");
        assert_eq!(field_in_words(&[360.0, 41.3], true), "360° all around, 41.3° up and down");
    }
}
