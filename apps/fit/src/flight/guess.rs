//! First guesses of a flight and its mirror.

use super::mirror::Mirror;
use super::model::Model;
use super::recording::Recording;
use super::{cones, facets, lines};

/// Guesses that the pulses suggest, of all mirrors but elliptic cones.
pub fn guesses(recording: &Recording) -> Vec<Model> {
    let mut mirrors = vec![(Mirror::Polygon, 1), (Mirror::Oscillating, 1)];
    if recording.channels > 1 {
        mirrors.push((Mirror::Polygon, recording.channels));
    }
    let mut found = cones::guesses(recording);
    let of_mirror = |(mirror, channels)| lines::guess(recording, mirror, channels);
    found.extend(mirrors.into_iter().filter_map(of_mirror));
    let of_facets: Vec<Model> = found.iter().filter_map(|first| facets::guess(recording, first)).collect();
    found.extend(of_facets);
    found
}

/// Guesses of mirrors that swing unevenly, if the lines go to and fro.
pub fn swings(recording: &Recording) -> Vec<Model> {
    [Mirror::Turning, Mirror::Sine].iter().filter_map(|mirror| lines::guess(recording, *mirror, 1)).collect()
}
