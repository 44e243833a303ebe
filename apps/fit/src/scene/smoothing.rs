//! Means of voxels over neighbouring columns, at the same height over the ground.

use rayon::prelude::*;

/// Writes means of `values` over 3 by 3 columns, with the weights 1, 2, 1 along x and y, to `means`. Values
/// are in the order of x, y, z; `ground` is the number of the voxel at the ground of each column.
pub(super) fn smoothed([nx, ny, nz]: [usize; 3], ground: &[i32], values: &[f32], means: &mut [f32]) {
    let slabs = means.par_chunks_mut(ny * nz).enumerate();
    slabs.for_each_init(
        || vec![0.0; ny * nz],
        |along_x, (i, means)| {
            let column_at = |column: usize| &values[column * nz..(column + 1) * nz];
            for (j, means) in along_x.chunks_mut(nz).enumerate() {
                let column = i * ny + j;
                let beside = [(i > 0).then(|| column - ny), (i + 1 < nx).then(|| column + ny)];
                write_means(column_at, ground, (column, beside), means);
            }
            let column_at = |column: usize| &along_x[(column - i * ny) * nz..(column - i * ny + 1) * nz];
            for (j, means) in means.chunks_mut(nz).enumerate() {
                let column = i * ny + j;
                let beside = [(j > 0).then(|| column - 1), (j + 1 < ny).then(|| column + 1)];
                write_means(column_at, ground, (column, beside), means);
            }
        },
    );
}

/// Writes means of a column and of those beside it, at the same height over the ground.
fn write_means<'v>(
    column_at: impl Fn(usize) -> &'v [f32],
    ground: &[i32],
    (column, beside): (usize, [Option<usize>; 2]),
    means: &mut [f32],
) {
    let count = means.len() as i64;
    means.iter_mut().zip(column_at(column)).for_each(|(mean, value)| *mean = 0.5 * value);
    for other in beside.into_iter().flatten() {
        // The voxel of the same height over the ground is as many voxels higher there.
        let shift = i64::from(ground[other]) - i64::from(ground[column]);
        let [from, to] = [shift, shift + count].map(|end| end.clamp(0, count));
        if from < to {
            let others = &column_at(other)[from as usize..to as usize];
            let means = means[(from - shift) as usize..].iter_mut();
            means.zip(others).for_each(|(mean, value)| *mean += 0.25 * value);
        }
    }
}
