//! The quantities that are compared: heights, returns, classes, intensity, pulses, scan lines.

use super::clock::{Angles, check_clocks};
use super::cut::{Cut, of_both};
use super::pulses::Pulses;
use super::quantity::{MAX_VALUES, evenly};
use super::setting::{Findings, Setting, step_of_values};
use super::statistic::Statistic::{self, Frequency, Mean, Quantile, Share, Spread};
use rayon::prelude::*;
use vlscan_formats::Attribute;

/// Edges of the reported classes of heights above the terrain, m.
const STRATA: [f64; 8] = [f64::NEG_INFINITY, -0.5, 0.5, 2.0, 5.0, 10.0, 20.0, f64::INFINITY];
/// Minimum share, in either cloud, of a reported class of points, percent.
const MIN_SHARE: f64 = 0.01;
const QUARTILES: [Statistic; 6] =
    [Mean, Quantile(0.05), Quantile(0.25), Quantile(0.5), Quantile(0.75), Quantile(0.95)];

impl Setting<'_> {
    pub fn density(&self, found: &mut Findings) {
        let all = of_both(self.cuts, |cut| self.grid.counts(cut.offsets()));
        let occupied: Vec<bool> = all[0].iter().zip(&all[1]).map(|(a, b)| a + b > 0.0).collect();
        let area = self.grid.side * self.grid.side;
        let definition = self.define(
            "Density",
            "density of cells",
            ("1/m²", "cell"),
            &[Mean],
            "points per m² of the cells that hold points of either cloud",
        );
        let densities = |points: &mut dyn Iterator<Item = [f64; 3]>, weight: f64| {
            let counts = self.grid.counts(points);
            let of_occupied = counts.iter().zip(&occupied).filter(|(_, is_occupied)| **is_occupied);
            of_occupied.map(|(count, _)| count * weight / area).collect()
        };
        found.add("density", self.of_cells(definition, &densities));
    }

    pub fn heights(&self, found: &mut Findings) {
        let (meaning, statistics) = match &self.terrain {
            Some(terrain) => {
                let shares = STRATA.windows(2).map(|pair| Share(pair[0], pair[1]));
                let meaning = format!("heights above {}", terrain.description());
                (meaning, QUARTILES.into_iter().chain(shares).collect::<Vec<_>>())
            }
            None => (
                format!(
                    "heights above the lowest point of both clouds within squares of {} m",
                    self.wide_grid.side
                ),
                QUARTILES.to_vec(),
            ),
        };
        let heights = self.cuts.map(|cut| self.heights_of(cut));
        let has_returns = self.cuts.map(|cut| (0..cut.len()).any(|i| cut.returns(i).is_some()));
        let define = |name, of: &str| {
            self.define("Heights", name, ("m", "point"), &statistics, &format!("{of}{meaning}"))
        };
        let steps = self.cuts.map(|cut| self.step_of_heights(cut));
        found.add("heights", self.of_points(define("height", ""), heights.clone(), steps[0]));
        if has_returns.contains(&false) {
            found.note_missing(
                "heights of first and last returns",
                "a cloud has no return numbers and numbers of returns",
            );
        } else {
            type Choice = (&'static str, &'static str, fn((u8, u8)) -> bool);
            let choices: [Choice; 2] = [
                ("height of first returns", "first returns: ", |(number, _)| number == 1),
                ("height of last returns", "last returns: ", |(number, count)| number >= count),
            ];
            for (name, of, is_chosen) in choices {
                let chosen = [0, 1].map(|cloud: usize| {
                    let is_chosen = |i: usize| self.cuts[cloud].returns(i).is_some_and(is_chosen);
                    let heights = (0..).step_by(steps[cloud]).zip(&heights[cloud]);
                    heights.map(|(i, h)| if is_chosen(i) { *h } else { f64::NAN }).collect()
                });
                found.add(name, self.of_points(define(name, of), chosen, steps[0]));
            }
        }
        let definition = self.define(
            "Heights",
            "height range of cells",
            ("m", "cell"),
            &QUARTILES,
            "highest minus lowest point of each cell with at least two points; of fewer points it is smaller",
        );
        let ranges = |points: &mut dyn Iterator<Item = [f64; 3]>, _: f64| -> Vec<f64> {
            let extremes = self.grid.extremes(points);
            extremes.into_iter().map(|[low, high]| high - low).filter(|range| *range > 0.0).collect()
        };
        found.add("height range of cells", self.of_cells(definition, &ranges));
    }

    /// Of how many points of a cut one has a height: above a terrain fewer heights are computed.
    fn step_of_heights(&self, cut: &Cut) -> usize {
        let of_terrain = self.terrain.as_ref().map_or(1, |_| cut.len().div_ceil(self.most));
        of_terrain.max(step_of_values(cut))
    }

    /// The height of every n-th point of a cut, see [`Setting::step_of_heights`]; NaN where there is no
    /// terrain.
    fn heights_of(&self, cut: &Cut) -> Vec<f64> {
        let height = |i: usize| {
            let p = cut.offset(i);
            match &self.terrain {
                Some(terrain) => terrain.height([p[0], p[1]]).map_or(f64::NAN, |(z, _)| p[2] - z),
                None => p[2] - self.lowest[self.wide_grid.cell(&p)],
            }
        };
        let heights = (0..cut.len()).into_par_iter().step_by(self.step_of_heights(cut)).map(height).collect();
        cut.points.release();
        heights
    }

    pub fn returns(&self, found: &mut Findings) {
        const NAME: &str = "returns per pulse";
        let whole = |number: u8| Share(f64::from(number), f64::from(number) + 1.0);
        let statistics: Vec<Statistic> =
            [Mean].into_iter().chain((1..=4).map(whole)).chain([Share(5.0, f64::INFINITY)]).collect();
        let mut definition = self.define(
            "Returns",
            NAME,
            ("", "pulse"),
            &statistics,
            "number of returns of each pulse with an echo: points of one time and source, or the first \
             returns where there are no times",
        );
        definition.is_whole = true;
        let returns = [0, 1].map(|cloud: usize| match &self.pulses[cloud] {
            Ok(pulses) => evenly(pulses.echoes(), MAX_VALUES),
            Err(_) => {
                let cut = self.cuts[cloud];
                let of_first =
                    |i: usize| cut.returns(i).filter(|(number, _)| *number == 1).map(|(_, n)| (n, i as u32));
                evenly((0..cut.len()).filter_map(of_first), MAX_VALUES)
            }
        });
        let [first, second] = returns;
        let first = first.into_iter().map(|(count, point)| (f64::from(count), self.block(point)));
        let second = second.into_iter().map(|(count, _)| f64::from(count)).collect();
        match definition.measure(first, second, self.halves.as_ref()) {
            Some(quantity) => found.quantities.push(quantity),
            None => found.note_missing(NAME, "a cloud has neither GPS times nor numbers of returns"),
        }
    }

    pub fn classes(&self, found: &mut Findings) {
        if self.cuts.iter().any(|cut| !cut.points.has(Attribute::Class)) {
            return found.note_missing("classes", "a cloud has none");
        }
        let classes = self.cuts.map(|cut| -> Vec<f64> {
            let chosen = (0..cut.len()).into_par_iter().step_by(step_of_values(cut));
            chosen.map(|i| cut.class(i).map_or(f64::NAN, f64::from)).collect()
        });
        let counts = [0, 1].map(|cloud: usize| {
            let mut counts = vec![0.0; 256];
            classes[cloud]
                .iter()
                .for_each(|class| counts[*class as usize] += 100.0 / classes[cloud].len() as f64);
            counts
        });
        let is_told = |class: &usize| counts[0][*class].max(counts[1][*class]) >= MIN_SHARE;
        let shares: Vec<Statistic> =
            (0..256).filter(is_told).map(|class| Share(class as f64, class as f64 + 1.0)).collect();
        let mut definition = self.define(
            "Classes",
            "class",
            ("", "point"),
            &shares,
            "shares of the classes of points by their codes in LAS",
        );
        definition.is_whole = true;
        found.add("classes", self.of_points(definition, classes, step_of_values(self.cuts[0])));
    }

    pub fn intensity(&self, found: &mut Findings) {
        if self.cuts.iter().any(|cut| !cut.points.has(Attribute::Intensity)) {
            return found.note_missing("intensities", "a cloud has none");
        }
        let scaled = self.cuts.map(|cut| -> Vec<f64> {
            let median = cut.median_intensity().unwrap_or(f64::NAN);
            let scale = if median > 0.0 { 1.0 / median } else { f64::NAN };
            let value = |i: usize| {
                let intensity = cut.points.intensity_of(cut.index(i));
                intensity.map_or(f64::NAN, f64::from) * scale
            };
            (0..cut.len()).into_par_iter().step_by(step_of_values(cut)).map(value).collect()
        });
        let definition = self.define(
            "Intensity",
            "intensity over its median",
            ("", "point"),
            &QUARTILES,
            "intensities in units of each cloud's median, since instruments scale them differently",
        );
        match self.of_points(definition, scaled, step_of_values(self.cuts[0])) {
            Some(quantity) => found.quantities.push(quantity),
            None => found.note_missing("intensities", "a cloud has none, or more than half of them are 0"),
        }
    }

    pub fn pulses(&self, found: &mut Findings) {
        let pulses = match self.both_pulses() {
            Ok(pulses) => pulses,
            Err(why) => return found.note_missing("pulses, scan angles and scan lines", &why.to_string()),
        };
        let intervals = pulses.map(|pulses| pulses.intervals().map(|(t, line)| (1e6 * t, line)));
        let definition = self.define(
            "Pulses",
            "time between pulses",
            ("µs", "pulse"),
            &[
                Frequency(1e6),
                Mean,
                Quantile(0.05),
                Quantile(0.25),
                Quantile(0.5),
                Quantile(0.75),
                Quantile(0.95),
            ],
            "time from a pulse with an echo to the next one of its scan line; the rate is that of pulses \
             with echoes within lines",
        );
        found.add("time between pulses", self.of_lines(definition, intervals));
        if pulses.iter().any(|pulses| !pulses.has_angles) {
            return found.note_missing("scan angles", "a cloud has none, or all are equal");
        }
        let angles = pulses.map(|pulses| pulses.angles());
        let definition = self.define(
            "Pulses",
            "scan angle",
            ("°", "pulse"),
            &QUARTILES,
            "scan angles as the files have them",
        );
        found.add("scan angles", self.of_lines(definition, angles));
        self.angles_at_same_time(pulses, found);
    }

    /// Measures scan angles of pulses at the same time.
    fn angles_at_same_time(&self, pulses: [&Pulses; 2], found: &mut Findings) {
        const AT_TIME: &str = "scan angle at the same time";
        if let Err(why) = check_clocks(pulses) {
            return found.note_missing(AT_TIME, &why.to_string());
        }
        let [first, second] = pulses;
        let Some(angles) = Angles::of(first) else {
            return found.note_missing(AT_TIME, "the first cloud has one pulse per scan line");
        };
        let mut definition = self.define(
            "Pulses",
            AT_TIME,
            ("°", "pulse"),
            &[Mean, Spread, Quantile(0.025), Quantile(0.5), Quantile(0.975)],
            "scan angle minus that of the first cloud at the same time; chance is what the angles of the \
             first cloud differ from those between the pulses before and after",
        );
        definition.errors = self.halves.is_some().then(|| angles.errors());
        let differences = angles.differences(second.count(), &|i| second.pulse(i), |(value, _)| value);
        let own = |i: usize| first.pulse(i);
        let quantity = match self.halves {
            Some(_) => {
                let with_lines = angles.differences(first.count(), &own, |value| value);
                definition.measure(with_lines, differences, self.halves_of_lines())
            }
            None => {
                let values = angles.differences(first.count(), &own, |(value, _)| value);
                definition.compare(values, differences, None, None)
            }
        };
        match quantity {
            Some(quantity) => found.quantities.push(quantity),
            None => found.note_missing(AT_TIME, "the clouds share no GPS times"),
        }
    }

    pub fn lines(&self, found: &mut Findings) {
        let Ok(pulses) = self.both_pulses() else { return };
        for (pulses, cloud) in pulses.iter().zip(["first", "second"]) {
            if !pulses.has_lines {
                let why = format!(
                    "the {cloud} cloud has neither gaps in its GPS times nor turns of the scan angle"
                );
                return found.note_missing("scan lines", &why);
            }
        }
        let define = |name: &str, of, statistics: &[Statistic], meaning| {
            self.define("Scan lines", name, of, statistics, meaning)
        };
        let milliseconds =
            |pulses: &Pulses| pulses.line_intervals().into_iter().map(|(t, line)| (1e3 * t, line));
        let definition = define(
            "time between scan lines",
            ("ms", "line"),
            &[Frequency(1e3), Mean, Quantile(0.05), Quantile(0.5), Quantile(0.95)],
            "from a scan line (arc) to the next one, at the median scan angle of the source or, without \
             angles, in the middle; the rate is that of lines, of revolutions if there is one line in each",
        );
        found.add("time between scan lines", self.of_lines(definition, pulses.map(milliseconds)));
        let definition = define(
            "pulses per scan line",
            ("", "line"),
            &[Mean, Quantile(0.05), Quantile(0.5), Quantile(0.95)],
            "pulses with an echo of each scan line",
        );
        found.add("pulses per scan line", self.of_lines(definition, pulses.map(|p| p.line_lengths())));
        let spacings = pulses.map(|pulses| pulses.spacings());
        let definition = define(
            "spacing along scan lines",
            ("m", "pulse"),
            &[Mean, Quantile(0.05), Quantile(0.25), Quantile(0.5), Quantile(0.75), Quantile(0.95)],
            "horizontal distance between the first echoes of successive pulses of a line",
        );
        found.add("spacing along scan lines", self.of_lines(definition, spacings));
        let across = pulses.map(Pulses::line_spacings);
        let definition = define(
            "spacing across scan lines",
            ("m", "pulse"),
            &[Mean, Quantile(0.05), Quantile(0.5), Quantile(0.95)],
            "horizontal distance from pulses of a line to the nearest of the next three lines of its strip",
        );
        found.add("spacing across scan lines", self.of_lines(definition, across));
    }
}
