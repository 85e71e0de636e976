//! Styles for QGIS: the names of a layer's columns for people, put into a style that was made without them.
//!
//! QGIS takes the aliases of fields from the style that it loads, and forgets those that GDAL knows from
//! `gpkg_data_columns` when the style has none (seen in 3.22). Both are written from [`Column::title`].

use std::fmt::Write as _;

use quick_xml::escape::escape;

use super::features::Column;

/// The end of a style.
const END: &str = "</qgis>";
/// Last category that a style says it holds.
const LAST_CATEGORY: &str = "MapTips\"";

/// The element of a style or of a project's layer that names columns, in their order.
#[must_use]
pub fn aliases(columns: &[Column]) -> String {
    let mut text = "<aliases>\n".to_owned();
    for (i, Column { name, title, .. }) in columns.iter().enumerate() {
        let (name, title) = (printable(name), printable(title));
        let (name, title) = (escape(name.as_str()), escape(title.as_str()));
        // Writing to a String does not fail.
        let _ = writeln!(text, "  <alias index=\"{i}\" field=\"{name}\" name=\"{title}\"/>");
    }
    text + "</aliases>\n"
}

/// A text without what XML does not allow, escaped or not.
fn printable(text: &str) -> String {
    text.chars().filter(|c| !c.is_control()).collect()
}

/// A style with the names of columns, the feature id among them where QGIS shows it; as it is where it is none.
#[must_use]
pub fn with_aliases(qml: &str, columns: &[Column]) -> String {
    let Some(end) = qml.rfind(END) else { return qml.to_owned() };
    let (inside, end) = qml.split_at(end);
    let inside = inside.replacen(LAST_CATEGORY, &format!("{}|Fields\"", LAST_CATEGORY.trim_end_matches('"')), 1);
    format!("{inside}{}{end}", aliases(columns))
}

#[cfg(test)]
mod tests {
    use super::super::features::ColumnKind;
    use super::*;

    #[test]
    fn titles_become_aliases_whatever_they_hold() {
        let columns = [
            Column::new("height_m", "Height (m)", ColumnKind::Real, "Height"),
            Column::carried("a<b".to_owned(), "\"a\" & <b>".to_owned(), ColumnKind::Text),
        ];
        let styled = with_aliases("<qgis styleCategories=\"Symbology|MapTips\">\n<blendMode/>\n</qgis>\n", &columns);
        assert_eq!(
            styled,
            "<qgis styleCategories=\"Symbology|MapTips|Fields\">\n<blendMode/>\n<aliases>\n  \
             <alias index=\"0\" field=\"height_m\" name=\"Height (m)\"/>\n  \
             <alias index=\"1\" field=\"a&lt;b\" name=\"&quot;a&quot; &amp; &lt;b&gt;\"/>\n</aliases>\n</qgis>\n"
        );
        assert_eq!(with_aliases("no style", &columns), "no style");
    }
}
