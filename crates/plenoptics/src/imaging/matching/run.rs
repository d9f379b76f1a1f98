//! Working through jobs: tiles prepared row by row and pairs compared while they are in the cache.

use std::sync::{Mutex, PoisonError};

use pulp::Simd;
use rayon::prelude::*;

use super::compare::{ALONG, CONTENTS, Moments, Overlap, Warp};
use super::gains::Light;
use super::model::Model;
use super::plan::{Job, Lens, Link, Pair};
use super::samples::{Frame, Sample};
use super::score::{Content, PairScore};
use super::shape::Shape;
use super::tile::{Tile, Workspace};

/// What all jobs of a pass share.
pub(in crate::imaging) struct Pass<'a, T> {
    pub(in crate::imaging) frame: &'a Frame<'a, T>,
    pub(in crate::imaging) light: Light<'a>,
    pub(in crate::imaging) lenses: &'a [Lens],
    pub(in crate::imaging) model: &'a Model,
    pub(in crate::imaging) shape: &'a Shape,
    /// Noise, grey levels.
    pub(in crate::imaging) noise: f64,
}

/// Room for one job at a time.
#[derive(Debug, Default)]
pub(in crate::imaging) struct Scratch {
    tiles: Vec<Tile>,
    work: Workspace,
    warp: Warp,
}

/// Room for as many jobs as run at a time; it grows to that and stays.
#[derive(Debug, Default)]
pub(in crate::imaging) struct Pool(Mutex<Vec<Scratch>>);

impl Pool {
    fn take(&self) -> Scratch {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).pop().unwrap_or_default()
    }

    fn put(&self, scratch: Scratch) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).push(scratch);
    }
}

/// Prepares every tile and compares every pair of all jobs.
pub(in crate::imaging) fn run<T: Sample, const WHAT: usize>(pass: &Pass<'_, T>, jobs: &mut [Job], pool: &Pool) {
    let arch = pulp::Arch::new();
    jobs.par_iter_mut().with_max_len(1).for_each(|job| {
        let mut scratch = pool.take();
        arch.dispatch(JobTask::<T, WHAT> { pass, job, scratch: &mut scratch });
        pool.put(scratch);
    });
}

struct JobTask<'a, T, const WHAT: usize> {
    pass: &'a Pass<'a, T>,
    job: &'a mut Job,
    scratch: &'a mut Scratch,
}

impl<T: Sample, const WHAT: usize> pulp::WithSimd for JobTask<'_, T, WHAT> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { pass, job, scratch } = self;
        let Scratch { tiles, work, warp } = scratch;
        if tiles.len() < job.slots {
            tiles.resize_with(job.slots, Tile::default);
        }
        let mut scores = job.scores.iter_mut();
        for row in &job.rows {
            for &(lens, _) in &row.tiles {
                std::hint::black_box(pass.frame.touch(&pass.lenses[lens as usize], pass.shape));
            }
            for &(lens, slot) in &row.tiles {
                let lens = &pass.lenses[lens as usize];
                tiles[usize::from(slot)].prepare(simd, pass.frame, (lens, pass.light), pass.shape, work);
            }
            for (link, score) in row.links.iter().zip(&mut scores) {
                let (a, b) = (&tiles[usize::from(link.slots[0])], &tiles[usize::from(link.slots[1])]);
                *score = compare::<S, T, WHAT>(simd, pass, link, [a, b], warp);
            }
        }
    }
}

/// Clusters of tiles that are kept, to be compared at several spacings.
#[derive(Debug)]
pub(in crate::imaging) struct Clusters {
    pub(in crate::imaging) jobs: Vec<Job>,
    scratches: Vec<Scratch>,
}

impl Clusters {
    pub(in crate::imaging) fn new(jobs: Vec<Job>) -> Self {
        let scratches = jobs.iter().map(|_| Scratch::default()).collect();
        Self { jobs, scratches }
    }

    /// Compares all pairs along themselves, and prepares their tiles where they are `fresh`.
    pub(in crate::imaging) fn run<T: Sample>(&mut self, pass: &Pass<'_, T>, fresh: bool) {
        let arch = pulp::Arch::new();
        self.jobs.par_iter_mut().zip(&mut self.scratches).with_min_len(4).for_each(|(job, scratch)| {
            if fresh {
                arch.dispatch(JobTask::<T, ALONG> { pass, job, scratch });
            } else {
                arch.dispatch(AgainTask { pass, job, scratch });
            }
        });
    }
}

/// Compares a cluster's pairs once more.
struct AgainTask<'a, T> {
    pass: &'a Pass<'a, T>,
    job: &'a mut Job,
    scratch: &'a mut Scratch,
}

impl<T: Sample> pulp::WithSimd for AgainTask<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { pass, job, scratch } = self;
        let Scratch { tiles, warp, .. } = scratch;
        for (link, score) in job.rows.iter().flat_map(|row| &row.links).zip(&mut job.scores) {
            let (a, b) = (&tiles[usize::from(link.slots[0])], &tiles[usize::from(link.slots[1])]);
            *score = compare::<S, T, ALONG>(simd, pass, link, [a, b], warp);
        }
    }
}

/// Both orders of a pair.
#[inline(always)]
fn compare<S: Simd, T: Sample, const WHAT: usize>(
    simd: S,
    pass: &Pass<'_, T>,
    link: &Link,
    tiles: [&Tile; 2],
    warp: &mut Warp,
) -> PairScore {
    let spacing = pass.model.spacing(usize::from(link.pair.region), &link.pair.place);
    both::<S, WHAT>(simd, pass.shape, tiles, link.pair.unit, spacing, warp)
        .map_or(PairScore::NONE, |moments| PairScore::new(&moments, pass.noise))
}

#[inline(always)]
fn both<S: Simd, const WHAT: usize>(
    simd: S,
    shape: &Shape,
    [a, b]: [&Tile; 2],
    unit: [f64; 2],
    spacing: [f64; 2],
    warp: &mut Warp,
) -> Option<[Moments; 2]> {
    let there = Overlap::new(a, b, shape, unit, spacing)?.compare::<S, WHAT>(simd, a, b, shape, warp)?;
    let back = Overlap::new(b, a, shape, [-unit[0], -unit[1]], spacing)?.compare::<S, WHAT>(simd, b, a, shape, warp)?;
    Some([there, back])
}

/// The contents of pairs at spacings all over a frame, px: of each pair one after another, `None` where its masks hardly
/// overlap. The pass's model is not asked.
pub(in crate::imaging) fn contents<T: Sample>(
    pass: &Pass<'_, T>,
    pairs: &[Pair],
    spacings: &[f64],
) -> Vec<Vec<Option<Content>>> {
    let arch = pulp::Arch::new();
    pairs
        .par_iter()
        .map_init(Scratch::default, |scratch, pair| arch.dispatch(ContentTask { pass, pair, spacings, scratch }))
        .collect()
}

struct ContentTask<'a, T> {
    pass: &'a Pass<'a, T>,
    pair: &'a Pair,
    spacings: &'a [f64],
    scratch: &'a mut Scratch,
}

impl<T: Sample> pulp::WithSimd for ContentTask<'_, T> {
    type Output = Vec<Option<Content>>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Self::Output {
        let Self { pass, pair, spacings, scratch: Scratch { tiles, work, warp } } = self;
        tiles.resize_with(2, Tile::default);
        for (tile, lens) in tiles.iter_mut().zip([pair.first, pair.second]) {
            tile.prepare(simd, pass.frame, (&pass.lenses[lens as usize], pass.light), pass.shape, work);
        }
        let mut found = Vec::with_capacity(spacings.len());
        for &spacing in spacings {
            let tiles = [&tiles[0], &tiles[1]];
            let moments = both::<S, CONTENTS>(simd, pass.shape, tiles, pair.unit, [spacing, 0.0], warp);
            found.push(moments.map(|moments| Content::new(&moments, pass.noise)));
        }
        found
    }
}

/// Prepares the tiles of groups of micro-images, and has `look` at each group: at its number and its tiles.
pub(in crate::imaging) fn each<T: Sample, R: Send, const N: usize>(
    pass: &Pass<'_, T>,
    groups: &[[u32; N]],
    look: impl Fn(usize, &[Tile]) -> R + Sync,
) -> Vec<R> {
    let arch = pulp::Arch::new();
    groups
        .par_iter()
        .enumerate()
        .map_init(Scratch::default, |scratch, (k, lenses)| {
            scratch.tiles.resize_with(N, Tile::default);
            arch.dispatch(PrepareTask { pass, lenses, scratch });
            look(k, &scratch.tiles)
        })
        .collect()
}

struct PrepareTask<'a, T> {
    pass: &'a Pass<'a, T>,
    lenses: &'a [u32],
    scratch: &'a mut Scratch,
}

impl<T: Sample> pulp::WithSimd for PrepareTask<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { pass, lenses, scratch: Scratch { tiles, work, .. } } = self;
        for (tile, &lens) in tiles.iter_mut().zip(lenses) {
            tile.prepare(simd, pass.frame, (&pass.lenses[lens as usize], pass.light), pass.shape, work);
        }
    }
}
