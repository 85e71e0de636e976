//! The configuration as a person would write it: the keys that matter, each with what it is and where its value is from.

use std::fmt::Write as _;
use std::path::Path;

use sizeup_geo::paths::named_from;

/// Lines are kept this long, characters.
const WIDTH: usize = 118;

/// A key of the configuration with its value and what is to be said of it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct ConfigEntry {
    key: &'static str,
    /// Value as TOML writes it.
    value: String,
    comment: String,
    is_set: bool,
}

impl ConfigEntry {
    /// A key that is set.
    pub(super) fn new(key: &'static str, value: impl Into<String>, comment: impl Into<String>) -> Self {
        Self { key, value: value.into(), comment: comment.into(), is_set: true }
    }

    /// A key that is left to the user: commented out.
    pub(super) fn off(key: &'static str, value: impl Into<String>, comment: impl Into<String>) -> Self {
        Self { is_set: false, ..Self::new(key, value, comment) }
    }

    /// A key with a path, named from the configuration's folder.
    pub(super) fn path(key: &'static str, path: &Path, home: &Path, comment: impl Into<String>) -> Self {
        Self::new(key, quoted(&named_from(home, path).to_string_lossy()), comment)
    }
}

/// A text as a TOML string, in quotes.
pub(super) fn quoted(text: &str) -> String {
    toml::Value::String(text.to_owned()).to_string()
}

/// A configuration that is being written.
#[derive(Debug, Default)]
pub(super) struct ConfigText {
    text: String,
}

impl ConfigText {
    /// A comment of its own, broken into lines.
    pub(super) fn note(&mut self, text: &str) {
        for line in broken(text, WIDTH - 2) {
            self.line(&format!("# {line}"));
        }
    }

    /// A list in comments, under a heading; nothing where it is empty.
    pub(super) fn list(&mut self, heading: &str, items: &[String]) {
        const NAMED: usize = 8;
        if items.is_empty() {
            return;
        }
        self.note(heading);
        for item in items.iter().take(NAMED) {
            for (i, line) in broken(item, WIDTH - 6).into_iter().enumerate() {
                let lead = if i == 0 { "  - " } else { "    " };
                self.line(&format!("#{lead}{line}"));
            }
        }
        if items.len() > NAMED {
            self.line(&format!("#   and {} more", items.len() - NAMED));
        }
    }

    /// The head of a table.
    pub(super) fn table(&mut self, name: &str) {
        self.line(&format!("\n[{name}]"));
    }

    /// The head of a table that is left to the user.
    pub(super) fn table_off(&mut self, name: &str) {
        self.line(&format!("\n# [{name}]"));
    }

    /// Keys with their comments: beside them where these are short, else above.
    pub(super) fn entries(&mut self, entries: &[ConfigEntry]) {
        for ConfigEntry { key, value, comment, is_set } in entries {
            let off = if *is_set { "" } else { "# " };
            let plain = format!("{off}{key} = {value}");
            let beside = format!("{plain:<36}  # {comment}");
            if comment.is_empty() {
                self.line(&plain);
            } else if beside.chars().count() <= WIDTH {
                self.line(&beside);
            } else {
                self.note(comment);
                self.line(&plain);
            }
        }
    }

    /// Lines of TOML as they are.
    pub(super) fn raw(&mut self, lines: &str) {
        self.text.push_str(lines);
    }

    /// Text of the configuration, as far as it is written.
    pub(super) fn into_text(self) -> String {
        self.text
    }

    fn line(&mut self, line: &str) {
        // Writing into text does not fail.
        let _ = writeln!(self.text, "{line}");
    }
}

/// Text in lines of at most so many characters, broken between words.
fn broken(text: &str, width: usize) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for part in text.lines() {
        lines.push(String::new());
        for word in part.split_whitespace() {
            let last = lines.last_mut().expect("a line was begun");
            if !last.is_empty() && last.chars().count() + 1 + word.chars().count() > width {
                lines.push(word.to_owned());
            } else {
                if !last.is_empty() {
                    last.push(' ');
                }
                last.push_str(word);
            }
        }
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_is_read_back_and_what_is_left_out_is_not() {
        let mut sheet = ConfigText::default();
        sheet.note(&"words ".repeat(60));
        sheet.table("survey");
        let long = "why ".repeat(50);
        sheet.entries(&[
            ConfigEntry::new("path", quoted("a \"b\"\\c"), long),
            ConfigEntry::off("offset", "[0.0]", "left"),
            ConfigEntry::path("images", Path::new("/town/photos"), Path::new("/town"), "photos"),
        ]);
        sheet.list("others", &(0..12).map(|i| format!("{i}")).collect::<Vec<_>>());
        let text = sheet.into_text();
        assert!(text.lines().all(|line| line.chars().count() <= WIDTH), "{text}");
        let table: toml::Table = text.parse().unwrap();
        assert_eq!(table["survey"]["path"].as_str(), Some("a \"b\"\\c"));
        assert_eq!(table["survey"]["images"].as_str(), Some("photos"));
        assert!(!table["survey"].as_table().unwrap().contains_key("offset"));
        assert!(text.contains("# offset = [0.0]") && text.contains("and 4 more"), "{text}");
    }
}
