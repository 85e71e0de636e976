//! Items that belong together, by joining pairs.

/// Sets of items that belong together.
pub struct Groups(Vec<usize>);

impl Groups {
    /// Each item for itself.
    pub fn new(n: usize) -> Self {
        Self((0..n).collect())
    }

    fn root(&mut self, mut i: usize) -> usize {
        while self.0[i] != i {
            self.0[i] = self.0[self.0[i]];
            i = self.0[i];
        }
        i
    }

    /// Puts two sets together; whether they were two.
    pub fn join(&mut self, a: usize, b: usize) -> bool {
        let (a, b) = (self.root(a), self.root(b));
        self.0[a.max(b)] = a.min(b);
        a != b
    }

    /// How many sets there are.
    pub fn count(&mut self) -> usize {
        (0..self.0.len()).filter(|&i| self.root(i) == i).count()
    }
}
