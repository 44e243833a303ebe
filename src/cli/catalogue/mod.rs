//! `vlscan catalogue`: the scanners and platforms shipped with the program.

mod pattern;

use super::Console;
use super::aligned::{Side, aligned};
use super::args::{CatalogueArgs, CatalogueCommand, ShowArgs};
use crate::error::{Error, Result};
use crate::files::{FileWriter, Patched, write_stdout};
use crate::geom::degrees;
use crate::survey::{Deflector, Platform, PlatformKind, ReadOptions, Scanner, catalogue, find_scanner};
use pattern::Pattern;
use serde::Serialize;

/// Properties of a scanner by which users compare scanners; the figures are those of its first device.
#[derive(Serialize)]
struct ScannerRow {
    /// Reference to the scanner in surveys and pipelines.
    reference: String,
    name: String,
    optics: &'static str,
    channels: usize,
    divergence_mrad: f64,
    pulse_rates_hz: Vec<u32>,
    range_min_m: f64,
    /// `None` is unlimited.
    range_max_m: Option<f64>,
    /// Full angle of the deflection.
    field_of_view_deg: f64,
    /// Maximum rotation rate of the head; 0 without a head.
    head_deg_per_s: f64,
    wavelength_nm: f64,
    pulse_length_ns: f64,
    accuracy_m: f64,
    /// 0 is unlimited.
    max_returns: u32,
}

#[derive(Serialize)]
struct PlatformRow {
    reference: String,
    kind: &'static str,
    mount_offset_m: [f64; 3],
}

#[derive(Serialize)]
struct Rows {
    scanners: Vec<ScannerRow>,
    platforms: Vec<PlatformRow>,
}

pub fn run(args: &CatalogueArgs, console: &Console) -> Result<()> {
    if let Some(CatalogueCommand::Show(args)) = &args.command {
        return show(args, console);
    }
    let (known, warnings) = catalogue()?;
    console.warnings(&warnings);
    let wanted = |reference: &str, name: &str| {
        let part = args.filter.as_deref().unwrap_or_default().to_lowercase();
        reference.to_lowercase().contains(&part) || name.to_lowercase().contains(&part)
    };
    let rows = Rows {
        scanners: known
            .scanners
            .iter()
            .filter(|(r, s)| wanted(r, &s.name))
            .map(|(r, s)| scanner(r, s))
            .collect(),
        platforms: known
            .platforms
            .iter()
            .filter(|(r, _)| wanted(r, ""))
            .map(|(r, p)| platform(r, p))
            .collect(),
    };
    write_stdout(&if args.json { json(&rows)? } else { table(&rows) })?;
    if rows.scanners.is_empty() && rows.platforms.is_empty() {
        console.say("nothing in the catalogue has that in its name; `vlscan catalogue` lists everything");
    }
    Ok(())
}

/// Shows one scanner.
fn show(args: &ShowArgs, console: &Console) -> Result<()> {
    let (found, warnings) = find_scanner(&args.name, &ReadOptions::default())?;
    console.warnings(&warnings);
    let row = scanner(&args.name, &found);
    let pattern = Pattern::of(&found)?;
    if let Some(path) = &args.picture {
        if path.exists() && !args.force {
            return Err(Error::input(format!("{} exists; --force overwrites it", path.display())));
        }
        let mut file = FileWriter::create(path, args.force, Patched::Never)?;
        file.append(pattern.svg(&found).as_bytes())?;
        file.finish()?;
    }
    write_stdout(&if args.json { json(&row)? } else { figures(&row, &found, &pattern) })
}

/// The figures of a scanner, a line each.
fn figures(row: &ScannerRow, scanner: &Scanner, pattern: &Pattern) -> String {
    let device = &scanner.devices[0];
    let rates: Vec<String> = row.pulse_rates_hz.iter().map(|&hz| (f64::from(hz) / 1e3).to_string()).collect();
    let [_, name, optics, channels, divergence, _, range, _, wavelength, returns] = scanner_line(row);
    let lines = match device.scan_freq {
        (_, most) if most <= 0.0 => "any".to_owned(),
        (least, most) => format!("{least} to {most} per second"),
    };
    let head = match row.head_deg_per_s {
        0.0 => "does not turn".to_owned(),
        rate => format!("up to {rate}° per second"),
    };
    let [across, up] = pattern.extent.map(|[lo, hi]| match hi - lo {
        angle if angle >= 100.0 => format!("{angle:.0}"),
        angle => format!("{angle:.1}"),
    });
    let rows = [
        ("name", name),
        ("optics", optics),
        ("channels", channels),
        ("pulse rates", format!("{} kHz", rates.join(", "))),
        ("field of view", format!("{across}° across, {up}° up and down")),
        ("lines", lines),
        ("head", head),
        ("range", format!("{range} m")),
        ("accuracy", format!("{} m (standard deviation)", row.accuracy_m)),
        ("returns", returns),
        ("wavelength", format!("{wavelength} nm")),
        ("beam divergence", format!("{divergence} mrad (full angle at 1/e²)")),
        ("pulse length", format!("{} ns", row.pulse_length_ns)),
    ];
    aligned(&rows.map(|(name, value)| vec![name.to_owned(), value]), Side::Left)
}

fn json(rows: &impl Serialize) -> Result<String> {
    Ok(serde_json::to_string_pretty(rows).map_err(|e| Error::Internal(e.to_string()))? + "\n")
}

fn scanner(reference: &str, scanner: &Scanner) -> ScannerRow {
    // A scanner has at least one device.
    let device = &scanner.devices[0];
    let (optics, half_angle) = match device.deflector {
        Deflector::Polygon { effective_max, .. } => ("rotating", effective_max),
        Deflector::Oscillating { .. } => ("oscillating", device.scan_angle_max),
        Deflector::Conic => ("conic", device.scan_angle_max),
        Deflector::EllipticConic { .. } => ("elliptic", device.scan_angle_max),
        Deflector::Fibres { .. } => ("line", device.scan_angle_max),
        Deflector::Risley { .. } => ("risley", device.scan_angle_max),
    };
    ScannerRow {
        reference: reference.to_owned(),
        name: scanner.name.clone(),
        optics,
        channels: scanner.devices.len(),
        divergence_mrad: rounded(device.beam.divergence * 1e3),
        pulse_rates_hz: scanner.pulse_freqs.clone(),
        range_min_m: device.detector.range_min,
        range_max_m: Some(device.detector.range_max).filter(|&m| m.is_finite() && m < 1e6),
        field_of_view_deg: rounded(2.0 * degrees(half_angle)),
        head_deg_per_s: rounded(degrees(device.head.max_rate)),
        wavelength_nm: rounded(device.beam.wavelength),
        pulse_length_ns: device.beam.pulse_length,
        accuracy_m: device.detector.accuracy,
        max_returns: device.detector.max_returns,
    }
}

fn platform(reference: &str, platform: &Platform) -> PlatformRow {
    let kind = match platform.kind {
        PlatformKind::Static => "static",
        PlatformKind::LinearPath => "linear path",
        PlatformKind::GroundVehicle { .. } => "ground vehicle",
        PlatformKind::Multicopter(_) => "multicopter",
        PlatformKind::Interpolated(_) => "trajectory",
        PlatformKind::Stream(_) => "stream",
    };
    PlatformRow { reference: reference.to_owned(), kind, mount_offset_m: platform.mount.offset.to_array() }
}

/// Rounds away the digits that come from the conversion of units.
fn rounded(value: f64) -> f64 {
    (value * 1e6).round() / 1e6
}

fn table(rows: &Rows) -> String {
    let mut text = String::new();
    if !rows.scanners.is_empty() {
        let mut lines = vec![
            ["scanner", "name", "optics", "chan", "mrad", "kHz", "range m", "fov °", "nm", "returns"]
                .map(str::to_owned)
                .to_vec(),
        ];
        lines.extend(rows.scanners.iter().map(|row| scanner_line(row).to_vec()));
        text += &aligned(&lines, Side::Left);
    }
    if !rows.platforms.is_empty() {
        let mut lines = vec![["platform", "kind", "mount m"].map(str::to_owned).to_vec()];
        lines.extend(rows.platforms.iter().map(|p| {
            let [x, y, z] = p.mount_offset_m;
            vec![p.reference.clone(), p.kind.to_owned(), format!("{x} {y} {z}")]
        }));
        if !text.is_empty() {
            text.push('\n');
        }
        text += &aligned(&lines, Side::Left);
    }
    text
}

/// The cells of a scanner in the table.
fn scanner_line(s: &ScannerRow) -> [String; 10] {
    let kilohertz = |f: Option<&u32>| f.map_or(0.0, |&f| f64::from(f) / 1e3);
    let (least, most) = (kilohertz(s.pulse_rates_hz.iter().min()), kilohertz(s.pulse_rates_hz.iter().max()));
    let rates = if least == most { format!("{least}") } else { format!("{least}-{most}") };
    let far = s.range_max_m.map_or("∞".to_owned(), |m| m.to_string());
    let returns = if s.max_returns == 0 { "∞".to_owned() } else { s.max_returns.to_string() };
    [
        s.reference.clone(),
        s.name.clone(),
        s.optics.to_owned(),
        s.channels.to_string(),
        s.divergence_mrad.to_string(),
        rates,
        format!("{}-{far}", s.range_min_m),
        s.field_of_view_deg.to_string(),
        s.wavelength_nm.to_string(),
        returns,
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_of_a_scanner() {
        let (known, _) = catalogue().unwrap();
        let (reference, found) = known.scanners.iter().find(|s| s.0.ends_with("#riegl_vz400")).unwrap();
        let row = scanner(reference, found);
        assert_eq!((row.optics, row.channels, row.field_of_view_deg), ("rotating", 1, 100.0));
        assert!(
            row.reference.starts_with("data/") && row.divergence_mrad > 0.0 && !row.pulse_rates_hz.is_empty()
        );
    }
}
