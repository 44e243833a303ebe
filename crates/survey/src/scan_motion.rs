//! Sense, phase, tilt and wander of deflectors: vlscan's own keys, which HELIOS++ ignores.

use super::fields::Fields;
use super::keys::{InstrumentKeys, WanderKeys};
use super::rows::{MAX_FILE_BYTES, RowLayout, RowProblem, read_rows};
use super::{AngleTable, Deflector, Device, ScanMotion, Swing, Wander};
use std::f64::consts::TAU;
use std::sync::Arc;
use vlscan_base::quantity::ANGLE;
use vlscan_geom::radians;

const K: InstrumentKeys = InstrumentKeys::KEYS;

/// Applies the keys of the deflector's motion, after those of the deflector.
pub(super) fn change_scan_motion(fields: &mut Fields, device: &mut Device) {
    let motion = &mut device.scan_motion;
    if matches!(device.deflector, Deflector::Pattern(_)) {
        refuse_of_pattern(fields);
        let tilt = std::mem::take(&mut motion.axis_tilt);
        *motion = ScanMotion { axis_tilt: tilt, ..ScanMotion::default() };
    }
    motion.is_reversed = fields.flag(K.scan_reverse, motion.is_reversed);
    if let Some(phase) = fields.optional(K.scan_phase_deg) {
        motion.phase = radians(phase.rem_euclid(360.0)) % TAU;
    }
    let are_tilts = |tilts: &[f64]| tilts.len() == 2 && tilts.iter().all(|tilt| tilt.abs() < 90.0);
    let tilts =
        fields.numbers(K.scan_axis_tilt_deg, are_tilts, "two angles between -90 and 90, about x and z");
    if let Some(&[x, z]) = tilts.as_deref() {
        motion.axis_tilt = [radians(x), radians(z)];
    }
    let is_line = matches!(device.deflector, Deflector::Fibres { .. });
    if is_line && fields.has(K.scan_wander) {
        match fields.is_toml() {
            true => fields.error(K.scan_wander, "needs optics that turn or swing, not \"line\""),
            false => fields.warn_of_effect(K.scan_wander, "with line optics"),
        }
        fields.ignore(&[K.scan_wander]);
    } else {
        motion.wander = read_wander(fields).or(motion.wander.take());
    }
    if is_line {
        motion.wander = None;
    }
    motion.swing = match device.deflector {
        Deflector::Oscillating { .. } => read_swing(fields, motion.swing),
        _ => Swing::default(),
    };
}

/// Rejects keys of a motion and its limits, which a table of beams does not have.
fn refuse_of_pattern(fields: &Fields) {
    let motion = [K.scan_reverse, K.scan_phase_deg, K.scan_wander];
    let limits = [K.scan_angle_max_deg, K.scan_freq_min_hz, K.scan_freq_max_hz];
    for key in motion.iter().chain(&limits).filter(|key| fields.has(**key)) {
        fields.error(*key, "needs optics that move, not \"pattern\", whose rows state all directions");
    }
}

/// Reads the swing of an oscillating mirror, which stays `before` unless the keys change it.
fn read_swing(fields: &mut Fields, before: Swing) -> Swing {
    let kinds = [("even", Swing::TurningPulses), ("sine", Swing::Sine)];
    let kind = fields.choice(K.mirror_motion, &kinds, None);
    let part = fields.optional(K.turning_part);
    match (kind, part) {
        (Some(Swing::Sine), Some(_)) => {
            let message = format!("is not for a sine (`{}`)", fields.name(K.mirror_motion));
            fields.error(K.turning_part, &message);
            Swing::Sine
        }
        (_, Some(part)) => Swing::TurningPart(part),
        (Some(kind), None) => kind,
        (None, None) => before,
    }
}

fn read_wander(fields: &mut Fields) -> Option<Wander> {
    if !fields.has_table(K.scan_wander) {
        let name = fields.text(K.scan_wander)?;
        return read_angles(fields, &name).map(|table| Wander::Table(Arc::new(table)));
    }
    let keys = WanderKeys::KEYS;
    let mut sine = fields.child(K.scan_wander, &WanderKeys::TABLE)?;
    let (amplitude, freq) = (sine.required_number(keys.amplitude_deg), sine.required_number(keys.freq_hz));
    let phase = radians(sine.number(keys.phase_deg, 0.0));
    sine.done(&[]);
    Some(Wander::Sine { amplitude: radians(amplitude?), freq: freq?, phase })
}

/// Lines of a time, s, ascending, and an angle, degrees.
fn read_angles(fields: &Fields, name: &str) -> Option<AngleTable> {
    let mut table = AngleTable { times: Vec::new(), degrees: Vec::new() };
    let columns = "two finite numbers: time in s and angle in degrees";
    let row = |&[time, angle]: &[f64; 2]| {
        if table.times.last().is_some_and(|last| time <= *last) {
            return Err(RowProblem::NotLater);
        }
        if !ANGLE.contains(angle) {
            return Err(RowProblem::Angle(ANGLE.expected));
        }
        table.times.push(time);
        table.degrees.push(angle);
        Ok(())
    };
    let place = fields.place(K.scan_wander);
    let help = "a line is a time in s and an angle in degrees, such as `0.25, -0.02`";
    let format = RowLayout { columns, help, headings: ["time_s", "angle_deg"] };
    read_rows(fields.context, name, (fields.folder(), MAX_FILE_BYTES), &place, &format, row)?;
    if table.times.is_empty() {
        fields.context.error_help(place, format!("`{name}` has no line of numbers"), help);
        return None;
    }
    Some(table)
}
