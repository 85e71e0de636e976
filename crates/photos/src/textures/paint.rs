//! The colours of a surface, texel by texel.
//!
//! Which photo paints a cell is decided by the means over cells, so that noise and errors of a pixel change nothing: the
//! surface's photo where it shows the cell clearly and agrees with the median of those that do, else the next one. Between the
//! middles of cells the weights of photos are interpolated, which hides the seams. Texels of cells that no photo shows are
//! filled from those around them, by ever coarser means.
//!
//! Below its upper edge, where the roof's level is uncertain, a wall keeps the photo's colours up to the first texel that differs from the wall
//! below ([`eave`]).

use image::{Rgb, RgbImage};

use super::chart::Chart;
use super::views::{Candidate, Colours, Shown};
use super::{Choice, TexturedArea, eave};

/// Largest difference of a cell's mean from the median of the photos, of 255, at which a photo still shows the surface.
pub(super) const AGREES_WITHIN: f32 = 24.0;
/// Fewest photos of which a median tells who is wrong.
pub(super) const LEAST_PHOTOS: usize = 3;
/// Share of a wall's height that may be left out below its eave, at most.
const MOST_EAVE: f32 = 0.25;

/// Photos of a surface.
pub(super) struct Palette<'a> {
    pub candidates: &'a [Candidate],
    /// Colours of each.
    pub colours: &'a [Colours],
    /// Position of the surface's own photo.
    pub first: usize,
    /// Gains of all views.
    pub gains: &'a [f32],
    /// So far below the upper edge a wall may show the roof, metres; `None` for roofs.
    pub eave_m: Option<f64>,
}

/// A painted surface.
#[derive(Debug)]
pub(super) struct Painted {
    /// Empty once it is on a page.
    pub picture: RgbImage,
    /// Mean colour of what is seen.
    pub mean: [f32; 3],
    /// View whose photo paints most of it.
    pub photo: usize,
    /// Texels on the surface that a photo paints, and those that are filled; without party walls.
    pub n_seen: u32,
    pub n_filled: u32,
}

/// Paints a surface; `None` where no photo shows a cell of it.
pub(super) fn paint(chart: &Chart, palette: &Palette<'_>, choice: Choice) -> Option<Painted> {
    let painters: Vec<Option<usize>> =
        (0..chart.cells.len()).map(|cell| painter(chart, palette, cell, choice)).collect();
    let (mut picture, mut known) =
        (RgbImage::new(chart.size.x, chart.size.y), vec![false; (chart.size.x * chart.size.y) as usize]);
    let eave_px = palette.eave_m.filter(|_| choice == Choice::Agreeing).map_or(0, |eave_m| {
        let most = MOST_EAVE * (chart.size.y - 2 * super::chart::GUTTER_PX) as f32;
        // A texel at least: what the photo's own pixel mixes.
        (eave_m as f32 / chart.texel_m).ceil().max(1.0).min(most) as u32
    });
    for cell in 0..chart.cells.len() as u32 {
        for (x, y) in chart.texels_of(cell).filter(|(x, y)| chart.is_inside(*x, *y)) {
            if painters[cell as usize].is_some() {
                let colour = colour(chart, palette, &painters, (x, y), choice);
                picture.put_pixel(x, y, Rgb(colour.map(|v| (v + 0.5) as u8)));
                known[(y * chart.size.x + x) as usize] = true;
            }
        }
    }
    if eave_px > 0 {
        eave::clear(chart, &picture, &mut known, eave_px);
    }
    let (mut sum, mut n_seen, mut n_filled) = ([0.0_f64; 3], 0_u32, 0_u32);
    let mut n_by = vec![0_u32; palette.candidates.len()];
    for cell in 0..chart.cells.len() as u32 {
        let of = &chart.cells[cell as usize];
        for (x, y) in chart.texels_of(cell).filter(|(x, y)| chart.is_inside(*x, *y)) {
            let is_known = known[(y * chart.size.x + x) as usize];
            let Some(painter) = painters[cell as usize].filter(|_| is_known) else {
                n_filled += u32::from(!of.is_party);
                continue;
            };
            n_seen += 1;
            n_by[painter] += 1;
            let colour = picture.get_pixel(x, y).0;
            colour.iter().zip(&mut sum).for_each(|(v, sum)| *sum += f64::from(*v));
        }
    }
    if n_seen == 0 {
        return None;
    }
    fill_unknown(&mut picture, &known);
    let most = (0..n_by.len()).max_by_key(|&k| (n_by[k], std::cmp::Reverse(k)))?;
    let mean = sum.map(|v| (v / f64::from(n_seen)) as f32);
    Some(Painted { picture, mean, photo: palette.candidates[most].view, n_seen, n_filled })
}

/// Position of the photo that paints a cell.
fn painter(chart: &Chart, palette: &Palette<'_>, cell: usize, choice: Choice) -> Option<usize> {
    if chart.cells[cell].n_texels == 0 {
        return None;
    }
    let candidates = palette.candidates;
    // The surface's own photo, then by what they are worth here.
    let mut order: Vec<usize> = (0..candidates.len()).collect();
    let worth: Vec<f32> = candidates.iter().map(|candidate| candidate.cell_worth(chart, cell)).collect();
    order.sort_by(|a, b| worth[*b].total_cmp(&worth[*a]).then(a.cmp(b)));
    order.sort_by_key(|k| *k != palette.first);
    let own_first = || order.iter().copied();
    let shows = |shown: Shown| own_first().filter(move |&k| candidates.get(k).is_some_and(|c| c.shown[cell] == shown));
    if choice == Choice::BestPerSurface {
        return own_first().next().filter(|&k| candidates.get(k).is_some_and(|c| c.shown[cell] != Shown::Hidden));
    }
    let mean = |k: usize| (k, palette.colours[k].means[cell].map(|v| v * palette.gains[candidates[k].view]));
    let clear: Vec<(usize, [f32; 3])> = shows(Shown::Clear).map(mean).collect();
    if clear.len() < LEAST_PHOTOS {
        return clear.first().map(|(k, _)| *k).or_else(|| shows(Shown::Beside).next());
    }
    let median = median(&clear.iter().map(|(_, mean)| *mean).collect::<Vec<_>>());
    let off = |mean: &[f32; 3]| difference(mean, &median);
    let agreeing = clear.iter().find(|(_, mean)| off(mean) <= AGREES_WITHIN);
    let nearest = || clear.iter().min_by(|(_, a), (_, b)| off(a).total_cmp(&off(b)));
    agreeing.or_else(nearest).map(|(k, _)| *k)
}

/// Median of some colours, at least one, channel by channel.
pub(super) fn median(colours: &[[f32; 3]]) -> [f32; 3] {
    std::array::from_fn(|c| {
        let mut values: Vec<f32> = colours.iter().map(|colour| colour[c]).collect();
        values.sort_unstable_by(f32::total_cmp);
        f32::midpoint(values[(values.len() - 1) / 2], values[values.len() / 2])
    })
}

/// Largest difference of two colours over the channels.
pub(super) fn difference(a: &[f32; 3], b: &[f32; 3]) -> f32 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}

/// Colour of a texel: of the photos of the four cells around it, by how near their middles are.
fn colour(
    chart: &Chart,
    palette: &Palette<'_>,
    painters: &[Option<usize>],
    (x, y): (u32, u32),
    choice: Choice,
) -> [f32; 3] {
    let n = chart.cell_px as f32;
    let (cx, cy) = (x / chart.cell_px, y / chart.cell_px);
    let own = painters[(cy * chart.cells_size.x + cx) as usize];
    let of = |k: usize| {
        let gain = palette.gains[palette.candidates[k].view];
        palette.colours[k].at(chart, (x, y)).map(|v| f32::from(v) * gain)
    };
    let (mut sum, mut total) = ([0.0_f32; 3], 0.0_f32);
    let mut add = |painter: Option<usize>, weight: f32| {
        if let Some(colour) = painter.map(of) {
            total += weight;
            sum.iter_mut().zip(colour).for_each(|(sum, v)| *sum += weight * v);
        }
    };
    if choice == Choice::BestPerSurface {
        add(own, 1.0);
    } else {
        // Shares of the way from the middle of the own cell to those beside it.
        let off = |at: u32, cell: u32| ((at as f32 + 0.5) / n - cell as f32 - 0.5).clamp(-0.5, 0.5);
        let (dx, dy) = (off(x, cx), off(y, cy));
        let beside = |dx: f32, at: u32, end: u32| match dx {
            _ if dx < 0.0 => at.checked_sub(1),
            _ => Some(at + 1).filter(|at| *at < end),
        };
        let (nx, ny) = (beside(dx, cx, chart.cells_size.x), beside(dy, cy, chart.cells_size.y));
        let at = |x: Option<u32>, y: Option<u32>| painters[(y? * chart.cells_size.x + x?) as usize];
        let around = [at(nx, Some(cy)), at(Some(cx), ny), at(nx, ny)];
        if around.iter().all(|painter| *painter == own) {
            return own.map_or([0.0; 3], |k| of(k).map(|v| v.min(255.0)));
        }
        let (wx, wy) = (dx.abs(), dy.abs());
        add(own, (1.0 - wx) * (1.0 - wy));
        add(around[0], wx * (1.0 - wy));
        add(around[1], (1.0 - wx) * wy);
        add(around[2], wx * wy);
    }
    sum.map(|v| (v / total.max(f32::MIN_POSITIVE)).min(255.0))
}

/// Gives texels without a colour one of those around: the picture is halved, means over known texels, until all of it is
/// known; what is not known is then taken from the next coarser one.
pub fn fill_unknown(picture: &mut RgbImage, known: &[bool]) {
    let (width, height) = (picture.width() as usize, picture.height() as usize);
    let is_whole = |known: &[bool]| known.len() <= 1 || known.iter().all(|known| *known);
    if is_whole(known) {
        return;
    }
    let pixels = picture.as_raw().as_chunks::<3>().0;
    let mut coarser = vec![Coarse::of((width, height), known, |at| pixels[at].map(f32::from))];
    while let Some(last) = coarser.last().filter(|last| !is_whole(&last.known)) {
        let height = last.known.len() / last.width;
        coarser.push(Coarse::of((last.width, height), &last.known, |at| last.colours[at]));
    }
    for i in (1..coarser.len()).rev() {
        let (finer, coarse) = coarser.split_at_mut(i);
        let Coarse { width, colours, known } = &mut finer[i - 1];
        for at in (0..known.len()).filter(|&at| !known[at]) {
            colours[at] = coarse[0].between(at % *width, at / *width);
        }
    }
    for at in (0..known.len()).filter(|&at| !known[at]) {
        let (x, y) = (at % width, at / width);
        let colour = coarser[0].between(x, y).map(|v| (v + 0.5) as u8);
        picture.put_pixel(x as u32, y as u32, Rgb(colour));
    }
}

/// A picture at half the size of a finer one, whose colours are means over known texels.
struct Coarse {
    width: usize,
    colours: Vec<[f32; 3]>,
    known: Vec<bool>,
}

impl Coarse {
    /// Half of a picture.
    fn of((width, height): (usize, usize), known: &[bool], colour: impl Fn(usize) -> [f32; 3]) -> Self {
        let (w, h) = (width.div_ceil(2), height.div_ceil(2));
        let mean = |i: usize| {
            let (x, y) = (i % w * 2, i / w * 2);
            let four = [(x, y), (x + 1, y), (x, y + 1), (x + 1, y + 1)];
            let of = four.into_iter().filter(|(x, y)| *x < width && *y < height).map(|(x, y)| y * width + x);
            let (n, sum) = of.filter(|at| known[*at]).fold((0.0_f32, [0.0_f32; 3]), |(n, sum), at| {
                let colour = colour(at);
                (n + 1.0, std::array::from_fn(|c| sum[c] + colour[c]))
            });
            (sum.map(|v| v / n.max(1.0)), n > 0.0)
        };
        let (colours, known) = (0..w * h).map(mean).unzip();
        Self { width: w, colours, known }
    }

    /// Colour at a texel of the finer picture; bilinear, so that no squares are seen.
    fn between(&self, x: usize, y: usize) -> [f32; 3] {
        let height = self.colours.len() / self.width;
        let (x, y) = (x as f32 / 2.0 - 0.25, y as f32 / 2.0 - 0.25);
        let (x, y) = (x.clamp(0.0, self.width as f32 - 1.0), y.clamp(0.0, height as f32 - 1.0));
        let (col, row) = (x as usize, y as usize);
        let (right, below) = ((col + 1).min(self.width - 1), (row + 1).min(height - 1));
        let (fx, fy) = (x.fract(), y.fract());
        let of = |col: usize, row: usize, c: usize| self.colours[row * self.width + col][c];
        std::array::from_fn(|c| {
            let (a, b) = (of(col, row, c), of(col, below, c));
            let (a, b) = (a + (of(right, row, c) - a) * fx, b + (of(right, below, c) - b) * fx);
            a + (b - a) * fy
        })
    }
}

/// Areas of a surface by where its colours come from.
pub(super) fn areas(chart: &Chart, painted: Option<&Painted>) -> TexturedArea {
    let texel_m2 = f64::from(chart.texel_m).powi(2);
    let n = |is_party: bool| chart.cells.iter().filter(|c| c.is_party == is_party).map(|c| c.n_texels).sum::<u32>();
    let m2 = |n: u32| f64::from(n) * texel_m2;
    let (n_seen, n_filled) = painted.map_or((0, 0), |painted| (painted.n_seen, painted.n_filled));
    TexturedArea {
        seen_m2: m2(n_seen),
        filled_m2: m2(n_filled),
        plain_m2: if painted.is_some() { 0.0 } else { m2(n(false)) },
        party_m2: m2(n(true)),
    }
}
