//! Names that a misspelt one may stand for.

/// The candidate that a misspelt `word` probably means: at most a third of its letters differ (an inserted,
/// missing, wrong or swapped letter counts once; case is ignored). Among equally near candidates the first is
/// returned. If more than one letter differs, the shortest one that goes on after `word` with an underscore
/// comes first: it may lack only a unit. If none is as near, it is one whose first words are, and then the
/// shortest one of which `word` is a part, whatever the signs between its letters.
pub fn nearest<'a>(word: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let lower = word.to_lowercase();
    let length = lower.chars().count();
    if length > 60 {
        return None;
    }
    let candidates: Vec<&str> = candidates.into_iter().collect();
    let distances = candidates.iter().map(|candidate| {
        let other = candidate.to_lowercase();
        (strsim::osa_distance(&lower, &other), other.chars().count(), *candidate)
    });
    let near =
        distances.filter(|(distance, letters, _)| *distance <= (length / 3).max(1) && distance < letters);
    let near = near.min_by_key(|near| near.0);
    if let Some((0 | 1, _, candidate)) = near {
        return Some(candidate);
    }
    let near = longer(&lower, &candidates).or(near.map(|near| near.2));
    near.or_else(|| misspelt_start(&lower, &candidates)).or_else(|| part_of(word, &candidates))
}

/// Letters and digits that a part of a name must have.
const MIN_PART: usize = 3;

/// The shortest candidate that goes on after the name `lower`, in lower case, with an underscore.
fn longer<'a>(lower: &str, candidates: &[&'a str]) -> Option<&'a str> {
    let is_longer = |candidate: &&&str| {
        let other = candidate.to_lowercase();
        other.strip_prefix(lower).is_some_and(|end| end.starts_with('_'))
    };
    let longer = candidates.iter().filter(is_longer).min_by_key(|candidate| candidate.len());
    longer.copied().filter(|_| lower.chars().count() >= MIN_PART)
}

/// The candidate whose first words are nearest to those of `lower`, a name in lower case that is misspelt and
/// may lack a unit.
fn misspelt_start<'a>(lower: &str, candidates: &[&'a str]) -> Option<&'a str> {
    let (words, length) = (lower.split('_').count(), lower.chars().count());
    let start = |candidate: &&'a str| {
        let other = candidate.to_lowercase();
        let start = other.split('_').take(words).collect::<Vec<_>>().join("_");
        (strsim::osa_distance(lower, &start), candidate.len(), *candidate)
    };
    let starts = candidates.iter().map(start).filter(|(distance, ..)| *distance <= length / 3);
    starts.min_by_key(|(distance, length, _)| (*distance, *length)).map(|(_, _, candidate)| candidate)
}

/// The shortest candidate of which `word` is a part; only letters and digits count.
fn part_of<'a>(word: &str, candidates: &[&'a str]) -> Option<&'a str> {
    let plain = |text: &str| text.to_lowercase().chars().filter(|c| c.is_alphanumeric()).collect::<String>();
    let part = plain(word);
    let holds = |candidate: &&&str| plain(candidate).contains(&part);
    let holding = candidates.iter().filter(holds).min_by_key(|candidate| candidate.len());
    holding.copied().filter(|_| part.chars().count() >= MIN_PART)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn misspelt_words_find_their_neighbour() {
        let names = ["scanFreq_hz", "scanAngle_deg", "pulseFreq_hz", "id"];
        assert_eq!(nearest("scanFreq_Hz", names), Some("scanFreq_hz"));
        assert_eq!(nearest("pulsFreq_hz", names), Some("pulseFreq_hz"));
        assert_eq!(nearest("dI", names), Some("id"));
        assert_eq!(nearest("colour", names), None);
        // The unit is missing, but `water_index` has fewer other letters.
        let water = ["water_index", "water_level_m", "water_wind_m_s", "water_wind_deg"];
        assert_eq!(nearest("water_wind", water), Some("water_wind_m_s"));
        assert_eq!(nearest("water_indx", water), Some("water_index"));
        // Both a letter and the unit are missing.
        let rates = ["pulse_times", "pulse_freq_hz", "head_rate_deg_per_s"];
        assert_eq!(nearest("pulse_frq", rates), Some("pulse_freq_hz"));
        assert_eq!(nearest("heat_rate", rates), Some("head_rate_deg_per_s"));
        assert_eq!(nearest("tail", rates), None);
        let ids = ["riegl_vux-1uav22", "riegl_vux-1uav", "velodyne_hdl-64e"];
        assert_eq!([nearest("VUX-1UAV", ids), nearest("hdl64", ids)], [Some(ids[1]), Some(ids[2])]);
        assert_eq!(nearest("1u", ids), None);
    }
}
