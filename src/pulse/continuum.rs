//! Light from all along the ways of subrays through foliage.
//!
//! A subray stands for a part of the footprint in which there are many leaves, so that what it loses to foliage returns
//! from everywhere along its way, by the density σ·exp(−τ) of the range at which light is intercepted first (Beer and
//! Lambert). Of a subray that is known to be intercepted it is that density over 1 − exp(−T), with the optical depth T of its
//! whole way. The light of a pulse is collected in cells of range that all of its subrays share: as wide as the bins of the
//! waveform, so that a homogeneous medium leaves no ripples there.

use super::instrument::Instrument;
use super::reflect::Encounter;
use super::reflections::Reflections;

/// Foliage along a ray.
#[derive(Clone, Copy, Debug)]
pub(super) struct Stretch {
    /// Where the ray enters it.
    pub entry: Encounter,
    /// From there on, m from the pulse's origin.
    pub from: f64,
    /// To there.
    pub to: f64,
    /// Extinction, 1/m.
    pub sigma: f64,
}

/// Optical depth of the way through `stretches` up to `end` m from the pulse's origin.
pub(super) fn depth(stretches: &[Stretch], end: f64) -> f64 {
    stretches.iter().map(|s| s.sigma * (s.to.min(end) - s.from).max(0.0)).sum()
}

/// How foliage reflects.
#[derive(Clone, Copy, Debug)]
pub(super) struct Leaves {
    /// Mean cosine of the incidence angle.
    pub cosine: f64,
    /// Mean reflectance factor.
    pub factor: f64,
}

/// Optical depth behind which no light is looked for: less than the 2⁻⁵³ that a draw resolves gets there.
pub(super) const MAX_DEPTH: f64 = 40.0;

/// Parts of the pulse's width at half maximum that are small enough to leave no ripples in a waveform of finer bins.
const CELLS_PER_WIDTH: f64 = 32.0;

/// The light of a pulse from foliage, and memory for it.
#[derive(Clone, Debug, Default)]
pub(super) struct Continuum {
    /// Width of a cell, m.
    cell: f64,
    /// Cells that hold light, by ascending number.
    pages: Vec<Page>,
    /// Foliage along the current subray by ascending entry.
    pub stretches: Vec<Stretch>,
    /// Of the current subray: cells, ranges and intensities.
    cells: Vec<(u64, Source)>,
    ranges: Vec<f64>,
    intensities: Vec<f64>,
    rings: Vec<u32>,
}

/// Cells per page.
const PAGE: usize = 64;

/// Neighbouring cells.
#[derive(Clone, Debug)]
struct Page {
    /// Number of the first cell, divided by [`PAGE`].
    number: u64,
    intensity: [f64; PAGE],
    /// Intensity times range.
    moment: [f64; PAGE],
    /// The brightest of the sources.
    source: [Source; PAGE],
}

/// What sends light back.
#[derive(Clone, Copy, Debug, Default)]
struct Source {
    primitive: u32,
    cosine: f64,
    intensity: f64,
}

impl Continuum {
    /// Forgets the light of the pulse before.
    pub fn clear(&mut self, instrument: &Instrument) {
        self.pages.clear();
        self.stretches.clear();
        self.cell = cell(instrument);
    }

    /// Adds the light of the current subray, which is intercepted before `end` m; `leaves` tells how a stretch reflects.
    pub fn scatter(
        &mut self,
        instrument: &Instrument,
        ring: u32,
        end: f64,
        leaves: impl Fn(&Stretch) -> Leaves,
    ) {
        let total = depth(&self.stretches, end);
        self.cells.clear();
        self.ranges.clear();
        self.intensities.clear();
        let mut bounds: Vec<f64> = self.stretches.iter().flat_map(|s| [s.from, s.to.min(end)]).collect();
        bounds.sort_unstable_by(f64::total_cmp);
        let leaves: Vec<Leaves> = self.stretches.iter().map(leaves).collect();
        let mut active: Vec<usize> = Vec::new();
        let mut next = 0;
        // What is left of the light, as a share of all that is intercepted.
        let mut left = -1.0 / libm::expm1(-total);
        for pair in bounds.windows(2) {
            let (from, to) = (pair[0], pair[1]);
            active.retain(|i| self.stretches[*i].to.min(end) > from);
            while let Some(s) = self.stretches.get(next).filter(|s| s.from <= from) {
                if s.to.min(end) > from {
                    active.push(next);
                }
                next += 1;
            }
            let sigma: f64 = active.iter().map(|i| self.stretches[*i].sigma).sum();
            let densest = active
                .iter()
                .copied()
                .max_by(|a, b| f64::total_cmp(&self.stretches[*a].sigma, &self.stretches[*b].sigma));
            let Some(densest) = densest.filter(|_| to > from) else { continue };
            let weighed = |i: &usize| self.stretches[*i].sigma * leaves[*i].factor;
            let factor = active.iter().map(weighed).sum::<f64>() / sigma;
            let source = Source {
                primitive: self.stretches[densest].entry.primitive,
                cosine: leaves[densest].cosine,
                intensity: 0.0,
            };
            left = self.fill((from, to), sigma, (left, factor), source);
        }
        self.rings.clear();
        self.rings.resize(self.ranges.len(), ring);
        instrument.energy.apply(&self.rings, &self.ranges, &mut self.intensities);
        for i in 0..self.cells.len() {
            let range = self.ranges[i];
            if range >= instrument.range_min && range <= instrument.range_max {
                self.add(i);
            }
        }
    }

    /// Cuts a homogeneous stretch into cells, each with the factor by which it reflects; what is left of the light behind.
    fn fill(
        &mut self,
        (from, to): (f64, f64),
        sigma: f64,
        (mut left, factor): (f64, f64),
        source: Source,
    ) -> f64 {
        let whole = libm::expm1(-sigma * self.cell);
        let mut number = (from / self.cell) as u64;
        let mut begin = from;
        while begin < to {
            let is_whole = begin > from;
            let border = (number + 1) as f64 * self.cell;
            let (finish, lost) = if is_whole && border <= to {
                (border, whole)
            } else {
                let finish = border.min(to);
                (finish, libm::expm1(-sigma * (finish - begin)))
            };
            if finish > begin {
                self.cells.push((number, source));
                self.ranges.push(begin + (finish - begin) * centroid(sigma * (finish - begin)));
                self.intensities.push(-lost * left * factor);
                left += lost * left;
            }
            (begin, number) = (finish.max(begin), number + 1);
        }
        left
    }

    fn add(&mut self, i: usize) {
        let (number, source) = self.cells[i];
        let (range, intensity) = (self.ranges[i], self.intensities[i]);
        let (page, place) = (number / PAGE as u64, (number % PAGE as u64) as usize);
        let at = self.pages.binary_search_by_key(&page, |p| p.number).unwrap_or_else(|at| {
            let empty = Page {
                number: page,
                intensity: [0.0; PAGE],
                moment: [0.0; PAGE],
                source: [Source::default(); PAGE],
            };
            self.pages.insert(at, empty);
            at
        });
        let page = &mut self.pages[at];
        page.intensity[place] += intensity;
        page.moment[place] += intensity * range;
        if intensity > page.source[place].intensity {
            page.source[place] = Source { intensity, ..source };
        }
    }

    /// Adds what was collected: a reflection per cell, where its light comes from on average.
    pub fn emit(&self, out: &mut Reflections) {
        for page in &self.pages {
            for i in 0..PAGE {
                if page.intensity[i] > 0.0 {
                    let range = page.moment[i] / page.intensity[i];
                    let source = page.source[i];
                    out.add_lit(range, source.primitive, source.cosine, page.intensity[i]);
                }
            }
        }
    }
}

/// Mean position of what an optical depth `depth` intercepts, from 0 (its front) to 1: 1/x − 1/(eˣ − 1).
fn centroid(depth: f64) -> f64 {
    if depth < 1e-2 { 0.5 - depth / 12.0 } else { 1.0 / depth - 1.0 / libm::expm1(depth) }
}

/// Width of the cells, m: a bin of the waveform, or several where bins are much finer than the pulse.
fn cell(instrument: &Instrument) -> f64 {
    let shape = &instrument.shape;
    let half = shape.samples.iter().copied().fold(0.0, f64::max) * 0.5;
    let width = shape.samples.iter().filter(|s| **s >= half).count() as f64;
    instrument.light_speed * shape.bin * (width / CELLS_PER_WIDTH).floor().max(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::DVec3;
    use crate::pulse::testkit::tls_instrument;

    fn stretch(primitive: u32, from: f64, to: f64, sigma: f64) -> Stretch {
        let entry = Encounter { from: DVec3::ZERO, t: from, primitive, range: from, stop: from };
        Stretch { entry, from, to, sigma }
    }

    /// Light by range, primitive and as a share of that of a mirror there: what reflects has a factor of 1.
    fn light(stretches: &[Stretch], end: f64, instrument: &Instrument) -> Vec<(f64, u32, f64)> {
        let (mut continuum, mut out) = (Continuum::default(), Reflections::default());
        continuum.clear(instrument);
        continuum.stretches.extend_from_slice(stretches);
        continuum.scatter(instrument, 0, end, |_| Leaves { cosine: 0.5, factor: 1.0 });
        continuum.emit(&mut out);
        let mut gains = vec![1.0; out.count()];
        instrument.energy.apply(&vec![0; out.count()], out.ranges(), &mut gains);
        assert!(out.cosines().iter().all(|c| *c == 0.5));
        let shares = out.intensities().iter().zip(gains).map(|(i, g)| i / g);
        out.ranges().iter().zip(out.primitives()).zip(shares).map(|((r, p), s)| (*r, *p, s)).collect()
    }

    /// The share of the light from before `range`, by the closed form, of what is intercepted before `end`.
    fn expected(stretches: &[Stretch], range: f64, end: f64) -> f64 {
        libm::expm1(-depth(stretches, range.min(end))) / libm::expm1(-depth(stretches, end))
    }

    #[test]
    fn light_returns_by_the_truncated_exponential() {
        let instrument = tls_instrument(4.0);
        let cell = cell(&instrument);
        let cases = [
            (vec![stretch(7, 100.0, 108.0, 0.05)], f64::INFINITY),
            (vec![stretch(7, 100.0, 102.0, 3.0)], f64::INFINITY),
            (vec![stretch(7, 100.0, 101.0, 0.5), stretch(8, 101.0, 102.5, 2.0)], f64::INFINITY),
            (vec![stretch(7, 100.0, 101.0, 0.5), stretch(8, 100.3, 103.0, 0.2)], f64::INFINITY),
            (vec![stretch(7, 100.0, 104.0, 0.3), stretch(8, 110.0, 112.0, 0.3)], 111.2),
            (vec![stretch(7, 100.0, 100.01, 0.3)], f64::INFINITY),
        ];
        for (stretches, end) in &cases {
            let light = light(stretches, *end, &instrument);
            let total: f64 = light.iter().map(|l| l.2).sum();
            assert!((total - 1.0).abs() < 1e-5, "all that is intercepted returns: {total}");
            let mut sum = 0.0;
            for (range, primitive, share) in &light {
                let (before, after) =
                    (expected(stretches, range - cell, *end), expected(stretches, range + cell, *end));
                assert!(
                    sum + share > before - 1e-5 && sum < after + 1e-5,
                    "{range} m: {before} {sum} {after}"
                );
                sum += share;
                let inside = |s: &&Stretch| range > &s.from && range < &s.to.min(*end);
                let densest =
                    stretches.iter().filter(inside).max_by(|a, b| a.sigma.total_cmp(&b.sigma)).unwrap();
                let near_border = |s: &Stretch| (range - s.from).abs() < cell || (range - s.to).abs() < cell;
                assert!(densest.entry.primitive == *primitive || stretches.iter().any(near_border));
            }
            assert!(light.windows(2).all(|w| w[1].0 > w[0].0));
        }
        // Mean range of a long, dense medium: 1/σ behind its front.
        let light = light(&[stretch(1, 50.0, 80.0, 1.25)], f64::INFINITY, &instrument);
        let mean: f64 = light.iter().map(|l| l.0 * l.2).sum();
        assert!((mean - 50.8).abs() < 1e-4, "{mean}");
        // Neighbouring cells are nearer than a quarter of the pulse's width at half maximum: 3.39/7 of 4 ns.
        let widest = light.windows(2).map(|w| w[1].0 - w[0].0).fold(0.0, f64::max);
        assert!(widest < 0.25 * 4.0 * 3.39 / 7.0 * instrument.light_speed, "{widest}");
    }

    #[test]
    fn what_is_out_of_range_is_not_measured() {
        let mut instrument = tls_instrument(4.0);
        (instrument.range_min, instrument.range_max) = (101.0, 102.0);
        let light = light(&[stretch(1, 100.0, 110.0, 0.7)], f64::INFINITY, &instrument);
        let (first, last) = (light[0].0, light[light.len() - 1].0);
        assert!((101.0..101.1).contains(&first) && (101.9..=102.0).contains(&last), "{first} {last}");
    }

    #[test]
    fn subrays_share_cells() {
        let instrument = tls_instrument(4.0);
        let (mut continuum, mut once, mut twice) =
            (Continuum::default(), Reflections::default(), Reflections::default());
        continuum.clear(&instrument);
        continuum.stretches.push(stretch(1, 100.0, 105.0, 0.4));
        let leaves = |_: &Stretch| Leaves { cosine: 0.5, factor: 0.3 };
        continuum.scatter(&instrument, 0, f64::INFINITY, leaves);
        continuum.emit(&mut once);
        continuum.scatter(&instrument, 0, f64::INFINITY, leaves);
        continuum.emit(&mut twice);
        assert_eq!(once.count(), twice.count());
        for (a, b) in once.intensities().iter().zip(twice.intensities()) {
            assert_eq!(2.0 * a, *b);
        }
    }
}
