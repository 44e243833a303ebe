//! Properties shared by all LAS files of a run: version, scale, offset, extra bytes, variable length records.

use super::packets::WavePackets;
use super::vlr::{self, Groups};
use crate::columnar::LightColumns;
use crate::las::{ExtraDimensions, LasVersion, PacketPlace};
use crate::settings::CloudSettings;
use vlscan_base::diag::Diagnostics;
use vlscan_geom::{Aabb, DVec3};

/// Coarsest scale that can be chosen where finer ones hold the scene, m.
const MAX_SCALE: f64 = 1.0;
/// Highest class of point format 1.
pub(super) const MAX_CLASS_1: i32 = 31;

#[derive(Debug)]
pub(in crate::las) struct LasFormat {
    pub version: LasVersion,
    /// Metres per unit.
    pub scale: f64,
    /// World position of the origin of the stored integers, m.
    pub offset: DVec3,
    /// Origin of points relative to the offset, m.
    pub shift: DVec3,
    pub extra: ExtraDimensions,
    /// Number of points in the header of a stream that cannot be patched.
    pub at_most: Option<u64>,
    /// Box around all points that can occur, in stored integers, for the header of a stream that cannot be
    /// patched.
    pub(super) reach: Aabb,
    pub groups: Groups,
    /// True if points have the colour of the surface.
    pub colours: bool,
    /// True if these colours are widened to 16 bits where all of them have 8.
    pub widens_colours: bool,
    /// Layout of waveform packets, if requested.
    pub packets: Option<WavePackets>,
    pub(super) adjusted_times: bool,
    pub(super) creation: (u16, u16),
    pub(super) system: String,
    /// Variable length records, except the one of the compression.
    pub(super) vlrs: Vec<Vec<u8>>,
}

impl LasFormat {
    /// Chooses scale and offset and prepares the variable length records.
    pub fn new(settings: &CloudSettings, problems: &mut Diagnostics) -> LasFormat {
        let (cloud, settings) = (settings, &settings.las);
        let offset =
            DVec3::from(cloud.origin.to_array().map(|c| if c.is_finite() { c.round() } else { 0.0 }));
        let groups = Groups {
            labels: cloud.labels,
            directions: cloud.misses,
            true_positions: cloud.true_positions,
            heights: cloud.heights,
            velocities: cloud.has_velocities(),
            light: LightColumns::of(cloud.columns.as_deref()).without_primitive_if(cloud.labels),
        };
        let highest = cloud.highest_class;
        if settings.version == LasVersion::V10 && highest > MAX_CLASS_1 {
            problems
                .warn(
                    None,
                    format!(
                        "--las10 has classes 0 to {MAX_CLASS_1}, the scene has up to {highest}: points with \
                         a higher class get class 0"
                    ),
                )
                .help("leave out --las10: LAS 1.4 has classes up to 255");
        }
        let colours = cloud.has_colours();
        if colours && settings.version == LasVersion::V10 {
            problems.error(None, "LAS 1.0 has no colours").help("leave out --las10: LAS 1.4 has them");
        }
        let mut vlrs = Vec::new();
        if settings.extra != ExtraDimensions::None {
            vlrs.push(vlr::extra_bytes(settings.extra, groups));
        }
        vlrs.extend(cloud.crs.as_deref().and_then(|wkt| vlr::crs(settings.version, wkt, problems)));
        let packets = settings.packets.and_then(|place| {
            if settings.version == LasVersion::V10 {
                problems.error(None, "LAS 1.0 has no waveform packets").help("write LAS 1.4");
                return None;
            }
            WavePackets::new(place, &cloud.bins_ns, cloud.metres_per_ns, problems)
        });
        vlrs.extend(packets.iter().flat_map(WavePackets::descriptors));
        vlrs.push(vlr::remarks(settings));
        vlrs.extend(vlr::object_names(&cloud.objects.names));
        let scale = choose_scale(settings.scale, &cloud.bounds, problems);
        let shift = cloud.origin - offset;
        if settings.at_most.is_some() && settings.packets == Some(PacketPlace::Inside) {
            problems
                .error(
                    None,
                    "--wave-packets inside needs a header that is completed at the end, which --las-at-most \
                     rules out",
                )
                .help("use --wave-packets beside, or leave out --las-at-most");
        }
        LasFormat {
            version: settings.version,
            scale,
            at_most: settings.at_most,
            reach: reach(&cloud.bounds, shift, scale),
            offset,
            shift,
            extra: settings.extra,
            adjusted_times: cloud.adjusted_times,
            creation: cloud.creation,
            groups,
            colours,
            widens_colours: colours && settings.widen_colours,
            packets,
            system: cloud.scanner.clone(),
            vlrs,
        }
    }

    pub fn point_format(&self) -> u8 {
        match (self.version, &self.packets) {
            (LasVersion::V14, None) if self.colours => 7,
            (LasVersion::V14, Some(_)) if self.colours => 10,
            (LasVersion::V14, None) => 6,
            (LasVersion::V14, Some(_)) => 9,
            (LasVersion::V10, _) => 1,
        }
    }

    /// Bytes of a point without extra bytes.
    pub fn base_length(&self) -> u16 {
        match self.point_format() {
            6 => 30,
            7 => 36,
            9 => 59,
            10 => 67,
            _ => 28,
        }
    }

    /// Offset of a reference to a waveform packet in a record: after the fields that format 9 shares with
    /// format 6, and after red, green, blue and near infrared in format 10.
    pub fn packet_offset(&self) -> usize {
        if self.colours { 38 } else { 30 }
    }

    pub fn extra_length(&self) -> u16 {
        vlr::extra_length(self.extra, self.groups)
    }

    /// Bytes of a point with extra bytes.
    pub fn record_length(&self) -> u16 {
        self.base_length() + self.extra_length()
    }

    /// Maximum number of points in a file.
    pub fn max_points(&self) -> u64 {
        match self.version {
            LasVersion::V14 => u64::MAX,
            LasVersion::V10 => u64::from(u32::MAX),
        }
    }

    /// Location of the waveform packets, if there are any.
    pub fn packet_place(&self) -> Option<PacketPlace> {
        self.packets.as_ref().map(|p| p.place)
    }

    /// Converts a box of stored integers to world coordinates.
    pub fn world(&self, stored: &Aabb) -> Aabb {
        if stored.is_empty() {
            return Aabb::EMPTY;
        }
        Aabb { min: stored.min * self.scale + self.offset, max: stored.max * self.scale + self.offset }
    }
}

/// Returns the scene's box enlarged by ten metres for range noise, in stored integers.
fn reach(bounds: &Aabb, shift: DVec3, scale: f64) -> Aabb {
    if bounds.is_empty() {
        return Aabb::EMPTY;
    }
    let margin = DVec3::splat(10.0);
    Aabb { min: (bounds.min - margin + shift) / scale, max: (bounds.max + margin + shift) / scale }
}

/// Returns the requested scale, or the smallest of 0.1 mm, 1 mm ... at which the scene fits into 32 bits.
fn choose_scale(requested: Option<f64>, bounds: &Aabb, problems: &mut Diagnostics) -> f64 {
    // Range noise moves points beyond the scene's box.
    let reach = if bounds.is_empty() {
        0.0
    } else {
        bounds.min.abs().max(bounds.max.abs()).max_element() * 1.01 + 10.0
    };
    let fits = |scale: f64| reach / scale < f64::from(i32::MAX);
    let Some(scale) = requested else {
        let scales = [1e-4, 1e-3, 1e-2, 0.1, 1.0];
        return scales.into_iter().find(|&s| fits(s)).unwrap_or(reach / 1e9);
    };
    if !(scale > 0.0 && scale.is_finite()) {
        problems.error(None, format!("expected a LAS scale greater than 0 m, found {scale}"));
    } else if scale > MAX_SCALE && fits(MAX_SCALE) {
        problems
            .error(None, format!("a LAS scale of {scale} m moves points by up to half of it"))
            .help(format!("the scale is in metres, at most {MAX_SCALE}; 0.001 is a millimetre"));
    } else if !fits(scale) {
        let min_scale = reach / f64::from(i32::MAX);
        problems
            .error(None, format!("the coordinates of the scene exceed 32 bits at a LAS scale of {scale:e} m"))
            .help(format!("choose a scale of at least {min_scale:.1e} m"));
    }
    scale
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_scale_grows_with_the_scene() {
        let sized = |half: f64| Aabb { min: DVec3::splat(-half), max: DVec3::splat(half) };
        let mut problems = Diagnostics::default();
        assert_eq!(choose_scale(None, &Aabb::EMPTY, &mut problems), 1e-4);
        assert_eq!(choose_scale(None, &sized(200e3), &mut problems), 1e-4);
        assert_eq!(choose_scale(None, &sized(300e3), &mut problems), 1e-3);
        assert!(choose_scale(None, &sized(1e12), &mut problems) > 100.0);
        assert_eq!(choose_scale(Some(0.01), &sized(300e3), &mut problems), 0.01);
        assert!(problems.items().is_empty());
        assert_eq!(choose_scale(Some(1.0), &sized(300e3), &mut problems), 1.0);
        assert_eq!(choose_scale(Some(1e6), &sized(1e12), &mut problems), 1e6);
        assert!(problems.items().is_empty());
        for wrong in [0.0, -1.0, f64::NAN, f64::INFINITY, 1e-5, 10.0] {
            choose_scale(Some(wrong), &sized(300e3), &mut problems);
        }
        assert_eq!(problems.items().len(), 6);
    }

    #[test]
    fn las_1_0_has_seconds_of_the_week_where_las_1_4_has_adjusted_ones() {
        // 2024-05-26 00:00:05.5 of GPS time, a Sunday: week 2316, less 10⁹ s.
        let adjusted = 2316.0 * 604_800.0 - 1e9;
        for (version, at, expected) in [(LasVersion::V14, 22, adjusted + 5.5), (LasVersion::V10, 20, 5.5)] {
            let las = crate::las::LasSettings { version, ..Default::default() };
            let format =
                LasFormat::new(&CloudSettings { las, ..Default::default() }, &mut Diagnostics::default());
            for (time_origin, time_ns, expected) in
                [(adjusted, 5.5e9, expected), (0.0, 7.25e9, 7.25), (0.0, 604_800e9, 604_800.0)]
            {
                let point = crate::PointRecord { time_origin, time_ns, ..Default::default() };
                let mut record = Vec::new();
                format.push(&mut record, &point).unwrap();
                let seconds = f64::from_le_bytes(std::array::from_fn(|i| record[at + i]));
                assert_eq!(seconds, expected, "{version:?}");
                assert_eq!(point.has_adjusted_time(), time_origin != 0.0);
            }
        }
    }
}
