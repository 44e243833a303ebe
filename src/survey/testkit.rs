//! Devices and surveys for the tests of several modules.

use super::*;
use crate::geom::DVec3;
use std::path::PathBuf;

/// The beam of the worked examples (spec pulse-physics §3.6), of 5 ns.
pub fn tls_beam() -> Beam {
    Beam {
        divergence: 3e-4,
        divergence_y: None,
        profile: BeamProfile::Gaussian,
        aperture: 0.0,
        pulse_length: 5.0,
        wavelength: 1064.0,
        atmosphere_wavelength: 1064.0,
        average_power: 4.0,
        pulse_energy: None,
        quality: 1.0,
        efficiency: 0.99,
        receiver_diameter: 0.15,
        visibility: 23.0,
    }
}

/// A device with that beam, 3 rings, bins of 0.25 ns and a window of a quarter pulse.
pub fn tls_device(pulse_length: f64) -> Device {
    Device {
        id: "tls".to_owned(),
        deflector: Deflector::Conic,
        scan_angle_max: 1.0,
        scan_freq: (0.0, 0.0),
        head: Head { axis: DVec3::Z, max_rate: 0.0 },
        beam_origin: Mount::IDENTITY,
        beam: Beam { pulse_length, ..tls_beam() },
        detector: Detector {
            accuracy: 0.0,
            range_min: 1.5,
            range_max: f64::MAX,
            max_returns: 0,
            threshold: 1e-4,
            threshold_given: false,
            distance_error: None,
        },
        receiver: Receiver::default(),
        waveform: WaveformSettings { bin: 0.25, window: pulse_length / 4.0, quality: 3, max_range: 0.0 },
        errors: MechanicalErrors::default(),
    }
}

/// A survey of one leg with these devices and device 0's divergence.
pub fn survey(devices: Vec<Device>) -> Survey {
    let scanner = ScannerSettings {
        active: true,
        pulse_freq: 1000,
        scan_freq: 0.0,
        scan_angle: 0.0,
        vertical_min: None,
        vertical_max: None,
        head_rate: 0.0,
        head_start: 0.0,
        head_stop: 0.0,
        beam_divergence: devices[0].beam.divergence,
        written_divergence: None,
        trajectory_interval: 0.0,
        max_duration: None,
        warmup: 0.0,
    };
    let platform = PlatformSettings {
        position: DVec3::ZERO,
        on_ground: false,
        speed: 0.0,
        stop_and_turn: false,
        smooth_turn: false,
        slowdown: false,
        yaw_at_departure: None,
        trajectory: None,
    };
    Survey {
        name: "test".to_owned(),
        path: PathBuf::new(),
        seed: None,
        platform: Platform {
            id: "tripod".to_owned(),
            kind: PlatformKind::Static,
            mount: Mount::IDENTITY,
            noise: PlatformNoise::default(),
        },
        scanner: Scanner {
            id: "tls".to_owned(),
            name: "tls".to_owned(),
            pulse_freqs: vec![1000],
            multi_channel: devices.len() > 1,
            devices,
        },
        scene: SceneRecipe {
            id: "scene".to_owned(),
            path: PathBuf::new(),
            parts: Vec::new(),
            dyn_step: 1,
            dyn_time_step: None,
            packed: None,
            asset_folders: Vec::new(),
        },
        legs: vec![Leg { number: 0, strip: None, platform, scanner, place: None }],
        leg_offset: None,
        crs_wkt: None,
    }
}
