//! Encoding in the worker threads: a batch becomes the bytes of every file that it contributes to.

use super::layout::{Content, Route, Slots};
use super::memory;
use super::piece::{Piece, samples_of};
use super::plan::OutputPlan;
use super::request::{TableContent, TrajectoryFormat};
use super::text;
use crate::shards;
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::sync::Arc;
use vlscan_formats::{Cause, EncodedPoints, PointBatch, PointEncoder, PointRecord, Wave};
use vlscan_geom::{DVec3, HeightModel, is_inside};
use vlscan_lidar::pulse::{Batch, Echo, WaveformRecord};

/// Points that are converted to records at a time; a block of records fits into the first cache.
const BLOCK_POINTS: usize = 64;

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
        let continues = |(mine, next): (&Piece, &Piece)| {
            mine.slot == next.slot && mine.points.is_joinable() && next.points.is_joinable()
        };
        let alike = self.leg == next.leg && self.pieces.len() == next.pieces.len();
        if !alike || !self.pieces.iter().zip(&next.pieces).all(continues) {
            return Some(next);
        }
        self.pieces.iter_mut().zip(&next.pieces).for_each(|(mine, next)| mine.points.append(&next.points));
        self.points_of_part.extend(next.points_of_part);
        self.left_out += next.left_out;
        None
    }

    /// Total bytes of all pieces.
    pub fn bytes(&self) -> usize {
        self.pieces.iter().map(|p| p.points.bytes.len()).sum()
    }
}

/// A batch over the ground of its epoch.
#[derive(Clone, Copy)]
struct Source<'a> {
    batch: &'a Batch,
    ground: Option<&'a Arc<dyn HeightModel>>,
}

/// Waveforms of a batch, found in the order of the echoes.
struct Waves<'a> {
    records: &'a [WaveformRecord],
    /// Start of the search for the waveform of an echo, by device.
    next: BTreeMap<u32, usize>,
}

impl Waves<'_> {
    /// Index of the waveform of an echo; `u32::MAX` for none. Echoes and waveforms are both in order of
    /// emission.
    fn index_of(&mut self, echo: &Echo) -> u32 {
        let next = self.next.entry(echo.device).or_default();
        let is_before =
            |wave: &WaveformRecord| wave.device != echo.device || wave.pulse_number < echo.pulse_number;
        while self.records.get(*next).is_some_and(is_before) {
            *next += 1;
        }
        let found = self.records.get(*next).is_some_and(|wave| wave.pulse_number == echo.pulse_number);
        if found { *next as u32 } else { u32::MAX }
    }
}

impl OutputPlan {
    /// Encodes a batch for every file. Called by the worker threads. Heights of its points count from
    /// `ground`, that of the batch's epoch.
    pub fn encode(&self, batch: &Batch, ground: Option<&Arc<dyn HeightModel>>) -> Encoded {
        let source = Source { batch, ground };
        let mut echoes =
            if self.request.cloud.misses { with_misses(batch) } else { Cow::Borrowed(&batch.echoes[..]) };
        if let Some(ring) = &self.request.clip {
            let keeps =
                |p: DVec3| is_inside(ring, [p.x + self.settings.origin.x, p.y + self.settings.origin.y]);
            echoes.to_mut().retain(|echo| keeps(echo.position));
        }
        let routes = self.layout.routes.get(batch.leg as usize).map_or(&[][..], |r| r);
        let mut pieces = Vec::with_capacity(routes.len());
        let mut left_out = 0;
        for Route { content, slots } in routes {
            // Outputs other than points have one file.
            let slot = slots.as_slice().first().copied().unwrap_or_default();
            match (*content, slots) {
                (Content::Points(format), Slots::Divided(slots)) => {
                    let divided = self.divided(&echoes);
                    left_out = (echoes.len() - divided.values().map(Vec::len).sum::<usize>()) as u64;
                    let encoder = self.encoders.get(&format);
                    for (file, own) in divided {
                        self.points(encoder, &Slots::One(slots[file]), source, &own, &mut pieces);
                    }
                }
                (Content::Points(format), slots) => {
                    self.points(self.encoders.get(&format), slots, source, &echoes, &mut pieces);
                }
                (Content::Trajectory(format), _) => pieces.push(self.trajectory(format, slot, batch)),
                (Content::Waveforms, _) => pieces.push(self.waveforms(slot, batch)),
                (Content::Pulses, _) => pieces.push(self.pulses(slot, batch)),
                (Content::Shard, _) => pieces.push(shard(slot, batch)),
                (Content::Table(TableContent::Points), slots) => {
                    self.points(self.table_encoder(), slots, source, &echoes, &mut pieces);
                }
                (Content::Table(content), _) => {
                    pieces.push(Piece { slot, points: memory::encode(content, batch, self.frame()) });
                }
            }
        }
        let points_of_part = if self.request.counts_parts { count_parts(&echoes) } else { Vec::new() };
        Encoded { leg: batch.leg, pieces, points_of_part, left_out }
    }

    /// Echoes by the index of their file, ascending.
    fn divided(&self, echoes: &[Echo]) -> BTreeMap<usize, Vec<Echo>> {
        let mut files: BTreeMap<usize, Vec<Echo>> = BTreeMap::new();
        for echo in echoes {
            if let Some(file) = self.divider.as_ref().and_then(|d| d.file_of(echo, self.settings.origin)) {
                files.entry(file).or_default().push(*echo);
            }
        }
        files
    }

    /// Encodes points and appends one piece per file of `slots`.
    fn points(
        &self,
        encoder: Option<&Arc<dyn PointEncoder>>,
        slots: &Slots,
        source: Source<'_>,
        echoes: &[Echo],
        pieces: &mut Vec<Piece>,
    ) {
        let Some(encoder) = encoder else { return };
        // With one file per device the share of each device is unknown, so nothing is reserved.
        let is_one = matches!(slots, Slots::One(_));
        let capacity = if is_one { echoes.len() * encoder.typical_bytes() } else { 0 };
        for (index, &slot) in slots.as_slice().iter().enumerate() {
            let mut piece = Piece::new(slot, capacity);
            let own = echoes.iter().filter(|echo| slots.index_of(echo.device) == index);
            self.encode_echoes(&**encoder, source, own, &mut piece.points);
            pieces.push(piece);
        }
    }

    /// Converts echoes to records and encodes them.
    fn encode_echoes<'e>(
        &self,
        encoder: &dyn PointEncoder,
        source: Source<'_>,
        mut echoes: impl Iterator<Item = &'e Echo>,
        out: &mut EncodedPoints,
    ) {
        let batch = source.batch;
        let (leg, frame_ns) = self.leg_of(batch);
        let has_packets = encoder.packets().is_some();
        let mut records =
            Waves { records: if has_packets { &batch.waveforms } else { &[] }, next: BTreeMap::new() };
        let waves: Vec<Wave> = records
            .records
            .iter()
            .map(|wave| Wave {
                device: wave.device,
                start_ns: wave.start_ns,
                samples: samples_of(batch, wave),
            })
            .collect();
        let time_origin = self.frame().time;
        let mut block = [PointRecord { leg, time_origin, ..PointRecord::default() }; BLOCK_POINTS];
        loop {
            let mut count = 0;
            for (record, echo) in block.iter_mut().zip(&mut echoes) {
                self.fill(record, echo, source);
                if has_packets {
                    record.wave = records.index_of(echo);
                }
                count += 1;
            }
            if count == 0 {
                return;
            }
            encoder.encode(&PointBatch { points: &block[..count], waves: &waves, frame_ns }, out);
        }
    }

    /// Fills a record with the properties of an echo that the formats need.
    #[inline]
    fn fill(&self, record: &mut PointRecord, echo: &Echo, source: Source<'_>) {
        record.position = echo.position;
        record.origin = echo.origin;
        record.direction = echo.direction;
        record.range = echo.range;
        record.true_range = echo.true_range;
        record.amplitude = echo.intensity;
        record.echo_width = echo.echo_width;
        record.incidence_cosine = echo.incidence_cosine;
        record.scan_angle = echo.scan_angle;
        record.time_ns = echo.time_ns;
        record.pulse_number = echo.pulse_number;
        record.return_number = echo.return_number;
        record.number_of_returns = echo.number_of_returns;
        record.device = echo.device;
        record.part = echo.part;
        record.primitive = echo.primitive;
        record.object = self.settings.objects.of_part(echo.part);
        record.class = echo.classification;
        let truths = &source.batch.truths;
        if self.needs.in_scanner {
            record.in_scanner = echo.position_in_scanner();
            record.scanner = echo.scanner_attitude();
        }
        if self.needs.true_position {
            record.true_position = echo.true_position(truths);
        }
        if self.needs.height {
            let below = source.ground.and_then(|ground| ground.height(echo.position.x, echo.position.y));
            record.height = below.map_or(f32::NAN, |z| (echo.position.z - z) as f32);
        }
        if self.needs.cause || self.needs.colour || self.needs.velocity {
            let truth = echo.truth(truths);
            let (surface, normal) = (truth.surface, truth.normal);
            let [path, order] = truth.path.code().to_le_bytes();
            let (fraction, subray, colour) = (truth.fraction, truth.subray, truth.colour);
            let velocity = echo.velocity(&source.batch.velocities);
            let velocity = [velocity.radial, velocity.spread];
            record.cause = Cause { surface, normal, fraction, subray, path, order, colour, velocity };
        }
    }

    fn trajectory(&self, format: TrajectoryFormat, slot: u32, batch: &Batch) -> Piece {
        let push = match format {
            TrajectoryFormat::Helios => text::push_pose,
            TrajectoryFormat::Csv => text::push_pose_csv,
        };
        piece_of(slot, &batch.poses, 80, |out, pose| push(out, self.frame(), pose))
    }

    fn waveforms(&self, slot: u32, batch: &Batch) -> Piece {
        piece_of(slot, &batch.waveforms, 512, |out, wave| {
            text::push_waveform(out, self.frame(), wave, samples_of(batch, wave));
        })
    }

    fn pulses(&self, slot: u32, batch: &Batch) -> Piece {
        piece_of(slot, &batch.pulses, 96, |out, pulse| text::push_pulse(out, self.frame(), pulse))
    }
}

/// Returns the batch as a block of a shard.
fn shard(slot: u32, batch: &Batch) -> Piece {
    let mut piece = Piece::new(slot, batch.echoes.len() * 168 + 1024);
    shards::encode(batch, &mut piece.points.bytes);
    piece.points.tally.records = batch.echoes.len() as u64;
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
    records.iter().for_each(|record| push(&mut piece.points.bytes, record));
    piece.points.tally.records = records.len() as u64;
    piece
}
