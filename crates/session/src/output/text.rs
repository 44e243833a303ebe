//! The text files of HELIOS++ besides points (spec outputs §5–7), with fields separated by single spaces and
//! without header, and trajectories as comma-separated values.

use super::plan::WorldFrame;
use vlscan_formats::number::{push_fixed, push_integer};
use vlscan_geom::{DVec3, degrees};
use vlscan_lidar::flight::PoseSample;
use vlscan_lidar::pulse::{PulseRecord, WaveformRecord};

/// Header line of a trajectory as comma-separated values.
pub(super) const TRAJECTORY_HEADER: &[u8] = b"time,x,y,z,roll,pitch,yaw\n";

/// Appends `x y z gps_time roll pitch yaw`, angles in degrees.
pub(super) fn push_pose(out: &mut Vec<u8>, frame: WorldFrame, pose: &PoseSample) {
    push_vector(out, frame.origin + pose.position);
    push_seconds(out, frame.seconds(pose.time_ns));
    out.push(b' ');
    push_decimals(out, degrees(pose.roll));
    push_decimals(out, degrees(pose.pitch));
    push_fixed::<4>(out, yaw_degrees(pose));
    out.push(b'\n');
}

/// Appends `time,x,y,z,roll,pitch,yaw` in seconds, metres and degrees (heading, pitch, roll innermost), the
/// input format of `--trajectory`.
pub(super) fn push_pose_csv(out: &mut Vec<u8>, frame: WorldFrame, pose: &PoseSample) {
    push_seconds(out, frame.seconds(pose.time_ns));
    for metres in (frame.origin + pose.position).to_array() {
        out.push(b',');
        push_fixed::<6>(out, metres);
    }
    for angle in pose.attitude.heading_angles().map(degrees) {
        out.push(b',');
        push_fixed::<9>(out, angle);
    }
    out.push(b'\n');
}

/// Appends `fullwave_index origin direction start end gps_time sample…`.
pub(super) fn push_waveform(out: &mut Vec<u8>, frame: WorldFrame, wave: &WaveformRecord, samples: &[f64]) {
    push_count(out, wave.pulse_number);
    push_vector(out, frame.origin + wave.origin);
    push_vector(out, wave.direction);
    push_decimals(out, wave.start_ns);
    push_decimals(out, wave.end_ns);
    push_seconds(out, frame.seconds(wave.time_ns));
    for &sample in samples {
        out.push(b' ');
        push_fixed::<9>(out, sample);
    }
    out.push(b'\n');
}

/// Appends `origin direction gps_time fullwave_index device`; the time is in nanoseconds.
pub(super) fn push_pulse(out: &mut Vec<u8>, frame: WorldFrame, pulse: &PulseRecord) {
    push_vector(out, frame.origin + pulse.origin);
    push_vector(out, pulse.direction);
    push_decimals(out, pulse.time_ns + frame.time * 1e9);
    push_count(out, pulse.number);
    push_integer(out, pulse.device);
    out.push(b'\n');
}

fn push_seconds(out: &mut Vec<u8>, seconds: f64) {
    push_fixed::<9>(out, seconds);
}

fn push_vector(out: &mut Vec<u8>, v: DVec3) {
    v.to_array().into_iter().for_each(|c| push_decimals(out, c));
}

fn push_decimals(out: &mut Vec<u8>, value: f64) {
    push_fixed::<4>(out, value);
    out.push(b' ');
}

fn push_count(out: &mut Vec<u8>, count: impl itoa::Integer) {
    push_integer(out, count);
    out.push(b' ');
}

fn yaw_degrees(pose: &PoseSample) -> f64 {
    let yaw = degrees(pose.yaw);
    if yaw < 0.0 { yaw + 360.0 } else { yaw }
}

#[cfg(test)]
mod tests {
    use super::*;
    use vlscan_geom::Rotation;

    fn at(x: f64, y: f64, z: f64) -> WorldFrame {
        WorldFrame { origin: DVec3::new(x, y, z), time: 0.0 }
    }

    fn text(push: impl FnOnce(&mut Vec<u8>)) -> String {
        let mut out = Vec::new();
        push(&mut out);
        String::from_utf8(out).unwrap()
    }

    #[test]
    fn a_pose_of_the_specification() {
        let pose = PoseSample {
            time_ns: 86_391e9,
            position: DVec3::ZERO,
            roll: 0.0,
            pitch: -0.0,
            yaw: 1.5 * std::f64::consts::PI,
            attitude: Rotation::about_z(1.5 * std::f64::consts::PI),
            flown: (DVec3::ZERO, Rotation::IDENTITY),
        };
        let position = at(-30.0, -50.0, 100.0);
        let line = text(|out| push_pose(out, position, &pose));
        assert_eq!(line, "-30.0000 -50.0000 100.0000 86391.000000000 0.0000 -0.0000 270.0000\n");
        let line = text(|out| push_pose_csv(out, position, &pose));
        assert_eq!(
            line,
            "86391.000000000,-30.000000,-50.000000,100.000000,0.000000000,0.000000000,90.000000000\n"
        );
        let adjusted = WorldFrame { time: 390_000_000.0, ..position };
        assert!(text(|out| push_pose_csv(out, adjusted, &pose)).starts_with("390086391.000000000,-30.0"));
        let west = PoseSample { yaw: -0.5 * std::f64::consts::PI, ..pose };
        assert!(text(|out| push_pose(out, position, &west)).ends_with(" 270.0000\n"));
    }

    #[test]
    fn a_pulse_of_the_specification() {
        let pulse = PulseRecord {
            origin: DVec3::ZERO,
            direction: DVec3::new(0.2542, 0.2289, -0.9397),
            time_ns: 86_391e9,
            number: 1,
            device: 0,
            scan_angle: 0.0,
        };
        let line = text(|out| push_pulse(out, at(-30.0, -50.0, 100.414), &pulse));
        assert_eq!(line, "-30.0000 -50.0000 100.4140 0.2542 0.2289 -0.9397 86391000000000.0000 1 0\n");
    }

    #[test]
    fn a_waveform_has_nine_decimals_from_the_time_on() {
        let wave = WaveformRecord {
            pulse_number: 7,
            device: 0,
            origin: DVec3::ZERO,
            direction: DVec3::NEG_Z,
            start_ns: 355.8806,
            end_ns: 356.1306,
            time_ns: 518_391e9,
            first_sample: 0,
            samples: 2,
        };
        let line = text(|out| push_waveform(out, at(-5.1, 1.4, 88.2), &wave, &[0.0, 1.168329293]));
        let expected = "7 -5.1000 1.4000 88.2000 0.0000 0.0000 -1.0000 355.8806 356.1306 518391.000000000 \
                        0.000000000 1.168329293\n";
        assert_eq!(line, expected);
    }
}
