//! Trajectories in rows, of text or of an Arrow stream: a header names columns in any order, otherwise they are time, x, y, z,
//! roll, pitch, yaw. Of the comments of text the directives `#HEADER:` and `#TIME_COLUMN:` of HELIOS++'s files count. Lines that
//! HELIOS++ wrote are detected by their numbers of decimals.

use super::decoder::TakeFix;
use super::fix::{Fix, FixPlace, RecordPlace};
use crate::platform::interpolated::composed;
use crate::platform::layout::{ANGLES, POSE_COLUMNS, PoseColumn, PoseLayout, StatedColumns};
use std::f64::consts::FRAC_PI_2;
use std::path::Path;
use vlscan_base::columns::Separator;
use vlscan_base::diag::Place;
use vlscan_base::error::Result;
use vlscan_base::input::rows::{Row, RowDecoder, RowError};
use vlscan_geom::Rotation;
use vlscan_survey::{AngleConvention, PoseFormat, PoseStream, RotationSpec};

/// Maximum number of rows that are decoded together.
const BLOCK_ROWS: usize = 1024;
/// Decimals of the columns of HELIOS++'s trajectory files: x, y, z, t, roll, pitch, yaw.
const HELIOS_DECIMALS: [usize; 7] = [4, 4, 4, 9, 4, 4, 4];
/// Hint where no columns are found.
const NAME_COLUMNS: &str = "name the columns in a first line: time,x,y,z,roll,pitch,yaw";

/// Decodes rows to fixes.
#[derive(Debug)]
pub struct PoseRows {
    /// Name of the stream in messages.
    place: Place,
    rows: RowDecoder,
    settings: PoseStream,
    layout: Option<PoseLayout>,
    /// The convention of the angles, once the layout is known.
    rotation: AngleConvention,
    helios: bool,
}

impl PoseRows {
    pub fn new(path: &Path, settings: PoseStream) -> PoseRows {
        PoseRows {
            place: Place::of_file(path),
            rows: RowDecoder::new(path, "a pose", settings.separator),
            helios: settings.format == Some(PoseFormat::Helios),
            settings,
            layout: None,
            rotation: AngleConvention::Heading,
        }
    }

    pub fn name(&self) -> &'static str {
        match (self.helios, self.rows.fields()) {
            (true, _) => "HELIOS++ text",
            (false, None) => "text",
            (false, Some(_)) => "Arrow",
        }
    }

    pub fn feed(&mut self, bytes: &[u8]) {
        self.rows.feed(bytes);
    }

    /// Passes the rows that have arrived to `take` until it breaks; with `ended` no others will follow.
    ///
    /// # Errors
    /// The first row that is no fix, columns that are missing, and what [`RowDecoder::next_block`] refuses.
    pub fn decode(&mut self, ended: bool, take: &mut TakeFix) -> Result<()> {
        let mut fields = Vec::new();
        loop {
            let block = self.rows.next_block(BLOCK_ROWS, ended)?;
            let mut begin = 0;
            if self.layout.is_none() && (block.is_some() || self.rows.fields().is_some()) {
                let first = block.as_ref().map(|block| block.row(0, &mut fields));
                begin = usize::from(self.begin(first.as_ref())?);
            }
            let (Some(block), Some(layout)) = (block, &self.layout) else { return Ok(()) };
            let time = layout.columns[PoseColumn::Time as usize].unwrap_or_default();
            for index in begin..block.len() {
                let row = block.row(index, &mut fields);
                let values = layout.read(&row).map_err(|e| e.with_help(""))?;
                if take(self.name(), self.fix(layout, values), RecordPlace::Row(&row, time)).is_break() {
                    return Ok(());
                }
            }
        }
    }

    /// Finds the columns; returns whether the first row names them.
    fn begin(&mut self, first: Option<&Row>) -> Result<bool> {
        let stated = StatedColumns::of(&self.rows, first).map_err(|e| e.with_help(""))?;
        self.helios |= stated.has_directives && self.settings.format.is_none();
        let separator = first.map(Row::separator);
        let layout = self.choose_layout(&stated, separator).map_err(|message| {
            let line = first.filter(|_| self.rows.fields().is_none());
            let place = line.map_or_else(|| self.place.clone(), |row| row.error(None, "").place);
            RowError { place, message }
        });
        self.layout = Some(layout.map_err(|e| e.with_help(NAME_COLUMNS))?);
        let default = if self.helios { AngleConvention::Helios } else { AngleConvention::Heading };
        self.rotation = self.settings.rotation.unwrap_or(default);
        let has_no_number = || stated.first.iter().all(|text| text.parse::<f64>().is_err());
        let is_text = !stated.first.is_empty();
        Ok(stated.has_header_row() || is_text && self.settings.columns.is_some() && has_no_number())
    }

    /// Chooses by precedence: the user's columns, the stream's header, a `#HEADER` directive, the default orders.
    fn choose_layout(
        &mut self,
        stated: &StatedColumns,
        separator: Option<Separator>,
    ) -> std::result::Result<PoseLayout, String> {
        use PoseColumn::{Pitch, Roll, Time, X, Y, Yaw, Z};
        let time = stated.directives.time_column;
        let mut layout = if let Some(columns) = &self.settings.columns {
            PoseLayout::chosen(columns)?
        } else if stated.has_header {
            stated.header()?
        } else if let Some(layout) = &stated.directives.layout {
            layout.clone()
        } else if time.is_some() {
            PoseLayout::in_order(&POSE_COLUMNS, time)
        } else if self.helios || self.settings.format.is_none() && is_helios_output(&stated.first, separator)
        {
            self.helios = true;
            PoseLayout::in_order(&[X, Y, Z, Time, Roll, Pitch, Yaw], None)
        } else {
            PoseLayout::in_order(&[Time, X, Y, Z, Roll, Pitch, Yaw], None)
        };
        if !stated.has_header && self.settings.columns.is_none() {
            layout.set_time(time);
        }
        layout.complete(&POSE_COLUMNS)
    }

    fn fix(&self, layout: &PoseLayout, values: [f64; 7]) -> Fix {
        let [time, roll, pitch, yaw, x, y, z] = layout.in_si(values, self.settings.degrees);
        let unitless = ANGLES.iter().all(|&angle| layout.factors[angle as usize].is_none());
        Fix {
            unitless_angles: unitless.then(|| ANGLES.map(|angle| values[angle as usize])),
            time,
            place: if layout.geographic {
                FixPlace::Geographic([y, x, z])
            } else {
                FixPlace::Local([x, y, z])
            },
            attitude: attitude(self.rotation, roll, pitch, yaw),
        }
    }
}

fn attitude(convention: AngleConvention, roll: f64, pitch: f64, yaw: f64) -> Rotation {
    match convention {
        AngleConvention::Heading => Rotation::of_heading(roll, pitch, yaw),
        AngleConvention::Yaw => Rotation::of_heading(roll, pitch, FRAC_PI_2 - yaw),
        AngleConvention::Ros => Rotation::of_heading(roll, -pitch, FRAC_PI_2 - yaw),
        AngleConvention::Helios => composed(RotationSpec::Arinc705, roll, pitch, yaw),
        AngleConvention::Canonical => composed(RotationSpec::Canonical, roll, pitch, yaw),
    }
}

fn is_helios_output(first: &[String], separator: Option<Separator>) -> bool {
    let decimals = |text: &str| text.split_once('.').map_or(0, |(_, decimals)| decimals.len());
    separator == Some(Separator::Blanks)
        && first.len() == HELIOS_DECIMALS.len()
        && first.iter().zip(HELIOS_DECIMALS).all(|(text, expected)| decimals(text) == expected)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::ops::ControlFlow;
    use vlscan_geom::{DVec3, radians};

    fn first(settings: PoseStream, text: &str) -> Fix {
        let (mut rows, mut first) = (PoseRows::new(Path::new("-"), settings), None);
        rows.feed(text.as_bytes());
        rows.decode(true, &mut |_, fix, _| {
            first.get_or_insert(fix);
            ControlFlow::Break(())
        })
        .unwrap();
        first.unwrap()
    }

    fn defaults() -> PoseStream {
        PoseStream::at("-")
    }

    #[test]
    fn what_the_reference_writes_is_known_by_its_decimals() {
        let line = "-30.0000 -50.0000 100.0000 86391.000000000 0.0000 0.0000 90.0000\n";
        let fix = first(defaults(), line);
        assert_eq!((fix.time, fix.place), (86391.0, FixPlace::Local([-30.0, -50.0, 100.0])));
        let text = PoseStream { format: Some(PoseFormat::Text), ..defaults() };
        assert_eq!(first(text, line).time, -30.0, "asked to be plain text");
        let helios = PoseStream { format: Some(PoseFormat::Helios), ..defaults() };
        assert_eq!(first(helios, "1 2 3 4 5 6 7").time, 4.0);
    }

    #[test]
    fn angles_mean_what_they_are_said_to_mean() {
        let forward = |rotation| {
            first(PoseStream { rotation: Some(rotation), ..defaults() }, "1 0 0 0 0 0 30").attitude.forward()
        };
        let (sin, cos) = (0.5, 3f64.sqrt() / 2.0);
        for (convention, expected) in [
            (AngleConvention::Heading, DVec3::new(sin, cos, 0.0)),
            (AngleConvention::Yaw, DVec3::new(cos, sin, 0.0)),
            (AngleConvention::Canonical, DVec3::new(-sin, cos, 0.0)),
        ] {
            assert!((forward(convention) - expected).length() < 1e-12, "{convention:?}");
        }
        let nose = |rotation| {
            first(PoseStream { rotation: Some(rotation), ..defaults() }, "1 0 0 0 0 30 0")
                .attitude
                .forward()
                .z
        };
        assert!((nose(AngleConvention::Yaw) - 0.5).abs() < 1e-12);
        assert!((nose(AngleConvention::Ros) + 0.5).abs() < 1e-12);
    }

    #[test]
    fn angles_compose_as_their_layout_does() {
        let row = "1 0 0 0 20 10 30\n";
        let [roll, pitch, heading] = [20.0, 10.0, 30.0].map(radians);
        let recorded = Rotation::of_heading(roll, pitch, heading);
        let of_reference = composed(RotationSpec::Arinc705, roll, pitch, heading);
        let ros = Rotation::about_z(heading)
            .after(Rotation::about_y(pitch))
            .after(Rotation::about_x(roll))
            // From right, forward, up to forward, left, up.
            .after(Rotation::about_z(-FRAC_PI_2));
        let of = |rotation, text: &str| first(PoseStream { rotation, ..defaults() }, text).attitude;
        let helios = |text: &str| {
            format!("#TIME_COLUMN: 0\n#HEADER: \"t\",\"x\",\"y\",\"z\",\"roll\",\"pitch\",\"yaw\"\n{text}")
        };
        for (found, wanted) in [
            (of(None, row), recorded),
            (of(Some(AngleConvention::Helios), row), of_reference),
            (of(None, &helios(row)), of_reference),
            (of(None, "0.0000 0.0000 0.0000 1.000000000 20.0000 10.0000 30.0000\n"), of_reference),
            (of(Some(AngleConvention::Heading), &helios(row)), recorded),
            (of(Some(AngleConvention::Yaw), "1 0 0 0 20 10 60\n"), recorded),
            (of(Some(AngleConvention::Ros), row), ros),
        ] {
            assert!((found.forward() - wanted.forward()).length() < 1e-12);
            assert!((found.apply(DVec3::X) - wanted.apply(DVec3::X)).length() < 1e-12);
        }
        assert!((recorded.forward() - of_reference.forward()).length() > 0.05);
    }

    #[test]
    fn a_first_line_may_state_the_separator() {
        let fix = first(defaults(), "sep=;\ntime;x;y;z;roll;pitch;yaw\n1;2;3;4;0;0;0\n");
        assert_eq!((fix.time, fix.place), (1.0, FixPlace::Local([2.0, 3.0, 4.0])));
    }

    #[test]
    fn bytes_are_not_printed_as_text() {
        let settings = PoseStream { format: Some(PoseFormat::Text), ..defaults() };
        let mut rows = PoseRows::new(Path::new("-"), settings);
        rows.feed(&[1, 0, 2, b'\n']);
        let refused = rows.decode(true, &mut |_, fix, _| panic!("{fix:?}")).unwrap_err();
        assert!(refused.to_string().contains("found binary data"), "{refused}");
    }

    #[test]
    fn columns_are_chosen_by_name_or_number() {
        let columns = |list: &[&str]| PoseStream {
            columns: Some(list.iter().map(|c| (*c).to_owned()).collect()),
            ..defaults()
        };
        let numbered = ["time=2", "x=5", "y=4", "z=3", "roll=6", "pitch=7", "yaw[rad]=1"];
        let fix = first(columns(&numbered), "some,words,that,name,all,the,rest\n0.5,9,3,2,1,0,0\n");
        assert_eq!((fix.time, fix.place), (9.0, FixPlace::Local([1.0, 2.0, 3.0])));
        assert!((fix.attitude.forward().x - libm::sin(0.5)).abs() < 1e-12);
        let named = ["quality", "time", "x", "y", "z", "roll", "pitch", "yaw"];
        assert_eq!(first(columns(&named), "7 9 1 2 3 0 0 0").time, 9.0);
    }

    #[test]
    fn latitude_and_longitude_are_columns_too() {
        let fix = first(defaults(), "time,lat,lon,height,roll,pitch,heading\n1,49,8.5,300,0,0,0\n");
        assert_eq!(fix.place, FixPlace::Geographic([radians(49.0), radians(8.5), 300.0]));
        let fix = first(
            defaults(),
            "time,longitude[rad],latitude[rad],height,roll,pitch,heading\n1,0.1,0.8,300,0,0,0\n",
        );
        assert_eq!(fix.place, FixPlace::Geographic([0.8, 0.1, 300.0]));
        let fix = first(defaults(), "time,lat,lon,height,roll,pitch,heading,x,y\n1,49,8.5,300,0,0,0,5,6\n");
        assert_eq!(
            fix.place,
            FixPlace::Local([5.0, 6.0, 300.0]),
            "coordinates that are projected already win"
        );
    }
}
