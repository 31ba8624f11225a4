//! Items sorted into groups by a key: one array of items and one of where each group begins.

/// Items 0 … n − 1, grouped by key 0 … k − 1; within a group in ascending order.
#[derive(Clone, Debug)]
pub struct Groups {
    starts: Vec<usize>,
    items: Vec<u32>,
}

impl Groups {
    /// Counting sort of `keys`, each below `count`; O(n + k).
    #[must_use]
    pub fn by_key(keys: &[u32], count: usize) -> Self {
        let mut starts = vec![0; count + 1];
        for &key in keys {
            starts[key as usize + 1] += 1;
        }
        for i in 0..count {
            starts[i + 1] += starts[i];
        }
        let mut next = starts.clone();
        let mut items = vec![0; keys.len()];
        for (item, &key) in (0u32..).zip(keys) {
            items[next[key as usize]] = item;
            next[key as usize] += 1;
        }
        Self { starts, items }
    }

    /// How many groups.
    #[must_use]
    pub fn len(&self) -> usize {
        self.starts.len() - 1
    }

    /// Whether there is no group.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The items of one group.
    #[must_use]
    pub fn get(&self, group: usize) -> &[u32] {
        &self.items[self.starts[group]..self.starts[group + 1]]
    }

    /// All groups in order.
    #[must_use]
    pub fn iter(&self) -> impl ExactSizeIterator<Item = &[u32]> + '_ {
        (0..self.len()).map(|group| self.get(group))
    }
}

/// Gives keys of any values the numbers 0 … in the order in which they first appear; returns them and how many there are.
pub fn number_by_appearance<K: std::hash::Hash + Eq>(keys: impl Iterator<Item = K>) -> (Vec<u32>, usize) {
    let mut numbers = std::collections::HashMap::new();
    let numbered = keys
        .map(|key| {
            let next = numbers.len() as u32;
            *numbers.entry(key).or_insert(next)
        })
        .collect();
    (numbered, numbers.len())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn groups_keep_the_order_of_their_items() {
        let groups = Groups::by_key(&[2, 0, 2, 3, 0], 4);
        assert_eq!(groups.iter().collect::<Vec<_>>(), [&[1, 4][..], &[], &[0, 2], &[3]]);
        assert!(Groups::by_key(&[], 0).is_empty());
    }

    #[test]
    fn numbers_follow_appearance() {
        assert_eq!(number_by_appearance([7, 3, 7, 9].into_iter()), (vec![0, 1, 0, 2], 3));
    }
}
