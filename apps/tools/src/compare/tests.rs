//! Tests of whole comparisons with closed forms.

use super::*;
use crate::cloud::Points;
use vlscan_base::Observer;
use vlscan_base::error::Error;
use vlscan_base::machine::with_pool;
use vlscan_base::rng::{Purpose, Stream};
use vlscan_formats::{AttributeSet, PointRow};
use vlscan_geom::DVec3;

const ORIGIN: DVec3 = DVec3::new(431_000.0, 5_412_000.0, 100.0);

fn cloud(points: impl IntoIterator<Item = [f64; 3]>) -> Points {
    let mut cloud = Points::new(AttributeSet::of(|_| true));
    for (i, p) in points.into_iter().enumerate() {
        let row = PointRow {
            position: DVec3::from(p) + ORIGIN,
            intensity: (i % 10) as f32 + 1.0,
            return_number: 1 + (i % 2) as u8,
            number_of_returns: 2,
            ..PointRow::default()
        };
        cloud.push(&row, None);
    }
    cloud
}

fn square(step: f64, z: f64) -> Vec<[f64; 3]> {
    let n = (20.0 / step).round() as usize;
    (0..n * n).map(|i| [(i % n) as f64 * step, (i / n) as f64 * step, z]).collect()
}

fn options() -> CompareOptions {
    CompareOptions { max_distances: 1000, ..CompareOptions::default() }
}

fn compared(a: &Points, b: &Points, options: &CompareOptions) -> Comparison {
    compare([("a", a), ("b", b)], options, &Observer::default()).unwrap()
}

fn figure<'c>(c: &'c Comparison, quantity: &str, figure: &str) -> &'c Figure {
    let found = c.quantity(quantity).unwrap_or_else(|| panic!("{quantity}: {:?}", c.missing));
    found.figures.iter().find(|f| f.name == figure).unwrap_or_else(|| panic!("{figure}: {found:?}"))
}

#[test]
fn a_cloud_is_like_itself() {
    let a = cloud(square(0.25, 0.0).into_iter().chain(square(2.0, 8.0)));
    let c = compared(&a, &a, &options());
    assert_eq!((c.agreement.voxels.agreement, c.agreement.canopy.rms_difference_m), (1.0, 0.0));
    assert_eq!((c.agreement.first_to_second.mean_m, c.agreement.second_to_first.max_m), (0.0, 0.0));
    assert!((c.first.density_per_m2 - 16.25).abs() < 1e-9, "{}", c.first.density_per_m2);
    assert!((c.agreement.density_correlation - 1.0).abs() < 1e-9);
    for quantity in &c.quantities {
        assert_eq!(quantity.distribution.largest, 0.0, "{quantity:?}");
        assert!((quantity.histogram.overlap - 1.0).abs() < 1e-9, "{quantity:?}");
        assert!(quantity.figures.iter().all(|figure| figure.difference == 0.0), "{quantity:?}");
    }
    assert!(
        c.missing.iter().any(|missing| missing.contains("all its GPS times are equal")),
        "{:?}",
        c.missing
    );
}

/// Asserts that a cloud has no difference from itself in any row, and returns the comparison.
fn assert_like_itself(cloud: &Points, what: &str) -> Comparison {
    let c = compared(cloud, cloud, &options());
    for quantity in &c.quantities {
        assert_eq!(quantity.distribution.largest, 0.0, "{what}: {quantity:?}");
        assert_eq!(quantity.counts[0], quantity.counts[1], "{what}: {}", quantity.name);
        assert_eq!(
            quantity.histogram.fractions[0], quantity.histogram.fractions[1],
            "{what}: {}",
            quantity.name
        );
        assert!(quantity.figures.iter().all(|figure| figure.difference == 0.0), "{what}: {quantity:?}");
    }
    let Change { fill, cut, net_m3, rms_m, .. } = &c.change;
    assert_eq!((fill.volume_m3, cut.volume_m3, *net_m3, *rms_m), (0.0, 0.0, 0.0, 0.0), "{what}");
    assert_eq!((fill.undetected_m3, cut.undetected_m3), (0.0, 0.0), "{what}");
    let text = table(&c);
    let is_negative_zero = |word: &&str| word.starts_with('-') && word.parse() == Ok(0.0);
    assert_eq!(text.split_whitespace().find(is_negative_zero), None, "{what}: {text}");
    c
}

#[test]
fn a_cloud_is_like_itself_whatever_its_times_are() {
    let strip = strip(1, 0.0, 5);
    let rows = |strip: &Points| -> Vec<PointRow> {
        (0..strip.len())
            .map(|i| PointRow {
                position: strip.position(i),
                time: strip.time_of(i).unwrap(),
                scan_angle: f64::from(strip.scan_angle_of(i).unwrap()),
                class: strip.class_of(i).unwrap(),
                intensity: strip.intensity_of(i).unwrap(),
                return_number: strip.return_number_of(i).unwrap(),
                number_of_returns: strip.number_of_returns_of(i).unwrap(),
                ..PointRow::default()
            })
            .collect()
    };
    let cloud = |rows: Vec<PointRow>| {
        let mut cloud = Points::new(AttributeSet::of(|_| true));
        rows.iter().for_each(|row| cloud.push(row, None));
        cloud
    };
    let all = rows(&strip);
    let of = |change: &dyn Fn(usize, PointRow) -> PointRow| {
        all.iter().enumerate().map(|(i, row)| change(i, *row)).collect::<Vec<PointRow>>()
    };
    let told = assert_like_itself(&strip, "as it is");
    assert!(told.quantity("scan angle at the same time").is_some(), "{:?}", told.missing);
    let mut reversed = all.clone();
    reversed.reverse();
    let shuffled = (0..all.len()).map(|i| all[i * 7919 % all.len()]).collect();
    // Two flight lines and two channels that have pulses at the same times with other angles.
    let lines = of(&|_, row| PointRow { leg: 1, scan_angle: -row.scan_angle + 3.0, ..row });
    let channels = of(&|_, row| PointRow { channel: 1, scan_angle: row.scan_angle + 5.0, ..row });
    let step = |step: f64| of(&|_, row| PointRow { time: (row.time / step).round() * step, ..row });
    for (what, rows) in [
        ("reversed", reversed),
        ("shuffled", shuffled),
        ("two lines at one time", [all.clone(), lines].concat()),
        ("two channels at one time", [channels, all.clone()].concat()),
        ("every point twice", [all.clone(), all.clone()].concat()),
        ("times of a few pulses", step(2e-6)),
        ("a time per line", step(6e-3)),
        ("one time", step(1e6)),
        ("times of a week later", of(&|_, row| PointRow { time: row.time + 604_800.0, ..row })),
        ("angles of whole degrees", of(&|_, row| PointRow { scan_angle: row.scan_angle.round(), ..row })),
        ("a line of a few pulses", all[..40].to_vec()),
    ] {
        assert_like_itself(&cloud(rows), what);
    }
}

#[test]
fn a_raised_canopy_and_a_thinned_cloud_are_seen() {
    let a = cloud(square(0.25, 0.0).into_iter().chain(square(0.5, 8.0)));
    let b = cloud(square(0.5, 0.0).into_iter().chain(square(0.5, 8.5)));
    let c = compared(&a, &b, &options());
    assert!((c.agreement.canopy.mean_difference_m - 0.5).abs() < 1e-6);
    // 16 + 4 to 4 + 4 points per m², but for the margin of the common box.
    let ratio = c.second.density_per_m2 / c.first.density_per_m2;
    assert!((ratio - 3200.0 / 7841.0).abs() < 1e-9, "{ratio}");
    // A raised point is half a metre from the next one.
    assert!((c.agreement.second_to_first.max_m - 0.5).abs() < 1e-6, "{c:?}");
    // Four fifths and half of the points are on the ground.
    assert!((c.quantity("height").unwrap().distribution.largest - 0.5).abs() < 0.01);
}

/// A strip of 120 scan lines 0.5 m apart with 200 pulses each, 0.25 m along and 1 µs apart, over rolling
/// ground with noise of 2 cm (a centimetre of it common to a line), of which every `nth` pulse has a second
/// return 5 m above. The seed is that of the noise, of the phase of each line, and of which pulses meet two
/// things.
fn strip(seed: u64, bias: f64, nth: u64) -> Points {
    let mut points = Points::new(AttributeSet::of(|_| true));
    let stream = Stream::new(seed, Purpose::SceneMaking);
    let phase = stream.uniform(8, 0, 0);
    for (line, pulse) in (0..120u32).flat_map(|line| (0..200u32).map(move |pulse| (line, pulse))) {
        let number = u64::from(200 * line + pulse);
        let along =
            f64::from(pulse) + 4.0 * stream.uniform(9, line.into(), 0) + 0.2 * stream.uniform(10, number, 0);
        let (x, y) = (0.25 * along, 0.5 * (f64::from(line) + phase));
        let ground = 2.0 * libm::sin(x / 15.0) + libm::cos(y / 20.0);
        let noise = 0.01 * stream.normal(1, u64::from(line), 0) + 0.017 * stream.normal(2, number, 0);
        let number_of_returns = if stream.uniform(3, number, 0) * (nth as f64) < 1.0 { 2 } else { 1 };
        for return_number in 1..=number_of_returns {
            let is_last = return_number == number_of_returns;
            let z = ground + if is_last { noise + bias } else { 5.0 + noise };
            let row = PointRow {
                position: DVec3::new(x, y, z) + ORIGIN,
                class: if is_last { 2 } else { 5 },
                intensity: 100.0 + 10.0 * stream.normal(4, number, 0) as f32,
                return_number,
                number_of_returns,
                // Steps of LAS 1.4.
                scan_angle: 0.006 * ((0.1 * along - 10.0) / 0.006).round(),
                time: 1e5 + f64::from(line) * 6e-3 + along * 1e-6,
                ..PointRow::default()
            };
            points.push(&row, None);
        }
    }
    points
}

#[test]
fn results_do_not_depend_on_memory_and_threads() {
    let copied = |points: &Points, max_bytes: u64| {
        let mut copy = Points::within(AttributeSet::of(|_| true), Some(max_bytes));
        for i in 0..points.len() {
            let row = PointRow {
                position: points.position(i),
                class: points.class_of(i).unwrap(),
                intensity: points.intensity_of(i).unwrap(),
                return_number: points.return_number_of(i).unwrap(),
                number_of_returns: points.number_of_returns_of(i).unwrap(),
                scan_angle: f64::from(points.scan_angle_of(i).unwrap()),
                time: points.time_of(i).unwrap(),
                ..PointRow::default()
            };
            copy.push(&row, None);
        }
        copy
    };
    let clouds = [strip(1, 0.0, 5), strip(2, 0.01, 4)];
    for (chance, cases) in [(false, &[(u64::MAX, 1), (1, 2), (1 << 20, 5)][..]), (true, &[(1, 2)][..])] {
        let options = CompareOptions { chance, ..options() };
        let expected = json(&compared(&clouds[0], &clouds[1], &options)).unwrap();
        for (max_bytes, threads) in cases {
            let [a, b] = [&clouds[0], &clouds[1]].map(|points| copied(points, *max_bytes));
            let c = with_pool(*threads, || compared(&a, &b, &options)).unwrap();
            assert!(json(&c).unwrap() == expected, "{max_bytes} bytes, {threads} threads, chance {chance}");
        }
    }
}

#[test]
fn two_measurements_of_one_place_are_within_chance() {
    let with_chance = CompareOptions { chance: true, max_distances: 200_000, ..options() };
    let c = compared(&strip(1, 0.0, 5), &strip(2, 0.0, 5), &with_chance);
    assert_eq!(c.chance.as_ref().unwrap().kind, BlockKind::ScanLines);
    assert_eq!(c.first.pulses_and_lines.map(|counts| counts[1]), Some(119));
    let beyond: Vec<String> = c
        .quantities
        .iter()
        .flat_map(|q| q.figures.iter().map(move |f| (q, f)))
        .filter(|(_, f)| f.is_within_chance != Some(true))
        .map(|(q, f)| format!("{}: {f:?}", q.name))
        .collect();
    assert!(beyond.is_empty(), "{beyond:#?}");
    assert!(c.quantities.len() > 15, "{:?}", c.missing);
}

#[test]
fn a_comparison_does_not_depend_on_the_number_of_threads() {
    let clouds = [strip(1, 0.0, 5), strip(2, 0.01, 4)];
    for chance in [false, true] {
        let options = CompareOptions { chance, ..options() };
        let on = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| json(&compared(&clouds[0], &clouds[1], &options)).unwrap())
        };
        let expected = on(1);
        for threads in [2, 5] {
            assert_eq!(on(threads), expected, "{threads} threads");
        }
    }
}

#[test]
fn a_centimetre_of_bias_and_a_third_more_returns_are_beyond_chance() {
    let with_chance = CompareOptions { chance: true, max_distances: 200_000, ..options() };
    let c = compared(&strip(1, 0.0, 5), &strip(2, 0.01, 2), &with_chance);
    let mean = figure(&c, "residual to the terrain", "mean");
    assert!((mean.difference - 10.0).abs() < 2.0 && mean.is_within_chance == Some(false), "{mean:?}");
    // The noise is that of points, of their line and of the planes of 12 neighbours.
    let spread = figure(&c, "residual to the terrain", "robust spread");
    assert!((spread.first - 22.5).abs() < 1.5 && spread.is_within_chance == Some(true), "{spread:?}");
    let returns = figure(&c, "returns per pulse", "mean");
    assert!(
        (returns.difference - 0.3).abs() < 0.02 && returns.is_within_chance == Some(false),
        "{returns:?}"
    );
    assert_eq!(figure(&c, "returns per pulse", "share of 2").is_within_chance, Some(false));
    let angle = figure(&c, "residual, scan angle -10° to -5°", "mean");
    assert!((angle.difference - 10.0).abs() < 3.0 && angle.is_within_chance == Some(false), "{angle:?}");
    // What did not change is within chance.
    for (quantity, name) in
        [("time between pulses", "mean"), ("spacing along scan lines", "mean"), ("scan angle", "mean")]
    {
        assert_eq!(figure(&c, quantity, name).is_within_chance, Some(true), "{quantity}");
    }
    assert!((figure(&c, "time between scan lines", "rate").first - 1.0 / 6e-3).abs() < 1e-3);
    assert!((figure(&c, "time between pulses", "rate").first - 1e6).abs() < 1e4);
    assert!((figure(&c, "spacing across scan lines", "median").first - 0.5).abs() < 1e-6);
}

/// Ground of 60 by 60 m with noise of 2 cm and, if `is_changed`, a cone 3 m high and a conical pit 3 m deep,
/// of a radius of 10 m.
fn epoch(seed: u64, is_changed: bool) -> Points {
    let stream = Stream::new(seed, Purpose::SceneMaking);
    let mut points = Points::new(AttributeSet::of(|_| true));
    for i in 0..40_000u64 {
        let [x, y] = [0, 1].map(|axis| 60.0 * stream.uniform(1, i, axis));
        let cone = |cx: f64, cy: f64| (3.0 - 0.3 * libm::hypot(x - cx, y - cy)).max(0.0);
        let change = if is_changed { cone(15.0, 15.0) - cone(42.0, 40.0) } else { 0.0 };
        let z = 0.1 * x + change + 0.02 * stream.normal(2, i, 0);
        let row = PointRow { position: DVec3::new(x, y, z) + ORIGIN, class: 2, ..PointRow::default() };
        points.push(&row, None);
    }
    points
}

#[test]
fn a_cone_and_a_pit_have_their_volumes() {
    let change = compared(&epoch(1, false), &epoch(2, true), &options()).change;
    // π r² h / 3; what is lower than the level of detection at the rim is missing, some 0.02 m on 2 % of the
    // radius.
    let cone = std::f64::consts::PI * 100.0;
    for volume in [change.fill, change.cut] {
        let missing = cone - volume.volume_m3;
        assert!(missing.abs() < 3.0 * volume.uncertainty_m3 + 0.5, "{volume:?}");
        // What is below the level of detection at the rim and in noise dominates.
        assert!((0.05..8.0).contains(&volume.uncertainty_m3), "{volume:?}");
        assert!((volume.area_m2 - cone).abs() < 40.0, "{volume:?}");
    }
    assert!(change.offset_m.abs() < 0.002 && change.net_m3.abs() < 3.0, "{change:?}");
    // Two planes through some 11 points of 2 cm: 1.96 · 0.02 · √(2/11).
    assert!((change.detection_m - 0.0167).abs() < 0.005, "{}", change.detection_m);
    let none = compared(&epoch(1, false), &epoch(2, false), &options()).change;
    // Of 3600 cells one in twenty is beyond by chance.
    assert!(none.fill.volume_m3 + none.cut.volume_m3 < 10.0, "{none:?}");
}

/// Ground at some places with noise of 2 cm and, if `is_changed`, a pit of 20 by 20 m, 2 m deep: 800 m³.
fn pit(seed: u64, places: &[[f64; 2]], is_changed: bool) -> Points {
    let stream = Stream::new(seed, Purpose::SceneMaking);
    let mut points = Points::new(AttributeSet::of(|_| true));
    for (i, [x, y]) in (0..).zip(places) {
        let is_in_pit = is_changed && [x, y].into_iter().all(|c| (20.0..40.0).contains(c));
        let z = if is_in_pit { -2.0 } else { 0.0 } + 0.02 * stream.normal(2, i, 0);
        let row = PointRow { position: DVec3::new(*x, *y, z) + ORIGIN, class: 2, ..PointRow::default() };
        points.push(&row, None);
    }
    points
}

/// Scan lines 60 m long, with points every 0.15 m.
fn places_on_lines(spacing: f64) -> Vec<[f64; 2]> {
    let line = |line: u32| {
        let x = 0.05 + spacing * f64::from(line);
        (0..400u32).map(move |point| [x, 0.15 * f64::from(point)])
    };
    (0..(60.0 / spacing) as u32).flat_map(line).collect()
}

#[test]
fn a_pit_in_sparse_points_is_within_its_uncertainty() {
    // 4 points/m², of which one cell in five has a surface in both clouds.
    for seed in 0..3 {
        let places = |seed: u64| -> Vec<[f64; 2]> {
            let stream = Stream::new(seed, Purpose::SceneMaking);
            (0..14_400u64).map(|i| [0, 1].map(|axis| 60.0 * stream.uniform(1, i, axis))).collect()
        };
        let first = pit(2 * seed, &places(2 * seed), false);
        let c = compared(&first, &pit(2 * seed + 1, &places(2 * seed + 1), true), &options());
        let Change { cut, net_m3, net_uncertainty_m3, .. } = &c.change;
        assert!((cut.volume_m3 - 800.0).abs() < 2.0 * cut.uncertainty_m3, "{cut:?}");
        assert!(cut.uncertainty_m3 < 320.0, "{cut:?}");
        assert!((net_m3 + 800.0).abs() < 2.0 * net_uncertainty_m3, "{net_m3} ± {net_uncertainty_m3}");
        assert!(c.missing.iter().any(|missing| missing.contains("--cell 2")), "{:?}", c.missing);
    }
    // Lines on one side of the centres only, in pairs of columns and in nearly all: the first are filled.
    for (spacing, is_filled) in [(0.7, true), (0.9, false)] {
        let places = places_on_lines(spacing);
        let of = |is_changed: bool, cell: f64| {
            let options = CompareOptions { cell, ..options() };
            compared(&pit(1, &places, false), &pit(2, &places, is_changed), &options)
        };
        let c = of(true, 1.0);
        let cut = c.change.cut;
        assert!((cut.volume_m3 - 800.0).abs() < 2.0 * cut.uncertainty_m3, "{spacing}: {cut:?}");
        assert_eq!((cut.volume_m3 - 800.0).abs() < 120.0, is_filled, "{spacing}: {cut:?}");
        assert_eq!(cut.unmeasured_m3 < 50.0, is_filled, "{spacing}: {cut:?}");
        assert!(c.missing.iter().any(|missing| missing.contains("--cell 2")), "{:?}", c.missing);
        let wide = of(true, 2.0).change.cut;
        assert!((wide.volume_m3 - 800.0).abs() < 3.0 * wide.uncertainty_m3 + 1.0, "{spacing}: {wide:?}");
        assert!(wide.uncertainty_m3 < cut.uncertainty_m3, "{spacing}: {wide:?} {cut:?}");
        let unchanged = of(false, 1.0).change.cut;
        assert!(unchanged.volume_m3 < 2.0 * unchanged.uncertainty_m3, "{spacing}: {unchanged:?}");
        assert!(unchanged.uncertainty_m3 < 20.0, "{spacing}: {unchanged:?}");
    }
}

/// Ground of 60 by 60 m in strips of 20 m, of which each has a tilt and an offset of its own, with noise of 2
/// cm.
fn epoch_with_strips(seed: u64, is_changed: bool) -> Points {
    let stream = Stream::new(seed, Purpose::SceneMaking);
    let flown = epoch(seed, is_changed);
    let mut points = Points::new(AttributeSet::of(|_| true));
    for i in 0..flown.len() {
        let p = flown.position(i) - ORIGIN;
        let strip = (p.x / 20.0).floor();
        let [offset, tilt] = [0, 1].map(|draw| stream.normal(7 + draw, strip as u64, 0));
        let error =
            0.05 * stream.normal(9, 0, 0) + 0.02 * offset + 0.002 * tilt * (p.x - 20.0 * strip - 10.0);
        points.push(
            &PointRow { position: p + DVec3::Z * error + ORIGIN, class: 2, ..PointRow::default() },
            None,
        );
    }
    points
}

#[test]
fn errors_of_strips_are_within_the_uncertainties_of_the_volumes() {
    let cone = std::f64::consts::PI * 100.0;
    let mut beyond = 0;
    for seed in 0..5 {
        let pairs = [(false, 0.0), (true, cone)];
        for (is_changed, volume) in pairs {
            let first = epoch_with_strips(2 * seed + 10, false);
            let change = compared(&first, &epoch_with_strips(2 * seed + 11, is_changed), &options()).change;
            for part in [change.fill, change.cut] {
                let off = (part.volume_m3 - volume).abs() / part.uncertainty_m3;
                assert!(off < 3.0, "{seed}: {part:?} for {volume}");
                beyond += usize::from(off > 2.0);
            }
            assert!(change.net_m3.abs() < 2.0 * change.net_uncertainty_m3, "{seed}: {change:?}");
            // Not that anything would do: errors of some centimetres on the area of the cone, and below the
            // level on all.
            assert!(change.fill.uncertainty_m3 < 150.0, "{seed}: {:?}", change.fill);
        }
    }
    assert!(beyond <= 1, "{beyond} of 20 beyond two standard uncertainties");
}

#[test]
fn a_change_near_the_level_of_detection_is_within_its_uncertainty() {
    // A patch of 20 by 20 m: 8 and 12 m³; of most cells the change is within the level of detection.
    for (rise, seed) in [(0.01, 3), (0.02, 4), (0.03, 5)] {
        let raised = epoch(seed, false);
        let mut patch = Points::new(AttributeSet::of(|_| true));
        for i in 0..raised.len() {
            let p = raised.position(i) - ORIGIN;
            let rise = if p.x.max(p.y) < 30.0 && p.x.min(p.y) > 10.0 { rise } else { 0.0 };
            patch.push(
                &PointRow { position: p + DVec3::Z * rise + ORIGIN, class: 2, ..PointRow::default() },
                None,
            );
        }
        let change = compared(&epoch(1, false), &patch, &options()).change;
        let volume = 400.0 * rise;
        let off = (change.fill.volume_m3 - volume).abs();
        assert!(off < 2.0 * change.fill.uncertainty_m3, "{:?} for {volume}", change.fill);
        assert!(change.fill.undetected_m3 > 0.3 * off, "{:?}", change.fill);
        assert!(change.cut.volume_m3 < 2.0 * change.cut.uncertainty_m3, "{:?}", change.cut);
    }
}

#[test]
fn cells_whose_planes_would_be_extrapolated_are_left_out_and_counted() {
    // On a slope of 1 in 2 the points of the second cloud are in the western fifth of each cell.
    let slope = |x: f64, y: f64| [x, y, 0.5 * x];
    let grid = |width: f64| {
        let place = move |i: u32| (f64::from(i % 100) * 0.2, f64::from(i / 100) * 0.2);
        cloud((0..10_000).map(place).filter(move |(x, _)| x.fract() < width).map(|(x, y)| slope(x + 0.05, y)))
    };
    let c = compared(&grid(1.0), &grid(0.3), &options());
    let change = &c.change;
    assert!(change.cells_extrapolated[0] < 45 && change.cells_extrapolated[1] > 350, "{change:?}");
    assert!((change.fill.volume_m3, change.cut.volume_m3) == (0.0, 0.0), "{change:?}");
    assert!(c.missing.iter().any(|missing| missing.contains("--cell 2")), "{:?}", c.missing);
    assert!(table(&c).contains("cells left out as extrapolated"), "{}", table(&c));
    // The first cloud has narrow strips in the south, the second in the north: no cell is left out twice.
    let half = |is_narrow: fn(f64) -> bool| {
        let place = |i: u32| (f64::from(i % 100) * 0.2 + 0.05, f64::from(i / 100) * 0.2);
        let is_kept = move |(x, y): &(f64, f64)| !is_narrow(*y) || x.fract() < 0.3;
        cloud((0..10_000).map(place).filter(is_kept).map(|(x, y)| slope(x, y)))
    };
    let change = compared(&half(|y| y < 10.0), &half(|y| y >= 10.0), &options()).change;
    assert!(change.cells_extrapolated.iter().all(|count| *count < 250), "{change:?}");
    assert!(change.cells_left_out > 350, "{change:?}");
}

#[test]
fn a_stated_registration_takes_the_place_of_the_offset() {
    // Snow of 30 cm everywhere: by default it counts as an error of registration.
    let snow = epoch(2, false);
    let mut deep = Points::new(AttributeSet::of(|_| true));
    for i in 0..snow.len() {
        deep.push(
            &PointRow { position: snow.position(i) + DVec3::Z * 0.3, class: 2, ..PointRow::default() },
            None,
        );
    }
    let by_default = compared(&epoch(1, false), &deep, &options()).change;
    assert!(by_default.fill.volume_m3 == 0.0 && (by_default.offset_m - 0.3).abs() < 0.002, "{by_default:?}");
    assert!((by_default.net_m3 - 1080.0).abs() < by_default.net_uncertainty_m3, "{by_default:?}");
    let stated = CompareOptions { registration: Some(0.02), ..options() };
    let change = compared(&epoch(1, false), &deep, &stated).change;
    assert!((change.fill.volume_m3 - 1080.0).abs() < 20.0, "{change:?}");
    assert!((70.0..110.0).contains(&change.fill.uncertainty_m3), "{change:?}");
}

#[test]
fn a_uniform_change_below_the_level_is_undetected_if_the_registration_is_stated() {
    let snow = epoch(2, false);
    let mut shallow = Points::new(AttributeSet::of(|_| true));
    for i in 0..snow.len() {
        let position = snow.position(i) + DVec3::Z * 0.03;
        shallow.push(&PointRow { position, class: 2, ..PointRow::default() }, None);
    }
    let stated = CompareOptions { registration: Some(0.02), ..options() };
    let fill = compared(&epoch(1, false), &shallow, &stated).change.fill;
    assert!((fill.volume_m3 + fill.undetected_m3 - 108.0).abs() < 5.0, "{fill:?}");
    assert!(fill.undetected_m3 > 50.0 && fill.uncertainty_m3 > fill.undetected_m3, "{fill:?}");
    // By default the measured offset counts as an error of registration.
    let by_default = compared(&epoch(1, false), &shallow, &options()).change.fill;
    assert!(by_default.undetected_m3 < 10.0, "{by_default:?}");
}

#[test]
fn a_common_offset_widens_the_uncertainty() {
    let mut lifted = Points::new(AttributeSet::of(|_| true));
    let changed = epoch(2, true);
    for i in 0..changed.len() {
        let position = changed.position(i) + DVec3::Z * 0.008;
        lifted.push(&PointRow { position, class: 2, ..PointRow::default() }, None);
    }
    let change = compared(&epoch(1, false), &lifted, &options()).change;
    assert!((change.offset_m - 0.006).abs() < 0.003, "{}", change.offset_m);
    assert!(change.fill.uncertainty_m3 > 1.0, "{:?}", change.fill);
}

#[test]
fn a_dam_and_a_pit_without_classes_have_their_volumes() {
    let ground = || square(0.5, 0.0);
    let a = cloud(ground());
    // A dam of 4 by 20 m, 1.5 m high, and a pit of 6 by 5 m, 3 m deep.
    let b = cloud(ground().into_iter().map(|[x, y, z]| match (x, y) {
        (x, _) if x < 4.0 => [x, y, z + 1.5],
        (x, y) if (10.0..16.0).contains(&x) && (10.0..15.0).contains(&y) => [x, y, z - 3.0],
        _ => [x, y, z],
    }));
    let change = compared(&a, &b, &options()).change;
    assert!(
        (change.fill.volume_m3 - 120.0).abs() < 1e-6 && (change.cut.volume_m3 - 90.0).abs() < 1e-6,
        "{change:?}"
    );
    let nothing = compared(&a, &a, &options()).change;
    assert_eq!((nothing.fill.volume_m3, nothing.cut.volume_m3, nothing.rms_m), (0.0, 0.0, 0.0));
}

#[test]
fn clouds_apart_are_refused_with_their_distance() {
    let refused = |a: &Points, b: &Points| {
        let Err(Error::Input(report)) = compare([("a", a), ("b", b)], &options(), &Observer::default())
        else {
            panic!("accepted")
        };
        report.headline()
    };
    let (a, b) = (cloud([[0.0; 3], [10.0, 10.0, 0.0]]), cloud([[500.0, 0.0, 0.0], [510.0, 10.0, 0.0]]));
    assert!(refused(&a, &b).contains("490.0 m"));
    let wide = cloud([[0.0; 3], [1e6, 1e6, 0.0]]);
    assert!(refused(&wide, &wide).contains("--cell"));
    let places = square(0.5, 0.0).into_iter();
    let apart = cloud(places.clone().chain(places.take(100).map(|[x, y, z]| [x + 2e4, y + 2e4, z])));
    let said = refused(&apart, &apart);
    assert!(said.contains("100 of 1700 lie 20 km from the others, around x 451010 and y 54320"), "{said}");
}
