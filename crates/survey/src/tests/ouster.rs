//! Calibration files of Ouster sensors, in the versions of their format.

use super::*;
use std::f64::consts::TAU;
use vlscan_geom::DVec3;

/// Firmware 1.14 to 2.1: all in one table.
const FLAT: &str = r#"{
  "beam_altitude_angles": [10.5, 0, -10.5], "beam_azimuth_angles": [4.2, 0, -1.4],
  "data_format": {"columns_per_frame": 512, "pixels_per_column": 3, "pixel_shift_by_row": [6, 0, -2], "column_window": [0, 511]},
  "lidar_mode": "512x20", "lidar_origin_to_beam_origin_mm": 15.806, "prod_line": "OS-1-32"
}"#;
/// Firmware 2.2 and later: sections, a transformation for the origin.
const NESTED: &str = r#"{
  "beam_intrinsics": {
    "beam_altitude_angles": [10.5, 0, -10.5], "beam_azimuth_angles": [4.2, 0, -1.4],
    "beam_to_lidar_transform": [1, 0, 0, 15.806, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1],
    "lidar_origin_to_beam_origin_mm": 15.806
  },
  "config_params": {"lidar_mode": "512x20", "azimuth_window": [0, 360000]},
  "lidar_data_format": {"columns_per_frame": 512, "pixels_per_column": 3, "fps": 20, "column_window": [0, 511]},
  "lidar_intrinsics": {"lidar_to_sensor_transform": [-1, 0, 0, 0, 0, -1, 0, 0, 0, 0, 1, 36.18, 0, 0, 0, 1]},
  "sensor_info": {"prod_line": "OS-1-32", "prod_sn": "992000000000"}
}"#;
/// A reduced form.
const REDUCED: &str = r#"{
  "product": "OS-1-32", "mode": "512x20", "columns": 512, "origin_to_beam_mm": 15.806,
  "beam_altitude_deg": [10.5, 0, -10.5], "beam_azimuth_deg": [4.2, 0, -1.4]
}"#;

/// The scanner of a pipeline whose `[scanner]` names this calibration file, and the warnings.
fn of_json(json: &str, keys: &str) -> vlscan_base::Result<(Survey, Diagnostics)> {
    let text = format!(
        "scene = \"a.obj\"\n[[leg]]\nposition_m = [0, 0, 0]\n[platform]\ncatalogue = \"tripod\"\n[scanner]\ncatalogue = \
         \"sensor.json\"\n{keys}"
    );
    let folder = Folder::new(&[("p.toml", &text), ("a.obj", ""), ("sensor.json", json)]);
    read_pipeline(&folder.path("p.toml"))
}

#[test]
fn all_versions_of_the_format_are_the_same_instrument() {
    for json in [FLAT, NESTED, REDUCED] {
        let (survey, warnings) = of_json(json, "").unwrap_or_else(|e| panic!("{}", report(&e)));
        assert!(warnings.is_empty(), "{}", warnings.render(false));
        let scanner = &survey.scanner;
        assert_eq!((scanner.name.as_str(), scanner.pulse_freqs.as_slice()), ("OS-1-32", &[10240][..]));
        assert_eq!(scanner.devices.len(), 3);
        for (device, (altitude, azimuth)) in
            scanner.devices.iter().zip([(10.5f64, 4.2f64), (0.0, 0.0), (-10.5, -1.4)])
        {
            // Clockwise seen from above: a positive azimuth is to the right of forward.
            let (up, right) = (altitude.to_radians(), azimuth.to_radians());
            let expected = DVec3::new(up.cos() * right.sin(), up.cos() * right.cos(), up.sin());
            assert!((device.beam_origin.rotation.forward() - expected).length() < 1e-12, "{altitude}");
            assert!((device.beam_origin.offset - DVec3::new(0.0, 0.015806, 0.0)).length() < 1e-15);
        }
        // One frame from column 0 on, clockwise.
        let leg = &survey.legs[0].scanner;
        assert_eq!(leg.pulse_freq, 10240);
        assert!((leg.head_rate + 20.0 * TAU).abs() < 1e-9 && leg.head_start == 0.0);
        assert!((leg.head_stop + TAU * 511.5 / 512.0).abs() < 1e-12);
        // Beam and receiver are those of the product line.
        let (model, _) = find_scanner("ouster_os1-128", &ReadOptions::default()).unwrap();
        assert_eq!(scanner.devices[0].receiver, model.devices[0].receiver);
        assert_eq!(scanner.devices[0].detector.range_max, model.devices[0].detector.range_max);
    }
}

#[test]
fn keys_change_a_calibrated_sensor() {
    let keys = "range_max_m = 50\naccuracy_m = 0.02\n[settings]\nhead_rate_deg_per_s = -3600\nhead_stop_deg = -720\n";
    let (survey, _) = of_json(FLAT, keys).unwrap_or_else(|e| panic!("{}", report(&e)));
    let device = &survey.scanner.devices[2];
    assert_eq!((device.detector.range_max, device.detector.accuracy), (50.0, 0.02));
    assert_eq!(device.receiver.range_noise, None);
    assert!((survey.legs[0].scanner.head_rate + 10.0 * TAU).abs() < 1e-9);
    assert!((survey.legs[0].scanner.head_stop + 2.0 * TAU).abs() < 1e-9);
}

#[test]
fn what_a_file_lacks_is_said() {
    for (from, to, said) in [
        ("\"lidar_origin_to_beam_origin_mm\": 15.806, ", "", "12.163 mm is used"),
        ("\"OS-1-32\"", "\"OS-DOME-128\"", "`OS-DOME-128` is not in the catalogue"),
        ("[0, 511]", "[100, 300]", "the columns [100,300] alone"),
    ] {
        assert!(FLAT.contains(from), "{from}");
        let (_, warnings) = of_json(&FLAT.replace(from, to), "").unwrap_or_else(|e| panic!("{}", report(&e)));
        assert_eq!(warnings.items().len(), 1, "{}", warnings.render(false));
        assert!(warnings.render(false).contains(said), "{}", warnings.render(false));
    }
    // Firmware 1.12 has a text in place of the format.
    let old = NESTED.replace(
        r#"{"columns_per_frame": 512, "pixels_per_column": 3, "fps": 20, "column_window": [0, 511]}"#,
        "\"error: Command not recognized.\"",
    );
    assert!(of_json(&old, "").unwrap().1.is_empty());
}

#[test]
fn files_that_are_no_calibration_are_refused_with_the_line() {
    for (from, to, said) in [
        ("{\n", "[\n", "no calibration file"),
        ("[10.5, 0, -10.5]", "[10.5, 0]", "2 altitudes of beams and 3 azimuths"),
        ("[10.5, 0, -10.5]", "[10.5, 0, \"low\"]", "`beam_altitude_angles` must be 1 to 1024 angles"),
        ("[10.5, 0, -10.5]", "[10.5, 0, -91]", "`beam_altitude_angles` must be 1 to 1024 angles"),
        ("[10.5, 0, -10.5]", "[0, 0, 0]", "calibrated sensor"),
        ("\"beam_altitude_angles\"", "\"altitudes\"", "`beam_altitude_angles` is missing"),
        ("\"512x20\"", "\"fast\"", "`lidar_mode` must be a mode such as 1024x10"),
        ("\"512x20\"", "\"512x1e300\"", "`lidar_mode` must be a mode such as 1024x10"),
        ("\"512x20\"", "\"1024x20\"", "`columns_per_frame` must be 1024"),
        ("\"pixels_per_column\": 3", "\"pixels_per_column\": 4", "`pixels_per_column` must be 3"),
        ("15.806", "1e9", "`lidar_origin_to_beam_origin_mm` must be a length"),
    ] {
        assert!(FLAT.contains(from), "{from}");
        let error = report(&of_json(&FLAT.replace(from, to), "").unwrap_err());
        assert!(error.contains(said) && error.contains("sensor.json"), "{said:?} is missing from\n{error}");
    }
    assert!(report(&of_json(&FLAT.replace("-1.4", "-1.4e"), "").unwrap_err()).contains("sensor.json:2"));
}
