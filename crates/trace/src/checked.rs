//! Geometries that are checked before a tree is built over them.

use super::{BuildOptions, Geometry, Tree};
use std::fmt;

/// A geometry with references out of range.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum GeometryError {
    /// A triangle with a vertex that does not exist.
    Vertex {
        /// Index of the triangle among the stored ones.
        triangle: usize,
        /// The number of the vertex.
        vertex: u32,
        /// Number of vertices.
        vertices: usize,
    },
    /// More primitives than 32 bits can number.
    TooMany(usize),
}

impl fmt::Display for GeometryError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            GeometryError::Vertex { triangle, vertex, vertices } => {
                write!(f, "triangle {triangle} has the vertex {vertex}, expected less than {vertices}")
            }
            GeometryError::TooMany(primitives) => {
                write!(f, "{primitives} primitives: expected less than {}", u32::MAX)
            }
        }
    }
}

impl std::error::Error for GeometryError {}

impl Geometry {
    /// Checks that all vertices of triangles exist and that primitives can be numbered.
    ///
    /// # Errors
    /// The first problem.
    pub fn check(&self) -> Result<(), GeometryError> {
        let vertices = self.vertices.len();
        for (triangle, corners) in self.triangles.iter().enumerate() {
            if let Some(&vertex) = corners.iter().find(|vertex| **vertex as usize >= vertices) {
                return Err(GeometryError::Vertex { triangle, vertex, vertices });
            }
        }
        match self.len() {
            primitives if primitives >= u32::MAX as usize => Err(GeometryError::TooMany(primitives)),
            _ => Ok(()),
        }
    }
}

impl Tree {
    /// [`Tree::build`] over a geometry that is [checked](Geometry::check) before.
    ///
    /// # Errors
    /// A geometry that is not valid.
    pub fn try_build(geometry: &Geometry, options: &BuildOptions) -> Result<Tree, GeometryError> {
        geometry.check()?;
        Ok(Tree::build(geometry, options))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use vlscan_geom::DVec3;

    #[test]
    fn a_vertex_that_does_not_exist_is_an_error_before_the_build() {
        let corners = vec![DVec3::ZERO, DVec3::X, DVec3::Y];
        let mesh = |last| Geometry {
            vertices: corners.clone(),
            triangles: vec![[0, 1, 2], [0, 1, last]],
            ..Geometry::default()
        };
        let build = |last| Tree::try_build(&mesh(last), &BuildOptions::default()).map(drop);
        assert_eq!(build(0), Ok(()));
        let error = build(3).unwrap_err();
        assert_eq!(error, GeometryError::Vertex { triangle: 1, vertex: 3, vertices: 3 });
        assert_eq!(error.to_string(), "triangle 1 has the vertex 3, expected less than 3");
    }
}
