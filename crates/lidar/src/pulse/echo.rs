//! The records of a pulse.

use vlscan_geom::{DVec3, Rotation};

/// A return with its position, surface and pulse, from which points are written (spec pulse-physics §7.1).
/// Called echo in code and return in the documentation; `Return` is its peak in the waveform, before the
/// surface is known. Positions are in the scene frame; writers add the shift.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Echo {
    /// Measured position, m, scene frame.
    pub position: DVec3,
    /// Reported beam origin, m, scene frame.
    pub origin: DVec3,
    /// Reported beam direction, unit.
    pub direction: DVec3,
    /// Reported attitude of the scanner: from the axes of its mount to the scene; [`Echo::NO_ATTITUDE`]
    /// unless it is recorded ([`super::PhysicsOptions::record_scanner_axes`]).
    pub scanner: Rotation,
    /// Measured range, m, noise and errors included.
    pub range: f64,
    /// Distance along the subray to the hit, m, without noise, errors or bins.
    pub true_range: f64,
    /// Waveform amplitude at the peak.
    pub intensity: f64,
    /// Width of the fitted Gaussian, ns; 0 unless requested.
    pub echo_width: f64,
    /// Number of the return, from 1.
    pub return_number: u32,
    /// Number of returns detected of the pulse.
    pub number_of_returns: u32,
    /// Pulse number of its device, from 1.
    pub pulse_number: u64,
    /// Index of the scanner's device that emitted the pulse, from 0.
    pub device: u32,
    /// Index into the scene's parts.
    pub part: u32,
    /// Index of the primitive that was hit, in the scene with all instances expanded.
    pub primitive: u32,
    /// Class of the material.
    pub classification: i32,
    /// Cosine of the incidence angle at the attributed hit.
    pub incidence_cosine: f64,
    /// Scan angle of its pulse, rad; see [`Pulse::scan_angle`](crate::flight::Pulse::scan_angle).
    pub scan_angle: f64,
    /// Emission time, ns of the GPS week.
    pub time_ns: f64,
    /// Index into [`super::Batch::truths`], or [`Echo::NO_TRUTH`].
    pub truth_index: u32,
}

/// The true cause of an echo.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EchoTruth {
    /// True origin and direction of the beam, scene frame; equal to the reported ones if there are no
    /// navigation errors.
    pub beam: [DVec3; 2],
    /// Point where the strongest subray hit the surface, m, scene frame; NaN if no surface caused the echo.
    /// The point of the echo lies on the beam's axis instead.
    pub surface: DVec3,
    /// Unit normal there, towards the instrument; 0 in voxels.
    pub normal: DVec3,
    /// Share of the beam's subrays that are part of the echo.
    pub fraction: f64,
    /// Number of the strongest subray within the beam, from 0.
    pub subray: u32,
    /// Way of the light to the surface and back.
    pub path: EchoPath,
    /// Red, green and blue of the surface there, of sRGB with 8 bits; black without a colour, and unless they
    /// are recorded ([`super::PhysicsOptions::record_colours`]).
    pub colour: [u8; 3],
}

/// Radial velocity of an echo, positive away from the instrument.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EchoVelocity {
    /// Mean over the light of the echo, m/s; NaN if it is not recorded.
    pub radial: f64,
    /// Standard deviation over the light of the echo, m/s; NaN if it is not recorded.
    pub spread: f64,
}

impl EchoVelocity {
    /// Not recorded, or of an echo that noise caused.
    pub const UNKNOWN: EchoVelocity = EchoVelocity { radial: f64::NAN, spread: f64::NAN };
}

/// Way of the light of an echo.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct EchoPath {
    /// Kind of the way.
    pub kind: PathKind,
    /// Number of mirrors, panes and surfaces of water on the way to the surface.
    pub order: u8,
}

/// Kind of the way of the light of an echo; its number is the label in tables.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PathKind {
    /// Straight to the surface.
    Direct = 0,
    /// Through panes.
    Pane = 1,
    /// Over a mirror, or mirrored by a pane or by water: the echo is a ghost.
    Mirror = 2,
    /// To the surface of water, whose waves mirror it straight back.
    WaterSurface = 3,
    /// Into water, which scatters it back.
    WaterColumn = 4,
    /// Through water.
    WaterBottom = 5,
    /// Into fog, rain, snow or dust, which scatters it back.
    Air = 6,
    /// To a single raindrop or snowflake.
    Drop = 7,
    /// To a mirror or pane that sends the beam straight back into the receiver.
    MirrorSurface = 8,
}

/// Class of the bottom of water in the domain profile of LAS for bathymetry.
const BOTTOM_CLASS: i32 = 40;
/// Class of the surface of water there.
const WATER_SURFACE_CLASS: i32 = 41;
/// Class of high noise in LAS 1.4, for echoes of the air.
const HIGH_NOISE_CLASS: i32 = 18;

impl PathKind {
    /// Number of kinds.
    pub(super) const COUNT: usize = 9;

    /// True for echoes of fog, rain, snow and dust, which have no surface.
    pub fn is_air(self) -> bool {
        matches!(self, PathKind::Air | PathKind::Drop)
    }

    /// True for echoes that may be spread over a way, and those that compete with them.
    pub(super) fn is_of_medium(self) -> bool {
        self.is_water() || self.is_air()
    }

    /// True for echoes of water and its bottom.
    pub fn is_water(self) -> bool {
        matches!(self, PathKind::WaterSurface | PathKind::WaterColumn | PathKind::WaterBottom)
    }

    /// Class of an echo of a surface whose material has the class `of_material`. Water without a class, and
    /// its bottom without another class than ground, have those of bathymetry; echoes of the air are noise.
    pub fn classification(self, of_material: i32) -> i32 {
        match (self, of_material) {
            (PathKind::WaterSurface, 0) => WATER_SURFACE_CLASS,
            (PathKind::WaterBottom, 0..=2) => BOTTOM_CLASS,
            (PathKind::Air | PathKind::Drop, _) => HIGH_NOISE_CLASS,
            _ => of_material,
        }
    }
}

impl EchoPath {
    /// Straight to the surface.
    pub const DIRECT: EchoPath = EchoPath { kind: PathKind::Direct, order: 0 };

    /// The way as a number; 0 for the straight one.
    pub fn code(self) -> u16 {
        u16::from_le_bytes([self.kind as u8, self.order])
    }

    /// The way of a [`EchoPath::code`].
    pub fn of_code(code: u16) -> EchoPath {
        let [kind, order] = code.to_le_bytes();
        let kind = match kind {
            1 => PathKind::Pane,
            2 => PathKind::Mirror,
            3 => PathKind::WaterSurface,
            4 => PathKind::WaterColumn,
            5 => PathKind::WaterBottom,
            6 => PathKind::Air,
            7 => PathKind::Drop,
            8 => PathKind::MirrorSurface,
            _ => PathKind::Direct,
        };
        EchoPath { kind, order }
    }
}

impl EchoTruth {
    /// Truth of an echo that no surface caused, or whose cause is not recorded: NaN, no subray.
    pub fn unknown(beam: [DVec3; 2]) -> EchoTruth {
        EchoTruth {
            beam,
            surface: DVec3::NAN,
            normal: DVec3::NAN,
            fraction: f64::NAN,
            subray: u32::MAX,
            path: EchoPath::DIRECT,
            colour: [0; 3],
        }
    }
}

impl Echo {
    /// [`Echo::truth_index`] of echoes whose truth is not recorded and whose pulse has no errors of
    /// navigation.
    pub const NO_TRUTH: u32 = u32::MAX;

    /// [`Echo::scanner`] of echoes whose scanner's attitude is not recorded.
    pub const NO_ATTITUDE: Rotation = Rotation { w: 0.0, u: DVec3::ZERO };

    /// The record of a pulse without echoes, at the beam's origin: no part, no primitive, return numbers
    /// of 0.
    pub fn miss(pulse: &PulseRecord) -> Echo {
        Echo {
            position: pulse.origin,
            origin: pulse.origin,
            direction: pulse.direction,
            scanner: Echo::NO_ATTITUDE,
            range: 0.0,
            true_range: 0.0,
            intensity: 0.0,
            echo_width: 0.0,
            return_number: 0,
            number_of_returns: 0,
            pulse_number: pulse.number,
            device: pulse.device,
            part: u32::MAX,
            primitive: u32::MAX,
            classification: 0,
            incidence_cosine: 1.0,
            scan_angle: pulse.scan_angle,
            time_ns: pulse.time_ns,
            truth_index: Echo::NO_TRUTH,
        }
    }

    /// The true cause of the echo, [`EchoTruth::unknown`] if it is not recorded; `truths` belong to its
    /// batch.
    pub fn truth(&self, truths: &[EchoTruth]) -> EchoTruth {
        let recorded = truths.get(self.truth_index as usize).copied();
        recorded.unwrap_or_else(|| EchoTruth::unknown([self.origin, self.direction]))
    }

    /// Radial velocity, [`EchoVelocity::UNKNOWN`] if it is not recorded; `velocities` belong to its batch.
    pub fn velocity(&self, velocities: &[EchoVelocity]) -> EchoVelocity {
        velocities.get(self.truth_index as usize).copied().unwrap_or(EchoVelocity::UNKNOWN)
    }

    /// Position relative to the origin of the beam in the scanner's axes, m: the origin itself for a missed
    /// pulse; NaN unless it is recorded.
    pub fn position_in_scanner(&self) -> DVec3 {
        match self.scanner_attitude() {
            _ if self.is_miss() => DVec3::ZERO,
            None => DVec3::NAN,
            Some(attitude) => attitude.inverse().apply(self.direction) * self.range,
        }
    }

    /// Attitude of the scanner, if it is recorded.
    pub fn scanner_attitude(&self) -> Option<Rotation> {
        (self.scanner != Echo::NO_ATTITUDE).then_some(self.scanner)
    }

    /// True position, m, scene frame; `truths` belong to the echo's batch.
    pub fn true_position(&self, truths: &[EchoTruth]) -> DVec3 {
        truths.get(self.truth_index as usize).map_or(self.position, |t| t.beam[0] + t.beam[1] * self.range)
    }

    /// True if the record represents a pulse without echoes.
    pub fn is_miss(&self) -> bool {
        self.number_of_returns == 0
    }
}

/// One digitised waveform (spec pulse-physics §4.11); its samples lie in the batch's pool.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WaveformRecord {
    /// Pulse number of its device.
    pub pulse_number: u64,
    /// Index of the scanner's device that emitted the pulse, from 0.
    pub device: u32,
    /// Beam origin, m, scene frame.
    pub origin: DVec3,
    /// Traced direction.
    pub direction: DVec3,
    /// One-way travel time of the first sample, ns.
    pub start_ns: f64,
    /// One-way travel time of the last sample, ns.
    pub end_ns: f64,
    /// Emission time, ns of the GPS week.
    pub time_ns: f64,
    /// First sample within [`crate::pulse::Batch::samples`].
    pub first_sample: usize,
    /// Number of samples.
    pub samples: usize,
}

/// One emitted pulse as a record (spec pulse-physics §7.3).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PulseRecord {
    /// Beam origin, m, scene frame.
    pub origin: DVec3,
    /// Traced direction.
    pub direction: DVec3,
    /// ns of the GPS week.
    pub time_ns: f64,
    /// Pulse number of its device.
    pub number: u64,
    /// Index of the scanner's device that emitted the pulse, from 0.
    pub device: u32,
    /// Deflection angle of the beam, rad.
    pub scan_angle: f64,
}
