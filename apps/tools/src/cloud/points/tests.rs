//! Tests of points.

use super::*;

#[test]
fn positions_keep_their_digits_at_utm_coordinates() {
    let mut points = Points::default();
    for x in [478_000.123, 478_001.456] {
        points.push(&PointRow { position: DVec3::new(x, 5_474_500.5, 110.25), ..PointRow::default() }, None);
    }
    points.push(&PointRow { position: DVec3::NAN, ..PointRow::default() }, None);
    assert_eq!((points.len(), points.skipped()), (2, 1));
    let doubts = points.doubts(Path::new("a.xyz")).text();
    assert!(doubts.contains("1 point without coordinates") && doubts.contains("a.xyz"), "{doubts}");
    assert_eq!(points.position(1), DVec3::new(478_001.456, 5_474_500.5, 110.25));
    assert!((f64::from(points.offset(1)[0]) + points.origin().x - 478_001.456).abs() < 1e-6);
    assert_eq!(points.bounds().max.x, 478_001.456);
}

#[test]
fn a_bounded_number_of_points_is_kept_evenly() {
    let all = AttributeSet::of(|attribute| attribute != Attribute::Time);
    let mut points = Points { max_points: 8, ..Points::new(all) };
    for i in 0..100 {
        let position = DVec3::X * f64::from(i);
        let class = i as u8;
        points.push(&PointRow { position, intensity: i as f32, class, ..PointRow::default() }, Some("a"));
    }
    assert_eq!((points.total(), points.len()), (100, 7));
    assert_eq!(points.class.to_vec(), [0, 16, 32, 48, 64, 80, 96]);
    assert_eq!((points.intensity.at(6), points.position(6).x, points.object.len()), (96.0, 96.0, 7));
    assert_eq!(points.bounds().max.x, 99.0);
}

#[test]
fn numbers_beyond_those_that_are_kept_are_told() {
    let mut points = Points::new(AttributeSet::of(|_| true));
    for (leg, channel) in [(0, 3), (255, 256), (300, 0), (70, 1)] {
        points.push(&PointRow { leg, channel, ..PointRow::default() }, None);
    }
    assert_eq!((points.leg.to_vec(), points.channel.to_vec()), (vec![0, 255, 300, 70], vec![3, 255, 0, 1]));
    assert_eq!(points.beyond_bytes(), (1, 1));
}

#[test]
fn objects_are_numbered_in_order_of_appearance() {
    let mut points = Points::new(AttributeSet::of(|attribute| attribute == Attribute::Object));
    for object in ["7", "7", "tree", "7", "tree"] {
        points.push(&PointRow::default(), Some(object));
    }
    assert_eq!(points.object.to_vec(), [0, 0, 1, 0, 1]);
    assert_eq!(points.objects, ["7", "tree"]);
}

#[test]
fn more_objects_than_numbers_share_the_last_one() {
    let mut points = Points::new(AttributeSet::of(|attribute| attribute == Attribute::Object));
    for i in 0..70_000 {
        points.push(&PointRow { object: i, ..PointRow::default() }, None);
    }
    assert_eq!(points.len(), 70_000);
    assert_eq!(points.objects.len(), 65_535);
}

#[test]
fn points_of_blocks_are_those_added_one_by_one() {
    let row = |i: u32| PointRow {
        position: if i % 90 == 7 { DVec3::NAN } else { DVec3::new(f64::from(i), f64::from(i % 13), 0.1) },
        intensity: i as f32 * 0.5,
        class: (i % 7) as u8,
        return_number: 1 + (i % 2) as u8,
        number_of_returns: 2,
        scan_angle: f64::from(i % 40) - 20.0,
        object: i64::from(i / 50),
        leg: (i % 300) as u16,
        channel: (i % 3) as u16,
        time: 1e5 + f64::from(i / 2) * 1e-5,
        colour: (i > 100).then_some([i as u16; 3]),
        is_miss: i % 60 == 3,
        ..PointRow::default()
    };
    let rows: Vec<PointRow> = (0..500).map(row).collect();
    let all = AttributeSet::of(|_| true);
    let without_objects = AttributeSet::of(|attribute| attribute != Attribute::Object);
    for (attributes, max_points, max_bytes) in [
        (all, 128, None),
        (without_objects, 128, None),
        (without_objects, 1000, None),
        (without_objects, 1000, Some(1)),
    ] {
        let empty = || Points { max_points, ..Points::within(attributes, max_bytes) };
        blocks_are_as_single_points(&rows, &empty);
    }
}

fn blocks_are_as_single_points(rows: &[PointRow], empty: &dyn Fn() -> Points) {
    let mut single = empty();
    rows.iter().for_each(|row| single.push(row, None));
    for length in [1, 7, 500] {
        let (mut together, mut part) = (empty(), PointsPart::default());
        for block in rows.chunks(length) {
            part.clear();
            block.iter().for_each(|row| part.add(row));
            together.append(&part);
        }
        let facts = |points: &Points| {
            let counts = (points.len(), points.total(), points.skipped(), points.misses());
            (counts, points.bounds(), points.beyond_bytes(), points.objects.clone(), points.object.to_vec())
        };
        assert_eq!(facts(&together), facts(&single), "{length}");
        let values = |points: &Points, i: usize| {
            let numbers = (points.class_of(i), points.return_number_of(i), points.source_of(i));
            let measured = (points.intensity_of(i), points.scan_angle_of(i), points.time_of(i));
            (points.position(i), numbers, measured, points.colour_of(i))
        };
        assert!((0..single.len()).all(|i| values(&together, i) == values(&single, i)), "{length}");
    }
}
