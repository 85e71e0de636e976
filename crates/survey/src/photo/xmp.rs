//! The tags of an XMP packet, by their names without prefix: attributes and simple elements alike.

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

    /// A tag's number, which DJI writes with a sign: `+28.29`.
    pub(super) fn number(&self, name: &str) -> Result<Option<f64>, String> {
        let Some(text) = self.text(name) else { return Ok(None) };
        match text.trim().parse::<f64>() {
            Ok(number) if number.is_finite() => Ok(Some(number)),
            _ => Err(format!("its {name} is {text:?}: expected a number")),
        }
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
            XmlStep::Start(start) => collect(&xml.element(start)?, &mut tags),
            XmlStep::End(_) => {}
            XmlStep::Done => return Ok(tags),
        }
    }
}

fn collect(element: &Element, tags: &mut Tags) {
    for (name, value) in &element.attributes {
        tags.0.insert(name.clone(), value.clone());
    }
    if element.children.is_empty() && !element.text.trim().is_empty() {
        tags.0.insert(element.name.clone(), element.text.trim().to_owned());
    }
    for child in &element.children {
        collect(child, tags);
    }
}
