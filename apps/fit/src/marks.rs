//! A mark for some of very many items: two bits for each item.

/// Marks of items, and their number before each.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Marks {
    /// 64 marks each.
    words: Vec<u64>,
    /// Number of marked items before those of each word.
    before: Vec<usize>,
    /// Number of items, and of those that are marked.
    len: usize,
    count: usize,
}

impl Marks {
    /// Adds an item.
    pub fn push(&mut self, is_marked: bool) {
        if self.len.is_multiple_of(64) {
            self.words.push(0);
            self.before.push(self.count);
        }
        if let Some(word) = self.words.last_mut() {
            *word |= u64::from(is_marked) << (self.len % 64);
        }
        self.len += 1;
        self.count += usize::from(is_marked);
    }

    /// Number of items.
    #[cfg(test)]
    pub fn len(&self) -> usize {
        self.len
    }

    /// True if an item is marked.
    pub fn has(&self, item: usize) -> bool {
        self.words[item / 64] >> (item % 64) & 1 == 1
    }

    /// Number of marked items before an item.
    pub fn before(&self, item: usize) -> usize {
        let earlier = self.words[item / 64] & ((1 << (item % 64)) - 1);
        self.before[item / 64] + earlier.count_ones() as usize
    }
}

impl FromIterator<bool> for Marks {
    fn from_iter<I: IntoIterator<Item = bool>>(marks: I) -> Marks {
        let mut all = Marks::default();
        marks.into_iter().for_each(|is_marked| all.push(is_marked));
        all
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn marks_are_found_and_counted() {
        let is_marked = |item: usize| item.is_multiple_of(3) || (100..170).contains(&item);
        let marks: Marks = (0..1000).map(is_marked).collect();
        assert_eq!(marks.len(), 1000);
        let mut count = 0;
        for item in 0..1000 {
            assert_eq!((marks.has(item), marks.before(item)), (is_marked(item), count), "{item}");
            count += usize::from(is_marked(item));
        }
    }
}
