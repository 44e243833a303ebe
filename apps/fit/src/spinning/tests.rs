//! A sensor in a room whose noise and detection are known.

use super::*;
use std::io::Write as _;
use vlscan_base::rng::{Purpose, Stream};

const CALIBRATION: &str = r#"{"product": "OS-1-64", "mode": "1024x10", "columns": 1024, "origin_to_beam_mm": 15.806,
    "beam_altitude_deg": ALTITUDES, "beam_azimuth_deg": AZIMUTHS}"#;
/// Strength of a white target at 1 m, and of an echo at the threshold.
const WHITE: f64 = 40_000.0;
const THRESHOLD: f64 = 8.0;
const PHOTONS: u32 = 8;
const DROPOUT_RATE: f64 = 0.02;
const NOISE: RangeNoise = RangeNoise { constant: 0.006, shot: 0.03, amplifier: 0.0, footprint: 0.7 };

/// A sensor with 64 staggered beams.
fn scanner() -> Scanner {
    let list = |of: &dyn Fn(usize) -> f64| format!("{:?}", (0..64).map(of).collect::<Vec<f64>>());
    let text = CALIBRATION
        .replace("ALTITUDES", &list(&|i| 22.0 - 0.7 * i as f64))
        .replace("AZIMUTHS", &list(&|i| [4.2, 1.4, -1.4, -4.2][i % 4]));
    let mut file = tempfile::Builder::new().suffix(".json").tempfile().unwrap();
    file.write_all(text.as_bytes()).unwrap();
    let path = file.path().to_string_lossy().into_owned();
    let (mut scanner, warnings) = find_scanner(&path, &ReadOptions::default()).unwrap();
    assert!(warnings.is_empty(), "{}", warnings.text());
    scanner.devices.iter_mut().for_each(|device| device.beam.take_stated_width());
    scanner
}

/// A room of 14 by 60 by 9 m whose walls reflect from 2 % to 80 %, in fields of some metres.
fn room(scanner: &Scanner) -> RangeImage {
    let mut image = RangeImage::empty(scanner).unwrap();
    (image.has_signal, image.range_step) = (true, 0.001);
    let (noise, chance) = (Stream::new(1, Purpose::Range), Stream::new(2, Purpose::PhotonCount));
    let divergence = scanner.devices[0].beam.divergence;
    let half = [7.0f64, 30.0, 4.5];
    for (number, pixel) in (0u64..).zip(&mut image.pixels) {
        let (o, d) = (pixel.origin.to_array(), pixel.direction.to_array());
        let walls = (0..3).map(|axis| (half[axis].copysign(d[axis]) - o[axis]) / d[axis]);
        let (axis, range) = walls.enumerate().min_by(|a, b| a.1.total_cmp(&b.1)).unwrap();
        let (cosine, at) = (d[axis].abs(), pixel.origin + pixel.direction * range);
        let field = ((at.x * 0.4).sin() + (at.y * 0.3).sin() + (at.z * 0.5).sin()).round();
        let reflectance = 0.8 * 10f64.powf(-(field + 3.0) / 6.0 * 1.6);
        let mean = WHITE * reflectance * cosine / (range * range);
        let weakness = (THRESHOLD / mean).min(1.0);
        let depth = range * divergence * 0.25 * (1.0 / (cosine * cosine) - 1.0).sqrt();
        let sigma = NOISE.sigma(THRESHOLD / weakness, THRESHOLD, depth);
        // The distribution of Poisson by its sum.
        let (mut term, mut below) = ((-mean).exp(), 0.0);
        for k in 0..PHOTONS {
            below += term;
            term *= mean / f64::from(k + 1);
        }
        let is_seen = chance.uniform(0, number, 0) > below && chance.uniform(0, number, 1) >= DROPOUT_RATE;
        if is_seen {
            pixel.range = range + sigma * noise.normal(0, number, 0);
            pixel.strength = mean.max(THRESHOLD);
            pixel.reflectance = reflectance * cosine;
        }
    }
    image
}

#[test]
fn noise_and_detection_of_a_known_sensor_are_found() {
    let scanner = scanner();
    let image = room(&scanner);
    let fits = [Half::Even, Half::Odd].map(|half| estimate(scanner.clone(), image.clone(), half).unwrap());
    for fit in &fits {
        let figures = fit.figures();
        let found = [figures.constant_m, figures.shot_m, figures.footprint];
        for (found, expected) in found.into_iter().zip([NOISE.constant, NOISE.shot, NOISE.footprint]) {
            assert!(
                (found[0] / expected - 1.0).abs() < 0.12,
                "{} is not {expected}\n{}",
                found[0],
                figures.table()
            );
            assert!(found[1] > 0.0 && found[1] < 0.1 * expected, "{}", figures.table());
        }
        assert!(figures.amplifier_m[0] < 0.02, "{}", figures.table());
        assert!((figures.dropout_rate[0] / DROPOUT_RATE - 1.0).abs() < 0.15, "{}", figures.table());
        assert!(figures.planes > 1000, "{}", figures.planes);
        // The half that was not fitted scatters as the law says.
        for class in &figures.classes {
            let [fitted, other] = class.scatter_m.map(|scatter| scatter / class.law_m[1]);
            assert!((other - 1.0).abs() < 0.15 && (fitted - 1.0).abs() < 0.15, "{}", figures.table());
        }
    }
}

/// The room suggests a sensor that sees less far than its product line: its threshold is left out, and the
/// noise of an echo of any strength stays.
#[test]
fn a_maximum_range_far_from_that_of_the_product_line_is_a_comment() {
    let scanner = scanner();
    let fit = estimate(scanner.clone(), room(&scanner), Half::Even).unwrap();
    let written = |fit: &SpinningFit| {
        let folder = tempfile::tempdir().unwrap();
        let files = SpinningFiles::new(&folder.path().join("fit.toml"), None);
        fit.write(&files, (Path::new("sensor.json"), "vlscan fit"), false).unwrap();
        std::fs::read_to_string(&files.pipeline).unwrap()
    };
    let with_range = |range: f64| {
        let mut fit = fit.clone();
        let target = vlscan_survey::ReferenceTarget { range, reflectance: 0.1, pulse_freq: None };
        fit.scanner.devices.iter_mut().for_each(|device| device.receiver.max_range = Some(target));
        fit
    };
    let near = with_range(1.2 * fit.max_range);
    assert!(near.range_doubt().is_none() && written(&near).contains("\nmax_range = "), "{}", written(&near));
    let far = with_range(2.0 * fit.max_range);
    let text = written(&far);
    assert!(text.contains("# left out: ") && text.contains("\n# max_range = "), "{text}");
    assert!(text.contains("\n# threshold_photons = ") && text.contains("\ndropout_rate = "), "{text}");
    let (noise, threshold) = (far.written_noise(), fit.detection.threshold);
    let sigmas = [
        fit.noise.sigma(20.0 * threshold, threshold, 0.0),
        noise.sigma(20.0 * threshold, threshold / 4.0, 0.0),
    ];
    assert!((sigmas[1] / sigmas[0] - 1.0).abs() < 1e-9, "{sigmas:?}");
}

/// Noise that no sensor of a product line has, as that of planes seen with the calibration of another sensor,
/// is a comment.
#[test]
fn implausible_noise_is_a_comment() {
    let scanner = scanner();
    let fit = estimate(scanner.clone(), room(&scanner), Half::Even).unwrap();
    let written = |noise: RangeNoise| {
        let fit = SpinningFit { noise, ..fit.clone() };
        let folder = tempfile::tempdir().unwrap();
        let files = SpinningFiles::new(&folder.path().join("fit.toml"), None);
        fit.write(&files, (Path::new("sensor.json"), "vlscan fit"), false).unwrap();
        (fit.noise_doubt(), std::fs::read_to_string(&files.pipeline).unwrap())
    };
    let (doubt, text) = written(fit.noise);
    assert!(doubt.is_none() && text.contains("\nrange_noise = "), "{text}");
    for (noise, said) in [
        (RangeNoise { constant: 0.055, ..fit.noise }, "of strong echoes is 55 mm, expected at most 30 mm"),
        (RangeNoise { amplifier: 0.352, ..fit.noise }, "at the threshold is 352 mm, expected at most 300 mm"),
        (RangeNoise { footprint: 2.8, ..fit.noise }, "depth of the footprint is 2.8, expected at most 2.0"),
    ] {
        let (doubt, text) = written(noise);
        assert!(doubt.as_ref().is_some_and(|reason| reason.contains(said)), "{said}: {doubt:?}");
        assert!(text.contains("\n# range_noise = ") && text.contains("\ndropout_rate = "), "{text}");
    }
}

#[test]
fn recordings_without_planes_are_refused() {
    let scanner = scanner();
    let empty = RangeImage::empty(&scanner).unwrap();
    let error = estimate(scanner.clone(), empty.clone(), Half::Even).unwrap_err();
    assert_eq!(error, SpinningError::FewPlanes(0));
    assert!(error.to_string().starts_with("0 planes were found, expected at least 25;"), "{error}");
    // Noise of metres everywhere.
    let mut wild = empty;
    let noise = Stream::new(1, Purpose::Range);
    for (number, pixel) in (0u64..).zip(&mut wild.pixels) {
        (pixel.range, pixel.strength) = (5.0 + 30.0 * noise.uniform(0, number, 0), 10.0);
    }
    let error = estimate(scanner, wild, Half::Even).unwrap_err();
    assert!(matches!(error, SpinningError::FewPlanes(_)), "{error}");
}
