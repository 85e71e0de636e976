//! Addresses of buildings, from attributes in `OpenStreetMap`'s names (<https://wiki.openstreetmap.org/wiki/Key:addr:*>).
//!
//! | attribute | CityJSON | xAL 2 in `CityGML` 2.0 | xAL 3 in `CityGML` 3.0 |
//! |---|---|---|---|
//! | `addr:street` | `ThoroughfareName` | `ThoroughfareName` | `Thoroughfare/NameElement` |
//! | `addr:housenumber` | `ThoroughfareNumber` | `ThoroughfareNumber` | `Thoroughfare/Number` |
//! | `addr:postcode` | `Postcode` | `PostalCodeNumber` | `PostCode/Identifier` |
//! | `addr:city` | `Locality` | `LocalityName` | `Locality/NameElement` |
//! | `addr:country` | `Country` | `CountryNameCode` | `Country/NameElement` |

use serde_json::{Map as JsonMap, Value};

use quick_xml::escape::escape;
use sizeup_footprints::attribute;

/// Address of a building; parts that are not known are `None`, but not all of them.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Address {
    street: Option<String>,
    number: Option<String>,
    postcode: Option<String>,
    place: Option<String>,
    country: Option<String>,
}

impl Address {
    /// Returns the address that attributes of a building state; `None` where they name neither street, number nor place.
    pub fn of(attributes: &JsonMap<String, Value>) -> Option<Self> {
        let text = |name: &str| {
            let text = match attribute(attributes, name)?.as_ref() {
                Value::String(text) => text.trim().to_owned(),
                Value::Number(number) => number.to_string(),
                _ => return None,
            };
            (!text.is_empty()).then_some(text)
        };
        let address = Self {
            street: text("addr:street"),
            number: text("addr:housenumber"),
            postcode: text("addr:postcode"),
            place: text("addr:city"),
            country: text("addr:country"),
        };
        (address.street.is_some() || address.number.is_some() || address.place.is_some()).then_some(address)
    }

    /// Returns `CityJSON`'s object of it.
    pub fn to_json(&self) -> Value {
        let members = [
            ("Country", &self.country),
            ("Locality", &self.place),
            ("Postcode", &self.postcode),
            ("ThoroughfareName", &self.street),
            ("ThoroughfareNumber", &self.number),
        ];
        let known = members.into_iter().filter_map(|(name, text)| Some((name.to_owned(), text.clone()?.into())));
        Value::Object(known.collect())
    }

    /// Returns xAL 2.0's element of it, in the order of the schema.
    pub fn to_xal2(&self) -> String {
        let street = element("ThoroughfareNumber", self.number.as_deref())
            + &element("ThoroughfareName", self.street.as_deref());
        let street = within("Thoroughfare", " Type=\"Street\"", &street);
        let postcode = within("PostalCode", "", &element("PostalCodeNumber", self.postcode.as_deref()));
        let place = element("LocalityName", self.place.as_deref()) + &street + &postcode;
        let country =
            element("CountryNameCode", self.country.as_deref()) + &within("Locality", " Type=\"Town\"", &place);
        within("AddressDetails", "", &format!("<xAL:Country>{country}</xAL:Country>"))
    }

    /// Returns xAL 3.0's element of it, in the order of the schema.
    pub fn to_xal3(&self) -> String {
        let street = element("NameElement", self.street.as_deref()) + &element("Number", self.number.as_deref());
        let parts = [
            within("Country", "", &element("NameElement", self.country.as_deref())),
            within("Locality", " xAL:Type=\"Town\"", &element("NameElement", self.place.as_deref())),
            within("Thoroughfare", " xAL:Type=\"Street\"", &street),
            within("PostCode", "", &element("Identifier", self.postcode.as_deref())),
        ];
        within("Address", "", &parts.concat())
    }
}

fn element(name: &str, text: Option<&str>) -> String {
    text.map_or_else(String::new, |text| format!("<xAL:{name}>{}</xAL:{name}>", escape(text)))
}

/// An element with others in it; nothing around nothing.
fn within(name: &str, attributes: &str, inner: &str) -> String {
    match inner {
        "" => String::new(),
        _ => format!("<xAL:{name}{attributes}>{inner}</xAL:{name}>"),
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn of(attributes: &Value) -> Option<Address> {
        Address::of(attributes.as_object().unwrap())
    }

    #[test]
    fn columns_and_tags_in_openstreetmaps_names_are_an_address() {
        let columns = json!({
            "addr:street": " Am Hof ", "addr:housenumber": 7, "addr:postcode": "1010", "addr:city": "Wien", "addr:country": "AT",
        });
        let tags = json!({
            "other_tags": "\"addr:street\"=>\"Am Hof\",\"addr:housenumber\"=>\"7\",\"addr:postcode\"=>\"1010\",\
                           \"addr:city\"=>\"Wien\",\"addr:country\"=>\"AT\"",
        });
        let found = of(&columns).unwrap();
        assert_eq!(of(&tags), Some(found.clone()));
        let expected = json!({
            "Country": "AT", "Locality": "Wien", "Postcode": "1010", "ThoroughfareName": "Am Hof", "ThoroughfareNumber": "7",
        });
        assert_eq!(found.to_json(), expected);
    }

    #[test]
    fn a_postcode_alone_is_no_address_and_markup_stays_text() {
        for none in [json!({}), json!({ "addr:postcode": "1010" }), json!({ "addr:street": "  ", "street": "Am Hof" })]
        {
            assert_eq!(of(&none), None, "{none}");
        }
        let address = of(&json!({ "addr:street": "A & <B>" })).unwrap();
        assert!(address.to_xal2().contains("<xAL:ThoroughfareName>A &amp; &lt;B&gt;</xAL:ThoroughfareName>"));
        let street = "<xAL:Thoroughfare xAL:Type=\"Street\"><xAL:NameElement>A &amp; &lt;B&gt;</xAL:NameElement></xAL:Thoroughfare>";
        assert_eq!(address.to_xal3(), format!("<xAL:Address>{street}</xAL:Address>"));
    }
}
