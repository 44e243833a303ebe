//! Tests of columns.

use super::*;

#[test]
fn columns_are_found_by_the_usual_names_and_the_first_of_them_counts() {
    let columns = Columns::find(["Intensity", "scalar_Normal_X", "y [m]", "Amplitude", "X", "hitObjectId"]);
    let used: Vec<_> = columns.used().collect();
    use Attribute::{Intensity, NormalX, Object, X, Y};
    assert_eq!(used, [(X, 4), (Y, 2), (NormalX, 1), (Intensity, 0), (Object, 5)]);
    let row = columns.with(Attribute::Z, 0).row(|column| column as f64);
    assert_eq!((row.position, row.normal), (DVec3::new(4.0, 2.0, 0.0), None));
    assert_eq!((row.intensity, row.class, row.object), (0.0, 0, 5));
}

#[test]
fn zeros_are_misses_in_tables_of_this_program_alone() {
    let of = |more: &str, value: f64| {
        Columns::find(["x", "y", "z", "ReturnNumber", "NumberOfReturns", more]).row(|_| value).is_miss
    };
    assert!(of("PulseNumber", 0.0) && of("scalar_PulseNumber", 0.0) && of("BeamDirectionX", 0.0));
    assert!(!of("PulseNumber", 1.0) && !of("Intensity", 0.0) && !of("GpsTime", 0.0));
    assert!(!Columns::find(["x", "y", "z", "PulseNumber"]).row(|_| 0.0).is_miss);
}

#[test]
fn a_path_is_one_of_light_in_tables_of_this_program_alone() {
    let of = |more: &str| Columns::find(["x", "y", "z", "Path", more]).get(Attribute::Path);
    for name in ["PathOrder", "path_order", "SurfaceX", "scalar_PulseNumber", "fullwaveIndex"] {
        assert_eq!(of(name), Some(3), "{name}");
    }
    assert_eq!((of("Line"), of("NumberOfReturns")), (None, None));
}

#[test]
fn intensity_counts_beside_amplitude_but_in_own_tables() {
    for (names, column) in [
        (&["x", "y", "z", "Amplitude", "Intensity"][..], 4),
        (&["x", "y", "z", "Amplitude [dB]", "Reflectance [dB]"], 3),
        (&["x", "y", "z", "Intensity", "heliosAmplitude"], 4),
        (&["X", "Y", "Z", "Intensity", "Amplitude", "PulseNumber"], 4),
    ] {
        let columns = Columns::find(names.iter().copied());
        assert_eq!(columns.get(Attribute::Intensity), Some(column), "{names:?}");
        assert_eq!(columns.remarks(names), [""; 0], "{names:?}");
    }
}

#[test]
fn values_that_do_not_fit_are_noted() {
    let columns = Columns::find(["x", "y", "z", "class", "return", "object", "leg", "ring", "time"]);
    let row = |value: f64| columns.row(|column| if column < 3 { 0.0 } else { value });
    let fits = row(7.0);
    assert_eq!((fits.class, fits.return_number, fits.object, fits.leg, fits.channel), (7, 7, 7, 7, 7));
    assert!(fits.misfits == Misfits::default() && fits.time == 7.0);
    use Attribute::{Channel, Class, Leg, Object, ReturnNumber, Time};
    let integers = [Class, ReturnNumber, Object, Leg, Channel];
    for (value, class, leg, misfits) in [
        (300.0, 255, 300, &[Class, ReturnNumber][..]),
        (70_000.0, 255, 65_535, &[Class, ReturnNumber, Leg, Channel]),
        (-1.0, 0, 0, &[Class, ReturnNumber, Leg, Channel]),
        (2.7, 2, 2, &integers),
        (f64::NAN, 0, 0, &[Class, ReturnNumber, Object, Leg, Channel, Time]),
        (f64::INFINITY, 255, 65_535, &[Class, ReturnNumber, Object, Leg, Channel, Time]),
    ] {
        let row = row(value);
        assert_eq!((row.class, row.leg), (class, leg), "{value}");
        let noted: Vec<Attribute> = row.misfits.attributes().collect();
        assert!(noted.iter().all(|attribute| row.misfits.has(*attribute)), "{value}");
        let expected = Attribute::ALL.into_iter().filter(|attribute| misfits.contains(attribute));
        assert_eq!(noted, expected.collect::<Vec<_>>(), "{value}");
    }
}

#[test]
fn coordinates_have_other_names_and_units_too() {
    let columns = Columns::find_positions(&["id", "E", "Northing (ft)", "Höhe [cm]", "H"]).unwrap();
    let row = columns.row(|column| column as f64);
    assert_eq!(row.position, DVec3::new(1.0, 2.0 * 0.3048, 0.03));
    let names = ["X [in]", "Y [yd]", "Z [US survey foot]", "gps_time [ms]"];
    let row = Columns::find(names).row(|_| 1000.0);
    assert!((row.position - DVec3::new(25.4, 914.4, 304.800_609_601_219_2)).length() < 1e-9, "{row:?}");
    assert_eq!((row.time, Columns::find(names).remarks(&names)), (1.0, vec![]));
    let angle = |heading| Columns::find([heading]).row(|_| 0.5).scan_angle;
    assert_eq!(["ScanAngle", "ScanAngleRank [deg]", "scan_angle (rad)"].map(angle), [0.5, 0.5, degrees(0.5)]);
    let names = ["X [furlong]", "Y []", "Z (m a.s.l.)", "time [fortnight]", "intensity [dB]"];
    assert_eq!(Columns::find(names).row(|_| 1.0).position, DVec3::ONE);
    let said = Columns::find(names).remarks(&names);
    assert!(said.len() == 2 && said[0].contains("unit \"furlong\" of column 1"), "{said:?}");
    assert!(said[0].contains("metres are assumed") && said[1].contains("seconds are assumed"), "{said:?}");
    let missing = Columns::find_positions(&["x", "depth"]).unwrap_err().to_string();
    assert!(missing.contains("no column y and z") && missing.contains("x, depth"), "{missing}");
    for names in [&["lon", "lat", "z"][..], &["x [deg]", "y [deg]", "z"], &["Longitude", "y", "z"]] {
        let degrees = Columns::find_positions(names).unwrap_err().to_string();
        assert!(degrees.contains("longitude and latitude"), "{degrees}");
    }
}

#[test]
fn names_that_are_unknown_or_mean_the_same_are_remarked() {
    let remarks = |names: &[&str]| Columns::find(names.iter().copied()).remarks(names);
    let own =
        ["X", "Y", "Z", "Amplitude", "Intensity", "SurfaceClass", "Classification", "EchoWidth", "ObjectId"];
    assert_eq!(remarks(&own), [""; 0]);
    let twice = remarks(&["x", "y", "z", "Height", "z", "class", "Class", "omnivariance", "note"]);
    assert_eq!(twice.len(), 3, "{twice:?}");
    assert!(twice[0].contains("columns 3 (\"z\") and 4 (\"Height\")"), "{twice:?}");
    assert!(twice[1].contains("columns 6 (\"class\") and 7") && twice[2].contains("omnivariance, note"));
    let coloured = remarks(&["x", "y", "z", "red", "green", "blue", "Red"]);
    assert!(
        coloured.len() == 1 && coloured[0].contains("columns 4 (\"red\") and 7 (\"Red\")"),
        "{coloured:?}"
    );
    let misspelt = remarks(&["x", "y", "z", "intensty", "gps_tme [s]", "note"]);
    let question = "note; did you mean `intensity` by `intensty`, `gpstime` by `gps_tme [s]`?";
    assert!(misspelt.len() == 1 && misspelt[0].ends_with(question), "{misspelt:?}");
    let missing = Columns::find_positions(&["x", "y", "elevaton"]).unwrap_err().to_string();
    assert!(missing.ends_with("elevaton; did you mean `elevation` by `elevaton`?"), "{missing}");
    for names in [&["x", "y", "z", "class", "label"][..], &["x", "y", "z", "tree_id", "instance"]] {
        assert!(remarks(names)[0].contains("columns 4"), "{names:?}: only usual pairs are no question");
    }
}

#[test]
fn whole_numbers_fit_within_their_ranges() {
    let of_long = [-3.0, 9_223_372_036_854_775_808.0, -9_223_372_036_854_775_808.0];
    for (attribute, value) in
        [(Attribute::Class, 255.0), (Attribute::Class, -0.0), (Attribute::Leg, 65_535.0)]
            .into_iter()
            .chain(of_long.map(|value| (Attribute::Object, value)))
            .chain([(Attribute::Time, 0.5), (Attribute::Time, -1e300)])
    {
        let mut misfits = Misfits::default();
        let fitted = misfits.fitted(attribute, value);
        let noted = misfits.attributes().count();
        assert_eq!((fitted.to_bits(), noted), (value.to_bits(), 0), "{attribute:?} {value}");
    }
    for (attribute, value, expected) in [
        (Attribute::Class, 256.0, 255.0),
        (Attribute::Class, 2.5, 2.0),
        (Attribute::Class, -1.0, 0.0),
        (Attribute::Class, f64::NAN, 0.0),
        (Attribute::Leg, f64::INFINITY, 65_535.0),
        (Attribute::Object, 1e300, 9_223_372_036_854_775_808.0),
        (Attribute::Object, -0.5, 0.0),
        (Attribute::Time, f64::NEG_INFINITY, 0.0),
    ] {
        let mut misfits = Misfits::default();
        assert_eq!(misfits.fitted(attribute, value), expected, "{attribute:?} {value}");
        assert!(misfits.has(attribute), "{attribute:?} {value}");
    }
}
