//! The pulses of a flight line, in columns: 24 bytes for one of a single return in a file of LAS, 36 for one
//! of several.

use crate::columns::{Angles, Places, shorten};
use crate::marks::Marks;
use std::ops::Range;
use vlscan_geom::DVec3;

/// A pulse with at least one return.
#[derive(Clone, Copy, Debug)]
pub struct Pulse {
    /// s after [`Recording::start`](super::Recording::start).
    pub time: f64,
    /// Position of its first return, m, relative to [`Recording::origin`](super::Recording::origin).
    pub position: DVec3,
    /// Scan angle, rad, positive to the right of the flight.
    pub angle: f64,
    /// Number of its returns.
    pub returns: u8,
    /// Class of its first return.
    pub class: u8,
    /// Position of its last return, if it has several.
    pub last: Option<DVec3>,
    /// Number of its channel in the file.
    pub file_channel: u16,
    /// Number of its channel by the directions of lines, from 0.
    pub channel: u8,
}

#[cfg(test)]
impl Pulse {
    /// A pulse of the only channel with one return, which is from the ground.
    pub fn on_ground(time: f64, position: DVec3, angle: f64) -> Pulse {
        Pulse { time, position, angle, returns: 1, class: 2, last: None, file_channel: 0, channel: 0 }
    }
}

/// Pulses in the order of their channel of the file, then of time; no two of a channel have the same time.
#[derive(Clone, Debug, Default)]
pub struct Pulses {
    /// Subtracted from places, m.
    origin: DVec3,
    times: Vec<f64>,
    /// Of each pulse the position of its first return and, if it has several, of its last one.
    places: Places,
    has_last: Marks,
    /// rad.
    angles: Angles,
    returns: Vec<u8>,
    classes: Vec<u8>,
    /// The first pulse of each channel of the file, and the number of the channel.
    file_channels: Vec<(usize, u16)>,
    /// Channels by the directions of lines; empty as long as all are 0.
    channels: Vec<u8>,
}

/// The treatment of a pulse.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Treatment {
    Keep,
    /// Keeps the pulse without its last return.
    LeaveOutLast,
    LeaveOut,
}

/// Columns of pulses whose places relative to `origin` are theirs.
pub(super) struct PulseColumns {
    pub origin: DVec3,
    pub times: Vec<f64>,
    pub places: Places,
    pub has_last: Marks,
    pub angles: Angles,
    pub returns: Vec<u8>,
    pub classes: Vec<u8>,
    pub file_channels: Vec<(usize, u16)>,
}

impl From<PulseColumns> for Pulses {
    fn from(columns: PulseColumns) -> Pulses {
        let PulseColumns { origin, times, places, has_last, angles, returns, classes, file_channels } =
            columns;
        let channels = Vec::new();
        Pulses { origin, times, places, has_last, angles, returns, classes, file_channels, channels }
    }
}

impl FromIterator<Pulse> for Pulses {
    /// Takes pulses in the order of [`Pulses`].
    fn from_iter<I: IntoIterator<Item = Pulse>>(pulses: I) -> Pulses {
        let mut all = Pulses::default();
        pulses.into_iter().for_each(|pulse| all.push(&pulse));
        all
    }
}

impl Pulses {
    /// Adds a pulse to those at the origin of coordinates.
    fn push(&mut self, pulse: &Pulse) {
        let number = self.len();
        if self.file_channels.last().is_none_or(|(_, channel)| *channel != pulse.file_channel) {
            self.file_channels.push((number, pulse.file_channel));
        }
        if pulse.channel != 0 && self.channels.is_empty() {
            self.channels = vec![0; number];
        }
        if pulse.channel != 0 || !self.channels.is_empty() {
            self.channels.push(pulse.channel);
        }
        self.times.push(pulse.time);
        self.places.push(pulse.position);
        pulse.last.into_iter().for_each(|last| self.places.push(last));
        self.has_last.push(pulse.last.is_some());
        self.angles.push(pulse.angle);
        self.returns.push(pulse.returns);
        self.classes.push(pulse.class);
    }

    /// Number of pulses.
    pub fn len(&self) -> usize {
        self.times.len()
    }

    /// True without pulses.
    pub fn is_empty(&self) -> bool {
        self.times.is_empty()
    }

    /// The pulse of an index below their number.
    pub fn get(&self, i: usize) -> Pulse {
        let place = i + self.has_last.before(i);
        Pulse {
            time: self.times[i],
            position: self.places.get(place) - self.origin,
            angle: self.angles.get(i),
            returns: self.returns[i],
            class: self.classes[i],
            last: self.has_last.has(i).then(|| self.places.get(place + 1) - self.origin),
            file_channel: self.file_channel(i),
            channel: self.channels.get(i).copied().unwrap_or(0),
        }
    }

    /// Position of the first return of a pulse, m, relative to the origin of the recording.
    pub fn position(&self, i: usize) -> DVec3 {
        self.places.get(i + self.has_last.before(i)) - self.origin
    }

    /// The time of a pulse, s.
    pub fn time(&self, i: usize) -> f64 {
        self.times[i]
    }

    /// The scan angle of a pulse, rad.
    pub fn angle(&self, i: usize) -> f64 {
        self.angles.get(i)
    }

    /// The number of a pulse's channel in the file.
    pub fn file_channel(&self, i: usize) -> u16 {
        let after = self.file_channels.partition_point(|(first, _)| *first <= i);
        after.checked_sub(1).map_or(0, |last| self.file_channels[last].1)
    }

    /// The pulses of each channel of the file.
    pub fn by_file_channel(&self) -> impl Iterator<Item = Range<usize>> {
        let ends = self.file_channels.iter().skip(1).map(|(first, _)| *first).chain([self.len()]);
        self.file_channels.iter().zip(ends).map(|((first, _), end)| *first..end)
    }

    /// All pulses.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = Pulse> + DoubleEndedIterator + Clone + '_ {
        self.range(0..self.len())
    }

    /// The pulses of a range.
    pub fn range(
        &self,
        range: Range<usize>,
    ) -> impl ExactSizeIterator<Item = Pulse> + DoubleEndedIterator + Clone + '_ {
        range.map(move |i| self.get(i))
    }

    /// The scan angles of all pulses, rad.
    pub fn angles(&self) -> impl Iterator<Item = f64> + Clone + '_ {
        (0..self.len()).map(move |i| self.angle(i))
    }

    /// The times of all pulses, s.
    pub fn times(&self) -> impl ExactSizeIterator<Item = f64> + Clone + '_ {
        self.times.iter().copied()
    }

    /// Gives the pulses of a range the number of a channel by the directions of lines.
    pub(super) fn set_channel(&mut self, range: Range<usize>, number: u8) {
        if self.channels.is_empty() {
            self.channels = vec![0; self.len()];
        }
        self.channels[range].fill(number);
    }

    /// Reverses the sign of all scan angles.
    pub(super) fn reverse_angles(&mut self) {
        self.angles.change(|angle| -angle);
    }

    /// Treats each pulse, by its index, in the order of indices.
    pub(super) fn treat(&mut self, treatment: impl Fn(usize) -> Treatment) {
        let mut file_channels: Vec<(usize, u16)> = Vec::new();
        let mut has_last = Marks::default();
        let (mut kept, mut places, mut from) = (0, 0, 0);
        for i in 0..self.len() {
            let channel = self.file_channel(i);
            let had_last = self.has_last.has(i);
            let treated = treatment(i);
            if treated != Treatment::LeaveOut {
                if file_channels.last().is_none_or(|(_, last)| *last != channel) {
                    file_channels.push((kept, channel));
                }
                self.times[kept] = self.times[i];
                self.angles.copy(i, kept);
                self.returns[kept] = self.returns[i];
                self.classes[kept] = self.classes[i];
                if let Some(number) = self.channels.get(i).copied() {
                    self.channels[kept] = number;
                }
                self.places.copy(from, places);
                places += 1;
                let keeps_last = had_last && treated == Treatment::Keep;
                if keeps_last {
                    self.places.copy(from + 1, places);
                    places += 1;
                }
                has_last.push(keeps_last);
                kept += 1;
            }
            from += 1 + usize::from(had_last);
        }
        shorten(&mut self.times, kept);
        self.angles.truncate(kept);
        shorten(&mut self.returns, kept);
        shorten(&mut self.classes, kept);
        shorten(&mut self.channels, kept);
        self.places.truncate(places);
        (self.has_last, self.file_channels) = (has_last, file_channels);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Pulses of two channels of a file, some of several returns.
    fn pulses() -> Vec<Pulse> {
        let pulse = |k: usize| {
            let position = DVec3::new(k as f64, 0.25, -1e-3 * k as f64);
            Pulse {
                time: 1e-5 * (k % 60) as f64,
                position,
                angle: 0.1 * (k % 9) as f64,
                returns: (k % 4) as u8,
                class: (k % 3) as u8,
                last: (k % 5 == 2).then(|| position * 2.0),
                file_channel: if k < 60 { 3 } else { 8 },
                channel: 0,
            }
        };
        (0..100).map(pulse).collect()
    }

    /// The values of pulses but the number of their channel.
    fn values(pulses: impl Iterator<Item = Pulse>) -> Vec<([f64; 5], [u16; 3], Option<DVec3>)> {
        let values = |p: Pulse| {
            let DVec3 { x, y, z } = p.position;
            ([p.time, x, y, z, p.angle], [p.returns.into(), p.class.into(), p.file_channel], p.last)
        };
        pulses.map(values).collect()
    }

    #[test]
    fn pulses_are_those_that_were_added() {
        let expected = pulses();
        let mut all: Pulses = expected.iter().copied().collect();
        assert_eq!(values(all.iter()), values(expected.iter().copied()));
        assert_eq!(all.by_file_channel().collect::<Vec<_>>(), [0..60, 60..100]);
        assert!(all.iter().all(|pulse| pulse.channel == 0));
        all.set_channel(7..9, 2);
        let marked: Vec<usize> = (0..100).filter(|i| all.get(*i).channel == 2).collect();
        assert_eq!(marked, [7, 8]);
        let copy: Pulses = all.iter().collect();
        assert!((0..100).all(|i| copy.get(i).channel == all.get(i).channel));
        all.reverse_angles();
        assert!((0..100).all(|i| all.angle(i) == -expected[i].angle && all.time(i) == expected[i].time));
        assert!(Pulses::default().is_empty() && Pulses::default().by_file_channel().count() == 0);
    }

    #[test]
    fn pulses_and_last_returns_are_left_out() {
        let treatment = |i: usize| match i {
            0..=4 | 37 | 60..=70 => Treatment::LeaveOut,
            12 | 13 => Treatment::LeaveOutLast,
            _ => Treatment::Keep,
        };
        let mut all: Pulses = pulses().into_iter().collect();
        all.set_channel(30..40, 1);
        all.treat(treatment);
        let kept = (0..100).zip(pulses()).filter(|(i, _)| treatment(*i) != Treatment::LeaveOut);
        let expected: Vec<Pulse> = kept
            .map(|(i, pulse)| Pulse {
                last: pulse.last.filter(|_| treatment(i) == Treatment::Keep),
                channel: u8::from((30..40).contains(&i)),
                ..pulse
            })
            .collect();
        assert_eq!(values(all.iter()), values(expected.iter().copied()));
        assert!(all.iter().zip(&expected).all(|(pulse, expected)| pulse.channel == expected.channel));
        assert_eq!(all.by_file_channel().collect::<Vec<_>>(), [0..54, 54..83]);
    }
}
