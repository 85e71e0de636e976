//! Photo names: how the paths in a pose file become names, and how names that systems write differently compare.
//!
//! A name is the photo's file, with the folders above it where the file of the poses has them: `left/DSC00000.JPG`. Paths from
//! another place (`D:\flight\left\DSC00000.JPG`, `/mnt/flight/left/DSC00000.JPG`, `../images/left/DSC00000.JPG`, a `file:` URI) keep
//! as many of their last parts as tell all photos of the survey apart. So a name never leads out of the folder of the photos.

use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};

use icu_normalizer::ComposingNormalizerBorrowed;

use super::poses::Poses;
use sizeup_geo::issue::Subject;

/// How a format names photos.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) enum NameStyle {
    /// By a name, perhaps with folders, which is kept. Only a path that leads elsewhere is shortened.
    #[default]
    Name,
    /// By the path where the photo was: the file's name is kept, and of the folders what tells photos apart.
    Path,
}

/// The parts of a path that any system may have written, without its root, `.` and `..`.
pub(crate) fn parts(path: &str) -> Vec<&str> {
    let mut parts = Vec::new();
    for part in without_scheme(path).split(['/', '\\']) {
        match part {
            "" | "." => {}
            ".." => drop(parts.pop()),
            part => parts.push(part),
        }
    }
    // Cards of several cameras lie in several drives.
    if let Some(first) = parts.first_mut().filter(|first| is_drive(first)) {
        *first = &first[..1];
    }
    parts
}

/// Form of a part of a path in which names of different systems are equal: percent-decoded, composed (Unicode NFC), lower case.
pub(crate) fn key(part: &str) -> String {
    let decoded = percent_decoded(part);
    if decoded.is_ascii() {
        return decoded.to_ascii_lowercase();
    }
    ComposingNormalizerBorrowed::new_nfc().normalize(&decoded.to_lowercase()).into_owned()
}

/// Whether two parts of a path are equal but for the system that wrote them.
pub(crate) fn are_alike(a: &str, b: &str) -> bool {
    let is_plain = |part: &str| part.is_ascii() && !part.contains('%');
    a.eq_ignore_ascii_case(b) || (!(is_plain(a) && is_plain(b)) && key(a) == key(b))
}

fn without_scheme(path: &str) -> &str {
    path.strip_prefix("file:").unwrap_or(path)
}

fn is_drive(part: &str) -> bool {
    matches!(part.as_bytes(), [letter, b':'] if letter.is_ascii_alphabetic())
}

/// Whether a path counts from a root, or leads out of the folder that it counts from.
fn leads_elsewhere(path: &str) -> bool {
    let mut parts = without_scheme(path).split(['/', '\\']);
    let is_rooted = parts.next().is_some_and(|first| (first.is_empty() || is_drive(first)) && parts.next().is_some());
    is_rooted || path.split(['/', '\\']).any(|part| part == "..")
}

/// Text with `%20` and its like decoded; as it is where that gives no text.
fn percent_decoded(text: &str) -> Cow<'_, str> {
    if !text.contains('%') {
        return Cow::Borrowed(text);
    }
    let bytes = text.as_bytes();
    let digit = |i: usize| bytes.get(i).and_then(|byte| char::from(*byte).to_digit(16));
    let mut decoded = Vec::with_capacity(bytes.len());
    let mut i = 0;
    while i < bytes.len() {
        let coded = (bytes[i] == b'%').then(|| Some((16 * digit(i + 1)? + digit(i + 2)?) as u8)).flatten();
        decoded.push(coded.unwrap_or(bytes[i]));
        i += if coded.is_some() { 3 } else { 1 };
    }
    String::from_utf8(decoded).map_or(Cow::Borrowed(text), Cow::Owned)
}

/// A photo's name as a pose file writes it, taken apart.
enum Written<'a> {
    /// A name that is kept.
    Kept(Cow<'a, str>),
    /// The parts of a path, to be shortened.
    Path(Vec<&'a str>),
}

impl<'a> Written<'a> {
    fn of(name: &'a str, style: NameStyle) -> Self {
        let parts = parts(name);
        // What is no path at all is refused later.
        let is_path = !parts.is_empty() && !name.contains('\0');
        if is_path && (style == NameStyle::Path || leads_elsewhere(name)) {
            Self::Path(parts)
        } else if is_path && name.contains('\\') {
            Self::Kept(Cow::Owned(parts.join("/")))
        } else {
            Self::Kept(Cow::Borrowed(name))
        }
    }

    /// The name with so many parts of a path.
    fn name(&self, n_parts: usize) -> String {
        match self {
            Self::Kept(name) => name.clone().into_owned(),
            Self::Path(parts) => parts[parts.len().saturating_sub(n_parts)..].join("/"),
        }
    }
}

/// Number of last parts that paths need so that each differs from all others and from the names that are kept.
fn parts_needed(all: &[Written<'_>]) -> usize {
    let mut from_the_end: Vec<(Vec<&str>, bool)> = all
        .iter()
        .map(|written| match written {
            Written::Kept(name) => (parts(name).into_iter().rev().collect(), false),
            Written::Path(parts) => (parts.iter().rev().copied().collect(), true),
        })
        .collect();
    from_the_end.sort();
    from_the_end.dedup_by(|a, b| a.0 == b.0);
    let shared =
        from_the_end.windows(2).filter(|pair| pair[0].1 || pair[1].1).map(|pair| n_equal(&pair[0].0, &pair[1].0));
    shared.max().unwrap_or(0) + 1
}

fn n_equal(a: &[&str], b: &[&str]) -> usize {
    a.iter().zip(b).take_while(|(a, b)| a == b).count()
}

/// Names the photos of all poses and issues, and keeps what the file writes where that differs.
pub(crate) fn settle(poses: &mut Poses) {
    let style = poses.names;
    let is_settled = |name: &str| style == NameStyle::Name && !name.contains('\\') && !leads_elsewhere(name);
    let of_issues = poses.issues.iter().filter_map(|issue| match &issue.subject {
        Subject::View(name) => Some(name.as_str()),
        _ => None,
    });
    if poses.poses.iter().map(|pose| pose.name.as_str()).chain(of_issues).all(is_settled) {
        return;
    }
    let all: Vec<Written<'_>> = poses.poses.iter().map(|pose| Written::of(&pose.name, style)).collect();
    let n_parts = parts_needed(&all);
    let names: Vec<String> = all.iter().map(|written| written.name(n_parts)).collect();
    let mut written = BTreeMap::new();
    for (pose, name) in poses.poses.iter_mut().zip(names) {
        let was = std::mem::replace(&mut pose.name, name);
        written.insert(pose.name.clone(), was);
    }
    let posed: BTreeSet<String> = written.keys().cloned().collect();
    for issue in &mut poses.issues {
        let Subject::View(name) = &mut issue.subject else { continue };
        let apart = Written::of(name, style);
        let short = apart.name(n_parts);
        // A photo without a pose gives way to one that has it.
        let is_taken = posed.contains(&short) && written.get(&short) != Some(name);
        let short = if is_taken { apart.name(usize::MAX) } else { short };
        let was = std::mem::replace(name, short);
        written.entry(name.clone()).or_insert(was);
    }
    written.retain(|name, was| name != was);
    poses.written = written;
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::poses::refused;
    use crate::poses::tests::pose;

    fn named(style: NameStyle, written: &[&str]) -> Vec<String> {
        let mut poses = Poses { names: style, ..Poses::new() };
        poses.poses = written.iter().map(|name| pose(name)).collect();
        settle(&mut poses);
        poses.poses.into_iter().map(|pose| pose.name).collect()
    }

    #[test]
    fn names_stay_as_they_are_where_they_lie_below_one_folder() {
        let all = ["left/a.jpg", "right/a.jpg", "./b.jpg", "c%20d.jpg", "label", "C:e", "2: x"];
        assert_eq!(named(NameStyle::Name, &all), all);
        assert_eq!(named(NameStyle::Name, &["left\\a.jpg", ".\\b.jpg"]), ["left/a.jpg", "b.jpg"]);
        assert_eq!(named(NameStyle::Name, &["..", "a\0b"]), ["..", "a\0b"], "no names: refused later");
    }

    #[test]
    fn paths_keep_what_tells_photos_apart() {
        let rig = ["D:\\flight\\left\\1.jpg", "D:/flight/right/1.jpg", "D:/flight/right/2.jpg"];
        for style in [NameStyle::Name, NameStyle::Path] {
            assert_eq!(named(style, &rig), ["left/1.jpg", "right/1.jpg", "right/2.jpg"]);
            assert_eq!(named(style, &["/mnt/left/1.jpg", "/mnt/right/2.jpg"]), ["1.jpg", "2.jpg"]);
            assert_eq!(named(style, &["../images/x.jpg", "../../images/y.jpg"]), ["x.jpg", "y.jpg"]);
            assert_eq!(named(style, &["E:\\DCIM\\1.jpg", "F:\\DCIM\\1.jpg"]), ["E/DCIM/1.jpg", "F/DCIM/1.jpg"]);
            assert_eq!(named(style, &["/a/1.jpg", "/a/1.jpg"]), ["1.jpg", "1.jpg"], "one photo twice");
            assert_eq!(named(style, &["file:///c:/l/1.jpg", "file:///c:/r/1.jpg"]), ["l/1.jpg", "r/1.jpg"]);
        }
        assert_eq!(named(NameStyle::Path, &["left/1.jpg", "right/2.jpg"]), ["1.jpg", "2.jpg"]);
        assert_eq!(named(NameStyle::Path, &["left/day 1/1.jpg", "right/day 1/1.jpg"])[0], "left/day 1/1.jpg");
        assert_eq!(named(NameStyle::Name, &["left/1.jpg", "/mnt/right/1.jpg"]), ["left/1.jpg", "right/1.jpg"]);
        assert_eq!(named(NameStyle::Name, &["1.jpg", "/mnt/1.jpg"]), ["1.jpg", "mnt/1.jpg"]);
    }

    #[test]
    fn a_photo_without_a_pose_takes_no_name_from_one_that_has_it() {
        let mut poses = Poses { names: NameStyle::Path, ..Poses::new() };
        poses.poses = vec![pose("D:/left/1.jpg")];
        poses.issues =
            ["D:/left/1.jpg", "D:/right/1.jpg", "D:/right/2.jpg"].map(|name| refused("c", name, "")).to_vec();
        settle(&mut poses);
        let subjects: Vec<String> = poses.issues.iter().map(|issue| format!("{:?}", issue.subject)).collect();
        assert_eq!(subjects, [r#"View("1.jpg")"#, r#"View("D/right/1.jpg")"#, r#"View("2.jpg")"#]);
        assert_eq!(poses.written["1.jpg"], "D:/left/1.jpg");
        assert_eq!(poses.written["D/right/1.jpg"], "D:/right/1.jpg");
    }

    #[test]
    fn keys_of_one_name_on_different_systems_are_equal() {
        assert!(are_alike("a%20b", "A B") && are_alike("Stra\u{DF}e\u{301}", "STRA\u{DF}\u{C9}"));
        assert!(are_alike("U\u{308}ber", "\u{FC}ber") && are_alike("U%CC%88ber", "%C3%BCber"));
        assert!(!are_alike("a", "b") && are_alike("100%", "100%") && are_alike("%zz%2", "%ZZ%2"));
        assert_eq!(key("%ff"), "%ff", "no text");
    }
}
