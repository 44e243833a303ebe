//! Trees, geometry and instances as arrays of a file.

use std::sync::Arc;
use vlscan_base::error::{Error, Result};
use vlscan_base::store::{ArrayFile, ArrayFileWriter, ByteReader, ByteWriter, UnexpectedEnd};
use vlscan_geom::{Aabb, Rotation};
use vlscan_trace::{Frame, Geometry, Instances, Model, NodeArray, Placement, Statistics, Tree, TreeParts};

/// The error for values that end too early.
fn cut(file: &ArrayFile) -> impl FnOnce(UnexpectedEnd) -> Error {
    |UnexpectedEnd| file.refuse("its contents end too early")
}

/// Writes the arrays of a geometry under names that begin with `name`.
pub(super) fn write_geometry(geometry: &Geometry, name: &str, out: &mut ArrayFileWriter) -> Result<()> {
    out.array(format!("{name}.vertices"), &geometry.vertices)?;
    out.array(format!("{name}.triangles"), &geometry.triangles)?;
    out.array(format!("{name}.cubes"), &geometry.cubes)
}

/// Reads the arrays of [`write_geometry`].
///
/// # Errors
/// As for [`ArrayFile::array`].
pub(super) fn read_geometry(name: &str, file: &ArrayFile) -> Result<Geometry> {
    Ok(Geometry {
        vertices: file.array(&format!("{name}.vertices"))?,
        triangles: file.array(&format!("{name}.triangles"))?,
        cubes: file.array(&format!("{name}.cubes"))?,
    })
}

/// Writes a tree without its instances: arrays to `out` under names that begin with `name`, other values to `words`.
pub(super) fn write_tree(
    tree: &Tree,
    name: &str,
    out: &mut ArrayFileWriter,
    words: &mut ByteWriter,
) -> Result<()> {
    let parts = tree.parts();
    words.vector(parts.frame.origin);
    words.f64(parts.frame.scale);
    parts.bounds.as_flattened().iter().for_each(|x| words.f64(f64::from(*x)));
    let s = &parts.statistics;
    [s.primitives, s.references, s.interior, s.leaves, s.max_depth as usize, s.max_leaf, s.min_leaf]
        .into_iter()
        .for_each(|n| words.u64(n as u64));
    words.f64(s.root_area);
    words.f64(s.cost);
    words.option(s.booked_cost, ByteWriter::f64);
    words.flag(matches!(parts.nodes, NodeArray::Wide(_)));
    match &parts.nodes {
        NodeArray::Kd(nodes) => out.array(format!("{name}.nodes"), nodes)?,
        NodeArray::Wide(nodes) => out.array(format!("{name}.nodes"), nodes)?,
    }
    out.array(format!("{name}.blocks"), &parts.blocks)
}

/// Reads a tree of [`write_tree`].
///
/// # Errors
/// As for [`ArrayFile::array`].
pub(super) fn read_tree(name: &str, file: &ArrayFile, words: &mut ByteReader) -> Result<Tree> {
    let mut head = || {
        let frame = Frame { origin: words.vector()?, scale: words.f64()? };
        let mut bounds = [[0.0f32; 3]; 2];
        for x in bounds.as_flattened_mut() {
            *x = words.f64()? as f32;
        }
        let statistics = Statistics {
            primitives: words.size()?,
            references: words.size()?,
            interior: words.size()?,
            leaves: words.size()?,
            max_depth: words.u32()?,
            max_leaf: words.size()?,
            min_leaf: words.size()?,
            root_area: words.f64()?,
            cost: words.f64()?,
            booked_cost: words.option(ByteReader::f64)?,
        };
        Ok((frame, bounds, statistics, words.flag()?))
    };
    let (frame, bounds, statistics, is_wide) = head().map_err(cut(file))?;
    let nodes = format!("{name}.nodes");
    let nodes = match is_wide {
        true => NodeArray::Wide(file.array(&nodes)?.into()),
        false => NodeArray::Kd(file.array(&nodes)?.into()),
    };
    let blocks = file.array(&format!("{name}.blocks"))?.into();
    Ok(Tree::from_parts(TreeParts { frame, bounds, statistics, nodes, blocks }))
}

/// Writes the trees of a tree's instances, as arrays under names that begin with `name`.
pub(super) fn write_instance_trees(
    tree: &Tree,
    name: &str,
    out: &mut ArrayFileWriter,
    words: &mut ByteWriter,
) -> Result<()> {
    let Some((top, models)) = tree.instance_trees() else { return Ok(()) };
    write_tree(top, &format!("{name}top"), out, words)?;
    models.iter().enumerate().try_for_each(|(i, m)| write_tree(m, &format!("{name}model {i}"), out, words))
}

/// Adds the trees of [`write_instance_trees`] to `tree`.
///
/// # Errors
/// As for [`ArrayFile::array`].
pub(super) fn read_instance_trees(
    tree: Tree,
    name: &str,
    instances: &Arc<Instances>,
    file: &ArrayFile,
    words: &mut ByteReader,
) -> Result<Tree> {
    let top = read_tree(&format!("{name}top"), file, words)?;
    let models = (0..instances.models.len()).map(|i| read_tree(&format!("{name}model {i}"), file, words));
    let models = models.collect::<Result<_>>()?;
    Ok(tree.with_instance_trees(instances, top, models))
}

/// Writes models and placements, the models as arrays under names that begin with `name`.
pub(super) fn write_instances(
    instances: &Instances,
    name: &str,
    out: &mut ArrayFileWriter,
    words: &mut ByteWriter,
) -> Result<()> {
    words.vector(instances.shift);
    words.u64(u64::from(instances.first()));
    words.list(&instances.models, |w, m| {
        w.f64(m.reach());
        w.list(m.outline(), |w, b| {
            w.vector(b.min);
            w.vector(b.max);
        });
    });
    words.list(&instances.all, |w, i| {
        [i.model, i.before].into_iter().for_each(|n| w.u64(u64::from(n)));
        let p = &i.placement;
        [p.rotation.w, p.scale, p.raise].into_iter().for_each(|x| w.f64(x));
        w.vector(p.rotation.u);
        w.vector(p.offset);
    });
    let mut models = instances.models.iter().enumerate();
    models.try_for_each(|(i, m)| write_geometry(&m.geometry, &format!("{name}mesh {i}"), out))
}

/// Reads instances of [`write_instances`].
///
/// # Errors
/// As for [`ArrayFile::array`].
pub(super) fn read_instances(name: &str, file: &ArrayFile, words: &mut ByteReader) -> Result<Instances> {
    let mut head = || {
        let (shift, first) = (words.vector()?, words.u32()?);
        let models = words.list(|r| {
            let reach = r.f64()?;
            Ok((reach, r.list(|r| Ok(Aabb { min: r.vector()?, max: r.vector()? }))?))
        })?;
        let places = words.list(|r| {
            let (model, before) = (r.u32()?, r.u32()?);
            let (w, scale, raise) = (r.f64()?, r.f64()?, r.f64()?);
            let rotation = Rotation { w, u: r.vector()? };
            Ok((model, before, Placement { rotation, scale, offset: r.vector()?, raise }))
        })?;
        Ok((shift, first, models, places))
    };
    let (shift, first, outlines, places) = head().map_err(cut(file))?;
    let mut models = Vec::with_capacity(outlines.len());
    for (i, (reach, outline)) in outlines.into_iter().enumerate() {
        let geometry = read_geometry(&format!("{name}mesh {i}"), file)?;
        models.push(Arc::new(Model::from_parts(geometry, reach, outline)));
    }
    let instances = Instances::new(models, places, first as usize);
    let mut instances = instances.ok_or_else(|| file.refuse("its instances cannot be numbered"))?;
    instances.shift = shift;
    Ok(instances)
}

#[cfg(test)]
mod tests {
    use super::*;
    use vlscan_base::rng::{Purpose, Stream};
    use vlscan_geom::{DVec3, unit};
    use vlscan_trace::{BuildOptions, Builder, Cube};

    #[test]
    fn trees_and_instances_from_a_file_hit_the_same() {
        let random = Stream::new(5, Purpose::Range);
        let point = |i: u32, k: u32| 10.0 * random.uniform(k, u64::from(i), 0) - 5.0;
        let mesh = |n: u32| Geometry {
            vertices: (0..3 * n).map(|i| DVec3::new(point(i, 1), point(i, 77), point(i, 5))).collect(),
            triangles: (0..n).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect(),
            cubes: vec![Cube { centre: DVec3::splat(3.0), half: 0.5 }; usize::from(n > 50)],
        };
        let (own, model) = (mesh(100), mesh(40));
        let place = |x: f64| Placement { offset: DVec3::X * x, scale: 0.5, ..Placement::IDENTITY };
        let places = [(0, 10, place(9.0)), (0, 20, place(-9.0))];
        let mut instances = Instances::new(vec![Arc::new(Model::new(model))], places, own.len()).unwrap();
        instances.shift = DVec3::splat(0.25);
        let instances = Arc::new(instances);
        for builder in [Builder::Bvh, Builder::Fsah] {
            let options = BuildOptions::of(builder);
            let tree = Tree::build(&own, &options).with_instances(&instances, &options);
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("t.vlscene");
            let (mut out, mut words) = (ArrayFileWriter::create(&path).unwrap(), ByteWriter::default());
            write_geometry(&own, "own", &mut out).unwrap();
            write_tree(&tree, "tree", &mut out, &mut words).unwrap();
            write_instances(&instances, "a ", &mut out, &mut words).unwrap();
            write_instance_trees(&tree, "a ", &mut out, &mut words).unwrap();
            out.finish().unwrap();
            let file = ArrayFile::open(&path).unwrap();
            let mut reader = ByteReader(words.bytes());
            let again = read_geometry("own", &file).unwrap();
            assert!(again.is_sound());
            let read = read_tree("tree", &file, &mut reader).unwrap();
            let placed = Arc::new(read_instances("a ", &file, &mut reader).unwrap());
            let read = read_instance_trees(read, "a ", &placed, &file, &mut reader).unwrap();
            assert!(read.is_sound(&again) && !read.is_sound(&Geometry::default()));
            assert_eq!(placed.all, instances.all);
            assert_eq!(placed.shift, instances.shift);
            let mut found = 0;
            for i in 0..500 {
                let origin = DVec3::new(point(i, 3) * 3.0, -20.0, point(i, 9));
                let d = unit(DVec3::new(point(i, 11) * 0.1, 1.0, point(i, 13) * 0.1));
                let hit = tree.nearest_where(&own, origin, d, |_| true);
                found += usize::from(hit.is_some());
                assert_eq!(read.nearest_where(&again, origin, d, |_| true), hit);
            }
            assert!(found > 100, "{found}");
            assert_eq!(read.statistics(), tree.statistics());
        }
    }
}
