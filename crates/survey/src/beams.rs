//! Channels that differ by the directions of their beams.

use super::{Device, Mount};
use vlscan_geom::{DVec3, Rotation, radians};

/// Beams of the channels of a sensor.
pub(super) struct Beams {
    /// Degrees.
    pub altitudes: Vec<f64>,
    /// Degrees, clockwise seen from above.
    pub azimuths: Vec<f64>,
    /// Origin of all beams in the frame of the emitter, m.
    pub origin: DVec3,
}

/// Channels like `base` that differ by elevation and azimuth (degrees) of their beams, by the distance of
/// their origin (m) and by the time of their pulse (µs); a list of one value applies to all channels.
pub(super) fn channels_of_beams(
    base: &Device,
    elevations: &[f64],
    azimuths: &[f64],
    radii: &[f64],
    offsets: &[f64],
) -> Vec<Device> {
    let of = |list: &[f64], i: usize| list[if list.len() == 1 { 0 } else { i }];
    let channel = |(i, elevation): (usize, &f64)| {
        let mut begin = base.beam_origin;
        if of(radii, i) != 0.0 {
            begin.offset += begin.rotation.apply(DVec3::new(0.0, of(radii, i), 0.0));
        }
        let beam_origin = beam_pose(&begin, *elevation, of(azimuths, i));
        Device { id: i.to_string(), beam_origin, firing_offset: of(offsets, i) * 1e-6, ..base.clone() }
    };
    elevations.iter().enumerate().map(channel).collect()
}

/// The pose of a channel of an entry without its rotation, which is that of the nominal angles of its beam.
pub(super) fn level(mount: &Mount) -> Mount {
    Mount { offset: mount.offset, ..Mount::IDENTITY }
}

/// Pose of an emitter whose beam leaves at an altitude and an azimuth (degrees, clockwise seen from above)
/// relative to the beam of `base`, with the origin of `base`.
pub(super) fn beam_pose(base: &Mount, altitude: f64, azimuth: f64) -> Mount {
    let turn = Rotation::about_x(radians(altitude));
    let turn = match azimuth {
        0.0 => turn,
        azimuth => Rotation::about_z(radians(-azimuth)).after(turn),
    };
    Mount { rotation: base.rotation.after(turn), ..*base }
}
