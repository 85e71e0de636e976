//! Photo files as files: those whose data end early, and those that are there twice.
//!
//! Decoders fill up what is missing of a JPEG with grey and say little, so it is found here: a whole one has a marker of its
//! end (ITU-T T.81, B.1.1.3) behind its data, which within them cannot occur. Files behind the picture (previews of drones)
//! end the same way; only where the last bytes are others is the file gone through from its start.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, BufRead, BufReader, Read, Seek, SeekFrom};
use std::path::Path;

use rayon::prelude::*;

use super::View;
use sizeup_geo::issue::{Issue, Severity, Subject};

/// Read ahead of a photo that is gone through, bytes.
const BUFFER: usize = 1 << 16;
/// Zero bytes that writers leave behind the end, at most.
const PADDING: u64 = 4096;
/// Bytes from the middle of a file that tell most photos of one length apart.
const SAMPLE: u64 = 1 << 14;

/// Takes photos whose data end early from their views, and names them and those that are there twice.
pub(super) fn check(views: &mut [View]) -> Vec<Issue> {
    let mut issues: Vec<Issue> = views.par_iter_mut().filter_map(cut_short).collect();
    issues.extend(duplicates(views));
    issues
}

fn cut_short(view: &mut View) -> Option<Issue> {
    // What cannot be read at all is told when it is wanted.
    let path = view.image.as_deref().filter(|path| ends_early(path).unwrap_or(false))?;
    let message = format!("the data of {} end early: it is not looked at", path.display());
    view.image = None;
    let issue = Issue::new(Severity::Refused, "photo_cut_short", Subject::View(view.id.0.clone()), message);
    Some(issue.hint("copy it again from where it comes from"))
}

/// Whether a JPEG has no end.
fn ends_early(path: &Path) -> io::Result<bool> {
    let mut file = File::open(path)?;
    let length = file.seek(SeekFrom::End(0))?;
    let is_named_jpeg =
        path.extension().is_some_and(|e| e.eq_ignore_ascii_case("jpg") || e.eq_ignore_ascii_case("jpeg"));
    if length < 4 {
        return Ok(is_named_jpeg);
    }
    let mut start = [0; 2];
    file.rewind()?;
    file.read_exact(&mut start)?;
    if start != [0xFF, 0xD8] {
        return Ok(false);
    }
    let mut tail = Vec::new();
    file.seek(SeekFrom::Start(length.saturating_sub(PADDING)))?;
    file.by_ref().take(PADDING).read_to_end(&mut tail)?;
    let end = tail.iter().rposition(|byte| *byte != 0).map_or(0, |last| last + 1);
    if tail[..end].ends_with(&[0xFF, 0xD9]) {
        return Ok(false);
    }
    file.seek(SeekFrom::Start(2))?;
    match goes_to_its_end(&mut BufReader::with_capacity(BUFFER, file)) {
        Err(e) if e.kind() == io::ErrorKind::UnexpectedEof => Ok(true),
        // What is garbled is for the decoder to tell.
        outcome => outcome.map(|()| false),
    }
}

/// Goes from segment to segment until the end is marked.
fn goes_to_its_end(reader: &mut (impl BufRead + Seek)) -> io::Result<()> {
    loop {
        let marker = next_marker(reader)?;
        match marker {
            0xD9 => return Ok(()),
            // Restarts, stuffed and fill bytes belong to the data; a start has no content.
            0x00 | 0x01 | 0xD0..=0xD8 | 0xFF => {}
            _ => {
                let mut length = [0; 2];
                reader.read_exact(&mut length)?;
                let n_skipped = u64::from(u16::from_be_bytes(length).saturating_sub(2));
                if io::copy(&mut reader.take(n_skipped), &mut io::sink())? < n_skipped {
                    return Err(io::ErrorKind::UnexpectedEof.into());
                }
            }
        }
    }
}

/// The byte behind the next FF.
fn next_marker(reader: &mut impl BufRead) -> io::Result<u8> {
    let mut byte = [0xFF];
    reader.skip_until(0xFF)?;
    while byte[0] == 0xFF {
        reader.read_exact(&mut byte)?;
    }
    Ok(byte[0])
}

/// Photos of different views with the same bytes.
fn duplicates(views: &[View]) -> Vec<Issue> {
    let photo = |view: &View| {
        let path = view.image.clone()?;
        let length = path.metadata().ok()?.len();
        (length > 0).then_some((length, path))
    };
    let mut by_length: BTreeMap<u64, Vec<usize>> = BTreeMap::new();
    let photos: Vec<_> = views.par_iter().map(photo).collect();
    for (i, photo) in photos.iter().enumerate() {
        if let Some((length, _)) = photo {
            by_length.entry(*length).or_default().push(i);
        }
    }
    let path_of = |i: usize| photos[i].as_ref().map(|(_, path)| path.as_path());
    let groups: Vec<Vec<usize>> = by_length.into_values().filter(|group| group.len() > 1).collect();
    let same = groups.par_iter().flat_map_iter(|group| {
        let mut by_sample: BTreeMap<Vec<u8>, Vec<usize>> = BTreeMap::new();
        for &i in group {
            if let Some(sample) = path_of(i).and_then(|path| sample(path).ok()) {
                by_sample.entry(sample).or_default().push(i);
            }
        }
        by_sample.into_values().flat_map(|alike| {
            let first = alike[0];
            let is_same =
                move |i: &usize| path_of(first).zip(path_of(*i)).is_some_and(|(a, b)| are_same(a, b).unwrap_or(false));
            alike.into_iter().skip(1).filter(is_same).map(move |i| (first, i)).collect::<Vec<_>>()
        })
    });
    let mut same: Vec<(usize, usize)> = same.collect();
    same.sort_unstable();
    same.into_iter()
        .map(|(first, again)| {
            let message = format!("its photo is that of {}, byte for byte", views[first].id);
            let subject = Subject::View(views[again].id.0.clone());
            Issue::new(Severity::Warning, "duplicate_photo", subject, message)
                .hint("one of the two is the wrong photo, or was copied under a second name: take it out")
        })
        .collect()
}

fn sample(path: &Path) -> io::Result<Vec<u8>> {
    let mut file = File::open(path)?;
    let length = file.seek(SeekFrom::End(0))?;
    file.seek(SeekFrom::Start(length.saturating_sub(SAMPLE) / 2))?;
    let mut sample = Vec::new();
    file.take(SAMPLE).read_to_end(&mut sample)?;
    Ok(sample)
}

fn are_same(a: &Path, b: &Path) -> io::Result<bool> {
    let open = |path| File::open(path).map(|file| BufReader::with_capacity(BUFFER, file));
    let (mut a, mut b) = (open(a)?, open(b)?);
    loop {
        let (left, right) = (a.fill_buf()?, b.fill_buf()?);
        let n = left.len().min(right.len());
        if n == 0 {
            return Ok(left.is_empty() && right.is_empty());
        }
        if left[..n] != right[..n] {
            return Ok(false);
        }
        a.consume(n);
        b.consume(n);
    }
}

#[cfg(test)]
mod tests {
    use image::codecs::jpeg::JpegEncoder;

    use super::*;

    /// A photo of 64 × 48 pixels of noise.
    fn jpeg(seed: u32) -> Vec<u8> {
        let mut state = seed;
        let mut noise = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 24) as u8
        };
        let pixels: Vec<u8> = (0..64 * 48 * 3).map(|_| noise()).collect();
        let mut bytes = Vec::new();
        JpegEncoder::new(&mut bytes).encode(&pixels, 64, 48, image::ExtendedColorType::Rgb8).unwrap();
        bytes
    }

    fn is_cut(bytes: &[u8]) -> bool {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.jpg");
        std::fs::write(&path, bytes).unwrap();
        ends_early(&path).unwrap()
    }

    #[test]
    fn a_photo_is_whole_or_cut_short_wherever_it_was_cut() {
        let whole = jpeg(1);
        assert!(!is_cut(&whole));
        for n in (0..whole.len()).rev().step_by(97).chain([whole.len() - 1]) {
            assert!(is_cut(&whole[..n]), "cut to {n} of {} bytes", whole.len());
        }
        let preview = [whole.clone(), jpeg(2)].concat();
        assert!(!is_cut(&preview), "a preview behind it");
        assert!(!is_cut(&preview[..preview.len() - 100]), "only the preview is cut");
        assert!(!is_cut(&[&whole[..], &[0; 900]].concat()), "padding behind it");
        assert!(is_cut(&[&whole[..whole.len() / 2], &[0; 9000]].concat()), "as a copy that broke off leaves it");
        assert!(!is_cut(b"no JPEG at all"));
    }
}
