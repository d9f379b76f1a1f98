//! From pixels to numbers with uncertainties: pure functions, no I/O, clock, async or logging.
//!
//! Three lengths are never swapped here: the *MLA pitch* D_MLA (made), the *micro-image pitch* D_MLA (d + b)/d (seen in
//! a white frame), and the *spacing* l_P0P1 (between the image points of one object point under adjacent microlenses).
//! Frame coordinates: pixel centres at integers, x right, y down; rotations from +x towards +y. Field terms use x and y
//! from the frame's centre in units of half its width, in both directions.

pub mod calibration;
pub mod clarity;
pub mod combined;
pub mod depth;
pub mod grid;
pub mod interpolation;
pub mod known;
pub mod live;
mod matching;
pub mod measurement;
pub mod microlenses;
pub mod misfit;
pub mod mosaic;
pub mod overlay;
pub mod pictures;
pub mod spacing;
pub mod stillness;
pub mod view;
pub mod vignetting;
