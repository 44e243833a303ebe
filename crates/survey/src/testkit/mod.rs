//! Devices and surveys for the tests of several modules.

pub mod documents;

use super::device::{DETECTOR, DEVICE_BEAM, WAVEFORM};
use super::*;

pub fn device() -> Device {
    Device { scan_angle_max: 1.0, id: "tls".to_owned(), ..Device::new(Deflector::Conic) }
}

/// The beam of the worked examples (spec pulse-physics §3.6), of 5 ns.
pub fn tls_beam() -> Beam {
    Beam { pulse_length: 5.0, ..DEVICE_BEAM }
}

/// A device with [`tls_beam`] of the given pulse length (ns), a minimum range of 1.5 m, 3 rings, bins of 0.25
/// ns and a window of a quarter pulse.
pub fn tls_device(pulse_length: f64) -> Device {
    Device {
        beam: Beam { pulse_length, ..tls_beam() },
        detector: Detector { range_min: 1.5, ..DETECTOR },
        waveform: WaveformSettings { window: pulse_length / 4.0, ..WAVEFORM },
        ..device()
    }
}

/// Settings of an active leg at `pulse_freq` Hz.
pub fn scanner_settings(pulse_freq: u32) -> ScannerSettings {
    ScannerSettings {
        active: true,
        pulse_freq,
        pulse_times: None,
        scan_freq: 0.0,
        scan_angle: 0.0,
        vertical_min: None,
        vertical_max: None,
        head_rate: 0.0,
        head_start: 0.0,
        head_stop: 0.0,
        beam_divergence: DEVICE_BEAM.divergence,
        written_divergence: None,
        trajectory_interval: 0.0,
        max_duration: None,
        warmup: 0.0,
        weather: Weather::CLEAR,
    }
}

pub fn leg(number: u32, scanner: ScannerSettings) -> Leg {
    Leg {
        number,
        strip: None,
        platform: PlatformSettings::at(vlscan_geom::DVec3::ZERO),
        scanner,
        place: None,
    }
}

/// A survey of these devices on a tripod with one leg at 1 kHz and the divergence of device 0.
pub fn survey(devices: Vec<Device>) -> Survey {
    let beam_divergence = devices[0].beam.divergence;
    Survey {
        name: "test".to_owned(),
        path: "test.xml".into(),
        seed: None,
        platform: Platform {
            id: "tripod".to_owned(),
            kind: PlatformKind::Static,
            mount: Mount::IDENTITY,
            noise: PlatformNoise::default(),
        },
        scanner: Scanner {
            id: "scanner".to_owned(),
            name: "Test scanner".to_owned(),
            pulse_freqs: vec![1000],
            multi_channel: devices.len() > 1,
            sources: Vec::new(),
            turn: None,
            pulse_times: None,
            devices,
            written: Vec::new(),
        },
        scene: SceneRecipe {
            id: "scene".to_owned(),
            path: "scene.xml".into(),
            parts: Vec::new(),
            dyn_step: 1,
            dyn_time_step: None,
            packed: None,
            asset_folders: Vec::new(),
        },
        legs: vec![leg(0, ScannerSettings { beam_divergence, ..scanner_settings(1000) })],
        leg_offset: None,
        crs_wkt: None,
    }
}
