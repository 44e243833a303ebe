//! First guess of lines across the flight, of one channel or of several whose lines have different
//! directions.

use super::guess::{chosen, coherence, height, line_rate, slope, wrapped};
use super::mirror::Mirror;
use super::model::{MAX_CHANNELS, MAX_PARAMETERS, Model, PLATFORM_PARAMETERS};
use super::recording::{Pulse, Recording, median};
use libm::{atan2, cos, hypot, sin, tan};
use std::f64::consts::{PI, TAU};
use std::ops::Range;

/// Lines of fewer pulses have no direction.
pub const MIN_PULSES: usize = 12;
/// Lines whose directions differ by less are of one channel, rad.
const SAME: f64 = 0.07;
/// Smaller shares of the lines are no channel.
const MIN_SHARE: f64 = 0.1;

/// Finds the channels by the directions of their lines and gives each pulse the number of its channel. Two
/// channels that record at the same time are separate only if the file numbers them.
pub fn find_channels(recording: &mut Recording) {
    // Middle of each line in time, its direction, and the number of its channel in the file.
    let mut lines = Vec::new();
    for line in recording.lines.iter().filter(|line| line.len() >= MIN_PULSES) {
        let (_, axis) = motion(recording, line.clone());
        let middle = &recording.pulses[(line.start + line.end) / 2];
        lines.push((middle.time, axis, middle.file_channel));
    }
    let mut axes: Vec<(f64, u16)> = Vec::new();
    let is_of =
        |line: &(f64, f64, u16), axis: &(f64, u16)| turn(line.1, axis.0).abs() < SAME && line.2 == axis.1;
    let mut rest = lines.clone();
    while axes.len() < MAX_CHANNELS && rest.len() as f64 > MIN_SHARE * lines.len() as f64 {
        // The line that most others resemble.
        let step = rest.len().div_ceil(200);
        let alike =
            |line: &(f64, f64, u16)| rest.iter().filter(|other| is_of(other, &(line.1, line.2))).count();
        let Some(best) = rest.iter().step_by(step).max_by_key(|line| alike(line)).copied() else { break };
        if (alike(&best) as f64) < MIN_SHARE * lines.len() as f64 {
            break;
        }
        let turns =
            rest.iter().filter(|line| is_of(line, &(best.1, best.2))).map(|line| turn(line.1, best.1));
        axes.push((best.1 + median(turns.collect()), best.2));
        rest.retain(|line| !is_of(line, &(best.1, best.2)));
    }
    recording.channels = axes.len().max(1);
    if axes.len() < 2 {
        return;
    }
    let channel_of = |line: &(f64, f64, u16)| {
        let distance =
            |axis: &(f64, u16)| turn(line.1, axis.0).abs() + if line.2 == axis.1 { 0.0 } else { TAU };
        (0..axes.len()).min_by(|a, b| distance(&axes[*a]).total_cmp(&distance(&axes[*b]))).unwrap_or(0)
    };
    for line in recording.lines.clone() {
        let middle = recording.pulses[(line.start + line.end) / 2];
        let number = match line.len() >= MIN_PULSES {
            true => channel_of(&(middle.time, motion(recording, line.clone()).1, middle.file_channel)),
            // Short ones are of the channel that records at that time.
            false => {
                let alike = lines.iter().filter(|other| other.2 == middle.file_channel);
                let near =
                    alike.min_by(|a, b| (a.0 - middle.time).abs().total_cmp(&(b.0 - middle.time).abs()));
                near.map_or(0, channel_of)
            }
        };
        recording.pulses[line].iter_mut().for_each(|pulse| pulse.channel = number as u8);
    }
}

/// Velocity of the beam on the ground along a line, m/s, and the angle of its direction from east, rad.
fn motion(recording: &Recording, line: Range<usize>) -> ((f64, f64), f64) {
    let pulses = &recording.pulses[line];
    let times: Vec<f64> = pulses.iter().map(|pulse| pulse.time - pulses[0].time).collect();
    let x = slope(&times, &pulses.iter().map(|pulse| pulse.position.x).collect::<Vec<_>>()).0;
    let y = slope(&times, &pulses.iter().map(|pulse| pulse.position.y).collect::<Vec<_>>()).0;
    ((x, y), atan2(y, x))
}

/// Turn from direction `b` to `a`, whatever their senses, from −π/2 to π/2.
fn turn(a: f64, b: f64) -> f64 {
    let turn = a - b;
    turn - PI * (turn / PI).round()
}

/// Lines of a channel.
struct Channel {
    /// Their direction, unit vector, to the right of the flight.
    along: (f64, f64),
    /// Times at which they look straight down, by the sense of their motion.
    rising: Vec<f64>,
    falling: Vec<f64>,
}

/// Parallel lines of each of `channels` channels.
pub fn guess(recording: &Recording, mirror: Mirror, channels: usize) -> Option<Model> {
    let chosen = chosen(recording);
    let number = |i: usize| usize::from(recording.pulses[i].channel).min(channels - 1);
    let axes: Vec<f64> = (0..channels).map(|channel| axis(recording, channel, channels)).collect();
    // Lines advance at right angles to their direction with the share of the velocity in that direction.
    let (mut xx, mut xy, mut yy, mut x, mut y) = (0.0, 0.0, 0.0, 0.0, 0.0);
    for (channel, axis) in axes.iter().enumerate() {
        let normal = (-sin(*axis), cos(*axis));
        let of_channel = chosen.iter().filter(|i| number(**i) == channel).map(|i| &recording.pulses[*i]);
        let (times, places): (Vec<f64>, Vec<f64>) = of_channel
            .map(|pulse| (pulse.time, pulse.position.x * normal.0 + pulse.position.y * normal.1))
            .unzip();
        let speed = slope(&times, &places).0;
        (xx, xy, yy) = (xx + normal.0 * normal.0, xy + normal.0 * normal.1, yy + normal.1 * normal.1);
        (x, y) = (x + speed * normal.0, y + speed * normal.1);
    }
    let velocity = match channels {
        1 => (x, y),
        _ => ((x * yy - y * xy) / (xx * yy - xy * xy), (y * xx - x * xy) / (xx * yy - xy * xy)),
    };
    let speed = hypot(velocity.0, velocity.1);
    let course = atan2(velocity.0, velocity.1);
    let (forward, right) = ((sin(course), cos(course)), (cos(course), -sin(course)));
    let (height, across) = height(recording, &chosen, course, (0.0, 0.0), velocity)?;
    let mut found = Vec::new();
    let mut starts = Vec::new();
    for (channel, axis) in axes.iter().enumerate() {
        let to_right = if cos(*axis) * right.0 + sin(*axis) * right.1 < 0.0 { -1.0 } else { 1.0 };
        let along = (to_right * cos(*axis), to_right * sin(*axis));
        // Where the platform is at time 0 along the flight, by the place of these lines.
        let yaw = yaw(along, forward, right);
        let places = chosen.iter().filter(|i| number(**i) == channel).map(|i| {
            let (pulse, time) = (&recording.pulses[*i], recording.pulses[*i].time);
            let side = pulse.position.x * right.0 + pulse.position.y * right.1 - across;
            pulse.position.x * forward.0 + pulse.position.y * forward.1 - speed * time + side * tan(yaw)
        });
        starts.push(median(places.collect()));
        found.push(Channel { along, rising: Vec::new(), falling: Vec::new() });
    }
    let start = starts.iter().sum::<f64>() / channels as f64;
    let centre = (start * forward.0 + across * right.0, start * forward.1 + across * right.1);
    let mut rates = Vec::new();
    for line in recording.lines.iter().filter(|line| line.len() >= MIN_PULSES) {
        let channel = &mut found[number(line.start)];
        let found = crossing(recording, line.clone(), centre, velocity, channel.along, height);
        let Some(Crossing { time, rate }) = found else { continue };
        if rate > 0.0 {
            channel.rising.push(time)
        } else {
            channel.falling.push(time)
        }
        rates.push(rate.abs());
    }
    let mut model = Model::new(mirror, [0.0; MAX_PARAMETERS]);
    let parameters = &mut model.parameters;
    (parameters[0], parameters[1]) = centre;
    (parameters[2], parameters[3]) = velocity;
    parameters[6] = height;
    let speed_of_angle = median(rates);
    let is_both = |channel: &Channel| {
        let (rising, falling) = (channel.rising.len(), channel.falling.len());
        rising.min(falling) * 5 > rising.max(falling)
    };
    let of_mirror = &mut parameters[PLATFORM_PARAMETERS..];
    match mirror {
        Mirror::Polygon if !found.iter().any(is_both) => {
            let sense =
                |channel: &Channel| if channel.rising.len() > channel.falling.len() { 1.0 } else { -1.0 };
            let crossings = |channel: &Channel| match channel.rising.len() > channel.falling.len() {
                true => channel.rising.clone(),
                false => channel.falling.clone(),
            };
            let most = found.iter().max_by_key(|channel| channel.rising.len().max(channel.falling.len()))?;
            let (frequency, _) = line_rate(&crossings(most), 1.0)?;
            of_mirror[0] = sense(&found[0]) * speed_of_angle / frequency;
            of_mirror[1] = frequency;
            // What the channels have in common is the scanner's.
            let yaws: Vec<f64> = found.iter().map(|channel| yaw(channel.along, forward, right)).collect();
            let common = match channels {
                1 => 0.0,
                _ => yaws.iter().sum::<f64>() / channels as f64,
            };
            of_mirror[3] = common;
            model.senses = found.iter().map(|channel| sense(channel) * sense(&found[0])).collect();
            for (number, channel) in found.iter().enumerate() {
                let samples: Vec<(f64, f64)> = crossings(channel).iter().map(|time| (*time, 0.0)).collect();
                // The angle is 0 in the middle of a line.
                let phase = wrapped(0.5 * TAU + coherence(&samples, frequency).1);
                model.set_channel(number, phase, yaws[number] - common, 0.0);
            }
        }
        Mirror::Oscillating if is_both(&found[0]) => {
            let (frequency, offset) = line_rate(&found[0].rising, 1.0)?;
            of_mirror[0] = speed_of_angle / (4.0 * frequency);
            of_mirror[1] = frequency;
            of_mirror[2] = wrapped(0.25 * TAU + offset);
        }
        _ => return None,
    }
    Some(model)
}

/// When a line looks straight down, s, and the speed of its angle, rad/s.
pub struct Crossing {
    pub time: f64,
    pub rate: f64,
}

/// The crossing of a line in the direction `along` from a platform at `centre` at time 0 and at `height`;
/// `None` if its angle does not change.
pub fn crossing(
    recording: &Recording,
    line: Range<usize>,
    centre: (f64, f64),
    velocity: (f64, f64),
    along: (f64, f64),
    height: f64,
) -> Option<Crossing> {
    let pulses = &recording.pulses[line];
    let angle = |pulse: &Pulse| {
        let x = pulse.position.x - centre.0 - velocity.0 * pulse.time;
        let y = pulse.position.y - centre.1 - velocity.1 * pulse.time;
        (pulse.time - pulses[0].time, atan2(x * along.0 + y * along.1, height - pulse.position.z))
    };
    let (times, angles): (Vec<f64>, Vec<f64>) = pulses.iter().map(angle).unzip();
    let (rate, first) = slope(&times, &angles);
    (rate != 0.0 && rate.is_finite()).then(|| Crossing { time: pulses[0].time - first / rate, rate })
}

/// Turn of lines in the direction `along` from across the flight, to the right.
fn yaw(along: (f64, f64), forward: (f64, f64), right: (f64, f64)) -> f64 {
    let (x, y) = (along.0 * right.0 + along.1 * right.1, along.0 * forward.0 + along.1 * forward.1);
    atan2(-y, x)
}

/// Main axis of the pulses of a channel about the centres of their lines: its angle from east.
fn axis(recording: &Recording, channel: usize, channels: usize) -> f64 {
    let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
    for line in recording.lines.iter().filter(|line| line.len() >= 8) {
        let pulses = &recording.pulses[line.clone()];
        if usize::from(pulses[0].channel).min(channels - 1) != channel {
            continue;
        }
        let count = pulses.len() as f64;
        let mx = pulses.iter().map(|pulse| pulse.position.x).sum::<f64>() / count;
        let my = pulses.iter().map(|pulse| pulse.position.y).sum::<f64>() / count;
        for pulse in pulses {
            let (x, y) = (pulse.position.x - mx, pulse.position.y - my);
            (xx, xy, yy) = (xx + x * x, xy + x * y, yy + y * y);
        }
    }
    0.5 * atan2(2.0 * xy, xx - yy)
}
