//! Tests of colours.

use super::*;
use vlscan_formats::{AttributeSet, PointRow};
use vlscan_geom::DVec3;

fn luminance(c: Rgb) -> f64 {
    0.2126 * f64::from(c[0]) + 0.7152 * f64::from(c[1]) + 0.0722 * f64::from(c[2])
}

#[test]
fn ramps_get_lighter_all_the_way() {
    for table in [&HEIGHTS[..], &STRENGTHS] {
        let steps: Vec<f64> = (0..=100).map(|i| luminance(mixed(table, i as f32 / 100.0))).collect();
        assert!(steps.windows(2).all(|w| w[1] > w[0] - 0.5), "{steps:?}");
        assert!(steps[100] - steps[0] > 130.0);
    }
    assert_eq!(mixed(&HEIGHTS, f32::NAN), HEIGHTS[0]);
    assert_eq!(mixed(&HEIGHTS, 7.0), HEIGHTS[7]);
}

#[test]
fn colours_that_points_lack_are_a_warning() {
    let mut points = Points::new(AttributeSet::of(|attribute| attribute == Attribute::Class));
    let said = |points: &Points, colour: ColourBy| colour.doubts(points, Path::new("a.las")).text();
    assert_eq!(said(&points, ColourBy::Rgb), "");
    points.push(&PointRow::default(), None);
    assert_eq!(said(&points, ColourBy::Height) + &said(&points, ColourBy::Class), "");
    let expected = "no point has a colour; `--colour rgb` shows the heights instead; `vlscan run` writes";
    assert!(said(&points, ColourBy::Rgb).contains(expected), "{}", said(&points, ColourBy::Rgb));
    assert!(said(&points, ColourBy::Time).contains("no point has a time; `--colour time`"));
    points.push(&PointRow { colour: Some([9, 0, 0]), ..PointRow::default() }, None);
    assert_eq!(said(&points, ColourBy::Rgb), "");
}

#[test]
fn colours_of_points_have_the_upper_eight_bits() {
    let drawn = |all: &[Option<[u16; 3]>]| {
        let mut points = Points::new(AttributeSet::default());
        for colour in all {
            points.push(&PointRow { colour: *colour, ..PointRow::default() }, None);
        }
        let colouring = Colouring::new(&points, ColourBy::Rgb, None);
        let is_own = matches!(colouring, Colouring::Own);
        is_own.then(|| (0..points.len()).map(|i| colouring.of(&points, i)).collect::<Vec<_>>())
    };
    assert_eq!(drawn(&[None, None]), None, "heights");
    assert_eq!(drawn(&[None, Some([255, 7, 0])]), Some(vec![[0; 3], [255, 7, 0]]));
    // 256 or 257 times the number of 8 bits.
    assert_eq!(drawn(&[Some([65_280, 37_376, 0])]), Some(vec![[255, 146, 0]]));
    assert_eq!(drawn(&[Some([65_535, 37_522, 0])]), Some(vec![[255, 146, 0]]));
}

#[test]
fn a_missing_attribute_falls_back_to_height() {
    let mut points = Points::new(AttributeSet::of(|attribute| attribute == Attribute::Class));
    for (class, z) in [(2, 0.0), (2, 1.0), (2, 2.0), (5, 9.0)] {
        points.push(&PointRow { position: DVec3::new(0.0, 0.0, z), class, ..PointRow::default() }, None);
    }
    assert!(matches!(
        Colouring::new(&points, ColourBy::Object, None),
        Colouring::Ramp { value: ColourBy::Height, .. }
    ));
    let Legend::List { entries, more, .. } =
        Colouring::new(&points, ColourBy::Class, None).legend(&points, 1)
    else {
        panic!("no list")
    };
    assert_eq!((entries.len(), entries[0].label.as_str(), more), (1, "2 ground 75%", 1));
}

#[test]
fn clouds_side_by_side_have_one_scale_of_heights() {
    let cloud = |top: f64| {
        let mut points = Points::default();
        for i in 0..1000 {
            let position = DVec3::new(0.0, 0.0, 200.0 + top * f64::from(i) / 999.0);
            points.push(&PointRow { position, ..PointRow::default() }, None);
        }
        points
    };
    let (low, high) = (cloud(10.0), cloud(40.0));
    let heights = super::super::common_heights(&[&low, &high]);
    // The highest point of the lower cloud has the colour of its height in the other one.
    let top = Colouring::new(&low, ColourBy::Height, heights).of(&low, 999);
    let same = Colouring::new(&high, ColourBy::Height, heights).of(&high, 250);
    assert!((0..3).all(|c| top[c].abs_diff(same[c]) < 4), "{top:?} {same:?}");
    assert_ne!(Colouring::new(&low, ColourBy::Height, None).of(&low, 999), top);
}

#[test]
fn places_without_a_line_are_grey_and_lines_count_from_1() {
    let mut points = Points::new(AttributeSet::of(|attribute| attribute == Attribute::Leg));
    for leg in [0, 0, 1, 2] {
        points.push(&PointRow { leg, ..PointRow::default() }, None);
    }
    let labels = |points: &Points| {
        let legend = Colouring::new(points, ColourBy::Leg, None).legend(points, 9);
        let Legend::List { entries, .. } = legend else { panic!("no list") };
        entries.into_iter().map(|entry| (entry.label, entry.colour)).collect::<Vec<_>>()
    };
    let recorded = labels(&points);
    assert_eq!((recorded[0].0.as_str(), recorded[0].1), ("leg 0 50%", object_colour(0)));
    points.count_legs_from_one();
    let planned = labels(&points);
    assert_eq!((planned[0].0.as_str(), planned[0].1), ("no line 50%", NO_LINE));
    assert_eq!((planned[1].0.as_str(), planned[1].1), ("line 1 25%", object_colour(0)));
}
