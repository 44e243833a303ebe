//! Tests of plans of flights.

use super::*;
use crate::plan::report::MAX_DENSITY_ERROR;
use crate::plan::testing;
use vlscan_survey::Mount;

fn instrument() -> SwathModel {
    testing::instrument("riegl_lms-q780")
}

fn options() -> AirborneOptions {
    AirborneOptions { height: 500.0, speed: Some(60.0), ..AirborneOptions::default() }
}

const CARRIER: Carrier = Carrier { mount: Mount::IDENTITY, may_turn: true };

const FLAT: PlanGround = PlanGround { heights: &|_, _| Some(100.0), level: 0.0 };

#[test]
fn lines_are_along_the_longer_side_and_cover_the_area() {
    let area = Area::rectangle([0.0, 0.0], [3000.0, 1000.0]).unwrap();
    let plan = plan_airborne(&area, &instrument(), &CARRIER, &options(), &FLAT).unwrap();
    // Swath 577.35 m, spacing 404.15 m: (1000 + 577.35) / 404.15 - 2 = 1.9, so 2 + 1 lines.
    let starts: Vec<_> = plan.waypoints.iter().filter(|w| w.active).collect();
    assert_eq!(starts.len(), 3);
    assert!(plan.waypoints.iter().all(|w| w.position.z == 600.0));
    let y: Vec<f64> = starts.iter().map(|w| w.position.y).collect();
    assert!((y.iter().sum::<f64>() / 3.0 - 500.0).abs() < 1e-9, "{y:?}");
    assert!(y.iter().any(|y| *y - 404.2 <= -577.35 / 2.0 + 1e-6), "{y:?}");
    // To and fro.
    assert!(starts[0].position.x < 0.0 && starts[1].position.x > 3000.0);
}

#[test]
fn density_yields_speed_or_spacing() {
    let area = Area::rectangle([0.0, 0.0], [3000.0, 1000.0]).unwrap();
    let frame = Frame::new(best_heading(&area), [0.0; 2]);
    let chosen = |options: &AirborneOptions| choose(&area, &frame, &instrument(), &CARRIER, options);
    let with_density = AirborneOptions { density: Some(8.0), speed: None, ..options() };
    let choice = chosen(&with_density).unwrap();
    assert!((choice.density - 8.0).abs() < 1e-9);
    assert!((choice.ground_rate() / (choice.speed * choice.spacing) - 8.0).abs() < 0.8);
    assert!((choice.spacing / choice.field.width() - 0.7).abs() < 1e-12);
    let both = AirborneOptions { density: Some(12.0), speed: Some(60.0), ..options() };
    let choice = chosen(&both).unwrap();
    assert!((choice.density / 12.0 - 1.0).abs() < 0.03, "{}", choice.density);
    // Of small areas the number of lines decides: a density that is missed is a warning, with the speed
    // that would meet it.
    let tiny = Area::rectangle([0.0, 0.0], [500.0, 300.0]).unwrap();
    let mut warnings = 0;
    for density in (4..24).map(|i| 0.5 * f64::from(i)) {
        let options = AirborneOptions { density: Some(density), ..both.clone() };
        let Ok(plan) = plan_airborne(&tiny, &instrument(), &CARRIER, &options, &FLAT) else { continue };
        let found = plan.comments.iter().find(|line| line.starts_with("density")).unwrap();
        let found: f64 = found.split_whitespace().nth(1).unwrap().parse().unwrap();
        // The comment is rounded.
        if ((found / density - 1.0).abs() / MAX_DENSITY_ERROR - 1.0).abs() < 0.02 {
            continue;
        }
        let has_warned = plan.warnings.iter().any(|text| text.contains("lines is whole"));
        assert_eq!(has_warned, (found / density - 1.0).abs() > MAX_DENSITY_ERROR, "{density}: {found}");
        warnings += usize::from(has_warned);
    }
    assert!(warnings > 0);
    let sparse = AirborneOptions { density: Some(0.1), ..both };
    assert!(chosen(&sparse).err().unwrap().to_string().contains("already"));
    assert!(
        plan_airborne(&area, &instrument(), &CARRIER, &AirborneOptions { speed: None, ..options() }, &FLAT)
            .is_err()
    );
}

#[test]
fn lines_follow_the_ground_no_more_steeply_than_allowed() {
    let area = Area::rectangle([0.0, 0.0], [4000.0, 200.0]).unwrap();
    // A step of 200 m.
    let hill = PlanGround { heights: &|x, _| Some(if x > 2000.0 { 200.0 } else { 0.0 }), level: 0.0 };
    let follow = AirborneOptions { follow_terrain: true, ..options() };
    let plan = plan_airborne(&area, &instrument(), &CARRIER, &follow, &hill).unwrap();
    let line: Vec<DVec3> = plan.waypoints.iter().map(|w| w.position).take(4).collect();
    assert!(line.len() > 2);
    for pair in line.windows(2) {
        let run = libm::hypot(pair[1].x - pair[0].x, pair[1].y - pair[0].y);
        assert!((pair[1].z - pair[0].z).abs() <= 10f64.to_radians().tan() * run * 1.05 + 5.0);
    }
    for p in &line {
        assert!(p.z >= hill.heights.height(p.x, p.y).unwrap() + 495.0, "{p}");
    }
}

#[test]
fn mirrors_on_heads_are_planned_whatever_limits_they_state() {
    let area = Area::rectangle([0.0, 0.0], [90.0, 90.0]).unwrap();
    let low = AirborneOptions { height: 50.0, speed: Some(5.0), ..options() };
    for limits in ["", "scanFreqMin_Hz='100'", "scanFreqMin_Hz='100' scanFreqMax_Hz='200'"] {
        let plan = |range: &str| {
            plan_airborne(&area, &testing::spinning(&format!("{limits} {range}")), &CARRIER, &low, &FLAT)
        };
        let planned = plan("rangeMax_m='200'").unwrap();
        let lines = planned.settings.iter().find(|(key, _)| *key == "scan_freq_hz").unwrap().1;
        assert!(lines >= 100.0, "{limits}: {lines}");
        let endless = plan("").unwrap_err().to_string();
        assert!(endless.contains("rangeMax_m"), "{limits}: {endless}");
    }
}

#[test]
fn cross_lines_are_perpendicular() {
    let area = Area::rectangle([0.0, 0.0], [3000.0, 1000.0]).unwrap();
    let plan = plan_airborne(
        &area,
        &instrument(),
        &CARRIER,
        &AirborneOptions { cross_lines: 2, ..options() },
        &FLAT,
    )
    .unwrap();
    let crossing: Vec<_> = plan
        .waypoints
        .iter()
        .filter(|w| w.strip.as_deref().is_some_and(|s| s.starts_with("cross")))
        .collect();
    let mut x: Vec<f64> = crossing.iter().map(|w| w.position.x).collect();
    x.sort_by(f64::total_cmp);
    assert!(x.len() == 2 && (x[0] - 750.0).abs() < 1e-6 && (x[1] - 2250.0).abs() < 1e-6, "{x:?}");
}

#[test]
fn density_with_speed_and_overlap_yields_the_pulse_rate() {
    let area = Area::rectangle([0.0, 0.0], [3000.0, 1000.0]).unwrap();
    let rate = |density: f64| {
        let options = AirborneOptions { density: Some(density), overlap: Some(30.0), ..options() };
        plan_airborne(&area, &instrument(), &CARRIER, &options, &FLAT)
    };
    // Two thirds of the pulses of 100, 200, 300 and 400 kHz are fired, over a spacing of 404.15 m at 60 m/s.
    for (density, kilohertz) in [(2.0, 100.0), (4.0, 200.0), (7.0, 300.0), (10.0, 400.0)] {
        let plan = rate(density).unwrap();
        assert_eq!(plan.settings[0], ("pulse_freq_hz", 1e3 * kilohertz), "{density}");
        assert!(plan.promise.unwrap().density >= density);
        let told = plan.comments.iter().find(|line| line.starts_with("rate")).unwrap();
        assert!(told.contains(&format!("{kilohertz} kHz, the lowest of 100, 200, 300, 400 kHz")), "{told}");
        assert!(plan.warnings.iter().all(|text| !text.contains("lines is whole")));
    }
    let refused = rate(40.0).unwrap_err().to_string();
    assert!(refused.contains("400 kHz, gives 1") && refused.contains("instead of 40"), "{refused}");
    // A rate that is given leaves nothing to choose.
    let mut fixed = instrument();
    fixed.wanted_rate = Some(200_000);
    let options = AirborneOptions { density: Some(4.0), overlap: Some(30.0), ..options() };
    let refused = plan_airborne(&area, &fixed, &CARRIER, &options, &FLAT).unwrap_err().to_string();
    assert!(refused.contains("determine each other"), "{refused}");
}

#[test]
fn lines_follow_the_bends_of_a_corridor() {
    // East, then to the north-east: a bend of 36.87 degrees.
    let line = [[0.0, 0.0], [4000.0, 0.0], [8000.0, 3000.0]];
    let area =
        Area::new(vec![[0.0, -200.0], [4100.0, -200.0], [8100.0, 2800.0], [8000.0, 3000.0], [0.0, 200.0]]);
    let area = area.unwrap();
    let options = AirborneOptions { height: 500.0, density: Some(4.0), ..AirborneOptions::default() };
    let plan = |line: &[[f64; 2]], options: &AirborneOptions| {
        plan_corridor(line, 200.0, &area, &instrument(), &CARRIER, options, &FLAT)
    };
    let found = plan(&line, &options).unwrap();
    assert!((found.promise.unwrap().density - 4.0).abs() < 1e-9);
    assert!(found.comments.iter().any(|text| text.contains("along the line, 40")), "{found:?}");
    // Swath 578 m, spacing 405 m, 227 m to both sides: two lines, or three.
    let strips: Vec<Vec<&Waypoint>> = (1..=3)
        .map(|i| {
            let name = format!("line{i:03}");
            found.waypoints.iter().filter(|w| w.strip.as_deref() == Some(&name)).collect()
        })
        .collect();
    assert!(strips[0].len() > 10 && strips[1].len() > 10);
    for strip in strips.iter().filter(|strip| !strip.is_empty()) {
        let positions: Vec<[f64; 2]> = strip.iter().map(|w| [w.position.x, w.position.y]).collect();
        for corner in positions.windows(3) {
            let heading = |a: [f64; 2], b: [f64; 2]| libm::atan2(b[1] - a[1], b[0] - a[0]).to_degrees();
            let turn = heading(corner[1], corner[2]) - heading(corner[0], corner[1]);
            assert!(turn.abs() < 3.1, "{corner:?}");
        }
    }
    // To and fro.
    let first = |strip: &[&Waypoint]| strip[0].position.x;
    assert!(first(&strips[0]) < 0.0 && first(&strips[1]) > 7000.0);
    // Straight lines are the same by either way.
    let straight = plan(&line[..2], &options).unwrap();
    assert!(straight.waypoints.iter().all(|w| w.position.x < 4300.0 && w.position.y.abs() < 600.0));
    // Corners without room, and a line without length.
    let sharp = [[0.0, 0.0], [4000.0, 0.0], [4000.0, 100.0], [8000.0, 100.0]];
    let refused = plan(&sharp, &options).unwrap_err().to_string();
    assert!(refused.contains("turns too sharply at x 4000.0 y 0.0, where a bend of 50 m fits"), "{refused}");
    let refused = plan(&[[0.0, 0.0], [0.0, 0.0]], &options).unwrap_err().to_string();
    assert!(refused.contains("at least 2"), "{refused}");
    // Waypoints of lines that follow the ground keep the corners.
    let hill = PlanGround { heights: &|x: f64, _| Some(0.02 * x.max(0.0)), level: 0.0 };
    let follow = AirborneOptions { follow_terrain: true, ..options.clone() };
    let found = plan_corridor(&line, 200.0, &area, &instrument(), &CARRIER, &follow, &hill).unwrap();
    for waypoint in found.waypoints.iter().filter(|w| w.active) {
        let expected = 500.0 + 0.02 * waypoint.position.x.max(0.0);
        assert!((waypoint.position.z - expected).abs() < 6.0, "{waypoint:?}");
    }
}
