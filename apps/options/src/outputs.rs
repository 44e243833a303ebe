//! Outputs of a pipeline file, and the request for outputs that follows from all options.

use super::groups::{Options, OutputOptions};
use super::values::Crs;
use serde::Deserialize;
use std::path::{Path, PathBuf};
use vlscan_base::diag::Diagnostics;
use vlscan_base::error::{Error, Result};
use vlscan_base::files;
use vlscan_session::output::{
    CloudSettings, Division, LasVersion, OutputRequest, PointFormat, Target, TrajectoryFormat,
};

vlscan_survey::key_table! {
/// An output. Points go to HELIOS++'s layout in the folder `output` when none is named.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OutputKeys = "[[output]]" {
    /// The file, relative to the working directory, or `-` for standard output; a folder with `per_leg`.
    pub path: PathBuf,
    /// `points`, or `trajectory`: the platform's poses as CSV, in the layout that `--trajectory` reads.
    /// Default: `points`.
    #[serde(default)]
    pub content: OutputContent,
    /// Format of the points, a name of `--format`. Default: from the extension, else `xyz`.
    #[serde(default)]
    pub format: Option<PointFormat>,
    /// One file for each leg or strip. Default: false.
    #[serde(default)]
    pub per_leg: bool,
    /// The folder gets HELIOS++'s layout, `PATH/SURVEY/TIME/leg000_points.xyz` and so on. Default: false.
    #[serde(default)]
    pub helios: bool,
}
}

impl OutputKeys {
    /// The points in a file or folder, with the default of every other key.
    pub fn of_path(path: PathBuf) -> OutputKeys {
        let content = OutputContent::default();
        OutputKeys { path, content, format: None, per_leg: false, helios: false }
    }
}

/// Contents of an output.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum OutputContent {
    /// The point cloud.
    #[default]
    Points,
    /// The platform's poses.
    Trajectory,
}

impl Options {
    /// Outputs. `creation` is the day for the headers of files.
    ///
    /// # Errors
    /// Names of files that tell no format; a coordinate reference system that cannot be read.
    pub fn output_request(&self, creation: (u16, u16)) -> Result<OutputRequest> {
        let output = &self.output;
        let sinks = self.sinks()?;
        let trajectory = match &self.trajectory_out {
            Some(path) => Some(("--trajectory-out", path, false)),
            None => {
                let mut outputs = self.outputs.iter().filter(|o| o.content == OutputContent::Trajectory);
                outputs.next().map(|o| ("the trajectory in [[output]]", &o.path, o.per_leg))
            }
        };
        if let Some((name, path, _)) = trajectory {
            check_content(name, path, "CSV")?;
        }
        let trajectory = trajectory.map(|(_, path, per_leg)| {
            let target = if is_stdout(path) { Target::Stdout } else { Target::File(path.clone()) };
            (if per_leg { with_file_per_leg(target) } else { target }, TrajectoryFormat::Csv)
        });
        let mut request = OutputRequest::default();
        request.sinks = sinks;
        request.cloud = output.cloud_settings(creation)?;
        request.waveforms = output.waveforms.is_on();
        request.pulses = output.pulses.is_on();
        request.zip = output.zip_output.is_on();
        request.split_by_channel = output.split_by_channel.is_on();
        request.trajectory = trajectory;
        request.frame_s = output.frame_s.map(|seconds| seconds.0);
        request.division = match output.tile {
            Some(size) => Some(Division::Tiles(size.0)),
            None => output.per_object.is_on().then_some(Division::Objects),
        };
        request.force = output.force.is_on();
        Ok(request)
    }

    /// Warns of formats that are chosen for outputs whose names determine another one.
    ///
    /// # Errors
    /// As for [`Options::output_request`].
    pub fn warn_of_unused_formats(&self, warnings: &mut Diagnostics) -> Result<()> {
        let (output, sinks) = (&self.output, self.sinks()?);
        let has = |is_of: &dyn Fn(PointFormat) -> bool| sinks.iter().any(|(_, format)| is_of(*format));
        let mut unused = Vec::new();
        if let Some(format) = output.format.filter(|format| !has(&|used| used == *format)) {
            unused.push(format!("--format {}", format.name()));
        }
        if output.las_output.is_on() && !has(&PointFormat::is_las) {
            unused.push("--las-output".to_owned());
        }
        if output.out.is_empty() && output.output.is_none() && output.format.is_none() {
            let points = self.outputs.iter().filter(|o| o.content == OutputContent::Points);
            for keys in points {
                let Some(format) = keys.format else { continue };
                if sink(&keys.path, Some(format), format)?.1 != format {
                    unused.push(format!("format = \"{}\" of {}", format.name(), keys.path.display()));
                }
            }
        }
        for choice in unused {
            warnings
                .warn(None, format!("{choice} has no effect: the extension determines the format"))
                .help("leave it out, or give the output the extension of this format");
        }
        Ok(())
    }

    /// Targets and formats of the points.
    pub(super) fn sinks(&self) -> Result<Vec<(Target, PointFormat)>> {
        let output = &self.output;
        let default_format = output.helios_format();
        if let Some(folder) = &output.output {
            check_folder("--output", folder)?;
            return Ok(vec![(Target::Helios(folder.clone()), default_format)]);
        }
        if !output.out.is_empty() {
            return output.out.iter().map(|path| sink(path, output.format, default_format)).collect();
        }
        let points = self.outputs.iter().filter(|o| o.content == OutputContent::Points);
        let mut sinks = points
            .map(|o| {
                let (target, format) = sink(&o.path, output.format.or(o.format), default_format)?;
                let target = match (o.helios, o.per_leg) {
                    (true, _) => Target::Helios(o.path.clone()),
                    (_, true) => with_file_per_leg(target),
                    _ => target,
                };
                Ok((target, format))
            })
            .collect::<Result<Vec<_>>>()?;
        if sinks.is_empty() {
            sinks.push((Target::Helios(PathBuf::from("output")), default_format));
        }
        Ok(sinks)
    }
}

impl OutputOptions {
    /// Leaves out the options of a file, over which `typed` ones go, that apply to none of these outputs: the
    /// command line names them instead of the file's, for which its options are.
    pub(super) fn leave_unused(&mut self, typed: &OutputOptions, sinks: &[(Target, PointFormat)]) {
        let has = |is_of: fn(PointFormat) -> bool| sinks.iter().any(|(_, format)| is_of(*format));
        if !has(PointFormat::has_frames) {
            self.frame_s = typed.frame_s;
            self.world_frame.clone_from(&typed.world_frame);
            self.sensor_frame.clone_from(&typed.sensor_frame);
        }
        if !has(PointFormat::is_las) {
            self.las10 = typed.las10;
            self.las_scale = typed.las_scale;
            self.las_extra = typed.las_extra;
            self.las_at_most = typed.las_at_most;
            self.wave_packets = typed.wave_packets;
        }
        let has_fields =
            has(|format| format.is_las() || matches!(format, PointFormat::PlyAscii | PointFormat::PlyBinary));
        let has_tables = has(|format| format.has_columns() && format != PointFormat::Xyz);
        let has_columns = self.columns.is_some();
        if !has_fields && (has_columns || !has_tables) {
            self.labels = typed.labels;
        }
        // A chosen column may hold the others.
        if !has_columns && !has(PointFormat::is_las) {
            self.true_positions = typed.true_positions;
        }
        if !has_columns && !has_fields && !has_tables {
            self.height_above_ground = typed.height_above_ground;
        }
        if !sinks.iter().any(|(target, _)| matches!(target, Target::Directory(_))) {
            self.tile = typed.tile;
            self.per_object = typed.per_object;
        }
        if !sinks.iter().any(|(target, _)| matches!(target, Target::Helios(_))) {
            self.zip_output = match self.waveforms.is_on() || self.pulses.is_on() {
                true => self.zip_output,
                false => typed.zip_output,
            };
        }
    }

    /// Settings of the points. `creation` is the day for the headers of files.
    fn cloud_settings(&self, creation: (u16, u16)) -> Result<CloudSettings> {
        let mut cloud = CloudSettings::default();
        cloud.creation = creation;
        cloud.crs = self.crs.as_ref().map(Crs::wkt).transpose()?;
        cloud.columns = self.columns.clone().map(|columns| columns.0);
        cloud.misses = self.misses.is_on();
        cloud.labels = self.labels.is_on();
        cloud.true_positions = self.true_positions.is_on();
        cloud.heights = self.height_above_ground.is_on();
        if let Some(world) = &self.world_frame {
            cloud.frame_names.world.clone_from(world);
        }
        if let Some(sensor) = &self.sensor_frame {
            cloud.frame_names.sensor.clone_from(sensor);
        }
        cloud.las.version = if self.las10.is_on() { LasVersion::V10 } else { LasVersion::V14 };
        cloud.las.scale = self.las_scale;
        cloud.las.at_most = self.las_at_most.map(|count| count.0);
        cloud.las.packets = self.wave_packets;
        cloud.las.extra = self.las_extra.unwrap_or_default();
        Ok(cloud)
    }

    /// The format of points in HELIOS++'s layout, and of files without a known extension.
    fn helios_format(&self) -> PointFormat {
        match (self.las_output.is_on() || self.las10.is_on(), self.zip_output.is_on()) {
            (true, true) => PointFormat::Laz,
            (true, false) => PointFormat::Las,
            (false, zip) => self.format.unwrap_or(if zip { PointFormat::Bin } else { PointFormat::Xyz }),
        }
    }
}

/// Refuses the name of a file beside the points if it is standard output, or that of a file of points: the
/// file of `option` has other `content`, such as CSV.
///
/// # Errors
/// [`Error::Input`].
pub fn check_companion(option: &str, path: &Path, content: &str) -> Result<()> {
    if files::means_stdout(path) {
        let message = format!("{option} {}: stdout is for points; name a file", path.display());
        return Err(Error::input(message));
    }
    check_content(option, path, content)
}

/// Refuses the name of a file of points, unless it may be text, for a file with other content.
///
/// # Errors
/// [`Error::Input`].
pub fn check_content(option: &str, path: &Path, content: &str) -> Result<()> {
    match PointFormat::of_file(path) {
        Some(Ok(format)) if !matches!(format, PointFormat::Csv | PointFormat::Xyz) => {
            let (shown, format) = (path.display(), format.name());
            let ending = content.to_lowercase();
            let message = format!("{option} {shown}: the file is {content}, not {format}");
            Err(Error::input_with_help(message, format!("give it a name that ends in .{ending}")))
        }
        _ => Ok(()),
    }
}

/// Refuses the name of a file of points for a folder that does not exist yet.
///
/// # Errors
/// [`Error::Input`].
pub fn check_folder(option: &str, path: &Path) -> Result<()> {
    match PointFormat::of_file(path) {
        Some(Ok(format)) if !path.is_dir() => {
            let (shown, format) = (path.display(), format.name());
            let message =
                format!("{option} {shown}: expected the name of a folder, found that of a {format} file");
            let folder = path.with_extension("");
            Err(Error::input_with_help(message, format!("name a folder, such as {}", folder.display())))
        }
        _ => Ok(()),
    }
}

fn with_file_per_leg(target: Target) -> Target {
    match target {
        Target::File(path) => Target::Directory(path),
        other => other,
    }
}

fn is_stdout(path: &Path) -> bool {
    path.as_os_str() == "STDOUT" || files::means_stdout(path)
}

/// Target of a path, and its format: from the extension, otherwise the requested one, otherwise `default`.
fn sink(path: &Path, requested: Option<PointFormat>, default: PointFormat) -> Result<(Target, PointFormat)> {
    if is_stdout(path) {
        return Ok((Target::Stdout, requested.unwrap_or(default)));
    }
    if path.as_os_str().is_empty() {
        return Err(Error::input("an output needs a path (`path`, -o, --output); \"-\" is standard output"));
    }
    let from_extension = if path.is_dir() { None } else { PointFormat::of_file(path) };
    let is_special_file = files::is_special(path);
    // A named pipe, such as the shell makes of >(...), has no extension.
    let target = match from_extension.is_some() || is_special_file {
        true => Target::File(path.to_path_buf()),
        false => Target::Directory(path.to_path_buf()),
    };
    let format = match (from_extension, requested) {
        (Some(Ok(from_extension)), Some(requested)) if from_extension.shares_extension(requested) => {
            requested
        }
        (Some(Ok(format)), _) => format,
        (_, Some(requested)) => requested,
        (None, None) => default,
        (Some(Err(unknown)), None) => return Err(Error::input(format!("{}: {unknown}", path.display()))),
    };
    Ok((target, format))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Precedence;

    #[test]
    fn files_beside_the_points_have_names_of_their_own() {
        let said = |path: &str| {
            let checked = check_companion("--parts", Path::new(path), "CSV");
            checked.map_or_else(|error| error.to_string(), |()| String::new())
        };
        for fine in ["parts.csv", "a/parts.txt", "parts.tsv", "parts"] {
            assert_eq!(said(fine), "");
        }
        for other in ["parts.las", "parts.geo.parquet", "PARTS.LAZ"] {
            assert!(said(other).contains("the file is CSV, not"), "{other}: {}", said(other));
        }
        assert!(said("-").contains("stdout is for points") && said("/dev/stdout").contains("stdout"));
        let folder = |path: &str| check_folder("-o", Path::new(path)).map_err(|error| error.to_string());
        assert!(["a", "a.b/c", "v1.2", "."].map(folder).iter().all(std::result::Result::is_ok));
        assert!(folder("a.laz").unwrap_err().contains("-o a.laz: expected the name of a folder"));
        let way = || PathBuf::from("way.ply");
        let typed = Options { trajectory_out: Some(way()), ..Options::default() };
        let content = OutputContent::Trajectory;
        let output = OutputKeys { path: way(), content, format: None, per_leg: false, helios: false };
        let of_file = Options { outputs: vec![output], ..Options::default() };
        for (options, name) in [(typed, "--trajectory-out"), (of_file, "the trajectory in [[output]]")] {
            let error = options.output_request((2026, 1)).unwrap_err().to_string();
            assert!(error.contains(&format!("{name} way.ply: the file is CSV, not ply")), "{error}");
        }
    }

    #[test]
    fn formats_that_names_do_not_have_are_named() {
        let said = |line: &str, outputs: &[(&str, PointFormat)]| -> Vec<String> {
            let mut options = Options::parse(line.split_whitespace().map(str::to_owned)).unwrap();
            let keys = |(path, format): &(&str, PointFormat)| OutputKeys {
                format: Some(*format),
                ..OutputKeys::of_path(PathBuf::from(path))
            };
            options.outputs = outputs.iter().map(keys).collect();
            let mut warnings = Diagnostics::default();
            options.warn_of_unused_formats(&mut warnings).unwrap();
            warnings.items().iter().map(|item| item.message.clone()).collect()
        };
        let none: &[(&str, PointFormat)] = &[];
        for fine in [
            "",
            "--format csv",
            "-o - --format csv",
            "-o a.las --format las",
            "-o a.ply --format ply-ascii",
            "-o a.las -o - --format csv",
            "--las-output --format las",
            "-o folder --las-output",
        ] {
            assert_eq!(said(fine, none), [""; 0], "{fine}");
        }
        assert!(said("-o a.las --format csv", none)[0].contains("--format csv has no effect"));
        assert!(said("-o a.csv --las-output", none)[0].contains("--las-output has no effect"));
        assert!(said("--las-output --format csv", none)[0].contains("--format csv has no effect"));
        let of_file = [("a.laz", PointFormat::Csv), ("b.dat", PointFormat::Csv)];
        let found = said("", &of_file);
        assert!(found.len() == 1 && found[0].contains("format = \"csv\" of a.laz"), "{found:?}");
        assert_eq!(said("-o c.csv", &of_file), [""; 0]);
    }

    #[test]
    fn options_of_a_file_are_for_its_own_outputs() {
        let parse = |line: &str| Options::parse(line.split_whitespace().map(str::to_owned)).unwrap().output;
        let file = || parse("--frame-s 0.1 --world-frame w --tile 5 --las10 --las-scale 0.01 --zip-output");
        let typed = parse("-o a.csv --las-scale 0.1");
        let mut found = typed.clone().over(file());
        found.leave_unused(&typed, &[(Target::File("a.csv".into()), PointFormat::Csv)]);
        assert!(found.frame_s.is_none() && found.world_frame.is_none() && found.tile.is_none());
        assert_eq!(
            (found.las_scale, found.las10.is_on(), found.zip_output.is_on()),
            (Some(0.1), false, false)
        );
        let mut found = typed.clone().over(file());
        found.leave_unused(&typed, &[(Target::Directory("a".into()), PointFormat::Laz)]);
        assert!(found.tile.is_some() && found.las10.is_on() && found.frame_s.is_none());
        let contents = || parse("--labels --true-positions --height-above-ground");
        let kept = |line: &str, format: PointFormat| {
            let typed = parse(line);
            let mut found = typed.clone().over(contents());
            found.leave_unused(&typed, &[(Target::Stdout, format)]);
            [found.labels.is_on(), found.true_positions.is_on(), found.height_above_ground.is_on()]
        };
        assert_eq!(kept("", PointFormat::Laz), [true; 3]);
        assert_eq!(kept("", PointFormat::Csv), [true, false, true]);
        assert_eq!(kept("", PointFormat::Xyz), [false; 3]);
        assert_eq!(kept("--columns X,Y,Z", PointFormat::Csv), [false, true, true]);
    }

    #[test]
    fn a_sink_is_a_stream_a_file_or_a_folder() {
        use PointFormat::{Copc, Las, Laz, Mcap, Pcd, PlyAscii, PlyBinary, RayCloud, Xyz};
        let file = |path: &str| Target::File(path.into());
        let folder = Target::Directory("folder".into());
        for (path, requested, expected) in [
            ("-", Some(Laz), (Target::Stdout, Laz)),
            ("a/b.PLY", None, (file("a/b.PLY"), PlyBinary)),
            ("folder", Some(Las), (folder.clone(), Las)),
            ("folder", None, (folder, Xyz)),
            // A name never lies.
            ("a.laz", Some(Xyz), (file("a.laz"), Laz)),
            ("a.copc.laz", Some(Xyz), (file("a.copc.laz"), Copc)),
            // Two formats share an extension.
            ("a.ply", Some(PlyAscii), (file("a.ply"), PlyAscii)),
            ("a.laz", Some(Copc), (file("a.laz"), Copc)),
            ("a.ply", Some(RayCloud), (file("a.ply"), RayCloud)),
            ("a.RayCloud.ply", None, (file("a.RayCloud.ply"), RayCloud)),
            ("a.pcd", None, (file("a.pcd"), Pcd)),
            ("a.mcap", None, (file("a.mcap"), Mcap)),
            ("a.dat", Some(Las), (file("a.dat"), Las)),
        ] {
            assert_eq!(sink(Path::new(path), requested, Xyz).unwrap(), expected, "{path}");
        }
        assert!(sink(Path::new("a.e58"), None, Xyz).is_err());
        #[cfg(unix)]
        {
            use std::os::unix::ffi::OsStrExt;
            let name = Path::new(std::ffi::OsStr::from_bytes(b"a\xff.copc.laz"));
            assert_eq!(sink(name, None, Xyz).unwrap(), (Target::File(name.into()), Copc));
        }
    }
}
