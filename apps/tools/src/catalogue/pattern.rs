//! The scan pattern of an instrument at rest as a drawing: where its beams point, seen from the instrument.

use crate::chart::{Anchor, Axis, Drawing, Mark, Plot, Role, labelled, steps};
use std::f64::consts::TAU;
use vlscan_base::corrections::Corrections;
use vlscan_base::error::Result;
use vlscan_base::rng::GOLDEN;
use vlscan_geom::{DVec3, degrees};
use vlscan_lidar::scanner::{DevicePlan, DeviceState};
use vlscan_survey::{Deflector, Scanner, ScannerSettings};

/// Beams that are drawn, at most.
const DOTS: u64 = 24_000;
/// Pulses that are stepped through, at most.
const MAX_PULSES: u64 = 20_000_000;
/// Duration of the pattern of instruments without a turning head, s: a frame of those whose pattern does not
/// repeat.
const FRAME_S: f64 = 0.1;
/// Lines per second of mirrors without limits.
const LINES_HZ: f64 = 50.0;

const WIDTH: f64 = 1040.0;
const MAX_HEIGHT: f64 = 760.0;
/// Space for title and axes: left, right, top, bottom, px.
const MARGINS: [f64; 4] = [64.0, 24.0, 62.0, 52.0];
/// Distance of the lines of the grid, at least, px.
const TICK_PX: f64 = 36.0;
/// Distances of the lines of the grid, degrees.
const STEPS: [f64; 10] = [0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 15.0, 30.0, 45.0];

/// Directions of beams by channel.
pub struct Pattern {
    settings: ScannerSettings,
    seconds: f64,
    /// Horizontal and vertical angle of beams by channel, degrees.
    channels: Vec<Vec<[f64; 2]>>,
    /// Ranges of the angles of all beams, degrees: horizontal, vertical.
    extent: [[f64; 2]; 2],
}

impl Pattern {
    /// Steps through a revolution of the head, or a tenth of a second, at the instrument's fastest settings.
    ///
    /// # Errors
    /// Formulas of mechanical errors without a value.
    pub fn of(scanner: &Scanner) -> Result<Pattern> {
        // A scanner has at least one device.
        let first = &scanner.devices[0];
        let head_rate = first.head.max_rate.abs();
        let turns = head_rate > 0.0;
        let settings = ScannerSettings {
            active: true,
            pulse_freq: scanner.pulse_freqs.iter().max().copied().unwrap_or(1).max(1),
            scan_freq: match first.scan_freq {
                (_, most) if most > 0.0 => most,
                // The head alone turns the fan of channels.
                _ if turns && scanner.multi_channel => 0.0,
                (least, _) => least.max(LINES_HZ),
            },
            scan_angle: first.scan_angle_max,
            head_rate,
            head_stop: TAU,
            ..scanner.own_settings()
        };
        let seconds = if turns { TAU / head_rate } else { FRAME_S };
        let pulses = ((seconds * f64::from(settings.pulse_freq)).ceil() as u64).clamp(1, MAX_PULSES);
        let share = DOTS as f64 / (pulses as f64 * scanner.devices.len() as f64);
        let (mut channels, mut extent) = (Vec::new(), [[f64::INFINITY, f64::NEG_INFINITY]; 2]);
        for device in &scanner.devices {
            let plan = DevicePlan::new(device, Corrections::MOTION);
            channels.push(beams(&plan, &settings, pulses, share, &mut extent)?);
        }
        Ok(Pattern { settings, seconds, channels, extent })
    }

    /// Draws the pattern, with the same scale on both axes.
    pub fn drawing(&self, scanner: &Scanner) -> Drawing {
        let [left, right, top, bottom] = MARGINS;
        // A line has room around it.
        let largest = self.extent.iter().map(|[lo, hi]| hi - lo).fold(1.0, f64::max);
        let [x, y] = self.extent.map(|[lo, hi]| {
            let room = (0.04 * (hi - lo)).max(0.1 * largest - 0.5 * (hi - lo)).max(0.02 * largest);
            Axis::new(lo - room, hi + room)
        });
        let [across, up] = [x.high - x.low, y.high - y.low];
        let scale = ((WIDTH - left - right) / across).min((MAX_HEIGHT - top - bottom) / up);
        let (right, bottom_at) = (left + scale * across, top + scale * up);
        let plot = Plot { left, right, top, bottom: bottom_at, x, y };
        let width = (right + MARGINS[1]).max(560.0).round();
        let mut drawing = Drawing::new(width, (bottom_at + bottom).round(), 1.1);
        drawing.write([left, 12.0], scanner.name.clone(), Role::Ink, Anchor::Start);
        drawing.write([left, 30.0], self.caption(scanner), Role::Faint, Anchor::Start);
        drawing.write([left, 46.0], "upwards", Role::Faint, Anchor::End);
        let ticks = |axis: Axis| {
            let step = STEPS.into_iter().find(|step| step * scale >= TICK_PX).unwrap_or(90.0);
            let ticks = labelled(steps(axis.low, axis.high, step), step);
            ticks.into_iter().map(|(value, name)| (value, name + "°")).collect()
        };
        plot.grid(&mut drawing, ticks(x), ticks(y));
        let middle = 0.5 * (left + right);
        let below = [middle, bottom_at + 30.0];
        drawing.write(below, "to the right of straight ahead", Role::Ink, Anchor::Middle);
        for (n, beams) in self.channels.iter().enumerate() {
            let at = beams.iter().map(|[across, up]| plot.at(*across, *up)).collect();
            drawing.add(Mark::Dots { at, width: 1.6, role: Role::Series(n) });
        }
        drawing
    }

    /// Caption of the drawing.
    fn caption(&self, scanner: &Scanner) -> String {
        let device = &scanner.devices[0];
        let mut parts = vec![match scanner.devices.len() {
            1 => format!("{} kHz", f64::from(self.settings.pulse_freq) / 1e3),
            n => format!("{n} channels of {} kHz", f64::from(self.settings.pulse_freq) / 1e3),
        }];
        match device.deflector {
            Deflector::Fibres { count: 1 } | Deflector::Risley { .. } | Deflector::Pattern(_) => {}
            Deflector::Fibres { count } => parts.push(format!("{count} beams in turn")),
            _ if self.settings.scan_freq == 0.0 => {}
            _ => parts.push(format!("{} lines/s", self.settings.scan_freq)),
        }
        if device.head.max_rate != 0.0 {
            parts.push(format!("a revolution of the head in {} s", (self.seconds * 1e4).round() / 1e4));
        } else {
            parts.push(format!("{} s", self.seconds));
        }
        parts.push("seen along the optical axis of the instrument at rest".to_owned());
        parts.join(", ")
    }
}

/// Horizontal and vertical angles of a share of the beams of a device, degrees. `extent` grows by those of
/// all beams.
fn beams(
    plan: &DevicePlan,
    settings: &ScannerSettings,
    pulses: u64,
    share: f64,
    extent: &mut [[f64; 2]; 2],
) -> Result<Vec<[f64; 2]>> {
    let mut state = DeviceState::at_rest(plan);
    state.start_leg(plan, settings);
    let (mut beams, mut position) = (Vec::new(), 0.0);
    for _ in 0..pulses {
        state.step_head(plan);
        state.step_deflector(plan);
        if !state.has_deflection() {
            return Err(state.formula_error(plan));
        }
        if !state.deflector.is_firing() {
            continue;
        }
        let DVec3 { x, y, z } = state.emitter(plan).after(state.deflector.rotation(plan)).apply(DVec3::Y);
        let beam = [libm::atan2(x, y), libm::asin(z.clamp(-1.0, 1.0))].map(degrees);
        for ([lo, hi], angle) in extent.iter_mut().zip(beam) {
            (*lo, *hi) = (lo.min(angle), hi.max(angle));
        }
        position = (position + GOLDEN) % 1.0;
        if position < share {
            beams.push(beam);
        }
    }
    Ok(beams)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::chart::Theme;
    use vlscan_survey::catalogue;

    fn pattern(id: &str) -> Pattern {
        let (known, _) = catalogue().unwrap();
        let (_, scanner) = known.scanners.iter().find(|(name, _)| name.ends_with(id)).unwrap();
        let pattern = Pattern::of(scanner).unwrap();
        let svg = pattern.drawing(scanner).file(Theme::Light);
        let drawn: usize = pattern.channels.iter().map(Vec::len).sum();
        assert_eq!(svg.matches("h0").count(), drawn);
        assert!((drawn as u64) < 2 * DOTS && drawn > 500, "{id}: {drawn}");
        pattern
    }

    #[test]
    fn patterns_fill_the_field_of_view_of_the_data_sheet() {
        // Velodyne Puck: all around, 16 channels from -15 to 15 degrees.
        let puck = pattern("#vlp16");
        let [[west, east], [down, up]] = puck.extent;
        assert!(west < -175.0 && east > 175.0, "{west} {east}");
        assert!((down + 15.0).abs() < 0.1 && (up - 15.0).abs() < 0.1, "{down} {up}");
        assert_eq!(puck.channels.len(), 16);
        // RIEGL VQ-840-G: 20 degrees across and 14 degrees along the track.
        let [[left, right], [down, up]] = pattern("#riegl_vq-840-g").extent;
        assert!((right - 14.0).abs() < 0.1 && (left + 14.0).abs() < 0.1, "{left} {right}");
        assert!((up - 20.0).abs() < 0.1 && (down + 20.0).abs() < 0.1, "{down} {up}");
        // Livox Mid-40: a circle of 38.4 degrees.
        let livox = pattern("#livox_mid-40");
        let farthest = livox.channels[0].iter().map(|[x, y]| x.hypot(*y)).fold(0.0, f64::max);
        assert!((farthest - 19.2).abs() < 0.4, "{farthest}");
    }
}
