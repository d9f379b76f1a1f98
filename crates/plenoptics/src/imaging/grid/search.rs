//! From a frame to its grid, with nothing known or with a grid that nearly fits.

mod canonical;

use super::demodulate::{Demodulator, Lens};
use super::fit::{DEGREE_MAX, Fit, Model, monomial_count};
use super::frame::Frame;
use super::harmonics::Harmonics;
use super::nodes::suspects;
use super::phases::Phases;
use super::profile::{Effort, Known, matched_best};
use super::spectrum::{Candidate, candidates, central_part};
use super::{Distortion, Grid, GridError, GridOptions, GridSigma, LensResidual, MicroImage, reciprocal};
use crate::imaging::vignetting::Vignetting;
use crate::optics::ArrayKind;
use crate::raw::RawImage;
use canonical::{canonical, symmetry};

/// Least coherence of a frame's lattice phases for a grid to be found in it. Chequered boards come down to 0.6 in the
/// referee frames, other textures stay above 0.9.
const COHERENCE_LEAST: f64 = 0.45;
/// Least coherence for a known grid to be fitted: a chequered board under a hexagonal array comes down to 0.4.
const COHERENCE_KNOWN_LEAST: f64 = 0.3;
/// Coherence of the phases in the frame's middle below which a lattice is none. That of a true one, from its peaks in the
/// spectrum alone, is several times as much.
const HOPELESS: f64 = 0.15;
/// Nearer to a known grid than this, in pitches, nothing was found elsewhere.
const STAYS: f64 = 0.02;
/// A quarter of a pitch beside a grid's place, the white frame's profile is off by so many times as much as in it, at least.
const BESIDE: f64 = 0.25;
const WORSE: f64 = 1.5;
/// Median distance of micro-images from the grid, in pitches, up to which a frame counts as clean (a white frame) and
/// may ask for more than a lattice.
pub(super) const CLEAN_SCATTER: f64 = 0.006;
/// Times as much about a map of a degree that follows a lens's distortion, with the phases still taken on the straight
/// lattice: sure to be texture.
const TEXTURED: f64 = 2.5;
const TEXTURED_DEGREE: usize = 3;
/// Windows of neighbouring micro-images overlap by half, and both see the gap between them, where the noise of the
/// logarithm is: what moves one moves the other half as far. The scatter of neighbourhoods shows so much less of that
/// than there is; 4/3 from the windows alone, the rest as measured.
const OVERLAP: f64 = 1.6;
/// What a pitch may be beyond the bounds given for it: micro-images are a few per cent farther apart than microlenses.
const PITCH_SLACK: f64 = 1.02;
/// Finest pitch at which micro-images can be told from each other, px.
const FINEST_PX: f64 = 4.0;
/// Largest relative change of the pitch that [`refine_grid`] takes for the same grid.
pub const PITCH_FOLLOWED: f64 = 0.01;

/// Finds the grid of a white or textured frame: array type, pitch, rotation and place, without being told any of them.
///
/// # Errors
/// [`GridError`] for a frame that is too small, blank, saturated, has no lattice, or too few micro-images.
pub fn find_grid(image: &RawImage, options: &GridOptions) -> Result<Grid, GridError> {
    let frame = Frame::new(image, options)?;
    let no_lattice =
        |reason: String| GridError::NoLattice { least: options.pitch_px[0], greatest: options.pitch_px[1], reason };
    let part = central_part(&frame);
    let candidates = candidates(&frame, part, options.pitch_px);
    if candidates.is_empty() {
        return Err(no_lattice("its spectrum has no peaks at right angles or at 60° to each other".to_owned()));
    }
    let least = options.micro_images_min;
    let too_few = |grid: &Grid| {
        let (found, pitch) = (grid.micro_images(), grid.pitch_px());
        (found < least).then_some(GridError::TooFewMicroImages { found, pitch, least })
    };
    let mut best: Option<Grid> = None;
    let mut scarce = None;
    for candidate in &candidates {
        let start = start(candidate, [frame.width, frame.height]);
        if let Some(few) = too_few(&start) {
            scarce.get_or_insert(few);
            continue;
        }
        // Where there is a lattice already, one that the frame's middle speaks against is not worth the work.
        let least = best.as_ref().filter(|best| best.coherence > COHERENCE_LEAST).map(|_| HOPELESS);
        let Some(mut grid) = settle(&frame, start, part, least) else { continue };
        while let Some(finer) = finer(&frame, &grid).and_then(|start| settle(&frame, start, part, None)) {
            grid = finer;
        }
        if let Some(few) = too_few(&grid) {
            scarce.get_or_insert(few);
            continue;
        }
        if best.as_ref().is_none_or(|best| grid.coherence > best.coherence) {
            best = Some(grid);
        }
        if best.as_ref().is_some_and(|best| best.coherence > 0.9) {
            break;
        }
    }
    let Some(best) = best else {
        return Err(scarce.unwrap_or_else(|| no_lattice("its phases determine no lattice".to_owned())));
    };
    if best.coherence < COHERENCE_LEAST {
        return Err(no_lattice(format!(
            "the best has a coherence of {:.2}, at least {COHERENCE_LEAST} is needed",
            best.coherence
        )));
    }
    let Some(grid) = fundamental(&frame, &best, part, options) else {
        return Err(no_lattice(format!(
            "the pitch of {:.2} px is a harmonic of a larger one, of which too few micro-images are in the frame",
            best.pitch_px()
        )));
    };
    let pitch = grid.pitch_px();
    if pitch < options.pitch_px[0] / PITCH_SLACK || pitch > options.pitch_px[1] * PITCH_SLACK {
        return Err(no_lattice(format!("the best has a pitch of {pitch:.2} px")));
    }
    let grid = match bend(&frame, &grid, options.degree_max.clamp(1, DEGREE_MAX)) {
        Some(bent) => bent,
        None => placed(&frame, grid, &[], None, Model::Similarity),
    };
    Ok(centred(grid))
}

/// Whether a white frame's profile fits a frame clearly worse with the grid moved to any side: that it fits is no chance then,
/// nor for the frame's texture alone, under which any place would do.
fn fits_nowhere_beside(white: &Vignetting, image: &RawImage, grid: &Grid) -> bool {
    let step = BESIDE * grid.pitch_px();
    let misfit = |[x, y]: [f64; 2]| {
        let moved = Grid { centre: [grid.centre[0] + x, grid.centre[1] + y], ..grid.clone() };
        white.fit(image, &moved).map(|fit| fit.misfit)
    };
    let Ok(here) = misfit([0.0; 2]) else { return false };
    let sides = [[step, 0.0], [-step, 0.0], [0.0, step], [0.0, -step]];
    sides.into_iter().all(|side| misfit(side).is_ok_and(|misfit| misfit > WORSE * here))
}

/// Fits a known grid to a frame taken at another image distance: a shift of a few pixels and a change of the pitch of
/// up to 1 %. Rotation, array and distortion are kept: a motor does not turn the array. With `white`, the micro-image's
/// profile from the white frame that the grid is of, a textured frame is placed better than by its own mean profile.
///
/// # Errors
/// [`GridError`] for a frame that is too small, blank, saturated, of another size, or that the grid no longer fits.
pub fn refine_grid(image: &RawImage, grid: &Grid, white: Option<&Vignetting>) -> Result<Grid, GridError> {
    let profile = |u: f64, v: f64| white.map_or(0.0, |white| f64::from(white.transmission(u, v, 0.0, 0.0)));
    let known: Option<Known> = if white.is_some() { Some(&profile) } else { None };
    let size = [image.width(), image.height()];
    if size != grid.frame_size {
        return Err(GridError::OtherFrameSize { grid: grid.frame_size, frame: size });
    }
    let frame = Frame::new(image, &GridOptions::default())?;
    let whole = [0, 0, frame.width, frame.height];
    let misfit = |reason: String| GridError::DoesNotFit { reason };
    let too_few = || misfit("too few of its micro-images lie in the frame".to_owned());
    let lenses = demodulated(&frame, grid, whole).1;
    if lenses.is_empty() {
        return Err(too_few());
    }
    let together = Phases::new(grid, &lenses, &Harmonics::new(grid).waves).brought_together(PITCH_FOLLOWED);
    let mut followed = together.clone();
    for _ in 0..3 {
        let Some(fit) = fit_once(&frame, &followed, whole, Model::ScaleShift) else { return Err(too_few()) };
        let moved = fit.grid.distance_to(&followed);
        followed = fit.grid;
        if moved < 0.02 {
            break;
        }
    }
    // Where single micro-images say little their phases may lead astray: then the sum over all of them may not, or the
    // known grid itself is the nearest.
    let followed = judged(&frame, followed, whole);
    let refined = placed(&frame, followed, &[together, grid.clone()], known, Model::ScaleShift);
    let refined = Grid { coherence: judged(&frame, refined.clone(), whole).coherence, ..refined };
    let change = refined.pitch_px() / grid.pitch_px() - 1.0;
    if change.abs() > PITCH_FOLLOWED {
        return Err(misfit(format!("its pitch would change by {:.2} %", 100.0 * change)));
    }
    // Print under a hexagonal array has phases of its own, and coarse print under few large micro-images hides the lattice's.
    // The white frame's profile, once it fits, says as much as they; where they say nothing it does not lead elsewhere.
    let profile_fits = || {
        let fit = white.and_then(|white| white.fit(image, &refined).ok());
        let stays = || refined.distance_to(grid) <= STAYS * grid.pitch_px();
        let alone_here = || white.is_some_and(|white| fits_nowhere_beside(white, image, &refined));
        fit.is_some_and(|fit| fit.fits()) && (refined.coherence >= HOPELESS || (stays() && alone_here()))
    };
    if refined.coherence < COHERENCE_KNOWN_LEAST && !profile_fits() {
        return Err(misfit(format!("coherence {:.2}, at least {COHERENCE_KNOWN_LEAST} is needed", refined.coherence)));
    }
    let sigma = GridSigma { rotation_rad: grid.sigma.rotation_rad, ..refined.sigma };
    // How far single micro-images lie from the lattice is not told by a textured frame.
    Ok(centred(Grid { residual_px: grid.residual_px, scatter_px: grid.scatter_px, sigma, ..refined }))
}

/// Where each micro-image of the frame lies against the grid, and its contrast: for maps, and to flag missing, dead and
/// dirty microlenses. Micro-images too near the frame's edge to be judged are left out.
///
/// # Errors
/// [`GridError`] for a frame that is too small, blank, saturated or of another size.
pub fn lens_residuals(image: &RawImage, grid: &Grid) -> Result<Vec<LensResidual>, GridError> {
    let size = [image.width(), image.height()];
    if size != grid.frame_size {
        return Err(GridError::OtherFrameSize { grid: grid.frame_size, frame: size });
    }
    let frame = Frame::new(image, &GridOptions::default())?;
    let (demodulator, lenses) = demodulated(&frame, grid, [0, 0, frame.width, frame.height]);
    let phases = Phases::new(grid, &lenses, &demodulator.harmonics);
    Ok(lenses
        .iter()
        .map(|l| LensResidual { micro_image: l.at, offset_px: phases.displacement(l), contrast: phases.contrast(l) })
        .collect())
}

/// The finest lattice that one is a harmonic of, or that one itself where it is none. `None` where the frame has too little
/// of what it seems to be a harmonic of.
fn fundamental(frame: &Frame, grid: &Grid, part: [usize; 4], options: &GridOptions) -> Option<Grid> {
    let mut unseen = false;
    for basis in suspects(frame, grid) {
        let start = exact(grid.array, basis, grid.centre, grid.frame_size);
        if start.micro_images() < options.micro_images_min {
            unseen = true;
            continue;
        }
        let Some(found) = settle(frame, start, part, None) else { continue };
        let enough = found.coherence > COHERENCE_LEAST && found.micro_images() >= options.micro_images_min;
        if enough && suspects(frame, &found).is_empty() {
            return Some(found);
        }
    }
    (!unseen).then(|| grid.clone())
}

/// A candidate's lattice, in canonical basis, with its centre still anywhere.
fn start(candidate: &Candidate, frame_size: [usize; 2]) -> Grid {
    let centre = frame_size.map(|n| (n as f64 - 1.0) / 2.0);
    exact(candidate.array, reciprocal(candidate.reciprocal), centre, frame_size)
}

/// The exact array nearest to a basis, which two peaks of a spectrum do not give well enough to tell a shear.
fn exact(array: ArrayKind, basis: [[f64; 2]; 2], centre: [f64; 2], frame_size: [usize; 2]) -> Grid {
    let [a, b] = canonical(array, basis);
    let (sine, cosine) = symmetry(array).sin_cos();
    let a = [(a[0] + cosine * b[0] + sine * b[1]) / 2.0, (a[1] - sine * b[0] + cosine * b[1]) / 2.0];
    let b = [cosine * a[0] - sine * a[1], sine * a[0] + cosine * a[1]];
    Grid::affine(array, centre, [a, b], frame_size)
}

/// The lattice of all micro-images where this one has only those of one type: microlenses of several focal lengths repeat
/// at √2, √3 or twice their pitch. The places between its micro-images are then as bright as they are, where one
/// array would have its gaps.
fn finer(frame: &Frame, grid: &Grid) -> Option<Grid> {
    let [a, b] = grid.basis;
    let along = |s: f64, t: f64| [s * a[0] + t * b[0], s * a[1] + t * b[1]];
    let level = |places: &[[f64; 2]]| {
        let (mut sum, mut count) = (0.0, 0.0);
        let mut value = [0.0f32];
        for m in grid.micro_images_within(0.0) {
            for place in places {
                let [x, y] = [m.x + place[0], m.y + place[1]].map(f64::round);
                if x >= 0.0 && y >= 0.0 && x < frame.width as f64 && y < frame.height as f64 {
                    frame.row(y as usize, x as usize, &mut value);
                    sum += f64::from(value[0]);
                    count += 1.0;
                }
            }
        }
        sum / f64::max(count, 1.0)
    };
    let own = level(&[[0.0, 0.0]]);
    let bright = |between: &[[f64; 2]], gap: &[[f64; 2]]| level(between) > f64::midpoint(own, level(gap));
    let half = [along(0.5, 0.0), along(0.0, 0.5)];
    let quarter = [along(0.25, 0.0), along(0.0, 0.25)];
    let basis = match grid.array {
        ArrayKind::Square if bright(&[along(0.5, 0.5)], &half) => [along(0.5, -0.5), along(0.5, 0.5)],
        ArrayKind::Hexagonal if bright(&[along(1.0 / 3.0, 1.0 / 3.0), along(2.0 / 3.0, 2.0 / 3.0)], &half) => {
            [along(2.0 / 3.0, -1.0 / 3.0), along(1.0 / 3.0, 1.0 / 3.0)]
        }
        _ if bright(&half, &quarter) => half,
        _ => return None,
    };
    let finer = exact(grid.array, basis, grid.centre, grid.frame_size);
    // Below the least pitch of any use there is nothing to be had.
    (finer.pitch_px() > FINEST_PX).then_some(finer)
}

/// From a candidate to a lattice over the whole frame: the part it was found in first, where its pitch is good enough
/// to count micro-images by. `None` where the phases there agree less than `least`, where that is given, or determine nothing.
fn settle(frame: &Frame, start: Grid, part: [usize; 4], least: Option<f64>) -> Option<Grid> {
    let (demodulator, lenses) = demodulated(frame, &start, part);
    let phases = Phases::new(&start, &lenses, &demodulator.harmonics);
    let shift = phases.common_shift();
    let mut grid = Grid { centre: [start.centre[0] + shift[0], start.centre[1] + shift[1]], ..start.clone() };
    if least.is_some_and(|least| phases.coherence_about(&grid) < least) {
        return None;
    }
    let whole = [0, 0, frame.width, frame.height];
    let parts: &[[usize; 4]] = if part[2] + 64 < whole[2] || part[3] + 64 < whole[3] {
        &[part, part, whole, whole]
    } else {
        &[whole, whole, whole]
    };
    for (round, &part) in parts.iter().enumerate() {
        grid = fit_once(frame, &grid, part, Model::Similarity)?.grid;
        if round == 1 {
            // Hopeless ones are not worth the whole frame.
            grid = judged(frame, grid, part);
            if grid.coherence < 0.6 * COHERENCE_LEAST {
                return Some(grid);
            }
        }
    }
    Some(judged(frame, grid, whole))
}

fn demodulated(frame: &Frame, grid: &Grid, part: [usize; 4]) -> (Demodulator, Vec<Lens>) {
    let lenses: Vec<MicroImage> = grid.micro_images_within(0.0).collect();
    let demodulator = Demodulator::new(grid, step_for(grid, lenses.len()));
    let found = demodulator.run(frame, &lenses, part);
    (demodulator, found)
}

fn fit_once(frame: &Frame, grid: &Grid, part: [usize; 4], model: Model) -> Option<Fit> {
    let (demodulator, lenses) = demodulated(frame, grid, part);
    let phases = Phases::new(grid, &lenses, &demodulator.harmonics);
    let mut fit = phases.fit(model)?;
    fit.grid.sigma = phases.sigma(&fit, OVERLAP);
    Some(fit)
}

/// The grid with its coherence, residual and scatter filled in.
fn judged(frame: &Frame, mut grid: Grid, part: [usize; 4]) -> Grid {
    let (demodulator, lenses) = demodulated(frame, &grid, part);
    let phases = Phases::new(&grid, &lenses, &demodulator.harmonics);
    let coherence = phases.coherence();
    (grid.residual_px, grid.scatter_px) = phases.residual_and_scatter_about(&grid);
    grid.coherence = coherence;
    grid
}

/// Where the frame is clean enough to tell, the array's own departure from an exact lattice: affine first, then as many
/// degrees as the data ask for. `None` for a textured frame: texture moves single micro-images more than any array does,
/// and its mean field is no property of the array.
fn bend(frame: &Frame, grid: &Grid, degree_max: usize) -> Option<Grid> {
    let whole = [0, 0, frame.width, frame.height];
    let (demodulator, lenses) = demodulated(frame, grid, whole);
    let phases = Phases::new(grid, &lenses, &demodulator.harmonics);
    // Windows overlap fourfold: so many fewer independent phases.
    let independent = (lenses.len() * demodulator.harmonics.len()) as f64 / 4.0;
    // What a map explains leaves a textured frame far from clean: no need to ask further.
    let left = phases.fit(Model::Polynomial(TEXTURED_DEGREE)).map(|fit| phases.scatter_about(&fit.grid));
    if left.is_some_and(|scatter| scatter > TEXTURED * CLEAN_SCATTER * grid.pitch_px()) {
        return None;
    }
    let mut best: Option<(f64, usize)> = None;
    for degree in 1..=DEGREE_MAX {
        let unknowns = 2.0 * monomial_count(degree) as f64;
        if independent < 4.0 * unknowns {
            break;
        }
        let Some(fit) = phases.fit(Model::Polynomial(degree)) else { break };
        // Bayes' information criterion.
        let cost = independent * fit.variance.max(1e-12).ln() + unknowns * independent.ln();
        if best.as_ref().is_none_or(|b| cost < b.0) {
            best = Some((cost, degree));
        }
    }
    let (_, asked) = best?;
    // One more round about the bent grid: the first had its windows on the straight one.
    let bent = |degree: usize| {
        let once = fit_once(frame, grid, whole, Model::Polynomial(degree))?.grid;
        let twice = fit_once(frame, &once, whole, Model::Polynomial(degree))?.grid;
        Some(judged(frame, twice, whole))
    };
    let best = bent(asked)?;
    if best.scatter_px > CLEAN_SCATTER * best.pitch_px() {
        return None;
    }
    if asked > degree_max { bent(degree_max) } else { Some(best) }
}

/// The grid of a textured frame, placed by the mean profile from where it is or from one of `others`; that of a clean
/// frame as it is.
fn placed(frame: &Frame, grid: Grid, others: &[Grid], known: Option<Known>, model: Model) -> Grid {
    if grid.scatter_px < CLEAN_SCATTER * grid.pitch_px() {
        return grid;
    }
    let lenses: Vec<MicroImage> = grid.micro_images_within(0.0).collect();
    let effort = Effort { step: step_for(&grid, lenses.len()), rounds: 8, at_rest_px: 0.003 };
    let mut starts = vec![grid.clone()];
    starts.extend_from_slice(others);
    let Some(matched) = matched_best(frame, &starts, &lenses, known, model, effort) else { return grid };
    // Far from all of them the linear comparison does not hold.
    let near = |start: &Grid| distance(matched.fit.grid.centre, start.centre) < 0.1 * grid.pitch_px();
    if starts.iter().any(near) { matched.fit.grid } else { grid }
}

/// Every so many pixels of every so many rows are enough for so many micro-images.
fn step_for(grid: &Grid, lenses: usize) -> usize {
    /// Samples of a pass over the frame.
    const ENOUGH: f64 = 4e6;
    /// Fewest samples a pitch.
    const PER_PITCH: f64 = 9.0;
    let pitch = grid.pitch_px();
    let all = 4.0 * pitch * pitch * lenses as f64;
    (all / ENOUGH).sqrt().ceil().min(pitch / PER_PITCH).max(1.0) as usize
}

/// The same grid, counted from the micro-image nearest the frame's centre.
fn centred(mut grid: Grid) -> Grid {
    let middle = grid.frame_size.map(|n| (n as f64 - 1.0) / 2.0);
    let [i, j] = grid.index_of(middle[0], middle[1]);
    if [i, j] == [0, 0] {
        return grid;
    }
    grid.centre = [
        grid.centre[0] + f64::from(i) * grid.basis[0][0] + f64::from(j) * grid.basis[1][0],
        grid.centre[1] + f64::from(i) * grid.basis[0][1] + f64::from(j) * grid.basis[1][1],
    ];
    if let Some(distortion) = &mut grid.distortion {
        recount(distortion, f64::from(i), f64::from(j));
    }
    grid
}

/// Moves the origin of the indices by (i, j): the binomials of the shifted powers, expanded.
fn recount(distortion: &mut Distortion, i: f64, j: f64) {
    let choose = |n: usize, k: usize| (0..k).fold(1.0, |c, q| c * (n - q) as f64 / (q + 1) as f64);
    let (s0, t0) = (i / distortion.scale, j / distortion.scale);
    let mut shifted = vec![[0.0; 2]; monomial_count(distortion.degree)];
    let powers = (0..=distortion.degree).flat_map(|d| (0..=d).map(move |q| (d - q, q)));
    for (c, (p, q)) in distortion.coefficients.iter().zip(powers) {
        for a in 0..=p {
            for b in 0..=q {
                let f = choose(p, a) * s0.powi((p - a) as i32) * choose(q, b) * t0.powi((q - b) as i32);
                let to = &mut shifted[(a + b) * (a + b + 1) / 2 + b];
                to[0] += f * c[0];
                to[1] += f * c[1];
            }
        }
    }
    distortion.coefficients = shifted;
}

fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}
