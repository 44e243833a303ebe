//! Choices of a request that have no effect on any of its outputs.

use super::request::{OutputRequest, Target};
use vlscan_base::diag::Diagnostics;
use vlscan_base::files::is_special;
use vlscan_formats::{Column, ExtraDimensions, LasVersion, PointFormat};

/// Warns of columns and of options of formats that no output has a use for. Shards hold everything that they
/// are asked for, and the outputs that a merge makes of them are not known yet.
pub(super) fn warn_of_unused(request: &OutputRequest, problems: &mut Diagnostics) {
    if request.uses_columns() && !request.uses_all_columns() {
        warn_of_unused_columns(request, problems);
    }
    // Tables in memory are no files.
    if request.shard.is_some() || request.sinks.is_empty() {
        return;
    }
    let las = unused_options_of_las(request);
    if !las.is_empty() {
        let message = format!("{}: no output is LAS, LAZ or COPC", las.join(", "));
        problems.warn(None, message).help("-o points.laz");
    }
    let cloud = &request.cloud;
    let contents = [
        ("--labels", cloud.labels && !request.has_labels(), "las, laz or ply"),
        ("--height-above-ground", cloud.heights && !request.has_heights(), "las, laz, ply or csv"),
        ("--true-positions", cloud.true_positions && !request.has_true_positions(), "las or laz"),
    ];
    for (option, _, formats) in contents.into_iter().filter(|(_, is_unused, _)| *is_unused) {
        let message = format!("{option} has no effect: none of the outputs is {formats}");
        problems.warn(None, message).help("-o points.laz");
    }
    let may_stream = |(target, format): &(Target, PointFormat)| {
        *format == PointFormat::Las
            && match target {
                Target::Stdout => true,
                Target::File(path) => is_special(path),
                Target::Directory(_) | Target::Helios(_) => false,
            }
    };
    if request.cloud.las.at_most.is_some() && !request.sinks.iter().any(may_stream) {
        problems
            .warn(None, "--las-at-most: no output is LAS on a pipe; headers of files have the exact number")
            .help("-o - --format las");
    }
    let is_helios = |(target, _): &(Target, PointFormat)| matches!(target, Target::Helios(_));
    if request.zip && !request.waveforms && !request.pulses && !request.sinks.iter().any(is_helios) {
        problems
            .warn(None, "--zip-output: there are no waveforms and no pulses to compress")
            .help("-o points.laz or points.bin compresses points");
    }
}

/// The options of LAS that are not the default, if no output is LAS, LAZ or COPC.
fn unused_options_of_las(request: &OutputRequest) -> Vec<&'static str> {
    if request.has_las() {
        return Vec::new();
    }
    let las = &request.cloud.las;
    let options = [
        ("--las10", las.version != LasVersion::default()),
        ("--las-scale", las.scale.is_some()),
        ("--las-extra", las.extra != ExtraDimensions::default()),
        ("--wave-packets", las.packets.is_some()),
    ];
    options.into_iter().filter_map(|(option, is_given)| is_given.then_some(option)).collect()
}

/// Warns of chosen columns that no output has.
fn warn_of_unused_columns(request: &OutputRequest, problems: &mut Diagnostics) {
    let formats: Vec<PointFormat> = request.sinks.iter().map(|(_, format)| *format).collect();
    let unused = PointFormat::unused_columns(&formats, &request.cloud);
    if unused.is_empty() {
        return;
    }
    let has = |column: Column| unused.contains(&column);
    let other = match (has(Column::HeightAboveGround), has(Column::TrueX)) {
        (true, _) => "; --height-above-ground writes the height to las, laz and ply",
        (false, true) => "; --true-positions writes them to las and laz",
        (false, false) => "",
    };
    let names: Vec<&str> = unused.iter().map(|column| column.name()).collect();
    problems
        .warn(None, format!("--columns: the outputs have no {}", names.join(", ")))
        .help(format!("-o points.csv, .xyz, .arrow or .parquet{other}"));
}

#[cfg(test)]
mod tests {
    use super::*;
    use vlscan_formats::PacketPlace;

    /// The messages about a request with these outputs.
    fn said(sinks: &[(Target, PointFormat)], choose: impl Fn(&mut OutputRequest)) -> Vec<String> {
        let mut request = OutputRequest { sinks: sinks.to_vec(), ..OutputRequest::default() };
        choose(&mut request);
        let mut problems = Diagnostics::default();
        warn_of_unused(&request, &mut problems);
        problems.items().iter().map(|item| item.message.clone()).collect()
    }

    #[test]
    fn options_of_las_need_las() {
        use PointFormat::{Copc, Csv, Las, Laz};
        let file = |format| (Target::File("points".into()), format);
        let choose = |request: &mut OutputRequest| {
            request.cloud.las.version = LasVersion::V10;
            request.cloud.las.scale = Some(0.01);
            request.cloud.las.extra = ExtraDimensions::None;
            request.cloud.las.packets = Some(PacketPlace::Inside);
        };
        let found = said(&[file(Csv)], choose);
        assert_eq!(
            found,
            ["--las10, --las-scale, --las-extra, --wave-packets: no output is LAS, LAZ or COPC"]
        );
        for format in [Las, Laz, Copc] {
            assert!(said(&[file(Csv), file(format)], choose).is_empty(), "{format:?}");
        }
        assert!(said(&[file(Csv)], |_| ()).is_empty());
        let shard = |request: &mut OutputRequest| {
            choose(request);
            request.shard = Some(crate::output::ShardOutput { path: "0".into(), head: Vec::new() });
        };
        assert!(said(&[], shard).is_empty());
    }

    #[test]
    fn counts_for_headers_need_a_pipe_and_compression_needs_text() {
        let at_most = |request: &mut OutputRequest| request.cloud.las.at_most = Some(5);
        let file = |format| [(Target::File("points.las".into()), format)];
        assert!(said(&file(PointFormat::Las), at_most)[0].contains("--las-at-most"));
        assert!(said(&[(Target::Stdout, PointFormat::Laz)], at_most)[0].contains("--las-at-most"));
        assert!(said(&[(Target::Stdout, PointFormat::Las)], at_most).is_empty());
        let zip = |request: &mut OutputRequest| request.zip = true;
        assert!(said(&file(PointFormat::Csv), zip)[0].contains("--zip-output"));
        assert!(said(&[(Target::Helios("output".into()), PointFormat::Bin)], zip).is_empty());
        let pulses = |request: &mut OutputRequest| (request.zip, request.pulses) = (true, true);
        assert!(said(&file(PointFormat::Csv), pulses).is_empty());
    }
}
