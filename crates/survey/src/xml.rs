//! XML read as a stream, with small subtrees where a whole element is wanted. Depth and number of elements of a
//! subtree are bounded, entities beyond the predefined ones are refused: a hostile file costs no more than its size.

use std::collections::BTreeMap;
use std::io::{BufReader, Read};
use std::path::{Path, PathBuf};

use quick_xml::Reader;
use quick_xml::events::{BytesStart, Event};

use super::SurveyError;
use super::error::Place;
use super::text::Utf8;

/// Elements nested deeper than this belong to no survey.
const MAX_DEPTH: usize = 64;
/// Elements of one subtree (a photo, a sensor); a photo with tie points has some thousands.
const MAX_ELEMENTS: usize = 1_000_000;

/// An element with all that is in it. Names lack their namespace prefix; attributes that have one are there by both names.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Element {
    pub name: String,
    /// Namespace prefix of the name; empty without one.
    pub prefix: String,
    pub attributes: BTreeMap<String, String>,
    pub text: String,
    pub children: Vec<Element>,
}

impl Element {
    /// The first child of a name.
    pub(crate) fn child(&self, name: &str) -> Option<&Self> {
        self.children.iter().find(|child| child.name == name)
    }

    /// All children of a name.
    pub(crate) fn all<'a>(&'a self, name: &'a str) -> impl Iterator<Item = &'a Self> {
        self.children.iter().filter(move |child| child.name == name)
    }

    /// Text of the first child of this name; `None` without one.
    pub(crate) fn text_of(&self, name: &str) -> Option<&str> {
        Some(self.child(name)?.text.trim())
    }

    /// A child's text as a number, if the child is there.
    pub(crate) fn number(&self, name: &str) -> Result<Option<f64>, String> {
        self.text_of(name).map(|text| parse_number(name, text)).transpose()
    }

    /// A child's text as a number that has to be there.
    pub(crate) fn need_number(&self, name: &str) -> Result<f64, String> {
        self.number(name)?.ok_or_else(|| format!("<{}> has no <{name}>", self.name))
    }

    /// Value of an attribute; `None` without one.
    pub(crate) fn attribute(&self, name: &str) -> Option<&str> {
        self.attributes.get(name).map(String::as_str)
    }

    /// The numbers of a blank-separated list.
    pub(crate) fn numbers(&self) -> Result<Vec<f64>, String> {
        self.text.split_ascii_whitespace().map(|text| parse_number(&self.name, text)).collect()
    }
}

pub(crate) fn parse_number(name: &str, text: &str) -> Result<f64, String> {
    let number: f64 = text.trim().parse().map_err(|_| format!("<{name}> is {text:?}: expected a number"))?;
    if number.is_finite() { Ok(number) } else { Err(format!("<{name}> is {number}: expected a finite number")) }
}

/// The next step on the top level of the walk.
pub(crate) enum XmlStep {
    /// An element opens: take it with [`Xml::element`], or let the walk go on inside it.
    Start(Element),
    /// The end of the element of this name.
    End(String),
    /// The end of the file.
    Done,
}

/// A walk through an XML file. Its encoding is that of all text here ([`Utf8`]), whatever its declaration states.
pub(crate) struct Xml<R: Read> {
    reader: Reader<BufReader<Utf8<R>>>,
    path: PathBuf,
    buffer: Vec<u8>,
    open: Vec<String>,
}

impl<R: Read> Xml<R> {
    pub(crate) fn new(reader: R, path: &Path) -> Self {
        let mut reader = Reader::from_reader(BufReader::with_capacity(1 << 16, Utf8::new(reader)));
        let config = reader.config_mut();
        config.expand_empty_elements = true;
        config.check_end_names = true;
        Self { reader, path: path.to_owned(), buffer: Vec::new(), open: Vec::new() }
    }

    /// An error at the present byte.
    pub(crate) fn error(&self, message: impl Into<String>) -> SurveyError {
        SurveyError::malformed(&self.path, Place::Byte(self.reader.buffer_position()), message)
    }

    /// The next opening or closing element.
    pub(crate) fn step(&mut self) -> Result<XmlStep, SurveyError> {
        let mut ignored = String::new();
        self.next(&mut ignored)
    }

    /// The rest of an element that has just opened.
    pub(crate) fn element(&mut self, start: Element) -> Result<Element, SurveyError> {
        let mut stack = vec![start];
        let mut n_elements = 0;
        loop {
            let mut text = String::new();
            let step = self.next(&mut text)?;
            let depth = stack.len();
            let Some(top) = stack.last_mut() else { return Err(self.error("an element closes that never opened")) };
            top.text.push_str(&text);
            match step {
                XmlStep::Start(child) => {
                    n_elements += 1;
                    if depth >= MAX_DEPTH || n_elements > MAX_ELEMENTS {
                        return Err(self.error("elements nested or repeated beyond what a survey holds"));
                    }
                    stack.push(child);
                }
                XmlStep::End(_) => {
                    let Some(done) = stack.pop() else { return Err(self.error("an element closes twice")) };
                    match stack.last_mut() {
                        Some(parent) => parent.children.push(done),
                        None => return Ok(done),
                    }
                }
                XmlStep::Done => return Err(self.error("the file ends inside an element")),
            }
        }
    }

    fn next(&mut self, text: &mut String) -> Result<XmlStep, SurveyError> {
        loop {
            self.buffer.clear();
            let event = match self.reader.read_event_into(&mut self.buffer) {
                Ok(event) => event,
                Err(e) => {
                    let place = Place::Byte(self.reader.error_position());
                    return Err(SurveyError::malformed(&self.path, place, format!("not well-formed XML: {e}")));
                }
            };
            match event {
                Event::Start(start) => {
                    let element = opened(&start).map_err(|message| {
                        SurveyError::malformed(&self.path, Place::Byte(self.reader.buffer_position()), message)
                    })?;
                    if self.open.len() >= MAX_DEPTH {
                        return Err(self.error("elements nested beyond what a survey holds"));
                    }
                    self.open.push(element.name.clone());
                    return Ok(XmlStep::Start(element));
                }
                Event::End(_) => {
                    let Some(name) = self.open.pop() else {
                        return Err(self.error("an element closes that never opened"));
                    };
                    return Ok(XmlStep::End(name));
                }
                Event::Text(part) => text.push_str(&part.xml10_content()),
                Event::CData(part) => text.push_str(&part.xml10_content()),
                Event::GeneralRef(reference) => {
                    let name = reference.into_inner().into_owned();
                    match resolve(&name) {
                        Some(resolved) => text.push(resolved),
                        None => return Err(self.error(format!("unknown entity &{name};"))),
                    }
                }
                Event::Eof if self.open.is_empty() => return Ok(XmlStep::Done),
                Event::Eof => return Err(self.error("the file ends inside an element").hint("it is truncated")),
                Event::Decl(_) | Event::Comment(_) | Event::PI(_) | Event::DocType(_) | Event::Empty(_) => {}
            }
        }
    }
}

fn resolve(entity: &str) -> Option<char> {
    match entity {
        "amp" => Some('&'),
        "lt" => Some('<'),
        "gt" => Some('>'),
        "quot" => Some('"'),
        "apos" => Some('\''),
        _ => {
            let number = entity.strip_prefix('#')?;
            let code = match number.strip_prefix('x') {
                Some(hexadecimal) => u32::from_str_radix(hexadecimal, 16).ok()?,
                None => number.parse().ok()?,
            };
            char::from_u32(code)
        }
    }
}

fn opened(start: &BytesStart<'_>) -> Result<Element, String> {
    let prefix = start.name().prefix().map_or_else(String::new, |prefix| prefix.as_ref().to_owned());
    let mut element = Element { name: start.local_name().as_ref().to_owned(), prefix, ..Element::default() };
    for attribute in start.attributes() {
        let attribute = attribute.map_err(|e| format!("a broken attribute: {e}"))?;
        let value = attribute
            .normalized_value(quick_xml::XmlVersion::Implicit1_0)
            .map_err(|e| format!("a broken attribute: {e}"))?;
        if attribute.key.prefix().is_some_and(|prefix| prefix.as_ref() != "xmlns") {
            element.attributes.insert(attribute.key.as_ref().to_owned(), value.clone().into_owned());
        }
        element.attributes.insert(attribute.key.local_name().as_ref().to_owned(), value.into_owned());
    }
    Ok(element)
}
