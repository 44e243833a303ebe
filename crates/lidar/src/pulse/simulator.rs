//! The simulation of pulses: ray generation, traversal and detection for many pulses at a time.

use super::ahead::Ahead;
use super::batch::Batch;
use super::echo::Echo;
use super::instrument::InstrumentTable;
use super::physics::Physics;
use super::range_noise;
use super::ray_batch::RayBatch;
use super::receive::{Detection, pulse_record, traced_axis};
use super::subray::Subrays;
use super::tiles::TileTracer;
use super::traced::{GainBuffer, TracedPulse};
use super::view::StaticView;
use crate::flight::Pulse;
use std::ops::Range;
use vlscan_base::quantity::number;
use vlscan_base::rng;
use vlscan_base::{Error, Result};
use vlscan_geom::Aabb;
use vlscan_scene::{DynamicObject, DynamicScene, ObjectUpdate, SceneTriangle};
use vlscan_trace::TraceScratch;
use vlscan_trace::simd::{Level, Simd, dispatch};

/// Maximum number of pulses traced together, over all devices.
const MAX_BATCH_PULSES: usize = 128;
/// Maximum number of rays traced together, unless one pulse has more.
const MAX_BATCH_RAYS: usize = 1 << 16;
/// Maximum coordinate of a point in the scene frame, m: that of a scene, and as much again from its centre.
const MAX_POSITION: f64 = 1e13;
/// Number of pulses whose ranges and gains are computed in one go, so that the latency of square roots
/// overlaps.
const GAIN_BATCH: usize = 8;

/// Simulates pulses. One per worker: it owns the scratch memory, which is reused from pulse to pulse.
pub struct PulseSimulator<'p> {
    physics: &'p Physics<'p>,
    /// The survey's instruments, or those set later.
    instruments: InstrumentTable,
    /// One per device, because successive pulses of a device hit nearby surfaces.
    batches: Vec<RayBatch>,
    /// Pulses of one device between two updates of the moving objects.
    dynamic_batch: RayBatch,
    /// Index of each pulse in the batch of its device; `None` if it is culled.
    slots: Vec<Option<usize>>,
    gain_buffer: GainBuffer,
    ahead: Ahead,
    /// Triangles that some pulses hit and that are not cached.
    missing: Vec<SceneTriangle<'p>>,
    detection: Detection,
    trace_scratch: TraceScratch,
    /// The tiles of the scene, if there are any.
    tiles: Option<TileTracer>,
    /// The instruction set of ray generation and detection.
    pub(super) level: Level,
}

/// A phase of the simulation, see [`PulseSimulator::simulate_timed`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Phase {
    /// Pulses become rays.
    RayGeneration,
    /// The nearest hits of the rays are found.
    Traversal,
    /// Hits become echoes.
    Detection,
}

impl<'p> PulseSimulator<'p> {
    /// A simulator for one worker.
    pub fn new(physics: &'p Physics<'p>) -> PulseSimulator<'p> {
        PulseSimulator {
            physics,
            instruments: physics.instruments.clone(),
            batches: vec![RayBatch::default(); physics.instruments.devices()],
            dynamic_batch: RayBatch::default(),
            slots: Vec::new(),
            gain_buffer: GainBuffer::default(),
            ahead: Ahead::default(),
            missing: Vec::new(),
            detection: Detection::default(),
            trace_scratch: TraceScratch::default(),
            tiles: physics.view.scene.tiles.as_ref().map(TileTracer::new),
            level: Level::best(),
        }
    }

    /// Replaces the instruments. They must have as many devices as the survey; leg indices refer to the
    /// survey from which they were computed.
    pub fn set_instruments(&mut self, instruments: &InstrumentTable) {
        self.instruments = instruments.clone();
    }

    /// Simulates `pulses` of leg `leg` (index into the survey's legs) and appends their records to `batch` in
    /// the order of the pulses. The records of a pulse do not depend on the pulses simulated with it; many at
    /// once are traced several times faster.
    ///
    /// # Errors
    /// A leg or device that the survey does not have, or a waveform that is too long to be recorded.
    pub fn simulate(&mut self, leg: u32, pulses: &[Pulse], batch: &mut Batch) -> Result<()> {
        self.simulate_timed(leg, pulses, batch, |_| ())
    }

    /// [`PulseSimulator::simulate`] that calls `on_end` at the end of each phase of some of the pulses.
    pub fn simulate_timed(
        &mut self,
        leg: u32,
        pulses: &[Pulse],
        batch: &mut Batch,
        mut on_end: impl FnMut(Phase),
    ) -> Result<()> {
        let (mut rest, mut max_pulses) = (pulses, usize::MAX);
        while !rest.is_empty() {
            let (pulses, later) = rest.split_at(self.trace_some(leg, rest, max_pulses, &mut on_end)?);
            let mark = batch.mark();
            self.detect(leg, pulses, 0..pulses.len(), &[], batch)?;
            if pulses.len() > 1 && self.needs_too_many_tiles() {
                // Mirrors have sent light to further tiles; those of fewer pulses may fit into memory.
                let _ = self.release_tiles();
                batch.truncate(&mark);
                max_pulses = pulses.len() / 2;
                continue;
            }
            self.release_tiles()?;
            on_end(Phase::Detection);
            rest = later;
            max_pulses = max_pulses.saturating_mul(2);
        }
        Ok(())
    }

    /// [`PulseSimulator::simulate`] over a dynamic scene that is in the state of the first pulse. `updates`
    /// are ordered by the first pulse to which they apply. The static objects are traced for many pulses at
    /// once, however often the others move.
    pub fn simulate_dynamic(
        &mut self,
        leg: u32,
        pulses: &[Pulse],
        scene: &mut DynamicScene,
        updates: &[ObjectUpdate],
        batch: &mut Batch,
    ) -> Result<()> {
        let (mut simulated, mut updates) = (0, updates.iter().peekable());
        while simulated < pulses.len() {
            let rest = &pulses[simulated..];
            let chunk = &rest[..self.trace_some(leg, rest, usize::MAX, |_| ())?];
            let mut done = 0;
            while done < chunk.len() {
                while let Some(update) = updates.next_if(|u| u.first_pulse <= simulated + done) {
                    scene.apply(update);
                }
                let end =
                    updates.peek().map_or(chunk.len(), |u| (u.first_pulse - simulated).min(chunk.len()));
                let moving = scene.rebuild_moved();
                self.trace_moving(moving, chunk, done..end);
                self.detect(leg, chunk, done..end, moving, batch)?;
                done = end;
            }
            self.release_tiles()?;
            simulated += chunk.len();
        }
        Ok(())
    }

    /// True if the tiles that were needed since they were released last exceed the memory for tiles.
    fn needs_too_many_tiles(&self) -> bool {
        self.tiles.as_ref().is_some_and(TileTracer::is_over_budget)
    }

    /// Generates the rays of the first of `pulses`, as many as are traced together and at most `max`, and
    /// traces them through the static scene. Returns their number.
    fn trace_some(
        &mut self,
        leg: u32,
        pulses: &[Pulse],
        max: usize,
        mut on_end: impl FnMut(Phase),
    ) -> Result<usize> {
        let mut count = self.batch_pulses().min(pulses.len()).min(max);
        loop {
            self.generate_rays(leg, &pulses[..count])?;
            on_end(Phase::RayGeneration);
            self.trace(leg)?;
            on_end(Phase::Traversal);
            if count == 1 || !self.needs_too_many_tiles() {
                return Ok(count);
            }
            // The tiles under fewer pulses may fit into memory; a missing tile is not a failure yet.
            let _ = self.release_tiles();
            count /= 2;
        }
    }

    /// Allows the tiles to be dropped that were needed since the last call; fails if one of them was not
    /// available.
    fn release_tiles(&mut self) -> Result<()> {
        self.tiles.as_mut().map_or(Ok(()), TileTracer::release)
    }

    /// Box around everything that rays could hit since the last call, scene frame, m; `None` in a scene
    /// without tiles.
    pub fn take_area(&mut self) -> Option<Aabb> {
        self.tiles.as_mut().map(TileTracer::take_area)
    }

    fn batch_pulses(&self) -> usize {
        (MAX_BATCH_RAYS / self.instruments.max_rays().max(1)).clamp(1, MAX_BATCH_PULSES)
    }

    fn generate_rays(&mut self, leg: u32, pulses: &[Pulse]) -> Result<()> {
        dispatch!(self.level, _simd => self.generate_rays_generic(leg, pulses))
    }

    /// [`PulseSimulator::generate_rays`] for the instruction set of the caller: plain Rust without fused or
    /// reordered operations, so that all sets give the same bits.
    #[inline(always)]
    fn generate_rays_generic(&mut self, leg: u32, pulses: &[Pulse]) -> Result<()> {
        let PulseSimulator { physics, instruments, batches, slots, .. } = self;
        batches.iter_mut().for_each(|b| b.rays.clear(0));
        slots.clear();
        for pulse in pulses {
            let subrays = &instruments.instrument(leg, pulse.device)?.subrays;
            if !physics.hits_bounds(pulse.origin, traced_axis(pulse)) {
                slots.push(None);
                continue;
            }
            let RayBatch { rays, exits: device_exits, .. } = &mut batches[pulse.device as usize];
            if rays.is_empty() {
                device_exits.clear();
                rays.clear(subrays.len());
            }
            let pattern = choose_pattern(physics, subrays, pulse);
            subrays.expand(pattern, &pulse.attitude, rays.push_registers(pulse.origin));
            if let Some(exits) = subrays.exits(pattern) {
                device_exits.extend(exits.iter().map(|exit| pulse.origin + pulse.attitude.apply(*exit)));
            }
            slots.push(Some(rays.len() - 1));
        }
        Ok(())
    }

    /// Traces the rays through the static scene.
    fn trace(&mut self, leg: u32) -> Result<()> {
        let PulseSimulator { physics, instruments, batches, trace_scratch, tiles, .. } = self;
        let StaticView { scene, tree, .. } = physics.view;
        let is_all_tiles = tiles.is_some() && scene.numbers() == 0;
        for (device, batch) in (0..).zip(batches).filter(|(_, b)| !b.rays.is_empty()) {
            match is_all_tiles {
                true => batch.trace_nothing(),
                false => batch.trace(tree, &scene.geometry, trace_scratch),
            }
            if let Some(tiles) = tiles {
                let is_one_pattern = instruments.instrument(leg, device)?.subrays.patterns() == 1;
                tiles.trace(scene, batch, is_one_pattern, trace_scratch);
            }
        }
        Ok(())
    }

    /// Replaces the hits of the pulses in `range` where moving objects are nearer than the static scene.
    fn trace_moving(&mut self, moving: &[DynamicObject], pulses: &[Pulse], range: Range<usize>) {
        let PulseSimulator { physics, batches, dynamic_batch, slots, trace_scratch, .. } = self;
        let scene = physics.view.scene;
        for (device, batch) in batches.iter_mut().enumerate() {
            let of_device = |i: &usize| pulses[*i].device as usize == device;
            let mut own = range.clone().filter(of_device).filter_map(|i| slots[i]);
            let Some(first) = own.next() else { continue };
            // The pulses of a device have consecutive slots.
            let rows = first..own.next_back().unwrap_or(first) + 1;
            dynamic_batch.copy_rays(batch, rows.clone());
            for object in moving {
                dynamic_batch.trace(&object.tree, &object.scene.geometry, trace_scratch);
                let first = rows.start * dynamic_batch.rays.stride();
                let (number, order) = (|i| object.to_scene_index(i), |i| scene.number_when_stored(i));
                batch.hits.take_nearer(first, &dynamic_batch.hits, number, order);
            }
        }
    }

    fn detect(
        &mut self,
        leg: u32,
        pulses: &[Pulse],
        range: Range<usize>,
        moving: &[DynamicObject],
        batch: &mut Batch,
    ) -> Result<()> {
        self.detection.scratch.triangles.forget_moving();
        let pulses = &pulses[range.clone()];
        let detected =
            dispatch!(self.level, simd => self.detect_generic(simd, leg, pulses, range, moving, batch));
        detected.inspect_err(|_| {
            // Other workers may wait for the memory of these tiles.
            let _ = self.release_tiles();
        })
    }

    /// [`PulseSimulator::detect`] of `pulses` with the slots `range` on one instruction set; all give the
    /// same bits.
    #[inline(always)]
    fn detect_generic<S: Simd>(
        &mut self,
        simd: S,
        leg: u32,
        pulses: &[Pulse],
        range: Range<usize>,
        moving: &[DynamicObject],
        batch: &mut Batch,
    ) -> Result<()> {
        let physics = self.physics;
        let mut view = physics.view.with(moving, self.tiles.as_ref().map(TileTracer::near));
        let slots = &self.slots[range];
        let first_echo = batch.echoes.len();
        self.detection.refracted.clear();
        for (pulses, slots) in pulses.chunks(GAIN_BATCH).zip(slots.chunks(GAIN_BATCH)) {
            self.gain_buffer.clear();
            self.missing.clear();
            for (pulse, slot) in pulses.iter().zip(slots) {
                if let Some(slot) = *slot {
                    let traced = &self.batches[pulse.device as usize];
                    let instrument = self.instruments.instrument(leg, pulse.device)?;
                    let traced = TracedPulse::of(traced, slot);
                    let triangles = &self.detection.scratch.triangles;
                    triangles.prefetch(physics.view.scene, traced.primitives, &mut self.missing);
                    self.gain_buffer.push(instrument, &traced);
                }
            }
            self.missing.iter().for_each(SceneTriangle::prefetch_corners);
            if view.has_optics {
                let mut first_block = 0;
                let traced = pulses.iter().zip(slots).filter_map(|(pulse, slot)| {
                    let traced = TracedPulse::of(&self.batches[pulse.device as usize], (*slot)?);
                    let gains = self.gain_buffer.of(first_block, &traced);
                    first_block += traced.blocks();
                    Some((traced, gains))
                });
                self.ahead.find(&view, traced, &mut self.trace_scratch);
            }
            let (mut first_block, mut row) = (0, 0);
            for (pulse, slot) in pulses.iter().zip(slots) {
                if physics.options.record_pulses {
                    batch.pulses.push(pulse_record(pulse));
                }
                if let Some(slot) = *slot {
                    let traced = &self.batches[pulse.device as usize];
                    let instrument = self.instruments.instrument(leg, pulse.device)?;
                    let traced = TracedPulse { ahead: self.ahead.of(row), ..TracedPulse::of(traced, slot) };
                    let gains = self.gain_buffer.of(first_block, &traced);
                    view.wavelength = physics.wavelengths.get(pulse.device as usize).copied().unwrap_or(0);
                    let pulse = (instrument, pulse);
                    self.detection.detect(simd, physics, &view, pulse, (traced, gains), batch)?;
                    first_block += traced.blocks();
                    row += 1;
                }
            }
        }
        self.finish_echoes(leg, first_echo, batch)?;
        check_positions(&batch.echoes[first_echo..])
    }

    /// Adds the noise of ranges to the echoes from `first` on, and corrects the positions of those in water.
    #[inline(always)]
    fn finish_echoes(&mut self, leg: u32, first: usize, batch: &mut Batch) -> Result<()> {
        let physics = self.physics;
        if physics.options.record_subrays {
            return Ok(());
        }
        let mut is_outside = false;
        for echoes in batch.echoes[first..].chunks_mut(rng::NORMALS_PER_BLOCK) {
            is_outside |= range_noise::apply_noise(echoes, &physics.range_noise, &self.instruments, leg)?;
        }
        for (i, plane) in self.detection.refracted.drain(..) {
            let echo = &mut batch.echoes[i];
            let corrected = plane.corrected(echo.origin, echo.direction, echo.range);
            echo.position = corrected.unwrap_or(echo.position);
        }
        if is_outside && physics.options.corrections.range_gate {
            range_noise::remove_outside(batch, first, &self.instruments, leg)?;
        }
        Ok(())
    }
}

/// Rejects points that are not finite or out of range, so that invalid inputs that no reader has rejected
/// never become points.
#[inline(always)]
fn check_positions(echoes: &[Echo]) -> Result<()> {
    let is_place = |echo: &Echo| {
        let [x, y, z] = echo.position.to_array().map(|coordinate| coordinate.abs() <= MAX_POSITION);
        x & y & z
    };
    if echoes.iter().fold(true, |all, echo| all & is_place(echo)) {
        return Ok(());
    }
    Err(no_place(echoes.iter().find(|echo| !is_place(echo))))
}

#[cold]
fn no_place(echo: Option<&Echo>) -> Error {
    let Some(Echo { position: p, range, pulse_number, device, .. }) = echo else {
        return Error::Internal("a point has no finite position".to_owned());
    };
    Error::input(format!(
        "pulse {pulse_number} of device {device} gives a point beyond ±{MAX_POSITION:e} m or NaN: x {} y {} \
         z {} at the range {} m; check the settings of the scanner and the coordinates of the scene",
        number(p.x),
        number(p.y),
        number(p.z),
        number(*range)
    ))
}

#[inline(always)]
fn choose_pattern(physics: &Physics, subrays: &Subrays, pulse: &Pulse) -> usize {
    match subrays.patterns() {
        1 => 0,
        n => physics.pattern_turns.bits(pulse.device, pulse.number, 0)[0] as usize % n,
    }
}
