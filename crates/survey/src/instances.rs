//! Tables of instances: the mesh and the placement of each instance, one per line.
//!
//! ```text
//! file,x,y,z,yaw,scale,scale_xy
//! beech_1.obj,431002.5,5412200.0,113.2,40,1.1,1.1
//! beech_2.obj,431009.1,5412203.7,113.0,275.5,0.9,1.3
//! ```
//!
//! `file` is searched next to the table, x, y and z are metres, yaw is degrees about the vertical axis from x
//! to y, scale is a factor, and scale_xy the factor of the mesh's x and y. Yaw, scale and scale_xy are
//! optional (0, 1 and scale). A first line without a number names the columns, in any order; without headings
//! the order is that of the example. Blank lines and lines that begin with `#` are skipped. Every line
//! becomes a separate part.
//!
//! A table is used as a part of a scene (`<filter type="instances">` with the parameter `filepath`) or as a
//! complete scene (`scene = "trees.csv"`). After an `objloader` an empty `file` means the file of that
//! loader, whose parameters apply to all instances; filters between the loader and the table transform the
//! mesh before it is placed, filters after the table transform all instances together.

use super::context::Context;
use super::text::decode_table;
use super::{Loader, MeshReading, Transform};
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use vlscan_base::columns::{comma_note, is_number};
use vlscan_base::diag::{Diagnostics, Place};
use vlscan_base::quantity;
use vlscan_base::recognise::{Expected, foreign};
use vlscan_geom::{DVec3, Rotation, radians};
use vlscan_tables::{Headings, Line, Quantity, Schema, TextTable, Use};

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

/// The columns of a table, in the order of tables without headings.
const SCHEMA: Schema = Schema {
    columns: &[
        (Quantity::File, Use::Optional),
        (Quantity::X, Use::Required),
        (Quantity::Y, Use::Required),
        // `height` is that of a tree; instances are scaled by a factor.
        (Quantity::TreeHeight, Use::Unread(Some((Quantity::Z, HEIGHT)))),
        (Quantity::Z, Use::Required),
        (Quantity::Yaw, Use::Optional),
        (Quantity::Scale, Use::Optional),
        (Quantity::ScaleXy, Use::Optional),
        (Quantity::Roll, Use::Refused(ONLY_YAW)),
        (Quantity::Pitch, Use::Refused(ONLY_YAW)),
        (Quantity::QuaternionW, Use::Refused(ONLY_YAW)),
        (Quantity::QuaternionX, Use::Refused(ONLY_YAW)),
        (Quantity::QuaternionY, Use::Refused(ONLY_YAW)),
        (Quantity::QuaternionZ, Use::Refused(ONLY_YAW)),
        (Quantity::Latitude, Use::Refused(PROJECT)),
        (Quantity::Longitude, Use::Refused(PROJECT)),
    ],
    is_unique: true,
    help: HELP,
};

/// The columns of a line without headings.
const ORDER: [Quantity; 7] = [
    Quantity::File,
    Quantity::X,
    Quantity::Y,
    Quantity::Z,
    Quantity::Yaw,
    Quantity::Scale,
    Quantity::ScaleXy,
];
/// Minimum number of fields of a line without headings.
const MIN_FIELDS: usize = 4;
/// Maximum size of a table, bytes.
const MAX_TABLE_BYTES: u64 = 1 << 29;
/// Maximum length of a line, bytes.
const MAX_LINE_BYTES: usize = 1 << 16;

const HELP: &str = "the columns are file, x, y, z, yaw (degrees from x to y), scale and scale_xy (factors)";
const ONLY_YAW: &str =
    "an instance turns about the vertical only: leave out the column, or turn the mesh itself";
const HEIGHT: &str =
    "a height may be that of a tree: if it is the elevation of the ground, rename the column to `z`";
const PROJECT: &str =
    "project the positions to metres first: gdaltransform -s_srs EPSG:4326 -t_srs EPSG:25832";
const HEADING: &str = "yaw counts from x to y; of a heading clockwise from north it is 90 - heading";

/// Reads a table. Problems are recorded in `context`.
pub(super) fn read_table(context: &Context, path: &Path, base: &Base) -> Option<Vec<Row>> {
    let text = read_text(context, path)?;
    let mut table = TextTable::new(path, &text);
    let mut reader = Reader { context, path, base, columns: None, files: HashMap::new() };
    let (mut rows, mut before, mut is_first) = (Vec::new(), 0, true);
    while let Some(mut line) = table.next() {
        if line.text.len() > MAX_LINE_BYTES {
            let message = format!("a line of more than {MAX_LINE_BYTES} bytes, expected an instance");
            context.error_help(Place::in_line(path, line.number, "", 0..0), message, HELP);
            return None;
        }
        if std::mem::take(&mut is_first) && !line.fields.iter().any(|field| is_number(field)) {
            reader.columns = Some(reader.headings(&table, &line)?);
            continue;
        }
        let is_cut = !text.ends_with(['\n', '\r']) && text.ends_with(line.text) && line.fields.len() < before;
        before = line.fields.len();
        rows.extend(reader.row(&table, &mut line, is_cut));
    }
    if rows.is_empty() && !context.failed() {
        context.error_help(Place::in_line(path, 1, "", 0..0), "the table names no instance", HELP);
    }
    Some(rows)
}

fn read_text(context: &Context, path: &Path) -> Option<String> {
    let bytes = match context.read(path, MAX_TABLE_BYTES) {
        Ok(bytes) => bytes,
        Err(e) => {
            context.unread(None, path, &e);
            return None;
        }
    };
    if let Some(found) = foreign(path, &bytes, &Expected::INSTANCES) {
        found.report(path, &mut context.problems.borrow_mut());
        return None;
    }
    let is_wide = bytes.starts_with(b"\xff\xfe") || bytes.starts_with(b"\xfe\xff");
    let place = Place::in_line(path, 1, "", 0..0);
    if bytes.contains(&0) && !is_wide {
        context.error_help(place, "expected a table of instances, found bytes that are not text", HELP);
        return None;
    }
    match decode_table(&bytes) {
        Ok((text, guess)) => {
            if let Some(guess) = guess {
                context.warn(place, guess);
            }
            Some(text)
        }
        Err(e) => {
            context.error_help(place, e.to_string(), HELP);
            None
        }
    }
}

struct Reader<'c> {
    context: &'c Context,
    path: &'c Path,
    base: &'c Base,
    /// `None` for tables without headings.
    columns: Option<Headings>,
    /// The files that the table has named so far.
    files: HashMap<String, Option<PathBuf>>,
}

impl Reader<'_> {
    /// The columns by their headings; `None` after errors.
    fn headings(&self, table: &TextTable, line: &Line) -> Option<Headings> {
        let headings = Headings::of(&line.fields, &SCHEMA);
        let place = table.place(line, None);
        let mut problems = Diagnostics::default();
        headings.report(&SCHEMA, Some(&place), &mut problems);
        if !headings.has(Quantity::File) && self.base.file.is_none() {
            problems.error(Some(place.clone()), "no column file").help(HELP);
        }
        if let Some(yaw) = headings.get(Quantity::Yaw).filter(|yaw| !yaw.name.to_lowercase().contains("yaw"))
        {
            let message = format!("column `{}` counts clockwise from north, expected yaw", yaw.name);
            problems.error(Some(place), message).help(HEADING);
        }
        let is_fatal = problems.is_fatal(false);
        self.context.take(problems);
        (!is_fatal).then_some(headings)
    }

    /// The instance of a line; `None` after errors. `is_cut` is true if the line has no line break and fewer
    /// fields than the previous line.
    fn row(&mut self, table: &TextTable, line: &mut Line, is_cut: bool) -> Option<Row> {
        let context = self.context;
        let width = line.fields.len();
        if self.columns.is_none() && is_cut && width >= MIN_FIELDS {
            let message = "fewer fields than in the line before; is the file truncated?";
            context.error_help(table.place(line, None), message, HELP);
            return None;
        }
        let expected = self.columns.as_ref().map(|columns| columns.width);
        if let Err(e) = line.fit(
            expected.unwrap_or(width.clamp(MIN_FIELDS, ORDER.len())),
            if expected.is_some() { "the heading" } else { "file,x,y,z,yaw,scale,scale_xy" },
            table.separator(),
        ) {
            let help = if e.help.is_empty() { HELP } else { e.help };
            context.error_help(table.place(line, None), e.message, help);
            return None;
        }
        let transform = self.transform(table, line)?;
        let (name, at) = match self.column(Quantity::File) {
            Some((column, _)) => (line.fields.get(column).map_or("", AsRef::as_ref), Some(column)),
            None => ("", None),
        };
        let place = table.place(line, at);
        if transform.widening != 1.0 && !self.base.transform.is_upright() {
            let message = "scale_xy needs a mesh that is only turned about z before the table";
            let help = "rotate the mesh in its file, or leave out scale_xy";
            context.error_help(table.place(line, None), message, help);
            return None;
        }
        let loader =
            Loader::MeshFiles { files: vec![self.file(name, &place)?], reading: self.base.reading.clone() };
        Some(Row { loader, transform: transform.after(&self.base.transform), place })
    }

    /// Position and unit of the column of a quantity.
    fn column(&self, quantity: Quantity) -> Option<(usize, Option<f64>)> {
        match &self.columns {
            Some(headings) => headings.get(quantity).map(|column| (column.index, column.factor)),
            None => ORDER.iter().position(|of| *of == quantity).map(|column| (column, None)),
        }
    }

    fn file(&mut self, name: &str, place: &Place) -> Option<PathBuf> {
        if let Some(known) = self.files.get(name) {
            return known.clone();
        }
        let file = match (name, &self.base.file) {
            ("", Some(file)) => Some(file.clone()),
            ("", None) => {
                let message = "expected the name of a mesh file, found nothing";
                self.context.error_help(place.clone(), message, HELP);
                None
            }
            (name, _) => {
                self.context.sibling_file(name, self.path.parent().unwrap_or(Path::new("")), place.clone())
            }
        };
        self.files.insert(name.to_owned(), file.clone());
        file
    }

    fn transform(&self, table: &TextTable, line: &Line) -> Option<Transform> {
        let mut is_valid = true;
        let mut number = |quantity: Quantity, default: Option<f64>| {
            let column = self.column(quantity).filter(|(column, _)| *column < line.fields.len());
            let Some((column, factor)) = column else { return default.unwrap_or_default() };
            let field = line.fields[column].as_ref();
            if let Some(default) = default.filter(|_| field.is_empty()) {
                return default;
            }
            let is_factor = matches!(quantity, Quantity::Scale | Quantity::ScaleXy);
            let bounds = if is_factor { quantity::POSITIVE } else { quantity::NUMBER };
            let all = line.fields.iter().map(|field| field.as_bytes());
            let parsed = table.separator().number(field.as_bytes(), all);
            let value = parsed.filter(|value| bounds.contains(*value));
            if value.is_none() {
                let name = quantity.name();
                let message = match (quantity, parsed) {
                    (Quantity::Scale | Quantity::ScaleXy, Some(0.0)) => {
                        "a scale of 0 leaves nothing of the mesh".to_owned()
                    }
                    (Quantity::Scale | Quantity::ScaleXy, Some(scale)) if scale < 0.0 => {
                        format!("a scale of {field} mirrors the mesh; expected {}", bounds.expected)
                    }
                    _ => format!("expected a number for {name}, found \"{field}\"{}", comma_note(field)),
                };
                self.context.error_help(table.place(line, Some(column)), message, HELP);
                is_valid = false;
            }
            let value = value.unwrap_or_default();
            match factor {
                None if quantity == Quantity::Yaw => radians(value),
                factor => value * factor.unwrap_or(1.0),
            }
        };
        let [x, y, z] = [Quantity::X, Quantity::Y, Quantity::Z].map(|axis| number(axis, None));
        let (yaw, scale) = (number(Quantity::Yaw, Some(0.0)), number(Quantity::Scale, Some(1.0)));
        let scale_xy = number(Quantity::ScaleXy, Some(scale));
        let widening = if scale_xy == scale { 1.0 } else { scale_xy / scale };
        let rotation = Rotation::about_z(yaw);
        let transform = Transform { rotation, widening, scale, offset: DVec3::new(x, y, z), on_ground: 0 };
        is_valid.then_some(transform)
    }
}

impl Transform {
    /// The composition `self ∘ first`; the grounding mode is that of `self` unless that is 0. If `self`
    /// widens, `first` must turn about z only.
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
    use vlscan_render::Render as _;

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
        let text = "file,x,y,z,yaw,scale\n# oaks\na.obj, 1,2,3, 90, 2\n\nb.obj,4,5,6,,\r\n";
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
        for table in ["a.obj,1,2,3,90,2,5\n", "scale_xy,file,x,y,z,yaw,scale\n5,a.obj,1,2,3,90,2\n"] {
            fs::write(folder.path().join("t.csv"), table).unwrap();
            let part = read(&folder, "t.csv").unwrap().parts.remove(0);
            let (p, image) = (DVec3::new(1.0, 2.0, 3.0), DVec3::new(-9.0, 7.0, 9.0));
            assert!((part.transform.apply(p) - image).length() < 1e-13, "{}", part.transform.apply(p));
            assert!((part.transform.undo(image) - p).length() < 1e-13);
        }
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
    #[test]
    fn headings_name_the_columns() {
        let folder = folder();
        let place = |heading: &str, row: &str| {
            fs::write(folder.path().join("t.csv"), format!("{heading}\n{row}\n")).unwrap();
            let path = folder.path().join("t.csv");
            read_scene(&path.to_string_lossy(), &ReadOptions::default())
                .map(|(scene, found)| (scene.parts[0].transform, found.render(false)))
                .map_err(|e| match e {
                    vlscan_base::Error::Input(problems) => problems.render(false),
                    other => panic!("{other}"),
                })
        };
        let (transform, said) = place("file,y,x,z,yaw,scale", "a.obj,10,20,30,90,2").unwrap();
        assert_eq!(
            (transform.offset, transform.scale, said.as_str()),
            (DVec3::new(20.0, 10.0, 30.0), 2.0, "")
        );
        let (transform, _) = place("scale;Z_cm;POINT_X;POINT_Y;Filename", "2;100;1;2;a.obj").unwrap();
        assert_eq!((transform.offset, transform.scale), (DVec3::new(1.0, 2.0, 1.0), 2.0));
        for (heading, row) in
            [("file;x;y;z", "a.obj;1,5;2;3"), ("\"file\",\"x\",\"y\",\"z\"", "\"a.obj\",\"1.5\",\"2\",\"3\"")]
        {
            assert_eq!(place(heading, row).unwrap().0.offset, DVec3::new(1.5, 2.0, 3.0), "{heading}");
        }
        let (transform, said) = place("file,x,y,z,dbh,species,height", "a.obj,1,2,3,40,2,30").unwrap();
        assert!(said.contains("not read: `dbh`, `species`, `height`"), "{said}");
        assert_eq!((transform.scale, transform.rotation), (1.0, Rotation::IDENTITY));
        for (heading, row, part) in [
            ("file,x,y,z,pitch,scale", "a.obj,1,2,3,4,5", "turns about the vertical only"),
            ("file,x,y,z,heading", "a.obj,1,2,3,4", "90 - heading"),
            ("file,x,y,height", "a.obj,1,2,3", "no column z"),
            ("file,x,y,height", "a.obj,1,2,3", "rename the column to `z`"),
            ("x,y,z", "1,2,3", "no column file"),
            ("file,x,y,z,x", "a.obj,1,2,3,4", "have the same meaning"),
            ("file,x,y,z", "a.obj,1,2,3,4", "5 fields, expected 4 as in the heading"),
            ("file,x,y,z,yaw", "a.obj,1,2,3", "4 fields, expected 5"),
            ("file,x,y,z,scale", "a.obj,1,2,3,-2", "a scale of -2 mirrors the mesh"),
            ("file;x;y;z", "a.obj;1,5;2.5;3", "decimal comma"),
            ("file,lon,lat,z", "a.obj,1,2,3", "project the positions"),
        ] {
            let said = place(heading, row).unwrap_err();
            assert!(said.contains(part) && said.contains("t.csv:"), "{heading}: {said}");
        }
    }
}
