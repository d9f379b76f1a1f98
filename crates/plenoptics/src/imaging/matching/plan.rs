//! What stays from frame to frame: the micro-images, their pairs, and the order in which they are worked through.
//!
//! The lattice is cut into jobs, each a block of lattice columns and rows. A job walks down its rows and keeps the tiles
//! of two rows only, so that a tile is prepared once in a job and compared with its neighbours while it is in the cache:
//!
//! ```text
//!   row j − 1   o---o---o---o      tiles kept
//!               |   |   |   |      pairs between the rows
//!   row j       o---o---o---o      tiles prepared now, pairs along the row
//! ```

use std::collections::{BTreeMap, HashMap};

use super::model::{Directions, Place};
use super::motion::{Field, Motion};
use super::score::PairScore;
use crate::imaging::grid::Grid;

/// Most lattice columns of a job: with them two rows of tiles fit into the second-level cache.
const JOB_COLUMNS: i32 = 14;
/// Most lattice rows of a job.
const JOB_ROWS: i32 = 24;
/// The golden ratio's fraction: its multiples spread evenly however many there are.
pub(in crate::imaging) const GOLDEN: f64 = 0.618_033_988_749_895;

/// A micro-image.
#[derive(Debug, Clone, Copy)]
pub(in crate::imaging) struct Lens {
    /// The pixel nearest its centre.
    pub(in crate::imaging) nearest: [i32; 2],
    /// The centre less that pixel, px.
    pub(in crate::imaging) fraction: [f64; 2],
}

impl Lens {
    fn at([x, y]: [f64; 2]) -> Self {
        let nearest = [x.round(), y.round()];
        Self { nearest: nearest.map(|n| n as i32), fraction: [x - nearest[0], y - nearest[1]] }
    }
}

/// Which of so many places along an axis between two pixels is nearest to a centre, from its [`Lens::fraction`].
#[inline(always)]
pub(in crate::imaging) fn nearest_place(fraction: f64, places: usize) -> usize {
    (((fraction + 0.5) * places as f64) as usize).min(places - 1)
}

/// Where the place with this number has its centre from the nearest pixel, px.
#[inline(always)]
pub(in crate::imaging) fn place(number: usize, places: usize) -> f64 {
    (number as f64 + 0.5) / places as f64 - 0.5
}

/// Two neighbouring micro-images.
#[derive(Debug, Clone, Copy)]
pub(in crate::imaging) struct Pair {
    /// The two by their numbers in the plan.
    pub(in crate::imaging) first: u32,
    pub(in crate::imaging) second: u32,
    /// From the first centre to the second, of length 1.
    pub(in crate::imaging) unit: [f64; 2],
    /// Where in the field, and along which direction, it measures: at its midpoint.
    pub(in crate::imaging) place: Place,
    /// Lattice direction: 0 and 1 along the basis, 2 along their difference (hexagonal arrays).
    pub(in crate::imaging) direction: u8,
    /// Field block of the midpoint.
    pub(in crate::imaging) block: u8,
    /// Which of several regions both belong to.
    pub(in crate::imaging) region: u8,
}

/// A pair and where in its job's ring the two tiles are.
#[derive(Debug, Clone, Copy)]
pub(in crate::imaging) struct Link {
    pub(in crate::imaging) pair: Pair,
    pub(in crate::imaging) slots: [u16; 2],
}

/// One lattice row of a job.
#[derive(Debug, Clone, Default)]
pub(in crate::imaging) struct Row {
    /// Micro-images to be prepared, and their slots.
    pub(in crate::imaging) tiles: Vec<(u32, u16)>,
    /// Pairs to be compared once they are.
    pub(in crate::imaging) links: Vec<Link>,
}

/// A block of the lattice.
#[derive(Debug, Clone, Default)]
pub(in crate::imaging) struct Job {
    pub(in crate::imaging) rows: Vec<Row>,
    /// How many tiles its ring holds.
    pub(in crate::imaging) slots: usize,
    /// What its pairs said, in the order of the rows' links.
    pub(in crate::imaging) scores: Vec<PairScore>,
}

impl Job {
    pub(in crate::imaging) fn links(&self) -> impl Iterator<Item = &Link> {
        self.rows.iter().flat_map(|row| &row.links)
    }
}

/// A micro-image with all its pairs, for the noise of one micro-image in all of them together.
#[derive(Debug, Clone)]
pub(in crate::imaging) struct Star {
    pub(in crate::imaging) lens: u32,
    /// The pairs: whether the micro-image is the first of it, its job and its place in the job's scores.
    pub(in crate::imaging) rays: Vec<Ray>,
}

/// One pair of a [`Star`].
#[derive(Debug, Clone, Copy)]
pub(in crate::imaging) struct Ray {
    pub(in crate::imaging) pair: Pair,
    pub(in crate::imaging) outwards: bool,
    pub(in crate::imaging) job: u32,
    pub(in crate::imaging) score: u32,
}

/// The whole frame's plan.
#[derive(Debug, Clone)]
pub(in crate::imaging) struct Plan {
    pub(in crate::imaging) lenses: Vec<Lens>,
    pub(in crate::imaging) jobs: Vec<Job>,
    /// How many pairs all jobs have.
    pub(in crate::imaging) pairs: usize,
    pub(in crate::imaging) directions: Directions,
    /// How many of them pairs lie along.
    pub(in crate::imaging) direction_count: usize,
    pub(in crate::imaging) field: Field,
    /// Centres in the known grid, px, and lattice indices.
    bases: Vec<[f64; 2]>,
    pub(in crate::imaging) indices: Vec<[i32; 2]>,
    places: HashMap<[i32; 2], u32>,
}

impl Plan {
    /// Plans for a known grid that has moved, for the micro-images whose centres are at least `margin` px from the
    /// frame's outermost pixel centres: all of them up to about `most`, else rows of them.
    pub(in crate::imaging) fn new(known: &Grid, motion: &Motion, margin: f64, most: usize) -> Self {
        let grid = &motion.of(known);
        let mut plan = Self {
            lenses: Vec::new(),
            jobs: Vec::new(),
            pairs: 0,
            directions: Directions::new(grid),
            direction_count: grid.neighbour_steps().len(),
            field: Field::new(known.frame_size),
            bases: Vec::new(),
            indices: Vec::new(),
            places: HashMap::new(),
        };
        let all = grid.micro_images_within(margin + 0.5).count();
        let (kept, period) = rows_kept(all, most);
        for m in grid.micro_images_within(margin + 0.5).filter(|m| m.j.rem_euclid(period) < kept) {
            plan.places.insert([m.i, m.j], plan.lenses.len() as u32);
            plan.indices.push([m.i, m.j]);
            plan.bases.push(known.position(m.i, m.j));
            plan.lenses.push(Lens::at([m.x, m.y]));
        }
        let pairs = plan.all_pairs(grid);
        plan.pairs = pairs.len();
        // As many parts as it takes, all alike.
        let parts = |axis: usize, most: i32| {
            let places = plan.indices.iter().map(|index| index[axis]);
            let (low, high) = places.fold((i32::MAX, i32::MIN), |(l, h), i| (l.min(i), h.max(i)));
            let count = (high.saturating_sub(low)).saturating_add(1).max(1);
            (low, (count + (count + most - 1) / most - 1) / ((count + most - 1) / most))
        };
        let ((first_column, columns), (first_row, rows)) = (parts(0, JOB_COLUMNS), parts(1, JOB_ROWS));
        let mut blocks: BTreeMap<(i32, i32), Vec<Pair>> = BTreeMap::new();
        for pair in pairs {
            let column = plan.indices[pair.first as usize][0] - first_column;
            let row = plan.indices[pair.second as usize][1] - first_row;
            blocks.entry((column / columns, row / rows)).or_default().push(pair);
        }
        plan.jobs = blocks.values().map(|pairs| plan.job(pairs)).collect();
        plan
    }

    fn all_pairs(&self, grid: &Grid) -> Vec<Pair> {
        let mut pairs = Vec::new();
        for (first, index) in self.indices.iter().enumerate() {
            for (direction, step) in grid.neighbour_steps().iter().enumerate() {
                let Some(&second) = self.places.get(&[index[0] + step[0], index[1] + step[1]]) else { continue };
                let (a, b) = (self.centre(first as u32), self.centre(second));
                let step = [b[0] - a[0], b[1] - a[1]];
                let length = step[0].hypot(step[1]);
                let midpoint = [f64::midpoint(a[0], b[0]), f64::midpoint(a[1], b[1])];
                let place = self.directions.place(self.field.coordinates(midpoint), direction);
                pairs.push(Pair {
                    first: first as u32,
                    second,
                    unit: [step[0] / length, step[1] / length],
                    place,
                    direction: direction as u8,
                    block: place.block() as u8,
                    region: 0,
                });
            }
        }
        pairs
    }

    /// Moves all centres. Directions and midpoints of pairs stay: for them motions of a pixel or two are nothing.
    pub(in crate::imaging) fn shift_to(&mut self, motion: &Motion) {
        for (lens, &base) in self.lenses.iter_mut().zip(&self.bases) {
            *lens = Lens::at(motion.moved(&self.field, base));
        }
    }

    /// Centre of a micro-image, px.
    pub(in crate::imaging) fn centre(&self, lens: u32) -> [f64; 2] {
        let lens = &self.lenses[lens as usize];
        [f64::from(lens.nearest[0]) + lens.fraction[0], f64::from(lens.nearest[1]) + lens.fraction[1]]
    }

    /// The micro-image with these lattice indices.
    pub(in crate::imaging) fn lens(&self, index: [i32; 2]) -> Option<u32> {
        self.places.get(&index).copied()
    }

    /// A job of these pairs, which lie within a block of the lattice.
    pub(in crate::imaging) fn job(&self, pairs: &[Pair]) -> Job {
        let index = |lens: u32| self.indices[lens as usize];
        let columns = pairs.iter().flat_map(|p| [index(p.first)[0], index(p.second)[0]]);
        let (low, high) = columns.fold((i32::MAX, i32::MIN), |(l, h), i| (l.min(i), h.max(i)));
        // Of no pairs there is no column.
        let width = high.saturating_sub(low).saturating_add(1).max(1);
        let slot = |lens: u32| {
            let [i, j] = index(lens);
            (j.rem_euclid(2) * width + i - low) as u16
        };
        let mut rows: BTreeMap<i32, (BTreeMap<i32, u32>, Row)> = BTreeMap::new();
        for pair in pairs {
            for lens in [pair.first, pair.second] {
                let [i, j] = index(lens);
                rows.entry(j).or_default().0.insert(i, lens);
            }
            let link = Link { pair: *pair, slots: [slot(pair.first), slot(pair.second)] };
            rows.entry(index(pair.second)[1]).or_default().1.links.push(link);
        }
        let rows = rows
            .into_values()
            .map(|(lenses, row)| Row { tiles: lenses.values().map(|&lens| (lens, slot(lens))).collect(), ..row })
            .collect();
        Job { rows, slots: 2 * width as usize, scores: vec![PairScore::default(); pairs.len()] }
    }

    /// Jobs of two by two micro-images each, spread over the frame: with all their tiles at hand at once.
    pub(in crate::imaging) fn clusters(&self, wanted: usize) -> Vec<Job> {
        let pairs: HashMap<(u32, u32), Pair> =
            self.jobs.iter().flat_map(Job::links).map(|l| ((l.pair.first, l.pair.second), l.pair)).collect();
        let corner = |[i, j]: [i32; 2]| -> Option<[u32; 4]> {
            let place = |i: i32, j: i32| self.places.get(&[i, j]).copied();
            Some([place(i, j)?, place(i + 1, j)?, place(i, j + 1)?, place(i + 1, j + 1)?])
        };
        let whole: Vec<[u32; 4]> = self.indices.iter().filter_map(|&index| corner(index)).collect();
        spread(whole.len(), wanted)
            .map(|k| {
                let within = whole[k];
                let all = within.iter().flat_map(|&a| within.iter().map(move |&b| (a, b)));
                self.job(&all.filter_map(|ends| pairs.get(&ends).copied()).collect::<Vec<_>>())
            })
            .collect()
    }

    /// Micro-images with all their pairs in these jobs, spread over the frame.
    pub(in crate::imaging) fn stars(&self, jobs: &[Job], wanted: usize) -> Vec<Star> {
        let mut stars: HashMap<u32, Star> = spread(self.lenses.len(), wanted)
            .map(|lens| (lens as u32, Star { lens: lens as u32, rays: Vec::new() }))
            .collect();
        for (job, j) in jobs.iter().enumerate() {
            for (score, link) in j.links().enumerate() {
                let pair = link.pair;
                for (lens, outwards) in [(pair.first, true), (pair.second, false)] {
                    if let Some(star) = stars.get_mut(&lens) {
                        star.rays.push(Ray { pair, outwards, job: job as u32, score: score as u32 });
                    }
                }
            }
        }
        let mut stars: Vec<Star> = stars.into_values().collect();
        stars.sort_unstable_by_key(|star| star.lens);
        stars
    }
}

/// At most `wanted` of `count` places, spread evenly.
pub(in crate::imaging) fn spread(count: usize, wanted: usize) -> impl Iterator<Item = usize> {
    let mut chosen: Vec<usize> = if wanted >= count {
        (0..count).collect()
    } else {
        (0..wanted).map(|k| ((k as f64 * GOLDEN).fract() * count as f64) as usize).collect()
    };
    chosen.sort_unstable();
    chosen.dedup();
    chosen.into_iter()
}

/// How many rows side by side are kept, and of how many: about as many micro-images as `most` of `all`. At least three,
/// so that most of their pairs are kept with them.
fn rows_kept(all: usize, most: usize) -> (i32, i32) {
    let share = most.max(1) as f64 / all.max(1) as f64;
    if share >= 1.0 {
        (1, 1)
    } else if share >= 0.75 {
        let period = (1.0 / (1.0 - share)).floor().min(1e6) as i32;
        (period - 1, period)
    } else {
        (3, (3.0 / share).ceil().min(1e6) as i32)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::optics::ArrayKind;

    fn grid(array: ArrayKind, pitch: f64, angle: f64) -> Grid {
        let turn = if array == ArrayKind::Square { 90f64 } else { 60.0 }.to_radians();
        let along = |a: f64| [pitch * a.cos(), pitch * a.sin()];
        Grid::affine(array, [300.2, 199.7], [along(angle), along(angle + turn)], [600, 400])
    }

    #[test]
    fn a_job_of_no_pairs_has_nothing_to_do() {
        let plan = Plan::new(&grid(ArrayKind::Square, 9.3, 0.0), &Motion::NONE, 8.0, usize::MAX);
        let job = plan.job(&[]);
        assert!(job.rows.is_empty() && job.scores.is_empty());
    }

    #[test]
    fn every_pair_is_compared_once_with_its_tiles_at_hand() {
        for (array, angle) in [(ArrayKind::Square, 0.01), (ArrayKind::Square, 0.7), (ArrayKind::Hexagonal, -0.3)] {
            let plan = Plan::new(&grid(array, 9.3, angle), &Motion::NONE, 8.0, usize::MAX);
            let mut seen = std::collections::HashSet::new();
            for job in plan.jobs.iter().chain(&plan.clusters(20)) {
                let mut ring = vec![None; job.slots];
                for row in &job.rows {
                    for &(lens, slot) in &row.tiles {
                        ring[usize::from(slot)] = Some(lens);
                    }
                    for link in &row.links {
                        let ends = link.slots.map(|slot| ring[usize::from(slot)]);
                        assert_eq!(ends, [Some(link.pair.first), Some(link.pair.second)]);
                    }
                }
            }
            for link in plan.jobs.iter().flat_map(Job::links) {
                assert!(seen.insert((link.pair.first, link.pair.second)), "{:?} twice", link.pair);
                let (a, b) = (plan.centre(link.pair.first), plan.centre(link.pair.second));
                assert!((f64::hypot(b[0] - a[0], b[1] - a[1]) - 9.3).abs() < 1e-9);
            }
            assert_eq!(seen.len(), plan.pairs);
            // About two or three pairs a micro-image.
            let expected = plan.direction_count * plan.lenses.len();
            assert!(seen.len() < expected && seen.len() > expected * 9 / 10, "{} of {expected}", seen.len());
        }
    }

    #[test]
    fn of_too_many_micro_images_whole_rows_are_left_out() {
        let whole = Plan::new(&grid(ArrayKind::Square, 9.3, 0.01), &Motion::NONE, 8.0, usize::MAX);
        for share in [0.9, 0.8, 0.6, 0.3] {
            let most = (share * whole.lenses.len() as f64) as usize;
            let plan = Plan::new(&grid(ArrayKind::Square, 9.3, 0.01), &Motion::NONE, 8.0, most);
            let kept = plan.lenses.len() as f64 / whole.lenses.len() as f64;
            assert!(kept < share + 0.05 && kept > share - 0.12, "{kept} for {share}");
            assert!(plan.pairs as f64 > 0.6 * kept * whole.pairs as f64, "{share}");
        }
    }

    #[test]
    fn stars_have_all_neighbours() {
        for (array, most) in [(ArrayKind::Square, 4), (ArrayKind::Hexagonal, 6)] {
            let plan = Plan::new(&grid(array, 15.0, 0.1), &Motion::NONE, 10.0, usize::MAX);
            let stars = plan.stars(&plan.jobs, 50);
            assert!(stars.len() > 45);
            assert_eq!(stars.iter().map(|s| s.rays.len()).max(), Some(most));
            for ray in stars.iter().flat_map(|s| s.rays.iter().map(move |r| (s.lens, r))) {
                let (lens, ray) = ray;
                assert_eq!(lens, if ray.outwards { ray.pair.first } else { ray.pair.second });
                let job = &plan.jobs[ray.job as usize];
                assert_eq!(job.links().nth(ray.score as usize).map(|l| l.pair.first), Some(ray.pair.first));
            }
        }
    }
}
