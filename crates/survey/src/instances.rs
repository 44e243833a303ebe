//! Tables of instances: the mesh and the placement of each instance, one per line.
//!
//! ```text
//! file,x,y,z,yaw,scale,scale_xy
//! beech_1.obj,431002.5,5412200.0,113.2,40,1.1,1.1
//! beech_2.obj,431009.1,5412203.7,113.0,275.5,0.9,1.3
//! ```
//!
//! `file` is searched beside the table, x, y and z are metres, yaw is degrees about the vertical axis from x to y,
//! scale is a factor, and scale_xy the factor of the mesh's x and y. Yaw, scale and scale_xy are optional (0, 1 and scale). A first line that begins with the word `file` is a
//! header; blank lines and lines that begin with `#` are skipped. Every line becomes a separate part.
//!
//! A table is used as a part of a scene (`<filter type="instances">` with the parameter `filepath`) or as a complete
//! scene (`scene = "trees.csv"`). After an `objloader` an empty `file` means the file of that loader, whose
//! parameters apply to all instances; filters between the loader and the table transform the mesh before it is placed,
//! filters after the table transform all instances together.

use super::context::Context;
use super::{Loader, MeshReading, Transform};
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use vlscan_base::diag::Place;
use vlscan_base::quantity;
use vlscan_geom::{DVec3, Rotation, radians};

pub(super) struct Row {
    pub loader: Loader,
    pub transform: Transform,
    pub place: Place,
}

/// Defaults and transform that apply to all lines of a table.
pub(super) struct Base {
    /// The file of lines without a file name.
    pub file: Option<PathBuf>,
    pub reading: MeshReading,
    /// Applied to the mesh before it is placed.
    pub transform: Transform,
}

/// Reads a table. Problems are recorded in `context`.
pub(super) fn read_table(context: &Context, path: &Path, base: &Base) -> Option<Vec<Row>> {
    let bytes = match context.read(path, MAX_TABLE_BYTES) {
        Ok(bytes) => bytes,
        Err(e) => {
            context.error_help(None, format!("cannot read {}: {e}", path.display()), "");
            return None;
        }
    };
    let first_line = || Place::in_line(path, 1, "", 0..0);
    if bytes.contains(&0) {
        context.error_help(
            first_line(),
            "expected a table of instances, found bytes that are not text",
            HELP,
        );
        return None;
    }
    let text = String::from_utf8_lossy(&bytes);
    let folder = path.parent().unwrap_or(Path::new(""));
    let mut known: HashMap<&str, Option<PathBuf>> = HashMap::new();
    let mut rows = Vec::new();
    let (mut may_be_heading, mut columns) = (true, 0);
    let end = text.as_ptr() as usize + text.len();
    for (number, line) in (1..).zip(text.lines()) {
        if line.len() > MAX_LINE_BYTES {
            let message = format!("a line of more than {MAX_LINE_BYTES} bytes, expected an instance");
            context.error_help(Place::in_line(path, number, line, 0..0), message, HELP);
            return None;
        }
        let content = line.trim_start_matches('\u{feff}').trim();
        if content.is_empty() || content.starts_with('#') {
            continue;
        }
        // One field more than a line can have shows that there are too many.
        let fields: Vec<&str> = content.splitn(MAX_FIELDS + 1, ',').map(str::trim).collect();
        let before = std::mem::replace(&mut columns, fields.len());
        let is_heading = std::mem::take(&mut may_be_heading) && fields[0].eq_ignore_ascii_case("file");
        if is_heading {
            continue;
        }
        let place = |field: &str| {
            let at = field.as_ptr() as usize - line.as_ptr() as usize;
            Place::in_line(path, number, line, at..at + field.len())
        };
        let is_last = content.as_ptr() as usize + content.len() == end;
        if is_last && fields.len() < before && fields.len() >= 4 {
            let message = format!("expected {before} fields as in the line before; is the file truncated?");
            context.error_help(place(content), message, HELP);
            continue;
        }
        let Some(transform) = read_numbers(context, &fields, &place) else { continue };
        let file = known.entry(fields[0]).or_insert_with(|| match (fields[0], &base.file) {
            ("", Some(file)) => Some(file.clone()),
            ("", None) => {
                context.error_help(place(content), "expected the name of a mesh file, found nothing", HELP);
                None
            }
            (name, _) => context.file_beside(name, folder, place(name)),
        });
        if transform.widening != 1.0 && !base.transform.is_upright() {
            let message = "scale_xy needs a mesh that is only turned about z before the table";
            context.error_help(place(content), message, "rotate the mesh in its file, or leave out scale_xy");
            continue;
        }
        if let Some(file) = file {
            let loader = Loader::MeshFiles { files: vec![file.clone()], reading: base.reading.clone() };
            let transform = transform.after(&base.transform);
            rows.push(Row { loader, transform, place: place(fields[0]) });
        }
    }
    if rows.is_empty() && !context.failed() {
        context.error_help(first_line(), "the table names no instance", HELP);
    }
    Some(rows)
}

/// Maximum size of a table, bytes.
const MAX_TABLE_BYTES: u64 = 1 << 29;
/// Maximum length of a line, bytes.
const MAX_LINE_BYTES: usize = 1 << 16;

const HELP: &str = "a line is file,x,y,z,yaw,scale,scale_xy";
const COMMAS: &str =
    "fields are separated by commas, and numbers have decimal points: file,x,y,z,yaw,scale,scale_xy";
const MAX_FIELDS: usize = 7;

fn read_numbers(context: &Context, fields: &[&str], place: &dyn Fn(&str) -> Place) -> Option<Transform> {
    if !(4..=MAX_FIELDS).contains(&fields.len()) {
        let found = if fields.len() > MAX_FIELDS { "more".to_owned() } else { fields.len().to_string() };
        let message = format!("expected four to seven fields, found {found}");
        let help = if fields.iter().any(|field| field.contains(';')) { COMMAS } else { HELP };
        context.error_help(place(fields[0]), message, help);
        return None;
    }
    let mut numbers = [0.0, 0.0, 0.0, 0.0, 1.0, f64::NAN];
    let mut sound = true;
    for (number, field) in numbers.iter_mut().zip(&fields[1..]) {
        match field.parse::<f64>().ok().filter(|n| quantity::NUMBER.contains(*n)) {
            Some(n) => *number = n,
            None => {
                context.error_help(place(field), format!("expected a number, found \"{field}\""), HELP);
                sound = false;
            }
        }
    }
    let [x, y, z, yaw, scale, scale_xy] = numbers;
    if scale == 0.0 {
        context.error_help(place(fields[5]), "a scale of 0 leaves nothing of the mesh", HELP);
        return None;
    }
    let widening = if scale_xy.is_nan() { 1.0 } else { scale_xy / scale };
    // The quotient of a tiny and a large factor may be 0 or infinite.
    if sound && !(widening > 0.0 && widening.is_finite()) {
        let message = format!("expected a scale_xy above 0 beside the scale {scale}, found {scale_xy}");
        context.error_help(place(fields[6]), message, HELP);
        return None;
    }
    let rotation = Rotation::about_z(radians(yaw));
    let transform = Transform { rotation, widening, scale, offset: DVec3::new(x, y, z), on_ground: 0 };
    sound.then_some(transform)
}

impl Transform {
    /// The composition `self ∘ first`; the grounding mode is that of `self` unless that is 0. If `self` widens, `first` must
    /// turn about z only.
    pub fn after(&self, first: &Transform) -> Transform {
        Transform {
            rotation: self.rotation.after(first.rotation),
            widening: self.widening * first.widening,
            scale: self.scale * first.scale,
            offset: self.apply(first.offset),
            on_ground: if self.on_ground != 0 { self.on_ground } else { first.on_ground },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{ReadOptions, read_scene};
    use std::fs;

    fn folder() -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        for name in ["a.obj", "b.obj"] {
            fs::write(folder.path().join(name), "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
        }
        folder
    }

    fn read(folder: &tempfile::TempDir, name: &str) -> vlscan_base::Result<crate::SceneRecipe> {
        let path = folder.path().join(name);
        read_scene(&path.to_string_lossy(), &ReadOptions::default()).map(|(scene, _)| scene)
    }

    #[test]
    fn a_table_is_a_scene() {
        let folder = folder();
        let text = "file,x,y,z,yaw,scale\n# oaks\na.obj, 1,2,3, 90, 2\n\nb.obj,4,5,6\r\n";
        fs::write(folder.path().join("t.csv"), text).unwrap();
        let scene = read(&folder, "t.csv").unwrap();
        assert_eq!(scene.parts.iter().map(|p| p.number).collect::<Vec<_>>(), [0, 1]);
        let p = scene.parts[0].transform.apply(DVec3::X);
        assert!((p - DVec3::new(1.0, 4.0, 3.0)).length() < 1e-15, "{p}");
        assert_eq!(scene.parts[1].transform.apply(DVec3::X), DVec3::new(5.0, 5.0, 6.0));
    }

    #[test]
    fn x_and_y_have_a_factor_of_their_own() {
        let folder = folder();
        fs::write(folder.path().join("t.csv"), "a.obj,1,2,3,90,2,5\n").unwrap();
        let part = read(&folder, "t.csv").unwrap().parts.remove(0);
        let (p, image) = (DVec3::new(1.0, 2.0, 3.0), DVec3::new(-9.0, 7.0, 9.0));
        assert!((part.transform.apply(p) - image).length() < 1e-13, "{}", part.transform.apply(p));
        assert!((part.transform.undo(image) - p).length() < 1e-13);
        for wrong in ["0", "-1", "nan", "inf"] {
            fs::write(folder.path().join("t.csv"), format!("a.obj,1,2,3,90,2,{wrong}\n")).unwrap();
            assert!(matches!(read(&folder, "t.csv"), Err(vlscan_base::Error::Input(_))), "{wrong}");
        }
    }

    #[test]
    fn a_table_stands_for_a_part() {
        let folder = folder();
        fs::write(folder.path().join("t.csv"), ",1,0,0\n,0,0,0,90\na.obj,0,0,0\n").unwrap();
        let filter = |kind: &str, params: &str| format!("<filter type=\"{kind}\">{params}</filter>");
        let param = |t: &str, k: &str, v: &str| format!("<param type=\"{t}\" key=\"{k}\" value=\"{v}\"/>");
        let part = [
            filter("objloader", &param("string", "filepath", "b.obj")),
            filter("translate", &param("vec3", "offset", "10;0;0")),
            filter("instances", &param("string", "filepath", "t.csv")),
            filter("scale", &param("double", "scale", "2")),
        ]
        .concat();
        let plain = filter("objloader", &param("string", "filepath", "a.obj"));
        let text =
            format!("<document><scene id=\"s\"><part>{part}</part><part>{plain}</part></scene></document>");
        fs::write(folder.path().join("s.xml"), text).unwrap();
        let scene = read(&folder, "s.xml").unwrap();
        assert_eq!(scene.parts.iter().map(|p| p.number).collect::<Vec<_>>(), [0, 1, 2, 3]);
        assert_eq!(scene.parts[0].transform.apply(DVec3::ZERO), DVec3::new(22.0, 0.0, 0.0));
        let turned = scene.parts[1].transform.apply(DVec3::ZERO);
        assert!((turned - DVec3::new(0.0, 20.0, 0.0)).length() < 1e-14, "{turned}");
        let Loader::MeshFiles { files, .. } = &scene.parts[0].loader else { panic!() };
        assert!(files[0].ends_with("b.obj"));
    }

    #[test]
    fn all_mistakes_of_a_table_are_named() {
        let folder = folder();
        let text = "a.obj,1,2\na.obj,1,x,3\nc.obj,1,2,3\n,1,2,3\na.obj,1,2,3,4,0\na.obj,1,2,inf\na.obj,1,2,3,4\na.obj,1,2,3";
        fs::write(folder.path().join("t.csv"), text).unwrap();
        let vlscan_base::Error::Input(problems) = read(&folder, "t.csv").unwrap_err() else { panic!() };
        let mut lines: Vec<usize> = problems.items().iter().flat_map(|d| d.lines()).collect();
        lines.sort_unstable();
        assert_eq!(lines, [1, 2, 3, 4, 5, 6, 8], "the last line has no end and a field less");
        fs::write(folder.path().join("t.csv"), "file,x,y,z\n").unwrap();
        assert!(matches!(read(&folder, "t.csv"), Err(vlscan_base::Error::Input(_))));
    }
}
