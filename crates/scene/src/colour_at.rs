//! The colour of a primitive of a scene at a point.

use super::Scene;
use vlscan_geom::DVec3;
use vlscan_trace::PrimitiveRef;

impl Scene {
    /// The colour of primitive `i` at the point `at` of it, as red, green and blue of sRGB with 8 bits; black
    /// without a colour and for a scene without colours. `corners` are those of a triangle, in the frame of
    /// `at`.
    pub fn colour_at(&self, i: u32, corners: Option<[DVec3; 3]>, at: DVec3) -> [u8; 3] {
        let (Some(colours), Some(primitive)) = (&self.colours, self.primitive(i)) else { return [0; 3] };
        let Some(corners) = corners else { return colours.of_voxel(primitive) };
        match (primitive, &self.instances) {
            (PrimitiveRef::Triangle(index), _) => colours.of_stored(index, corners, at),
            (PrimitiveRef::Field { field, triangle }, _) => colours.of_field(field, triangle, corners, at),
            (PrimitiveRef::Instance { instance, triangle }, Some(set)) => {
                let model = set.instances.all[instance].model as usize;
                colours.of_model(model, triangle, corners, at)
            }
            _ => [0; 3],
        }
    }
}
