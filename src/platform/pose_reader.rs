//! Reads poses from a stream while it still flows.

use super::interpolated::composed;
use super::layout::{Layout, is_header};
use super::rows::{QUANTITIES, Quantity, Separator, column_name};
use crate::arrivals::{Arrival, Arrivals, is_stdin};
use crate::diag::{Diagnostics, Place};
use crate::error::{Error, Result};
use crate::geom::{DVec3, Rotation, radians};
use crate::survey::PoseStream;
use std::collections::VecDeque;
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// One pose of a stream.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Seconds in the stream's own scale.
    pub time: f64,
    /// World coordinates, m.
    pub position: DVec3,
    /// Attitude of the platform.
    pub attitude: Rotation,
}

/// What waiting for poses came to.
#[derive(Clone, Debug, PartialEq)]
pub enum Waited {
    /// Some arrived.
    Poses(Vec<Pose>),
    /// None within the time given.
    Nothing,
    /// None will any more.
    End,
}

/// Why no more poses can be read.
enum Failure {
    Input(Box<Diagnostics>),
    Io(std::io::ErrorKind, String),
}

/// Most rows of a block.
const MOST_ROWS: usize = 1024;
/// Longer lines are no poses.
const LONGEST_LINE: usize = 1 << 16;
/// More warnings than these say nothing new.
const MOST_WARNINGS: usize = 20;

/// Turns lines of text into poses: a header line names columns in any order, otherwise they are time, x, y, z, roll, pitch,
/// yaw. Blank lines and lines that begin with `#` are passed over, but for the `#HEADER:` and `#TIME_COLUMN:` of trajectory
/// files. Times must ascend.
pub struct PoseReader {
    arrivals: Arrivals,
    path: PathBuf,
    settings: PoseStream,
    /// Bytes of a line whose end has not arrived.
    rest: Vec<u8>,
    line: usize,
    directive: Option<Layout>,
    time_column: Option<usize>,
    reading: Option<(Layout, Separator)>,
    last: Option<([f64; 7], Pose)>,
    arrived: VecDeque<Pose>,
    failure: Option<Failure>,
    ended: bool,
    warnings: Diagnostics,
    latency: Duration,
}

impl std::fmt::Debug for PoseReader {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("PoseReader")
            .field("path", &self.path)
            .field("line", &self.line)
            .finish_non_exhaustive()
    }
}

impl PoseReader {
    /// Opens the file, named pipe or (`-`) standard input that `settings` name.
    ///
    /// # Errors
    /// The file cannot be opened.
    pub fn open(settings: &PoseStream) -> Result<PoseReader> {
        let arrivals = Arrivals::open(&settings.path).map_err(|e| Error::io("read", &settings.path, e))?;
        Ok(PoseReader::of(arrivals, settings))
    }

    /// Reads what arrives; `settings.path` is the name in messages.
    pub fn of(arrivals: Arrivals, settings: &PoseStream) -> PoseReader {
        let stdin = is_stdin(&settings.path);
        PoseReader {
            arrivals,
            path: if stdin { PathBuf::from("<stdin>") } else { settings.path.clone() },
            settings: settings.clone(),
            rest: Vec::new(),
            line: 0,
            directive: None,
            time_column: None,
            reading: None,
            last: None,
            arrived: VecDeque::new(),
            failure: None,
            ended: false,
            warnings: Diagnostics::default(),
            latency: Duration::ZERO,
        }
    }

    /// The same reader, whose poses may wait so long for others to be flown along together.
    pub fn patient(self, latency: Duration) -> PoseReader {
        PoseReader { latency, ..self }
    }

    /// How long what is flown along its poses may wait for more of them.
    pub fn latency(&self) -> Duration {
        self.latency
    }

    /// Waits for poses for some time and returns those that have arrived, at most 1024.
    ///
    /// # Errors
    /// A line that is no pose, or whose time does not ascend, with its number; a stream that cannot be read. Poses before
    /// the wrong line are returned first. The error stays: waiting again meets it again.
    pub fn wait(&mut self, patience: Duration) -> Result<Waited> {
        let until = Instant::now() + patience;
        while self.arrived.is_empty() && self.failure.is_none() && !self.ended {
            if !self.receive(Some(until.saturating_duration_since(Instant::now()))) {
                return Ok(Waited::Nothing);
            }
        }
        if !self.arrived.is_empty() {
            let count = self.arrived.len().min(MOST_ROWS);
            return Ok(Waited::Poses(self.arrived.drain(..count).collect()));
        }
        self.ended = true;
        match &self.failure {
            Some(Failure::Input(problems)) => Err(Error::Input(problems.clone())),
            Some(Failure::Io(kind, text)) => {
                Err(Error::io("read", &self.path, std::io::Error::new(*kind, text.clone())))
            }
            None => Ok(Waited::End),
        }
    }

    /// Waits for at least one pose, as long as it takes; `None` at the end of the stream.
    ///
    /// # Errors
    /// As [`PoseReader::wait`].
    pub fn next_block(&mut self) -> Result<Option<Vec<Pose>>> {
        loop {
            match self.wait(Duration::from_secs(3600))? {
                Waited::Poses(block) => return Ok(Some(block)),
                Waited::End => return Ok(None),
                Waited::Nothing => {}
            }
        }
    }

    /// The warnings since the last call.
    pub fn take_warnings(&mut self) -> Diagnostics {
        std::mem::take(&mut self.warnings)
    }

    /// Takes in one read's worth of bytes; `false` if none arrived in time.
    fn receive(&mut self, patience: Option<Duration>) -> bool {
        let mut taken = std::mem::take(&mut self.rest);
        match self.arrivals.next(patience) {
            Arrival::Bytes(bytes) => taken.extend_from_slice(&bytes),
            Arrival::Nothing => {
                self.rest = taken;
                return false;
            }
            Arrival::End => self.ended = true,
            Arrival::Failed(e) => self.failure = Some(Failure::Io(e.kind(), e.to_string())),
        }
        let mut start = 0;
        while self.failure.is_none() {
            let line = match taken[start..].iter().position(|b| *b == b'\n') {
                Some(end) => start..start + end,
                None if self.ended && start < taken.len() => start..taken.len(),
                None => break,
            };
            start = (line.end + 1).min(taken.len());
            self.line += 1;
            let text = String::from_utf8_lossy(&taken[line]).into_owned();
            self.take_line(text.trim_end_matches('\r'));
        }
        taken.drain(..start);
        if taken.len() > LONGEST_LINE && self.failure.is_none() {
            self.line += 1;
            let start = String::from_utf8_lossy(&taken[..40]).into_owned();
            self.fail(&start, 0..0, format!("a line of more than {LONGEST_LINE} bytes, expected a pose"));
        }
        self.rest = taken;
        true
    }

    fn take_line(&mut self, line: &str) {
        let content = line.trim_start();
        if content.is_empty() {
            return;
        }
        if content.starts_with('#') {
            return self.take_comment(line, content);
        }
        if self.reading.is_none() {
            let separator = self.settings.separator.map_or_else(|| Separator::guess(line), Separator::named);
            let header = is_header(line, separator);
            match self.choose_layout(line, separator, header) {
                Ok(layout) => self.reading = Some((layout, separator)),
                Err(message) => {
                    return self.fail_with_help(
                        line,
                        0..line.len(),
                        message,
                        "name the columns in a first line: time,x,y,z,roll,pitch,yaw",
                    );
                }
            }
            if header {
                return;
            }
        }
        let Some((layout, separator)) = &self.reading else { return };
        match layout.values(line, *separator) {
            Ok(values) => {
                let pose = self.pose(layout, values);
                self.take_pose(line, values, pose);
            }
            Err(e) => self.fail(line, e.at, e.message),
        }
    }

    fn take_comment(&mut self, line: &str, comment: &str) {
        if let Some(names) = comment.strip_prefix("#HEADER:") {
            match Layout::named(names, &Separator::guess(names).split(names)) {
                Ok(layout) => self.directive = Some(layout),
                Err(e) => self.fail(line, 0..line.len(), e.message),
            }
        } else if let Some(column) = comment.strip_prefix("#TIME_COLUMN:") {
            match column.trim().parse() {
                Ok(column) => self.time_column = Some(column),
                Err(_) => {
                    let message = format!("expected the number of a column, found `{}`", column.trim());
                    self.fail(line, 0..line.len(), message);
                }
            }
        }
    }

    /// The user's names win over the stream's header, that over a `#HEADER`, and that over the usual orders.
    fn choose_layout(&self, line: &str, separator: Separator, header: bool) -> Result<Layout, String> {
        use Quantity::{Pitch, Roll, Time, X, Y, Yaw, Z};
        let mut layout = if let Some(names) = &self.settings.columns {
            let joined = names.join(",");
            for name in names {
                column_name(name)?;
            }
            Layout::named(&joined, &Separator::Char(',').split(&joined)).map_err(|e| e.message)?
        } else if header {
            Layout::named(line, &separator.split(line)).map_err(|e| e.message)?
        } else if let Some(layout) = &self.directive {
            layout.clone()
        } else if let Some(time) = self.time_column {
            let mut order = vec![Roll, Pitch, Yaw, X, Y, Z];
            order.insert(time.min(6), Time);
            Layout::in_order(order)
        } else {
            Layout::in_order([Time, X, Y, Z, Roll, Pitch, Yaw])
        };
        if let Some(time) = self.time_column.filter(|_| !header && self.settings.columns.is_none()) {
            layout.columns[Time as usize] = Some(time);
        }
        let missing = layout.missing(&QUANTITIES);
        if missing.is_empty() { Ok(layout) } else { Err(format!("no column for {}", missing.join(", "))) }
    }

    fn pose(&self, layout: &Layout, values: [f64; 7]) -> Pose {
        let angle = |q: Quantity| match layout.factors[q as usize] {
            Some(factor) => values[q as usize] * factor,
            None if self.settings.degrees => radians(values[q as usize]),
            None => values[q as usize],
        };
        let attitude = composed(
            self.settings.rotation_spec,
            angle(Quantity::Roll),
            angle(Quantity::Pitch),
            angle(Quantity::Yaw),
        );
        let [time, .., x, y, z] = values;
        let time = time * layout.factors[Quantity::Time as usize].unwrap_or(1.0);
        Pose { time, position: DVec3::new(x, y, z), attitude }
    }

    fn take_pose(&mut self, line: &str, values: [f64; 7], pose: Pose) {
        if let Some((before, last)) = &self.last {
            if values == *before {
                if self.warnings.items().len() < MOST_WARNINGS {
                    let place = Place::in_line(&self.path, self.line, line, 0..line.len());
                    self.warnings.warn(Some(place), "the same pose again, passed over");
                }
                return;
            }
            if pose.time <= last.time {
                let what = if pose.time == last.time { "repeats with another pose" } else { "goes back" };
                let message = format!("time {} {what}; the pose before it has {}", values[0], before[0]);
                let column = self
                    .reading
                    .as_ref()
                    .and_then(|(l, s)| s.split(line).get(l.columns[Quantity::Time as usize]?).cloned());
                let at = column.unwrap_or(0..line.len());
                return self.fail_with_help(line, at, message, "the times of a stream must ascend");
            }
        }
        self.last = Some((values, pose));
        self.arrived.push_back(pose);
    }

    fn fail(&mut self, line: &str, at: std::ops::Range<usize>, message: String) {
        self.fail_with_help(line, at, message, "");
    }

    fn fail_with_help(&mut self, line: &str, at: std::ops::Range<usize>, message: String, help: &str) {
        let mut problems = Diagnostics::default();
        let problem = problems.error(Some(Place::in_line(&self.path, self.line, line, at)), message);
        if !help.is_empty() {
            problem.help(help);
        }
        self.failure = Some(Failure::Input(Box::new(problems)));
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::survey::RotationSpec;
    use std::io::Read;

    /// Settings without any wishes.
    pub fn settings() -> PoseStream {
        PoseStream {
            path: PathBuf::from("-"),
            rotation_spec: RotationSpec::Arinc705,
            degrees: true,
            columns: None,
            separator: None,
        }
    }

    /// Hands out its text in pieces of `size` bytes.
    struct Trickle {
        text: Vec<u8>,
        size: usize,
    }

    impl Read for Trickle {
        fn read(&mut self, to: &mut [u8]) -> std::io::Result<usize> {
            let count = self.size.min(self.text.len()).min(to.len());
            to[..count].copy_from_slice(&self.text[..count]);
            self.text.drain(..count);
            Ok(count)
        }
    }

    fn reader(text: &str, size: usize, settings: &PoseStream) -> PoseReader {
        let trickle = Trickle { text: text.as_bytes().to_vec(), size };
        PoseReader::of(Arrivals::of(trickle), settings)
    }

    fn read_all(text: &str, size: usize, settings: &PoseStream) -> Result<Vec<Pose>, String> {
        let mut reader = reader(text, size, settings);
        let mut poses = Vec::new();
        loop {
            match reader.next_block() {
                Ok(Some(block)) => poses.extend(block),
                Ok(None) => return Ok(poses),
                Err(Error::Input(d)) => return Err(d.render(false)),
                Err(e) => return Err(e.to_string()),
            }
        }
    }

    #[test]
    fn columns_are_named_or_in_the_usual_order() {
        let usual = read_all("# remark\n\n10 1 2 3 0 0 90\n11 1 2 3 0 0 90\n", 5, &settings()).unwrap();
        let named = read_all(
            "heading[rad];z;y;x;quality;roll_deg;pitch;gps_time\n1.5707963267948966;3;2;1;7;0;0;10\n\
             1.5707963267948966;3;2;1;7;0;0;11",
            64,
            &settings(),
        )
        .unwrap();
        assert_eq!(usual.len(), 2);
        for (a, b) in usual.iter().zip(&named) {
            assert_eq!((a.time, a.position), (b.time, b.position));
            assert!((a.attitude.forward() - DVec3::X).length() < 1e-12);
            assert!((b.attitude.forward() - DVec3::X).length() < 1e-12);
        }
        let user = PoseStream {
            columns: Some(["x", "y", "z", "t", "yaw", "roll", "pitch"].map(str::to_owned).to_vec()),
            ..settings()
        };
        assert_eq!(read_all("1,2,3,10,90,0,0", 9, &user).unwrap()[0].time, 10.0);
    }

    #[test]
    fn trajectory_files_of_surveys_are_understood() {
        let text = "#TIME_COLUMN: 0\n#HEADER: \"t\", \"roll\", \"pitch\", \"yaw\", \"x\", \"y\", \"z\"\n10,0,0,90,1,2,3\n";
        assert_eq!(read_all(text, 100, &settings()).unwrap()[0].position, DVec3::new(1.0, 2.0, 3.0));
        assert_eq!(
            read_all("#TIME_COLUMN: 0\n10,0,0,90,1,2,3\n", 100, &settings()).unwrap()[0].position,
            DVec3::new(1.0, 2.0, 3.0)
        );
    }

    #[test]
    fn a_block_is_what_has_arrived() {
        let mut r = reader("1 0 0 0 0 0 0\n2 0 0 0 0 0 0\n3 0 0 0 0 0 0\n", 20, &settings());
        let counts: Vec<usize> = std::iter::from_fn(|| r.next_block().unwrap()).map(|b| b.len()).collect();
        assert_eq!(counts, [1, 1, 1]);
        let many: String = (0..3000).map(|i| format!("{i},0,0,0,0,0,0\n")).collect();
        let mut r = PoseReader::of(Arrivals::of(std::io::Cursor::new(many)), &settings());
        let counts: Vec<usize> = std::iter::from_fn(|| r.next_block().unwrap()).map(|b| b.len()).collect();
        assert_eq!(counts, [1024, 1024, 952]);
    }

    #[test]
    fn wrong_lines_are_named_after_the_poses_before_them() {
        let mut r = reader("1,0,0,0,0,0,0\n2,0,0,0,0,0,0\n1.5,0,0,0,0,0,0\n", 1000, &settings());
        assert_eq!(r.next_block().unwrap().unwrap().len(), 2);
        let Err(Error::Input(d)) = r.next_block() else { panic!("the backward time went unnoticed") };
        let report = d.render(false);
        assert!(report.contains("<stdin>:3:1") && report.contains("goes back"), "{report}");
        for (text, part) in [
            ("1,0,0,0,0,0,0\n1,9,0,0,0,0,0\n", "repeats"),
            ("1,0,0,0,0,0,zero\n", "<stdin>:1:13"),
            ("1,0,0,0\n", "column 5 for roll is missing"),
            ("time,x,y,z\n", "no column for roll, pitch, yaw"),
            ("time,x,y,z,roll[gon],pitch,yaw\n", "gon"),
        ] {
            let report = read_all(text, 7, &settings()).unwrap_err();
            assert!(report.contains(part), "{part:?} is missing from\n{report}");
        }
        assert!(
            read_all(&"7".repeat(70_000), 5000, &settings()).unwrap_err().contains("a line of more than")
        );
    }

    #[test]
    fn an_identical_row_is_passed_over_with_a_warning() {
        let mut r = reader("1,0,0,0,0,0,0\n1,0,0,0,0,0,0\n2,0,0,0,0,0,0\n", 1000, &settings());
        assert_eq!(r.next_block().unwrap().unwrap().len(), 2);
        assert!(r.take_warnings().render(false).contains("<stdin>:2:1"));
        assert!(r.take_warnings().items().is_empty());
    }

    proptest::proptest! {
        #[test]
        fn any_bytes_are_read_or_refused(text in "[#HEADRTIM_:0-9txyz,; \t\n.-]{0,200}", size in 1usize..40) {
            let once = read_all(&text, 10_000, &settings());
            proptest::prop_assert_eq!(once, read_all(&text, size, &settings()));
        }
    }
}
