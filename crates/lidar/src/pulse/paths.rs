//! Light that mirrors, panes and water pass on to other surfaces.
//!
//! Each subray that meets a mirror, a pane or water is followed to the surfaces behind it. Light returns the
//! way that it came, so every mirror and pane counts twice. A reflection at the end of a path has the optical
//! length of the path as its range, and the detector receives it like any other: echoes are on the axis of
//! the beam, as instruments report them.
//!
//! Light that mirrors turn back to the receiver is an echo of the last of them ([`super::specular`]): it does
//! not return the way that it came, and half of its way is its range.
//!
//! A subray splits in two at a pane. Paths end at the maximum order, beyond the maximum range, or when
//! hardly any light is left, and at the first surface in water. Pulses that meet no such surface have no
//! paths.

use super::continuum::LeafResponse;
use super::echo::{EchoPath, PathKind};
use super::foliage::FreePaths;
use super::instrument::Instrument;
use super::light::{
    Arrival, Departure, Found, Light, mirrored, next_surface, normal_towards, optics_of, spread_share,
};
use super::pane::Pane;
use super::reflect::ShadedSurface;
use super::reflections::{PathEnd, Reflections};
use super::specular::{Image, Mirror};
use super::traced::{NextHits, SubrayGains, TracedPulse};
use super::view::SceneView;
use super::water::{self, Refracted, WaterPlane};
use super::water_column::{ColumnRay, WaterColumn};
use vlscan_base::rng::Stream;
use vlscan_geom::{DVec3, unit};
use vlscan_scene::{OpticsKind, Water};
use vlscan_trace::Hits;

/// Share of the light, one way, below which a path ends: 1e-8 of it would return.
const MIN_SHARE: f64 = 1e-4;
/// Minimum reflectance factor of light that comes straight back.
const MIN_FACTOR: f64 = 1e-8;
/// Minimum length in air of light that enters water, m.
const MIN_AIR: f64 = 1e-3;

/// Paths of the light of one pulse.
#[derive(Clone, Debug, Default)]
pub(super) struct LightPaths {
    /// Arrivals at mirrors and panes that are not passed on yet; the last one is next.
    open: Vec<Arrival>,
    ends: Vec<Found>,
    column: WaterColumn,
    /// Ranges at which the gains of the instrument apply: those of the ends, but in water the length in air.
    ranges: Vec<f64>,
    rings: Vec<u32>,
    intensities: Vec<f64>,
    /// Draws of the pulse so far.
    drawn: u32,
    /// Centre of the receiver, m, and axis of the beam.
    receiver: [DVec3; 2],
}

impl LightPaths {
    /// Appends the reflections at the ends of all paths to `out`, and to `hits` if they differ from it.
    /// `max_order` is the maximum number of mirrors and panes on a path.
    #[inline(never)]
    pub fn follow(
        &mut self,
        view: &SceneView,
        instrument: &Instrument,
        (traced, gains): (TracedPulse, SubrayGains),
        (max_order, (slopes, paths)): (u8, (&Stream, &mut FreePaths)),
        hits: &mut Option<Reflections>,
        out: &mut Reflections,
    ) {
        self.find_arrivals(view, instrument, (&traced, &gains), out);
        if self.open.is_empty() {
            return;
        }
        let (detector, rings) = (&instrument.detector, &instrument.subrays.ring);
        let is_reflected =
            |i: &usize| traced.primitives[*i] != Hits::MISS && detector.is_in_range(gains.ranges[*i]);
        out.complete((0..traced.primitives.len()).filter(is_reflected), rings);
        let is_optical = |primitive: u32| optics_of(view, primitive).is_some();
        out.remove_dark(is_optical);
        if let Some(hits) = hits {
            hits.remove_dark(is_optical);
        }
        self.receiver = [traced.origin, axis_of(&traced)];
        let image = Image::of_beam(self.receiver[0], self.receiver[1]);
        let image = Some(image).filter(|_| instrument.aperture.is_some());
        self.open.iter_mut().for_each(|arrival| arrival.light.image = image);
        self.drawn = 0;
        self.ends.clear();
        self.column.clear();
        self.ranges.clear();
        self.intensities.clear();
        while let Some(arrival) = self.open.pop() {
            if let OpticsKind::Water(water) = arrival.optics.kind {
                self.enter_water(view, instrument, (&arrival, &water), (max_order, slopes), paths);
                continue;
            }
            let [mirrored, passed] = self.departures(view, &arrival, slopes, paths);
            // The light that is pushed last goes on first.
            for departure in [mirrored, passed].into_iter().flatten() {
                self.send_back(view, instrument, &departure, paths);
                self.send(view, instrument, &departure, max_order, paths);
            }
        }
        self.rings.clear();
        self.rings.extend(self.ends.iter().map(|found| rings[found.subray as usize]));
        instrument.energy.apply(&self.rings, &self.ranges, &mut self.intensities);
        for (i, Found { end, subray, primitive, cosine, range }) in self.ends.iter().enumerate() {
            let (source, intensity) = ((*subray, self.rings[i]), self.intensities[i]);
            out.push_end(source, *end, *range, (*primitive, *cosine), intensity);
            if let Some(hits) = hits {
                hits.push_end(source, *end, *range, (*primitive, *cosine), intensity);
            }
        }
        self.column.emit(instrument, hits, out);
    }

    /// Finds the subrays that meet mirrors and panes first: those among the reflections, which may lie behind
    /// foliage, and those that are nearer than the instrument measures.
    fn find_arrivals(
        &mut self,
        view: &SceneView,
        instrument: &Instrument,
        (traced, gains): (&TracedPulse, &SubrayGains),
        reflections: &Reflections,
    ) {
        self.open.clear();
        let detector = &instrument.detector;
        let subrays = reflections.subrays();
        let is_near_opaque = !detector.corrections.see_through_near;
        // Neighbouring subrays mostly hit the same primitive.
        let mut last = (Hits::MISS, None);
        let mut arrive = |subray: usize, range: f64, primitive: u32| {
            if last.0 != primitive {
                last = (primitive, optics_of(view, primitive));
            }
            if let Some(optics) = last.1.filter(|_| range <= detector.range_max) {
                let direction = traced.direction(subray);
                let at = traced.start(subray) + direction * range;
                let (subray, path) = (subray as u32, EchoPath::DIRECT);
                let light = Light { subray, length: range, share: 1.0, path, image: None };
                let is_first = primitive == traced.primitives[subray as usize]
                    && range.to_bits() == gains.ranges[subray as usize].to_bits();
                let next = traced.ahead.get(subray as usize).filter(|_| is_first).copied();
                let next = next.unwrap_or_default();
                self.open.push(Arrival { optics, primitive, at, direction, light, next });
            }
        };
        for (subray, (primitive, range)) in traced.primitives.iter().zip(gains.ranges).enumerate() {
            if subrays.is_none() || (is_near_opaque && *range < detector.range_min) {
                arrive(subray, *range, *primitive);
            }
        }
        for (i, subray) in subrays.into_iter().flatten().enumerate() {
            arrive(*subray as usize, reflections.ranges()[i], reflections.primitives()[i]);
        }
        self.open.reverse();
    }

    /// The light that a mirror or pane mirrors, and that which it lets pass.
    fn departures(
        &mut self,
        view: &SceneView,
        arrival: &Arrival,
        slopes: &Stream,
        paths: &FreePaths,
    ) -> [Option<Departure>; 2] {
        let Arrival { optics, primitive, at, direction, light, next } = *arrival;
        let Some(normal) = normal_towards(view, primitive, direction) else { return [None; 2] };
        let cosine = (-normal.dot(direction)).min(1.0);
        let order = light.path.order + 1;
        let image = light.image.and_then(Image::beyond);
        let pane = Pane::of(optics.kind);
        let shares = pane.map(|pane| pane.shares(cosine));
        let mirrored_share = match optics.kind {
            OpticsKind::Mirror { reflectance } => reflectance,
            OpticsKind::Pane { .. } | OpticsKind::Water(_) => shares.map_or(0.0, |shares| shares.mirrored),
        };
        let passed = pane.zip(shares).map(|(pane, shares)| {
            let crossing = pane.crossing(normal, direction);
            let kind = match light.path.kind {
                PathKind::Mirror => PathKind::Mirror,
                _ => PathKind::Pane,
            };
            let light = Light {
                length: light.length + crossing.length,
                share: light.share * optics.share * shares.transmitted,
                path: EchoPath { kind, order },
                image: image.map(|image| image.displaced(crossing.way, direction)),
                ..light
            };
            let (from, crossing, next) = (at + crossing.way, Some(crossing), next[1]);
            Departure { primitive, from, direction, crossing, roughness: 0.0, slowness: 1.0, light, next }
        });
        let roughness = optics.roughness;
        let mirror = Mirror { at, direction, primitive, cosine, roughness, is_water: false };
        let facet = self.facet(normal, roughness, slopes, paths);
        let direction = mirrored(direction, facet);
        let light = Light {
            share: light.share * optics.share * mirrored_share,
            path: EchoPath { kind: PathKind::Mirror, order },
            image: image.map(|image| image.mirrored(normal, mirror)),
            ..light
        };
        let (from, crossing, next) = (at, None, next[0]);
        let mirrored =
            Departure { primitive, from, direction, crossing, roughness, slowness: 1.0, light, next };
        // Light that a steep facet throws into the surface is lost.
        [Some(mirrored).filter(|_| direction.dot(normal) > 0.0), passed]
    }

    /// Draws the normal of a facet of a surface: its slopes along two axes are normally distributed.
    fn facet(&mut self, normal: DVec3, roughness: f64, slopes: &Stream, paths: &FreePaths) -> DVec3 {
        if roughness == 0.0 {
            return normal;
        }
        let aside = if normal.z.abs() < 0.9 { DVec3::Z } else { DVec3::X };
        let u = unit(normal.cross(aside));
        let v = normal.cross(u);
        let mut slope = || roughness * self.draw(slopes, paths);
        let (along_u, along_v) = (slope(), slope());
        unit(normal + u * along_u + v * along_v)
    }

    /// The next normally distributed number of the pulse.
    fn draw(&mut self, slopes: &Stream, paths: &FreePaths) -> f64 {
        let drawn = slopes.normal(paths.device, paths.pulse, self.drawn);
        self.drawn = self.drawn.wrapping_add(1);
        drawn
    }

    /// Light at the surface of water: its facets mirror some of it, straight back or on to other surfaces;
    /// the rest enters the water.
    fn enter_water(
        &mut self,
        view: &SceneView,
        instrument: &Instrument,
        (arrival, water): (&Arrival, &Water),
        (max_order, slopes): (u8, &Stream),
        paths: &mut FreePaths,
    ) {
        let Arrival { optics, primitive, at, direction, light, .. } = *arrival;
        let Some(normal) = normal_towards(view, primitive, direction) else { return };
        let facet = water::facet(water, normal, || self.draw(slopes, paths));
        let glint = optics.share * water::glint(water, normal, &facet, direction);
        if glint > 0.0 && instrument.detector.is_in_range(light.length) {
            let path = EchoPath { kind: kind_in_water(light, PathKind::WaterSurface), ..light.path };
            let end = PathEnd { surface: at, direction, path, plane: None };
            let cosine = (-normal.dot(direction)).min(1.0);
            self.ends.push(Found { end, subray: light.subray, primitive, cosine, range: light.length });
            self.ranges.push(light.length);
            self.intensities.push(glint * light.share * light.share);
        }
        let Some(refracted) = water::refract(water, facet.normal, direction) else { return };
        let mirrored_share = water::mirrored_share(water, refracted.cosines[0]);
        let mirrored = mirrored(direction, facet.normal);
        if mirrored.dot(normal) > 0.0 {
            let path = EchoPath { kind: PathKind::Mirror, order: light.path.order + 1 };
            let share = light.share * optics.share * mirrored_share;
            // What waves mirror straight back is the glint.
            let image = light.image.and_then(Image::beyond).filter(|_| water::is_flat(water));
            let cosine = refracted.cosines[0];
            let mirror = Mirror { at, direction, primitive, cosine, roughness: 0.0, is_water: true };
            let image = image.map(|image| image.mirrored(normal, mirror));
            let light = Light { share, path, image, ..light };
            let roughness = (0.5 * (water.slopes[0] + water.slopes[1])).sqrt();
            let (from, direction, crossing, next) = (at, mirrored, None, None);
            let departure =
                Departure { primitive, from, direction, crossing, roughness, slowness: 1.0, light, next };
            self.send_back(view, instrument, &departure, paths);
            self.send(view, instrument, &departure, max_order, paths);
        }
        if refracted.direction.dot(normal) < 0.0 {
            let share = light.share * optics.share * (1.0 - mirrored_share);
            let kind = kind_in_water(light, PathKind::WaterBottom);
            let path = EchoPath { kind, order: light.path.order + 1 };
            let plane = WaterPlane { point: at, normal, water: *water };
            let light = Light { share, path, ..light };
            self.dive(view, instrument, (primitive, light), (&plane, &refracted), paths);
        }
    }

    /// Follows light into water, which scatters some of it back, to the bottom.
    fn dive(
        &mut self,
        view: &SceneView,
        instrument: &Instrument,
        (primitive, light): (u32, Light),
        (plane, refracted): (&WaterPlane, &Refracted),
        paths: &mut FreePaths,
    ) {
        if light.share < MIN_SHARE {
            return;
        }
        let WaterPlane { point: from, water, .. } = *plane;
        let Refracted { direction, cosines } = *refracted;
        let slowness = water.group_index;
        let (roughness, crossing, next) = (0.0, None, None);
        let departure = Departure { primitive, from, direction, crossing, roughness, slowness, light, next };
        let bottom = next_surface(view, instrument, &departure, paths);
        let air = light.length.max(MIN_AIR);
        let attenuation = water::attenuation(&water, instrument.field_of_view, air);
        let of_beam = Some(*plane).filter(|_| light.path.kind.is_water());
        let end = PathEnd { surface: from, direction, path: light.path, plane: of_beam };
        if water::has_column(&water) {
            let kind = kind_in_water(light, PathKind::WaterColumn);
            self.column.push(ColumnRay {
                water,
                attenuation,
                primitive,
                cosine: cosines[0],
                source: (light.subray, instrument.subrays.ring[light.subray as usize]),
                end: PathEnd { path: EchoPath { kind, ..light.path }, ..end },
                from,
                air,
                way: bottom.map_or(f64::INFINITY, |(_, way)| way),
                cosines,
                share: light.share * light.share,
            });
        }
        let Some((at, way)) = bottom else { return };
        let length = light.length + slowness * way;
        let mut surface = ShadedSurface::none(view);
        surface.load(view, at.primitive);
        let corrections = &instrument.detector.corrections;
        let LeafResponse { cosine, factor } =
            surface.response(&at, direction, view.fixed_incidence, corrections);
        if factor > 0.0 && instrument.detector.is_in_range(length) {
            let end = PathEnd { surface: from + direction * way, ..end };
            let range = length;
            self.ends.push(Found { end, subray: light.subray, primitive: at.primitive, cosine, range });
            self.ranges.push(air);
            let spread = air * air / water::effective_range_squared(&water, air, way, cosines);
            let passed = light.share * light.share * libm::exp(-2.0 * attenuation * way);
            self.intensities.push(factor * passed * spread);
        }
    }

    /// Receives light that mirrors have turned back to the instrument, unless something is before it. Light
    /// that has passed the instrument counts where it passed: surfaces behind send it away from there.
    fn send_back(
        &mut self,
        view: &SceneView,
        instrument: &Instrument,
        departure: &Departure,
        paths: &mut FreePaths,
    ) {
        let Departure { from, light, .. } = *departure;
        let (Some(aperture), Some(image)) = (&instrument.aperture, light.image) else { return };
        let (Some(mirror), [receiver, axis]) = (image.mirror, self.receiver) else { return };
        let way = (receiver - from).length();
        let length = light.length + way;
        let range = 0.5 * length;
        let factor = light.share * aperture.factor(&image, (receiver, axis), length);
        let is_received =
            image.leads_to(from, receiver) && factor > MIN_FACTOR && instrument.detector.is_in_range(range);
        if !is_received {
            return;
        }
        let back = Departure { direction: unit(receiver - from), next: None, ..*departure };
        if next_surface(view, instrument, &back, paths).is_some_and(|(_, free)| free < way) {
            return;
        }
        let Mirror { at, direction, primitive, cosine, is_water, .. } = mirror;
        let kind = if is_water { PathKind::WaterSurface } else { PathKind::MirrorSurface };
        // The mirror itself is no mirror on the way.
        let path = EchoPath { kind, order: light.path.order.saturating_sub(1) };
        let end = PathEnd { surface: at, direction, path, plane: None };
        self.ends.push(Found { end, subray: light.subray, primitive, cosine, range });
        self.ranges.push(range);
        self.intensities.push(factor);
    }

    /// Follows light to the next surface, which reflects it or passes it on.
    fn send(
        &mut self,
        view: &SceneView,
        instrument: &Instrument,
        departure: &Departure,
        max_order: u8,
        paths: &mut FreePaths,
    ) {
        let Departure { from, direction, roughness, light, .. } = *departure;
        if light.share < MIN_SHARE {
            return;
        }
        let Some((at, way)) = next_surface(view, instrument, departure, paths) else { return };
        let length = light.length + way;
        let share = light.share * spread_share(instrument, roughness, way, length);
        let mut surface = ShadedSurface::none(view);
        surface.load(view, at.primitive);
        let corrections = &instrument.detector.corrections;
        let LeafResponse { cosine, factor } =
            surface.response(&at, direction, view.fixed_incidence, corrections);
        let point = from + direction * way;
        if factor > 0.0 && instrument.detector.is_in_range(length) {
            let end = PathEnd { surface: point, direction, path: light.path, plane: None };
            let range = length;
            self.ends.push(Found { end, subray: light.subray, primitive: at.primitive, cosine, range });
            self.ranges.push(length);
            self.intensities.push(factor * share * share);
        }
        if let Some(optics) = optics_of(view, at.primitive).filter(|_| light.path.order < max_order) {
            let light = Light { length, share, ..light };
            let (primitive, next) = (at.primitive, NextHits::default());
            self.open.push(Arrival { optics, primitive, at: point, direction, light, next });
        }
    }
}

/// Axis of a beam, on which its subrays are centred.
fn axis_of(traced: &TracedPulse) -> DVec3 {
    unit((0..traced.primitives.len()).fold(DVec3::ZERO, |sum, i| sum + traced.direction(i)))
}

/// Kind of a path into water: ghosts remain ghosts.
fn kind_in_water(light: Light, kind: PathKind) -> PathKind {
    if light.path.kind == PathKind::Mirror { PathKind::Mirror } else { kind }
}
