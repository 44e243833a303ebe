//! Tracing alone, on the forests of `vlscan scene make` and on one thread, against Embree if there is one.
//!
//! ```text
//! cargo bench --bench kernel                                     own builders, 1 M and 10 M triangles
//! cargo bench --bench kernel --features embree                   and Embree (Debian: libembree-dev)
//! cargo bench --bench kernel --features embree -- -n 1M --rounds 9 --builders bvh,fsah --sets airborne,sparse
//! ```
//!
//! Rays come by volleys, which lie in the second-level cache when the clock starts, as they do in a run, where they have
//! just been made: ours in double precision by pulse, Embree's in single precision one after the other. Both write
//! distance and triangle of every ray. The tracers take turns, and a ratio is the median over the rounds of the ratios
//! within a round. The clock is that of the thread, so that other load matters little.

#[cfg(feature = "embree")]
mod embree;
mod rays;
mod scene;

use rays::RaySet;
use std::time::Duration;
use vlscan::internals::{BuildOptions, Builder, Geometry, Hits, RayGroup, Tree};

const BUILDERS: [(&str, Builder); 5] = [
    ("bvh", Builder::Bvh),
    ("fsah", Builder::Fsah),
    ("axis-sah", Builder::AxisSah),
    ("sah", Builder::Sah),
    ("median", Builder::Median),
];

struct Settings {
    scenes: Vec<String>,
    builders: Vec<String>,
    sets: Vec<String>,
    rounds: usize,
}

impl Settings {
    fn from_arguments() -> Settings {
        let list = |text: &str| text.split(',').map(str::to_owned).collect::<Vec<_>>();
        let mut settings =
            Settings { scenes: list("1M,10M"), builders: list("bvh,fsah"), sets: Vec::new(), rounds: 7 };
        let mut arguments = std::env::args().skip(1).filter(|a| a != "--bench");
        while let Some(option) = arguments.next() {
            let value = arguments.next().unwrap_or_default();
            match option.as_str() {
                "-n" => settings.scenes = list(&value),
                "--builders" => settings.builders = list(&value),
                "--sets" => settings.sets = list(&value),
                "--rounds" => settings.rounds = value.parse().unwrap_or(7).max(1),
                _ => {
                    eprintln!(
                        "usage: kernel [-n 1M,10M] [--builders bvh,fsah,…] [--sets airborne,…] [--rounds 7]"
                    );
                    std::process::exit(2);
                }
            }
        }
        settings
    }
}

/// Time that this thread has worked.
fn clock() -> Duration {
    let t = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
    Duration::new(t.tv_sec as u64, t.tv_nsec as u32)
}

/// One way to trace, and what it has taken per round.
struct Lane<'a> {
    name: String,
    tracer: Box<dyn Tracer + 'a>,
    seconds: Vec<f64>,
}

/// Traces volley after volley.
trait Tracer {
    /// Brings the rays of a volley near.
    fn load(&mut self, volley: usize);
    /// Traces the rays loaded last.
    fn trace(&mut self);
}

/// One of our trees.
struct Own<'a> {
    geometry: &'a Geometry,
    tree: &'a Tree,
    set: &'a RaySet,
    rays: RayGroup,
    hits: Hits,
}

impl Tracer for Own<'_> {
    fn load(&mut self, volley: usize) {
        let volley = &self.set.volleys[volley];
        self.rays.copy_from(volley, 0..volley.len());
    }

    fn trace(&mut self) {
        self.tree.trace_group(self.geometry, &self.rays, &mut self.hits);
        std::hint::black_box(&self.hits);
    }
}

impl<'a> Lane<'a> {
    fn new(name: impl Into<String>, tracer: impl Tracer + 'a) -> Lane<'a> {
        Lane { name: name.into(), tracer: Box::new(tracer), seconds: Vec::new() }
    }

    fn pass(&mut self, volleys: usize) {
        let mut spent = Duration::ZERO;
        for volley in 0..volleys {
            self.tracer.load(volley);
            let start = clock();
            self.tracer.trace();
            spent += clock() - start;
        }
        self.seconds.push(spent.as_secs_f64());
    }

    /// Median ratio of another's time to ours.
    fn times_as_fast_as(&self, other: &Lane) -> f64 {
        median(self.seconds.iter().zip(&other.seconds).map(|(own, other)| other / own))
    }
}

fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

fn main() {
    let settings = Settings::from_arguments();
    for name in &settings.scenes {
        let geometry = scene::forest(name);
        println!("\nforest of {} triangles", geometry.len());
        bench(&geometry, &settings);
    }
}

fn bench(geometry: &Geometry, settings: &Settings) {
    let mut trees = Vec::new();
    for (name, builder) in BUILDERS.into_iter().filter(|(n, _)| settings.builders.iter().any(|b| b == n)) {
        let tree = Tree::build(geometry, &BuildOptions::of(builder));
        println!("{name:<10} {:.0} bytes per triangle", tree.memory() as f64 / geometry.len() as f64);
        trees.push((name, tree));
    }
    #[cfg(feature = "embree")]
    let embree = embree::Embree::build(geometry);
    println!(
        "{:<12} {:<10} {:>8} {:>8} {:>9} {:>10}   hits, mean range",
        "rays", "tracer", "Mrays/s", "ns/ray", "to single", "to coherent"
    );
    for set in RaySet::all(geometry) {
        if !settings.sets.is_empty() && !settings.sets.iter().any(|s| s == set.name) {
            continue;
        }
        #[cfg(feature = "embree")]
        let volleys: Vec<embree::Packed> = set.volleys.iter().map(embree::Packed::of).collect();
        let mut lanes = Vec::new();
        #[cfg(feature = "embree")]
        for mode in embree::Mode::BOTH {
            lanes.push(Lane::new(mode.name(), embree::Theirs::new(&embree, mode, &volleys)));
        }
        for (name, tree) in &trees {
            let (rays, hits) = (RayGroup::new(0), Hits::default());
            lanes.push(Lane::new(*name, Own { geometry, tree, set: &set, rays, hits }));
        }
        for round in 0..=settings.rounds {
            lanes.iter_mut().for_each(|l| l.pass(set.volleys.len()));
            if round == 0 {
                // Caches and clocks are warm now.
                lanes.iter_mut().for_each(|l| l.seconds.clear());
            }
        }
        report(&set, &lanes);
        drop(lanes);
        let ours = trees.first().map(|(_, tree)| outcome(geometry, tree, &set));
        if let Some(ours) = &ours {
            println!("{:<12} {:<10} {:>50}", set.name, "ours", summary(ours));
            for (name, tree) in &trees[1..] {
                assert!(*ours == outcome(geometry, tree, &set), "{name} does not hit what the others hit");
            }
        }
        #[cfg(feature = "embree")]
        for mode in embree::Mode::BOTH {
            let theirs = embree.hits(mode, &volleys);
            print!("{:<12} {:<10} {:>50}", set.name, mode.name(), summary(&theirs));
            if let Some(ours) = &ours {
                print!(", {}", difference(ours, &theirs));
            }
            println!();
        }
    }
}

fn report(set: &RaySet, lanes: &[Lane]) {
    let reference = |name: &str| lanes.iter().find(|l| l.name == name);
    for lane in lanes {
        let seconds = median(lane.seconds.iter().copied());
        let rate = set.rays as f64 / seconds;
        print!("{:<12} {:<10} {:>8.1} {:>8.2}", set.name, lane.name, rate * 1e-6, 1e9 / rate);
        for other in ["single", "coherent"] {
            match reference(other) {
                Some(other) => print!(" {:>10.2}", lane.times_as_fast_as(other)),
                None => print!(" {:>10}", "-"),
            }
        }
        println!();
    }
}

/// Distance and triangle of every ray.
fn outcome(geometry: &Geometry, tree: &Tree, set: &RaySet) -> Vec<(f64, u32)> {
    let (mut all, mut hits) = (Vec::with_capacity(set.rays), Hits::default());
    for group in &set.volleys {
        tree.trace_group(geometry, group, &mut hits);
        for p in 0..group.len() {
            let row = p * group.stride()..p * group.stride() + group.rays();
            all.extend(hits.t[row.clone()].iter().copied().zip(hits.primitive[row].iter().copied()));
        }
    }
    all
}

fn summary(hits: &[(f64, u32)]) -> String {
    let ranges = || hits.iter().map(|h| h.0).filter(|t| t.is_finite());
    let count = ranges().count();
    format!("{count} hits at {:.5} m", ranges().sum::<f64>() / count as f64)
}

#[cfg(feature = "embree")]
fn difference(ours: &[(f64, u32)], theirs: &[(f64, u32)]) -> String {
    let pairs = || ours.iter().zip(theirs);
    let verdicts = pairs().filter(|(a, b)| a.0.is_finite() != b.0.is_finite()).count();
    let ids = pairs().filter(|(a, b)| a.1 != b.1).count();
    let ranges = pairs().filter(|(a, b)| (a.0 - b.0).abs() > 1e-3).count();
    format!("{verdicts} hit or miss, {ids} triangles, {ranges} ranges by 1 mm differ")
}
