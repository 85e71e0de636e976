//! Names of units of length, as files write them.

/// Metres per international foot.
pub const FOOT_M: f64 = 0.3048;
/// Metres per US survey foot.
pub const US_SURVEY_FOOT_M: f64 = 1200.0 / 3937.0;

/// Metres per unit of a name such as `metre`, `ft`, `US survey foot` or `us-ft`; `None` for other names. Case, blanks and signs do
/// not count.
#[must_use]
pub fn metres_per(name: &str) -> Option<f64> {
    let letters: String = name.chars().filter(char::is_ascii_alphanumeric).collect();
    Some(match letters.to_ascii_lowercase().as_str() {
        "m" | "metre" | "metres" | "meter" | "meters" => 1.0,
        "mm" | "millimetre" | "millimetres" | "millimeter" | "millimeters" => 0.001,
        "cm" | "centimetre" | "centimetres" | "centimeter" | "centimeters" => 0.01,
        "dm" | "decimetre" | "decimetres" | "decimeter" | "decimeters" => 0.1,
        "ft" | "foot" | "feet" | "ftint" | "intft" | "internationalfoot" | "internationalfeet"
        | "footinternational" => FOOT_M,
        "usft" | "ftus" | "usfoot" | "usfeet" | "footus" | "feetus" | "usftus" | "surveyfoot" | "surveyfeet"
        | "ussurveyfoot" | "ussurveyfeet" | "ussurveyft" | "footussurvey" | "sft" => US_SURVEY_FOOT_M,
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_units_are_known_as_programs_write_them() {
        for name in ["m", "metre", "Meters", "METRE"] {
            assert_eq!(metres_per(name), Some(1.0), "{name}");
        }
        for name in ["ft", "foot", "Feet", "International foot", "int-ft", "foot (international)"] {
            assert_eq!(metres_per(name), Some(FOOT_M), "{name}");
        }
        for name in ["us-ft", "US survey foot", "Foot_US", "ftUS", "U.S. Survey Feet", "Survey foot"] {
            assert_eq!(metres_per(name), Some(US_SURVEY_FOOT_M), "{name}");
        }
        for name in ["", "yd", "unknown", "m/s", "degree"] {
            assert_eq!(metres_per(name), None, "{name}");
        }
    }
}
