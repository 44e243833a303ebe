//! Lines that no gap divides: the sweeps of a mirror that swings, and full turns.

use super::pulses::Pulses;
use super::recording::{Recording, ends};
use std::ops::Range;

/// Maximum number of lines of a recording that gaps do not divide, in each window of time.
const MAX_LINES: usize = 2;
/// Minimum number of sweeps in a recording that is divided.
const MIN_SWEEPS: usize = 20;
/// Change of the scan angle back from its extreme that ends a sweep: steps of the angles, and share of their
/// range.
const BACK_STEPS: f64 = 1.5;
const BACK: f64 = 0.1;
/// Change of the scan angle from pulse to pulse that ends a turn, as a share of the range of the angles.
const JUMP: f64 = 0.5;

/// The sweeps of a recording whose pulses gaps do not divide into lines: of a mirror that swings, whose ends
/// are in the cloud, or of one that turns fully. `None` if gaps divide it, or if the scan angles do not go to
/// and fro.
pub fn of_undivided(recording: &Recording) -> Option<Vec<Range<usize>>> {
    if recording.lines.len() > MAX_LINES * recording.max_windows() {
        return None;
    }
    let (low, high) = ends(recording.pulses.angles());
    let range = high - low;
    let back = (BACK_STEPS * recording.angle_step).max(BACK * range);
    let mut sweeps = Vec::new();
    for line in &recording.lines {
        let mut begin = line.start;
        for border in borders(&recording.pulses, line, back, JUMP * range) {
            sweeps.push(begin..border);
            begin = border;
        }
        sweeps.push(begin..line.end);
    }
    (sweeps.len() >= MIN_SWEEPS).then_some(sweeps)
}

/// Extreme of the scan angles since the last border: its value, and the first and the last pulse with it.
#[derive(Clone, Copy)]
struct Extreme {
    angle: f64,
    first: usize,
    last: usize,
}

impl Extreme {
    fn at(pulses: &Pulses, i: usize) -> Extreme {
        Extreme { angle: pulses.angle(i), first: i, last: i }
    }

    /// The middle of the pulses at the extreme, of which rounded angles have several.
    fn middle(&self) -> usize {
        usize::midpoint(self.first, self.last)
    }

    /// Takes a pulse whose angle is at least as far out in the direction of `sense`.
    fn extend(&mut self, pulses: &Pulses, i: usize, sense: f64) {
        let beyond = sense * (pulses.angle(i) - self.angle);
        if beyond > 0.0 {
            *self = Extreme::at(pulses, i);
        } else if beyond == 0.0 {
            self.last = i;
        }
    }
}

/// Pulses of a line with which a new sweep begins: those at an extreme from which the angles go back by more
/// than `back`, and those after a jump of more than `jump`.
fn borders(pulses: &Pulses, line: &Range<usize>, back: f64, jump: f64) -> Vec<usize> {
    let mut found = Vec::new();
    let (mut low, mut high) = (Extreme::at(pulses, line.start), Extreme::at(pulses, line.start));
    // Of the sweep: 1 for rising angles, -1 for falling ones, 0 before it is known.
    let mut sense = 0.0;
    for i in line.clone().skip(1) {
        let angle = pulses.angle(i);
        if (angle - pulses.angle(i - 1)).abs() > jump {
            found.push(i);
            (low, high, sense) = (Extreme::at(pulses, i), Extreme::at(pulses, i), 0.0);
            continue;
        }
        low.extend(pulses, i, -1.0);
        high.extend(pulses, i, 1.0);
        if sense >= 0.0 && high.angle - angle > back {
            if sense > 0.0 {
                found.push(high.middle());
            }
            (low, sense) = (Extreme::at(pulses, i), -1.0);
        } else if sense <= 0.0 && angle - low.angle > back {
            if sense < 0.0 {
                found.push(low.middle());
            }
            (high, sense) = (Extreme::at(pulses, i), 1.0);
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::super::pulses::Pulse;
    use super::*;
    use vlscan_geom::{DVec3, radians};

    /// 5000 pulses with these scan angles, degrees, without a gap.
    fn recorded(angle: impl Fn(usize) -> f64) -> Recording {
        let pulse =
            |k: usize| Pulse::on_ground(1e-5 * k as f64, DVec3::new(k as f64, 0.0, 0.0), radians(angle(k)));
        Recording::new((0..5000).map(pulse).collect()).unwrap()
    }

    #[test]
    fn sweeps_end_where_the_mirror_turns_back() {
        // Sweeps of 100 pulses from -20 to 20 degrees and back, exact and in whole degrees.
        let place = |k: usize| if k % 200 < 100 { (k % 200) as f64 } else { (200 - k % 200) as f64 };
        for is_whole in [false, true] {
            let angle = |k: usize| 0.4 * place(k) - 20.0;
            let recording = recorded(|k| if is_whole { angle(k).round() } else { angle(k) + 0.003 });
            let sweeps = of_undivided(&recording).unwrap();
            assert_eq!((sweeps.len(), sweeps[0].start, sweeps[49].end), (50, 0, 5000));
            for (number, sweep) in sweeps.iter().enumerate().skip(1) {
                assert!(sweep.start.abs_diff(100 * number) <= 2, "{is_whole}: {sweep:?}");
            }
        }
    }

    #[test]
    fn full_turns_end_where_the_angle_jumps() {
        let recording = recorded(|k| 3.6 * (k % 100) as f64 - 80.0 * 0.5);
        let sweeps = of_undivided(&recording).unwrap();
        assert_eq!(sweeps, (0..50).map(|number| 100 * number..100 * (number + 1)).collect::<Vec<_>>());
    }

    #[test]
    fn lines_between_gaps_and_single_sweeps_stay() {
        assert_eq!(of_undivided(&recorded(|k| 0.004 * k as f64 - 10.0)), None);
        let mut divided = recorded(|k| (k % 100) as f64);
        divided.lines = vec![0..1000, 1000..3000, 3000..5000];
        assert_eq!(of_undivided(&divided), None);
    }
}
