//! Schedules computed by hand.

use super::*;
use crate::workload::{Overheads, PerSize, Profile};

fn load(costs: &[f64], legs: &[u64]) -> Workload {
    let mut sum = 0.0;
    let entries: Vec<(u64, f64)> = (1..)
        .zip(costs)
        .map(|(i, c)| {
            sum += c;
            (i, sum)
        })
        .collect();
    Workload { profiles: vec![Profile::new(1, &entries)], legs: legs.to_vec(), ..Workload::default() }
}

fn seconds(load: &Workload, threads: usize, policy: Policy, leg_barrier: bool) -> f64 {
    let replayed = replay(load, &Schedule { threads, policy, leg_barrier });
    assert!(replayed.utilisation <= 1.0 + 1e-9 && replayed.utilisation > 0.0, "{replayed:?}");
    (replayed.seconds * 1e9).round() / 1e9
}

#[test]
fn one_thread_computes_one_task_after_the_other() {
    let load = load(&[1.0, 2.0, 4.0], &[2, 3]);
    for policy in [Policy::Single, Policy::Static { size: 2 }, Policy::Warehouse { size: 2, factor: 4 }] {
        assert_eq!(seconds(&load, 1, policy, true), 7.0);
    }
}

/// Two workers, five tasks of 1 s: 0 and 1, 2 and 3, 4.
#[test]
fn a_producer_of_single_tasks_does_not_compute() {
    assert_eq!(seconds(&load(&[1.0; 5], &[5]), 3, Policy::Single, false), 3.0);
}

/// The worker computes 0 and 1 until 2 s; the producer computes 2 and 3; the worker computes 4 and 5 until 4
/// s.
#[test]
fn a_refused_static_chunk_loses_a_task_to_the_producer() {
    let load = load(&[1.0; 6], &[6]);
    assert_eq!(seconds(&load, 2, Policy::Static { size: 2 }, false), 4.0);
    // In chunks of three the worker is done with 0, 1, 2 at 3 s, when the producer has done 3, 4, 5.
    assert_eq!(seconds(&load, 2, Policy::Static { size: 3 }, false), 3.0);
}

/// The worker computes 0 until 3 s, 1 is queued, the producer computes 2, 3 and finally 1.
#[test]
fn a_full_warehouse_lets_the_producer_work() {
    let load = load(&[3.0, 1.0, 1.0, 1.0], &[4]);
    assert_eq!(seconds(&load, 2, Policy::Warehouse { size: 1, factor: 1 }, false), 3.0);
    // With room for two, the producer computes 3, then one of the queued tasks.
    assert_eq!(seconds(&load, 2, Policy::Warehouse { size: 1, factor: 2 }, false), 3.0);
}

/// Legs of a long and a short task: with the barrier each takes as long as its long task.
#[test]
fn a_barrier_costs_the_wait_for_the_slowest() {
    let load = load(&[4.0, 1.0, 1.0, 4.0], &[2, 4]);
    let policy = Policy::Warehouse { size: 1, factor: 1 };
    // The worker computes 0; 1 is queued and taken back by the producer; then the worker computes 2, the
    // producer 3.
    assert_eq!(seconds(&load, 2, policy, true), 8.0);
    // The worker computes 0 until 4 s; 1 is queued; the producer computes 2 and 3 until 5 s, when the worker
    // is done with 1.
    assert_eq!(seconds(&load, 2, policy, false), 5.0);
}

#[test]
fn making_handing_over_and_waking_cost_time() {
    let making = PerSize(vec![(1, 0.5)]);
    let single = ChunkCosts { producer_s: 0.125, worker_s: 0.5, collector_s: 0.0625, wake_s: 0.25 };
    let alone = ChunkCosts { producer_s: 0.25, ..ChunkCosts::default() };
    let overheads = Overheads { single, alone, ..Overheads::default() };
    let load = Workload { making, overheads, ..load(&[1.0; 2], &[2]) };
    // One thread makes and computes both and announces them together.
    assert_eq!(seconds(&load, 1, Policy::Single, false), 3.25);
    // First task: made and sent at 0.5 s, announced at 0.6875 s, worker awake at 0.75 s, done at 2.25 s.
    // Second task: made at 1.1875 s, a worker idle at 2.25 s, the producer awake at 2.5 s, the worker awake
    // at 2.75 s, done at 4.25 s.
    assert_eq!(seconds(&load, 2, Policy::Single, false), 4.25);
}

#[test]
fn nothing_ends_before_everything_is_collected() {
    let costs = PerSize(vec![(1, 2.0)]);
    let load = Workload { collecting: costs.clone(), taking: costs, ..load(&[0.0; 10], &[10]) };
    assert_eq!(seconds(&load, 64, Policy::Warehouse { size: 1, factor: 1 }, false), 20.0);
}

/// Two workers in chunks of two: they are idle while the producer computes a single task.
#[test]
fn dynamic_chunks_grow_when_a_worker_was_idle() {
    let load = Workload { making: PerSize(vec![(1, 1e-4)]), ..load(&[1e-3; 4000], &[4000]) };
    let policy = Policy::Dynamic { size: 2, significant_ns: 100 };
    let replayed = replay(&load, &Schedule { threads: 3, policy, leg_barrier: false });
    let sizes = replayed.sizes.entries();
    assert!(!sizes.is_empty() && sizes.iter().all(|s| s.size >= 1), "{sizes:?}");
    assert!(replayed.seconds < 2.0, "{} s", replayed.seconds);
}

/// A chunk of 1 s for the worker from 0.5 s. Meanwhile the producer takes off single tasks: each is stepped
/// through twice (0.25 s), takes 0.125 s more to make alone and one second to compute.
#[test]
fn a_task_that_is_taken_off_costs_a_chunk_and_a_second_step() {
    let making = PerSize(vec![(1, 0.375), (2, 0.25)]);
    let load = Workload { making, fixed_s: 0.5, ..load(&[1.0; 4], &[4]) };
    // 0 and 1 are sent at 0.5 s and done at 2.5 s. 2 and 3 are made at 1 s and refused; 2 is done at 2.375 s.
    // Only 3 is left and the worker is busy: done at 3.5 s.
    assert_eq!(seconds(&load, 2, Policy::Static { size: 2 }, false), 4.0);
}

/// Chunks of 4096 tasks, each of one second except the first of 100 s: the worker computes 0 until 100 s and
/// 1 is queued. The producer computes 2 to 7; with 0 held by the collector, the queue of six results is full
/// before 7, so the producer computes 1 and then waits until 100 s. From then on both work: 8 and 10 until
/// 101 s, and so on until 19 at 106 s.
#[test]
fn who_is_too_far_ahead_of_the_collector_waits() {
    const SIZE: u64 = 4096;
    let chunks = |costs: &[f64]| {
        let mut sum = 0.0;
        let until = |(i, cost): (u64, &f64)| {
            sum += cost;
            (i * SIZE, sum)
        };
        let entries: Vec<(u64, f64)> = (1..).zip(costs).map(until).collect();
        Workload {
            profiles: vec![Profile::new(SIZE as u32, &entries)],
            legs: vec![costs.len() as u64 * SIZE],
            ..Workload::default()
        }
    };
    let mut costs = [1.0; 20];
    costs[0] = 100.0;
    let size = SIZE as u32;
    assert_eq!(seconds(&chunks(&costs), 2, Policy::Warehouse { size, factor: 1 }, false), 106.0);
    // Small chunks fit into the queue.
    let small = load(&costs, &[20]);
    assert_eq!(seconds(&small, 2, Policy::Warehouse { size: 1, factor: 1 }, false), 100.0);
    // One slot holds all the single tasks that the producer computes during one large task.
    let mut costs = [1.0; 20];
    costs[..10].fill(1.2);
    assert_eq!(seconds(&load(&costs, &[20]), 2, Policy::Static { size: 10 }, false), 12.0);
}

#[test]
fn more_threads_than_tasks_do_no_harm() {
    let load = load(&[1.0; 8], &[3, 8]);
    for policy in [
        Policy::Single,
        Policy::Static { size: 1 },
        Policy::Dynamic { size: 1, significant_ns: 1 },
        Policy::Warehouse { size: 1, factor: 4 },
    ] {
        assert_eq!(seconds(&load, 512, policy, false), 1.0, "{policy:?}");
        assert_eq!(seconds(&load, 512, policy, true), 2.0, "{policy:?}");
    }
    assert_eq!(
        replay(&Workload::default(), &Schedule { threads: 4, policy: Policy::Single, leg_barrier: true })
            .seconds,
        0.0
    );
}

/// Four tasks of 1 s with a job of 1 s each: two threads need 4 s. A collector that needs as long for each
/// result is done a second after the last of them.
#[test]
fn jobs_are_shared_and_collecting_is_not() {
    let costs = PerSize(vec![(1, 1.0)]);
    let work = load(&[1.0; 4], &[4]);
    let policy = Policy::Static { size: 1 };
    let jobs = Workload { jobs: costs.clone(), ..work.clone() };
    assert_eq!(seconds(&jobs, 2, policy, false), 4.0);
    assert_eq!(seconds(&jobs, 4, policy, false), 2.0);
    let collecting = Workload { collecting: costs.clone(), taking: costs, ..work };
    assert_eq!(seconds(&collecting, 4, policy, false), 5.0);
    // Half of it is falling asleep and being woken, which takes time from the cores alone.
    let taking = PerSize(vec![(1, 0.5)]);
    assert_eq!(seconds(&Workload { taking, ..collecting }, 4, policy, false), 3.0);
}
