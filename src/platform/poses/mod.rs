//! Reads poses while they still arrive, whatever layout they have.
//!
//! | file | what it does |
//! |---|---|
//! | `source` | finds the layout out; bytes to fixes |
//! | `text`, `binary` | the layouts |
//! | `fix` | one record as it stands there, and its place for messages |
//! | `frame` | a fix to a pose: projection, lever arm, boresight |
//! | `order` | times that ascend, gaps, headings that contradict the course |

mod binary;
mod fix;
mod frame;
mod order;
mod source;
mod text;

use super::layout::PoseLayout;
use super::pose_table::Spelling;
use crate::diag::{Diagnostics, Notice};
use crate::error::{Error, Result};
use crate::geom::{DVec3, Rotation};
use crate::input::{InputStream, ReadEvent, is_stdin};
use crate::survey::{Grid, PoseStream};
use fix::Mark;
pub(super) use fix::{Fix, FixPlace, Problem};
pub(super) use frame::Frame;
use order::Order;
use source::{Next, Source};
use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// One pose of a trajectory.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Seconds in the trajectory's own scale.
    pub time: f64,
    /// World coordinates, m.
    pub position: DVec3,
    /// Attitude of the platform.
    pub attitude: Rotation,
}

/// What waiting for poses came to.
#[derive(Clone, Debug, PartialEq)]
pub enum PollResult {
    /// Some arrived.
    Poses(Vec<Pose>),
    /// None arrived within the time given.
    TimedOut,
    /// The stream is over.
    End,
}

/// What an observer of a trajectory sees.
#[derive(Clone, Copy, Debug)]
pub enum PoseEvent {
    /// The next pose, with its angles as they stand in text that names no unit for them.
    Pose(Pose, Option<[f64; 3]>),
    /// No more poses will come.
    End,
}

/// Why no more poses can be read.
enum Failure {
    Input(Box<Diagnostics>),
    Io(std::io::ErrorKind, String),
}

/// Most poses of a block.
const MOST_POSES: usize = 1024;

/// Reads a trajectory in any of its layouts from a file, a named pipe or standard input. Times must ascend.
pub struct PoseReader {
    input: InputStream,
    path: PathBuf,
    spelling: Spelling,
    source: Source,
    frame: Frame,
    order: Order,
    /// Whether the zone is that of the first pose.
    zone_is_found: bool,
    /// Bytes of a record whose end has not arrived.
    rest: Vec<u8>,
    bytes: u64,
    poses: u64,
    arrived: VecDeque<Pose>,
    failure: Option<Failure>,
    ended: bool,
    strict: bool,
    tell: Box<dyn FnMut(Notice) + Send>,
    observe: Box<dyn FnMut(PoseEvent) -> Diagnostics + Send>,
    latency: Duration,
}

impl std::fmt::Debug for PoseReader {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("PoseReader")
            .field("path", &self.path)
            .field("poses", &self.poses)
            .finish_non_exhaustive()
    }
}

impl PoseReader {
    /// Opens the file, named pipe or (`-`) standard input that `settings` name.
    ///
    /// # Errors
    /// The file cannot be opened; columns that are none.
    pub fn open(settings: &PoseStream) -> Result<PoseReader> {
        if let Some(Err(message)) = settings.columns.as_deref().map(PoseLayout::chosen) {
            return Err(Error::input(format!("columns of the trajectory: {message}")));
        }
        let input = InputStream::open(&settings.path).map_err(|e| Error::open(&settings.path, e))?;
        Ok(PoseReader::new(input, settings))
    }

    /// Reads what arrives; `settings.path` is the name in messages.
    pub fn new(input: InputStream, settings: &PoseStream) -> PoseReader {
        let stdin = is_stdin(&settings.path);
        PoseReader {
            input,
            path: if stdin { PathBuf::from("<stdin>") } else { settings.path.clone() },
            spelling: Spelling::default(),
            source: Source::new(settings),
            frame: Frame::new(settings),
            order: Order::new(settings.max_gap),
            zone_is_found: settings.grid == Grid::FirstFix,
            rest: Vec::new(),
            bytes: 0,
            poses: 0,
            arrived: VecDeque::new(),
            failure: None,
            ended: false,
            strict: false,
            tell: Box::new(|_| ()),
            observe: Box::new(|_| Diagnostics::default()),
            latency: Duration::ZERO,
        }
    }

    /// The same reader, whose poses may wait so long for others to be flown along together.
    pub fn with_max_latency(self, latency: Duration) -> PoseReader {
        PoseReader { latency, ..self }
    }

    /// The same reader, which tells `tell` what it meets as it meets it. With `strict` a warning is an error.
    pub fn on_notice(self, strict: bool, tell: impl FnMut(Notice) + Send + 'static) -> PoseReader {
        PoseReader { strict, tell: Box::new(tell), ..self }
    }

    /// The same reader, which shows every pose to `observe` as it arrives and tells what that finds.
    pub fn on_pose(self, observe: impl FnMut(PoseEvent) -> Diagnostics + Send + 'static) -> PoseReader {
        PoseReader { observe: Box::new(observe), ..self }
    }

    /// How long what is flown along its poses may wait for more of them.
    pub fn max_latency(&self) -> Duration {
        self.latency
    }

    /// Waits for poses for some time and returns those that have arrived, at most 1024.
    ///
    /// # Errors
    /// A line or record that is no pose, or whose time does not ascend, with its number; a trajectory that cannot be read,
    /// or that is empty. Poses before the wrong one are returned first. The error stays: waiting again meets it again.
    pub fn poll(&mut self, timeout: Duration) -> Result<PollResult> {
        let until = Instant::now() + timeout;
        while self.arrived.is_empty() && self.failure.is_none() && !self.ended {
            if !self.receive(Some(until.saturating_duration_since(Instant::now()))) {
                return Ok(PollResult::TimedOut);
            }
        }
        if !self.arrived.is_empty() {
            let count = self.arrived.len().min(MOST_POSES);
            return Ok(PollResult::Poses(self.arrived.drain(..count).collect()));
        }
        self.ended = true;
        match &self.failure {
            Some(Failure::Input(problems)) => Err(Error::Input(problems.clone())),
            Some(Failure::Io(kind, text)) => {
                Err(Error::io("read", &self.path, std::io::Error::new(*kind, text.clone())))
            }
            None => Ok(PollResult::End),
        }
    }

    /// Waits for at least one pose, as long as it takes; `None` at the end of the stream.
    ///
    /// # Errors
    /// As [`PoseReader::poll`].
    pub fn next_block(&mut self) -> Result<Option<Vec<Pose>>> {
        loop {
            match self.poll(Duration::from_secs(3600))? {
                PollResult::Poses(block) => return Ok(Some(block)),
                PollResult::End => return Ok(None),
                PollResult::TimedOut => {}
            }
        }
    }

    /// Takes in one read's worth of bytes; `false` if none arrived in time.
    fn receive(&mut self, patience: Option<Duration>) -> bool {
        let mut taken = std::mem::take(&mut self.rest);
        match self.input.next(patience) {
            ReadEvent::Bytes(bytes) => {
                self.bytes += bytes.len() as u64;
                let spelled = self.spelling.add(&bytes, &mut taken, &mut self.path);
                self.refuse(spelled);
            }
            ReadEvent::Timeout => {
                self.rest = taken;
                return false;
            }
            ReadEvent::End => {
                self.ended = true;
                let whole = self.spelling.end();
                self.refuse(whole);
            }
            ReadEvent::Error(e) => self.failure = Some(Failure::Io(e.kind(), e.to_string())),
        }
        if self.spelling.is_unknown() && !self.ended {
            self.rest = taken;
            return true;
        }
        let mut start = 0;
        while self.failure.is_none() {
            match self.source.next(&taken[start..], self.ended) {
                Next::More => break,
                Next::Passed(bytes) => start += bytes,
                Next::Fix(bytes, fix, mark) => {
                    start += bytes;
                    self.take(&fix, &mark);
                }
                Next::Wrong(mark, problem) => self.fail(&mark, problem),
            }
        }
        taken.drain(..start);
        self.rest = taken;
        if self.ended && self.failure.is_none() {
            self.look_back();
        }
        true
    }

    /// Keeps what is wrong with the stream as a whole, if anything is.
    fn refuse(&mut self, outcome: Result<()>) {
        if let Err(Error::Input(problems)) = outcome {
            self.failure = Some(Failure::Input(problems));
        }
    }

    fn take(&mut self, fix: &Fix, mark: &Mark) {
        match self.order.admit(fix) {
            Err(problem) => {
                let at = problem.at.clone().or(mark.time());
                return self.fail(mark, Problem { at, ..problem });
            }
            Ok(order::Admitted { passed_over, warning }) => {
                if let Some(problem) = warning {
                    self.warn(mark, problem);
                }
                if passed_over || self.failure.is_some() {
                    return;
                }
            }
        }
        let pose = match self.frame.pose(fix) {
            Ok(pose) => pose,
            Err(problem) => return self.fail(mark, problem),
        };
        if self.poses == 0 {
            self.introduce(&pose, matches!(fix.place, FixPlace::Geographic(_)));
        }
        if let Some(note) = self.order.course(&pose) {
            (self.tell)(Notice::Note(format!("{}: {note}", self.path.display())));
        }
        self.show(PoseEvent::Pose(pose, fix.unitless_angles));
        self.poses += 1;
        self.arrived.push_back(pose);
    }

    /// Says what the first pose was understood to be.
    fn introduce(&mut self, pose: &Pose, geographic: bool) {
        let (path, p) = (self.path.display(), pose.position);
        if let Some(zone) = self.frame.zone().filter(|_| self.zone_is_found) {
            (self.tell)(Notice::Note(format!(
                "{path}: poses are projected to UTM zone {zone}, that of the first one; --utm-zone names another"
            )));
        }
        if geographic && self.frame.height_offset() == 0.0 {
            (self.tell)(Notice::Note(format!(
                "{path}: heights are taken as they are, the first is {:.1} m; where they count from the ellipsoid and the \
                 scene's from a geoid, --height-offset brings them together",
                p.z
            )));
        }
        let heading = libm::atan2(pose.attitude.forward().x, pose.attitude.forward().y).to_degrees();
        (self.tell)(Notice::Detail(format!(
            "{path}: {}; first pose at time {}, x {:.3}, y {:.3}, z {:.3}, heading {:.2}°",
            self.source.name(),
            pose.time,
            p.x,
            p.y,
            p.z,
            heading.rem_euclid(360.0)
        )));
    }

    fn show(&mut self, seen: PoseEvent) {
        let found = (self.observe)(seen);
        if found.is_empty() {
            return;
        }
        match found.finish(self.strict) {
            Ok(warnings) => (self.tell)(Notice::Warnings(warnings)),
            Err(Error::Input(problems)) => self.failure = Some(Failure::Input(problems)),
            Err(_) => {}
        }
    }

    /// Judges the trajectory as a whole.
    fn look_back(&mut self) {
        self.show(PoseEvent::End);
        if self.poses > 0 {
            let (poses, path) = (self.poses, self.path.display());
            return (self.tell)(Notice::Detail(format!("{path}: {poses} poses")));
        }
        let file = Mark::Line { number: 0, text: "".into(), time: 0..0 };
        if self.bytes == 0 {
            self.fail(&file, Problem::new("the trajectory is empty, expected poses"));
        } else {
            self.warn(&file, Problem::new("the trajectory holds 0 poses: nothing is flown"));
        }
    }

    fn warn(&mut self, mark: &Mark, problem: Problem) {
        if self.strict {
            return self.fail(mark, problem);
        }
        let mut warnings = Diagnostics::default();
        mark.warn(&self.path, problem, &mut warnings);
        (self.tell)(Notice::Warnings(warnings));
    }

    fn fail(&mut self, mark: &Mark, problem: Problem) {
        self.failure = Some(Failure::Input(Box::new(mark.error(&self.path, problem))));
    }
}

/// All poses of a file whose content is binary; `None` for text.
pub(super) fn read_binary(
    path: &Path,
    bytes: &[u8],
    frame: &mut Frame,
) -> Option<std::result::Result<Vec<Pose>, Diagnostics>> {
    let mut source = Source::new(&PoseStream::at(path));
    let (mut poses, mut start) = (Vec::new(), 0);
    loop {
        let next = source.next(&bytes[start..], true);
        if !matches!(source, Source::Binary(_)) {
            return None;
        }
        match next {
            Next::More => return Some(Ok(poses)),
            Next::Passed(count) => start += count,
            Next::Fix(count, fix, mark) => {
                start += count;
                match frame.pose(&fix) {
                    Ok(pose) => poses.push(pose),
                    Err(problem) => return Some(Err(mark.error(path, problem))),
                }
            }
            Next::Wrong(mark, problem) => return Some(Err(mark.error(path, problem))),
        }
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use std::io::Read;

    /// Settings without any wishes.
    pub fn settings() -> PoseStream {
        PoseStream::at("-")
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
        PoseReader::new(InputStream::from_reader(trickle), settings)
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
        let mut r = PoseReader::new(InputStream::from_reader(std::io::Cursor::new(many)), &settings());
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

    /// What is told while `bytes` are read, and how the reading ends.
    fn told(bytes: &[u8], strict: bool) -> (Vec<Notice>, Result<usize, String>) {
        let all = std::sync::Arc::new(std::sync::Mutex::new(Vec::new()));
        let heard = all.clone();
        let mut reader =
            PoseReader::new(InputStream::from_reader(std::io::Cursor::new(bytes.to_vec())), &settings())
                .on_notice(strict, move |told| heard.lock().unwrap().push(told));
        let mut poses = 0;
        let end = loop {
            match reader.next_block() {
                Ok(Some(block)) => poses += block.len(),
                Ok(None) => break Ok(poses),
                Err(Error::Input(d)) => break Err(d.render(false)),
                Err(e) => break Err(e.to_string()),
            }
        };
        let told = all.lock().unwrap().clone();
        (told, end)
    }

    fn warnings(told: &[Notice]) -> String {
        let of = |t: &Notice| match t {
            Notice::Warnings(found) => Some(found.render(false)),
            _ => None,
        };
        told.iter().filter_map(of).collect()
    }

    #[test]
    fn an_identical_row_is_passed_over_with_a_warning() {
        let text = b"1,0,0,0,0,0,0\n1,0,0,0,0,0,0\n2,0,0,0,0,0,0\n";
        let (said, end) = told(text, false);
        assert_eq!(end, Ok(2));
        assert!(warnings(&said).contains("<stdin>:2:1"), "{said:?}");
        assert!(told(text, true).1.unwrap_err().contains("<stdin>:2:1"));
    }

    #[test]
    fn gaps_are_told_with_their_lines() {
        let (said, end) = told(b"1,0,0,0,0,0,0\n1.1,0,0,0,0,0,0\n9.1,0,0,0,0,0,0\n", false);
        assert_eq!(end, Ok(3));
        assert!(
            warnings(&said).contains("<stdin>:3:1") && warnings(&said).contains("no pose for 8 s"),
            "{said:?}"
        );
        let slow: String = (0..9).map(|i| format!("{i},0,0,0,0,0,0\n")).collect();
        assert_eq!(warnings(&told(slow.as_bytes(), false).0), "", "one pose a second is no gap");
    }

    #[test]
    fn nothing_to_fly_is_told() {
        let (said, end) = told(b"time,x,y,z,roll,pitch,yaw\n", false);
        assert_eq!(end, Ok(0));
        assert!(warnings(&said).contains("0 poses"), "{said:?}");
        assert!(told(b"", false).1.unwrap_err().contains("empty"));
    }

    #[test]
    fn headings_across_the_course_are_told_once() {
        let east: String = (0..30).map(|i| format!("{i},{},0,0,0,0,270\n", i * 10)).collect();
        let notes: Vec<String> = told(east.as_bytes(), false)
            .0
            .into_iter()
            .filter_map(|t| if let Notice::Note(note) = t { Some(note) } else { None })
            .collect();
        assert!(notes.len() == 1 && notes[0].contains("--trajectory-rotation"), "{notes:?}");
    }

    #[test]
    fn records_are_read_in_any_pieces() {
        let rows: Vec<[f64; 7]> =
            (0..300).map(|i| [1000.0 + f64::from(i) * 0.005, 0.8, 0.15, 300.0, 0., 0., 1.]).collect();
        let (sbet, trj) = (binary::testing::sbet(&rows), binary::testing::terrascan(&rows));
        for bytes in [&sbet, &trj] {
            let whole = told(bytes, false).1;
            assert_eq!(whole, Ok(300));
            for size in [1, 7, 137, 4096] {
                let trickle = Trickle { text: bytes.clone(), size };
                let mut reader = PoseReader::new(InputStream::from_reader(trickle), &settings());
                let mut count = 0;
                while let Some(block) = reader.next_block().unwrap() {
                    count += block.len();
                }
                assert_eq!(count, 300, "in pieces of {size}");
            }
        }
        let zone = |t: &Notice| matches!(t, Notice::Note(note) if note.contains("UTM zone 32N"));
        assert!(told(&sbet, false).0.iter().any(zone));
    }

    proptest::proptest! {
        #[test]
        fn any_bytes_are_read_or_refused(text in "[#HEADRTIM_:0-9txyz,; \t\n.-]{0,200}", size in 1usize..40) {
            let once = read_all(&text, 10_000, &settings());
            proptest::prop_assert_eq!(once, read_all(&text, size, &settings()));
        }

        #[test]
        fn any_records_are_read_or_refused(bytes in proptest::collection::vec(0u8.., 0..500)) {
            let _ = told(&bytes, false);
        }
    }
}
