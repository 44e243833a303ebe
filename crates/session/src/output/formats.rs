//! The formats of the points of a run, with what is known of the points.

use super::context::OutputContext;
use super::request::OutputRequest;
use std::collections::BTreeMap;
use std::sync::Arc;
use vlscan_base::diag::Diagnostics;
use vlscan_base::error::Result;
use vlscan_crs as crs;
use vlscan_formats::{CloudSettings, ObjectIds, PointEncoder, PointFormat};

/// The formats that points are written in, and the facts about the points for them.
#[derive(Debug)]
pub(super) struct Formats {
    pub settings: CloudSettings,
    pub encoders: BTreeMap<PointFormat, Arc<dyn PointEncoder>>,
    /// That of tables whose columns differ from those of files.
    pub table: Option<TableFormat>,
}

/// The format of points in tables with their own choice of columns.
#[derive(Debug)]
pub(super) struct TableFormat {
    pub settings: CloudSettings,
    pub encoder: Arc<dyn PointEncoder>,
}

impl Formats {
    /// The formats of a request.
    ///
    /// # Errors
    /// [`Error::Input`](vlscan_base::error::Error::Input) for a format that this build does not write; other
    /// problems are recorded in `problems`.
    pub fn new(
        request: &OutputRequest,
        context: &OutputContext,
        objects: ObjectIds,
        problems: &mut Diagnostics,
    ) -> Result<Formats> {
        if let (Some(chosen), Some(named)) = (&request.cloud.crs, &context.crs)
            && crs::differ(chosen, named)
        {
            let message = format!(
                "--crs is {}, but the measured points are in {}",
                crs::name(chosen),
                crs::name(named)
            );
            problems.warn(None, message).help("leave out --crs: points are not reprojected");
        }
        let settings = cloud_settings(request, context, objects);
        let (has_table, has_own) = (request.has_point_table(), request.table_columns.is_some());
        let mut encoders = BTreeMap::new();
        let formats = request.sinks.iter().map(|(_, format)| *format);
        for format in formats.chain((has_table && !has_own).then_some(PointFormat::Arrow)) {
            encoders.insert(format, format.encoder(&settings, problems)?);
        }
        let mut table = None;
        if has_table && has_own {
            let mut settings = settings.clone();
            settings.columns.clone_from(&request.table_columns);
            let encoder = PointFormat::Arrow.encoder(&settings, problems)?;
            table = Some(TableFormat { settings, encoder });
        }
        Ok(Formats { settings, encoders, table })
    }
}

/// The settings of the request, with the facts about survey and scene.
fn cloud_settings(request: &OutputRequest, context: &OutputContext, objects: ObjectIds) -> CloudSettings {
    let mut settings = request.cloud.clone();
    settings.origin = context.shift;
    settings.bounds = context.bounds;
    settings.crs = settings.crs.or_else(|| context.crs.clone());
    settings.scanner.clone_from(&context.scanner);
    settings.adjusted_times = context.time_origin != 0.0;
    settings.parts.clone_from(&context.parts);
    settings.objects = objects;
    settings.highest_class = context.highest_class;
    settings.rings = context.devices.iter().map(|device| device.ring).collect();
    settings.stands = context.stands;
    settings.bins_ns = context.devices.iter().map(|device| device.bin).collect();
    settings.metres_per_ns = context.metres_per_ns;
    settings
}
