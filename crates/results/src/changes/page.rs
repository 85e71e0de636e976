//! `changes.html`: what changed on one page that needs no network and no script: counts, map, and a row per building that has
//! changed or of which the results do not tell.

use std::fmt::Write as _;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use quick_xml::escape::escape;

use super::layer::colour;
use super::{Change, ChangesReport, Class};

/// Rows of the table: more make browsers slow, and nobody reads them. All are in the other files.
const N_ROWS: usize = 2000;

/// Looks, light and dark.
const STYLE: &str = "body{font:16px/1.45 system-ui,sans-serif;margin:1.5rem auto;padding:0 1rem;max-width:75rem;color-scheme:light dark}\
 img{max-width:100%;height:auto;border-radius:.3rem}table{border-collapse:collapse;width:100%;font-size:.9rem}\
 th,td{text-align:left;padding:.25rem .5rem;border-bottom:1px solid #8884;vertical-align:top}td.n{text-align:right;white-space:nowrap}\
 .counts{display:flex;flex-wrap:wrap;gap:.4rem 1.4rem;padding:0;list-style:none}\
 i{display:inline-block;width:.9em;height:.9em;border:1px solid #8888;border-radius:.15em;margin-right:.45em;vertical-align:-.1em}\
 .wide{overflow-x:auto}";

/// The page, with the map as PNG in it.
#[must_use]
pub fn changes_page(report: &ChangesReport, map_png: &[u8]) -> String {
    let mut page = format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head><meta charset=\"utf-8\"><meta name=\"viewport\" content=\"width=device-width\">\
         <title>What changed</title><style>{STYLE}</style></head>\n<body>\n<main>\n<h1>What changed</h1>\n<p>{}<br>{}</p>\n",
        source("old", report),
        source("new", report)
    );
    // Writing to a String does not fail.
    page.push_str("<ul class=\"counts\">\n");
    for class in Class::ALL {
        let n = report.counts.get(class.as_str()).copied().unwrap_or(0);
        let _ = writeln!(page, "<li>{}{n} {}</li>", swatch(class), words(class));
    }
    page.push_str("</ul>\n");
    for note in &report.notes {
        let _ = writeln!(page, "<p>{}</p>", escape(note.as_str()));
    }
    let _ = writeln!(
        page,
        "<img alt=\"Map of the buildings, coloured by what became of them\" src=\"data:image/png;base64,{}\">",
        STANDARD.encode(map_png)
    );
    table(&mut page, report);
    page.push_str("</main>\n</body>\n</html>\n");
    page
}

/// Source of one of the results.
fn source(epoch: &str, report: &ChangesReport) -> String {
    let result = if epoch == "old" { &report.old } else { &report.new };
    let date = result.reference_date.as_deref().map(|date| format!(", {date}")).unwrap_or_default();
    escape(format!("{epoch}: {}{date}, {} buildings or parts", result.path, result.n_records).as_str()).into_owned()
}

fn words(class: Class) -> String {
    class.as_str().replace('_', " ")
}

fn swatch(class: Class) -> String {
    let [r, g, b] = colour(class);
    format!("<i style=\"background:rgb({r},{g},{b})\"></i>")
}

/// Counts of changes, and of what is not told, by class.
fn table(page: &mut String, report: &ChangesReport) {
    let told = |class: Class| report.changes.iter().filter(move |change| change.class == class);
    let rows: Vec<&Change> = Class::ALL.into_iter().filter(|class| *class != Class::Same).flat_map(told).collect();
    if rows.is_empty() {
        return;
    }
    page.push_str(
        "<h2>Buildings</h2>\n<div class=\"wide\" tabindex=\"0\" role=\"group\" aria-label=\"Buildings\"><table>\n<tr><th>change</th><th>new id</th><th>old id</th><th>height before, m</th>\
         <th>now, m</th><th>difference, m</th><th>sigma, m</th><th>why</th></tr>\n",
    );
    rows.iter().take(N_ROWS).for_each(|change| row(page, change));
    page.push_str("</table></div>\n");
    if rows.len() > N_ROWS {
        let _ = writeln!(page, "<p>… and {} more, in changes.gpkg and changes.json.</p>", rows.len() - N_ROWS);
    }
}

fn row(page: &mut String, change: &Change) {
    let ids = |ids: &[String]| escape(ids.join("; ").as_str()).into_owned();
    let metres = |value: Option<f64>| value.map_or_else(String::new, |value| format!("{value:.2}"));
    let difference = change.d_roof_z_m.or(change.d_height_m).map_or_else(String::new, |value| format!("{value:+.2}"));
    let _ = writeln!(
        page,
        "<tr><td>{}{}</td><td>{}</td><td>{}</td><td class=\"n\">{}</td><td class=\"n\">{}</td><td class=\"n\">{difference}</td>\
         <td class=\"n\">{}</td><td>{}</td></tr>",
        swatch(change.class),
        words(change.class),
        ids(&change.new_ids),
        ids(&change.old_ids),
        metres(change.old_height_m),
        metres(change.new_height_m),
        metres(change.sigma_m),
        escape(change.explanation.as_str()),
    );
}
