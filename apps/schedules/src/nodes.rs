//! Runs in shards on many nodes, in simulated time: measured costs of computing, merging and stepping through
//! the flight, and the speed of disks and the behaviour of a batch system as assumptions.

use crate::measure::ShardCosts;
use crate::replay::replay;
use crate::workload::Workload;
use serde::Serialize;
use std::cmp::Reverse;
use std::collections::BinaryHeap;
use vlscan_warehouse::Schedule;

/// Assumptions about a cluster.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Cluster {
    /// Threads of a node, each on a core of its own.
    pub threads: usize,
    /// Pulses of the whole survey.
    pub pulses: u64,
    /// Parts per node.
    pub shards_per_node: u32,
    /// Bytes per second that a node reads or writes.
    pub node_bytes_per_s: f64,
    /// Bytes per second of all nodes together.
    pub all_bytes_per_s: f64,
}

/// Time that the batch system takes to begin a task on a node, s, and the number of tasks that it begins per
/// second.
const TASK_START_S: f64 = 1.0;
const TASKS_PER_S: f64 = 50.0;

/// The simulated run of a survey on a number of nodes.
#[derive(Clone, Debug, Serialize)]
pub struct NodesForecast {
    pub nodes: u32,
    pub shards: u32,
    /// Time to find where the shards begin, s.
    pub index_s: f64,
    /// Time from the first shard to the last, s.
    pub shards_s: f64,
    /// Time of the merge, s, and the number of nodes that share it.
    pub merge_s: f64,
    pub merging_nodes: u32,
    /// Time to join what several nodes have merged, s.
    pub join_s: f64,
    pub total_s: f64,
    /// Time of a run without shards on one node, divided by this time.
    pub speedup: f64,
    pub efficiency: f64,
    /// Fraction of the time of the shards in which a node waits for the disk.
    pub disk: f64,
}

/// Costs of a survey of the cluster's size.
struct Scaled<'a> {
    load: &'a Workload,
    costs: &'a ShardCosts,
    cluster: Cluster,
    /// Pulses of the survey per pulse that was measured.
    scale: f64,
    /// Threads' worth of work that the threads of a node do.
    threads: f64,
}

impl Scaled<'_> {
    /// Seconds of computing of a fraction of the survey on a node.
    fn compute(&self, from: f64, to: f64) -> f64 {
        self.load.share(from, to) * self.costs.shard_cpu_s * self.scale / self.threads
    }

    fn shard_bytes(&self) -> f64 {
        self.costs.shard_bytes as f64 * self.scale
    }

    fn out_bytes(&self) -> f64 {
        self.costs.out_bytes as f64 * self.scale
    }

    /// Bytes per second of each of so many nodes.
    fn disk(&self, nodes: u32) -> f64 {
        self.cluster.node_bytes_per_s.min(self.cluster.all_bytes_per_s / f64::from(nodes))
    }

    fn start(&self) -> f64 {
        TASK_START_S + self.costs.start_s
    }

    /// A run without shards on one node.
    fn alone(&self) -> f64 {
        let computing = self.costs.run_cpu_s * self.scale / self.threads;
        self.start() + computing.max(self.out_bytes() / self.disk(1))
    }

    /// Time of all shards, and the fraction of it that nodes wait for disks.
    fn shards(&self, nodes: u32, shards: u32) -> (f64, f64) {
        let active = nodes.min(shards);
        let writing = self.shard_bytes() / f64::from(shards) / self.disk(active);
        // Tasks begin one after the other, each on the node that is idle first. Times are compared as whole
        // nanoseconds.
        let mut idle: BinaryHeap<Reverse<u64>> = (0..active).map(|_| Reverse(0)).collect();
        let (mut last, mut waited, mut busy) = (0.0_f64, 0.0, 0.0);
        for shard in 0..shards {
            let Some(Reverse(at)) = idle.pop() else { break };
            let begin = (at as f64 * 1e-9).max(f64::from(shard) / TASKS_PER_S);
            let [from, to] = [shard, shard + 1].map(|n| f64::from(n) / f64::from(shards));
            let computing = self.compute(from, to);
            let end = begin + self.start() + computing.max(writing);
            waited += (writing - computing).max(0.0);
            busy += end - begin;
            idle.push(Reverse((end * 1e9) as u64));
            last = last.max(end);
        }
        (last, waited / busy.max(f64::MIN_POSITIVE))
    }

    /// A merge that so many nodes share, and its join.
    fn merge(&self, nodes: u32) -> (f64, f64) {
        let share = self.scale / f64::from(nodes);
        let encoding = self.costs.merge_cpu_s * share / self.threads;
        let collecting = self.costs.collect_s * share;
        let bytes = (self.costs.shard_bytes + self.costs.out_bytes) as f64 * share;
        let merging = encoding.max(collecting).max(bytes / self.disk(nodes));
        let join = if nodes > 1 { TASK_START_S + 2.0 * self.out_bytes() / self.disk(1) } else { 0.0 };
        (TASK_START_S + f64::from(nodes) / TASKS_PER_S + merging, join)
    }
}

/// Simulates runs on `nodes` nodes each. `schedule` is that of a node.
pub fn simulate(
    load: &Workload,
    costs: &ShardCosts,
    schedule: Schedule,
    cluster: Cluster,
    nodes: &[u32],
) -> Vec<NodesForecast> {
    let replayed = |threads| replay(load, &Schedule { threads, ..schedule }).seconds;
    let threads = replayed(1) / replayed(cluster.threads).max(f64::MIN_POSITIVE);
    simulate_with(load, costs, threads, cluster, nodes)
}

/// [`simulate`], where the threads of a node do the work of `threads` threads that never wait.
fn simulate_with(
    load: &Workload,
    costs: &ShardCosts,
    threads: f64,
    cluster: Cluster,
    nodes: &[u32],
) -> Vec<NodesForecast> {
    let scale = cluster.pulses as f64 / costs.pulses.max(1) as f64;
    let scaled = Scaled { load, costs, cluster, scale, threads };
    let index_s = TASK_START_S + costs.index_s * scale;
    let forecast = |&nodes: &u32| {
        let shards = nodes.saturating_mul(cluster.shards_per_node).max(1);
        let (shards_s, disk) = scaled.shards(nodes, shards);
        let alone = (1, scaled.merge(1));
        let shared = (nodes, scaled.merge(nodes));
        let time = |(_, (merge, join)): &(u32, (f64, f64))| merge + join;
        let (merging_nodes, (merge_s, join_s)) = if time(&shared) < time(&alone) { shared } else { alone };
        let total_s = index_s + shards_s + merge_s + join_s;
        let speedup = scaled.alone() / total_s;
        let efficiency = speedup / f64::from(nodes.max(1));
        NodesForecast {
            nodes,
            shards,
            index_s,
            shards_s,
            merge_s,
            merging_nodes,
            join_s,
            total_s,
            speedup,
            efficiency,
            disk,
        }
    };
    nodes.iter().map(forecast).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn costs() -> ShardCosts {
        ShardCosts {
            pulses: 1_000_000,
            index_s: 0.001,
            start_s: 2.0,
            run_cpu_s: 10.0,
            shard_cpu_s: 10.0,
            merge_cpu_s: 1.0,
            collect_s: 0.1,
            shard_bytes: 100_000_000,
            out_bytes: 40_000_000,
        }
    }

    fn simulated(cluster: Cluster, nodes: &[u32]) -> Vec<NodesForecast> {
        simulate_with(&Workload::default(), &costs(), 1.0, cluster, nodes)
    }

    const CLUSTER: Cluster = Cluster {
        threads: 1,
        pulses: 1_000_000_000,
        shards_per_node: 4,
        node_bytes_per_s: 1e9,
        all_bytes_per_s: 10e9,
    };

    #[test]
    fn one_node_takes_what_its_work_takes() {
        let [one, ten] = simulated(CLUSTER, &[1, 10]).try_into().unwrap();
        // 10 000 s of computing in four shards, each of which starts in 3 s; 1000 s to merge.
        assert!((one.shards_s - 10_012.0).abs() < 0.1, "{one:?}");
        assert!((one.merge_s - 1001.0).abs() < 0.1 && one.merging_nodes == 1 && one.join_s == 0.0, "{one:?}");
        assert!((one.index_s - 2.0).abs() < 1e-9 && one.efficiency < 1.0, "{one:?}");
        // Ten nodes compute in a tenth of the time, and merge together.
        assert!((ten.shards_s - 1012.0).abs() < 1.0, "{ten:?}");
        assert!(ten.merging_nodes == 10 && (ten.join_s - 81.0).abs() < 0.1, "{ten:?}");
    }

    #[test]
    fn disks_limit_many_nodes() {
        let [slow] = simulated(Cluster { all_bytes_per_s: 1e8, ..CLUSTER }, &[100]).try_into().unwrap();
        // 100 GB at 100 MB/s.
        assert!(slow.shards_s > 1000.0 && slow.disk > 0.8, "{slow:?}");
        let [fast] = simulated(Cluster { all_bytes_per_s: 1e12, ..CLUSTER }, &[100]).try_into().unwrap();
        assert!(fast.shards_s < 130.0 && fast.disk == 0.0, "{fast:?}");
    }
}
