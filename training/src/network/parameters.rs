//! The parameters of a network: named tensors, drawn from a seed, kept as safetensors.

use std::collections::BTreeMap;

use candle_core::{DType, Device, Result, Tensor, Var, bail};
use sizeup_heights::seed;

use super::{Builder, Kernel, NetworkConfig, network};

/// Named parameters that learn.
#[derive(Debug, Clone)]
pub struct Parameters {
    /// By name, in the names' order.
    pub vars: BTreeMap<String, Var>,
}

impl Parameters {
    /// Drawn for a network: weights normally with variance 2 over their inputs (He and others, 2015), biases 0. The same seed
    /// gives the same numbers, each parameter's from its own name.
    ///
    /// # Errors
    /// A configuration whose layers do not fit each other.
    pub fn new(config: &NetworkConfig, root_seed: u64, dtype: DType, device: &Device) -> Result<Self> {
        let mut vars = BTreeMap::new();
        for (name, shape) in shapes(config)? {
            let n: usize = shape.iter().product();
            let values: Vec<f64> = match shape.len() {
                1 => vec![if kind_of(&name) == "gain" { 1.0 } else { 0.0 }; n],
                _ => {
                    let deviation = (2.0 / (n / shape[0]) as f64).sqrt();
                    let mut rng = seed::stream(root_seed, "parameter", &[seed::key_of(&name)]);
                    (0..n).map(|_| deviation * normal(&mut rng)).collect()
                }
            };
            let tensor = Tensor::from_vec(values, shape, device)?.to_dtype(dtype)?;
            vars.insert(name, Var::from_tensor(&tensor)?);
        }
        Ok(Self { vars })
    }

    /// How many numbers there are.
    #[must_use]
    pub fn n_values(&self) -> usize {
        self.vars.values().map(|v| v.as_tensor().elem_count()).sum()
    }

    /// A parameter.
    ///
    /// # Errors
    /// A name that is not there.
    pub fn get(&self, name: &str) -> Result<&Tensor> {
        match self.vars.get(name) {
            Some(var) => Ok(var.as_tensor()),
            None => bail!("the network has no parameter {name:?}"),
        }
    }
}

/// Last part of a parameter's name: `weight`, `bias` or `gain`.
pub(super) fn kind_of(name: &str) -> &str {
    name.rsplit('.').next().unwrap_or(name)
}

/// A normal number, from two uniform ones (Box and Muller, 1958).
pub(crate) fn normal(rng: &mut impl rand::Rng) -> f64 {
    let (u, v): (f64, f64) = (rng.random(), rng.random());
    (-2.0 * (1.0 - u).ln()).sqrt() * (std::f64::consts::TAU * v).cos()
}

/// Names and shapes of a network's parameters, in the order in which they are used.
///
/// # Errors
/// A configuration whose layers do not fit each other.
pub fn shapes(config: &NetworkConfig) -> Result<Vec<(String, Vec<usize>)>> {
    let side = config.multiple();
    let given: Vec<(String, [usize; 3])> = if config.features.is_empty() {
        config.inputs.iter().map(|i| (i.name().to_owned(), [i.channels(), side, side])).collect()
    } else {
        config.features.iter().map(|f| (f.name.clone(), [f.channels, side, side])).collect()
    };
    let mut declared = Declare::default();
    network(&mut declared, config, &given, (side, side))?;
    Ok(declared.0)
}

/// Goes through the layers without computing anything.
#[derive(Default)]
struct Declare(Vec<(String, Vec<usize>)>);

impl Builder for Declare {
    type Value = [usize; 3];

    fn shape(&self, x: &[usize; 3]) -> Result<[usize; 3]> {
        Ok(*x)
    }

    fn conv(&mut self, name: &str, [n_in, rows, columns]: &[usize; 3], k: Kernel) -> Result<[usize; 3]> {
        self.0.push((format!("{name}.weight"), vec![k.n_out, *n_in, k.side, k.side]));
        self.0.push((format!("{name}.bias"), vec![k.n_out]));
        Ok([k.n_out, rows.div_ceil(k.stride), columns.div_ceil(k.stride)])
    }

    fn norm(&mut self, name: &str, x: &[usize; 3], _n_groups: usize) -> Result<[usize; 3]> {
        self.0.push((format!("{name}.gain"), vec![x[0]]));
        self.0.push((format!("{name}.bias"), vec![x[0]]));
        Ok(*x)
    }

    fn resize(&mut self, x: &[usize; 3], rows: usize, columns: usize) -> Result<[usize; 3]> {
        Ok([x[0], rows, columns])
    }

    fn concat(&mut self, xs: &[[usize; 3]]) -> Result<[usize; 3]> {
        let Some([_, rows, columns]) = xs.first() else { bail!("nothing to concatenate") };
        if let Some([_, other_rows, other_columns]) = xs.iter().find(|x| x[1..] != [*rows, *columns]) {
            bail!("maps of {rows} × {columns} and {other_rows} × {other_columns} cells do not go together");
        }
        Ok([xs.iter().map(|x| x[0]).sum(), *rows, *columns])
    }
}
