//! Which programs made the outcomes of a table: figures of several programs are no comparison of methods.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::Outcome;

/// Number of outcomes by program.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Programs {
    /// The program that wrote the table.
    pub written_by: String,
    /// Outcomes by the program that made them.
    pub n_outcomes: BTreeMap<String, usize>,
}

impl Programs {
    /// Programs of the outcomes of a table.
    pub fn of<'a>(written_by: &str, outcomes: impl Iterator<Item = &'a Outcome>) -> Self {
        let mut n_outcomes = BTreeMap::new();
        for outcome in outcomes {
            *n_outcomes.entry(outcome.program.clone()).or_default() += 1;
        }
        Self { written_by: written_by.to_owned(), n_outcomes }
    }

    /// Outcomes that another program made than the one that wrote the table.
    #[must_use]
    pub fn n_outdated(&self) -> usize {
        self.n_outcomes.iter().filter(|(program, _)| **program != self.written_by).map(|(_, n)| n).sum()
    }

    /// A line for below the table.
    #[must_use]
    pub fn to_markdown(&self) -> String {
        let named = |program: &str| match program {
            "" => "an older program that did not say which".to_owned(),
            known => format!("`{known}`"),
        };
        let mut all = self.n_outcomes.iter();
        match (all.next(), self.n_outcomes.len()) {
            (Some((program, n)), 1) => format!("All {n} outcomes by {}.\n", named(program)),
            _ => {
                let each: Vec<String> = self.n_outcomes.iter().map(|(p, n)| format!("{n} by {}", named(p))).collect();
                format!("**The outcomes are of different programs**: {}.\n", each.join(", "))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn programs(n_outcomes: &[(&str, usize)]) -> Programs {
        let n_outcomes = n_outcomes.iter().map(|(name, n)| ((*name).to_owned(), *n)).collect();
        Programs { written_by: "sizeup 2".to_owned(), n_outcomes }
    }

    #[test]
    fn a_table_of_one_program_names_it_and_one_of_several_says_so() {
        let one = programs(&[("sizeup 2", 36)]);
        assert_eq!((one.to_markdown().as_str(), one.n_outdated()), ("All 36 outcomes by `sizeup 2`.\n", 0));
        let mixed = programs(&[("", 3), ("sizeup 1", 4), ("sizeup 2", 5)]);
        assert_eq!(mixed.n_outdated(), 7);
        let text = mixed.to_markdown();
        assert!(
            text.contains("different programs") && text.contains("4 by `sizeup 1`") && text.contains("3 by an older")
        );
    }
}
