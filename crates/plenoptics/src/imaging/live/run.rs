//! Working through jobs: tiles prepared row by row and pairs compared while they are in the cache.

use std::sync::{Mutex, PoisonError};

use pulp::Simd;
use rayon::prelude::*;

use super::compare::{Moments, Overlap, Warp};
use super::frame::{Frame, Sample};
use super::gains::Gains;
use super::normal::Model;
use super::plan::{Job, Lens};
use super::score::PairScore;
use super::shape::Shape;
use super::tile::{Tile, Workspace};
use crate::imaging::spacing::Directions;

/// What all jobs of a pass share.
pub(super) struct Pass<'a, T> {
    pub(super) frame: &'a Frame<'a, T>,
    pub(super) gains: &'a Gains,
    pub(super) lenses: &'a [Lens],
    pub(super) directions: &'a Directions,
    pub(super) model: &'a Model,
    pub(super) shape: &'a Shape,
    /// Noise, grey levels.
    pub(super) noise: f64,
}

/// Room for one job at a time.
#[derive(Debug, Default)]
pub(super) struct Scratch {
    tiles: Vec<Tile>,
    work: Workspace,
    warp: Warp,
}

/// Room for as many jobs as run at a time; it grows to that and stays.
#[derive(Debug, Default)]
pub(super) struct Pool(Mutex<Vec<Scratch>>);

impl Pool {
    fn take(&self) -> Scratch {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).pop().unwrap_or_default()
    }

    fn put(&self, scratch: Scratch) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).push(scratch);
    }
}

/// Prepares every tile and compares every pair of all jobs.
pub(super) fn run<T: Sample>(pass: &Pass<'_, T>, jobs: &mut [Job], pool: &Pool) {
    let arch = pulp::Arch::new();
    jobs.par_iter_mut().with_max_len(1).for_each(|job| {
        let mut scratch = pool.take();
        arch.dispatch(JobTask { pass, job, scratch: &mut scratch });
        pool.put(scratch);
    });
}

struct JobTask<'a, T> {
    pass: &'a Pass<'a, T>,
    job: &'a mut Job,
    scratch: &'a mut Scratch,
}

impl<T: Sample> pulp::WithSimd for JobTask<'_, T> {
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
                tiles[usize::from(slot)].prepare(simd, pass.frame, (lens, pass.gains), pass.shape, work);
            }
            for (link, score) in row.links.iter().zip(&mut scores) {
                let (a, b) = (&tiles[usize::from(link.slots[0])], &tiles[usize::from(link.slots[1])]);
                *score = compare(simd, pass, link, a, b, warp);
            }
        }
    }
}

/// Clusters of tiles that are kept, to be compared at several spacings.
#[derive(Debug)]
pub(super) struct Clusters {
    pub(super) jobs: Vec<Job>,
    scratches: Vec<Scratch>,
}

impl Clusters {
    pub(super) fn new(jobs: Vec<Job>) -> Self {
        let scratches = jobs.iter().map(|_| Scratch::default()).collect();
        Self { jobs, scratches }
    }

    /// Compares all pairs, and prepares their tiles where they are `fresh`.
    pub(super) fn run<T: Sample>(&mut self, pass: &Pass<'_, T>, fresh: bool) {
        let arch = pulp::Arch::new();
        self.jobs.par_iter_mut().zip(&mut self.scratches).with_min_len(4).for_each(|(job, scratch)| {
            if fresh {
                arch.dispatch(JobTask { pass, job, scratch });
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
            *score = compare(simd, pass, link, a, b, warp);
        }
    }
}

/// Both orders of a pair.
#[inline(always)]
fn compare<S: Simd, T: Sample>(
    simd: S,
    pass: &Pass<'_, T>,
    link: &super::plan::Link,
    a: &Tile,
    b: &Tile,
    warp: &mut Warp,
) -> PairScore {
    let spacing = pass.model.spacing(&link.pair, pass.directions);
    let there = order(simd, pass.shape, a, b, link.pair.unit, spacing, warp);
    let back = order(simd, pass.shape, b, a, [-link.pair.unit[0], -link.pair.unit[1]], spacing, warp);
    match (there, back) {
        (Some(there), Some(back)) => PairScore::new(&[there, back], pass.noise),
        _ => PairScore::NONE,
    }
}

/// One order of a pair; a closure would not be compiled for the instruction set in use.
#[inline(always)]
fn order<S: Simd>(
    simd: S,
    shape: &Shape,
    a: &Tile,
    b: &Tile,
    unit: [f64; 2],
    spacing: [f64; 2],
    warp: &mut Warp,
) -> Option<Moments> {
    let overlap = Overlap::new(a, b, shape, unit, spacing)?;
    overlap.compare(simd, a, b, shape, warp)
}
