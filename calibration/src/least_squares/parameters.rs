//! Blocks of parameters, each with its name, unit, typical size and rule for steps.

use glam::{DQuat, DVec3};

/// The side from which a step turns a rotation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    /// exp(step)·R: about the axes of the frame that R maps to.
    Left,
    /// R·exp(step): about the axes of the frame that R maps from.
    Right,
}

/// A rotation among the parameters; its step is a vector of angles, rad.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Rotation(Place);

/// N numbers among the parameters, to which a step is added.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Vector<const N: usize>(Place);

/// N positive factors among the parameters. A step multiplies them by its exponential, so their
/// covariance is that of their logarithms, that is, relative.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Scale<const N: usize>(Place);

/// Position of a block among the parameters.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Place {
    /// Index of the block.
    block: usize,
    /// Index of its first number in a state.
    value: usize,
}

/// A block whose step has K components: [`Rotation`] (3), [`Vector`], [`Scale`].
pub trait Block<const K: usize>: Copy {
    /// Returns its position.
    fn place(self) -> Place;
}

impl Block<3> for Rotation {
    fn place(self) -> Place {
        self.0
    }
}

impl<const K: usize> Block<K> for Vector<K> {
    fn place(self) -> Place {
        self.0
    }
}

impl<const K: usize> Block<K> for Scale<K> {
    fn place(self) -> Place {
        self.0
    }
}

/// The rule by which a step changes a block.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Rotation(Side),
    Vector,
    Scale,
}

#[derive(Debug, Clone)]
struct Description {
    kind: Kind,
    value: usize,
    /// Names of the components of its step.
    names: Vec<String>,
    unit: &'static str,
    typical: f64,
    held: bool,
}

/// The parameters of a problem, and their start values.
#[derive(Debug, Clone, Default)]
pub struct Parameters {
    blocks: Vec<Description>,
    start: Vec<f64>,
}

/// Values of all parameters.
#[derive(Debug, Clone, PartialEq)]
pub struct State(Vec<f64>);

impl Parameters {
    /// Returns an empty list.
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds a rotation. `typical_rad` is the angle that moves residuals by about as much as the
    /// other parameters' typical sizes: those sizes over the lever between them.
    pub fn rotation(&mut self, name: &str, side: Side, typical_rad: f64, start: DQuat) -> Rotation {
        let names = ["x", "y", "z"].map(|axis| format!("{name} about {axis}")).to_vec();
        Rotation(self.push(Kind::Rotation(side), names, "rad", typical_rad, &start.normalize().to_array()))
    }

    /// Adds a point or a shift in space, mm.
    pub fn point(&mut self, name: &str, typical_mm: f64, start: DVec3) -> Vector<3> {
        self.vector(name, ["x", "y", "z"], "mm", typical_mm, start.to_array())
    }

    /// Adds numbers of one unit; `components` are appended to the block's name and may be
    /// empty.
    pub fn vector<const N: usize>(
        &mut self,
        name: &str,
        components: [&str; N],
        unit: &'static str,
        typical: f64,
        start: [f64; N],
    ) -> Vector<N> {
        Vector(self.push(Kind::Vector, named(name, components), unit, typical, &start))
    }

    /// Adds factors that stay positive. `typical` is relative: 0.01 for one per cent.
    pub fn scale<const N: usize>(
        &mut self,
        name: &str,
        components: [&str; N],
        typical: f64,
        start: [f64; N],
    ) -> Scale<N> {
        Scale(self.push(Kind::Scale, named(name, components), "relative", typical, &start))
    }

    /// Fixes a block at its start.
    pub fn hold<const K: usize>(&mut self, block: impl Block<K>) {
        self.blocks[block.place().block].held = true;
    }

    /// Returns the start values.
    pub fn start(&self) -> State {
        State(self.start.clone())
    }

    /// Sets the start values, for example to the solution of a more robust loss.
    pub fn begin_at(&mut self, state: &State) {
        self.start.clone_from(&state.0);
    }

    /// Returns the number of components of a step of all free blocks.
    pub fn steps(&self) -> usize {
        self.free().map(|block| block.names.len()).sum()
    }

    /// Returns the state after a step.
    ///
    /// # Panics
    /// Panics unless the step has [`Self::steps`] components.
    pub fn moved(&self, state: &State, step: &[f64]) -> State {
        assert_eq!(step.len(), self.steps(), "a step's components");
        let mut moved = state.clone();
        let mut rest = step;
        for Description { kind, value, names, .. } in self.free() {
            let (own, after) = rest.split_at(names.len());
            rest = after;
            match kind {
                Kind::Rotation(side) => {
                    let turn = DQuat::from_scaled_axis(DVec3::from_slice(own));
                    let before = DQuat::from_slice(&moved.0[*value..]);
                    let after = if *side == Side::Left { turn * before } else { before * turn };
                    after.normalize().write_to_slice(&mut moved.0[*value..]);
                }
                Kind::Vector => moved.0[*value..].iter_mut().zip(own).for_each(|(x, step)| *x += step),
                Kind::Scale => moved.0[*value..].iter_mut().zip(own).for_each(|(x, step)| *x *= step.exp()),
            }
        }
        moved
    }

    /// Returns the name and unit of each component of a step.
    pub(super) fn components(&self) -> impl Iterator<Item = (&str, &'static str)> {
        self.free().flat_map(|block| block.names.iter().map(|name| (name.as_str(), block.unit)))
    }

    /// Returns the typical size of each component of a step.
    pub(super) fn typical(&self) -> Vec<f64> {
        self.free().flat_map(|block| block.names.iter().map(|_| block.typical)).collect()
    }

    /// Returns each block's first component in a step; `None` for fixed blocks.
    pub(super) fn columns(&self) -> Vec<Option<usize>> {
        let mut next = 0;
        let column = |block: &Description| {
            (!block.held).then(|| {
                next += block.names.len();
                next - block.names.len()
            })
        };
        self.blocks.iter().map(column).collect()
    }

    fn free(&self) -> impl Iterator<Item = &Description> {
        self.blocks.iter().filter(|block| !block.held)
    }

    fn push(&mut self, kind: Kind, names: Vec<String>, unit: &'static str, typical: f64, start: &[f64]) -> Place {
        let place = Place { block: self.blocks.len(), value: self.start.len() };
        self.blocks.push(Description { kind, value: place.value, names, unit, typical, held: false });
        self.start.extend_from_slice(start);
        place
    }
}

fn named<const N: usize>(name: &str, components: [&str; N]) -> Vec<String> {
    components.map(|component| format!("{name} {component}").trim_end().to_owned()).to_vec()
}

impl Place {
    /// Returns the index among the blocks.
    pub(super) fn block(self) -> usize {
        self.block
    }
}

impl State {
    /// Returns a rotation.
    pub fn rotation(&self, block: Rotation) -> DQuat {
        DQuat::from_slice(&self.0[block.0.value..])
    }

    /// Returns a point.
    pub fn point(&self, block: Vector<3>) -> DVec3 {
        DVec3::from_slice(&self.0[block.0.value..])
    }

    /// Returns numbers.
    pub fn vector<const N: usize>(&self, block: Vector<N>) -> [f64; N] {
        std::array::from_fn(|i| self.0[block.0.value + i])
    }

    /// Returns factors.
    pub fn scale<const N: usize>(&self, block: Scale<N>) -> [f64; N] {
        std::array::from_fn(|i| self.0[block.0.value + i])
    }
}
