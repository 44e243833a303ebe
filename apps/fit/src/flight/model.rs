//! Model of the place where the beam of a flown scanner meets the ground.

use super::mirror::{MIRROR_PARAMETERS, Mirror};
use libm::{atan2, cos, hypot, sin};
use vlscan_geom::DVec3;

/// Parameters of the platform, which precede those of the mirror.
pub const PLATFORM_PARAMETERS: usize = 10;
/// Maximum number of channels, each with lines of its own.
pub const MAX_CHANNELS: usize = 4;
/// Parameters of a channel beyond the first.
pub const CHANNEL_PARAMETERS: usize = 3;
/// Index of the first parameter of a channel.
pub const FIRST_OF_CHANNELS: usize = PLATFORM_PARAMETERS + MIRROR_PARAMETERS;
/// Maximum number of facets that differ.
pub const MAX_FACETS: usize = CHANNEL_PARAMETERS * (MAX_CHANNELS - 1);
/// Maximum number of parameters.
pub const MAX_PARAMETERS: usize = FIRST_OF_CHANNELS + MAX_FACETS;

/// A flight with its scanner.
///
/// The platform moves along a parabola and has a constant attitude; deviations of single lines from it are
/// [`Attitude`]s.
#[derive(Clone, Debug)]
pub struct Model {
    /// Mirror that deflects the beam.
    pub mirror: Mirror,
    /// Place at time 0 (x, y: m), velocity (m/s), acceleration (m/s²), height at time 0 (m), climb (m/s),
    /// roll, pitch (rad), the parameters of the mirror, and for n channels n − 1 times: phase of channel k +
    /// 1, yaw and pitch of channel k. Yaws and pitches of the channels have the sum 0: their mean is that of
    /// the scanner. Facets that differ have their tilts in place of channels.
    pub parameters: [f64; MAX_PARAMETERS],
    /// 1 for each channel whose lines go the way of the first one's, −1 for those that go the other way.
    pub senses: Vec<f64>,
    /// Facets of a polygon mirror that draw lines of different tilts in turn; 1 if they are alike.
    pub facets: usize,
}

/// Deviation of the attitude of one line: roll, pitch, yaw, rad. A cone turns by its yaw just as by the phase
/// of its mirror.
pub type Attitude = [f64; 3];

/// How a channel differs from the scanner, rad.
#[derive(Clone, Copy, Debug)]
pub struct Channel {
    /// Phase of its mirror at time 0.
    pub phase: f64,
    /// Turn of its lines about the vertical, to the right.
    pub yaw: f64,
    /// Tilt of its lines forward (nose up).
    pub pitch: f64,
    /// 1, or −1 for lines that go the other way.
    pub sense: f64,
}

/// Intersection of a beam with the height of a point, and its scan angle.
#[derive(Clone, Copy, Debug)]
pub struct Footprint {
    /// m.
    pub x: f64,
    /// m.
    pub y: f64,
    /// Across the track, positive to the right, rad.
    pub angle: f64,
}

impl Model {
    /// A model with one channel.
    pub fn new(mirror: Mirror, parameters: [f64; MAX_PARAMETERS]) -> Model {
        Model { mirror, parameters, senses: vec![1.0], facets: 1 }
    }

    /// Number of parameters.
    pub fn count(&self) -> usize {
        match self.senses.len() {
            _ if self.facets > 1 => FIRST_OF_CHANNELS + self.facets,
            1 => PLATFORM_PARAMETERS + self.mirror.count(),
            channels => FIRST_OF_CHANNELS + CHANNEL_PARAMETERS * (channels - 1),
        }
    }

    /// Position of the platform at `time`, m.
    pub fn position(&self, time: f64) -> DVec3 {
        let p = &self.parameters;
        let half = 0.5 * time * time;
        DVec3::new(p[0] + p[2] * time + p[4] * half, p[1] + p[3] * time + p[5] * half, p[6] + p[7] * time)
    }

    /// Course at time 0, rad, clockwise from north (+y).
    pub fn course(&self) -> f64 {
        atan2(self.parameters[2], self.parameters[3])
    }

    /// Parameters of the mirror.
    pub fn of_mirror(&self) -> &[f64] {
        &self.parameters[PLATFORM_PARAMETERS..FIRST_OF_CHANNELS]
    }

    /// A channel by its number, the last one for greater numbers: cones and single lines have one channel.
    pub fn channel(&self, number: usize) -> Channel {
        let extra = &self.parameters[FIRST_OF_CHANNELS..];
        let others = self.senses.len() - 1;
        let number = number.min(others);
        let angle = |which: usize| match number < others {
            true => extra[CHANNEL_PARAMETERS * number + which],
            false => -(0..others).map(|k| extra[CHANNEL_PARAMETERS * k + which]).sum::<f64>(),
        };
        let phase = match number {
            0 => self.of_mirror()[2],
            _ => extra[CHANNEL_PARAMETERS * (number - 1)],
        };
        Channel { phase, yaw: angle(1), pitch: angle(2), sense: self.senses[number] }
    }

    /// Sets phase, yaw and pitch of a channel; the last one keeps the sums of yaws and pitches at 0.
    pub fn set_channel(&mut self, number: usize, phase: f64, yaw: f64, pitch: f64) {
        let others = self.senses.len() - 1;
        let extra = FIRST_OF_CHANNELS + CHANNEL_PARAMETERS * number;
        match number {
            0 => self.parameters[PLATFORM_PARAMETERS + 2] = phase,
            _ => self.parameters[extra - CHANNEL_PARAMETERS] = phase,
        }
        if number < others {
            (self.parameters[extra + 1], self.parameters[extra + 2]) = (yaw, pitch);
        }
    }

    /// Tilts of the facets of a polygon mirror, in the order of their lines; empty if they are alike. A facet
    /// turns the beam by its tilt forward, along the axis of the mirror.
    pub fn facet_tilts(&self) -> &[f64] {
        let count = if self.facets > 1 { self.facets } else { 0 };
        &self.parameters[FIRST_OF_CHANNELS..][..count]
    }

    /// Place of a channel's mirror within the revolution, line or period at `time`, from 0 to 1.
    pub fn part(&self, channel: usize, time: f64) -> f64 {
        self.mirror.part(self.of_mirror(), self.channel(channel).phase, time)
    }

    /// Direction of the beam of a channel in the axes right, forward, up of the course, unit vector.
    pub fn direction(&self, attitude: &Attitude, channel: usize, time: f64) -> DVec3 {
        let p = &self.parameters;
        let channel = self.channel(channel);
        let mut beam = self.mirror.direction(self.of_mirror(), channel.phase, time);
        if self.facets > 1 {
            let line = self.mirror.number(self.of_mirror(), channel.phase, time);
            let tilt = self.facet_tilts()[line.rem_euclid(self.facets as i64) as usize];
            beam = DVec3::new(beam.x * cos(tilt), sin(tilt), beam.z * cos(tilt));
        }
        beam.x *= channel.sense;
        if self.senses.len() > 1 {
            beam = turned(beam, 0.0, channel.pitch, channel.yaw);
        }
        let yaw = if self.mirror == Mirror::Cone { 0.0 } else { self.of_mirror()[3] };
        turned(beam, p[8] + attitude[0], p[9] + attitude[1], yaw + attitude[2])
    }

    /// Intersection of the beam of a channel at `time` with `height`.
    pub fn footprint(&self, attitude: &Attitude, channel: usize, time: f64, height: f64) -> Footprint {
        let beam = self.direction(attitude, channel, time);
        let place = self.position(time);
        let scale = (place.z - height) / -beam.z;
        let course = self.course();
        let (sin, cos) = (sin(course), cos(course));
        let (x, y) = (beam.x * cos + beam.y * sin, beam.y * cos - beam.x * sin);
        // Scan angles are about the direction of travel at that time.
        let p = &self.parameters;
        let (east, north) = (p[2] + p[4] * time, p[3] + p[5] * time);
        let to_right = (x * north - y * east) / hypot(east, north);
        Footprint { x: place.x + scale * x, y: place.y + scale * y, angle: atan2(to_right, -beam.z) }
    }
}

/// A vector of the body in the axes right, forward, up of the course: first roll (right side down), then
/// pitch (nose up), then yaw (to the right).
fn turned(v: DVec3, roll: f64, pitch: f64, yaw: f64) -> DVec3 {
    let (s, c) = (sin(roll), cos(roll));
    let v = DVec3::new(c * v.x + s * v.z, v.y, c * v.z - s * v.x);
    let (s, c) = (sin(pitch), cos(pitch));
    let v = DVec3::new(v.x, c * v.y - s * v.z, s * v.y + c * v.z);
    let (s, c) = (sin(yaw), cos(yaw));
    DVec3::new(c * v.x + s * v.y, c * v.y - s * v.x, v.z)
}
