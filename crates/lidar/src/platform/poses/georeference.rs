//! Direct georeferencing: converts a fix in the recorder's frame into the pose of the scanner's platform in
//! the world.

use super::fix::{Fix, FixPlace, Pose, RecordError};
use vlscan_base::quantity::{COORDINATE, number};
use vlscan_geom::{DVec3, Rotation, UtmZone};
use vlscan_survey::{PoseStream, ProjectionGrid};

#[derive(Debug)]
pub struct Georeference {
    grid: ProjectionGrid,
    height_offset: f64,
    lever_arm: DVec3,
    boresight: Option<Rotation>,
    /// True if a position was projected to the grid.
    has_projected: bool,
}

impl Georeference {
    pub fn new(settings: &PoseStream) -> Georeference {
        let [roll, pitch, heading] = settings.boresight;
        Georeference {
            grid: settings.grid,
            height_offset: settings.height_offset,
            lever_arm: settings.lever_arm,
            boresight: (settings.boresight != [0.0; 3]).then(|| Rotation::of_heading(roll, pitch, heading)),
            has_projected: false,
        }
    }

    pub fn of_grid(grid: ProjectionGrid) -> Georeference {
        Georeference {
            grid,
            height_offset: 0.0,
            lever_arm: DVec3::ZERO,
            boresight: None,
            has_projected: false,
        }
    }

    pub fn height_offset(&self) -> f64 {
        self.height_offset
    }

    /// The UTM zone, once known.
    pub fn zone(&self) -> Option<UtmZone> {
        match self.grid {
            ProjectionGrid::Utm(zone) | ProjectionGrid::OfScene(zone) => Some(zone),
            _ => None,
        }
    }

    /// The UTM zone that positions were projected to.
    pub fn projected_zone(&self) -> Option<UtmZone> {
        self.zone().filter(|_| self.has_projected)
    }

    pub fn pose(&mut self, fix: &Fix) -> Result<Pose, RecordError> {
        let (mut position, mut attitude) = match fix.place {
            FixPlace::Local(place) => (DVec3::from(place), fix.attitude),
            FixPlace::Geographic(place) => self.project(place, fix.attitude)?,
        };
        if self.height_offset != 0.0 {
            position.z += self.height_offset;
        }
        if self.lever_arm != DVec3::ZERO {
            position += attitude.apply(self.lever_arm);
        }
        if let Some(boresight) = self.boresight {
            attitude = attitude.after(boresight);
        }
        if !position.to_array().iter().all(|&coordinate| COORDINATE.contains(coordinate)) {
            let message = format!(
                "the position x {} y {} z {}, expected {}",
                number(position.x),
                number(position.y),
                number(position.z),
                COORDINATE.expected
            );
            return Err(RecordError::new(message));
        }
        Ok(Pose { time: fix.time, position, attitude })
    }

    /// The position on the grid, and the attitude relative to the grid's north.
    fn project(
        &mut self,
        [latitude, longitude, height]: [f64; 3],
        attitude: Rotation,
    ) -> Result<(DVec3, Rotation), RecordError> {
        let (lat, lon) = (latitude.to_degrees(), longitude.to_degrees());
        let zone = match self.grid {
            ProjectionGrid::Utm(zone) | ProjectionGrid::OfScene(zone) => zone,
            ProjectionGrid::Foreign => {
                return Err(RecordError::new(
                    "latitude and longitude cannot be projected: the scene's coordinate reference system is \
                     no UTM zone",
                )
                .help("project the trajectory first, or name a zone with --utm-zone"));
            }
            ProjectionGrid::FirstFix => UtmZone::of(latitude, longitude)
                .ok_or_else(|| RecordError::new(format!("{lat}° is not a valid latitude")).help(UNIT))?,
        };
        let point = zone.project(latitude, longitude).ok_or_else(|| {
            let message = format!("latitude {lat}°, longitude {lon}° do not lie in UTM zone {zone}");
            RecordError::new(message).help(UNIT)
        })?;
        self.grid = ProjectionGrid::Utm(zone);
        self.has_projected = true;
        let position = DVec3::new(point.easting, point.northing, height);
        Ok((position, Rotation::about_z(point.convergence).after(attitude)))
    }
}

const UNIT: &str = "angles are degrees, unless their columns or --trajectory-angles say rad";

#[cfg(test)]
mod tests {
    use super::*;
    use vlscan_geom::radians;

    fn fix(place: FixPlace, heading: f64) -> Fix {
        Fix {
            time: 1.0,
            place,
            attitude: Rotation::of_heading(0.0, 0.0, radians(heading)),
            unitless_angles: None,
        }
    }

    #[test]
    fn lever_arm_and_boresight_turn_with_the_platform() {
        let mut georeference = Georeference::new(&PoseStream {
            lever_arm: DVec3::new(1.0, 2.0, -0.5),
            boresight: [0.0, radians(-10.0), radians(5.0)],
            height_offset: 100.0,
            ..PoseStream::at("-")
        });
        // To the east: right is south, forward is east.
        let pose = georeference.pose(&fix(FixPlace::Local([10.0, 20.0, 30.0]), 90.0)).unwrap();
        assert!((pose.position - DVec3::new(12.0, 19.0, 129.5)).length() < 1e-12, "{}", pose.position);
        let expected = Rotation::of_heading(0.0, radians(-10.0), radians(95.0));
        assert!((pose.attitude.forward() - expected.forward()).length() < 1e-12);
    }

    #[test]
    fn a_point_is_georeferenced_as_by_hand() {
        // r_world = r_nav + R (l + B r_scanner), computed by hand in docs/dev/details.md.
        let [quarter, eighth] = [90.0, 30.0].map(radians);
        let mut georeference = Georeference::new(&PoseStream {
            lever_arm: DVec3::new(0.4, 1.0, -0.2),
            boresight: [eighth, 0.0, 0.0],
            ..PoseStream::at("-")
        });
        let pose = georeference
            .pose(&Fix {
                time: 0.0,
                place: FixPlace::Local([1000.0, 2000.0, 500.0]),
                attitude: Rotation::of_heading(eighth, eighth, quarter),
                unitless_angles: None,
            })
            .unwrap();
        let scanner = DVec3::new(1001.052628, 1999.753590, 500.176795);
        assert!((pose.position - scanner).length() < 1e-6, "{}", pose.position);
        let point = pose.position + pose.attitude.apply(DVec3::new(0.0, 0.0, -100.0));
        assert!((point - DVec3::new(1026.052628, 2086.356130, 456.875525)).length() < 1e-6, "{point}");
    }

    #[test]
    fn headings_count_from_the_north_of_the_grid() {
        let mut georeference = Georeference::of_grid(ProjectionGrid::FirstFix);
        let place = |lat: f64, lon: f64| FixPlace::Geographic([radians(lat), radians(lon), 0.0]);
        let (a, b) = (
            georeference.pose(&fix(place(49.0, 11.0), 0.0)).unwrap(),
            georeference.pose(&fix(place(49.001, 11.0), 0.0)).unwrap(),
        );
        let way = (b.position - a.position).normalize();
        assert!((a.attitude.forward() - way).length() < 1e-5, "{} {way}", a.attitude.forward());
        assert!(way.x < -0.02, "true north leads to the left of grid north");
        assert_eq!(georeference.zone().unwrap().to_string(), "32N");
        // The zone stays, also across its border.
        assert!(georeference.pose(&fix(place(49.0, 12.1), 0.0)).unwrap().position.x > 700_000.0);
    }

    #[test]
    fn invalid_places_are_refused() {
        let mut georeference = Georeference::of_grid(ProjectionGrid::FirstFix);
        let of = |georeference: &mut Georeference, lat: f64| {
            georeference.pose(&fix(FixPlace::Geographic([lat, 0.1, 0.0]), 0.0))
        };
        assert!(of(&mut georeference, 49.0).unwrap_err().message.contains("is not a valid latitude"));
        assert!(
            of(&mut Georeference::of_grid(ProjectionGrid::Foreign), 0.8)
                .unwrap_err()
                .message
                .contains("no UTM zone")
        );
        let zone = ProjectionGrid::Utm(UtmZone::parse("50N").unwrap());
        assert!(
            of(&mut Georeference::of_grid(zone), 0.8)
                .unwrap_err()
                .message
                .contains("do not lie in UTM zone 50N")
        );
    }
}
