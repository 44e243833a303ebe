//! True causes of echoes: the surface of the strongest subray, and the share of the footprint.

use super::detector_settings::Return;
use super::echo::{EchoPath, EchoTruth};
use super::instrument::Instrument;
use super::reflections::{PathEnd, Reflections};
use super::traced::{SubrayGains, TracedPulse};
use super::triangle_cache::TriangleCache;
use super::view::SceneView;
use vlscan_geom::DVec3;
use vlscan_trace::Hits;

/// Subray and return of each reflection of a pulse.
#[derive(Clone, Debug, Default)]
pub(super) struct ReflectionSources {
    subrays: Vec<u32>,
    /// From 1; 0 for a reflection that is part of no return.
    returns: Vec<u32>,
}

impl ReflectionSources {
    /// Finds the subray of each reflection, and the nearest return if it is nearer than the pulse length.
    pub fn assign(
        &mut self,
        instrument: &Instrument,
        (traced, gains): (&TracedPulse, &SubrayGains),
        reflections: &Reflections,
        returns: &[Return],
    ) {
        let detector = &instrument.detector;
        self.subrays.clear();
        match reflections.subrays() {
            Some(subrays) => self.subrays.extend_from_slice(subrays),
            None => {
                let reflects =
                    |i: &usize| traced.primitives[*i] != Hits::MISS && detector.is_in_range(gains.ranges[*i]);
                self.subrays.extend((0..traced.primitives.len()).filter(reflects).map(|i| i as u32));
            }
        }
        let pulse_depth = detector.light_speed * detector.shape.duration;
        let nearest = |entry: &f64| {
            let off = |r: &Return| (r.range - entry).abs();
            let found = (1..).zip(returns).min_by(|a, b| off(a.1).total_cmp(&off(b.1)));
            found.filter(|(_, r)| off(r) <= pulse_depth).map_or(0, |(number, _)| number)
        };
        self.returns.clear();
        self.returns.extend(reflections.entries().iter().map(nearest));
    }

    /// True cause of return `number` (from 1): its strongest subray, or the reflection `source` if it has
    /// none. `beam` is the beam's origin and direction. The direction in the scanner's axes is left to the
    /// caller.
    pub fn of_return(
        &self,
        number: u32,
        source: usize,
        view: &SceneView,
        (traced, beam): (&TracedPulse, [DVec3; 2]),
        (reflections, triangles): (&Reflections, &mut TriangleCache),
    ) -> EchoTruth {
        let medium_of =
            |i: usize| reflections.end_of(i).map(|end| end.path.kind).filter(|kind| kind.is_of_medium());
        let medium = medium_of(source);
        // A raindrop in front of a surface may outshine each of its subrays, but not the surface.
        let is_alike = |i: &usize| medium_of(*i) == medium;
        let own = || (0..self.returns.len()).filter(|i| self.returns[*i] == number).filter(is_alike);
        let intensities = reflections.intensities();
        let strongest = own().max_by(|a, b| intensities[*a].total_cmp(&intensities[*b])).unwrap_or(source);
        let of_subray = self.of_reflection(strongest, view, (traced, beam), (reflections, triangles));
        let fraction = own().count() as f64 / traced.primitives.len().max(1) as f64;
        // The light of a column of water or fog is not that of single subrays.
        EchoTruth { fraction: if medium.is_some() { fraction.min(1.0) } else { fraction }, ..of_subray }
    }

    pub fn of_reflection(
        &self,
        i: usize,
        view: &SceneView,
        (traced, beam): (&TracedPulse, [DVec3; 2]),
        (reflections, triangles): (&Reflections, &mut TriangleCache),
    ) -> EchoTruth {
        let subray = self.subray_of(i);
        let (start, direction) = (traced.start(subray as usize), traced.direction(subray as usize));
        let primitive = reflections.primitives()[i];
        let is_air = primitive == Hits::MISS;
        let triangle = if is_air { None } else { triangles.look_up(view, primitive) };
        let normal = triangle.map_or(DVec3::ZERO, |t| t.normal);
        let PathEnd { surface, direction, path, .. } = match reflections.end_of(i) {
            Some(end) => *end,
            None => {
                let surface = start + direction * reflections.ranges()[i];
                PathEnd { surface, direction, path: EchoPath::DIRECT, plane: None }
            }
        };
        let colour = if view.has_colours && !is_air { view.colour_at(primitive, surface) } else { [0; 3] };
        EchoTruth {
            beam,
            surface,
            normal: if normal.dot(direction) > 0.0 { -normal } else { normal },
            fraction: 1.0 / traced.primitives.len().max(1) as f64,
            subray,
            path,
            colour,
        }
    }

    /// The reflections that are part of return `number`, from 1.
    pub fn of_number(&self, number: u32) -> impl Iterator<Item = usize> {
        (0..self.returns.len()).filter(move |i| self.returns[*i] == number)
    }

    pub fn subray_of(&self, reflection: usize) -> u32 {
        self.subrays.get(reflection).copied().unwrap_or(0)
    }

    /// Return that a reflection is part of, from 1; 0 for none.
    pub fn return_of(&self, reflection: usize) -> u32 {
        self.returns[reflection]
    }
}
