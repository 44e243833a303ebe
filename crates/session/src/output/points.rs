//! Files of the points of a table in memory, with the bytes that the run itself would have written.

use super::point_table::{PointTable, PositionFrame};
use super::request::{OutputRequest, Target};
use super::system::check_system;
use ::arrow_array::RecordBatch;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;
use vlscan_base::diag::{Diagnostics, Place};
use vlscan_base::error::{Error, Result};
use vlscan_base::files::refuse_existing;
use vlscan_formats::{
    CloudSettings, Column, Destination, EncodedFile, EncodedPoints, ExtraDimensions, Job, OBJECT_NAMES,
    ObjectIds, Offload, OutputStream, PointBatch, PointEncoder, PointFormat, PointRecord, Tally,
};
use vlscan_geom::{Aabb, DVec3};

/// Points that a thread encodes at a time.
const BLOCK_POINTS: usize = 1 << 15;

/// First bytes of stored facts, with the version of their form.
const MARK: &[u8] = b"VLFACTS 2\n";

/// Facts about the points of a table in addition to their columns.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CloudFacts {
    settings: CloudSettings,
    /// Number of each leg in records, and duration of its frames, ns.
    legs: Vec<(u16, f64)>,
}

impl CloudFacts {
    /// The facts that a run knows; only its choice of columns counts, without those that are always beside a
    /// table.
    pub(super) fn new(mut settings: CloudSettings, legs: Vec<(u16, f64)>) -> CloudFacts {
        let chosen = settings.columns.take().unwrap_or_default();
        let chosen: Vec<Column> =
            chosen.into_iter().filter(|column| !Column::EXACT.contains(column)).collect();
        let is_default = chosen.is_empty() || chosen == settings.table_columns();
        settings.columns = (!is_default).then_some(chosen);
        CloudFacts { settings, legs }
    }

    /// Facts about a table of another program: the box around its points, their highest class, its columns,
    /// and the names of objects in its metadata.
    /// `crs` is the coordinate reference system as WKT.
    ///
    /// # Errors
    /// [`Error::Input`] for columns that are not numeric, and names of objects in another form.
    pub fn of_table(table: &RecordBatch, crs: Option<String>) -> Result<CloudFacts> {
        let objects = ObjectIds::default();
        let rows =
            PointTable::new([Some(table), None], &objects, DVec3::ZERO, (PositionFrame::World, false))?;
        let (mut bounds, mut highest_class) = (Aabb::EMPTY, 0);
        for row in 0..rows.rows() {
            let PointRecord { position, class, .. } = rows.record(row);
            if position.is_finite() {
                bounds = bounds.with(position);
            }
            highest_class = highest_class.max(class);
        }
        let origin = if bounds.is_empty() { DVec3::ZERO } else { bounds.centre().round() };
        let bounds = Aabb { min: bounds.min - origin, max: bounds.max - origin };
        let columns = Column::ALL.iter().copied().filter(|column| rows.has(*column)).collect();
        let mut settings = CloudSettings::default();
        (settings.origin, settings.bounds) = (origin, bounds);
        (settings.crs, settings.highest_class) = (crs, highest_class);
        settings.columns = Some(columns);
        let schema = table.schema();
        let names = schema.metadata().get(OBJECT_NAMES).map(|text| serde_json::from_str(text));
        let names = names.transpose().map_err(|e| {
            let text = format!("the metadata {OBJECT_NAMES} are no JSON object of names by numbers: {e}");
            Error::input(text)
        })?;
        settings.objects = ObjectIds::of_names(names.unwrap_or_default());
        Ok(CloudFacts { settings, legs: Vec::new() })
    }

    /// The facts as bytes.
    ///
    /// # Errors
    /// [`Error::Internal`].
    pub fn to_bytes(&self) -> Result<Vec<u8>> {
        let mut bytes = MARK.to_vec();
        let facts = postcard::to_stdvec(self);
        bytes.extend(facts.map_err(|e| Error::Internal(format!("facts about points: {e}")))?);
        Ok(bytes)
    }

    /// The facts that [`CloudFacts::to_bytes`] has made bytes of.
    ///
    /// # Errors
    /// [`Error::Input`] for other bytes.
    pub fn from_bytes(bytes: &[u8]) -> Result<CloudFacts> {
        let other = |e: &str| Error::input(format!("the points are of another version of vlscan: {e}"));
        let stored =
            bytes.strip_prefix(MARK).ok_or_else(|| other("their stored facts have another format"))?;
        postcard::from_bytes(stored).map_err(|e| other(&e.to_string()))
    }
}

/// Writes the points of a table to the file of a request, which has no other outputs. `exact` are the columns
/// [`Column::EXACT`] of the same rows, as far as they are known: with them, and if the table has the columns
/// that a run writes by default, the bytes are those that the run would have written. Returns the counts and
/// notes for the user.
///
/// # Errors
/// [`Error::Input`] for a file that exists unless it is to be replaced, for columns that the format needs and
/// the table lacks, and for requests of another kind; [`Error::Io`].
pub fn write_points(
    table: &RecordBatch,
    exact: Option<&RecordBatch>,
    facts: &CloudFacts,
    request: &OutputRequest,
) -> Result<(Tally, Diagnostics)> {
    let [(Target::File(path), format)] = &request.sinks[..] else {
        return Err(Error::input("points in memory are written to one file"));
    };
    if request.division.is_some() || request.split_by_channel || request.waveforms || request.pulses {
        return Err(Error::input("points in memory are written to one file without waveforms and pulses"));
    }
    let mut found = Diagnostics::default();
    let mut settings = settings_of(facts, request);
    let frame = match format.has_columns() || format.has_frames() || matches!(format, PointFormat::E57) {
        true => PositionFrame::World,
        false => PositionFrame::Scene,
    };
    let objects = std::mem::take(&mut settings.objects);
    let rows =
        PointTable::new([Some(table), exact], &objects, settings.origin, (frame, format.has_frames()))?
            .with_misses(settings.misses);
    check_columns(&rows, *format, &mut settings, path, &mut found)?;
    warn_of_unknown(table, path, &mut found);
    if let Some(wkt) = request.cloud.crs.as_deref() {
        let centre = settings.bounds.centre() + settings.origin;
        check_system(wkt, (!settings.bounds.is_empty()).then_some(centre), &mut found);
    }
    settings.objects = objects.clone();
    if frame == PositionFrame::World {
        settings.bounds = settings.bounds.translated(settings.origin);
        settings.origin = DVec3::ZERO;
    }
    refuse_existing(path, request.force)?;
    let encoder = format.encoder(&settings, &mut found)?;
    if found.is_fatal(false) {
        return Err(Error::Input(Box::new(found)));
    }
    let out = OutputStream::open(&Destination::Path(path.clone()), request.force, encoder.patched())?;
    let mut file = EncodedFile::begin(out, |out| encoder.clone().begin(out))?;
    let frames = Frames::new(facts, request, format.has_frames());
    let starts: Vec<usize> = (0..rows.rows()).step_by(BLOCK_POINTS).collect();
    for group in starts.chunks(4 * rayon::current_num_threads().max(1)) {
        let encoded: Vec<EncodedPoints> =
            group.par_iter().map(|start| encode(&rows, *start, &*encoder, &frames)).collect();
        for block in encoded {
            file.append(block.bytes, &block.tally, &IdleThreads)?;
        }
    }
    let (out, tally) = file.finish(false, &IdleThreads, |_| Ok(None))?;
    out.finish()?;
    if tally.left_out > 0 {
        let message =
            format!("{} points are left out: the format cannot hold their coordinates", tally.left_out);
        found.warn(Some(Place::of_file(path)), message);
    }
    Ok((tally, found))
}

/// Encodes the rows of a block.
fn encode(rows: &PointTable, start: usize, encoder: &dyn PointEncoder, frames: &Frames) -> EncodedPoints {
    let end = (start + BLOCK_POINTS).min(rows.rows());
    let records: Vec<PointRecord> = (start..end).map(|row| rows.record(row)).collect();
    let mut out = EncodedPoints::with_capacity(records.len() * encoder.typical_bytes());
    for points in frames.batches(&records) {
        encoder.encode(&PointBatch { points, waves: &[], frame_ns: frames.duration_ns(points) }, &mut out);
    }
    out
}

/// Durations of the frames of legs.
struct Frames {
    chosen_ns: Option<f64>,
    by_leg: BTreeMap<u16, f64>,
    matter: bool,
}

impl Frames {
    fn new(facts: &CloudFacts, request: &OutputRequest, matter: bool) -> Frames {
        let chosen_ns = request.frame_s.map(|seconds| seconds * 1e9);
        Frames { chosen_ns, by_leg: facts.legs.iter().copied().collect(), matter }
    }

    /// Points of the same leg, as far as it matters.
    fn batches<'p>(&self, points: &'p [PointRecord]) -> impl Iterator<Item = &'p [PointRecord]> {
        let matter = self.matter;
        points.chunk_by(move |a, b| !matter || a.leg == b.leg)
    }

    fn duration_ns(&self, points: &[PointRecord]) -> f64 {
        let of_leg = points.first().and_then(|point| self.by_leg.get(&point.leg)).copied();
        self.chosen_ns.or(of_leg).unwrap_or(PointBatch::FRAME_NS)
    }
}

/// Settings of the format.
fn settings_of(facts: &CloudFacts, request: &OutputRequest) -> CloudSettings {
    let cloud = &request.cloud;
    let mut settings = facts.settings.clone();
    settings.crs = cloud.crs.clone().or(settings.crs);
    settings.labels |= cloud.labels;
    settings.columns = cloud.columns.clone().or(settings.columns);
    settings.las = cloud.las.clone();
    settings.frame_names = cloud.frame_names.clone();
    settings
}

/// Warns of columns that no format has.
fn warn_of_unknown(table: &RecordBatch, path: &Path, found: &mut Diagnostics) {
    let schema = table.schema();
    let names = schema.fields().iter().map(|field| field.name().as_str());
    let unknown: Vec<&str> =
        names.filter(|name| Column::ALL.iter().all(|column| column.name() != *name)).collect();
    if !unknown.is_empty() {
        let problem = found.warn(
            Some(Place::of_file(path)),
            format!("columns that no file of points has are not written: {}", unknown.join(", ")),
        );
        problem.help(
            "the columns of points are those that `vlscan.columns()` lists; files of tables, such as Parquet \
             of pandas, hold any",
        );
    }
}

/// Rejects formats that need columns missing from the table, and notes the columns written as 0.
fn check_columns(
    rows: &PointTable,
    format: PointFormat,
    settings: &mut CloudSettings,
    path: &Path,
    found: &mut Diagnostics,
) -> Result<()> {
    use Column::{
        Amplitude, BeamOriginX, BeamOriginY, BeamOriginZ, Classification, Device, EchoWidth, GpsTime,
        IncidenceAngle, Intensity, NumberOfReturns, ObjectId, PointSourceId, PulseNumber, Range,
        ReturnNumber, ScanAngle, ScannerX, ScannerY, ScannerZ, X, Y, Z,
    };
    let origins: &[Column] = &[X, Y, Z, BeamOriginX, BeamOriginY, BeamOriginZ];
    let needed = match format {
        PointFormat::E57 | PointFormat::RayCloud => origins,
        PointFormat::Mcap => &[X, Y, Z, ScannerX, ScannerY, ScannerZ, GpsTime],
        _ => &[X, Y, Z],
    };
    let colours = [Column::Red, Column::Green, Column::Blue];
    if format.has_colours() && settings.columns.is_none() && colours.iter().all(|column| rows.has(*column)) {
        settings.columns = Some(colours.to_vec());
    }
    let is_free = settings.columns.as_ref().is_none_or(|columns| *columns == colours);
    if is_free && format.has_velocities() && rows.has(Column::Doppler) {
        settings.columns.get_or_insert_default().push(Column::Doppler);
    }
    if is_free && format.has_light_labels() && rows.has(Column::Path) {
        let labels = [Column::Path, Column::PathOrder, Column::SurfaceX, Column::SurfaceY, Column::SurfaceZ];
        let labels = labels.into_iter().chain([Column::Primitive]).filter(|column| rows.has(*column));
        settings.columns.get_or_insert_default().extend(labels);
    }
    let chosen = if format.has_columns() { settings.columns.as_deref().unwrap_or_default() } else { &[] };
    let missing = |columns: &[Column]| {
        let names: Vec<&str> = columns.iter().filter(|c| !rows.has(**c)).map(|c| c.name()).collect();
        (!names.is_empty()).then(|| names.join(", "))
    };
    if let Some(names) = missing(&[needed, chosen].concat()) {
        let message = format!("{} needs columns that the points lack: {names}", path.display());
        let help = "add them to the columns of the run; in Python columns=vlscan.columns() has all of them";
        return Err(Error::input_with_help(message, help));
    }
    let extra = [EchoWidth, PulseNumber, ObjectId, Amplitude, Device, Range, IncidenceAngle];
    if format.is_las() && settings.las.extra == ExtraDimensions::All && missing(&extra).is_some() {
        settings.las.extra = ExtraDimensions::None;
    }
    let common = [ReturnNumber, NumberOfReturns, Classification, ScanAngle, PointSourceId, GpsTime];
    let mut absent: Vec<&str> = Vec::new();
    if format.is_las() {
        absent.extend(common.iter().filter(|c| !rows.has(**c)).map(|c| c.name()));
        if !rows.has(Amplitude) && !rows.has(Intensity) {
            absent.push(Intensity.name());
        }
    }
    if !absent.is_empty() {
        let message = format!(
            "the points have no {}: single returns, and 0 for everything else, are written",
            absent.join(", ")
        );
        found.warn(Some(Place::of_file(path)), message);
    }
    Ok(())
}

/// Runs jobs of writers in idle threads.
struct IdleThreads;

impl Offload for IdleThreads {
    fn try_run(&self, job: Job) -> std::result::Result<(), Job> {
        rayon::spawn(job);
        Ok(())
    }

    fn threads(&self) -> usize {
        rayon::current_num_threads()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use vlscan_formats::PacketPlace;

    #[test]
    fn facts_are_stored_whole() {
        let mut settings = CloudSettings::default();
        settings.parts = vec!["north".to_owned(), "7".to_owned()];
        settings.objects = ObjectIds::new(&settings.parts);
        settings.columns = Some(vec![Column::X, Column::Subray]);
        settings.las.packets = Some(PacketPlace::Beside);
        settings.frame_names.world = "site".to_owned();
        settings.bins_ns = vec![0.25];
        let facts = CloudFacts { settings, legs: vec![(3, 1e8)] };
        let bytes = facts.to_bytes().unwrap();
        assert_eq!(CloudFacts::from_bytes(&bytes).unwrap(), facts);
        for other in [&bytes[MARK.len()..], &bytes[..bytes.len() - 1], b""] {
            let error = CloudFacts::from_bytes(other).unwrap_err().to_string();
            assert!(error.contains("another version of vlscan"), "{error}");
        }
    }
}
