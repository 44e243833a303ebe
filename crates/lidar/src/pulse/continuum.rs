//! Light that foliage returns from everywhere along the paths of subrays.
//!
//! A subray represents a part of the footprint that holds many leaves, so the light that it loses to foliage
//! returns from everywhere along its path, with the density σ·exp(−τ) of the range at which light is
//! intercepted first (Beer and Lambert). For a subray that is known to be intercepted it is that density over
//! 1 − exp(−T), with the optical depth T of the path. The light of a pulse is collected in range cells that
//! all of its subrays share. They are as wide as the bins of the waveform, so that a homogeneous medium
//! leaves no ripples there.
//!
//! That is the limit of leaves much smaller than the footprint. Foliage of larger elements (shoots, clusters
//! of leaves) intercepts a column of the footprint, as wide as an element, at one place ([`intercept`]).

use super::detector_settings::DetectorSettings;
use super::energy::Energy;
use super::reflections::Reflections;
use super::view::Interaction;

#[derive(Clone, Copy, Debug)]
pub(super) struct MediumSegment {
    /// Entry of the ray.
    pub entry: Interaction,
    /// Distance of the entry from the pulse's origin, m.
    pub from: f64,
    /// Distance of the exit from the pulse's origin, m.
    pub to: f64,
    /// Extinction, 1/m.
    pub sigma: f64,
}

/// Optical depth of `segments` up to `end` m from the pulse's origin.
pub(super) fn depth(segments: &[MediumSegment], end: f64) -> f64 {
    segments.iter().map(|s| s.sigma * (s.to.min(end) - s.from).max(0.0)).sum()
}

/// The segment in which light is intercepted at an optical depth, the densest of those that overlap there,
/// and the distance from the pulse's origin, m; `None` if the foliage up to `end` m has less depth.
pub(super) fn intercept(segments: &[MediumSegment], target: f64, end: f64) -> Option<(MediumSegment, f64)> {
    let mut bounds: Vec<f64> = segments.iter().flat_map(|s| [s.from, s.to.min(end)]).collect();
    bounds.sort_unstable_by(f64::total_cmp);
    let mut passed = 0.0;
    for pair in bounds.windows(2).filter(|pair| pair[1] > pair[0]) {
        let active = || segments.iter().filter(|s| s.from <= pair[0] && s.to.min(end) > pair[0]);
        let sigma: f64 = active().map(|s| s.sigma).sum();
        let depth = sigma * (pair[1] - pair[0]);
        if sigma > 0.0 && passed + depth >= target {
            let densest = active().max_by(|a, b| a.sigma.total_cmp(&b.sigma))?;
            return Some((*densest, pair[0] + (target - passed) / sigma));
        }
        passed += depth;
    }
    None
}

#[derive(Clone, Copy, Debug)]
pub(super) struct LeafResponse {
    /// Mean cosine of the incidence angle.
    pub cosine: f64,
    pub factor: f64,
}

/// Optical depth behind which the search for light ends: less light than the 2⁻⁵³ that a draw resolves
/// reaches it.
pub(super) const MAX_DEPTH: f64 = 40.0;

/// Cells per full width of the pulse at half maximum that leave no ripples in a waveform of finer bins.
const CELLS_PER_WIDTH: f64 = 32.0;

/// The light of a pulse from foliage by range, and scratch memory.
#[derive(Clone, Debug, Default)]
pub(super) struct FoliageContinuum {
    /// Width of a cell, m.
    cell: f64,
    /// Pages of cells that hold light, by ascending number.
    pages: Vec<Page>,
    /// Foliage along the current subray by ascending entry.
    pub segments: Vec<MediumSegment>,
    /// Cells of the current subray, their ranges and intensities.
    cells: Vec<(u64, Source)>,
    ranges: Vec<f64>,
    intensities: Vec<f64>,
    rings: Vec<u32>,
}

const CELLS_PER_PAGE: usize = 64;

#[derive(Clone, Debug)]
struct Page {
    /// Number of the first cell, divided by [`CELLS_PER_PAGE`].
    number: u64,
    intensity: [f64; CELLS_PER_PAGE],
    /// Intensity times range.
    moment: [f64; CELLS_PER_PAGE],
    /// The source with the greatest intensity.
    source: [Source; CELLS_PER_PAGE],
}

#[derive(Clone, Copy, Debug, Default)]
struct Source {
    primitive: u32,
    cosine: f64,
    intensity: f64,
}

impl FoliageContinuum {
    pub fn clear(&mut self, detector: &DetectorSettings) {
        self.pages.clear();
        self.segments.clear();
        self.cell = cell_width(detector);
    }

    /// Adds the light of the current subray, which is intercepted before `end` m; `response` evaluates a
    /// segment.
    pub fn scatter(
        &mut self,
        (energy, detector): (&Energy, &DetectorSettings),
        ring: u32,
        end: f64,
        response: impl Fn(&MediumSegment) -> LeafResponse,
    ) {
        let total = depth(&self.segments, end);
        self.cells.clear();
        self.ranges.clear();
        self.intensities.clear();
        let mut bounds: Vec<f64> = self.segments.iter().flat_map(|s| [s.from, s.to.min(end)]).collect();
        bounds.sort_unstable_by(f64::total_cmp);
        let responses: Vec<LeafResponse> = self.segments.iter().map(response).collect();
        let mut active: Vec<usize> = Vec::new();
        let mut next = 0;
        // Light that is left, as a share of all that is intercepted.
        let mut left = -1.0 / libm::expm1(-total);
        for pair in bounds.windows(2) {
            let (from, to) = (pair[0], pair[1]);
            active.retain(|i| self.segments[*i].to.min(end) > from);
            while let Some(s) = self.segments.get(next).filter(|s| s.from <= from) {
                if s.to.min(end) > from {
                    active.push(next);
                }
                next += 1;
            }
            let sigma_of = |i: &usize| self.segments[*i].sigma;
            let sigma: f64 = active.iter().map(sigma_of).sum();
            let densest = active.iter().copied().max_by(|a, b| sigma_of(a).total_cmp(&sigma_of(b)));
            let Some(densest) = densest.filter(|_| to > from) else { continue };
            let factor = active.iter().map(|i| sigma_of(i) * responses[*i].factor).sum::<f64>() / sigma;
            let (primitive, cosine) = (self.segments[densest].entry.primitive, responses[densest].cosine);
            let source = Source { primitive, cosine, intensity: 0.0 };
            left = self.fill((from, to), sigma, (left, factor), source);
        }
        self.rings.clear();
        self.rings.resize(self.ranges.len(), ring);
        energy.apply(&self.rings, &self.ranges, &mut self.intensities);
        for i in 0..self.cells.len() {
            if detector.is_in_range(self.ranges[i]) {
                self.add(i);
            }
        }
    }

    /// Splits a homogeneous interval into cells, each with the factor by which it reflects. Returns the light
    /// left behind it.
    fn fill(
        &mut self,
        (from, to): (f64, f64),
        sigma: f64,
        (mut left, factor): (f64, f64),
        source: Source,
    ) -> f64 {
        let lost_in_cell = libm::expm1(-sigma * self.cell);
        let mut number = (from / self.cell) as u64;
        let mut start = from;
        while start < to {
            let border = (number + 1) as f64 * self.cell;
            let (finish, lost) = if start > from && border <= to {
                (border, lost_in_cell)
            } else {
                let finish = border.min(to);
                (finish, libm::expm1(-sigma * (finish - start)))
            };
            if finish > start {
                self.cells.push((number, source));
                self.ranges.push(start + (finish - start) * centroid(sigma * (finish - start)));
                self.intensities.push(-lost * left * factor);
                left += lost * left;
            }
            (start, number) = (finish.max(start), number + 1);
        }
        left
    }

    fn add(&mut self, i: usize) {
        let (number, source) = self.cells[i];
        let (range, intensity) = (self.ranges[i], self.intensities[i]);
        let (page, slot) = (number / CELLS_PER_PAGE as u64, (number % CELLS_PER_PAGE as u64) as usize);
        let at = self.pages.binary_search_by_key(&page, |p| p.number).unwrap_or_else(|at| {
            let empty = Page {
                number: page,
                intensity: [0.0; CELLS_PER_PAGE],
                moment: [0.0; CELLS_PER_PAGE],
                source: [Source::default(); CELLS_PER_PAGE],
            };
            self.pages.insert(at, empty);
            at
        });
        let page = &mut self.pages[at];
        page.intensity[slot] += intensity;
        page.moment[slot] += intensity * range;
        if intensity > page.source[slot].intensity {
            page.source[slot] = Source { intensity, ..source };
        }
    }

    /// Appends a reflection for each cell with light, at the mean range of that light.
    pub fn emit(&self, out: &mut Reflections) {
        for page in &self.pages {
            for i in 0..CELLS_PER_PAGE {
                if page.intensity[i] > 0.0 {
                    let range = page.moment[i] / page.intensity[i];
                    let source = page.source[i];
                    out.push_lit(range, source.primitive, source.cosine, page.intensity[i]);
                }
            }
        }
    }
}

/// Mean position of the light that an optical depth intercepts, from 0 (its front) to 1: 1/x − 1/(eˣ − 1).
pub(super) fn centroid(depth: f64) -> f64 {
    if depth < 1e-2 { 0.5 - depth / 12.0 } else { 1.0 / depth - 1.0 / libm::expm1(depth) }
}

/// Width of the cells, m: a bin of the waveform, or several where bins are much finer than the pulse.
pub(super) fn cell_width(detector: &DetectorSettings) -> f64 {
    let shape = &detector.shape;
    let half = shape.samples.iter().copied().fold(0.0, f64::max) * 0.5;
    let width = shape.samples.iter().filter(|s| **s >= half).count() as f64;
    detector.light_speed * shape.bin * (width / CELLS_PER_WIDTH).floor().max(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pulse::instrument::Instrument;
    use crate::pulse::testkit::tls_instrument;
    use vlscan_geom::DVec3;

    fn segment(primitive: u32, from: f64, to: f64, sigma: f64) -> MediumSegment {
        let entry = Interaction { from: DVec3::ZERO, t: from, primitive, range: from, scatter_range: from };
        MediumSegment { entry, from, to, sigma }
    }

    /// Returns (range, primitive, share) of the light; shares are relative to a mirror at that range, as the
    /// reflectance factor is 1.
    fn light(segments: &[MediumSegment], end: f64, instrument: &Instrument) -> Vec<(f64, u32, f64)> {
        let (mut continuum, mut out) = (FoliageContinuum::default(), Reflections::default());
        continuum.clear(&instrument.detector);
        continuum.segments.extend_from_slice(segments);
        continuum.scatter((&instrument.energy, &instrument.detector), 0, end, |_| LeafResponse {
            cosine: 0.5,
            factor: 1.0,
        });
        continuum.emit(&mut out);
        let mut gains = vec![1.0; out.count()];
        instrument.energy.apply(&vec![0; out.count()], out.ranges(), &mut gains);
        assert!(out.cosines().iter().all(|c| *c == 0.5));
        let shares = out.intensities().iter().zip(gains).map(|(i, g)| i / g);
        out.ranges().iter().zip(out.primitives()).zip(shares).map(|((r, p), s)| (*r, *p, s)).collect()
    }

    /// By the closed form, the share of the light intercepted before `end` that comes from before `range`.
    fn expected(segments: &[MediumSegment], range: f64, end: f64) -> f64 {
        libm::expm1(-depth(segments, range.min(end))) / libm::expm1(-depth(segments, end))
    }

    #[test]
    fn light_is_intercepted_at_its_depth() {
        let segments =
            [segment(7, 100.0, 101.0, 0.5), segment(8, 100.5, 102.5, 2.0), segment(9, 110.0, 111.0, 1.0)];
        let at = |depth: f64, end: f64| {
            intercept(&segments, depth, end).map(|(s, range)| (s.entry.primitive, range))
        };
        assert_eq!(at(0.2, f64::INFINITY), Some((7, 100.4)));
        assert_eq!(at(0.25 + 2.5 * 0.4, f64::INFINITY), Some((8, 100.9)));
        assert_eq!(at(0.25 + 1.25 + 3.0 + 0.5, f64::INFINITY), Some((9, 110.5)));
        assert_eq!((at(5.6, f64::INFINITY), at(4.6, 110.0), at(0.6, 100.0)), (None, None, None));
    }

    #[test]
    fn light_returns_by_the_truncated_exponential() {
        let instrument = tls_instrument(4.0);
        let cell = cell_width(&instrument.detector);
        let cases = [
            (vec![segment(7, 100.0, 108.0, 0.05)], f64::INFINITY),
            (vec![segment(7, 100.0, 102.0, 3.0)], f64::INFINITY),
            (vec![segment(7, 100.0, 101.0, 0.5), segment(8, 101.0, 102.5, 2.0)], f64::INFINITY),
            (vec![segment(7, 100.0, 101.0, 0.5), segment(8, 100.3, 103.0, 0.2)], f64::INFINITY),
            (vec![segment(7, 100.0, 104.0, 0.3), segment(8, 110.0, 112.0, 0.3)], 111.2),
            (vec![segment(7, 100.0, 100.01, 0.3)], f64::INFINITY),
        ];
        for (segments, end) in &cases {
            let light = light(segments, *end, &instrument);
            let total: f64 = light.iter().map(|l| l.2).sum();
            assert!((total - 1.0).abs() < 1e-5, "all that is intercepted returns: {total}");
            let mut sum = 0.0;
            for (range, primitive, share) in &light {
                let (before, after) =
                    (expected(segments, range - cell, *end), expected(segments, range + cell, *end));
                assert!(
                    sum + share > before - 1e-5 && sum < after + 1e-5,
                    "{range} m: {before} {sum} {after}"
                );
                sum += share;
                let inside = |s: &&MediumSegment| range > &s.from && range < &s.to.min(*end);
                let densest =
                    segments.iter().filter(inside).max_by(|a, b| a.sigma.total_cmp(&b.sigma)).unwrap();
                let near_border =
                    |s: &MediumSegment| (range - s.from).abs() < cell || (range - s.to).abs() < cell;
                assert!(densest.entry.primitive == *primitive || segments.iter().any(near_border));
            }
            assert!(light.windows(2).all(|w| w[1].0 > w[0].0));
        }
        // Mean range of a long, dense medium: 1/σ behind its front.
        let light = light(&[segment(1, 50.0, 80.0, 1.25)], f64::INFINITY, &instrument);
        let mean: f64 = light.iter().map(|l| l.0 * l.2).sum();
        assert!((mean - 50.8).abs() < 1e-4, "{mean}");
        // Neighbouring cells are nearer than a quarter of the pulse's width at half maximum: 3.39/7 of 4 ns.
        let widest = light.windows(2).map(|w| w[1].0 - w[0].0).fold(0.0, f64::max);
        assert!(widest < 0.25 * 4.0 * 3.39 / 7.0 * instrument.detector.light_speed, "{widest}");
    }

    #[test]
    fn what_is_out_of_range_is_not_measured() {
        let mut instrument = tls_instrument(4.0);
        (instrument.detector.range_min, instrument.detector.range_max) = (101.0, 102.0);
        let light = light(&[segment(1, 100.0, 110.0, 0.7)], f64::INFINITY, &instrument);
        let (first, last) = (light[0].0, light[light.len() - 1].0);
        assert!((101.0..101.1).contains(&first) && (101.9..=102.0).contains(&last), "{first} {last}");
    }

    #[test]
    fn subrays_share_cells() {
        let instrument = tls_instrument(4.0);
        let (mut continuum, mut once, mut twice) =
            (FoliageContinuum::default(), Reflections::default(), Reflections::default());
        continuum.clear(&instrument.detector);
        continuum.segments.push(segment(1, 100.0, 105.0, 0.4));
        let leaves = |_: &MediumSegment| LeafResponse { cosine: 0.5, factor: 0.3 };
        continuum.scatter((&instrument.energy, &instrument.detector), 0, f64::INFINITY, leaves);
        continuum.emit(&mut once);
        continuum.scatter((&instrument.energy, &instrument.detector), 0, f64::INFINITY, leaves);
        continuum.emit(&mut twice);
        assert_eq!(once.count(), twice.count());
        for (a, b) in once.intensities().iter().zip(twice.intensities()) {
            assert_eq!(2.0 * a, *b);
        }
    }
}
