//! Tables of the studies as Markdown.

use std::fmt::Write as _;

use super::{Study, StudyRow, StudyTables};
use crate::benchmark::accuracy::word;

impl StudyTables {
    /// As Markdown; empty where there was no study.
    #[must_use]
    pub fn to_markdown(&self) -> String {
        let Some(c) = &self.config else { return String::new() };
        let towns = c.towns.iter().map(word).collect::<Vec<_>>().join(", ");
        let mut text = format!(
            "\nOne setting of `paper` changed at a time: {towns} of {} buildings, {} views of {} px, seeds {:?}, each solved with \
             solver seeds {:?}; priors `{}`.\n",
            c.n_buildings,
            c.n_views,
            c.longest_px,
            c.seeds,
            c.solver_seeds,
            word(&c.level),
        );
        for (study, rows) in &self.studies {
            let _ = write!(
                text,
                "\n**{}**\n\n| setting | err avg m | err 90 % m | acc avg % | runs' err avg m | by solver seed m | #Sel | #Used | \
                 ratio | time s | no height | below 0.5 % |{}\n|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|{}\n",
                study.title(),
                if *study == Study::Components { " Err 90 % m | Comp 0.5/1 m % |" } else { "" },
                if *study == Study::Components { "---:|---:|" } else { "" },
            );
            rows.iter().for_each(|row| text.push_str(&row.to_markdown()));
        }
        text.push_str(
            "\n**Stability of the method as it is**\n\n| epoch | loss | mean relative change % | runs below 0.5 % so far % | to the \
             last heights m |\n|---:|---:|---:|---:|---:|\n",
        );
        for row in &self.stability {
            let _ = writeln!(
                text,
                "| {} | {:.3} | {:.2} | {:.0} | {:.2} |",
                row.epoch,
                row.loss,
                100.0 * row.relative_change,
                100.0 * row.stable_share,
                row.to_last_m
            );
        }
        text.push_str(
            "\nerr, acc: over the buildings of all runs, as in the tables of heights; runs' err avg: least and greatest mean error of \
             a single run; by solver seed: greatest less least mean error of one town over the solver's seeds, mean over the \
             towns; below 0.5 %: runs whose heights changed by less on average in some epoch (the paper's criterion); to the last heights: mean way from the heights after this epoch to those after the last. ",
        );
        text.push_str(&self.programs.to_markdown());
        text
    }
}

impl StudyRow {
    fn to_markdown(&self) -> String {
        let s = &self.statistics;
        let bodies = self.bodies.map_or_else(String::new, |[error_90_m, comp_05, comp_1]| {
            format!(" {error_90_m:.2} | {:.1}/{:.1} |", 100.0 * comp_05, 100.0 * comp_1)
        });
        format!(
            "| {} | {:.2} | {:.2} | {:.1} | {:.2}–{:.2} | {:.2} | {:.0} | {:.0} | {:.2} | {:.1} | {} | {:.0} % |{bodies}\n",
            self.label,
            s.error_mean_m,
            s.error_p90_m,
            100.0 * s.accuracy_mean,
            self.run_means_m[0],
            self.run_means_m[1],
            self.by_solver_seed_m,
            self.n_selected,
            self.n_used,
            self.used_share,
            self.heights_s,
            self.n_without_height,
            100.0 * self.stable_share,
        )
    }
}
