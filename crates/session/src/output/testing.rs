//! Surveys, scenes and batches for the tests of this module.

use super::{NoOffload, OutputContext, OutputPlan, OutputRequest, OutputSummary};
use std::sync::Arc;
use vlscan_base::error::Result;
use vlscan_geom::{Aabb, DVec3, Rotation};
use vlscan_lidar::flight::PoseSample;
use vlscan_lidar::pulse::{Batch, Echo, PulseRecord, WaveformRecord};
use vlscan_scene::{Part, Scene};
use vlscan_survey::{Detector, Device, Leg, ScannerSettings, Survey, testkit};

/// Returns an echo with plain values, return `number` of `of`.
pub(super) fn echo(number: u32, of: u32) -> Echo {
    Echo {
        scanner: Echo::NO_ATTITUDE,
        position: DVec3::ZERO,
        origin: DVec3::new(0.0, 0.0, 100.0),
        direction: DVec3::NEG_Z,
        range: 100.0,
        true_range: 100.0,
        intensity: 1.0,
        echo_width: 0.0,
        return_number: number,
        number_of_returns: of,
        pulse_number: 1,
        device: 0,
        part: 0,
        primitive: 0,
        classification: 0,
        incidence_cosine: 1.0,
        scan_angle: 0.0,
        time_ns: 0.0,
        truth_index: Echo::NO_TRUTH,
    }
}

/// Returns a scene at about (500 000, 5 400 000, 300) with parts `0`, `north` and an unnamed one.
pub(super) fn scene() -> Scene {
    Scene {
        shift: DVec3::new(500_000.25, 5_400_000.5, 300.125),
        bounds: Aabb { min: DVec3::splat(-1000.0), max: DVec3::splat(1000.0) },
        parts: ["0", "north", ""].map(|id| Part { id: id.to_owned(), ..Part::default() }).to_vec(),
        ..Scene::default()
    }
}

/// Returns a survey `demo` with devices `q0`, `q1` ... and one leg per entry of `legs`, which is its strip;
/// `!` makes it inactive.
pub(super) fn survey(devices: usize, legs: &[Option<&str>]) -> Survey {
    let device = |i| Device {
        id: format!("q{i}"),
        detector: Detector { range_max: 1e4, threshold: 0.0, ..testkit::device().detector },
        ..testkit::device()
    };
    let leg = |(i, strip): (usize, &Option<&str>)| {
        let settings = testkit::scanner_settings(1000);
        let scanner = ScannerSettings { active: *strip != Some("!"), scan_freq: 10.0, ..settings };
        Leg { strip: strip.filter(|s| *s != "!").map(str::to_owned), ..testkit::leg(i as u32, scanner) }
    };
    Survey {
        name: "demo".to_owned(),
        path: "demo.xml".into(),
        legs: legs.iter().enumerate().map(leg).collect(),
        ..testkit::survey((0..devices).map(device).collect())
    }
}

/// Returns `echoes` echoes of two devices over all parts, with one to seventeen returns per pulse, and a
/// waveform, a pulse and a pose per hundred echoes.
pub(super) fn batch(leg: u32, first: usize, echoes: usize) -> Batch {
    let mut batch = Batch { leg, ..Batch::default() };
    for i in first..first + echoes {
        let x = i as f64;
        let returns = (i / 20 % 17 + 1) as u32;
        let time_ns = 86_391e9 + (i / 20) as f64 * 10_000.0;
        batch.echoes.push(Echo {
            position: DVec3::new(
                libm::sin(x) * 900.0,
                libm::cos(x * 0.7) * 900.0,
                libm::sin(x * 0.01) * 50.0,
            ),
            range: 100.0 + (i % 977) as f64 * 0.125,
            intensity: libm::pow(10.0, (i % 1100) as f64 / 100.0 - 4.0),
            echo_width: (i % 7) as f64 * 0.5,
            pulse_number: (i / 20) as u64 + 1,
            device: (i / 20 % 2) as u32,
            part: (i % 3) as u32,
            classification: (i % 40) as i32,
            incidence_cosine: libm::cos((i % 90) as f64 * 0.017),
            scan_angle: libm::sin(x * 0.001) * 0.6,
            time_ns,
            ..echo((i % 20) as u32 % returns + 1, returns)
        });
        if i % 100 == 0 {
            let (origin, direction) = (DVec3::new(x, 0.0, 100.0), DVec3::NEG_Z);
            let (first_sample, samples) = (batch.samples.len(), 5);
            batch.samples.extend((0..samples).map(|k| k as f64 * 0.1));
            batch.waveforms.push(WaveformRecord {
                pulse_number: i as u64,
                device: 0,
                origin,
                direction,
                start_ns: 300.0,
                end_ns: 301.0,
                time_ns,
                first_sample,
                samples,
            });
            batch.pulses.push(PulseRecord {
                origin,
                direction,
                time_ns,
                number: i as u64,
                device: 0,
                scan_angle: 0.0,
            });
            let attitude = Rotation::about_z(1.0);
            batch.poses.push(PoseSample {
                time_ns,
                position: origin,
                roll: 0.0,
                pitch: 0.0,
                yaw: 1.0,
                attitude,
                flown: (origin, attitude),
            });
        }
    }
    batch
}

pub(super) fn write(request: OutputRequest, survey: &Survey, batches: &[Batch]) -> Result<OutputSummary> {
    let scene = scene();
    let plan = Arc::new(OutputPlan::new(request, &OutputContext::new(survey, &scene))?);
    let mut writer = plan.open(Arc::new(NoOffload))?;
    for batch in batches {
        writer.append(plan.encode(batch, None))?;
    }
    writer.finish()
}
