//! Rasters from point clouds: terrain, surface, canopy height, densities.
//!
//! Points are read once and summed in cells, so that memory grows with the number of cells that have points
//! and not with that of points. Corners of cells are at multiples of their side, so that rasters of
//! neighbouring tiles fit together.
//!
//! | file | what it does |
//! |---|---|
//! | `cells` | sums of points in cells |
//! | `hull` | the convex hull of cells |
//! | `options` | which rasters are made, and how |
//! | `part` | the points of a block that count |

mod cells;
mod hull;
mod options;
mod part;

pub use options::{RasterFiles, RasterKind, RasterOptions};

use crate::cloud::{CloudSource, in_command, too_many_cells};
use crate::geotiff::{Grid, geotiff};
use crate::neighbours::{Neighbours, plane_at};
use cells::Cells;
use part::BlockPart;
use rayon::prelude::*;
use std::any::Any;
use std::ops::ControlFlow;
use std::path::Path;
use vlscan_base::diag::{Diagnostics, Place};
use vlscan_base::error::{Error, Result};
use vlscan_base::quantity::{bytes, counted};
use vlscan_crs as crs;
use vlscan_formats::{
    Attribute, AttributeSet, NewPart, PointPart, PointRow, PointSink, Selection, StrayFinder, Strays,
};
use vlscan_geom::{DVec3, MAX_COORDINATE};

/// Ground samples through which the plane of a cell goes.
const SAMPLES_OF_PLANE: usize = 12;
/// Largest distance of these samples from a cell, in those at which there is terrain.
const MAX_REACH: f64 = 4.0;
/// Number of points of a file that are summed together, unless the file has blocks.
const PART_POINTS: usize = 1 << 12;
/// Most cells of a raster.
const MAX_CELLS: f64 = 1e8;

/// Points in cells, and the rasters that they make.
#[derive(Clone, Debug)]
pub struct CloudRasters {
    cells: Cells,
    columns: usize,
    rows: usize,
    /// Column and row of the south-western cell, counted from the origin of the coordinates.
    first: [i64; 2],
    /// System of the coordinates as WKT.
    crs: Option<String>,
    /// Number of points that count.
    pub points: u64,
    /// Points of the noise classes 7 and 18, which are left out.
    pub noise: u64,
    /// Pulses without a return, which are not points.
    pub misses: u64,
    /// Number of ground points.
    pub ground: u64,
    fill: f64,
}

/// Points that are summed.
struct Sink {
    cells: Cells,
    /// Points that are not summed yet.
    part: BlockPart,
    points: u64,
    noise: u64,
    misses: u64,
    first_returns: u64,
    ground: u64,
    strays: StrayFinder,
    /// Points that are left out.
    left_out: Option<Strays>,
    /// Bytes that cells may take.
    max_bytes: Option<u64>,
    attributes: AttributeSet,
    crs: Option<String>,
    skipped: u64,
    has_returns: bool,
    is_too_large: bool,
}

impl Sink {
    /// No points yet. The cells may take `max_bytes` of memory; `left_out` are points that do not count.
    fn new(cells: Cells, max_bytes: Option<u64>, left_out: Option<Strays>) -> Sink {
        Sink {
            cells,
            part: BlockPart::default(),
            points: 0,
            noise: 0,
            misses: 0,
            first_returns: 0,
            ground: 0,
            strays: StrayFinder::default(),
            left_out,
            max_bytes,
            attributes: AttributeSet::default(),
            crs: None,
            skipped: 0,
            has_returns: false,
            is_too_large: false,
        }
    }

    /// Adds the points of a block.
    fn sum(&mut self, part: &BlockPart) -> ControlFlow<()> {
        self.skipped += part.skipped;
        self.misses += part.misses;
        self.noise += part.noise;
        self.points += part.positions.len() as u64;
        self.strays.add_all(&part.positions);
        for (p, kind) in part.positions.iter().zip(&part.kinds) {
            self.ground += u64::from(kind.is_ground);
            self.first_returns += u64::from(kind.is_first_return);
            let has_grown = self.cells.add(*p, kind.is_first_return, kind.is_ground);
            self.is_too_large = has_grown && self.max_bytes.is_some_and(|max| self.cells.memory() > max);
            if self.is_too_large {
                return ControlFlow::Break(());
            }
        }
        ControlFlow::Continue(())
    }

    /// Adds the points that are not summed yet.
    fn sum_rest(&mut self) -> ControlFlow<()> {
        let mut part = std::mem::take(&mut self.part);
        let flow = self.sum(&part);
        part.clear();
        self.part = part;
        flow
    }
}

impl PointSink for Sink {
    fn start(&mut self, attributes: AttributeSet) {
        self.attributes = attributes;
        self.has_returns |= attributes.has(Attribute::ReturnNumber);
        self.part = BlockPart::new(attributes, self.left_out);
    }

    fn selection(&self) -> Selection {
        let is_used = |attribute| matches!(attribute, Attribute::Class | Attribute::ReturnNumber);
        Selection::Attributes(AttributeSet::of(is_used))
    }

    fn crs(&mut self, wkt: &str) {
        self.crs = Some(wkt.to_owned());
    }

    fn parts(&self) -> Option<NewPart> {
        let (attributes, left_out) = (self.attributes, self.left_out);
        Some(Box::new(move || -> Box<dyn PointPart> { Box::new(BlockPart::new(attributes, left_out)) }))
    }

    fn add_part(&mut self, part: &mut (dyn PointPart + 'static)) -> Result<ControlFlow<()>> {
        let part: &mut dyn Any = part;
        let flow = self.sum_rest();
        Ok(match part.downcast_ref::<BlockPart>() {
            Some(part) if flow.is_continue() => self.sum(part),
            _ => flow,
        })
    }

    fn point(&mut self, row: &PointRow, _: Option<&str>) -> Result<ControlFlow<()>> {
        self.part.add(row);
        Ok(match self.part.positions.len() >= PART_POINTS {
            true => self.sum_rest(),
            false => ControlFlow::Continue(()),
        })
    }
}

/// Checks that there are the points of which rasters of these kinds are made; `input` are the files as words
/// of a command.
fn check_points(sink: &Sink, kinds: &[RasterKind], name: &str, input: &str) -> Result<()> {
    if sink.points == 0 {
        return Err(Error::input(format!("{name}: no points to rasterise")));
    }
    if sink.ground == 0 && kinds.iter().any(|kind| kind.needs_ground()) {
        return Err(Error::input_with_help(
            format!(
                "{name}: no points of class 2 (ground), from which terrain and canopy height are computed"
            ),
            format!("classify the ground first, for example: pdal translate {input} classified.laz smrf"),
        ));
    }
    let reason = match sink.has_returns {
        false => Some("the points have no return numbers"),
        true => (sink.first_returns == 0).then_some("no point is one"),
    };
    if let Some(reason) = reason.filter(|_| kinds.contains(&RasterKind::PulseDensity)) {
        let message = format!("{name}: --pulse-density counts first returns, and {reason}; use --density");
        return Err(Error::input(message));
    }
    Ok(())
}

impl CloudRasters {
    /// Reads point clouds as one, for rasters of some kinds. `crs` is the system of clouds that name none, as
    /// WKT; `max_bytes` the memory that the cells may take. Also returns messages about the clouds.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::Input`] for files that are not point clouds, clouds in different systems, no
    /// points, too many cells, and without ground points if they are needed.
    pub fn read(
        clouds: &[CloudSource],
        kinds: &[RasterKind],
        options: &RasterOptions,
        crs: Option<String>,
        max_bytes: Option<u64>,
    ) -> Result<(CloudRasters, Diagnostics)> {
        options.check()?;
        let needs_ground = kinds.iter().any(|kind| kind.needs_ground());
        let mut all = Diagnostics::default();
        let new = |within| Sink::new(Cells::new(options.cell, needs_ground), max_bytes, within);
        let mut sink = new(None);
        let named = read_all(&mut sink, (clouds, options), crs.as_deref(), &mut all)?;
        let names: Vec<String> = clouds.iter().map(|cloud| cloud.name().display().to_string()).collect();
        let name = names.join(", ");
        let input = in_command(&clouds.iter().map(CloudSource::name).collect::<Vec<_>>());
        let strays = sink.strays.strays();
        if strays.count > 0 {
            // A raster of one point far away would be mostly empty, or too large.
            let is_read_again = clouds.iter().all(CloudSource::can_be_read_again);
            if is_read_again {
                sink = new(Some(strays));
                read_all(&mut sink, (clouds, options), crs.as_deref(), &mut Diagnostics::default())?;
            }
            let what = if is_read_again { "left out" } else { "in the raster, since a stream is read once" };
            strays.warn(Path::new(&name), what, &mut all);
        }
        check_points(&sink, kinds, &name, &input)?;
        let Sink { cells, points, noise, misses, ground, strays: finder, .. } = sink;
        let (first, last) = cells.extent();
        let [columns, rows] = [0, 1].map(|axis| last[axis] - first[axis] + 1);
        if columns as f64 * rows as f64 > MAX_CELLS {
            let counts = [columns as f64, rows as f64];
            return Err(too_many_cells((&name, &input), counts, options.cell, MAX_CELLS, &finder));
        }
        let rasters = CloudRasters {
            cells,
            columns: columns as usize,
            rows: rows as usize,
            first,
            crs: named.or(crs),
            points,
            noise,
            misses,
            ground,
            fill: options.fill,
        };
        Ok((rasters, all))
    }

    /// Side of a cell, m.
    pub fn side(&self) -> f64 {
        self.cells.side()
    }

    /// Number of cells from west to east and from south to north.
    pub fn size(&self) -> [usize; 2] {
        [self.columns, self.rows]
    }

    /// Largest distance from a ground point at which there is terrain, m.
    pub fn fill(&self) -> f64 {
        self.fill
    }

    /// The system of the coordinates as WKT.
    pub fn crs(&self) -> Option<&str> {
        self.crs.as_deref()
    }

    /// World coordinates of the south-western corner, m.
    pub fn corner(&self) -> [f64; 2] {
        self.first.map(|cell| cell as f64 * self.cells.side())
    }

    /// The values of a raster, row by row from the south west; NaN where there is none.
    pub fn values(&self, kind: RasterKind) -> Vec<f64> {
        let area = self.cells.side() * self.cells.side();
        let cell = |i: usize| {
            self.cells
                .cell([self.first[0] + (i % self.columns) as i64, self.first[1] + (i / self.columns) as i64])
        };
        let of_cells = |value: &(dyn Fn(cells::Cell) -> f64 + Sync)| -> Vec<f64> {
            let count = self.columns * self.rows;
            (0..count).into_par_iter().map(|i| cell(i).map_or(f64::NAN, value)).collect()
        };
        let densities = |value: &(dyn Fn(cells::Cell) -> u32 + Sync)| -> Vec<f64> {
            let values = of_cells(&|cell| f64::from(value(cell)) / area);
            values.into_iter().map(|value| if value.is_nan() { 0.0 } else { value }).collect()
        };
        match kind {
            RasterKind::Density => densities(&|cell| cell.points),
            RasterKind::PulseDensity => densities(&|cell| cell.pulses),
            RasterKind::Dsm => of_cells(&|cell| cell.highest),
            RasterKind::Dtm => self.terrain(),
            RasterKind::Chm => {
                let (surface, terrain) = (self.values(RasterKind::Dsm), self.terrain());
                surface.into_iter().zip(terrain).map(|(surface, terrain)| surface - terrain).collect()
            }
        }
    }

    /// Heights of the ground at the centres of cells: the plane through the nearest mean ground points of
    /// cells, within the convex hull of the cells with points and not farther from a ground point than is
    /// filled. Ground points beyond four times that distance are not searched.
    fn terrain(&self) -> Vec<f64> {
        let side = self.cells.side();
        let samples: Vec<DVec3> = self.cells.ground().collect();
        let neighbours = Neighbours::of(samples);
        let spans = hull::row_spans(&self.cells.row_ends(self.first, self.rows));
        let height = |i: usize| {
            let (column, row) = (i % self.columns, i / self.columns);
            if !spans[row].contains(column as f64) {
                return f64::NAN;
            }
            let [x, y] =
                [(0, column), (1, row)].map(|(axis, at)| (self.first[axis] as f64 + at as f64 + 0.5) * side);
            // Most cells of wide places without ground end here.
            if !neighbours.is_near(x, y, self.fill) {
                return f64::NAN;
            }
            let near = neighbours.nearest_within(x, y, SAMPLES_OF_PLANE, MAX_REACH * self.fill);
            plane_at(neighbours.points(), &near, [x, y])
        };
        (0..self.columns * self.rows).into_par_iter().map(height).collect()
    }

    /// A raster as the bytes of a GeoTIFF file, NaN where there is no value.
    ///
    /// # Errors
    /// [`Error::Input`] for a raster that is too large for the format.
    pub fn geotiff(&self, kind: RasterKind) -> Result<Vec<u8>> {
        let grid = Grid {
            columns: self.columns,
            rows: self.rows,
            side_m: self.cells.side(),
            corner: self.corner(),
            crs: self.crs(),
        };
        geotiff(&grid, &self.values(kind))
    }
}

/// Reads clouds into the sums; returns their system. `crs` is the system of those that name none.
fn read_all(
    sink: &mut Sink,
    (clouds, options): (&[CloudSource], &RasterOptions),
    crs: Option<&str>,
    all: &mut Diagnostics,
) -> Result<Option<String>> {
    let mut named: Option<String> = None;
    for cloud in clouds {
        let this = read_into(sink, cloud, options, all)?;
        for known in [named.as_deref(), crs].into_iter().flatten() {
            if let Some(this) = this.as_deref().filter(|this| crs::differ(known, this)) {
                let (shown, this, known) = (cloud.name().display(), crs::name(this), crs::name(known));
                let message = format!("{shown} is in {this}, not in {known}; a raster has one system");
                return Err(Error::input(message));
            }
        }
        named = named.or(this);
    }
    Ok(named)
}

/// Reads a cloud into the sums; returns its system.
fn read_into(
    sink: &mut Sink,
    cloud: &CloudSource,
    options: &RasterOptions,
    all: &mut Diagnostics,
) -> Result<Option<String>> {
    let (skipped, mut found) = (sink.skipped, Diagnostics::default());
    cloud.read(sink, &mut found)?;
    if sink.is_too_large || sink.sum_rest().is_break() {
        return Err(Error::input(format!(
            "cells of {} m over so large a place need more than {} of memory; take larger ones (--cell), \
             fewer files or more memory (--max-memory)",
            options.cell,
            bytes(sink.max_bytes.unwrap_or(u64::MAX))
        )));
    }
    if sink.skipped > skipped {
        let points = counted(sink.skipped - skipped, "point");
        let message = format!("left out: {points} without coordinates within ±{MAX_COORDINATE:e} m");
        found.warn(Some(Place::of_file(cloud.name())), message);
    }
    all.extend(found.finish(false)?);
    Ok(sink.crs.take())
}
