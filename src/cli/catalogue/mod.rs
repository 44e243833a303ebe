//! `vlscan catalogue`: the scanners and platforms shipped with the program.

mod field;
mod pattern;
mod sources;

use super::Console;
use super::aligned::{Side, aligned};
use super::args::{CatalogueArgs, CatalogueCommand, ShowArgs};
use field::field_of_view;
use pattern::Pattern;
use serde::Serialize;
use sources::Sources;
use vlscan_base::diag::nearest;
use vlscan_base::error::{Error, Result};
use vlscan_base::files::{FileWriter, Patched, write_stdout};
use vlscan_base::quantity::number;
use vlscan_geom::degrees;
use vlscan_survey::{
    Deflector, Platform, PlatformKind, ReadOptions, Scanner, catalogue, find_scanner, width_of_pulse_length,
};

/// Properties of a scanner by which users compare scanners; the figures are those of its first device.
#[derive(Serialize)]
struct ScannerRow {
    /// Reference to the scanner in surveys and pipelines.
    reference: String,
    name: String,
    optics: &'static str,
    channels: usize,
    /// Along the emitter's x axis.
    divergence_mrad: f64,
    /// Along the emitter's z axis, of elliptic beams.
    divergence_y_mrad: Option<f64>,
    pulse_rates_hz: Vec<u32>,
    range_min_m: f64,
    /// `None` is unlimited.
    range_max_m: Option<f64>,
    /// Full angle of the field, or of its two extents: all around, and up and down, of a head that turns; each at most 360.
    field_of_view_deg: Vec<f64>,
    /// Maximum rotation rate of the head; 0 without a head.
    head_deg_per_s: f64,
    wavelength_nm: f64,
    /// In the measure of HELIOS++, which surveys in XML keep without corrections.
    pulse_length_ns: f64,
    /// Full width at half maximum.
    pulse_fwhm_ns: f64,
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
    console.warnings(&warnings)?;
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
            .collect::<Result<_>>()?,
        platforms: known
            .platforms
            .iter()
            .filter(|(r, _)| wanted(r, ""))
            .map(|(r, p)| platform(r, p))
            .collect(),
    };
    if rows.scanners.is_empty() && rows.platforms.is_empty() {
        let typed = args.filter.as_deref().unwrap_or_default();
        let references =
            known.scanners.iter().map(|(name, _)| name).chain(known.platforms.iter().map(|(name, _)| name));
        let ids = references.filter_map(|reference| Some(reference.split_once('#')?.1));
        let help = match nearest(typed, ids) {
            Some(near) => format!("did you mean `{near}`?"),
            None => "`vlscan catalogue` lists everything".to_owned(),
        };
        return Err(Error::input(format!("nothing in the catalogue has `{typed}` in its name; {help}")));
    }
    write_stdout(&if args.json { json(&rows)? } else { table(&rows) })
}

/// Shows one scanner.
fn show(args: &ShowArgs, console: &Console) -> Result<()> {
    let (found, warnings) = find_scanner(&args.name, &ReadOptions::default())?;
    console.warnings(&warnings)?;
    let row = scanner(&args.name, &found)?;
    if let Some(path) = &args.picture {
        if path.exists() && !args.force {
            return Err(Error::input(format!("{} exists; --force overwrites it", path.display())));
        }
        let picture = Pattern::of(&found)?.svg(&found);
        let mut file = FileWriter::create(path, args.force, Patched::Never)?;
        file.append(picture.as_bytes())?;
        file.finish()?;
    }
    let text = match args.json {
        true => json(&ShownScanner { figures: &row, sources: Sources::of(&found) })?,
        false => figures(&row, &found),
    };
    write_stdout(&text)
}

/// The figures of a scanner, a line each.
fn figures(row: &ScannerRow, scanner: &Scanner) -> String {
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
    let stated = match device.beam.stated_width {
        Some(_) => " (full width at half maximum)".to_owned(),
        None => format!(" in the measure of HELIOS++, {} ns at half maximum", number(row.pulse_fwhm_ns)),
    };
    let sources = Sources::of(scanner);
    let mut rows = Vec::new();
    let mut line = |name: &str, value: String, figures: &[&str]| {
        rows.push(vec![name.to_owned(), value, sources.of_figures(figures)]);
    };
    line("name", name, &[]);
    line("optics", optics, &[]);
    line("channels", channels, &["channels"]);
    line("pulse rates", format!("{} kHz", rates.join(", ")), &["pulseFreqs_Hz"]);
    let field = field::in_words(&row.field_of_view_deg, row.head_deg_per_s > 0.0);
    line("field of view", field, &field::figures(scanner, &sources));
    line("lines", lines, &["scanFreqMin_Hz", "scanFreqMax_Hz"]);
    line("head", head, &["headRotatePerSecMax_deg"]);
    // A range without an end is no figure.
    let ranges: &[&str] =
        if row.range_max_m.is_some() { &["rangeMin_m", "rangeMax_m"] } else { &["rangeMin_m"] };
    line("range", format!("{range} m"), ranges);
    if let Some(target) = device.receiver.max_range {
        let rate = target.pulse_freq.map_or(String::new(), |hz| format!(" at {} kHz", number(hz / 1e3)));
        let reflectance = number(100.0 * target.reflectance);
        let value = format!("{} m for a target that reflects {reflectance} %{rate}", number(target.range));
        line("farthest echo", value, &["maxRange"]);
    }
    line("accuracy", format!("{} m (standard deviation)", row.accuracy_m), &["accuracy_m"]);
    line("returns", returns, &["maxNOR"]);
    line("wavelength", format!("{wavelength} nm"), &["wavelength_nm"]);
    let divergences: &[&str] = match row.divergence_y_mrad {
        Some(_) => &["beamDivergence_rad", "beamDivergenceY_rad"],
        None => &["beamDivergence_rad"],
    };
    line("beam divergence", format!("{divergence} mrad (full angle at 1/e²)"), divergences);
    let length = number(device.beam.stated_width.unwrap_or(row.pulse_length_ns));
    line("pulse length", format!("{length} ns{stated}"), &["pulseLength_ns"]);
    aligned(&rows, Side::Left)
}

fn json(rows: &impl Serialize) -> Result<String> {
    Ok(serde_json::to_string_pretty(rows).map_err(|e| Error::Internal(e.to_string()))? + "\n")
}

fn scanner(reference: &str, scanner: &Scanner) -> Result<ScannerRow> {
    // A scanner has at least one device.
    let device = &scanner.devices[0];
    let optics = match device.deflector {
        Deflector::Polygon { .. } => "rotating",
        Deflector::Oscillating { .. } => "oscillating",
        Deflector::Conic => "conic",
        Deflector::EllipticConic { .. } => "elliptic",
        Deflector::Fibres { .. } => "line",
        Deflector::Risley { .. } => "risley",
        Deflector::Custom(_) => "custom",
    };
    let beam = &device.beam;
    Ok(ScannerRow {
        reference: reference.to_owned(),
        name: scanner.name.clone(),
        optics,
        channels: scanner.devices.len(),
        divergence_mrad: rounded(beam.divergence * 1e3),
        divergence_y_mrad: beam.divergence_y.map(|angle| rounded(angle * 1e3)),
        pulse_rates_hz: scanner.pulse_freqs.clone(),
        range_min_m: device.detector.range_min,
        range_max_m: Some(device.detector.range_max).filter(|&m| m.is_finite() && m < 1e6),
        field_of_view_deg: field_of_view(scanner)?,
        head_deg_per_s: rounded(degrees(device.head.max_rate)),
        wavelength_nm: rounded(beam.wavelength),
        pulse_length_ns: beam.pulse_length,
        pulse_fwhm_ns: rounded(width_of_pulse_length(beam.length(true))),
        accuracy_m: device.detector.accuracy,
        max_returns: device.detector.max_returns,
    })
}

/// A scanner with where its figures come from.
#[derive(Serialize)]
struct ShownScanner<'r> {
    #[serde(flatten)]
    figures: &'r ScannerRow,
    sources: Sources<'r>,
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
        match s.divergence_y_mrad {
            Some(other) => format!("{}×{other}", s.divergence_mrad),
            None => s.divergence_mrad.to_string(),
        },
        rates,
        format!("{}-{far}", s.range_min_m),
        s.field_of_view_deg.iter().map(f64::to_string).collect::<Vec<_>>().join("×"),
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
        let row = scanner(reference, found).unwrap();
        assert_eq!(
            (row.optics, row.channels, &row.field_of_view_deg[..]),
            ("rotating", 1, &[360.0, 100.0][..])
        );
        assert!(
            row.reference.starts_with("data/") && row.divergence_mrad > 0.0 && !row.pulse_rates_hz.is_empty()
        );
    }

    #[test]
    fn list_and_lines_tell_the_same_field() {
        let (known, _) = catalogue().unwrap();
        for (reference, found) in &known.scanners {
            let row = scanner(reference, found).unwrap();
            let shown = figures(&row, found);
            let line = shown.lines().find(|line| line.starts_with("field of view")).unwrap();
            let told: Vec<f64> =
                line.split_whitespace().filter_map(|word| word.strip_suffix('°')?.parse().ok()).collect();
            assert_eq!(told, row.field_of_view_deg, "{reference}: {line}");
        }
    }

    #[test]
    fn figures_without_a_source_are_named_beside_those_with_one() {
        let (known, _) = catalogue().unwrap();
        let line = |id: &str, name: &str| {
            let (reference, found) = known.scanners.iter().find(|s| s.0.ends_with(id)).unwrap();
            let shown = figures(&scanner(reference, found).unwrap(), found);
            shown.lines().find(|line| line.starts_with(name)).unwrap_or_else(|| panic!("{shown}")).to_owned()
        };
        // The source of its farthest echo says nothing of its least range.
        let range = line("#dji-zenmuse-l2-repetitive", "range");
        assert!(range.contains("2-∞ m ") && range.ends_with("  not compared with a data sheet"), "{range}");
        let farthest = line("#dji-zenmuse-l2-repetitive", "farthest echo");
        assert!(farthest.contains("490 m") && farthest.contains("between both"), "{farthest}");
        assert!(
            line("#riegl_minivux-3uav", "range").ends_with("data sheet, riegl.com, edition not recorded")
        );
        for (id, source) in [
            ("#vlp16", "User Manual 63-9243"),
            ("#riegl_vq-1560ii", "data sheet, riegl.com"),
            ("#leica_rtc360", "data sheet, leica"),
            ("#riegl_vq-840-g", "data sheet, riegl.com"),
            ("#dji-zenmuse-l1-non-repetitive", "Guidebook"),
            ("#riegl_vz400", "not compared"),
        ] {
            let field = line(id, "field of view");
            assert!(field.contains(source), "{id}: {field}");
        }
    }
}
