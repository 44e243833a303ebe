//! Reads the points of an MCAP as those of a cloud: in the world, where the poses of their frames put them.

use super::read::read_frames;
use crate::frames::Frame;
use crate::{Attribute, AttributeSet, Misfits, PointRow, Reading};
use std::io::Read;
use std::ops::ControlFlow;
use vlscan_base::error::{Error, Result};
use vlscan_geom::DVec3;

/// Reads a file. Times are those of the messages, s.
pub(crate) fn read_points(source: &mut dyn Read, reading: &mut Reading) -> Result<()> {
    let path = reading.path;
    let (mut is_begun, mut is_over) = (false, false);
    let read = read_frames(source, path, &mut |frame| {
        if !is_begun {
            reading.sink.start(frame.attributes);
            is_begun = true;
        }
        match pass(&frame, reading)? {
            ControlFlow::Continue(()) => Ok(()),
            ControlFlow::Break(()) => {
                is_over = true;
                Err(Error::Interrupted)
            }
        }
    });
    if !is_begun {
        reading.sink.start(AttributeSet::of(|attribute| Attribute::POSITION.contains(&attribute)));
    }
    match read {
        // The sink has ended reading.
        Err(_) if is_over => Ok(()),
        Err(Error::Input(problems)) => {
            reading.found.extend(*problems);
            Ok(())
        }
        read => read,
    }
}

/// Passes the points of a frame to the sink.
fn pass(frame: &Frame, reading: &mut Reading) -> Result<ControlFlow<()>> {
    // Points of one pulse, and of pulses at once, have one pose.
    let (mut latest, mut at) = (f32::NAN, None);
    for point in &frame.points {
        let in_scanner = DVec3::from(point.position.map(f64::from));
        // In ROS this marks the absence of a point.
        if in_scanner.is_nan() {
            continue;
        }
        let mut misfits = Misfits::default();
        let after = misfits.fitted(Attribute::Time, point.time_s.into());
        let time_ns = frame.time_ns as f64 + after * 1e9;
        if at.is_none() || point.time_s != latest {
            (latest, at) = (point.time_s, frame.pose_at(time_ns));
        }
        let is_miss = frame.has_misses && point.return_number == 0 && point.number_of_returns == 0;
        let position = match at {
            Some(pose) => pose.position + pose.rotation.apply(in_scanner),
            // Poses are those of points.
            None if is_miss => DVec3::ZERO,
            None => {
                return Err(Error::input_with_help(
                    format!("{}: it contains points whose frame has no poses (/tf)", reading.path.display()),
                    "write it with vlscan run -o points.mcap, whose poses are on /tf",
                ));
            }
        };
        let mut byte = |attribute, value: i64| misfits.fitted(attribute, value as f64) as u8;
        let class = byte(Attribute::Class, point.class);
        let return_number = byte(Attribute::ReturnNumber, point.return_number);
        let number_of_returns = byte(Attribute::NumberOfReturns, point.number_of_returns);
        let path = byte(Attribute::Path, point.path);
        let row = PointRow {
            position,
            intensity: misfits.fitted(Attribute::Intensity, point.intensity.into()) as f32,
            class,
            return_number,
            number_of_returns,
            is_miss,
            object: point.instance,
            time: time_ns / 1e9,
            path,
            misfits,
            ..PointRow::default()
        };
        if reading.take(&row).is_break() {
            return Ok(ControlFlow::Break(()));
        }
    }
    Ok(ControlFlow::Continue(()))
}
