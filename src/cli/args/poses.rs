//! The command line of recorded trajectories.

use crate::error::{Error, Result};
use crate::geom::{DVec3, UtmZone, radians};
use crate::survey::{AngleConvention, PoseChoices, PoseFormat};
use clap::Args;
use std::path::PathBuf;

/// How a trajectory is read.
#[derive(Clone, Debug, Default, Args)]
pub struct PoseArgs {
    /// Layout of the trajectory. [default: found out from its content]
    #[arg(long, value_name = "FORMAT", value_parser = PoseFormat::NAMES, help_heading = "Trajectory")]
    pub trajectory_format: Option<String>,
    /// Columns of text: names in their order (time, x, y, z, roll, pitch, yaw, lat, lon; others are passed over) or
    /// name=number from 1; a unit may stand behind a name: roll[rad]. [default: the first line, else time,x,y,z,roll,pitch,yaw]
    #[arg(long, value_name = "NAMES", value_delimiter = ',', help_heading = "Trajectory")]
    pub trajectory_columns: Vec<String>,
    /// Unit of angles in text behind whose names none stands. [default: deg]
    #[arg(long, value_name = "UNIT", value_parser = ["deg", "rad"], help_heading = "Trajectory")]
    pub trajectory_angles: Option<String>,
    /// What the angles of text are: heading (clockwise from north, nose up, right side down, roll innermost; the same as
    /// arinc705), yaw (counter-clockwise from east, otherwise the same), ros (as yaw, nose down), helios (as heading, but
    /// pitch innermost), or canonical (about x, y, z, as HELIOS++ writes flights from waypoint to waypoint). [default: helios
    /// for files as HELIOS++ reads and writes them, else heading]
    #[arg(long, value_name = "MEANING", value_parser = AngleConvention::NAMES, help_heading = "Trajectory")]
    pub trajectory_rotation: Option<String>,
    /// UTM zone to which latitudes and longitudes are projected, such as 32N. [default: that of --crs, else that of the
    /// first pose]
    #[arg(long, value_name = "ZONE", help_heading = "Trajectory")]
    pub utm_zone: Option<String>,
    /// Added to all heights of the trajectory, in metres: from those above the ellipsoid to those of the scene.
    #[arg(long, value_name = "METRES", allow_hyphen_values = true, help_heading = "Trajectory")]
    pub height_offset: Option<f64>,
    /// Lever arm: where the scanner's platform frame is as seen from what was recorded, in metres to the right, forward and
    /// up of the recorded body. It turns with the attitude, not with the boresight.
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, help_heading = "Trajectory")]
    pub lever_arm: Option<String>,
    /// Boresight: how the scanner's platform frame is turned in the recorded body: roll (right side down), pitch (nose up)
    /// and heading (clockwise from above) in degrees, roll innermost. A point is at position + attitude (lever arm +
    /// boresight (point as the platform's scanner sees it)).
    #[arg(long, value_name = "R,P,H", allow_hyphen_values = true, help_heading = "Trajectory")]
    pub boresight: Option<String>,
    /// Fire nothing between poses that are more seconds apart than this.
    #[arg(long, value_name = "SECONDS", help_heading = "Trajectory")]
    pub max_gap: Option<f64>,
}

impl PoseArgs {
    /// What is said about the trajectory at `path`.
    ///
    /// # Errors
    /// Values that cannot be meant.
    pub fn choices(&self, path: Option<PathBuf>) -> Result<PoseChoices> {
        let utm_zone = self.utm_zone.as_deref().map(|text| {
            UtmZone::parse(text).ok_or_else(|| {
                Error::input(format!("--utm-zone: expected a zone such as 32N or 55S, found {text:?}"))
            })
        });
        if let Some(offset) = self.height_offset.filter(|offset| !offset.is_finite()) {
            return Err(Error::input(format!("--height-offset: expected metres, found {offset}")));
        }
        if let Some(gap) = self.max_gap.filter(|gap| !(gap.is_finite() && *gap > 0.0)) {
            return Err(Error::input(format!("--max-gap: expected seconds above 0, found {gap}")));
        }
        let boresight =
            three("--boresight", "roll, pitch and heading in degrees", self.boresight.as_deref())?;
        Ok(PoseChoices {
            path,
            format: self.trajectory_format.as_deref().and_then(PoseFormat::named),
            rotation: self.trajectory_rotation.as_deref().and_then(AngleConvention::named),
            degrees: self.trajectory_angles.as_deref().map(|unit| unit == "deg"),
            columns: (!self.trajectory_columns.is_empty()).then(|| self.trajectory_columns.clone()),
            separator: None,
            utm_zone: utm_zone.transpose()?,
            height_offset: self.height_offset,
            lever_arm: three("--lever-arm", "x, y and z in metres", self.lever_arm.as_deref())?
                .map(DVec3::from),
            boresight: boresight.map(|angles| angles.map(radians)),
            max_gap: self.max_gap,
        })
    }
}

fn three(option: &str, expected: &str, text: Option<&str>) -> Result<Option<[f64; 3]>> {
    let Some(text) = text else { return Ok(None) };
    let numbers: Vec<f64> = text.split(',').filter_map(|n| n.trim().parse().ok()).collect();
    match <[f64; 3]>::try_from(numbers) {
        Ok(three) if text.split(',').count() == 3 && three.iter().all(|v| v.is_finite()) => Ok(Some(three)),
        _ => Err(Error::input(format!("{option}: expected {expected}, such as 0,-0.5,1.2, found {text:?}"))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_checked() {
        let args = |change: fn(&mut PoseArgs)| {
            let mut args = PoseArgs::default();
            change(&mut args);
            args.choices(None)
        };
        let lever = args(|a| a.lever_arm = Some("-0.5, 1,2e-1".into())).unwrap().lever_arm;
        assert_eq!(lever, Some(DVec3::new(-0.5, 1.0, 0.2)));
        let boresight = args(|a| a.boresight = Some("0,0,180".into())).unwrap().boresight.unwrap();
        assert!((boresight[2] - std::f64::consts::PI).abs() < 1e-15);
        assert_eq!(args(|_| ()).unwrap(), PoseChoices::default());
        for wrong in ["1,2", "1,2,x", "1,2,3,4", "1,,2,3", "nan,0,0", ""] {
            let mut a = PoseArgs { lever_arm: Some(wrong.into()), ..PoseArgs::default() };
            assert!(a.choices(None).unwrap_err().to_string().contains("--lever-arm"), "{wrong}");
            a = PoseArgs { boresight: a.lever_arm, ..PoseArgs::default() };
            assert!(a.choices(None).unwrap_err().to_string().contains("--boresight"), "{wrong}");
        }
        assert!(args(|a| a.utm_zone = Some("32U".into())).unwrap_err().to_string().contains("32N"));
        assert!(
            args(|a| a.max_gap = Some(0.0)).is_err() && args(|a| a.height_offset = Some(f64::NAN)).is_err()
        );
    }
}
