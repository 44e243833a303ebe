//! A font of strokes on a grid of 5 × 7 units.

/// Distance from one character to the next, units.
pub(crate) const ADVANCE: f64 = 6.0;
/// Height of the capitals, units; descenders take two more units below.
pub(crate) const HEIGHT: f64 = 7.0;

/// The strokes of a character, separated by spaces: points of two letters each, a digit for half units to the
/// right and a letter for half units down (`a` is the upper end of capitals, `m` the baseline). A single
/// point is a dot. Characters without a glyph are drawn as a box.
fn strokes_of(c: char) -> &'static str {
    match c {
        ' ' => "",
        '!' => "4a4i 4m",
        '"' => "2a2d 6a6d",
        '#' => "3a1m 7a5m 0e8e 0i8i",
        '%' => "8a0m 0a2a2c0c0a 6k8k8m6m6k",
        '&' => "8m2e2b3a5a6b6d0i0k2m4m8i",
        '\'' => "4a4d",
        '(' => "6a4d4j6m",
        ')' => "2a4d4j2m",
        '*' => "4c4k 1e7i 7e1i",
        '+' => "4c4k 0g8g",
        ',' => "4l4n3p",
        '-' => "2g6g",
        '–' => "0g8g",
        '−' => "1g7g",
        '.' => "4m",
        '/' => "8a0m",
        '0' => "3a5a7d7j5m3m1j1d3a",
        '1' => "1c4a4m 1m7m",
        '2' => "0c2a6a8c8e0m8m",
        '3' => "0c2a6a8c8e6g3g 6g8i8k6m2m0k",
        '4' => "6m6a0i8i",
        '5' => "8a0a0f6f8h8k6m2m0k",
        '6' => "7a4a0e0k2m6m8k8i6g2g0i",
        '7' => "0a8a3m",
        '8' => "2a6a8c8e6g2g0e0c2a 2g0i0k2m6m8k8i6g",
        '9' => "8e6g2g0e0c2a6a8c8i4m1m",
        ':' => "4e 4l",
        ';' => "4e 4l4n3p",
        '<' => "7c1g7k",
        '=' => "0e8e 0i8i",
        '>' => "1c7g1k",
        '?' => "0c2a6a8c8e4h4i 4m",
        '@' => "6i4i3h3f4e6e6i8h8c6a2a0c0k2m7m",
        '[' => "5a3a3m5m",
        '\\' => "0a8m",
        ']' => "3a5a5m3m",
        '_' => "0m8m",
        '|' => "4a4m",
        '~' => "0g2f6h8g",
        '×' => "1d7j 7d1j",
        '±' => "4b4h 1e7e 1k7k",
        '·' => "4g",
        '…' => "0m 4m 8m",
        '°' => "3a5a6b6c5d3d2c2b3a",
        '²' => "2a6a6c2f6f",
        '³' => "2a6a4c6d5f2f",
        'A' => "0m4a8m 1j7j",
        'B' => "0a0m6m8k8i6g0g 6g8e8c6a0a",
        'C' => "8c6a2a0c0k2m6m8k",
        'D' => "0a5a8d8j5m0m0a",
        'E' => "8a0a0m8m 0g6g",
        'F' => "8a0a0m 0g6g",
        'G' => "8c6a2a0c0k2m6m8k8g5g",
        'H' => "0a0m 8a8m 0g8g",
        'I' => "2a6a 4a4m 2m6m",
        'J' => "3a8a 6a6k4m2m0k",
        'K' => "0a0m 8a0h 3e8m",
        'L' => "0a0m8m",
        'M' => "0m0a4g8a8m",
        'N' => "0m0a8m8a",
        'O' => "2a6a8c8k6m2m0k0c2a",
        'P' => "0m0a6a8c8e6g0g",
        'Q' => "2a6a8c8k6m2m0k0c2a 5j8m",
        'R' => "0m0a6a8c8e6g0g 4g8m",
        'S' => "8c6a2a0c0e2g6g8i8k6m2m0k",
        'T' => "0a8a 4a4m",
        'U' => "0a0k2m6m8k8a",
        'V' => "0a4m8a",
        'W' => "0a2m4g6m8a",
        'X' => "0a8m 8a0m",
        'Y' => "0a4g8a 4g4m",
        'Z' => "0a8a0m8m",
        'a' => "1e6e8g8m 8i2i0k2m6m8k",
        'b' => "0a0m 0g2e6e8g8k6m2m0k",
        'c' => "8f6e2e0g0k2m6m8l",
        'd' => "8a8m 8g6e2e0g0k2m6m8k",
        'e' => "0i8i8g6e2e0g0k2m6m8l",
        'f' => "7a6a4c4m 1e7e",
        'g' => "8e8o6q2q0p 8g6e2e0g0k2m6m8k",
        'h' => "0a0m 0g2e6e8g8m",
        'i' => "4b 2e4e4m 2m6m",
        'j' => "6b 4e6e6o4q1q",
        'k' => "0a0m 7e0j 3h8m",
        'l' => "2a4a4m6m",
        'm' => "0m0e 0f2e4f4m 4f6e8f8m",
        'n' => "0e0m 0g2e6e8g8m",
        'o' => "2e6e8g8k6m2m0k0g2e",
        'p' => "0e0q 0g2e6e8g8k6m2m0k",
        'q' => "8e8q 8g6e2e0g0k2m6m8k",
        'r' => "0e0m 0g2e6e7f",
        's' => "8f6e2e0g2i6i8k6m2m0l",
        't' => "4b4k6m7m 1e7e",
        'u' => "0e0k2m6m8k 8e8m",
        'v' => "0e4m8e",
        'w' => "0e2m4g6m8e",
        'x' => "0e8m 8e0m",
        'y' => "0e4m 8e2q",
        'z' => "0e8e0m8m",
        _ => "0a8a8m0m0a",
    }
}

/// The segments of a character, in units from its upper left corner; both ends of a dot are equal.
pub(crate) fn segments(c: char) -> impl Iterator<Item = [[f64; 2]; 2]> {
    strokes_of(c).split(' ').filter(|stroke| !stroke.is_empty()).flat_map(|stroke| {
        let bytes = stroke.as_bytes();
        let point = move |i: usize| {
            let unit = |byte: u8, zero: u8| 0.5 + 0.5 * f64::from(byte.saturating_sub(zero));
            [unit(bytes[2 * i], b'0'), unit(bytes[2 * i + 1], b'a')]
        };
        let count = bytes.len() / 2;
        (0..count.saturating_sub(1).max(1)).map(move |i| [point(i), point((i + 1).min(count - 1))])
    })
}

/// Width of a text, units.
pub(crate) fn width(text: &str) -> f64 {
    (text.chars().count() as f64 * ADVANCE - 1.0).max(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;

    const DRAWN: &str = " !\"#%&'()*+,-–−./0123456789:;<=>?@[\\]_|~×±·…°²³\
        ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz";

    #[test]
    fn no_two_characters_look_alike() {
        let mut seen = BTreeMap::new();
        for c in DRAWN.chars() {
            assert_ne!(strokes_of(c), strokes_of('\u{1}'), "{c} is not drawn");
            if let Some(other) = seen.insert(strokes_of(c), c) {
                panic!("{c} looks like {other}");
            }
        }
    }

    #[test]
    fn strokes_stay_within_their_character() {
        for c in DRAWN.chars() {
            let points: Vec<[f64; 2]> = segments(c).flatten().collect();
            let is_inside =
                |[x, y]: &[f64; 2]| (0.5..=ADVANCE - 1.5).contains(x) && (0.5..=HEIGHT + 1.5).contains(y);
            assert!(points.iter().all(is_inside), "{c}: {points:?}");
            let pairs = strokes_of(c).split(' ').all(|stroke| stroke.len().is_multiple_of(2));
            assert!(pairs && points.is_empty() == (c == ' '), "{c}");
        }
        assert_eq!(segments('L').collect::<Vec<_>>(), [[[0.5, 0.5], [0.5, 6.5]], [[0.5, 6.5], [4.5, 6.5]]]);
        assert_eq!(segments('.').collect::<Vec<_>>(), [[[2.5, 6.5], [2.5, 6.5]]]);
    }
}
