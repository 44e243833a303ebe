//! Points far above or below those that were recorded before and after them.

use super::pulses::{Pulses, Treatment};
use super::search::{OrderSearch, search};
use std::collections::VecDeque;

/// Number of pulses before and after a pulse with whose heights it is compared.
const NEIGHBOURS: usize = 12;
/// Points farther from the median height of their neighbours are noise: m, and multiples of the distance
/// within which 95 % of the points lie.
const MIN_OUTLIER: f64 = 50.0;
const OUTLIER: f64 = 6.0;

/// Removes pulses, and last returns of pulses, far above or below the others around their time. Returns their
/// number, and the distance that is too far, m.
pub(super) fn remove_outliers(pulses: &mut Pulses) -> (usize, f64) {
    let near = medians(pulses);
    let height = |i: usize| pulses.position(i).z;
    let median = |i: usize| height((i + usize::from(near[i])).saturating_sub(NEIGHBOURS));
    let distances = || (0..pulses.len()).map(|i| (height(i) - median(i)).abs());
    let Some(usual) = search(OrderSearch::of(|count| [count * 95 / 100; 2]), distances) else {
        return (0, MIN_OUTLIER);
    };
    let limit = MIN_OUTLIER.max(OUTLIER * usual);
    let is_far = |height: f64, i: usize| (height - median(i)).abs() > limit;
    let far = |i: usize| {
        let pulse = pulses.get(i);
        [is_far(pulse.position.z, i), pulse.last.is_some_and(|last| is_far(last.z, i))]
    };
    let removed = (0..pulses.len()).flat_map(far).filter(|is_far| *is_far).count();
    if removed > 0 {
        let treatment = |i: usize| match far(i) {
            [true, _] => Treatment::LeaveOut,
            [false, true] => Treatment::LeaveOutLast,
            [false, false] => Treatment::Keep,
        };
        let treatments: Vec<Treatment> = (0..pulses.len()).map(treatment).collect();
        pulses.treat(|i| treatments[i]);
    }
    (removed, limit)
}

/// For each pulse the pulse among those around it whose height is their median, counted from the pulse
/// [`NEIGHBOURS`] before.
fn medians(pulses: &Pulses) -> Vec<u8> {
    let mut heights = pulses.iter().map(|pulse| pulse.position.z);
    let mut near: VecDeque<f64> = VecDeque::with_capacity(2 * NEIGHBOURS + 2);
    near.extend(heights.by_ref().take(NEIGHBOURS));
    let mut sorted: Vec<f64> = Vec::with_capacity(2 * NEIGHBOURS + 1);
    let of_pulse = |i: usize| {
        near.extend(heights.next());
        if i > NEIGHBOURS {
            near.pop_front();
        }
        sorted.clear();
        sorted.extend(&near);
        let middle = sorted.len() / 2;
        let median = *sorted.select_nth_unstable_by(middle, f64::total_cmp).1;
        let place = near.iter().position(|height| height.to_bits() == median.to_bits());
        // The first pulses have fewer before them.
        (place.unwrap_or(0) + NEIGHBOURS.saturating_sub(i)) as u8
    };
    (0..pulses.len()).map(of_pulse).collect()
}

#[cfg(test)]
mod tests {
    use super::super::pulses::Pulse;
    use super::*;
    use vlscan_geom::DVec3;

    fn pulse(k: usize) -> Pulse {
        let position = DVec3::new(k as f64, 0.0, 0.3 * k as f64);
        let last = (k % 10 == 3).then_some(position);
        Pulse {
            time: 1e-5 * k as f64,
            position,
            angle: 0.0,
            returns: 1,
            class: 1,
            last,
            file_channel: 0,
            channel: 0,
        }
    }

    #[test]
    fn points_far_from_those_around_them_are_noise() {
        let mut all: Vec<Pulse> = (0..2000).map(pulse).collect();
        let mut pulses: Pulses = all.iter().copied().collect();
        assert_eq!(remove_outliers(&mut pulses).0, 0);
        for k in (0..2000).step_by(50) {
            all[k].position.z += if k % 100 == 0 { 500.0 } else { -300.0 };
        }
        all[3].last = Some(DVec3::new(3.0, 0.0, -400.0));
        let mut pulses: Pulses = all.into_iter().collect();
        let (removed, limit) = remove_outliers(&mut pulses);
        assert_eq!((removed, pulses.len(), limit), (41, 1960, MIN_OUTLIER));
        assert!(pulses.iter().all(|pulse| (pulse.position.z - 0.3 * pulse.position.x).abs() < 1e-9));
        let with_last = pulses.iter().filter(|pulse| pulse.last.is_some()).count();
        assert!(pulses.get(2).last.is_none() && with_last == 199);
        assert_eq!(remove_outliers(&mut Pulses::default()), (0, MIN_OUTLIER));
    }

    #[test]
    fn medians_are_those_of_the_pulses_around() {
        let height = |k: usize| ((k * 7919) % 101) as f64;
        for count in [1, 5, 12, 13, 24, 25, 26, 300] {
            let pulses: Pulses =
                (0..count).map(|k| Pulse { position: DVec3::new(0.0, 0.0, height(k)), ..pulse(k) }).collect();
            for (i, place) in medians(&pulses).into_iter().enumerate() {
                let around = i.saturating_sub(NEIGHBOURS)..(i + NEIGHBOURS + 1).min(count);
                let mut heights: Vec<f64> = around.map(height).collect();
                heights.sort_by(f64::total_cmp);
                let found = pulses.get(i + usize::from(place) - NEIGHBOURS).position.z;
                assert_eq!(found, heights[heights.len() / 2], "{i} of {count}");
            }
        }
    }
}
