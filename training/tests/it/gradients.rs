//! Gradients of every layer against central differences, in double precision.

use candle_core::{DType, Device, Result, Tensor, Var};
use sizeup_training::network::conv::conv2d;
use sizeup_training::network::evaluate::logits;
use sizeup_training::network::norm::group_norm_relu;
use sizeup_training::network::parameters::Parameters;
use sizeup_training::network::resize::resize;
use sizeup_training::train::LossConfig;
use sizeup_training::train::loss::loss;
use sizeup_training::train::sample::Batch;

use crate::scene::small_network;

/// Numbers that look random and are the same everywhere.
fn numbers(n: usize, key: f64) -> Vec<f64> {
    (0..n).map(|i| ((i as f64 + key) * 12.9898).sin() * 43_758.545_3).map(|v| 2.0 * (v - v.floor()) - 1.0).collect()
}

fn tensor(shape: &[usize], key: f64) -> Tensor {
    Tensor::from_vec(numbers(shape.iter().product(), key), shape, &Device::Cpu).unwrap()
}

/// Holds the gradients of `f`'s weighted sum against differences of some of each variable's values.
fn check(vars: &[&Var], f: &dyn Fn() -> Result<Tensor>) {
    const STEP: f64 = 1e-5;
    let sum = || -> Result<Tensor> {
        let y = f()?;
        (&y * tensor(y.dims(), 0.37))?.sum_all()
    };
    let gradients = sum().unwrap().backward().unwrap();
    for (i, var) in vars.iter().enumerate() {
        let gradient = gradients.get(var.as_tensor()).unwrap().flatten_all().unwrap().to_vec1::<f64>().unwrap();
        let start = var.as_tensor().copy().unwrap().flatten_all().unwrap().to_vec1::<f64>().unwrap();
        let every = (start.len() / 23).max(1);
        for k in (0..start.len()).step_by(every) {
            let at = |offset: f64| {
                let mut moved = start.clone();
                moved[k] += offset;
                var.set(&Tensor::from_vec(moved, var.as_tensor().dims(), &Device::Cpu).unwrap()).unwrap();
                sum().unwrap().to_scalar::<f64>().unwrap()
            };
            let difference = (at(STEP) - at(-STEP)) / (2.0 * STEP);
            at(0.0);
            let off = (gradient[k] - difference).abs();
            assert!(off < 1e-6 * (1.0 + difference.abs()), "variable {i}, value {k}: {} and {difference}", gradient[k]);
        }
    }
}

fn var(shape: &[usize], key: f64) -> Var {
    Var::from_tensor(&tensor(shape, key)).unwrap()
}

#[test]
fn convolutions_of_any_side_and_stride() {
    for (side, stride, rows, columns) in
        [(3, 1, 7, 6), (3, 2, 8, 6), (3, 2, 7, 9), (1, 1, 5, 4), (5, 2, 9, 8), (3, 3, 10, 7)]
    {
        let (x, w, b) = (var(&[2, 3, rows, columns], 1.0), var(&[4, 3, side, side], 2.0), var(&[4], 3.0));
        check(&[&x, &w, &b], &|| conv2d(x.as_tensor(), w.as_tensor(), b.as_tensor(), stride));
    }
}

#[test]
fn convolutions_are_those_of_candle() {
    let (x, w, b) = (tensor(&[2, 3, 12, 10], 1.0), tensor(&[5, 3, 3, 3], 2.0), tensor(&[5], 3.0));
    for stride in [1, 2] {
        let own = conv2d(&x, &w, &b, stride).unwrap();
        let theirs = x.conv2d(&w, 1, stride, 1, 1).unwrap().broadcast_add(&b.reshape((1, 5, 1, 1)).unwrap()).unwrap();
        let off = (own - theirs).unwrap().abs().unwrap().max_all().unwrap().to_scalar::<f64>().unwrap();
        assert!(off < 1e-12, "{off}");
    }
}

#[test]
fn group_normalisation_with_its_rectifier() {
    for n_groups in [1, 2, 4] {
        let (x, g, b) = (var(&[2, 4, 5, 3], 1.0), var(&[4], 2.0), var(&[4], 3.0));
        check(&[&x, &g, &b], &|| group_norm_relu(x.as_tensor(), g.as_tensor(), b.as_tensor(), n_groups));
    }
}

#[test]
fn resizing_up_down_and_by_odd_ratios() {
    let x = var(&[2, 2, 6, 5], 1.0);
    for (rows, columns) in [(12, 10), (3, 4), (7, 13), (6, 5)] {
        check(&[&x], &|| resize(x.as_tensor(), rows, columns));
    }
}

#[test]
fn losses_with_unknown_pixels() {
    let logits = var(&[2, 5, 4, 5], 1.0);
    let step = |t: Tensor| t.gt(0.0).unwrap().to_dtype(DType::F64).unwrap();
    let share = |t: Tensor| t.affine(0.5, 0.5).unwrap();
    let batch = Batch {
        inputs: Vec::new(),
        target: Tensor::cat(&[step(tensor(&[2, 2, 4, 5], 5.0)), share(tensor(&[2, 3, 4, 5], 7.0))], 1).unwrap(),
        weight: (step(tensor(&[2, 5, 4, 5], 6.0)) * 1.5).unwrap(),
    };
    check(&[&logits], &|| loss(logits.as_tensor(), &batch, &LossConfig::default()));
}

#[test]
fn the_whole_network_down_to_its_first_kernel() {
    let config = small_network();
    let parameters = Parameters::new(&config, 3, DType::F64, &Device::Cpu).unwrap();
    let given: Vec<(String, Tensor)> = config
        .inputs
        .iter()
        .map(|i| (i.name().to_owned(), tensor(&[2, i.channels(), 16, 24], 1.0 + i.channels() as f64)))
        .collect();
    let some: Vec<&Var> =
        ["texture.0.down.weight", "geometry.0.same.bias", "head.project.tex1.weight", "head.up.0.norm.gain"]
            .into_iter()
            .map(|name| &parameters.vars[name])
            .collect();
    check(&some, &|| logits(&config, &parameters, &given, (16, 24)));
}
