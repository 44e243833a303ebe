//! Attributes of cubes: their interaction with rays (spec pulse-physics §2.3–2.5).

use bytemuck::{Pod, Zeroable};
use vlscan_geom::{Affine, DVec3, Rotation};

/// The interaction of a ray with a cube.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
#[repr(u32)]
pub enum VoxelKind {
    /// The ray stops at its entry.
    #[default]
    Opaque,
    /// The ray stops after an exponentially distributed free path or passes through (`transmittive`).
    Transmittive,
    /// The ray passes through (`fixed` and `scaled` voxels whose transmittance is 1 or NaN).
    Transparent,
}

impl VoxelKind {
    /// The kind with this number; opaque for any other.
    pub(super) fn of_number(number: u32) -> VoxelKind {
        const TRANSMITTIVE: u32 = VoxelKind::Transmittive as u32;
        const TRANSPARENT: u32 = VoxelKind::Transparent as u32;
        match number {
            TRANSMITTIVE => VoxelKind::Transmittive,
            TRANSPARENT => VoxelKind::Transparent,
            _ => VoxelKind::Opaque,
        }
    }
}

/// Attributes of a cube; 24 bytes.
#[derive(Clone, Copy, Debug, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct Voxel {
    /// Plant area density `PadBVTotal`, 1/m; 0 for cubes of point clouds.
    pub density: f64,
    normal: [f32; 3],
    /// A [`VoxelKind`] as an integer.
    kind: u32,
}

impl Voxel {
    /// An opaque cube of a point cloud, with the normal of its points if they have one.
    pub fn of_points(normal: Option<DVec3>) -> Voxel {
        Voxel {
            density: 0.0,
            normal: normal.unwrap_or(DVec3::ZERO).to_array().map(|c| c as f32),
            kind: VoxelKind::Opaque as u32,
        }
    }

    /// A cube of vegetation with plant area density `density`, 1/m, and no normal.
    pub fn of_plants(density: f64, kind: VoxelKind) -> Voxel {
        Voxel { density, normal: [0.0; 3], kind: kind as u32 }
    }

    pub(super) fn new(density: f64, normal: [f32; 3], kind: VoxelKind) -> Voxel {
        Voxel { density, normal, kind: kind as u32 }
    }

    /// The stored normal; (0, 0, 0) without one.
    pub(super) fn stored_normal(&self) -> [f32; 3] {
        self.normal
    }

    /// How the cube interacts with rays.
    #[inline]
    pub fn kind(&self) -> VoxelKind {
        VoxelKind::of_number(self.kind)
    }

    pub(super) fn rotate(&mut self, rotation: &Rotation) {
        if let Some(normal) = self.normal() {
            self.normal = rotation.apply(normal).to_array().map(|c| c as f32);
        }
    }

    /// Rotates or mirrors the normal with a moving part.
    pub(super) fn turn(&mut self, map: &Affine) {
        if let Some(normal) = self.normal() {
            self.normal = map.apply_to_vector(normal).to_array().map(|c| c as f32);
        }
    }

    /// The surface normal of the points in the cube; without one, the normal of the nearest face is used
    /// (spec pulse-physics §2.4).
    pub fn normal(&self) -> Option<DVec3> {
        (self.normal != [0.0; 3]).then(|| DVec3::from(self.normal.map(f64::from)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_voxel_is_small_and_keeps_its_normal() {
        assert_eq!(size_of::<Voxel>(), 24);
        assert_eq!(Voxel::of_points(Some(DVec3::Z)).normal(), Some(DVec3::Z));
        assert_eq!(Voxel::of_points(None).normal(), None);
        assert_eq!(Voxel::of_plants(1.3, VoxelKind::Transmittive).density, 1.3);
    }
}
