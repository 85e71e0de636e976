//! Putting pages together: templates, escaping, and a policy that lets a page run its own script and nothing else.

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use sha2::{Digest as _, Sha256};

const REPORT: &str = include_str!("page/report.html");
const VIEW: &str = include_str!("page/view.html");
/// Inside of both pages' head, and the picture with what lies over it.
const HEAD: &str = include_str!("page/head.html");
const STAGE: &str = include_str!("page/stage.html");
const STYLE: &str = include_str!("page/style.css");

/// Scripts that both pages share, then those of each; all of a page make one closed scope.
const SHARED: [&str; 15] = [
    "const HEIGHT_CLASSES =",
    include_str!("../output/height_classes.json"),
    ";",
    include_str!("page/maths.js"),
    include_str!("page/dom.js"),
    include_str!("page/colours.js"),
    include_str!("page/doubt.js"),
    include_str!("page/mesh.js"),
    include_str!("page/glb.js"),
    include_str!("page/shaders.js"),
    include_str!("page/gpu.js"),
    include_str!("page/pace.js"),
    include_str!("page/scene.js"),
    include_str!("page/orbit.js"),
    include_str!("page/panel.js"),
];
const OF_REPORT: [&str; 7] = [
    include_str!("page/sight.js"),
    include_str!("page/charts.js"),
    include_str!("page/map.js"),
    include_str!("page/layers.js"),
    include_str!("page/building.js"),
    include_str!("page/sections.js"),
    include_str!("page/report.js"),
];
const OF_VIEW: [&str; 2] = [include_str!("page/tileset.js"), include_str!("page/view.js")];

/// Keys that only the report has.
const KEYS_OF_REPORT: &str = "N and P go to the next and the previous building, ";

/// Tags before and behind the textures in the report.
const AROUND_TEXTURES: [&str; 2] = ["<script type=\"application/json\" id=\"textured\">", "</script>"];

/// A report with other textures, JSON; `None` where it has no place for them.
pub fn retextured(html: &str, textured: &str) -> Option<String> {
    let [before, behind] = AROUND_TEXTURES;
    let start = html.find(before)? + before.len();
    let end = start + html[start..].find(behind)?;
    Some([&html[..start], &escape_json(textured), &html[end..]].concat())
}

/// The report with its data and its textures, JSON.
pub fn report(title: &str, data: &str, textured: &str) -> String {
    let script = script(&OF_REPORT);
    let parts = [
        ("head", head(&format!("sizeup: {title}"), &script, "")),
        ("heading", escape(title)),
        ("stage", fill(STAGE, &[("keys", KEYS_OF_REPORT.to_owned())])),
        ("data", escape_json(data)),
        ("textured", escape_json(textured)),
        ("script", script),
    ];
    fill(REPORT, &parts)
}

/// The page that streams tiles from where it was loaded.
pub fn view(title: &str) -> String {
    let script = script(&OF_VIEW);
    let parts = [
        ("head", head(&format!("sizeup view: {title}"), &script, "; connect-src 'self'")),
        ("heading", escape(title)),
        ("stage", fill(STAGE, &[("keys", String::new())])),
        ("script", script),
    ];
    fill(VIEW, &parts)
}

fn head(title: &str, script: &str, more_policy: &str) -> String {
    let policy = escape(&policy(script, more_policy));
    fill(HEAD, &[("policy", policy), ("title", escape(title)), ("style", STYLE.to_owned())])
}

fn script(parts: &[&str]) -> String {
    let all: Vec<&str> = SHARED.iter().chain(parts).copied().collect();
    format!("\"use strict\";\n(() => {{\n{}}})();\n", all.join("\n"))
}

fn policy(script: &str, more: &str) -> String {
    format!(
        "default-src 'none'; script-src '{}'; style-src '{}'; img-src data:; base-uri 'none'; form-action 'none'{more}",
        hash(script),
        hash(STYLE)
    )
}

/// A hash as a content security policy names it.
fn hash(text: &str) -> String {
    format!("sha256-{}", STANDARD.encode(Sha256::digest(text.as_bytes())))
}

/// Puts values in place of `{{name}}`, in one go: what looks like a placeholder within a value stays as it is.
fn fill(template: &str, values: &[(&str, String)]) -> String {
    let mut page = String::with_capacity(template.len() + values.iter().map(|(_, v)| v.len()).sum::<usize>());
    let mut rest = template;
    while let Some((text, after)) = rest.split_once("{{") {
        let (name, after) = after.split_once("}}").expect("the templates' placeholders are closed");
        let value = values.iter().find(|(known, _)| *known == name).expect("the templates' placeholders are known");
        page.push_str(text);
        page.push_str(&value.1);
        rest = after;
    }
    page.push_str(rest);
    page
}

/// Text that stays text in HTML, attributes included.
fn escape(text: &str) -> String {
    text.chars().fold(String::with_capacity(text.len()), |mut escaped, c| {
        match c {
            '&' => escaped.push_str("&amp;"),
            '<' => escaped.push_str("&lt;"),
            '>' => escaped.push_str("&gt;"),
            '"' => escaped.push_str("&quot;"),
            '\'' => escaped.push_str("&#39;"),
            _ => escaped.push(c),
        }
        escaped
    })
}

/// JSON in which no element of HTML begins or ends: the characters occur within strings only, and strings may escape
/// any character.
fn escape_json(json: &str) -> String {
    json.replace('&', "\\u0026").replace('<', "\\u003c").replace('>', "\\u003e")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn data_cannot_end_its_block_and_reads_back_the_same() {
        let hostile = "</script><!--<script>alert(1)</script> {{script}} & \u{2028}";
        let json = serde_json::to_string(hostile).unwrap();
        let escaped = escape_json(&json);
        assert!(!escaped.contains('<') && !escaped.contains('>'));
        assert_eq!(serde_json::from_str::<String>(&escaped).unwrap(), hostile);
        let page = report("a <b> & 'c'", &json, "null");
        assert_eq!(page.matches("</script>").count(), REPORT.matches("</script>").count());
        assert!(page.contains("<title>sizeup: a &lt;b&gt; &amp; &#39;c&#39;</title>"));
        assert!(page.contains(r"{{script}} \u0026"));
    }

    #[test]
    fn textures_are_exchanged_and_nothing_else_whatever_the_data_holds() {
        let hostile = serde_json::to_string(AROUND_TEXTURES.concat().as_str()).unwrap();
        let page = |textured: &str| report("t", &hostile, textured);
        assert_eq!(retextured(&page("null"), &hostile).unwrap(), page(&hostile));
        assert_eq!(retextured(&page(&hostile), "null").unwrap(), page("null"));
        assert_eq!(retextured(&view("t"), "null"), None);
    }

    #[test]
    fn the_policy_names_the_script_and_the_style_as_they_stand_in_the_page() {
        for page in [report("t", "{}", "null"), view("t")] {
            let between = |from: &str, to: &str| page.split_once(from).unwrap().1.split_once(to).unwrap().0.to_owned();
            assert!(page.contains(&escape(&hash(&between("<style>", "</style>")))));
            assert!(page.contains(&escape(&hash(&between("<script>", "</script>")))));
            assert!(!page.contains("unsafe-"));
        }
    }

    #[test]
    fn the_scripts_write_no_markup_and_load_nothing() {
        for script in [script(&OF_REPORT), script(&["", ""])] {
            for word in ["innerHTML", "outerHTML", "insertAdjacentHTML", "document.write", "eval(", "import("] {
                assert!(!script.contains(word), "{word}");
            }
        }
        assert!(!script(&OF_REPORT).contains("fetch("));
    }
}
