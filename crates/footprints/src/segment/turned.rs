//! Tiles turned over: a network that is shown a place in several ways errs in several ways, and their mean errs less.
//!
//! A photo turned over is one of a world turned over, in which all that the network is told stays true once the lean is turned along.

use sizeup_heights::raster::Raster;
use sizeup_photos::onnx::Tensor;

/// Turn of a tile: its columns, its rows, or both in the other order.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct TurnedOver {
    columns: bool,
    rows: bool,
}

impl TurnedOver {
    /// All of them, the first as it is.
    pub const ALL: [Self; 4] = [
        Self { columns: false, rows: false },
        Self { columns: true, rows: false },
        Self { columns: true, rows: true },
        Self { columns: false, rows: true },
    ];

    /// Maps `… × rows × columns` turned over.
    pub fn tensor(self, mut tensor: Tensor) -> Tensor {
        if let [.., rows, columns] = tensor.shape[..] {
            self.turn(&mut tensor.values, rows * columns, columns);
        }
        tensor
    }

    /// The lean, columns' parts and then rows' parts, turned over: what leant to the right leans to the left.
    pub fn lean(self, tensor: Tensor) -> Tensor {
        let mut tensor = self.tensor(tensor);
        let half = tensor.values.len() / 2;
        let (across, along) = tensor.values.split_at_mut(half);
        for (values, is_turned) in [(across, self.columns), (along, self.rows)] {
            if is_turned {
                values.iter_mut().for_each(|v| *v = -*v);
            }
        }
        tensor
    }

    /// A map turned over; twice is as it was.
    pub fn map(self, mut map: Raster<f32>) -> Raster<f32> {
        let columns = map.width();
        let n = map.data().len();
        self.turn(map.data_mut(), n, columns);
        map
    }

    fn turn(self, values: &mut [f32], per_map: usize, columns: usize) {
        if per_map == 0 {
            return;
        }
        for map in values.chunks_exact_mut(per_map) {
            match (self.columns, self.rows) {
                (true, true) => map.reverse(),
                (true, false) => map.chunks_exact_mut(columns).for_each(<[f32]>::reverse),
                (false, true) => {
                    map.reverse();
                    map.chunks_exact_mut(columns).for_each(<[f32]>::reverse);
                }
                (false, false) => {}
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn maps_are_turned_over_and_back_and_leans_with_them() {
        let turns = TurnedOver::ALL;
        let turned = |turn: TurnedOver| {
            let values = vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6];
            turn.lean(Tensor { shape: vec![1, 2, 2, 3], values }).values
        };
        assert_eq!(turned(turns[0]), [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6]);
        assert_eq!(turned(turns[1]), [-3.0, -2.0, -1.0, -6.0, -5.0, -4.0, 0.3, 0.2, 0.1, 0.6, 0.5, 0.4]);
        assert_eq!(turned(turns[2]), [-6.0, -5.0, -4.0, -3.0, -2.0, -1.0, -0.6, -0.5, -0.4, -0.3, -0.2, -0.1]);
        assert_eq!(turned(turns[3]), [4.0, 5.0, 6.0, 1.0, 2.0, 3.0, -0.4, -0.5, -0.6, -0.1, -0.2, -0.3]);
        let map = Raster::from_vec(3, 2, vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0]).unwrap();
        assert!(turns.iter().all(|turn| turn.map(turn.map(map.clone())) == map));
    }
}
