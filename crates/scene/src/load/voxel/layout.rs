//! Assignment of the columns of a file to the attributes of a voxel.

use crate::text::{Line, Problems, Words, shown};
use vlscan_base::diag::nearest;

/// Number of columns of a voxel in files that do not name them, and two of these columns.
const COLUMNS: usize = 16;
const DENSITY: usize = 3;
const TRANSMITTANCE: usize = 13;
/// Names of plant area density, in small letters: of the versions of AMAPVox, and of programs that write its
/// format.
const DENSITY_NAMES: [&str; 4] = ["padbvtotal", "pad", "plant_area_density", "padbfltotal"];
const TRANSMITTANCE_NAMES: [&str; 2] = ["transmittance", "transmittance_tmp"];

/// The columns of a voxel.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Layout {
    /// Minimum number of columns.
    pub count: usize,
    pub index: [usize; 3],
    pub density: usize,
    /// `None` in files that do not have it.
    pub transmittance: Option<usize>,
}

/// A column that is missing.
#[derive(Debug, thiserror::Error)]
enum MissingColumn {
    #[error("no column of cells ({0})")]
    Cells(&'static str),
    #[error("no column of plant area density (PadBVTotal)")]
    Density,
}

impl Layout {
    /// The layout of files that do not name their columns.
    pub const UNNAMED: Layout =
        Layout { count: COLUMNS, index: [0, 1, 2], density: DENSITY, transmittance: Some(TRANSMITTANCE) };

    /// The layout by the line that names the columns.
    fn of_names(names: &[String]) -> Result<Layout, MissingColumn> {
        let column =
            |known: &[&str]| known.iter().find_map(|known| names.iter().position(|name| name == known));
        let cells = |name: &'static str| column(&[name]).ok_or(MissingColumn::Cells(name));
        let other_density = || {
            let mut others = (0..names.len()).filter(|&i| names[i].starts_with("pad"));
            others.next().filter(|_| others.next().is_none())
        };
        let density = column(&DENSITY_NAMES).or_else(other_density);
        Ok(Layout {
            count: names.len(),
            index: [cells("i")?, cells("j")?, cells("k")?],
            density: density.ok_or(MissingColumn::Density)?,
            transmittance: column(&TRANSMITTANCE_NAMES),
        })
    }

    /// The columns by the line of their names; `None` after an error.
    pub fn read(line: &Line, problems: &mut Problems) -> Option<Layout> {
        let at = line.start..line.start + line.text.len();
        let names: Vec<String> =
            Words::new(&line.text, 0).map(|(word, _)| shown(word).to_lowercase()).collect();
        let names: Vec<String> = names.into_iter().map(|name| name.trim_matches('"').to_owned()).collect();
        if names.first().is_none_or(|name| name != "i") && names.iter().all(|name| name != "k") {
            problems.warn(line.number, at, || {
                format!(
                    "the columns are not named (i j k ...); column {} is taken as plant area density, column \
                     {} as transmittance",
                    DENSITY + 1,
                    TRANSMITTANCE + 1
                )
            });
            return Some(Layout::UNNAMED);
        }
        match Layout::of_names(&names) {
            Ok(layout) => {
                let used = &names[layout.density];
                // Other programs have other names, such as pad_capped.
                let is_misspelt = !DENSITY_NAMES.contains(&used.as_str());
                if is_misspelt && nearest(used, DENSITY_NAMES).is_some() {
                    problems.warn(line.number, at.clone(), || {
                        format!("no column is named PadBVTotal; \"{used}\" is read as plant area density")
                    });
                }
                let twice = [Some(layout.density), layout.transmittance].into_iter().flatten();
                for name in twice.chain(layout.index).map(|column| &names[column]) {
                    if names.iter().filter(|other| *other == name).count() > 1 {
                        problems.warn(line.number, at.clone(), || {
                            format!("the column \"{name}\" is named twice; the first one is read")
                        });
                    }
                }
                Some(layout)
            }
            Err(missing) => {
                let has_attenuation = names.iter().any(|name| name.starts_with("attenuation"));
                let hint = if has_attenuation {
                    "; plantAreaDensity of the R package AMAPVox computes it from attenuation or \
                     transmittance"
                } else {
                    ""
                };
                problems.error(line.number, at, || format!("the voxels have {missing}{hint}"));
                None
            }
        }
    }
}
