//! Sections of lines within which the attitude of the platform counts as constant.

use super::recording::Recording;

/// Pulses of a section that are used.
const SECTION_PULSES: usize = 40;

/// Pulses for which the attitude counts as constant.
#[derive(Clone, Debug)]
pub struct Section {
    /// Mean time, s.
    pub time: f64,
    /// Indices of pulses that are used.
    pub pulses: Vec<usize>,
}

/// Divides lines into sections of at most `max_duration` s. At most `max_sections` are used, evenly chosen.
pub fn sections(recording: &Recording, max_duration: f64, max_sections: usize) -> Vec<Section> {
    let mut found = Vec::new();
    for line in &recording.lines {
        let pulses = &recording.pulses[line.clone()];
        let (first, last) = (pulses[0].time, pulses[pulses.len() - 1].time);
        let count = ((last - first) / max_duration).ceil().max(1.0) as usize;
        let (mut begin, mut k) = (line.start, 0usize);
        while begin < line.end && k < count {
            // Sections without pulses are passed over: a guess may turn far too fast.
            let passed = (recording.pulses[begin].time - first) / (last - first) * count as f64 - 1.0;
            k = (k + 1).max(passed as usize).min(count);
            let until = first + (last - first) * k as f64 / count as f64;
            let mut end = begin;
            while end < line.end && (recording.pulses[end].time <= until || k == count) {
                end += 1;
            }
            if end - begin >= 8 {
                let step = (end - begin).div_ceil(SECTION_PULSES);
                let pulses: Vec<usize> = (begin..end).step_by(step).collect();
                let time =
                    pulses.iter().map(|i| recording.pulses[*i].time).sum::<f64>() / pulses.len() as f64;
                found.push(Section { time, pulses });
            }
            begin = end;
        }
    }
    found.sort_by(|a, b| a.time.total_cmp(&b.time));
    let step = found.len().div_ceil(max_sections.max(1)).max(1);
    found.into_iter().step_by(step).collect()
}
