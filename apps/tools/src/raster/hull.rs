//! The convex hull of cells, as the columns of each row that it covers.

/// Columns from the first to the last centre of a cell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct RowSpan {
    first: f64,
    last: f64,
}

impl RowSpan {
    /// True if the centre of a column is within the span.
    pub fn contains(self, column: f64) -> bool {
        /// Room for rounding on an edge.
        const ROOM: f64 = 1e-9;
        column >= self.first - ROOM && column <= self.last + ROOM
    }
}

/// The columns that the convex hull of the centres of cells covers in each row, from the first and last cell
/// of the rows that have any.
pub(super) fn row_spans(ends: &[Option<[i64; 2]>]) -> Vec<RowSpan> {
    let of = |side: usize, sign: f64| {
        let points: Vec<[f64; 2]> = (0..)
            .zip(ends)
            .filter_map(|(row, ends)| Some([row as f64, sign * (*ends)?[side] as f64]))
            .collect();
        let values = lower_envelope(&points, ends.len());
        values.into_iter().map(move |value| sign * value)
    };
    of(0, 1.0).zip(of(1, -1.0)).map(|(first, last)| RowSpan { first, last }).collect()
}

/// The greatest convex function below points of ascending abscissa, at each whole abscissa below `count`;
/// infinite before the first and behind the last point. By the chain of Andrew (1979).
fn lower_envelope(points: &[[f64; 2]], count: usize) -> Vec<f64> {
    let mut chain: Vec<[f64; 2]> = Vec::new();
    for p in points {
        while let [.., a, b] = chain[..]
            && (b[0] - a[0]) * (p[1] - a[1]) <= (b[1] - a[1]) * (p[0] - a[0])
        {
            chain.pop();
        }
        chain.push(*p);
    }
    let mut values = vec![f64::INFINITY; count];
    if let [[at, value]] = chain[..] {
        values[at as usize] = value;
    }
    for pair in chain.windows(2) {
        let [a, b] = [pair[0], pair[1]];
        let (first, last) = (a[0] as usize, b[0] as usize);
        for (at, value) in (first..=last).zip(&mut values[first..=last]) {
            *value = a[1] + (b[1] - a[1]) * (at as f64 - a[0]) / (b[0] - a[0]);
        }
    }
    values
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_within_the_hull_are_spanned() {
        // A wedge with a hole, and a row that sticks out.
        let ends = [Some([4, 4]), None, Some([3, 5]), Some([0, 5]), Some([2, 2])];
        let spans = row_spans(&ends);
        let covers = |row: usize| {
            (0..8).filter(|column| spans[row].contains(f64::from(*column))).collect::<Vec<i32>>()
        };
        assert_eq!(covers(0), [4]);
        assert_eq!(covers(1), [3, 4]);
        assert_eq!(covers(2), [2, 3, 4, 5]);
        assert_eq!(covers(3), [0, 1, 2, 3, 4, 5]);
        assert_eq!(covers(4), [2]);
        assert!(row_spans(&[Some([2, 2])])[0].contains(2.0));
        assert!(!row_spans(&[None, Some([2, 2])])[0].contains(2.0));
    }
}
