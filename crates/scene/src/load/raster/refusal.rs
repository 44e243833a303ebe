//! Why a raster cannot be used.

use super::error::RasterError;
use crate::builder::{PartSource, SceneBuilder};
use crate::text::is_wrong_name;
use std::borrow::Cow;
use std::io;
use std::path::PathBuf;
use vlscan_base::diag::{Place, ProblemKind};
use vlscan_base::error::{Error, Result};

/// Why a raster cannot be used.
pub(super) enum Refusal {
    /// The file cannot be opened.
    Unread(PathBuf, io::Error),
    /// The file was changed or removed while it was being read.
    Changed(PathBuf, io::Error),
    /// Problem of a file, and its solution.
    Unusable(PathBuf, Box<RasterError>, Cow<'static, str>),
    /// Incompatibility of two files, and its remedy.
    Apart(String, &'static str),
}

impl Refusal {
    /// A problem of a file without a known solution.
    pub fn unusable(path: PathBuf, problem: RasterError) -> Refusal {
        Refusal::Unusable(path, Box::new(problem), "".into())
    }

    /// Reports it as an error of the part, at `place` if it has a place.
    pub fn report(self, scene: &mut SceneBuilder, part: &PartSource, place: Option<Place>) -> Result<()> {
        let mut kind = ProblemKind::Invalid;
        let (message, help, problem) = match self {
            Refusal::Unread(path, e) if is_wrong_name(&e) => {
                kind = (&e).into();
                let message = format!("cannot read {}: {e}", path.display());
                (message, Cow::Borrowed(""), Some(RasterError::Io(e)))
            }
            Refusal::Unread(path, e) | Refusal::Changed(path, e) => return Err(Error::io("read", &path, e)),
            Refusal::Unusable(path, problem, help) => {
                (format!("cannot read the raster {}: {problem}", path.display()), help, Some(*problem))
            }
            Refusal::Apart(message, help) => (message, help.into(), None),
        };
        let error = scene.diagnostics.error(place.or_else(|| part.place.cloned()), message);
        if let Some(problem) = problem {
            error.because_of(problem);
        }
        if kind != ProblemKind::Invalid {
            error.of_kind(kind);
        }
        if !help.is_empty() {
            error.help(help);
        }
        Ok(())
    }
}
