//! First guess of lines across the flight, of one channel or of several whose lines have different
//! directions.

use super::level::{Track, level, line_on_ground, sampled_pulses};
use super::mirror::{Mirror, MirrorParameters};
use super::model::{MAX_CHANNELS, Model};
use super::parameters::{Channel, Parameters};
use super::phases::{PhaseSample, StraightLine, coherence, line_rate, wrapped};
use super::pulses::Pulse;
use super::recording::Recording;
use libm::{atan2, cos, sin, tan};
use std::f64::consts::{PI, TAU};
use std::ops::Range;
use vlscan_geom::{DVec2, LeastSquares, median};

/// Minimum number of pulses of a line whose direction is used.
pub const MIN_PULSES: usize = 12;
/// Minimum number of pulses of a line that counts for the mean direction of its channel.
const MIN_AXIS_PULSES: usize = 8;
/// Lines whose directions differ by less are of one channel, rad.
const SAME: f64 = 0.07;
/// Minimum share of the lines that makes a channel.
const MIN_SHARE: f64 = 0.1;
/// Number of lines that are tried as the direction of a channel.
const MAX_TRIALS: usize = 200;
/// First guess of the share of a sweep in which a mirror reverses.
const FIRST_TURNING: f64 = 0.3;
/// Lines of a mirror go to and fro if those of one sense are at most this many times as many as the others.
const MAX_RATIO: usize = 5;

/// Direction of a line, seen from above.
#[derive(Clone, Copy)]
struct Direction {
    /// Angle from east, rad.
    axis: f64,
    /// Number of the channel in the file.
    file_channel: u16,
}

impl Direction {
    fn is_alike(&self, other: &Direction) -> bool {
        self.file_channel == other.file_channel && turn(self.axis, other.axis).abs() < SAME
    }

    /// Difference from another direction, rad; more than any angle for other channels of the file.
    fn distance(&self, other: &Direction) -> f64 {
        let of_file = if self.file_channel == other.file_channel { 0.0 } else { TAU };
        turn(self.axis, other.axis).abs() + of_file
    }
}

/// Finds the channels by the directions of their lines and gives each pulse the number of its channel. Two
/// channels that record at the same time are separate only if the file numbers them.
pub fn find_channels(recording: &mut Recording) {
    // Middle of each line in time, and its direction.
    let long = recording.lines.iter().filter(|line| line.len() >= MIN_PULSES);
    let lines: Vec<(f64, Direction)> =
        long.map(|line| (middle(recording, line).time, direction(recording, line))).collect();
    let channels = channel_directions(lines.iter().map(|(_, direction)| *direction).collect());
    recording.channels = channels.len().max(1);
    if channels.len() < 2 {
        return;
    }
    let nearest = |line: &Direction| {
        let distance = |channel: &usize| channels[*channel].distance(line);
        (0..channels.len()).min_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap_or(0)
    };
    for line in recording.lines.clone() {
        let middle = middle(recording, &line);
        let number = if line.len() >= MIN_PULSES {
            nearest(&direction(recording, &line))
        } else {
            // Short ones are of the channel that records at that time.
            let same = lines.iter().filter(|(_, direction)| direction.file_channel == middle.file_channel);
            let interval = |line: &(f64, Direction)| (line.0 - middle.time).abs();
            let near = same.min_by(|a, b| interval(a).total_cmp(&interval(b)));
            near.map_or(0, |(_, direction)| nearest(direction))
        };
        recording.pulses.set_channel(line, number as u8);
    }
}

/// Directions of the lines of channels, those of most lines first.
fn channel_directions(mut lines: Vec<Direction>) -> Vec<Direction> {
    let min_lines = MIN_SHARE * lines.len() as f64;
    let mut channels = Vec::new();
    while channels.len() < MAX_CHANNELS && lines.len() as f64 > min_lines {
        // The line that most others resemble.
        let step = lines.len().div_ceil(MAX_TRIALS);
        let alike = |line: &Direction| lines.iter().filter(|other| other.is_alike(line)).count();
        let Some(best) = lines.iter().step_by(step).max_by_key(|line| alike(line)).copied() else { break };
        if (alike(&best) as f64) < min_lines {
            break;
        }
        let same = lines.iter().filter(|line| line.is_alike(&best));
        let shift = median(same.map(|line| turn(line.axis, best.axis))).unwrap_or(0.0);
        channels.push(Direction { axis: best.axis + shift, ..best });
        lines.retain(|line| !line.is_alike(&best));
    }
    channels
}

/// Pulse in the middle of a line.
fn middle(recording: &Recording, line: &Range<usize>) -> Pulse {
    recording.pulses.get((line.start + line.end) / 2)
}

/// Direction in which the beam moves on the ground along a line.
fn direction(recording: &Recording, line: &Range<usize>) -> Direction {
    let [x, y] = line_on_ground(&recording.pulses, line);
    Direction { axis: atan2(y.slope, x.slope), file_channel: middle(recording, line).file_channel }
}

/// Turn from direction `b` to `a`, whatever their senses, from −π/2 to π/2.
fn turn(a: f64, b: f64) -> f64 {
    let turn = a - b;
    turn - PI * (turn / PI).round()
}

/// Lines of a channel.
struct ChannelLines {
    /// Direction of the lines, unit vector, to the right of the flight.
    along: DVec2,
    /// Turn of the lines from across the flight, to the right, rad.
    yaw: f64,
    /// Times at which lines that go to the right look straight down, s.
    to_right: Vec<f64>,
    /// Times at which lines that go to the left look straight down, s.
    to_left: Vec<f64>,
}

impl ChannelLines {
    fn new(axis: f64, track: &Track) -> ChannelLines {
        let along = DVec2::new(cos(axis), sin(axis));
        let along = if along.dot(track.right()) < 0.0 { -along } else { along };
        let yaw = atan2(-along.dot(track.forward()), along.dot(track.right()));
        ChannelLines { along, yaw, to_right: Vec::new(), to_left: Vec::new() }
    }

    fn is_to_and_fro(&self) -> bool {
        let (right, left) = (self.to_right.len(), self.to_left.len());
        right.min(left) * MAX_RATIO > right.max(left)
    }

    /// 1 if most lines go to the right, −1 otherwise.
    fn sense(&self) -> f64 {
        if self.to_right.len() > self.to_left.len() { 1.0 } else { -1.0 }
    }

    /// Times of the lines that go in the sense of most.
    fn crossings(&self) -> &[f64] {
        if self.sense() > 0.0 { &self.to_right } else { &self.to_left }
    }
}

/// Parallel lines of each of `channels` channels.
pub fn guess(recording: &Recording, mirror: Mirror, channels: usize) -> Option<Model> {
    let number = |pulse: &Pulse| usize::from(pulse.channel).min(channels - 1);
    let sampled = sampled_pulses(recording);
    let mut pulses = vec![Vec::new(); channels];
    for pulse in sampled.iter().map(|i| recording.pulses.get(*i)) {
        pulses[number(&pulse)].push(pulse);
    }
    let axes: Vec<f64> =
        (0..channels).map(|channel| axis(recording, |pulse| number(pulse) == channel)).collect();
    let velocity = velocity_from_lines(&axes, &pulses)?;
    let level = level(recording, &sampled, &Track { start: DVec2::ZERO, velocity })?;
    let (track, mut lines) = assemble(&axes, &pulses, velocity, level.across);
    let mut speeds = Vec::new();
    for line in recording.lines.iter().filter(|line| line.len() >= MIN_PULSES) {
        let channel = &mut lines[number(&recording.pulses.get(line.start))];
        let crossing = crossing(recording, line, &track, channel.along, level.height);
        let Some(Crossing { time, speed }) = crossing else { continue };
        if speed > 0.0 {
            channel.to_right.push(time)
        } else {
            channel.to_left.push(time)
        }
        speeds.push(speed.abs());
    }
    let speed = median(speeds).unwrap_or(0.0);
    let (mut parameters, channels) = mirror_from_angles(mirror, &lines, speed)?;
    if matches!(mirror, Mirror::Turning | Mirror::Sine) {
        // The mean speed of a sweep is below that in its middle.
        let angles = recording.pulses.angles().map(f64::abs);
        parameters.angle = parameters.angle.max(angles.fold(0.0, f64::max));
    }
    let mut parameters = Parameters {
        position: track.start.extend(level.height),
        velocity: velocity.extend(0.0),
        mirror: parameters,
        channels,
        ..Parameters::default()
    };
    if parameters.channels.len() > 1 {
        parameters.balance_channels();
    }
    Some(Model { mirror, parameters })
}

/// Velocity of the platform by the lines of channels with these directions: lines advance at right angles to
/// their direction with the share of the velocity in that direction. `None` if the lines of all channels are
/// parallel.
fn velocity_from_lines(axes: &[f64], pulses: &[Vec<Pulse>]) -> Option<DVec2> {
    let mut sums = LeastSquares::new(2);
    let mut advance = DVec2::ZERO;
    for (axis, pulses) in axes.iter().zip(pulses) {
        let normal = DVec2::new(-sin(*axis), cos(*axis));
        let times: Vec<f64> = pulses.iter().map(|pulse| pulse.time).collect();
        let places: Vec<f64> = pulses.iter().map(|pulse| pulse.position.truncate().dot(normal)).collect();
        let speed = StraightLine::through(&times, &places).slope;
        advance = speed * normal;
        sums.add(&normal.to_array(), speed, 1.0);
    }
    // The lines of one channel are across the flight.
    if axes.len() == 1 { Some(advance) } else { Some(DVec2::from_slice(&sums.solution()?)) }
}

/// Track of the platform, and its channels without the times of their lines. Where the platform is along the
/// flight at time 0 follows from the positions of the lines.
fn assemble(axes: &[f64], pulses: &[Vec<Pulse>], velocity: DVec2, across: f64) -> (Track, Vec<ChannelLines>) {
    let track = Track { start: DVec2::ZERO, velocity };
    let (forward, right) = (track.forward(), track.right());
    let lines: Vec<ChannelLines> = axes.iter().map(|axis| ChannelLines::new(*axis, &track)).collect();
    let starts = lines.iter().zip(pulses).map(|(lines, pulses)| {
        let ahead = pulses.iter().map(|pulse| {
            let offset = track.offset(pulse.position, pulse.time);
            offset.dot(forward) + (offset.dot(right) - across) * tan(lines.yaw)
        });
        median(ahead).unwrap_or(0.0)
    });
    let ahead = starts.sum::<f64>() / axes.len() as f64;
    (Track { start: ahead * forward + across * right, velocity }, lines)
}

/// Parameters of the mirror and its channels, by the times at which their lines look straight down and the
/// speed of their angles, rad/s. `None` if the lines are not those of this kind of mirror.
fn mirror_from_angles(
    mirror: Mirror,
    lines: &[ChannelLines],
    speed: f64,
) -> Option<(MirrorParameters, Vec<Channel>)> {
    match mirror {
        Mirror::Polygon if !lines.iter().any(ChannelLines::is_to_and_fro) => polygon(lines, speed),
        Mirror::Oscillating | Mirror::Turning | Mirror::Sine if lines[0].is_to_and_fro() => {
            let swing = line_rate(&lines[0].to_right, 1.0)?;
            let (way, turning) = match mirror {
                Mirror::Sine => (TAU, 0.0),
                Mirror::Turning => (4.0 / (1.0 - 0.5 * FIRST_TURNING), FIRST_TURNING),
                _ => (4.0, 0.0),
            };
            let angle = speed / (way * swing.rate);
            let mirror = MirrorParameters { angle, rate: swing.rate, turning, ..MirrorParameters::default() };
            let phase = wrapped(0.25 * TAU + swing.phase);
            Some((mirror, vec![Channel { phase, ..Channel::default() }]))
        }
        _ => None,
    }
}

fn polygon(lines: &[ChannelLines], speed: f64) -> Option<(MirrorParameters, Vec<Channel>)> {
    let most = lines.iter().max_by_key(|channel| channel.crossings().len())?;
    let rate = line_rate(most.crossings(), 1.0)?.rate;
    let sense = lines[0].sense();
    let mean_yaw = lines.iter().map(|channel| channel.yaw).sum::<f64>() / lines.len() as f64;
    // A yaw of the scanner is not visible in the lines of one channel.
    let yaw = if lines.len() > 1 { mean_yaw } else { 0.0 };
    let mirror = MirrorParameters { angle: sense * speed / rate, rate, yaw, ..MirrorParameters::default() };
    let channel = |channel: &ChannelLines| Channel {
        // The angle is 0 in the middle of a line.
        phase: wrapped(0.5 * TAU + coherence(&PhaseSample::zeros(channel.crossings()), rate).phase),
        yaw: channel.yaw - mean_yaw,
        pitch: 0.0,
        sense: channel.sense() * sense,
    };
    Some((mirror, lines.iter().map(channel).collect()))
}

/// Time at which a line looks straight down, and the speed of its angle.
pub struct Crossing {
    /// s.
    pub time: f64,
    /// rad/s.
    pub speed: f64,
}

/// The crossing of a line in the direction `along` from a platform on `track` at `height`; `None` if its
/// angle does not change.
pub fn crossing(
    recording: &Recording,
    line: &Range<usize>,
    track: &Track,
    along: DVec2,
    height: f64,
) -> Option<Crossing> {
    let first = recording.pulses.time(line.start);
    let angle = |pulse: Pulse| {
        let offset = track.offset(pulse.position, pulse.time);
        (pulse.time - first, atan2(offset.dot(along), height - pulse.position.z))
    };
    let angles: Vec<(f64, f64)> = recording.pulses.range(line.clone()).map(angle).collect();
    let angle = StraightLine::through_points(angles.iter().copied());
    (angle.slope != 0.0 && angle.slope.is_finite())
        .then(|| Crossing { time: first - angle.start / angle.slope, speed: angle.slope })
}

/// Main axis of the pulses of a channel about the centres of their lines: its angle from east.
fn axis(recording: &Recording, is_of_channel: impl Fn(&Pulse) -> bool) -> f64 {
    let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
    let pulses = &recording.pulses;
    let is_used =
        |line: &&Range<usize>| line.len() >= MIN_AXIS_PULSES && is_of_channel(&pulses.get(line.start));
    for line in recording.lines.iter().filter(is_used) {
        let places = line.clone().map(|i| pulses.position(i).truncate());
        let mean = places.clone().sum::<DVec2>() / line.len() as f64;
        for place in places {
            let DVec2 { x, y } = place - mean;
            (xx, xy, yy) = (xx + x * x, xy + x * y, yy + y * y);
        }
    }
    0.5 * atan2(2.0 * xy, xx - yy)
}

#[cfg(test)]
mod tests {
    use super::*;
    use vlscan_geom::{DVec3, radians};

    /// Pulses at 1000 m over flat ground with lines of `turned` rad from across a flight to the north at 50
    /// m/s: 100 lines a second, each of 40 degrees, from left to right or every second one back.
    fn recorded(turned: &[f64], is_to_and_fro: bool) -> Recording {
        let mut pulses = Vec::new();
        for (number, turned) in (0u16..).zip(turned) {
            let along = DVec2::new(cos(*turned), -sin(*turned));
            for k in 0..20_000 {
                let time = 2e-5 * f64::from(k);
                let (line, part) = (k / 500, f64::from(k % 500) / 499.0 - 0.5);
                // Ends of the lines are beyond the cloud.
                if part.abs() > 0.35 {
                    continue;
                }
                let sense = if is_to_and_fro && line % 2 == 1 { -1.0 } else { 1.0 };
                let angle = sense * radians(40.0) * part;
                let place = DVec2::new(0.0, 50.0 * time) + 1000.0 * tan(angle) * along;
                pulses.push(Pulse {
                    time,
                    position: DVec3::new(place.x, place.y, 0.0),
                    angle: libm::atan(place.x / 1000.0),
                    returns: 1,
                    class: 2,
                    last: None,
                    file_channel: number,
                    channel: 0,
                });
            }
        }
        let mut recording = Recording::new(pulses).unwrap();
        find_channels(&mut recording);
        recording
    }

    fn is_near(value: f64, expected: f64, share: f64) -> bool {
        (value / expected - 1.0).abs() < share
    }

    #[test]
    fn lines_of_one_direction_are_those_of_a_polygon_mirror() {
        let recording = recorded(&[0.0], false);
        assert_eq!(recording.channels, 1);
        assert!(guess(&recording, Mirror::Oscillating, 1).is_none());
        let parameters = guess(&recording, Mirror::Polygon, 1).unwrap().parameters;
        assert!(is_near(parameters.velocity.length(), 50.0, 0.05), "{parameters:?}");
        assert!(is_near(parameters.position.z, 1000.0, 0.01), "{parameters:?}");
        assert!(is_near(parameters.mirror.rate, 100.0, 0.001), "{parameters:?}");
        assert!(is_near(parameters.mirror.angle, radians(40.0), 0.02), "{parameters:?}");
    }

    #[test]
    fn lines_to_and_fro_are_those_of_an_oscillating_mirror() {
        let recording = recorded(&[0.0], true);
        assert!(guess(&recording, Mirror::Polygon, 1).is_none());
        let parameters = guess(&recording, Mirror::Oscillating, 1).unwrap().parameters;
        assert!(is_near(parameters.mirror.rate, 50.0, 0.001), "{parameters:?}");
        assert!(is_near(parameters.mirror.angle, radians(20.0), 0.02), "{parameters:?}");
    }

    #[test]
    fn channels_are_told_apart_by_the_directions_of_their_lines() {
        let recording = recorded(&[0.25, -0.25], false);
        assert_eq!(recording.channels, 2);
        let parameters = guess(&recording, Mirror::Polygon, 2).unwrap().parameters;
        let yaws: Vec<f64> = parameters.channels.iter().map(|channel| channel.yaw).collect();
        let sum = yaws[0] + yaws[1];
        assert!(sum.abs() < 1e-12 && is_near(yaws[0].abs(), 0.25, 0.05), "{yaws:?}");
        assert!(is_near(parameters.velocity.y, 50.0, 0.05), "{parameters:?}");
    }
}
