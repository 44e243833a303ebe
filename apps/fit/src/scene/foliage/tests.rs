//! Tests of foliage.

use super::*;

#[test]
fn a_beam_passes_its_voxels_without_gaps() {
    let grid = Grid { min: DVec3::new(-1.0, -2.0, 0.0), size: 0.5, cells: [8, 9, 10] };
    for (origin, direction) in [
        (DVec3::new(0.3, 0.1, 50.0), DVec3::new(0.02, -0.03, -1.0).normalize()),
        (DVec3::new(-9.0, 0.1, 2.0), DVec3::X),
        (DVec3::new(0.3, 0.2, 1.0), DVec3::new(1.0, 1.0, 1.0).normalize()),
    ] {
        let mut last: Option<f64> = None;
        let mut total = 0.0;
        grid.along(origin, direction, 60.0, |voxel, enter, leave| {
            assert!(last.is_none_or(|l| (l - enter).abs() < 1e-9), "{last:?} {enter}");
            let middle = origin + direction * (0.5 * (enter + leave));
            assert_eq!(grid.containing(middle), Some(voxel));
            (last, total) = (Some(leave), total + leave - enter);
        });
        assert!(total > 1.0, "{total}");
    }
}

#[test]
fn smoothing_keeps_sums_and_follows_the_ground() {
    let grid = Grid { min: DVec3::ZERO, size: 1.0, cells: [5, 5, 4] };
    let level = vec![0; 25];
    // Rises by a voxel per column along x.
    let slope: Vec<i32> = (0..25).map(|c| c / 5).collect();
    for (ground, at, beside) in [(&level, [2, 2, 1], [1, 3, 1]), (&slope, [2, 2, 2], [1, 3, 1])] {
        let mut sums = Sums { hits: vec![0.0; grid.len()], lengths: vec![1.0; grid.len()] };
        sums.hits[grid.number(at)] = 16.0;
        sums.smooth(&grid, ground, &mut vec![0.0; grid.len()]);
        assert_eq!(sums.hits[grid.number(at)], 4.0);
        assert_eq!(sums.hits[grid.number(beside)], 1.0);
        assert_eq!(sums.hits.iter().sum::<f32>(), 16.0);
    }
}

#[test]
fn voxels_are_larger_where_there_may_be_few() {
    let corners = [DVec3::ZERO, DVec3::new(100.0, 50.0, 20.0)];
    let voxels = |max: f64| Grid::around(corners.into_iter(), 0.5, max).unwrap();
    assert_eq!(voxels(f64::INFINITY).size, 0.5);
    let few = voxels(1000.0);
    assert!(few.size > 4.0 && few.len() <= 2000, "{} of {} m", few.len(), few.size);
}

#[test]
fn the_class_of_a_voxel_is_that_of_most_light() {
    let grid = Grid { min: DVec3::ZERO, size: 1.0, cells: [3, 1, 1] };
    let returns = [
        (0.5, 5, 1),
        (2.5, 3, 2),
        (0.5, 4, 2),
        (2.5, 5, 4),
        (0.1, 4, 4),
        (9.0, 6, 1),
        (2.6, 5, 4),
        (1.5, 5, 1),
    ];
    let at = |(x, class, of)| Return::last_of(of, class, DVec3::new(x, 0.5, 0.5));
    let recording = Recording { returns: returns.map(at).to_vec(), ..Recording::default() };
    let is_leaf = [true, true, true, true, true, true, true, false];
    // In the last voxel both have half.
    assert_eq!(classes(&recording, &is_leaf, &grid), [5, NO_CLASS, 5]);
}

#[test]
fn the_finest_level_is_not_smoothed() {
    let grid = Grid { min: DVec3::ZERO, size: 1.0, cells: [9, 9, 1] };
    let mut sums = Sums { hits: vec![0.0; grid.len()], lengths: vec![1.0; grid.len()] };
    sums.hits[grid.number([4, 4, 0])] = 8.0;
    let levels = Levels::of(&sums, &grid, &[0; 81]);
    let middle = levels.smooth.iter().map(|(sums, _)| sums.hits[grid.number([4, 4, 0])]);
    let middle: Vec<f32> = middle.collect();
    assert!(middle.len() == 3 && middle[0] < 2.0 && middle[1] < middle[0] && middle[2] < middle[1]);
    // Without a prior only the finest level counts.
    let found = levels.extinctions(0.0);
    assert_eq!((found[grid.number([4, 4, 0])], found[grid.number([4, 3, 0])]), (8.0, 0.0));
}

/// The likelihood is greatest at the extinction by which the sums were made.
#[test]
fn the_likelihood_prefers_the_truth() {
    let sums = Sums { hits: vec![3.0, 6.0], lengths: vec![10.0, 20.0] };
    let at = |s: f32| sums.log_likelihood(&sums.passed(), |_| s);
    assert!(at(0.3) > at(0.29) && at(0.3) > at(0.31));
    // With enough beams, the prior has no effect.
    let grid = Grid { min: DVec3::ZERO, size: 1.0, cells: [2, 1, 1] };
    let sums = Sums { hits: vec![3e6, 0.0], lengths: vec![10e6, 0.0] };
    let found = Levels::of(&sums, &grid, &[0, 0]).extinctions(1.0);
    assert!(found.iter().all(|s| (s - 0.3).abs() < 1e-4), "{found:?}");
}
