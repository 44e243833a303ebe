//! Text in aligned columns.

/// Side of a column on which its text begins or ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// Text begins at the left.
    Left,
    /// Text ends at the right.
    Right,
}

/// Formats lines in aligned columns, two spaces apart. The first column is aligned at its left, all others at
/// `side`.
pub fn aligned(lines: &[Vec<String>], side: Side) -> String {
    let columns = lines.iter().map(Vec::len).max().unwrap_or(0);
    let width =
        |at: usize| lines.iter().filter_map(|l| l.get(at)).map(|c| c.chars().count()).max().unwrap_or(0);
    let widths: Vec<usize> = (0..columns).map(width).collect();
    let mut text = String::new();
    for line in lines {
        let cells = line.iter().zip(&widths).enumerate().map(|(at, (cell, &width))| match side {
            Side::Right if at > 0 => format!("{cell:>width$}"),
            _ => format!("{cell:width$}"),
        });
        text.push_str(cells.collect::<Vec<_>>().join("  ").trim_end());
        text.push('\n');
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_are_aligned() {
        let lines = [["a", "∞", "c"].map(str::to_owned).to_vec(), ["long", "12"].map(str::to_owned).to_vec()];
        assert_eq!(aligned(&lines, Side::Left), "a     ∞   c\nlong  12\n");
        assert_eq!(aligned(&lines, Side::Right), "a      ∞  c\nlong  12\n");
    }
}
