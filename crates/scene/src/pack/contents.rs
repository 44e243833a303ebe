//! Encodes scenes as arrays and values of a file.

use super::trees::{
    read_geometry, read_instance_trees, read_instances, read_tree, write_geometry, write_instance_trees,
    write_instances, write_tree,
};
use crate::{
    InstanceSet, LadTable, Material, MovingPart, PackedTree, Part, Reflection, Scene, Sizes, Surface,
    SurfaceIds,
};
use std::ops::Range;
use std::sync::Arc;
use vlscan_base::error::Result;
use vlscan_base::store::{ArrayFile, ArrayFileWriter, ByteReader, ByteWriter, UnexpectedEnd};
use vlscan_geom::{Aabb, DVec3};
use vlscan_survey::{Motion, MotionKind, MotionSequence, MotionTiming};
use vlscan_trace::{Builder, Geometry, Tree};

/// The encoded values of all epochs.
pub(super) struct Contents(Vec<Vec<u8>>);

type Read<T> = std::result::Result<T, UnexpectedEnd>;

impl Contents {
    pub fn read(bytes: &[u8]) -> std::result::Result<Contents, String> {
        let mut r = ByteReader(bytes);
        let mut all = || {
            let epochs = r.u64()?;
            (0..epochs).map(|_| r.blob().map(<[u8]>::to_vec)).collect::<Read<Vec<_>>>()
        };
        all().map(Contents).map_err(|UnexpectedEnd| TRUNCATED.to_owned())
    }

    pub fn epochs(&self) -> u32 {
        self.0.len() as u32
    }

    /// Reads the scene of an epoch.
    ///
    /// # Errors
    /// As for [`ArrayFile::array`].
    pub fn scene(&self, file: &ArrayFile, epoch: u32, builder: Builder) -> Result<Scene> {
        let values = self.0.get(epoch as usize).ok_or_else(|| file.refuse("it holds no epoch"))?;
        read_scene(file, epoch, builder, &mut ByteReader(values))
    }
}

const TRUNCATED: &str = "its contents end too early";

/// What the names of all arrays of an epoch begin with.
fn prefix(epoch: u32) -> String {
    format!("epoch {epoch} ")
}

/// Whether an array is needed for an epoch, by its name.
pub(super) fn is_of_epoch(name: &str, epoch: u32) -> bool {
    name.starts_with(&prefix(epoch)) || !name.starts_with("epoch ")
}

pub(super) fn write(
    scene: &Scene,
    tree: &Tree,
    epoch: u32,
    out: &mut ArrayFileWriter,
    values: &mut ByteWriter,
) -> Result<()> {
    let mut w = ByteWriter::default();
    let name = |what: &str| prefix(epoch) + what;
    w.vector(scene.shift);
    w.vector(scene.bounds.min);
    w.vector(scene.bounds.max);
    w.list(&scene.surfaces, |w, s| [s.part, s.material].into_iter().for_each(|n| w.u64(u64::from(n))));
    w.list(&scene.parts, |w, p| {
        w.text(&p.id);
        w.text(&p.name);
        w.option(p.lad.as_deref(), |w, lad| {
            w.list(&lad.rows().collect::<Vec<_>>(), |w, (a, g)| [*a, *g].into_iter().for_each(|x| w.f64(x)));
        });
    });
    w.list(&scene.materials, write_material);
    w.u64(scene.dyn_step.into());
    w.option(scene.dyn_time_step, ByteWriter::f64);
    w.option(scene.crs.as_deref(), ByteWriter::text);
    w.list(&scene.moving_parts, write_moving_part);
    let sizes = scene.sizes();
    w.flag(sizes.are_within_bounds);
    w.f64(sizes.max_cube);
    write_geometry(&scene.geometry, &name("own"), out)?;
    out.array(name("voxels"), &scene.voxels)?;
    scene.surface_ids.pack(name("surfaces"), out)?;
    write_tree(tree, &name("tree"), out, &mut w)?;
    w.flag(scene.instances.is_some());
    if let Some(set) = &scene.instances {
        write_instances(&set.instances, &prefix(epoch), out, &mut w)?;
        w.list(&set.parts, |w, n| w.u64(u64::from(*n)));
        for (i, materials) in set.materials.iter().enumerate() {
            out.array(name(&format!("materials {i}")), materials)?;
        }
        write_instance_trees(tree, &prefix(epoch), out, &mut w)?;
    }
    values.blob(w.bytes());
    Ok(())
}

fn read_scene(file: &ArrayFile, epoch: u32, builder: Builder, r: &mut ByteReader) -> Result<Scene> {
    let truncated = |UnexpectedEnd| file.refuse(TRUNCATED);
    let name = |what: &str| prefix(epoch) + what;
    let head = |r: &mut ByteReader| -> Read<Scene> {
        Ok(Scene {
            shift: r.vector()?,
            bounds: Aabb { min: r.vector()?, max: r.vector()? },
            surfaces: r.list(|r| Ok(Surface { part: r.u32()?, material: r.u32()? }))?,
            parts: r.list(read_part)?,
            materials: r.list(read_material)?,
            dyn_step: r.u32()?,
            dyn_time_step: r.option(ByteReader::f64)?,
            crs: r.option(ByteReader::text)?,
            moving_parts: r.list(read_moving_part)?,
            packed_sizes: Some(Sizes { are_within_bounds: r.flag()?, max_cube: r.f64()? }),
            ..Scene::default()
        })
    };
    let mut scene = head(r).map_err(truncated)?;
    scene.geometry = read_geometry(&name("own"), file)?;
    scene.voxels = file.array(&name("voxels"))?;
    scene.surface_ids = SurfaceIds::unpack(&name("surfaces"), file)?;
    let (primitives, cubes) = (scene.geometry.len(), scene.geometry.cubes.len());
    if scene.surface_ids.len() != primitives || scene.voxels.len() != cubes {
        return Err(file.refuse("its arrays do not belong together"));
    }
    let mut tree = read_tree(&name("tree"), file, r)?;
    if r.flag().map_err(truncated)? {
        let instances = Arc::new(read_instances(&prefix(epoch), file, r)?);
        let parts = r.list(ByteReader::u32).map_err(truncated)?;
        let materials = (0..instances.models.len()).map(|i| file.array(&name(&format!("materials {i}"))));
        let materials = materials.collect::<Result<Vec<_>>>()?;
        if parts.len() != instances.all.len() {
            return Err(file.refuse("its instances do not belong together"));
        }
        tree = read_instance_trees(tree, &prefix(epoch), &instances, file, r)?;
        scene.instances = Some(InstanceSet { instances, materials, parts });
    }
    if !are_numbers_valid(&scene) {
        return Err(file.refuse("its parts name something that is not there"));
    }
    scene.packed_tree = Some(PackedTree { builder, tree: Arc::new(tree) });
    Ok(scene)
}

/// Whether the numbers in everything but the large arrays are those of existing things.
fn are_numbers_valid(scene: &Scene) -> bool {
    let (parts, materials, g) = (scene.parts.len(), scene.materials.len(), &scene.geometry);
    let is_within = |range: &Range<usize>, len: usize| range.start <= range.end && range.end <= len;
    let is_surface = |s: &Surface| (s.part as usize) < parts && (s.material as usize) < materials;
    let is_moving = |m: &MovingPart| {
        (m.part as usize) < parts
            && is_within(&m.vertices, g.vertices.len())
            && is_within(&m.triangles, g.triangles.len())
            && is_within(&m.cubes, g.cubes.len())
            && m.motions.iter().all(|s| s.next.is_none_or(|next| next < m.motions.len()))
    };
    let are_instances = |set: &InstanceSet| {
        let models = &set.instances.models;
        set.parts.iter().all(|&part| (part as usize) < parts)
            && set.instances.all.iter().all(|i| (i.model as usize) < models.len())
            && set.materials.iter().zip(models).all(|(of, m)| of.len() == m.geometry.triangles.len())
    };
    scene.surfaces.iter().all(is_surface)
        && scene.moving_parts.iter().all(is_moving)
        && scene.instances.as_ref().is_none_or(are_instances)
}

/// Whether the numbers in the large arrays are those of existing things. Reads all of them.
pub(super) fn are_arrays_valid(scene: &Scene) -> bool {
    let materials = scene.materials.len();
    let geometries = scene.instances.iter().flat_map(|set| &set.instances.models).map(|m| &m.geometry);
    let of_instances = scene.instances.iter().flat_map(|set| &set.materials).flatten();
    std::iter::once(&scene.geometry).chain(geometries).all(Geometry::is_sound)
        && scene.surface_ids.iter().all(|id| (id as usize) < scene.surfaces.len())
        && of_instances.copied().all(|m| (m as usize) < materials)
        && scene.packed_tree.as_ref().is_none_or(|packed| packed.tree.is_sound(&scene.geometry))
}

fn read_part(r: &mut ByteReader) -> Read<Part> {
    let (id, name) = (r.text()?, r.text()?);
    let rows = r.option(|r| r.list(|r| Ok((r.f64()?, r.f64()?))))?;
    Ok(Part { id, name, lad: rows.map(|rows| Arc::new(LadTable::of_rows(rows))) })
}

fn write_material(w: &mut ByteWriter, m: &Material) {
    w.text(&m.name);
    w.f64(m.reflectance);
    w.u64(m.classification as u32 as u64);
    w.flag(m.is_ground);
    match m.reflection {
        Reflection::Uniform => w.u64(0),
        Reflection::Lambert => w.u64(1),
        Reflection::Phong { specularity, exponent } => {
            w.u64(2);
            w.f64(specularity);
            w.f64(exponent);
        }
        Reflection::Lobes { specularity, exponent, roughness } => {
            w.u64(3);
            [specularity, exponent, roughness].into_iter().for_each(|x| w.f64(x));
        }
    }
}

fn read_material(r: &mut ByteReader) -> Read<Material> {
    Ok(Material {
        name: r.text()?,
        reflectance: r.f64()?,
        classification: r.u32()? as i32,
        is_ground: r.flag()?,
        reflection: match r.u64()? {
            0 => Reflection::Uniform,
            1 => Reflection::Lambert,
            2 => Reflection::Phong { specularity: r.f64()?, exponent: r.f64()? },
            3 => Reflection::Lobes { specularity: r.f64()?, exponent: r.f64()?, roughness: r.f64()? },
            _ => return Err(UnexpectedEnd),
        },
    })
}

fn write_moving_part(w: &mut ByteWriter, m: &MovingPart) {
    w.u64(m.part.into());
    for range in [&m.vertices, &m.triangles, &m.cubes] {
        w.u64(range.start as u64);
        w.u64(range.end as u64);
    }
    w.u64(m.timing.dyn_step.into());
    w.u64(m.timing.tree_step.into());
    w.option(m.timing.dyn_time_step, ByteWriter::f64);
    w.option(m.timing.tree_time_step, ByteWriter::f64);
    w.list(&m.motions, |w, s| {
        w.text(&s.id);
        w.u64(s.loops.into());
        w.option(s.next, |w, n| w.u64(n as u64));
        w.list(&s.motions, write_motion);
    });
}

fn read_moving_part(r: &mut ByteReader) -> Read<MovingPart> {
    let range = |r: &mut ByteReader| -> Read<Range<usize>> { Ok(r.size()?..r.size()?) };
    Ok(MovingPart {
        part: r.u32()?,
        vertices: range(r)?,
        triangles: range(r)?,
        cubes: range(r)?,
        timing: MotionTiming {
            dyn_step: r.u32()?,
            tree_step: r.u32()?,
            dyn_time_step: r.option(ByteReader::f64)?,
            tree_time_step: r.option(ByteReader::f64)?,
        },
        motions: r.list(|r| {
            Ok(MotionSequence {
                id: r.text()?,
                loops: r.u32()?,
                next: r.option(ByteReader::size)?,
                motions: r.list(read_motion)?,
            })
        })?,
    })
}

fn write_motion(w: &mut ByteWriter, m: &Motion) {
    w.flag(m.about_self);
    w.f64(m.auto_crs);
    let mut put = |number: u64, vectors: &[DVec3], numbers: &[f64], centre: Option<DVec3>| {
        w.u64(number);
        vectors.iter().for_each(|v| w.vector(*v));
        numbers.iter().for_each(|x| w.f64(*x));
        w.option(centre, ByteWriter::vector);
    };
    match m.kind {
        MotionKind::Identity => put(0, &[], &[], None),
        MotionKind::Translation { by } => put(1, &[by], &[], None),
        MotionKind::Rotation { axis, angle, centre } => put(2, &[axis], &[angle], centre),
        MotionKind::Reflection { normal } => put(3, &[normal], &[], None),
        MotionKind::GlidePlane { normal, shift } => put(4, &[normal, shift], &[], None),
        MotionKind::Helical { axis, angle, glide } => put(5, &[axis], &[angle, glide], None),
        MotionKind::RotaryReflection { axis, angle, centre } => put(6, &[axis], &[angle], centre),
    }
}

fn read_motion(r: &mut ByteReader) -> Read<Motion> {
    let (about_self, auto_crs, number) = (r.flag()?, r.f64()?, r.u64()?);
    let kind = match number {
        0 => MotionKind::Identity,
        1 => MotionKind::Translation { by: r.vector()? },
        2 => MotionKind::Rotation { axis: r.vector()?, angle: r.f64()?, centre: None },
        3 => MotionKind::Reflection { normal: r.vector()? },
        4 => MotionKind::GlidePlane { normal: r.vector()?, shift: r.vector()? },
        5 => MotionKind::Helical { axis: r.vector()?, angle: r.f64()?, glide: r.f64()? },
        6 => MotionKind::RotaryReflection { axis: r.vector()?, angle: r.f64()?, centre: None },
        _ => return Err(UnexpectedEnd),
    };
    let found = r.option(ByteReader::vector)?;
    let kind = match kind {
        MotionKind::Rotation { axis, angle, .. } => MotionKind::Rotation { axis, angle, centre: found },
        MotionKind::RotaryReflection { axis, angle, .. } => {
            MotionKind::RotaryReflection { axis, angle, centre: found }
        }
        other => other,
    };
    Ok(Motion { kind, about_self, auto_crs })
}
