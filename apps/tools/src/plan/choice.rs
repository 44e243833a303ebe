//! Speed, distance of lines, scan and pulse rate of a flight.

use super::area::Area;
use super::beams::{Beams, Field, best_mount};
use super::document::Turned;
use super::error::PlanError;
use super::reach::GROUND_REFLECTANCE;
use super::requirements::{AirborneOptions, Carrier};
use super::swath::{Scan, SwathModel};
use vlscan_geom::MAX_COORDINATE;
use vlscan_survey::Mount;

/// Maximum number of flight lines of a plan.
const MAX_LINES: f64 = 10_000.0;
/// Overlap of neighbouring strips if none is requested, percent.
const DEFAULT_OVERLAP: f64 = 30.0;
/// Share of the pulses that point down which the instrument's ranges may cut off where its field can be
/// narrowed.
const MAX_CUT: f64 = 0.01;
/// Part of the least range by which the ground must be farther away.
const MIN_CLEARANCE: f64 = 0.01;
/// Reach of a swath, per height, beyond which the ground counts as at the horizon: 89.4° from the vertical.
const HORIZON: f64 = 100.0;
/// Range, per height, up to which mounts are compared for an instrument that detects no ground at that
/// height.
const MOUNT_RANGE: f64 = 4.0;
/// Rounds of choosing speed and scan frequency, on which the strips of oscillating mirrors depend.
const ROUNDS: u32 = 3;

/// A frame in the direction of the lines.
#[derive(Clone, Copy)]
pub(super) struct Frame {
    /// Unit vectors.
    along: [f64; 2],
    across: [f64; 2],
    /// An origin near the area, so that no digits are lost.
    origin: [f64; 2],
}

impl Frame {
    /// `heading` is rad clockwise from +y.
    pub fn new(heading: f64, origin: [f64; 2]) -> Frame {
        let (s, c) = libm::sincos(heading);
        Frame { along: [s, c], across: [c, -s], origin }
    }

    fn project(&self, axis: [f64; 2], p: [f64; 2]) -> f64 {
        (p[0] - self.origin[0]) * axis[0] + (p[1] - self.origin[1]) * axis[1]
    }

    pub fn point(&self, along: f64, across: f64) -> [f64; 2] {
        [0, 1].map(|i| self.origin[i] + along * self.along[i] + across * self.across[i])
    }

    /// The extent of the area along where its distance across is within `limits`.
    pub fn extent(&self, area: &Area, limits: [f64; 2]) -> Option<[f64; 2]> {
        area.extent(|p| self.project(self.along, p), |p| self.project(self.across, p), limits)
    }

    /// The extent of the area across.
    pub fn width(&self, area: &Area) -> [f64; 2] {
        let distances = area.corners().iter().map(|p| self.project(self.across, *p));
        distances.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], d| [low.min(d), high.max(d)])
    }
}

/// Speed, distance of the lines and scan of a plan.
pub(super) struct Choice {
    pub scan: Scan,
    /// Part of the ground that the scan covers.
    pub field: Field,
    /// Pulses per second that leave the instrument, all devices.
    pub fired_rate: f64,
    /// m/s.
    pub speed: f64,
    /// Distance of the lines, m.
    pub spacing: f64,
    /// Mean over the area of the parallel lines, pulses/m².
    pub density: f64,
    /// The turned mount, if the platform's does not serve.
    pub turned: Option<Turned>,
}

impl Choice {
    /// Pulses per second that reach the ground within the instrument's ranges.
    pub fn ground_rate(&self) -> f64 {
        self.fired_rate * self.field.measured
    }

    /// Spacing of scan lines along the flight, m; 0 for patterns without lines.
    fn line_spacing(&self) -> f64 {
        if self.scan.line_rate > 0.0 { self.speed / self.scan.line_rate } else { 0.0 }
    }

    /// The flight with another density, of which the pulses that are fired have a share per m² at 1 m/s; at
    /// the speed of the requested density if the speed is not requested.
    pub fn with_density(self, share: f64, options: &AirborneOptions) -> Choice {
        let at_one = self.fired_rate * share;
        match (options.density, options.speed) {
            (Some(density), None) => Choice { speed: at_one / density, density, ..self },
            _ => Choice { density: at_one / self.speed, ..self },
        }
    }

    /// How far before the area lines begin and behind it they end, m, so that all beams of the strip sweep it
    /// from end to end.
    pub fn margins(&self, run_in: Option<f64>) -> [f64; 2] {
        let [behind, ahead] = self.field.along;
        match run_in {
            Some(length) => [length + self.field.ahead(), length - self.field.ahead()],
            None => [ahead + self.line_spacing(), self.line_spacing() - behind],
        }
    }
}

/// Rejects ground that is nearer than the instrument measures.
pub(super) fn check_clearance(
    instrument: &SwathModel,
    options: &AirborneOptions,
    relief: f64,
) -> Result<(), PlanError> {
    let [near, _] = instrument.ranges();
    let lowest = options.height - relief;
    if lowest > near * (1.0 + MIN_CLEARANCE) {
        return Ok(());
    }
    let (instrument, distance) = (instrument.name().to_owned(), lowest);
    let height = (near * (1.0 + MIN_CLEARANCE) + relief).ceil();
    Err(match relief > 0.01 * options.height {
        true => PlanError::LowAtTop { distance, relief, instrument, near, height },
        false => PlanError::Low { distance, instrument, near, height },
    })
}

/// The width that lines are laid out for, m: that of the strip, but no more than 45° to either side of
/// instruments whose field cannot be narrowed and whose strips grow thin towards the horizon.
pub(super) fn planned_width(field: &Field, instrument: &SwathModel, options: &AirborneOptions) -> f64 {
    let is_open = instrument.half_angle(None).is_ok_and(|angle| angle.is_none());
    if is_open { field.width().min(2.0 * options.height) } else { field.width() }
}

pub(super) fn choose(
    area: &Area,
    frame: &Frame,
    instrument: &SwathModel,
    carrier: &Carrier,
    options: &AirborneOptions,
) -> Result<Choice, PlanError> {
    match (options.density, options.speed, options.overlap) {
        (Some(density), Some(_), Some(_)) => choose_rate(area, frame, instrument, carrier, options, density),
        (None, None, _) => Err(PlanError::NoSpeed),
        _ => choose_at(area, frame, instrument, carrier, options, instrument.pulse_rate()?),
    }
}

/// The flight at the lowest pulse rate of the instrument with which the requested speed and overlap give the
/// requested density.
fn choose_rate(
    area: &Area,
    frame: &Frame,
    instrument: &SwathModel,
    carrier: &Carrier,
    options: &AirborneOptions,
    density: f64,
) -> Result<Choice, PlanError> {
    let mut rates: Vec<u32> = instrument.pulse_rates().iter().copied().filter(|rate| *rate > 0).collect();
    rates.sort_unstable();
    if instrument.wanted_rate.is_some() || rates.len() < 2 {
        return Err(PlanError::Overdetermined);
    }
    // Speed and overlap determine the lines.
    let given = AirborneOptions { density: None, ..options.clone() };
    let (mut densest, mut refused) = (None, None);
    for rate in rates {
        match choose_at(area, frame, instrument, carrier, &given, rate) {
            Ok(choice) if choice.density >= density * (1.0 - 1e-9) => return Ok(choice),
            Ok(choice) => densest = Some((rate, choice.density)),
            // Pulses at a higher rate are weaker, but the scan frequency may be feasible.
            Err(problem) => refused = refused.or(Some(problem)),
        }
    }
    Err(match (densest, refused) {
        (Some((rate, found)), _) => PlanError::PulseRates { rate, found, density },
        (None, Some(problem)) => problem,
        (None, None) => PlanError::Overdetermined,
    })
}

/// Chooses the flight at a pulse rate, Hz.
fn choose_at(
    area: &Area,
    frame: &Frame,
    instrument: &SwathModel,
    carrier: &Carrier,
    options: &AirborneOptions,
    pulse_rate: u32,
) -> Result<Choice, PlanError> {
    let half_angle = instrument.half_angle(options.scan_angle)?;
    // The first guess of the lines is that of a flight at 30 m/s.
    let mut lines = (30.0 * f64::from(pulse_rate) / options.height).sqrt();
    let mut choice: Option<Choice> = None;
    for _ in 0..ROUNDS {
        let scan = instrument.scan(half_angle, pulse_rate, options.scan_freq, lines)?;
        if choice.as_ref().is_some_and(|choice| choice.scan == scan) {
            break;
        }
        let beams = instrument.beams(&scan)?;
        let (mount, turned) = match &choice {
            Some(Choice { turned: Some(turned), .. }) => {
                (Mount { rotation: turned.turns.rotation(), ..carrier.mount }, Some(*turned))
            }
            Some(_) => (carrier.mount, None),
            None => mount(instrument, &beams, carrier, options)?,
        };
        let field = beams.over_ground(&mount, options.height);
        check_ranges(instrument, options, &field)?;
        let fired_rate = f64::from(pulse_rate) * beams.fired * instrument.devices();
        let strip = Strip {
            area,
            frame,
            field: &field,
            fired_rate,
            width: planned_width(&field, instrument, options),
        };
        let (speed, spacing) = strip.speed_and_spacing(options)?;
        let density = strip.density(spacing)? / speed;
        // v / f = W·f / N with f lines per second.
        lines = (speed * fired_rate * field.measured / field.width()).sqrt();
        choice = Some(Choice { scan, field, fired_rate, speed, spacing, density, turned });
    }
    choice.ok_or(PlanError::NoScan)
}

/// The mount of the scanner: that of the platform if it serves, else one that the plan turns, if it may.
fn mount(
    instrument: &SwathModel,
    beams: &Beams,
    carrier: &Carrier,
    options: &AirborneOptions,
) -> Result<(Mount, Option<Turned>), PlanError> {
    let [_, far] = instrument.ranges();
    let name = || instrument.name().to_owned();
    if options.height >= far {
        return Err(PlanError::High { height: options.height, instrument: name(), far });
    }
    let Some((turns, serves)) = best_mount(beams, &carrier.mount, options.height) else {
        // Where a mount would point the beams at the ground the ranges tell why it is not measured.
        let near = beams.up_to(MOUNT_RANGE * options.height);
        if let Some((turns, _)) = best_mount(&near, &carrier.mount, options.height) {
            let down = Mount { rotation: turns.rotation(), ..carrier.mount };
            check_ranges(instrument, options, &beams.over_ground(&down, options.height))?;
        }
        return Err(PlanError::NoMount { instrument: name() });
    };
    if serves {
        return Ok((carrier.mount, None));
    }
    if !carrier.may_turn {
        return Err(PlanError::Mount { instrument: name(), turns: turns.text() });
    }
    let turned = Turned { offset: carrier.mount.offset, turns };
    Ok((Mount { rotation: turns.rotation(), ..carrier.mount }, Some(turned)))
}

/// Rejects strips that the instrument's reach cuts off.
fn check_ranges(instrument: &SwathModel, options: &AirborneOptions, field: &Field) -> Result<(), PlanError> {
    let name = || instrument.name().to_owned();
    let [near, far] = instrument.ranges();
    let is_open = instrument.half_angle(None)?.is_none();
    let height = options.height;
    let percent = (100.0 * GROUND_REFLECTANCE).round();
    if field.lost.too_near > MAX_CUT {
        return Err(PlanError::TooNear { height, instrument: name(), near });
    }
    if field.measured <= 0.0 && field.lost.too_weak > 0.0 {
        return Err(PlanError::TooWeak { height, instrument: name(), percent });
    }
    if field.measured <= 0.0 {
        return Err(PlanError::OutOfReach { height, instrument: name() });
    }
    if is_open && far > MAX_COORDINATE && field.reach() > HORIZON * height {
        return Err(PlanError::Horizon { height, instrument: name() });
    }
    if !is_open && field.lost.too_far > MAX_CUT {
        return Err(PlanError::EdgeTooFar { instrument: name(), far });
    }
    if !is_open && field.lost.too_weak > MAX_CUT {
        return Err(PlanError::EdgeTooWeak { instrument: name(), percent });
    }
    Ok(())
}

/// The strips of a plan.
struct Strip<'s> {
    area: &'s Area,
    frame: &'s Frame,
    field: &'s Field,
    /// Pulses per second that leave the instrument.
    fired_rate: f64,
    /// The width that lines are laid out for, m.
    width: f64,
}

impl Strip<'_> {
    fn speed_and_spacing(&self, options: &AirborneOptions) -> Result<(f64, f64), PlanError> {
        let spacing_of = |overlap: Option<f64>| match overlap {
            Some(overlap) => self.field.width() * (1.0 - overlap / 100.0),
            None => self.width * (1.0 - DEFAULT_OVERLAP / 100.0),
        };
        let (speed, spacing) = match (options.density, options.speed) {
            (Some(density), Some(speed)) => (speed, self.spacing_for(density, speed)?),
            (Some(density), None) => {
                let spacing = spacing_of(options.overlap);
                (self.density(spacing)? / density, spacing)
            }
            (None, speed) => (speed.unwrap_or_default(), spacing_of(options.overlap)),
        };
        if !(1e-3..=1000.0).contains(&speed) {
            return Err(PlanError::Speed(speed));
        }
        Ok((speed, spacing))
    }

    /// The distance of lines that gives the density over the area at that speed.
    fn spacing_for(&self, density: f64, speed: f64) -> Result<f64, PlanError> {
        let mut spacing = self.fired_rate * self.field.measured / (density * speed);
        // Edges and the number of lines change the density over the area a little.
        // Where it jumps there may be no such spacing: the nearest one counts.
        let mut best = (f64::INFINITY, spacing);
        for _ in 0..12 {
            let found = self.density(spacing)? / speed;
            let off = (found / density - 1.0).abs();
            best = if off < best.0 { (off, spacing) } else { best };
            spacing *= (found / density).clamp(0.5, 2.0);
        }
        let spacing = best.1;
        if spacing > self.field.width() * 1.001 {
            let found = self.fired_rate * self.field.measured / (speed * self.field.width());
            return Err(PlanError::Dense { speed, found, density });
        }
        Ok(spacing)
    }

    /// Mean density over the area of strips `spacing` m apart, flown at 1 m/s, pulses/m²: the integral across
    /// of what the strips have there and of how long the area is there.
    fn density(&self, spacing: f64) -> Result<f64, PlanError> {
        let places = line_places(self.area, self.frame, self.width, spacing)?;
        let [pulses, square] = shares(self.area, self.frame, &places, self.field);
        Ok(self.fired_rate * pulses / square)
    }
}

/// Integral over an area of the share of the fired pulses per metre of flight that lines at distances across
/// have per metre of width, m, and the size of the area, m².
pub(super) fn shares(area: &Area, frame: &Frame, places: &[f64], field: &Field) -> [f64; 2] {
    const STEPS: u32 = 4000;
    let [low, high] = frame.width(area);
    let step = (high - low) / f64::from(STEPS);
    let reach = field.reach();
    let first = |x: f64| places.partition_point(|place| *place < x - reach);
    let (mut pulses, mut square) = (0.0, 0.0);
    for i in 0..STEPS {
        let x = low + (f64::from(i) + 0.5) * step;
        let Some([from, to]) = frame.extent(area, [x; 2]) else { continue };
        let near = places[first(x)..].iter().take_while(|place| **place <= x + reach);
        let per_metre: f64 = near.map(|place| field.profile(x - place)).sum();
        pulses += per_metre * (to - from);
        square += to - from;
    }
    [pulses, square]
}

/// Distances across of lines `spacing` apart. The outermost line lies so that the next one, which is not
/// flown, would not reach the area.
pub(super) fn line_places(
    area: &Area,
    frame: &Frame,
    width: f64,
    spacing: f64,
) -> Result<Vec<f64>, PlanError> {
    let [low, high] = frame.width(area);
    let needed = (high - low) + width - 2.0 * spacing;
    let count = if needed > 1e-9 { (needed / spacing - 1e-9).ceil() + 1.0 } else { 1.0 };
    if count > MAX_LINES {
        return Err(PlanError::FlightLines { count, max: MAX_LINES });
    }
    let first = 0.5 * (low + high) - 0.5 * (count - 1.0) * spacing;
    Ok((0..count as u32).map(|i| first + f64::from(i) * spacing).collect())
}
