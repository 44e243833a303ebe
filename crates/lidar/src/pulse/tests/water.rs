//! Surface, column and bottom of water in complete pulses.

use super::*;
use crate::pulse::testkit::*;
use crate::pulse::{EchoPath, PathKind};
use vlscan_scene::{Optics, OpticsKind, Water};
use vlscan_survey::{ReadOptions, find_scanner};

/// Flat water without scattering.
const WATER: Water = Water {
    index: 1.34,
    group_index: 1.365,
    attenuation: 0.1,
    beam_attenuation: 0.1,
    backscatter: 0.0,
    slopes: [0.0; 2],
    wind: [0.0, 1.0],
};

/// A wall that faces −y at distance y.
fn wide(y: f64) -> [DVec3; 3] {
    [DVec3::new(-600.0, y, -300.0), DVec3::X * 1200.0, DVec3::Z * 600.0]
}

/// Water whose surface is `air` m away, and its bottom `depth` m behind it.
fn lake(water: Water, air: f64, depth: f64) -> Scene {
    let mut scene = rectangles(half_white(), &[wide(air), wide(air + depth)]);
    let optics = Optics { kind: OpticsKind::Water(water), share: 1.0, roughness: 0.0 };
    scene.materials.push(Material { reflectance: 0.0, optics: Some(optics), ..half_white() });
    scene.surfaces[0].material = 1;
    scene
}

fn recorded() -> PhysicsOptions {
    PhysicsOptions { record_truth: true, record_subrays: true, ..PhysicsOptions::refined() }
}

fn one_ray() -> Survey {
    tls_with(|device| device.waveform.quality = 1)
}

fn turned(degrees: f64) -> [Pulse; 1] {
    [pulse(Rotation::about_z(radians(degrees)))]
}

#[test]
fn the_bottom_has_the_refracted_place_and_the_light_of_the_closed_form() {
    let scene = lake(WATER, 300.0, 10.0);
    let bare = rectangles(half_white(), &[wide(300.0)]);
    for (degrees, light) in
        [(0.0, 7.639813e-07), (10.0, 7.178395e-07), (20.0, 5.933099e-07), (30.0, 4.263529e-07)]
    {
        let [seen, alone] =
            [&scene, &bare].map(|scene| simulate_pulses(scene, &one_ray(), recorded(), 0, &turned(degrees)));
        let is_bottom = |i: &usize| seen.truths[*i].path.kind == PathKind::WaterBottom;
        let (Some(i), [surface]) = ((0..seen.echoes.len()).find(is_bottom), &alone.echoes[..]) else {
            panic!("{degrees}°: {:?} {:?}", seen.echoes, alone.echoes)
        };
        let (truth, bottom) = (seen.truths[i], seen.echoes[i]);
        assert_eq!(truth.path, EchoPath { kind: PathKind::WaterBottom, order: 1 });
        let (outer, sine) = (libm::cos(radians(degrees)), libm::sin(radians(degrees)));
        let inner = (1.0 - (sine / 1.34).powi(2)).sqrt();
        let (air, way) = (300.0 / outer, 10.0 / inner);
        assert!((bottom.range - (air + 1.365 * way)).abs() < 1e-9, "{degrees}°");
        let at = truth.surface + scene.shift;
        let true_x = -300.0 * sine / outer - 10.0 * sine / 1.34 / inner;
        assert!((at - DVec3::new(true_x, 310.0, 0.0)).length() < 1e-9, "{degrees}°: {at}");
        // The bare surface has the light ρ·cos θ/l_a².
        let found = bottom.intensity / surface.intensity * outer / (air * air);
        assert!((found / light - 1.0).abs() < 1e-6, "{degrees}°: {found:e}");
        assert_eq!((bottom.classification, bottom.part), (40, 1));
    }
}

#[test]
fn points_below_water_lie_on_the_axis_or_where_the_light_was() {
    let scene = lake(WATER, 300.0, 10.0);
    let options = PhysicsOptions { record_truth: true, ..PhysicsOptions::refined() };
    let found = |is_corrected: bool| {
        let survey = tls_with(|device| device.receiver.corrects_refraction = is_corrected);
        let batch = simulate_pulses(&scene, &survey, options, 0, &turned(-20.0));
        assert_eq!(batch.echoes.len(), 1, "{:?}", batch.echoes);
        batch.echoes[0].position + scene.shift
    };
    let (recorded, corrected) = (found(false), found(true));
    assert!((recorded - DVec3::new(114.019575, 313.266207, 0.0)).length() < 0.05, "{recorded}");
    assert!((corrected - DVec3::new(111.830896, 310.0, 0.0)).length() < 0.05, "{corrected}");
    // The same range of the same beam, up to where it enters the water.
    let direction = Rotation::about_z(radians(-20.0)).forward();
    let entry = direction * (300.0 / direction.y);
    let bent = vlscan_geom::unit(corrected - entry);
    assert!((bent.x * 1.34 - direction.x).abs() < 1e-9, "{bent}");
    let behind = (recorded - entry).length() / 1.365;
    assert!(((corrected - entry).length() - behind).abs() < 1e-9);
}

/// Rows of the subrays of pulses along the axis, by kind of their way.
fn light_by_kind(scene: &Scene, survey: &Survey, pulses: &[Pulse]) -> [f64; 6] {
    let batch = simulate_pulses(scene, survey, recorded(), 0, pulses);
    let mut light = [0.0; 6];
    for (echo, truth) in batch.echoes.iter().zip(&batch.truths) {
        light[truth.path.kind as usize] += echo.intensity;
    }
    light
}

#[test]
fn waves_mirror_light_back_by_cox_and_munk_and_calm_water_drops_out_aside() {
    let windy = Water { slopes: [0.5 * (0.003 + 0.00512 * 5.0); 2], ..WATER };
    let calm = Water { slopes: [0.5 * (0.003 + 0.00512); 2], ..WATER };
    let bare = rectangles(half_white(), &[wide(100.0)]);
    let many = |degrees: f64| -> Vec<Pulse> {
        (1..=1000).map(|number| Pulse { number, ..turned(degrees)[0] }).collect()
    };
    let factor = |water: Water, degrees: f64| {
        let pulses = many(degrees);
        let surface =
            light_by_kind(&lake(water, 100.0, 10.0), &tls(), &pulses)[PathKind::WaterSurface as usize];
        let lambert = light_by_kind(&bare, &tls(), &pulses)[0];
        surface / lambert * 0.5 * libm::cos(radians(degrees))
    };
    for (degrees, expected) in [(0.0, 0.184544), (10.0, 0.067177)] {
        let found = factor(windy, degrees);
        assert!((found / expected - 1.0).abs() < 0.04, "{degrees}°: {found}");
    }
    assert!(factor(calm, 0.0) > 0.5 && factor(calm, 20.0) < 1e-6);
    // Flat water is a mirror: the receiver of 150 mm takes its part of a beam of 30 mm at 200 m.
    let share = 1.0 - libm::exp(-2.0 * (0.075f64 / 0.03).powi(2));
    let expected = (0.34f64 / 2.34).powi(2) * share * (200.0f64 / 0.15).powi(2);
    assert!((factor(WATER, 0.0) / expected - 1.0).abs() < 1e-6, "{}", factor(WATER, 0.0));
    assert_eq!(factor(WATER, 10.0), 0.0);
}

#[test]
fn surface_and_bottom_are_returns_with_classes_of_bathymetry() {
    let water = Water { slopes: [0.0143; 2], backscatter: 1e-5, ..WATER };
    let options = PhysicsOptions { record_truth: true, ..PhysicsOptions::refined() };
    let mut scene = lake(water, 100.0, 5.0);
    let classes = |scene: &Scene| {
        let batch = simulate(scene, &tls(), options);
        let kinds: Vec<_> = batch.truths.iter().map(|truth| truth.path.kind).collect();
        assert_eq!(kinds, [PathKind::WaterSurface, PathKind::WaterBottom], "{:?}", batch.echoes);
        batch.echoes.iter().map(|echo| echo.classification).collect::<Vec<_>>()
    };
    assert_eq!(classes(&scene), [41, 40]);
    scene.materials[0].classification = 2;
    assert_eq!(classes(&scene), [41, 40]);
    scene.materials[0].classification = 43;
    scene.materials[1].classification = 9;
    assert_eq!(classes(&scene), [9, 43]);
    assert_eq!(PathKind::Pane.classification(0), 0);
    assert_eq!(PathKind::WaterColumn.classification(0), 0);
}

#[test]
fn water_without_a_bottom_has_a_column() {
    let water = Water { backscatter: Water::BACKSCATTER, ..WATER };
    let mut scene = lake(water, 100.0, 5.0);
    let kinds = |scene: &Scene| light_by_kind(scene, &tls(), &turned(10.0)).map(|light| light > 0.0);
    assert_eq!(kinds(&scene), [false, false, false, false, true, true]);
    scene.materials[0].reflectance = 0.0;
    let options = PhysicsOptions { record_truth: true, ..PhysicsOptions::refined() };
    let batch = simulate_pulses(&scene, &tls(), options, 0, &turned(10.0));
    assert!(!batch.truths.is_empty(), "no echo of the column");
    assert!(batch.truths.iter().all(|truth| truth.path.kind == PathKind::WaterColumn), "{:?}", batch.truths);
}

#[test]
fn water_that_takes_no_light_returns_none_but_that_of_its_bottom() {
    let clear = Water { backscatter: Water::BACKSCATTER, attenuation: 0.0, beam_attenuation: 0.0, ..WATER };
    let mut scene = lake(clear, 100.0, 5.0);
    let kinds = |scene: &Scene| light_by_kind(scene, &tls(), &turned(10.0)).map(|light| light > 0.0);
    assert_eq!(kinds(&scene), [false, false, false, false, false, true]);
    scene.materials[0].reflectance = 0.0;
    assert_eq!(kinds(&scene), [false; 6]);
}

#[test]
fn pulses_beside_water_do_not_change() {
    let walls = [wall(-20.0, 0.0, 10.0), wall(5.0, 20.0, 12.0)];
    let plain = rectangles(half_white(), &walls);
    let mut wet = rectangles(half_white(), &walls);
    let optics = Optics { kind: OpticsKind::Water(WATER), share: 1.0, roughness: 0.0 };
    wet.materials.push(Material { reflectance: 0.0, optics: Some(optics), ..half_white() });
    wet.surfaces[1].material = 1;
    let options = PhysicsOptions { record_truth: true, ..PhysicsOptions::refined() };
    let [plain, wet] = [plain, wet].map(|scene| simulate_pulses(&scene, &tls(), options, 0, &turned(20.0)));
    assert_eq!(plain.echoes.len(), 1);
    assert_eq!((plain.echoes, plain.truths), (wet.echoes, wet.truths));
}

#[test]
fn banks_are_mirrored_by_flat_water() {
    // The bank stands aside in air; the light that reaches it over the water is a ghost below the surface.
    let bank = [DVec3::new(-20.0, 20.0, -20.0), DVec3::Y * 78.0, DVec3::Z * 40.0];
    let mut scene = rectangles(half_white(), &[wide(100.0), bank]);
    let optics = Optics { kind: OpticsKind::Water(WATER), share: 1.0, roughness: 0.0 };
    scene.materials.push(Material { reflectance: 0.0, optics: Some(optics), ..half_white() });
    scene.surfaces[0].material = 1;
    let aimed = pulse(Rotation::about_z(libm::atan(0.12)));
    let batch = simulate_pulses(&scene, &one_ray(), recorded(), 0, &[aimed]);
    let [ghost] = &batch.echoes[..] else { panic!("{:?}", batch.echoes) };
    let truth = ghost.truth(&batch.truths);
    assert_eq!(truth.path, EchoPath { kind: PathKind::Mirror, order: 1 });
    assert!(((truth.surface + scene.shift).x + 20.0).abs() < 1e-9);
}

/// The data sheet states depths of 1.7, 1.8, 2.0, 2.2 and 2.5 Secchi depths from 75 m at 200, 100, 50, 5 and
/// 0.5 kHz. The last two are means of 10 and 100 pulses, whose noise is less by the square root.
#[test]
fn depths_of_the_vq_840_g_follow_from_its_pulse_rates() {
    let (scanner, _) = find_scanner("riegl_vq-840-g", &ReadOptions::default()).unwrap();
    let secchi = 5.0;
    let water = Water { attenuation: 2.3 / secchi, beam_attenuation: 2.3 / secchi, ..WATER };
    let bottom = |pulse_freq: u32, depths: f64| {
        let mut survey = Survey { scanner: scanner.clone(), ..one_ray() };
        survey.scanner.devices[0].waveform.quality = 1;
        survey.legs[0].scanner.pulse_freq = pulse_freq;
        let scene = lake(water, 75.0, depths * secchi);
        light_by_kind(&scene, &survey, &turned(0.0))[PathKind::WaterBottom as usize]
    };
    let threshold = bottom(50_000, 2.0);
    assert!(threshold > 0.0);
    for (pulse_freq, mean_of, sheet, exact) in [
        (200_000, 1.0, 1.7, 1.6986),
        (100_000, 1.0, 1.8, 1.8493),
        (50_000, 1.0, 2.0, 2.0),
        (50_000, 10.0f64, 2.2, 2.2503),
        (50_000, 100.0, 2.5, 2.5006),
    ] {
        let (mut shallow, mut deep) = (1.0, 3.0);
        for _ in 0..30 {
            let middle = 0.5 * (shallow + deep);
            match bottom(pulse_freq, middle) * mean_of.sqrt() > threshold {
                true => shallow = middle,
                false => deep = middle,
            }
        }
        assert!((shallow - sheet).abs() < 0.1, "{pulse_freq} Hz, {mean_of} pulses: {shallow}");
        let formula = 2.0 + libm::log(50_000.0 / f64::from(pulse_freq) * mean_of.sqrt()) / (2.0 * 2.3);
        assert!((formula - exact).abs() < 5.1e-5, "{formula}");
        // The formula leaves out that light spreads with the depth.
        assert!((shallow - exact).abs() < 0.02, "{pulse_freq} Hz, {mean_of} pulses: {shallow}");
    }
}

#[test]
fn a_narrow_field_of_view_loses_light_that_water_scatters_forward() {
    let turbid = Water { beam_attenuation: 0.5, ..WATER };
    let bottom = |field_of_view: Option<f64>| {
        let survey = tls_with(|device| device.receiver.field_of_view = field_of_view);
        light_by_kind(&lake(turbid, 75.0, 5.0), &survey, &turned(0.0))[PathKind::WaterBottom as usize]
    };
    let all = bottom(None);
    // Only the attenuation c of the beam, only K, and between.
    assert!((bottom(Some(0.0)) / all / libm::exp(-2.0 * 0.4 * 5.0) - 1.0).abs() < 1e-6);
    let between = 0.4 * libm::exp(-0.85 * 0.5 * 0.006 * 75.0);
    assert!((bottom(Some(0.006)) / all / libm::exp(-2.0 * between * 5.0) - 1.0).abs() < 1e-3);
    assert!(bottom(Some(0.006)) < bottom(Some(0.018)));
}

#[test]
fn clear_water_has_the_same_echoes_whether_its_light_ends_behind_the_last_surface_or_not() {
    let windy = Water { slopes: [0.0143; 2], backscatter: Water::BACKSCATTER, attenuation: 1e-5, ..WATER };
    for water in [windy, Water { slopes: [0.0; 2], ..windy }] {
        for (depth, reflectance) in [(5.0, 0.5), (60.0, 0.5), (60.0, 0.0)] {
            let mut scene = lake(water, 100.0, depth);
            scene.materials[0].reflectance = reflectance;
            let echoes = |record_waveforms: bool| {
                let options = PhysicsOptions { record_waveforms, ..PhysicsOptions::refined() };
                let pulses: Vec<Pulse> = (1..=40).map(|number| Pulse { number, ..turned(8.0)[0] }).collect();
                simulate_pulses(&scene, &tls(), options, 0, &pulses).echoes
            };
            let (bounded, all) = (echoes(false), echoes(true));
            assert!(!all.is_empty());
            assert_eq!(bounded.len(), all.len(), "{depth} m, {reflectance}");
            for (one, other) in bounded.iter().zip(&all) {
                assert!((one.range - other.range).abs() < 1e-6, "{one:?} {other:?}");
                assert!((one.intensity / other.intensity - 1.0).abs() < 1e-6, "{one:?} {other:?}");
            }
        }
    }
}
