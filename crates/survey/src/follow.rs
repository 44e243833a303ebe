//! Surveys that follow a stream of poses; scanners and legs with default settings.

use super::{
    Device, HeadTurn, Leg, PlatformKind, PlatformSettings, PoseStream, Scanner, ScannerSettings, Survey,
};
use vlscan_geom::DVec3;

impl Survey {
    /// Replaces the platform by a stream of poses; mount and noise are kept. The legs are replaced by one
    /// active leg with the scanner settings of the first active leg (else of the first leg, else the
    /// scanner's defaults), without a maximum duration: the flight ends with the stream.
    pub fn follow(&mut self, stream: PoseStream) {
        self.platform.kind = PlatformKind::Stream(stream);
        let model = self.legs.iter().find(|leg| leg.scanner.active).or(self.legs.first());
        let settings = model.map_or_else(|| self.scanner.own_settings(), |leg| leg.scanner.clone());
        let leg = Leg {
            number: 0,
            strip: None,
            platform: PlatformSettings::at(DVec3::ZERO),
            scanner: ScannerSettings { active: true, max_duration: None, ..settings },
            place: model.and_then(|leg| leg.place.clone()),
        };
        self.legs = vec![leg];
    }
}

impl Scanner {
    /// Wavelengths of the devices without duplicates, nm, in the order of the devices: at least one.
    pub fn wavelengths(&self) -> Vec<f64> {
        let mut found: Vec<f64> = Vec::new();
        for wavelength in self.devices.iter().map(|device| device.beam.wavelength) {
            if !found.contains(&wavelength) {
                found.push(wavelength);
            }
        }
        found
    }

    /// A scanner of one device with this name, which emits this many pulses per second.
    pub fn new(name: impl Into<String>, pulse_freq: u32, device: Device) -> Scanner {
        let name = name.into();
        Scanner {
            id: name.clone(),
            pulse_freqs: vec![pulse_freq],
            devices: vec![Device { id: name.clone(), ..device }],
            name,
            multi_channel: false,
            written: Vec::new(),
            sources: Vec::new(),
            turn: None,
            pulse_times: None,
        }
    }

    /// A leg without a position, for pulses of a stream.
    pub fn leg(&self) -> Leg {
        Leg {
            number: 0,
            strip: None,
            platform: PlatformSettings::at(DVec3::ZERO),
            scanner: ScannerSettings { active: true, ..self.own_settings() },
            place: None,
        }
    }

    /// Default scanner settings of a leg: the first pulse frequency, the first device's divergence, and the
    /// pulse times and the turn of the head that the scanner states; other angles and frequencies 0, no
    /// vertical limits.
    pub fn own_settings(&self) -> ScannerSettings {
        let beam = self.devices.first().map(|d| d.beam.divergence);
        let settings = super::settings::ScannerLayer::of_scanner(
            self.pulse_freqs.first().copied().unwrap_or(0),
            beam.unwrap_or_default(),
        )
        .resolved();
        let settings = match &self.pulse_times {
            Some(times) => ScannerSettings { pulse_times: Some(times.clone()), ..settings },
            None => settings,
        };
        match self.turn {
            Some(HeadTurn { rate, start, stop }) => {
                ScannerSettings { head_rate: rate, head_start: start, head_stop: stop, ..settings }
            }
            None => settings,
        }
    }
}

impl PlatformSettings {
    /// Default platform settings of a leg that starts at `position` (world, m).
    pub fn at(position: DVec3) -> PlatformSettings {
        PlatformSettings {
            position,
            on_ground: false,
            speed: 70.0,
            has_speed: false,
            stop_and_turn: true,
            smooth_turn: false,
            slowdown: true,
            yaw_at_departure: None,
            trajectory: None,
            mount: None,
        }
    }
}
