//! Changes of the materials of parts.

use crate::scene::{fields_of, indices, material};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict, PyString};
use vlscan::survey::{MaterialChange, MaterialChanges, Replaced};

/// Changes of the materials of a part, which its copies share.
#[pyclass(frozen, module = "vlscan")]
pub struct Changes(pub MaterialChanges);

#[pymethods]
impl Changes {
    /// No changes.
    #[new]
    fn new() -> Changes {
        Changes(MaterialChanges::default())
    }

    /// These changes and another one: of all primitives, of those whose material has a name, or of those with
    /// the indices in the bytes of unsigned 32-bit integers.
    fn then(&self, which: &Bound<'_, PyAny>, fields: &Bound<'_, PyDict>) -> PyResult<Changes> {
        let replaced = if which.is_none() {
            Replaced::All
        } else if let Ok(name) = which.extract::<String>() {
            Replaced::Named(name)
        } else {
            Replaced::Faces(indices(which.cast::<PyBytes>()?.as_bytes()))
        };
        let last = MaterialChange { replaced, material: material(fields)? };
        Ok(Changes(self.0.iter().cloned().chain([last]).collect()))
    }

    /// The arguments of the calls of [`Changes::then`] that make equal changes.
    #[allow(clippy::type_complexity, reason = "unpacked by the package")]
    fn parts<'py>(&self, py: Python<'py>) -> PyResult<Vec<(Bound<'py, PyAny>, Bound<'py, PyDict>)>> {
        let part = |change: &MaterialChange| {
            let which = match &change.replaced {
                Replaced::All => py.None().into_bound(py),
                Replaced::Named(name) => PyString::new(py, name).into_any(),
                Replaced::Faces(faces) => {
                    let bytes: Vec<u8> = faces.iter().flat_map(|index| index.to_le_bytes()).collect();
                    PyBytes::new(py, &bytes).into_any()
                }
            };
            Ok((which, fields_of(py, &change.material)?))
        };
        self.0.iter().map(part).collect()
    }
}
