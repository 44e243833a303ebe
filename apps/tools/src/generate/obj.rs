//! Writes a mesh as OBJ text while it is generated; no part of the mesh is kept in memory.

use std::cell::RefCell;
use std::path::{Path, PathBuf};
use vlscan_base::corrections::Corrections;
use vlscan_base::error::Result;
use vlscan_base::files::{FileGroup, FileWriter, Patched, refuse_existing};
use vlscan_geom::{Aabb, DVec3};
use vlscan_scene::Material;

/// Decimals of a coordinate in metres: the unit is 0.1 mm.
const DECIMALS: usize = 4;
const UNITS_PER_METRE: f64 = 10_000.0;
const FLUSH_AT: usize = 1 << 20;

/// The folder of a scene. Its files get their names together, when the last one is complete.
pub struct SceneFolder {
    path: PathBuf,
    overwrite: bool,
    complete: RefCell<FileGroup>,
}

impl SceneFolder {
    /// Creates the folder, if it does not exist.
    /// # Errors
    /// [`Error::Io`].
    pub fn create(path: &Path, overwrite: bool) -> Result<SceneFolder> {
        let folder = SceneFolder { path: path.to_path_buf(), overwrite, complete: RefCell::default() };
        folder.add_folder("").map(|()| folder)
    }

    pub(super) fn add_folder(&self, name: &str) -> Result<()> {
        self.complete.borrow_mut().create_folder(&self.path.join(name))
    }

    /// Creates a file in the folder.
    pub(super) fn file(&self, name: &str) -> Result<NewFile<'_>> {
        let path = self.path.join(name);
        refuse_existing(&path, self.overwrite)?;
        let file = FileWriter::create(&path, self.overwrite, Patched::Never)?;
        Ok(NewFile { folder: self, path, file })
    }

    /// Writes a file and returns its path.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::Input`] for a file that exists, unless it may be replaced.
    pub fn write(&self, name: &str, content: &[u8]) -> Result<PathBuf> {
        let mut file = self.file(name)?;
        file.write(content)?;
        Ok(file.finish())
    }

    /// Removes a file of an earlier scene when the files of this one have their names.
    pub fn remove(&self, name: &str) {
        self.complete.borrow_mut().remove(&self.path.join(name));
    }

    /// Gives all files their names, in the order in which they were completed.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn commit(self) -> Result<()> {
        self.complete.into_inner().commit()
    }
}

/// A file of a scene under construction.
pub(super) struct NewFile<'f> {
    folder: &'f SceneFolder,
    path: PathBuf,
    file: FileWriter,
}

impl NewFile<'_> {
    pub(super) fn write(&mut self, bytes: &[u8]) -> Result<()> {
        self.file.append(bytes)
    }

    /// Passes the complete file to its folder and returns its path.
    pub(super) fn finish(self) -> PathBuf {
        self.folder.complete.borrow_mut().add(self.file);
        self.path
    }
}

/// An OBJ file under construction.
pub(super) struct ObjFile<'f> {
    file: NewFile<'f>,
    text: Vec<u8>,
    vertices: u64,
    pub(super) triangles: u64,
    pub(super) bounds: Aabb,
    wood: Option<Wood>,
}

/// The triangles of a mesh that are not leaves.
#[derive(Default)]
struct Wood {
    vertices: Vec<DVec3>,
    triangles: Vec<[DVec3; 3]>,
    is_leaf: bool,
}

impl<'f> ObjFile<'f> {
    /// # Errors
    /// [`Error::Io`].
    pub fn create(folder: &'f SceneFolder, name: &str, materials: &str) -> Result<ObjFile<'f>> {
        let mut text = Vec::with_capacity(FLUSH_AT + 4096);
        text.extend_from_slice(format!("mtllib {materials}\n").as_bytes());
        let file = folder.file(name)?;
        Ok(ObjFile { file, text, vertices: 0, triangles: 0, bounds: Aabb::EMPTY, wood: None })
    }

    /// Keeps the triangles that are not leaves, for [`Mesh::wood`].
    pub(super) fn keeping_wood(self) -> ObjFile<'f> {
        ObjFile { wood: Some(Wood::default()), ..self }
    }

    /// Sets the material of the faces that follow.
    pub(super) fn material(&mut self, name: &str) {
        if let Some(wood) = &mut self.wood {
            wood.is_leaf = Material::unnamed(name, Corrections::NONE).is_leaf() == Some(true);
        }
        self.text.extend_from_slice(b"usemtl ");
        self.text.extend_from_slice(name.as_bytes());
        self.text.push(b'\n');
    }

    /// Writes a vertex and returns its number, counted from 1.
    pub(super) fn vertex(&mut self, p: DVec3) -> Result<u64> {
        let units = [p.x, p.y, p.z].map(|c| (c * UNITS_PER_METRE).round() as i64);
        self.text.push(b'v');
        for u in units {
            self.text.push(b' ');
            push_fixed(&mut self.text, u);
        }
        self.text.push(b'\n');
        let [x, y, z] = units.map(|u| u as f64 / UNITS_PER_METRE);
        self.bounds = self.bounds.with(DVec3::new(x, y, z));
        if let Some(wood) = &mut self.wood {
            wood.vertices.push(DVec3::new(x, y, z));
        }
        self.vertices += 1;
        self.flush_when_full()?;
        Ok(self.vertices)
    }

    /// Writes a triangle, or a quad that readers split into (1, 2, 3) and (1, 3, 4).
    pub(super) fn face<const N: usize>(&mut self, corners: [u64; N]) -> Result<()> {
        if let Some(Wood { vertices, triangles, is_leaf: false }) = &mut self.wood {
            let corners = corners.map(|number| vertices[number as usize - 1]);
            triangles.extend((2..N).map(|i| [corners[0], corners[i - 1], corners[i]]));
        }
        self.text.push(b'f');
        let mut digits = itoa::Buffer::new();
        for c in corners {
            self.text.push(b' ');
            self.text.extend_from_slice(digits.format(c).as_bytes());
        }
        self.text.push(b'\n');
        self.triangles += N as u64 - 2;
        self.flush_when_full()
    }

    fn flush_when_full(&mut self) -> Result<()> {
        if self.text.len() >= FLUSH_AT { self.flush() } else { Ok(()) }
    }

    fn flush(&mut self) -> Result<()> {
        self.file.write(&self.text)?;
        self.text.clear();
        Ok(())
    }

    pub(super) fn finish(mut self) -> Result<Mesh> {
        self.flush()?;
        let wood = self.wood.map_or_else(Vec::new, |wood| wood.triangles);
        Ok(Mesh { triangles: self.triangles, bounds: self.bounds, path: self.file.finish(), wood })
    }
}

/// Summary of a written mesh file.
pub(super) struct Mesh {
    pub(super) path: PathBuf,
    pub(super) triangles: u64,
    pub(super) bounds: Aabb,
    /// The triangles that are not leaves; empty unless they were to be kept.
    pub(super) wood: Vec<[DVec3; 3]>,
}

/// Appends a length in units of 0.1 mm as decimal metres.
fn push_fixed(text: &mut Vec<u8>, units: i64) {
    if units < 0 {
        text.push(b'-');
    }
    let magnitude = units.unsigned_abs();
    let scale = 10u64.pow(DECIMALS as u32);
    text.extend_from_slice(itoa::Buffer::new().format(magnitude / scale).as_bytes());
    let mut rest = magnitude % scale;
    if rest == 0 {
        return;
    }
    let mut fraction = [b'0'; DECIMALS];
    for digit in fraction.iter_mut().rev() {
        *digit = b'0' + (rest % 10) as u8;
        rest /= 10;
    }
    let used = fraction.iter().rposition(|&d| d != b'0').map_or(0, |i| i + 1);
    text.push(b'.');
    text.extend_from_slice(&fraction[..used]);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coordinates_are_short_and_exact() {
        let text = |u| {
            let mut t = Vec::new();
            push_fixed(&mut t, u);
            String::from_utf8(t).unwrap()
        };
        assert_eq!(text(0), "0");
        assert_eq!(text(1_234_567), "123.4567");
        assert_eq!(text(-5), "-0.0005");
        assert_eq!(text(-1_205_000), "-120.5");
    }
}
