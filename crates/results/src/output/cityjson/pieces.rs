//! A `CityJSON` file read piece by piece: objects and vertices one at a time, never all of it in memory.

use std::fmt;
use std::io::Read;

use serde::Deserializer;
use serde::de::{DeserializeOwned, DeserializeSeed, Error as _, MapAccess, SeqAccess, Visitor};

/// Takes the pieces of a file in its order.
pub(in crate::output) trait Pieces {
    /// Part of a city object that is read.
    type Object: DeserializeOwned;
    /// Part of a vertex that is read.
    type Vertex: DeserializeOwned;
    /// Part of any other member that is read.
    type Member: DeserializeOwned;

    /// `CityObjects` or `vertices` begin; `false` ends the reading.
    fn list(&mut self, _name: &str) -> bool {
        true
    }
    /// An object; `false` ends the reading.
    fn object(&mut self, id: String, object: Self::Object) -> bool;
    /// Takes a vertex; does nothing unless a reader wants it.
    fn vertex(&mut self, _vertex: Self::Vertex) {}
    /// Another member of the file.
    fn member(&mut self, _name: String, _value: Self::Member) {}
}

/// Reads a file to its end, or until `pieces` end it.
///
/// # Errors
/// Error of reading, of syntax, or of data: where objects and vertices are no such lists, or `pieces` ended the reading.
pub(in crate::output) fn read_pieces(reader: impl Read, pieces: &mut impl Pieces) -> serde_json::Result<()> {
    let mut deserializer = serde_json::Deserializer::from_reader(reader);
    Seed { place: DocumentPlace::File, pieces }.deserialize(&mut deserializer)?;
    deserializer.end()
}

#[derive(Clone, Copy)]
enum DocumentPlace {
    File,
    Objects,
    Vertices,
}

/// A part of the file, and who takes its pieces.
struct Seed<'a, P> {
    place: DocumentPlace,
    pieces: &'a mut P,
}

impl<'de, P: Pieces> DeserializeSeed<'de> for Seed<'_, P> {
    type Value = ();

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<(), D::Error> {
        match self.place {
            DocumentPlace::File | DocumentPlace::Objects => deserializer.deserialize_map(self),
            DocumentPlace::Vertices => deserializer.deserialize_seq(self),
        }
    }
}

impl<'de, P: Pieces> Visitor<'de> for Seed<'_, P> {
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self.place {
            DocumentPlace::File => "a CityJSON object",
            DocumentPlace::Objects => "city objects by id",
            DocumentPlace::Vertices => "a list of vertices",
        })
    }

    fn visit_map<A: MapAccess<'de>>(self, mut members: A) -> Result<(), A::Error> {
        let Self { place, pieces } = self;
        let go_on = |goes_on: bool| if goes_on { Ok(()) } else { Err(A::Error::custom("stopped")) };
        while let Some(name) = members.next_key::<String>()? {
            let place = match (place, name.as_str()) {
                (DocumentPlace::File, "CityObjects") => DocumentPlace::Objects,
                (DocumentPlace::File, "vertices") => DocumentPlace::Vertices,
                (DocumentPlace::File, _) => {
                    pieces.member(name, members.next_value()?);
                    continue;
                }
                _ => {
                    go_on(pieces.object(name, members.next_value()?))?;
                    continue;
                }
            };
            go_on(pieces.list(&name))?;
            members.next_value_seed(Seed { place, pieces: &mut *pieces })?;
        }
        Ok(())
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut vertices: A) -> Result<(), A::Error> {
        while let Some(vertex) = vertices.next_element()? {
            self.pieces.vertex(vertex);
        }
        Ok(())
    }
}
