//! Trajectories in text: a header names columns in any order, otherwise they are time, x, y, z, roll, pitch, yaw. Blank
//! lines and lines that begin with `#` are skipped, except the directives `#HEADER:` and `#TIME_COLUMN:` of HELIOS++'s
//! files. Lines that HELIOS++ wrote are detected by their numbers of decimals.

use super::fix::{Decoded, Fix, FixPlace, RecordError, RecordPlace};
use crate::platform::interpolated::composed;
use crate::platform::layout::{ANGLES, Directives, POSE_COLUMNS, PoseColumn, PoseLayout, is_header};
use std::borrow::Cow;
use std::f64::consts::FRAC_PI_2;
use vlscan_base::columns::{Separator, stated_separator};
use vlscan_geom::Rotation;
use vlscan_survey::{AngleConvention, PoseFormat, PoseStream, RotationSpec};

pub const MAX_LINE_BYTES: usize = 1 << 16;
/// Decimals of the columns of HELIOS++'s trajectory files: x, y, z, t, roll, pitch, yaw.
const HELIOS_DECIMALS: [usize; 7] = [4, 4, 4, 9, 4, 4, 4];

#[derive(Debug)]
pub struct TextDecoder {
    /// The convention of the angles, once the layout is known.
    rotation: AngleConvention,
    settings: PoseStream,
    line: usize,
    directives: Directives,
    reading: Option<(PoseLayout, Separator)>,
    helios: bool,
}

impl TextDecoder {
    pub fn new(settings: PoseStream) -> TextDecoder {
        let helios = settings.format == Some(PoseFormat::Helios);
        TextDecoder {
            rotation: AngleConvention::Heading,
            settings,
            line: 0,
            directives: Directives::default(),
            reading: None,
            helios,
        }
    }

    pub fn name(&self) -> &'static str {
        if self.helios { "HELIOS++ text" } else { "text" }
    }

    pub fn next<'t>(&mut self, bytes: &'t [u8], ended: bool) -> Decoded<'t> {
        let end = memchr::memchr(b'\n', bytes);
        let line = &bytes[..end.unwrap_or(bytes.len())];
        if line.len() > MAX_LINE_BYTES {
            let start = String::from_utf8_lossy(&line[..40]).into_owned();
            let place = RecordPlace::Line { number: self.line + 1, text: Cow::Owned(start), time: 0..0 };
            let message = format!("a line of more than {MAX_LINE_BYTES} bytes, expected a pose");
            return Decoded::Invalid(place, RecordError { at: Some(0..0), ..RecordError::new(message) });
        }
        let taken = match end {
            Some(end) => end + 1,
            None if ended && !line.is_empty() => line.len(),
            None => return Decoded::Incomplete,
        };
        self.line += 1;
        if self.line == 1 && line.contains(&0) {
            let place = RecordPlace::Line { number: 1, text: Cow::Borrowed(""), time: 0..0 };
            let help = "binary trajectories (SBET, TerraScan) are recognised if no format is named";
            return Decoded::Invalid(
                place,
                RecordError::new("expected text, found bytes that are none").help(help),
            );
        }
        let mut text = String::from_utf8_lossy(line);
        if text.ends_with('\r') || self.line == 1 && text.starts_with('\u{feff}') {
            let bare = text.trim_end_matches('\r').trim_start_matches('\u{feff}');
            text = Cow::Owned(bare.to_owned());
        }
        match self.take(&text) {
            Ok(None) => Decoded::Skipped(taken),
            Ok(Some((fix, time))) => {
                Decoded::Fix(taken, fix, RecordPlace::Line { number: self.line, text, time })
            }
            Err(problem) => {
                Decoded::Invalid(RecordPlace::Line { number: self.line, text, time: 0..0 }, problem)
            }
        }
    }

    fn take(&mut self, line: &str) -> Result<Option<(Fix, std::ops::Range<usize>)>, RecordError> {
        let content = line.trim_start();
        if content.is_empty() {
            return Ok(None);
        }
        if content.starts_with('#') {
            let is_directive = self.directives.parse(content).map_err(RecordError::new)?;
            self.helios |= is_directive && self.settings.format.is_none();
            return Ok(None);
        }
        if let Some(separator) = stated_separator(content).filter(|_| self.reading.is_none()) {
            self.settings.separator = self.settings.separator.or(Some(separator));
            return Ok(None);
        }
        if self.reading.is_none() {
            let separator = self.settings.separator.map_or_else(|| Separator::guess(line), Separator::named);
            let header = is_header(line, separator);
            let layout = self.choose_layout(line, separator, header).map_err(|message| {
                RecordError::new(message).help("name the columns in a first line: time,x,y,z,roll,pitch,yaw")
            })?;
            self.reading = Some((layout, separator));
            let default = if self.helios { AngleConvention::Helios } else { AngleConvention::Heading };
            self.rotation = self.settings.rotation.unwrap_or(default);
            if header || self.settings.columns.is_some() && has_no_number(line, separator) {
                return Ok(None);
            }
        }
        let Some((layout, separator)) = &self.reading else { return Ok(None) };
        let (values, time) = layout
            .read(line, *separator)
            .map_err(|e| RecordError { at: Some(e.at), ..RecordError::new(e.message) })?;
        Ok(Some((self.fix(layout, values), time)))
    }

    /// Chooses by precedence: the user's columns, the stream's header, a `#HEADER` directive, the default orders.
    fn choose_layout(
        &mut self,
        line: &str,
        separator: Separator,
        header: bool,
    ) -> Result<PoseLayout, String> {
        use PoseColumn::{Pitch, Roll, Time, X, Y, Yaw, Z};
        let time = self.directives.time_column;
        let mut layout = if let Some(columns) = &self.settings.columns {
            PoseLayout::chosen(columns)?
        } else if header {
            PoseLayout::from_headings(line, separator).map_err(|e| e.message)?
        } else if let Some(layout) = &self.directives.layout {
            layout.clone()
        } else if time.is_some() {
            PoseLayout::in_order(&POSE_COLUMNS, time)
        } else if self.helios || self.settings.format.is_none() && is_helios_output(line, separator) {
            self.helios = true;
            PoseLayout::in_order(&[X, Y, Z, Time, Roll, Pitch, Yaw], None)
        } else {
            PoseLayout::in_order(&[Time, X, Y, Z, Roll, Pitch, Yaw], None)
        };
        if !header && self.settings.columns.is_none() {
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

fn has_no_number(line: &str, separator: Separator) -> bool {
    separator.split(line).into_iter().all(|field| line[field].parse::<f64>().is_err())
}

fn is_helios_output(line: &str, separator: Separator) -> bool {
    let fields = separator.split(line);
    let decimals = |text: &str| text.split_once('.').map_or(0, |(_, decimals)| decimals.len());
    separator == Separator::Blanks
        && fields.len() == HELIOS_DECIMALS.len()
        && fields.iter().zip(HELIOS_DECIMALS).all(|(f, expected)| decimals(&line[f.clone()]) == expected)
}

#[cfg(test)]
mod tests {
    use super::*;
    use vlscan_geom::{DVec3, radians};

    fn first(settings: PoseStream, text: &str) -> Fix {
        let (mut lines, mut at) = (TextDecoder::new(settings), 0);
        loop {
            match lines.next(&text.as_bytes()[at..], true) {
                Decoded::Skipped(n) => at += n,
                Decoded::Fix(_, fix, _) => return fix,
                other => panic!("{other:?}"),
            }
        }
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
        match TextDecoder::new(settings).next(&[1, 0, 2, b'\n'], true) {
            Decoded::Invalid(_, error) => assert!(error.message.contains("found bytes that are none")),
            other => panic!("{other:?}"),
        }
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
