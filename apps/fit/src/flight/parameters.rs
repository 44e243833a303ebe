//! Parameters of a flown scanner, by name, and as vectors for the solver.

use super::mirror::{Mirror, MirrorParameters};
use vlscan_geom::DVec3;

/// Parameters of a flight and its scanner. Their standard deviations, priors and steps of derivatives have
/// the same structure.
#[derive(Clone, Debug, PartialEq)]
pub struct Parameters {
    /// Time of position and velocity, s. Not estimated.
    pub epoch: f64,
    /// Position of the platform at the epoch, m.
    pub position: DVec3,
    /// Velocity at the epoch, m/s; z is the climb.
    pub velocity: DVec3,
    /// Acceleration, m/s²; z is the change of the climb.
    pub acceleration: DVec3,
    /// Roll of the scanner, right side down, rad.
    pub roll: f64,
    /// Pitch of the scanner, nose up, rad.
    pub pitch: f64,
    /// Parameters of the mirror.
    pub mirror: MirrorParameters,
    /// At least one channel. The yaws and pitches of several channels have the sum 0: their mean is that of
    /// the scanner.
    pub channels: Vec<Channel>,
    /// Tilts of the facets of a polygon mirror in the order of their lines, rad: a facet turns the beam
    /// forward by its tilt, along the axis of the mirror. Empty if all facets are alike.
    pub facet_tilts: Vec<f64>,
}

/// Phase of a channel, and its difference from the scanner.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Channel {
    /// Phase of its mirror at time 0, rad.
    pub phase: f64,
    /// Turn of its lines about the vertical, to the right, rad.
    pub yaw: f64,
    /// Tilt of its lines forward (nose up), rad.
    pub pitch: f64,
    /// 1, or −1 if its lines go in the direction opposite to those of the first channel. Not estimated.
    pub sense: f64,
}

impl Default for Channel {
    fn default() -> Channel {
        Channel { phase: 0.0, yaw: 0.0, pitch: 0.0, sense: 1.0 }
    }
}

impl Default for Parameters {
    /// Zeros, with one channel and without facets that differ.
    fn default() -> Parameters {
        Parameters {
            epoch: 0.0,
            position: DVec3::ZERO,
            velocity: DVec3::ZERO,
            acceleration: DVec3::ZERO,
            roll: 0.0,
            pitch: 0.0,
            mirror: MirrorParameters::default(),
            channels: vec![Channel::default()],
            facet_tilts: Vec::new(),
        }
    }
}

impl Parameters {
    /// Position of the platform at `time`, m.
    pub fn position_at(&self, time: f64) -> DVec3 {
        let since = time - self.epoch;
        self.position + since * self.velocity + (0.5 * since * since) * self.acceleration
    }

    /// Velocity of the platform at `time`, m/s.
    pub fn velocity_at(&self, time: f64) -> DVec3 {
        self.velocity + (time - self.epoch) * self.acceleration
    }

    /// The same flight, with position and velocity at `epoch`.
    pub fn with_epoch(&self, epoch: f64) -> Parameters {
        let (position, velocity) = (self.position_at(epoch), self.velocity_at(epoch));
        Parameters { epoch, position, velocity, ..self.clone() }
    }

    /// Parameters that all have the same value, for as many channels and facets as these have.
    pub fn filled(&self, value: f64) -> Parameters {
        let channel = |channel: &Channel| Channel { phase: value, yaw: value, pitch: value, ..*channel };
        Parameters {
            epoch: self.epoch,
            position: DVec3::splat(value),
            velocity: DVec3::splat(value),
            acceleration: DVec3::splat(value),
            roll: value,
            pitch: value,
            mirror: MirrorParameters {
                angle: value,
                rate: value,
                yaw: value,
                angle_along: value,
                turning: value,
            },
            channels: self.channels.iter().map(channel).collect(),
            facet_tilts: vec![value; self.facet_tilts.len()],
        }
    }

    /// Values that the solver estimates for this kind of mirror, in the order of [`Parameters::with_vector`].
    pub fn to_vector(&self, mirror: Mirror) -> Vec<f64> {
        let mut copy = self.clone();
        copy.estimated(mirror).into_iter().map(|value| *value).collect()
    }

    /// Parameters with the estimated values of a vector, in the order of [`Parameters::to_vector`]. All other
    /// values remain, also yaw and pitch of the last of several channels.
    pub fn with_vector(&self, mirror: Mirror, vector: &[f64]) -> Parameters {
        let mut parameters = self.clone();
        for (value, new) in parameters.estimated(mirror).into_iter().zip(vector) {
            *value = *new;
        }
        parameters
    }

    /// Values that the solver estimates. Yaw and pitch of the last channel follow from the other channels.
    fn estimated(&mut self, mirror: Mirror) -> Vec<&mut f64> {
        let (position, velocity, acceleration) =
            (&mut self.position, &mut self.velocity, &mut self.acceleration);
        let mut values = vec![
            &mut position.x,
            &mut position.y,
            &mut velocity.x,
            &mut velocity.y,
            &mut acceleration.x,
            &mut acceleration.y,
            &mut position.z,
            &mut velocity.z,
            &mut acceleration.z,
            &mut self.roll,
            &mut self.pitch,
            &mut self.mirror.angle,
            &mut self.mirror.rate,
        ];
        if mirror.has_yaw() {
            values.push(&mut self.mirror.yaw);
        }
        if mirror == Mirror::EllipticCone {
            values.push(&mut self.mirror.angle_along);
        }
        if mirror == Mirror::Turning {
            values.push(&mut self.mirror.turning);
        }
        let last = self.channels.len().saturating_sub(1);
        for (number, channel) in self.channels.iter_mut().enumerate() {
            values.push(&mut channel.phase);
            if number < last {
                values.extend([&mut channel.yaw, &mut channel.pitch]);
            }
        }
        values.extend(&mut self.facet_tilts);
        values
    }

    /// Sets yaw and pitch of the last of several channels, so that their sums are 0.
    pub fn balance_channels(&mut self) {
        if let [others @ .., last] = &mut self.channels[..] {
            last.yaw = -others.iter().map(|channel| channel.yaw).sum::<f64>();
            last.pitch = -others.iter().map(|channel| channel.pitch).sum::<f64>();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two channels of a polygon mirror whose values all differ.
    fn example() -> Parameters {
        Parameters {
            epoch: -2.0,
            position: DVec3::new(1.0, 2.0, 3.0),
            velocity: DVec3::new(4.0, 5.0, 6.0),
            acceleration: DVec3::new(7.0, 8.0, 20.0),
            roll: 9.0,
            pitch: 10.0,
            mirror: MirrorParameters { angle: 11.0, rate: 12.0, yaw: 13.0, angle_along: 14.0, turning: 19.0 },
            channels: vec![
                Channel { phase: 15.0, yaw: 16.0, pitch: 17.0, sense: 1.0 },
                Channel { phase: 18.0, yaw: -16.0, pitch: -17.0, sense: -1.0 },
            ],
            facet_tilts: Vec::new(),
        }
    }

    #[test]
    fn vectors_hold_each_estimated_value_once() {
        let example = example();
        for (mirror, yaw, angle_along, turning) in [
            (Mirror::Cone, false, false, false),
            (Mirror::EllipticCone, true, true, false),
            (Mirror::Polygon, true, false, false),
            (Mirror::Oscillating, true, false, false),
            (Mirror::Turning, true, false, true),
            (Mirror::Sine, true, false, false),
        ] {
            let vector = example.to_vector(mirror);
            let mut sorted = vector.clone();
            sorted.sort_by(f64::total_cmp);
            let expected = (1..=20).map(f64::from);
            let expected = expected
                .filter(|v| (yaw || *v != 13.0) && (angle_along || *v != 14.0) && (turning || *v != 19.0));
            assert_eq!(sorted, expected.collect::<Vec<f64>>(), "{mirror:?}");
            let back = example.filled(0.0).with_vector(mirror, &vector);
            assert_eq!(back.to_vector(mirror), vector);
            assert_eq!((back.velocity, back.channels[1].phase), (example.velocity, 18.0));
        }
    }

    #[test]
    fn a_flight_with_another_epoch_is_the_same() {
        let example = example();
        assert_eq!(
            (example.position_at(-2.0), example.velocity_at(-2.0)),
            (example.position, example.velocity)
        );
        let later = example.with_epoch(1.0);
        assert_eq!((later.epoch, later.velocity), (1.0, DVec3::new(25.0, 29.0, 66.0)));
        assert_eq!(later.position, DVec3::new(44.5, 53.0, 111.0));
        assert!((later.with_epoch(-2.0).position - example.position).length() < 1e-12);
        assert_eq!(later.position_at(3.0), example.position_at(3.0));
    }

    #[test]
    fn the_last_channel_balances_the_others() {
        let mut parameters = example();
        parameters.channels[0].yaw = 0.25;
        parameters.channels.insert(1, Channel { yaw: 0.5, pitch: 3.0, ..Channel::default() });
        parameters.balance_channels();
        assert_eq!((parameters.channels[2].yaw, parameters.channels[2].pitch), (-0.75, -20.0));
        assert_eq!(parameters.channels[2].sense, -1.0);
        let mut single = Parameters::default();
        single.balance_channels();
        assert_eq!((single.channels[0].yaw, single.channels[0].pitch), (0.0, 0.0));
    }

    #[test]
    fn filled_parameters_keep_their_channels_and_facets() {
        let filled = Parameters { facet_tilts: vec![0.1, 0.2], ..example() }.filled(3.5);
        assert_eq!((filled.channels.len(), filled.facet_tilts), (2, vec![3.5, 3.5]));
        assert_eq!(filled.channels[1], Channel { phase: 3.5, yaw: 3.5, pitch: 3.5, sense: -1.0 });
    }
}
