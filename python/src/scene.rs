//! Scenes of files and of arrays. A scene and its tree are loaded once and shared by all runs that need the
//! same ones.

use crate::cast::{cast, vectors};
use crate::changes::Changes;
use crate::errors::{Notices, exception};
use crate::options::values;
use crate::table::{Column, Table};
use crate::watch::{Interruption, interruptible, watched};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::pybacked::PyBackedBytes;
use pyo3::types::{PyBytes, PyDict, PyList};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use vlscan::geom::{DVec3, Rotation};
use vlscan::scene::{Pack, pack};
use vlscan::survey::{
    Loader, MaterialChoice, MeshReading, OpticsDefinition, PartRecipe, RasterFiles, SceneRecipe, Transform,
    UpAxis, VoxelLoader, VoxelMode, WaterDefinition, XyzLoader, find_raster,
};
use vlscan::{LoadedScene, MaterialDefinition, OptionValues, ReadOptions, ResolvedRun, Session, read_scene};

/// Triangles with materials.
#[pyclass(frozen, module = "vlscan")]
pub struct Mesh(Arc<vlscan::Mesh>);

#[pymethods]
impl Mesh {
    /// `vertices`: bytes of doubles, three per vertex, m. `triangles`: bytes of unsigned 32-bit integers,
    /// three per triangle. `materials`: dictionaries. `material_of`: bytes of unsigned 32-bit integers, one
    /// per triangle, or none.
    #[new]
    fn new(
        py: Python<'_>,
        vertices: &[u8],
        triangles: &[u8],
        materials: Vec<Bound<'_, PyDict>>,
        material_of: &[u8],
    ) -> PyResult<Mesh> {
        let vertices = vectors(vertices);
        let triangles = triangles.as_chunks::<4>().0.as_chunks::<3>().0.iter();
        let triangles = triangles.map(|t| t.map(u32::from_le_bytes)).collect();
        let materials = materials.iter().map(material).collect::<PyResult<Vec<_>>>()?;
        let mesh = vlscan::Mesh::new(vertices, triangles, materials, indices(material_of));
        mesh.map(|mesh| Mesh(Arc::new(mesh))).map_err(|error| exception(py, error))
    }

    /// Its materials, as dictionaries.
    fn materials<'py>(&self, py: Python<'py>) -> PyResult<Vec<Bound<'py, PyDict>>> {
        self.0.materials().iter().map(|material| fields_of(py, material)).collect()
    }

    /// The arguments that make an equal mesh.
    #[allow(clippy::type_complexity, reason = "unpacked by the package")]
    fn parts<'py>(
        &self,
        py: Python<'py>,
    ) -> PyResult<(Bound<'py, PyBytes>, Bound<'py, PyBytes>, Vec<Bound<'py, PyDict>>, Bound<'py, PyBytes>)>
    {
        let mesh = &self.0;
        let vertices = mesh.vertices().iter().flat_map(|v| v.to_array()).flat_map(f64::to_le_bytes);
        let triangles = mesh.triangles().iter().flatten().flat_map(|index| index.to_le_bytes());
        let material_of = mesh.material_of().iter().flat_map(|index| index.to_le_bytes());
        Ok((
            PyBytes::new(py, &vertices.collect::<Vec<u8>>()),
            PyBytes::new(py, &triangles.collect::<Vec<u8>>()),
            self.materials(py)?,
            PyBytes::new(py, &material_of.collect::<Vec<u8>>()),
        ))
    }
}

/// The dictionary of a material.
pub fn fields_of<'py>(py: Python<'py>, material: &MaterialDefinition) -> PyResult<Bound<'py, PyDict>> {
    let fields = PyDict::new(py);
    fields.set_item("name", &material.name)?;
    fields.set_item("diffuse", material.kd)?;
    fields.set_item("specular", material.ks)?;
    fields.set_item("specular_exponent", material.ns)?;
    // In radians, which degrees would not give back bit for bit.
    fields.set_item("roughness", material.roughness)?;
    fields.set_item("element_size_m", material.element_size)?;
    fields.set_item("reflectance", material.reflectance)?;
    fields.set_item("spectrum", material.spectrum.as_deref())?;
    fields.set_item("classification", material.classification)?;
    fields.set_item("is_ground", material.is_ground)?;
    fields.set_item("is_leaf", material.leaf)?;
    fields.set_item("mirror", material.optics.mirror)?;
    fields.set_item("pane_index", material.optics.index)?;
    fields.set_item("pane_thickness_m", material.optics.thickness)?;
    fields.set_item("pane_absorption", material.optics.absorption)?;
    fields.set_item("pane_sheets", material.optics.sheets)?;
    fields.set_item("retro", material.optics.retro)?;
    let water = &material.optics.water;
    fields.set_item("water_index", water.index)?;
    fields.set_item("water_group_index", water.group_index)?;
    fields.set_item("water_attenuation", water.attenuation)?;
    fields.set_item("water_secchi_m", water.secchi)?;
    fields.set_item("water_beam_attenuation", water.beam_attenuation)?;
    fields.set_item("water_backscatter", water.backscatter)?;
    fields.set_item("water_wind_m_s", water.wind)?;
    fields.set_item("water_wind_deg", water.wind_direction)?;
    Ok(fields)
}

/// A material from a dictionary whose keys the class `Material` of the package sets.
pub fn material(fields: &Bound<'_, PyDict>) -> PyResult<MaterialDefinition> {
    let get = |key: &str| item(fields, key);
    Ok(MaterialDefinition {
        name: get("name")?.extract()?,
        kd: get("diffuse")?.extract()?,
        ks: get("specular")?.extract()?,
        ns: get("specular_exponent")?.extract()?,
        roughness: match fields.get_item("roughness")? {
            Some(exact) => exact.extract()?,
            None => get("roughness_deg")?.extract::<f64>()?.to_radians(),
        },
        element_size: get("element_size_m")?.extract()?,
        reflectance: get("reflectance")?.extract()?,
        spectrum: get("spectrum")?.extract()?,
        classification: get("classification")?.extract()?,
        is_ground: get("is_ground")?.extract()?,
        leaf: get("is_leaf")?.extract()?,
        optics: OpticsDefinition {
            mirror: get("mirror")?.extract()?,
            index: get("pane_index")?.extract()?,
            thickness: get("pane_thickness_m")?.extract()?,
            absorption: get("pane_absorption")?.extract()?,
            sheets: get("pane_sheets")?.extract()?,
            retro: get("retro")?.extract()?,
            opacity: None,
            water: WaterDefinition {
                index: get("water_index")?.extract()?,
                group_index: get("water_group_index")?.extract()?,
                attenuation: get("water_attenuation")?.extract()?,
                secchi: get("water_secchi_m")?.extract()?,
                beam_attenuation: get("water_beam_attenuation")?.extract()?,
                backscatter: get("water_backscatter")?.extract()?,
                wind: get("water_wind_m_s")?.extract()?,
                wind_direction: get("water_wind_deg")?.extract()?,
            },
        },
        colour: None,
        unused_optics: None,
        place: None,
    })
}

/// A part of a scene: geometry and where it stands.
#[pyclass(frozen, module = "vlscan")]
pub struct Part(PartRecipe);

#[pymethods]
impl Part {
    /// A part of a mesh in memory.
    #[staticmethod]
    fn of_mesh(mesh: &Mesh, place: &Bound<'_, PyDict>) -> PyResult<Part> {
        part(Loader::Mesh(mesh.0.clone()), place)
    }

    /// A part of a mesh file: OBJ, PLY, STL, OFF or glTF. `up`: `y` or `z`, none for that of the format.
    /// `unit`: of coordinates. `materials`: a table of materials.
    #[staticmethod]
    fn of_mesh_file(
        path: PathBuf,
        up: Option<&str>,
        unit: Option<&str>,
        materials: Option<PathBuf>,
        place: &Bound<'_, PyDict>,
    ) -> PyResult<Part> {
        let up = match up {
            None => None,
            Some("y") => Some(UpAxis::Y),
            Some("z") => Some(UpAxis::Z),
            Some(other) => {
                return Err(PyValueError::new_err(format!("up is {other:?}; expected 'y' or 'z'")));
            }
        };
        let metres = |unit: &str| {
            let message = format!("unit is {unit:?}; expected {}", MeshReading::UNITS);
            MeshReading::unit(unit).ok_or_else(|| PyValueError::new_err(message))
        };
        let reading = MeshReading { up, unit_m: unit.map(metres).transpose()?, materials };
        part(Loader::MeshFiles { files: vec![path], reading }, place)
    }

    /// A part of a terrain raster: a file, a virtual raster, a folder or a pattern of tiles, or several files
    /// as tiles.
    #[staticmethod]
    fn of_raster(
        py: Python<'_>,
        paths: Vec<PathBuf>,
        material: &Bound<'_, PyDict>,
        place: &Bound<'_, PyDict>,
    ) -> PyResult<Part> {
        let files = match &paths[..] {
            // Single rasters are looked for when the scene is loaded.
            [path] if has_tiles(path) => {
                let found = find_raster(&path.to_string_lossy(), &ReadOptions::default());
                let (files, warnings) = found.map_err(|error| exception(py, error))?;
                let notices = Notices::default();
                notices.add(vlscan::Notice::Warnings(warnings));
                notices.issue(py)?;
                files
            }
            [] => return Err(PyValueError::new_err("there is no raster, expected at least one file")),
            _ => RasterFiles::Tiles(paths),
        };
        part(Loader::GeoTiff { files, material: choice(material)? }, place)
    }

    /// A part of a point cloud as text, which becomes voxels.
    #[staticmethod]
    fn of_points(
        path: PathBuf,
        settings: &Bound<'_, PyDict>,
        material: &Bound<'_, PyDict>,
        place: &Bound<'_, PyDict>,
    ) -> PyResult<Part> {
        let get = |key: &str| item(settings, key);
        let normal: Option<[f64; 3]> = get("default_normal")?.extract()?;
        let loader = XyzLoader {
            files: vec![path],
            separator: get("separator")?.extract()?,
            voxel_size: get("voxel_size")?.extract()?,
            max_color_value: get("max_color_value")?.extract()?,
            default_normal: normal.map(DVec3::from),
            rgb_columns: get("rgb_columns")?.extract()?,
            normal_columns: get("normal_columns")?.extract()?,
            snap_neighbor_normal: get("snap_neighbor_normal")?.extract()?,
            estimate_normals: get("estimate_normals")?.extract()?,
            material: choice(material)?,
        };
        part(Loader::Xyz(Box::new(loader)), place)
    }

    /// A part of vegetation voxels (AMAPVox).
    #[staticmethod]
    fn of_voxels(
        path: PathBuf,
        settings: &Bound<'_, PyDict>,
        material: &Bound<'_, PyDict>,
        place: &Bound<'_, PyDict>,
    ) -> PyResult<Part> {
        let get = |key: &str| item(settings, key);
        let mode: String = get("mode")?.extract()?;
        let loader = VoxelLoader {
            files: vec![path],
            mode: match mode.as_str() {
                "transmittive" => VoxelMode::Transmittive,
                "fixed" => VoxelMode::Fixed,
                "scaled" => VoxelMode::Scaled(get("exponent")?.extract()?),
                other => {
                    let expected = "expected transmittive, fixed or scaled";
                    return Err(PyValueError::new_err(format!("mode is {other:?}; {expected}")));
                }
            },
            drop_empty: get("drop_empty")?.extract()?,
            random_shift: get("random_shift")?.extract()?,
            lad_table: get("lad_table")?.extract()?,
            material: choice(material)?,
        };
        part(Loader::DetailedVoxels(Box::new(loader)), place)
    }
}

/// True if a path is that of a virtual raster or a folder, or a pattern.
fn has_tiles(path: &Path) -> bool {
    let is_virtual = path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("vrt"));
    is_virtual || path.is_dir() || path.to_string_lossy().contains(['*', '?'])
}

fn item<'py>(fields: &Bound<'py, PyDict>, key: &str) -> PyResult<Bound<'py, PyAny>> {
    fields.get_item(key)?.ok_or_else(|| PyTypeError::new_err(format!("{key} is missing")))
}

fn choice(fields: &Bound<'_, PyDict>) -> PyResult<MaterialChoice> {
    Ok(MaterialChoice {
        file: item(fields, "file")?.extract()?,
        name: item(fields, "name")?.extract()?,
        random_variants: 0,
        random_range: 1.0,
    })
}

/// Unsigned 32-bit integers.
pub fn indices(bytes: &[u8]) -> Vec<u32> {
    let (numbers, _) = bytes.as_chunks();
    numbers.iter().map(|number| u32::from_le_bytes(*number)).collect()
}

/// A part with its place: `axis` and `angle` (rad) of its rotation, `scale`, `offset` (m), `on_ground`, `id`.
fn part(loader: Loader, place: &Bound<'_, PyDict>) -> PyResult<Part> {
    let get = |key: &str| item(place, key);
    let axis = DVec3::from(get("axis")?.extract::<[f64; 3]>()?);
    let angle: f64 = get("angle")?.extract()?;
    Ok(Part(PartRecipe {
        id: get("id")?.extract()?,
        changes: get("changes")?.cast::<Changes>()?.get().0.clone(),
        transform: Transform {
            rotation: if angle == 0.0 { Rotation::IDENTITY } else { Rotation::about(axis, angle) },
            scale: get("scale")?.extract()?,
            offset: DVec3::from(get("offset")?.extract::<[f64; 3]>()?),
            on_ground: get("on_ground")?.extract()?,
            ..Transform::IDENTITY
        },
        ..PartRecipe::new(loader)
    }))
}

/// Scene that is scanned.
#[pyclass(frozen, module = "vlscan")]
pub struct Scene {
    pub recipe: Arc<SceneRecipe>,
    loaded: Mutex<Option<LoadedScene>>,
}

#[pymethods]
impl Scene {
    /// Reads a scene: `file.xml#id`, `file.xml`, a geometry file, a table of instances or a packed scene.
    #[staticmethod]
    fn read(py: Python<'_>, reference: &str, assets: Vec<PathBuf>) -> PyResult<Scene> {
        let options = ReadOptions { assets, ..ReadOptions::default() };
        let reference = reference.to_owned();
        let read = interruptible(py, move |_| read_scene(&reference, &options))?;
        let (recipe, warnings) = read.map_err(|error| exception(py, error))?;
        let notices = Notices::default();
        notices.add(vlscan::Notice::Warnings(warnings));
        notices.issue(py)?;
        Ok(Scene::of(recipe))
    }

    /// A scene of parts.
    #[staticmethod]
    fn of_parts(parts: &Bound<'_, PyList>, asset_folders: Vec<PathBuf>) -> PyResult<Scene> {
        let mut recipes = Vec::new();
        for part in parts {
            recipes.push(part.cast_into::<Part>()?.get().0.clone());
        }
        let recipe = SceneRecipe::of_parts("<python>", recipes);
        Ok(Scene::of(SceneRecipe { asset_folders, ..recipe }))
    }

    /// Ids of the parts that the description names; none for packed scenes.
    #[getter]
    fn part_count(&self) -> usize {
        self.recipe.parts.len()
    }

    /// Loads scene and tree now; otherwise the first run does. `options` are those of a run, `document`
    /// is a pipeline.
    fn load(own: Py<Self>, py: Python<'_>, document: String, options: &Bound<'_, PyDict>) -> PyResult<()> {
        let (notices, interruption) = (Notices::default(), Interruption::default());
        let options = values(options)?;
        let is_by_itself = options.is_empty();
        let mut job = own.get().job(document, options).map_err(|error| exception(py, error))?;
        if let (true, Some(path)) = (is_by_itself, &own.get().recipe.packed) {
            let pack = Pack::open(path).map_err(|error| exception(py, error))?;
            job.settings.load.rules = pack.conditions().rules;
        }
        interruption.watch(&mut job.settings);
        let own_notices = notices.clone();
        let work = move || own.get().session(job, &own_notices).map(drop);
        let done = watched(py, &interruption, work, || py.check_signals())?;
        notices.issue(py)?;
        done.map_err(|error| exception(py, error))
    }

    /// Writes scene and tree to a packed scene; the other arguments are those of `load`.
    fn pack(
        &self,
        py: Python<'_>,
        path: PathBuf,
        document: String,
        options: &Bound<'_, PyDict>,
    ) -> PyResult<()> {
        let (notices, interruption) = (Notices::default(), Interruption::of_writing());
        let job = self.job(document, values(options)?);
        let mut settings = job.map_err(|error| exception(py, error))?.settings;
        interruption.watch(&mut settings);
        let recipe = self.recipe.clone();
        let own_notices = notices.clone();
        let work = move || {
            let strict = settings.strict;
            let warn = |found: &vlscan::Diagnostics| {
                own_notices.add(vlscan::Notice::Warnings(found.clone().finish(strict)?));
                Ok(())
            };
            pack(&recipe, &settings.load, &settings.tree, &path, &warn).map(drop)
        };
        let done = watched(py, &interruption, work, || py.check_signals())?;
        notices.issue(py)?;
        done.map_err(|error| exception(py, error))
    }

    /// True if scene and tree are in memory.
    #[getter]
    fn is_loaded(&self) -> bool {
        self.lock().is_some()
    }

    /// Frees scene and tree.
    fn unload(&self) {
        *self.lock() = None;
    }

    /// Box, number of primitives, ids of parts, materials (name, reflectance, class) and memory of the loaded
    /// scene.
    #[allow(clippy::type_complexity, reason = "unpacked by the package")]
    fn facts(&self) -> Option<([[f64; 3]; 2], u64, Vec<String>, Vec<(String, f64, i32)>, u64)> {
        let facts = self.lock().as_ref()?.facts();
        let bounds = [facts.bounds.min.to_array(), facts.bounds.max.to_array()];
        Some((bounds, facts.primitives, facts.parts, facts.materials, facts.memory))
    }

    /// All facts of the loaded scene as JSON, as `vlscan scene info --json` writes them.
    fn report(&self, py: Python<'_>) -> PyResult<Option<String>> {
        let Some(loaded) = self.lock().clone() else { return Ok(None) };
        let made = interruptible(py, move |_| vlscan::scene_json(&loaded))?;
        made.map(Some).map_err(|error| exception(py, error))
    }

    /// World height of the ground of the loaded scene at (x, y), m.
    fn ground_height(&self, py: Python<'_>, x: f64, y: f64) -> Option<f64> {
        let loaded = self.lock().clone()?;
        py.detach(|| loaded.ground_height(x, y))
    }

    /// Points on the surfaces of the loaded scene.
    fn sample(&self, py: Python<'_>, count: usize) -> PyResult<Option<Table>> {
        let Some(loaded) = self.lock().clone() else { return Ok(None) };
        let sampled =
            interruptible(py, move |_| loaded.sample(count))?.map_err(|error| exception(py, error))?;
        Ok(Some(Table::new(sampled)))
    }

    /// First hits of rays on the loaded scene: distances, parts, primitives, normals. Origins and directions
    /// are bytes of doubles, three per ray.
    #[allow(clippy::type_complexity, reason = "unpacked by the package")]
    fn cast(
        &self,
        py: Python<'_>,
        origins: PyBackedBytes,
        directions: PyBackedBytes,
    ) -> PyResult<Option<(Column, Column, Column, Column)>> {
        let Some(loaded) = self.lock().clone() else { return Ok(None) };
        let notices = Notices::default();
        let own_notices = notices.clone();
        let hits = interruptible(py, move |_| {
            let notify = |notice: vlscan::Notice| own_notices.add(notice);
            cast(&loaded, (&origins, &directions), &notify)
        })?;
        notices.issue(py)?;
        let found = hits.map_err(|error| exception(py, error))?;
        let [distance, part, primitive, normal] = found.map(Column::new);
        Ok(Some((distance, part, primitive, normal)))
    }
}

impl Scene {
    fn of(recipe: SceneRecipe) -> Scene {
        Scene { recipe: Arc::new(recipe), loaded: Mutex::new(None) }
    }

    /// The loaded scene, if it is in memory.
    pub fn loaded(&self) -> Option<LoadedScene> {
        self.lock().clone()
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, Option<LoadedScene>> {
        self.loaded.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn job(&self, document: String, options: OptionValues) -> vlscan::Result<ResolvedRun> {
        let mut options = vlscan::Options::of_values(options)?;
        options.is_traced = true;
        options.scene = Some(self.recipe.clone());
        ResolvedRun::of_text("<python>".as_ref(), document, &options).map(|(job, _)| job)
    }

    /// A session over this scene, which is loaded if the one in memory is not the one that the settings ask
    /// for.
    pub fn session(&self, job: ResolvedRun, notices: &Notices) -> vlscan::Result<Session> {
        let loaded = self.lock().clone();
        if let Some(loaded) = loaded.filter(|loaded| loaded.suits(&job.settings)) {
            return Session::new(job.settings, loaded, notices.observer());
        }
        // Only one scene is kept.
        self.unload();
        let session = Session::open(job.settings, notices.observer())?;
        *self.lock() = session.loaded();
        Ok(session)
    }
}
