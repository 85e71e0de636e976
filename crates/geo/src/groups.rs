//! Items that belong together, by joining pairs: union-find, paths halved on the way (Tarjan and van Leeuwen 1984).

/// Sets of items that belong together.
#[derive(Debug, Clone)]
pub struct Groups(Vec<usize>);

impl Groups {
    /// Each item for itself.
    #[must_use]
    pub fn new(n: usize) -> Self {
        Self((0..n).collect())
    }

    /// The least item of the set that an item belongs to.
    pub fn first_of(&mut self, mut i: usize) -> usize {
        while self.0[i] != i {
            self.0[i] = self.0[self.0[i]];
            i = self.0[i];
        }
        i
    }

    /// Puts two sets together; whether they were two.
    pub fn join(&mut self, a: usize, b: usize) -> bool {
        let (a, b) = (self.first_of(a), self.first_of(b));
        self.0[a.max(b)] = a.min(b);
        a != b
    }

    /// Number of sets that the members fall into.
    pub fn count(&mut self) -> usize {
        (0..self.0.len()).filter(|&i| self.first_of(i) == i).count()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sets_are_named_by_their_least_item_in_whatever_order_they_are_joined() {
        for pairs in [[(4, 2), (2, 0), (5, 3)], [(2, 0), (3, 5), (0, 4)]] {
            let mut groups = Groups::new(6);
            assert!(pairs.into_iter().all(|(a, b)| groups.join(a, b)));
            assert!(!groups.join(0, 4), "they are one already");
            assert_eq!((0..6).map(|i| groups.first_of(i)).collect::<Vec<_>>(), [0, 1, 0, 3, 0, 3]);
            assert_eq!(groups.count(), 3);
        }
    }
}
