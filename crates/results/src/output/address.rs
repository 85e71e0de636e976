//! Addresses of buildings, from attributes in `OpenStreetMap`'s names (<https://wiki.openstreetmap.org/wiki/Key:addr:*>).
//!
//! | attribute | CityJSON | xAL in `CityGML` |
//! |---|---|---|
//! | `addr:street` | `ThoroughfareName` | `ThoroughfareName` |
//! | `addr:housenumber` | `ThoroughfareNumber` | `ThoroughfareNumber` |
//! | `addr:postcode` | `Postcode` | `PostalCodeNumber` |
//! | `addr:city` | `Locality` | `LocalityName` |
//! | `addr:country` | `Country` | `CountryNameCode` |

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

    /// Returns `CityGML`'s element of it, in the order of xAL 2.0.
    pub fn to_gml(&self) -> String {
        let element = |name: &str, text: &Option<String>| {
            text.as_ref().map_or_else(String::new, |text| format!("<xAL:{name}>{}</xAL:{name}>", escape(text)))
        };
        let within = |name: &str, kind: &str, inner: &str| match inner {
            "" => String::new(),
            _ => format!("<xAL:{name}{kind}>{inner}</xAL:{name}>"),
        };
        let street = element("ThoroughfareNumber", &self.number) + &element("ThoroughfareName", &self.street);
        let street = within("Thoroughfare", " Type=\"Street\"", &street);
        let postcode = within("PostalCode", "", &element("PostalCodeNumber", &self.postcode));
        let place = element("LocalityName", &self.place) + &street + &postcode;
        let country = element("CountryNameCode", &self.country) + &within("Locality", " Type=\"Town\"", &place);
        format!(
            "<bldg:address><core:Address><core:xalAddress><xAL:AddressDetails><xAL:Country>{country}</xAL:Country>\
             </xAL:AddressDetails></core:xalAddress></core:Address></bldg:address>"
        )
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
        let gml = of(&json!({ "addr:street": "A & <B>" })).unwrap().to_gml();
        assert!(gml.contains("<xAL:ThoroughfareName>A &amp; &lt;B&gt;</xAL:ThoroughfareName>"), "{gml}");
    }
}
