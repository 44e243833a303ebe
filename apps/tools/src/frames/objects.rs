//! Moving objects over time, as `vlscan run --objects` writes them.

use std::collections::BTreeMap;
use std::path::Path;
use vlscan_base::diag::{Diagnostics, nearest};
use vlscan_base::error::{Error, Result};
use vlscan_base::quantity::Bounds;
use vlscan_base::recognise::{Expected, foreign};
use vlscan_geom::{DVec3, Rotation};
use vlscan_tables::input::read_file;
use vlscan_tables::{Line, TextTable, did_you_mean};

/// Maximum size of a table, bytes.
const MAX_BYTES: u64 = 1 << 30;

/// Columns with numbers.
const NUMBERS: [&str; 14] =
    ["time", "x", "y", "z", "qw", "qx", "qy", "qz", "length", "width", "height", "vx", "vy", "vz"];
/// Columns with whole numbers and texts.
const OTHERS: [&str; 4] = ["object", "id", "name", "class"];

const COORDINATE: Bounds = Bounds::new(-1e9, 1e9, "a number from -1e9 to 1e9");
const TIME: Bounds = Bounds::new(0.0, 1e10, "seconds from 0 to 1e10");
const SIZE: Bounds = Bounds::new(0.0, 1e6, "metres from 0 to 1e6");
/// Number of times between poses for which the last pose of a moving object may hold. The flight ends within
/// one of them, which is longer where pulses of a lower rate follow.
const MAX_LAST_STEPS: f64 = 10.0;
/// Greatest difference of the length of a quaternion from 1.
const MAX_QUATERNION_ERROR: f64 = 0.01;

/// A pose of the box of an object, which holds until the next one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct ObjectPose {
    /// Time from which on it holds, ns.
    pub time_ns: f64,
    /// Centre of the box in the world, m.
    pub centre: DVec3,
    /// From the axes of the box, with x forward, y left and z up, to the world.
    pub rotation: Rotation,
    /// Velocity of the centre in the world, m/s.
    pub velocity: DVec3,
}

/// A moving object.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct ObjectTrack {
    pub id: String,
    pub name: String,
    /// Class of its surface.
    pub class: i64,
    /// Length, width and height of its box, m.
    pub size: DVec3,
    /// In the order of time; at least one.
    poses: Vec<ObjectPose>,
}

/// Moving objects by their numbers in the points.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Objects {
    tracks: BTreeMap<i64, ObjectTrack>,
}

impl ObjectTrack {
    /// Time of the first pose, ns.
    pub fn begin_ns(&self) -> f64 {
        self.poses.first().map_or(f64::NEG_INFINITY, |pose| pose.time_ns)
    }

    /// Time up to which the last pose of an object that moves on may hold, ns; infinite for others.
    pub fn end_ns(&self) -> f64 {
        match self.poses.as_slice() {
            // The first pose holds until the first pulse only.
            [_, .., before, last] if last.velocity != DVec3::ZERO => {
                last.time_ns + MAX_LAST_STEPS * (last.time_ns - before.time_ns)
            }
            _ => f64::INFINITY,
        }
    }

    /// The pose at a time, ns: the last one before, or the first one.
    pub fn at(&self, time_ns: f64) -> ObjectPose {
        let after = self.poses.partition_point(|pose| pose.time_ns <= time_ns);
        self.poses[after.saturating_sub(1)]
    }
}

impl Objects {
    /// Reads a table.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::Input`] with the line and the field of the first problem.
    pub fn read(path: &Path) -> Result<Objects> {
        let bytes = read_file(path, MAX_BYTES).map_err(|e| Error::open(path, e))?;
        if let Some(found) = foreign(path, &bytes, &Expected::NUMBERS.named("a table of objects")) {
            return Err(found.error(path));
        }
        let text = String::from_utf8(bytes)
            .map_err(|_| Error::input(format!("{}: expected text in UTF-8", path.display())))?;
        Objects::parse(path, &text)
    }

    /// The objects of a table; `path` names it in messages.
    pub fn parse(path: &Path, text: &str) -> Result<Objects> {
        let mut table = TextTable::new(path, text);
        let Some(heading) = table.next() else {
            return Err(Error::input_with_help(
                format!("{}: the table of objects is empty", path.display()),
                "vlscan run --objects objects.csv writes one",
            ));
        };
        let columns = Columns::of(path, &heading)?;
        let mut objects = Objects::default();
        while let Some(mut line) = table.next() {
            let problem = match line.fit(heading.fields.len(), "the heading", table.separator()) {
                Err(error) => Some((None, error.message)),
                Ok(()) => objects.add(&columns, &line).err().map(|(field, text)| (Some(field), text)),
            };
            if let Some((field, message)) = problem {
                let mut problems = Diagnostics::default();
                problems.error(Some(table.place(&line, field)), message);
                return Err(Error::Input(Box::new(problems)));
            }
        }
        Ok(objects)
    }

    /// The object with a number.
    pub fn get(&self, number: i64) -> Option<&ObjectTrack> {
        self.tracks.get(&number)
    }

    /// Adds the object of a line, or a pose to it. Errors have the index of the field.
    fn add(&mut self, columns: &Columns, line: &Line) -> std::result::Result<(), (usize, String)> {
        let [object, id, name, class] = columns.others;
        let whole = |field: usize| {
            let text = line.fields[field].trim();
            text.parse::<i32>().map_err(|_| (field, format!("expected a whole number, found `{text}`")))
        };
        let number = |i: usize, bounds: Bounds| {
            let field = columns.numbers[i];
            bounds.parse(&line.fields[field]).map_err(|error| (field, error.to_string()))
        };
        let vector = |first: usize, bounds: Bounds| {
            let value = |i: usize| number(first + i, bounds);
            Ok::<DVec3, (usize, String)>(DVec3::new(value(0)?, value(1)?, value(2)?))
        };
        let key = i64::from(whole(object)?);
        let (time, centre) = (number(0, TIME)?, vector(1, COORDINATE)?);
        let (w, u) = (number(4, COORDINATE)?, vector(5, COORDINATE)?);
        let length = (w * w + u.length_squared()).sqrt();
        if (length - 1.0).abs() > MAX_QUATERNION_ERROR {
            let message = format!("the quaternion has the length {length:.4}, expected 1");
            return Err((columns.numbers[4], message));
        }
        let rotation = Rotation { w: w / length, u: u / length };
        let pose = ObjectPose { time_ns: time * 1e9, centre, rotation, velocity: vector(11, COORDINATE)? };
        let size = vector(8, SIZE)?;
        let (class, text) = (i64::from(whole(class)?), |field: usize| line.fields[field].to_string());
        let new = || ObjectTrack { id: text(id), name: text(name), class, size, poses: Vec::new() };
        let track = self.tracks.entry(key).or_insert_with(new);
        if track.poses.last().is_some_and(|last| last.time_ns > pose.time_ns) {
            let message = format!("the times of object {key} do not ascend");
            return Err((columns.numbers[0], message));
        }
        track.poses.push(pose);
        Ok(())
    }
}

/// Places of the columns.
struct Columns {
    numbers: [usize; NUMBERS.len()],
    others: [usize; OTHERS.len()],
}

impl Columns {
    fn of(path: &Path, heading: &Line) -> Result<Columns> {
        let at = |name: &str| heading.fields.iter().position(|field| &**field == name);
        let missing: Vec<&str> =
            OTHERS.into_iter().chain(NUMBERS).filter(|name| at(name).is_none()).collect();
        if !missing.is_empty() {
            let is_known = |name: &str| OTHERS.contains(&name) || NUMBERS.contains(&name);
            let unknown = heading.fields.iter().filter(|field| !is_known(field));
            let question = did_you_mean(unknown, |name| nearest(name, missing.iter().copied()));
            return Err(Error::input_with_help(
                format!("{}: no columns {}", path.display(), missing.join(", ")),
                question.unwrap_or_else(|| "vlscan run --objects objects.csv writes such a table".to_owned()),
            ));
        }
        let count = |name: &str| heading.fields.iter().filter(|field| &***field == name).count();
        if let Some(name) = OTHERS.into_iter().chain(NUMBERS).find(|name| count(name) > 1) {
            return Err(Error::input(format!("{}: duplicate column {name}", path.display())));
        }
        // All are there.
        let place = |name: &str| at(name).unwrap_or_default();
        Ok(Columns { numbers: NUMBERS.map(place), others: OTHERS.map(place) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEADING: &str = "object,id,name,class,time,x,y,z,qw,qx,qy,qz,length,width,height,vx,vy,vz";

    fn read(rows: &str) -> Result<Objects> {
        Objects::parse(Path::new("objects.csv"), &format!("{HEADING}\n{rows}"))
    }

    #[test]
    fn poses_hold_until_the_next_one() {
        let objects = read(
            "7,car,\"a, b\",64,10,1,2,3,1,0,0,0,4,2,1.5,10,0,0\n\
             9,9,bus,65,10,0,0,0,1,0,0,0,12,3,3,0,0,0\n\
             7,car,\"a, b\",64,10.5,6,2,3,0.6,0,0,0.8,4,2,1.5,10,0,0\n",
        )
        .unwrap();
        let car = objects.get(7).unwrap();
        assert_eq!((car.id.as_str(), car.name.as_str(), car.class), ("car", "a, b", 64));
        assert_eq!(car.size, DVec3::new(4.0, 2.0, 1.5));
        let x = |time: f64| car.at(time * 1e9).centre.x;
        assert_eq!([9.0, 10.0, 10.49, 10.5, 99.0].map(x), [1.0, 1.0, 1.0, 6.0, 6.0]);
        // cos and sin of twice the angle whose cosine is 0.6.
        let nose = car.at(11e9).rotation.apply(DVec3::X);
        assert!((nose - DVec3::new(-0.28, 0.96, 0.0)).length() < 1e-12, "{nose}");
        assert!(objects.get(8).is_none() && objects.get(9).is_some());
    }

    #[test]
    fn hostile_tables_are_errors_with_their_line() {
        let good = "7,car,car,64,10,1,2,3,1,0,0,0,4,2,1.5,10,0,0";
        let row = |field: usize, text: &str| {
            let mut fields: Vec<&str> = good.split(',').collect();
            fields[field] = text;
            fields.join(",")
        };
        for (rows, expected) in [
            (row(0, "1.5"), "whole number"),
            (row(0, "99999999999"), "whole number"),
            (row(3, ""), "whole number"),
            (row(4, "NaN"), "seconds"),
            (row(4, "-1"), "seconds"),
            (row(5, "inf"), "number"),
            (row(8, "0"), "quaternion"),
            (row(12, "-4"), "metres"),
            (row(15, "1e300"), "number"),
            (format!("{good},5"), "19"),
            ("7,car".to_owned(), "2"),
            (format!("{good}\n{}", row(4, "9")), "ascend"),
        ] {
            let error = read(&rows).unwrap_err();
            let text = error.to_string();
            assert!(text.contains(expected), "{rows}: {text}");
        }
        for text in ["", "# nothing\n", "a,b\n1,2\n", "\u{0}\u{0}"] {
            assert!(Objects::parse(Path::new("objects.csv"), text).is_err(), "{text:?}");
        }
        let twice = Objects::parse(Path::new("objects.csv"), &format!("{HEADING},x\n")).unwrap_err();
        assert!(twice.to_string().contains("duplicate column x"), "{twice}");
        let misspelt = HEADING.replace("length", "lenght").replace("class", "clas");
        let error = format!("{:?}", Objects::parse(Path::new("objects.csv"), &misspelt).unwrap_err());
        assert!(error.contains("did you mean `class` by `clas`, `length` by `lenght`?"), "{error}");
        assert!(read("").unwrap().tracks.is_empty());
    }
}
