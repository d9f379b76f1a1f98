//! Exact rays from the sensor to the board, in either precision.
//!
//! ```text
//!   sensor  MLA            main lens M      C    inner   outer        board
//!     |p-----|u----------------|m-----------+------(-------(------------|X
//!     |<-b ->|<------ d ------>|<--- e ---->|
//! ```
//!
//! A ray starts at p on the sensor and passes u on the microlens with centre c. What follows is vector algebra: no angle
//! is taken as small, at the spheres Snell's law is applied to directions, and nothing here knows of image distances.

use std::ops::{Add, Div, Mul, Neg, Sub};

use super::camera::{CameraTruth, Medium};
use crate::sim::scene::Board;

/// The arithmetic that a ray needs, so that the fast path (f32) and the accurate one (f64) are one text.
pub(super) trait Real:
    Copy
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + PartialOrd
{
    fn of(value: f64) -> Self;
    fn root(self) -> Self;
}

impl Real for f32 {
    #[inline(always)]
    fn of(value: f64) -> Self {
        value as Self
    }
    #[inline(always)]
    fn root(self) -> Self {
        self.sqrt()
    }
}

impl Real for f64 {
    #[inline(always)]
    fn of(value: f64) -> Self {
        value
    }
    #[inline(always)]
    fn root(self) -> Self {
        self.sqrt()
    }
}

pub(super) type Vector<T> = [T; 3];
type Matrix<T> = [Vector<T>; 3];

#[inline(always)]
pub(super) fn dot<T: Real>(a: Vector<T>, b: Vector<T>) -> T {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline(always)]
fn apply<T: Real>(m: &Matrix<T>, v: Vector<T>) -> Vector<T> {
    [dot(m[0], v), dot(m[1], v), dot(m[2], v)]
}

/// The least rotation that turns the plane z = 0 into one that rises by `slopes` along x and y.
pub(super) fn tilt(slopes: [f64; 2]) -> Matrix<f64> {
    let length = (1.0 + slopes[0].powi(2) + slopes[1].powi(2)).sqrt();
    // The normal n; Rodrigues' formula for the rotation of z into n about z × n.
    let n = [-slopes[0] / length, -slopes[1] / length, 1.0 / length];
    let k = 1.0 / (1.0 + n[2]);
    [
        [1.0 - k * n[0] * n[0], -k * n[0] * n[1], n[0]],
        [-k * n[0] * n[1], 1.0 - k * n[1] * n[1], n[1]],
        [-n[0], -n[1], n[2]],
    ]
}

fn transpose(m: &Matrix<f64>) -> Matrix<f64> {
    [[m[0][0], m[1][0], m[2][0]], [m[0][1], m[1][1], m[2][1]], [m[0][2], m[1][2], m[2][2]]]
}

fn multiply(a: &Matrix<f64>, b: &Matrix<f64>) -> Matrix<f64> {
    let columns = transpose(b);
    [
        [dot(a[0], columns[0]), dot(a[0], columns[1]), dot(a[0], columns[2])],
        [dot(a[1], columns[0]), dot(a[1], columns[1]), dot(a[1], columns[2])],
        [dot(a[2], columns[0]), dot(a[2], columns[1]), dot(a[2], columns[2])],
    ]
}

fn vector<T: Real>(v: Vector<f64>) -> Vector<T> {
    [T::of(v[0]), T::of(v[1]), T::of(v[2])]
}

fn matrix<T: Real>(m: &Matrix<f64>) -> Matrix<T> {
    [vector(m[0]), vector(m[1]), vector(m[2])]
}

/// Where a ray is and where it goes. The direction need not have unit length.
#[derive(Debug, Clone, Copy)]
pub(super) struct Ray<T> {
    pub(super) from: Vector<T>,
    pub(super) along: Vector<T>,
    /// False once the ray is blocked.
    pub(super) open: bool,
}

/// The spheres, from inside.
#[derive(Debug, Clone, Copy)]
pub(super) struct Spheres<T> {
    centre: Vector<T>,
    inner: T,
    outer: T,
    inner_inverse: T,
    outer_inverse: T,
    air_over_shell: T,
    shell_over_water: T,
}

/// A camera's coefficients, ready for tracing.
#[derive(Debug, Clone, Copy)]
pub(super) struct Path<T> {
    b_inverse: T,
    mla_power: T,
    lens_power: T,
    aperture_squared: T,
    /// From the unit of MLA and sensor to the lens's frame.
    lens_from_unit: Matrix<T>,
    mla_in_lens: Vector<T>,
    world_from_lens: Matrix<T>,
    pub(super) spheres: Option<Spheres<T>>,
    /// Whether the main lens has aberrations; most cameras are traced without.
    pub(super) aberrated: bool,
    aberrations: Aberrations<T>,
    /// M in the unit's frame: where chief rays go.
    principal_in_unit: Vector<T>,
    mla_to_sensor: T,
    /// b/(b + distance of M): how far towards M a chief ray has gone at the array.
    chief_share: T,
}

impl<T: Real> Path<T> {
    pub(super) fn new(camera: &CameraTruth) -> Self {
        let world_from_unit = tilt([-camera.mla_tilt[0], -camera.mla_tilt[1]]);
        let world_from_lens = tilt(camera.lens_tilt);
        let lens_from_world = transpose(&world_from_lens);
        let mla = [0.0, 0.0, -camera.lens_to_mla];
        let spheres = match camera.medium {
            Medium::Air => None,
            Medium::Water { shell, e, decentre } => Some(Spheres {
                centre: vector([decentre[0], decentre[1], e]),
                inner: T::of(shell.inner_radius),
                outer: T::of(shell.outer_radius),
                inner_inverse: T::of(1.0 / shell.inner_radius),
                outer_inverse: T::of(1.0 / shell.outer_radius),
                air_over_shell: T::of(crate::optics::shell::N_AIR / shell.n_shell),
                shell_over_water: T::of(shell.n_shell / shell.n_water),
            }),
        };
        let principal = apply(&transpose(&world_from_unit), [-mla[0], -mla[1], -mla[2]]);
        let chief_share = camera.mla_to_sensor / (camera.mla_to_sensor + principal[2]);
        let aberrations = Aberrations {
            distortion: T::of(camera.distortion_k1),
            walk: T::of(camera.pupil_walk / WALK_SLOPE.powi(2)),
        };
        Self {
            b_inverse: T::of(1.0 / camera.mla_to_sensor),
            mla_power: T::of(1.0 / camera.mla_focal_length),
            lens_power: T::of(1.0 / camera.focal_length),
            aperture_squared: T::of((camera.aperture / 2.0).powi(2)),
            lens_from_unit: matrix(&multiply(&lens_from_world, &world_from_unit)),
            mla_in_lens: vector(apply(&lens_from_world, mla)),
            world_from_lens: matrix(&world_from_lens),
            spheres,
            aberrated: camera.distortion_k1 != 0.0 || camera.pupil_walk != 0.0,
            aberrations,
            principal_in_unit: vector(principal),
            mla_to_sensor: T::of(camera.mla_to_sensor),
            chief_share: T::of(chief_share),
        }
    }

    /// Where the chief ray from `p` on the sensor, to the centre of the exit pupil that it sees, crosses the array's plane,
    /// mm.
    #[inline(always)]
    pub(super) fn chief_on_mla(&self, p: [T; 2]) -> [T; 2] {
        if self.aberrated {
            let m = self.pupil_seen_from([p[0], p[1], -self.mla_to_sensor]);
            let share = self.mla_to_sensor / (self.mla_to_sensor + m[2]);
            return [p[0] + (m[0] - p[0]) * share, p[1] + (m[1] - p[1]) * share];
        }
        let m = self.principal_in_unit;
        [p[0] + (m[0] - p[0]) * self.chief_share, p[1] + (m[1] - p[1]) * self.chief_share]
    }

    /// The inverse: where the chief ray through `c` on the array meets the sensor, mm.
    pub(super) fn chief_on_sensor(&self, c: [T; 2]) -> [T; 2] {
        let m = if self.aberrated { self.pupil_seen_from([c[0], c[1], T::of(0.0)]) } else { self.principal_in_unit };
        let share = self.mla_to_sensor / m[2];
        [c[0] - (m[0] - c[0]) * share, c[1] - (m[1] - c[1]) * share]
    }

    /// Centre of the exit pupil as a chief ray from a place in the unit sees it, in the unit's frame.
    #[inline(never)]
    fn pupil_seen_from(&self, place: Vector<T>) -> Vector<T> {
        // The lens's axis in the unit's frame: the matrix is a rotation.
        let axis = self.lens_from_unit[2];
        let mut m = self.principal_in_unit;
        let mut walk = T::of(0.0);
        // The configuration keeps each round's error below a fifth of the last one's.
        for _ in 0..16 {
            let along = apply(&self.lens_from_unit, [m[0] - place[0], m[1] - place[1], m[2] - place[2]]);
            let s = [along[0] / along[2], along[1] / along[2]];
            // Where it crosses the lens's plane, before the pupil's centre, the lens bends it back a little.
            let field = T::of(1.0) + walk * self.lens_power;
            walk = self.aberrations.walk * field * field * (s[0] * s[0] + s[1] * s[1]);
            let from = self.principal_in_unit;
            m = [from[0] + walk * axis[0], from[1] + walk * axis[1], from[2] + walk * axis[2]];
        }
        m
    }

    /// The ray after the main lens, in the world's frame. `p` and `u` are relative to the microlens's centre `c`, so
    /// that short lengths keep their digits.
    #[inline(always)]
    pub(super) fn through_lens(&self, p: [T; 2], u: [T; 2], c: [T; 2]) -> Ray<T> {
        if self.aberrated { self.through::<true>(p, u, c) } else { self.through::<false>(p, u, c) }
    }

    /// As [`Self::through_lens`], with the lens's aberrations or as if it had none.
    #[inline(always)]
    pub(super) fn through<const ABERRATED: bool>(&self, p: [T; 2], u: [T; 2], c: [T; 2]) -> Ray<T> {
        let (m, s) = self.at_lens(p, u, c);
        let ideal = [s[0] - m[0] * self.lens_power, s[1] - m[1] * self.lens_power];
        if !ABERRATED {
            let open = m[0] * m[0] + m[1] * m[1] <= self.aperture_squared;
            return self.leave_lens(m, ideal, open);
        }
        // All rays of a field, which is one direction on the object side, see the stop in one place.
        let walk = self.aberrations.walk * (ideal[0] * ideal[0] + ideal[1] * ideal[1]);
        let stop = [m[0] + s[0] * walk, m[1] + s[1] * walk];
        let open = stop[0] * stop[0] + stop[1] * stop[1] <= self.aperture_squared;
        let (share, bent) = self.aberrations.undistorted(ideal);
        self.leave_lens(m, [ideal[0] * share, ideal[1] * share], open & bent)
    }

    /// Where the ray meets the main lens's plane, and its slope there, in the lens's frame.
    #[inline(always)]
    fn at_lens(&self, p: [T; 2], u: [T; 2], c: [T; 2]) -> ([T; 2], [T; 2]) {
        // s = (u − p)/b − (u − c)/f_MLA with everything from c.
        let slope = |k: usize| (u[k] - p[k]) * self.b_inverse - u[k] * self.mla_power;
        let zero = T::of(0.0);
        let one = T::of(1.0);
        let along = apply(&self.lens_from_unit, [slope(0), slope(1), one]);
        let place = apply(&self.lens_from_unit, [c[0] + u[0], c[1] + u[1], zero]);
        let from = [place[0] + self.mla_in_lens[0], place[1] + self.mla_in_lens[1], place[2] + self.mla_in_lens[2]];
        let unit = one / along[2];
        let s = [along[0] * unit, along[1] * unit];
        ([from[0] - from[2] * s[0], from[1] - from[2] * s[1]], s)
    }

    #[inline(always)]
    fn leave_lens(&self, m: [T; 2], slope: [T; 2], open: bool) -> Ray<T> {
        let from = apply(&self.world_from_lens, [m[0], m[1], T::of(0.0)]);
        Ray { from, along: apply(&self.world_from_lens, [slope[0], slope[1], T::of(1.0)]), open }
    }
}

/// Slope of the field for which [`CameraTruth::pupil_walk`] is given.
const WALK_SLOPE: f64 = 0.1;

/// What keeps the main lens from being ideal.
#[derive(Debug, Clone, Copy)]
struct Aberrations<T> {
    /// Brown's k1.
    distortion: T,
    /// How far the exit pupil is from M for a field of slope 1, mm.
    walk: T,
}

impl<T: Real> Aberrations<T> {
    /// The share of its ideal slope that a ray has on the object side: the solution λ of λ (1 + k1 (λ s)²) = 1. False
    /// beyond where a barrel's law turns back.
    #[inline(always)]
    fn undistorted(&self, ideal: [T; 2]) -> (T, bool) {
        let one = T::of(1.0);
        let (two, three) = (T::of(2.0), T::of(3.0));
        let a = self.distortion * (ideal[0] * ideal[0] + ideal[1] * ideal[1]);
        // Newton: with |a| below 0.1 its fourth round is exact in double precision.
        let mut share = one;
        for _ in 0..5 {
            let square = a * share * share;
            share = (one + two * square * share) / (one + three * square);
        }
        (share, a > T::of(-4.0 / 27.0))
    }
}

impl<T: Real> Spheres<T> {
    /// The ray in the water. A ray that meets the rim (the shell is a half sphere), misses it or is totally reflected
    /// is blocked.
    #[inline(always)]
    pub(super) fn refract(&self, ray: Ray<T>) -> Ray<T> {
        let one = T::of(1.0);
        let length = one / dot(ray.along, ray.along).root();
        let along = [ray.along[0] * length, ray.along[1] * length, ray.along[2] * length];
        let from = [ray.from[0] - self.centre[0], ray.from[1] - self.centre[1], ray.from[2] - self.centre[2]];
        let (inside, normal) = cross(from, along, self.inner, self.inner_inverse);
        let (along, bent) = snell(along, normal, self.air_over_shell);
        let clear = bent & (normal[2] > T::of(0.0)) & (dot(from, from) < self.inner * self.inner);
        let (outside, normal) = cross(inside, along, self.outer, self.outer_inverse);
        let (along, refracted) = snell(along, normal, self.shell_over_water);
        let from = [outside[0] + self.centre[0], outside[1] + self.centre[1], outside[2] + self.centre[2]];
        Ray { from, along, open: ray.open & clear & refracted }
    }
}

/// Where a ray from inside leaves the sphere about the origin, and the outward normal there.
#[inline(always)]
fn cross<T: Real>(from: Vector<T>, along: Vector<T>, radius: T, inverse: T) -> (Vector<T>, Vector<T>) {
    let h = dot(from, along);
    let reach = (h * h + (radius * radius - dot(from, from))).root() - h;
    let to = [from[0] + reach * along[0], from[1] + reach * along[1], from[2] + reach * along[2]];
    (to, [to[0] * inverse, to[1] * inverse, to[2] * inverse])
}

/// Snell's law for unit vectors, the normal on the side the ray goes to: t = η i + (√(1 − η² (1 − cos²)) − η cos) n. False when totally reflected.
#[inline(always)]
pub(super) fn snell<T: Real>(along: Vector<T>, normal: Vector<T>, ratio: T) -> (Vector<T>, bool) {
    let one = T::of(1.0);
    let cos = dot(along, normal);
    let square = one - ratio * ratio * (one - cos * cos);
    let k = square.root() - ratio * cos;
    let bent = [ratio * along[0] + k * normal[0], ratio * along[1] + k * normal[1], ratio * along[2] + k * normal[2]];
    (bent, square >= T::of(0.0))
}

/// A board's plane and its own axes.
#[derive(Debug, Clone, Copy)]
pub(super) struct Plane<T> {
    normal: Vector<T>,
    height: T,
    centre: Vector<T>,
    axes: [Vector<T>; 2],
}

impl<T: Real> Plane<T> {
    pub(super) fn new(camera: &CameraTruth, board: &Board) -> Self {
        let z = match camera.medium {
            Medium::Air => board.distance,
            Medium::Water { shell, e, .. } => e + shell.outer_radius + board.distance,
        };
        let turn = transpose(&tilt(board.tilt));
        let centre = [0.0, 0.0, z];
        Self {
            normal: vector(turn[2]),
            height: T::of(dot(turn[2], centre)),
            centre: vector(centre),
            axes: [vector(turn[0]), vector(turn[1])],
        }
    }

    /// Where the ray meets the board, in the board's own x and y from its centre, mm.
    #[inline(always)]
    pub(super) fn meet(&self, ray: &Ray<T>) -> [T; 2] {
        let reach = (self.height - dot(self.normal, ray.from)) / dot(self.normal, ray.along);
        let place = [
            ray.from[0] + reach * ray.along[0] - self.centre[0],
            ray.from[1] + reach * ray.along[1] - self.centre[1],
            ray.from[2] + reach * ray.along[2] - self.centre[2],
        ];
        [dot(self.axes[0], place), dot(self.axes[1], place)]
    }
}
