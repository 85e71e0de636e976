//! Computes a network with candle, so that gradients reach its parameters.

use candle_core::{Result, Tensor};

use super::conv::conv2d;
use super::norm::group_norm_relu;
use super::parameters::Parameters;
use super::resize::resize;
use super::{Builder, Kernel, NetworkConfig, network};

/// Logits of a batch: `batch × 5 × rows × columns`.
///
/// `given`: inputs or feature maps by name, each `batch × channels × rows × columns`.
///
/// # Errors
/// Shapes that do not fit.
pub fn logits(
    config: &NetworkConfig,
    parameters: &Parameters,
    given: &[(String, Tensor)],
    size: (usize, usize),
) -> Result<Tensor> {
    network(&mut Evaluate { parameters }, config, given, size)
}

struct Evaluate<'a> {
    parameters: &'a Parameters,
}

impl Builder for Evaluate<'_> {
    type Value = Tensor;

    fn shape(&self, x: &Tensor) -> Result<[usize; 3]> {
        let (_, channels, rows, columns) = x.dims4()?;
        Ok([channels, rows, columns])
    }

    fn conv(&mut self, name: &str, x: &Tensor, k: Kernel) -> Result<Tensor> {
        let part = |what: &str| self.parameters.get(&format!("{name}.{what}"));
        conv2d(x, part("weight")?, part("bias")?, k.stride)
    }

    fn norm(&mut self, name: &str, x: &Tensor, n_groups: usize) -> Result<Tensor> {
        let part = |what: &str| self.parameters.get(&format!("{name}.{what}"));
        group_norm_relu(x, part("gain")?, part("bias")?, n_groups)
    }

    fn resize(&mut self, x: &Tensor, rows: usize, columns: usize) -> Result<Tensor> {
        resize(x, rows, columns)
    }

    fn concat(&mut self, xs: &[Tensor]) -> Result<Tensor> {
        Tensor::cat(xs, 1)
    }
}
