//! Surfaces, and the surface of each primitive.

use std::ops::Range;
use vlscan_base::error::Result;
use vlscan_base::store::{ArrayFile, ArrayFileWriter, vec_bytes};
use vlscan_trace::prefetch;

/// Part and material of primitives.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
pub struct Surface {
    /// Index in [`Scene::parts`](super::Scene::parts).
    pub part: u32,
    /// Index in [`Scene::materials`](super::Scene::materials).
    pub material: u32,
}

/// The surface index of each primitive: two bytes each if all indices fit, otherwise four. Scenes have few
/// surfaces and many primitives.
#[derive(Clone, Debug)]
pub enum SurfaceIds {
    /// Indices below 65 536.
    Narrow(Vec<u16>),
    /// Indices of any size.
    Wide(Vec<u32>),
}

impl SurfaceIds {
    /// Number of primitives.
    pub fn len(&self) -> usize {
        match self {
            SurfaceIds::Narrow(numbers) => numbers.len(),
            SurfaceIds::Wide(numbers) => numbers.len(),
        }
    }

    /// True if there are no primitives.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The surface of primitive `i`, if the index is in range.
    #[inline(always)]
    pub fn get(&self, i: usize) -> Option<u32> {
        match self {
            SurfaceIds::Narrow(numbers) => numbers.get(i).map(|n| u32::from(*n)),
            SurfaceIds::Wide(numbers) => numbers.get(i).copied(),
        }
    }

    pub(crate) fn iter(&self) -> impl Iterator<Item = u32> {
        self.range(0..self.len())
    }

    /// The surfaces of those primitives of a range that exist.
    pub fn range(&self, primitives: Range<usize>) -> impl Iterator<Item = u32> {
        primitives.map_while(|i| self.get(i))
    }

    /// Appends the surface index of one primitive; the storage widens to 32 bits where 16 do not suffice.
    pub fn push(&mut self, surface: u32) {
        self.extend([surface]);
    }

    /// Appends the surface indices of primitives; the storage widens to 32 bits where 16 do not suffice.
    pub fn extend(&mut self, surfaces: impl IntoIterator<Item = u32>) {
        for surface in surfaces {
            match (&mut *self, u16::try_from(surface)) {
                (SurfaceIds::Narrow(numbers), Ok(surface)) => numbers.push(surface),
                (SurfaceIds::Wide(numbers), _) => numbers.push(surface),
                (SurfaceIds::Narrow(_), Err(_)) => {
                    let mut wide: Vec<u32> = self.iter().collect();
                    wide.push(surface);
                    *self = SurfaceIds::Wide(wide);
                }
            }
        }
    }

    /// Prefetches the surface index of primitive `i` into the cache.
    #[inline(always)]
    pub fn prefetch(&self, i: usize) {
        match self {
            SurfaceIds::Narrow(numbers) => prefetch(numbers.as_ptr().wrapping_add(i)),
            SurfaceIds::Wide(numbers) => prefetch(numbers.as_ptr().wrapping_add(i)),
        }
    }

    pub(crate) fn memory(&self) -> usize {
        match self {
            SurfaceIds::Narrow(numbers) => vec_bytes(numbers),
            SurfaceIds::Wide(numbers) => vec_bytes(numbers),
        }
    }

    /// Writes the indices as an array of a file.
    pub fn pack(&self, name: String, out: &mut ArrayFileWriter) -> Result<()> {
        match self {
            SurfaceIds::Narrow(numbers) => out.array(name, numbers),
            SurfaceIds::Wide(numbers) => out.array(name, numbers),
        }
    }

    /// Reads the indices written by [`SurfaceIds::pack`].
    ///
    /// # Errors
    /// As for [`ArrayFile::array`].
    pub fn unpack(name: &str, file: &ArrayFile) -> Result<SurfaceIds> {
        match file.element(name) {
            Some(2) => file.array(name).map(SurfaceIds::Narrow),
            _ => file.array(name).map(SurfaceIds::Wide),
        }
    }
}

impl Default for SurfaceIds {
    fn default() -> SurfaceIds {
        SurfaceIds::Narrow(Vec::new())
    }
}

impl PartialEq for SurfaceIds {
    fn eq(&self, other: &SurfaceIds) -> bool {
        self.len() == other.len() && self.iter().eq(other.iter())
    }
}

impl FromIterator<u32> for SurfaceIds {
    fn from_iter<I: IntoIterator<Item = u32>>(surfaces: I) -> SurfaceIds {
        let mut all = SurfaceIds::default();
        all.extend(surfaces);
        all
    }
}

impl From<Vec<u32>> for SurfaceIds {
    fn from(mut surfaces: Vec<u32>) -> SurfaceIds {
        if surfaces.iter().any(|n| *n > u32::from(u16::MAX)) {
            surfaces.shrink_to_fit();
            return SurfaceIds::Wide(surfaces);
        }
        SurfaceIds::Narrow(surfaces.into_iter().map(|n| n as u16).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_narrow_as_long_as_they_can_be() {
        let mut of: SurfaceIds = vec![3, 65_535, 0].into();
        assert!(matches!(of, SurfaceIds::Narrow(_)) && of.memory() <= 8, "{of:?}");
        assert_eq!((of.get(1), of.get(3)), (Some(65_535), None));
        of.push(65_536);
        assert!(matches!(of, SurfaceIds::Wide(_)), "{of:?}");
        assert_eq!(of.iter().collect::<Vec<_>>(), [3, 65_535, 0, 65_536]);
        assert_eq!(of.range(1..9).collect::<Vec<_>>(), [65_535, 0, 65_536]);
        assert_eq!(of, SurfaceIds::from(vec![3, 65_535, 0, 65_536]));
        assert_ne!(of, SurfaceIds::from(vec![3, 65_535, 0]));
    }
}
