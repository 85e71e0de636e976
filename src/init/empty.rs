//! Why there are no poses in a folder, and what to do about it.

use super::InitError;
use super::folder::Inventory;
use super::poses::Passed;
use sizeup_survey::PhotoFacts;

/// Pictures with a longer side of at most this are thumbnails where they say nothing of themselves, pixels.
const THUMBNAIL_PX: u32 = 320;
/// Remedy for photos without poses.
const ALIGN_THEM: &str = "compute poses with photogrammetry (OpenDroneMap, COLMAP, Metashape, Pix4D, …), put its result into the folder, \
                          and run this again; photos of drones bring poses only with the XMP that the drone wrote, which messengers and editors \
                          drop: `sizeup survey inspect` names the tags that they have";

/// Why nothing in a folder has a pose.
pub(super) fn why(inventory: &Inventory, facts: &[PhotoFacts], passed: &[Passed]) -> InitError {
    let path = inventory.root.clone();
    let none = |found: String, hint| InitError::NoPhotos { path: path.clone(), found, hint };
    if let Some(first) = passed.first() {
        let found = format!("{} ({}), which cannot be read: {}", first.path.display(), first.format, first.why);
        let hint = "`sizeup survey inspect` with its options reads what has to be declared, such as a table's columns and camera";
        return InitError::NoPoses { path, found, hint: hint.to_owned() };
    }
    let n_videos = inventory.n_videos;
    if facts.is_empty() && n_videos > 0 {
        let found = format!("{n_videos} {} and no photos", if n_videos == 1 { "video" } else { "videos" });
        return none(
            found,
            "videos have no poses: take single photos, or cut the video into photos and compute their poses",
        );
    }
    if facts.is_empty() {
        let found = match inventory.n_files {
            0 => "an empty folder".to_owned(),
            n => format!("{n} other files"),
        };
        return none(found, "is it the right folder? Photos are looked for in it and three levels below");
    }
    let is_thumbnail = |photo: &PhotoFacts| {
        photo.place_deg.is_none() && photo.size_px.is_some_and(|(width, height)| width.max(height) <= THUMBNAIL_PX)
    };
    if facts.iter().all(is_thumbnail) {
        let found = format!("only thumbnails ({}, of up to {THUMBNAIL_PX} pixels)", facts.len());
        return none(found, "copy the photos themselves from the drone's card");
    }
    let n = facts.len();
    let n_unreadable = facts.iter().filter(|photo| photo.fault.is_some()).count();
    let n_placed = facts.iter().filter(|photo| photo.place_deg.is_some()).count();
    let found = match n_placed {
        0 => format!("{n} photos without position and direction in their metadata"),
        _ => format!("{n} photos, {n_placed} of them with a position, none with a direction of view"),
    };
    let first = facts.iter().find_map(|photo| photo.fault.as_deref());
    let found = match first {
        Some(first) => format!("{found}; {n_unreadable} cannot be read, the first: {first}"),
        None => found,
    };
    InitError::NoPoses { path, found, hint: ALIGN_THEM.to_owned() }
}
