//! Rows of different lengths in one array, and items grouped by key into such rows.

/// Rows of any length: one array of values, and one with the start of each row.
#[derive(Clone, Debug)]
pub struct Rows<T> {
    starts: Vec<u32>,
    values: Vec<T>,
}

/// Items 0 … n − 1, grouped by key 0 … k − 1; within a group in ascending order.
pub type Groups = Rows<u32>;

impl<T> Default for Rows<T> {
    fn default() -> Self {
        Self { starts: vec![0], values: Vec::new() }
    }
}

impl<T> Rows<T> {
    /// Returns the number of rows.
    #[must_use]
    pub fn len(&self) -> usize {
        self.starts.len() - 1
    }

    /// Returns whether there are no rows.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Returns the values of one row.
    #[must_use]
    #[inline]
    pub fn get(&self, row: usize) -> &[T] {
        &self.values[self.starts[row] as usize..self.starts[row + 1] as usize]
    }

    /// Returns an iterator over all rows in order.
    #[must_use]
    pub fn iter(&self) -> impl ExactSizeIterator<Item = &[T]> + '_ {
        (0..self.len()).map(|row| self.get(row))
    }

    /// Appends a row.
    ///
    /// # Panics
    /// With 2³² values or more: offsets are u32.
    pub fn push(&mut self, row: impl IntoIterator<Item = T>) {
        self.values.extend(row);
        self.starts.push(u32::try_from(self.values.len()).expect("fewer than 2³² values"));
    }
}

impl<T: Copy> Rows<T> {
    /// Returns the rows with the given numbers, in the given order.
    #[must_use]
    pub fn select(&self, rows: impl ExactSizeIterator<Item = usize> + Clone) -> Self {
        let mut starts = Vec::with_capacity(rows.len() + 1);
        let mut values = Vec::with_capacity(rows.clone().map(|row| self.get(row).len()).sum());
        starts.push(0);
        for row in rows {
            values.extend_from_slice(self.get(row));
            starts.push(values.len() as u32);
        }
        Self { starts, values }
    }
}

impl Groups {
    /// Groups items by `keys`, each below `count`, with a counting sort; O(n + k).
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
        let mut values = vec![0; keys.len()];
        for (item, &key) in (0u32..).zip(keys) {
            values[next[key as usize] as usize] = item;
            next[key as usize] += 1;
        }
        Self { starts, values }
    }
}

/// Numbers keys from 0 in the order of their first appearance; returns the numbers and the count of distinct keys.
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
    fn rows_are_chosen_in_any_order() {
        let mut rows = Rows::default();
        rows.push(['a', 'b']);
        rows.push([]);
        rows.push(['c']);
        let chosen = rows.select([2, 0, 2].into_iter());
        assert_eq!(chosen.iter().collect::<Vec<_>>(), [&['c'][..], &['a', 'b'], &['c']]);
    }

    #[test]
    fn numbers_follow_appearance() {
        assert_eq!(number_by_appearance([7, 3, 7, 9].into_iter()), (vec![0, 1, 0, 2], 3));
    }
}
