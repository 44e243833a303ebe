//! Encoding in the worker threads: a batch becomes the bytes of every file that it contributes to.

use super::codec::{LegFacts, Piece, PointCodec, encode_points};
use super::column_codec::ColumnCodec;
use super::e57::E57Codec;
use super::ground::Ground;
use super::las::{LasCodec, encode_with_packets};
use super::layout::{Route, Slots};
use super::mcap::McapCodec;
use super::memory::{self, TableContent};
use super::pcd::PcdCodec;
use super::plan::OutputPlan;
use super::ply::{PlyCodec, PlyGroups};
use super::ray_cloud::RayCloudCodec;
use super::request::{PointFormat, TrajectoryFormat};
use super::{table, text};
use crate::shards;
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::sync::Arc;
use vlscan_geom::{DVec3, is_inside};
use vlscan_lidar::pulse::Batch;
use vlscan_lidar::pulse::Echo;

/// The encoded pieces of a batch for all files; input of [`Writer::append`](super::Writer::append).
#[derive(Debug)]
pub struct Encoded {
    pub(super) leg: u32,
    pub(super) pieces: Vec<Piece>,
    /// Numbers of points by part, if they are counted.
    pub(super) points_of_part: Vec<(u32, u64)>,
    /// Points of no file of a division.
    pub(super) left_out: u64,
}

impl Encoded {
    /// Index of the encoded leg.
    pub fn leg(&self) -> u32 {
        self.leg
    }

    /// Appends the next batch, or returns it when the pieces cannot be joined.
    pub fn join(&mut self, next: Encoded) -> Option<Encoded> {
        let goes_on = |(mine, next): (&Piece, &Piece)| {
            mine.slot == next.slot && !next.is_block && mine.packets.is_empty() && next.packets.is_empty()
        };
        let alike = self.leg == next.leg && self.pieces.len() == next.pieces.len();
        if !alike || !self.pieces.iter().zip(&next.pieces).all(goes_on) {
            return Some(next);
        }
        for (mine, next) in self.pieces.iter_mut().zip(&next.pieces) {
            mine.bytes.extend_from_slice(&next.bytes);
            mine.tally.add(&next.tally);
        }
        self.points_of_part.extend(next.points_of_part);
        self.left_out += next.left_out;
        None
    }

    /// Total bytes of all pieces.
    pub fn bytes(&self) -> usize {
        self.pieces.iter().map(|p| p.bytes.len()).sum()
    }
}

pub(super) struct XyzCodec<'a> {
    pub shift: DVec3,
    pub part_names: &'a [Box<[u8]>],
}

impl PointCodec for XyzCodec<'_> {
    const TYPICAL_BYTES: usize = 112;

    fn push(&self, out: &mut Vec<u8>, _: &LegFacts, echo: &Echo) -> Option<DVec3> {
        let position = echo.position + self.shift;
        let label = self.part_names.get(echo.part as usize).map_or(&b"-"[..], |l| l);
        text::push_point(out, position, echo, label);
        Some(position)
    }
}

/// A batch over the ground of its epoch.
#[derive(Clone, Copy)]
struct Source<'a> {
    batch: &'a Batch,
    ground: Option<&'a Arc<dyn Ground>>,
}

impl OutputPlan {
    /// Encodes a batch for every file. Called by the worker threads. Heights of its points count from `ground`, that of the
    /// batch's epoch.
    pub fn encode(&self, batch: &Batch, ground: Option<&Arc<dyn Ground>>) -> Encoded {
        let source = Source { batch, ground };
        let mut echoes = if self.misses { with_misses(batch) } else { Cow::Borrowed(&batch.echoes[..]) };
        if let Some(ring) = &self.clip {
            let keeps = |p: DVec3| is_inside(ring, [p.x + self.shift.x, p.y + self.shift.y]);
            echoes.to_mut().retain(|echo| keeps(echo.position));
        }
        let routes = self.layout.routes.get(batch.leg as usize).map_or(&[][..], |r| r);
        let mut pieces = Vec::with_capacity(routes.len());
        let mut left_out = 0;
        for route in routes {
            match route {
                Route::Points(format, Slots::Divided(slots)) => {
                    let divided = self.divided(&echoes);
                    left_out = (echoes.len() - divided.values().map(Vec::len).sum::<usize>()) as u64;
                    for (file, own) in divided {
                        self.points(*format, &Slots::One(slots[file]), source, &own, &mut pieces);
                    }
                }
                Route::Points(format, slots) => self.points(*format, slots, source, &echoes, &mut pieces),
                Route::Trajectory(format, slot) => pieces.push(self.trajectory(*format, *slot, batch)),
                Route::Waveforms(slot) => pieces.push(self.waveforms(*slot, batch)),
                Route::Pulses(slot) => pieces.push(self.pulses(*slot, batch)),
                Route::Shard(slot) => pieces.push(shard(*slot, batch)),
                Route::Table(TableContent::Points, slots) => {
                    self.points(PointFormat::Arrow, slots, source, &echoes, &mut pieces);
                }
                Route::Table(content, slots) => {
                    pieces.extend(slots.as_slice().iter().map(|slot| self.table(*content, *slot, batch)));
                }
            }
        }
        let points_of_part = if self.counts_parts { count_parts(&echoes) } else { Vec::new() };
        Encoded { leg: batch.leg, pieces, points_of_part, left_out }
    }

    /// Echoes by the index of their file, ascending.
    fn divided(&self, echoes: &[Echo]) -> BTreeMap<usize, Vec<Echo>> {
        let mut files: BTreeMap<usize, Vec<Echo>> = BTreeMap::new();
        for echo in echoes {
            if let Some(file) = self.divider.as_ref().and_then(|d| d.file_of(echo, self.shift)) {
                files.entry(file).or_default().push(*echo);
            }
        }
        files
    }

    fn points(
        &self,
        format: PointFormat,
        slots: &Slots,
        source: Source<'_>,
        echoes: &[Echo],
        pieces: &mut Vec<Piece>,
    ) {
        let Source { batch, ground } = source;
        let Some(leg) = self.leg_of(batch) else { return };
        let leg = &leg;
        let (shift, objects, groups) = (self.shift, &self.objects, self.ply_groups());
        match format {
            PointFormat::Xyz if self.columns_chosen => {
                self.tables(leg, slots, source, echoes, pieces, |out, rows, block| {
                    table::push_rows(out, &self.columns, rows, &block, b' ');
                });
            }
            PointFormat::Csv => self.tables(leg, slots, source, echoes, pieces, |out, rows, block| {
                table::push_rows(out, &self.columns, rows, &block, b',');
            }),
            PointFormat::Arrow | PointFormat::Parquet => {
                let before = pieces.len();
                self.tables(leg, slots, source, echoes, pieces, |out, _, block| *out = block);
                pieces[before..].iter_mut().for_each(|piece| piece.is_block = true);
            }
            PointFormat::Xyz | PointFormat::Bin => {
                let codec = XyzCodec { shift, part_names: &self.part_names };
                encode_points(&codec, leg, slots, echoes, pieces);
            }
            PointFormat::Las | PointFormat::Laz | PointFormat::Copc => {
                let codec = LasCodec { format: &self.las, objects, truths: &batch.truths, ground };
                match &self.las.packets {
                    None => encode_points(&codec, leg, slots, echoes, pieces),
                    Some(packets) => encode_with_packets(&codec, packets, leg, slots, echoes, batch, pieces),
                }
            }
            PointFormat::PlyBinary => {
                encode_points(
                    &PlyCodec::<false> { shift, objects, groups, ground },
                    leg,
                    slots,
                    echoes,
                    pieces,
                );
            }
            PointFormat::RayCloud => {
                encode_points(&RayCloudCodec { shift, las: &self.las }, leg, slots, echoes, pieces);
            }
            PointFormat::E57 => encode_points(&E57Codec { shift }, leg, slots, echoes, pieces),
            PointFormat::Mcap => {
                let frame_ns = self.frame_ns(batch.leg);
                let codec = McapCodec { shift, frame_ns };
                encode_points(&codec, leg, slots, echoes, pieces);
            }
            PointFormat::Pcd => {
                encode_points(&PcdCodec { shift: shift - self.pcd_offset }, leg, slots, echoes, pieces);
            }
            PointFormat::PlyAscii => {
                encode_points(
                    &PlyCodec::<true> { shift, objects, groups, ground },
                    leg,
                    slots,
                    echoes,
                    pieces,
                );
            }
        }
    }

    /// The facts of a batch's leg.
    fn leg_of(&self, batch: &Batch) -> Option<LegFacts> {
        let own = batch.leg_number.map(LegFacts::new);
        own.or_else(|| self.legs.get(batch.leg as usize).copied())
    }

    /// Encodes points as one block of columns per file, which `write` converts to the bytes of the file.
    fn tables(
        &self,
        leg: &LegFacts,
        slots: &Slots,
        source: Source<'_>,
        echoes: &[Echo],
        pieces: &mut Vec<Piece>,
        write: impl Fn(&mut Vec<u8>, usize, Vec<u8>),
    ) {
        let codec = ColumnCodec {
            columns: &self.columns,
            shift: self.shift,
            objects: &self.objects,
            las: &self.las,
            truths: &source.batch.truths,
            ground: source.ground,
        };
        for (index, &slot) in slots.as_slice().iter().enumerate() {
            let own: Vec<&Echo> = echoes.iter().filter(|echo| slots.index_of(echo.device) == index).collect();
            let mut piece = Piece::new(slot, 0);
            let mut block = Vec::new();
            codec.push(&mut block, leg, &own);
            write(&mut piece.bytes, own.len(), block);
            own.iter()
                .for_each(|echo| piece.tally.count_point(echo.position + self.shift, echo.return_number));
            pieces.push(piece);
        }
    }

    /// Returns the requested groups of PLY properties.
    pub(super) fn ply_groups(&self) -> PlyGroups {
        PlyGroups { labels: self.labels, directions: self.misses, heights: self.heights }
    }

    fn trajectory(&self, format: TrajectoryFormat, slot: u32, batch: &Batch) -> Piece {
        let push = match format {
            TrajectoryFormat::Helios => text::push_pose,
            TrajectoryFormat::Csv => text::push_pose_csv,
        };
        piece_of(slot, &batch.poses, 80, |out, pose| push(out, pose.position + self.shift, pose))
    }

    fn table(&self, content: TableContent, slot: u32, batch: &Batch) -> Piece {
        let (bytes, tally) = memory::encode(content, batch, self.shift);
        Piece { bytes, tally, is_block: true, ..Piece::new(slot, 0) }
    }

    fn waveforms(&self, slot: u32, batch: &Batch) -> Piece {
        piece_of(slot, &batch.waveforms, 512, |out, wave| {
            let samples = batch.samples.get(wave.first_sample..).unwrap_or_default();
            let samples = &samples[..wave.samples.min(samples.len())];
            text::push_waveform(out, wave.origin + self.shift, wave, samples);
        })
    }

    fn pulses(&self, slot: u32, batch: &Batch) -> Piece {
        piece_of(slot, &batch.pulses, 96, |out, pulse| {
            text::push_pulse(out, pulse.origin + self.shift, pulse)
        })
    }
}

/// Returns the batch as a block of a shard.
fn shard(slot: u32, batch: &Batch) -> Piece {
    let mut piece = Piece::new(slot, batch.echoes.len() * 168 + 1024);
    shards::encode(batch, &mut piece.bytes);
    piece.tally.records = batch.echoes.len() as u64;
    piece
}

/// Counts echoes by part.
fn count_parts(echoes: &[Echo]) -> Vec<(u32, u64)> {
    let mut parts: Vec<u32> = echoes.iter().map(|echo| echo.part).filter(|&part| part != u32::MAX).collect();
    parts.sort_unstable();
    parts.chunk_by(|a, b| a == b).map(|alike| (alike[0], alike.len() as u64)).collect()
}

/// Returns the echoes of a batch together with records of its pulses without echoes, in order of emission.
fn with_misses(batch: &Batch) -> Cow<'_, [Echo]> {
    let mut all = Vec::with_capacity(batch.echoes.len() + batch.pulses.len());
    let mut echoes = batch.echoes.iter().peekable();
    for pulse in &batch.pulses {
        let before = all.len();
        let is_its = |echo: &&Echo| (echo.device, echo.pulse_number) == (pulse.device, pulse.number);
        while let Some(echo) = echoes.next_if(is_its) {
            all.push(*echo);
        }
        if all.len() == before {
            all.push(Echo::miss(pulse));
        }
    }
    Cow::Owned(all)
}

/// Returns a piece of records without coordinates.
fn piece_of<T>(slot: u32, records: &[T], typical_bytes: usize, push: impl Fn(&mut Vec<u8>, &T)) -> Piece {
    let mut piece = Piece::new(slot, records.len() * typical_bytes);
    records.iter().for_each(|record| push(&mut piece.bytes, record));
    piece.tally.records = records.len() as u64;
    piece
}
