//! The equations that are left when points are eliminated: six unknowns per photo, a block for each two that share a point.
//!
//! `A x = b`, `A` symmetric and positive definite, by conjugate gradients that are preconditioned with the inverse of the blocks on the
//! diagonal. Memory grows with the pairs of photos that share points. Blocks and sums are kept in the order of photos.

use std::collections::BTreeMap;

/// Unknowns of a photo: a turn and a shift.
pub(super) const SIX: usize = 6;
pub(super) type Six = [f64; SIX];
pub(super) type Matrix6 = [Six; SIX];

/// Residual against the right side at which the solution is exact for our purposes.
const CONVERGED: f64 = 1e-10;
/// Most steps per unknown.
const MAX_STEPS_PER_UNKNOWN: usize = 4;

/// The upper half of a symmetric matrix of blocks, and a right side.
#[derive(Debug)]
pub(super) struct Reduced {
    /// By row: blocks from the diagonal to the right.
    rows: Vec<BTreeMap<usize, Matrix6>>,
    right: Vec<Six>,
}

impl Reduced {
    pub fn new(n_photos: usize) -> Self {
        Self { rows: vec![BTreeMap::new(); n_photos], right: vec![[0.0; SIX]; n_photos] }
    }

    /// Adds to the block of a row and a column that is not left of the diagonal.
    pub fn add(&mut self, row: usize, col: usize, block: &Matrix6) {
        debug_assert!(row <= col, "only the upper half is kept");
        let here = self.rows[row].entry(col).or_insert([[0.0; SIX]; SIX]);
        for (here, add) in here.iter_mut().flatten().zip(block.iter().flatten()) {
            *here += add;
        }
    }

    pub fn add_right(&mut self, row: usize, values: &Six) {
        add_scaled(&mut self.right[row], 1.0, values);
    }

    /// The solution, with the diagonal raised by a share of itself.
    pub fn solve(&mut self, damping: f64) -> Vec<Six> {
        for (row, blocks) in self.rows.iter_mut().enumerate() {
            let diagonal = blocks.entry(row).or_insert([[0.0; SIX]; SIX]);
            (0..SIX).for_each(|i| diagonal[i][i] *= 1.0 + damping);
        }
        let inverses: Vec<Matrix6> = self.rows.iter().enumerate().map(|(row, blocks)| inverse(&blocks[&row])).collect();
        self.conjugate_gradients(&inverses)
    }

    fn conjugate_gradients(&self, inverses: &[Matrix6]) -> Vec<Six> {
        let precondition = |r: &[Six]| -> Vec<Six> { inverses.iter().zip(r).map(|(m, r)| times(m, r)).collect() };
        let mut x = vec![[0.0; SIX]; self.right.len()];
        let mut r = self.right.clone();
        let mut z = precondition(&r);
        let mut p = z.clone();
        let mut rz = dot(&r, &z);
        let enough = CONVERGED * CONVERGED * rz;
        for _ in 0..MAX_STEPS_PER_UNKNOWN * SIX * x.len() {
            if rz <= enough {
                break;
            }
            let ap = self.times(&p);
            let step = rz / dot(&p, &ap);
            if !step.is_finite() {
                break;
            }
            add_all(&mut x, step, &p);
            add_all(&mut r, -step, &ap);
            z = precondition(&r);
            let next = dot(&r, &z);
            let keep = next / rz;
            rz = next;
            for (p, z) in p.iter_mut().flatten().zip(z.iter().flatten()) {
                *p = z + keep * *p;
            }
        }
        x
    }

    fn times(&self, x: &[Six]) -> Vec<Six> {
        let mut product = vec![[0.0; SIX]; x.len()];
        for (row, blocks) in self.rows.iter().enumerate() {
            for (col, block) in blocks {
                add_scaled(&mut product[row], 1.0, &times(block, &x[*col]));
                if row != *col {
                    add_scaled(&mut product[*col], 1.0, &times_transposed(block, &x[row]));
                }
            }
        }
        product
    }
}

fn add_scaled(to: &mut Six, scale: f64, values: &Six) {
    to.iter_mut().zip(values).for_each(|(to, value)| *to += scale * value);
}

fn add_all(to: &mut [Six], scale: f64, values: &[Six]) {
    to.iter_mut().zip(values).for_each(|(to, values)| add_scaled(to, scale, values));
}

fn dot(a: &[Six], b: &[Six]) -> f64 {
    a.iter().flatten().zip(b.iter().flatten()).map(|(a, b)| a * b).sum()
}

fn times(block: &Matrix6, x: &Six) -> Six {
    block.map(|row| row.iter().zip(x).map(|(a, x)| a * x).sum())
}

fn times_transposed(block: &Matrix6, x: &Six) -> Six {
    let mut product = [0.0; SIX];
    block.iter().zip(x).for_each(|(row, x)| add_scaled(&mut product, *x, row));
    product
}

/// Inverse of a symmetric positive definite block, by Cholesky's factor `L`: column by column of `L Lᵀ X = 1`.
fn inverse(block: &Matrix6) -> Matrix6 {
    let mut l = [[0.0; SIX]; SIX];
    for col in 0..SIX {
        for row in col..SIX {
            let value = block[row][col] - (0..col).map(|k| l[row][k] * l[col][k]).sum::<f64>();
            l[row][col] = if row == col { value.max(f64::MIN_POSITIVE).sqrt() } else { value / l[col][col] };
        }
    }
    // The inverse is symmetric: its columns are its rows.
    std::array::from_fn(|col| {
        let mut x = [0.0; SIX];
        for row in 0..SIX {
            let unit = if row == col { 1.0 } else { 0.0 };
            x[row] = (unit - (0..row).map(|k| l[row][k] * x[k]).sum::<f64>()) / l[row][row];
        }
        for row in (0..SIX).rev() {
            x[row] = (x[row] - (row + 1..SIX).map(|k| l[k][row] * x[k]).sum::<f64>()) / l[row][row];
        }
        x
    })
}
