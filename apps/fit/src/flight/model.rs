//! Model of the intersection of a flown scanner's beam with the ground.

use super::mirror::{Mirror, MirrorParameters};
use super::parameters::Parameters;
use libm::{atan2, cos, hypot, sin};
use vlscan_geom::{DVec2, DVec3};

/// Maximum number of channels.
pub const MAX_CHANNELS: usize = 4;
/// Maximum number of facets that differ.
pub const MAX_FACETS: usize = 9;

/// A flight with its scanner.
///
/// The platform moves along a parabola and has a constant attitude; deviations of single lines from it are
/// [`Attitude`]s.
#[derive(Clone, Debug)]
pub struct Model {
    /// Mirror that deflects the beam.
    pub mirror: Mirror,
    /// Parameters of platform, mirror, channels and facets.
    pub parameters: Parameters,
}

/// Deviation of the attitude of one line, rad. A cone's yaw has the same effect as the phase of its mirror.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Attitude {
    /// Right side down.
    pub roll: f64,
    /// Nose up.
    pub pitch: f64,
    /// To the right.
    pub yaw: f64,
}

impl Attitude {
    /// Attitude of a vector of roll, pitch and yaw.
    pub fn from_vector(vector: DVec3) -> Attitude {
        Attitude { roll: vector.x, pitch: vector.y, yaw: vector.z }
    }

    /// Vector of roll, pitch and yaw.
    pub fn to_vector(self) -> DVec3 {
        DVec3::new(self.roll, self.pitch, self.yaw)
    }
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
    /// Number of facets that draw lines of different tilts in turn; 1 if all are alike.
    pub fn facets(&self) -> usize {
        self.parameters.facet_tilts.len().max(1)
    }

    /// True if the lines of several channels differ in direction.
    pub fn has_channels(&self) -> bool {
        self.parameters.channels.len() > 1
    }

    /// Position of the platform at `time`, m.
    pub fn position(&self, time: f64) -> DVec3 {
        self.parameters.position_at(time)
    }

    /// Horizontal velocity of the platform at `time`, m/s.
    pub fn horizontal_velocity(&self, time: f64) -> DVec2 {
        self.parameters.velocity_at(time).truncate()
    }

    /// Horizontal speed at the epoch, m/s.
    pub fn speed(&self) -> f64 {
        hypot(self.parameters.velocity.x, self.parameters.velocity.y)
    }

    /// Course at the epoch, rad, clockwise from north (+y).
    pub fn course(&self) -> f64 {
        atan2(self.parameters.velocity.x, self.parameters.velocity.y)
    }

    /// Index of a channel among those of the model: clouds may number more channels than have different
    /// lines.
    fn channel_index(&self, channel: usize) -> usize {
        channel.min(self.parameters.channels.len() - 1)
    }

    /// Fraction of the revolution, line or period of a channel's mirror that has passed at `time`, from 0 to
    /// 1.
    pub fn fraction(&self, channel: usize, time: f64) -> f64 {
        let channel = &self.parameters.channels[self.channel_index(channel)];
        self.parameters.mirror.fraction(channel.phase, time)
    }

    /// Direction of the beam of a channel in the axes right, forward, up of the course, unit vector.
    pub fn direction(&self, attitude: &Attitude, channel: usize, time: f64) -> DVec3 {
        let p = &self.parameters;
        let rotation = |index: usize| Rotation::new(0.0, p.channels[index].pitch, p.channels[index].yaw);
        let beam = self.beam(channel, time, |facet| SinCos::of(p.facet_tilts[facet]), rotation);
        self.rotation(attitude).turned(beam)
    }

    /// Intersection of the beam of a channel at `time` with `height`.
    pub fn footprint(&self, attitude: &Attitude, channel: usize, time: f64, height: f64) -> Footprint {
        self.intersection(self.direction(attitude, channel, time), SinCos::of(self.course()), time, height)
    }

    /// Direction of the beam of a channel in the axes of the scanner, with the tilts of facets and the
    /// rotations of channels by their indices.
    fn beam(
        &self,
        channel: usize,
        time: f64,
        tilt: impl Fn(usize) -> SinCos,
        rotation: impl Fn(usize) -> Rotation,
    ) -> DVec3 {
        let p = &self.parameters;
        let index = self.channel_index(channel);
        let channel = &p.channels[index];
        let mut beam = self.mirror.direction(&p.mirror, channel.phase, time);
        if !p.facet_tilts.is_empty() {
            let line = p.mirror.number(channel.phase, time);
            let tilt = tilt(line.rem_euclid(p.facet_tilts.len() as i64) as usize);
            beam = DVec3::new(beam.x * tilt.cos, tilt.sin, beam.z * tilt.cos);
        }
        beam.x *= channel.sense;
        if self.has_channels() {
            beam = rotation(index).turned(beam);
        }
        beam
    }

    /// Rotation from the axes of the scanner to those of the course.
    fn rotation(&self, attitude: &Attitude) -> Rotation {
        let p = &self.parameters;
        let yaw = if self.mirror.has_yaw() { p.mirror.yaw } else { 0.0 };
        Rotation::new(p.roll + attitude.roll, p.pitch + attitude.pitch, yaw + attitude.yaw)
    }

    /// Intersection of a beam, in the axes of the course, at `time` with `height`.
    fn intersection(&self, beam: DVec3, course: SinCos, time: f64, height: f64) -> Footprint {
        let place = self.position(time);
        let scale = (place.z - height) / -beam.z;
        let SinCos { sin, cos } = course;
        let (x, y) = (beam.x * cos + beam.y * sin, beam.y * cos - beam.x * sin);
        // Scan angles are about the direction of travel at that time.
        let velocity = self.horizontal_velocity(time);
        let to_right = (x * velocity.y - y * velocity.x) / hypot(velocity.x, velocity.y);
        Footprint { x: place.x + scale * x, y: place.y + scale * y, angle: atan2(to_right, -beam.z) }
    }
}

/// A model with the sines and cosines that all of its footprints share.
#[derive(Clone, Debug)]
pub struct Prepared<'m> {
    model: &'m Model,
    course: SinCos,
    /// Rotations of the channels; empty if there is one channel.
    channels: Vec<Rotation>,
    facet_tilts: Vec<SinCos>,
}

impl Prepared<'_> {
    /// Computes what the footprints of a model share.
    pub fn of(model: &Model) -> Prepared<'_> {
        let p = &model.parameters;
        let channels = if model.has_channels() { &p.channels[..] } else { &[] };
        Prepared {
            model,
            course: SinCos::of(model.course()),
            channels: channels.iter().map(|c| Rotation::new(0.0, c.pitch, c.yaw)).collect(),
            facet_tilts: p.facet_tilts.iter().map(|tilt| SinCos::of(*tilt)).collect(),
        }
    }

    /// Direction of the beam of a channel in the axes of the scanner, unit vector.
    pub fn beam(&self, channel: usize, time: f64) -> DVec3 {
        self.model.beam(channel, time, |facet| self.facet_tilts[facet], |index| self.channels[index])
    }

    /// True if the beams of another model have the same directions in the axes of the scanner.
    pub fn has_beams_of(&self, other: &Prepared) -> bool {
        let of = |model: &Model| (model.mirror, MirrorParameters { yaw: 0.0, ..model.parameters.mirror });
        let (p, others) = (&self.model.parameters, &other.model.parameters);
        of(self.model) == of(other.model)
            && p.channels == others.channels
            && p.facet_tilts == others.facet_tilts
    }

    /// The model at an attitude.
    pub fn at(&self, attitude: &Attitude) -> Posed<'_> {
        Posed { prepared: self, rotation: self.model.rotation(attitude) }
    }
}

/// A model at an attitude, with the sines and cosines that all of its footprints share.
#[derive(Clone, Copy, Debug)]
pub struct Posed<'m> {
    prepared: &'m Prepared<'m>,
    rotation: Rotation,
}

impl Posed<'_> {
    /// Direction of the beam of a channel in the axes of the scanner, unit vector.
    pub fn beam(&self, channel: usize, time: f64) -> DVec3 {
        self.prepared.beam(channel, time)
    }

    /// Intersection of a beam, in the axes of the scanner, at `time` with `height`.
    pub fn footprint(&self, beam: DVec3, time: f64, height: f64) -> Footprint {
        let Prepared { model, course, .. } = self.prepared;
        model.intersection(self.rotation.turned(beam), *course, time, height)
    }
}

/// Sine and cosine of an angle.
#[derive(Clone, Copy, Debug)]
struct SinCos {
    sin: f64,
    cos: f64,
}

impl SinCos {
    fn of(angle: f64) -> SinCos {
        SinCos { sin: sin(angle), cos: cos(angle) }
    }
}

/// Rotation from the axes of a body to the axes right, forward, up of its course: first roll (right side
/// down), then pitch (nose up), then yaw (to the right).
#[derive(Clone, Copy, Debug)]
struct Rotation {
    roll: SinCos,
    pitch: SinCos,
    yaw: SinCos,
}

impl Rotation {
    fn new(roll: f64, pitch: f64, yaw: f64) -> Rotation {
        Rotation { roll: SinCos::of(roll), pitch: SinCos::of(pitch), yaw: SinCos::of(yaw) }
    }

    fn turned(&self, v: DVec3) -> DVec3 {
        let SinCos { sin, cos } = self.roll;
        let v = DVec3::new(cos * v.x + sin * v.z, v.y, cos * v.z - sin * v.x);
        let SinCos { sin, cos } = self.pitch;
        let v = DVec3::new(v.x, cos * v.y - sin * v.z, sin * v.y + cos * v.z);
        let SinCos { sin, cos } = self.yaw;
        DVec3::new(cos * v.x + sin * v.y, cos * v.y - sin * v.x, v.z)
    }
}

#[cfg(test)]
mod tests {
    use super::super::parameters::Channel;
    use super::*;
    use vlscan_geom::radians;

    /// A flight to the north with 50 m/s at 1000 m, whose polygon mirror looks straight down at time 0.
    fn northward() -> Model {
        let channel = Channel { phase: std::f64::consts::PI, ..Channel::default() };
        let parameters = Parameters {
            position: DVec3::new(10.0, 20.0, 1000.0),
            velocity: DVec3::new(0.0, 50.0, 0.0),
            mirror: MirrorParameters { angle: radians(60.0), rate: 100.0, ..MirrorParameters::default() },
            channels: vec![channel],
            ..Parameters::default()
        };
        Model { mirror: Mirror::Polygon, parameters }
    }

    fn at(model: &Model, channel: usize, time: f64) -> [f64; 2] {
        let footprint = model.footprint(&Attitude::default(), channel, time, 0.0);
        [footprint.x, footprint.y]
    }

    fn is_near(found: [f64; 2], expected: [f64; 2]) -> bool {
        found.iter().zip(expected).all(|(found, expected)| (found - expected).abs() < 1e-6)
    }

    #[test]
    fn the_beam_moves_to_the_right_and_with_the_platform() {
        let model = northward();
        assert!(is_near(at(&model, 0, 0.0), [10.0, 20.0]));
        // A sixth of a line later: 10 degrees to the right.
        let time = 1.0 / 600.0;
        let footprint = model.footprint(&Attitude::default(), 0, time, 0.0);
        assert!((footprint.angle - radians(10.0)).abs() < 1e-9, "{}", footprint.angle);
        let expected = [10.0 + 1000.0 * libm::tan(radians(10.0)), 20.0 + 50.0 * time];
        assert!(is_near(at(&model, 0, time), expected));
    }

    #[test]
    fn roll_moves_the_beam_to_the_left_and_pitch_moves_it_forward() {
        let tangent = libm::tan(0.01);
        let mut rolled = northward();
        rolled.parameters.roll = 0.01;
        assert!(is_near(at(&rolled, 0, 0.0), [10.0 - 1000.0 * tangent, 20.0]), "{:?}", at(&rolled, 0, 0.0));
        let pitched = Attitude { pitch: 0.01, ..Attitude::default() };
        let footprint = northward().footprint(&pitched, 0, 0.0, 0.0);
        assert!(is_near([footprint.x, footprint.y], [10.0, 20.0 + 1000.0 * tangent]), "{footprint:?}");
    }

    #[test]
    fn channels_that_a_model_does_not_have_are_its_last() {
        let mut model = northward();
        let second = Channel { pitch: 0.02, sense: -1.0, ..model.parameters.channels[0] };
        model.parameters.channels.push(second);
        assert_eq!(at(&model, 1, 0.003), at(&model, 7, 0.003));
        assert_ne!(at(&model, 0, 0.003), at(&model, 1, 0.003));
    }

    #[test]
    fn facets_tilt_lines_in_turn() {
        let mut model = northward();
        model.parameters.facet_tilts = vec![0.0, 0.01];
        assert_eq!(model.facets(), 2);
        let ahead = |line: f64| at(&model, 0, 0.01 * line)[1] - 20.0 - 0.5 * line;
        assert!(ahead(0.0).abs() < 1e-6 && ahead(2.0).abs() < 1e-6);
        assert!((ahead(1.0) - 1000.0 * libm::tan(0.01)).abs() < 1e-6, "{}", ahead(1.0));
    }

    #[test]
    fn prepared_models_have_the_same_footprints_to_the_bit() {
        let mut model = northward();
        let second = Channel { yaw: -0.2, pitch: 0.02, sense: -1.0, ..model.parameters.channels[0] };
        model.parameters.channels.push(second);
        let attitude = Attitude { roll: 0.01, pitch: -0.02, yaw: 0.03 };
        for tilts in [vec![], vec![0.0, 0.01, -0.02]] {
            model.parameters.facet_tilts = tilts;
            let prepared = Prepared::of(&model);
            let posed = prepared.at(&attitude);
            for (channel, time) in [(0, 0.0), (1, 0.0123), (1, 0.0456), (7, -0.3)] {
                let expected = model.footprint(&attitude, channel, time, 3.0);
                let found = posed.footprint(posed.beam(channel, time), time, 3.0);
                let bits = |at: Footprint| [at.x, at.y, at.angle].map(f64::to_bits);
                assert_eq!(bits(found), bits(expected), "{channel} {time}");
            }
        }
    }

    #[test]
    fn only_mirror_channels_and_facets_change_the_beams_of_the_scanner() {
        let model = northward();
        let has_beams = |change: &dyn Fn(&mut Parameters)| {
            let mut other = model.clone();
            change(&mut other.parameters);
            Prepared::of(&other).has_beams_of(&Prepared::of(&model))
        };
        assert!(has_beams(&|p| (p.position.x, p.velocity.y, p.roll, p.mirror.yaw) = (3.0, 49.0, 0.1, 0.2)));
        assert!(!has_beams(&|p| p.mirror.angle += 1e-7));
        assert!(!has_beams(&|p| p.mirror.rate += 1e-7));
        assert!(!has_beams(&|p| p.channels[0].phase += 1e-7));
        assert!(!has_beams(&|p| p.facet_tilts.push(0.1)));
    }
}
