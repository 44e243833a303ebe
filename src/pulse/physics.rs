//! The whole way of a pulse: expand → trace → reflect → receive → detect → emit.

use super::cluster::Clusters;
use super::detect::{Return, attribute, detect};
use super::foliage::FreePaths;
use super::instrument::{Fleet, Instrument};
use super::light::Light;
use super::range_noise;
use super::receiver::ReceiverModel;
use super::reflect::{Probe, View};
use super::reflections::Reflections;
use super::sight::{Shot, Sights};
use super::slope::Slopes;
use super::subray::Subrays;
use super::truth::Truths;
use super::waveform::Waveform;
use super::{Echo, EchoTruth, PhysicsOptions, PulseRecord, WaveformRecord};
use crate::flight::Pulse;
use crate::geom::{Aabb, DVec3};
use crate::pulse::Batch;
use crate::rng::{self, Purpose, Stream};
use crate::scene::{DynamicObject, DynamicScene, ObjectUpdate, Scene};
use crate::survey::Survey;
use crate::tree::{Geometry, Hits, Level, RayGroup, Tree};
use crate::{Error, Result};
use std::ops::Range;
use std::sync::Arc;

/// Longest waveform that is recorded, samples (1,250 km of 0.25 ns bins).
pub(super) const LONGEST_RECORD: u64 = 1 << 24;

/// The pulse physics of a survey over a scene: immutable, shared by all workers.
#[derive(Clone, Debug)]
pub struct Physics<'a> {
    view: View<'a>,
    /// Box that the beam's axis must meet for the pulse to count.
    gate: Option<Aabb>,
    fleet: Arc<Fleet>,
    options: PhysicsOptions,
    range_noise: Stream,
    waveform_noise: Stream,
    free_paths: Stream,
    pattern_turns: Stream,
}

impl<'a> Physics<'a> {
    /// Computes the constants of all devices and legs of `survey`. Fails on settings that no instrument can have (bins
    /// without width) or no memory hold (millions of subrays or of pulse samples).
    pub fn new(scene: &'a Scene, tree: &'a Tree, survey: &Survey, o: PhysicsOptions) -> Result<Physics<'a>> {
        Ok(Physics {
            view: View {
                scene,
                tree,
                moving: &[],
                limits: limits(scene, &o),
                fixed_incidence: o.fixed_incidence,
                largest_cube: scene
                    .geometry
                    .cubes
                    .iter()
                    .fold(0.0, |largest, c| f64::max(largest, c.half * 2.0)),
            },
            gate: gate(scene, &o),
            fleet: Arc::new(Fleet::new(survey, &o)?),
            options: o,
            range_noise: Stream::new(o.seed, Purpose::Range),
            waveform_noise: Stream::new(o.seed, Purpose::Waveform),
            free_paths: Stream::new(o.seed, Purpose::FreePath),
            pattern_turns: Stream::new(o.seed, Purpose::PatternTurn),
        })
    }

    /// Rays of a pulse, of the device that has most of them.
    pub fn most_rays(&self) -> usize {
        self.fleet.most_rays()
    }

    /// The instruments that a shooter begins with.
    pub fn equipment(&self) -> Equipment {
        Equipment(self.fleet.clone())
    }

    /// A shooter for one worker.
    pub fn shooter(&self) -> Shooter<'_> {
        let volleys = vec![Volley::default(); self.fleet.devices()];
        Shooter {
            physics: self,
            fleet: self.fleet.clone(),
            volleys,
            apart: Volley::default(),
            places: Vec::new(),
            receiver: Receiver::default(),
            level: Level::best(),
        }
    }
}

/// The scene's box if something may lie outside of it and must not be seen: what moves there once the scene is loaded.
fn limits(scene: &Scene, o: &PhysicsOptions) -> Option<Aabb> {
    let (b, g) = (scene.bounds, &scene.geometry);
    let within = |p: DVec3, half: f64| (p - half).cmpge(b.min).all() && (p + half).cmple(b.max).all();
    let all = g.vertices.iter().all(|v| within(*v, 0.0)) && g.cubes.iter().all(|c| within(c.centre, c.half));
    let may_leave = !all || !scene.moving_parts.is_empty();
    (!o.corrections.unbounded_scene && may_leave).then_some(b)
}

/// The box of spec pulse-physics §2.1 that the axis must meet.
fn gate(scene: &Scene, o: &PhysicsOptions) -> Option<Aabb> {
    (!o.corrections.no_axis_gate && !o.corrections.unbounded_scene).then_some(scene.bounds)
}

/// The instruments of a survey by leg and device, apart from what they look at.
#[derive(Clone, Debug)]
pub struct Equipment(Arc<Fleet>);

impl Equipment {
    /// Computes all that `survey` uses.
    ///
    /// # Errors
    /// As [`Physics::new`].
    pub fn new(survey: &Survey, options: &PhysicsOptions) -> Result<Equipment> {
        Fleet::new(survey, options).map(|fleet| Equipment(Arc::new(fleet)))
    }
}

/// Most pulses that are traced together, over all devices.
const VOLLEY: usize = 128;
/// Most rays that are traced together, unless one pulse has more.
const VOLLEY_RAYS: usize = 1 << 16;

/// Pulses whose ranges are computed one after the other, so that none of them waits for another's square roots.
const SIGHTED: usize = 8;

/// Fires pulses. One per worker: it owns the memory, which stays from pulse to pulse.
#[derive(Clone, Debug)]
pub struct Shooter<'p> {
    physics: &'p Physics<'p>,
    /// The survey's instruments, or those taken up later.
    fleet: Arc<Fleet>,
    /// One per device, whose neighbouring pulses hit neighbouring things.
    volleys: Vec<Volley>,
    /// Pulses of one device that see the moving parts at the same places.
    apart: Volley,
    /// Place of each pulse in its device's volley; `None` if its axis misses the scene.
    places: Vec<Option<usize>>,
    receiver: Receiver,
    /// The instruction set of everything behind the tracing.
    pub(super) level: Level,
}

/// A stage that some pulses have gone through, see [`Shooter::fire_timed`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Lap {
    /// They are rays.
    Aimed,
    /// It is known what the rays hit.
    Traced,
    /// The echoes are in the batch.
    Received,
}

/// Pulses of one device on their way.
#[derive(Clone, Debug, Default)]
struct Volley {
    rays: RayGroup,
    hits: Hits,
    /// Where each ray leaves the instrument, pulse by pulse, m; empty where all rays of a pulse leave its origin.
    exits: Vec<DVec3>,
    /// The same rays one by one, and what they hit, if they do not leave the origin.
    single: Box<(RayGroup, Hits)>,
}

impl Volley {
    fn trace(&mut self, tree: &Tree, geometry: &Geometry) {
        if self.exits.is_empty() {
            return tree.trace_group(geometry, &self.rays, &mut self.hits);
        }
        let (rays, n, stride) = (&self.rays, self.rays.rays(), self.rays.stride());
        let (single, hits) = &mut *self.single;
        single.clear(1);
        for (i, exit) in self.exits.iter().enumerate() {
            let d = rays.direction(i / n, i % n);
            single.push(*exit, |x, y, z| (x[0], y[0], z[0]) = (d.x, d.y, d.z));
        }
        tree.trace_group(geometry, single, hits);
        self.hits.t.clear();
        self.hits.t.resize(rays.len() * stride, f64::INFINITY);
        self.hits.primitive.clear();
        self.hits.primitive.resize(rays.len() * stride, Hits::MISS);
        for i in 0..self.exits.len() {
            let (to, from) = (i / n * stride + i % n, i * single.stride());
            (self.hits.t[to], self.hits.primitive[to]) = (hits.t[from], hits.primitive[from]);
        }
    }
}

/// Memory of everything behind the tracing.
#[derive(Clone, Debug, Default)]
struct Receiver {
    sights: Sights,
    probe: Probe,
    reflections: Reflections,
    light: Light,
    slopes: Slopes,
    truths: Truths,
    clusters: Clusters,
    waveform: Waveform,
    returns: Vec<Return>,
}

impl Shooter<'_> {
    /// Fires with other instruments from now on; they must have as many devices as the survey's, and legs are those of
    /// the survey that they were computed from.
    pub fn take_up(&mut self, equipment: &Equipment) {
        self.fleet = equipment.0.clone();
    }

    /// Fires `pulses`, emitted one after the other in leg `leg` (position among the survey's legs), and appends what they
    /// yield to `batch` in their order. What a pulse yields does not depend on those fired with it; many at once are
    /// traced several times faster. Fails if the survey has no such leg or device, or if a waveform is too long to be
    /// recorded.
    pub fn fire_all(&mut self, leg: u32, pulses: &[Pulse], batch: &mut Batch) -> Result<()> {
        self.fire_timed(leg, pulses, batch, |_| ())
    }

    /// [`Shooter::fire_all`] that tells `lap` whenever some pulses are through a stage.
    pub fn fire_timed(
        &mut self,
        leg: u32,
        pulses: &[Pulse],
        batch: &mut Batch,
        mut lap: impl FnMut(Lap),
    ) -> Result<()> {
        pulses.chunks(self.together()).try_for_each(|pulses| {
            self.aim(leg, pulses)?;
            lap(Lap::Aimed);
            self.trace();
            lap(Lap::Traced);
            self.receive(leg, pulses, 0..pulses.len(), &[], batch)?;
            lap(Lap::Received);
            Ok(())
        })
    }

    /// [`Shooter::fire_all`] over a scene with moving parts, which `stage` shows as the first pulse sees them. `changes`
    /// come in the order of the pulses that see them first. The still parts are traced for many pulses at once, however
    /// often the others move.
    pub fn fire_moving(
        &mut self,
        leg: u32,
        pulses: &[Pulse],
        stage: &mut DynamicScene,
        changes: &[ObjectUpdate],
        batch: &mut Batch,
    ) -> Result<()> {
        let (mut fired, mut changes) = (0, changes.iter().peekable());
        for volley in pulses.chunks(self.together()) {
            self.aim(leg, volley)?;
            self.trace();
            let mut done = 0;
            while done < volley.len() {
                while let Some(change) = changes.next_if(|c| c.first_pulse <= fired + done) {
                    stage.apply(change);
                }
                let until =
                    changes.peek().map_or(volley.len(), |c| (c.first_pulse - fired).min(volley.len()));
                let moving = stage.rebuild_moved();
                self.trace_moving(moving, volley, done..until);
                self.receive(leg, volley, done..until, moving, batch)?;
                done = until;
            }
            fired += volley.len();
        }
        Ok(())
    }

    /// Pulses that are traced together.
    fn together(&self) -> usize {
        (VOLLEY_RAYS / self.fleet.most_rays().max(1)).clamp(1, VOLLEY)
    }

    /// [`Shooter::fire_all`] of one pulse.
    pub fn fire(&mut self, leg: u32, pulse: &Pulse, batch: &mut Batch) -> Result<()> {
        self.fire_all(leg, std::slice::from_ref(pulse), batch)
    }

    /// Expands pulses into subrays.
    fn aim(&mut self, leg: u32, pulses: &[Pulse]) -> Result<()> {
        match self.level {
            Level::Portable => self.aim_here(leg, pulses),
            // SAFETY: the level is available only where the features are.
            #[cfg(target_arch = "x86_64")]
            Level::Avx2 => unsafe { self.aim_avx2(leg, pulses) },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            Level::Avx512 => unsafe { self.aim_avx512(leg, pulses) },
        }
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    fn aim_avx2(&mut self, leg: u32, pulses: &[Pulse]) -> Result<()> {
        self.aim_here(leg, pulses)
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx512f,avx512vl,avx512bw,avx512dq")]
    fn aim_avx512(&mut self, leg: u32, pulses: &[Pulse]) -> Result<()> {
        self.aim_here(leg, pulses)
    }

    /// As [`Shooter::receive_here`]: the same bits on all sets.
    #[inline(always)]
    fn aim_here(&mut self, leg: u32, pulses: &[Pulse]) -> Result<()> {
        let Shooter { physics, fleet, volleys, places, .. } = self;
        volleys.iter_mut().for_each(|v| v.rays.clear(0));
        places.clear();
        for pulse in pulses {
            let subrays = &fleet.instrument(leg, pulse.device)?.subrays;
            if !meets(physics.gate, pulse.origin, axis(pulse)) {
                places.push(None);
                continue;
            }
            let Volley { rays, exits: exits_of_device, .. } = &mut volleys[pulse.device as usize];
            if rays.is_empty() {
                exits_of_device.clear();
                rays.clear(subrays.len());
            }
            let pattern = pattern(physics, subrays, pulse);
            subrays.expand(pattern, &pulse.attitude, rays.add(pulse.origin));
            if let Some(exits) = subrays.exits(pattern) {
                exits_of_device.extend(exits.iter().map(|exit| pulse.origin + pulse.attitude.apply(*exit)));
            }
            places.push(Some(rays.len() - 1));
        }
        Ok(())
    }

    fn trace(&mut self) {
        let View { scene, tree, .. } = self.physics.view;
        for volley in self.volleys.iter_mut().filter(|v| !v.rays.is_empty()) {
            volley.trace(tree, &scene.geometry);
        }
    }

    /// Lets some of the pulses hit moving parts where these are nearer than what stands still.
    fn trace_moving(&mut self, moving: &[DynamicObject], pulses: &[Pulse], some: Range<usize>) {
        let Shooter { physics, volleys, apart, places, .. } = self;
        let scene = physics.view.scene;
        for (device, volley) in volleys.iter_mut().enumerate() {
            let of_device = |i: &usize| pulses[*i].device as usize == device;
            let mut own = some.clone().filter(of_device).filter_map(|i| places[i]);
            let Some(first) = own.next() else { continue };
            // Pulses of a device have places one after the other.
            let rows = first..own.next_back().unwrap_or(first) + 1;
            apart.rays.copy_from(&volley.rays, rows.clone());
            apart.exits.clear();
            if !volley.exits.is_empty() {
                let n = volley.rays.rays();
                apart.exits.extend_from_slice(&volley.exits[rows.start * n..rows.end * n]);
            }
            for actor in moving {
                apart.trace(&actor.tree, &actor.scene.geometry);
                let first = rows.start * apart.rays.stride();
                let (number, order) = (|i| actor.to_scene_index(i), |i| scene.number_when_stored(i));
                volley.hits.take_nearer(first, &apart.hits, number, order);
            }
        }
    }

    /// Turns the hits of some of the pulses into records.
    fn receive(
        &mut self,
        leg: u32,
        pulses: &[Pulse],
        some: Range<usize>,
        moving: &[DynamicObject],
        batch: &mut Batch,
    ) -> Result<()> {
        self.receiver.probe.facets.forget_moving();
        let volley = Arrived { leg, pulses: &pulses[some.clone()], places: some, moving };
        match self.level {
            Level::Portable => self.receive_here::<false>(&volley, batch),
            // SAFETY: the level is available only where the features are.
            #[cfg(target_arch = "x86_64")]
            Level::Avx2 => unsafe { self.receive_avx2(&volley, batch) },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            Level::Avx512 => unsafe { self.receive_avx512(&volley, batch) },
        }
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    fn receive_avx2(&mut self, volley: &Arrived, batch: &mut Batch) -> Result<()> {
        self.receive_here::<false>(volley, batch)
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx512f,avx512vl,avx512bw,avx512dq")]
    fn receive_avx512(&mut self, volley: &Arrived, batch: &mut Batch) -> Result<()> {
        self.receive_here::<true>(volley, batch)
    }

    /// Plain Rust that the compiler turns into instructions of whatever set it is inlined for: nothing is fused or
    /// reordered, so that all of them give the same bits.
    #[inline(always)]
    fn receive_here<const WIDE: bool>(&mut self, volley: &Arrived, batch: &mut Batch) -> Result<()> {
        let physics = self.physics;
        let view = View { moving: volley.moving, ..physics.view };
        let places = &self.places[volley.places.clone()];
        let first_echo = batch.echoes.len();
        for (pulses, places) in volley.pulses.chunks(SIGHTED).zip(places.chunks(SIGHTED)) {
            self.receiver.sights.clear();
            for (pulse, place) in pulses.iter().zip(places) {
                if let Some(place) = *place {
                    let of_device = &self.volleys[pulse.device as usize];
                    let instrument = self.fleet.instrument(volley.leg, pulse.device)?;
                    let shot = Shot::of(&of_device.rays, &of_device.hits, place);
                    shot.foresee(view.scene);
                    self.receiver.sights.push(instrument, &shot);
                }
            }
            let mut first = 0;
            for (pulse, place) in pulses.iter().zip(places) {
                if physics.options.record_pulses {
                    batch.pulses.push(pulse_record(pulse));
                }
                if let Some(place) = *place {
                    let of_device = &self.volleys[pulse.device as usize];
                    let instrument = self.fleet.instrument(volley.leg, pulse.device)?;
                    let shot = Shot::of(&of_device.rays, &of_device.hits, place);
                    self.receiver.receive::<WIDE>(physics, &view, instrument, pulse, (shot, first), batch)?;
                    first += shot.blocks();
                }
            }
        }
        if physics.options.record_subrays {
            // They are where the surfaces are: no noise.
            batch.echoes[first_echo..].iter_mut().for_each(|e| e.position = e.truth.surface);
            return Ok(());
        }
        for echoes in batch.echoes[first_echo..].chunks_mut(rng::LANES) {
            range_noise::disturb(echoes, &physics.range_noise, &self.fleet, volley.leg)?;
        }
        Ok(())
    }
}

/// Pulses that have been traced.
struct Arrived<'a> {
    leg: u32,
    pulses: &'a [Pulse],
    /// Where they stand among those that were aimed together.
    places: Range<usize>,
    moving: &'a [DynamicObject],
}

/// The pattern of subrays that a pulse has.
#[inline(always)]
fn pattern(physics: &Physics, subrays: &Subrays, pulse: &Pulse) -> usize {
    match subrays.patterns() {
        1 => 0,
        n => physics.pattern_turns.bits(pulse.device, pulse.number, 0)[0] as usize % n,
    }
}

/// Direction of the beam as it is traced; no component is a negative zero.
fn axis(pulse: &Pulse) -> DVec3 {
    pulse.attitude.forward() + DVec3::ZERO
}

fn pulse_record(pulse: &Pulse) -> PulseRecord {
    PulseRecord {
        origin: pulse.origin,
        direction: axis(pulse),
        time_ns: pulse.time_ns,
        number: pulse.number,
        device: pulse.device,
        scan_angle: pulse.scan_angle,
    }
}

/// Whether a beam along `axis` meets the box, not only behind its back.
fn meets(gate: Option<Aabb>, origin: DVec3, axis: DVec3) -> bool {
    let Some(b) = gate else { return true };
    b.slabs(origin, axis).is_some_and(|(enter, exit)| !(enter < 0.0 && exit <= 0.0))
}

impl Receiver {
    /// From the hits of a pulse's subrays, whose ranges begin in block `first` of the sights, to its records.
    #[inline(always)]
    fn receive<const WIDE: bool>(
        &mut self,
        physics: &Physics,
        view: &View,
        instrument: &Instrument,
        pulse: &Pulse,
        (shot, first): (Shot, usize),
        batch: &mut Batch,
    ) -> Result<()> {
        let corrections = &instrument.corrections;
        let mut paths =
            FreePaths { stream: physics.free_paths, device: pulse.device, pulse: pulse.number, drawn: 0 };
        let seen = (shot, self.sights.of(first, &shot));
        view.reflect(instrument, seen, &mut paths, &mut self.probe, &mut self.reflections);
        let model = instrument.receiver.as_ref();
        if self.reflections.is_empty() && !model.is_some_and(ReceiverModel::has_false_alarms) {
            return Ok(());
        }
        self.light.order::<WIDE>(&self.reflections, corrections.sum_equal_ranges);
        self.returns.clear();
        let kept =
            |range: f64| !corrections.count_kept_returns || !too_near(range + pulse.range_error, instrument);
        if corrections.smooth_slopes && !self.reflections.is_empty() {
            let facets = &mut self.probe.facets;
            self.slopes.merge(view, instrument, seen, &self.reflections, facets, &mut self.light);
        }
        if physics.options.record_waveforms || !self.detect_without_waveform(instrument, kept) {
            if !self.waveform.receive(&self.light, instrument) {
                return Ok(());
            }
            let (width, of) = (physics.options.echo_width, (pulse.device, pulse.number));
            if let Some(model) = model {
                model.distort(&mut self.waveform, physics.options.record_waveforms, of);
            }
            detect::<WIDE>(&self.waveform, instrument, width, kept, &mut self.returns);
            if let Some(model) = model {
                model.add_false_alarms(&self.waveform, instrument, of, &mut self.returns);
            }
        }
        if physics.options.record_truth || physics.options.record_subrays {
            let seen = (&shot, &self.sights.of(first, &shot));
            self.truths.assign(instrument, seen, &self.reflections, &self.returns);
        }
        if physics.options.record_subrays {
            self.emit_subrays(view, &shot, pulse, batch);
            return Ok(());
        }
        if self.returns.is_empty() {
            return Ok(());
        }
        self.emit_echoes(view, instrument, physics.options.record_truth.then_some(&shot), pulse, batch);
        if physics.options.record_waveforms && self.waveform.bins > 0 {
            self.emit_waveform(physics, instrument, pulse, batch)?;
        }
        Ok(())
    }

    /// The returns that show without adding up a waveform; `false` if they do not.
    #[inline(always)]
    fn detect_without_waveform(&mut self, instrument: &Instrument, kept: impl Fn(f64) -> bool) -> bool {
        if let Some(rule) = &instrument.clusters {
            return self.clusters.detect(rule, &self.light, instrument, kept, &mut self.returns);
        }
        let found = instrument.lone.as_ref().and_then(|lone| lone.detect(&self.light, instrument));
        self.returns.extend(found.into_iter().flatten().filter(|r| kept(r.range)));
        found.is_some()
    }

    /// Errors and attribution of each return (spec pulse-physics §4.7–4.9).
    #[inline(always)]
    fn emit_echoes(
        &mut self,
        view: &View,
        instrument: &Instrument,
        truth_of: Option<&Shot>,
        pulse: &Pulse,
        batch: &mut Batch,
    ) {
        let direction = pulse.reported_attitude.forward();
        let origin = pulse.origin + pulse.origin_error;
        let true_beam = [pulse.origin, pulse.exact_attitude.forward()];
        for (number, r) in (1..).zip(&self.returns) {
            if r.is_noise {
                batch.echoes.push(self.false_alarm(pulse, number, r));
                continue;
            }
            let source = attribute(&self.reflections, r.range);
            if instrument.receiver.is_some() && self.is_far_from(source, r, instrument) {
                batch.echoes.push(self.false_alarm(pulse, number, r));
                continue;
            }
            let primitive = self.reflections.primitives()[source];
            let range = r.range + pulse.range_error;
            if too_near(range, instrument) {
                continue;
            }
            let (part, classification) = match self.probe.facets.look_up(view, primitive) {
                Some(facet) => (facet.part, facet.classification),
                None => {
                    let surface = view.scene.surface(primitive);
                    (surface.part, view.scene.materials[surface.material as usize].classification)
                }
            };
            let truth = truth_of.map_or(EchoTruth::default(), |shot| {
                let found = (&self.reflections, &mut self.probe.facets);
                self.truths.of_return(number, source, view, (shot, pulse.origin), found)
            });
            batch.echoes.push(Echo {
                truth,
                // Comes with the noise.
                position: origin,
                origin,
                direction,
                true_beam,
                range,
                true_range: self.reflections.ranges()[source],
                intensity: r.amplitude,
                echo_width: r.width,
                return_number: number,
                number_of_returns: self.returns.len() as u32,
                pulse_number: pulse.number,
                device: pulse.device,
                part,
                primitive,
                classification,
                incidence_cosine: self.reflections.cosines()[source],
                scan_angle: pulse.scan_angle,
                time_ns: pulse.time_ns,
            });
        }
    }

    /// Appends every reflection of a subray as an echo at the place of the surface, in the order of the subrays. It bears the
    /// number of the return that it is part of, or 0.
    #[inline(never)]
    fn emit_subrays(&mut self, view: &View, shot: &Shot, pulse: &Pulse, batch: &mut Batch) {
        for i in 0..self.reflections.count() {
            let found = (&self.reflections, &mut self.probe.facets);
            let truth = self.truths.of_reflection(i, view, (shot, pulse.origin), found);
            let primitive = self.reflections.primitives()[i];
            let surface = view.scene.surface(primitive);
            let (range, direction) = (self.reflections.ranges()[i], shot.direction(truth.subray as usize));
            batch.echoes.push(Echo {
                direction,
                true_beam: [pulse.origin, direction],
                range,
                true_range: range,
                intensity: self.reflections.intensities()[i],
                return_number: self.truths.return_of(i),
                number_of_returns: self.returns.len().max(1) as u32,
                part: surface.part,
                primitive,
                classification: view.scene.materials[surface.material as usize].classification,
                incidence_cosine: self.reflections.cosines()[i],
                truth,
                ..Echo::miss(&pulse_record(pulse))
            });
        }
    }

    /// Whether a return lies farther from a reflection than a pulse is long, so that only noise can have made it.
    fn is_far_from(&self, reflection: usize, r: &Return, instrument: &Instrument) -> bool {
        let pulse_depth = instrument.light_speed * instrument.shape.duration;
        (self.reflections.ranges()[reflection] - r.range).abs() > pulse_depth
    }

    /// An echo of nothing: it has a range, but neither part nor primitive.
    #[inline(never)]
    fn false_alarm(&self, pulse: &Pulse, number: u32, r: &Return) -> Echo {
        Echo {
            direction: pulse.exact_attitude.forward(),
            range: r.range + pulse.range_error,
            intensity: r.amplitude,
            echo_width: r.width,
            return_number: number,
            number_of_returns: self.returns.len() as u32,
            ..Echo::miss(&pulse_record(pulse))
        }
    }

    #[inline(never)]
    fn emit_waveform(
        &self,
        physics: &Physics,
        instrument: &Instrument,
        pulse: &Pulse,
        batch: &mut Batch,
    ) -> Result<()> {
        let waveform = &self.waveform;
        if waveform.bins > LONGEST_RECORD {
            return Err(Error::input(format!(
                "the waveform of pulse {} of device {} has {} samples, at most {LONGEST_RECORD} can be recorded; \
                 set maxFullwaveRange_ns or a larger binSize_ns",
                pulse.number, pulse.device, waveform.bins
            )));
        }
        let first_sample = batch.samples.len();
        let skipped = match instrument.corrections.clip_dead_zone {
            true => waveform.first_beyond(instrument.range_min, instrument),
            false => 0,
        };
        waveform.append_to(&mut batch.samples, skipped);
        let sigma = instrument.waveform_noise.sigma(&batch.samples[first_sample..]);
        if sigma != 0.0 {
            for (j, sample) in (0..).zip(&mut batch.samples[first_sample..]) {
                *sample += sigma * physics.waveform_noise.normal(pulse.device, pulse.number, j);
            }
        }
        batch.waveforms.push(WaveformRecord {
            pulse_number: pulse.number,
            device: pulse.device,
            origin: pulse.origin,
            direction: axis(pulse),
            start_ns: waveform.start + skipped as f64 * instrument.shape.bin,
            end_ns: waveform.end(instrument.shape.bin),
            time_ns: pulse.time_ns,
            first_sample,
            samples: batch.samples.len() - first_sample,
        });
        Ok(())
    }
}

/// The near-range filter. A range that is no number passes.
fn too_near(range: f64, instrument: &Instrument) -> bool {
    range < instrument.range_min
}
