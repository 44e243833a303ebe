//! Linear equations: least squares by Cholesky's decomposition, small general systems by elimination.

/// Symmetric matrix; only the lower triangle is stored, by rows.
#[derive(Clone, Debug, PartialEq)]
pub struct SymmetricMatrix {
    size: usize,
    lower: Vec<f64>,
}

/// Index of row `i`, column `j` of a lower triangle, for `j` ≤ `i`.
fn index(i: usize, j: usize) -> usize {
    i * (i + 1) / 2 + j
}

impl SymmetricMatrix {
    /// Matrix of zeros with `size` rows and columns.
    pub fn zeros(size: usize) -> SymmetricMatrix {
        SymmetricMatrix { size, lower: vec![0.0; index(size, 0)] }
    }

    /// Number of rows and columns.
    pub fn size(&self) -> usize {
        self.size
    }

    /// Element in row `i` and column `j`.
    pub fn at(&self, i: usize, j: usize) -> f64 {
        self.lower[index(i.max(j), i.min(j))]
    }

    /// Adds `value` to the element in row `i` and column `j` and to its mirror image.
    pub fn add(&mut self, i: usize, j: usize, value: f64) {
        self.lower[index(i.max(j), i.min(j))] += value;
    }

    /// Adds `weight` times the product of a vector with itself.
    pub fn add_square(&mut self, vector: &[f64], weight: f64) {
        let mut elements = self.lower.iter_mut();
        for (i, a) in vector.iter().enumerate().take(self.size) {
            for (b, element) in vector[..=i].iter().zip(elements.by_ref()) {
                *element += weight * a * b;
            }
        }
    }

    /// Adds a matrix of the same size.
    pub fn add_matrix(&mut self, other: &SymmetricMatrix) {
        self.lower.iter_mut().zip(&other.lower).for_each(|(element, other)| *element += other);
    }

    /// Matrix of the rows and columns with these indices.
    pub fn principal(&self, indices: &[usize]) -> SymmetricMatrix {
        let mut part = SymmetricMatrix::zeros(indices.len());
        for (i, row) in indices.iter().enumerate() {
            for (j, column) in indices.iter().enumerate().take(i + 1) {
                part.add(i, j, self.at(*row, *column));
            }
        }
        part
    }

    /// Cholesky's decomposition; `None` if a pivot is not larger than `min_pivot`, as those of a positive
    /// definite matrix are for 0.
    pub fn cholesky(&self, min_pivot: f64) -> Option<Cholesky> {
        let mut lower = self.lower.clone();
        for i in 0..self.size {
            for j in 0..=i {
                let mut sum = lower[index(i, j)];
                for k in 0..j {
                    sum -= lower[index(i, k)] * lower[index(j, k)];
                }
                lower[index(i, j)] = match i == j {
                    true if sum.is_nan() || sum <= min_pivot => return None,
                    true => sum.sqrt(),
                    false => sum / lower[index(j, j)],
                };
            }
        }
        Some(Cholesky { size: self.size, lower })
    }

    /// Cholesky's decomposition after rows and columns are scaled to a diagonal of 1, to which `damping` is
    /// added, for unknowns of different units; `None` if a pivot is not larger than `min_pivot`.
    pub fn scaled_cholesky(&self, damping: f64, min_pivot: f64) -> Option<ScaledCholesky> {
        let scale: Vec<f64> =
            (0..self.size).map(|k| 1.0 / self.at(k, k).max(f64::MIN_POSITIVE).sqrt()).collect();
        let mut scaled = SymmetricMatrix::zeros(self.size);
        for i in 0..self.size {
            for j in 0..=i {
                scaled.add(i, j, self.at(i, j) * scale[i] * scale[j]);
            }
            scaled.add(i, i, damping);
        }
        Some(ScaledCholesky { decomposition: scaled.cholesky(min_pivot)?, scale })
    }
}

/// Cholesky's decomposition of a symmetric, positive definite matrix into a lower triangle and its transpose.
#[derive(Clone, Debug)]
pub struct Cholesky {
    size: usize,
    lower: Vec<f64>,
}

impl Cholesky {
    /// Solution for the right side `right`.
    ///
    /// # Panics
    /// If `right` is shorter than the matrix.
    pub fn solve(&self, right: &[f64]) -> Vec<f64> {
        let mut x = right[..self.size].to_vec();
        for i in 0..self.size {
            for k in 0..i {
                x[i] -= self.lower[index(i, k)] * x[k];
            }
            x[i] /= self.lower[index(i, i)];
        }
        for i in (0..self.size).rev() {
            for k in i + 1..self.size {
                x[i] -= self.lower[index(k, i)] * x[k];
            }
            x[i] /= self.lower[index(i, i)];
        }
        x
    }

    /// Inverse of the matrix.
    pub fn inverse(&self) -> SymmetricMatrix {
        let mut inverse = SymmetricMatrix::zeros(self.size);
        for j in 0..self.size {
            let mut unit = vec![0.0; self.size];
            unit[j] = 1.0;
            for (i, value) in self.solve(&unit).into_iter().enumerate().skip(j) {
                inverse.add(i, j, value);
            }
        }
        inverse
    }
}

/// Decomposition of a matrix whose rows and columns were scaled to a diagonal of 1.
#[derive(Clone, Debug)]
pub struct ScaledCholesky {
    decomposition: Cholesky,
    scale: Vec<f64>,
}

impl ScaledCholesky {
    /// Solution for the right side `right`, in the units of the matrix that was scaled.
    ///
    /// # Panics
    /// If `right` is shorter than the matrix.
    pub fn solve(&self, right: &[f64]) -> Vec<f64> {
        let scaled: Vec<f64> = right.iter().zip(&self.scale).map(|(value, scale)| value * scale).collect();
        let solution = self.decomposition.solve(&scaled);
        solution.into_iter().zip(&self.scale).map(|(value, scale)| value * scale).collect()
    }

    /// Inverse of the damped matrix, in its units.
    pub fn inverse(&self) -> SymmetricMatrix {
        let mut inverse = self.decomposition.inverse();
        for i in 0..self.scale.len() {
            for j in 0..=i {
                inverse.lower[index(i, j)] *= self.scale[i] * self.scale[j];
            }
        }
        inverse
    }
}

/// Normal equations of weighted linear least squares.
#[derive(Clone, Debug)]
pub struct LeastSquares {
    /// Sum of the products of derivatives.
    pub matrix: SymmetricMatrix,
    /// Sum of the products of derivatives and values.
    pub right: Vec<f64>,
}

impl LeastSquares {
    /// Equations of `unknowns` unknowns without observations.
    pub fn new(unknowns: usize) -> LeastSquares {
        LeastSquares { matrix: SymmetricMatrix::zeros(unknowns), right: vec![0.0; unknowns] }
    }

    /// Adds an observation: its derivatives by the unknowns, its value and its weight.
    pub fn add(&mut self, derivatives: &[f64], value: f64, weight: f64) {
        self.matrix.add_square(derivatives, weight);
        self.right.iter_mut().zip(derivatives).for_each(|(sum, by)| *sum += weight * value * by);
    }

    /// Adds the observations of other equations of the same unknowns.
    pub fn add_sums(&mut self, other: &LeastSquares) {
        self.matrix.add_matrix(&other.matrix);
        self.right.iter_mut().zip(&other.right).for_each(|(sum, other)| *sum += other);
    }

    /// Unknowns with the smallest weighted sum of squared residuals; `None` if the observations do not
    /// determine them.
    pub fn solution(&self) -> Option<Vec<f64>> {
        let solution = self.matrix.scaled_cholesky(0.0, 0.0)?.solve(&self.right);
        solution.iter().all(|value| value.is_finite()).then_some(solution)
    }
}

/// Solution of `matrix` · x = `right` by elimination with partial pivoting; `None` if a pivot is exactly
/// zero.
pub fn solve_by_elimination<const N: usize>(
    mut matrix: [[f64; N]; N],
    mut right: [f64; N],
) -> Option<[f64; N]> {
    for column in 0..N {
        let mut pivot = column;
        for row in column + 1..N {
            if matrix[row][column].abs() > matrix[pivot][column].abs() {
                pivot = row;
            }
        }
        if matrix[pivot][column] == 0.0 {
            return None;
        }
        matrix.swap(column, pivot);
        right.swap(column, pivot);
        for row in column + 1..N {
            let factor = matrix[row][column] / matrix[column][column];
            let pivot_row = matrix[column];
            for (value, above) in matrix[row].iter_mut().zip(pivot_row).skip(column) {
                *value -= factor * above;
            }
            right[row] -= factor * right[column];
        }
    }
    let mut solution = [0.0; N];
    for row in (0..N).rev() {
        let known: f64 = (row + 1..N).map(|k| matrix[row][k] * solution[k]).sum();
        solution[row] = (right[row] - known) / matrix[row][row];
    }
    Some(solution)
}

/// Median; the mean of the two middle values of an even number of values, `None` for none. NaN counts as
/// larger than all numbers, or as smaller if its sign is negative.
pub fn median(values: impl IntoIterator<Item = f64>) -> Option<f64> {
    let mut values: Vec<f64> = values.into_iter().collect();
    let count = values.len();
    if count == 0 {
        return None;
    }
    let (below, upper, _) = values.select_nth_unstable_by(count / 2, f64::total_cmp);
    let upper = *upper;
    let lower = below.iter().copied().max_by(f64::total_cmp).filter(|_| count.is_multiple_of(2));
    Some(lower.map_or(upper, |lower| 0.5 * (lower + upper)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Product of a symmetric matrix and a vector.
    fn product(matrix: &SymmetricMatrix, x: &[f64]) -> Vec<f64> {
        (0..matrix.size()).map(|i| (0..x.len()).map(|j| matrix.at(i, j) * x[j]).sum()).collect()
    }

    #[test]
    fn a_worked_example_is_solved() {
        // 4 12 −16; 12 37 −43; −16 −43 98 is the square of 2; 6 1; −8 5 3.
        let mut matrix = SymmetricMatrix::zeros(3);
        for (i, j, value) in
            [(0, 0, 4.0), (1, 0, 12.0), (1, 1, 37.0), (0, 2, -16.0), (2, 1, -43.0), (2, 2, 98.0)]
        {
            matrix.add(i, j, value);
        }
        let decomposition = matrix.cholesky(0.0).unwrap();
        assert_eq!(decomposition.lower, [2.0, 6.0, 1.0, -8.0, 5.0, 3.0]);
        assert_eq!(decomposition.solve(&[-20.0, -43.0, 192.0]), [1.0, 2.0, 3.0]);
        let general = [[4.0, 12.0, -16.0], [12.0, 37.0, -43.0], [-16.0, -43.0, 98.0]];
        let x = solve_by_elimination(general, [-20.0, -43.0, 192.0]).unwrap();
        assert!(x.iter().zip([1.0, 2.0, 3.0]).all(|(x, expected)| (x - expected).abs() < 1e-10), "{x:?}");
    }

    #[test]
    fn matrices_that_are_not_positive_definite_have_no_decomposition() {
        let mut singular = SymmetricMatrix::zeros(2);
        singular.add_square(&[1.0, 2.0], 4.0);
        assert!(singular.cholesky(0.0).is_none() && singular.scaled_cholesky(0.0, 1e-12).is_none());
        assert!(singular.scaled_cholesky(1e-3, 0.0).is_some());
        let mut unknown = SymmetricMatrix::zeros(1);
        unknown.add(0, 0, f64::NAN);
        assert!(unknown.cholesky(0.0).is_none());
        assert!(SymmetricMatrix::zeros(1).scaled_cholesky(0.0, 0.0).is_none());
        assert!(solve_by_elimination([[0.0, 1.0], [0.0, 2.0]], [1.0, 1.0]).is_none());
    }

    #[test]
    fn a_part_of_a_matrix_has_the_chosen_rows_and_columns() {
        let mut matrix = SymmetricMatrix::zeros(3);
        matrix.add_square(&[1.0, 10.0, 100.0], 2.0);
        let part = matrix.principal(&[2, 0]);
        assert_eq!((part.size(), part.at(0, 0), part.at(0, 1), part.at(1, 1)), (2, 20_000.0, 200.0, 2.0));
    }

    #[test]
    fn a_zero_on_the_diagonal_is_exchanged_by_elimination() {
        assert_eq!(solve_by_elimination([[0.0, 2.0], [4.0, 0.0]], [6.0, 8.0]), Some([2.0, 3.0]));
    }

    #[test]
    fn least_squares_weigh_observations_and_need_enough_of_them() {
        // A value seen as 1 with the weight 3 and as 5 with the weight 1.
        let mut mean = LeastSquares::new(1);
        mean.add(&[1.0], 1.0, 3.0);
        mean.add(&[1.0], 5.0, 1.0);
        assert_eq!(mean.solution(), Some(vec![2.0]));
        // Units that differ by many orders of magnitude.
        let mut line = LeastSquares::new(2);
        for k in 0..10 {
            line.add(&[1e9 * f64::from(k), 1e-6], 3.0 * 1e9 * f64::from(k) + 7.0 * 1e-6, 1.0);
        }
        let found = line.solution().unwrap();
        assert!((found[0] - 3.0).abs() < 1e-9, "{found:?}");
        let mut single = LeastSquares::new(2);
        single.add(&[1.0, 0.0], 1.0, 1.0);
        assert_eq!(single.solution(), None);
        // With those of another one.
        let mut other = LeastSquares::new(2);
        other.add(&[1.0, 2.0], 7.0, 1.0);
        single.add_sums(&other);
        let found = single.solution().unwrap();
        assert!((found[0] - 1.0).abs() < 1e-12 && (found[1] - 3.0).abs() < 1e-12, "{found:?}");
    }

    #[test]
    fn medians_are_the_middle_of_values() {
        assert_eq!(median([3.0, 1.0, 2.0]), Some(2.0));
        assert_eq!(median([4.0, 1.0, 2.0, 8.0]), Some(3.0));
        assert_eq!(median(vec![5.0]), Some(5.0));
        assert_eq!(median([]), None);
        assert!(median([f64::NAN, 1.0]).unwrap().is_nan());
        assert_eq!(median([f64::NAN, 1.0, 2.0]), Some(2.0));
    }

    proptest! {
        #[test]
        fn solutions_meet_the_equations(
            rows in prop::collection::vec(prop::collection::vec(-3.0..3.0f64, 5), 8..20),
            x in prop::collection::vec(-9.0..9.0f64, 5),
        ) {
            // Weak observations of each unknown keep the matrix away from a singular one.
            let mut sums = LeastSquares::new(5);
            for (k, value) in x.iter().enumerate() {
                let unit: Vec<f64> = (0..5).map(|j| f64::from(u8::from(j == k))).collect();
                sums.add(&unit, *value, 0.1);
            }
            for row in &rows {
                sums.add(row, row.iter().zip(&x).map(|(a, b)| a * b).sum(), 1.0);
            }
            let found = sums.solution().unwrap();
            for (found, expected) in found.iter().zip(&x) {
                prop_assert!((found - expected).abs() < 1e-8, "{found} is not {expected}");
            }
            let plain = sums.matrix.cholesky(0.0).unwrap();
            let general: [[f64; 5]; 5] =
                std::array::from_fn(|i| std::array::from_fn(|j| sums.matrix.at(i, j)));
            let right: [f64; 5] = std::array::from_fn(|k| sums.right[k]);
            let by_elimination = solve_by_elimination(general, right).unwrap();
            for (a, b) in plain.solve(&sums.right).iter().zip(by_elimination) {
                prop_assert!((a - b).abs() < 1e-8, "{a} {b}");
            }
            let scaled = sums.matrix.scaled_cholesky(0.0, 0.0).unwrap();
            for inverse in [plain.inverse(), scaled.inverse()] {
                let back = product(&sums.matrix, &product(&inverse, &x));
                for (back, expected) in back.iter().zip(&x) {
                    prop_assert!((back - expected).abs() < 1e-7, "{back} is not {expected}");
                }
            }
        }

        #[test]
        fn half_of_the_values_lie_on_either_side_of_the_median(
            values in prop::collection::vec(-1e3..1e3f64, 1..40),
        ) {
            let middle = median(values.iter().copied()).unwrap();
            let below = values.iter().filter(|value| **value < middle).count();
            let above = values.iter().filter(|value| **value > middle).count();
            prop_assert!(2 * below <= values.len() && 2 * above <= values.len());
        }
    }
}
