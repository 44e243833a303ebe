//! Sections of lines within which the attitude of the platform counts as constant.

use super::recording::Recording;
use std::iter::StepBy;
use std::ops::Range;

/// Pulses of a section that are used.
const SECTION_PULSES: usize = 40;
/// Number of independent pulses that a section is worth: errors of neighbouring pulses are correlated
/// (terrain height, encoders).
const SECTION_WEIGHT: f64 = 20.0;

/// Multiplier whose multiples, modulo 2⁶⁴, are evenly distributed: 2⁶⁴ times the golden section.
const GOLDEN: u64 = 0x9e37_79b9_7f4a_7c15;

/// Pulses for which the attitude counts as constant.
#[derive(Clone, Debug)]
pub struct Section {
    /// Mean time, s.
    pub time: f64,
    /// Its pulses.
    all: Range<usize>,
}

impl Section {
    /// Indices of the pulses that are used.
    pub fn pulses(&self) -> StepBy<Range<usize>> {
        self.all.clone().step_by(self.all.len().div_ceil(SECTION_PULSES).max(1))
    }

    /// Weight of each of the pulses that are used.
    pub fn share(&self) -> f64 {
        (SECTION_WEIGHT / self.pulses().len() as f64).min(1.0)
    }
}

/// Divides lines into sections of at most `max_duration` s. At most `max_sections` are used, evenly chosen in
/// time and among the parts of lines.
pub fn sections(recording: &Recording, max_duration: f64, max_sections: usize) -> Vec<Section> {
    let mut found = Vec::new();
    for line in &recording.lines {
        let time = |i: usize| recording.pulses.time(i);
        let (first, last) = (time(line.start), time(line.end - 1));
        let count = ((last - first) / max_duration).ceil().max(1.0) as usize;
        let (mut begin, mut k) = (line.start, 0usize);
        while begin < line.end && k < count {
            // Sections without pulses are passed over: a guess may turn far too fast.
            let passed = (time(begin) - first) / (last - first) * count as f64 - 1.0;
            k = (k + 1).max(passed as usize).min(count);
            let until = first + (last - first) * k as f64 / count as f64;
            let mut end = begin;
            while end < line.end && (time(end) <= until || k == count) {
                end += 1;
            }
            if end - begin >= 8 {
                let section = Section { time: 0.0, all: begin..end };
                let mean = section.pulses().map(time).sum::<f64>() / section.pulses().len() as f64;
                found.push(Section { time: mean, ..section });
            }
            begin = end;
        }
    }
    found.sort_by(|a, b| a.time.total_cmp(&b.time));
    let step = found.len().div_ceil(max_sections.max(1)).max(1);
    // One of each `step` sections: always the first would be the same part of every line where a line has as
    // many sections, or a part of them.
    let chosen = found.chunks(step).zip(0u64..).filter_map(|(sections, k)| {
        let share = k.wrapping_mul(GOLDEN) >> 32;
        sections.get(((share * sections.len() as u64) >> 32) as usize)
    });
    chosen.cloned().collect()
}
