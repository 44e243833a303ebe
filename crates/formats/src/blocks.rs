//! Blocks of a file decoded on several threads, and taken in the order of the file by the thread that reads.
//!
//! Items of the file, such as chunks and pieces of text, go to the threads in turn. Each thread makes one or
//! more blocks of an item and waits when enough of them are unread, so that memory is bounded by the number
//! of threads and not by that of points.

use std::ops::ControlFlow;
use std::panic::resume_unwind;
use std::sync::mpsc::{Receiver, Sender, SyncSender, channel, sync_channel};
use vlscan_base::damage::outside_decoder;
use vlscan_base::error::Result;
use vlscan_base::machine::{memory, spawn_scoped};

/// Maximum number of items that a thread has, with those that wait for it.
const ITEMS_PER_THREAD: usize = 2;
/// Maximum number of unread blocks of a thread, with the mark at the end of an item.
const UNREAD_BLOCKS: usize = 5;
/// Memory of the blocks of a thread, bytes: eight blocks of 16,384 points with their details take 24 MB.
const THREAD_BYTES: u64 = 32 << 20;
/// The blocks of all threads take up at most this fraction of the memory.
const MAX_BLOCKS_FRACTION: u64 = 8;

/// Passes a block on, and leaves a block with any content to be filled next; `Break` if no more are needed.
pub(crate) type Emit<'e, B> = dyn FnMut(&mut B) -> ControlFlow<()> + 'e;

/// Calls `make` for all items on `threads` threads, or fewer where memory is short, and `take` with the
/// blocks that it emits, in the order of the items and on this thread, until `take` breaks. The content of
/// the block passed to `make` is arbitrary. A single item, and all of them for a single thread, are decoded
/// on this thread.
///
/// # Errors
/// [`Error::Io`](vlscan_base::error::Error::Io) if a thread cannot be started.
pub(crate) fn in_order<I: Send, B: Default + Send>(
    threads: usize,
    mut items: impl Iterator<Item = I>,
    make: impl Fn(I, &mut B, &mut Emit<'_, B>) + Sync,
    take: impl FnMut(&mut B) -> ControlFlow<()>,
) -> Result<()> {
    let threads = if threads > 1 { affordable(threads, memory()) } else { threads };
    if threads <= 1 {
        decode_here(items, make, take);
        return Ok(());
    }
    let (first, second) = (items.next(), items.next());
    let is_single = second.is_none();
    let items = first.into_iter().chain(second).chain(items);
    if is_single {
        decode_here(items, make, take);
        return Ok(());
    }
    decode_on_threads(threads, items, &make, take)
}

/// The number of threads whose blocks fit into a process of this memory, bytes.
fn affordable(threads: usize, memory: Option<u64>) -> usize {
    let most = memory.map_or(u64::MAX, |memory| memory / MAX_BLOCKS_FRACTION / THREAD_BYTES);
    threads.min(usize::try_from(most).unwrap_or(usize::MAX))
}

fn decode_here<I, B: Default>(
    items: impl Iterator<Item = I>,
    make: impl Fn(I, &mut B, &mut Emit<'_, B>),
    mut take: impl FnMut(&mut B) -> ControlFlow<()>,
) {
    let (mut block, mut is_ended, mut panic) = (B::default(), false, None);
    for item in items {
        make(item, &mut block, &mut |full: &mut B| {
            // `make` catches panics over damaged data, but not those of `take`.
            let flow = outside_decoder(|| take(full)).unwrap_or_else(|payload| {
                panic = Some(payload);
                ControlFlow::Break(())
            });
            is_ended = flow.is_break();
            flow
        });
        if let Some(payload) = panic.take() {
            resume_unwind(payload);
        }
        if is_ended {
            break;
        }
    }
}

fn decode_on_threads<I: Send, B: Default + Send>(
    threads: usize,
    items: impl Iterator<Item = I>,
    make: &(impl Fn(I, &mut B, &mut Emit<'_, B>) + Sync),
    mut take: impl FnMut(&mut B) -> ControlFlow<()>,
) -> Result<()> {
    std::thread::scope(|scope| {
        let mut workers = Vec::with_capacity(threads);
        for _ in 0..threads {
            let (worker, decoder) = channels::<I, B>();
            spawn_scoped(scope, "decoder", move || decoder.run(make))?;
            workers.push(worker);
        }
        let mut items = items.fuse();
        let (mut sent, mut taken) = (0, 0);
        loop {
            while sent < taken + ITEMS_PER_THREAD * threads {
                let Some(item) = items.next() else { break };
                // Channels close before only if the thread has panicked, which the scope passes on.
                if workers[sent % threads].items.send(item).is_err() {
                    return Ok(());
                }
                sent += 1;
            }
            if taken == sent {
                return Ok(());
            }
            if workers[taken % threads].take_item(&mut take).is_break() {
                return Ok(());
            }
            taken += 1;
        }
    })
}

/// The ends of the channels of a thread that the reading thread has.
struct Worker<I, B> {
    items: Sender<I>,
    /// Blocks; `None` after the last one of an item.
    blocks: Receiver<Option<B>>,
    /// Blocks that have been read, to be filled again.
    spares: Sender<B>,
}

/// The ends of the channels that a decoding thread has.
struct Decoder<I, B> {
    items: Receiver<I>,
    blocks: SyncSender<Option<B>>,
    spares: Receiver<B>,
}

fn channels<I, B>() -> (Worker<I, B>, Decoder<I, B>) {
    let (to_thread, items) = channel();
    let (blocks, from_thread) = sync_channel(UNREAD_BLOCKS);
    let (back, spares) = channel();
    (Worker { items: to_thread, blocks: from_thread, spares: back }, Decoder { items, blocks, spares })
}

impl<I, B> Worker<I, B> {
    /// Takes the blocks of the next item.
    fn take_item(&self, take: &mut impl FnMut(&mut B) -> ControlFlow<()>) -> ControlFlow<()> {
        loop {
            match self.blocks.recv() {
                Ok(Some(mut block)) => {
                    take(&mut block)?;
                    // The thread may have ended.
                    let _ = self.spares.send(block);
                }
                Ok(None) => return ControlFlow::Continue(()),
                Err(_) => return ControlFlow::Break(()),
            }
        }
    }
}

impl<I, B: Default> Decoder<I, B> {
    /// Decodes items until there are no more, or none are needed.
    fn run(self, make: &impl Fn(I, &mut B, &mut Emit<'_, B>)) {
        let Decoder { items, blocks, spares } = self;
        let mut block = B::default();
        while let Ok(item) = items.recv() {
            make(item, &mut block, &mut |full: &mut B| {
                let next = spares.try_recv().unwrap_or_default();
                match blocks.send(Some(std::mem::replace(full, next))) {
                    Ok(()) => ControlFlow::Continue(()),
                    Err(_) => ControlFlow::Break(()),
                }
            });
            if blocks.send(None).is_err() {
                return;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The numbers below `items`, each `item % 4` times, up to the first `most`.
    fn taken(threads: usize, items: usize, most: usize) -> Vec<usize> {
        let mut all = Vec::new();
        let make = |item: usize, block: &mut Vec<usize>, emit: &mut Emit<'_, Vec<usize>>| {
            for _ in 0..item % 4 {
                block.clear();
                block.push(item);
                if emit(block).is_break() {
                    return;
                }
            }
        };
        in_order(threads, 0..items, make, |block: &mut Vec<usize>| {
            all.append(block);
            if all.len() == most { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        })
        .unwrap();
        all
    }

    #[test]
    fn blocks_of_any_number_of_threads_come_in_the_order_of_their_items() {
        for items in [0, 1, 2, 3, 100] {
            let expected: Vec<usize> = (0..items).flat_map(|i| std::iter::repeat_n(i, i % 4)).collect();
            for threads in [0, 1, 2, 5] {
                assert_eq!(taken(threads, items, usize::MAX), expected, "{threads} threads, {items} items");
                let few = taken(threads, items, 7);
                assert_eq!(few, expected[..expected.len().min(7)], "{threads} threads, {items} items");
            }
        }
    }

    #[test]
    fn a_panic_while_blocks_are_taken_is_not_one_of_the_decoder() {
        use std::panic::{AssertUnwindSafe, catch_unwind};
        use vlscan_base::damage::catch_decoder_panic;
        for threads in [1, 3] {
            let make = |item: usize, block: &mut usize, emit: &mut Emit<'_, usize>| {
                *block = item;
                let _ = catch_decoder_panic(|| emit(block));
            };
            let mut taken = 0;
            let read = || {
                in_order(threads, 0..9, make, |block: &mut usize| {
                    taken += 1;
                    assert!(*block != 4, "on purpose");
                    ControlFlow::Continue(())
                })
            };
            assert!(catch_unwind(AssertUnwindSafe(read)).is_err(), "{threads} threads");
            assert_eq!(taken, 5, "{threads} threads");
        }
    }

    #[test]
    fn the_number_of_threads_is_bounded_by_the_memory() {
        for (memory, expected) in
            [(None, 64), (Some(1 << 40), 64), (Some(4 << 30), 16), (Some(1 << 30), 4), (Some(1 << 20), 0)]
        {
            assert_eq!(affordable(64, memory), expected, "{memory:?}");
        }
        let point = size_of::<crate::PointRow>() + size_of::<crate::PointDetails>();
        let blocks = (UNREAD_BLOCKS + 3) * (1 << 14) * point;
        assert!(blocks as u64 <= THREAD_BYTES, "{blocks} bytes");
    }

    #[test]
    fn the_number_of_blocks_is_bounded_by_that_of_threads() {
        use std::sync::atomic::{AtomicUsize, Ordering};
        static MADE: AtomicUsize = AtomicUsize::new(0);
        struct Counted;
        impl Default for Counted {
            fn default() -> Counted {
                MADE.fetch_add(1, Ordering::Relaxed);
                Counted
            }
        }
        let make = |_: usize, block: &mut Counted, emit: &mut Emit<'_, Counted>| {
            for _ in 0..10 {
                let _ = emit(block);
            }
        };
        let mut count = 0;
        in_order(3, 0..50, make, |_: &mut Counted| {
            count += 1;
            ControlFlow::Continue(())
        })
        .unwrap();
        assert_eq!(count, 500);
        let made = MADE.load(Ordering::Relaxed);
        assert!(made <= 3 * (UNREAD_BLOCKS + 3), "{made} blocks");
    }
}
