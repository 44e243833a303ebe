//! The nodes of a glTF document: which meshes the scene shows, and where.

use super::GltfError;
use super::gltf::{GltfDocument, Instancing, NodeJson};
use glam::{DAffine3, DMat3, DMat4, DQuat, DVec3};
use vlscan_survey::PartRecipe;

/// Maximum number of meshes that the nodes of a document place.
const MAX_PLACED: usize = 1 << 22;

/// A mesh that a node places.
#[derive(Clone, Debug)]
pub(super) struct PlacedMesh {
    /// Index of the mesh.
    pub mesh: usize,
    /// Name of the node, or of the nearest node above it that has one; instances of a node append their
    /// number.
    pub name: Option<String>,
    /// From the frame of the mesh to that of the document.
    pub transform: DAffine3,
}

impl GltfDocument {
    /// The meshes of the scene, in the order of its nodes.
    pub fn placed_meshes(&self) -> Result<Vec<PlacedMesh>, GltfError> {
        let json = &self.json;
        let roots = match json.scenes.get(json.scene) {
            Some(scene) => scene.nodes.clone(),
            None if json.scenes.is_empty() => self.nodes_without_parent(),
            None => return Err(GltfError::Missing { what: "scene", number: json.scene }),
        };
        let mut placed = Vec::new();
        let mut is_seen = vec![false; json.nodes.len()];
        let mut open: Vec<(usize, DAffine3, &str)> =
            roots.into_iter().rev().map(|n| (n, DAffine3::IDENTITY, "")).collect();
        while let Some((number, parent, name)) = open.pop() {
            let node = json.nodes.get(number).ok_or(GltfError::Missing { what: "node", number })?;
            if std::mem::replace(&mut is_seen[number], true) {
                return Err(GltfError::TwoParents(number));
            }
            let transform = parent * local_transform(node);
            let name = if node.name.is_empty() { name } else { node.name.as_str() };
            let named = || (!name.is_empty()).then(|| name.to_owned());
            if !transform.is_finite() {
                return Err(GltfError::Transform(number));
            }
            if let Some(mesh) = node.mesh {
                match &node.extensions.instancing {
                    Some(instancing) => {
                        let instances = self.instances(instancing, placed.len(), name.len())?;
                        placed.extend((0..).zip(instances).map(|(i, instance): (usize, _)| PlacedMesh {
                            mesh,
                            name: named().map(|name| format!("{name}_{i}")),
                            transform: transform * instance,
                        }));
                    }
                    None => {
                        self.check_placed(placed.len() + 1, name.len())?;
                        placed.push(PlacedMesh { mesh, name: named(), transform });
                    }
                }
            }
            open.extend(node.children.iter().rev().map(|&child| (child, transform, name)));
        }
        Ok(placed)
    }

    fn nodes_without_parent(&self) -> Vec<usize> {
        let mut is_child = vec![false; self.json.nodes.len()];
        for &child in self.json.nodes.iter().flat_map(|n| &n.children) {
            if let Some(child) = is_child.get_mut(child) {
                *child = true;
            }
        }
        (0..is_child.len()).filter(|&n| !is_child[n]).collect()
    }

    /// Fails if this many meshes with names of this length cannot be placed.
    fn check_placed(&self, count: usize, name_bytes: usize) -> Result<(), GltfError> {
        if count > MAX_PLACED {
            return Err(GltfError::TooManyMeshes { count, max: MAX_PLACED });
        }
        let each = size_of::<PlacedMesh>() + size_of::<PartRecipe>() + 2 * name_bytes;
        self.check_memory((count as u64).saturating_mul(each as u64))
    }

    /// The transforms of `EXT_mesh_gpu_instancing`, after `before` other placed meshes, for a node with a
    /// name of this length.
    fn instances(
        &self,
        instancing: &Instancing,
        before: usize,
        name_bytes: usize,
    ) -> Result<Vec<DAffine3>, GltfError> {
        for (name, &accessor) in &instancing.attributes {
            if ["TRANSLATION", "ROTATION", "SCALE"].contains(&name.as_str()) {
                let count = before.saturating_add(self.count_of_instances(accessor)?);
                self.check_placed(count, name_bytes)?;
            }
        }
        let attribute = |name: &str| instancing.attributes.get(name).copied();
        let translations = attribute("TRANSLATION").map(|a| self.vectors::<3>(a)).transpose()?;
        let rotations = attribute("ROTATION").map(|a| self.vectors::<4>(a)).transpose()?;
        let scales = attribute("SCALE").map(|a| self.vectors::<3>(a)).transpose()?;
        let lengths = [
            translations.as_ref().map(Vec::len),
            rotations.as_ref().map(Vec::len),
            scales.as_ref().map(Vec::len),
        ];
        let count = lengths.iter().flatten().copied().min().unwrap_or(0);
        let transform = |i: usize| {
            trs(
                translations.as_ref().map(|all| all[i]),
                rotations.as_ref().map(|all| all[i]),
                scales.as_ref().map(|all| all[i]),
            )
        };
        Ok((0..count).map(transform).collect())
    }
}

fn local_transform(node: &NodeJson) -> DAffine3 {
    match node.matrix {
        Some(matrix) => DAffine3::from_mat4(DMat4::from_cols_array(&matrix)),
        None => trs(node.translation, node.rotation, node.scale),
    }
}

fn trs(translation: Option<[f64; 3]>, rotation: Option<[f64; 4]>, scale: Option<[f64; 3]>) -> DAffine3 {
    let rotation = rotation.map_or(DQuat::IDENTITY, |[x, y, z, w]| DQuat::from_xyzw(x, y, z, w).normalize());
    let (scale, translation) = (scale.unwrap_or([1.0; 3]), translation.unwrap_or([0.0; 3]));
    DAffine3::from_scale_rotation_translation(DVec3::from(scale), rotation, DVec3::from(translation))
}

/// Splits a linear map into a rotation and a factor, which is negative if the map mirrors; `None` if it is
/// not a similarity.
pub(super) fn similarity(map: DMat3) -> Option<(DQuat, f64)> {
    const TOLERANCE: f64 = 1e-7;
    let size = map.x_axis.length();
    let factor = if map.determinant() < 0.0 { -size } else { size };
    let rotation = map * (1.0 / factor);
    let error = rotation.transpose() * rotation - DMat3::IDENTITY;
    let is_rotation = error.to_cols_array().iter().all(|e| e.abs() < TOLERANCE);
    is_rotation.then(|| (DQuat::from_mat3(&rotation).normalize(), factor))
}
