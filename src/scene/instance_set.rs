//! The instances of a scene: shared meshes with their materials.

use super::surfaces::Surface;
use crate::store::Store;
use crate::tree::Instances;
use std::sync::Arc;

/// The instances of a scene.
#[derive(Clone, Debug, Default)]
pub struct InstanceSet {
    /// Meshes and placements.
    pub instances: Arc<Instances>,
    /// The material of each triangle of each mesh.
    pub materials: Vec<Store<u32>>,
    /// The part that each instance is.
    pub parts: Vec<u32>,
}

impl InstanceSet {
    /// What triangle `i` belongs to and is made of; `None` if it is not of an instance.
    pub fn surface(&self, i: u32) -> Option<Surface> {
        let (instance, triangle) = self.instances.locate(i)?;
        let model = self.instances.all[instance].model as usize;
        Some(Surface { part: self.parts[instance], material: self.materials[model][triangle] })
    }

    /// Bytes held.
    pub fn memory(&self) -> usize {
        self.instances.memory()
            + self.materials.iter().map(Store::memory).sum::<usize>()
            + self.parts.capacity() * size_of::<u32>()
    }
}
