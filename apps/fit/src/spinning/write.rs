//! The pipeline file of a fitted sensor, and its planes as a scene.

use super::planes::Patch;
use super::{SpinningFit, TARGET_REFLECTANCE};
use libm::exp;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use vlscan_base::error::Result;
use vlscan_base::files::reads::refuse_input_of;
use vlscan_base::files::{FileGroup, refuse_unwritable};
use vlscan_geom::DVec3;

/// Pixels by which a plane reaches beyond the middles of the outermost ones: half a pixel, and half a column
/// by which beams that look aside are off.
const MARGIN: f64 = 0.75;
/// Steps of reflectances of planes per factor of e.
const STEPS: f64 = 20.0;
/// Minimum and maximum reflectance of a plane: retroreflectors have more than 1; more than 2 would be read as
/// per cent.
const REFLECTANCES: (f64, f64) = (1e-4, 1.95);

/// The files of a fitted sensor.
#[derive(Clone, Debug)]
pub struct SpinningFiles {
    /// The pipeline file.
    pub pipeline: PathBuf,
    /// Planes and their materials: a Wavefront mesh and its library.
    pub planes: Option<[PathBuf; 2]>,
}

impl SpinningFiles {
    /// The pipeline file and, if `planes` is given, the mesh of the planes with its library beside it.
    pub fn new(pipeline: &Path, planes: Option<&Path>) -> SpinningFiles {
        let with_materials = |planes: &Path| [planes.to_path_buf(), planes.with_extension("mtl")];
        SpinningFiles { pipeline: pipeline.to_path_buf(), planes: planes.map(with_materials) }
    }

    /// Checks that the files can be written: before a fit, which takes long. `inputs` are the recording and
    /// the calibration file.
    ///
    /// # Errors
    /// [`vlscan_base::error::Error::Input`]: a file exists and `force` is not set, or is an input.
    pub fn check(&self, inputs: [&Path; 2], force: bool) -> Result<()> {
        self.all().try_for_each(|path| {
            refuse_unwritable(path, force)?;
            refuse_input_of(path, inputs)
        })
    }

    /// All files, the pipeline first.
    pub fn all(&self) -> impl Iterator<Item = &PathBuf> {
        [&self.pipeline].into_iter().chain(self.planes.iter().flatten())
    }
}

impl SpinningFit {
    /// Writes the pipeline file with the scanner and, if `files` contains planes, with these as the scene of
    /// a static platform. `calibration` is the sensor's file, `command` the command line that made it.
    ///
    /// # Errors
    /// [`vlscan_base::error::Error::Io`]; a file exists and `force` is not set.
    pub fn write(
        &self,
        files: &SpinningFiles,
        (calibration, command): (&Path, &str),
        force: bool,
    ) -> Result<()> {
        files.all().try_for_each(|path| refuse_unwritable(path, force))?;
        let mut group = FileGroup::default();
        if let Some([planes, materials]) = &files.planes {
            let (mesh, table) = self.scene(materials);
            group.write(planes, force, mesh.as_bytes())?;
            group.write(materials, force, table.as_bytes())?;
        }
        let planes = files.planes.as_ref().map(|[planes, _]| planes.as_path());
        let pipeline = self.pipeline(planes, calibration, command);
        group.write(&files.pipeline, force, pipeline.as_bytes())?;
        group.commit()
    }

    fn pipeline(&self, planes: Option<&Path>, calibration: &Path, command: &str) -> String {
        let absolute = |path: &Path| {
            let path = std::path::absolute(path).unwrap_or_else(|_| path.to_path_buf());
            toml::Value::String(path.to_string_lossy().into_owned())
        };
        let (noise, detection, doubt) = (self.written_noise(), &self.detection, self.range_doubt());
        let mut text = format!("# {command}\n#\n# Estimated, with standard deviations:\n");
        // Writing to a string does not fail.
        self.figures().table().lines().for_each(|line| _ = writeln!(text, "#   {line}"));
        text.push('\n');
        match planes {
            Some(planes) => _ = writeln!(text, "scene = {}\n", absolute(planes)),
            None => {
                text.push_str("# scene = \"scene.xml\"         # what is scanned; or vlscan run --scene\n\n")
            }
        }
        text.push_str("[platform]\nkind = \"static\"\n\n[[leg]]\nposition_m = [0, 0, 0]\n\n");
        let _ = writeln!(text, "[scanner]\ncatalogue = {}", absolute(calibration));
        // Estimates that are not plausible are comments.
        let mark = if doubt.is_some() { "# " } else { "" };
        if let Some(reason) = &doubt {
            let _ = writeln!(text, "# left out: {reason}");
        }
        let _ = writeln!(
            text,
            "{mark}max_range = {{ range_m = {:.2}, reflectance = {TARGET_REFLECTANCE}, pulse_freq_hz = {} }}",
            self.max_range, self.scanner.pulse_freqs[0]
        );
        let noise_doubt = self.noise_doubt();
        let noise_mark = if noise_doubt.is_some() { "# " } else { "" };
        if let Some(reason) = &noise_doubt {
            let _ = writeln!(text, "# left out: {reason}");
        }
        let _ = writeln!(
            text,
            "{noise_mark}range_noise = {{ constant_m = {:.5}, shot_m = {:.5}, amplifier_m = {:.5}, \
             footprint = {:.3} }}",
            noise.constant, noise.shot, noise.amplifier, noise.footprint
        );
        let _ = writeln!(
            text,
            "{mark}threshold_photons = {}\ndropout_rate = {:.5}\nrange_step_m = {}",
            detection.photons, detection.dropout_rate, self.image.range_step
        );
        text
    }

    /// The planes as a Wavefront mesh of quadrangles and its table of materials, with reflectances from the
    /// recording.
    fn scene(&self, materials: &Path) -> (String, String) {
        let name = materials.file_name().unwrap_or_default().to_string_lossy();
        let (mut mesh, mut table) = (format!("mtllib {name}\n"), String::new());
        let mut steps: Vec<(i32, &Patch)> =
            self.planes.iter().map(|p| (self.reflectance_step(p), p)).collect();
        steps.sort_by_key(|(step, _)| *step);
        let mut last = None;
        for (number, (step, patch)) in steps.into_iter().enumerate() {
            if last.replace(step) != Some(step) {
                let reflectance = exp(f64::from(step) / STEPS);
                let _ = writeln!(table, "newmtl plane{step}\nhelios_reflectance {reflectance:.6}\n");
                let _ = writeln!(mesh, "usemtl plane{step}");
            }
            for corner in corners(patch) {
                let _ = writeln!(mesh, "v {:.5} {:.5} {:.5}", corner.x, corner.y, corner.z);
            }
            let first = 4 * number + 1;
            let _ = writeln!(mesh, "f {first} {} {} {}", first + 1, first + 2, first + 3);
        }
        (mesh, table)
    }

    /// Reflectance of a plane, as the step of a logarithmic scale.
    fn reflectance_step(&self, patch: &Patch) -> i32 {
        let facing = patch.strength * patch.range * patch.range / self.white / patch.cosine;
        libm::rint(libm::log(facing.clamp(REFLECTANCES.0, REFLECTANCES.1)) * STEPS) as i32
    }
}

/// The corners of the part of a plane that its pixels cover: those of the patch, moved out by the margin.
fn corners(patch: &Patch) -> [DVec3; 4] {
    let [rows, columns] = super::planes::PATCH;
    let point = |row: usize, column: usize| patch.samples[row * columns + column].point;
    let corner = |row: usize, column: usize| {
        let (next_row, next_column) =
            (if row == 0 { 1 } else { row - 1 }, if column == 0 { 1 } else { column - 1 });
        let at = point(row, column);
        at + (at - point(next_row, column)) * MARGIN + (at - point(row, next_column)) * MARGIN
    };
    [corner(0, 0), corner(0, columns - 1), corner(rows - 1, columns - 1), corner(rows - 1, 0)]
}
