use super::*;
use std::sync::Barrier;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc;

/// Items of 100 bytes, each of which is its index, and how often each was loaded.
fn hundreds(budget: u64, count: usize) -> (Arc<Residency>, Paged<usize>, Arc<Vec<AtomicUsize>>) {
    let residency = Residency::new(budget);
    let loads: Arc<Vec<AtomicUsize>> = Arc::new((0..count).map(|_| AtomicUsize::new(0)).collect());
    let counts = loads.clone();
    let items = residency.add(vec![100; count], move |i| {
        counts[i].fetch_add(1, Ordering::SeqCst);
        Ok((i, 100))
    });
    (residency, items, loads)
}

fn counts(loads: &[AtomicUsize]) -> Vec<usize> {
    loads.iter().map(|n| n.load(Ordering::SeqCst)).collect()
}

/// Uses these items as one packet.
fn packet(pins: &mut Pins, items: &Paged<usize>, selected: &[usize]) {
    for i in selected {
        assert_eq!(pins.get(items, *i), Some(i));
    }
    pins.release().unwrap();
}

#[test]
fn the_least_recently_used_item_is_dropped() {
    let (residency, items, loads) = hundreds(300, 5);
    let mut pins = Pins::new(&residency);
    packet(&mut pins, &items, &[0]);
    packet(&mut pins, &items, &[1]);
    packet(&mut pins, &items, &[2, 0]);
    packet(&mut pins, &items, &[3]);
    assert_eq!(counts(&loads), [1, 1, 1, 1, 0]);
    packet(&mut pins, &items, &[0, 2, 3]);
    assert_eq!(counts(&loads), [1, 1, 1, 1, 0], "1 was dropped");
    packet(&mut pins, &items, &[1]);
    assert_eq!(counts(&loads), [1, 2, 1, 1, 0]);
    let s = residency.statistics();
    assert_eq!((s.loaded, s.dropped, s.hits, s.misses), (5, 2, 4, 5));
    assert_eq!((s.resident, s.peak), ((3, 300), 300));
    assert!((s.hit_rate() - 4.0 / 9.0).abs() < 1e-12);
}

#[test]
fn an_item_is_taken_once_per_packet() {
    let (residency, items, _) = hundreds(300, 1);
    let mut pins = Pins::new(&residency);
    packet(&mut pins, &items, &[0, 0, 0]);
    assert_eq!((residency.statistics().misses, residency.statistics().hits), (1, 0));
    assert_eq!(pins.get(&items, 1), None, "no such item");
    assert!(pins.release().is_ok());
}

#[test]
fn kinds_share_a_budget() {
    let (residency, numbers, loads) = hundreds(250, 2);
    let words: Paged<String> = residency.add([100, 100], |i| Ok((format!("word {i}"), 100)));
    let mut pins = Pins::new(&residency);
    packet(&mut pins, &numbers, &[0, 1]);
    assert_eq!(pins.get(&words, 1).map(String::as_str), Some("word 1"));
    pins.release().unwrap();
    assert_eq!(residency.statistics().resident, (2, 200));
    packet(&mut pins, &numbers, &[1]);
    assert_eq!(counts(&loads), [1, 1]);
}

#[test]
fn a_packet_beyond_the_budget_is_told_what_it_needs() {
    let (residency, items, _) = hundreds(250, 4);
    let mut pins = Pins::new(&residency);
    (0..4).for_each(|i| packet(&mut pins, &items, &[i]));
    let got: Vec<_> = (0..4).map(|i| pins.get(&items, i).copied()).collect();
    assert_eq!(got, [Some(0), Some(1), None, None]);
    let error = pins.release().unwrap_err();
    assert!(matches!(error, PinError::TooSmall { needed: 400, budget: 250 }), "{error}");
    assert_eq!(
        error.to_string(),
        "rays traced together need 400 bytes of the scene at once, the budget is 250"
    );
    packet(&mut pins, &items, &[2, 3]);
    assert_eq!(residency.statistics().peak, 200);
}

#[test]
fn the_bytes_after_loading_count() {
    let residency = Residency::new(1000);
    let items = residency.add([10, 1 << 40], |i| Ok((i, if i == 0 { 900 } else { 200 })));
    let mut pins = Pins::new(&residency);
    assert_eq!((pins.get(&items, 0), pins.get(&items, 1)), (Some(&0), None), "too large together");
    assert!(matches!(pins.release(), Err(PinError::TooSmall { needed: 1100, .. })));
    packet(&mut pins, &items, &[1]);
    assert_eq!(residency.statistics().resident, (1, 200), "the other one was dropped");
}

#[test]
fn a_failure_is_told_to_every_packet_that_needs_the_item() {
    let residency = Residency::new(1000);
    let items = residency.add([10, 10], |i| match i {
        0 => Ok((i, 10)),
        _ => Err(Arc::new(std::io::Error::other("tile 1 is damaged")) as LoadError),
    });
    let mut pins = Pins::new(&residency);
    for _ in 0..2 {
        assert_eq!((pins.get(&items, 0), pins.get(&items, 1)), (Some(&0), None));
        assert_eq!(pins.release().unwrap_err().to_string(), "tile 1 is damaged");
        packet(&mut pins, &items, &[0]);
    }
    assert!(!items.prefetch(1));
    assert_eq!(residency.statistics().loaded, 1);
}

#[test]
fn a_panic_in_the_loader_leaves_nobody_waiting() {
    let residency = Residency::new(1000);
    let items: Paged<usize> = residency.add([10], |_| panic!("a defect of the loader"));
    let caught = std::thread::scope(|threads| {
        threads.spawn(|| Pins::new(&residency).get(&items, 0).copied()).join().is_err()
    });
    assert!(caught);
    let mut pins = Pins::new(&residency);
    assert_eq!(pins.get(&items, 0), None);
    assert!(matches!(pins.release(), Err(PinError::Load(_))));
}

#[test]
fn one_thread_loads_an_item_while_others_use_other_items() {
    let residency = Residency::new(1000);
    let (begin, begun) = mpsc::channel::<()>();
    let (finish, finished) = mpsc::channel::<()>();
    let (begin, finished) = (Mutex::new(begin), Mutex::new(finished));
    let loads = Arc::new(AtomicUsize::new(0));
    let count = loads.clone();
    let items = residency.add([10, 10], move |i| {
        if i == 0 {
            count.fetch_add(1, Ordering::SeqCst);
            begin.lock().unwrap().send(()).unwrap();
            finished.lock().unwrap().recv().unwrap();
        }
        Ok((i, 10))
    });
    std::thread::scope(|threads| {
        let slow = || packet(&mut Pins::new(&residency), &items, &[0]);
        threads.spawn(slow);
        begun.recv().unwrap();
        threads.spawn(slow);
        packet(&mut Pins::new(&residency), &items, &[1]);
        finish.send(()).unwrap();
    });
    assert_eq!(loads.load(Ordering::SeqCst), 1);
}

#[test]
fn threads_wait_for_room_and_then_keep_to_the_budget() {
    let (residency, items, _) = hundreds(200, 3);
    let barrier = Barrier::new(2);
    std::thread::scope(|threads| {
        threads.spawn(|| {
            let mut pins = Pins::new(&residency);
            assert!(pins.get(&items, 0).is_some() && pins.get(&items, 1).is_some());
            barrier.wait();
            // The other one waits for room meanwhile, or has not asked yet.
            std::thread::sleep(Duration::from_millis(20));
            pins.release().unwrap();
        });
        barrier.wait();
        packet(&mut Pins::new(&residency), &items, &[2]);
    });
    assert_eq!(residency.statistics().peak, 200);
}

#[test]
fn threads_that_all_wait_go_on() {
    let (residency, items, _) = hundreds(200, 16);
    let work = |thread: usize| {
        let mut pins = Pins::new(&residency);
        for round in 0..400 {
            packet(&mut pins, &items, &[(thread * 5 + round) % 16, (thread * 3 + round * 7 + 1) % 16]);
        }
    };
    std::thread::scope(|threads| {
        (0..4).for_each(|thread| {
            threads.spawn(move || work(thread));
        });
    });
    let s = residency.statistics();
    assert!(s.peak <= 4 * 200 && s.resident.1 <= s.peak, "{s:?}");
    assert!(s.hits + s.misses >= 4 * 400);
}

#[test]
fn what_was_used_lately_is_not_dropped_for_a_prefetch() {
    let (residency, items, loads) = hundreds(200, 4);
    let mut pins = Pins::new(&residency);
    packet(&mut pins, &items, &[0]);
    assert!(items.prefetch(1) && items.prefetch(1) && !items.prefetch(2));
    for _ in 0..=RECENT_PACKETS {
        packet(&mut pins, &items, &[0]);
    }
    assert!(items.prefetch(2), "1 was not used for long");
    assert_eq!(counts(&loads), [1, 1, 1, 0]);
    assert!(!items.prefetch(9));
    assert_eq!(residency.statistics().prefetched, 2);
}
