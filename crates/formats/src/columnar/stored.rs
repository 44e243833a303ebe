//! Names of the columns in files of points, which differ by format.

use super::Column;
use vlscan_tables::{plain, split_unit};

impl Column {
    /// The column with this name in the files that this program writes, whatever their format: `Range` of
    /// tables, `scalar_Range` of PLY, `range` of LAS, `path_order` of PCD. `None` for other names, and for
    /// names with a unit that is not the one of the column.
    pub fn stored_as(name: &str) -> Option<Column> {
        let (name, unit) = split_unit(name);
        let name = plain(name);
        let name = match name.as_str() {
            "heliosamplitude" => "amplitude",
            "hitobjectid" => "objectid",
            "fullwaveindex" => "pulsenumber",
            name => name,
        };
        let found = Column::ALL.iter().copied().find(|column| column.name().eq_ignore_ascii_case(name));
        found.filter(|column| unit.is_none_or(|unit| unit == column.unit()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::PointRecord;
    use crate::{AttributeSet, CloudSettings, CloudWriter, ObjectIds, PointFormat, PointRow, PointSink};
    use std::collections::BTreeMap;
    use std::ops::ControlFlow;
    use vlscan_base::diag::Diagnostics;
    use vlscan_base::error::Result;

    /// The columns of a file by their names, and its metadata.
    #[derive(Default)]
    struct Stored {
        columns: Vec<Column>,
        values: Vec<Vec<f64>>,
        points: usize,
        metadata: BTreeMap<String, String>,
    }

    impl PointSink for Stored {
        fn start(&mut self, _: AttributeSet) {}

        fn takes_columns(&self) -> bool {
            true
        }

        fn choose(&mut self, names: &[&str]) -> Vec<usize> {
            let found = names.iter().enumerate().filter_map(|(i, name)| Some((i, Column::stored_as(name)?)));
            let (chosen, columns) = found.unzip();
            self.columns = columns;
            chosen
        }

        fn values(&mut self, values: &[f64]) {
            self.values.push(values.to_vec());
        }

        fn metadata(&mut self, key: &str, text: &str) {
            self.metadata.insert(key.to_owned(), text.to_owned());
        }

        fn point(&mut self, _: &PointRow, _: Option<&str>) -> Result<ControlFlow<()>> {
            self.points += 1;
            assert!(self.values.len() == self.points, "values come before their point");
            Ok(ControlFlow::Continue(()))
        }
    }

    #[test]
    fn files_of_all_formats_have_their_columns_by_name() {
        let folder = tempfile::tempdir().unwrap();
        let objects = ObjectIds::new(&["oak".to_owned(), "7".to_owned()]);
        let mut settings = CloudSettings { labels: true, objects, ..CloudSettings::default() };
        let mut columns = Column::default_columns(false);
        columns.extend([Column::Path, Column::SurfaceX]);
        settings.columns = Some(columns);
        // More than a block of lines or records.
        let count = 3000;
        let point = |i: u32| {
            let mut point = PointRecord {
                range: f64::from(i) * 0.5,
                pulse_number: u64::from(i),
                part: i % 3,
                object: (i % 5) as i32,
                return_number: 1,
                number_of_returns: 1,
                ..PointRecord::default()
            };
            point.cause.path = (i % 7) as u8;
            point
        };
        let points: Vec<PointRecord> = (0..count).map(point).collect();
        let text = ["csv", "xyz"];
        let tables = if cfg!(feature = "parquet") { &["arrow", "parquet"][..] } else { &["arrow"] };
        for ending in ["las", "laz", "ply"].into_iter().chain(text).chain(tables.iter().copied()) {
            let path = folder.path().join(format!("points.{ending}"));
            let format = PointFormat::required(&path).unwrap();
            let mut found = Diagnostics::default();
            let mut writer = CloudWriter::create(&path, false, format, &settings, &mut found).unwrap();
            writer.write(&points).unwrap();
            writer.finish().unwrap();
            for threads in [1, 3] {
                let mut stored = Stored::default();
                crate::read_points_on(&path, threads, &mut stored).unwrap();
                assert_eq!(stored.points, count as usize, "{ending}");
                let value = |column: Column, point: usize| {
                    let at = stored.columns.iter().position(|stored| *stored == column);
                    at.map(|at| stored.values[point][at])
                };
                for i in [0, 1, 1000, 2999] {
                    let number = i as f64;
                    let expected = [
                        (Column::Range, number * 0.5),
                        (Column::PulseNumber, number),
                        (Column::Part, (i % 3) as f64),
                        (Column::ObjectId, (i % 5) as f64),
                        (Column::Path, (i % 7) as f64),
                    ];
                    for (column, expected) in expected {
                        assert_eq!(value(column, i), Some(expected), "{ending}, {column:?}, point {i}");
                    }
                }
                let names = stored.metadata.get(crate::OBJECT_NAMES).map(String::as_str);
                let expected = if text.contains(&ending) { None } else { Some("{\"8\":\"oak\"}") };
                assert_eq!(names, expected, "{ending}");
            }
        }
    }

    #[test]
    fn columns_are_found_by_the_names_of_all_formats() {
        for column in Column::ALL {
            assert_eq!(Column::stored_as(column.name()), Some(*column));
            assert_eq!(Column::stored_as(&format!("scalar_{}", column.name())), Some(*column));
        }
        for (name, expected) in [
            ("hitObjectId", Some(Column::ObjectId)),
            ("heliosAmplitude", Some(Column::Amplitude)),
            ("fullwaveIndex", Some(Column::PulseNumber)),
            ("true_range", Some(Column::TrueRange)),
            ("path_order", Some(Column::PathOrder)),
            ("Range[m]", Some(Column::Range)),
            ("Range [ft]", None),
            ("Path[m]", None),
            ("verticality", None),
            ("", None),
        ] {
            assert_eq!(Column::stored_as(name), expected, "{name}");
        }
    }
}
