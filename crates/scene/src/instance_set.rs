use super::surfaces::Surface;
use std::sync::Arc;
use vlscan_base::store::vec_bytes;
use vlscan_trace::Instances;

/// The instances of a scene: shared meshes with their materials.
#[derive(Clone, Debug, Default)]
pub struct InstanceSet {
    /// The shared meshes and their placements.
    pub instances: Arc<Instances>,
    /// The material of each triangle of each mesh.
    pub materials: Vec<Vec<u32>>,
    /// The part of each instance.
    pub parts: Vec<u32>,
}

impl InstanceSet {
    /// Part and material of a triangle of an instance, which has this number in the instance's model.
    #[inline]
    pub fn surface(&self, instance: usize, triangle: usize) -> Surface {
        let model = self.instances.all[instance].model as usize;
        Surface { part: self.parts[instance], material: self.materials[model][triangle] }
    }

    pub(crate) fn memory(&self) -> usize {
        self.instances.memory()
            + self.materials.iter().map(vec_bytes).sum::<usize>()
            + self.parts.capacity() * size_of::<u32>()
    }
}
