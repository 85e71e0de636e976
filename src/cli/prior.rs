//! `sizeup prior`: what a depth network wants.

use std::path::PathBuf;

use clap::{Args, Subcommand};
use serde_json::{Value, json};

use super::{Failure, Global, print_json};
use crate::onnx::Port;
use crate::prior::network::{Inspection, inspect};

/// Subcommands of `sizeup prior`.
#[derive(Debug, Clone, Subcommand)]
pub enum PriorCommand {
    /// Say what an ONNX graph wants and gives, and which built-in profile fits it.
    Inspect(InspectArgs),
}

/// Arguments of `sizeup prior inspect`.
#[derive(Debug, Clone, Args)]
#[command(after_help = "Example:
  sizeup prior inspect depth_anything_v2_small.onnx")]
pub struct InspectArgs {
    /// ONNX file.
    pub model: PathBuf,
}

pub(super) fn run(command: &PriorCommand, global: &Global) -> Result<u8, Failure> {
    let PriorCommand::Inspect(args) = command;
    let inspection = inspect(&args.model).map_err(|e| Failure::new(3, &e))?;
    if global.json {
        print_json(&as_json(&inspection))?;
    } else {
        print_table(&inspection);
    }
    Ok(0)
}

fn print_table(inspection: &Inspection) {
    for (what, ports) in [("input", &inspection.inputs), ("output", &inspection.outputs)] {
        for port in ports {
            println!("{what:<8}{} {}", port.name, shape(port));
        }
    }
    for (profile, wiring) in &inspection.profiles {
        match wiring {
            Ok(wiring) => println!("fits    {} ({}; weights: {})", profile.name, wiring.output, profile.licence),
            Err(reason) => println!("no fit  {}: {reason}", profile.name),
        }
    }
    if inspection.profiles.iter().all(|(_, wiring)| wiring.is_err()) {
        println!("hint: declare `prior.custom`; `sizeup schema run` lists its keys");
    } else {
        println!("hint: several may fit; choose by where the weights come from, not by the graph");
    }
}

fn shape(port: &Port) -> String {
    if port.shape.is_empty() {
        return "of unsaid shape".to_owned();
    }
    port.shape.iter().map(|n| n.map_or_else(|| "?".to_owned(), |n| n.to_string())).collect::<Vec<_>>().join(" × ")
}

fn as_json(inspection: &Inspection) -> Value {
    let ports = |ports: &[Port]| -> Vec<Value> {
        ports.iter().map(|port| json!({ "name": port.name, "shape": port.shape })).collect()
    };
    let profiles: Vec<Value> = inspection
        .profiles
        .iter()
        .map(|(profile, wiring)| {
            let reason = wiring.as_ref().err();
            json!({ "name": profile.name, "fits": reason.is_none(), "reason": reason, "licence": profile.licence })
        })
        .collect();
    json!({ "inputs": ports(&inspection.inputs), "outputs": ports(&inspection.outputs), "profiles": profiles })
}
