//! Tests of columns of poses.

use super::*;
use vlscan_base::columns::Separator;
use vlscan_tables::input::rows::RowDecoder;

fn names(line: &str) -> Vec<String> {
    Separator::guess(line).split(line).map(|at| line[at].to_owned()).collect()
}

fn layout(line: &str) -> Result<PoseLayout, String> {
    PoseLayout::from_headings(names(line)).map_err(|e| e.to_string())
}

/// The message about a row, if there is one, and the text that it marks.
fn refused(layout: &PoseLayout, line: &str) -> (String, String) {
    let mut rows = RowDecoder::new(std::path::Path::new("a.txt"), "a pose", None);
    rows.feed(line.as_bytes());
    let block = rows.next_block(1, true).unwrap().unwrap();
    let e = layout.read(&block.row(0, &mut Vec::new())).unwrap_err();
    (e.place.excerpt[e.place.marked.clone()].to_owned(), e.message)
}

#[test]
fn headings_are_found_in_any_order() {
    let l = layout("x,y,z,gps_time,quality,Roll[deg],pitch,heading").unwrap();
    assert_eq!(l.columns, [Some(3), Some(5), Some(6), Some(7), Some(0), Some(1), Some(2)]);
    assert!(l.factors[1].is_some() && l.factors[2].is_none());
    assert!(l.complete(&POSE_COLUMNS).is_ok());
}

#[test]
fn names_of_the_grid_are_coordinates() {
    for line in [
        "time,Grid Easting,Grid Northing,Ell. Height,roll,pitch,yaw",
        "time;Rechts;Hoch;hauteur;roll;pitch;yaw",
        "time,UTM_E,UTM_N,alt,roll,pitch,yaw,GPSWeek,sigma_x,speed,sats,cog",
    ] {
        let l = layout(line).unwrap().complete(&POSE_COLUMNS).unwrap();
        assert_eq!(l.columns, [0, 4, 5, 6, 1, 2, 3].map(Some), "{line}");
        let mut found = Diagnostics::default();
        l.report_unread(None, &mut found);
        assert!(!found.text().contains("warning"), "{line}");
    }
}

#[test]
fn units_separated_from_their_names_are_no_columns() {
    let l = layout("time x y z roll (deg) pitch (deg) yaw (deg)").unwrap();
    assert_eq!(l.columns, [Some(0), Some(4), Some(5), Some(6), Some(1), Some(2), Some(3)]);
    assert!(l.factors[3].is_some());
}

#[test]
fn geographic_columns_count_where_there_are_no_projected_ones() {
    let l = layout("t,lat[rad],longitude,h").unwrap();
    assert!(l.geographic && l.columns[4] == Some(2) && l.columns[5] == Some(1));
    assert_eq!(l.in_si([1.0, 2.0, 0.0, 0.0, 180.0, 0.5, 9.0], true)[4..], [std::f64::consts::PI, 0.5, 9.0]);
    let l = layout("t,lat,lon,x,northing,z").unwrap();
    assert!(!l.geographic && l.columns[4] == Some(3) && l.columns[5] == Some(4));
    assert!(layout("lat[m]").unwrap_err().contains("expected rad, mrad or deg"));
}

#[test]
fn two_quantities_in_one_column_are_refused() {
    let chosen =
        |list: &[&str]| PoseLayout::chosen(&list.iter().map(|c| (*c).to_owned()).collect::<Vec<_>>());
    let e = chosen(&["time=1", "x=1", "y=2", "z=3", "roll=4", "pitch=5", "yaw=6"]).unwrap_err();
    assert_eq!(e, PoseLayoutError::SameColumn { one: "time", other: "x", column: 1 });
    assert_eq!(e.to_string(), "time and x are both column 1");
    assert!(chosen(&["time", "x", "y", "z", "roll", "pitch", "yaw"]).is_ok());
    let named = layout("time,x,y,z,roll,pitch,yaw").unwrap();
    let numbered = PoseLayout::numbered([0, 1, 2, 3, 4, 5, 6]);
    assert_eq!(numbered.difference(&named), Some(("roll", 1, 4)));
    assert_eq!(named.difference(&named), None);
}

#[test]
fn errors_in_rows_are_located() {
    let l = PoseLayout::in_order(&POSE_COLUMNS, None);
    let (marked, message) = refused(&l, "1,2,3,abc,5,6,7");
    assert_eq!((&*marked, &*message), ("abc", "expected a number for yaw, found `abc`"));
    assert!(refused(&l, "1,2,3").1.contains("column 4 for yaw is missing: 3 columns"));
    assert!(refused(&l, "1,2,3,nan,5,6,7").1.contains("found `nan`"));
    assert!(refused(&l, "1;2.5;3,5;4;5;6;7").1.contains("decimal comma"));
    assert!(refused(&l, "1,2,3,1e30,5,6,7").1.contains("yaw is 1e30, expected an angle"));
    assert!(layout("time,x,x").unwrap_err().contains("`x` and `x` have the same meaning"));
}

#[test]
fn quaternions_are_columns_too() {
    let l = layout(
        "#timestamp [ns],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z []",
    );
    let l = l.unwrap().complete(&POSE_COLUMNS).unwrap();
    assert_eq!((l.attitude, l.factors[0]), (AttitudeColumns::Quaternion([4, 5, 6, 7]), Some(1e-9)));
    let l = layout("t,tx,ty,tz,qx,qy,qz,qw").unwrap();
    assert_eq!(l.attitude, AttitudeColumns::Quaternion([7, 4, 5, 6]));
    assert!(refused(&l, "0 0 0 0 0 0 0 2").1.contains("the quaternion's length is 2"));
    assert!(refused(&l, "0 0 0 0 0 0 0 1 5").1.contains("9 fields, expected 8 as in the heading"));
    assert!(layout("t,x,y,z,qx,qy,qz").unwrap_err().contains("no column for qw"));
    let chosen = |list: &str| {
        let chosen = PoseLayout::chosen(&list.split(',').map(str::to_owned).collect::<Vec<_>>());
        chosen.map_err(|e| e.to_string())
    };
    let l = chosen("time_ms,x,y,z,qw,qx,qy,qz").unwrap();
    assert_eq!((l.attitude, l.factors[0]), (AttitudeColumns::Quaternion([4, 5, 6, 7]), Some(1e-3)));
    assert!(chosen("time,x,y,z,qw,qx,qy,qz,yaw").unwrap_err().contains("`yaw` would not be read"));
    assert!(chosen("time,x,y,easting").unwrap_err().contains("`x` and `easting`"));
}

#[test]
fn exports_of_navigation_programs_have_further_columns() {
    let pospac = "TIME, DISTANCE, EASTING, NORTHING, ELLIPSOID HEIGHT, LATITUDE, LONGITUDE, ELLIPSOID HEIGHT, \
                      ROLL, PITCH, HEADING, EAST VELOCITY, NORTH VELOCITY, UP VELOCITY, EAST SD, ROLL SD, HEADING SD";
    let l = layout(pospac).unwrap().complete(&POSE_COLUMNS).unwrap();
    assert_eq!(l.columns, [0, 8, 9, 10, 2, 3, 4].map(Some));
    let mut found = Diagnostics::default();
    l.report_unread(None, &mut found);
    let said = found.text();
    assert!(said.contains("note") && said.contains("`LATITUDE`") && !said.contains("warning"), "{said}");
    let explorer =
        layout("Week GPSTime(sec) Latitude(deg) Longitude(deg) H-Ell(m) Azimuth(deg) Pitch(deg) Roll(deg) Q");
    let l = explorer.unwrap().complete(&POSE_COLUMNS).unwrap();
    assert_eq!((l.columns, l.geographic), ([1, 7, 6, 5, 3, 2, 4].map(Some), true));
    assert!(layout("time,x,y,H-Ell,H-MSL,roll,pitch,yaw").unwrap_err().contains("have the same meaning"));
    let mut found = Diagnostics::default();
    layout("time,x,y,z,roll,pitch,hedaing").unwrap().report_unread(None, &mut found);
    assert!(found.text().contains("did you mean `heading` by `hedaing`?"));
}
