//! A sample of a sequence whose length is not known: few items, evenly spread.

/// Items evenly spread over a sequence.
#[derive(Clone, Debug)]
pub struct Spread<T> {
    kept: Vec<T>,
    /// Maximum number of kept items.
    capacity: usize,
    /// Number of items from one kept item to the next.
    stride: usize,
    count: usize,
}

impl<T> Spread<T> {
    /// Keeps up to `capacity` items, of long sequences at least half as many.
    pub fn new(capacity: usize) -> Spread<T> {
        Spread { kept: Vec::new(), capacity: capacity.max(2), stride: 1, count: 0 }
    }

    /// Adds the next item; every second one is removed when there are too many.
    pub fn add(&mut self, item: T) {
        if self.count.is_multiple_of(self.stride) {
            self.kept.push(item);
        }
        self.count += 1;
        if self.kept.len() > self.capacity {
            let mut index = 0;
            self.kept.retain(|_| {
                index += 1;
                index % 2 == 1
            });
            self.stride *= 2;
        }
    }

    pub fn items(&self) -> &[T] {
        &self.kept
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kept_items_span_the_sequence() {
        let mut spread = Spread::new(64);
        (0..10_000).for_each(|i| spread.add(i));
        let kept = spread.items();
        assert!((32..=64).contains(&kept.len()), "{}", kept.len());
        assert!(kept[0] == 0 && kept[kept.len() - 1] > 9500);
        let steps: Vec<i32> = kept.windows(2).map(|pair| pair[1] - pair[0]).collect();
        assert!(steps.iter().all(|step| *step == steps[0]), "{steps:?}");
    }
}
