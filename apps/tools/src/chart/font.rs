//! A font of 5 × 7 dots.

/// Distance from one character to the next, dots.
pub(crate) const ADVANCE: u32 = 6;
/// Height of the capitals, dots; descenders take two more rows below.
pub(crate) const HEIGHT: u32 = 7;

/// The dots of a character: seven rows of five (bit 4 is the leftmost), and the number of rows that it
/// extends below the baseline. Characters without a glyph are drawn as a box.
pub(crate) fn glyph(c: char) -> ([u8; 7], u32) {
    let rows = |bits: [u8; 7]| (bits, 0);
    let hanging = |bits: [u8; 7]| (bits, 2);
    match c {
        ' ' => rows([0, 0, 0, 0, 0, 0, 0]),
        '!' => rows([4, 4, 4, 4, 4, 0, 4]),
        '"' => rows([10, 10, 0, 0, 0, 0, 0]),
        '#' => rows([10, 31, 10, 10, 10, 31, 10]),
        '%' => rows([25, 25, 2, 4, 8, 19, 19]),
        '&' => rows([12, 18, 20, 8, 21, 18, 13]),
        '\'' => rows([4, 4, 0, 0, 0, 0, 0]),
        '(' => rows([2, 4, 4, 4, 4, 4, 2]),
        ')' => rows([8, 4, 4, 4, 4, 4, 8]),
        '*' => rows([0, 10, 4, 31, 4, 10, 0]),
        '+' => rows([0, 4, 4, 31, 4, 4, 0]),
        ',' => hanging([0, 0, 0, 0, 4, 4, 8]),
        '-' => rows([0, 0, 0, 14, 0, 0, 0]),
        '–' => rows([0, 0, 0, 31, 0, 0, 0]),
        '.' => rows([0, 0, 0, 0, 0, 0, 4]),
        '/' => rows([1, 1, 2, 4, 8, 16, 16]),
        '0' => rows([14, 17, 17, 17, 17, 17, 14]),
        '1' => rows([4, 12, 20, 4, 4, 4, 31]),
        '2' => rows([14, 17, 1, 6, 8, 16, 31]),
        '3' => rows([14, 17, 1, 6, 1, 17, 14]),
        '4' => rows([3, 5, 9, 17, 31, 1, 1]),
        '5' => rows([31, 16, 30, 1, 1, 17, 14]),
        '6' => rows([6, 8, 16, 30, 17, 17, 14]),
        '7' => rows([31, 1, 2, 2, 4, 4, 4]),
        '8' => rows([14, 17, 17, 14, 17, 17, 14]),
        '9' => rows([14, 17, 17, 15, 1, 2, 12]),
        ':' => rows([0, 0, 4, 0, 0, 4, 0]),
        '=' => rows([0, 0, 31, 0, 31, 0, 0]),
        '<' => rows([0, 2, 4, 8, 4, 2, 0]),
        '>' => rows([0, 8, 4, 2, 4, 8, 0]),
        '?' => rows([14, 17, 1, 2, 4, 0, 4]),
        '_' => rows([0, 0, 0, 0, 0, 0, 31]),
        '×' => rows([0, 17, 10, 4, 10, 17, 0]),
        '·' => rows([0, 0, 0, 4, 0, 0, 0]),
        '°' => rows([6, 9, 6, 0, 0, 0, 0]),
        'A' => rows([4, 10, 17, 17, 31, 17, 17]),
        'B' => rows([30, 17, 17, 30, 17, 17, 30]),
        'C' => rows([14, 17, 16, 16, 16, 17, 14]),
        'D' => rows([28, 18, 17, 17, 17, 18, 28]),
        'E' => rows([31, 16, 16, 30, 16, 16, 31]),
        'F' => rows([31, 16, 16, 30, 16, 16, 16]),
        'G' => rows([14, 17, 16, 19, 17, 17, 14]),
        'H' => rows([17, 17, 17, 31, 17, 17, 17]),
        'I' => rows([14, 4, 4, 4, 4, 4, 14]),
        'J' => rows([7, 1, 1, 1, 1, 17, 14]),
        'K' => rows([17, 18, 20, 24, 20, 18, 17]),
        'L' => rows([16, 16, 16, 16, 16, 16, 31]),
        'M' => rows([17, 27, 21, 21, 17, 17, 17]),
        'N' => rows([17, 25, 25, 21, 19, 19, 17]),
        'O' => rows([14, 17, 17, 17, 17, 17, 14]),
        'P' => rows([30, 17, 17, 30, 16, 16, 16]),
        'Q' => rows([14, 17, 17, 17, 21, 18, 13]),
        'R' => rows([30, 17, 17, 30, 20, 18, 17]),
        'S' => rows([15, 16, 16, 14, 1, 1, 30]),
        'T' => rows([31, 4, 4, 4, 4, 4, 4]),
        'U' => rows([17, 17, 17, 17, 17, 17, 14]),
        'V' => rows([17, 17, 17, 17, 10, 10, 4]),
        'W' => rows([17, 17, 17, 21, 21, 21, 10]),
        'X' => rows([17, 17, 10, 4, 10, 17, 17]),
        'Y' => rows([17, 17, 10, 4, 4, 4, 4]),
        'Z' => rows([31, 1, 2, 4, 8, 16, 31]),
        'a' => rows([0, 0, 14, 1, 15, 17, 15]),
        'b' => rows([16, 16, 30, 17, 17, 17, 30]),
        'c' => rows([0, 0, 15, 16, 16, 16, 15]),
        'd' => rows([1, 1, 15, 17, 17, 17, 15]),
        'e' => rows([0, 0, 14, 17, 31, 16, 15]),
        'f' => rows([6, 8, 8, 30, 8, 8, 8]),
        'g' => hanging([15, 17, 17, 17, 15, 1, 14]),
        'h' => rows([16, 16, 30, 17, 17, 17, 17]),
        'i' => rows([4, 0, 12, 4, 4, 4, 14]),
        'j' => hanging([2, 0, 2, 2, 2, 18, 12]),
        'k' => rows([16, 16, 18, 20, 24, 20, 18]),
        'l' => rows([12, 4, 4, 4, 4, 4, 6]),
        'm' => rows([0, 0, 26, 21, 21, 21, 21]),
        'n' => rows([0, 0, 30, 17, 17, 17, 17]),
        'o' => rows([0, 0, 14, 17, 17, 17, 14]),
        'p' => hanging([30, 17, 17, 17, 30, 16, 16]),
        'q' => hanging([15, 17, 17, 17, 15, 1, 1]),
        'r' => rows([0, 0, 22, 25, 16, 16, 16]),
        's' => rows([0, 0, 15, 16, 14, 1, 30]),
        't' => rows([8, 8, 30, 8, 8, 8, 6]),
        'u' => rows([0, 0, 17, 17, 17, 17, 15]),
        'v' => rows([0, 0, 17, 17, 17, 10, 4]),
        'w' => rows([0, 0, 17, 21, 21, 21, 10]),
        'x' => rows([0, 0, 17, 10, 4, 10, 17]),
        'y' => hanging([17, 17, 17, 17, 15, 1, 14]),
        'z' => rows([0, 0, 31, 2, 4, 8, 31]),
        _ => rows([31, 17, 17, 17, 17, 17, 31]),
    }
}

/// Width of a text, dots.
pub(crate) fn width(text: &str) -> u32 {
    (text.chars().count() as u32 * ADVANCE).saturating_sub(1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;

    #[test]
    fn no_two_characters_look_alike() {
        let drawn = " !\"#%&'()*+,-–./0123456789:=<>?_×·°ABCDEFGHIJKLMNPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz";
        let mut seen = BTreeMap::new();
        for c in drawn.chars() {
            let dots = glyph(c);
            assert!(dots.0.iter().all(|row| *row < 32), "{c}");
            assert_ne!(dots, glyph('\u{1}'), "{c} is not drawn");
            if let Some(other) = seen.insert(dots, c) {
                panic!("{c} looks like {other}");
            }
        }
    }
}
