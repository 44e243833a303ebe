//! The error about a cloud that has too many cells: where its points are, and what to type.

use std::path::Path;
use vlscan_base::error::Error;
use vlscan_base::quantity::number;
use vlscan_formats::StrayFinder;
use vlscan_geom::Aabb;

/// The name of a cloud in a command to type: its quoted file, or a word for others.
pub(crate) fn in_command(clouds: &[&Path]) -> String {
    match clouds {
        [file] if file.is_file() => format!("'{}'", file.display()),
        _ => "CLOUD".to_owned(),
    }
}

/// The error about points that need too many square cells, as set by `--cell`. The help leaves out points
/// that lie apart from the file `input`, or states cells that are large enough.
pub(crate) fn too_many_cells(
    (name, input): (&str, &str),
    [columns, rows]: [f64; 2],
    side: f64,
    max_cells: f64,
    points: &StrayFinder,
) -> Error {
    let message = format!(
        "{name}: {columns:.0} by {rows:.0} cells of {side} m (--cell), expected at most {max_cells}; {}",
        points.described_extent()
    );
    // A part of a cell at the ends counts as one.
    let larger = number(rounded_up(1.01 * side * (columns * rows / max_cells).sqrt()));
    let help = match points.apart() {
        Some(apart) => {
            let Aabb { min, max } = apart.others;
            format!(
                "leave out the points that lie apart, for example: pdal translate {input} near.laz crop \
                 --filters.crop.bounds=\"([{:.0}, {:.0}], [{:.0}, {:.0}])\", or take larger cells: --cell \
                 {larger}",
                min.x.floor(),
                max.x.ceil(),
                min.y.floor(),
                max.y.ceil()
            )
        }
        None => format!("take larger cells: --cell {larger}"),
    };
    Error::input_with_help(message, help)
}

/// The next larger number with one digit.
fn rounded_up(value: f64) -> f64 {
    let step = 10f64.powi(value.log10().floor() as i32);
    (value / step).ceil() * step
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_are_rounded_up_to_one_digit() {
        for (value, expected) in [(1.01, 2.0), (2.0, 2.0), (0.31, 0.4), (93.0, 100.0)] {
            assert!((rounded_up(value) - expected).abs() < 1e-9, "{value}");
        }
    }
}
