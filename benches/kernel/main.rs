//! Tracing alone, on the forests of `vlscan scene make` and on one thread, against Embree if there is one.
//!
//! ```text
//! cargo bench --bench kernel                                     own builders, 1 M and 10 M triangles
//! cargo bench --bench kernel --features embree                   and Embree (Debian: libembree-dev)
//! cargo bench --bench kernel --features embree -- -n 1M --rounds 9 --builders bvh,fsah --sets airborne,sparse
//! ```
//!
//! Rays come in batches, which are in the second-level cache when the clock starts, as in a run, where they
//! have just been generated: those of vlscan in double precision by pulse, those of Embree in single
//! precision one after the other. Both write distance and triangle of every ray. The tracers take turns, and
//! a ratio is the median over the rounds of the ratios within a round. The clock measures the thread's
//! processor time, so that other load has little effect.

#[cfg(feature = "embree")]
mod embree;
mod rays;
mod scene;

use rays::RaySet;
use std::time::Duration;
use vlscan::trace::{BuildOptions, Builder, Geometry, Hits, RayGroup, TraceScratch, Tree};

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

fn thread_time() -> Duration {
    let t = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
    Duration::new(t.tv_sec as u64, t.tv_nsec as u32)
}

struct Contender<'a> {
    name: String,
    tracer: Box<dyn Tracer + 'a>,
    seconds: Vec<f64>,
}

trait Tracer {
    /// Copies the rays of a batch into the cache.
    fn load(&mut self, batch: usize);
    /// Traces the rays loaded last.
    fn trace(&mut self);
}

struct Own<'a> {
    geometry: &'a Geometry,
    tree: &'a Tree,
    set: &'a RaySet,
    rays: RayGroup,
    hits: Hits,
    scratch: TraceScratch,
}

impl Tracer for Own<'_> {
    fn load(&mut self, batch: usize) {
        let batch = &self.set.batches[batch];
        self.rays.copy_from(batch, 0..batch.len());
    }

    fn trace(&mut self) {
        self.tree.trace_group(self.geometry, &self.rays, &mut self.hits, &mut self.scratch);
        std::hint::black_box(&self.hits);
    }
}

impl<'a> Contender<'a> {
    fn new(name: impl Into<String>, tracer: impl Tracer + 'a) -> Contender<'a> {
        Contender { name: name.into(), tracer: Box::new(tracer), seconds: Vec::new() }
    }

    fn run_round(&mut self, batches: usize) {
        let mut spent = Duration::ZERO;
        for batch in 0..batches {
            self.tracer.load(batch);
            let start = thread_time();
            self.tracer.trace();
            spent += thread_time() - start;
        }
        self.seconds.push(spent.as_secs_f64());
    }

    /// Median ratio of the other contender's time to this one's.
    fn times_as_fast_as(&self, other: &Contender) -> f64 {
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
        let batches: Vec<embree::Packed> = set.batches.iter().map(embree::Packed::of).collect();
        let mut contenders = Vec::new();
        #[cfg(feature = "embree")]
        for mode in embree::Mode::BOTH {
            contenders.push(Contender::new(mode.name(), embree::EmbreeTracer::new(&embree, mode, &batches)));
        }
        for (name, tree) in &trees {
            let (rays, hits, scratch) = (RayGroup::new(0), Hits::default(), TraceScratch::default());
            contenders.push(Contender::new(*name, Own { geometry, tree, set: &set, rays, hits, scratch }));
        }
        for round in 0..=settings.rounds {
            contenders.iter_mut().for_each(|l| l.run_round(set.batches.len()));
            if round == 0 {
                // Caches and clock rates have settled.
                contenders.iter_mut().for_each(|l| l.seconds.clear());
            }
        }
        report(&set, &contenders);
        drop(contenders);
        let ours = trees.first().map(|(_, tree)| hits_of(geometry, tree, &set));
        if let Some(ours) = &ours {
            println!("{:<12} {:<10} {:>50}", set.name, "ours", summary(ours));
            for (name, tree) in &trees[1..] {
                assert!(*ours == hits_of(geometry, tree, &set), "{name} does not hit what the others hit");
            }
        }
        #[cfg(feature = "embree")]
        for mode in embree::Mode::BOTH {
            let theirs = embree.hits(mode, &batches);
            print!("{:<12} {:<10} {:>50}", set.name, mode.name(), summary(&theirs));
            if let Some(ours) = &ours {
                print!(", {}", difference(ours, &theirs));
            }
            println!();
        }
    }
}

fn report(set: &RaySet, contenders: &[Contender]) {
    let reference = |name: &str| contenders.iter().find(|l| l.name == name);
    for contender in contenders {
        let seconds = median(contender.seconds.iter().copied());
        let rate = set.rays as f64 / seconds;
        print!("{:<12} {:<10} {:>8.1} {:>8.2}", set.name, contender.name, rate * 1e-6, 1e9 / rate);
        for other in ["single", "coherent"] {
            match reference(other) {
                Some(other) => print!(" {:>10.2}", contender.times_as_fast_as(other)),
                None => print!(" {:>10}", "-"),
            }
        }
        println!();
    }
}

fn hits_of(geometry: &Geometry, tree: &Tree, set: &RaySet) -> Vec<(f64, u32)> {
    let (mut all, mut hits) = (Vec::with_capacity(set.rays), Hits::default());
    let mut scratch = TraceScratch::default();
    for group in &set.batches {
        tree.trace_group(geometry, group, &mut hits, &mut scratch);
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
    let hit_or_miss = pairs().filter(|(a, b)| a.0.is_finite() != b.0.is_finite()).count();
    let ids = pairs().filter(|(a, b)| a.1 != b.1).count();
    let ranges = pairs().filter(|(a, b)| (a.0 - b.0).abs() > 1e-3).count();
    format!("{hit_or_miss} hit or miss, {ids} triangles, {ranges} ranges by 1 mm differ")
}
