//! Tests of poses in lines of text.

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
        first(PoseStream { rotation: Some(rotation), ..defaults() }, "1 0 0 0 0 30 0").attitude.forward().z
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
    for (found, reference) in [
        (of(None, row), recorded),
        (of(Some(AngleConvention::Helios), row), of_reference),
        (of(None, &helios(row)), of_reference),
        (of(None, "0.0000 0.0000 0.0000 1.000000000 20.0000 10.0000 30.0000\n"), of_reference),
        (of(Some(AngleConvention::Heading), &helios(row)), recorded),
        (of(Some(AngleConvention::Yaw), "1 0 0 0 20 10 60\n"), recorded),
        (of(Some(AngleConvention::Ros), row), ros),
    ] {
        assert!((found.forward() - reference.forward()).length() < 1e-12);
        assert!((found.apply(DVec3::X) - reference.apply(DVec3::X)).length() < 1e-12);
    }
    assert!((recorded.forward() - of_reference.forward()).length() > 0.05);
}

#[test]
fn a_first_line_may_state_the_separator() {
    let fix = first(defaults(), "sep=;\ntime;x;y;z;roll;pitch;yaw\n1;2;3;4;0;0;0\n");
    assert_eq!((fix.time, fix.place), (1.0, FixPlace::Local([2.0, 3.0, 4.0])));
}

#[test]
fn headings_of_euroc_and_ros_mean_nanoseconds() {
    let euroc = "#timestamp,p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z []\n";
    let ros = "%time,field.header.stamp,field.pose.position.x,field.pose.position.y,field.pose.position.z,\
                   field.pose.orientation.x,field.pose.orientation.y,field.pose.orientation.z,\
                   field.pose.orientation.w\n";
    for (text, time) in [
        (format!("{euroc}1500000000,1,2,3,1,0,0,0\n"), 1.5),
        (format!("{euroc}1.25,1,2,3,1,0,0,0\n"), 1.25),
        (format!("{ros}2500000000,2500000000,1,2,3,0,0,0,1\n"), 2.5),
        ("time,x,y,z,qw,qx,qy,qz\n15,1,2,3,1,0,0,0\n".to_owned(), 15.0),
    ] {
        assert!((first(defaults(), &text).time - time).abs() < 1e-12, "{text}");
    }
}

#[test]
fn quaternions_that_probably_have_w_first_give_a_warning() {
    let remarks = |text: &str| {
        let mut rows = PoseRows::new(Path::new("-"), defaults());
        rows.feed(text.as_bytes());
        rows.decode(true, &mut |_, _, _| ControlFlow::Continue(())).unwrap();
        rows.take_remarks().text()
    };
    for text in ["1 0 0 0 1 0 0 0\n", "1403636580838555648 0 0 0 0 0 0 1\n"] {
        let said = remarks(text);
        assert!(said.contains("EuRoC has qw before qx") && said.contains("warning"), "{said}");
    }
    assert!(!remarks("1 0 0 0 0 0 0 1\n").contains("warning"));
}

#[test]
fn spreadsheets_quote_fields_and_write_decimal_commas() {
    let expected = (0.5, FixPlace::Local([2.25, 3.0, 4.0]));
    for text in [
        "\"time\",\"x\",\"y\",\"z\",\"roll\",\"pitch\",\"yaw\"\n\"0.5\",\"2.25\",\"3\",\"4\",\"0\",\"0\",\"0\"\n",
        "time;x;y;z;roll;pitch;yaw\n0,5;2,25;3;4;0;0;0\n",
        "0,5;2,25;3,0;4,0;0,0;0,0;0,0\n",
        "time\tx\ty\tz\troll\tpitch\tyaw\n0,5\t2,25\t3\t4\t0\t0\t0\n",
        "0,5 2,25 3 4 0,0 0,0 0,0 1,0\n",
    ] {
        let fix = first(defaults(), text);
        assert_eq!((fix.time, fix.place), expected, "{text}");
    }
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
    assert_eq!(fix.place, FixPlace::Local([5.0, 6.0, 300.0]), "coordinates that are projected already win");
}
