//! The tags of an XMP packet: attributes and simple elements alike, by their names without prefix, by their names with prefix
//! (`Camera:Yaw`), and where they are parts of another by both (`drone-skydio:CameraOrientationNED/Yaw`).

use std::collections::BTreeMap;
use std::path::Path;

use crate::SurveyError;
use crate::xml::{Element, Xml, XmlStep};

/// Values of an XMP packet by the names of their tags.
#[derive(Debug, Default)]
pub(super) struct Tags(BTreeMap<String, String>);

impl Tags {
    /// Text of a tag; `None` where it is missing.
    pub(super) fn text(&self, name: &str) -> Option<&str> {
        self.0.get(name).map(String::as_str)
    }

    /// A tag's number, which DJI writes with a sign (`+28.29`) and others as a fraction (`2829/100`).
    pub(super) fn number(&self, name: &str) -> Result<Option<f64>, String> {
        let Some(text) = self.text(name) else { return Ok(None) };
        let parsed = match text.split_once('/') {
            Some((numerator, denominator)) => {
                let parts = numerator.trim().parse::<f64>().ok().zip(denominator.trim().parse::<f64>().ok());
                parts.map(|(numerator, denominator)| numerator / denominator)
            }
            None => text.trim().parse().ok(),
        };
        match parsed.filter(|number| number.is_finite()) {
            Some(number) => Ok(Some(number)),
            None => Err(format!("its {name} is {text:?}: expected a number")),
        }
    }

    /// Names with a prefix.
    pub(super) fn names(&self) -> impl Iterator<Item = &str> {
        self.0.keys().map(String::as_str).filter(|name| name.contains(':'))
    }
}

/// Reads the tags of an XMP packet.
pub(super) fn tags(packet: &[u8], path: &Path) -> Result<Tags, SurveyError> {
    // The padding behind the packet may hold zero bytes.
    let end = packet.iter().rposition(|&byte| byte == b'>').map_or(0, |last| last + 1);
    let mut xml = Xml::new(&packet[..end], path);
    let mut tags = Tags::default();
    loop {
        match xml.step()? {
            XmlStep::Start(start) => collect(&xml.element(start)?, "", &mut tags),
            XmlStep::End(_) => {}
            XmlStep::Done => return Ok(tags),
        }
    }
}

/// Adds the tags of an element, which is a part of `parent`: the name of a tag with its prefix, or nothing.
fn collect(element: &Element, parent: &str, tags: &mut Tags) {
    // Containers of RDF and of the packet itself are no tags.
    let is_tag = !element.prefix.is_empty() && !["rdf", "x"].contains(&element.prefix.as_str());
    let name = if is_tag { format!("{}:{}", element.prefix, element.name) } else { parent.to_owned() };
    for (key, value) in &element.attributes {
        tags.insert(key, &name, value);
    }
    if element.children.is_empty() && !element.text.trim().is_empty() {
        let text = element.text.trim();
        tags.insert(&element.name, parent, text);
        if is_tag {
            tags.insert(&name, "", text);
        }
    }
    for child in &element.children {
        collect(child, &name, tags);
    }
}

impl Tags {
    fn insert(&mut self, key: &str, parent: &str, value: &str) {
        if !parent.is_empty() && !key.contains(':') {
            self.0.insert(format!("{parent}/{key}"), value.to_owned());
        }
        self.0.insert(key.to_owned(), value.to_owned());
    }
}
