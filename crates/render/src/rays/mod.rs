//! Rays through the render region: samples, composition, and the data kept between pictures.
//!
//! - `line`: a ray and its samples in a box. `run`: samples between voxels.
//! - `visible_blocks`: blocks of samples in which anything may be visible (empty-space skipping).
//! - `cast`, `composite`: a ray's samples and their composition.
//! - `cache`: kept samples and blocks. `slab`: samples of rays inside a body (D-buffer).
//! - `marks`: samples that a change may have reached. `rows`: casts their rays again.
//! - `tile`: the rays of a tile of a new view, cast in lockstep.

pub(crate) mod cache;
pub(crate) mod cast;
pub(crate) mod composite;
pub(crate) mod line;
pub(crate) mod marks;
pub(crate) mod rows;
pub(crate) mod run;
pub(crate) mod slab;
pub(crate) mod tile;
pub(crate) mod visible_blocks;
