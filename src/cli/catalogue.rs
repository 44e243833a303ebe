//! `vlscan catalogue`: the scanners and platforms shipped with the program.

use super::Console;
use super::args::{CatalogueArgs, CatalogueCommand, ListArgs, ShowArgs};
use super::coverage::has_extension;
use serde::Serialize;
use vlscan_base::aligned::{Side, aligned};
use vlscan_base::diag::nearest;
use vlscan_base::error::{Error, Result};
use vlscan_base::files::{refuse_unwritable, write_file, write_stdout};
use vlscan_base::quantity::number;
use vlscan_survey::{ReadOptions, Scanner, StatedFigures, catalogue, find_scanner};
use vlscan_tools::catalogue::{
    Pattern, PlatformFigures, ScannerFigures, Sources, field_figures, field_in_words,
};
use vlscan_tools::chart::Theme;

#[derive(Serialize)]
struct Rows {
    scanners: Vec<ScannerFigures>,
    platforms: Vec<PlatformFigures>,
}

pub fn run(args: &CatalogueArgs, console: &Console) -> Result<()> {
    match &args.command {
        Some(CatalogueCommand::Show(args)) => show(args, console),
        Some(CatalogueCommand::List(args)) => list(args, console),
        None => list(&args.list, console),
    }
}

/// Lists the entries that have all words of the filter.
fn list(args: &ListArgs, console: &Console) -> Result<()> {
    let (known, warnings) = catalogue()?;
    console.warnings(&warnings)?;
    let words: Vec<String> = args.filter.iter().map(|word| word.to_lowercase()).collect();
    let is_listed = |reference: &str, name: &str| {
        let (reference, name) = (reference.to_lowercase(), name.to_lowercase());
        words.iter().all(|word| reference.contains(word) || name.contains(word))
    };
    let rows = Rows {
        scanners: known
            .scanners
            .iter()
            .filter(|(r, s)| is_listed(r, &s.name))
            .map(|(r, s)| ScannerFigures::of(r, s))
            .collect::<Result<_>>()?,
        platforms: known
            .platforms
            .iter()
            .filter(|(r, _)| is_listed(r, ""))
            .map(|(r, p)| PlatformFigures::of(r, p))
            .collect(),
    };
    if rows.scanners.is_empty() && rows.platforms.is_empty() {
        let scanners = known.scanners.iter().map(|(reference, scanner)| (reference, scanner.name.as_str()));
        let entries: Vec<(&String, &str)> =
            scanners.chain(known.platforms.iter().map(|(reference, _)| (reference, ""))).collect();
        return Err(no_entry(&args.filter, &entries));
    }
    write_stdout(&if args.json { json(&rows)? } else { table(&rows) })
}

/// No entry, given as its reference and name, has all these words.
fn no_entry(words: &[String], entries: &[(&String, &str)]) -> Error {
    let has = |word: &str| {
        let word = word.to_lowercase();
        entries.iter().any(|(reference, name)| {
            reference.to_lowercase().contains(&word) || name.to_lowercase().contains(&word)
        })
    };
    let ids = || entries.iter().filter_map(|(reference, _)| Some(reference.split_once('#')?.1));
    let near = words.iter().filter(|word| !has(word)).find_map(|word| nearest(word, ids()));
    let help = match (words, near) {
        ([first, name], _) if nearest(first, ["show"]).is_some() => {
            format!("`vlscan catalogue show {name}` shows a scanner; options follow it")
        }
        (_, Some(near)) => format!("did you mean `{near}`?"),
        (_, None) => "`vlscan catalogue` lists all entries".to_owned(),
    };
    let typed: Vec<String> = words.iter().map(|word| format!("`{word}`")).collect();
    Error::input(format!("no entry of the catalogue has {} in its name; {help}", typed.join(" and ")))
}

/// A scanner with where its figures come from.
#[derive(Serialize)]
struct ShownScanner<'r> {
    #[serde(flatten)]
    figures: &'r ScannerFigures,
    sources: Sources<'r>,
}

/// Shows one scanner.
fn show(args: &ShowArgs, console: &Console) -> Result<()> {
    let (found, warnings) = find_scanner(&args.name, &ReadOptions::default())?;
    console.warnings(&warnings)?;
    let row = ScannerFigures::of(&args.name, &found)?;
    if let Some(path) = &args.picture {
        if !has_extension(path, &["svg"]) {
            let shown = path.display();
            return Err(Error::input(format!("--picture {shown}: expected a name that ends in .svg")));
        }
        refuse_unwritable(path, args.force)?;
        let picture = Pattern::of(&found)?.drawing(&found).file(Theme::Light);
        write_file(path, args.force, picture.as_bytes())?;
    }
    let text = match args.json {
        true => json(&ShownScanner { figures: &row, sources: Sources::of(&found) })?,
        false => figures(&row, &found),
    };
    write_stdout(&text)
}

/// The figures of a scanner, a line each.
fn figures(row: &ScannerFigures, scanner: &Scanner) -> String {
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
    // Optics, a single channel, optics without a rate of their own, a head that does not turn and any number
    // of returns are no figures, unless the entry names a source or a remark.
    let stated_of = |figures: &'static [&'static str], is_figure: bool| -> &'static [&'static str] {
        if is_figure || figures.iter().all(|figure| sources.names(figure)) { figures } else { &[] }
    };
    line("name", name, &[]);
    line("optics", optics, stated_of(&["optics"], false));
    line("channels", channels, stated_of(&["channels"], scanner.devices.len() > 1));
    line("pulse rates", format!("{} kHz", rates.join(", ")), &["pulseFreqs_Hz"]);
    let field = field_in_words(&row.field_of_view_deg, row.head_deg_per_s > 0.0);
    line("field of view", field, &field_figures(scanner, &sources));
    line("lines", lines, stated_of(&["scanFreqMin_Hz", "scanFreqMax_Hz"], device.scan_freq.1 > 0.0));
    line("head", head, stated_of(&["headRotatePerSecMax_deg"], row.head_deg_per_s > 0.0));
    // A range without an end is not a figure.
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
    line("returns", returns, stated_of(&["maxNOR"], row.max_returns > 0));
    line("wavelength", format!("{wavelength} nm"), &["wavelength_nm"]);
    let divergences: &[&str] = match row.divergence_y_mrad {
        Some(_) => &["beamDivergence_rad", "beamDivergenceY_rad"],
        None => &["beamDivergence_rad"],
    };
    line("beam divergence", format!("{divergence} mrad (full angle at 1/e²)"), divergences);
    let length = number(device.beam.stated_width.unwrap_or(row.pulse_length_ns));
    line("pulse length", format!("{length} ns{stated}"), &["pulseLength_ns"]);
    rows.extend(in_pipelines(&device.stated));
    aligned(&rows, Side::Left)
}

/// The figures that pipelines use instead of those of HELIOS++'s catalogue, with their sources.
fn in_pipelines(stated: &StatedFigures) -> Vec<Vec<String>> {
    let mrad = stated.divergence.map(|rad| (rad * 1e6).round() / 1e3);
    let figures = [
        ("accuracy", "accuracy_m", stated.accuracy, "m (standard deviation)"),
        ("wavelength", "wavelength_nm", stated.wavelength, "nm"),
        ("beam divergence", "beamDivergence_rad", mrad, "mrad (full angle at 1/e²)"),
        ("pulse length", "pulseLength_ns", stated.pulse_width, "ns (full width at half maximum)"),
        ("range from", "rangeMin_m", stated.range_min, "m"),
        ("dead time", "deadTime_ns", stated.dead_time, "ns"),
    ];
    let row = |(name, key, value, unit): (&str, &str, Option<f64>, &str)| {
        let source = stated.sources.iter().find(|source| source.figures.iter().any(|own| own == key));
        let source = source.map_or(String::new(), |source| source.name.clone());
        Some(vec![format!("{name} in pipelines"), format!("{} {unit}", number(value?)), source])
    };
    figures.into_iter().filter_map(row).collect()
}

fn json(rows: &impl Serialize) -> Result<String> {
    Ok(serde_json::to_string_pretty(rows).map_err(|e| Error::Internal(e.to_string()))? + "\n")
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
fn scanner_line(s: &ScannerFigures) -> [String; 10] {
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
    fn list_and_lines_tell_the_same_field() {
        let (known, _) = catalogue().unwrap();
        for (reference, found) in &known.scanners {
            let row = ScannerFigures::of(reference, found).unwrap();
            let shown = figures(&row, found);
            let line = shown.lines().find(|line| line.starts_with("field of view")).unwrap();
            let listed: Vec<f64> =
                line.split_whitespace().filter_map(|word| word.strip_suffix('°')?.parse().ok()).collect();
            assert_eq!(listed, row.field_of_view_deg, "{reference}: {line}");
        }
    }

    #[test]
    fn figures_without_a_source_are_named_beside_those_with_one() {
        let (known, _) = catalogue().unwrap();
        let line = |id: &str, name: &str| {
            let (reference, found) = known.scanners.iter().find(|s| s.0.ends_with(id)).unwrap();
            let shown = figures(&ScannerFigures::of(reference, found).unwrap(), found);
            shown.lines().find(|line| line.starts_with(name)).unwrap_or_else(|| panic!("{shown}")).to_owned()
        };
        // The source of its farthest echo says nothing of its least range.
        let range = line("#riegl_vux-1uav", "range");
        assert!(range.contains("3-∞ m ") && range.ends_with("  not verified"), "{range}");
        let farthest = line("#riegl_vux-1uav", "farthest echo");
        assert!(farthest.contains("920 m") && farthest.contains("at 60 %, 50 kHz"), "{farthest}");
        // Pipelines have the figure of a source.
        let replaced = line("#dji-zenmuse-l2-repetitive", "range  ");
        assert!(replaced.ends_with("  of HELIOS++'s catalogue, replaced in pipelines"), "{replaced}");
        for (id, name, value) in [
            ("#dji-zenmuse-l2-repetitive", "range from in pipelines", "  3 m  "),
            ("#livox-avia-non-repetitive", "accuracy in pipelines", "  0.02 m (standard deviation)  "),
            ("#riegl_vz400", "beam divergence in pipelines", "  0.35 mrad (full angle at 1/e²)  "),
        ] {
            let figure = line(id, name);
            assert!(figure.contains(value), "{figure}");
        }
        assert!(
            line("#riegl_minivux-3uav", "range").ends_with("data sheet, riegl.com, edition not recorded")
        );
        for (id, source) in [
            ("#vlp16", "User Manual 63-9243"),
            ("#riegl_vq-1560ii", "data sheet, riegl.com"),
            ("#leica_rtc360", "data sheet, leica"),
            ("#riegl_vq-840-g", "data sheet, riegl.com"),
            ("#dji-zenmuse-l1-non-repetitive", "Guidebook"),
            ("#riegl_vq_780i", "not verified"),
            ("#livox_hap", "120 by 25 degrees"),
        ] {
            let field = line(id, "field of view");
            assert!(field.contains(source), "{id}: {field}");
        }
    }
}
